"""Choose the best wavelets of a library for given data.

Three rules, all greedy, one wavelet after another; the affine part is fitted throughout:

- "ols" (orthogonal least squares) picks the candidate with which the least-squares error becomes smallest;
- "omp" (orthogonal matching pursuit) picks the one most correlated with what is left, and refits all weights;
- "mp" (matching pursuit) picks likewise, and refits none: it may pick one candidate again.

"ols" is the best of them at the same cost, and the only one that does not depend on how the candidates are normalised.
"""

from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.wavenet.library import Library, affine_basis, normalised
from morphlet.wavenet.network import WaveletNetwork

Method = Literal["ols", "omp", "mp"]
Reason = Literal["count", "tolerance", "exhausted"]
RULES: tuple[Method, ...] = get_args(Method)
OLS, MP = RULES.index("ols"), RULES.index("mp")

LEAST_REMAINDER = 1e-4
"""Share of a candidate's squared norm that must be left beside the wavelets already chosen: weights stay moderate."""
ROUNDING = 1e-26
"""Share of the signal's sum of squares that is no more than rounding (an amplitude of 1e-13)."""
LARGEST = 1e150
"""Largest value whose square is a number with room for sums."""
GRAM_LIMIT = 8192
"""Most candidates for which all inner products are stored: 0.5 GB."""


