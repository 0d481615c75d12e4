"""A spherical mesh as a problem of optimisation: its energy in tangent coordinates, two unknowns per vertex.

One sort of the half-edges gives twins, edges, and the pattern of the Hessian with a place for every entry of every face.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.numerics.linalg import Analysis, analyse
from morphlet.sphere import energy
from morphlet.sphere.energy import Reference
from morphlet.sphere.relax import colour_order, relax_colours, relax_range

SERIAL_BELOW = 3000
"""Vertices below which sweeps run on one thread (waking threads costs more)."""


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
        return self.assembled(*energy.derivatives(x, self.F, self.reference, self.form, self.shape, self.majorant, self.frames, project))

    def assembled(self, g: Float[np.ndarray, "m 6"], H: Float[np.ndarray, "m 21"]) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian values from those of the faces."""
        unknowns = 2 * self.F[:, [0, 0, 1, 1, 2, 2]] + np.array([0, 1, 0, 1, 0, 1])
        gradient = np.bincount(unknowns.ravel(), g.ravel(), 2 * len(self.V))
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
