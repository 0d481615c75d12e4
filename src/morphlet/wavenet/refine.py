"""Wavelets moved and widened until their network follows the samples best: variable projection [1]_.

For given centers and dilations the best weights are linear least squares, so only the centers and dilations are unknown:
they follow Levenberg-Marquardt steps with Kaufman's Jacobian. `refine_rows` moves the wavelets of a network that is there;
`interleave_rows` picks them one by one, and moves all it has after each pick, so that the next one is chosen beside wavelets
that fit.

Inside, samples lie in [0, 1], a signal has unit norm and no affine part, mothers are tabulated, and a small ridge keeps
wavelets from meeting with huge opposite weights. What comes out is measured with the mothers themselves and plain least
squares.

.. [1] G. Golub, V. Pereyra, "Separable nonlinear least squares: the variable projection method and its applications",
   Inverse Problems 19 (2003).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.numerics.compiled import inner_kernel, kernel
from morphlet.numerics.threads import each
from morphlet.wavenet.blocks import NetworkTable
from morphlet.wavenet.library import Wavelets, affine_basis, fitting, sampled
from morphlet.wavenet.mothers import Mother

RIDGE = 1e-7
"""Penalty on a squared weight, as a share of the squared norm of its wavelet on samples spread evenly: n times the dilation.
So wavelets neither meet with huge opposite weights, nor leave until only a far tail is seen, with a huge weight."""
LARGEST_SHIFT, LARGEST_WIDENING = 1.0, 0.7
"""Trust bounds of one step: a dilation for a center, a factor of 2 for a dilation."""
LEFTMOST, RIGHTMOST = -1.0, 2.0
"""Where centers may go, samples lying in [0, 1]: as far as a library has candidates. Dilations stay in [1 / n, 1]."""
FIRST_DAMPING, LEAST_DAMPING, MOST_DAMPING = 2e-4, 1e-9, 1e8
"""Of the Gauss-Newton matrix, as a share of its diagonal; 0.2 at first ends with 5 % more squared error."""
HARDER, SOFTER = 4.0, 5.0
"""Factors by which the damping rises when a step fails, and falls when one succeeds."""
MOST_FAILURES = 8
"""Failed steps in a row (damping up 65000 times) after which there is no way down."""
LEAST_DECREASE, PATIENCE = 1e-3, 3
"""Steps in a row that lower the error by less than this share end the descent; 1e-4 takes half as long again and gains 0.5 %."""
LEAST_DIAGONAL = 1e-9
"""What the damping adds at least, as a share of the mean diagonal: a wavelet beside all samples has no derivatives."""
SMALLEST = 1e-300
"""Keeps the damping positive where all derivatives are 0."""
LEAST_REMAINDER = 0.1
"""Share of a candidate's squared norm that must be left beside the wavelets so far; from 0.001 to 0.3 errors differ by
2 % at most, and the larger it is, the more candidates need no second look."""
LEAST_INDEPENDENT = 1e-12
"""Share of a wavelet's squared norm that is rounding when left beside the others."""
LEAST_SEEN = 1e-6
"""Share of a candidate's squared norm that its affine part must leave."""
ROUNDING = 1e-26
"""Share of the signal's sum of squares that is no more than rounding (an amplitude of 1e-13)."""
RANK = 1e-5
"""Singular values below this share of the largest count as 0 in the final weights: copies of a wavelet share its weight,
and one that the samples do not see has none."""
CELLS = 200
"""Cells of the tables per unit: cubic pieces are exact to 8e-10 (polywog5), which is in what is minimised, not in what comes out."""
TAIL, FAR, TAIL_SAMPLES = 1e-10, 40.0, 16001
"""A table ends where values stay below this share of the largest, at most that far out, found on so many samples."""


