"""One pose of a mesh in symbols: each vertex predicted by the motion of the ring around it, the difference coded.

The ring is known in the reference and in this frame; the rotation that fits best carries the reference's vertex over, and
what is missing is coded in the reference's axes. Several references may be blended. Only integers choose contexts; positions
take IEEE additions, multiplications, divisions and square roots in a fixed order, so that they agree between machines to
rounding, and a rounding can never change what is read: the rotation is that of `numerics.rotations`, written out once more,
since these operations and their order belong to the file format, and those may change for speed. The error of each
coordinate is at most `DEADEST` steps.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from morphlet.codec.range_coder import FAULT, MALFORMED, SLOTS, WRITES, code_bit, code_magnitude, code_raw
from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel

ROOT_STEP = 0.25
"""Step of the roots, in steps: all else hangs on them."""
ROOT_SIZE = np.int64(20 * 256)
"""Magnitude that contexts take roots to have, in 1/256."""
KEPT, FRESH, SHARES = np.int64(9), np.int64(1792), np.int64(30)
"""Smoothed magnitude: (1792 sum of |symbol| + 9 mean of the ring) / 30, 0.7 and 0.3 in units of 1/256."""
NORMAL_WEIGHT = 0.5
"""Of the ring's normals against its covariance's trace: steadies flat rings."""
SMALL_TRACE = 1e-12
TINY = 1e-290
"""Squared norm of a covariance below which it has no direction."""
NEWTON = 10
"""Steps on the quartic from its upper bound sqrt(3): of random covariances, two in a thousand need more."""
BOUND = float(np.sqrt(3.0))
SEPARATE = 1e-4
"""Least slope at the largest root: below it the rotation is not sure, and the one of the ring vertex told last is taken."""
CUTS = np.array([0, 32, 64, 128, 192, 288, 400, 600, 900, 1400, 2500, 5000], np.int64)
"""Upper ends of the classes of magnitudes, in 1/256."""
CLASSES = 13
LEVELS = 16
"""Classes of depth: by doublings of the records told so far."""
TOTALS = 4
PAST = 3
RING = CLASSES * TOTALS * 3
TIME = CLASSES * CLASSES * TOTALS
DEPTH = CLASSES * LEVELS * TOTALS * PAST
ROOTS = RING + TIME + DEPTH
SIGNS = (ROOTS + 1) * SLOTS
CONTEXTS = SIGNS + 27 + 6
ROOT_MIXER = CLASSES * SLOTS
MIXERS = ROOT_MIXER + SLOTS
MOST = np.int64(1) << 40
"""Largest symbol."""


COUNT_BITS = 2
MOST_REFERENCES = 4
NUMBER_BITS = 5
SHARE_ONE, SHARE_BITS, SHARE_MOST = 64, 8, 2
"""Shares of references after the first are multiples of 1/64 from -2 to below 2; the first has what is left to 1."""


class Order(NamedTuple):
    """Records as plain arrays (numba type)."""

    removed: Int[np.ndarray, "r"]
    offsets: Int[np.ndarray, "r1"]
    rings: Int[np.ndarray, "s"]
    closed: Int[np.ndarray, "r"]
    roots: Int[np.ndarray, "k"]


class Past(NamedTuple):
    """What contexts remember (numba type): of this frame, smoothed magnitudes and symbols; of those before, the same."""

    size: Int[np.ndarray, "n"]
    symbol: Int[np.ndarray, "n 3"]
    old_size: Int[np.ndarray, "n"]
    old_symbol: Int[np.ndarray, "n 3"]


@inner_kernel
def _rotation(H, R):  # R (9,), the rotation with the largest tr(R^T H); False where it is not sure, and R stays
    s00, s01, s02, s10, s11, s12, s20, s21, s22 = H[0], H[3], H[6], H[1], H[4], H[7], H[2], H[5], H[8]
    square = s00 * s00 + s01 * s01 + s02 * s02 + s10 * s10 + s11 * s11 + s12 * s12 + s20 * s20 + s21 * s21 + s22 * s22
    if not square > TINY:
        return False
    f = 1.0 / np.sqrt(square)
    s00, s01, s02, s10, s11 = f * s00, f * s01, f * s02, f * s10, f * s11
    s12, s20, s21, s22 = f * s12, f * s20, f * s21, f * s22
    a00, a11, a22, a33 = s00 + s11 + s22, s00 - s11 - s22, s11 - s00 - s22, s22 - s00 - s11
    a01, a02, a03, a12, a13, a23 = s12 - s21, s20 - s02, s01 - s10, s01 + s10, s20 + s02, s12 + s21
    det_s = s00 * (s11 * s22 - s12 * s21) - s01 * (s10 * s22 - s12 * s20) + s02 * (s10 * s21 - s11 * s20)
    det_k = (a00 * a11 - a01 * a01) * (a22 * a33 - a23 * a23) - (a00 * a12 - a02 * a01) * (a12 * a33 - a23 * a13)
    det_k += (a00 * a13 - a03 * a01) * (a12 * a23 - a22 * a13) + (a01 * a12 - a02 * a11) * (a02 * a33 - a23 * a03)
    det_k += (a02 * a13 - a03 * a12) * (a02 * a13 - a03 * a12) - (a01 * a13 - a03 * a11) * (a02 * a23 - a22 * a03)
    root = BOUND
    for _ in range(NEWTON):
        slope = 4.0 * (root * root - 1.0) * root - 8.0 * det_s
        if not slope > SEPARATE:
            return False
        root -= (((root * root - 2.0) * root - 8.0 * det_s) * root + det_k) / slope
    a00, a11, a22, a33 = a00 - root, a11 - root, a22 - root, a33 - root
    g23, g13, g12 = a22 * a33 - a23 * a23, a12 * a33 - a23 * a13, a12 * a23 - a22 * a13
    g03, g02, g01 = a02 * a33 - a23 * a03, a02 * a23 - a22 * a03, a02 * a13 - a12 * a03
    h13, h12 = a01 * a13 - a03 * a11, a01 * a12 - a02 * a11
    h03, h02, h01 = a00 * a13 - a03 * a01, a00 * a12 - a02 * a01, a00 * a11 - a01 * a01
    w0, x1 = a11 * g23 - a12 * g13 + a13 * g12, a00 * g23 - a02 * g03 + a03 * g02
    y2, z3 = a03 * h13 - a13 * h03 + a33 * h01, a02 * h12 - a12 * h02 + a22 * h01
    x0, y0, z0 = a12 * g03 - a01 * g23 - a13 * g02, a01 * g13 - a11 * g03 + a13 * g01, a11 * g02 - a01 * g12 - a12 * g01
    y1, z1, z2 = a01 * g03 - a00 * g13 - a03 * g01, a00 * g12 - a01 * g02 + a02 * g01, a13 * h02 - a03 * h12 - a23 * h01
    d0, d1, d2, d3 = abs(w0), abs(x1), abs(y2), abs(z3)
    w, x, y, z = z0, z1, z2, z3
    if d0 >= d1 and d0 >= d2 and d0 >= d3:
        w, x, y, z = w0, x0, y0, z0
    elif d1 >= d2 and d1 >= d3:
        w, x, y, z = x0, x1, y1, z1
    elif d2 >= d3:
        w, x, y, z = y0, y1, y2, z2
    square = w * w + x * x + y * y + z * z
    if not square > SEPARATE**4:
        return False
    f = 2.0 / square
    xx, yy, zz, xy, xz, yz = f * x * x, f * y * y, f * z * z, f * x * y, f * x * z, f * y * z
    wx, wy, wz = f * w * x, f * w * y, f * w * z
    R[0], R[1], R[2] = 1.0 - yy - zz, xy - wz, xz + wy
    R[3], R[4], R[5] = xy + wz, 1.0 - xx - zz, yz - wx
    R[6], R[7], R[8] = xz - wy, yz + wx, 1.0 - xx - yy
    return True


@inner_kernel
def _carried(i, order, Z, Y, work):  # where record i's vertex goes; work (33,): covariance, rotation, both means and normals, place
    first, last = order.offsets[i], order.offsets[i + 1]
    d, u = last - first, order.removed[i]
    for j in range(9):
        work[j] = 0.0
    for j in range(18, 33):
        work[j] = 0.0
    for k in range(first, last):
        r = order.rings[k]
        for j in range(3):
            work[18 + j] += Z[r, j]
            work[21 + j] += Y[r, j]
    c0, c1, c2, e0, e1, e2 = work[18] / d, work[19] / d, work[20] / d, work[21] / d, work[22] / d, work[23] / d
    for k in range(first, last):
        r = order.rings[k]
        zx, zy, zz = Z[r, 0] - c0, Z[r, 1] - c1, Z[r, 2] - c2
        yx, yy, yz = Y[r, 0] - e0, Y[r, 1] - e1, Y[r, 2] - e2
        work[0] += yx * zx
        work[1] += yx * zy
        work[2] += yx * zz
        work[3] += yy * zx
        work[4] += yy * zy
        work[5] += yy * zz
        work[6] += yz * zx
        work[7] += yz * zy
        work[8] += yz * zz
        if k + 1 < last or order.closed[i] == 1:
            s = order.rings[k + 1 if k + 1 < last else first]
            ax, ay, az = Z[s, 0] - c0, Z[s, 1] - c1, Z[s, 2] - c2
            bx, by, bz = Y[s, 0] - e0, Y[s, 1] - e1, Y[s, 2] - e2
            work[24] += zy * az - zz * ay
            work[25] += zz * ax - zx * az
            work[26] += zx * ay - zy * ax
            work[27] += yy * bz - yz * by
            work[28] += yz * bx - yx * bz
            work[29] += yx * by - yy * bx
    length = np.sqrt(work[24] * work[24] + work[25] * work[25] + work[26] * work[26])
    length *= np.sqrt(work[27] * work[27] + work[28] * work[28] + work[29] * work[29])
    if length > 0.0:
        f = NORMAL_WEIGHT * max(abs(work[0] + work[4] + work[8]), SMALL_TRACE) / length
        for a in range(3):
            for b in range(3):
                work[3 * a + b] += f * work[27 + a] * work[24 + b]
    sure = _rotation(work[:9], work[9:18])
    if not sure:
        for j in range(9):
            work[9 + j] = 1.0 if j % 4 == 0 else 0.0
    zx, zy, zz = Z[u, 0] - c0, Z[u, 1] - c1, Z[u, 2] - c2
    work[30] = e0 + (work[9] * zx + work[10] * zy + work[11] * zz)
    work[31] = e1 + (work[12] * zx + work[13] * zy + work[14] * zz)
    work[32] = e2 + (work[15] * zx + work[16] * zy + work[17] * zz)


@inlined_kernel
def _class(x):
    c = 0
    while c < CLASSES - 1 and x > CUTS[c]:
        c += 1
    return c


@inlined_kernel
def _sign(x):
    return 1 if x > 0 else (2 if x < 0 else 0)


@inner_kernel
def _code_roots(coder, X, Z, Y, order, step, past):  # Z the first reference
    writes = coder.state[WRITES] == 1
    c, moved = ROOTS * SLOTS, np.zeros(3, np.int64)
    for k in range(order.roots.shape[0]):
        v = order.roots[k]
        for j in range(3):
            q = np.int64(np.round((X[v, j] - Z[v, j]) / step)) - moved[j] if writes else np.int64(0)
            m = abs(q)
            if code_bit(coder, np.int64(m != 0), c, c, c, ROOT_MIXER) == 1:
                negative = code_raw(coder, np.int64(q < 0), 1)
                m = code_magnitude(coder, m, np.int64(1), c, c, c, ROOT_MIXER)
                q = -m if negative == 1 else m
            else:
                q = np.int64(0)
            moved[j] += q
            if abs(moved[j]) > MOST:
                coder.state[FAULT] = MALFORMED
                return
            Y[v, j] = Z[v, j] + moved[j] * step
            past.symbol[v, j] = 0
        past.size[v] = ROOT_SIZE


@inner_kernel
def _code_three(coder, i, order, wanted, past, symbols):  # wanted (3,) when writing; symbols (3,) come back
    first, last = order.offsets[i], order.offsets[i + 1]
    u, told = order.removed[i], order.removed.shape[0] - i
    mean = np.int64(0)
    for k in range(first, last):
        mean += past.size[order.rings[k]]
    mean //= last - first
    ends = _class((past.size[order.rings[first]] + past.size[order.rings[last - 1]]) // 2)
    ring, time, depth = _class(mean), _class(past.old_size[u]), 0
    while told > 0 and depth < LEVELS - 1:
        told, depth = told >> 1, depth + 1
    total = np.int64(0)
    mixer = ring * SLOTS
    for j in range(3):
        around = np.int64(0)
        for k in range(first, last):
            around += past.symbol[order.rings[k], j]
        before = past.old_symbol[u, j]
        t = min(total, TOTALS - 1)
        c0 = ((ring * TOTALS + t) * 3 + j) * SLOTS
        c1 = (RING + (time * CLASSES + ring) * TOTALS + t) * SLOTS
        c2 = (RING + TIME + ((ends * LEVELS + depth) * TOTALS + t) * PAST + min(abs(before), PAST - 1)) * SLOTS
        q = wanted[j]
        m = abs(q)
        if code_bit(coder, np.int64(m != 0), c0, c1, c2, mixer) == 1:
            a, b = _sign(around), _sign(before)
            negative = code_bit(coder, np.int64(q < 0), SIGNS + (3 * a + b) * 3 + j, SIGNS + 27 + a, SIGNS + 30 + b, mixer + SLOTS - 1)
            m = code_magnitude(coder, m, np.int64(1), c0, c1, c2, mixer)
            q = -m if negative == 1 else m
        else:
            m = q = np.int64(0)
        total += m
        symbols[j] = q
        past.symbol[u, j] = q
        past.old_symbol[u, j] = q
    if total > MOST:
        coder.state[FAULT] = MALFORMED
    past.size[u] = (FRESH * total + KEPT * mean) // SHARES
    past.old_size[u] = (past.size[u] + past.old_size[u]) // 2


@inlined_kernel
def step_at(told, count, step, finest):  # coarse vertices carry the rest, so they are told finer
    return step * min(max(finest, np.sqrt(np.sqrt(told / count))), 1.0)


@kernel
def code_choice(coder, choice):  # choice (1 + 2 MOST_REFERENCES,): how many references, then of each its number and its share
    choice[0] = code_raw(coder, choice[0] - 1, COUNT_BITS) + 1
    for k in range(choice[0]):
        choice[1 + 2 * k] = code_raw(coder, choice[1 + 2 * k], NUMBER_BITS)
        if k > 0:
            choice[2 + 2 * k] = code_raw(coder, choice[2 + 2 * k] + SHARE_ONE * SHARE_MOST, SHARE_BITS) - SHARE_ONE * SHARE_MOST


@kernel
def code_frame(coder, X, Z, shares, Y, order, span, steps, past):
    """Records span[0] down to span[1] of one frame; X (n, 3) is read when writing, Y (n, 3) gets what the reader will have.

    Z (k, n, 3) references and shares (k,) their weights; steps: step, finest share of it, dead zone. With span[2] 0
    nothing is coded and all differences are zero; with span[3] 1 the roots come first.
    """
    writes, told = coder.state[WRITES] == 1, span[2] == 1
    count = order.removed.shape[0]
    work, place = np.zeros(33), np.zeros(3)
    wanted, symbols = np.zeros(3, np.int64), np.zeros(3, np.int64)
    if span[3] == 1:
        _code_roots(coder, X, Z[0], Y, order, steps[0] * ROOT_STEP, past)
    for i in range(span[0] - 1, span[1] - 1, -1):
        if coder.state[FAULT] > 0:
            return
        u = order.removed[i]
        for k in range(Z.shape[0] - 1, -1, -1):
            _carried(i, order, Z[k], Y, work)
            for j in range(3):
                place[j] = work[30 + j] * shares[k] + (place[j] if k < Z.shape[0] - 1 else 0.0)
        step = step_at(count - i, count, steps[0], steps[1])
        if writes:
            for j in range(3):
                e = work[9 + j] * (X[u, 0] - place[0]) + work[12 + j] * (X[u, 1] - place[1]) + work[15 + j] * (X[u, 2] - place[2])
                q = np.int64(np.floor(abs(e) / step + (1.0 - steps[2])))
                wanted[j] = -q if e < 0.0 else q
        if told:
            _code_three(coder, i, order, wanted, past, symbols)
        a, b, c = step * symbols[0], step * symbols[1], step * symbols[2]
        for j in range(3):
            Y[u, j] = place[j] + (work[9 + 3 * j] * a + work[10 + 3 * j] * b + work[11 + 3 * j] * c)


@kernel
def open_loop(X, Z, order, chosen, places):  # chosen (s,) records; places (s, 3): where Z (n, 3) would carry them, ring as in X
    work = np.zeros(33)
    for s in range(chosen.shape[0]):
        _carried(chosen[s], order, Z, X, work)
        for j in range(3):
            places[s, j] = work[30 + j]
