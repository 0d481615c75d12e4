"""Exact signs of determinants of three vectors.

A floating-point filter settles nearly all; the rest is decided in exact rational arithmetic (doubles are dyadic numbers).
Filter and exact branch use the same raw determinant.
"""

from fractions import Fraction

import numpy as np
from jaxtyping import Float, Int

FILTER = 8e-16
"""Relative error bound of the raw determinant: 7 roundings of 2^-53 on the sum of absolute products."""
UNDERFLOW = float(np.finfo(float).tiny)
"""Absolute error bound of one product that underflows, with room to spare."""


def determinant_signs(
    a: Float[np.ndarray, "m 3"], b: Float[np.ndarray, "m 3"], c: Float[np.ndarray, "m 3"]
) -> tuple[Int[np.ndarray, "m"], int]:
    """Sign (-1, 0, 1) of det(a, b, c) row by row, and how many rows needed the exact branch.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.predicates import determinant_signs
    >>> e = np.eye(3)
    >>> determinant_signs(e[[0, 0]], e[[1, 1]], np.stack([e[2], e[0] + e[1]]))
    (array([1, 0]), 1)
    """
    total, bound = np.zeros(len(a)), UNDERFLOW * (1 + np.abs(a).sum(axis=1))
    with np.errstate(over="ignore", under="ignore", invalid="ignore"):  # what is not finite fails the filter
        for i in range(3):
            j, k = (i + 1) % 3, (i + 2) % 3
            plus, minus = b[:, j] * c[:, k], b[:, k] * c[:, j]
            total += a[:, i] * (plus - minus)
            bound += FILTER * np.abs(a[:, i]) * (np.abs(plus) + np.abs(minus))
    signs = (total > 0).astype(np.int64) - (total < 0)
    uncertain = np.nonzero(~(np.abs(total) > bound))[0]
    for row in uncertain:
        signs[row] = _exact_sign(a[row], b[row], c[row])
    return signs, len(uncertain)


def _exact_sign(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"], c: Float[np.ndarray, "3"]) -> int:
    x, y, z = ([Fraction(float(v)) for v in row] for row in (a, b, c))
    total = sum(x[i] * (y[(i + 1) % 3] * z[(i + 2) % 3] - y[(i + 2) % 3] * z[(i + 1) % 3]) for i in range(3))
    return (total > 0) - (total < 0)
