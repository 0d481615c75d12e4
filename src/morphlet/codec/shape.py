"""One closed surface in few bytes, its triangles new: a coarse mesh, subdivided, moved along its normals level by level."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.codec.coarsening import coarser, require_closed
from morphlet.codec.container import damaged
from morphlet.codec.fitting import Quadratic, Surface, Target, evenness, fit_moves, fit_points, rounded
from morphlet.codec.payloads import GROWTH_ONE, RATIO_ONE, Law, packed, read_moves, sizes, unpacked
from morphlet.codec.rest import Shape, read_faces, read_positions, write_faces, write_positions
from morphlet.codec.subdivision import Refinement, edge_normals, refined_sizes, refinements
from morphlet.codec.surface_error import surface_error
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh

BIAS = 0.05
"""Moves are read this much shorter than their whole number of steps: smaller ones are more frequent."""
PRICE = 0.08
"""Squared steps of error, of a mean unknown, that a bit is worth."""
GROWTH = 72 / 64
"""Steps grow from level to level: coarse moves carry fine ones, and there are fewer."""
RATIO = 8
"""The first step in 1/16 spacings of the control points' lattice."""
POINT_ROUNDS, FINE_ROUNDS, MOVE_ROUNDS = 7, 1, 2
ROUGH_LEVELS = 2
"""How often pairs of places are found anew."""
SAMPLES = 10_000
"""Of the target, that fits look at."""
FIRST_RMS, FACES_POWER = 9e-4, 1.65
"""A distance in diagonals, and how faces of a coarse mesh grow with finer ones, as on a rabbit of 7,000 faces."""
FEWEST_FACES, MOST_FACES, MOST_POWER = 24.0, 60_000.0, 6.0
"""Of a coarse mesh: with three levels still fewer vertices than a reader takes; and the power at most."""
FACE_TRIES, NEAR_ENOUGH, BEYOND = 4, 0.1, 0.03
"""Of the search for a coarse mesh, and below and above what (of the logarithm of the rms) steps do the rest."""
STEP_TRIES, STEP_POWER, STEP_AIM, STEP_ENOUGH = 4, 1.5, 0.993, 0.985
"""Of the search for a step, the power of the distance that it goes with at first; what share of the distance is aimed at, and enough."""
MOST_RATIO = 2.0
"""Of one step, or number of faces, to the next."""


@dataclass(frozen=True)
class Kind:
    """A way to tell a surface: levels, those with moves, the first step in distances, faces it took at `FIRST_RMS`."""

    levels: int
    coded: int
    step: float
    faces: float


SMOOTH = Kind(levels=3, coded=2, step=6.0, faces=600.0)
"""Two levels with moves; one more makes the surface smooth. Finer steps cost more than a finer coarse mesh, coarser ones spoil it."""
FLAT = Kind(levels=0, coded=0, step=1.5, faces=1500.0)
"""Triangles alone, where edges are sharp."""


@dataclass(frozen=True, eq=False)
class Base:
    """A coarse mesh as its faces are read, with levels, and where its control points would best be."""

    faces: bytes
    shape: Shape
    levels: list[Refinement]
    origin: Float[np.ndarray, "3"]
    fit: Quadratic


def read_shape(payloads: Sequence[bytes], vertices: int) -> Mesh:
    """The mesh that payloads tell; levels whose payloads are missing are subdivided without moves.

    Parameters
    ----------
    payloads
        All, or the first ones.
    vertices
        How many the mesh has, as the file's header says.

    Raises
    ------
    CodecError
        If the payloads are damaged, or another number of vertices comes of them.

    Notes
    -----
    O(vertices).
    """
    law, (n, m), (faces, points, moves) = unpacked(payloads[0] if payloads else b"", vertices)
    shape = read_faces(faces, m, n, 0)
    if np.any(shape.twin < 0) or np.any(shape.start < 0):
        raise damaged("a coarse mesh that is not closed")
    lattice = read_positions(points, shape)
    levels = refinements(shape.faces, n, law.levels)
    apart = law.cuts & 1 or not law.coded
    if apart and moves:
        raise damaged("moves where none belong")
    told = [*payloads[1:]] if apart else [moves, *payloads[1:]]
    return _told(law, shape.faces, levels, lattice, read_moves(law, levels, told))


