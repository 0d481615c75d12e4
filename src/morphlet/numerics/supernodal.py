"""Sparse Cholesky by dense blocks: the multifrontal method on supernodes.

The panel of supernode s has its c columns and its f = c + r rows, column by column; the r x r update that it leaves behind is
added into its parent's panel and update. Subtrees far apart are factored on several threads; each block is computed by the same
operations in the same order on any number of them, so the bits agree. What the pattern alone decides is found by `elimination`.
Arrays only, checked by `linalg`.
"""

from functools import partial
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from morphlet.numerics import threads
from morphlet.numerics.compiled import OPTIONS, inner_kernel, kernel, njit
from morphlet.numerics.elimination import Symbolic, from_counts

WIDTH = 8
"""Columns subtracted at a time: more would not fit the registers, fewer would load the target too often."""

LANES = 8
"""Rows of an inverted panel are padded to multiples of it: half of the widest vector register, all of the usual one."""

FASTMATH = {"reassoc", "contract", "nsz"}
"""Sums may be reordered to use vector registers; NaN and infinities keep their meaning."""


fast_kernel = njit(**OPTIONS, no_cpython_wrapper=True, fastmath=FASTMATH)
"""Inner kernels of long sums."""


def factor(plan: Symbolic, values: Float[np.ndarray, "z"]) -> tuple[Float[np.ndarray, "p"], int]:
    """The panels, and the unknown of the first pivot that is not positive, -1 if all are."""
    panels = np.zeros(plan.tree.panel[-1])
    panels[plan.targets] = values
    run = partial(_factor, plan.tree, (panels, np.empty(plan.workspace)))
    *apart, top = plan.groups
    failures = [f for f in threads.each(lambda k: run(apart[k]), len(apart)) if f >= 0] or [run(top)]
    return panels, int(plan.order[min(failures)]) if min(failures) >= 0 else -1


class Projection(NamedTuple):
    """What a matrix that became stiffer in a few unknowns takes out of half-solved right-hand sides.

    Of ``z = L^-1 b`` it takes ``Q Q' z``, in some rows alone: with the rest, L' gives the answer of the stiffer matrix.
    """

    rows: Int[np.ndarray, "m"]  # ascending, in elimination order
    basis: Float[np.ndarray, "k m"]  # Q, column by column; column j is zero above row j
    single: Float32[np.ndarray, "q"]  # the same in single precision, rows padded to whole `LANES`


NOTHING = Projection(np.zeros(0, np.int64), np.zeros((0, 0)), np.zeros(0, np.float32))
"""The matrix as it was factored."""


