"""The smallest file whose surface lies within an error, whatever vertices and faces that takes.

Each way of telling a surface that applies is tried, its file is read back, and its distance to the mesh is measured; the
smallest file that holds is kept. Where the caller's vertices and faces must come back, `encode` is the call.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from morphlet.codec.container import DECIMATED, END, EXACT, NETWORK, SHAPE, SURFACE, Header, Packet, rounded_down, rounded_up
from morphlet.codec.decimation import decimated
from morphlet.codec.network import BYTES_PER_WAVELET, FEWEST_BYTES, USUAL, NetworkEncoder, NetworkFile, NetworkOptions, network_at
from morphlet.codec.reading import decode
from morphlet.codec.sequence import told_on_lattice
from morphlet.codec.shape import shape_at, shape_sizes
from morphlet.codec.surface_error import surface_error
from morphlet.errors import InputError, MorphletError, SolveError
from morphlet.metrics import psnr
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest

File = bytes
SurfaceMode = Literal["auto", "exact", "decimated", "shape", "mlwnn"]
OF_SPACING = 0.25
"""Root mean square distance of a surface from itself on a lattice, in spacings, as a first guess."""
ROUNDS = 6
"""Of looking for the largest spacing."""
NEAR = 0.01
"""Spacings that differ by less are as good as equal."""
MARGIN = 0.997
"""Of the spacing that should just do: measured errors scatter."""
SHARES = (0.55, 0.7, 0.85)
"""Of the error that fewer faces alone may take; the lattice takes the rest."""
FIRST_FACES = 4
"""A first decimation, from which the others follow, leaves a quarter of the faces."""
FEWEST_FACES = 8
MOST_LEFT = 0.9
"""Of the faces, at most."""
NETWORK_LEAST = 3e-3
"""Errors, in bounding-box diagonals, below which networks take minutes and more bytes than coarse meshes: only if asked for by name."""
NETWORK_FRAME = 40
"""Bytes of a network's file beside its one payload."""
LATTICE_MOST = 1 << 27
"""Spacings along an axis, at most."""


@dataclass(frozen=True)
class Trial:
    """One way of telling a surface.

    Parameters
    ----------
    mode
        Its name.
    bytes, rms
        Of its file, as read back; None if there is none.
    note
        Why there is none, or why it cannot be taken; empty otherwise.
    data
        The file.
    """

    mode: str
    bytes: int | None
    rms: float | None
    note: str
    data: File | None = field(default=None, repr=False)


LEFT_OUT = Trial("mlwnn", None, None, f"not tried below an error of {100 * NETWORK_LEAST:g}% of the diagonal unless named")


@dataclass(frozen=True)
class SurfaceReport:
    """What the encoding of a surface came to, measured on the mesh as read back.

    Parameters
    ----------
    mode
        "exact", "decimated", "shape" or "mlwnn".
    bytes
        Of the file.
    bits_per_vertex
        Per vertex of the mesh that was told.
    rms, hausdorff
        Root mean square and largest distance of the surfaces, in mesh units, the larger of both directions.
    max_vertex_error, kg_error
        Of the told vertices against the places of the surface read that are nearest to them: largest distance, in mesh units;
        and in percent, ``100 |A - A'| / |A - mean A|``.
    psnr
        20 log10 of the bounding-box diagonal over the rms.
    candidates
        All that was tried.
    """

    mode: str
    bytes: int
    bits_per_vertex: float
    rms: float
    hausdorff: float
    max_vertex_error: float
    kg_error: float
    psnr: float
    candidates: tuple[Trial, ...] = ()


@dataclass(frozen=True, eq=False)
class EncodedSurface:
    """Bytes of a `.mlw` file whose surface is the mesh's, to an error.

    Parameters
    ----------
    data
        The file.
    mesh
        As read back.
    report
        Sizes and errors.
    """

    data: bytes
    mesh: Mesh
    report: SurfaceReport


