"""Kernels of the spokes-and-rims energy, cell by cell.

Around cell v the covariance is ``S_v = sum_j z_vj (U_j - U_v)^T`` over its neighbours j, where z_vj collects what the faces
with v and j say about j at rest: of ``sum_k c_tk e_k e'_k^T``, the part of corner j. The same z_vj, turned by the cell's
rotation, is what the cell adds to the right-hand side of j (a third of it: each face averages three rotations), so one pass
over the cells gathers positions, fits a block of rotations and scatters residuals. Nothing is stored per face.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, UInt32

from morphlet.numerics.compiled import OPTIONS, kernel, njit
from morphlet.numerics.rotations import BLOCK, LAMBDA, WORK, R, S, fit_block

contracted_kernel = njit(**OPTIONS, no_cpython_wrapper=True, forceinline=True, fastmath={"contract", "nsz"})
"""Kernels called by kernels, once per cell: a call with a dozen arrays would cost as much as the work."""


class Stars(NamedTuple):
    """The neighbours of each cell, one after the other; unsigned indices need no wrap-around check."""

    starts: UInt32[np.ndarray, "c+1"]
    nodes: UInt32[np.ndarray, "s"]
    rest: Float[np.ndarray, "s 3"]  # z_vj
    weight: Float[np.ndarray, "s"]  # w_vj, zero on edges without an unknown end


def stars(
    faces: Int[np.ndarray, "m 3"], rest: Float[np.ndarray, "p 3"], cotangents: Float[np.ndarray, "m 3"], n_cells: int, n_unknowns: int
) -> Stars:
    """The stars of the first `n_cells` vertices."""
    starts, nodes, pull, weight = _stars(faces, rest, cotangents, n_cells, n_unknowns)
    return Stars(starts, nodes[: starts[-1]].copy(), pull[: starts[-1]].copy(), weight[: starts[-1]].copy())


def renumbered(before: Stars, chosen: Int[np.ndarray, "p"], place: Int[np.ndarray, "p"]) -> Stars:
    """The same stars with the vertices in another order: `chosen` of them one after the other, the inverse `place`."""
    cells = chosen[: len(before.starts) - 1]
    counts = np.diff(before.starts)[cells]
    starts = np.concatenate([np.zeros(1, np.uint32), np.cumsum(counts, dtype=np.uint32)])
    entry = np.arange(starts[-1]) + np.repeat(before.starts[cells].astype(np.int64) - starts[:-1], counts)
    return Stars(starts, place.astype(np.uint32)[before.nodes[entry]], np.take(before.rest, entry, axis=0), before.weight[entry])


def sweep(around: Stars, positions: Float[np.ndarray, "p 3"], residual: Float[np.ndarray, "p 3"]) -> float:
    """Fit every cell's rotation and write the residual ``sum_t M_t y_t - L U`` of each unknown; the energy but for a constant.

    Rows of vertices that are no unknowns hold nothing of use.
    """
    return float(_sweep(around, positions, residual))


def turned(
    around: Stars, positions: Float[np.ndarray, "p 3"], rotations: Float[np.ndarray, "c 9"], residual: Float[np.ndarray, "p 3"]
) -> None:
    """Write the residual of each unknown for given rotations of the cells."""
    _turned(around, positions, rotations, residual)


def laplacian_pull(around: Stars, values: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
    """-L times the values on the unknowns: the residual where nothing has a shape to keep."""
    residual = np.empty_like(values)
    _turned(around, values, np.zeros((len(around.starts) - 1, 9)), residual)
    return residual


def reached(around: Stars, held: Bool[np.ndarray, "p"], n_unknowns: int) -> Bool[np.ndarray, "p"]:
    """Whether each vertex is held or joined, through unknowns, to one that is."""
    found = held.copy()
    _reach(around, found, n_unknowns)
    return found


@kernel
def _reach(around, found, n_unknowns):  # type: ignore[no-untyped-def]
    """Stars, (p,) held vertices -> with all that chains of unknowns join to them."""
    stack, top = np.empty(n_unknowns, np.int64), 0
    for v in range(n_unknowns):
        q, end = around.starts[v], around.starts[v + 1]
        while not found[v] and q < end:
            found[v] = found[around.nodes[q]]
            q += np.uint32(1)
        if found[v]:
            stack[top] = v
            top += 1
    while top > 0:
        top -= 1
        for q in range(around.starts[stack[top]], around.starts[stack[top] + 1]):
            j = np.int64(around.nodes[q])
            if j < n_unknowns and not found[j]:
                found[j] = True
                stack[top] = j
                top += 1


@kernel
def _stars(faces, rest, cotangents, n_cells, n_unknowns):  # type: ignore[no-untyped-def]
    """Starts, and neighbours, rest parts and weights in arrays that are too long."""
    corner_start = np.zeros(len(rest) + 1, np.int64)
    for t in range(len(faces)):
        for k in range(3):
            corner_start[faces[t, k] + 1] += 1
    for v in range(len(rest)):
        corner_start[v + 1] += corner_start[v]
    corners, filled = np.empty(3 * len(faces), np.int64), corner_start[:-1].copy()
    for t in range(len(faces)):
        for k in range(3):
            corners[filled[faces[t, k]]] = 3 * t + k
            filled[faces[t, k]] += 1
    room = 2 * corner_start[n_cells]
    starts, nodes = np.zeros(n_cells + 1, np.uint32), np.empty(room, np.uint32)
    pull, weight = np.zeros((room, 3)), np.zeros(room)
    end = 0
    for v in range(n_cells):
        begin = end
        for q in range(corner_start[v], corner_start[v + 1]):
            t = corners[q] // 3
            k = corners[q] - 3 * t
            a, b = k + 1 if k < 2 else 0, k - 1 if k > 0 else 2
            for _ in range(2):
                j, at = faces[t, a], begin
                while at < end and nodes[at] != j:
                    at += 1
                if at == end:
                    nodes[at] = j
                    end += 1
                if v < n_unknowns or j < n_unknowns:
                    weight[at] += cotangents[t, b]
                for x in range(3):
                    to_v, to_b = rest[j, x] - rest[v, x], rest[j, x] - rest[faces[t, b], x]
                    pull[at, x] += cotangents[t, b] * to_v + cotangents[t, k] * to_b
                a, b = b, a
        starts[v + 1] = end
    return starts, nodes, pull, weight


@kernel
def _sweep(around, positions, residual):  # type: ignore[no-untyped-def]
    """Stars, (p, 3) positions -> (p, 3) residual; the energy but for a constant."""
    residual[:] = 0.0
    work, n_cells, energy = np.zeros(WORK), len(around.starts) - 1, 0.0
    for begin in range(0, n_cells, BLOCK):
        count = min(BLOCK, n_cells - begin)
        for i in range(np.uintp(count)):
            energy += gather(around, positions, residual, np.uintp(begin) + i, work, i)
        fit_block(work, count)
        for i in range(np.uintp(count)):
            scatter(around, residual, np.uintp(begin) + i, work, i)
            energy -= 2.0 / 3.0 * work[np.uintp(LAMBDA) + i]
    return energy


@kernel
def _turned(around, positions, rotations, residual):  # type: ignore[no-untyped-def]
    """Stars, (p, 3) positions, (c, 9) rotations -> (p, 3) residual."""
    residual[:] = 0.0
    work, block = np.zeros(WORK), np.uintp(BLOCK)
    for v in range(np.uintp(len(around.starts) - 1)):
        gather(around, positions, residual, v, work, np.uintp(0))
        for k in range(np.uintp(9)):
            work[np.uintp(R) + k * block] = rotations[v, k]
        scatter(around, residual, v, work, np.uintp(0))


@contracted_kernel
def gather(around, positions, residual, v, work, i):  # type: ignore[no-untyped-def]
    """Covariance of cell v into place i of the work space, -L U into its residual; its half of the edges' energy."""
    x, y, z = positions[v, 0], positions[v, 1], positions[v, 2]
    s00 = s01 = s02 = s10 = s11 = s12 = s20 = s21 = s22 = 0.0
    r0 = r1 = r2 = energy = 0.0
    for q in range(np.uintp(around.starts[v]), np.uintp(around.starts[v + np.uintp(1)])):
        j, w = np.uintp(around.nodes[q]), around.weight[q]
        d0, d1, d2 = positions[j, 0] - x, positions[j, 1] - y, positions[j, 2] - z
        a0, a1, a2 = around.rest[q, 0], around.rest[q, 1], around.rest[q, 2]
        s00, s01, s02 = s00 + a0 * d0, s01 + a0 * d1, s02 + a0 * d2
        s10, s11, s12 = s10 + a1 * d0, s11 + a1 * d1, s12 + a1 * d2
        s20, s21, s22 = s20 + a2 * d0, s21 + a2 * d1, s22 + a2 * d2
        r0, r1, r2 = r0 + w * d0, r1 + w * d1, r2 + w * d2
        energy += w * (d0 * d0 + d1 * d1 + d2 * d2)
    residual[v, 0] += r0
    residual[v, 1] += r1
    residual[v, 2] += r2
    at, block = np.uintp(S) + i, np.uintp(BLOCK)
    for value in (s00, s01, s02, s10, s11, s12, s20, s21, s22):
        work[at] = value
        at += block
    return 0.5 * energy


