"""Which regions of two surfaces go together: where several matchings are nearly as good, coarse maps decide."""

from dataclasses import dataclass

import numpy as np

from morphlet.errors import MeshError
from morphlet.features.matching import CORE_LABEL, Matching, candidates
from morphlet.features.regions import find_regions
from morphlet.features.signature import local_area
from morphlet.mapping.embedding import sketch
from morphlet.numerics.optimize import OnStep
from morphlet.sphere.map import SphericalMap
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.repair import Repaired

UNMATCHED = "feature regions could not be matched ({reason}): the spheres were turned by a search alone, give pairs"
TRIED = "{count} pairings of the tips were nearly as good as each other: of their coarse maps {said} (score ahead by {margin:.3f})"
EXCHANGED = "one pair of tips could as well be another (score ahead by {margin:.3f}): look at the tips next to it"
DECIDED, UNDECIDED = "one fits clearly better", "none fits clearly better than all others: give landmarks, or check the pairs"
"""What is said of a matching that is not to be trusted blindly."""
MOST_TRIED, MOST_VARIANTS = 4, 2
"""Contested matchings that are tried by a coarse map: those that differ in several pairs, then those that exchange one pair of the best."""
LEAST_UNLIKE = 1e-6
"""Unlikeness below which surfaces are the same: its logarithm stays finite."""
CLEAR = 0.1
"""Score by which the best must be ahead of the next that differs in several pairs: a tenth in one of its factors. A grazer and a predator
in four poses: the right matching was first each time, ahead by 0.11 to 0.45; with less careful landmarks a wrong one once, by 0.07."""


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


def matched_regions(
    source_map: SphericalMap, target_map: SphericalMap, fixed: VertexPairs, on_step: OnStep | None = None
) -> tuple[Matching | None, tuple[Candidate, ...], tuple[str, ...]]:
    """Feature regions of the closed surfaces, matched; what else was tried; what is doubtful about it. None if they cannot be matched.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> from morphlet.surface.pairs import NO_PAIRS
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


def landmark_pairs(matching: Matching, source: Repaired, target: Repaired) -> VertexPairs:
    """Its pairs of the closed surfaces as pairs of the meshes as given; without the core, too coarse to be pulled to.

    The core is found a tenth of sqrt(area) off at worst.
    """
    labels, pairs = matching.pairs.labels, matching.pairs
    tips = pairs.chosen(np.array([k for k, label in enumerate(labels) if label != CORE_LABEL], np.int64))
    return VertexPairs(source.source_vertices[tips.source], target.source_vertices[tips.target], tips.weight, tips.labels)


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
    sketches = sketch(source, target, [landmark_pairs(one, source, target.surface) for one in matchings], on_step)
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
