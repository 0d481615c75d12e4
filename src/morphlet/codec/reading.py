"""Meshes from the bytes of a `.mlw` file, whole, cut between two packets, or as they come."""

from collections.abc import Iterable, Iterator, Sequence
from itertools import islice

import numpy as np
from jaxtyping import Float, Int

from morphlet.codec import poses
from morphlet.codec.container import (
    END,
    FACES,
    FRAMES,
    MODES,
    NETWORK,
    ORDER,
    POSITIONS,
    SEQUENCE,
    SHAPE,
    SURFACE,
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
from morphlet.codec.hierarchy import coarse_to_fine
from morphlet.codec.network import DecodedNetwork, read_network
from morphlet.codec.poses import Law, Told
from morphlet.codec.rest import Shape, as_they_came, read_faces, read_order, read_positions, rest_positions
from morphlet.codec.results import Decoded
from morphlet.codec.shape import read_shape
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.sequence import MeshSequence

LOOSE_PER_BYTE = 8
"""Vertices without faces that a byte of positions can tell."""


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
    source = Source([data])
    header, chain = read_header(source, limits)
    if header.mode in SURFACES:
        mesh, complete, layers = _surface(source, header, chain)
        return Decoded(MeshSequence(mesh.topology, mesh.vertices[None], np.zeros(1)), MODES[header.mode], complete, header.error, layers)
    reading = _Reading(source, header, chain, limits)
    found = [reading.positions(number) for number in reading.frames()]
    told = reading.told_layers
    if reading.told is not None:
        for frame in range(1, len(told) + 1):
            poses.guess_layers(reading.told, frame, told[frame - 1], reading.law)
    positions = found if reading.header.layers == 1 else [reading.positions(k) for k in range(len(told) + 1)]
    times = reading.times if reading.times is not None else np.arange(float(len(positions)))
    sequence = MeshSequence(reading.topology, np.stack(positions), times[: len(positions)])
    return Decoded(sequence, MODES[header.mode], reading.complete, header.error, min(told, default=header.layers))


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
    source, limits = Source(pieces), limits or Limits()
    header, chain = read_header(source, limits)
    if header.layers > 1:
        raise CodecError("a file of one layer", f"{header.layers}", "use decode_part")
    if header.mode in SURFACES:
        mesh, complete, _ = _surface(source, header, chain)
        if complete:
            yield mesh
    else:
        reading = _Reading(source, header, chain, limits)
        for number in reading.frames():
            yield Mesh(reading.positions(number), reading.topology)
        complete = reading.complete
    if not complete:
        raise damaged("its end before its last packet")


def decode_network(data: bytes, limits: Limits | None = None) -> DecodedNetwork:
    """The wavelet network of a `.mlw` file that may end early: a surface at any resolution.

    Raises
    ------
    CodecError
        If the file is damaged, of another mode or a later version, or asks for more than the limits.

    Examples
    --------
    >>> from morphlet import NetworkOptions, decode_network, encode_network, sample
    >>> data = encode_network(sample("blob", n_vertices=1500), size=150, options=NetworkOptions(level=4))
    >>> len(data) <= 150, decode_network(data).mesh(5)
    (True, Mesh(10242 vertices, 20480 faces))
    """
    limits = limits or Limits()
    _check(data, limits)
    source = Source([data])
    header, chain = read_header(source, limits)
    if header.mode != NETWORK:
        raise CodecError("a file of a wavelet network", f"one of mode {MODES[header.mode]}", "use decode")
    return _checked_network(_surface_payloads(source, chain)[0], header.vertices)


def _check(data: bytes, limits: Limits) -> None:
    """All checksums first: nothing of a file with a damaged end is decoded."""
    source = Source([data])
    _, chain = read_header(source, limits)
    for _ in read_packets(source, chain):
        pass


def _surface(source: Source, header: Header, chain: int) -> tuple[Mesh, bool, int]:
    """The mesh of a mode that changes vertices and faces, whether all of it is there, and the number of packets that are."""
    payloads, complete = _surface_payloads(source, chain)
    mesh = SURFACES[header.mode](payloads, header.vertices)
    if (mesh.n_vertices, mesh.n_faces) != (header.vertices, header.faces) or not np.isfinite(mesh.vertices).all():
        raise damaged(f"{mesh.n_vertices} vertices and {mesh.n_faces} faces where there were others")
    return mesh, complete, len(payloads)


def _surface_payloads(source: Source, chain: int) -> tuple[list[bytes], bool]:
    """The payloads of a mode that changes vertices and faces, and whether all are there."""
    payloads: list[bytes] = []
    complete = False
    for packet in read_packets(source, chain):
        complete = packet.kind == END
        if not complete and (packet.kind != SURFACE or packet.layer != len(payloads)):
            raise damaged(f"packet {packet.layer} of type {packet.kind} where number {len(payloads)} of a surface belongs")
        payloads += [] if complete else [packet.payload]
    if not payloads:
        raise damaged("an end before its first packet")
    return payloads, complete


def _network(payloads: Sequence[bytes], vertices: int) -> Mesh:
    """The mesh of a wavelet network at the level that its writer suggests."""
    return _checked_network(payloads, vertices).mesh()


def _checked_network(payloads: Sequence[bytes], vertices: int) -> DecodedNetwork:
    """A network that suggests as many vertices as the header says."""
    found = read_network(payloads)
    if 10 * 4**found.level + 2 != vertices:
        raise damaged(f"a network for {10 * 4**found.level + 2} vertices where there were {vertices}")
    return found


SURFACES = {SHAPE: read_shape, NETWORK: _network}
"""Readers of the modes that change vertices and faces."""


class _Reading:
    """A file as it is read: the rest mesh at once, then its frames one after the other."""

    def __init__(self, source: Source, header: Header, chain: int, limits: Limits) -> None:
        self.header = header
        self._limits, self._packets = limits, read_packets(source, chain)
        shape, lattice = self._shape()
        self._rest = rest_positions(header, lattice)
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
