"""Meshes and mesh sequences to bytes and back, every vertex within an error that was asked for.

The first frame is the rest mesh: it is told on an integer lattice, faces and all, and every further frame by how it differs
from a motion of what is known. What the reader will have is known to the writer to the last bit, and is checked against the
error before anything is handed out. Vertices and faces come back in an order of the coder's choosing unless theirs is kept.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.codec import poses
from morphlet.codec.container import (
    END,
    EXACT,
    FACES,
    FRAMES,
    ORDER,
    POSITIONS,
    SEQUENCE,
    TIMES,
    UNKNOWN,
    CodecError,
    Header,
    Limits,
    Packet,
    Source,
    damaged,
    read_header,
    read_packets,
)
from morphlet.codec.hierarchy import Records, coarse_to_fine
from morphlet.codec.poses import ERROR_PER_STEP, FINEST_ONE, Law, Reference, Told
from morphlet.codec.rest import Shape, as_they_came, read_faces, read_order, read_positions, write_faces, write_order, write_positions
from morphlet.errors import InputError, SolveError
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.sequence import MeshSequence

FINE_OF_DIAGONAL = 1e-3
"""Error unless another is asked for, in bounding-box diagonals."""
LATTICE_SHARE = 1e-6
"""By how much steps are smaller than the error allows: sums of three squares round."""
SINGLE = 2.0**-24
"""Largest relative error of a number rounded to single precision, which files of meshes hold."""
ROUND_WORTH = 0.25
"""Room is left for that rounding where it takes at most a quarter of the error."""
LATTICE_BITS = 28
"""Positions of the rest mesh are below 2^28 spacings."""
LOOSE_PER_BYTE = 8
"""Vertices without faces that a byte of positions can tell."""
BITS = 8


@dataclass(frozen=True)
class CodecOptions:
    """How a sequence is told.

    Parameters
    ----------
    reference
        What frames are predicted from: the rest mesh; that, the two frames before and where they lead; or a blend of up to
        four of all that and the 16 frames before, at some three times the time.
    order
        "free": vertices and faces come back in the coder's order. "kept": in the caller's, whose order is stored too.
    rest_share
        Spacing of the rest mesh's lattice, in steps of the frames' differences; only sequences have it.
    finest
        Step of the coarsest vertices, which carry all others, in steps of the finest.
    packet_frames
        Frames per packet: a reader gets so many at once.
    layers
        Above 1, packets come coarse to fine, for all frames: a file cut between two packets shows all frames, less precisely.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> from morphlet import CodecOptions, encode, sample
    >>> file = encode(sample("blob"), error=0.01, options=CodecOptions(order="kept"))
    >>> file.report.order_bytes > 0, file.permutation[:3].tolist()
    (True, [0, 1, 2])
    """

    reference: Reference = "best"
    order: Literal["free", "kept"] = "free"
    rest_share: float = 0.25
    finest: float = 0.375
    packet_frames: int = 16
    layers: int = 1

    def __post_init__(self) -> None:
        choices = {"reference": (self.reference, tuple(poses.CANDIDATES)), "order": (self.order, ("free", "kept"))}
        for name, (value, known) in choices.items():
            if value not in known:
                raise InputError(f"{name} {' or '.join(known)}", repr(value), "choose one of these")
        ranges = {"rest_share": (1e-3, 1.0), "finest": (1 / FINEST_ONE, 1.0), "packet_frames": (1, 1 << 20), "layers": (1, 16)}
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise InputError(f"{name} from {least:g} to {most:g}", f"{getattr(self, name)}", "choose one in that range")


@dataclass(frozen=True)
class EncodeReport:
    """What an encoding came to, measured on the bytes as read back.

    Parameters
    ----------
    mode
        "sequence" or "exact".
    bytes, rest_bytes, frame_bytes, order_bytes
        All; of the rest mesh; of the frames; of the caller's order.
    bits_per_vertex
        Per vertex and frame, the rest mesh among them.
    max_vertex_error, rms
        Of vertices over all frames, in mesh units.
    kg_error
        100 |A - A'| / |A - mean A|, A the coordinates by frame and axis.
    psnr
        20 log10 of the bounding-box diagonal of the first frame over the rms.
    single_precision
        Whether the error holds after rounding to single precision too.
    """

    mode: str
    bytes: int
    rest_bytes: int
    frame_bytes: int
    order_bytes: int
    bits_per_vertex: float
    max_vertex_error: float
    rms: float
    kg_error: float
    psnr: float
    single_precision: bool


@dataclass(frozen=True, eq=False)
class Encoded:
    """Bytes of a `.mlw` file.

    Parameters
    ----------
    data
        The file.
    permutation
        The caller's number of each vertex as it will be read; 0, 1, 2, ... where the order is kept.
    report
        Sizes and errors.
    """

    data: bytes
    permutation: Int[np.ndarray, "n"]
    report: EncodeReport


@dataclass(frozen=True, eq=False)
class Decoded:
    """What a file holds, or as much of it as has come.

    Parameters
    ----------
    sequence
        The rest mesh and the frames.
    complete
        False if the file ends early, between two packets: frames are missing, or are coarser than they were told.
    error
        Largest distance of a vertex from where it was, if complete.
    layers
        Of how many parts of the hierarchy the last frame was told.
    """

    sequence: MeshSequence
    complete: bool
    error: float
    layers: int


@dataclass(frozen=True, eq=False)
class FrameEncoder:
    """Frames over one rest mesh to bytes, as they come.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import FrameEncoder, decode_stream, sample
    >>> rest = sample("blob")
    >>> encoder = FrameEncoder.prepare(rest, error=0.01)
    >>> def stream():
    ...     yield encoder.opening
    ...     yield from encoder.packets(rest.vertices * (1 + 0.1 * k) for k in range(1, 4))
    >>> meshes = list(decode_stream(stream()))
    >>> len(meshes), bool(np.abs(meshes[3].vertices - 1.3 * rest.vertices[encoder.permutation]).max() < 0.01)
    (4, True)
    """

    permutation: Int[np.ndarray, "n"]
    opening: bytes
    header: Header
    rest_bytes: int
    order_bytes: int
    error: float
    _rest: Float[np.ndarray, "n 3"]
    _records: Records
    _law: Law
    _taken: Int[np.ndarray, "n"]
    _opened: tuple[int, int]

    @staticmethod
    def prepare(rest: Mesh, *, error: float, frames: int | None = None, options: CodecOptions | None = None) -> "FrameEncoder":
        """Tell the rest mesh.

        Parameters
        ----------
        rest
            The first mesh; its faces are those of all.
        error
            Largest distance of a vertex from where it was, in mesh units.
        frames
            How many will follow, if that is known; 0 for a single mesh.
        options
            How.

        Raises
        ------
        InputError
            If the error is not positive, or too small for the mesh's extent.
        """
        options = options or CodecOptions()
        if options.layers > 1 and frames is None:
            raise InputError("the number of frames where there are layers", "None", "count them, or take one layer")
        law, spacing = _law(rest, error, frames, options)
        return _prepared(rest, frames, options, (law, spacing, error))

    def packets(self, frames: Iterable[Float[np.ndarray, "n 3"]]) -> Iterator[bytes]:
        """Bytes after the opening, packet by packet as frames come, the end last.

        Raises
        ------
        InputError
            If a frame has another number of vertices than the rest mesh, or holds NaN or infinite values.
        """
        count, chain = self._opened
        told = poses.told_nothing(self._rest, self._records, poses.new_writer())
        ordered = (_arrays.real(frame, "frame", (len(self._rest), 3))[self._taken] for frame in frames)
        for packet in poses.packets(told, ordered, self._law):
            data, chain = packet.encoded(chain)
            count += 1
            yield data
        yield Packet(END, count, 0, b"").encoded(chain)[0]


def encode(subject: Mesh | MeshSequence, *, error: float | None = None, options: CodecOptions | None = None) -> Encoded:
    """A mesh, or a sequence over one topology, as the bytes of a `.mlw` file.

    Parameters
    ----------
    subject
        What to tell. The first frame of a sequence is its rest mesh. Any faces will do: open, of several parts, non-manifold.
    error
        Largest distance of a vertex from where it was, in mesh units; a thousandth of the first bounding-box diagonal unless given.
    options
        How.

    Returns
    -------
    Encoded
        Bytes, where each vertex went, and what was reached, as measured on the mesh read back from these bytes.

    Raises
    ------
    InputError
        If the error is not positive, or too small for the mesh's extent.

    Notes
    -----
    O(frames n). Positions are exact to rounding on every machine, faces and order are the same on all.

    References
    ----------
    Hoppe, Progressive meshes, SIGGRAPH 1996 (half-edge collapses); Karni & Gotsman, Compression of soft-body animation
    sequences, Computers & Graphics 28, 2004 (the error in percent); docs/format.md.

    Examples
    --------
    >>> from morphlet import MeshSequence, decode, encode, sample
    >>> rest = sample("blob")
    >>> moves = MeshSequence(rest.topology, [rest.vertices, rest.vertices * [1, 1.2, 1]], [0, 1])
    >>> file = encode(moves, error=0.01)
    >>> back = decode(file.data)
    >>> len(back), bool(abs(back.positions - moves.positions[:, file.permutation]).max() < 0.01)
    (2, True)
    """
    options = options or CodecOptions()
    sequence = subject if isinstance(subject, MeshSequence) else MeshSequence(subject.topology, subject.vertices[None], np.zeros(1))
    if not len(sequence):
        raise InputError("at least one frame", "none", "pass a mesh or a sequence that has one")
    if error is None:
        error = FINE_OF_DIAGONAL * sequence[0].bbox_diagonal
    encoder = FrameEncoder.prepare(sequence[0], error=error, frames=len(sequence) - 1, options=options)
    times = _times_packet(sequence)
    if times is not None:
        encoder = _with_packet(encoder, times)
    data = b"".join([encoder.opening, *encoder.packets(sequence.positions[1:])])
    decoded = decode(data)
    return Encoded(data, encoder.permutation, _report(encoder, len(data), sequence.positions[:, encoder.permutation], decoded.positions))


def decode(data: bytes, limits: Limits | None = None) -> MeshSequence:
    """The meshes of a whole `.mlw` file, the rest mesh first.

    Raises
    ------
    CodecError
        If the file is damaged, cut, of a later version, or asks for more than the limits.

    Examples
    --------
    >>> from morphlet import decode, encode, sample
    >>> len(decode(encode(sample("blob"), error=0.01).data))
    1
    """
    decoded = decode_part(data, limits)
    if not decoded.complete:
        raise CodecError("a whole .mlw file", f"one cut after {len(decoded.sequence)} meshes", "get the rest, or use decode_part")
    return decoded.sequence


def decode_part(data: bytes, limits: Limits | None = None) -> Decoded:
    """The meshes of a `.mlw` file that may end early, between two packets.

    Raises
    ------
    CodecError
        If the file is damaged, ends within a packet or before its rest mesh, is of a later version, or asks for more than the limits.

    Examples
    --------
    >>> from morphlet import decode_part, encode, sample
    >>> decode_part(encode(sample("blob"), error=0.01).data).complete
    True
    """
    limits = limits or Limits()
    _check(data, limits)
    reading = _Reading(Source([data]), limits)
    found = [reading.positions(number) for number in reading.frames()]
    told = reading.told_layers
    if reading.told is not None:
        for frame in range(1, len(told) + 1):
            poses.guess_layers(reading.told, frame, told[frame - 1], reading.law)
    positions = found if reading.header.layers == 1 else [reading.positions(k) for k in range(len(told) + 1)]
    times = reading.times if reading.times is not None else np.arange(float(len(positions)))
    sequence = MeshSequence(reading.topology, np.stack(positions), times[: len(positions)])
    return Decoded(sequence, reading.complete, reading.header.error, min(told, default=reading.header.layers))


def decode_stream(pieces: Iterable[bytes], limits: Limits | None = None) -> Iterator[Mesh]:
    """The meshes of a `.mlw` file that comes in pieces of any length: the rest mesh, then each frame as soon as it is whole.

    Raises
    ------
    CodecError
        If the bytes are damaged, or end before their end; then what came before was good. Files of several layers are
        refused, since none of their frames is whole before the last packets.

    Examples
    --------
    >>> from morphlet import decode_stream, encode, sample
    >>> data = encode(sample("blob"), error=0.01).data
    >>> len(list(decode_stream(data[k : k + 100] for k in range(0, len(data), 100))))
    1
    """
    reading = _Reading(Source(pieces), limits or Limits())
    if reading.header.layers > 1:
        raise CodecError("a file of one layer", f"{reading.header.layers}", "use decode_part")
    for number in reading.frames():
        yield Mesh(reading.positions(number), reading.topology)
    if not reading.complete:
        raise damaged("its end before its last packet")


def _law(rest: Mesh, error: float, frames: int | None, options: CodecOptions) -> tuple[Law, float]:
    """How frames are told within the error, and the spacing of the rest mesh's lattice."""
    if rest.n_vertices == 0:
        raise InputError("at least one vertex", "none", "pass a mesh that has one")
    largest = float(np.abs(rest.vertices).max())
    if not (math.isfinite(error) and error > largest * 2.0**-40):
        raise InputError(f"an error above 0 and what rounding takes, {largest * 2.0**-40:.3g}", f"{error}", "ask for a larger one")
    rounding = largest * SINGLE * math.sqrt(3)
    room = (error - (rounding if rounding < ROUND_WORTH * error else 0)) * (1 - LATTICE_SHARE)
    step, spacing = room / ERROR_PER_STEP, room * 2 / math.sqrt(3)
    spacing = spacing if frames == 0 else min(spacing, step * options.rest_share)
    if np.ptp(rest.vertices, axis=0).max() >= spacing * ((1 << LATTICE_BITS) - 1):
        raise InputError(f"an error of at least 2^-{LATTICE_BITS} of the mesh's extent", f"{error}", "ask for a larger one")
    finest = round(options.finest * FINEST_ONE)
    return Law(step, finest, options.reference, options.packet_frames, options.layers, error), spacing


