"""Anderson acceleration of a fixed-point iteration: the next point from the last few steps, not from the last alone.

Of a map x -> g(x) with steps d = g(x) - x, the affine combination of the last points g is taken whose combined step is
shortest (Walker & Ni 2011). Whether that point is any good is for the caller to find out, who then forgets the steps and goes
on from the last g.
"""

import numpy as np
from jaxtyping import Float

from morphlet.numerics.compiled import OPTIONS, inner_kernel, njit

REGULAR = 1e-10
"""Added to the diagonal of the normal equations, relative to it; a pivot below it belongs to a step that repeats others, which
then has no share."""

CANCELLED = 1e-13
"""Squared difference of two steps, relative to their squares, that may be rounding of their products."""

sum_kernel = njit(**OPTIONS, fastmath={"reassoc", "contract", "nsz"})
"""Kernels of long sums, in vector registers."""


class Anderson:
    """The last few steps of one iteration: the working state of one call.

    Parameters
    ----------
    window
        How many past steps to combine with the last; 0 leaves the iteration plain.

    Notes
    -----
    O(window) passes over the points.

    References
    ----------
    Walker and Ni, Anderson acceleration for fixed-point iterations, SIAM J. Numer. Anal. 49, 2011.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.anderson import Anderson
    >>> faster, x = Anderson(1), np.array([1.0])
    >>> for _ in range(2):
    ...     x = faster.next(x, 0.9 * x + 1.0 - x)
    >>> x.round(6).tolist()
    [10.0]
    """

    def __init__(self, window: int) -> None:
        self._products = np.zeros((window + 1, window + 1))
        self._past = np.zeros((2, window + 1, 0))
        self._count = 0

    def forget(self) -> None:
        """Start anew."""
        self._count = 0

    def next(self, x: Float[np.ndarray, "*n"], step: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Where to go from x, whose plain successor is x + step."""
        window = len(self._products)
        if self._past.shape[2] != x.size:
            self._past = np.zeros((2, window, x.size))
        known, last = min(self._count + 1, window), self._count % window
        self._count += 1
        out = np.empty(x.size)
        _advance(x.ravel(), step.ravel(), self._past, self._products, (known, last), out)
        return out.reshape(x.shape)


@sum_kernel
def _advance(x, step, past, products, count, out):  # type: ignore[no-untyped-def]
    """Remember step (n,) and x + step in row `last` of past (2, w, n) and its products (w, w) with the others; the next point (n,)."""
    steps, points = past[0], past[1]
    known, last = count
    for i in range(len(x)):
        steps[last, i] = step[i]
        points[last, i] = x[i] + step[i]
    for k in range(known):
        total = 0.0
        for i in range(len(x)):
            total += steps[k, i] * step[i]
        products[k, last] = products[last, k] = total
    share = _shortest(products, known, last)
    for i in range(len(out)):
        out[i] = share[last] * points[last, i]
    for k in range(len(share)):
        if k != last and share[k] != 0.0:
            for i in range(len(out)):
                out[i] += share[k] * points[k, i]


@inner_kernel
def _shortest(products, n, last):  # type: ignore[no-untyped-def]
    """Shares (n,), of sum 1, of the first n steps, whose products are given, for the shortest combination: Gaussian elimination."""
    normal, share, least = np.empty((n, n)), np.empty(n), np.empty(n)
    for i in range(n):
        share[i] = products[last, last] - products[last, i]
        for j in range(n):
            normal[i, j] = products[i, j] - products[i, last] - products[last, j] + products[last, last]
        least[i] = max(4.0 * REGULAR * normal[i, i], CANCELLED * (products[i, i] + products[last, last]))
        normal[i, i] *= 1.0 + REGULAR
    for p in range(n):
        if p != last and normal[p, p] > least[p]:
            for i in range(p + 1, n):
                factor = normal[i, p] / normal[p, p]
                share[i] -= factor * share[p]
                for j in range(p + 1, n):
                    normal[i, j] -= factor * normal[p, j]
    share[last], own = 0.0, 1.0
    for p in range(n - 1, -1, -1):
        if p != last and normal[p, p] > least[p]:
            for j in range(p + 1, n):
                share[p] -= normal[p, j] * share[j]
            share[p] /= normal[p, p]
            own -= share[p]
        else:
            share[p] = 0.0
    share[last] = own
    return share
