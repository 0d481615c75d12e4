"""The last relaxation of a mesh laid into another's sphere: chord energy with a little metric energy, by two means in turn.

Sweeps move one vertex at a time on the true energy, which is not smooth where images cross the target's edges. Newton moves all at
once on its smoothed model, with steps that are shortened only around the triangles that would fold or get much worse; they alone heed
the likeness of relief.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from morphlet.errors import SolveError
from morphlet.mapping import chord, metric
from morphlet.mapping.chord import TINY, Chord, Images, pair, stretch
from morphlet.mapping.metric import Ground, Seats, Source, form, robust, under
from morphlet.mapping.relief import Likeness
from morphlet.numerics.compiled import inner_kernel, kernel
from morphlet.numerics.optimize import DAMPING_PROJECTED
from morphlet.sphere import energy
from morphlet.sphere.energy import distance2, tangents
from morphlet.sphere.level import Level

METRIC_SHARE = 0.1
"""Weight of the metric energy beside that of the chords: a barrier against collapse (at .02 errors between species grow by a third)."""
DAMPING = 1e-4
"""Added to the diagonal of the Hessian, relative to it: the smoothed Jacobian overrates the model."""
LONGEST_MOVE = 0.5
"""Radians a vertex may move in one Newton step."""
ROOM, ENOUGH = 1.25, 1.2
"""Triangles shall not fold before 1.25 times the step; 1.2 is near enough."""
SHORTENINGS, GENTLE, LEAST_SHARE = 10, 6, 0.1
"""Passes that shorten the step of corners; the first six leave a tenth of it, the last may take it all."""
TRIALS = 12
"""Halvings of a step."""
HELD = (0.3, 0.3, 0.0)
"""Shares of their step that the corners of triangles that got much worse keep, one after the other, before the whole step is halved."""
WORSE, WORSE_FLOOR, MOST_WORSE = 1.3, 0.02, 0.3
"""A triangle is much worse if its term grew by 30 % and 2 % of its weight; if that holds for 30 % of all, the whole step is halved."""
ENOUGH_DECREASE = 0.1
"""Share of the linear decrease with which a step is taken at once."""
DECREASE = 1e-4
"""Relative decrease with which the best step of one length is taken."""
PATIENCE = 2
"""Small steps in a row that end the Newton iteration."""
STENCIL, REACH = 0.15, 0.8
"""Of the shortest edge at a vertex: distance of its trial points, and the farthest that a sweep moves it."""
LEAST_CURVATURE = 0.05
"""Share of the larger curvature that the smaller one counts at least."""
CUTS, CUT = 5, 0.4
"""A vertex's step is cut five times before it is given up."""
TURN, TWIST = 1.7, 0.37
"""Radians by which the stencil turns from sweep to sweep and from vertex to vertex: no direction is favoured."""
LEAST_VOLUME = 1e-16
"""Sweeps stay above this determinant of unit vectors, the rounding of its computation."""


class Goals(NamedTuple):
    """Places that vertices are pulled to (numba type): vertices (q,), points on the target's sphere (q, 3), stiffness (q,)."""

    vertices: Int[np.ndarray, "q"]
    places: Float[np.ndarray, "q 3"]
    stiffness: Float[np.ndarray, "q"]

    def value(self, S: Float[np.ndarray, "n 3"]) -> float:
        """Sum of stiffness times squared distance."""
        return float(self.stiffness @ np.sum((S[self.vertices] - self.places) ** 2, axis=1))

    def add(
        self, S: Float[np.ndarray, "n 3"], T: Float[np.ndarray, "n 2 3"], gradient: Float[np.ndarray, "d"], diagonal: Float[np.ndarray, "d"]
    ) -> None:
        """Its derivatives in the tangent frames T; the Hessian is taken as that of flat space, a multiple of the identity."""
        slope = 2 * np.einsum("nai,ni->na", T[self.vertices], S[self.vertices] - self.places) * self.stiffness[:, None]
        for axis in range(2):
            gradient[2 * self.vertices + axis] += slope[:, axis]
            diagonal[2 * self.vertices + axis] += 2 * self.stiffness


class Terms(NamedTuple):
    """What a sweep needs of the energy (numba type): the source for chords and for the metric, seats, tau."""

    chords: Source
    metric: Source
    seats: Seats
    tau: float


