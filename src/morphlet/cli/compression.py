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
    from collections.abc import Iterator

    from morphlet.codec.auto import SurfaceMode, Trial
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.sequence import MeshSequence

Mode = Literal["auto", "sequence", "exact", "decimated", "shape", "mlwnn"]
SURFACES: "dict[str, SurfaceMode]" = {"exact": "exact", "decimated": "decimated", "shape": "shape", "mlwnn": "mlwnn"}
SURFACE_MODES = ("decimated", "shape", "mlwnn")
"""Modes that keep the surface alone."""
USUAL_RMS = "0.05%"
"""Of the bounding-box diagonal: 66 dB."""
FIGURES = ("mode", "bytes", "bits_per_vertex", "rms", "hausdorff", "kg_error", "max_vertex_error", "psnr")
"""What is told of every file that keeps a surface."""
ANCHOR = "import sys; from morphlet.codec.draco import draco_size; print(draco_size(sys.stdin.buffer.read()))"
PATIENCE = 60.0
"""Seconds for a figure to compare with."""
MOST_BITS = 24
"""Of a lattice for --bits: files of meshes hold no more in single precision."""


def encode(
    *mesh: Path,
    output: Output,
    error: str | None = None,
    rms: str | None = None,
    bits: int | None = None,
    size: int | None = None,
    mode: Mode = "auto",
    keep_order: Annotated[bool, FLAG] = False,
    permutation: Path | None = None,
    common: Common = DEFAULTS,
) -> int:
    """Write a mesh, or a mesh and its poses, into few bytes.

    Vertices and faces only: colours and texture coordinates are not kept. With --rms, or --mode shape, mlwnn or decimated, only
    the surface is kept: vertices and faces become others.

    Parameters
    ----------
    mesh
        A mesh, then its poses, with vertices and faces in its order: files, folders of files, or a .glb with morph targets.
    output
        File of the ending .mlw.
    error
        Largest distance of a vertex from where it was: in mesh units, or in percent of the first mesh's bounding-box diagonal such as
        0.1%, which it is if left out.
    rms
        Instead, for one mesh: root mean square distance of the surfaces, in mesh units or percent; 0.05% if left out where the mode
        keeps no vertices. The smallest file that holds is written, whatever becomes of vertices and faces.
    bits
        Instead of an error: as close as a lattice of so many bits per coordinate, 1 to 24, comes.
    size
        Instead of an error, with --mode mlwnn: a file of at most so many bytes.
    mode
        Its vertices and faces (exact); with its poses (sequence); its surface alone, as fewer faces (decimated), as a coarse mesh with
        detail (shape), as a wavelet network (mlwnn); if left out, what comes, or with --rms the smallest.
    keep_order
        Keep vertices and faces in the file's order, which takes more bytes.
    permutation
        Also write which vertex of the input each decoded vertex was, as a .npy file.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.io.sequences import read_sequence

        run.file(output, ".mlw")
        if permutation is not None:
            run.file(permutation, ".npy")
        surface = rms is not None or mode in SURFACE_MODES
        _require_bound(error, rms, bits, size)
        if size is not None and mode != "mlwnn":
            raise InputError("--mode mlwnn for a --size", f"--mode {mode}", "name that mode, or ask for an error")
        if not mesh:
            raise InputError("at least one mesh", "none", "name the file of a mesh, and of its poses if there are any")
        if surface and (keep_order or permutation is not None or error is not None or bits is not None):
            raise InputError(
                "--rms alone where vertices become others", "bounds or an order of vertices", "leave these out, or --rms and the mode"
            )
        frames = read_sequence(*mesh)
        _require_mode(mode, len(frames), surface)
        for kernels in ("codec", "surfaces") if surface else ("codec",):
            steps.warm(run, kernels)
        run.stage("encode")
        if size is not None:
            return _encode_network(run, frames[0], output, size)
        if surface:
            return _encode_surface(run, frames[0], output, length(rms or USUAL_RMS, frames[0].bbox_diagonal), mode)
        return _encode_vertices(run, frames, (output, permutation), _bound(frames, error, bits), "kept" if keep_order else "free")

    return execute("encode", [*mesh], common, work)


def _encode_vertices(
    run: Run, frames: "MeshSequence", places: tuple[Path, Path | None], bound: float | None, order: Literal["kept", "free"]
) -> dict[str, Any]:
    """A file that keeps vertices and faces, and what to tell of it."""
    with run.uncounted():
        import numpy as np

        from morphlet import _store
        from morphlet.codec.reading import decode
        from morphlet.codec.results import CodecOptions
        from morphlet.codec.sequence import encode
        from morphlet.codec.surface_error import farthest

    output, permutation = places
    found = encode(frames, error=bound, options=CodecOptions(order=order))
    _store.put(run.place(output), found.data)
    if permutation is not None:
        with run.place(permutation).open("wb") as file:
            np.save(file, found.permutation, allow_pickle=False)
    draw_mesh(run, frames[0])
    back = decode(found.data)
    report = found.report
    sizes = {"rest_bytes": report.rest_bytes, "frame_bytes": report.frame_bytes, "order_bytes": report.order_bytes, "frames": len(frames)}
    far = max(farthest(meant, read) for meant, read in zip(_meshes(frames), _meshes(back), strict=True))
    errors = {"rms": report.rms, "hausdorff": far, "kg_error": report.kg_error, "max_vertex_error": report.max_vertex_error}
    return {"mode": report.mode, "bytes": report.bytes, "bits_per_vertex": report.bits_per_vertex} | errors | {"psnr": report.psnr} | sizes


def _encode_surface(run: Run, mesh: "Mesh", output: Path, rms: float, mode: Mode) -> dict[str, Any]:
    """A file that keeps the surface alone, and what to tell of it."""
    with run.uncounted():
        from morphlet import _store
        from morphlet.codec.auto import encode_surface

    found = encode_surface(mesh, rms=rms, mode="auto" if mode == "auto" else SURFACES[mode])
    report = found.report
    _store.put(run.place(output), found.data)
    draw_mesh(run, found.mesh)
    if report.mode != "exact":
        run.say(f"note: {mesh.n_vertices} vertices became {found.mesh.n_vertices}: --error keeps them")
    tried = [{"mode": c.mode, "bytes": c.bytes, "rms": c.rms, "note": c.note} for c in report.candidates]
    return {key: getattr(report, key) for key in FIGURES} | {"candidates": tried, "anchors": _anchors(report.candidates)}


def _encode_network(run: Run, mesh: "Mesh", output: Path, size: int) -> dict[str, Any]:
    """A wavelet network in so many bytes, and what to tell of it."""
    with run.uncounted():
        from morphlet import _store
        from morphlet.codec.auto import encode_network, surface_report
        from morphlet.codec.reading import decode

    data = encode_network(mesh, size=size)
    back = decode(data)[0]
    _store.put(run.place(output), data)
    draw_mesh(run, back)
    run.say(f"note: {mesh.n_vertices} vertices became {back.n_vertices}: --error keeps them")
    report = surface_report(mesh, back, "mlwnn", len(data))
    return {key: getattr(report, key) for key in FIGURES}


def _anchors(candidates: "tuple[Trial, ...]") -> dict[str, int | None]:
    """What Draco would take for the mesh's own faces, and for fewer, on the same lattices; None without DracoPy, or where it fails."""
    from importlib.util import find_spec

    sizes: dict[str, int | None] = {"draco": None, "decimated_draco": None}
    for candidate, name in ((c, {"exact": "draco", "decimated": "decimated_draco"}.get(c.mode)) for c in candidates):
        if name is not None and candidate.data is not None and find_spec("DracoPy") is not None:
            sizes[name] = _anchor(candidate.data)
    return sizes


