"""Wavelets and their coefficients as bytes: band by band, center by center, is there a wavelet, which, and how large.

Where coarser bands needed wavelets, finer ones will: what was told leaves a trace at its center and at its neighbours, half of
which goes down to the next level. A coefficient's size is expected from those told before. All that chooses a context is an integer.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Int

from morphlet.codec.atoms import AFFINE, FINEST_LEVEL, ODD, VOICES, Atoms, Level
from morphlet.codec.range_coder import CHANCE_BITS, FAULT, FINE, MALFORMED, SLOTS, WRITES, Coder, code_bit, code_magnitude, code_raw
from morphlet.numerics.compiled import inner_kernel, kernel

MOST_ATOMS = 2048
"""Of one file: readers factor a matrix of their products."""
BANDS = VOICES * (FINEST_LEVEL + 1)
AXES = 3
KINDS = len(ODD)
TURN_BITS = 3
UPPER, NEAR = 14, 8
"""Classes of the trace from the level above, and of that of the level itself."""
OWN, BESIDE = 4, 1
"""What a wavelet leaves at its center and at each neighbour of it, times its size."""
LARGEST_SIZE = 8
"""Of a wavelet, as a trace."""
ONE = 256
"""Magnitudes are expected in 1/256."""
FIRST_EXPECTED = np.array([10 * ONE, 10 * ONE, 10 * ONE, 0], np.int64)
"""At first: of each axis, and that nothing is known."""
MEMORY = 8
"""Expected magnitudes are means over about so many wavelets."""
CAPPED = np.int64(1 << 20)
"""What a larger coefficient counts as where another is expected: products stay below 2^63."""
LARGEST = np.int64(1 << 40)
"""Sum of magnitudes of a wavelet's coefficients beyond which a file is refused."""
SIZES, SHIFTS = 8, 4
"""Classes of the expected magnitude, halved until it is below 2; how often it was halved, at most 3."""

PLACE_NEAR = VOICES * UPPER * 8
PLACE_BAND = PLACE_NEAR + UPPER * NEAR
MORE = PLACE_BAND + BANDS
WHICH = MORE + BANDS
MAGNITUDES = WHICH + (BANDS + KINDS + 1) * KINDS
FIRST = MAGNITUDES + SLOTS * SIZES * (SHIFTS + AXES + UPPER)
CONTEXTS = FIRST + SLOTS * 2
"""Where which contexts start."""
AFFINE_MIXER = SLOTS * AXES
PLACE_MIXER = AFFINE_MIXER + SLOTS
WHICH_MIXER = PLACE_MIXER + 2
MIXERS = WHICH_MIXER + KINDS

UPPER_CHANCES = (614, 41, 12, 12, 8, 8, 25, 82, 123, 205, 328, 410, 410, 410)
BAND_CHANCES = (410, 410, 819, 819, 737, 614, 369, 246, 123, 61, 20, 8, 4, 4)
NEAR_CHANCE, MORE_CHANCE = 737, 82
ZERO_CHANCES = (480, 1257, 1826, 2237, 2539, 2764, 2937, 3072)
ON_CHANCES = (255, 743, 1175, 1539, 1839, 2086, 2289, 2458)
HALVED_CHANCES = (285, 285, 827, 1306, 1684, 1979, 2214, 2403)
"""First chances in 1/4096, rounded from counts on three animals: of a wavelet by the trace from above, by band, and beside another; of one
more; of a magnitude above 0, of going on, and of both where it was halved, for a two-sided geometric law of the class's mean."""
SEEN = 4
"""Decisions that first chances count for."""


class Field(NamedTuple):
    """One level while it is told (numba type): wavelets at each center, trace from above, trace of its own, neighbours."""

    own: Int[np.ndarray, "n"]
    above: Int[np.ndarray, "n"]
    trace: Int[np.ndarray, "n"]
    neighbours: Int[np.ndarray, "n 6"]


