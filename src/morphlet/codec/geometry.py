"""Integer positions of a mesh whose faces are known: each vertex predicted from those before it, the difference coded.

Vertices come in an order in which most of them close two triangles' edges at once. A prediction blends three: the mean of
the neighbours that are known, that of the parallelograms over known triangles, and that of the gaps in the fans of known
neighbours. The blend is learnt on the way, by weighted least squares, for ever finer classes of vertices: by what is known
around them, by their own valence, and by those of the neighbours between and at the ends; each class starts from the blend
of the coarser one. What is left is coded under six contexts at once. All in integers.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from morphlet.codec.connectivity import pred, succ
from morphlet.codec.range_coder import FAULT, MALFORMED, SLOTS, code_bit, code_mixed, code_raw, code_sized
from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel

POINT = 8
"""Bits below the point of predictions."""
WEIGHT_POINT = 10
"""Bits below the point of the blend's weights."""
WEIGHT_LEAST, WEIGHT_MOST = -2 << WEIGHT_POINT, 4 << WEIGHT_POINT
PARALLELOGRAMS, GAPS = 4, 3
"""Kinds of vertices: by parallelograms 0 to 3 and gaps 0 to 2, or more."""
USUAL = np.array([[0, 0], [8, 8], [8, 16], [25, 0], [8, 8], [8, 8], [16, 0], [22, 5], [20, 14], [16, 8], [16, 16], [20, 16]], np.int64)
"""Weights of parallelograms and gaps per kind, in 1/32, before anything is learnt."""
USUAL_SHIFT = WEIGHT_POINT - 5
FEWEST_EDGES, VALENCES = 3, 7
"""Valences 3 to 9: of a vertex, and of the neighbours between known ones, on average."""
END_VALENCES = 9
"""Of the neighbours at the ends of what is known, on average: 4 to 8 in halves."""
KINDS = PARALLELOGRAMS * GAPS
OWN, BETWEEN, ENDS = KINDS, KINDS * (1 + VALENCES), KINDS * (1 + VALENCES + VALENCES**2)
"""Where the finer classes start: by kind; that and valence; that and the neighbours between; that and those at the ends."""
LEARNERS = ENDS + KINDS * VALENCES**2 * END_VALENCES
LEVELS = 4
PRIOR = 10
"""The coarser class's blend counts as so many vertices of the finer one."""
FEATURE_BITS, SHARPNESS, QUARTERS = 14, 8, 4
"""Of a vertex in the sums; bits below their point; squares count by one over the difference in these units: nearly least absolute ones."""
SUM_BITS, SOLVE_BITS = 50, 18
"""Sums are halved beyond; they are solved with so many bits: products stay within 64."""
ERROR_POINT, ERROR_SHIFT = 4, 3
"""Smoothed sizes of differences per class: bits below the point, and how fast they follow."""
STEPS = np.array([0, 2, 4, 7, 10, 14, 20, 30, 45, 70, 120, 200, 400, 1000], np.int64)
"""Upper ends of the classes of magnitudes, in quarters."""
CLASSES = 15
NORMALS = 6
"""Classes of how much of the normal lies along an axis."""
TERMS = 6
"""Contexts of a difference."""
SPREADS = CLASSES * CLASSES * PARALLELOGRAMS
SHARES = NORMALS * CLASSES * CLASSES
PASTS = CLASSES**3
AXES = CLASSES * CLASSES * 3
DOUBTS = CLASSES**3
FANS = KINDS * VALENCES**2 * CLASSES
FRACTIONS = 4
LEANINGS = 36
SIGNS = (SPREADS + SHARES + PASTS + AXES + DOUBTS + FANS) * SLOTS
LEANS = SIGNS + 3 * FRACTIONS
TURNS = LEANS + LEANINGS
CONTEXTS = TURNS + 15 * NORMALS
SIGN_MIXER = 3 * SLOTS
"""Of the mixers of three; those of six are counted from 0 in their own table."""
MIXERS = SIGN_MIXER + 3
LEAN_LEAST = 64
"""A quarter of a spacing: predictions that are nearer to each other lean nowhere."""
FAR_OUT = np.int64(1) << 40
MOST_BITS = 28
"""Positions are below 2^28: products of two differences, summed over a fan, stay within 64 bits."""


