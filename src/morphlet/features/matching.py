"""Pair the feature regions of two surfaces (step 10 of the paper).

The tips are paired as cheaply as `pairing` finds; the best contradiction, the runner-up, says how far that can be trusted, and where it is
not far the other candidates are handed out, too. Then the tips of each pair of regions are compared with the lesser peaks around them, and
the core is placed by its distances from the tips.
"""

from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from jaxtyping import Int

from morphlet import _arrays
from morphlet.errors import InputError, MeshError
from morphlet.features.pairing import NEAR, MatchOptions, Pairing, Problem, contradicts, marks_of, plain_differences, problem_of
from morphlet.features.regions import Regions
from morphlet.surface.pairs import NO_PAIRS, VertexPairs
from morphlet.surface.requirements import many

SLACK = 0.5
"""Tips and details of a pair of regions are paired if that costs less than the mean pair of tips and this: the limb is sure by then."""
SURE = 0.04
"""Cost by which the pairing within a region must beat its best contradiction; else only the two most alike are paired. Right ones were seen
from 0.05, a wrong one at 0.02."""
AMBIGUOUS, UNLIKE = 0.1, 1.75
"""Margin below which, and cost above which, a matching is not to be trusted, per pair; where the cost is above 1, the margin over the cost.
23 pairs of poses of one animal: margins from 0.13, costs up to 1.14, all right. 41 pairs of different animals: the 10 wrong ones have
costs from 1.2 and margins up to 0.104; of the 31 right ones 14 are below these limits, too."""
WORTH, MOST = 0.3, 12
"""Candidates cost at most this much more than the best, per pair, and there are at most so many."""
MIRRORED = 0.2
"""Cost by which the mirror image may fit better, per pair: up to 0.04 for symmetric animals, 0.7 for a shape without symmetry."""
CORE, CORE_LABEL = 0.25, "core"
"""Weight of the pair of cores, which are found less exactly than tips, and its label."""
FEWEST, ENOUGH = 3, 4
"""Pairs without which no map can be started, and below which one had better not be."""
RIVAL = "another pairing of the tips is nearly as good (margin {margin:.3f}): give landmarks, or check the pairs"
MIRROR = "the mirror image of the target is much more alike (cost {reflected:.2f}, not {cost:.2f}, per pair): is one of them reflected?"
STRANGE = "even the best pairing is a poor one (cost {cost:.2f} per pair): the shapes may not correspond, give landmarks"
FEW = "only {count} pairs of regions or landmarks, of {tips} tips: give more landmarks"
"""What a matching says of itself."""


