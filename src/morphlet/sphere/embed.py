"""A one-to-one map to the sphere of low distortion: down to a tetrahedron and back.

The mesh is collapsed to a tetrahedron, which lies on the sphere without folds. The vertices come back in batches that
double their number: each is put into the kernel of its ring, so no triangle ever folds; then all vertices are relaxed, one
by one and by projected Newton steps whose line search cannot leave the fold-free set. The result is certified with exact
signs; if rounding spoiled an attempt, a more cautious one follows (thin limbs and degenerate metrics need it).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from morphlet.errors import InputError, SolveError
from morphlet.numerics.linalg import Analysis, analyse
from morphlet.numerics.optimize import NewtonOptions, OnStep, Step, Trace, newton
from morphlet.sphere import energy
from morphlet.sphere.energy import Reference
from morphlet.sphere.quality import certificate
from morphlet.sphere.relax import colour_order, insert, relax_colours, relax_range
from morphlet.surface.hierarchy import CollapseCost, Hierarchy, decimate, pull_up, push_down
from morphlet.surface.mesh import Mesh

FINE_FLOOR = 1e-6
"""Squared edge length, over the mean triangle area, below which a triangle counts as equilateral."""
GROWTH, JUMP = 2.0, 0.75
"""Vertices double per level; beyond 3/4 of all the rest comes at once."""
SWEEPS, LAST_SWEEPS = 4, 6
SERIAL_BELOW = 3000
"""Vertices below which sweeps run on one thread (waking threads costs more)."""
NEWTON_FROM, NEWTON_ALWAYS_BELOW, NEWTON_SHARE = 60, 4000, 0.35
"""Newton runs on levels of 60 to 4000 vertices, then on every second level below 35 % of the mesh, then on the full mesh."""
NEWTON_RAW_BELOW = 2000
"""The unprojected Hessian is positive definite mostly below 1000 to 2000 vertices, never seen so above."""
LEVEL_NEWTON = NewtonOptions(10, 1e-3)
LAST_NEWTON = NewtonOptions(8, 1e-4)
BALANCE_NEWTON = NewtonOptions(40, 1e-4)
VIRTUAL_WEIGHT = 0.01
"""Weight of the faces that fill holes: they must not fold, their shape is nobody's concern."""
TETRAHEDRON = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / np.sqrt(3.0)


@dataclass(frozen=True)
class Attempt:
    """One rung of the ladder: how to collapse, the coarse metric's size floor, retries of a failed insertion."""

    cost: CollapseCost
    floor: float
    retries: int


LADDER = (Attempt("shape", FINE_FLOOR, 0), Attempt("shape", 0.05, 4), Attempt("valence", 2.3, 30))
"""From fast to certain. 2.3 is the squared edge of an equilateral triangle of mean area: the coarse levels of the last rung see
connectivity only, also where edges are long (a needle of 1:1:1000: mean distortion 25, against 2e9 with its positions)."""

CALM = 1e4
"""Mean energy above which a certified map is so bad that the next rung is tried too: needles of 1:300 gave 1e11 on the first, 8e2 on
the last. Meshes of animals and things end between 1 and 4."""

Weights = Literal["uniform", "area"]


@dataclass(frozen=True)
class SphereOptions:
    """What a spherical map should be good at.

    Parameters
    ----------
    p
        Exponent of the distortion of a triangle, in (0, 1]: smaller gives a lower mean and a longer tail.
    weights
        "uniform": every triangle counts the same; "area": in proportion to its area.
    balance
        None: isometric. Otherwise the map is relaxed once more, from angles alone (0) to areas alone (1).

    Examples
    --------
    >>> from morphlet import SphereOptions
    >>> SphereOptions(p=0.5).weights
    'uniform'
    """

    p: float = 1.0
    weights: Weights = "uniform"
    balance: float | None = None

    def __post_init__(self) -> None:
        if not 0 < self.p <= 1:
            raise InputError("p in (0, 1]", str(self.p), "choose 1 for the shortest tail, 0.5 for the lowest mean")
        if self.weights not in get_args(Weights):
            raise InputError(f"weights to be one of {', '.join(get_args(Weights))}", repr(self.weights), "choose one of these")
        if self.balance is not None and not 0 <= self.balance <= 1:
            raise InputError("balance in [0, 1], or None", str(self.balance), "choose 0 for angles, 1 for areas")


