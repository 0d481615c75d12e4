"""Correspondences by markers anywhere on the faces, not at vertices only.

The markers become vertices of both surfaces; the source is laid into the target's sphere with them, exactly onto each other; then they
are taken out again. What is left are the vertices of the source as given, laid as the markers demand, and certified anew.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet.errors import SolveError
from morphlet.mapping.correspondence import Correspondence
from morphlet.mapping.marking import marked
from morphlet.numerics.optimize import OnStep
from morphlet.pipeline.correspond import correspond_maps
from morphlet.pipeline.results import CorrespondResult, Figures
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import NO_PAIRS, PointPairs, VertexPairs


@dataclass(frozen=True, eq=False)
class PlacedResult:
    """A correspondence by markers on the faces.

    Parameters
    ----------
    result
        Of the meshes as given; without pairs of vertices.
    refined
        Of the closed surfaces with the markers among their vertices, where they were pulled together.
    pairs
        The markers.
    """

    result: CorrespondResult
    refined: CorrespondResult
    pairs: PointPairs

    @property
    def correspondence(self) -> Correspondence:
        """Where each vertex of the source as given lies on the target as given."""
        return self.result.correspondence

    @property
    def residuals(self) -> Float[np.ndarray, "p"]:
        """Distance from the image of each marker to its partner, in mesh units.

        The image of a place is taken from the flat image of its face, so that a part of the distance is due to the size of the faces:
        up to a fifth of an edge was seen for markers inside faces of the source, a hundredth of that for markers at its vertices.
        """
        found = self.result.correspondence
        images = self.pairs.source.positions(found.source.with_vertices(found.positions))
        return np.linalg.norm(images - self.pairs.target.positions(found.target), axis=1)

    def figures(self) -> Figures:
        """The figures of the correspondence, with the number of markers and the root mean square of their residuals."""
        rmse = float(np.sqrt(np.mean(self.residuals**2))) if len(self.pairs) else None
        return self.result.figures() | {"pairs": len(self.pairs), "pairs_rmse": rmse}


def correspond_places(source: Mesh, target: Mesh, pairs: PointPairs, on_step: OnStep | None = None) -> PlacedResult:
    """Where each vertex of the source lies on the target, by markers anywhere on their faces.

    Parameters
    ----------
    source, target
        Meshes that `spherical_map` accepts.
    pairs
        Places that belong together; `nearest` gives those of positions in space. Three or more are used as they are; fewer are
        completed by matching feature regions.
    on_step
        Called with each step of the optimisations; may raise `Cancelled`.

    Raises
    ------
    MeshError
        If a mesh has no spherical map.
    InputError
        If the pairs do not fit the meshes.
    SolveError
        If no map passes the certificate, with the markers or without.

    Notes
    -----
    As long as `correspond`.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.pipeline.placed import correspond_places
    >>> from morphlet.surface.pairs import PointPairs
    >>> points, faces = icosphere(2)
    >>> ball, egg = Mesh(points, faces), Mesh(points * [1, 1, 1.5], faces)
    >>> middles = SurfacePoints([0, 100, 200, 300], [[1 / 3, 1 / 3, 1 / 3]] * 4)
    >>> found = correspond_places(ball, egg, PointPairs(middles, middles))
    >>> found.figures()["folds_sphere"], bool(found.residuals.max() < 0.1), bool(found.refined.figures()["pairs_rmse"] < 1e-3)
    (0, True, True)
    """
    pairs.checked(source, target)
    return correspond_places_maps(spherical_map(source, on_step=on_step), spherical_map(target, on_step=on_step), pairs, on_step)


def correspond_places_maps(
    source_map: SphericalMap, target_map: SphericalMap, pairs: PointPairs, on_step: OnStep | None = None
) -> PlacedResult:
    """The same for meshes whose spherical maps are at hand.

    Parameters
    ----------
    source_map, target_map
        Spherical maps of both meshes.
    pairs, on_step
        As for `correspond_places`.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints, spherical_map
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.pipeline.placed import correspond_places_maps
    >>> from morphlet.surface.pairs import PointPairs
    >>> ball = spherical_map(Mesh(*icosphere(1)))
    >>> corners = SurfacePoints([0, 30, 60], [[1, 0, 0]] * 3)
    >>> found = correspond_places_maps(ball, ball, PointPairs(corners, corners))
    >>> found.figures()["pairs"], round(found.figures()["pairs_rmse"], 3)
    (3, 0.0)
    """
    (fine_source, own), (fine_target, other) = marked(source_map, pairs.source), marked(target_map, pairs.target)
    refined = correspond_maps(fine_source, fine_target, VertexPairs(own, other, pairs.weight, pairs.labels), on_step)
    points = refined.laid.closed_points[: source_map.surface.mesh.n_vertices]
    laid = SphericalMap(source_map.surface, points, refined.laid.trace)
    proof = laid.certificate()
    if not proof.holds:
        raise SolveError("a map without inverted faces", f"{proof.inverted} without the markers", "move the markers to vertices")
    told = (refined.matching, refined.warnings, refined.candidates)
    result = CorrespondResult(source_map, target_map, refined.alignment, laid, NO_PAIRS, *told)
    return PlacedResult(result, refined, pairs)
