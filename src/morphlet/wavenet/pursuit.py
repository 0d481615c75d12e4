"""Greedy choice of candidates: a pivoted partial Cholesky factorization of their inner products, row by row of signals.

Arrays that go in and out are those of many signals at once (r rows, k outputs, l candidates, m picks); what a row does not
use of its m places stays zero.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int

from morphlet.numerics import threads
from morphlet.numerics.compiled import inner_kernel, kernel, njit
from morphlet.wavenet.library import Library, affine_basis, normalised

Method = Literal["ols", "omp", "mp"]
RULES: tuple[Method, ...] = get_args(Method)
OLS, MP = RULES.index("ols"), RULES.index("mp")

LEAST_REMAINDER = 1e-4
"""Share of a candidate's squared norm that must be left beside the wavelets already chosen: weights stay moderate."""
ROUNDING = 1e-26
"""Share of the signal's sum of squares that is no more than rounding (an amplitude of 1e-13)."""
GRAM_LIMIT = 8192
"""Most candidates for which all inner products are stored: 0.5 GB."""
PIECE = 16
"""Rows that a thread takes at a time."""


@dataclass(frozen=True, eq=False)
class Candidates:
    """A library on its samples: normalised columns, factors alpha, affine parts, and inner products of the columns if they pay."""

    library: Library
    x: Float[np.ndarray, "n"]
    basis: Float[np.ndarray, "n 2"]
    parts: Float[np.ndarray, "2 l"]
    alpha: Float[np.ndarray, "l"]
    design: Float[np.ndarray, "n l"]
    gram: Float[np.ndarray, "g g"]


@dataclass(frozen=True, eq=False)
class Picks:
    """Which candidates each row chose, how much each lowered its squared error, and what it takes to weigh them."""

    used: Int[np.ndarray, "r"]
    picks: Int[np.ndarray, "r m"]
    gains: Float[np.ndarray, "r m"]
    steps: Float[np.ndarray, "r m k"]
    factors: Float[np.ndarray, "r m m"]


def prepare(x: Float[np.ndarray, "n"], library: Library, n_picks: int) -> Candidates:
    """The library on its samples; the Gram matrix if about as many of its rows are needed as it has."""
    values, basis = library.values(x), affine_basis(x)
    parts = basis.T @ values
    design, alpha = normalised(values, x, library.normalisation)
    pays = len(library) <= min(2 * n_picks, GRAM_LIMIT)
    gram = design.T @ design if pays else np.zeros((0, 0))
    return Candidates(library, x, basis, parts, alpha, design, gram)