@dataclass(frozen=True, eq=False)
class Matching:
    """Which feature regions of two surfaces go together.

    Parameters
    ----------
    regions
        Regions of the source and of the target that were paired.
    pairs
        Vertices that go together: the user's, then tips or details of the paired regions, then the core; labels say which.
    cost
        Mean cost of a pair, misses included; 0 for identical surfaces.
    runner_up
        The same of the best pairing that contradicts this one; None if there is none. Less than `cost` if this is not the cheapest.
    reflected
        The mean cost with the mirror image of the target.
    n_tips
        Number of tips of the source and of the target.

    Examples
    --------
    >>> from morphlet import creature
    >>> from morphlet.features.matching import match
    >>> from morphlet.features.regions import find_regions
    >>> deer = find_regions(creature("grazer", n_vertices=2000))
    >>> found = match(deer, deer)
    >>> found.regions.tolist() == [[k, k] for k in range(len(deer))], round(found.cost, 12), found.warnings
    (True, 0.0, ())
    """

    regions: Int[np.ndarray, "r 2"]
    pairs: VertexPairs
    cost: float
    runner_up: float | None
    reflected: float
    n_tips: tuple[int, int]

    def __post_init__(self) -> None:
        object.__setattr__(self, "regions", _arrays.freeze(np.array(self.regions, np.int64).reshape(-1, 2)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Matching, (np.array(self.regions), self.pairs, self.cost, self.runner_up, self.reflected, self.n_tips)

    @property
    def margin(self) -> float | None:
        """How much worse the runner-up is; None if nothing else was possible."""
        return None if self.runner_up is None else self.runner_up - self.cost

    @property
    def ambiguous(self) -> bool:
        """Whether another pairing is nearly as good, or even this one is bad, or the mirror image much better."""
        return self.contested or self.strange

    @property
    def contested(self) -> bool:
        """Whether another pairing is nearly as good: the poorer this one, the larger its margin must be."""
        return self.margin is not None and self.margin < AMBIGUOUS * max(self.cost, 1.0)

    @property
    def strange(self) -> bool:
        """Whether even this one is bad, or the mirror image much better."""
        return self._mirrored or self.cost > UNLIKE

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know before relying on the pairs, in sentences."""
        return ((RIVAL.format(margin=self.margin),) if self.contested else ()) + self.doubts

    @property
    def doubts(self) -> tuple[str, ...]:
        """The same without what other pairings have to do with it."""
        told = ((self._mirrored, MIRROR), (self.cost > UNLIKE, STRANGE), (len(self.pairs) - 1 < ENOUGH, FEW))
        tips = " and ".join(map(str, self.n_tips))
        numbers = {"cost": self.cost, "reflected": self.reflected}
        return tuple(text.format(**numbers, count=len(self.pairs) - 1, tips=tips) for holds, text in told if holds)

    def contradictions(self, other: "Matching") -> int:
        """How many pairs of regions of another matching cannot stand beside those of this one."""
        forth, back = dict(self.regions.tolist()), {j: i for i, j in self.regions.tolist()}
        return sum(forth.get(i, j) != j or back.get(j, i) != i for i, j in other.regions.tolist())

    @property
    def _mirrored(self) -> bool:
        return self.cost - self.reflected > MIRRORED


def match(
    source: Regions,
    target: Regions,
    fixed: VertexPairs | None = None,
    forbidden: VertexPairs | None = None,
    options: MatchOptions | None = None,
) -> Matching:
    """Pair the feature regions of two surfaces.

    Parameters
    ----------
    source, target
        Their regions.
    fixed
        Vertices that go together in any case, on tips or elsewhere; tips within `NEAR` of them are taken.
    forbidden
        Vertices whose tips, within `NEAR` of them, do not go together.
    options
        Weights.

    Returns
    -------
    matching
        Regions and vertices that go together, and how far that can be trusted.

    Raises
    ------
    MeshError
        If fewer than three pairs are found: there is nothing to align.
    InputError
        If the pairs of the user do not fit the meshes, contradict each other, or forbid what is no tip.

    Notes
    -----
    Step 10 of the paper. The surfaces must be alike up to bending, size and some stretching. Left and right are told apart by orientation,
    so the faces of each must be oriented in one way. 0.2 to 0.6 s of one core for six tips on 4000 to 28000 vertices.

    Examples
    --------
    >>> from morphlet.features.matching import match
    >>> from morphlet.features.regions import find_regions
    >>> from morphlet.samples.creatures import Creature
    >>> from morphlet.samples.poses import POSES
    >>> fox = Creature.prepare("predator", n_vertices=2000)
    >>> found = match(find_regions(fox.mesh), find_regions(fox.posed(POSES["walking"])))
    >>> len(found.regions) >= 6, found.ambiguous  # nose, tail and feet; the ears stand out hardly enough to count
    (True, False)
    """
    return _Search.prepare(source, target, (fixed, forbidden), options or MatchOptions()).best()


def candidates(
    source: Regions,
    target: Regions,
    fixed: VertexPairs | None = None,
    forbidden: VertexPairs | None = None,
    options: MatchOptions | None = None,
) -> tuple[Matching, ...]:
    """The best pairing of the feature regions, and where that is contested the others that are worth a try.

    Parameters
    ----------
    source, target, fixed, forbidden, options
        As for `match`.

    Returns
    -------
    matchings
        What `match` finds; if its margin is small, then up to `MOST` in all, cheapest first, none more than `WORTH` above the best, each
        contradicting all before.

    Raises
    ------
    MeshError, InputError
        As `match`.

    Notes
    -----
    Head and tail, or left and right, of animals of different proportions cannot always be told by their tips: try the candidates, for
    instance by `embedding.sketch`.

    Examples
    --------
    >>> from morphlet import creature
    >>> from morphlet.features.matching import candidates
    >>> from morphlet.features.regions import find_regions
    >>> deer, fox = (find_regions(creature(name, n_vertices=2000)) for name in ("grazer", "predator"))
    >>> len(candidates(deer, deer)), len(candidates(deer, fox)) > 2
    (1, True)
    """
    search = _Search.prepare(source, target, (fixed, forbidden), options or MatchOptions())
    best = search.best()
    return (best, *map(search.matching, search.others())) if best.contested else (best,)


@dataclass(frozen=True, eq=False)
class _Search:
    """All that was found for two surfaces.

    Parameters
    ----------
    start
        The user's pairs among the landmarks.
    found
        Pairings and their costs, cheapest first.
    count
        Number of pairs that there could be; a tip without partner is half a pair.
    reflected
        Cost of the cheapest pairing with the mirror image.
    """

    problem: Problem
    surfaces: tuple[Regions, Regions]
    given: VertexPairs
    start: Pairing
    found: list[tuple[float, Pairing]]
    count: float
    reflected: float

    @staticmethod
    def prepare(
        source: Regions, target: Regions, wishes: tuple[VertexPairs | None, VertexPairs | None], options: MatchOptions
    ) -> "_Search":
        """Find the pairings; `wishes` are the fixed and the forbidden pairs."""
        given = _given(source, target, wishes[0])
        problem = problem_of(marks_of(source, given.source), marks_of(target, given.target), options)
        _forbid(problem, (source, target), wishes[1], given)
        start = tuple((len(source.landmarks) + k, len(target.landmarks) + k) for k in range(len(given)))
        rows, columns = problem.source.free(range(len(source)), len(given)), problem.target.free(range(len(target)), len(given))
        found = problem.cheapest(start, rows, columns)
        if len(found[0][1]) < FEWEST:
            raise _too_few(len(found[0][1]), source, target)
        mirror = replace(problem, target=replace(problem.target, volumes=-problem.target.volumes))
        count = (len(rows) + len(columns)) / 2 + len(start)
        return _Search(problem, (source, target), given, start, found, count, mirror.cheapest(start, rows, columns)[0][0])

    def best(self) -> Matching:
        """The cheapest."""
        return self.matching(self.found[0])

    def others(self) -> list[tuple[float, Pairing]]:
        """Pairings that are nearly as cheap, each contradicting all before."""
        kept = self.found[:1]
        for cost, pairing in self.found:
            if cost > self.found[0][0] + WORTH * self.count or len(kept) == MOST:
                break
            if len(pairing) >= FEWEST and all(contradicts(other, pairing) for _, other in kept):
                kept.append((cost, pairing))
        return kept[1:]

    def matching(self, one: tuple[float, Pairing]) -> Matching:
        """A pairing as regions and vertices."""
        cost, pairing = one
        rival = next((other for other, another in self.found if contradicts(pairing, another)), None)
        pairs = _pairs(self.problem, _located(self.problem, pairing, self.surfaces), self.surfaces, self.given)
        regions = [*pairing[len(self.start) :], *_taken(self.problem, self.start, self.surfaces)]
        costs = (cost / self.count, None if rival is None else rival / self.count, self.reflected / self.count)
        source, target = self.surfaces
        return Matching(np.array(regions), pairs, *costs, (len(source), len(target)))


def _given(source: Regions, target: Regions, fixed: VertexPairs | None) -> VertexPairs:
    """The user's pairs; none of them twice."""
    pairs = (fixed or NO_PAIRS).checked(source.mesh, target.mesh)
    for side, vertices in (("source", pairs.source), ("target", pairs.target)):
        values, counts = np.unique(vertices, return_counts=True)
        if np.any(counts > 1):
            found = f"{many(int(np.sum(counts > 1)), f'{side} vertex')} in several pairs"
            raise InputError("fixed pairs that name each vertex once", found, "keep one pair of each", values[counts > 1])
    return pairs


def _forbid(problem: Problem, surfaces: tuple[Regions, Regions], forbidden: VertexPairs | None, given: VertexPairs) -> None:
    """Make the pairs that the user excludes infinitely dear."""
    source, target = surfaces
    fixed = set(zip(*_columns(given, source, target), strict=True))
    for a, b in zip(*_columns(forbidden, source, target), strict=True):
        if (a, b) in fixed:
            raise InputError("forbidden pairs that are not fixed", f"{a}, {b} in both", "drop it from one of them", [a, b])
        rows, columns = np.flatnonzero(source.distance[:, a] < NEAR), np.flatnonzero(target.distance[:, b] < NEAR)
        if not (len(rows) and len(columns)):
            found = f"the pair {a}, {b}, which is not"
            raise InputError(f"forbidden pairs on tips, within {NEAR} sqrt(area)", found, "name vertices of the tips", [a, b])
        problem.unary[np.ix_(rows, columns)] = np.inf


def _columns(pairs: VertexPairs | None, source: Regions, target: Regions) -> tuple[list[int], list[int]]:
    """Source and target vertices; none of no pairs."""
    return ([], []) if pairs is None else (pairs.checked(source.mesh, target.mesh).source.tolist(), pairs.target.tolist())


def _too_few(count: int, source: Regions, target: Regions) -> MeshError:
    tips = f"{len(source)} and {len(target)} tips"
    return MeshError(
        f"at least {FEWEST} pairs of feature regions", f"{count}, of {tips}", "give landmarks: pairs of vertices that belong together"
    )


def _located(problem: Problem, best: Pairing, surfaces: tuple[Regions, Regions]) -> list[tuple[int, int]]:
    """For each pair of regions the tips and details in them that go together; the two most alike where that is not sure."""
    given = len(problem.source.fields) - len(surfaces[0].landmarks)
    strict = replace(problem, compared=plain_differences)  # where on a limb is a question of lengths
    eased = replace(problem.options, miss=strict.total(best, 0) / len(best) + SLACK)
    local, out = replace(strict, options=eased), list(best[:given])
    for tips in best[given:]:
        start = tuple(pair for pair in best if pair != tips)
        marks = (problem.source, problem.target)
        rows, columns = (mark.free(_within(regions, k), given) for mark, regions, k in zip(marks, surfaces, tips, strict=True))
        sure = _sure(local.cheapest(start, rows, columns))[len(start) :]
        out += sure or [min(product(rows, columns), key=lambda pair: local.added(start, pair[0])[pair[1]])]
    return out


def _sure(found: list[tuple[float, Pairing]]) -> Pairing:
    """The cheapest pairing; nothing where a contradiction is nearly as cheap."""
    cost, best = found[0]
    rivals = (other for other, pairing in found[1:] if contradicts(best, pairing))
    return best if next(rivals, np.inf) - cost >= SURE else ()


def _within(regions: Regions, k: int) -> list[int]:
    """The tip of a region and the details in it."""
    return [k, *(i for i in range(len(regions), len(regions.landmarks)) if regions.nodes[regions.landmarks[i]] == k)]


def _pairs(problem: Problem, located: list[tuple[int, int]], surfaces: tuple[Regions, Regions], given: VertexPairs) -> VertexPairs:
    """Vertices of the landmarks that go together, the user's first; then the core and where it lies by its distances from them."""
    source, target = surfaces
    i, j = np.array(located).T
    core = problem.source.fields[i, source.core]
    place = int(np.argmin(np.sum((problem.target.fields[j] - core[:, None]) ** 2, axis=0)))
    one, other = i[len(given) :], j[len(given) :]
    names = [f"tip {k}" if k < len(source) and m < len(target) else "detail" for k, m in zip(one, other, strict=True)]
    return VertexPairs(
        np.concatenate([given.source, source.landmarks[one], [source.core]]),
        np.concatenate([given.target, target.landmarks[other], [place]]),
        np.concatenate([given.weight, np.ones(len(one)), [CORE]]),
        (*(name or "given" for name in given.labels), *names, CORE_LABEL),
    )


def _taken(problem: Problem, start: Pairing, surfaces: tuple[Regions, Regions]) -> list[tuple[int, int]]:
    """Regions whose tips the user's pairs stand for."""
    source, target = surfaces
    near = [(problem.source.apart[: len(source), i], problem.target.apart[: len(target), j]) for i, j in start]
    return [(int(np.argmin(a)), int(np.argmin(b))) for a, b in near if np.min(a, initial=NEAR) < NEAR and np.min(b, initial=NEAR) < NEAR]