class Learnt(NamedTuple):
    """What classes have seen (numba type): sums of squares and products, how many vertices, smoothed sizes of differences."""

    sums: Int[np.ndarray, "c 5"]
    number: Int[np.ndarray, "c"]
    error: Int[np.ndarray, "c"]


@inlined_kernel
def _first(v, twin, start):  # the half-edge out of v from which all others follow counter-clockwise
    h = start[v]
    while True:
        t = twin[h]
        if t < 0:
            return h
        h = succ(t)
        if h == start[v]:
            return h


@inner_kernel
def _push(stacks, tops, level, v):
    stacks[level, tops[level]] = v
    tops[level] += 1


@kernel
def best_order(corner, twin, start, order):  # order (n,): of the vertices left, one that ends most parallelograms (0, 1, 2+), latest first
    n = start.shape[0]
    done, count, level = np.zeros(n, np.bool_), np.zeros(n, np.int64), np.full(n, -1, np.int64)
    stacks, tops = np.empty((3, n), np.int64), np.zeros(3, np.int64)
    k = 0
    for seed in range(n):
        if done[seed]:
            continue
        tops[0] = 1
        stacks[0, 0], level[seed] = seed, 0
        while tops[0] + tops[1] + tops[2] > 0:
            top = 2 if tops[2] > 0 else (1 if tops[1] > 0 else 0)
            tops[top] -= 1
            v = stacks[top, tops[top]]
            if done[v] or level[v] != top:
                continue
            done[v], order[k] = True, v
            k += 1
            if start[v] < 0:
                continue
            first = _first(v, twin, start)
            h = first
            while True:
                p, q = corner[succ(h)], corner[pred(h)]
                if done[p] and done[q]:
                    for i in range(3):
                        t = twin[h - h % 3 + i]
                        w = corner[pred(t)] if t >= 0 else v
                        if not done[w]:
                            count[w] += 1
                            if min(count[w], 2) > level[w]:
                                level[w] = min(count[w], 2)
                                _push(stacks, tops, level[w], w)
                else:
                    for w in (p, q):
                        if not done[w] and level[w] < 0:
                            level[w] = 0
                            _push(stacks, tops, np.int64(0), w)
                h = twin[pred(h)]
                if h < 0 or h == first:
                    break


@inner_kernel
def _look(v, corner, twin, first, X, seen, counts, told, valence):  # seen (8, 3): sums of neighbours, parallelograms, gaps; normal;
    for j in range(3):  # least, most of the parallelograms; sums of the neighbours' differences, and of their sizes; counts (7,)
        for k in range(8):
            seen[k, j] = 0
        seen[4, j], seen[5, j] = FAR_OUT, -FAR_OUT
    for k in range(7):
        counts[k] = 0
    h = first
    while h >= 0:
        p, q = corner[succ(h)], corner[pred(h)]
        if p < v:
            t = twin[h]
            before = corner[pred(t)] if t >= 0 else v
            gap = q < v and before < v
            _meet(p, X, seen, counts, told, valence, 3 if gap else 5)
            counts[2] += 1 if gap else 0
            t = twin[succ(h)]
            s = corner[pred(t)] if t >= 0 else v
            known = q < v and s < v
            counts[1] += 1 if known else 0
            for j in range(3):
                if gap:
                    seen[2, j] += X[q, j] + X[before, j] - X[p, j]
                if known:
                    value, a, b = X[p, j] + X[q, j] - X[s, j], (j + 1) % 3, (j + 2) % 3
                    seen[1, j] += value
                    seen[4, j], seen[5, j] = min(seen[4, j], value), max(seen[5, j], value)
                    seen[3, j] += (X[p, a] - X[q, a]) * (X[s, b] - X[q, b]) - (X[p, b] - X[q, b]) * (X[s, a] - X[q, a])
        h = twin[pred(h)]
        if h < 0 and q < v:
            _meet(q, X, seen, counts, told, valence, 5)
        if h == first:
            break