@dataclass(frozen=True, eq=False)
class Embedding:
    """Unit vectors of a closed mesh's vertices, and how they came about (`trace.attempt` is the rung of the ladder that held)."""

    points: Float[np.ndarray, "n 3"]
    trace: Trace


@dataclass(eq=False)
class Recorder:
    """Turns what the solver does into steps, for the trace and for the caller's `on_step`."""

    on_step: OnStep | None
    steps: list[Step] = field(default_factory=list)
    progress: float = 0.0

    def note(self, stage: str, iteration: int, objective: float, length: float = 1.0, accepted: bool = True) -> None:
        """Record one step; the caller may raise `Cancelled` from its callback."""
        step = Step(stage, iteration, objective / (4 * np.pi), length, accepted, self.progress)
        self.steps.append(step)
        if self.on_step is not None:
            self.on_step(step)


def embed(mesh: Mesh, virtual: Bool[np.ndarray, "m"], options: SphereOptions, on_step: OnStep | None = None) -> Embedding:
    """Map a closed genus-0 mesh one-to-one to the unit sphere.

    Parameters
    ----------
    mesh
        Closed, manifold, oriented, connected, genus 0.
    virtual
        Faces that only fill holes.

    Raises
    ------
    SolveError
        If no attempt passes the certificate.

    Notes
    -----
    About 0.15 CPU s per 1000 vertices, nearly linear.

    References
    ----------
    .. [1] E. Praun, H. Hoppe, "Spherical parametrization and remeshing", SIGGRAPH 2003 (coarse to fine, kernel insertion).
    .. [2] J. Smith, S. Schaefer, "Bijective parameterization with free boundaries", SIGGRAPH 2015 (barrier and step bound).
    """
    centred = mesh.vertices - mesh.vertices.mean(axis=0)
    size = np.abs(centred).max(initial=0.0)
    unit = mesh.with_vertices(centred / size if size > 0 else centred)
    failures, found = [], []
    for number, attempt in enumerate(LADDER):
        recorder = Recorder(on_step)
        try:
            points, reason = _Ascent(unit, virtual, options, attempt, recorder).run()
        except (SolveError, ZeroDivisionError) as error:
            failures.append(f"attempt {number}: {error}")
            continue
        proof = certificate(points, unit.faces)
        if not proof.holds:
            failures.append(f"attempt {number}: {proof.inverted} inverted faces, degree {proof.degree:.6f}")
            continue
        found.append(Embedding(points, Trace(tuple(recorder.steps), reason, number)))
        if _last_energy(found[-1]) < CALM:
            break
    if not found:
        raise SolveError("a spherical map without inverted faces", "; ".join(failures), "repair the mesh or remesh its thinnest parts")
    return min(found, key=_last_energy)


def _last_energy(embedding: Embedding) -> float:
    """Mean distortion energy at the end; infinite where it overflowed."""
    energies = [step.objective for step in embedding.trace.steps]
    return energies[-1] if energies and np.isfinite(energies[-1]) else np.inf


