"""A factored matrix that becomes stiffer in a few unknowns: what its solves then leave out.

With A = L L', more stiffness D in the unknowns E makes ``(A + E D E')^-1 = L^-T (I - Q Q') L^-1``: V = L^-1 E, its
products M = D^-1 + V' V, and Q = V R^-1 with R' R = M. Infinite stiffness holds an unknown at 0. V lives in the rows on the
ways from these unknowns to the root of the elimination tree, a few hundred of tens of thousands. Arrays only, checked by `linalg`.
"""

import numpy as np
from jaxtyping import Float, Int

from morphlet.numerics.compiled import kernel
from morphlet.numerics.elimination import Tree, from_counts
from morphlet.numerics.supernodal import NOTHING, WIDTH, Projection, forward, padded, subtract, triangulate

SHARE = 0.3
"""Entries of the projection, relative to those of the factor, beyond which a new factorization pays off."""

LEAST = 1e-6
"""Part of a column of V, squared, that the columns before may leave of it: with less, digits are lost that the solution needs. A third
is left by 200 neighbours on a surface, 3 % with bending; less than this where the factor's own unknowns were hardly held."""


def projection(
    tree: Tree, panels: Float[np.ndarray, "p"], unknowns: Int[np.ndarray, "k"], stiffness: Float[np.ndarray, "k"]
) -> Projection | None:
    """For unknowns in elimination order, the last first; None where it would be too large, or not precise."""
    if len(unknowns) == 0:
        return NOTHING
    owners = np.searchsorted(tree.first, unknowns, side="right") - 1
    chosen = _ways(tree, owners)
    branch, rows = _branch(tree, chosen)
    if len(rows) * len(unknowns) > SHARE * len(panels):
        return None
    halves = np.zeros((len(unknowns), len(rows)))
    halves[np.arange(len(unknowns)), np.searchsorted(rows, unknowns)] = 1.0
    forward(branch, panels, np.searchsorted(chosen, owners), halves)
    basis = np.empty((len(unknowns), len(unknowns) + len(rows)))
    left = _orthogonalise(np.ascontiguousarray(halves.T), 1.0 / stiffness, basis.ravel())
    return _upwards(rows, basis[::-1, len(unknowns) :]) if left > LEAST else None


def _ways(tree: Tree, owners: Int[np.ndarray, "k"]) -> Int[np.ndarray, "s"]:
    """The supernodes on the ways to the root, ascending."""
    met = np.zeros(len(tree.first) - 1, bool)
    for owner in owners.tolist():
        s = owner
        while s >= 0 and not met[s]:
            met[s] = True
            begin = int(tree.row_start[s])
            s = int(np.searchsorted(tree.first, tree.rows[begin], side="right")) - 1 if tree.row_start[s + 1] > begin else -1
    return np.flatnonzero(met)


def _branch(tree: Tree, chosen: Int[np.ndarray, "s"]) -> tuple[Tree, Int[np.ndarray, "m"]]:
    """The tree of these supernodes alone, whose panels are where they were; and the rows that are theirs."""
    columns, below = np.diff(tree.first)[chosen], np.diff(tree.row_start)[chosen]
    rows = _ranges(tree.first[chosen], columns)
    parts = np.searchsorted(rows, tree.rows[_ranges(tree.row_start[chosen], below)])
    return tree._replace(first=from_counts(columns), row_start=from_counts(below), rows=parts, panel=tree.panel[chosen]), rows


def _ranges(begin: Int[np.ndarray, "s"], counts: Int[np.ndarray, "s"]) -> Int[np.ndarray, "r"]:
    """So many numbers from each beginning on, one after the other."""
    return np.repeat(begin - from_counts(counts)[:-1], counts) + np.arange(counts.sum())


def _upwards(rows: Int[np.ndarray, "m"], basis: Float[np.ndarray, "k m"]) -> Projection:
    """With its copy in single precision."""
    single = np.zeros((len(basis), int(padded(np.array([len(rows)]))[0])), np.float32)
    single[:, : len(rows)] = basis
    return Projection(rows, np.ascontiguousarray(basis), single.ravel())


@kernel
def _orthogonalise(halves, compliance, panel):  # type: ignore[no-untyped-def]
    """From V (m, k) and the diagonal of D^-1: write the panel of k columns [R'; Q]; the least share of M's diagonal left as a pivot."""
    m, k = halves.shape
    source, f = halves.ravel(), k + m
    for j in range(k):
        at = j * f
        for i in range(k):
            panel[at + i] = 0.0
        for i in range(m):
            panel[at + k + i] = source[i * k + j]
        for row in range(0, m, WIDTH):
            subtract(source, row * k + j, (k, min(WIDTH, m - row)), panel, (at + j, k - j))
        for i in range(j, k):
            panel[at + i] = -panel[at + i]
        panel[at + j] += compliance[j]
    if triangulate(panel, np.int64(0), k, f) >= 0:  # a literal would compile it once more
        return 0.0
    least = 1.0
    for j in range(k):
        whole = 0.0
        for i in range(j + 1):
            whole += panel[i * f + j] ** 2
        least = min(least, panel[j * f + j] ** 2 / whole)
    return least