@inner_kernel
def _meet(p, X, seen, counts, told, valence, place):  # a known neighbour, between known ones (place 3) or at an end (5)
    counts[0] += 1
    counts[place] += valence[p]
    counts[place + 1] += 1
    for j in range(3):
        seen[0, j] += X[p, j]
        seen[6, j] += told[p, j]
        seen[7, j] += abs(told[p, j])


@inner_kernel
def _guesses(v, X, seen, counts):  # rows 0, 1, 2 of seen become means, POINT bits below the point
    if counts[1] == 1:  # one parallelogram: how far it is from the neighbours stands for the spread
        for j in range(3):
            seen[4, j], seen[5, j] = 0, abs(seen[1, j] * counts[0] - seen[0, j]) // counts[0]
    for j in range(3):
        if counts[0] > 0:
            seen[0, j] = (seen[0, j] << POINT) // counts[0]
        elif v > 0:
            seen[0, j] = X[v - 1, j] << POINT
        seen[1, j] = (seen[1, j] << POINT) // counts[1] if counts[1] > 0 else seen[0, j]
        seen[2, j] = (seen[2, j] << POINT) // counts[2] if counts[2] > 0 else seen[0, j]


@inlined_kernel
def _class(x):
    c = 0
    while c < CLASSES - 1 and x > STEPS[c]:
        c += 1
    return c


@inlined_kernel
def _length(x):  # bits of a number that is not negative
    bits = 0
    while x > 0:
        x, bits = x >> 1, bits + 1
    return bits


@inner_kernel
def _classify(counts, valence, ids):  # ids (LEVELS,), coarse to fine
    kind = min(counts[1], PARALLELOGRAMS - 1) * GAPS + min(counts[2], GAPS - 1)
    own = min(max(valence - FEWEST_EDGES, 0), VALENCES - 1)
    between = (2 * counts[3] + counts[4]) // (2 * counts[4]) - FEWEST_EDGES if counts[4] > 0 else VALENCES // 2
    ends = (4 * counts[5] + counts[6]) // (2 * counts[6]) - 8 if counts[6] > 0 else END_VALENCES // 2
    fan = (kind * VALENCES + own) * VALENCES + min(max(between, 0), VALENCES - 1)
    ids[0], ids[1], ids[2] = kind, OWN + kind * VALENCES + own, BETWEEN + fan
    ids[3] = ENDS + fan * END_VALENCES + min(max(ends, 0), END_VALENCES - 1)