class Told(NamedTuple):
    """The wavelets of a file (numba type), `filled[0]` of them, filled while reading.

    `symbols` are quantised coefficients. `expected` holds the magnitude expected of each axis, and how many are known. Mothers
    are among `kinds`, and `odd` tells of each of the six whether it has a turn.
    """

    bands: Int[np.ndarray, "k"]
    centers: Int[np.ndarray, "k"]
    turns: Int[np.ndarray, "k"]
    mothers: Int[np.ndarray, "k"]
    symbols: Int[np.ndarray, "k 3"]
    filled: Int[np.ndarray, "1"]
    expected: Int[np.ndarray, "4"]
    kinds: Int[np.ndarray, "m"]
    odd: Int[np.ndarray, "6"]

    @property
    def atoms(self) -> Atoms:
        """Those that are known."""
        k = int(self.filled[0])
        return Atoms(self.bands[:k], self.centers[:k], self.mothers[:k], self.turns[:k])


def telling(atoms: Atoms, symbols: Int[np.ndarray, "k 3"], kinds: Int[np.ndarray, "m"]) -> Told:
    """Wavelets to be told, in the order of a file."""
    bands, centers, turns, mothers = (np.array(a, np.int64) for a in (atoms.bands, atoms.centers, atoms.turns, atoms.kinds))
    told, filled = np.array(symbols, np.int64, order="C"), np.array([len(atoms)], np.int64)
    return Told(bands, centers, turns, mothers, told, filled, FIRST_EXPECTED.copy(), kinds, ODD.astype(np.int64))


def blank(room: int, kinds: Int[np.ndarray, "m"]) -> Told:
    """Room for so many to be read."""
    nothing = np.zeros(room, np.int64)
    told = telling(Atoms(nothing, nothing, nothing, nothing), np.zeros((room, AXES), np.int64), kinds)
    return told._replace(filled=np.zeros(1, np.int64))


def next_field(level: Level, upper: Field | None) -> Field:
    """A level before any of its wavelets is told, after the one above."""
    n = len(level.points)
    above = np.zeros(n, np.int64) if upper is None else (upper.above + 2 * upper.trace)[level.parents].sum(axis=1) // 4
    return Field(np.zeros(n, np.int64), above, np.zeros(n, np.int64), level.neighbours)


def taught(coder: Coder) -> Coder:
    """The coder with the first chances that its contexts have here."""
    up = np.array(UPPER_CHANCES)
    alone = np.arange(VOICES * UPPER * 8) % 8 < 2  # no neighbour has one
    first = np.where(alone, np.tile(np.repeat(up, 8), VOICES), NEAR_CHANCE)
    near = np.where(np.arange(NEAR)[:, None] == 0, up, NEAR_CHANCE).ravel()
    places = np.concatenate([first, near, BAND_CHANCES, np.full(BANDS, MORE_CHANCE)])
    coder.chance[:WHICH], coder.seen[:WHICH] = places << (CHANCE_BITS + FINE - 12), SEEN
    chances = np.zeros((SHIFTS + AXES + UPPER, SIZES, SLOTS), np.int64)
    chances[:, :, 0], chances[:, :, 1:14] = ZERO_CHANCES, np.array(ON_CHANCES)[:, None]
    chances[1:SHIFTS, :, :14] = np.array(HALVED_CHANCES)[:, None]
    chances[:, :, 14:] = 1 << 11
    coder.chance[MAGNITUDES:FIRST], coder.seen[MAGNITUDES:FIRST] = chances.ravel() << (CHANCE_BITS + FINE - 12), SEEN
    return coder


@kernel
def code_affine(coder, symbols):  # type: ignore[no-untyped-def]  # symbols (4, 3): of 1, x, y, z
    for k in range(AFFINE):
        for j in range(AXES):
            a = FIRST + SLOTS * min(k, 1)
            m = code_magnitude(coder, abs(symbols[k, j]), np.int64(0), a, a, a, np.int64(AFFINE_MIXER))
            symbols[k, j] = -m if m > 0 and code_raw(coder, np.int64(symbols[k, j] < 0), np.int64(1)) == 1 else m