@dataclass(frozen=True)
class Growth:
    """How many wavelets to pick, and how long to move them.

    Parameters
    ----------
    n_wavelets
        Most picks of a signal.
    tolerance
        Mean over the samples of the squared error, summed over the outputs (Eq. 9), at which to stop earlier.
    steps
        Most steps of all wavelets after each pick.
    last_steps
        Most steps at the end.

    Raises
    ------
    InputError
        If a number is negative, or the tolerance not finite.

    Examples
    --------
    >>> from morphlet.wavenet.refine import Growth
    >>> Growth(tolerance=1e-6)
    Growth(n_wavelets=15, tolerance=1e-06, steps=6, last_steps=60)
    """

    n_wavelets: int = 15
    tolerance: float = 0.0
    steps: int = 6
    last_steps: int = 60

    def __post_init__(self) -> None:
        if min(self.n_wavelets, self.steps, self.last_steps) < 0 or not 0 <= self.tolerance < np.inf:
            raise InputError("counts >= 0 and a finite tolerance >= 0", str(self), "start from Growth()")


@dataclass(frozen=True, eq=False)
class Refined:
    """Networks after refinement.

    Parameters
    ----------
    table
        The network of each signal.
    sse
        Sum of squared errors of each, over all samples and outputs.
    traces
        The same on the way, for each signal. After `refine_rows`: before and after. After `interleave_rows`: of the affine
        part alone and after each pick, with the wavelets where they were then.
    """

    table: NetworkTable
    sse: Float[np.ndarray, "r"]
    traces: tuple[Float[np.ndarray, "_"], ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sse", _arrays.real(self.sse, "sse", (len(self.table),)))
        object.__setattr__(self, "traces", tuple(_arrays.real(trace, "traces", (None,)) for trace in self.traces))

    def __reduce__(self) -> tuple[Any, ...]:
        return Refined, (self.table, np.array(self.sse), tuple(np.array(trace) for trace in self.traces))


def refine_rows(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], start: NetworkTable, steps: int = 60) -> Refined:
    """Networks with their wavelets moved and widened until they follow the signals best.

    Parameters
    ----------
    x
        Places of the samples, in any order.
    rows
        Signals (r, n, k). The k outputs of one row share its wavelets.
    start
        A network for each row. Only its mothers, centers and dilations are used: weights are fitted anew.
    steps
        Most steps of each row.

    Returns
    -------
    Refined
        As many wavelets as at the start, of the same mothers in the same order. No error is larger than at the start with
        the best weights there; where none could be made smaller, the wavelets are those of the start. They move within
        a length of the samples' range of its ends, and have dilations from 1/n to 1 of that range.

    Raises
    ------
    InputError
        If values are not finite or beyond 1e150, shapes differ, there are not 2 different places, or steps are negative.

    Notes
    -----
    A step costs O(m n (m + k) + m^3) per row for m wavelets on n samples. Its result depends on the row alone, neither on
    the rows beside it nor on the number of threads.

    Examples
    --------
    >>> from morphlet.wavenet.blocks import NetworkTable
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> from morphlet.wavenet.refine import refine_rows
    >>> hat, x = MOTHERS["mexican_hat"], np.linspace(0, 1, 64)
    >>> start = NetworkTable((hat,), [0, 1], [0], [0.46], [0.1], [[0.0]], np.zeros((1, 2, 1)))
    >>> found = refine_rows(x, 3 * hat((x - 0.5) / 0.07)[None, :, None], start)
    >>> found.table.centers.round(4), found.table.dilations.round(4), found.table.weights.round(3)
    (array([0.5]), array([0.07]), array([[3.]]))
    """
    if steps < 0:
        raise InputError("steps >= 0", str(steps), "ask for 60")
    signals = _prepare(x, rows, start.mothers)
    if len(start) != len(signals.rows):
        raise InputError(f"a network for each of {len(signals.rows)} rows", str(len(start)), "pass one network per row")
    return _gathered(signals, each(lambda row: _refined(signals, row, _of_row(start, row), steps), len(start)))