def shape_at(mesh: Mesh, rms: float) -> list[bytes] | None:
    """The payloads of a closed surface whose mesh is at most `rms` from it, in as few bytes as was found.

    Parameters
    ----------
    mesh
        Closed, oriented, manifold; of any genus, in any number of parts.
    rms
        Root mean square of the distance between the surfaces, the larger of both ways, in mesh units.

    Returns
    -------
    payloads
        Coarse to fine; None where coarse meshes of half as many faces do not come so near.

    Raises
    ------
    InputError
        If `rms` is not positive.
    MeshError
        If the mesh is not closed, oriented and manifold.

    Notes
    -----
    O(n log n) per try, a dozen tries. Of every try the mesh read back is measured.

    References
    ----------
    Hoppe et al., Piecewise smooth surface reconstruction, SIGGRAPH 1994 (control points by least squares); Lee, Moreton & Hoppe,
    Displaced subdivision surfaces, SIGGRAPH 2000; Loop, Smooth subdivision surfaces based on triangles, 1987.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.codec.shape import shape_at
    >>> mesh = sample("blob")
    >>> sum(len(payload) for payload in shape_at(mesh, 4e-3 * mesh.bbox_diagonal)) < 400
    True
    """
    if not (math.isfinite(rms) and rms > 0):
        raise InputError("a positive rms", f"{rms}", "ask for a distance above 0, in mesh units")
    require_closed(mesh)
    target, coarse = Target.prepare(mesh, SAMPLES), coarser(mesh)
    found = (_Search(target, coarse, rms, kind).shortest() for kind in (SMOOTH, FLAT))
    return min((each for each in found if each is not None), key=lambda payloads: sum(map(len, payloads)), default=None)


def _slope(one: tuple[float, float], two: tuple[float, float], least: float, most: float) -> float | None:
    """By which power of the distance a size changes between two pairs of both, within bounds; None if it says nothing."""
    size, distance = math.log(two[0] / one[0]), math.log(two[1] / one[1])
    return float(np.clip(size / distance, least, most)) if size * distance * least > 0 else None


@dataclass(frozen=True, eq=False)
class _Tried:
    """A try: coarse faces, first step, payloads and how far from the target they are."""

    base: Base
    step: float
    payloads: list[bytes]
    rms: float

    @property
    def bytes(self) -> int:
        """All."""
        return sum(len(payload) for payload in self.payloads)

    @property
    def coarseness(self) -> tuple[float, float]:
        """Coarse faces, and the distance."""
        return float(len(self.base.shape.faces)), self.rms


@dataclass(frozen=True, eq=False)
class _Search:
    """What tries of a kind have in common."""

    target: Target
    coarse: Callable[[int], Mesh]
    rms: float
    kind: Kind

    def shortest(self) -> list[bytes] | None:
        """The payloads of the shortest try that is near enough, if there is one."""
        mesh, tried, power = self.target.mesh, list[_Tried](), -FACES_POWER
        least, most = FEWEST_FACES, min(mesh.n_faces / 2, MOST_FACES)
        faces = self.kind.faces * (mesh.bbox_diagonal * FIRST_RMS / self.rms) ** FACES_POWER
        for _ in range(FACE_TRIES):
            faces = float(np.clip(faces, least, most))
            tried.append(self.told(round(faces)))
            off = math.log(tried[-1].rms / self.rms)
            if -NEAR_ENOUGH < off < BEYOND or faces == (least if off < 0 else most):
                break
            if len(tried) > 1:
                power = _slope(tried[-2].coarseness, tried[-1].coarseness, -MOST_POWER, -FACES_POWER / 2) or power
            least, most = (least, faces) if off < 0 else (faces, most)
            faces *= float(np.clip(math.exp(-power * off), 1 / MOST_RATIO, MOST_RATIO))
            faces = faces if least < faces < most else math.sqrt(least * most)
        return self.finest(min((each for each in tried if each.rms <= self.rms), key=lambda each: each.bytes, default=tried[-1]))

    def told(self, faces: int) -> _Tried:
        """A try with a new coarse mesh."""
        return self.again(prepared(self.target, self.coarse(faces), self.kind.levels), self.kind.step * self.rms)

    def again(self, base: Base, step: float) -> _Tried:
        """A try with a known one, its bytes read back."""
        payloads, mesh = write_shape(self.target, base, step, self.kind.coded)
        return _Tried(base, step, payloads, surface_error(self.target.mesh, read_shape(payloads, mesh.n_vertices)).rms)

    def finest(self, tried: _Tried) -> list[bytes] | None:
        """The shortest of some tries with other steps that are near enough."""
        best, power = tried if tried.rms <= self.rms else None, STEP_POWER
        for _ in range(STEP_TRIES):
            ratio = float(np.clip((STEP_AIM * self.rms / tried.rms) ** power, 1 / MOST_RATIO, MOST_RATIO))
            last, tried = tried, self.again(tried.base, tried.step * ratio)
            if tried.rms <= self.rms and (best is None or tried.bytes < best.bytes):
                best = tried
            stuck = ratio < 1 and tried.rms > max(self.rms, STEP_ENOUGH * last.rms)
            if stuck or STEP_ENOUGH * self.rms <= tried.rms <= self.rms:
                break
            power = _slope((last.step, last.rms), (tried.step, tried.rms), STEP_POWER / 2, 2 * STEP_POWER) or power
        return best.payloads if best is not None else None


