"""What a mesh is, and what it lacks for a spherical map."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool

from morphlet.errors import MorphletError
from morphlet.surface.fans import components, edge_uses, fans, next_corner
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.repair import close
from morphlet.surface.requirements import degenerate, pinched

FLAT = 1e-12
"""A face is degenerate if its height is below this fraction of its longest side: its normal is rounding."""


@dataclass(frozen=True, eq=False)
class Description:
    """The facts about a mesh.

    Parameters
    ----------
    vertices, faces
        How many there are, referenced or not.
    components
        Parts joined by shared vertices.
    boundary_loops
        Closed chains of edges with one face, counted apart where they touch.
    genus
        Number of handles, summed over the components; None where the mesh is not manifold and consistently oriented.
    nonmanifold_edges
        Edges with more than two faces. This and the next count leave out faces that repeat a vertex.
    duplicate_directed_edges
        Directed edges that several faces run along: non-manifold or inconsistently oriented.
    unreferenced_vertices
        Vertices in no face.
    degenerate_faces
        Faces that repeat a vertex or have no height.
    area, volume
        Total area and signed enclosed volume, in mesh units squared and cubed.
    bbox_diagonal
        Diagonal of the bounding box, in mesh units.
    fit_for_sphere
        Whether `close` makes a simplicial sphere of it, so that it has a spherical map.
    advice
        What to do, or what will be mended on the way.
    """

    vertices: int
    faces: int
    components: int
    boundary_loops: int
    genus: int | None
    nonmanifold_edges: int
    duplicate_directed_edges: int
    unreferenced_vertices: int
    degenerate_faces: int
    area: float
    volume: float
    bbox_diagonal: float
    fit_for_sphere: bool
    advice: str


def describe(mesh: Mesh) -> Description:
    """The facts about a mesh, whatever its state.

    Parameters
    ----------
    mesh
        Anything a file holds; it is measured as it is, before any repair.

    Returns
    -------
    Description
        The keys of `morphlet info`.

    Notes
    -----
    O(m log m), most of it the trial repair that `fit_for_sphere` and `advice` report on.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.description import describe
    >>> facts = describe(Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]]))
    >>> facts.boundary_loops, facts.genus, facts.fit_for_sphere, facts.advice
    (1, 0, True, 'ready for a spherical map once mended: filled boundary loops of 4 edges (1)')
    """
    topology, flat = mesh.topology, _flat(mesh)
    proper = Topology(topology.faces[~degenerate(topology.faces)], topology.n_vertices)
    loops, counts = _loop_count(proper), edge_uses(proper.faces, proper.n_vertices).count
    doubled = proper.halfedges[proper.halfedge_counts[:, 0] > 1]
    fit, advice = _fitness(mesh)
    return Description(
        vertices=mesh.n_vertices,
        faces=mesh.n_faces,
        components=topology.n_components,
        boundary_loops=loops,
        genus=_genus(topology, loops),
        nonmanifold_edges=int((counts > 2).sum()),
        duplicate_directed_edges=len(np.unique(doubled, axis=0)),
        unreferenced_vertices=int((~topology.referenced).sum()),
        degenerate_faces=int(flat.sum()),
        area=mesh.area,
        volume=mesh.volume,
        bbox_diagonal=mesh.bbox_diagonal,
        fit_for_sphere=fit,
        advice=advice,
    )


def _fitness(mesh: Mesh) -> tuple[bool, str]:
    """Whether the mesh can be closed into a sphere; what that takes, or why it cannot."""
    try:
        repairs = close(mesh).repairs
    except MorphletError as error:
        return False, f"needs {error.needed}, has {error.found}: {error.advice}"
    if not repairs:
        return True, "ready for a spherical map"
    return True, "ready for a spherical map once mended: " + ", ".join(f"{repair.what} ({repair.count})" for repair in repairs)


def _flat(mesh: Mesh) -> Bool[np.ndarray, "m"]:
    """Whether a face repeats a vertex or has no height."""
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(np.roll(corners, -1, axis=1) - corners, axis=2).max(axis=1, initial=0.0)
    return degenerate(mesh.faces) | (2 * mesh.face_areas <= FLAT * longest**2)


def _loop_count(topology: Topology) -> int:
    """Boundary loops, followed round the fans of faces so that two that touch at a vertex count as two."""
    uses = edge_uses(topology.faces, topology.n_vertices)
    label = fans(topology.faces, uses.used(2))
    rim = uses.used(1)[:, 0]
    start, end = label[rim], label[next_corner(rim)]
    chains = components(len(label), start, end)
    return len(np.unique(chains[start]))


def _genus(topology: Topology, loops: int) -> int | None:
    """Handles of all parts together, from the Euler characteristic; None if undefined."""
    manifold = not (topology.halfedge_counts[:, 0] > 1).any() and not degenerate(topology.faces).any()
    if not manifold or not len(topology.faces) or len(pinched(topology)):
        return None
    return (2 * topology.n_components - topology.euler_characteristic - loops) // 2