@dataclass(eq=False)
class Polish:
    """The full mesh on the target's sphere, as a problem of optimisation.

    Parameters
    ----------
    level
        The source: faces, metric, weights, place of every Hessian entry.
    ground, rows
        The target's metric, not smoothed, and what its vertices carry (`chord.sheet`).
    goals
        Landmarks.
    delta
        How robust: excess distortion up to its square counts almost linearly.
    seats, images
        First guesses of the target's faces.
    tau
        The chord energy rises steeply below this area ratio.
    likeness
        Relief that images should share; None leaves it out.
    """

    level: Level
    ground: Ground
    rows: Float[np.ndarray, "N 15"]
    goals: Goals
    delta: float
    seats: Seats
    images: Images
    tau: float = 0.5
    likeness: Likeness | None = None

    def __post_init__(self) -> None:
        m = len(self.level.F)
        self.terms = Chord(np.empty(m), np.empty(m), self.tau)
        r = self.level.reference
        self.chords = Source(self.level.F, r.k, r.inverse, r.weight, self.delta)
        self.metric = self.chords._replace(weight=METRIC_SHARE * r.weight)

    def soften(self, tau: float) -> None:
        """Let the chord energy rise steeply below another area ratio."""
        self.terms = self.terms._replace(tau=tau)

    def value(self, S: Float[np.ndarray, "n 3"]) -> float:
        """E at S, infinite if a triangle folds; everything else follows S."""
        total = metric.value(S, self.metric, self.ground, self.seats)
        if not np.isfinite(total):
            return np.inf
        chord.locate(S, self.ground, self.rows, self.images)
        total += chord.value(self.chords, self.images, self.terms) + self.goals.value(S)
        return total if self.likeness is None else total + self.likeness.value(S, self.images.face)

    def direction(self, S: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], float]:
        """Newton direction at the S of the last `value`, as tangent vectors, and its slope."""
        T = np.empty((len(S), 2, 3))
        energy.frames(S, T)
        g, H = metric.derivatives(S, T, self.metric, self.ground, self.seats, False)
        chord.add_derivatives(T, self.chords, self.images, self.terms, g, H)
        gradient, hessian = self.level.assembled(g, H)
        if self.likeness is not None:
            self.likeness.add((S, T), self.images.face, gradient, hessian, self.level.diagonal)
        diagonal = hessian[self.level.diagonal]
        self.goals.add(S, T, gradient, diagonal)
        hessian[self.level.diagonal] = (1 + DAMPING) * diagonal + DAMPING_PROJECTED * np.abs(diagonal).mean()
        step = -self.level.analysis.factor(hessian).solve(gradient)
        return np.einsum("ne,ned->nd", step.reshape(-1, 2), T), float(gradient @ step)

    def newton(self, S: Float[np.ndarray, "n 3"], iterations: int, tolerance: float, note: Callable[..., None]) -> Float[np.ndarray, "n 3"]:
        """Minimise from S by damped Newton steps; stops when two in a row decrease E by less than `tolerance` of itself."""
        reached, small = self.value(S), 0
        for iteration in range(iterations):
            try:
                along, slope = self.direction(S)
            except SolveError:
                break
            if not slope < 0:
                break
            before = reached
            found, reached, alpha = self._search(S, along, before, slope)
            note(iteration, reached, alpha, alpha > 0)
            if alpha == 0:
                break
            S = found
            self.value(S)
            small = small + 1 if before - reached < tolerance * reached else 0
            if small == PATIENCE:
                break
        return S

    def _search(
        self, S: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"], before: float, slope: float
    ) -> tuple[Float[np.ndarray, "n 3"], float, float]:
        """A step that decreases E, held back around the triangles that resist; S itself and 0 if there is none."""
        lengths = np.linalg.norm(along, axis=1, keepdims=True)
        along = along * np.minimum(1.0, LONGEST_MOVE / np.maximum(lengths, np.finfo(float).tiny))
        along, alpha = self._with_room(S, along)
        energies, best = self.terms.energy.copy(), (S, before, 0.0)
        for _ in range(TRIALS):
            held = along
            for share in HELD:
                found = self._tried(S, held, alpha)
                best = min(best, found, key=lambda one: one[1])
                if best[1] <= before + ENOUGH_DECREASE * alpha * slope:
                    return best
                worse = self._much_worse(energies) if np.isfinite(found[1]) else np.zeros(0, bool)
                if not 0 < worse.sum() <= MOST_WORSE * len(energies):
                    break
                held = held.copy()
                held[self.level.F[worse].ravel()] *= share
            alpha /= 2
            if best[1] < before - DECREASE * before:
                return best
        return best

    def _tried(
        self, S: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"], alpha: float
    ) -> tuple[Float[np.ndarray, "n 3"], float, float]:
        """Where a step leads, the energy there, its length."""
        alpha = min(alpha, 0.8 * energy.largest_step(S, along, self.level.F, ROOM))
        moved = np.empty_like(S)
        energy.move(S, along, alpha, moved)
        return moved, self.value(moved), alpha

    def _much_worse(self, energies: Float[np.ndarray, "m"]) -> np.ndarray:
        """Which triangles are much worse than before the step."""
        return self.terms.energy > WORSE * energies + WORSE_FLOOR * self.level.reference.weight

    def _with_room(self, S: Float[np.ndarray, "n 3"], along: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 3"], float]:
        """The direction, shortened at the corners of triangles that would soon fold; how much of it may be gone."""
        for turn in range(SHORTENINGS):
            room = energy.face_steps(S, along, self.level.F, ROOM)
            if room.min() >= ENOUGH:
                break
            tight = room < ROOM
            share = np.ones(len(S))
            least = np.maximum(room[tight] / ROOM, LEAST_SHARE if turn < GENTLE else 0.0)
            np.minimum.at(share, self.level.F[tight].ravel(), np.repeat(least, 3))
            along = along * share[:, None]
        return along, min(1.0, 0.8 * energy.largest_step(S, along, self.level.F, ROOM))

    @cached_property
    def _incidence(self) -> tuple[Int[np.ndarray, "n1"], Int[np.ndarray, "h"]]:
        """The faces at each vertex: where they start, and which."""
        corner = self.level.F.ravel()
        counts = np.bincount(corner, minlength=len(self.level.V))
        return np.concatenate([[0], np.cumsum(counts)]), np.argsort(corner, kind="stable") // 3

    def sweep(self, S: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "n 3"]:
        """Move every vertex `count` times, one after the other, on the true energy."""
        self.value(S)
        S, n = S.copy(), len(S)
        pull, place = np.zeros(n), np.zeros((n, 3))
        pull[self.goals.vertices], place[self.goals.vertices] = self.goals.stiffness, self.goals.places
        terms = Terms(self.chords, self.metric, self.seats, self.terms.tau)
        for turn in range(count):
            _sweep((S, self._incidence, (pull, place), terms, self.images), (self.ground, self.rows), TURN * (turn + 1))
        return S


@inner_kernel
def _face_energy(t, v, y, row, scene):  # of face t with its corner v at y, whose image is `row`
    S, _, _, terms, images = scene
    c, chords, M = terms.chords.F[t], terms.chords, terms.seats.metric[t]
    a, b, d = c[0], c[1], c[2]
    p, q, r = (y if a == v else S[a]), (y if b == v else S[b]), (y if d == v else S[d])
    ex, ey, ez, gx, gy, gz = q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2]
    volume = p[0] * (ey * gz - ez * gy) + p[1] * (ez * gx - ex * gz) + p[2] * (ex * gy - ey * gx)
    if volume <= LEAST_VOLUME:
        return np.inf
    k = chords.k[t]
    n = k[0] * form(M, gx - ex, gy - ey, gz - ez) + k[1] * form(M, gx, gy, gz) + k[2] * form(M, ex, ey, ez)
    D = volume * chords.inverse[t] * terms.seats.root[t]
    total = terms.metric.weight[t] * robust(0.25 * n * (1 + 1 / (D * D)), terms.metric.delta)[0]
    image = images.row
    p, q, r = (row if a == v else image[a]), (row if b == v else image[b]), (row if d == v else image[d])
    n, D = pair(k, chords.inverse[t], p, q, r)
    return total + chords.weight[t] * np.sqrt(max(stretch(n, D, terms.tau)[0] - 1, 0.0) + chords.delta * chords.delta)


