"""Two meshes in, a correspondence out (steps 1-4 of the paper on one page)."""

from dataclasses import replace

import numpy as np

from morphlet.features.matching import FEWEST
from morphlet.features.signature import signature
from morphlet.mapping.alignment import SPREAD, Alignment, SphereSamples, align_by_pairs, align_by_search
from morphlet.mapping.correspondence import doubts
from morphlet.mapping.embedding import embed
from morphlet.mapping.warp import warp_by_pairs
from morphlet.numerics.optimize import OnStep
from morphlet.pipeline.candidates import landmark_pairs, matched_regions
from morphlet.pipeline.results import CorrespondResult
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import NO_PAIRS, VertexPairs
from morphlet.surface.requirements import require_area

WAVELETS = 15
"""Of the network that aligns the spheres, as many as in the paper."""
SEARCHED = (
    "the {count} pairs lie within one line through the sphere's centre and determine no rotation: it was searched for, give pairs apart"
)
UNMET = "{count} of {all} pairs could not be brought together: they contradict each other, or left and right are exchanged"
"""What is said of a correspondence that is not to be trusted blindly."""


def correspond(source: Mesh, target: Mesh, pairs: VertexPairs | None = None, on_step: OnStep | None = None) -> CorrespondResult:
    """Where each vertex of the source lies on the target: one to one, without folds.

    Parameters
    ----------
    source, target
        Meshes that `spherical_map` accepts.
    pairs
        Vertices that belong together. Three or more are used as they are; fewer are completed by matching feature regions.
    on_step
        Called with each step of the optimisations; may raise `Cancelled`.

    Returns
    -------
    result
        The maps, the matching, the correspondence; `.figures()` measures them, `.warnings` says what is doubtful.

    Raises
    ------
    MeshError
        If a mesh has no spherical map.
    InputError
        If the pairs do not fit the meshes.

    Notes
    -----
    About as long as four spherical maps of the source.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(2)
    >>> egg = Mesh(points * [1, 1.2, 1.6] * (1 + 0.3 * points[:, [0]] + 0.2 * points[:, [1]]), faces)
    >>> result = correspond(egg, egg)
    >>> result.figures()["folds_sphere"], bool(abs(result.correspondence.positions - egg.vertices).max() < 0.2)
    (0, True)
    """
    if pairs is not None:
        pairs.checked(source, target)
    return correspond_maps(spherical_map(source, on_step=on_step), spherical_map(target, on_step=on_step), pairs, on_step)


def correspond_maps(
    source_map: SphericalMap, target_map: SphericalMap, pairs: VertexPairs | None = None, on_step: OnStep | None = None
) -> CorrespondResult:
    """The same for meshes whose spherical maps are at hand (step 1 of the paper: they may be precomputed and stored).

    Parameters
    ----------
    source_map, target_map
        Spherical maps of both meshes.
    pairs, on_step
        As for `correspond`.

    Raises
    ------
    InputError
        If the pairs do not fit the meshes.
    MeshError
        If one of the meshes has no area.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> one = spherical_map(Mesh(*icosphere(1)))
    >>> result = correspond_maps(one, one, VertexPairs([0, 1, 2], [0, 1, 2]))
    >>> result.figures()["pairs"], round(result.figures()["pairs_rmse"], 3)
    (3, 0.0)
    """
    for spherical in (source_map, target_map):
        require_area(spherical.surface.mesh)
    given = NO_PAIRS if pairs is None else _answered(pairs, source_map, target_map).distinct()
    matching, tried, told = (None, (), ()) if len(given) >= FEWEST else matched_regions(source_map, target_map, given, on_step)
    used = given if matching is None else landmark_pairs(matching, source_map.surface, target_map.surface)
    alignment = aligned(source_map, target_map, used)
    if len(used) and alignment.method == "search":
        told = (*told, SEARCHED.format(count=len(used)))
    laid = embed(source_map.surface, target_map, used, start=alignment(source_map.closed_points), on_step=on_step)
    if len(laid.unmet):
        told = (*told, UNMET.format(count=len(laid.unmet), all=len(used)))
    on_sphere = SphericalMap(source_map.surface, laid.closed_points, laid.trace)
    found = CorrespondResult(source_map, target_map, alignment, on_sphere, used, matching, told, tried)
    return replace(found, warnings=(*told, *doubts(found.correspondence, used)))


def aligned(source_map: SphericalMap, target_map: SphericalMap, pairs: VertexPairs, n_wavelets: int = WAVELETS) -> Alignment:
    """The source's sphere turned towards the target's and warped by a wavelet network; without pairs, turned by a search.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> ball = spherical_map(Mesh(*icosphere(2)))
    >>> aligned(ball, ball, VertexPairs([0, 1, 2], [0, 1, 2])).method
    'pairs'
    """
    points, goals = source_map.points[pairs.source], target_map.points[pairs.target]
    if np.linalg.matrix_rank(points, SPREAD) < 2 or np.linalg.matrix_rank(goals, SPREAD) < 2:
        return align_by_search(_samples(source_map), _samples(target_map))
    turned = align_by_pairs(points, goals, pairs.weight)
    return replace(turned, warp=warp_by_pairs(turned(points), goals, n_wavelets, pairs.weight))


def _answered(pairs: VertexPairs, source_map: SphericalMap, target_map: SphericalMap) -> VertexPairs:
    """The pairs, once it is certain that they name vertices that were mapped."""
    return pairs.checked(source_map.mesh, target_map.mesh).answered(source_map.valid, target_map.valid)


def _samples(spherical: SphericalMap) -> SphereSamples:
    """What each vertex sees around it, placed on the sphere."""
    return SphereSamples(spherical.points, signature(spherical.mesh), spherical.mesh.vertex_areas)