def encode_surface(mesh: Mesh, *, rms: float, mode: SurfaceMode = "auto") -> EncodedSurface:
    """The surface of a mesh as the bytes of a `.mlw` file; vertices and faces may be others.

    Parameters
    ----------
    mesh
        What to tell.
    rms
        Largest root mean square distance of the surfaces, the larger of both directions, in mesh units.
    mode
        "auto" for the smallest that holds; "exact" for the mesh's own faces, with vertices on a lattice; "decimated" for fewer
        faces; "shape" for a coarse mesh that is subdivided and moved along its normals; "mlwnn" for a wavelet network.

    Returns
    -------
    EncodedSurface
        Bytes, the mesh as read back, and what was reached.

    Raises
    ------
    InputError
        If the error is not positive.
    SolveError
        If the mode cannot reach the error, or does not apply: with its reason.

    Notes
    -----
    Seconds; a network takes a minute or more. Files are read back and measured with 20,000 points on each surface.

    Examples
    --------
    >>> from morphlet import decode, sample
    >>> from morphlet import encode_surface
    >>> mesh = sample("blob")
    >>> file = encode_surface(mesh, rms=0.01, mode="decimated")
    >>> file.report.rms <= 0.01, file.mesh.n_faces < mesh.n_faces
    (True, True)
    """
    if not (math.isfinite(rms) and rms > 0):
        raise InputError("an error above 0", f"{rms}", "ask for a larger one")
    names = tuple(WAYS) if mode == "auto" else (mode,)
    late = mode == "auto" and rms < NETWORK_LEAST * mesh.bbox_diagonal
    candidates = tuple(LEFT_OUT if late and name == "mlwnn" else _tried(mesh, rms, name) for name in names)
    held = [c for c in candidates if c.data is not None and not c.note]
    if not held:
        reasons = "; ".join(f"{c.mode}: {c.note}" for c in candidates)
        raise SolveError(f"a surface within {rms:.6g}", reasons, "ask for a larger error, or use encode")
    best = min(held, key=lambda c: len(c.data or b""))
    data = best.data or b""
    back = decode(data)[0]
    return EncodedSurface(data, back, replace(surface_report(mesh, back, best.mode, len(data)), candidates=candidates))


def encode_network(mesh: Mesh, *, size: int, options: NetworkOptions = USUAL) -> bytes:
    """A closed mesh as the bytes of a `.mlw` file that holds a wavelet network: the paper's model of a shape.

    Parameters
    ----------
    mesh
        Closed, of one piece and of genus 0.
    size
        Bytes of the file, at most; 300 to 5000 make sense.
    options
        Mothers, levels.

    Raises
    ------
    MeshError
        If the mesh is none that a sphere can be.
    InputError
        If the bytes are fewer than 100.

    Notes
    -----
    Time goes into the map and the choice of wavelets: seconds for hundreds of bytes, minutes for thousands.

    Examples
    --------
    >>> from morphlet import NetworkOptions, decode, encode_network, sample
    >>> data = encode_network(sample("blob", n_vertices=1500), size=150, options=NetworkOptions(level=4))
    >>> len(data) <= 150, decode(data)[0]
    (True, Mesh(2562 vertices, 5120 faces))
    """
    if size < FEWEST_BYTES + NETWORK_FRAME:
        raise InputError(f"at least {FEWEST_BYTES + NETWORK_FRAME} bytes", f"{size}", "ask for more")
    encoder = NetworkEncoder.prepare(mesh, math.ceil(size / BYTES_PER_WAVELET), options)
    room = size - NETWORK_FRAME
    data = _network_file(encoder.of_bytes(room))
    while len(data) > size and room > FEWEST_BYTES:  # each further packet has a head of its own
        room = max(room - (len(data) - size), FEWEST_BYTES)
        data = _network_file(encoder.of_bytes(room))
    return data


def _tried(mesh: Mesh, rms: float, name: str) -> Trial:
    """The file of one way, read back and measured."""
    try:
        data = WAYS[name](mesh, rms)
    except MorphletError as error:
        return Trial(name, None, None, str(error))
    if data is None:
        return Trial(name, None, None, "does not come so near")
    reached = surface_error(mesh, decode(data)[0]).rms
    return Trial(name, len(data), reached, "" if reached <= rms else f"comes within {reached:.6g}", data)


