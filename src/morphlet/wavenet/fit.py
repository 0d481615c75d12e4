"""Choose the best wavelets of a library for given data.

Three rules, all greedy, one wavelet after another; the affine part is fitted throughout:

- "ols" (orthogonal least squares) picks the candidate with which the least-squares error becomes smallest;
- "omp" (orthogonal matching pursuit) picks the one most correlated with what is left, and refits all weights;
- "mp" (matching pursuit) picks likewise, and refits none: it may pick one candidate again.

"ols" is the best of them at the same cost, and the only one that does not depend on how the candidates are normalised.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.wavenet.blocks import NetworkTable, joined
from morphlet.wavenet.library import Library, fitting
from morphlet.wavenet.network import WaveletNetwork
from morphlet.wavenet.pursuit import RULES, Candidates, Method, Picks, prepare, pursue, weigh
from morphlet.wavenet.refine import Growth, interleave_rows, refine_rows

Stop = Literal["count", "gcv"]
Reason = Literal["count", "tolerance", "gcv", "exhausted"]
Refinement = Literal["none", "final", "interleaved"]


@dataclass(frozen=True)
class FitOptions:
    """How wavelets are chosen, and how many.

    Parameters
    ----------
    n_wavelets
        Most picks of a signal; 15 in the paper.
    tolerance
        Mean over the samples of the squared error, summed over the outputs (Eq. 9), at which to stop earlier.
    method
        Rule of choice: "ols", "omp" or "mp".
    stop
        "count" for as many as that, or "gcv" for as many as generalised cross-validation finds to be more than noise.
    refinement
        Whether wavelets stay where the library has them ("none"), or their centers and dilations follow the samples: once
        all are chosen ("final"), or after each choice as well ("interleaved", by orthogonal least squares only).

    Raises
    ------
    InputError
        If an option is out of range.

    Examples
    --------
    >>> from morphlet.wavenet.fit import FitOptions
    >>> FitOptions(method="omp")
    FitOptions(n_wavelets=15, tolerance=0.0, method='omp', stop='count', refinement='none')
    """

    n_wavelets: int = 15
    tolerance: float = 0.0
    method: Method = "ols"
    stop: Stop = "count"
    refinement: Refinement = "none"

    def __post_init__(self) -> None:
        for name, choices in (("method", RULES), ("stop", get_args(Stop)), ("refinement", get_args(Refinement))):
            if getattr(self, name) not in choices:
                raise InputError(f"a {name} of {', '.join(choices)}", repr(getattr(self, name)), "choose one of them")
        if self.refinement == "interleaved" and self.method != "ols":
            raise InputError("method ols with interleaved refinement", self.method, "leave the method out, or refine at the end")
        if self.n_wavelets < 0 or not 0 <= self.tolerance < np.inf:
            found = f"n_wavelets {self.n_wavelets}, tolerance {self.tolerance}"
            raise InputError("n_wavelets >= 0 and a finite tolerance >= 0", found, "ask for 15 wavelets and tolerance 0, for instance")


@dataclass(frozen=True, eq=False)
class Fit:
    """What a fit chose, and what each choice gained.

    Parameters
    ----------
    network
        The wavelets in the order of their choice, with their weights.
    sse
        Sum of squared errors over all samples and outputs, of the affine part alone and after each pick; the last one after
        the refinement.
    reason
        Why it stopped: "count" (as many picks as asked), "tolerance" (error small enough), "gcv" (more would follow noise),
        or "exhausted" (no candidate that is left lowers the error).
    """

    network: WaveletNetwork
    sse: Float[np.ndarray, "m1"]
    reason: Reason

    def __post_init__(self) -> None:
        object.__setattr__(self, "sse", _arrays.real(self.sse, "sse", (None,)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Fit, (self.network, np.array(self.sse), self.reason)


@dataclass(frozen=True, eq=False)
class RowFits:
    """What the fits of many signals chose.

    Parameters
    ----------
    table
        The network of each signal.
    sse
        Sum of squared errors of each, over all samples and outputs.
    reasons
        Why each stopped, as for a `Fit`.
    """

    table: NetworkTable
    sse: Float[np.ndarray, "r"]
    reasons: tuple[Reason, ...]

    def __post_init__(self) -> None:
        object.__setattr__(self, "sse", _arrays.real(self.sse, "sse", (len(self.table),)))

    def __reduce__(self) -> tuple[Any, ...]:
        return RowFits, (self.table, np.array(self.sse), self.reasons)


def fit(x: Float[np.ndarray, "n"], y: Float[np.ndarray, "n k"], library: Library, options: FitOptions | None = None) -> Fit:
    """The network of a few wavelets of the library that follows the samples best; all outputs use the same wavelets.

    Parameters
    ----------
    x
        Places of the samples, on which the library was made.
    y
        Values of k outputs there.
    library
        Candidates.
    options
        15 wavelets by orthogonal least squares if left out.

    Returns
    -------
    Fit
        With fewer wavelets than asked if no more can lower the error, for instance since all samples are met exactly;
        `reason` tells.

    Raises
    ------
    InputError
        If values are not finite or beyond 1e150, shapes differ, or there are not 2 different places.

    Notes
    -----
    Orthogonal least squares as a pivoted partial Cholesky factorization of the candidates' inner products [1]_: O(l m (m + n))
    for m picks from l candidates on n samples, after O(n l) for their values. Near-duplicates of chosen wavelets are left
    alone: a candidate needs 1e-4 of its squared norm beside them.

    Generalised cross-validation [2]_ takes m wavelets for m (1 + 2 / k) + 2 parameters of each of k outputs: a weight each, and
    the common center and dilation.

    References
    ----------
    .. [1] S. Chen, S. A. Billings, W. Luo, "Orthogonal least squares methods and their application to non-linear system
       identification", International Journal of Control 50 (1989).
    .. [2] G. H. Golub, M. Heath, G. Wahba, "Generalized cross-validation as a method for choosing a good ridge parameter",
       Technometrics 21 (1979).

    Examples
    --------
    >>> from morphlet.wavenet.fit import FitOptions, fit
    >>> from morphlet.wavenet.library import dyadic_library
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> x = np.linspace(0, 1, 128)
    >>> bump = np.exp(-((x - 0.4) / 0.1) ** 2)[:, None]
    >>> library = dyadic_library([MOTHERS["mexican_hat"], MOTHERS["beta1"]], x)
    >>> found = fit(x, bump, library, FitOptions(n_wavelets=8))
    >>> found.network, found.reason, bool(np.sqrt(found.sse[-1] / 128) < 0.01)
    (WaveletNetwork(8 wavelets, 1 outputs), 'count', True)
    """
    values = _arrays.real(y, "y", (None, None))
    chosen = _fitted(x, values[None], library, options or FitOptions())
    return Fit(chosen.table[0], chosen.traces[0], chosen.reasons[0])


def fit_rows(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], library: Library, options: FitOptions | None = None) -> RowFits:
    """The networks of many signals on the same samples: as `fit` for each row, but faster.

    Parameters
    ----------
    x, library, options
        As for `fit`.
    rows
        Signals (r, n, k). The k outputs of one row use the same wavelets; each row has its own.

    Returns
    -------
    RowFits
        A table of networks, one per row.

    Raises
    ------
    InputError
        As for `fit`.

    Notes
    -----
    The inner products of the candidates are computed once, O(n l^2), when the rows are many enough for that to pay, and
    then O(l m^2) per row. Rows are spread over the threads; their number does not change a bit of the result.

    Examples
    --------
    >>> from morphlet.wavenet.fit import FitOptions, fit_rows
    >>> from morphlet.wavenet.library import dyadic_library
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> x = np.linspace(0, 1, 64)
    >>> rows = np.sin(np.multiply.outer([2.0, 5.0, 9.0], x))[:, :, None]
    >>> found = fit_rows(x, rows, dyadic_library([MOTHERS["slog1"]], x), FitOptions(20, tolerance=1e-4))
    >>> found.table, found.reasons
    (NetworkTable(3 blocks, 10 wavelets, 1 outputs), ('tolerance', 'tolerance', 'tolerance'))
    """
    chosen = _fitted(x, rows, library, options or FitOptions())
    return RowFits(chosen.table, np.array([trace[-1] for trace in chosen.traces]), chosen.reasons)


@dataclass(frozen=True, eq=False)
class _Chosen:
    """The networks of all rows, and the squared error of each after each of its picks."""

    table: NetworkTable
    traces: tuple[Float[np.ndarray, "_"], ...]
    reasons: tuple[Reason, ...]


def _fitted(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], library: Library, options: FitOptions) -> _Chosen:
    """Choose, and move if asked."""
    x, rows = fitting(x, rows)
    if options.refinement == "interleaved":
        return _interleaved(x, rows, library, options)
    chosen = _selected(x, rows, library, options)
    if options.refinement == "none":
        return chosen
    refined = refine_rows(x, rows, chosen.table)
    traces = tuple(np.append(trace[:-1], sse) for trace, sse in zip(chosen.traces, refined.sse, strict=True))
    return _Chosen(refined.table, traces, chosen.reasons)


def _interleaved(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], library: Library, options: FitOptions) -> _Chosen:
    """Choose and move by turns; once more with fewer picks where cross-validation wants fewer."""
    grown = interleave_rows(x, rows, library, Growth(options.n_wavelets, options.tolerance))
    used = np.diff(grown.table.offsets)
    met = (grown.sse <= options.tolerance * len(x)) & (options.tolerance > 0)
    reasons = np.where(met, "tolerance", np.where(used == options.n_wavelets, "count", "exhausted")).astype("<U10")
    if options.stop == "count":
        return _Chosen(grown.table, grown.traces, tuple(reasons.tolist()))
    fewer = [int(_best_validated(trace[:, None], rows.shape[1:])[0]) for trace in grown.traces]
    again = [interleave_rows(x, row[None], library, Growth(m, options.tolerance)) for m, row in zip(fewer, rows, strict=True)]
    reasons[np.array(fewer) < used] = "gcv"
    table = joined([one.table for one in again]) if again else grown.table
    return _Chosen(table, tuple(one.traces[0] for one in again), tuple(reasons.tolist()))


def _selected(x: Float[np.ndarray, "n"], rows: Float[np.ndarray, "r n k"], library: Library, options: FitOptions) -> _Chosen:
    """Prepare the candidates once, choose, weigh."""
    candidates = prepare(x, library, len(rows) * options.n_wavelets)
    parts = candidates.basis.T @ rows
    rests = rows - candidates.basis @ parts
    picks = pursue(candidates, rests, (rows**2).sum(axis=(1, 2)), (options.method, options.n_wavelets, options.tolerance * len(x)))
    picks, reasons = _cut(picks, rests, options)
    different = _merged(picks) if options.method == "mp" else picks
    weights, errors = weigh(candidates, different, rests)
    return _Chosen(_table(candidates, different, weights, parts), _traces(picks, errors), reasons)


def _traces(picks: Picks, errors: Float[np.ndarray, "r"]) -> tuple[Float[np.ndarray, "_"], ...]:
    """The error of each row after each of its picks: from the last one backwards, so that small errors keep their digits."""
    gains = np.hstack([picks.gains, np.zeros((len(errors), 1))])
    after = errors[:, None] + np.cumsum(gains[:, ::-1], axis=1)[:, ::-1]
    return tuple(row[: used + 1] for row, used in zip(after, picks.used, strict=True))


def _cut(picks: Picks, rests: Float[np.ndarray, "r n k"], options: FitOptions) -> tuple[Picks, tuple[Reason, ...]]:
    """As many picks as the stop allows, and why no more."""
    left = [(rests**2).sum(axis=(1, 2))]
    for gains in picks.gains.T:
        left.append(left[-1] - gains)  # one after another, as the kernel does
    met = (left[-1] <= options.tolerance * rests.shape[1]) & (options.tolerance > 0)
    names = np.where(met, "tolerance", np.where(picks.used == options.n_wavelets, "count", "exhausted")).astype("<U10")
    used = picks.used if options.stop == "count" else np.minimum(picks.used, _best_validated(np.array(left), rests.shape[1:]))
    names[used < picks.used] = "gcv"
    beyond = np.arange(picks.gains.shape[1]) >= used[:, None]
    return replace(picks, used=used, gains=np.where(beyond, 0, picks.gains)), tuple(names.tolist())


def _best_validated(left: Float[np.ndarray, "m1 r"], shape: tuple[int, int]) -> Int[np.ndarray, "r"]:
    """Where generalised cross-validation is least."""
    n, k = shape
    share = (np.arange(len(left)) * (1 + 2 / max(k, 1)) + 2) / n
    score = np.full(left.shape, np.inf)
    score[share < 1] = np.maximum(left[share < 1], 0) / (1 - share[share < 1, None]) ** 2
    return np.argmin(score, axis=0)


def _merged(picks: Picks) -> Picks:
    """Matching pursuit may pick a candidate again: its steps added up, in the place of the first."""
    used, places, steps = np.zeros_like(picks.used), np.zeros_like(picks.picks), np.zeros_like(picks.steps)
    for row, count in enumerate(picks.used):
        names, first, place = np.unique(picks.picks[row, :count], return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(first))
        used[row] = len(names)
        places[row, rank] = names
        np.add.at(steps[row], rank[place], picks.steps[row, :count])
    return replace(picks, used=used, picks=places, steps=steps, factors=picks.factors[:0])


def _table(candidates: Candidates, picks: Picks, weights: Float[np.ndarray, "r m k"], parts: Float[np.ndarray, "r 2 k"]) -> NetworkTable:
    """Weights of the wavelets themselves from those of the normalised columns, and the affine parts that go with them."""
    library, x = candidates.library, candidates.x
    weights = weights * candidates.alpha[picks.picks][:, :, None]
    parts = parts - np.einsum("arm,rmk->rak", candidates.parts[:, picks.picks], weights)
    slope = parts[:, 1] / np.linalg.norm(x - x.mean())
    affine = np.stack([parts[:, 0] / np.sqrt(len(x)) - slope * x.mean(), slope], axis=1)
    kept = np.arange(weights.shape[1]) < picks.used[:, None]
    of = picks.picks[kept]
    offsets = np.append(0, np.cumsum(picks.used))
    return NetworkTable(library.mothers, offsets, library.kinds[of], library.centers[of], library.dilations[of], weights[kept], affine)
