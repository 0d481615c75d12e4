"""Choose the best wavelets on the sphere for given data, by orthogonal least squares with sparse columns.

As `fit.fit` does with method "ols", with three differences. Samples count by the area they stand for. A wavelet of an odd
mother is turned about its center into the direction in which it gains most. And a large library is looked through in stages:
each chooses from the candidates that correlate most with what is left, so that only these need be kept beside the picks.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.numerics.compiled import njit
from morphlet.wavenet.fit import Reason
from morphlet.wavenet.library import LARGEST
from morphlet.wavenet.pursuit import LEAST_REMAINDER, ROUNDING
from morphlet.wavenet.spherical import Pairs, SphericalLibrary, SphericalNetwork, along, pairs, samples

SHORTLIST, PER_PICK = 4000, 8
"""Candidates of a stage: so many, or so many per pick. On a public mesh, 300 picks from 40k candidates so found fit as well as
those without stages, within 0.05 dB."""
FIRST_STAGE, GROWTH = 16, 2
"""Picks of the first stage; later ones add half of what there is."""
WIDENING = 4
"""How many times longer the list gets if no candidate on it gains anything."""
RANK_TOLERANCE = 1e-12
"""Share of the largest singular value at which 1, x, y and z count as dependent on the samples."""
CORRECTIONS = 2
"""Rounds of least squares on the residual after the first: one more changes weights by 3e-13 of the largest."""


@dataclass(frozen=True, eq=False)
class SphericalFit:
    """What a fit on the sphere chose, and what each choice gained.

    Parameters
    ----------
    network
        The wavelets in the order of their choice, with their weights.
    sse
        Mean over the area of the squared error, summed over the outputs: of the affine part alone and after each pick.
    reason
        Why it stopped: "count" (as many picks as asked), "tolerance" (error small enough), or "exhausted" (no candidate
        that is left lowers the error).
    """

    network: SphericalNetwork
    sse: Float[np.ndarray, "m1"]
    reason: Reason

    def __post_init__(self) -> None:
        object.__setattr__(self, "sse", _arrays.real(self.sse, "sse", (None,)))

    def __reduce__(self) -> tuple[Any, ...]:
        return SphericalFit, (self.network, np.array(self.sse), self.reason)


def fit_sphere(
    points: Float[np.ndarray, "n 3"],
    values: Float[np.ndarray, "n k"],
    areas: Float[np.ndarray, "n"],
    library: SphericalLibrary,
    n_wavelets: int,
    *,
    tolerance: float = 0.0,
) -> SphericalFit:
    """The network of a few wavelets of the library that follows the samples best; all outputs share the wavelets.

    Parameters
    ----------
    points
        Places of the samples on the sphere; their length is ignored.
    values
        Of k outputs there.
    areas
        What each sample stands for; a sample of area 0 does not count. Only their ratios matter.
    library
        Candidates; directional ones are turned.
    n_wavelets
        Most picks.
    tolerance
        Mean of the squared error at which to stop earlier.

    Returns
    -------
    SphericalFit
        With fewer wavelets than asked if no more can lower the error; `reason` tells.

    Raises
    ------
    InputError
        If values are not finite or beyond 1e150, shapes differ, areas are negative or all 0, or an option is out of range.

    Notes
    -----
    A pivoted partial Cholesky factorization of the candidates' inner products, as in `fit.fit`. A stage that starts with m
    picks and makes s more from T candidates costs O(T m^2 + T s m); it keeps T m numbers. Beside that there are the values
    of all candidates, once, and their correlations with the residual once per stage. Weights are corrected until they solve
    the least squares problem (corrected seminormal equations [1]_).

    References
    ----------
    .. [1] A. Bjorck, "Stability analysis of the method of seminormal equations for linear least squares problems", Linear
       Algebra and its Applications 88/89 (1987).

    Examples
    --------
    >>> from morphlet.numerics.unit_sphere import fibonacci
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> from morphlet.wavenet.spherical import spherical_library
    >>> from morphlet.wavenet.spherical_fit import fit_sphere
    >>> points, areas = fibonacci(1000), np.ones(1000)
    >>> bump = np.exp(-20 * ((points - [0.6, 0.0, 0.8]) ** 2).sum(axis=1, keepdims=True))
    >>> library = spherical_library([MOTHERS["beta2"], MOTHERS["beta1"]], points, areas, levels=3)
    >>> found = fit_sphere(points, bump, areas, library, 12)
    >>> found.network, found.reason, bool(found.sse[-1] < 1e-3 * found.sse[0])
    (SphericalNetwork(12 wavelets, 1 outputs), 'count', True)
    """
    points, areas = samples(points, areas)
    y = _arrays.real(values, "values", (len(points), None))
    _require(y, n_wavelets, tolerance)
    problem = _prepare(points, y, np.sqrt(areas), library)
    limits = np.array([tolerance, ROUNDING * float((problem.y**2).sum())])
    chosen, solution = _pursue(problem, min(n_wavelets, len(points)), limits)
    left = float((solution.rest**2).sum())
    sse = left + np.append(np.cumsum(chosen.gains[::-1])[::-1], 0)  # backwards: small errors keep their digits
    reason: Reason = "tolerance" if tolerance > 0 and left <= tolerance else "count" if len(chosen.leads) == n_wavelets else "exhausted"
    return SphericalFit(_network(library, problem, chosen, solution.weights), sse, reason)


def _require(y: Float[np.ndarray, "n k"], n_wavelets: int, tolerance: float) -> None:
    """Refuse what has no squares, and options out of range."""
    if np.abs(y).max(initial=0) > LARGEST:
        raise InputError(f"values up to {LARGEST:g}", f"{np.abs(y).max():g}", "change the unit: squares must not overflow")
    if n_wavelets < 0 or not 0 <= tolerance < np.inf:
        found = f"n_wavelets {n_wavelets}, tolerance {tolerance}"
        raise InputError("n_wavelets >= 0 and a finite tolerance >= 0", found, "ask for 500 wavelets and tolerance 0, for instance")


@dataclass(frozen=True, eq=False)
class _Problem:
    """Samples times the root of their areas; the affine part as orthonormal columns `basis`, of which `back` gives the
    coefficients of 1, x, y, z; the candidates as rows of a sparse matrix, those of odd mothers as two.

    `leads` are the first rows of the candidates, `widths` how many they have, `owners` which of the library they are; `squares`
    are the squared norms of all rows, `parts` their products with the basis.
    """

    y: Float[np.ndarray, "n k"]
    basis: Float[np.ndarray, "n a"]
    back: Float[np.ndarray, "4 a"]
    rows: sp.csr_matrix
    leads: Int[np.ndarray, "l"]
    widths: Int[np.ndarray, "l"]
    owners: Int[np.ndarray, "l"]
    squares: Float[np.ndarray, "c"]
    parts: Float[np.ndarray, "c a"]


@dataclass(frozen=True, eq=False)
class _Chosen:
    """Picks by their place among the candidates, with how they are turned, what they gained, their rows, and the Cholesky
    factor (lower) of the inner products of the basis and them."""

    leads: Int[np.ndarray, "m"]
    turns: Float[np.ndarray, "m 2"]
    gains: Float[np.ndarray, "m"]
    rows: sp.csr_matrix
    factor: Float[np.ndarray, "b b"]


@dataclass(frozen=True, eq=False)
class _Solution:
    """Weights of the basis and of the picks, and what they leave."""

    weights: Float[np.ndarray, "b k"]
    rest: Float[np.ndarray, "n k"]


def _prepare(
    points: Float[np.ndarray, "n 3"], y: Float[np.ndarray, "n k"], root: Float[np.ndarray, "n"], library: SphericalLibrary
) -> _Problem:
    """Everything that no pick changes."""
    columns = np.column_stack([np.ones(len(points)), points]) * root[:, None]
    U, sizes, V = np.linalg.svd(columns, full_matrices=False)
    kept = sizes > RANK_TOLERANCE * sizes[0]
    basis, back = np.ascontiguousarray(U[:, kept]), V[kept].T / sizes[kept]
    blocks, owners = [], []
    for of in pairs(library, points):
        if len(of.s):
            block, present = _block(library, points, root, of)
            blocks.append(block)
            owners.append(present)
    rows = sp.vstack(blocks, format="csr") if blocks else sp.csr_matrix((0, len(points)))
    widths = np.concatenate([np.zeros(0, np.int64), *(np.full(len(o), b.shape[0] // len(o)) for o, b in zip(owners, blocks, strict=True))])
    squares = np.concatenate([np.zeros(0), *(np.asarray(block.multiply(block).sum(axis=1)).ravel() for block in blocks)])
    leads = np.cumsum(widths) - widths
    return _Problem(
        y * root[:, None], basis, back, rows, leads, widths, np.concatenate([np.zeros(0, np.int64), *owners]), squares, rows @ basis
    )


def _block(library: SphericalLibrary, points: np.ndarray, root: np.ndarray, of: Pairs) -> tuple[sp.csr_matrix, Int[np.ndarray, "c"]]:
    """The candidates of one group as rows, two for each odd one, and which of the library they are."""
    present = np.flatnonzero(np.bincount(of.wavelets, minlength=len(library)))
    place = np.empty(len(library), np.int32)
    place[present] = np.arange(len(present))
    height, columns = of.profile.values(of.s) * root[of.points], of.points.astype(np.int32)
    first = sp.csr_matrix((height * along(library, points, of), (place[of.wavelets], columns)), shape=(len(present), len(points)))
    if library.mothers[library.kinds[present[0]]].parity == "even":
        return first, present
    across = np.cross(library.centers[present], library.directions[present])[place[of.wavelets]]
    height *= np.einsum("qc,qc->q", points[of.points], across) / library.dilations[of.wavelets]
    second = sp.csr_matrix((height, (place[of.wavelets], columns)), shape=first.shape)
    order = np.arange(2 * len(present)).reshape(2, -1).T.ravel()
    return sp.vstack([first, second], format="csr")[order], present


def _pursue(problem: _Problem, most: int, limits: Float[np.ndarray, "2"]) -> tuple[_Chosen, _Solution]:
    """Stage by stage, until there are enough picks or none gains anything."""
    a, k = problem.basis.shape[1], problem.y.shape[1]
    chosen = _Chosen(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros(0), sp.csr_matrix((0, len(problem.y))), np.eye(a))
    solution = _solved(problem, chosen, np.zeros((0, k)))
    length, whole = 0, len(problem.leads)
    while len(chosen.leads) < most:
        m = len(chosen.leads)
        step = most - m if whole <= SHORTLIST else min(most - m, max(FIRST_STAGE, m // GROWTH))
        length = min(whole, max(length, SHORTLIST, PER_PICK * step))
        listed = _shortlist(problem, chosen, solution.rest, length)
        after = _stage(problem, chosen, solution.rest, listed, step, limits)
        if len(after.leads) > m:
            chosen, length = after, 0
            solution = _solved(problem, chosen, solution.weights)
        elif length == whole or (solution.rest**2).sum() <= limits.max():
            break
        else:
            length *= WIDENING
    return chosen, solution


def _solved(problem: _Problem, chosen: _Chosen, start: Float[np.ndarray, "s k"]) -> _Solution:
    """Least squares on the basis and the picks, from weights that may lack the last picks."""
    a = problem.basis.shape[1]
    weights = np.vstack([start, np.zeros((a + len(chosen.leads) - len(start), problem.y.shape[1]))])
    rest = problem.y - problem.basis @ weights[:a] - chosen.rows.T @ weights[a:]
    for _ in range(1 + CORRECTIONS):
        right = np.vstack([problem.basis.T @ rest, chosen.rows @ rest])
        half = solve_triangular(chosen.factor, right, lower=True)
        weights = weights + solve_triangular(chosen.factor, half, lower=True, trans=1)
        rest = problem.y - problem.basis @ weights[:a] - chosen.rows.T @ weights[a:]
    return _Solution(weights, rest)


def _shortlist(problem: _Problem, chosen: _Chosen, rest: Float[np.ndarray, "n k"], length: int) -> Int[np.ndarray, "t"]:
    """The candidates that would gain most if there were no picks: those of one row first, then those of two."""
    remainder = problem.squares - (problem.parts**2).sum(axis=1)
    alive = remainder > LEAST_REMAINDER * problem.squares
    correlations = (problem.rows @ rest) * np.where(alive, 1 / np.sqrt(np.where(alive, remainder, 1)), 0)[:, None]
    scores = np.zeros(len(problem.leads))
    one, two = problem.leads[problem.widths == 1], problem.leads[problem.widths == 2]
    scores[problem.widths == 1] = (correlations[one] ** 2).sum(axis=1)
    p, q = correlations[two], correlations[two + 1]
    mean, spread = ((p**2) + (q**2)).sum(axis=1) / 2, ((p**2) - (q**2)).sum(axis=1) / 2
    scores[problem.widths == 2] = mean + np.hypot(spread, (p * q).sum(axis=1))  # in the best direction
    scores[np.bincount(chosen.leads, minlength=len(scores)) >= problem.widths] = 0
    best = np.argsort(-scores, kind="stable")[:length]
    best = best[scores[best] > 0]
    return best[np.argsort(problem.widths[best], kind="stable")]


def _stage(
    problem: _Problem,
    chosen: _Chosen,
    rest: Float[np.ndarray, "n k"],
    listed: Int[np.ndarray, "t"],
    step: int,
    limits: Float[np.ndarray, "2"],
) -> _Chosen:
    """A few more picks among those listed."""
    leads, widths = problem.leads[listed], problem.widths[listed]
    columns = np.repeat(leads, widths) + (np.arange(widths.sum()) - np.repeat(np.cumsum(widths) - widths, widths))
    rows, single, known = problem.rows[columns], int((widths == 1).sum()), len(chosen.factor)
    factor = np.zeros((known + step, len(columns)))
    factor[:known] = solve_triangular(chosen.factor, np.vstack([problem.parts[columns].T, (chosen.rows @ rows.T).toarray()]), lower=True)
    before = problem.squares[columns]
    first, second = np.arange(single, len(columns), 2), np.arange(single + 1, len(columns), 2)
    cross = np.asarray(rows[first].multiply(rows[second]).sum(axis=1)).ravel()
    cross -= (factor[:known, first] * factor[:known, second]).sum(axis=0)
    remainder = np.stack([before - (factor[:known] ** 2).sum(axis=0), before])
    picks, turns, gains = np.zeros(step, np.int64), np.zeros((step, 2)), np.zeros(step)
    by_sample, sse = rows.tocsc(), float((rest**2).sum())
    used = _choose(
        (rows.indptr, rows.indices, rows.data), (by_sample.indptr, by_sample.indices, by_sample.data), factor,
        remainder, cross, np.ascontiguousarray((rows @ rest).T), sse, limits, picks, turns, gains,
    )  # fmt: skip
    return _extended(chosen, rows, factor, listed, _Picks(picks[:used], turns[:used], gains[:used], single))


@dataclass(frozen=True, eq=False)
class _Picks:
    """What a stage picked: columns of its factor, of which the first `single` stand alone."""

    columns: Int[np.ndarray, "u"]
    turns: Float[np.ndarray, "u 2"]
    gains: Float[np.ndarray, "u"]
    single: int


def _extended(chosen: _Chosen, rows: sp.csr_matrix, factor: Float[np.ndarray, "f c"], listed: Int[np.ndarray, "t"], new: _Picks) -> _Chosen:
    """The picks of a stage behind those before."""
    used, known = len(new.columns), len(chosen.factor)
    alone = new.columns < new.single
    other = np.where(alone, new.columns, new.columns + 1)
    turned = sp.diags(new.turns[:, 0]) @ rows[new.columns] + sp.diags(new.turns[:, 1]) @ rows[other]
    whole = np.zeros((known + used, known + used))
    whole[:known, :known] = chosen.factor
    below = factor[: known + used, new.columns] * new.turns[:, 0] + factor[: known + used, other] * new.turns[:, 1]
    whole[known:] = np.tril(below.T, known)
    place = np.where(alone, new.columns, new.single + (new.columns - new.single) // 2)
    return _Chosen(
        np.append(chosen.leads, listed[place]), np.vstack([chosen.turns, new.turns]), np.append(chosen.gains, new.gains),
        sp.vstack([chosen.rows, turned], format="csr"), whole,
    )  # fmt: skip


def _network(library: SphericalLibrary, problem: _Problem, chosen: _Chosen, weights: Float[np.ndarray, "b k"]) -> SphericalNetwork:
    """The picks as a network."""
    a, of = problem.basis.shape[1], problem.owners[chosen.leads]
    along, across = library.directions[of], np.cross(library.centers[of], library.directions[of])
    directions = chosen.turns[:, :1] * along + chosen.turns[:, 1:] * across
    affine = problem.back @ weights[:a]
    return SphericalNetwork(library.mothers, library.kinds[of], library.centers[of], directions, library.dilations[of], weights[a:], affine)


@njit(cache=True, error_model="numpy")
def _choose(rows, samples, factor, remainder, cross, correlations, sse, limits, picks, turns, gains):  # type: ignore[no-untyped-def]
    # Pivoted partial Cholesky. The columns (c) of the stage come by column and by sample, each as (starts, places, values) of
    # a compressed matrix; factor (known + step, c) holds the rows of the picks before, the rest is filled; remainder (2, c):
    # squared norm of each column beside all picks, overwritten, and on its own; cross (c2,): inner products of the columns
    # that stand in twos at the end, overwritten, as are correlations (k, c) with the signal. Out come picks (step,), the first
    # column of each; turns (step, 2), its combination with the second; gains (step,). Returns how many.
    (starts, places, values), (s_starts, s_places, s_values) = rows, samples
    (step,), (k, size) = picks.shape, correlations.shape
    known, single, norms, before = len(factor) - step, size - 2 * len(cross), remainder[0], remainder[1]
    for m in range(step):
        if sse <= limits[0] or sse <= limits[1]:
            return m
        best, gain, length, u, v = -1, 0.0, 1.0, 1.0, 0.0
        for i in range(single):
            if norms[i] > LEAST_REMAINDER * before[i]:
                score = 0.0
                for j in range(k):
                    score += correlations[j, i] ** 2
                score /= norms[i]
                if score > gain:
                    best, gain, length = i, score, norms[i]
        for i in range(single, size, 2):
            a, b, x = norms[i], norms[i + 1], cross[(i - single) // 2]
            large = (a + b) / 2 + np.sqrt((a - b) ** 2 / 4 + x * x)
            floor = LEAST_REMAINDER * max(before[i], before[i + 1])
            if large <= floor:
                continue
            p = q = r = 0.0  # sums of squares and products of the correlations
            for j in range(k):
                p += correlations[j, i] ** 2
                q += correlations[j, i + 1] ** 2
                r += correlations[j, i] * correlations[j, i + 1]
            small = a + b - large
            if small > floor:  # the best direction, an eigenvector of the pencil
                area = a * b - x * x
                half = (b * p - 2 * x * r + a * q) / (2 * area)
                score = half + np.sqrt(max(half * half - (p * q - r * r) / area, 0.0))
                if score <= gain:
                    continue
                s, t = x * score - r, p - a * score
                if abs(q - b * score) > abs(t):
                    s, t = q - b * score, x * score - r
            elif a >= b:  # one direction is left
                s, t = large - b, x
            else:
                s, t = x, large - a
            reach = np.sqrt(s * s + t * t)
            s, t = (s / reach, t / reach) if reach > 0 else (1.0, 0.0)
            square = s * s * a + 2 * s * t * x + t * t * b
            score = (s * s * p + 2 * s * t * r + t * t * q) / square
            if score > gain:
                best, gain, length, u, v = i, score, square, s, t
        if best < 0 or gain <= limits[1]:
            return m
        if best < single:
            u, v = 1.0, 0.0
        row = factor[known + m]
        row[:] = 0.0
        for side in range(1 if best < single else 2):
            turn = u if side == 0 else v
            for e in range(starts[best + side], starts[best + side + 1]):
                n, share = places[e], turn * values[e]
                for f in range(s_starts[n], s_starts[n + 1]):
                    row[s_places[f]] += share * s_values[f]
        other = best if best < single else best + 1
        for j in range(known + m):
            share = u * factor[j, best] + v * factor[j, other]
            for i in range(size):
                row[i] -= share * factor[j, i]
        root = np.sqrt(length)
        for i in range(size):
            row[i] /= root
        for j in range(k):
            share = (u * correlations[j, best] + v * correlations[j, other]) / root
            for i in range(size):
                correlations[j, i] -= share * row[i]
        for i in range(size):
            norms[i] -= row[i] ** 2
        for i in range(single, size, 2):
            cross[(i - single) // 2] -= row[i] * row[i + 1]
        if best < single:
            norms[best] = 0.0
        picks[m], turns[m, 0], turns[m, 1], gains[m] = best, u, v, gain
        sse -= gain
    return step