def solve(plan: Symbolic, panels: Float[np.ndarray, "p"], projection: Projection, b: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
    """The solution of A x = b from the panels of A."""
    x = np.ascontiguousarray(b[plan.order].T)
    forward(plan.tree, panels, np.zeros(len(x), np.int64), x)
    if len(projection.rows):
        half = x[:, projection.rows]
        x[:, projection.rows] = half - np.einsum("ck,km->cm", np.einsum("cm,km->ck", half, projection.basis), projection.basis)
    _backwards(plan.tree, panels, x)
    answer = np.empty(b.shape)
    answer[plan.order] = x.T
    return answer


class Inverse(NamedTuple):
    """The panels with their diagonal blocks inverted, in single precision: a solve becomes two products per supernode.

    Panel ``[D; B]`` becomes ``[D^-1; -B D^-1]``, its rows padded to whole `LANES`: down, its product with the supernode's values
    is what they become, and what later rows receive; up, the transposed product is the answer.
    """

    start: Int[np.ndarray, "s+1"]
    panels: Float32[np.ndarray, "p"]


def inverse(plan: Symbolic, panels: Float[np.ndarray, "p"]) -> Inverse:
    """From the panels of a factor; as many operations as a tenth of the factorization's."""
    columns, below = np.diff(plan.tree.first), np.diff(plan.tree.row_start)
    start = from_counts(columns * padded(columns + below))
    inverted = np.zeros(start[-1])
    _invert(plan.tree, panels, start, inverted)
    return Inverse(start, inverted.astype(np.float32))


def solve_singly(plan: Symbolic, inverted: Inverse, projection: Projection, b: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Roughly the solution of A x = b, rows of b and x in elimination order."""
    rows = np.append(np.diff(plan.tree.first) + np.diff(plan.tree.row_start), len(projection.rows))
    x, work = b.astype(np.float32), np.zeros((6, padded(rows).max()), np.float32)
    _multiply_down(plan.tree, inverted, x, work)
    if len(projection.rows):
        _project(projection.rows, projection.single, x, work)
    _multiply_up(plan.tree, inverted, x, work)
    return x.astype(np.float64)


def padded(rows: Int[np.ndarray, "s"]) -> Int[np.ndarray, "s"]:
    """Rows rounded up to whole vector registers."""
    return (rows + LANES - 1) // LANES * LANES


@kernel
def _factor(tree, blocks, chosen):  # type: ignore[no-untyped-def]
    """Factor the chosen supernodes, children before parents; the first column whose pivot is not positive, -1 if there is none."""
    panels, updates = blocks
    for s in chosen:
        c, r = tree.first[s + 1] - tree.first[s], tree.row_start[s + 1] - tree.row_start[s]
        for q in range(tree.update[s], tree.update[s] + r * r):
            updates[q] = 0.0
        for k in range(tree.child_start[s], tree.child_start[s + 1]):
            _extend(tree, panels, updates, (tree.children[k], s))
        failed = _eliminate(panels, updates, (tree.panel[s], tree.update[s]), c, r)
        if failed >= 0:
            return tree.first[s] + failed
    return -1


@inner_kernel
def _extend(tree, panels, updates, family):  # type: ignore[no-untyped-def]
    """Add the update of a child into the panel and the update of its parent."""
    child, s = family
    begin = tree.row_start[child]
    m, source = tree.row_start[child + 1] - begin, np.uintp(tree.update[child])
    c, r = tree.first[s + 1] - tree.first[s], tree.row_start[s + 1] - tree.row_start[s]
    place = tree.relative[begin : begin + m]
    for j in range(m):
        if place[j] < c:
            column = tree.panel[s] + place[j] * (c + r)
            for i in range(np.uintp(j), np.uintp(m)):
                panels[np.uintp(column + place[i])] += updates[source + i]
        else:
            column = tree.update[s] + (place[j] - c) * r - c
            for i in range(np.uintp(j), np.uintp(m)):
                updates[np.uintp(column + place[i])] += updates[source + i]
        source += np.uintp(m)


@inner_kernel
def _eliminate(panels, updates, starts, c, r):  # type: ignore[no-untyped-def]
    """Cholesky of the panel and of its update; the first column whose pivot is not positive, or -1."""
    panel, update = starts
    failed = triangulate(panels, panel, c, c + r)
    for k in range(0, c if failed < 0 else 0, WIDTH):
        for j in range(r):
            columns = (c + r, min(WIDTH, c - k))
            subtract(panels, panel + k * (c + r) + c + j, columns, updates, (update + j * r + j, r - j))
    return failed


@inner_kernel
def triangulate(panels, panel, c, f):  # type: ignore[no-untyped-def]
    """Cholesky of a panel of c columns and f rows, WIDTH columns at a time; the first column whose pivot is not positive, or -1."""
    for k in range(0, c, WIDTH):
        end = min(k + WIDTH, c)
        for j in range(k, end):
            at = panel + j * f + j
            subtract(panels, panel + k * f + j, (f, j - k), panels, (at, f - j))
            if not panels[at] > 0.0:
                return j
            _divide_column(panels, at, f - j)
        for j in range(end, c):
            subtract(panels, panel + k * f + j, (f, end - k), panels, (panel + j * f + j, f - j))
    return -1


@inner_kernel
def _divide_column(panels, at, length):  # type: ignore[no-untyped-def]
    """A column of the factor from its pivot down."""
    root, a = np.sqrt(panels[at]), np.uintp(at)
    inverse = 1.0 / root
    for i in range(np.uintp(length)):
        panels[a + i] *= inverse
    panels[a] = root


@fast_kernel
def subtract(source, at, shape, target, span):  # type: ignore[no-untyped-def]
    """From a column of the target, columns of the source (their distance and number: `shape`) times their first entries."""
    step, count = shape
    to, length = span
    a, t, s = np.uintp(at), np.uintp(to), np.uintp(step)
    if count == WIDTH:
        b, c, d = a + s, a + s + s, a + s + s + s
        e = d + s
        f, g, h = e + s, e + s + s, e + s + s + s
        p0, p1, p2, p3, p4, p5, p6, p7 = source[a], source[b], source[c], source[d], source[e], source[f], source[g], source[h]
        for i in range(np.uintp(length)):
            low = source[a + i] * p0 + source[b + i] * p1 + source[c + i] * p2 + source[d + i] * p3
            target[t + i] -= low + source[e + i] * p4 + source[f + i] * p5 + source[g + i] * p6 + source[h + i] * p7
        return
    for k in range(0, count, 2):
        p, q = source[a], 0.0
        b = a
        if k + 1 < count:
            b = a + s
            q = source[b]
        for i in range(np.uintp(length)):
            target[t + i] -= source[a + i] * p + source[b + i] * q
        a = b + s


@kernel
def forward(tree, panels, start, x):  # type: ignore[no-untyped-def]
    """Solve L y = x in place, row by row of x (k, n); row k of x is zero before supernode start[k]."""
    work = np.empty(tree.first[-1])
    for s in range(len(tree.first) - 1):
        for k in range(len(x)):
            if start[k] <= s:
                _forward(tree, panels, s, x[k], work)


@kernel
def _backwards(tree, panels, x):  # type: ignore[no-untyped-def]
    """Solve L' y = x in place, row by row of x."""
    work = np.empty(tree.first[-1])
    for s in range(len(tree.first) - 2, -1, -1):
        for k in range(len(x)):
            _backward(tree, panels, s, x[k], work)


@fast_kernel
def _forward(tree, panels, s, y, work):  # type: ignore[no-untyped-def]
    """Eliminate the columns of supernode s from y; its columns end in `work`."""
    first, begin = tree.first[s], tree.row_start[s]
    c, r = np.uintp(tree.first[s + 1] - first), np.uintp(tree.row_start[s + 1] - begin)
    for i in range(c):
        work[i] = y[np.uintp(first) + i]
    for i in range(c, c + r):
        work[i] = 0.0
    column = np.uintp(tree.panel[s])
    for j in range(c):
        v = work[j] / panels[column + j]
        y[np.uintp(first) + j] = v
        for i in range(j + np.uintp(1), c + r):
            work[i] -= panels[column + i] * v
        column += c + r
    for i in range(r):
        y[tree.rows[np.uintp(begin) + i]] += work[c + i]


@fast_kernel
def _backward(tree, panels, s, y, work):  # type: ignore[no-untyped-def]
    """Solve for the unknowns of supernode s from those after it."""
    first, begin = np.uintp(tree.first[s]), np.uintp(tree.row_start[s])
    c, r = np.uintp(tree.first[s + 1] - tree.first[s]), np.uintp(tree.row_start[s + 1] - tree.row_start[s])
    for i in range(r):
        work[c + i] = y[tree.rows[begin + i]]
    for j in range(c):
        work[j] = y[first + j]
    column = np.uintp(tree.panel[s])
    column += c * (c + r)
    for k in range(np.uintp(1), c + np.uintp(1)):
        at = c - k
        column -= c + r
        v = work[at]
        for i in range(at + np.uintp(1), c + r):
            v -= panels[column + i] * work[i]
        v /= panels[column + at]
        work[at] = v
        y[first + at] = v


@kernel
def _invert(tree, panels, start, inverted):  # type: ignore[no-untyped-def]
    """Write the inverted panels; `inverted` is zero before."""
    for s in range(len(start) - 1):
        c, r = tree.first[s + 1] - tree.first[s], tree.row_start[s + 1] - tree.row_start[s]
        if c > 0:
            _invert_panel(panels, tree.panel[s], (c, c + r), inverted, start[s])


@fast_kernel
def _invert_panel(panels, panel, shape, inverted, to):  # type: ignore[no-untyped-def]
    """Columns from the last to the first: each is its own, less the later ones as often as it has their rows."""
    c, f = shape
    g = (f + LANES - 1) // LANES * LANES
    for j in range(c - 1, -1, -1):
        column, at = panel + j * f, to + j * g
        inverse = 1.0 / panels[column + j]
        for i in range(np.uintp(c), np.uintp(f)):
            inverted[np.uintp(at) + i] = -panels[np.uintp(column) + i] * inverse
        inverted[at + j] = inverse
        for k in range(j + 1, c):
            share, other = panels[column + k] * inverse, np.uintp(to + k * g)
            for i in range(np.uintp(k), np.uintp(f)):
                inverted[np.uintp(at) + i] -= inverted[other + i] * share


@kernel
def _multiply_down(tree, inverse, x, work):  # type: ignore[no-untyped-def]
    """Half-solve in place for x (n, 3); work (6, padded rows of the largest panel): values of the columns, and of all rows."""
    columns, rows = work[:3], work[3:]
    for s in range(len(tree.first) - 1):
        first, begin = np.uintp(tree.first[s]), np.uintp(tree.row_start[s])
        c, r = np.uintp(tree.first[s + 1]) - first, np.uintp(tree.row_start[s + 1]) - begin
        for k in range(np.uintp(3)):
            for i in range(c):
                columns[k, i] = x[first + i, k]
            for i in range((c + r + np.uintp(LANES - 1)) // np.uintp(LANES) * np.uintp(LANES)):
                rows[k, i] = 0.0
        _down(inverse.panels, inverse.start[s], (c, c + r), columns, rows)
        for k in range(np.uintp(3)):
            for i in range(c):
                x[first + i, k] = rows[k, i]
        for i in range(r):
            row = np.uintp(tree.rows[begin + i])
            for k in range(np.uintp(3)):
                x[row, k] += rows[k, c + i]


@kernel
def _project(chosen, basis, x, work):  # type: ignore[no-untyped-def]
    """Take from the chosen rows of x (n, 3) their part in the basis, as long as a panel of these rows."""
    columns, rows, f = work[:3], work[3:], np.uintp(len(chosen))
    g = (f + np.uintp(LANES - 1)) // np.uintp(LANES) * np.uintp(LANES)
    c = np.uintp(len(basis)) // g
    for k in range(np.uintp(3)):
        for i in range(f):
            rows[k, i] = x[chosen[i], k]
        for i in range(f, g):
            rows[k, i] = 0.0
    start = np.int64(0)  # a literal would compile both once more
    _up(basis, start, (c, f), columns, rows)
    for k in range(np.uintp(3)):
        for i in range(g):
            rows[k, i] = 0.0
    _down(basis, start, (c, f), columns, rows)
    for i in range(f):
        for k in range(np.uintp(3)):
            x[chosen[i], k] -= rows[k, i]


@kernel
def _multiply_up(tree, inverse, x, work):  # type: ignore[no-untyped-def]
    """The other half."""
    columns, rows = work[:3], work[3:]
    for s in range(len(tree.first) - 2, -1, -1):
        first, begin = np.uintp(tree.first[s]), np.uintp(tree.row_start[s])
        c, r = np.uintp(tree.first[s + 1]) - first, np.uintp(tree.row_start[s + 1]) - begin
        for k in range(np.uintp(3)):
            for i in range(c):
                rows[k, i] = x[first + i, k]
            for i in range(c + r, (c + r + np.uintp(LANES - 1)) // np.uintp(LANES) * np.uintp(LANES)):
                rows[k, i] = 0.0
        for i in range(r):
            row = np.uintp(tree.rows[begin + i])
            for k in range(np.uintp(3)):
                rows[k, c + i] = x[row, k]
        _up(inverse.panels, inverse.start[s], (c, c + r), columns, rows)
        for k in range(np.uintp(3)):
            for i in range(c):
                x[first + i, k] = columns[k, i]


@fast_kernel
def _down(panels, start, shape, columns, rows):  # type: ignore[no-untyped-def]
    """rows (3, g) += P columns (3, c), four columns of the panel at a time; above its diagonal block a column is zero."""
    c, f = shape
    lanes, one = np.uintp(LANES), np.uintp(1)
    g = (f + lanes - one) // lanes * lanes
    r0, r1, r2 = rows[0], rows[1], rows[2]
    j, p = np.uintp(0), np.uintp(start)
    while j + np.uintp(4) <= c:
        q, r, s = p + g, p + g + g, p + g + g + g
        k, l, m = j + one, j + one + one, j + one + one + one
        a0, a1, a2, a3 = columns[0, j], columns[0, k], columns[0, l], columns[0, m]
        b0, b1, b2, b3 = columns[1, j], columns[1, k], columns[1, l], columns[1, m]
        c0, c1, c2, c3 = columns[2, j], columns[2, k], columns[2, l], columns[2, m]
        for i in range(j // lanes * lanes, g):
            e0, e1, e2, e3 = panels[p + i], panels[q + i], panels[r + i], panels[s + i]
            r0[i] += e0 * a0 + e1 * a1 + e2 * a2 + e3 * a3
            r1[i] += e0 * b0 + e1 * b1 + e2 * b2 + e3 * b3
            r2[i] += e0 * c0 + e1 * c1 + e2 * c2 + e3 * c3
        j, p = m + one, s + g
    while j < c:
        a0, b0, c0 = columns[0, j], columns[1, j], columns[2, j]
        for i in range(j // lanes * lanes, g):
            e0 = panels[p + i]
            r0[i] += e0 * a0
            r1[i] += e0 * b0
            r2[i] += e0 * c0
        j, p = j + one, p + g


@fast_kernel
def _up(panels, start, shape, columns, rows):  # type: ignore[no-untyped-def]
    """columns (3, c) = P' rows (3, g), four columns of the panel at a time."""
    c, f = shape
    lanes, one = np.uintp(LANES), np.uintp(1)
    g = (f + lanes - one) // lanes * lanes
    r0, r1, r2 = rows[0], rows[1], rows[2]
    j, p = np.uintp(0), np.uintp(start)
    while j + np.uintp(4) <= c:
        q, r, s = p + g, p + g + g, p + g + g + g
        a0 = a1 = a2 = a3 = b0 = b1 = b2 = b3 = c0 = c1 = c2 = c3 = np.float32(0.0)
        for i in range(j // lanes * lanes, g):
            e0, e1, e2, e3 = panels[p + i], panels[q + i], panels[r + i], panels[s + i]
            x, y, z = r0[i], r1[i], r2[i]
            a0, a1, a2, a3 = a0 + e0 * x, a1 + e1 * x, a2 + e2 * x, a3 + e3 * x
            b0, b1, b2, b3 = b0 + e0 * y, b1 + e1 * y, b2 + e2 * y, b3 + e3 * y
            c0, c1, c2, c3 = c0 + e0 * z, c1 + e1 * z, c2 + e2 * z, c3 + e3 * z
        k, l, m = j + one, j + one + one, j + one + one + one
        columns[0, j], columns[0, k], columns[0, l], columns[0, m] = a0, a1, a2, a3
        columns[1, j], columns[1, k], columns[1, l], columns[1, m] = b0, b1, b2, b3
        columns[2, j], columns[2, k], columns[2, l], columns[2, m] = c0, c1, c2, c3
        j, p = m + one, s + g
    while j < c:
        a0 = b0 = c0 = np.float32(0.0)
        for i in range(j // lanes * lanes, g):
            e0 = panels[p + i]
            a0, b0, c0 = a0 + e0 * r0[i], b0 + e0 * r1[i], c0 + e0 * r2[i]
        columns[0, j], columns[1, j], columns[2, j] = a0, b0, c0
        j, p = j + one, p + g