def _prepared(rest: Mesh, frames: int | None, options: CodecOptions, told: tuple[Law, float, float]) -> FrameEncoder:
    """The rest mesh told."""
    law, spacing, error = told
    faces, shape, taken, starts = write_faces(rest.faces, rest.n_vertices)
    origin = rest.vertices.min(axis=0)
    lattice = np.ascontiguousarray(np.round((rest.vertices[taken] - origin) / spacing).astype(np.int64))
    records = coarse_to_fine(shape.corner, shape.twin, lattice) if frames != 0 else _no_records(len(lattice))
    numbers = rest.n_vertices, rest.n_faces, UNKNOWN if frames is None else frames
    corner = float(origin[0]), float(origin[1]), float(origin[2])
    mode, check = (EXACT, 0) if frames == 0 else (SEQUENCE, records.checksum)
    header = Header(mode, *numbers, corner, spacing, law.step, error, law.finest, law.layers, check)
    packets = [Packet(FACES, 0, 0, faces), Packet(POSITIONS, 0, 0, write_positions(shape, lattice))]
    kept = options.order == "kept"
    if kept:
        packets.append(Packet(ORDER, 0, 0, write_order(taken, starts)))
    opening, chain = header.encoded()
    sizes = [len(opening)]
    for packet in packets:
        data, chain = packet.encoded(chain)
        opening, sizes = opening + data, [*sizes, len(data)]
    permutation = np.arange(len(taken)) if kept else taken
    parts = _rest_positions(header, lattice), records, law, taken, (len(packets), chain)
    return FrameEncoder(_arrays.freeze(permutation), opening, header, sum(sizes[:3]), sum(sizes[3:]), error, *parts)


