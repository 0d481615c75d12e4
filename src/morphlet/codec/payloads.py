"""Payloads of a subdivided surface: how it starts, its coarse mesh, its moves level by level."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from morphlet.codec.container import damaged
from morphlet.codec.displacement import CONTEXTS, MIXERS, ONE, code_moves
from morphlet.codec.range_coder import consumed, opened, reader, renewed, writer, written
from morphlet.codec.subdivision import Refinement, refined_sizes

_HEAD = struct.Struct("<4f5B")
"""Origin, spacing; first step in 1/16 spacings, growth of steps in 1/64, levels, levels with moves, where payloads start."""
RATIO_ONE, GROWTH_ONE = 16, 64
MOST_LEVELS = 6
MOST_VERTICES = 1 << 21
"""Of a mesh that is read: each takes some 500 bytes on the way, and a few bytes can ask for thousands."""
SMALL = 200
"""Bytes of moves below which a payload of their own would not pay."""
ROOM = 1 << 16
"""Bytes that a writer starts with, and eight for each move."""
LONGEST_NUMBER = 5
"""Bytes of a stored count, at most."""
HIGHEST = 0x80
"""The bit of a byte that says that its number goes on."""


@dataclass(frozen=True)
class Law:
    """How numbers become positions.

    Parameters
    ----------
    origin, spacing
        Control points are at origin + spacing times integers.
    ratio
        Step of the first level's moves, in 1/16 spacings.
    growth
        Of the step from level to level, in 1/64.
    levels, coded
        Times that faces are split, and how many of these levels have moves.
    cuts
        Bit l is set where level l starts a payload.
    """

    origin: tuple[float, float, float]
    spacing: float
    ratio: int
    growth: int
    levels: int
    coded: int
    cuts: int

    @property
    def steps(self) -> list[float]:
        """Of each level with moves."""
        steps = [self.spacing * self.ratio / RATIO_ONE]
        for _ in range(1, self.coded):
            steps.append(steps[-1] * self.growth / GROWTH_ONE)
        return steps

    def encoded(self) -> bytes:
        """As the first payload starts."""
        return _HEAD.pack(*self.origin, self.spacing, self.ratio, self.growth, self.levels, self.coded, self.cuts)


def sizes(payload: bytes) -> tuple[int, int, int]:
    """Levels of a surface from its first payload, and vertices and faces of its coarse mesh.

    Raises
    ------
    CodecError
        If it does not start like one.
    """
    if len(payload) < _HEAD.size:
        raise damaged(f"{len(payload)} bytes that start a surface")
    levels, ((n, m), _) = _HEAD.unpack_from(payload)[6], _numbers(payload, _HEAD.size, 2)
    if levels > MOST_LEVELS or m % 2:
        raise damaged("a start of a surface that makes no sense")
    return levels, n, m


def unpacked(payload: bytes, vertices: int) -> tuple[Law, tuple[int, int], tuple[bytes, bytes, bytes]]:
    """The first payload: its law, vertices and faces of the coarse mesh, bytes of its faces, its points and the first moves.

    Raises
    ------
    CodecError
        If it makes no sense, or the surface has another number of vertices, or too many.
    """
    levels, n, m = sizes(payload)
    found = refined_sizes(n, m, levels)[0]
    if found != vertices or max(n, vertices) > MOST_VERTICES:
        raise damaged(f"a surface of {found} vertices where there are {vertices}")
    *reals, ratio, growth, levels, coded, cuts = _HEAD.unpack_from(payload)
    origin, spacing = (float(reals[0]), float(reals[1]), float(reals[2])), float(reals[3])
    (n, m, *lengths), place = _numbers(payload, _HEAD.size, 4)
    if not (all(map(math.isfinite, reals)) and spacing > 0 and ratio and growth and coded <= levels) or max(lengths) > len(payload):
        raise damaged("a start of a surface that makes no sense")
    middle = place + lengths[0]
    parts = payload[place:middle], payload[middle : middle + lengths[1]], payload[middle + lengths[1] :]
    return Law(origin, spacing, ratio, growth, levels, coded, cuts), (n, m), parts


def packed(law: Law, levels: Sequence[Refinement], coarse: tuple[int, int, bytes, bytes], moves: Sequence[np.ndarray]) -> list[bytes]:
    """All payloads: of a coarse mesh its vertices and faces, and the bytes of its faces and points; of all levels the moves."""
    n, m, faces, points = coarse
    groups, cuts = _grouped(levels, moves, len(faces) + len(points))
    first = replace(law, cuts=cuts).encoded() + b"".join(_number(k) for k in (n, m, len(faces), len(points))) + faces + points
    if groups and not cuts & 1:
        first += groups.pop(0)
    return [first, *groups]


def read_moves(law: Law, levels: Sequence[Refinement], payloads: Sequence[bytes]) -> list[Int[np.ndarray, "e"]]:
    """Moves of the levels that the payloads tell.

    Raises
    ------
    CodecError
        If one is damaged, or there are more.
    """
    left, found, coder = list(payloads), list[np.ndarray](), None
    size = _untaught(levels)
    for number in range(law.coded):
        if number == 0 or law.cuts >> number & 1:
            if not left or (coder is not None and not consumed(coder)):
                break
            data = left.pop(0)
            coder = reader(data, CONTEXTS, MIXERS) if coder is None else opened(coder, data)
        moves = np.zeros(len(levels[number].ends), np.int64)
        size = np.concatenate([size, moves])
        code_moves(coder, moves, levels[number].ends, levels[number].near, size, np.int64(number))
        found.append(moves)
    if left or (coder is not None and not consumed(coder)):
        raise damaged("moves that cannot be read")
    return found


def _grouped(levels: Sequence[Refinement], moves: Sequence[Int[np.ndarray, "_"]], before: int) -> tuple[list[bytes], int]:
    """Payloads of all moves, and the levels at which they start; a level with few bytes goes with the one before it."""
    sizes = [len(data) for data in _coded_moves(levels, moves, ~0)]
    cuts, since = 0, before
    for number, size in enumerate(sizes):
        if min(since, size) >= SMALL:
            cuts, since = cuts | 1 << number, 0
        since += size
    return _coded_moves(levels, moves, cuts), cuts


def _coded_moves(levels: Sequence[Refinement], moves: Sequence[Int[np.ndarray, "_"]], cuts: int) -> list[bytes]:
    """Payloads of moves that start at the levels of these bits, and at the first."""
    room = ROOM + 8 * sum(len(each) for each in moves)
    done, coder = [], writer(room, CONTEXTS, MIXERS)
    size = _untaught(levels)
    for number, told in enumerate(moves):
        if number and cuts >> number & 1:
            done.append(written(coder))
            coder = renewed(coder, room)
        size = np.concatenate([size, np.zeros_like(told)])
        code_moves(coder, told.copy(), levels[number].ends, levels[number].near, size, np.int64(number))
    return [*done, written(coder)] if moves else []


def _number(value: int) -> bytes:
    """Seven bits a byte, lowest first; all but the last have the highest bit."""
    out = bytearray()
    while value >= HIGHEST:
        out.append(HIGHEST | (value & 0x7F))
        value >>= 7
    return bytes([*out, value])


def _untaught(levels: Sequence[Refinement]) -> Int[np.ndarray, "n"]:
    """Magnitudes of the coarse mesh's vertices, as contexts take them."""
    return np.full(levels[0].even.shape[0] if levels else 0, ONE, np.int64)


def _numbers(data: bytes, place: int, count: int) -> tuple[list[int], int]:
    """So many numbers of 7 bits a byte, lowest first; the place after them."""
    found = []
    for _ in range(count):
        value, shift = 0, 0
        while True:
            if place >= len(data) or shift >= 7 * LONGEST_NUMBER:
                raise damaged("a number without an end")
            value |= (data[place] & 0x7F) << shift
            place, shift = place + 1, shift + 7
            if not data[place - 1] & HIGHEST:
                break
        found.append(value)
    return found, place