@inner_kernel
def _ring_energy(v, y, row, scene):  # of all faces at v, and of its landmark
    starts, faces = scene[1]
    pull, place = scene[2]
    total = pull[v] * ((y[0] - place[v, 0]) ** 2 + (y[1] - place[v, 1]) ** 2 + (y[2] - place[v, 2]) ** 2)
    for k in range(starts[v], starts[v + 1]):
        total += _face_energy(faces[k], v, y, row, scene)
        if total == np.inf:
            break
    return total


@inner_kernel
def _shortest(v, scene):  # length of the shortest edge at v
    S, (starts, faces), F = scene[0], scene[1], scene[3].chords.F
    least = np.inf
    for k in range(starts[v], starts[v + 1]):
        for c in range(3):
            if F[faces[k], c] != v:
                least = min(least, distance2(S, v, F[faces[k], c]))
    return np.sqrt(least)


@inner_kernel
def _frame(x, turn):  # two unit tangents at x, turned
    ax, ay, az, bx, by, bz = tangents(x[0], x[1], x[2])
    c, s = np.cos(turn), np.sin(turn)
    return (c * ax + s * bx, c * ay + s * by, c * az + s * bz), (c * bx - s * ax, c * by - s * ay, c * bz - s * az)


@inner_kernel
def _tried(v, step, frame, scene, target, place):  # energy with v moved by a step in the frame; place: where it is then, and its image
    (dx, dy), (a, b), (ground, rows), (y, row) = step, frame, target, place
    x = scene[0][v]
    px, py, pz = x[0] + dx * a[0] + dy * b[0], x[1] + dx * a[1] + dy * b[1], x[2] + dx * a[2] + dy * b[2]
    s = 1 / np.sqrt(px * px + py * py + pz * pz)
    y[0], y[1], y[2] = px * s, py * s, pz * s
    face, u, v_, w = under(ground, scene[4].face[v], y[0], y[1], y[2])
    i, j, k = ground.corner[3 * face], ground.corner[3 * face + 1], ground.corner[3 * face + 2]
    for e in range(6):
        row[e] = u * rows[i, e] + v_ * rows[j, e] + w * rows[k, e]
    return _ring_energy(v, y, row, scene), face


