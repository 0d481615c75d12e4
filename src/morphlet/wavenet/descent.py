"""Steps of variable projection for one signal: least squares in the weights, Levenberg-Marquardt in centers and dilations.

Kernels. Samples (3, n) are positions in [0, 1], ascending, above the two affine columns; `kinds` (p,) and `theta` (2, p), centers and
logarithms of dilations, tell the wavelets, `tables` their mothers. `refine` puts signals into this form and measures what comes out.
"""

import numpy as np

from morphlet.numerics.compiled import inner_kernel, kernel, njit

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
ROUNDING = 1e-26
"""Share of the signal's sum of squares that is no more than rounding (an amplitude of 1e-13)."""


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
def descend(samples, tables, y, kinds, theta, steps):  # type: ignore[no-untyped-def]
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
def project(samples, tables, y, kinds, theta):  # type: ignore[no-untyped-def]
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
def best_candidate(Q, rest, values, offsets, first, inside):  # type: ignore[no-untyped-def]
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
