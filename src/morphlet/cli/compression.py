"""Verbs of compression: meshes and sequences to few bytes, and back."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, FILM, Film, Output, length
from morphlet.cli.pictures import draw_mesh, promise_film, shoot
from morphlet.console import FLAG, Common, Run, execute
from morphlet.errors import FileError, InputError

if TYPE_CHECKING:
    from morphlet.codec.sequence import EncodeReport
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.sequence import MeshSequence

MOST_BITS = 24
"""Of a lattice for --bits: files of meshes hold no more in single precision."""


def encode(
    *mesh: Path,
    output: Output,
    error: str | None = None,
    bits: int | None = None,
    mode: Literal["auto", "sequence", "exact"] = "auto",
    keep_order: Annotated[bool, FLAG] = False,
    permutation: Path | None = None,
    common: Common = DEFAULTS,
) -> int:
    """Write a mesh, or a mesh and its poses, into few bytes.

    Vertices and faces only: colours and texture coordinates are not kept.

    Parameters
    ----------
    mesh
        A mesh, then its poses, with vertices and faces in its order: files, folders of files, or a .glb with morph targets.
    output
        File of the ending .mlw.
    error
        Largest distance of a vertex from where it was: in mesh units, or in percent of the first mesh's bounding-box diagonal such as
        0.1%, which it is if left out.
    bits
        Instead of an error: as close as a lattice of so many bits per coordinate, 1 to 24, comes.
    mode
        One mesh (exact), or one and its poses (sequence); as it comes, if left out.
    keep_order
        Keep vertices and faces in the file's order, which takes more bytes.
    permutation
        Also write which vertex of the input each decoded vertex was, as a .npy file.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            import numpy as np

            from morphlet.codec.sequence import CodecOptions
            from morphlet.codec.sequence import encode as encoded
            from morphlet.io.sequences import read_sequence

        run.file(output, ".mlw")
        if permutation is not None:
            run.file(permutation, ".npy")
        _require_bound(error, bits)
        if not mesh:
            raise InputError("at least one mesh", "none", "name the file of a mesh, and of its poses if there are any")
        frames = read_sequence(*mesh)
        _require_mode(mode, len(frames))
        steps.warm(run, "codec")
        run.stage("encode")
        found = encoded(frames, error=_bound(frames, error, bits), options=CodecOptions(order="kept" if keep_order else "free"))
        run.place(output).write_bytes(found.data)
        if permutation is not None:
            with run.place(permutation).open("wb") as file:
                np.save(file, found.permutation, allow_pickle=False)
        draw_mesh(run, frames[0])
        return _figures(found.report, frames)

    return execute("encode", [*mesh], common, work)


def decode(file: Path, /, *, output: Output, partial: Annotated[bool, FLAG] = False, film: Film = FILM, common: Common = DEFAULTS) -> int:
    """Read meshes back from few bytes.

    Parameters
    ----------
    file
        A .mlw file.
    output
        Folder for mesh.ply, or for rest.ply and frame-000.ply ...
    partial
        Also take a file that ends early, between two of its packets: fewer frames, or coarser ones.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.codec.container import EXACT, Limits, Source, read_header
            from morphlet.codec.sequence import decode_part

        run.folder(output)
        promise_film(run, film)
        try:
            data = file.read_bytes()
        except OSError as problem:
            raise FileError(f"a .mlw file at {file}", problem.strerror or str(problem), "check the path and its permissions") from problem
        steps.warm(run, "codec")
        run.stage("decode")
        found = decode_part(data)
        told = f"a file that ends early, {len(found.sequence)} meshes in it"
        if not found.complete and not partial:
            raise FileError(f"the whole of {file}", told, "get the rest, or add --partial")
        if not found.complete:
            run.say(f"note: {told}")
        mode = "exact" if read_header(Source([data]), Limits())[0].mode == EXACT else "sequence"
        _write_meshes(run.place(output), found.sequence, mode)
        draw_mesh(run, found.sequence[len(found.sequence) - 1])
        shoot(run, film, found.sequence)
        n = found.sequence.positions.shape[0] * found.sequence.positions.shape[1]
        figures = {"mode": mode, "bytes": len(data), "bits_per_vertex": 8 * len(data) / n}
        unknown = dict.fromkeys(("rms", "hausdorff", "kg_error", "max_vertex_error", "psnr"))
        return figures | unknown | {"error": found.error, "frames": len(found.sequence), "complete": found.complete}

    return execute("decode", [file], common, work)


def _require_bound(error: str | None, bits: int | None) -> None:
    """Refuse two bounds, and such as no mesh has."""
    if error is not None and bits is not None:
        raise InputError("--error or --bits", "both", "leave one out")
    if bits is not None and not 1 <= bits <= MOST_BITS:
        raise InputError(f"1 to {MOST_BITS} --bits", str(bits), "choose a number in that range")
    length(error, 1.0)


def _require_mode(mode: str, frames: int) -> None:
    """Refuse a mode that does not go with so many meshes."""
    if mode == "exact" and frames > 1:
        raise InputError("one mesh for --mode exact", str(frames), "leave the poses or the mode out")
    if mode == "sequence" and frames == 1:
        raise InputError("a mesh and its poses for --mode sequence", "one mesh", "add poses, or leave the mode out")


def _bound(frames: "MeshSequence", error: str | None, bits: int | None) -> float | None:
    """Largest distance of a vertex, in mesh units; of a lattice, half of its cells' diagonal."""
    if bits is not None:
        extent = max(x.max() - x.min() for x in frames[0].vertices.T)
        return math.sqrt(3) / 2 * float(extent) / (2**bits - 1)
    return None if error is None else length(error, frames[0].bbox_diagonal)


def _figures(report: "EncodeReport", frames: "MeshSequence") -> dict[str, Any]:
    """What `encode` tells."""
    sizes = {"rest_bytes": report.rest_bytes, "frame_bytes": report.frame_bytes, "order_bytes": report.order_bytes, "frames": len(frames)}
    errors = {"rms": report.rms, "hausdorff": None, "kg_error": report.kg_error, "max_vertex_error": report.max_vertex_error}
    return {"mode": report.mode, "bytes": report.bytes, "bits_per_vertex": report.bits_per_vertex} | errors | {"psnr": report.psnr} | sizes


def _write_meshes(folder: Path, found: "MeshSequence", mode: str) -> None:
    """mesh.ply, or rest.ply and the frames."""
    from morphlet.io.formats import write
    from morphlet.io.sequences import write_sequence
    from morphlet.surface.sequence import MeshSequence

    folder.mkdir(exist_ok=True)
    first: Mesh = found[0]
    write(folder / ("mesh.ply" if mode == "exact" else "rest.ply"), first)
    if len(found) > 1:
        write_sequence(folder, MeshSequence(found.topology, found.positions[1:], found.times[1:]))