@inner_kernel
def _newton_step(start, around, h, longest):  # diagonal Newton from the energies at a vertex and at its stencil
    hx, hy = (around[0] - 2 * start + around[1]) / (h * h), (around[2] - 2 * start + around[3]) / (h * h)
    floor = LEAST_CURVATURE * max(abs(hx), abs(hy)) + TINY
    dx, dy = (around[1] - around[0]) / (2 * h) / max(hx, floor), (around[3] - around[2]) / (2 * h) / max(hy, floor)
    shrink = min(1.0, longest / (np.sqrt(dx * dx + dy * dy) + TINY))
    return dx * shrink, dy * shrink


@kernel
def _sweep(scene, target, turn):  # every vertex once, in place: four points around it, then a diagonal Newton step
    S, images = scene[0], scene[4]
    place, best, around = (np.empty(3), np.empty(6)), (np.empty(3), np.empty(6)), np.empty(4)
    for v in range(S.shape[0]):
        shortest, frame = _shortest(v, scene), _frame(S[v], turn + TWIST * v)
        start = least = _ring_energy(v, S[v], images.row[v], scene)
        h, best_face, dx, dy = STENCIL * shortest, -1, 0.0, 0.0
        for trial in range(5 + CUTS):
            if trial < 4:
                side = h if trial % 2 == 0 else -h
                dx, dy = side if trial < 2 else 0.0, side if trial >= 2 else 0.0
            elif trial == 4:
                if not around[0] + around[1] + around[2] + around[3] < np.inf:
                    break
                dx, dy = _newton_step(start, around, h, REACH * shortest)
            else:
                dx, dy = CUT * dx, CUT * dy
            reached, face = _tried(v, (dx, dy), frame, scene, target, place)
            if trial < 4:
                around[trial] = reached
            if reached < least:
                least, best_face = reached, face
                for e in range(6):
                    best[0][e % 3], best[1][e] = place[0][e % 3], place[1][e]
                if trial >= 4:
                    break
        if best_face >= 0:
            images.face[v] = best_face
            for e in range(6):
                S[v, e % 3], images.row[v, e] = best[0][e % 3], best[1][e]
