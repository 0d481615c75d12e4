"""Integer positions of a mesh whose faces are known: each vertex predicted from those before it, the difference coded.

Vertices come in an order in which most of them close two triangles' edges at once. A prediction is a blend of three: the
mean of the neighbours that are known, that of the parallelograms over known triangles, and that of the gaps in the fans of
known neighbours. The blend's weights are part of the file where the mesh is large enough to fit its own. All in integers.
"""

import numpy as np
from jaxtyping import Float, Int

from morphlet.codec.connectivity import pred, succ
from morphlet.codec.range_coder import FAULT, MALFORMED, SLOTS, code_bit, code_magnitude, code_raw
from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel

POINT = 8
"""Bits below the point of predictions."""
WEIGHT_POINT = 5
"""Bits below the point of the blend's weights."""
WEIGHT_BITS, WEIGHT_LEAST = 8, -64
"""Of a stored weight: -2 to 6 in steps of 1/32."""
FEW = 300
"""Vertices of a kind below which the usual weights are taken: two bytes would not pay."""
ROUNDS = 4
"""Of reweighting towards least absolute differences, which cost fewer bits than least squares."""
PARALLELOGRAMS, GAPS = 4, 3
"""Kinds of vertices: by parallelograms 0 to 3 and gaps 0 to 2, or more."""
USUAL = np.array([[0, 0], [8, 8], [8, 16], [25, 0], [8, 8], [8, 8], [16, 0], [22, 5], [20, 14], [16, 8], [16, 16], [20, 16]], np.int64)
"""Weights of parallelograms and gaps per kind, in 1/32, where the file has none."""
STEPS = np.array([0, 2, 4, 7, 10, 14, 20, 30, 45, 70, 120], np.int64)
"""Upper ends of the classes of magnitudes, in quarters."""
CLASSES = 12
NORMALS = 6
"""Classes of how much of the normal lies along an axis."""
SPREADS = CLASSES * CLASSES * PARALLELOGRAMS
SHARES = NORMALS * CLASSES * CLASSES
PASTS = CLASSES * CLASSES * CLASSES
FRACTIONS = 4
SIGNS = (SPREADS + SHARES + PASTS) * SLOTS
PLAIN = SIGNS + 3 * FRACTIONS
CONTEXTS = PLAIN + 1
SIGN_MIXER = 3 * SLOTS
MIXERS = SIGN_MIXER + 3
FAR_OUT = np.int64(1) << 40
MOST_BITS = 28
"""Positions are below 2^28: products of two differences, summed over a fan, stay within 64 bits."""


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
def _look(v, corner, twin, first, X, seen, counts, size):  # seen (6, 3): sums of neighbours, parallelograms, gaps; normal; least, most
    for j in range(3):
        seen[0, j] = seen[1, j] = seen[2, j] = seen[3, j] = 0
        seen[4, j], seen[5, j] = FAR_OUT, -FAR_OUT
    counts[0] = counts[1] = counts[2] = counts[3] = 0
    h = first
    while h >= 0:
        p, q = corner[succ(h)], corner[pred(h)]
        if p < v:
            counts[0] += 1
            counts[3] += size[p]
            t = twin[h]
            before = corner[pred(t)] if t >= 0 else v
            gap = q < v and before < v
            counts[2] += 1 if gap else 0
            t = twin[succ(h)]
            s = corner[pred(t)] if t >= 0 else v
            known = q < v and s < v
            counts[1] += 1 if known else 0
            for j in range(3):
                seen[0, j] += X[p, j]
                if gap:
                    seen[2, j] += X[q, j] + X[before, j] - X[p, j]
                if known:
                    value, a, b = X[p, j] + X[q, j] - X[s, j], (j + 1) % 3, (j + 2) % 3
                    seen[1, j] += value
                    seen[4, j], seen[5, j] = min(seen[4, j], value), max(seen[5, j], value)
                    seen[3, j] += (X[p, a] - X[q, a]) * (X[s, b] - X[q, b]) - (X[p, b] - X[q, b]) * (X[s, a] - X[q, a])
        h = twin[pred(h)]
        if h < 0 and q < v:
            counts[0] += 1
            counts[3] += size[q]
            for j in range(3):
                seen[0, j] += X[q, j]
        if h == first:
            break


@inner_kernel
def _guesses(v, X, seen, counts):  # rows 0, 1, 2 of seen become means, POINT bits below the point
    for j in range(3):
        if counts[0] > 0:
            seen[0, j] = (seen[0, j] << POINT) // counts[0]
        elif v > 0:
            seen[0, j] = X[v - 1, j] << POINT
        seen[1, j] = (seen[1, j] << POINT) // counts[1] if counts[1] > 0 else seen[0, j]
        seen[2, j] = (seen[2, j] << POINT) // counts[2] if counts[2] > 0 else seen[0, j]


@inlined_kernel
def _kind(counts):
    return min(counts[1], PARALLELOGRAMS - 1) * GAPS + min(counts[2], GAPS - 1)


@inlined_kernel
def _class(x):
    c = 0
    while c < CLASSES - 1 and x > STEPS[c]:
        c += 1
    return c


