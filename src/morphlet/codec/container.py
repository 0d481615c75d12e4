"""The file: a header, then packets with checksums, each of which is checked before anything in it is believed.

All numbers are little-endian. A packet is a type, two counts, a length and a CRC-32 over all of that and the payload,
which goes on from the checksum before it. Whatever
is wrong with a file ends in one error, `CodecError`; a file that ends between two packets is told apart, since what came
before is good.
"""

import math
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from morphlet.errors import MorphletError

MAGIC: Final = b"MWNC"
MAJOR, MINOR = 1, 0
SEQUENCE, EXACT = 1, 2
"""Modes: a rest mesh and frames; one mesh."""
SCHEMES = (1, 1, 1, 1)
"""Connectivity, positions, hierarchy, frames: which coder of each."""
UNKNOWN = 0xFFFFFFFF
"""Number of frames that a stream does not know when it starts."""
FACES, POSITIONS, ORDER, TIMES, FRAMES, END = 1, 2, 3, 4, 5, 6
"""Types of packets, in the order in which they come."""
SKIPPABLE = 0x80
"""A reader that does not know a type with this bit passes over it."""
KNOWN = {FACES, POSITIONS, FRAMES, TIMES, ORDER, END}
_HEADER = struct.Struct("<4s4B3I6d2B4BI")
HEADER_SIZE = _HEADER.size + 4
"""Bytes of the header with its checksum."""
LONGEST_NUMBER = 10
"""Bytes of a packet's counts, at most."""
LONGEST_PACKET = 1 << 31
CHECKSUM = struct.Struct("<I")


class CodecError(MorphletError, ValueError):
    """Bytes that are no `.mlw` file, a damaged one, or one of a later version."""

    exit_code = 4


def damaged(found: str, needed: str = "an intact .mlw file") -> CodecError:
    """The error of a file that says what no writer says."""
    return CodecError(needed, found, "get the file again, or encode it anew")


@dataclass(frozen=True)
class Limits:
    """What a reader accepts, so that a small file cannot ask for all of the memory.

    Parameters
    ----------
    vertices, faces, frames
        Most of each.

    Examples
    --------
    >>> from morphlet import CodecError, Limits, decode, encode, sample
    >>> try:
    ...     decode(encode(sample("blob")).data, Limits(vertices=100))
    ... except CodecError as error:
    ...     error.advice
    'raise the limits if the file can be trusted'
    """

    vertices: int = 1 << 26
    faces: int = 1 << 27
    frames: int = 1 << 20


@dataclass(frozen=True)
class Header:
    """What a file holds.

    Parameters
    ----------
    mode
        `SEQUENCE` or `EXACT`.
    vertices, faces, frames
        How many; frames beside the rest mesh, or `UNKNOWN`.
    origin, spacing
        Positions of the rest mesh are origin + spacing * integers.
    step, finest
        Step of the frames' differences; that of the coarsest vertices is finest / 64 of it.
    layers
        Parts of the hierarchy that packets are divided by, coarse to fine.
    error
        Largest distance of a vertex from where it was, in mesh units.
    hierarchy
        Checksum of the hierarchy's records; 0 without frames.
    """

    mode: int
    vertices: int
    faces: int
    frames: int
    origin: tuple[float, float, float]
    spacing: float
    step: float
    error: float
    finest: int
    layers: int
    hierarchy: int

    def encoded(self) -> tuple[bytes, int]:
        """The header as a file has it; its checksum."""
        counts = self.vertices, self.faces, self.frames
        reals = *self.origin, self.spacing, self.step, self.error
        body = _HEADER.pack(MAGIC, MAJOR, MINOR, self.mode, 0, *counts, *reals, self.finest, self.layers, *SCHEMES, self.hierarchy)
        own = checksum(body, 0)
        return body + CHECKSUM.pack(own), own


@dataclass(frozen=True)
class Packet:
    """One packet: its type, what it covers (of `FRAMES`: how many frames, and of which layer), and its payload."""

    kind: int
    count: int
    layer: int
    payload: bytes

    def encoded(self, chain: int) -> tuple[bytes, int]:
        """The packet as a file has it, after a packet (or the header) with the checksum `chain`; its own checksum."""
        head = bytes([self.kind]) + _number(self.count) + _number(self.layer) + _number(len(self.payload))
        own = checksum(head + self.payload, chain)
        return head + CHECKSUM.pack(own) + self.payload, own


def checksum(content: bytes, chain: int) -> int:
    """CRC-32 that goes on from that of what came before: packets of other files, or in another order, do not fit."""
    return zlib.crc32(content, chain)