def shape_sizes(payload: bytes) -> tuple[int, int]:
    """Vertices and faces of the mesh that payloads tell, from the first.

    Raises
    ------
    CodecError
        If it does not start like one.
    """
    levels, n, m = sizes(payload)
    return refined_sizes(n, m, levels)


def _told(
    law: Law, faces: Int[np.ndarray, "m 3"], levels: Sequence[Refinement], lattice: Int[np.ndarray, "n 3"], moves: Sequence[np.ndarray]
) -> Mesh:
    """The mesh of coarse faces, control points and moves."""
    positions = np.array(law.origin) + law.spacing * lattice
    for number, level in enumerate(levels):
        known = moves[number] if number < len(moves) else np.zeros(len(level.ends), np.int64)
        positions = _moved(positions, level, _lengths(known, law.steps[number] if number < len(moves) else 0.0))
    if not np.isfinite(positions).all():
        raise damaged("positions that are not finite")
    return Mesh(positions, levels[-1].finer if levels else faces)


def _lengths(moves: Int[np.ndarray, "e"], step: float) -> Float[np.ndarray, "e"]:
    """What moves of so many steps are."""
    return step * (moves - BIAS * np.sign(moves))


def _moved(positions: Float[np.ndarray, "n 3"], level: Refinement, lengths: Float[np.ndarray, "e"]) -> Float[np.ndarray, "v 3"]:
    """Positions one level on, those of its edges moved along their normals."""
    moved = edge_normals(positions, level) * lengths[:, None]
    return np.concatenate([level.even @ positions, level.odd @ positions + moved])


def write_shape(target: Target, base: Base, step: float, coded: int) -> tuple[list[bytes], Mesh]:
    """Payloads of a surface, and the mesh that they tell."""
    spacing = float(np.float32(step * RATIO_ONE / RATIO))
    law = Law(tuple(base.origin.tolist()), spacing, RATIO, round(GROWTH * GROWTH_ONE), len(base.levels), coded, 0)
    lattice = _lattice(base, spacing)
    positions, moves = np.array(law.origin) + law.spacing * lattice, []
    for number, step in enumerate(law.steps[:coded]):
        quadratic = fit_moves(target, base.levels[number:], positions, MOVE_ROUNDS)
        moves.append(rounded(quadratic, step, PRICE))
        positions = _moved(positions, base.levels[number], _lengths(moves[-1], step))
    coarse = len(lattice), len(base.shape.faces), base.faces, write_positions(base.shape, lattice)
    payloads = packed(law, base.levels, coarse, moves)
    return payloads, _told(law, base.shape.faces, base.levels, lattice, moves)


def _lattice(base: Base, spacing: float) -> Int[np.ndarray, "n 3"]:
    """Control points on the lattice, each axis as it fits the others best."""
    return rounded(base.fit, spacing, 0.0).reshape(3, -1).T.copy()


def prepared(target: Target, coarse: Mesh, levels: int) -> Base:
    """A coarse mesh with its control points fitted to the target, subdivided so many times."""
    faces, shape, taken, _ = write_faces(coarse.faces, coarse.n_vertices)
    steps, n, positions = refinements(shape.faces, len(taken), levels), len(taken), coarse.vertices[taken]
    even = evenness(shape.faces, n)
    rough = fit_points(target, Surface.of(steps[:ROUGH_LEVELS], shape.faces, n), even, positions, POINT_ROUNDS)
    positions = positions + rough.least.reshape(3, -1).T
    fit = fit_points(target, Surface.of(steps, shape.faces, n), even, positions, FINE_ROUNDS)
    origin = (positions + fit.least.reshape(3, -1).T).min(axis=0).astype(np.float32).astype(np.float64)
    return Base(faces, shape, steps, origin, fit.around((positions - origin).T.ravel()))