def interleave_rows(
    x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], library: Wavelets, growth: Growth | None = None
) -> Refined:
    """Networks of a few wavelets, picked one by one from a library and all moved after each pick.

    Parameters
    ----------
    x
        Places of the samples, in any order.
    rows
        Signals (r, n, k). The k outputs of one row share its wavelets, rows share none.
    library
        Candidates, such as a `Library`. The next pick is the one with which the error becomes smallest, the wavelets so far
        staying where they are.
    growth
        How many, and how long each may move; None for `Growth()`.

    Returns
    -------
    Refined
        With fewer wavelets than asked if the error is within the tolerance, or no candidate lowers it.

    Raises
    ------
    InputError
        As for `refine_rows`.

    Notes
    -----
    15 wavelets on 256 samples take 10 to 25 ms of one core per signal, after 20 ms once per 1000 candidates. On rows of
    spherical geometry images, squared errors are 6 to 10 times smaller than those of orthogonal least squares
    (benchmarks/wavelet_rows.py).

    Examples
    --------
    >>> from morphlet.wavenet.library import dyadic_library
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> from morphlet.wavenet.refine import Growth, interleave_rows
    >>> x = np.linspace(0, 1, 128)
    >>> kink = np.abs(x - 0.4)[None, :, None]
    >>> found = interleave_rows(x, kink, dyadic_library([MOTHERS["mexican_hat"]], x), Growth(8))
    >>> found.table[0], bool(np.sqrt(found.sse[0] / 128) < 2e-4)
    (WaveletNetwork(8 wavelets, 1 outputs), True)
    """
    growth = growth or Growth()
    signals = _prepare(x, rows, library.mothers)
    pool = _pool(signals, library)
    return _gathered(signals, each(lambda row: _grown(signals, row, pool, growth), len(signals.rows)))


@dataclass(frozen=True, eq=False)
class _Placed:
    """Wavelets without weights."""

    mothers: tuple[Mother, ...]
    kinds: Int[np.ndarray, "p"]
    centers: Float[np.ndarray, "p"]
    dilations: Float[np.ndarray, "p"]


@dataclass(frozen=True, eq=False)
class _Signals:
    """Samples as they came; and sorted in [0, 1], above the two affine columns, with the tables of the mothers."""

    x: Float[np.ndarray, "n"]
    rows: Float[np.ndarray, "r n k"]
    mothers: tuple[Mother, ...]
    order: Int[np.ndarray, "n"]
    samples: Float[np.ndarray, "3 n"]
    tables: Float[np.ndarray, "l c 4"]

    def unit(self, row: int) -> tuple[Float[np.ndarray, "k n"], float]:
        """A signal in the order of the samples, without its affine part, of unit norm unless it is affine; its norm before."""
        y = self.rows[row][self.order].T
        rest = y - (y @ self.samples[1:].T) @ self.samples[1:]
        rest -= (rest @ self.samples[1:].T) @ self.samples[1:]
        size = float(np.linalg.norm(rest))
        affine = size <= np.sqrt(ROUNDING) * np.linalg.norm(y)
        return (np.zeros(y.shape), 0.0) if affine else (np.ascontiguousarray(rest / size), size)


@dataclass(frozen=True, eq=False)
class _Pool:
    """Candidates of unit norm, one after another, each from its first sample to its last; squared norms beside the affine part."""

    kinds: Int[np.ndarray, "l"]
    theta: Float[np.ndarray, "2 l"]
    values: Float[np.ndarray, "q"]
    offsets: Int[np.ndarray, "l1"]
    first: Int[np.ndarray, "l"]
    inside: Float[np.ndarray, "l"]


@dataclass(frozen=True, eq=False)
class _Row:
    """The network of one row, and its trace."""

    placed: _Placed
    weights: Float[np.ndarray, "p k"]
    affine: Float[np.ndarray, "2 k"]
    trace: Float[np.ndarray, "m1"]


def _prepare(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], mothers: tuple[Mother, ...]) -> _Signals:
    """Check, sort, scale, tabulate."""
    x, rows = fitting(x, rows)
    order = np.argsort(x, kind="stable")
    places = (x[order] - x.min()) / np.ptp(x)
    return _Signals(x, rows, mothers, order, np.vstack([places, affine_basis(places).T]), _tables(mothers))