@contracted_kernel
def scatter(around, residual, v, work, i):  # type: ignore[no-untyped-def]
    """Add a third of the turned rest parts of cell v to its neighbours' residuals, and take their sum from its own."""
    at, b = np.uintp(R) + i, np.uintp(BLOCK)
    m00, m01, m02 = work[at] / 3.0, work[at + b] / 3.0, work[at + b * np.uintp(2)] / 3.0
    m10, m11, m12 = work[at + b * np.uintp(3)] / 3.0, work[at + b * np.uintp(4)] / 3.0, work[at + b * np.uintp(5)] / 3.0
    m20, m21, m22 = work[at + b * np.uintp(6)] / 3.0, work[at + b * np.uintp(7)] / 3.0, work[at + b * np.uintp(8)] / 3.0
    t0 = t1 = t2 = 0.0
    for q in range(np.uintp(around.starts[v]), np.uintp(around.starts[v + np.uintp(1)])):
        j = np.uintp(around.nodes[q])
        a0, a1, a2 = around.rest[q, 0], around.rest[q, 1], around.rest[q, 2]
        g0, g1, g2 = m00 * a0 + m01 * a1 + m02 * a2, m10 * a0 + m11 * a1 + m12 * a2, m20 * a0 + m21 * a1 + m22 * a2
        residual[j, 0] += g0
        residual[j, 1] += g1
        residual[j, 2] += g2
        t0, t1, t2 = t0 + g0, t1 + g1, t2 + g2
    residual[v, 0] -= t0
    residual[v, 1] -= t1
    residual[v, 2] -= t2
