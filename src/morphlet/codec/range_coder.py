"""Binary arithmetic coding with adaptive chances, in integers alone: the same bits on every machine.

A binary decision is coded under three contexts at once. Each context keeps the chance of a one, learnt from what it has
seen; their log-odds are added with weights that are learnt too (logistic mixing), and the range coder spends
-log2 of the mixed chance on the decision. Integers are sequences of such decisions: zero or not, sign, magnitude in unary,
and beyond that Exp-Golomb. The coder that writes and the one that reads run the same code; only the lowest step differs.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Int, UInt8

from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel

LOW, RANGE, CACHE, PENDING, PLACE, CODE, WRITES, FAULT = range(8)
"""Where a coder's state keeps what."""

WORD = np.int64(0xFFFFFFFF)
SPLIT = np.int64(1 << 24)
"""The range is renewed byte by byte while it is below this."""
CARRY = np.int64(0xFF000000)

READ_PAST, TOO_LONG, NO_ROOM, MALFORMED = 1, 2, 3, 4
"""Faults: bytes used up, a magnitude beyond any that is written, the buffer of the writer full, what no writer writes."""

ENDING = 8
"""Bytes that a writer may still need to end."""
ODDS_ONE = 256
"""Log-odds are natural logarithms times this."""
ODDS_MOST = 2047
"""Largest size of log-odds: chances of 1 in 3000."""
CHANCE_BITS = 16
CHANCE_LEAST = np.int64(32)
"""No decision is taken to be surer than 32 in 65536, or an exception would cost too much."""
FINE = 6
"""Bits that learnt chances keep below the 16 they are used with."""
SLOWEST = 255
"""Chances are means over about this many of the last decisions at most."""
WEIGHT_ONE = 1 << 16
WEIGHT_START = (WEIGHT_ONE * 2) // 5
"""Of each of three inputs at first: a little more than their mean, for each alone is too careful."""
WEIGHT_RATE = 15
"""Shift of the step by which weights learn: error (16 bits) times log-odds (8 bits below the point)."""

MANY_START = WEIGHT_ONE // 5
"""Of each of six inputs at first."""
MANY_RATE = 14
"""Shift of the step by which their weights learn."""

SLOTS = 32
"""Binary contexts per integer context."""
UNARY = 14
"""Magnitudes from here on are escaped."""
PREFIX_MOST = 40
"""Longest Exp-Golomb prefix: magnitudes below 2^40."""
SIZES = 60
"""Classes of sizes told by class and place: below 2^30."""
SIZE_SLOTS = 24
"""Slots of classes; the eight others are for the highest bit of the place."""


def _squash() -> Int[np.ndarray, "4095"]:
    """Chances (16 bits) of the log-odds -2047 to 2047; no value is near a tie of its rounding."""
    values = [round((1 << CHANCE_BITS) / (1 + math.exp(-x / ODDS_ONE))) for x in range(-ODDS_MOST, ODDS_MOST + 1)]
    return np.array(values, np.int64)


def _stretch(squash: Int[np.ndarray, "4095"]) -> Int[np.ndarray, "4096"]:
    """Log-odds of the chances (k + 1/2) / 4096: the first whose chance reaches it."""
    middles = (2 * np.arange(1 << 12) + 1) << (CHANCE_BITS - 13)
    return np.minimum(np.searchsorted(squash, middles), len(squash) - 1) - ODDS_MOST