@kernel
def code_band(coder, told, field, band):  # type: ignore[no-untyped-def]  # all wavelets of one band; a reader adds them to those told
    place, writes = told.filled[0], coder.state[WRITES] == 1
    if writes:
        place = np.int64(0)
        while place < told.filled[0] and told.bands[place] < band:
            place += 1
    voice, previous = band % VOICES, np.int64(0)
    for j in range(AXES):
        told.expected[j] = max(told.expected[j] * 3 // 4, 1)
    for v in range(field.own.shape[0]):
        near = np.int64(0)
        for s in range(6):
            if field.neighbours[v, s] >= 0:
                near += field.own[field.neighbours[v, s]]
        up = _class(field.above[v], UPPER)
        a = ((voice * UPPER + up) * 4 + min(near, 3)) * 2 + min(field.own[v], 1)
        b = PLACE_NEAR + _class(field.trace[v], NEAR) * UPPER + up
        c, mixer = PLACE_BAND + band, np.int64(PLACE_MIXER)
        while True:
            here = writes and place < told.filled[0] and told.bands[place] == band and told.centers[place] == v
            if code_bit(coder, np.int64(here), a, b, c, mixer) == 0 or coder.state[FAULT] > 0:
                break
            if not writes:
                if place >= told.bands.shape[0]:
                    coder.state[FAULT] = MALFORMED
                    return
                told.filled[0] += 1
                told.bands[place], told.centers[place] = band, v
            size = _code_atom(coder, told, place, band, previous, up)
            _mark(field, v, size)
            previous = told.mothers[place]
            a = b = c = MORE + band
            mixer = np.int64(PLACE_MIXER + 1)
            place += 1


@inner_kernel
def _class(x, most):  # type: ignore[no-untyped-def]  # 0, 1, 2, 3-4, 5-8, 9-16, ...
    c = np.int64(0)
    while x > 0 and c < most - 1:
        c += 1
        x = x - 1 if x <= 2 else (x + 1) // 2
    return c


@inner_kernel
def _mark(field, v, size):  # type: ignore[no-untyped-def]
    field.own[v] += 1
    field.trace[v] += OWN * size
    for s in range(6):
        if field.neighbours[v, s] >= 0:
            field.trace[field.neighbours[v, s]] += BESIDE * size


@inner_kernel
def _code_atom(coder, told, place, band, previous, up):  # type: ignore[no-untyped-def]  # mother, turn and symbols of one wavelet; its size
    kind = told.kinds[told.kinds.shape[0] - 1]
    for i in range(told.kinds.shape[0] - 1):
        a, b, c = WHICH + band * KINDS + i, WHICH + (BANDS + previous) * KINDS + i, WHICH + (BANDS + KINDS) * KINDS + i
        if code_bit(coder, np.int64(told.mothers[place] == told.kinds[i]), a, b, c, np.int64(WHICH_MIXER + i)) == 1:
            kind = told.kinds[i]
            break
    told.mothers[place] = kind
    if told.odd[kind] == 1:
        told.turns[place] = code_raw(coder, told.turns[place], np.int64(TURN_BITS))
    e, total, known = told.expected, np.int64(0), np.int64(0)
    for j in range(AXES):
        guess = min(e[j] * (ONE * min(total, CAPPED) + known + 2 * ONE) // (2 * (known + ONE)), 4 * e[j])
        told.symbols[place, j] = _code_symbol(coder, told.symbols[place, j], guess, j, up)
        total += abs(told.symbols[place, j])
        known += e[j]
        if total > LARGEST:
            coder.state[FAULT] = MALFORMED
            return np.int64(0)
    e[AXES] = min(e[AXES] + 1, MEMORY)
    for j in range(AXES):
        e[j] = max(e[j] + (ONE * min(abs(told.symbols[place, j]), CAPPED) - e[j]) // (e[AXES] + 1), 1)
    return min(total, LARGEST_SIZE)


@inner_kernel
def _code_symbol(coder, value, guess, j, up):  # type: ignore[no-untyped-def]  # a coefficient of axis j, whose magnitude is expected to be so large
    shift = np.int64(0)
    while guess >= 2 * ONE:
        guess, shift = guess >> 1, shift + 1
    k = guess * SIZES // (2 * ONE)
    a = MAGNITUDES + SLOTS * (SIZES * min(int(shift), SHIFTS - 1) + k)
    b = MAGNITUDES + SLOTS * (SIZES * (SHIFTS + j) + k)
    c = MAGNITUDES + SLOTS * (SIZES * (SHIFTS + AXES + up) + k)
    high = code_magnitude(coder, abs(value) >> shift, np.int64(0), a, b, c, np.int64(SLOTS * j))
    m = (high << shift) + code_raw(coder, abs(value), shift)
    return -m if m > 0 and code_raw(coder, np.int64(value < 0), np.int64(1)) == 1 else m