@dataclass(eq=False)
class Level:
    """A mesh of the hierarchy in local numbering, its metric, and its current place on the sphere."""

    V: Float[np.ndarray, "n 3"]
    F: Int[np.ndarray, "m 3"]
    S: Float[np.ndarray, "n 3"]
    reference: Reference
    p: float = 1.0
    form: int = energy.ISOMETRIC
    shape: float = 0.0

    def __post_init__(self) -> None:
        self.majorant = np.empty(len(self.F))

    @cached_property
    def _sorted_edges(self) -> tuple[Int[np.ndarray, "e"], Int[np.ndarray, "e"], Int[np.ndarray, "h"], Int[np.ndarray, "h"]]:
        """Smaller and larger end of each edge in lexicographic order, the edge of each half-edge, and its twin."""
        a, b = self.F.ravel(), np.roll(self.F, -1, axis=1).ravel()
        key = np.minimum(a, b) * len(self.V) + np.maximum(a, b)
        order = np.argsort(key, kind="stable")
        edge, twin = np.empty(len(key), np.int64), np.empty(len(key), np.int64)
        edge[order] = np.arange(len(key)) // 2
        twin[order[0::2]], twin[order[1::2]] = order[1::2], order[0::2]
        low, high = np.divmod(key[order[0::2]], len(self.V))
        return low, high, edge, twin

    @cached_property
    def star(self) -> tuple[Int[np.ndarray, "h"], Int[np.ndarray, "h"], Int[np.ndarray, "n"]]:
        """Corners, twins and one outgoing half-edge per vertex."""
        corner = self.F.ravel()
        start = np.empty(len(self.V), np.int64)
        start[corner] = np.arange(len(corner))
        return corner, self._sorted_edges[3], start

    @cached_property
    def max_valence(self) -> int:
        """Largest number of faces at a vertex."""
        return int(np.bincount(self.F.ravel()).max())

    @cached_property
    def _columns(self) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "d1"]]:
        """First edge of each vertex's block column, and the column pointers."""
        low = self._sorted_edges[0]
        first = np.searchsorted(low, np.arange(len(self.V) + 1))
        counts = np.diff(first)
        lengths = np.stack([2 + 2 * counts, 1 + 2 * counts], axis=1).ravel()
        return first, np.concatenate([[0], np.cumsum(lengths)])

    @property
    def diagonal(self) -> Int[np.ndarray, "d"]:
        """Places of the diagonal among the Hessian's values."""
        return self._columns[1][:-1]

    @cached_property
    def _edge_places(self) -> Int[np.ndarray, "e 2"]:
        """Where the first entry of each edge's 2x2 block stands in its two columns."""
        low = self._sorted_edges[0]
        first, pointers = self._columns
        rank = 2 * (np.arange(len(low)) - first[low])
        return np.stack([pointers[2 * low] + 2 + rank, pointers[2 * low + 1] + 1 + rank], axis=1)

    @cached_property
    def _rows(self) -> Int[np.ndarray, "z"]:
        """Row of each entry of the Hessian's lower triangle: two unknowns per vertex, coupled along edges."""
        high = self._sorted_edges[1]
        pointers, places = self._columns[1], self._edge_places
        rows, even = np.empty(pointers[-1], np.int64), 2 * np.arange(len(self.V))
        rows[pointers[0:-1:2]], rows[pointers[0:-1:2] + 1], rows[pointers[1:-1:2]] = even, even + 1, even + 1
        for column in range(2):
            rows[places[:, column]], rows[places[:, column] + 1] = 2 * high, 2 * high + 1
        return rows

    @cached_property
    def analysis(self) -> Analysis:
        """Analysis of the Hessian."""
        return analyse(self._columns[1], self._rows)

    def matrix(self, hessian: Float[np.ndarray, "z"]) -> sp.csc_matrix:
        """The whole symmetric Hessian."""
        size = 2 * len(self.V)
        lower = sp.csc_matrix((hessian, self._rows, self._columns[1]), shape=(size, size))
        return (lower + sp.tril(lower, -1).T).tocsc()

    @cached_property
    def scatter(self) -> Int[np.ndarray, "m 21"]:
        """Place among the Hessian's values of each entry of the lower triangle of a face's 6x6 block."""
        edge, places, pointers = self._sorted_edges[2], self._edge_places, self._columns[1]
        target = np.empty((len(self.F), 21), np.int64)
        for i in range(6):
            for j in range(i + 1):
                (x, a), (y, b) = divmod(i, 2), divmod(j, 2)
                slot = i * (i + 1) // 2 + j
                if x == y:
                    target[:, slot] = pointers[2 * self.F[:, x] + b] + (a - b)
                    continue
                between = edge[3 * np.arange(len(self.F)) + (y if x == (y + 1) % 3 else x)]
                swapped = self.F[:, x] < self.F[:, y]  # then row and column change places
                target[:, slot] = places[between, np.where(swapped, a, b)] + np.where(swapped, b, a)
        return target

    def value(self, x: Float[np.ndarray, "n 3"]) -> float:
        """Energy at x; the majorant's weights follow it."""
        return float(energy.value(x, self.F, self.reference, self.form, self.shape, self.p, self.majorant))

    def model(self, x: Float[np.ndarray, "n 3"], project: bool) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian values in the tangent frames of x."""
        self.frames = np.empty((len(x), 2, 3))
        energy.frames(x, self.frames)
        g, H = energy.derivatives(x, self.F, self.reference, self.form, self.shape, self.majorant, self.frames, project)
        unknowns = 2 * self.F[:, [0, 0, 1, 1, 2, 2]] + np.array([0, 1, 0, 1, 0, 1])
        gradient = np.bincount(unknowns.ravel(), g.ravel(), 2 * len(x))
        return gradient, np.bincount(self.scatter.ravel(), H.ravel(), self._columns[1][-1])

    def direction(self, x: Float[np.ndarray, "n 3"], step: Float[np.ndarray, "d"]) -> Float[np.ndarray, "n 3"]:
        """Tangent vectors of a step."""
        return np.einsum("ne,ned->nd", step.reshape(-1, 2), self.frames)

    def largest_step(self, x: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"], limit: float) -> float:
        """A step up to which no triangle folds; the hinge form may cross folds."""
        if self.form == energy.HINGE:
            return limit
        return float(energy.largest_step(x, direction, self.F, limit))

    def moved(self, x: Float[np.ndarray, "n 3"], direction: Float[np.ndarray, "n 3"], alpha: float) -> Float[np.ndarray, "n 3"]:
        """x moved and back on the sphere."""
        out = np.empty_like(x)
        energy.move(x, direction, alpha, out)
        return out

    def sweep(self, count: int, note: Callable[[int, float], None]) -> None:
        """Relax every vertex `count` times, colour by colour."""
        corner, twin, start = self.star
        size = self.max_valence
        order, offsets = colour_order(corner, twin, start, size)
        for turn in range(count):
            note(turn, self.value(self.S))
            if len(self.V) < SERIAL_BELOW:
                relax_range(order, 0, len(order), self.S, corner, twin, start, self.reference, self.majorant, size)
            else:
                relax_colours(order, offsets, self.S, corner, twin, start, self.reference, self.majorant, size)


class _Ascent:
    """One attempt, from the tetrahedron to the full mesh."""

    def __init__(self, mesh: Mesh, virtual: Bool[np.ndarray, "m"], options: SphereOptions, attempt: Attempt, recorder: Recorder) -> None:
        self.V, self.full = np.array(mesh.vertices), np.array(mesh.faces)
        self.options, self.attempt, self.recorder = options, attempt, recorder
        self.coarse = self.V if attempt.cost == "shape" else np.zeros_like(self.V)
        self.hierarchy = decimate(mesh, attempt.cost)
        h = self.hierarchy
        self.records = (h.removed, h.ring_offsets, h.ring_vertices, h.ring_faces)
        self.weights = _face_weights(self.V, self.full, virtual, options)
        self.mass = np.bincount(self.full.ravel(), np.repeat(self.weights / 3, 3), len(self.V))
        push_down(*self.records[:2], h.ring_vertices, self.mass)
        self.F, self.S = h.bottom(), _base_points(h)
        self.alive = np.zeros(len(self.V), bool)
        self.alive[h.base_vertices] = True

    def run(self) -> tuple[Float[np.ndarray, "n 3"], str]:
        """Undo all collapses, relaxing after each batch."""
        reason = "tetrahedron"
        for number, (high, low) in enumerate(self.hierarchy.batches(GROWTH, JUMP), start=1):
            self._insert(high, low)
            self.alive[self.hierarchy.removed[low:high]] = True
            pull_up(high, low, *self.records[:2], self.hierarchy.ring_vertices, self.mass)
            level, vertices = self._level(last=low == 0)
            self.recorder.progress = (len(vertices) / len(self.V)) ** 0.5 * (1.0 if low else 0.9)
            reason = self._relax(level, last=low == 0, number=number)
            if not np.isfinite(level.S).all():
                raise SolveError("finite points", "NaN after relaxation", "try the next attempt")
            self.S[vertices] = level.S
        self.recorder.progress = 1.0
        return self.S, reason

    def _insert(self, high: int, low: int) -> None:
        """Undo records high - 1 .. low; where a ring's kernel is lost to rounding, relax the mesh so far and go on there."""
        rows = self.F[self.F[:, 0] >= 0]
        scale2 = 4 * np.pi / energy.slack_areas(self.coarse, rows).sum()
        n = int(self.alive.sum())
        floor2 = self.attempt.floor * 4 * np.pi / (2 * n)
        for retry in range(self.attempt.retries + 1):
            failed = insert(high, low, self.records, self.coarse, self.S, self.F, scale2, floor2, self.hierarchy.max_ring)
            if failed < 0:
                return
            high = failed + 1
            self.F = self.hierarchy.faces_after(high)  # the failed record had begun to write its rows
            self._fatten(high, 10 * (retry + 1))
        raise SolveError("room for every vertex in its ring", f"no kernel at record {high - 1}", "try the next attempt")

    def _fatten(self, high: int, sweeps: int) -> None:
        """Relax the mesh so far as if all its triangles were equilateral and equal: every ring gets a fat kernel."""
        self.alive[self.hierarchy.removed[high:]] = True
        vertices, faces = _compact(self.F, len(self.V))
        area = 4 * np.pi / len(faces)
        even = Reference(np.full((len(faces), 3), 0.5 / (np.sqrt(3.0) * area)), np.full(len(faces), 0.5 / area), np.ones(len(faces)))
        level = Level(self.V[vertices], faces, self.S[vertices], even)
        corner, twin, start = level.star
        everyone = np.arange(len(vertices))
        for _ in range(sweeps):
            relax_range(everyone, 0, len(vertices), level.S, corner, twin, start, even, even.weight, level.max_valence)
        self.S[vertices] = level.S

    def _level(self, last: bool) -> tuple[Level, Int[np.ndarray, "k"]]:
        """The mesh so far, with its metric and weights."""
        vertices, faces = _compact(self.F, len(self.V))
        seen, floor = (self.V, FINE_FLOOR) if last else (self.coarse, self.attempt.floor)
        metric = energy.reference(seen[vertices], faces, floor)
        if last:
            weight = self.weights[self.F[:, 0] >= 0]
        else:
            share = self.mass[vertices] / np.bincount(faces.ravel())
            weight = share[faces].sum(axis=1)
        return Level(self.V[vertices], faces, self.S[vertices], metric._replace(weight=weight), self.options.p), vertices

    def _relax(self, level: Level, last: bool, number: int) -> str:
        """Sweeps, then Newton where it pays."""
        n = len(level.V)
        level.sweep(LAST_SWEEPS if last else SWEEPS, lambda turn, value: self.recorder.note(f"sweep {n}", turn, value))
        often = n < NEWTON_ALWAYS_BELOW or (n < NEWTON_SHARE * len(self.V) and number % 2 == 0)
        if n < NEWTON_FROM or not (last or often):
            return "swept"
        chosen = LAST_NEWTON if last else LEVEL_NEWTON
        chosen = NewtonOptions(chosen.iterations, chosen.tolerance, try_raw=n < NEWTON_RAW_BELOW)
        level.S, reason = newton(level, level.S, chosen, lambda *step: self.recorder.note(f"newton {n}", *step))
        if last and self.options.balance is not None:
            level.form, level.shape, level.p = energy.ANGLE_AREA, self.options.balance, 1.0
            level.S, reason = newton(level, level.S, BALANCE_NEWTON, lambda *step: self.recorder.note("balance", *step))
        return reason


