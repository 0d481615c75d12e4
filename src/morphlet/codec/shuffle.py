"""Sequences of integers that mostly go on where they were: the price of keeping an order."""

import numpy as np

from morphlet.codec.range_coder import FAULT, MALFORMED, SLOTS, code_bit, code_magnitude
from morphlet.numerics.compiled import kernel

KINDS = 3
CLASSES = 8
"""Of the last difference's size."""
LONG = 4
"""Differences from here on double from class to class."""
CONTEXTS = KINDS * (2 * CLASSES + 1) * SLOTS
MIXERS = KINDS * SLOTS
MOST = np.int64(1) << 40


@kernel
def code_numbers(coder, values, kind):  # values (k,): each as its difference from the one before
    value, size = np.int64(0), np.int64(0)
    last = np.int64(0)
    base = kind * (2 * CLASSES + 1) * SLOTS
    mixer = kind * SLOTS
    for i in range(values.shape[0]):
        if coder.state[FAULT] > 0:
            return
        d = values[i] - value
        m = abs(d)
        c = base + size * SLOTS
        b = base + (CLASSES + min(abs(int(last)), CLASSES - 1)) * SLOTS
        a = base + 2 * CLASSES * SLOTS
        if code_bit(coder, np.int64(m != 0), a, b, c, mixer) == 1:
            s = SLOTS - 1
            negative = code_bit(coder, np.int64(d < 0), a + s, b + s, c + s, mixer + s)
            m = code_magnitude(coder, m, np.int64(1), a, b, c, mixer)
            d = -m if negative == 1 else m
        else:
            m = d = np.int64(0)
        value += d
        if abs(value) > MOST:
            coder.state[FAULT] = MALFORMED
            return
        values[i] = value
        last = d
        size = np.int64(0)
        while m > 0 and size < CLASSES - 1:
            m, size = m // LONG, size + 1