@kernel
def look_around(corner, twin, start, X, kinds, guesses):  # what predictions have to go by: kinds (n,), guesses (n, 3, 3)
    seen, counts, size = np.zeros((6, 3), np.int64), np.zeros(4, np.int64), np.zeros(len(X), np.int64)
    for v in range(len(X)):
        _look(v, corner, twin, _first(v, twin, start) if start[v] >= 0 else np.int64(-1), X, seen, counts, size)
        kinds[v] = _kind(counts)
        _guesses(v, X, seen, counts)
        for k in range(3):
            for j in range(3):
                guesses[v, k, j] = seen[k, j]


@kernel
def code_weights(coder, weights):  # weights (kinds, 2), int64
    for k in range(weights.shape[0]):
        own = np.int64(weights[k, 0] != USUAL[k, 0] or weights[k, 1] != USUAL[k, 1])
        own = code_bit(coder, own, PLAIN, PLAIN, PLAIN, SIGN_MIXER)
        for i in range(2):
            weights[k, i] = code_raw(coder, weights[k, i] - WEIGHT_LEAST, WEIGHT_BITS) + WEIGHT_LEAST if own == 1 else USUAL[k, i]


@kernel
def code_positions(coder, corner, twin, start, weights, X):  # X (n, 3), read when writing, written when reading
    n = X.shape[0]
    seen, counts, size, last = np.zeros((6, 3), np.int64), np.zeros(4, np.int64), np.zeros(n, np.int64), np.zeros(3, np.int64)
    for v in range(n):
        _look(v, corner, twin, _first(v, twin, start) if start[v] >= 0 else np.int64(-1), X, seen, counts, size)
        if start[v] < 0 and code_raw(coder, np.int64(0), 1) == 1:  # a vertex without faces costs a bit: numbers of them cannot be forged
            coder.state[FAULT] = MALFORMED
        neighbours, edges = counts[0], counts[1]
        size_class = _class(counts[3] // neighbours) if neighbours > 0 else CLASSES - 1
        around = neighbours > 1 and edges == 1
        for j in range(3):
            if edges == 1:  # one parallelogram: how far it is from the neighbours stands for the spread
                seen[4, j], seen[5, j] = 0, abs(seen[1, j] * neighbours - seen[0, j]) // neighbours
        _guesses(v, X, seen, counts)
        kind, kept = _kind(counts), min(edges, PARALLELOGRAMS - 1)
        normal = abs(seen[3, 0]) + abs(seen[3, 1]) + abs(seen[3, 2]) + 1
        total = np.int64(0)
        if coder.state[FAULT] > 0:
            return
        for j in range(3):
            a = seen[0, j]
            guess = a + ((weights[kind, 0] * (seen[1, j] - a) + weights[kind, 1] * (seen[2, j] - a)) >> WEIGHT_POINT)
            base = (guess + (1 << (POINT - 1))) >> POINT
            share = min(NORMALS * abs(seen[3, j]) // normal, NORMALS - 1)
            spread = _class(2 * (seen[5, j] - seen[4, j])) if edges > 1 or around else CLASSES - 1
            before, past = _class(2 * total), _class(last[j])
            c0 = ((size_class * CLASSES + spread) * PARALLELOGRAMS + kept) * SLOTS
            c1 = (SPREADS + (share * CLASSES + size_class) * CLASSES + before) * SLOTS
            c2 = (SPREADS + SHARES + (spread * CLASSES + past) * CLASSES + before) * SLOTS
            d = X[v, j] - base
            m = abs(d)
            if code_bit(coder, np.int64(m != 0), c0, c1, c2, j * SLOTS) == 1:
                s = SIGNS + j * FRACTIONS + ((guess >> (POINT - 2)) & (FRACTIONS - 1))
                negative = code_bit(coder, np.int64(d < 0), s, s, s, SIGN_MIXER + j)
                m = code_magnitude(coder, m, np.int64(1), c0, c1, c2, j * SLOTS)
                d = -m if negative == 1 else m
            else:
                m = d = np.int64(0)
            X[v, j] = base + d
            if abs(X[v, j]) >= np.int64(1) << MOST_BITS:
                coder.state[FAULT] = MALFORMED
                return
            total += m
            last[j] = 4 * m
        size[v] = 4 * total


def fitted_weights(
    kinds: Int[np.ndarray, "n"], guesses: Int[np.ndarray, "n 3 3"], positions: Int[np.ndarray, "n 3"]
) -> Int[np.ndarray, "12 2"]:
    """The blend of each kind with least absolute differences, on the lattice that files store."""
    weights = USUAL.copy()
    for kind in np.nonzero(np.bincount(kinds, minlength=len(USUAL)) >= FEW)[0]:
        chosen = kinds == kind
        near, edge, gap = (guesses[chosen, k].ravel() / (1 << POINT) for k in range(3))
        weights[kind] = _least_absolute(np.stack([edge - near, gap - near], axis=1), positions[chosen].ravel() - near)
    return weights


def _least_absolute(terms: Float[np.ndarray, "k 2"], goal: Float[np.ndarray, "k"]) -> Int[np.ndarray, "2"]:
    """Weights of two terms that come nearest to the goal, reweighted a few times."""
    found: np.ndarray = np.zeros(2)
    for _ in range(ROUNDS):
        trust = 1 / np.sqrt(np.maximum(np.abs(goal - terms @ found), 0.5))
        found = np.linalg.lstsq(terms * trust[:, None], goal * trust, rcond=None)[0]
    least = WEIGHT_LEAST
    return np.clip(np.round(found * (1 << WEIGHT_POINT)), least, least + (1 << WEIGHT_BITS) - 1).astype(np.int64)
