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

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.numerics.threads import each
from morphlet.wavenet.blocks import NetworkTable
from morphlet.wavenet.descent import ROUNDING, best_candidate, descend, project
from morphlet.wavenet.library import Wavelets, affine_basis, fitting, sampled
from morphlet.wavenet.mothers import Mother

LEAST_SEEN = 1e-6
"""Share of a candidate's squared norm that its affine part must leave."""
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
    descend(signals.samples, signals.tables, y, start.kinds, theta, steps)
    after = _weighed(signals, row, _placed(signals, start.kinds, theta))
    better = after if after.trace[0] < before.trace[0] else before
    return _Row(better.placed, better.weights, better.affine, np.append(before.trace, better.trace))


def _grown(signals: _Signals, row: int, pool: _Pool, growth: Growth) -> _Row:
    """One signal: pick, move, and so on; move once more, and weigh."""
    y, size = signals.unit(row)
    kinds, theta, errors = np.zeros(0, np.int64), np.zeros((2, 0)), [float(size > 0)]
    arguments = signals.samples, signals.tables, y
    while len(kinds) < growth.n_wavelets and errors[-1] * size**2 > max(growth.tolerance * len(signals.x), ROUNDING * size**2):
        Q, rest = project(*arguments, kinds, theta)
        best = best_candidate(Q, rest, pool.values, pool.offsets, pool.first, pool.inside)
        if best < 0 or (rest**2).sum() <= ROUNDING:
            break
        more, moved = np.append(kinds, pool.kinds[best]), np.hstack([theta, pool.theta[:, [best]]])
        error = descend(*arguments, more, moved, growth.steps)
        if error >= errors[-1]:
            break
        kinds, theta = more, moved
        errors.append(error)
    descend(*arguments, kinds, theta, growth.last_steps)
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
