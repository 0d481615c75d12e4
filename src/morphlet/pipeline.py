"""The paper on one page: two meshes in, a correspondence out, and the morph along it.

1. Map both meshes to the sphere, one to one (step 1; the maps may be made beforehand and passed in).
2. Grow feature regions on both and match them (steps 2 and 10), unless enough vertices were paired by hand. Where several matchings are
   nearly as good, coarse maps decide.
3. Turn the source's sphere so that paired vertices come near each other (section 6.2, Eq. 7), and let a wavelet network move
   them further, smoothly (section 6.2).
4. Lay the source into the target's sphere from there, coarse to fine, pairs onto each other, without folds.
5. Compose: up from the source, down to the target; move the source's vertices to their images (section 7.2), on straight lines,
   with each resolution at its own time, or so that faces turn and stretch.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet import _arrays, metrics
from morphlet.errors import InputError, MeshError
from morphlet.features.matching import CORE_LABEL, FEWEST, Matching, candidates
from morphlet.features.regions import find_regions
from morphlet.features.signature import local_area, signature
from morphlet.mapping import correspondence as quality
from morphlet.mapping.alignment import SPREAD, Alignment, SphereSamples, align_by_pairs, align_by_search
from morphlet.mapping.correspondence import Correspondence, compose, doubts
from morphlet.mapping.embedding import embed, sketch
from morphlet.mapping.overlay import Overlay, overlay
from morphlet.mapping.warp import warp_by_pairs
from morphlet.motion.bands import wavelet_bands
from morphlet.motion.delay import sweep
from morphlet.motion.morph import PATHS, Morph, MorphPath, edge_log_rms_max, self_intersections_max, volume_change_max
from morphlet.motion.schedule import Schedule
from morphlet.numerics.optimize import OnStep
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints
from morphlet.surface.repair import Repaired, close
from morphlet.surface.requirements import require_area
from morphlet.surface.sequence import MeshSequence

Figures = dict[str, float | int | bool | None]
"""Named numbers for a report; None where a figure does not apply."""

WAVELETS = 15
"""Of the network that aligns the spheres, as many as in the paper."""
UNMATCHED = "feature regions could not be matched ({reason}): the spheres were turned by a search alone, give pairs"
SEARCHED = (
    "the {count} pairs lie within one line through the sphere's centre and determine no rotation: it was searched for, give pairs apart"
)
TRIED = "{count} pairings of the tips were nearly as good as each other: of their coarse maps {said} (score ahead by {margin:.3f})"
EXCHANGED = "one pair of tips could as well be another (score ahead by {margin:.3f}): look at the tips next to it"
DECIDED, UNDECIDED = "one fits clearly better", "none fits clearly better than all others: give landmarks, or check the pairs"
UNMET = "{count} of {all} pairs could not be brought together: they contradict each other, or left and right are exchanged"
"""What is said of a correspondence that is not to be trusted blindly."""
MOST_TRIED, MOST_VARIANTS = 4, 2
"""Contested matchings that are tried by a coarse map: those that differ in several pairs, then those that exchange one pair of the best."""
LEAST_UNLIKE = 1e-6
"""Unlikeness below which surfaces are the same: its logarithm stays finite."""
CLEAR = 0.1
"""Score by which the best must be ahead of the next that differs in several pairs: a tenth in one of its factors. A grazer and a predator
in four poses: the right matching was first each time, ahead by 0.11 to 0.45; with less careful landmarks a wrong one once, by 0.07."""
NO_PAIRS = VertexPairs(np.zeros(0, np.int64), np.zeros(0, np.int64))


@dataclass(frozen=True, eq=False)
class Candidate:
    """A matching that was tried by a coarse map.

    Parameters
    ----------
    matching
        Regions and vertices that go together.
    energy
        Of the coarse map: how much it stretches.
    unlikeness
        How much thicker or thinner places are than their images: mean of the difference of the logarithms of `signature.local_area`.
    """

    matching: Matching
    energy: float
    unlikeness: float

    @property
    def score(self) -> float:
        """Cost of the matching and logarithms of the others: lower is better."""
        return self.matching.cost + float(np.log(self.energy) + np.log(self.unlikeness))


@dataclass(frozen=True, eq=False)
class CorrespondResult:
    """A correspondence and everything that it was made of.

    Parameters
    ----------
    source_map, target_map
        The spherical maps of both meshes.
    alignment
        The rotation between them, and the wavelet network behind it.
    laid
        The source on the target's sphere.
    pairs
        The paired vertices that were used.
    matching
        The feature regions' matching that gave them; None if they were given, or none were found.
    warnings
        What a person should know before relying on the map, in sentences.
    candidates
        Matchings that were tried by coarse maps, the one that was taken first; empty if the first was not contested.
    """

    source_map: SphericalMap
    target_map: SphericalMap
    alignment: Alignment
    laid: SphericalMap
    pairs: VertexPairs
    matching: Matching | None = None
    warnings: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = ()

    @cached_property
    def correspondence(self) -> Correspondence:
        """Where each vertex of the source lies on the target."""
        return compose(self.laid, self.target_map)

    @cached_property
    def inverse(self) -> Correspondence:
        """Where each vertex of the target lies on the source: the same map, read backwards."""
        return compose(self.target_map, self.laid)

    @cached_property
    def carried(self) -> Mesh:
        """The closed surface of the source with its vertices where they lie on the target."""
        places = self.target_map.locate(self.laid.closed_points)
        return self.source_map.surface.mesh.with_vertices(places.positions(self.target_map.mesh))

    def refinement(self) -> Overlay:
        """The common refinement of both closed surfaces: a connectivity that meets both exactly.

        Raises
        ------
        SolveError
            If the triangulations stay in special position under small turns.
        """
        source, target = self.source_map.surface.mesh, self.target_map.surface.mesh
        return overlay(source, self.laid.closed_points, target, self.target_map.closed_points)

    @property
    def ambiguous(self) -> bool:
        """Whether another correspondence is nearly as good, as far as the matching or the search can tell."""
        if self.alignment.ambiguous or self.matching is None:
            return self.alignment.ambiguous
        return trust(self.matching, self.candidates)[1]

    @property
    def margin(self) -> float | None:
        """How much better the matching is than the next: by the scores of the candidates if some were tried; of the search without one."""
        return self.alignment.margin if self.matching is None else trust(self.matching, self.candidates)[0]

    def figures(self) -> Figures:
        """What there is to say about the map.

        `folds_sphere`: triangles inverted on the sphere, by exact signs; `folds_surface_percent`, `energy` (mean over the area),
        `energy_mean` (mean over the triangles); `pairs`: how many were used, `pairs_rmse` in mesh units, None without pairs;
        `margin`, `ambiguous`: of the matching, or of a search. Faces count as they were mapped: without dropped parts, in the
        orientation that repair gave them.
        """
        found = _between_parts(self)
        return {
            "folds_sphere": self.laid.certificate().inverted,
            "folds_surface_percent": quality.folds_surface_percent(found),
            "energy": quality.energy(found),
            "energy_mean": quality.energy_mean(found),
            "pairs": len(self.pairs),
            "pairs_rmse": quality.pairs_rmse(self.correspondence, self.pairs) if len(self.pairs) else None,
            "margin": self.margin,
            "ambiguous": self.ambiguous,
        }


@dataclass(frozen=True, eq=False)
class MorphResult:
    """A morph, its frames, and the correspondence it follows.

    Parameters
    ----------
    matched
        The correspondence.
    morph
        Mesh by time: of the source as given, but of its closed surface for a "gradient" path of a mesh that was mended, so that no
        seam opens on the way.
    frames
        The source as given, at equal steps of time.
    """

    matched: CorrespondResult
    morph: Morph
    frames: MeshSequence

    def figures(self) -> Figures:
        """The figures of the correspondence, and of the frames.

        `volume_change_max` (percent, signed) and `edge_log_rms_max` compare each frame with the straight line between the ends;
        `self_intersections_max` is the largest number of pairs of triangles that cross in a frame, both ends included; `mse` (Eq. 9)
        and `deformation_rate` (percent of the bounding-box diagonal) compare the last frame with the first.
        """
        first, last = self.frames.positions[0], self.frames.positions[-1]
        return self.matched.figures() | {
            "frames": len(self.frames),
            "volume_change_max": volume_change_max(self.frames),
            "edge_log_rms_max": edge_log_rms_max(self.frames),
            "self_intersections_max": self_intersections_max(self.frames),
            "mse": metrics.mse(last, first),
            "deformation_rate": metrics.deformation_rate(last, first),
        }


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
    given = NO_PAIRS if pairs is None else _different(_answered(pairs, source_map, target_map))
    matching, tried, told = (None, (), ()) if len(given) >= FEWEST else matched_regions(source_map, target_map, given, on_step)
    used = given if matching is None else _as_given(_landmarks(matching), source_map.surface, target_map.surface)
    alignment = aligned(source_map, target_map, used)
    if len(used) and alignment.method == "search":
        told = (*told, SEARCHED.format(count=len(used)))
    laid = embed(source_map.surface, target_map, used, start=alignment(source_map.closed_points), on_step=on_step)
    if len(laid.unmet):
        told = (*told, UNMET.format(count=len(laid.unmet), all=len(used)))
    on_sphere = SphericalMap(source_map.surface, laid.closed_points, laid.trace)
    found = CorrespondResult(source_map, target_map, alignment, on_sphere, used, matching, told, tried)
    return replace(found, warnings=(*told, *doubts(found.correspondence, used)))


def matched_regions(
    source_map: SphericalMap, target_map: SphericalMap, fixed: VertexPairs, on_step: OnStep | None = None
) -> tuple[Matching | None, tuple[Candidate, ...], tuple[str, ...]]:
    """Feature regions of the closed surfaces, matched; what else was tried; what is doubtful about it. None if they cannot be matched.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> ball = spherical_map(Mesh(*icosphere(2)))
    >>> matched_regions(ball, ball, NO_PAIRS)[0] is None
    True
    """
    source, target = source_map.surface, target_map.surface
    closed = VertexPairs(source.vertex_map[fixed.source], target.vertex_map[fixed.target], fixed.weight, fixed.labels)
    try:
        found = candidates(find_regions(source.mesh), find_regions(target.mesh), closed if len(closed) else None)
    except MeshError as error:
        return None, (), (UNMATCHED.format(reason=error.found),)
    return settled(source_map, target_map, found, on_step)


def settled(
    source_map: SphericalMap, target_map: SphericalMap, found: tuple[Matching, ...], on_step: OnStep | None = None
) -> tuple[Matching, tuple[Candidate, ...], tuple[str, ...]]:
    """The one of some matchings of the closed surfaces that coarse maps speak for; what was tried; what is doubtful about it.

    Parameters
    ----------
    source_map, target_map
        Spherical maps of both meshes; not looked at for a single matching.
    found
        Matchings, cheapest first, as from `candidates`.
    on_step
        As for `correspond`.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.features.matching import Matching
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> from morphlet.surface.pairs import VertexPairs
    >>> ball = spherical_map(Mesh(*icosphere(1)))
    >>> only = Matching(np.zeros((0, 2), int), VertexPairs([0, 1, 2], [0, 1, 2]), 0.1, 0.5, 0.6, (3, 3))
    >>> settled(ball, ball, (only,))[0] is only
    True
    """
    if len(found) == 1:
        return found[0], (), found[0].warnings
    tried = _tried(source_map, target_map, found, on_step)
    said = TRIED.format(count=len(tried), said=DECIDED if _clear(tried) else UNDECIDED, margin=_ahead(tried))
    exchanged = (EXCHANGED.format(margin=tried[1].score - tried[0].score),) if tried[1].score - tried[0].score < CLEAR else ()
    return tried[0].matching, tried, (said, *(exchanged if _clear(tried) else ()), *tried[0].matching.doubts)


def trust(matching: Matching, tried: tuple[Candidate, ...]) -> tuple[float | None, bool]:
    """How much better a matching is than the next, and whether another is nearly as good: by the scores of what was tried, if any.

    Examples
    --------
    >>> from morphlet.features.matching import Matching
    >>> from morphlet.surface.pairs import VertexPairs
    >>> trust(Matching(np.zeros((0, 2), int), VertexPairs([0, 1, 2], [0, 1, 2]), 0.1, 0.5, 0.6, (3, 3)), ())
    (0.4, False)
    """
    return (_ahead(tried), matching.strange or not _clear(tried)) if tried else (matching.margin, matching.ambiguous)


def _tried(
    source_map: SphericalMap, target_map: SphericalMap, found: tuple[Matching, ...], on_step: OnStep | None
) -> tuple[Candidate, ...]:
    """Matchings, cheapest first, tried by coarse maps: those far from each other, then those near the best of them; best first."""
    seen = np.log(local_area(source_map.surface.mesh)), np.log(local_area(target_map.surface.mesh))
    apart: list[Matching] = []
    for one in found:
        if all(other.contradictions(one) > 1 for other in apart):
            apart.append(one)
    tried = _sketched(source_map, target_map, apart[:MOST_TRIED], seen, on_step)
    best = min(tried, key=lambda one: one.score).matching
    near = [one for one in found if best.contradictions(one) == 1][:MOST_VARIANTS]
    return tuple(sorted(tried + _sketched(source_map, target_map, near, seen, on_step), key=lambda one: one.score))


def _sketched(
    source_map: SphericalMap,
    target_map: SphericalMap,
    matchings: list[Matching],
    seen: tuple[np.ndarray, np.ndarray],
    on_step: OnStep | None,
) -> list[Candidate]:
    """Matchings with their coarse maps; `seen`: logarithm of the area around each vertex of the closed surfaces."""
    source, target, faces = source_map.surface, target_map, target_map.surface.mesh.faces
    sketches = sketch(source, target, [_as_given(_landmarks(one), source, target.surface) for one in matchings], on_step)
    out = []
    for one, coarse in zip(matchings, sketches, strict=True):
        there = np.sum(seen[1][faces[coarse.places.faces]] * coarse.places.weights, axis=1)
        unlikeness = float(coarse.shares @ np.abs(seen[0][coarse.vertices] - there))
        out.append(Candidate(one, coarse.energy, max(unlikeness, LEAST_UNLIKE)))
    return out


def _ahead(tried: tuple[Candidate, ...]) -> float:
    """Score by which the first is better than the next that differs in several pairs, or the second if none does."""
    far = [one for one in tried[1:] if tried[0].matching.contradictions(one.matching) > 1]
    return (far or tried[1:])[0].score - tried[0].score


def _clear(tried: tuple[Candidate, ...]) -> bool:
    """Whether that is enough; no if neither led to a map."""
    return _ahead(tried) >= CLEAR


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


def morph(
    source: Mesh,
    target: Mesh,
    pairs: VertexPairs | None = None,
    frames: int = 24,
    on_step: OnStep | None = None,
    path: MorphPath = "gradient",
) -> MorphResult:
    """A sequence of meshes from the source to the shape of the target.

    Parameters
    ----------
    source, target, pairs, on_step
        As for `correspond`.
    frames
        How many meshes, both ends included.
    path
        How vertices travel: "gradient" turns and stretches the faces, "linear" moves on straight lines, "wavelet" moves the coarse shape
        first and details later.

    Returns
    -------
    result
        The morph as a function of time, its frames, and the correspondence; `.figures()` measures them.

    Raises
    ------
    MeshError
        If a mesh has no spherical map.
    InputError
        If the pairs do not fit the meshes, there are fewer than 2 frames, or there is no such path.

    Notes
    -----
    All frames have the source's faces; the last one lies on the target's surface. A schedule of one's own for the path "wavelet" goes
    through `morph_along`.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(1)
    >>> ball, egg = Mesh(points, faces), Mesh(points * [1, 1, 2], faces)
    >>> result = morph(ball, egg, VertexPairs([0, 1, 2], [0, 1, 2]), frames=5)
    >>> len(result.frames), bool((result.frames[0].vertices == ball.vertices).all())
    (5, True)
    """
    _require_travel(frames, path, None)
    return morph_along(correspond(source, target, pairs, on_step), frames, path)


def morph_along(
    matched: CorrespondResult,
    frames: int = 24,
    path: MorphPath = "gradient",
    schedule: Schedule | None = None,
    starts: Int[np.ndarray, "s"] | None = None,
) -> MorphResult:
    """The morph along a correspondence that is at hand.

    Parameters
    ----------
    matched
        The correspondence.
    frames, path
        As for `morph`.
    schedule
        For the paths "wavelet" and "gradient": when each resolution moves, from coarse to fine, spread over as many as there are. On
        the path "gradient" details turn with the faces that carry them.
    starts
        Vertices of the source from which the morph sweeps over the surface, as with `sweep`; all set out at once if left out.

    Raises
    ------
    InputError
        If there are fewer than 2 frames, there is no such path or vertex, or the path takes no schedule.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> one = spherical_map(Mesh(*icosphere(1)))
    >>> result = morph_along(correspond_maps(one, one, VertexPairs([0, 1, 2], [0, 1, 2])), frames=3)
    >>> round(result.figures()["mse"], 3)
    0.0
    """
    _require_travel(frames, path, schedule)
    mapped, positions = _ends(matched, path)
    bands = wavelet_bands(mapped, positions) if path == "wavelet" or schedule is not None else None
    spread = schedule.over(len(bands)) if schedule is not None and bands is not None else None
    travel = Morph(mapped.mesh, positions, path, bands, spread, None if starts is None else _delay(matched, mapped, starts))
    return MorphResult(matched, travel, _as_in_source(matched, travel.frames(frames)))


def _require_travel(frames: int, path: MorphPath, schedule: Schedule | None) -> None:
    """Refuse what no morph can do, before the work."""
    if frames < 2:
        raise InputError("at least 2 frames, the source and the target", str(frames), "ask for more frames")
    if path not in PATHS:
        raise InputError(f"a path out of {', '.join(PATHS)}", f"'{path}'", "choose one of these")
    if schedule is not None and path == "linear":
        raise InputError('the path "wavelet" or "gradient" for a schedule', "'linear'", "leave the schedule out, or choose such a path")


def _ends(matched: CorrespondResult, path: MorphPath) -> tuple[SphericalMap, Float[np.ndarray, "n 3"]]:
    """The source and where its vertices go; closed where faces turn and stretch, or seams would open on the way."""
    found = matched.source_map
    if path != "gradient" or not found.surface.repairs:
        return found, matched.correspondence.positions
    return SphericalMap(close(found.surface.mesh), found.closed_points, found.trace), matched.carried.vertices


def _delay(matched: CorrespondResult, mapped: SphericalMap, starts: Int[np.ndarray, "s"]) -> Float[np.ndarray, "n"]:
    """How much later each vertex sets out; twins on a seam together."""
    surface = matched.source_map.surface
    chosen = _arrays.index(starts, "starts", (None,), surface.source.n_vertices)
    delay = sweep(surface.mesh, surface.vertex_map[chosen])
    return delay if mapped is not matched.source_map else delay[surface.vertex_map]


def _as_in_source(matched: CorrespondResult, frames: MeshSequence) -> MeshSequence:
    """Frames with the vertices of the source as given; those without an answer travel with the nearest one, towards it."""
    surface, source = matched.source_map.surface, matched.source_map.mesh
    if frames.topology is source.topology:
        return frames
    apart = source.vertices - surface.mesh.vertices[surface.vertex_map]
    positions = frames.positions[:, surface.vertex_map] + (1 - frames.times)[:, None, None] * apart
    positions[0], positions[-1] = source.vertices, matched.correspondence.positions
    return MeshSequence(source.topology, positions, frames.times)


def _answered(pairs: VertexPairs, source_map: SphericalMap, target_map: SphericalMap) -> VertexPairs:
    """The pairs, once it is certain that they name vertices that were mapped."""
    return pairs.checked(source_map.mesh, target_map.mesh).answered(source_map.valid, target_map.valid)


def _different(pairs: VertexPairs) -> VertexPairs:
    """The pairs without repeats."""
    first = np.sort(np.unique(np.stack([pairs.source, pairs.target], axis=1), axis=0, return_index=True)[1])
    return _chosen(pairs, first)


def _chosen(pairs: VertexPairs, kept: Int[np.ndarray, "k"]) -> VertexPairs:
    """Some of the pairs."""
    return VertexPairs(pairs.source[kept], pairs.target[kept], np.array(pairs.weight)[kept], tuple(pairs.labels[k] for k in kept))


def _landmarks(matching: Matching) -> VertexPairs:
    """Its pairs but the core, which is found a tenth of sqrt(area) off at worst: too coarse to be pulled to."""
    labels = matching.pairs.labels
    return _chosen(matching.pairs, np.array([k for k, label in enumerate(labels) if label != CORE_LABEL], np.int64))


def _as_given(pairs: VertexPairs, source: Repaired, target: Repaired) -> VertexPairs:
    """Pairs of the closed surfaces as pairs of the meshes as given."""
    return VertexPairs(source.source_vertices[pairs.source], target.source_vertices[pairs.target], pairs.weight, pairs.labels)


def _samples(spherical: SphericalMap) -> SphereSamples:
    """What each vertex sees around it, placed on the sphere."""
    return SphereSamples(spherical.points, signature(spherical.mesh), spherical.mesh.vertex_areas)


def _between_parts(matched: CorrespondResult) -> Correspondence:
    """The correspondence between the faces that were mapped, all turned outwards; vertices as given."""
    (own, own_turned), (other, other_turned) = _mapped_faces(matched.source_map), _mapped_faces(matched.target_map)
    source, target, points = matched.source_map.mesh, matched.target_map.mesh, matched.correspondence.points
    row = np.zeros(target.n_faces, np.int64)
    row[other] = np.arange(len(other))
    rows = row[points.faces]
    weights = np.where(other_turned[rows, None], points.weights[:, [0, 2, 1]], points.weights)
    return Correspondence(
        Mesh(source.vertices, _turned(source, own, own_turned)),
        Mesh(target.vertices, _turned(target, other, other_turned)),
        SurfacePoints(rows, weights),
        matched.correspondence.valid,
    )


def _mapped_faces(spherical: SphericalMap) -> tuple[Int[np.ndarray, "k"], Bool[np.ndarray, "k"]]:
    """Which faces as given were mapped, and which of them were turned over."""
    real = spherical.surface.face_map >= 0
    return spherical.surface.face_map[real], spherical.surface.flipped[real]


def _turned(mesh: Mesh, faces: Int[np.ndarray, "k"], turned: Bool[np.ndarray, "k"]) -> Topology:
    """Some faces of a mesh, turned over where it is asked."""
    return Topology(np.where(turned[:, None], mesh.faces[faces][:, [0, 2, 1]], mesh.faces[faces]), mesh.n_vertices)
