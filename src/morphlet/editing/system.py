"""The linear system of a patch, ``(L + Lambda) d = r`` on its unknowns: factored once, solved for any residual.

L is the cotangent Laplacian restricted to the unknowns, Lambda the stiffness with which soft handle vertices are held. Some
unknowns may be pinned, as if held infinitely stiffly. A handle that holds more than the one that was factored needs no new
factor; any other handle of these unknowns one numeric factorization: rows of pinned unknowns become identity, which keeps the pattern.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from morphlet.editing.kernels import reached
from morphlet.editing.patch import Patch, layers, patch, reordered, unknown_vertices
from morphlet.editing.roi import Roi
from morphlet.errors import MeshError
from morphlet.numerics import threads
from morphlet.numerics.linalg import Analysis, Factor, Solver, analyse

FEW = 3000
"""Unknowns below which one thread factors: to start others takes half a millisecond, a factorization of 1,300 a fifth of one."""


@dataclass(frozen=True, eq=False)
class System:
    """The patch of an edit, its system and where the handle is in them.

    Parameters
    ----------
    roi
        What is pulled, and what follows.
    patch
        Its patch; unknowns are in elimination order.
    order
        Place of each unknown in the analysis.
    analysis, lower
        The analysed pattern, and the entries of L's lower triangle on it.
    factor, rough
        Of the matrix for this handle; and its solver for corrections, of single precision.
    grip
        Where the handle is in the patch.
    base
        The last factorization, which `factor` may be made from.
    """

    roi: Roi
    patch: Patch
    order: Int[np.ndarray, "u"]
    analysis: Analysis
    lower: "Triangle"
    factor: Factor
    rough: Solver
    grip: "Grip"
    base: "Base"

    def correct(self, residual: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "u 3"]:
        """`solve` in single precision: for an iteration that measures what is left. Even faces that are nearly flat, with weights
        of 5e7, leave it a hundred times more than enough."""
        right = residual[: self.patch.n_unknowns]
        right[self.grip.pinned] = 0.0
        answer = self.rough(right)
        answer[self.grip.pinned] = 0.0  # a stiffened factor leaves rounding there
        return answer

    def solve(self, residual: Float[np.ndarray, "p k"]) -> Float[np.ndarray, "u k"]:
        """Displacement of the unknowns for a residual, whose further rows do not count."""
        right = np.empty((self.patch.n_unknowns, residual.shape[1]))
        right[self.order] = residual[: self.patch.n_unknowns]
        right[self.order[self.grip.pinned]] = 0.0
        answer = self.factor.answer(right)[self.order] if len(right) else right
        answer[self.grip.pinned] = 0.0
        return answer


class Triangle(NamedTuple):
    """A lower triangle, column by column: diagonal entry first, rows ascending."""

    indptr: Int[np.ndarray, "u+1"]
    indices: Int[np.ndarray, "z"]
    data: Float[np.ndarray, "z"]


@dataclass(frozen=True, eq=False)
class Base:
    """A factorization that others may be made from.

    Parameters
    ----------
    factor
        Of a matrix.
    stiffness
        What each of its unknowns is held with, in the matrix's numbering: infinite where it is pinned.
    """

    factor: Factor
    stiffness: Float[np.ndarray, "u"]

    def held(self, stiffness: Float[np.ndarray, "u"]) -> Factor | None:
        """The factor with the unknowns held so; None where one is held less than here, or too many more."""
        more = np.flatnonzero(stiffness > self.stiffness)
        if np.any(stiffness < self.stiffness):
            return None
        return self.factor.stiffened(more, stiffness[more] - self.stiffness[more]) if len(more) else self.factor


@dataclass(frozen=True, eq=False)
class Grip:
    """Where the handle and the answer are in a patch.

    Parameters
    ----------
    held, held_index
        Vertices of the patch held exactly, and which of the handle vertices each is.
    soft, soft_index, stiffness
        Unknowns held softly, which handle vertices they are, and how stiffly.
    pinned
        Unknowns that are held exactly.
    own, own_place
        Unknowns that are not pinned, and their rows among `Roi.moving`.
    handle_place
        Row of each handle vertex among `Roi.moving`.
    """

    held: Int[np.ndarray, "a"]
    held_index: Int[np.ndarray, "a"]
    soft: Int[np.ndarray, "b"]
    soft_index: Int[np.ndarray, "b"]
    stiffness: Float[np.ndarray, "b"]
    pinned: Int[np.ndarray, "c"]
    own: Int[np.ndarray, "d"]
    own_place: Int[np.ndarray, "d"]
    handle_place: Int[np.ndarray, "h"]

    def hold(self, order: Int[np.ndarray, "u"]) -> Float[np.ndarray, "u"]:
        """How stiffly each unknown is held, infinitely where it is pinned, in the matrix's numbering."""
        stiffness = np.zeros(len(order))
        stiffness[order[self.soft]] = self.stiffness
        stiffness[order[self.pinned]] = np.inf
        return stiffness

    def begin(self, rest: Float[np.ndarray, "p 3"], targets: Float[np.ndarray, "h 3"]) -> Float[np.ndarray, "p 3"]:
        """The patch at rest, its handle at the targets."""
        positions = rest.copy()
        positions[self.held] = targets[self.held_index]
        return positions

    def pull(self, positions: Float[np.ndarray, "p 3"], targets: Float[np.ndarray, "h 3"], residual: Float[np.ndarray, "p 3"]) -> float:
        """Add the pull of the soft handle vertices to the residual; their energy."""
        if len(self.soft) == 0:
            return 0.0
        apart = targets[self.soft_index] - positions[self.soft]
        residual[self.soft] += self.stiffness[:, None] * apart
        return float(np.einsum("b,bd,bd->", self.stiffness, apart, apart))

    def answer(self, positions: Float[np.ndarray, "p 3"], targets: Float[np.ndarray, "h 3"]) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`."""
        out = np.empty((len(self.handle_place) + len(self.own) - len(self.soft), 3))
        out[self.handle_place] = targets
        out[self.own_place] = positions[self.own]
        return out


def system(roi: Roi, least: float = -np.inf) -> System:
    """Everything that does not depend on where the handle goes; cotangents (halved) below `least` are raised to it.

    Raises
    ------
    MeshError
        If a piece of the free vertices touches neither the handle nor an anchor, so that nothing says where it belongs; or if
        all faces of a free vertex are single points.
    """
    among = layers(roi.mesh, unknown_vertices(roi))
    first = patch(roi.mesh, among, least)
    lower = _lower(first)
    analysis = analyse(lower.indptr, lower.indices)  # breadth-first cuts alone: found a fifth faster, for 3 % more fill
    whole = reordered(first, analysis.order)
    nothing = Factor(0, 0, np.array)
    known = System(roi, whole, analysis.order, analysis, lower, nothing, np.array, _grip(roi, whole), Base(nothing, np.zeros(0)))
    _check_pieces(known)
    return _factored(known)


def regripped(before: System, roi: Roi) -> System | None:
    """The same patch with another handle, for the price of a numeric factorization at most; None if an unknown is not one of its own."""
    outside = np.ones(roi.mesh.n_vertices, bool)
    outside[before.patch.vertices[: before.patch.n_unknowns]] = False
    if roi.mesh is not before.roi.mesh or np.any(outside & unknown_vertices(roi)):
        return None
    known = replace(before, roi=roi, grip=_grip(roi, before.patch))
    hold = known.grip.hold(known.order)
    if np.any(hold < before.grip.hold(known.order)):
        _check_pieces(known)  # who is held no less is not loose
    factor = known.base.held(hold)
    return _factored(known) if factor is None else replace(known, factor=factor, rough=factor.rough())


def _lower(first: Patch) -> "Triangle":
    """Entries of the Laplacian between unknowns, lower triangle: those that each star has with earlier ones."""
    n, star = first.n_unknowns, first.stars
    end = star.starts[n]
    row, column = np.repeat(np.arange(n), np.diff(star.starts[: n + 1])), star.nodes[:end].astype(np.int64)
    kept = np.flatnonzero(column < row)
    columns, rows = np.concatenate([np.arange(n), column[kept]]), np.concatenate([np.arange(n), row[kept]])
    by_column = np.argsort(columns, kind="stable")
    starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(np.bincount(columns, minlength=n))])
    return Triangle(starts, rows[by_column], np.concatenate([first.stiffness, -star.weight[kept]])[by_column])


def _grip(roi: Roi, whole: Patch) -> Grip:
    """Where the handle of this region is in the patch."""
    index = np.full(roi.mesh.n_vertices, -1, np.int64)
    index[roi.handle] = np.arange(len(roi.handle))
    pulled, unknown = index[whole.vertices], unknown_vertices(roi)[whole.vertices]
    unknown[whole.n_unknowns :] = False
    place = np.empty(roi.mesh.n_vertices, np.int64)
    place[roi.moving] = np.arange(len(roi.moving))
    held, soft, own = (np.nonzero(mask)[0] for mask in ((pulled >= 0) & ~unknown, (pulled >= 0) & unknown, unknown))
    weight = np.zeros(0) if roi.weight is None else roi.weight[pulled[soft]]
    return Grip(
        held=held,
        held_index=pulled[held],
        soft=soft,
        soft_index=pulled[soft],
        stiffness=weight * whole.stiffness[soft] if len(soft) else weight,
        pinned=np.nonzero(~unknown[: whole.n_unknowns])[0],
        own=own,
        own_place=place[whole.vertices[own]],
        handle_place=place[roi.handle],
    )


def _factored(known: System) -> System:
    """With its numeric factor: soft stiffness on the diagonal, identity where an unknown is pinned."""
    lower, grip, n = known.lower, known.grip, known.patch.n_unknowns
    values, diagonal = lower.data.copy(), lower.indptr[:-1]
    values[diagonal[known.order[grip.soft]]] += grip.stiffness
    pinned = np.zeros(n, bool)
    pinned[known.order[grip.pinned]] = True
    if len(grip.pinned):
        values[np.repeat(pinned, np.diff(lower.indptr)) | pinned[lower.indices]] = 0.0
        values[diagonal[pinned]] = 1.0
    with threads.limited(1 if n < FEW else None):
        factor = known.analysis.factor(values)
    return replace(known, factor=factor, rough=factor.rough(), base=Base(factor, grip.hold(known.order)))


def _check_pieces(known: System) -> None:
    """Refuse unknowns that nothing holds."""
    whole, grip = known.patch, known.grip
    held = np.ones(len(whole.vertices), bool)
    held[grip.own] = False
    held[grip.soft[grip.stiffness > 0]] = True
    loose = np.sort(whole.vertices[~reached(whole.stars, held, whole.n_unknowns)])
    if len(loose):
        raise MeshError(
            "free vertices that are joined to the handle or to anchors",
            f"{len(loose)} that are not",
            "take them out of the free vertices, or pull or anchor one of each piece",
            loose,
        )
    bare = np.sort(whole.vertices[grip.own[whole.stiffness[grip.own] <= 0]])
    if len(bare):
        raise MeshError("free vertices in faces of some size", f"{len(bare)} in single points only", "try repair(mesh)", bare)