def _tables(mothers: tuple[Mother, ...]) -> Float[np.ndarray, "l c 4"]:
    """One table per mother, filled up with zeros to the length of the longest."""
    tables = [_table(psi) for psi in mothers]
    stack = np.zeros((len(tables), max(map(len, tables), default=1), 4))
    for i, table in enumerate(tables):
        stack[i, : len(table)] = table
    return stack


def _table(psi: Mother) -> Float[np.ndarray, "c 4"]:
    """Where it begins and ends, cells per unit and their number; then the cubic on each cell, with psi and psi' at its ends."""
    t = np.linspace(-FAR, FAR, TAIL_SAMPLES)
    values = np.abs(psi(t))
    seen = t[values > TAIL * values.max()]
    low, high = (float(end if np.isfinite(end) else tail) for end, tail in zip(psi.support, (seen[0], seen[-1]), strict=True))
    cells = int(np.ceil((high - low) * CELLS))
    width, ends = (high - low) / cells, np.linspace(low, high, cells + 1)
    value = psi(ends)
    steepest = 2 * np.abs(value).max()  # where a slope is infinite, at the end of a support, the cell stays bounded
    slope = np.clip(psi.derivative(ends) * width, -steepest, steepest)
    rise, left, right = np.diff(value), slope[:-1], slope[1:]
    cubics = np.stack([value[:-1], left, 3 * rise - 2 * left - right, left + right - 2 * rise], axis=1)
    return np.vstack([[low, high, 1 / width, cells], cubics])


def _pool(signals: _Signals, library: Wavelets) -> _Pool:
    """The candidates that the samples see."""
    x = signals.samples[0]
    theta = _scaled(signals, library)
    unit = _Placed(library.mothers, library.kinds, theta[0], np.exp(theta[1]))
    values = np.ascontiguousarray(sampled(unit, x).T)
    ends = theta[0] + np.exp(theta[1]) * signals.tables[library.kinds, 0, :2].T
    first, last = np.searchsorted(x, ends[0]), np.searchsorted(x, ends[1], side="right")
    norms = np.linalg.norm(values, axis=1)
    values /= np.where(norms > 0, norms, 1)[:, None]
    inside = (values**2).sum(axis=1) - ((values @ signals.samples[1:].T) ** 2).sum(axis=1)
    kept = np.nonzero(inside > LEAST_SEEN)[0]
    places = np.arange(len(x))
    seen = (places >= first[kept, None]) & (places < last[kept, None])
    offsets = np.append(0, np.cumsum(seen.sum(axis=1)))
    return _Pool(library.kinds[kept], np.ascontiguousarray(theta[:, kept]), values[kept][seen], offsets, first[kept], inside[kept])


def _scaled(signals: _Signals, wavelets: Wavelets) -> Float[np.ndarray, "2 p"]:
    """Centers and logarithms of dilations, with the samples in [0, 1]."""
    span = np.ptp(signals.x)
    return np.stack([(wavelets.centers - signals.x.min()) / span, np.log(wavelets.dilations / span)])


def _placed(signals: _Signals, kinds: Int[np.ndarray, "p"], theta: Float[np.ndarray, "2 p"]) -> _Placed:
    """The way back."""
    span = np.ptp(signals.x)
    return _Placed(signals.mothers, kinds, signals.x.min() + span * theta[0], span * np.exp(theta[1]))


def _of_row(table: NetworkTable, row: int) -> _Placed:
    """The wavelets of one row, in arrays of their own."""
    part = slice(table.offsets[row], table.offsets[row + 1])
    return _Placed(table.mothers, *(np.array(a[part]) for a in (table.kinds, table.centers, table.dilations)))