def _no_records(n: int) -> Records:
    """A mesh of which all vertices are roots."""
    nothing = np.zeros(0, np.int64)
    return Records(nothing, np.zeros(1, np.int64), nothing, nothing, np.arange(n))


def _rest_positions(header: Header, lattice: Int[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Where the rest mesh's vertices are read."""
    return np.array(header.origin) + header.spacing * lattice


def _times_packet(sequence: MeshSequence) -> Packet | None:
    """The frames' times, unless they are 0, 1, 2, ..."""
    plain = np.array_equal(sequence.times, np.arange(len(sequence)))
    return None if plain else Packet(TIMES, 0, 0, sequence.times.astype("<f8").tobytes())


def _with_packet(encoder: FrameEncoder, packet: Packet) -> FrameEncoder:
    """The encoder with one more packet before its frames."""
    count, chain = encoder._opened
    data, chain = packet.encoded(chain)
    return replace(encoder, opening=encoder.opening + data, _opened=(count + 1, chain))


def _report(encoder: FrameEncoder, size: int, meant: Float[np.ndarray, "t n 3"], found: Float[np.ndarray, "t n 3"]) -> EncodeReport:
    """Sizes and errors; an error beyond what was asked for is refused."""
    distance = np.linalg.norm(found - meant, axis=2)
    worst = float(distance.max())
    if worst > encoder.error:
        needed = f"every vertex within {encoder.error:.6g} of where it was"
        raise SolveError(needed, f"{worst:.6g}", "report this sequence; a smaller error goes round it")
    single = np.linalg.norm(found.astype(np.float32).astype(np.float64) - meant, axis=2).max() <= encoder.error
    rms = float(np.sqrt(np.mean(distance**2)))
    spread = float(np.sqrt(np.sum((meant - meant.mean(axis=1, keepdims=True)) ** 2)))
    diagonal = float(np.linalg.norm(np.ptp(meant[0], axis=0)))
    rest, order = encoder.rest_bytes, encoder.order_bytes
    return EncodeReport(
        mode="exact" if encoder.header.mode == EXACT else "sequence",
        bytes=size,
        rest_bytes=rest,
        frame_bytes=size - rest - order,
        order_bytes=order,
        bits_per_vertex=BITS * size / distance.size,
        max_vertex_error=worst,
        rms=rms,
        kg_error=100 * float(np.sqrt(np.sum(distance**2))) / spread if spread else 0.0,
        psnr=20 * math.log10(diagonal / rms) if rms and diagonal else math.inf,
        single_precision=bool(single),
    )


def _check(data: bytes, limits: Limits) -> None:
    """All checksums first: nothing of a file with a damaged end is decoded."""
    source = Source([data])
    _, chain = read_header(source, limits)
    for _ in read_packets(source, chain):
        pass


class _Reading:
    """A file as it is read: the rest mesh at once, then its frames one after the other."""

    def __init__(self, source: Source, limits: Limits) -> None:
        self.header, chain = read_header(source, limits)
        self._limits, self._packets = limits, read_packets(source, chain)
        shape, lattice = self._shape()
        self._rest = _rest_positions(self.header, lattice)
        self._order: np.ndarray | None = None
        self.topology = Topology(shape.faces, len(lattice))
        self.times: np.ndarray | None = None
        self.law = Law(self.header.step, self.header.finest, "rest", 1, self.header.layers, self.header.error)
        self.told = self._told(shape, lattice) if self.header.mode == SEQUENCE else None
        self.told_layers: list[int] = []
        self.complete = False

    def frames(self) -> Iterator[int]:
        """Numbers of the meshes as they are whole: 0 for the rest mesh, and then, with one layer, each frame."""
        last, opened = POSITIONS, False
        for packet in self._packets:
            if packet.kind < last or (packet.kind == last and last != FRAMES):
                raise damaged(f"a packet of type {packet.kind} after one of type {last}")
            last = packet.kind
            if packet.kind == ORDER:
                self._keep(packet)
            elif packet.kind == TIMES:
                self._time(packet)
            elif not opened:
                opened = True
                yield 0
            if packet.kind == FRAMES:
                yield from self._frames_of(packet)
        if not opened:
            yield 0
        self._finish(last == END)

    def positions(self, number: int) -> Float[np.ndarray, "n 3"]:
        """Positions of a mesh: 0 the rest mesh, then the frames."""
        found = self._rest if number == 0 or self.told is None else self.told.kept[number]
        if self._order is None:
            return found
        out = np.empty_like(found)
        out[self._order] = found
        return out

    def _shape(self) -> tuple[Shape, Int[np.ndarray, "n 3"]]:
        """Faces and positions of the rest mesh."""
        found = list(islice(self._packets, 2))
        if [packet.kind for packet in found] != [FACES, POSITIONS]:
            raise damaged("an end, or other packets, before the rest mesh")
        faces, positions = (packet.payload for packet in found)
        shape = read_faces(faces, self.header.faces, self.header.vertices, LOOSE_PER_BYTE * len(positions))
        return shape, read_positions(positions, shape)

    def _told(self, shape: Shape, lattice: Int[np.ndarray, "n 3"]) -> Told:
        """The state before the first frame; the order of vertices must be the writer's."""
        records = coarse_to_fine(shape.corner, shape.twin, lattice)
        if records.checksum != self.header.hierarchy:
            raise damaged("an order of vertices that is not the writer's")
        return poses.told_nothing(self._rest, records, poses.new_reader())

    def _keep(self, packet: Packet) -> None:
        order, starts = read_order(packet.payload, len(self._rest), len(self.topology.faces))
        self.topology = Topology(as_they_came(self.topology.faces, order, starts), len(order))
        self._order = order

    def _time(self, packet: Packet) -> None:
        if len(packet.payload) % np.dtype("<f8").itemsize:
            raise damaged("times of half a number")
        times = np.frombuffer(packet.payload, "<f8").astype(np.float64)
        if len(times) != self.header.frames + 1 or not np.isfinite(times).all() or np.any(np.diff(times) <= 0):
            raise damaged("times that do not belong to the frames")
        self.times = times

    def _frames_of(self, packet: Packet) -> Iterator[int]:
        """The frames of a packet; those of layers are numbered where all layers are there."""
        first = sum(told > packet.layer for told in self.told_layers) + 1
        fits = packet.layer == 0 or first + packet.count - 1 <= len(self.told_layers)
        most = self._limits.frames if self.header.frames == UNKNOWN else self.header.frames
        ready = all(told >= packet.layer for told in self.told_layers[first - 1 : first - 1 + packet.count])
        if self.told is None or packet.layer >= self.header.layers or not fits or not ready or first + packet.count - 1 > most:
            raise damaged(f"{packet.count} frames where none, or fewer, belong")
        for number in poses.read_packet(self.told, packet, first, self.law):
            if packet.layer == 0:
                self.told_layers.append(1)
            else:
                self.told_layers[number - 1] = packet.layer + 1
            if self.header.layers == 1:
                yield number

    def _finish(self, ended: bool) -> None:
        """After the last packet: whether all that the header names was there."""
        layers, frames = self.header.layers, self.header.frames
        whole = all(told == layers for told in self.told_layers) and frames in (UNKNOWN, len(self.told_layers))
        if ended and not whole:
            raise damaged(f"{len(self.told_layers)} frames where there were {frames}")
        self.complete = ended
