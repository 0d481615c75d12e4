"""Integers at the edges of a subdivision: how far each level's new vertices are moved along their normals, in steps.

An integer is told under what its neighbours are: those at the four edges around that came before it, and those that the
ends and the opposite vertices of its edge were moved by, one level up.
"""

import numpy as np

from morphlet.codec.range_coder import FAULT, MALFORMED, SLOTS, code_bit, code_magnitude
from morphlet.numerics.compiled import inlined_kernel, kernel

STEPS = np.array([0, 1, 2, 4, 6, 9, 14, 20, 30, 50, 90], np.int64)
"""Upper ends of the classes of magnitudes, in quarters of a step."""
CLASSES = 12
ONE = 16
"""Magnitudes of vertices are in sixteenths of a step."""
LEVELS = 8
"""Levels that have contexts of their own; further ones share the last."""
AROUND = CLASSES * CLASSES * 3
BOTH = CLASSES * LEVELS
ENDS = CLASSES * CLASSES * CLASSES
SIGNS = (AROUND + BOTH + ENDS) * SLOTS
CONTEXTS = SIGNS + 1 + 3 + 3 * LEVELS
MIXERS = CLASSES * SLOTS + 1
MOST = np.int64(1) << 30
"""No writer moves a vertex by more steps."""


@inlined_kernel
def _class(y):  # type: ignore[no-untyped-def]
    k = np.int64(0)
    while k < CLASSES - 1 and y > STEPS[k]:
        k += 1
    return k


@kernel
def code_moves(coder, moves, ends, near, size, level):  # type: ignore[no-untyped-def]
    # moves (e,); ends, near (e, 4); size (n + e,): that of the ends is known, that of the edges found, and halved for the next level
    n = size.shape[0] - moves.shape[0]
    depth = min(level, LEVELS - 1)
    for i in range(moves.shape[0]):
        total, signed, count = np.int64(0), np.int64(0), np.int64(0)
        for j in range(4):
            if near[i, j] < i:
                v = moves[near[i, j]]
                total, signed, count = total + abs(v), signed + v, count + 1
        one, two = size[ends[i, 0]], size[ends[i, 1]]
        above = 3 * (one + two) + size[ends[i, 2]] + size[ends[i, 3]]
        k = _class(above // 8)
        near_by = 4 * total // (count if count > 0 else 1)
        g = _class(near_by) if count > 0 else np.int64(CLASSES - 1)
        both = _class((above // 32 + 2 * near_by) // 2) if count > 0 else k
        a = ((k * CLASSES + g) * 3 + min(count, 2)) * SLOTS
        b = (AROUND + both * LEVELS + depth) * SLOTS
        c = (AROUND + BOTH + (k * CLASSES + _class(one // 4)) * CLASSES + _class(two // 4)) * SLOTS
        w = g * SLOTS
        v = moves[i]
        m = abs(v)
        if code_bit(coder, np.int64(m != 0), a, b, c, w) == 1:
            t = np.int64(0) if signed == 0 else (np.int64(1) if signed > 0 else np.int64(2))
            negative = code_bit(coder, np.int64(v < 0), SIGNS + 1 + t, SIGNS + 4 + 3 * depth + t, SIGNS, np.int64(CLASSES * SLOTS))
            m = code_magnitude(coder, m, np.int64(1), a, b, c, w)
            if m > MOST:
                coder.state[FAULT] = MALFORMED
            v = -m if negative == 1 else m
        else:
            m = v = np.int64(0)
        if coder.state[FAULT] > 0:
            return
        moves[i], size[n + i] = v, ONE * m
    for i in range(n):
        size[i] = size[i] // 2