def _refined(signals: _Signals, row: int, start: _Placed, steps: int) -> _Row:
    """One signal: move, weigh, and keep the better."""
    before = _weighed(signals, row, start)
    y, size = signals.unit(row)
    if size == 0 or len(start.kinds) == 0:
        return _Row(before.placed, before.weights, before.affine, np.repeat(before.trace, 2))
    theta = _scaled(signals, start)
    _descend(signals.samples, signals.tables, y, start.kinds, theta, steps)
    after = _weighed(signals, row, _placed(signals, start.kinds, theta))
    better = after if after.trace[0] < before.trace[0] else before
    return _Row(better.placed, better.weights, better.affine, np.append(before.trace, better.trace))


def _grown(signals: _Signals, row: int, pool: _Pool, growth: Growth) -> _Row:
    """One signal: pick, move, and so on; move once more, and weigh."""
    y, size = signals.unit(row)
    kinds, theta, errors = np.zeros(0, np.int64), np.zeros((2, 0)), [float(size > 0)]
    arguments = signals.samples, signals.tables, y
    while len(kinds) < growth.n_wavelets and errors[-1] * size**2 > max(growth.tolerance * len(signals.x), ROUNDING * size**2):
        Q, rest = _project(*arguments, kinds, theta)
        best = _best(Q, rest, pool.values, pool.offsets, pool.first, pool.inside)
        if best < 0 or (rest**2).sum() <= ROUNDING:
            break
        more, moved = np.append(kinds, pool.kinds[best]), np.hstack([theta, pool.theta[:, [best]]])
        error = _descend(*arguments, more, moved, growth.steps)
        if error >= errors[-1]:
            break
        kinds, theta = more, moved
        errors.append(error)
    _descend(*arguments, kinds, theta, growth.last_steps)
    last = _weighed(signals, row, _placed(signals, kinds, theta))
    trace = np.append(size**2 * np.array(errors[: len(kinds)]), last.trace)
    return _Row(last.placed, last.weights, last.affine, np.maximum.accumulate(trace[::-1])[::-1])


def _weighed(signals: _Signals, row: int, placed: _Placed) -> _Row:
    """The network of these wavelets that follows the row best, with the mothers themselves; its error as the trace."""
    x, y = signals.x, signals.rows[row]
    basis, values = affine_basis(x), sampled(placed, x)
    rest = values - basis @ (basis.T @ values)
    norms = np.sqrt(len(x) * placed.dilations / np.ptp(x))
    weights = np.linalg.lstsq(rest / norms, y - basis @ (basis.T @ y), rcond=RANK)[0] / norms[:, None]
    left = y - values @ weights
    parts = basis.T @ left
    slope = parts[1] / np.linalg.norm(x - x.mean())
    affine = np.stack([parts[0] / np.sqrt(len(x)) - slope * x.mean(), slope])
    return _Row(placed, weights, affine, np.array([((left - basis @ parts) ** 2).sum()]))


def _gathered(signals: _Signals, found: list[_Row]) -> Refined:
    """One table of all rows."""
    k = signals.rows.shape[2]
    offsets = np.append(0, np.cumsum([len(row.placed.kinds) for row in found], dtype=np.int64))
    kinds = np.concatenate([np.zeros(0, np.int64), *(row.placed.kinds for row in found)])
    centers = np.concatenate([np.zeros(0), *(row.placed.centers for row in found)])
    dilations = np.concatenate([np.zeros(0), *(row.placed.dilations for row in found)])
    weights = np.concatenate([np.zeros((0, k)), *(row.weights for row in found)])
    affine = np.concatenate([np.zeros((0, 2, k)), *(row.affine[None] for row in found)])
    table = NetworkTable(signals.mothers, offsets, kinds, centers, dilations, weights, affine)
    return Refined(table, np.array([row.trace[-1] for row in found]), tuple(row.trace for row in found))


@njit(cache=True, error_model="numpy", nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True, fastmath={"reassoc", "contract"})
def _dot(a, b, first, last):  # type: ignore[no-untyped-def]
    # Sum of a[j] b[j] for first <= j < last. The terms may be added in any order, which is the same in each call: this is
    # what lets the compiler use vector instructions, and rounding is no worse.
    total = 0.0
    for j in range(first, last):
        total += a[j] * b[j]
    return total


