"""Weights of wavelets that overlap as numbers that do not: the R of a QR factorization, on points that a reader knows.

With the terms as columns of A on these points, A = Q R, u = R w are the coefficients of the orthonormal columns of Q. An error of
u is an error of the surface, of the same mean square, and the first terms need none of those that follow. R is found by
Cholesky's elimination of A^T A; no term is so near to those before it that this loses more than 4 digits.
"""

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from morphlet.codec.atoms import AFFINE, Atoms, Level
from morphlet.codec.container import damaged
from morphlet.numerics.compiled import kernel

REMAINDER = 1e-4
"""Share of its square that a term keeps beside those before it, or a writer leaves it out."""
BLOCK = 64
"""Terms that are eliminated at a time: their rows stay in the processor's cache."""
AT_ONCE = 4096
"""Points whose values are in memory at a time."""
DENSE = 0.1
"""Share of values that are not 0 above which they are multiplied as if none were."""
REFUSED = 1e-7
"""Share below which a reader refuses the file: far from the other, so that all machines decide alike."""


def products(atoms: Atoms, levels: Sequence[Level], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "a a"]:
    """Means over the points of the products of the terms: 1, x, y, z and the wavelets."""
    total = np.zeros((AFFINE + len(atoms), AFFINE + len(atoms)))
    for first in range(0, len(points), AT_ONCE):
        columns = terms_at(atoms, levels, points[first : first + AT_ONCE])
        if columns.nnz > DENSE * columns.shape[0] * columns.shape[1]:
            dense = columns.toarray()
            total += dense.T @ dense
        else:
            total += (columns.T @ columns).toarray()
    return total / len(points)


def terms_at(atoms: Atoms, levels: Sequence[Level], points: Float[np.ndarray, "n 3"]) -> sp.csr_matrix:
    """All terms at some points."""
    affine = np.column_stack([np.ones(len(points)), points])
    return sp.hstack([sp.csr_matrix(affine), atoms.library(levels).values(points)], format="csr")


def factor(gram: Float[np.ndarray, "a a"], least: float) -> tuple[Float[np.ndarray, "a a"], int]:
    """R, upper, of the products; and the first term that keeps less than `least` of its square, or -1."""
    upper, squares = np.array(gram, order="C"), np.array(np.diag(gram))
    for first in range(0, len(upper), BLOCK):
        last = min(first + BLOCK, len(upper))
        dependent = int(eliminate(upper, squares, first, last, least))
        if dependent >= 0:
            return upper, dependent
        rows = upper[first:last, last:]
        upper[last:, last:] -= rows.T @ rows
    return upper, -1


def weights(gram: Float[np.ndarray, "a a"], u: Float[np.ndarray, "a 3"]) -> Float[np.ndarray, "a 3"]:
    """The weights of the terms.

    Raises
    ------
    CodecError
        If a term depends on others.
    """
    upper, dependent = factor(gram, REFUSED)
    if dependent >= 0:
        raise damaged(f"a wavelet that others make up (term {dependent})")
    out = np.array(u, order="C")
    substitute(upper, out)
    return out


@kernel
def eliminate(G, squares, first, last, least):  # type: ignore[no-untyped-def]
    # Rows first .. last - 1 of R over those of the symmetric G (a, a), from which the rows before are eliminated already; squares (a,)
    # was its diagonal. The first term that is too dependent, or -1.
    for k in range(first, last):
        if not G[k, k] > least * squares[k]:
            return k
        root = np.sqrt(G[k, k])
        for j in range(k, G.shape[0]):
            G[k, j] /= root
        for i in range(k + 1, last):
            share = G[k, i]
            if share != 0.0:
                for j in range(i, G.shape[0]):
                    G[i, j] -= share * G[k, j]
    return -1


@kernel
def substitute(R, u):  # type: ignore[no-untyped-def]  # R (a, a) upper; u (a, 3) becomes the w with R w = u
    for k in range(R.shape[0] - 1, -1, -1):
        for c in range(u.shape[1]):
            rest = u[k, c]
            for j in range(k + 1, R.shape[0]):
                rest -= R[k, j] * u[j, c]
            u[k, c] = rest / R[k, k]