def _face_weights(
    V: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"], virtual: Bool[np.ndarray, "m"], options: SphereOptions
) -> Float[np.ndarray, "m"]:
    """Weights of the full mesh's faces, summing to 4 pi."""
    weight = np.ones(len(F)) if options.weights == "uniform" else energy.slack_areas(V, F)
    weight = np.where(virtual, VIRTUAL_WEIGHT * weight, weight)
    return weight * (4 * np.pi / weight.sum())


def _base_points(hierarchy: Hierarchy) -> Float[np.ndarray, "n 3"]:
    """The four survivors on a regular tetrahedron, with the orientation of their faces."""
    S = np.zeros((hierarchy.n_vertices, 3))
    first = hierarchy.base_faces[0]
    fourth = np.setdiff1d(hierarchy.base_vertices, first)[0]
    corners = TETRAHEDRON if np.linalg.det(TETRAHEDRON[:3]) > 0 else TETRAHEDRON[[1, 0, 2, 3]]
    S[np.append(first, fourth)] = corners
    return S


def _compact(F: Int[np.ndarray, "m 3"], n: int) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "l 3"]]:
    """Vertices in use, and the existing face rows in their local numbering."""
    rows = F[F[:, 0] >= 0]
    used = np.zeros(n, bool)
    used[rows] = True
    return np.nonzero(used)[0], (np.cumsum(used) - 1)[rows]
