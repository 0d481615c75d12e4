"""Smoothed rotations: cells that turn like their neighbours bend more softly and fold less.

To the energy comes ``alpha A sum_i sum_j |R_i - R_j|^2`` over neighbours, A the area of the mesh. Given the neighbours' rotations, a
cell's best one is that of the covariance ``S_i + 6 alpha A sum_j R_j^T``. Cells are visited colour by colour, no two of a colour
being neighbours, so that each visit lowers the energy and a block of a colour is fitted at once. Around the cells, anchors
keep the identity, and handle vertices the rotation of their piece.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.editing.kernels import Stars, gather, scatter
from morphlet.numerics.compiled import kernel
from morphlet.numerics.rotations import BLOCK, LAMBDA, WORK, R, S, fit_block

PASSES = 4
"""Over the cells, per solve: rotations settle far more slowly than positions. On a twisted bar with alpha 0.002, 10 iterations instead
of 40 come within 0.3 % of the least energy, in three quarters of the time; more passes cost as much as they save."""


@dataclass(eq=False)
class SmoothedSweep:
    """Some passes over the cells with smoothed rotations; remembers the rotations of the last accepted positions.

    Parameters
    ----------
    stars
        The cells.
    visits
        The cells sorted by colour, and where each colour starts.
    stiffness
        alpha A.
    rotations
        Of all vertices of the patch, accepted.
    tried
        Those of the last call.
    gain
        By how much the last pass lowered the energy: what is small where the rotations have settled.
    """

    stars: Stars
    visits: tuple[Int[np.ndarray, "c"], Int[np.ndarray, "k"]]
    stiffness: float
    rotations: Float[np.ndarray, "p 9"]
    tried: Float[np.ndarray, "p 9"] | None = None
    gain: float = 0.0

    def __call__(self, positions: Float[np.ndarray, "p 3"], residual: Float[np.ndarray, "p 3"]) -> float:
        """Write the residual of each unknown; the energy but for a constant."""
        self.tried = self.rotations.copy()
        energy, self.gain = _smoothed(self.stars, self.visits, positions, self.tried, self.stiffness, residual)
        return float(energy)

    def accept(self) -> None:
        """Go on from the rotations last tried."""
        if self.tried is not None:
            self.rotations = self.tried


def coloured(stars: Stars, n_vertices: int) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "k"]]:
    """The cells sorted by colour, and where each colour starts and the last ends; neighbours differ in colour."""
    colour = _colours(stars, n_vertices)
    return np.argsort(colour, kind="stable"), np.concatenate([[0], np.cumsum(np.bincount(colour))])


@kernel
def _colours(stars, n_vertices):  # type: ignore[no-untyped-def]
    """The least colour (c,) that no neighbour before has."""
    n_cells = len(stars.starts) - 1
    colour, taken = np.full(n_vertices, -1), np.full(n_vertices + 1, -1)
    for v in range(n_cells):
        for q in range(stars.starts[v], stars.starts[v + 1]):
            if colour[stars.nodes[q]] >= 0:
                taken[colour[stars.nodes[q]]] = v
        c = 0
        while taken[c] == v:
            c += 1
        colour[v] = c
    return colour[:n_cells]


@kernel
def _smoothed(stars, visits, positions, rotations, stiffness, residual):  # type: ignore[no-untyped-def]
    """Stars, visits, (p, 3) positions, (p, 9) rotations, alpha A -> (p, 3) residual; energy but for a constant, the last pass's gain."""
    residual[:] = 0.0
    order, first = visits
    n_cells, energy, gain = len(stars.starts) - 1, 0.0, 0.0
    work, own = np.zeros(WORK), np.empty((n_cells, 9))
    for v in range(n_cells):
        energy += gather(stars, positions, residual, np.uintp(v), work, np.uintp(0))
        for k in range(9):
            own[v, k] = work[S + k * BLOCK]
    for _ in range(PASSES):
        gain = 0.0
        for colour in range(len(first) - 1):
            for begin in range(first[colour], first[colour + 1], BLOCK):
                count = min(BLOCK, first[colour + 1] - begin)
                for i in range(count):
                    v = order[begin + i]
                    for k in range(9):
                        work[S + k * BLOCK + i] = own[v, k]
                    for q in range(stars.starts[v], stars.starts[v + 1]):
                        for k in range(9):
                            work[S + k * BLOCK + i] += 6.0 * stiffness * rotations[stars.nodes[q], 3 * (k % 3) + k // 3]
                    for k in range(9):
                        gain -= 2.0 / 3.0 * rotations[v, 3 * (k % 3) + k // 3] * work[S + k * BLOCK + i]
                fit_block(work, count)
                for i in range(count):
                    gain += 2.0 / 3.0 * work[LAMBDA + i]
                    for k in range(9):
                        rotations[order[begin + i], k] = work[R + k * BLOCK + i]
    for v in range(n_cells):
        for k in range(9):
            work[R + k * BLOCK] = rotations[v, k]
            energy -= 2.0 / 3.0 * rotations[v, k] * own[v, 3 * (k % 3) + k // 3]
        scatter(stars, residual, np.uintp(v), work, np.uintp(0))
        for q in range(stars.starts[v], stars.starts[v + 1]):
            apart = 0.0
            for k in range(9):
                apart += (rotations[v, k] - rotations[stars.nodes[q], k]) ** 2
            energy += stiffness * apart * (1.0 if stars.nodes[q] < n_cells else 2.0)
    return energy, gain
