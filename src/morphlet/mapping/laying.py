"""How one mesh is laid into another's sphere: levels, the landmark stage, refinement, polish.

Levels and the first round of the polish compare triangles with their own shapes, robustly: what is off is few and far off. Then the
stretch of the images is spread (`stretch`), and the rounds that follow, nearly of least squares, leave limbs that are longer or thicker
as a whole where they belong. On the full mesh the likeness of `relief` holds what could slide without being stretched.

Arrays and prepared targets only; what the caller gets, and the attempts, are `embedding`'s business.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.errors import InputError
from morphlet.mapping import chord, metric
from morphlet.mapping.chord import Images
from morphlet.mapping.metric import Ground, MetricField, Seats, Source, blended, empty_seats
from morphlet.mapping.polish import Goals, Polish
from morphlet.mapping.relief import Likeness
from morphlet.mapping.ring import putter, sweep
from morphlet.mapping.stretch import Evening
from morphlet.numerics.linalg import Analysis
from morphlet.numerics.optimize import SAFE_SHARE, NewtonOptions, newton
from morphlet.numerics.rigid import kabsch
from morphlet.sphere import energy
from morphlet.sphere.embed import Ascent, Attempt, Recorder, SphereOptions
from morphlet.sphere.energy import Reference
from morphlet.sphere.level import Level
from morphlet.sphere.locate import Locator
from morphlet.sphere.map import SphericalMap
from morphlet.sphere.relax import insert
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.repair import Repaired

COARSE, PER_PAIR, SPARE = 100, 4, 40
"""The landmark stage has max(100, 4 pairs + 40) vertices: enough between any two pairs to give way."""
LADDER_OF_PULLS = ((0.1, 0.0), (0.3, 0.0), (1.0, 0.25), (3.0, 0.5), (10.0, 0.75), (30.0, 1.0), (100.0, 1.0))
"""Landmark stage: weight of the pairs, and share of the target's metric against the round one."""
PULL = 1000.0
"""Weight of the pairs from there on, to the end: landmarks that are let go slide away."""
PULL_NEWTON, COARSE_NEWTON = NewtonOptions(15, 1e-3), NewtonOptions(30, 1e-4)
"""Per rung of the ladder, and once the pairs are met."""
LEVEL_NEWTON = NewtonOptions(12, 1e-3)
"""On each finer level, and on the full mesh before the polish."""
CHORDS_FROM, CHORD_SWEEPS, CHORD_ITERATIONS = 400, 2, 12
"""Levels of 400 vertices and more are fitted to the target's surface, too: the metric alone leads into wrong minima."""
SKETCHED = 800
"""Vertices of the level on which candidates are compared."""
GROWTH, JUMP = 2.0, 0.7
"""Vertices double per level; beyond 70 % of all the rest comes at once."""
SWEEPS = 4
SMOOTHING = 0.7
"""Scale of the target's metric, in mean edge lengths of the source's level (0.5 to 1.5 made no clear difference)."""
LEVEL_DELTA = 0.3
"""How robust the metric energy is on the levels."""
BEFORE_POLISH = 0.5
"""Share of the work that is done when the polish begins."""
LONGEST_MOVE = 0.7
"""Radians a vertex may move in one Newton step."""
POLISH_TOLERANCE = 1e-3
"""Relative decrease of the energy below which an iteration of the polish is small: two in a row end it."""
EVEN_ITERATIONS = 10
"""Newton steps per round with even stretch: the metric follows the map before it has settled."""


class Price(NamedTuple):
    """What distortion costs: robust below `delta`, steep for images smaller than `tau` of their area."""

    delta: float
    tau: float


OWN, EVEN_LEVEL, EVEN, LAST = Price(0.1, 0.5), Price(1.0, 0.5), Price(1.0, 0.2), Price(0.1, 0.2)
"""Against a triangle's own shape; with even stretch, on a level and on the full mesh; of the last round, and of the energy that is told.
With even stretch, 0.1 all along leaves knees and tails where they were (creatures of different proportions: mean errors 2.1 to 2.4 instead
of 1.9 to 2.25), but it is better at the end (two poses of a wolf: 0.40 instead of 0.45). Against a triangle's own shape 1.0 is worse for
poses (1.4 instead of 1.1 for a horse). A tau of 0.5 tolerates triangles shrunk to a tenth."""