@inner_kernel
def _blend(ids, sums, count, weight):  # weight (2,) of the finest class; each class's sums and PRIOR vertices of the coarser one, solved
    weight[0], weight[1] = USUAL[ids[0], 0] << USUAL_SHIFT, USUAL[ids[0], 1] << USUAL_SHIFT
    for level in range(LEVELS):
        c, p = ids[level], ids[max(level - 1, 0)]
        if count[p] == 0:
            return
        xx, xy, yy = (PRIOR * sums[p, 0]) // count[p], (PRIOR * sums[p, 1]) // count[p], (PRIOR * sums[p, 2]) // count[p]
        if level == 0:
            xx, xy, yy = (xx + yy) // 2, np.int64(0), (xx + yy) // 2
        most = max(max(xx, yy), np.int64(0))
        for k in range(5):
            most = max(most, abs(sums[c, k]))
        t = max(_length(most) - SOLVE_BITS, 0)
        xx, xy, yy = (xx >> t) + 1, xy >> t, (yy >> t) + 1
        b0 = (sums[c, 3] >> t) + ((xx * weight[0] + xy * weight[1]) >> WEIGHT_POINT)
        b1 = (sums[c, 4] >> t) + ((xy * weight[0] + yy * weight[1]) >> WEIGHT_POINT)
        xx, xy, yy = xx + (sums[c, 0] >> t), xy + (sums[c, 1] >> t), yy + (sums[c, 2] >> t)
        det = xx * yy - xy * xy
        if det > 0:
            weight[0] = min(max(((b0 * yy - b1 * xy) << WEIGHT_POINT) // det, WEIGHT_LEAST), WEIGHT_MOST)
            weight[1] = min(max(((b1 * xx - b0 * xy) << WEIGHT_POINT) // det, WEIGHT_LEAST), WEIGHT_MOST)


@inner_kernel
def _learn_from(v, X, seen, left, ids, sums, count):  # left (3,): sizes of what the prediction missed, in spacings
    most = np.int64(0)
    for j in range(3):
        a = seen[0, j]
        most = max(most, max(abs((X[v, j] << POINT) - a), max(abs(seen[1, j] - a), abs(seen[2, j] - a))))
    t = max(_length(most) - FEATURE_BITS, 0)
    xx = xy = yy = xz = yz = np.int64(0)
    for j in range(3):
        a = seen[0, j]
        x, y, z = (seen[1, j] - a) >> t, (seen[2, j] - a) >> t, ((X[v, j] << POINT) - a) >> t
        d = max((QUARTERS * left[j]) >> t, max(QUARTERS >> t, 1))
        xx, xy, yy = xx + (x * x << SHARPNESS) // d, xy + (x * y << SHARPNESS) // d, yy + (y * y << SHARPNESS) // d
        xz, yz = xz + (x * z << SHARPNESS) // d, yz + (y * z << SHARPNESS) // d
    for level in range(LEVELS):
        c = ids[level]
        if max(max(sums[c, 0], sums[c, 2]), max(abs(sums[c, 3]), abs(sums[c, 4]))) >> SUM_BITS > 0:
            count[c] = (count[c] + 1) >> 1
            for k in range(5):
                sums[c, k] >>= 1
        count[c] += 1
        sums[c, 0], sums[c, 1], sums[c, 2] = sums[c, 0] + xx, sums[c, 1] + xy, sums[c, 2] + yy
        sums[c, 3], sums[c, 4] = sums[c, 3] + xz, sums[c, 4] + yz


@inlined_kernel
def _side(x, least):  # 0 within `least`, 1 above, 2 below
    return 0 if abs(x) < least else (1 if x > 0 else 2)


@kernel
def code_positions(coder, six, corner, twin, start, learnt, X):  # six (mixers, TERMS); X (n, 3), read when writing, written when reading
    n, sums, count = X.shape[0], learnt.sums, learnt.number
    seen, counts, told, valence = np.zeros((8, 3), np.int64), np.zeros(7, np.int64), np.zeros((n, 3), np.int64), np.zeros(n, np.int64)
    last, left, ids, weight = np.zeros(3, np.int64), np.zeros(3, np.int64), np.zeros(LEVELS, np.int64), np.zeros(2, np.int64)
    base, slots, odds = np.zeros(TERMS, np.int64), np.zeros(TERMS, np.int64), np.zeros(TERMS, np.int64)
    for h in range(corner.shape[0]):
        valence[corner[h]] += 1 if twin[h] >= 0 else 2
    for v in range(n):
        _look(v, corner, twin, _first(v, twin, start) if start[v] >= 0 else np.int64(-1), X, seen, counts, told, valence)
        if start[v] < 0 and code_raw(coder, np.int64(0), 1) == 1:  # a vertex without faces costs a bit: numbers of them cannot be forged
            coder.state[FAULT] = MALFORMED
        neighbours, edges, kept = counts[0], counts[1], min(counts[1], PARALLELOGRAMS - 1)
        size = _class(QUARTERS * (seen[7, 0] + seen[7, 1] + seen[7, 2]) // neighbours) if neighbours > 0 else CLASSES - 1
        _guesses(v, X, seen, counts)
        _classify(counts, valence[v], ids)
        _blend(ids, sums, count, weight)
        fan, doubt = ids[2] - BETWEEN, _class(learnt.error[ids[2]] >> ERROR_POINT)
        normal = abs(seen[3, 0]) + abs(seen[3, 1]) + abs(seen[3, 2]) + 1
        total = turned = np.int64(0)
        if coder.state[FAULT] > 0:
            return
        for j in range(3):
            a = seen[0, j]
            edge, gap = seen[1, j] - a, seen[2, j] - a
            guess = a + ((weight[0] * edge + weight[1] * gap) >> WEIGHT_POINT)
            near = (guess + (1 << (POINT - 1))) >> POINT
            share = min(NORMALS * abs(seen[3, j]) // normal, NORMALS - 1)
            spread = _class(2 * (seen[5, j] - seen[4, j])) if edges > 1 or (edges == 1 and neighbours > 1) else CLASSES - 1
            before, past, axis = _class(2 * total), _class(last[j]), _class(QUARTERS * seen[7, j] // max(neighbours, 1))
            base[0] = ((size * CLASSES + spread) * PARALLELOGRAMS + kept) * SLOTS
            base[1] = (SPREADS + (share * CLASSES + size) * CLASSES + before) * SLOTS
            base[2] = (SPREADS + SHARES + (spread * CLASSES + past) * CLASSES + before) * SLOTS
            base[3] = (SPREADS + SHARES + PASTS + (axis * CLASSES + before) * 3 + j) * SLOTS
            apart = _class(abs(edge - gap) >> (POINT - 2))
            base[4] = (SPREADS + SHARES + PASTS + AXES + (doubt * CLASSES + apart) * CLASSES + axis) * SLOTS
            base[5] = (SPREADS + SHARES + PASTS + AXES + DOUBTS + fan * CLASSES + size) * SLOTS
            for k in range(TERMS):
                slots[k] = base[k]
            d = X[v, j] - near
            m = abs(d)
            if code_mixed(coder, np.int64(m != 0), slots, odds, six, j * SLOTS) == 1:
                s = SIGNS + j * FRACTIONS + ((guess >> (POINT - 2)) & (FRACTIONS - 1))
                lean = LEANS + (_side(a + edge - guess, LEAN_LEAST) * 3 + _side(a + gap - guess, LEAN_LEAST)) * PARALLELOGRAMS + kept
                turn = 0 if turned == 0 else (1 if (turned > 0) == (seen[3, j] > 0) else 2)
                pull = _side(seen[6, j], 1) + (2 if abs(seen[6, j]) > QUARTERS * neighbours else 0)
                negative = code_bit(coder, np.int64(d < 0), s, lean, TURNS + (pull * 3 + turn) * NORMALS + share, SIGN_MIXER + j)
                m = code_sized(coder, m, base, slots, odds, six, j * SLOTS)
                d = -m if negative == 1 else m
            else:
                m = d = np.int64(0)
            X[v, j] = near + d
            if abs(X[v, j]) >= np.int64(1) << MOST_BITS:
                coder.state[FAULT] = MALFORMED
                return
            total += m
            turned += (d if seen[3, j] > 0 else -d) * share
            last[j], told[v, j], left[j] = QUARTERS * m, d, abs((X[v, j] << POINT) - guess) >> POINT
        learnt.error[ids[2]] += ((QUARTERS * total << ERROR_POINT) - learnt.error[ids[2]]) >> ERROR_SHIFT
        if neighbours > 0:
            _learn_from(v, X, seen, left, ids, sums, count)


def nothing_learnt() -> Learnt:
    """Classes that have seen nothing."""
    return Learnt(np.zeros((LEARNERS, 5), np.int64), np.zeros(LEARNERS, np.int64), np.zeros(LEARNERS, np.int64))
