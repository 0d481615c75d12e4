"""A one-to-one map to the sphere of low distortion: down to a tetrahedron and back.

The mesh is collapsed to a tetrahedron, which lies on the sphere without folds. The vertices come back in batches that
double their number: each is put into the kernel of its ring, so no triangle ever folds; then all vertices are relaxed, one
by one and by projected Newton steps whose line search cannot leave the fold-free set. The result is certified with exact
signs; if rounding spoiled an attempt, a more cautious one follows (thin limbs and degenerate metrics need it).
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.errors import InputError, SolveError
from morphlet.numerics.optimize import NewtonOptions, OnStep, Step, Trace, newton
from morphlet.sphere import energy
from morphlet.sphere.energy import Reference
from morphlet.sphere.level import Level
from morphlet.sphere.quality import certificate
from morphlet.sphere.relax import insert, relax_range
from morphlet.surface.hierarchy import CollapseCost, Hierarchy, decimate, pull_up, push_down
from morphlet.surface.mesh import Mesh

FINE_FLOOR = 1e-6
"""Squared edge length, over the mean triangle area, below which a triangle counts as equilateral."""
GROWTH, JUMP = 2.0, 0.75
"""Vertices double per level; beyond 3/4 of all the rest comes at once."""
SWEEPS, LAST_SWEEPS = 4, 6
NEWTON_FROM, NEWTON_ALWAYS_BELOW, NEWTON_SHARE = 60, 4000, 0.35
"""Newton runs on levels of 60 to 4000 vertices, then on every second level below 35 % of the mesh, then on the full mesh."""
NEWTON_RAW_BELOW = 2000
"""The unprojected Hessian is positive definite mostly below 1000 to 2000 vertices, never seen so above."""
LEVEL_NEWTON = NewtonOptions(10, 1e-3)
LAST_NEWTON = NewtonOptions(8, 5e-4)
BALANCE_NEWTON = NewtonOptions(40, 1e-4)
"""On levels, on the full mesh, and for the last relaxation of another balance: most stop earlier by their tolerance."""
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
            points, reason = Ascent(unit, virtual, options, attempt, recorder).run()
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


Put = Callable[..., int]
"""Puts vertices back into their rings, as `relax.insert` does: the record that failed, or -1."""


class Ascent:
    """One attempt, from the tetrahedron to the full mesh; `late` are vertices that come back first."""

    def __init__(
        self, mesh: Mesh, virtual: Bool[np.ndarray, "m"], options: SphereOptions, attempt: Attempt, recorder: Recorder,
        late: Int[np.ndarray, "k"] | None = None,
    ) -> None:  # fmt: skip
        self.V, self.full = np.array(mesh.vertices), np.array(mesh.faces)
        self.options, self.attempt, self.recorder = options, attempt, recorder
        self.coarse = self.V if attempt.cost == "shape" else np.zeros_like(self.V)
        self.hierarchy = decimate(mesh, attempt.cost, late)
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
            self.insert(high, low, insert)
            level, vertices = self.level(last=low == 0)
            self.recorder.progress = (len(vertices) / len(self.V)) ** 0.5 * (1.0 if low else 0.9)
            reason = self.relax(level, last=low == 0, number=number)
            if not np.isfinite(level.S).all():
                raise SolveError("finite points", "NaN after relaxation", "try the next attempt")
            self.S[vertices] = level.S
        self.recorder.progress = 1.0
        return self.S, reason

    def insert(self, high: int, low: int, put: Put) -> None:
        """Undo records high - 1 .. low; where a ring's kernel is lost to rounding, relax the mesh so far and go on there."""
        self._put(high, low, put)
        self.alive[self.hierarchy.removed[low:high]] = True
        pull_up(high, low, *self.records[:2], self.hierarchy.ring_vertices, self.mass)

    def _put(self, high: int, low: int, put: Put) -> None:
        """The vertices alone."""
        rows = self.F[self.F[:, 0] >= 0]
        scale2 = 4 * np.pi / energy.slack_areas(self.coarse, rows).sum()
        n = int(self.alive.sum())
        floor2 = self.attempt.floor * 4 * np.pi / (2 * n)
        for retry in range(self.attempt.retries + 1):
            failed = put(high, low, self.records, self.coarse, self.S, self.F, scale2, floor2, self.hierarchy.max_ring)
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

    def level(self, last: bool) -> tuple[Level, Int[np.ndarray, "k"]]:
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

    def relax(self, level: Level, last: bool, number: int) -> str:
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