def pursue(
    candidates: Candidates, rests: Float[np.ndarray, "r n k"], energy: Float[np.ndarray, "r"], rule: tuple[Method, int, float]
) -> Picks:
    """The picks of every row, from what its affine part leaves; `rule` is the method, most picks, and the sum of squares to reach."""
    (r, n, k), (method, most, enough) = rests.shape, rule
    l = len(candidates.library)
    most = min(most, n, l) if method != "mp" else most if l else 0  # matching pursuit may pick a candidate again
    shapes = (r, most), (r, most), (r, most, k), (r, most, most)
    picks = Picks(np.zeros(r, np.int64), np.zeros(shapes[0], np.int64), *(np.zeros(shape) for shape in shapes[1:]))
    correlations = np.ascontiguousarray(rests.transpose(0, 2, 1)).reshape(r * k, n) @ candidates.design
    correlations = correlations.reshape(r, k, l)
    limits = np.stack([(rests**2).sum(axis=(1, 2)), np.full(r, enough), ROUNDING * energy], axis=1)
    found = (picks.used, picks.picks, picks.gains, picks.steps, picks.factors)
    columns = (candidates.design, candidates.gram, np.einsum("nl,nl->l", candidates.design, candidates.design))

    def work(piece: int) -> None:
        rows = slice(PIECE * piece, PIECE * (piece + 1))
        part = tuple(values[rows] for values in found)
        _choose_range(columns, correlations[rows], RULES.index(method), limits[rows], part)

    threads.each(work, -(-r // PIECE))
    return picks


def weigh(
    candidates: Candidates, picks: Picks, rests: Float[np.ndarray, "r n k"]
) -> tuple[Float[np.ndarray, "r m k"], Float[np.ndarray, "r"]]:
    """Weights of the picked columns, and the squared errors they leave.

    By least squares: seminormal equations, corrected once, which is as good as QR. Without factors, the steps are the weights.
    """
    weights = np.zeros(picks.steps.shape) if len(picks.factors) else picks.steps.copy()
    errors = np.zeros(len(rests))

    def work(piece: int) -> None:
        rows = slice(PIECE * piece, PIECE * (piece + 1))
        found = (picks.used[rows], picks.picks[rows], picks.factors[rows])
        _weigh_range(candidates.design, found, rests[rows], weights[rows], errors[rows])

    threads.each(work, -(-len(rests) // PIECE))
    return weights, errors


@kernel
def _choose_range(candidates, correlations, rule, limits, found):  # type: ignore[no-untyped-def]
    # every row; candidates: design (n, l), gram, squared norms; limits (r, 3): sum of squares, the one to reach, and rounding. Loops,
    # not slices: they compile ten times as fast.
    design, gram, before = candidates
    factor, scores = np.empty((1 if rule == MP else found[1].shape[1], len(before))), np.empty(len(before))
    for row in range(len(correlations)):
        out = (found[1][row], found[2][row], found[3][row], found[4][row])
        found[0][row] = _choose(design, gram, correlations[row], (rule, limits[row]), (before, factor, scores), out)


@inner_kernel
def _choose(design, gram, correlations, rule_limits, work, out):  # type: ignore[no-untyped-def]
    # Pivoted partial Cholesky of the Gram matrix. From candidates design (n, l), their inner products gram (l, l) or (0, 0) to
    # have them computed, and correlations (k, l) with the signal, overwritten; out come picks (m,), gains (m,), steps (m, k)
    # and the picks' own lower Cholesky factor (m, m), of which it fills as many as it returns. work: squared norms of the
    # candidates, and room for the rows of the factor (m, l) and for scores (l,).
    (rule, limits), (before, factor, scores), (picks, gains, steps, lower) = rule_limits, work, out
    sse, norms = limits[0], np.empty(len(before))  # squared, of what is left of each candidate beside the picks: of a pick, nothing
    for i in range(len(norms)):
        norms[i] = before[i]
    for m in range(len(picks)):
        if sse <= limits[1] or sse <= limits[2]:
            return m
        _score(correlations, norms, before, scores, rule)
        highest = _highest(scores)
        if highest <= 0:
            return m
        best = 0
        while scores[best] != highest:
            best += 1
        gain = highest if rule == OLS else highest / norms[best]
        if gain <= limits[2]:
            return m
        row, length = factor[0 if rule == MP else m], np.sqrt(norms[best])
        _inner(design, gram, best, row)
        if rule != MP:
            for j in range(m):
                lower[m, j] = factor[j, best]
            _subtract_rows(row, lower[m], factor, m)
        lower[m, m] = length
        for i in range(len(row)):
            row[i] *= 1 / length
        for j in range(len(correlations)):
            share = correlations[j, best] / length
            steps[m, j] = share / length
            _subtract(correlations[j], share, row)
        if rule != MP:
            for i in range(len(row)):
                norms[i] -= row[i] * row[i]
        picks[m], gains[m] = best, gain
        sse -= gain
    return len(picks)


@inner_kernel
def _score(correlations, norms, before, scores, rule):  # type: ignore[no-untyped-def]
    # by how much each candidate lowers the error (OLS), or how much it correlates; 0 for what is nearly spanned by the picks
    last = len(correlations) - 1
    for j in range(last):
        for i in range(len(norms)):
            scores[i] = correlations[j, i] * correlations[j, i] + (scores[i] if j else 0.0)
    for i in range(len(norms)):
        total = correlations[last, i] * correlations[last, i] + (scores[i] if last else 0.0)
        scores[i] = (total / norms[i] if rule == OLS else total) if norms[i] > LEAST_REMAINDER * before[i] else 0.0


@njit(cache=True, error_model="numpy", nogil=True, no_cfunc_wrapper=True, no_cpython_wrapper=True, fastmath={"nnan", "nsz", "reassoc"})
def _highest(scores):  # type: ignore[no-untyped-def]
    # the maximum, in any order: it is one of the values all the same
    highest = 0.0
    for i in range(len(scores)):
        highest = scores[i] if scores[i] > highest else highest
    return highest


@inner_kernel
def _subtract(target, factor, source):  # type: ignore[no-untyped-def]
    for i in range(len(target)):
        target[i] -= factor * source[i]


@inner_kernel
def _subtract_rows(target, factors, rows, count):  # type: ignore[no-untyped-def]
    # four at a time: the target is read and written a quarter as often
    whole = count - count % 4
    for j in range(0, whole, 4):
        a, b, c, d = factors[j], factors[j + 1], factors[j + 2], factors[j + 3]
        first, second, third, fourth = rows[j], rows[j + 1], rows[j + 2], rows[j + 3]
        for i in range(len(target)):
            target[i] -= a * first[i] + b * second[i] + c * third[i] + d * fourth[i]
    for j in range(whole, count):
        _subtract(target, factors[j], rows[j])


@inner_kernel
def _inner(design, gram, best, row):  # type: ignore[no-untyped-def]
    # inner products of the best candidate with all
    if len(gram):
        for i in range(len(row)):
            row[i] = gram[best, i]
    else:
        for i in range(len(row)):
            row[i] = 0.0
        for n in range(len(design)):
            _subtract(row, -design[n, best], design[n])


@kernel
def _weigh_range(design, found, rests, weights, errors):  # type: ignore[no-untyped-def]
    # twice w += (L L^T)^-1 D^T (y - D w), with D (n, m) the picked columns; then |y - D w|^2
    (used, picks, factors), (n, k) = found, rests.shape[1:]
    columns, left, step = np.empty((picks.shape[1], n)), np.empty((k, n)), np.empty(picks.shape[1])
    for row in range(len(used)):
        m, w = used[row], weights[row]
        for i in range(m):
            for x in range(n):
                columns[i, x] = design[x, picks[row, i]]
        for last in range(3):
            for j in range(k):
                for x in range(n):
                    left[j, x] = rests[row, x, j]
                for i in range(m):
                    _subtract(left[j], w[i, j], columns[i])
                if last < 2 and len(factors):
                    _solve(factors[row], columns, left[j], m, step)
                    for i in range(m):
                        w[i, j] += step[i]
        for j in range(k):
            for x in range(n):
                errors[row] += left[j, x] * left[j, x]


@inner_kernel
def _solve(lower, columns, left, m, step):  # type: ignore[no-untyped-def]
    # the first m of step = (L L^T)^-1 D^T left
    for i in range(m):
        total = 0.0
        for x in range(len(left)):
            total += columns[i, x] * left[x]
        for j in range(i):
            total -= lower[i, j] * step[j]
        step[i] = total / lower[i, i]
    for i in range(m - 1, -1, -1):
        for j in range(i + 1, m):
            step[i] -= lower[j, i] * step[j]
        step[i] /= lower[i, i]