def _number(value: int) -> bytes:
    """Seven bits a byte, lowest first; all but the last have the highest bit."""
    out = bytearray()
    while value >= 0x80:
        out.append(0x80 | (value & 0x7F))
        value >>= 7
    return bytes([*out, value])


class Source:
    """Bytes that come in pieces: what has come is kept until it is read."""

    def __init__(self, pieces: Iterable[bytes]) -> None:
        self._pieces = iter(pieces)
        self._kept = bytearray()

    def has(self, count: int) -> bool:
        """Whether so many bytes are left; takes pieces until they are, or none comes."""
        while len(self._kept) < count:
            piece = next(self._pieces, None)
            if piece is None:
                return False
            self._kept += piece
        return True

    def take(self, count: int) -> bytes:
        """So many bytes.

        Raises
        ------
        CodecError
            If fewer are left.
        """
        if not self.has(count):
            raise damaged(f"its end after {len(self._kept)} of {count} bytes of a packet")
        taken = bytes(self._kept[:count])
        del self._kept[:count]
        return taken


def read_header(source: Source, limits: Limits) -> tuple[Header, int]:
    """The header of a file, checked, and its checksum.

    Raises
    ------
    CodecError
        If these are other bytes, they are damaged, of a later major version, or claim more than the limits.
    """
    raw = source.take(HEADER_SIZE) if source.has(HEADER_SIZE) else b""
    if raw[:4] != MAGIC:
        raise damaged(f"{len(raw)} bytes that do not start with {MAGIC.decode()}", "a .mlw file")
    if raw[4] != MAJOR:
        raise CodecError(f"version {MAJOR} of .mlw", f"version {raw[4]}", "update morphlet")
    body = raw[: _HEADER.size]
    told = CHECKSUM.unpack(raw[_HEADER.size :])[0]
    if told != checksum(body, 0):
        raise damaged("a header with a wrong checksum")
    return _checked(_HEADER.unpack(body), limits), told


def _checked(fields: tuple[Any, ...], limits: Limits) -> Header:
    """The header of these fields, if they make sense and stay within the limits."""
    mode, flags, counts, reals, rest = fields[3], fields[4], fields[5:8], fields[8:14], fields[14:]
    vertices, faces, frames = (int(c) for c in counts)
    most = limits.frames if frames != UNKNOWN else UNKNOWN
    if vertices > limits.vertices or faces > limits.faces or frames > most:
        found = f"{vertices} vertices, {faces} faces, {frames} frames"
        raise CodecError("a mesh within the reader's limits", found, "raise the limits if the file can be trusted")
    sound = all(math.isfinite(r) for r in reals) and min(reals[3:]) > 0
    finest, layers, *schemes, hierarchy = (int(r) for r in rest)
    if not sound or mode not in (SEQUENCE, EXACT) or flags or tuple(schemes) != SCHEMES or not layers or (mode == EXACT and frames):
        raise damaged("a header that makes no sense, or of a coder that is not known")
    origin = float(reals[0]), float(reals[1]), float(reals[2])
    return Header(int(mode), vertices, faces, frames, origin, float(reals[3]), float(reals[4]), float(reals[5]), finest, layers, hierarchy)


def read_packets(source: Source, chain: int) -> Iterator[Packet]:
    """The packets of a file after a header with the checksum `chain`, each checked.

    The last one is `END` unless the file was cut between two.

    Raises
    ------
    CodecError
        If one is damaged, cut, of an unknown type, or follows the end.
    """
    before = 0
    while source.has(1):
        packet, chain = _read_packet(source, chain)
        if packet.kind == END and packet.count != before:
            raise damaged(f"{before} packets where there were {packet.count}")
        before += 1
        if packet.kind in KNOWN:
            yield packet
        elif not packet.kind & SKIPPABLE:
            raise CodecError("packets of known types", f"type {packet.kind}", "update morphlet")
        if packet.kind == END:
            if source.has(1):
                raise damaged("bytes after its end")
            return


def _read_packet(source: Source, chain: int) -> tuple[Packet, int]:
    """The next packet and its checksum."""
    head = bytearray(source.take(1))
    numbers = []
    for _ in range(3):
        start = len(head)
        while len(head) - start < LONGEST_NUMBER and (len(head) == start or head[-1] & 0x80):
            head += source.take(1)
        numbers.append(sum((byte & 0x7F) << (7 * k) for k, byte in enumerate(head[start:])))
    count, layer, length = numbers
    if length > LONGEST_PACKET:
        raise damaged(f"a packet of {length} bytes")
    told = CHECKSUM.unpack(source.take(CHECKSUM.size))[0]
    payload = source.take(length)
    if told != checksum(bytes(head) + payload, chain):
        raise damaged("a packet with a wrong checksum, or of another file")
    return Packet(head[0], count, layer, payload), told
