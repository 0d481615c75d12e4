"""The file: a header, then packets with checksums, each of which is checked before anything in it is believed.

All numbers are little-endian; whole ones take seven bits a byte, real ones are the upper half of a double. A packet is a type,
two counts, a length and a CRC-32 over all of that and the payload, which goes on from the checksum before it. Whatever
is wrong with a file ends in one error, `CodecError`; a file that ends between two packets is told apart, since what came
before is good.
"""

import math
import struct
import zlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from morphlet.errors import MorphletError

MAGIC: Final = b"MWNC"
MAJOR, MINOR = 1, 0
SEQUENCE, EXACT, SHAPE, NETWORK, DECIMATED = 1, 2, 3, 4, 5
"""Modes: a rest mesh and frames; one mesh; its surface as a coarse mesh and detail, as a wavelet network, as a mesh of fewer faces."""
MODES = {SEQUENCE: "sequence", EXACT: "exact", SHAPE: "shape", NETWORK: "mlwnn", DECIMATED: "decimated"}
ON_LATTICES = SEQUENCE, EXACT, DECIMATED
"""Modes whose vertices are told one by one."""
UNKNOWN = -1
"""Number of frames that a stream does not know when it starts."""
FACES, POSITIONS, ORDER, TIMES, FRAMES, END, SURFACE = 1, 2, 3, 4, 5, 6, 7
"""Types of packets; of the first two modes in the order in which they come."""
SKIPPABLE = 0x80
"""A reader that does not know a type with this bit passes over it."""
KNOWN = {FACES, POSITIONS, FRAMES, TIMES, ORDER, END, SURFACE}
LONGEST_NUMBER = 10
"""Bytes of a whole number, at most."""
FARTHEST = 1 << 50
"""Corners of lattices lie within so many spacings of the origin."""
LONGEST_PACKET = 1 << 31
CHECKSUM = struct.Struct("<I")
_REAL = struct.Struct("<d")
_HALF = 4


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
    """What a file holds; what its mode has no use for is not in the file.

    Parameters
    ----------
    mode
        One of `MODES`.
    vertices, faces
        Of the mesh that is read.
    error
        Largest distance of a vertex from where it was, in mesh units; of modes that change vertices and faces, the root mean
        square distance of the surfaces.
    corner, spacing
        Positions of the rest mesh are spacing * (corner + integers).
    frames
        Beside the rest mesh, or `UNKNOWN`.
    step, finest
        Step of the frames' differences; that of the coarsest vertices is finest / 64 of it.
    layers
        Parts of the hierarchy that packets are divided by, coarse to fine.
    hierarchy
        Checksum of the hierarchy's records.
    """

    mode: int
    vertices: int
    faces: int
    error: float
    corner: tuple[int, int, int] = (0, 0, 0)
    spacing: float = 1.0
    frames: int = 0
    step: float = 1.0
    finest: int = 1
    layers: int = 1
    hierarchy: int = 0

    def encoded(self) -> tuple[bytes, int]:
        """The header as a file has it; its checksum."""
        body = MAGIC + bytes([MAJOR, MINOR, self.mode, 0]) + _number(self.vertices) + _number(self.faces) + _real(self.error)
        if self.mode in ON_LATTICES:
            body += _real(self.spacing) + b"".join(_number(2 * c if c >= 0 else -2 * c - 1) for c in self.corner)
        if self.mode == SEQUENCE:
            body += _number(self.frames + 1) + _real(self.step) + bytes([self.finest, self.layers]) + CHECKSUM.pack(self.hierarchy)
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


def rounded_down(value: float) -> float:
    """The largest number that a file can hold and is at most this one, which is positive."""
    return float(_REAL.unpack(bytes(_HALF) + _REAL.pack(value)[_HALF:])[0])


def rounded_up(value: float) -> float:
    """The least number that a file can hold and is at least this one, which is positive."""
    below = rounded_down(value)
    upper = int.from_bytes(_REAL.pack(value)[_HALF:], "little") + 1
    return below if below == value else float(_REAL.unpack(bytes(_HALF) + upper.to_bytes(_HALF, "little"))[0])