def _anchor(data: bytes) -> int | None:
    """Bytes of Draco, found in a process of its own: there are meshes that end it."""
    import subprocess
    import sys

    try:
        done = subprocess.run([sys.executable, "-c", ANCHOR], input=data, capture_output=True, timeout=PATIENCE, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return int(done.stdout) if done.returncode == 0 else None


def decode(
    file: Path,
    /,
    *,
    output: Output,
    partial: Annotated[bool, FLAG] = False,
    level: int | None = None,
    film: Film = FILM,
    common: Common = DEFAULTS,
) -> int:
    """Read meshes back from few bytes.

    Parameters
    ----------
    file
        A .mlw file.
    output
        Folder for mesh.ply, or for rest.ply and frame-000.ply ...
    partial
        Also take a file that ends early, between two of its packets: fewer frames, or coarser ones.
    level
        Of a wavelet network: how often the icosahedron is subdivided, 0 to 8; the writer's suggestion if left out.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet import _store
            from morphlet.codec.reading import decode_network, decode_part

        run.folder(output)
        promise_film(run, film)
        try:
            data = _store.contents(file)
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
        frames = found.sequence if level is None else _single(decode_network(data).mesh(level))
        _write_meshes(run.place(output), frames, found.mode)
        draw_mesh(run, frames[len(frames) - 1])
        shoot(run, film, frames)
        n = frames.positions.shape[0] * frames.positions.shape[1]
        figures = {"mode": found.mode, "bytes": len(data), "bits_per_vertex": 8 * len(data) / n}
        unknown = dict.fromkeys(("rms", "hausdorff", "kg_error", "max_vertex_error", "psnr"))
        return figures | unknown | {"error": found.error, "frames": len(frames), "complete": found.complete}

    return execute("decode", [file], common, work)


def _require_bound(error: str | None, rms: str | None, bits: int | None, size: int | None) -> None:
    """Refuse two bounds, and such as no mesh has."""
    bounds = {"--error": error, "--rms": rms, "--bits": bits, "--size": size}
    given = [name for name, value in bounds.items() if value is not None]
    if len(given) > 1:
        raise InputError(f"one of {', '.join(bounds)}", " and ".join(given), "leave all but one out")
    if bits is not None and not 1 <= bits <= MOST_BITS:
        raise InputError(f"1 to {MOST_BITS} --bits", str(bits), "choose a number in that range")
    length(error, 1.0)
    length(rms, 1.0)


def _require_mode(mode: str, frames: int, surface: bool) -> None:
    """Refuse a mode that does not go with so many meshes."""
    if frames > 1 and (mode == "exact" or surface):
        raise InputError(
            f"one mesh for {'--rms' if mode == 'auto' else f'--mode {mode}'}", str(frames), "leave the poses or the option out"
        )
    if mode == "sequence" and (frames == 1 or surface):
        raise InputError("a mesh and its poses, and no --rms, for --mode sequence", "one mesh", "add poses, or leave the mode out")


def _meshes(frames: "MeshSequence") -> "Iterator[Mesh]":
    """The meshes of a sequence, one after the other."""
    return (frames[k] for k in range(len(frames)))


def _bound(frames: "MeshSequence", error: str | None, bits: int | None) -> float | None:
    """Largest distance of a vertex, in mesh units; of a lattice, half of its cells' diagonal."""
    if bits is not None:
        extent = max(x.max() - x.min() for x in frames[0].vertices.T)
        return math.sqrt(3) / 2 * float(extent) / (2**bits - 1)
    return None if error is None else length(error, frames[0].bbox_diagonal)


def _single(mesh: "Mesh") -> "MeshSequence":
    """A mesh as a sequence."""
    import numpy as np

    from morphlet.surface.sequence import MeshSequence

    return MeshSequence(mesh.topology, mesh.vertices[None], np.zeros(1))


def _write_meshes(folder: Path, found: "MeshSequence", mode: str) -> None:
    """mesh.ply, or rest.ply and the frames."""
    from morphlet.io.formats import write
    from morphlet.io.sequences import write_sequence
    from morphlet.surface.sequence import MeshSequence

    folder.mkdir(exist_ok=True)
    first: Mesh = found[0]
    write(folder / ("rest.ply" if mode == "sequence" else "mesh.ply"), first)
    if len(found) > 1:
        write_sequence(folder, MeshSequence(found.topology, found.positions[1:], found.times[1:]))