@dataclass(frozen=True, eq=False)
class Fit:
    """What a fit chose, and what each choice gained.

    Parameters
    ----------
    network
        The wavelets in the order of their choice, with their weights.
    sse
        Sum of squared errors over all samples and outputs, of the affine part alone and after each pick.
    reason
        Why it stopped: "count" (as many picks as asked), "tolerance" (error small enough), or "exhausted" (no candidate
        that is left lowers the error).
    """

    network: WaveletNetwork
    sse: Float[np.ndarray, "m1"]
    reason: Reason

    def __post_init__(self) -> None:
        object.__setattr__(self, "sse", _arrays.real(self.sse, "sse", (None,)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Fit, (self.network, np.array(self.sse), self.reason)


@dataclass(frozen=True, eq=False)
class _Candidates:
    """A library on its samples: values, the same normalised, and inner products of these if they pay."""

    library: Library
    x: Float[np.ndarray, "n"]
    basis: Float[np.ndarray, "n 2"]
    values: Float[np.ndarray, "n l"]
    design: Float[np.ndarray, "n l"]
    gram: Float[np.ndarray, "g g"]


@dataclass(frozen=True, eq=False)
class _Pursuit:
    """Picks, the decrease of the squared error by each, and the steps along the picked columns."""

    picks: Int[np.ndarray, "m"]
    gains: Float[np.ndarray, "m"]
    steps: Float[np.ndarray, "m k"]
    reason: Reason


def fit(
    x: Float[np.ndarray, "n"],
    y: Float[np.ndarray, "n k"],
    library: Library,
    n_wavelets: int,
    *,
    tolerance: float = 0.0,
    method: Method = "ols",
) -> Fit:
    """The network of a few wavelets of the library that follows the samples best; all outputs share the wavelets.

    Parameters
    ----------
    x
        Places of the samples, on which the library was made.
    y
        Values of k outputs there.
    library
        Candidates.
    n_wavelets
        Most picks.
    tolerance
        Mean over the samples of the squared error, summed over the outputs (Eq. 9), at which to stop earlier.
    method
        Rule of choice: "ols", "omp" or "mp".

    Returns
    -------
    Fit
        With fewer wavelets than asked if no more can lower the error, for instance since all samples are met exactly;
        `reason` tells.

    Raises
    ------
    InputError
        If values are not finite or beyond 1e150, shapes differ, there are not 2 different places, or an option is out of range.

    Notes
    -----
    Orthogonal least squares as a pivoted partial Cholesky factorization of the candidates' inner products [1]_: O(l m (m + n))
    for m picks from l candidates on n samples, after O(n l) for their values. Near-duplicates of chosen wavelets are left
    alone: a candidate needs 1e-4 of its squared norm beside them. Weights come from a QR factorization.

    References
    ----------
    .. [1] S. Chen, S. A. Billings, W. Luo, "Orthogonal least squares methods and their application to non-linear system
       identification", International Journal of Control 50 (1989).

    Examples
    --------
    >>> from morphlet.wavenet.fit import fit
    >>> from morphlet.wavenet.library import dyadic_library
    >>> x = np.linspace(0, 1, 128)
    >>> bump = np.exp(-((x - 0.4) / 0.1) ** 2)[:, None]
    >>> found = fit(x, bump, dyadic_library(["mexican_hat", "beta1"], x), 8)
    >>> found.network, found.reason, bool(np.sqrt(found.sse[-1] / 128) < 0.01)
    (WaveletNetwork(8 wavelets, 1 outputs), 'count', True)
    """
    values = _arrays.real(y, "y", (None, None))
    return _fits(x, values[None], library, _Options(n_wavelets, tolerance, method))[0]


def fit_rows(
    x: Float[np.ndarray, "n"],
    rows: Float[np.ndarray, "r n k"],
    library: Library,
    n_wavelets: int,
    *,
    tolerance: float = 0.0,
    method: Method = "ols",
) -> tuple[Fit, ...]:
    """The networks of many signals on the same samples: as `fit` for each row, but faster.

    Parameters
    ----------
    x, library, n_wavelets, tolerance, method
        As for `fit`.
    rows
        Signals (r, n, k). The k outputs of one row share its wavelets, rows share none.

    Returns
    -------
    tuple[Fit, ...]
        One per row.

    Raises
    ------
    InputError
        As for `fit`.

    Notes
    -----
    The inner products of the candidates are computed once, O(n l^2), when the rows are many enough for that to pay, and
    then O(l m^2) per row.

    Examples
    --------
    >>> from morphlet.wavenet.fit import fit_rows
    >>> from morphlet.wavenet.library import dyadic_library
    >>> x = np.linspace(0, 1, 64)
    >>> rows = np.sin(np.multiply.outer([2.0, 5.0, 9.0], x))[:, :, None]
    >>> [found.reason for found in fit_rows(x, rows, dyadic_library(["slog1"], x), 20, tolerance=1e-4)]
    ['tolerance', 'tolerance', 'tolerance']
    """
    return _fits(x, _arrays.real(rows, "rows", (None, None, None)), library, _Options(n_wavelets, tolerance, method))


@dataclass(frozen=True)
class _Options:
    """When to stop, and how to choose."""

    n_wavelets: int
    tolerance: float
    method: Method

    def __post_init__(self) -> None:
        if self.method not in RULES:
            raise InputError(f"a method of {', '.join(RULES)}", repr(self.method), "choose one of them")
        if self.n_wavelets < 0 or not 0 <= self.tolerance < np.inf:
            found = f"n_wavelets {self.n_wavelets}, tolerance {self.tolerance}"
            raise InputError("n_wavelets >= 0 and a finite tolerance >= 0", found, "ask for 15 wavelets and tolerance 0, for instance")


def _fits(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], library: Library, options: _Options) -> tuple[Fit, ...]:
    """Check, prepare the candidates once, then row by row."""
    x = _arrays.real(x, "x", (None,))
    if rows.shape[1] != len(x):
        raise InputError(f"{len(x)} values for {len(x)} places", f"{rows.shape[1]}", "pass one value per place and output")
    if len(np.unique(x)) < 2:
        raise InputError("samples at 2 or more different places", f"{len(np.unique(x))}", "sample the signal more densely")
    if np.abs(rows).max(initial=0) > LARGEST:
        raise InputError(f"values up to {LARGEST:g}", f"{np.abs(rows).max():g}", "change the unit: squares must not overflow")
    candidates = _prepare(x, library, len(rows) * options.n_wavelets)
    rests = rows - candidates.basis @ (candidates.basis.T @ rows)
    correlations = np.matmul(candidates.design.T, rests)
    return tuple(_fit_row(candidates, y, rest, c, options) for y, rest, c in zip(rows, rests, correlations, strict=True))


def _prepare(x: Float[np.ndarray, "n"], library: Library, picks: int) -> _Candidates:
    """The library on its samples; the Gram matrix if about as many of its rows are needed as it has."""
    values = library.values(x)
    design = normalised(values, x, library.normalisation)
    pays = len(library) <= min(2 * picks, GRAM_LIMIT)
    gram = design.T @ design if pays else np.zeros((0, 0))
    return _Candidates(library, x, affine_basis(x), values, design, gram)


def _fit_row(candidates: _Candidates, y: np.ndarray, rest: np.ndarray, correlations: np.ndarray, options: _Options) -> Fit:
    """One signal: pursue, refit, look back at what each pick gained."""
    pursuit = _pursue(candidates, (y**2).sum(), (rest**2).sum(), np.ascontiguousarray(correlations.T), options)
    refit = _accumulate if options.method == "mp" else _least_squares
    picks, weights = refit(candidates, pursuit, y)
    affine, error = _affine(candidates, y - candidates.values[:, picks] @ weights)
    after = error + np.append(np.cumsum(pursuit.gains[::-1])[::-1], 0)  # backwards: small errors keep their digits
    library = candidates.library
    names = tuple(library.mothers[i] for i in picks)
    return Fit(WaveletNetwork(names, library.centers[picks], library.dilations[picks], weights, affine), after, pursuit.reason)


def _pursue(candidates: _Candidates, energy: float, sse: float, correlations: np.ndarray, options: _Options) -> _Pursuit:
    """Run the kernel and cut what it did not use."""
    most = options.n_wavelets if options.method == "mp" else min(options.n_wavelets, len(candidates.x))
    picks, gains = np.zeros(most, np.int64), np.zeros(most)
    steps = np.zeros((most, len(correlations)))
    enough, rounding = options.tolerance * len(candidates.x), ROUNDING * energy
    rule = RULES.index(options.method)
    used = _choose(candidates.design, candidates.gram, correlations, rule, sse, enough, rounding, picks, gains, steps)
    left = np.subtract.reduce(np.append(sse, gains[:used]))  # one after another, as the kernel does
    reason: Reason = "tolerance" if enough > 0 and left <= enough else "count" if used == options.n_wavelets else "exhausted"
    return _Pursuit(picks[:used], gains[:used], steps[:used], reason)


def _least_squares(candidates: _Candidates, pursuit: _Pursuit, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the picks beside the affine part, by QR of the columns themselves."""
    columns = np.hstack([candidates.basis, candidates.values[:, pursuit.picks]])
    Q, R = np.linalg.qr(columns)
    return pursuit.picks, np.linalg.solve(R, Q.T @ y)[2:]


def _accumulate(candidates: _Candidates, pursuit: _Pursuit, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of the picks as matching pursuit leaves them, steps of one candidate added up."""
    different, first, place = np.unique(pursuit.picks, return_index=True, return_inverse=True)
    weights = np.zeros((len(different), y.shape[1]))
    np.add.at(weights, place, pursuit.steps)
    order = np.argsort(first)
    picks = different[order]
    values = candidates.values[:, picks]
    rest = values - candidates.basis @ (candidates.basis.T @ values)
    alpha = np.linalg.norm(candidates.design[:, picks], axis=0) / np.linalg.norm(rest, axis=0)
    return picks, weights[order] * alpha[:, None]


def _affine(candidates: _Candidates, y: Float[np.ndarray, "n k"]) -> tuple[Float[np.ndarray, "2 k"], float]:
    """The affine part of what the wavelets leave, and the sum of squares that remains."""
    x, parts = candidates.x, candidates.basis.T @ y
    left = y - candidates.basis @ parts
    slope = parts[1] / np.linalg.norm(x - x.mean())
    return np.stack([parts[0] / np.sqrt(len(x)) - slope * x.mean(), slope]), float((left**2).sum())


@njit(cache=True, error_model="numpy")
def _choose(design, gram, correlations, rule, sse, enough, rounding, picks, gains, steps):  # type: ignore[no-untyped-def]
    # Pivoted partial Cholesky of the Gram matrix. From candidates design (n, l), their inner products gram (l, l) or (0, 0) to
    # have them computed, and correlations (k, l) with the signal, overwritten; out come picks (m,), gains (m,) and steps
    # (m, k), of which it fills as many as it returns.
    count, (k, size) = len(picks), correlations.shape
    before = np.zeros(size)
    if len(gram):
        for i in range(size):
            before[i] = gram[i, i]
    else:
        for n in range(len(design)):
            for i in range(size):
                before[i] += design[n, i] ** 2
    norms = before.copy()  # squared, of what is left of each candidate beside the picks: of a pick, nothing
    factor = np.empty((1 if rule == MP else count, size))  # rows of the Cholesky factor
    for m in range(count):
        if sse <= enough or sse <= rounding:
            return m
        best, highest = -1, 0.0
        for i in range(size):
            if norms[i] > LEAST_REMAINDER * before[i]:
                score = 0.0
                for j in range(k):
                    score += correlations[j, i] ** 2
                if rule == OLS:
                    score /= norms[i]
                if score > highest:
                    best, highest = i, score
        gain = highest if rule == OLS or best < 0 else highest / norms[best]
        if best < 0 or gain <= rounding:
            return m
        row = factor[0 if rule == MP else m]
        if len(gram):
            row[:] = gram[best]
        else:
            row[:] = 0.0
            for n in range(len(design)):
                share = design[n, best]
                for i in range(size):
                    row[i] += share * design[n, i]
        if rule != MP:
            for j in range(m):
                share = factor[j, best]
                for i in range(size):
                    row[i] -= share * factor[j, i]
        length = np.sqrt(norms[best])
        for i in range(size):
            row[i] /= length
        for j in range(k):
            share = correlations[j, best] / length
            steps[m, j] = share / length
            for i in range(size):
                correlations[j, i] -= share * row[i]
        if rule != MP:
            for i in range(size):
                norms[i] -= row[i] ** 2
        picks[m], gains[m] = best, gain
        sse -= gain
    return count