@inner_kernel
def _cholesky(a):  # type: ignore[no-untyped-def]
    # Overwrites the lower triangle of a (m, m) by its Cholesky factor, diagonal inverted; False if it has none.
    for i in range(len(a)):
        for j in range(i + 1):
            total = a[i, j]
            for p in range(j):
                total -= a[i, p] * a[j, p]
            if j < i:
                a[i, j] = total * a[j, j]
            elif total > 0:
                a[i, i] = 1 / np.sqrt(total)
            else:
                return False
    return True


@inner_kernel
def _solve(factor, b):  # type: ignore[no-untyped-def]
    # Overwrites b (m,) by the solution, with a factor of `_cholesky` (m, m).
    for i in range(len(b)):
        for j in range(i):
            b[i] -= factor[i, j] * b[j]
        b[i] *= factor[i, i]
    for i in range(len(b) - 1, -1, -1):
        b[i] *= factor[i, i]
        for j in range(i):
            b[j] -= factor[i, j] * b[i]


@kernel
def _columns(samples, tables, kinds, theta, columns, ranges):  # type: ignore[no-untyped-def]
    # From samples (3, n), tables (l, c, 4), kinds (w,) and theta (2, w) to columns (3, 2 + w, n): the two affine ones, then
    # psi((x - t) / d) of each wavelet; its derivatives by t / d and by log d follow. Only what lies in ranges (2 + w, 2) is set.
    x, n = samples[0], samples.shape[1]
    for i in range(2):
        ranges[i, 0], ranges[i, 1] = 0, n
        for j in range(n):
            columns[0, i, j] = samples[1 + i, j]
    for i in range(len(kinds)):
        table, center, inverse = tables[kinds[i]], theta[0, i], np.exp(-theta[1, i])
        value, shift, widen = columns[0, 2 + i], columns[1, 2 + i], columns[2, 2 + i]
        low, high, per, cells = table[0, 0], table[0, 1], table[0, 2], int(table[0, 3])
        first, last = n, 0
        for j in range(n):
            z = (x[j] - center) * inverse
            if z < low or z > high:
                continue
            first, last = min(first, j), j + 1
            u = (z - low) * per
            c = min(int(u), cells - 1)
            u, c = u - c, c + 1
            slope = per * (table[c, 1] + u * (2 * table[c, 2] + 3 * u * table[c, 3]))
            value[j] = table[c, 0] + u * (table[c, 1] + u * (table[c, 2] + u * table[c, 3]))
            shift[j] = -slope
            widen[j] = -z * slope
        ranges[2 + i, 0], ranges[2 + i, 1] = min(first, last), last


@kernel
def _evaluate(columns, ranges, sizes, factor, weights, rest):  # type: ignore[no-untyped-def]
    # With columns (m, n), ranges (m, 2), sizes (m - 2,) of the penalties, and the signal in rest (k, n): fills factor (m, m)
    # of the normal equations and weights (k, m), and takes from rest what they make. Returns the objective, squared errors
    # and penalties, and the first alone.
    m, (k, n) = len(ranges), rest.shape
    penalty, sse = 0.0, 0.0
    for i in range(m):
        for j in range(i + 1):
            factor[i, j] = _dot(columns[i], columns[j], max(ranges[i, 0], ranges[j, 0]), min(ranges[i, 1], ranges[j, 1]))
        if i > 1:
            factor[i, i] += RIDGE * sizes[i - 2]
    if not _cholesky(factor):
        return np.inf, np.inf
    for c in range(k):
        r, w = rest[c], weights[c]
        for i in range(m):
            w[i] = _dot(columns[i], r, ranges[i, 0], ranges[i, 1])
        _solve(factor, w)
        for i in range(m):
            for j in range(ranges[i, 0], ranges[i, 1]):
                r[j] -= w[i] * columns[i, j]
        for j in range(n):
            sse += r[j] ** 2
        for i in range(2, m):
            penalty += sizes[i - 2] * w[i] ** 2
    return sse + RIDGE * penalty, sse


