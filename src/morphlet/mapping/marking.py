"""A spherical map with places of its mesh among its vertices, so that markers anywhere on the faces can be laid exactly."""

import numpy as np
from jaxtyping import Int

from morphlet.errors import InputError
from morphlet.sphere.map import SphericalMap
from morphlet.surface.insertion import inserted
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.points import SurfacePoints
from morphlet.surface.repair import Repaired


def marked(spherical: SphericalMap, places: SurfacePoints) -> tuple[SphericalMap, Int[np.ndarray, "k"]]:
    """The same map, of a surface whose vertices the places are.

    Parameters
    ----------
    spherical
        A map without inverted faces.
    places
        Places on the mesh as given.

    Returns
    -------
    map, vertices
        The map of the closed surface, its own vertices first and in their order; and which vertex each place became.

    Raises
    ------
    InputError
        If a place is on no face of the mesh, or on one that was not mapped.

    Notes
    -----
    A new vertex goes where the map takes its place, in the plane of its face's corners: no face is inverted by that. O(n + k).

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints, spherical_map
    >>> from morphlet.mapping.marking import marked
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = spherical_map(Mesh(*icosphere(1)))
    >>> fine, vertices = marked(ball, SurfacePoints([5], [[0.2, 0.5, 0.3]]))
    >>> fine.mesh, vertices, fine.certificate().holds
    (Mesh(43 vertices, 82 faces), array([42]), True)
    """
    surface = spherical.surface
    fine = inserted(surface.mesh, on_closed(surface, places))
    added = fine.places.positions(surface.mesh.with_vertices(spherical.closed_points))
    points = np.concatenate([spherical.closed_points, added / np.linalg.norm(added, axis=1, keepdims=True)])
    return SphericalMap(_as_source(fine.mesh, surface.face_map[fine.origins] < 0), points, spherical.trace), fine.vertices


def on_closed(surface: Repaired, places: SurfacePoints) -> SurfacePoints:
    """Places on a mesh as given, on the closed surface.

    Raises
    ------
    InputError
        If a place is on no face of the mesh, or on one that the closed surface does not have.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.mapping.marking import on_closed
    >>> from morphlet.surface.repair import close
    >>> inside_out = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 3, 1], [1, 3, 2], [0, 2, 3]])
    >>> on_closed(close(inside_out), SurfacePoints([0], [[0.2, 0.3, 0.5]])).weights
    array([[0.2, 0.5, 0.3]])
    """
    row = np.full(surface.source.n_faces, -1)
    real = np.flatnonzero(surface.face_map >= 0)
    row[surface.face_map[real]] = real
    known = (places.faces < len(row)) & (row[np.minimum(places.faces, len(row) - 1)] >= 0)
    if not known.all():
        lost = np.flatnonzero(~known)
        raise InputError("places on faces that are mapped", f"{len(lost)} that are not", "drop these places, or repair the mesh", lost)
    rows = row[places.faces]
    return SurfacePoints(rows, np.where(surface.flipped[rows, None], places.weights[:, [0, 2, 1]], places.weights))


def _as_source(mesh: Mesh, virtual: np.ndarray) -> Repaired:
    """A closed surface as if it had been given so, but for its virtual faces."""
    given = Mesh(mesh.vertices, Topology(mesh.faces[~virtual], mesh.n_vertices))
    face_map = np.where(virtual, -1, np.cumsum(~virtual) - 1)
    valid = np.array(given.topology.referenced)
    return Repaired(given, mesh, np.arange(mesh.n_vertices), valid, face_map, np.zeros(mesh.n_faces, bool), ())