@dataclass(frozen=True)
class EmbeddingOptions:
    """How much work goes into a map.

    Parameters
    ----------
    rounds
        Rounds of the polish on the full mesh, the first against the source's own shape, the others with even stretch; 0 leaves it out.
    iterations
        Newton steps per round, at most.

    Examples
    --------
    >>> from morphlet.mapping.embedding import EmbeddingOptions
    >>> EmbeddingOptions(rounds=1).iterations
    20
    """

    rounds: int = 5
    iterations: int = 20

    def __post_init__(self) -> None:
        if self.rounds < 0 or self.iterations < 1:
            raise InputError("rounds >= 0 and iterations >= 1", f"{self.rounds} and {self.iterations}", "choose numbers in this range")


@dataclass(frozen=True, eq=False)
class Target:
    """A spherical map made ready to have meshes laid into it."""

    map: SphericalMap
    field: MetricField
    finest: Ground
    rows: Float[np.ndarray, "N 15"]
    locator: Locator

    @staticmethod
    def prepare(target: SphericalMap) -> "Target":
        """Metric field, surface and point location; O(N)."""
        field = MetricField.prepare(target)
        locator = Locator.prepare(target.closed_points, target.surface.mesh.topology)
        return Target(target, field, field.at_scale(0.0), chord.sheet(target), locator)

    def faces_under(self, directions: Float[np.ndarray, "k 3"]) -> Int[np.ndarray, "k"]:
        """Faces of the closed surface."""
        return self.locator.locate(directions / np.linalg.norm(directions, axis=1, keepdims=True))[0]

    def seats(self, level: Level) -> Seats:
        """The faces under the triangles of a level."""
        return empty_seats(self.faces_under(level.S[level.F].sum(axis=1)))

    def scales(self, points: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p"]:
        """Half the trace of the metric: mean squared stretch from the sphere to the surface at some points."""
        faces, weights = self.locator.locate(points)
        traces = self.finest.metric[:, [0, 3, 5]].sum(axis=1)[self.map.surface.mesh.faces[faces]]
        return np.sum(weights * traces, axis=1) / 2


@dataclass(eq=False)
class _Fit:
    """A level of the source on the target's sphere, as a problem for Newton."""

    level: Level
    ground: Ground
    goals: Goals
    delta: float
    seats: Seats

    def __post_init__(self) -> None:
        r = self.level.reference
        self.source = Source(self.level.F, r.k, r.inverse, r.weight, self.delta)
        self.frames = np.empty((len(self.level.S), 2, 3))

    @property
    def analysis(self) -> Analysis:
        """Of the Hessian's lower triangle."""
        return self.level.analysis

    @property
    def diagonal(self) -> Int[np.ndarray, "d"]:
        """Places of the diagonal among the Hessian's values."""
        return self.level.diagonal

    def value(self, x: Float[np.ndarray, "n 3"]) -> float:
        """Metric energy and pull of the pairs; the seats follow x."""
        return metric.value(x, self.source, self.ground, self.seats) + self.goals.value(x)

    def model(self, x: Float[np.ndarray, "n 3"], project: bool) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian values at the x of the last `value`."""
        energy.frames(x, self.frames)
        g, H = metric.derivatives(x, self.frames, self.source, self.ground, self.seats, project)
        gradient, hessian = self.level.assembled(g, H)
        diagonal = hessian[self.diagonal]
        self.goals.add(x, self.frames, gradient, diagonal)
        hessian[self.diagonal] = diagonal
        return gradient, hessian

    def matrix(self, hessian: Float[np.ndarray, "z"]) -> sp.csc_matrix:
        """The whole Hessian."""
        return self.level.matrix(hessian)

    def direction(self, x: Float[np.ndarray, "n 3"], step: Float[np.ndarray, "d"]) -> Float[np.ndarray, "n 3"]:
        """Tangent vectors of a step."""
        return np.einsum("ne,ned->nd", step.reshape(-1, 2), self.frames)

    def largest_step(self, x: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"], limit: float) -> float:
        """A step up to which no triangle folds and no vertex moves far."""
        longest = max(float(np.linalg.norm(direction, axis=1).max()), np.finfo(float).tiny)
        return float(energy.largest_step(x, direction, self.level.F, min(limit, LONGEST_MOVE / SAFE_SHARE / longest)))

    def moved(self, x: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"], alpha: float) -> Float[np.ndarray, "n 3"]:
        """x moved and back on the sphere."""
        out = np.empty_like(x)
        energy.move(x, direction, alpha, out)
        return out


class Laying:
    """One attempt to lay the source in, from the tetrahedron to the polished full mesh."""

    def __init__(self, source: Repaired, target: Target, pairs: VertexPairs, attempt: Attempt, recorder: Recorder) -> None:
        self.target, self.recorder = target, recorder
        self.goals = _goals(source, target, pairs)
        mesh, virtual = source.mesh, source.face_map < 0
        centred = mesh.vertices - mesh.vertices.mean(axis=0)
        unit = mesh.with_vertices(centred / max(np.abs(centred).max(initial=0.0), np.finfo(float).tiny))
        self.ascent = Ascent(unit, virtual, SphereOptions(weights="area"), attempt, recorder, self.goals.vertices)
        self.mesh, self.n, self.under = mesh, mesh.n_vertices, np.zeros(mesh.n_vertices, np.int64)

    def run(self, options: EmbeddingOptions, start: Float[np.ndarray, "n 3"] | None) -> tuple[Float[np.ndarray, "n 3"], float]:
        """Points and energy."""
        (level, vertices, reached), finer = self._begun(start)
        for high, low in finer:
            self.recorder.progress = BEFORE_POLISH * ((self.n - low) / self.n) ** 0.5
            level, vertices, reached = self._refine(high, low)
        if options.rounds:
            reached = self._polish(level, options)
            self.ascent.S[vertices] = level.S
        self.recorder.progress = 1.0
        return self.ascent.S, reached

    def sketch(self) -> tuple[float, Level, Int[np.ndarray, "k"]]:
        """Energy on the first level of `SKETCHED` vertices or more, against the target's surface; the level and its vertices."""
        (level, vertices, _), finer = self._begun(None)
        for high, low in finer:
            if len(vertices) >= SKETCHED:
                break
            level, vertices, _ = self._refine(high, low)
        level.reference, ground, goals = self._as_whole(level), self._ground(len(vertices)), self._local(vertices, PULL)
        problem = self._problem(level, ground, goals, OWN, None)
        level.S = problem.newton(problem.sweep(level.S, CHORD_SWEEPS), CHORD_ITERATIONS, POLISH_TOLERANCE, self._note("chord", level))
        return self._problem(level, ground, goals, LAST, None).value(level.S), level, vertices

    def _note(self, stage: str, level: Level) -> Callable[..., None]:
        """Tells steps of a short polish."""
        return partial(self.recorder.note, f"{stage} {len(level.S)}")

    def _begun(self, start: Float[np.ndarray, "n 3"] | None) -> tuple[tuple[Level, np.ndarray, float], list[tuple[int, int]]]:
        """The coarse level on its goals, and the batches that are left."""
        coarse = self._coarse_size()
        spans = list(_spans(self.n, coarse))
        for number, (high, low) in enumerate(s for s in spans if s[1] >= self.n - coarse):
            self._rise(high, low, number)
        level, vertices = self.ascent.level(last=coarse == self.n)
        return (level, vertices, self._land(level, vertices, start)), [s for s in spans if s[1] < self.n - coarse]

    def _coarse_size(self) -> int:
        """Vertices of the landmark stage, all paired ones among them."""
        wanted = max(COARSE, PER_PAIR * len(self.goals.vertices) + SPARE)
        gone = np.nonzero(np.isin(self.ascent.hierarchy.removed, self.goals.vertices))[0]
        return min(self.n, max(wanted, self.n - int(gone.min(initial=self.n))))

    def _rise(self, high: int, low: int, number: int) -> None:
        """One batch on the bare sphere."""
        self.ascent.insert(high, low, insert)
        level, vertices = self.ascent.level(last=False)
        self.ascent.relax(level, False, number)
        self.ascent.S[vertices] = level.S

    def _fit(self, level: Level, ground: Ground, goals: Goals, delta: float, options: NewtonOptions) -> float:
        """Newton on a level; its energy, divided by 4 pi."""
        problem = _Fit(level, ground, goals, delta, self.target.seats(level))
        level.S, _ = newton(problem, level.S, options, partial(self.recorder.note, f"metric {len(level.S)}"))
        return problem.value(level.S)

    def _local(self, vertices: Int[np.ndarray, "k"], pull: float) -> Goals:
        """The goals in the numbering of a level."""
        return Goals(np.searchsorted(vertices, self.goals.vertices), self.goals.places, pull * self.goals.stiffness)

    def _land(self, level: Level, vertices: Int[np.ndarray, "k"], start: Float[np.ndarray, "n 3"] | None) -> float:
        """The landmark stage: turn the coarse level to its goals, then drag it there."""
        goals = self._local(vertices, 1.0)
        if start is not None:
            led = Goals(np.arange(len(vertices)), start[vertices], self.shares(level) * self.target.scales(start[vertices]))
            goals = _joined(led, goals)
        seen, places = level.S[goals.vertices], goals.places / np.linalg.norm(goals.places, axis=1, keepdims=True)
        level.S = np.ascontiguousarray(_turned(level.S, kabsch(seen, places, goals.stiffness)))
        bare, ground = self.target.field.bare, self._ground(len(vertices))
        for pull, share in LADDER_OF_PULLS:
            self._fit(level, blended(bare, ground, share), goals._replace(stiffness=pull * goals.stiffness), 0.0, PULL_NEWTON)
        goals = self._local(vertices, PULL)
        for stage in (PULL_NEWTON, COARSE_NEWTON):
            reached = self._fit(level, ground, goals, 0.0, stage)
        self.ascent.S[vertices] = level.S
        self.under[vertices] = self.target.faces_under(level.S)
        return reached

    @staticmethod
    def shares(level: Level) -> Float[np.ndarray, "k"]:
        """Weight of each vertex of a level, 4 pi in all."""
        return np.bincount(level.F.ravel(), np.repeat(level.reference.weight / 3, 3), len(level.S))

    def _ground(self, n: int) -> Ground:
        """The target's metric for a level of n vertices."""
        return self.target.field.at_scale(SMOOTHING * np.sqrt(4 * np.pi / n))

    def _refine(self, high: int, low: int) -> tuple[Level, Int[np.ndarray, "k"], float]:
        """One batch on the target's sphere: insert, sweep, Newton."""
        ground = self._ground(self.n - low)
        self.ascent.insert(high, low, putter(ground, self.under))
        level, vertices = self.ascent.level(last=low == 0)
        under, free = self.under[vertices], np.nonzero(~np.isin(vertices, self.goals.vertices))[0]
        for _ in range(SWEEPS):
            sweep(free, level.S, (*level.star, level.max_valence), level.reference, ground, under)
        goals = self._local(vertices, PULL)
        reached = self._fit(level, ground, goals, LEVEL_DELTA, LEVEL_NEWTON)
        if low and len(vertices) >= CHORDS_FROM:
            self._approach(level, ground, goals)
        self.ascent.S[vertices], self.under[vertices] = level.S, under
        return level, vertices, reached

    def _approach(self, level: Level, ground: Ground, goals: Goals) -> None:
        """A short polish of a level."""
        kept, level.reference = level.reference, self._as_whole(level)
        for stage, evening, price in (("chord", None, OWN), ("even", Evening.prepare(level), EVEN_LEVEL)):
            problem = self._problem(level, ground, goals, price, evening)
            level.S = problem.newton(problem.sweep(level.S, CHORD_SWEEPS), CHORD_ITERATIONS, POLISH_TOLERANCE, self._note(stage, level))
        level.reference = kept

    def _as_whole(self, level: Level) -> Reference:
        """The triangles of a level in the size they have on the full mesh: coarse ones cover less than all."""
        whole, covered = (energy.slack_areas(self.ascent.V, faces).sum() for faces in (self.ascent.full, self._faces()))
        own = level.reference
        return own._replace(k=own.k * (whole / covered), inverse=own.inverse * (whole / covered))

    def _faces(self) -> Int[np.ndarray, "k 3"]:
        """Faces of the mesh so far."""
        return self.ascent.F[self.ascent.F[:, 0] >= 0]

    def _problem(self, level: Level, ground: Ground, goals: Goals, price: Price, evening: Evening | None) -> Polish:
        """A level against the target's surface, with the stretch of its images spread if there is an evening."""
        images = Images(self.target.faces_under(level.S), np.empty((len(level.S), 15)))
        if evening is not None:
            chord.locate(level.S, ground, self.target.rows, images)
            level.reference = evening.reference(images.row[:, :3])
        return Polish(level, ground, self.target.rows, goals, price.delta, self.target.seats(level), images, price.tau)

    def _polish(self, level: Level, options: EmbeddingOptions) -> float:
        """Rounds of sweeps and Newton against the target's surface; the energy in the source's own metric."""
        finest, goals, own = self.target.finest, self._local(np.arange(self.n), PULL), level.reference
        evening, likeness = None, Likeness.prepare(self.mesh, self.shares(level), self.target.map)
        for turn in range(options.rounds):
            self.recorder.progress += (1 - self.recorder.progress) / 3
            price = OWN if turn == 0 else LAST if turn == options.rounds - 1 else EVEN
            problem = replace(self._problem(level, finest, goals, price, evening), likeness=likeness)
            iterations = min(options.iterations, EVEN_ITERATIONS) if turn else options.iterations
            note = partial(self.recorder.note, "polish, even" if turn else "polish")
            level.S = problem.newton(problem.sweep(level.S, SWEEPS), iterations, POLISH_TOLERANCE, note)
            evening = evening or (Evening.prepare(level) if options.rounds > 1 else None)
        level.reference = own
        return self._problem(level, finest, goals, LAST, None).value(level.S)


def _turned(S: Float[np.ndarray, "n 3"], rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "n 3"]:
    """Unit vectors after a rotation, unit again to the last bit that counts."""
    turned = S @ rotation.T
    return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def _spans(n: int, coarse: int) -> Iterator[tuple[int, int]]:
    """Ranges (high, low) of records to undo: up to `coarse` vertices, then to all."""
    count = 4
    while count < n:
        goal = max(int(count * GROWTH), count + 4)
        if count < coarse:
            goal = min(goal, coarse)
        elif goal > JUMP * n:
            goal = n
        yield n - count, n - goal
        count = goal


def _goals(source: Repaired, target: Target, pairs: VertexPairs) -> Goals:
    """Where the paired vertices shall go; one goal per vertex, the weighted mean where it has several."""
    vertices, place = np.unique(source.vertex_map[pairs.source], return_inverse=True)
    points = target.map.points[pairs.target]
    weight = np.array(pairs.weight, float)
    stiffness = weight / max(weight.sum() / max(len(weight), 1), np.finfo(float).tiny) * target.scales(points)
    total = np.bincount(place, stiffness, len(vertices))
    mean = np.stack([np.bincount(place, stiffness * x, len(vertices)) for x in points.T], axis=1) / total[:, None]
    return Goals(vertices, mean, total)


def _joined(one: Goals, other: Goals) -> Goals:
    """Both; the other wins where they concern the same vertex."""
    keep = ~np.isin(one.vertices, other.vertices)
    return Goals(*(np.concatenate([a[keep], b]) for a, b in zip(one, other, strict=True)))
