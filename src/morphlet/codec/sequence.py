"""Meshes and mesh sequences to bytes and back, every vertex within an error that was asked for.

The first frame is the rest mesh: it is told on an integer lattice, faces and all, and every further frame by how it differs
from a motion of what is known. What the reader will have is known to the writer to the last bit, and is checked against the
error before anything is handed out. Vertices and faces come back in an order of the coder's choosing unless theirs is kept.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.codec import poses
from morphlet.codec.container import (
    END,
    EXACT,
    FACES,
    MODES,
    ORDER,
    POSITIONS,
    SEQUENCE,
    TIMES,
    UNKNOWN,
    Header,
    Packet,
    rounded_down,
    rounded_up,
)
from morphlet.codec.hierarchy import Records, coarse_to_fine
from morphlet.codec.poses import ERROR_PER_STEP, FINEST_ONE, Law
from morphlet.codec.reading import decode
from morphlet.codec.rest import rest_positions, write_faces, write_order, write_positions
from morphlet.codec.results import CodecOptions, Encoded, EncodeReport
from morphlet.errors import InputError, SolveError
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

FINE_OF_DIAGONAL = 1e-3
"""Error unless another is asked for, in bounding-box diagonals."""
ROUNDS_OFF = 2.0**-32
"""Errors are larger than so much of the largest coordinate, or divisions by the spacing would round too much."""
SMALLEST = 1e-290
"""Coordinates below are as good as 0."""
LATTICE_SHARE = 1e-6
"""By how much steps are smaller than the error allows: sums of three squares round."""
SINGLE = 2.0**-24
"""Largest relative error of a number rounded to single precision, which files of meshes hold."""
ROUND_WORTH = 0.25
"""Room is left for that rounding where it takes at most a quarter of the error."""
LATTICE_BITS = 28
"""Positions of the rest mesh are below 2^28 spacings."""
BITS = 8


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
        return _prepared(rest, frames, options, (law, spacing, error), EXACT if frames == 0 else SEQUENCE)

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


def _law(rest: Mesh, error: float, frames: int | None, options: CodecOptions) -> tuple[Law, float]:
    """How frames are told within the error, and the spacing of the rest mesh's lattice."""
    if rest.n_vertices == 0:
        raise InputError("at least one vertex", "none", "pass a mesh that has one")
    largest = 2.0 ** math.ceil(math.log2(max(float(np.abs(rest.vertices).max()), SMALLEST)))
    if not (math.isfinite(error) and error > largest * ROUNDS_OFF):
        raise InputError(f"an error above 0 and what rounding takes, {largest * ROUNDS_OFF:.3g}", f"{error}", "ask for a larger one")
    rounding = largest * SINGLE * math.sqrt(3)
    room = (error - (rounding if rounding < ROUND_WORTH * error else 0)) * (1 - LATTICE_SHARE)
    step, spacing = rounded_down(room / ERROR_PER_STEP), room * 2 / math.sqrt(3)
    spacing = rounded_down(spacing if frames == 0 else min(spacing, step * options.rest_share))
    if np.ptp(rest.vertices, axis=0).max() >= spacing * ((1 << LATTICE_BITS) - 2):
        raise InputError(f"an error of at least 2^-{LATTICE_BITS} of the mesh's extent", f"{error}", "ask for a larger one")
    finest = round(options.finest * FINEST_ONE)
    return Law(step, finest, options.reference, options.packet_frames, options.layers, error), spacing


def _prepared(rest: Mesh, frames: int | None, options: CodecOptions, told: tuple[Law, float, float], mode: int) -> FrameEncoder:
    """The rest mesh told."""
    law, spacing, error = told
    faces, shape, taken, starts = write_faces(rest.faces, rest.n_vertices)
    points = np.round(rest.vertices[taken] / spacing).astype(np.int64)
    corner = tuple(int(c) for c in points.min(axis=0))
    lattice = np.ascontiguousarray(points - corner)
    records = coarse_to_fine(shape.corner, shape.twin, lattice) if frames != 0 else _no_records(len(lattice))
    count = UNKNOWN if frames is None else frames
    header = Header(mode, rest.n_vertices, rest.n_faces, rounded_up(error), (corner[0], corner[1], corner[2]), spacing, count)
    header = replace(header, step=law.step, finest=law.finest, layers=law.layers, hierarchy=records.checksum)
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
    parts = rest_positions(header, lattice), records, law, taken, (len(packets), chain)
    return FrameEncoder(_arrays.freeze(permutation), opening, header, sum(sizes[:3]), sum(sizes[3:]), error, *parts)


def _no_records(n: int) -> Records:
    """A mesh of which all vertices are roots."""
    nothing = np.zeros(0, np.int64)
    return Records(nothing, np.zeros(1, np.int64), nothing, nothing, np.arange(n))


def _times_packet(sequence: MeshSequence) -> Packet | None:
    """The frames' times, unless they are 0, 1, 2, ..."""
    plain = np.array_equal(sequence.times, np.arange(len(sequence)))
    return None if plain else Packet(TIMES, 0, 0, sequence.times.astype("<f8").tobytes())


def _with_packet(encoder: FrameEncoder, packet: Packet) -> FrameEncoder:
    """The encoder with one more packet before its frames."""
    count, chain = encoder._opened
    data, chain = packet.encoded(chain)
    return replace(encoder, opening=encoder.opening + data, _opened=(count + 1, chain))


def told_on_lattice(mesh: Mesh, mode: int, spacing: float, error: float) -> tuple[bytes, Int[np.ndarray, "n"]]:
    """A file of one mesh, `EXACT` or `DECIMATED`, at a spacing that files can hold; the number that each vertex had."""
    law = Law(spacing, FINEST_ONE, "rest", 1, 1, error)
    encoder = _prepared(mesh, 0, CodecOptions(), (law, spacing, error), mode)
    return b"".join([encoder.opening, *encoder.packets(())]), encoder.permutation


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
        mode=MODES[encoder.header.mode],
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