@kernel
def _derivatives(columns, ranges, sizes, factor, weights, rest):  # type: ignore[no-untyped-def]
    # Half the Gauss-Newton matrix (2 w, 2 w), lower triangle, and half the gradient (2 w,) of the objective by t / d of all
    # w = m - 2 wavelets, then by log d. Kaufman's Jacobian: derivatives of the columns, (3, m, n), times their weights (k, m),
    # less what the columns themselves can make of them. The gradient is exact. Arrays are those of `_evaluate`.
    m, k = len(ranges), len(weights)
    w = m - 2
    cross, gradient, hessian = np.empty((2 * w, m)), np.zeros(2 * w), np.zeros((2 * w, 2 * w))
    for p in range(2 * w):
        i, column = 2 + p % w, columns[1 + p // w, 2 + p % w]
        first, last = ranges[i, 0], ranges[i, 1]
        size = 0.0
        for c in range(k):
            gradient[p] -= weights[c, i] * _dot(column, rest[c], first, last)
            size += weights[c, i] ** 2
        if p >= w:
            gradient[p] += 0.5 * RIDGE * size * sizes[i - 2]
        for j in range(m):
            total = _dot(column, columns[0, j], max(first, ranges[j, 0]), min(last, ranges[j, 1]))
            for q in range(j):
                total -= cross[p, q] * factor[j, q]
            cross[p, j] = total * factor[j, j]
        for q in range(p + 1):
            j = 2 + q % w
            total, size = _dot(column, columns[1 + q // w, j], max(first, ranges[j, 0]), min(last, ranges[j, 1])), 0.0
            for a in range(m):
                total -= cross[p, a] * cross[q, a]
            for c in range(k):
                size += weights[c, i] * weights[c, j]
            hessian[p, q] = total * size
    return hessian, gradient


@inner_kernel
def _move(hessian, gradient, damping, theta, moved, narrowest):  # type: ignore[no-untyped-def]
    # A damped step from theta (2, w) to moved (2, w), within the bounds; False if the matrix has no factor.
    w = theta.shape[1]
    damped, step, floor = hessian.copy(), -gradient, SMALLEST
    for p in range(2 * w):
        floor += LEAST_DIAGONAL * hessian[p, p] / (2 * w)
    for p in range(2 * w):
        damped[p, p] += damping * (hessian[p, p] + floor)
    if not _cholesky(damped):
        return False
    _solve(damped, step)
    for i in range(w):
        shift = min(max(step[i], -LARGEST_SHIFT), LARGEST_SHIFT) * np.exp(theta[1, i])
        widening = min(max(step[w + i], -LARGEST_WIDENING), LARGEST_WIDENING)
        moved[0, i] = min(max(theta[0, i] + shift, LEFTMOST), RIGHTMOST)
        moved[1, i] = min(max(theta[1, i] + widening, narrowest), 0.0)
    return True


@kernel
def _descend(samples, tables, y, kinds, theta, steps):  # type: ignore[no-untyped-def]
    # Levenberg-Marquardt from theta (2, w), overwritten, for y (k, n), with samples (3, n), tables (l, c, 4) and kinds (w,).
    # Neither the objective nor the squared error, which it returns, ever rises. Two slots: where it is, and what it tries.
    (k, n), m = y.shape, len(kinds) + 2
    columns, ranges, rest = np.empty((2, 3, m, n)), np.empty((2, m, 2), np.int64), np.empty((2, k, n))
    factor, weights, thetas = np.empty((2, m, m)), np.empty((2, k, m)), np.empty((2, 2, m - 2))
    sizes, hessian, gradient = np.empty((2, m - 2)), np.empty((0, 0)), np.empty(0)
    for i in range(m - 2):
        thetas[0, 0, i], thetas[0, 1, i] = theta[0, i], theta[1, i]
    slot, done, failures, stalled = 1, 0, 0, 0
    least, sse, damping = np.inf, np.inf, SOFTER * FIRST_DAMPING
    while True:
        trial = 1 - slot
        _columns(samples, tables, kinds, thetas[trial], columns[trial], ranges[trial])
        for i in range(m - 2):
            sizes[trial, i] = n * np.exp(thetas[trial, 1, i])
        for c in range(k):
            for j in range(n):
                rest[trial, c, j] = y[c, j]
        value, left = _evaluate(columns[trial, 0], ranges[trial], sizes[trial], factor[trial], weights[trial], rest[trial])
        if value < least and left <= sse:
            stalled = stalled + 1 if least - value < LEAST_DECREASE * least else 0
            slot, trial, failures = trial, slot, 0
            least, sse, damping = value, left, max(damping / SOFTER, LEAST_DAMPING)
            if done == steps or sse <= ROUNDING or stalled == PATIENCE:
                break
            done += 1
            hessian, gradient = _derivatives(columns[slot], ranges[slot], sizes[slot], factor[slot], weights[slot], rest[slot])
        elif least == np.inf:
            return left
        else:
            failures += 1
            damping = min(damping * HARDER, MOST_DAMPING)
            if failures == MOST_FAILURES:
                break
        if not _move(hessian, gradient, damping, thetas[slot], thetas[trial], -np.log(n)):
            break
    for i in range(m - 2):
        theta[0, i], theta[1, i] = thetas[slot, 0, i], thetas[slot, 1, i]
    return sse


@kernel
def _project(samples, tables, y, kinds, theta):  # type: ignore[no-untyped-def]
    # Orthonormal columns (2 + w, n) that span the affine functions and the wavelets, 0 for one that adds nothing, and what
    # they leave of y (k, n). Gram-Schmidt, twice.
    m, n = len(kinds) + 2, samples.shape[1]
    columns, ranges, Q, rest = np.zeros((3, m, n)), np.empty((m, 2), np.int64), np.empty((m, n)), y.copy()
    _columns(samples, tables, kinds, theta, columns, ranges)
    first, last = ranges[0]
    for i in range(m + len(y)):
        v, columns_before = columns[0, i] if i < m else rest[i - m], min(i, m)
        before = _dot(v, v, first, last)
        for p in range(2 * columns_before):
            q = Q[p % columns_before]
            share = _dot(q, v, first, last)
            for j in range(n):
                v[j] -= share * q[j]
        if i < m:
            left = _dot(v, v, first, last)
            inverse = 1 / np.sqrt(left) if left > LEAST_INDEPENDENT * before else 0.0
            for j in range(n):
                Q[i, j] = v[j] * inverse
    return Q, rest


@kernel
def _best(Q, rest, values, offsets, first, inside):  # type: ignore[no-untyped-def]
    # The candidate, with values[offsets[i] : offsets[i + 1]] from sample first[i] on, that lowers the squared error most beside
    # Q (m, n), where rest (k, n) is left: the largest correlation^2 / remainder. Remainders are only computed where they can
    # matter. -1 if there is none.
    scores, most, best, top = np.zeros(len(first)), 0.0, -1, 0
    start = offsets[0]  # 0, but no literal, for which numba would compile `_dot` once more
    for i in range(len(first)):
        v = values[offsets[i] : offsets[i + 1]]
        for c in range(len(rest)):
            scores[i] += _dot(rest[c][first[i] :], v, start, len(v)) ** 2
        if scores[i] > scores[top]:
            top = i
    for turn in range(len(first)):
        i = (top + turn) % len(first)
        if scores[i] > LEAST_REMAINDER * inside[i] * most:
            v, left = values[offsets[i] : offsets[i + 1]], inside[i]
            for q in range(2, len(Q)):
                left -= _dot(Q[q][first[i] :], v, start, len(v)) ** 2
            if left > LEAST_REMAINDER * inside[i] and scores[i] > most * left:
                most, best = scores[i] / left, i
    return best