def surface_report(mesh: Mesh, back: Mesh, mode: str, size: int) -> SurfaceReport:
    """Errors of a mesh as read back from a file of so many bytes."""
    error = surface_error(mesh, back)
    distance = np.linalg.norm(nearest(back, mesh.vertices).positions(back) - mesh.vertices, axis=1)
    spread = float(np.linalg.norm(mesh.vertices - mesh.vertices.mean(axis=0)))
    kg = 100 * float(np.linalg.norm(distance)) / spread if spread else 0.0
    sizes = mode, size, 8 * size / mesh.n_vertices
    return SurfaceReport(*sizes, error.rms, error.hausdorff, float(distance.max()), kg, psnr(error.rms, mesh.bbox_diagonal))


def finest_file(goal: Mesh, mesh: Mesh, mode: int, rms: float) -> bytes | None:
    """The file of `mesh` on the coarsest lattice, nearly, on which it still lies within an error of `goal`; None if it does not anyway."""
    base = 0.0 if mesh is goal else surface_error(goal, mesh).rms
    if base >= rms * (1 - NEAR):
        return None
    room, best, kept = math.sqrt(rms**2 - base**2), 0.0, None
    spacing = room / OF_SPACING
    for _ in range(ROUNDS):
        spacing = rounded_down(max(spacing, float(np.abs(mesh.vertices).max()) / LATTICE_MOST))
        data = told_on_lattice(mesh, mode, spacing, math.sqrt(0.75) * spacing * (1 + NEAR) if mode == EXACT else rms)[0]
        reached = surface_error(goal, decode(data)[0]).rms
        if reached <= rms and spacing > best:
            best, kept = spacing, data
        share = max(reached**2 - base**2, (NEAR * room) ** 2) / spacing**2
        spacing = MARGIN * room / math.sqrt(share)
        if best and spacing < (1 + NEAR) * best:
            break
    return kept


def fewer_faces(mesh: Mesh, rms: float) -> list[Mesh]:
    """Meshes of fewer faces that take some shares of the error, which falls with the number of faces."""
    most = round(MOST_LEFT * mesh.n_faces)
    first = decimated(mesh, max(mesh.n_faces // FIRST_FACES, FEWEST_FACES))
    scale, found = surface_error(mesh, first).rms * first.n_faces, []
    for share in SHARES:
        coarse = None
        for _ in range(2):
            count = min(max(round(scale / (share * rms)), FEWEST_FACES), most)
            coarse = decimated(mesh, count)
            scale = surface_error(mesh, coarse).rms * coarse.n_faces
        found += [coarse] if coarse is not None else []
    return found


def _exactly(mesh: Mesh, rms: float) -> bytes | None:
    """The mesh's own faces."""
    return finest_file(mesh, mesh, EXACT, rms)


def _with_fewer_faces(mesh: Mesh, rms: float) -> bytes | None:
    """The smallest of some meshes of fewer faces."""
    files = [finest_file(mesh, coarse, DECIMATED, rms) for coarse in fewer_faces(mesh, rms)]
    return min((file for file in files if file is not None), key=len, default=None)


def _as_shape(mesh: Mesh, rms: float) -> bytes | None:
    """A coarse mesh, subdivided and moved."""
    payloads = shape_at(mesh, rms)
    return None if payloads is None else surface_file(SHAPE, payloads, shape_sizes(payloads[0]), rms)


def _as_network(mesh: Mesh, rms: float) -> bytes | None:
    """A wavelet network over the sphere."""
    found = network_at(mesh, rms)
    return None if found is None else _network_file(found)


def _network_file(network: NetworkFile) -> bytes:
    """The file of a network, which says how near it comes."""
    return surface_file(NETWORK, network.payloads, (10 * 4**network.level + 2, 20 * 4**network.level), network.report.rms)


def surface_file(mode: int, payloads: Sequence[bytes], sizes: tuple[int, int], rms: float) -> bytes:
    """A file of a mode that changes vertices and faces; of the mesh that is read there are so many."""
    data, chain = Header(mode, *sizes, rounded_up(rms)).encoded()
    for packet in (*(Packet(SURFACE, 0, k, payload) for k, payload in enumerate(payloads)), Packet(END, len(payloads), 0, b"")):
        piece, chain = packet.encoded(chain)
        data += piece
    return data


WAYS: dict[str, Callable[[Mesh, float], bytes | None]] = {
    "exact": _exactly,
    "decimated": _with_fewer_faces,
    "shape": _as_shape,
    "mlwnn": _as_network,
}
"""Ways of telling a surface, by the name of their mode."""
