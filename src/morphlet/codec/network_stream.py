"""Payloads of a network: its head, then bands of wavelets, cut into packets from coarse to fine."""

import math
import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Int

from morphlet.codec.atom_coder import (
    BANDS,
    CONTEXTS,
    LARGEST,
    MIXERS,
    MOST_ATOMS,
    Told,
    blank,
    code_affine,
    code_band,
    next_field,
    taught,
    telling,
)
from morphlet.codec.atoms import AFFINE, FINEST_LEVEL, VOICES, Atoms, Level, levels_up_to
from morphlet.codec.container import damaged
from morphlet.codec.range_coder import PLACE, consumed, full, opened, reader, renewed, writer, written
from morphlet.errors import InputError, SolveError
from morphlet.wavenet.mothers import PAPER_SIX

STEPS_PER_OCTAVE = 16
"""Steps are powers of the 16th root of 2."""
FIRST_CUT = 256
"""Bytes after which a new packet starts; then after twice as many, and so on."""
LEAST_PACKET = 128
"""Bytes of the last packet, at least: each costs about 13."""
ROOM = 1 << 16
"""Bytes of the largest network: 32 for each of 2048 wavelets."""
LEAST_LEVEL, LAST_LEVEL = 3, 8
"""Subdivisions of the mesh that a reader makes."""
MOST_EXPONENT = 480 * STEPS_PER_OCTAVE
"""Of steps: squares of coordinates do not overflow."""


@dataclass(frozen=True)
class Head:
    """What a network starts with.

    Parameters
    ----------
    kinds
        Which of the paper's mothers may occur, ascending.
    exponent
        Of the step of the coefficients, 2^(exponent / 16) mesh units.
    reference
        Level whose points tell which terms are orthogonal.
    level
        Subdivisions of the mesh that a reader makes.
    """

    kinds: tuple[int, ...]
    exponent: int
    reference: int
    level: int

    STRUCT = struct.Struct("<BhB")

    @property
    def step(self) -> float:
        """Of the coefficients, in mesh units."""
        return step_of(self.exponent)

    def encoded(self) -> bytes:
        """Four bytes."""
        return self.STRUCT.pack(sum(1 << k for k in self.kinds), self.exponent, self.reference << 4 | self.level)

    @staticmethod
    def decoded(data: bytes) -> "Head":
        """The head at the start of the first payload, if it makes sense."""
        if len(data) < Head.STRUCT.size:
            raise damaged("a network without its beginning")
        mask, exponent, levels = Head.STRUCT.unpack_from(data)
        kinds = tuple(k for k in range(len(PAPER_SIX)) if mask >> k & 1)
        head = Head(kinds, exponent, levels >> 4, levels & 15)
        sound = 0 < mask < 1 << len(PAPER_SIX) and 0 < head.reference <= FINEST_LEVEL and LEAST_LEVEL <= head.level <= LAST_LEVEL
        if not sound or abs(exponent) > MOST_EXPONENT:
            raise damaged("a network's beginning that makes no sense")
        return head


def step_of(exponent: int) -> float:
    """2^(exponent / 16)."""
    return math.ldexp(2.0 ** (exponent % STEPS_PER_OCTAVE / STEPS_PER_OCTAVE), exponent // STEPS_PER_OCTAVE)


def write_network(head: Head, atoms: Atoms, symbols: Int[np.ndarray, "a 3"], levels: Sequence[Level]) -> list[bytes]:
    """Payloads, cut where a file of one packet would pass 256 bytes, twice that and so on.

    Raises
    ------
    InputError
        If a coefficient is beyond 2^40: a mesh far from the origin, or a step that is too fine.
    """
    if np.abs(symbols).sum(axis=1).max(initial=0) > LARGEST:
        raise InputError("coefficients up to 2^40 steps", f"{np.abs(symbols).sum(axis=1).max():.3g}", "move the mesh nearer to the origin")
    whole, places = _told(head, atoms, symbols, levels, ())
    total, cuts, goal = len(whole[0]), [], FIRST_CUT
    for band, place in enumerate(places[:-1]):
        if place >= goal and total - place >= LEAST_PACKET:
            cuts.append(band + 1)
            goal = 2 * place
    payloads = _told(head, atoms, symbols, levels, tuple(cuts))[0] if cuts else whole
    return [head.encoded() + payloads[0], *payloads[1:]]


def _told(
    head: Head, atoms: Atoms, symbols: Int[np.ndarray, "a 3"], levels: Sequence[Level], cuts: tuple[int, ...]
) -> tuple[list[bytes], list[int]]:
    """Payloads that start at these bands, each with the number of its bands first; and where in its payload each band ends."""
    bands = int(atoms.bands[-1]) + 1 if len(atoms) else 0
    told = telling(atoms, symbols[AFFINE:], np.array(head.kinds, np.int64))
    coder, field = taught(writer(ROOM, CONTEXTS, MIXERS)), None
    code_affine(coder, symbols[:AFFINE].copy())
    payloads, places, start = [], [], 0
    for band in range(bands):
        if band in cuts:
            payloads.append(bytes([band - start]) + written(coder))
            start, coder = band, renewed(coder, ROOM)
        if band % VOICES == 0:
            field = next_field(levels[band // VOICES], field)
        code_band(coder, told, field, np.int64(band))
        places.append(int(coder.state[PLACE]))
    if full(coder):
        raise SolveError(f"a network of at most {ROOM} bytes", "a larger one", "ask for a larger error, or for fewer wavelets")
    return [*payloads, bytes([bands - start]) + written(coder)], places


def read_payloads(payloads: Sequence[bytes]) -> tuple[Head, Atoms, Int[np.ndarray, "a 3"], list[Level]]:
    """What `write_network` was given, or its coarse part if payloads are missing at the end."""
    head = Head.decoded(payloads[0] if payloads else b"")
    levels = levels_up_to(head.reference)
    told = blank(min(MOST_ATOMS, sum(map(len, payloads))), np.array(head.kinds, np.int64))
    affine = _read([payloads[0][Head.STRUCT.size :], *payloads[1:]], told, levels)
    return head, told.atoms, np.concatenate([affine, told.symbols[: told.filled[0]]]), levels


def _read(bodies: Sequence[bytes], told: Told, levels: Sequence[Level]) -> Int[np.ndarray, "4 3"]:
    """Coefficients of 1, x, y, z; those of the wavelets go into `told`."""
    affine, field, coder = np.zeros((AFFINE, 3), np.int64), None, None
    first = 0
    for body in bodies:
        if not body or first + body[0] > min(BANDS, VOICES * len(levels)):
            raise damaged("a network's packet with too many bands, or none")
        if coder is None:
            coder = taught(reader(body[1:], CONTEXTS, MIXERS))
            code_affine(coder, affine)
        else:
            coder = opened(coder, body[1:])
        for band in range(first, first + body[0]):
            if band % VOICES == 0:
                field = next_field(levels[band // VOICES], field)
            code_band(coder, told, field, np.int64(band))
        first += body[0]
        if not consumed(coder):
            raise damaged("a network's packet that cannot be read")
    return affine