def _real(value: float) -> bytes:
    """The upper half of a double."""
    return _REAL.pack(value)[_HALF:]


class _Record:
    """Fields one after the other, and the bytes they were."""

    def __init__(self, source: "Source") -> None:
        self._source, self.raw = source, bytearray()

    def take(self, count: int) -> bytes:
        """So many bytes."""
        found = self._source.take(count)
        self.raw += found
        return found

    def number(self) -> int:
        """A whole number."""
        value, byte = 0, 0x80
        for k in range(LONGEST_NUMBER):
            byte = self.take(1)[0]
            value |= (byte & 0x7F) << (7 * k)
            if byte < 0x80:
                break
        return value

    def signed(self) -> int:
        """A whole number of either sign."""
        value = self.number()
        return value >> 1 if value % 2 == 0 else -((value + 1) >> 1)

    def real(self) -> float:
        """The upper half of a double."""
        return float(_REAL.unpack(bytes(_HALF) + self.take(_HALF))[0])

    def checksum(self) -> int:
        """What follows as the checksum, which is not part of the record."""
        return int(CHECKSUM.unpack(self._source.take(CHECKSUM.size))[0])


def read_header(source: Source, limits: Limits) -> tuple[Header, int]:
    """The header of a file, checked, and its checksum.

    Raises
    ------
    CodecError
        If these are other bytes, they are damaged, of a later major version, or claim more than the limits.
    """
    record = _Record(source)
    start = record.take(8) if source.has(8) else b""
    if start[:4] != MAGIC:
        raise damaged(f"{len(start)} bytes that do not start with {MAGIC.decode()}", "a .mlw file")
    if start[4] != MAJOR:
        raise CodecError(f"version {MAJOR} of .mlw", f"version {start[4]}", "update morphlet")
    if start[6] not in MODES or start[7]:
        raise damaged("a header that makes no sense, or of a coder that is not known")
    header = _fields(start[6], record)
    told = record.checksum()
    if told != checksum(bytes(record.raw), 0):
        raise damaged("a header with a wrong checksum")
    return _checked(header, limits), told


def _fields(mode: int, record: _Record) -> Header:
    """The fields that a header of this mode has."""
    header = Header(mode, record.number(), record.number(), record.real())
    if mode in ON_LATTICES:
        header = replace(header, spacing=record.real(), corner=(record.signed(), record.signed(), record.signed()))
    if mode == SEQUENCE:
        header = replace(header, frames=record.number() - 1, step=record.real())
        finest, layers = record.take(2)
        header = replace(header, finest=finest, layers=layers, hierarchy=int(CHECKSUM.unpack(record.take(CHECKSUM.size))[0]))
    return header


def _checked(header: Header, limits: Limits) -> Header:
    """The header, if it makes sense and stays within the limits."""
    vertices, faces, frames = header.vertices, header.faces, header.frames
    if vertices > limits.vertices or faces > limits.faces or frames > limits.frames:
        found = f"{vertices} vertices, {faces} faces, {frames} frames"
        raise CodecError("a mesh within the reader's limits", found, "raise the limits if the file can be trusted")
    reals = header.spacing, header.step, header.error
    far = max(abs(c) for c in header.corner) > FARTHEST or not math.isfinite(FARTHEST * header.spacing)
    if not all(math.isfinite(r) and r > 0 for r in reals) or not header.layers or far:
        raise damaged("a header that makes no sense, or of a coder that is not known")
    return header


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
    record = _Record(source)
    kind = record.take(1)[0]
    count, layer, length = record.number(), record.number(), record.number()
    if length > LONGEST_PACKET:
        raise damaged(f"a packet of {length} bytes")
    told = record.checksum()
    payload = source.take(length)
    if told != checksum(bytes(record.raw) + payload, chain):
        raise damaged("a packet with a wrong checksum, or of another file")
    return Packet(kind, count, layer, payload), told