SQUASH = _squash()
STRETCH = _stretch(SQUASH)
RATES = np.array([(1 << 16) * 2 // (2 * n + 3) for n in range(SLOWEST + 1)], np.int64)


class Coder(NamedTuple):
    """A range coder with what its contexts have learnt (numba type)."""

    state: Int[np.ndarray, "8"]
    buffer: UInt8[np.ndarray, "b"]
    chance: Int[np.ndarray, "c"]
    seen: Int[np.ndarray, "c"]
    weight: Int[np.ndarray, "w"]


def models(contexts: int, mixers: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Untaught chances, counts and weights."""
    chance = np.full(contexts, 1 << (CHANCE_BITS + FINE - 1), np.int64)
    return chance, np.zeros(contexts, np.int64), np.full(3 * mixers, WEIGHT_START, np.int64)


def many_weights(mixers: int, inputs: int) -> Int[np.ndarray, "w k"]:
    """Untaught weights of mixers of more than three contexts."""
    return np.full((mixers, inputs), MANY_START, np.int64)


@inner_kernel
def _shift_low(coder):
    state = coder.state
    if state[LOW] < CARRY or state[LOW] > WORD:
        carry = state[LOW] >> 32
        while state[PENDING] > 0:  # the cached byte, then bytes of 255 that a carry turns to 0
            if state[PLACE] >= 0:
                if state[PLACE] >= coder.buffer.shape[0]:
                    state[FAULT] = NO_ROOM
                    return
                coder.buffer[state[PLACE]] = (state[CACHE] + carry) & 0xFF
            state[PLACE] += 1
            state[CACHE] = 0xFF
            state[PENDING] -= 1
        state[CACHE] = (state[LOW] >> 24) & 0xFF
    state[PENDING] += 1
    state[LOW] = (state[LOW] & 0xFFFFFF) << 8


@inlined_kernel
def _next_byte(coder):
    state = coder.state
    place = state[PLACE]
    state[PLACE] = place + 1
    if place >= coder.buffer.shape[0]:
        state[FAULT] = READ_PAST
        return np.int64(0)
    return np.int64(coder.buffer[place])


@inner_kernel
def _code(coder, bit, chance):  # one decision, whose chance of being 1 is chance / 65536
    state = coder.state
    bound = (state[RANGE] >> 16) * chance
    if state[WRITES] == 1:
        if bit == 1:
            state[RANGE] = bound
        else:
            state[LOW] += bound
            state[RANGE] -= bound
        while state[RANGE] < SPLIT:
            state[RANGE] <<= 8
            _shift_low(coder)
        return bit
    if state[CODE] < bound:
        state[RANGE] = bound
        bit = np.int64(1)
    else:
        state[CODE] -= bound
        state[RANGE] -= bound
        bit = np.int64(0)
    while state[RANGE] < SPLIT:
        state[RANGE] <<= 8
        state[CODE] = (state[CODE] << 8) | _next_byte(coder)
    return bit


@inlined_kernel
def _learn(coder, slot, bit):
    n = coder.seen[slot]
    goal = bit << (CHANCE_BITS + FINE)
    coder.chance[slot] += ((goal - coder.chance[slot]) * RATES[n]) >> 16
    coder.seen[slot] = n + 1 if n < SLOWEST else n


@inner_kernel
def code_bit(coder, bit, a, b, c, mixer):  # a decision under contexts a, b, c, mixed with the weights of `mixer`
    chance, weight, w = coder.chance, coder.weight, 3 * mixer
    x, y, z = STRETCH[chance[a] >> 10], STRETCH[chance[b] >> 10], STRETCH[chance[c] >> 10]
    odds = (weight[w] * x + weight[w + 1] * y + weight[w + 2] * z) >> 16
    odds = min(max(odds, -ODDS_MOST), ODDS_MOST)
    p = min(max(SQUASH[odds + ODDS_MOST], CHANCE_LEAST), 65536 - CHANCE_LEAST)
    bit = _code(coder, bit, p)
    error = (bit << 16) - p
    weight[w] += (x * error) >> WEIGHT_RATE
    weight[w + 1] += (y * error) >> WEIGHT_RATE
    weight[w + 2] += (z * error) >> WEIGHT_RATE
    _learn(coder, a, bit)
    if b != a:
        _learn(coder, b, bit)
    if c != b:
        _learn(coder, c, bit)
    return bit


@inner_kernel
def code_mixed(coder, bit, slots, odds, weight, mixer):  # a decision under contexts slots (k,); odds (k,) is room; weight (mixers, k)
    total = 0
    for i in range(slots.shape[0]):
        odds[i] = STRETCH[coder.chance[slots[i]] >> 10]
        total += weight[mixer, i] * odds[i]
    total = min(max(total >> 16, -ODDS_MOST), ODDS_MOST)
    p = min(max(SQUASH[total + ODDS_MOST], CHANCE_LEAST), 65536 - CHANCE_LEAST)
    bit = _code(coder, bit, p)
    error = (bit << 16) - p
    for i in range(slots.shape[0]):
        weight[mixer, i] += (odds[i] * error) >> MANY_RATE
        _learn(coder, slots[i], bit)
    return bit


@inner_kernel
def code_sized(coder, m, base, slots, odds, weight, mixer):  # m >= 1: its class (1 2 3 4-5 6-7 8-11 12-15 ...) in unary, its place in it
    k, low, bits = 1, np.int64(1), 0
    while k <= SIZES:
        slot = min(k, SIZE_SLOTS - 1)
        for i in range(base.shape[0]):
            slots[i] = base[i] + slot
        if code_mixed(coder, np.int64(m >= low + (np.int64(1) << bits)), slots, odds, weight, mixer + slot) == 0:
            break
        low += np.int64(1) << bits
        k += 1
        bits = max(k // 2 - 1, 0)
    if k > SIZES:
        coder.state[FAULT] = TOO_LONG
        return low
    if bits == 0:
        return low
    slot = min(SIZE_SLOTS + (k // 2 - 2), SLOTS - 1)
    for i in range(base.shape[0]):
        slots[i] = base[i] + slot
    top = code_mixed(coder, ((m - low) >> (bits - 1)) & 1, slots, odds, weight, mixer + slot)
    return low + (top << (bits - 1)) + code_raw(coder, m - low, bits - 1)


@inner_kernel
def code_raw(coder, value, bits):  # the lowest `bits` bits, each as likely 0 as 1
    out = np.int64(0)
    for k in range(bits - 1, -1, -1):
        out = 2 * out + _code(coder, (value >> k) & 1, np.int64(32768))
    return out


@inner_kernel
def code_magnitude(coder, m, k, a, b, c, mixer):  # m >= k, in unary from k and then Exp-Golomb; contexts and mixers of SLOTS each
    while k < UNARY:
        if code_bit(coder, np.int64(m != k), a + k, b + k, c + k, mixer + k) == 0:
            return k
        k += 1
    rest, bits = m - UNARY + 1, 0
    while coder.state[WRITES] == 1 and (rest >> (bits + 1)) > 0:
        bits += 1
    z = np.int64(0)
    while True:
        slot = min(UNARY + 1 + z, SLOTS - 1)
        if code_bit(coder, np.int64(z < bits), a + slot, b + slot, c + slot, mixer + slot) == 0:
            break
        z += 1
        if z > PREFIX_MOST:
            coder.state[FAULT] = TOO_LONG
            return k
    return (np.int64(1) << z) + code_raw(coder, rest, z) + UNARY - 1


@kernel
def start_reading(coder):
    for _ in range(4):
        coder.state[CODE] = (coder.state[CODE] << 8) | _next_byte(coder)


@kernel
def finish_writing(coder):
    for _ in range(5):
        _shift_low(coder)


def writer(size: int, contexts: int, mixers: int) -> Coder:
    """A coder that writes up to `size` bytes and has learnt nothing."""
    return Coder(_writing(), np.zeros(size, np.uint8), *models(contexts, mixers))


def reader(data: bytes, contexts: int, mixers: int) -> Coder:
    """A coder that reads these bytes and has learnt nothing."""
    return opened(Coder(_writing(), np.zeros(0, np.uint8), *models(contexts, mixers)), data)


def renewed(coder: Coder, size: int) -> Coder:
    """A coder that writes up to `size` bytes and keeps, and goes on teaching, what this one has learnt."""
    return coder._replace(state=_writing(), buffer=np.zeros(size, np.uint8))


def opened(coder: Coder, data: bytes) -> Coder:
    """A coder that reads these bytes and keeps, and goes on teaching, what this one has learnt."""
    state = np.zeros(8, np.int64)
    state[RANGE] = WORD
    coder = coder._replace(state=state, buffer=np.frombuffer(data, np.uint8).copy())
    start_reading(coder)
    return coder


def copied(coder: Coder) -> Coder:
    """A coder that goes on from here without this one learning from it."""
    return Coder(*(part.copy() for part in coder))


def written(coder: Coder) -> bytes:
    """All bytes of a coder that writes, ended."""
    finish_writing(coder)
    return coder.buffer[: coder.state[PLACE]].tobytes()


def full(coder: Coder) -> bool:
    """Whether a writer ran out of room, with its last bytes in mind."""
    return bool(coder.state[FAULT] == NO_ROOM or coder.state[PLACE] + ENDING + coder.state[PENDING] > len(coder.buffer))


def consumed(coder: Coder) -> bool:
    """Whether a reader found no fault, and has taken all of its bytes."""
    return bool(coder.state[FAULT] == 0 and coder.state[PLACE] == len(coder.buffer))


def _writing() -> Int[np.ndarray, "8"]:
    """The state of a writer that has written nothing."""
    state = np.zeros(8, np.int64)
    state[RANGE], state[PENDING], state[PLACE], state[WRITES] = WORD, 1, -1, 1
    return state
