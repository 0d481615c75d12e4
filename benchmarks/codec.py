"""Meshes and sequences in bytes: the package's codec and others, at equal error.

    python benchmarks/codec.py [--data DIR] [--only sequences,animation,static,surfaces,order,speed] [--markdown] [--json FILE]

sequences: rest mesh and poses, all bytes, against Draco (level 10) frame by frame at 8, 10 and 12 bits, and principal components
of the displacements with zstandard. The codec's error is searched until its KG (of the poses, without the rest mesh) is at most
Draco's. KG = 100 |A - A'| / |A - mean A|; Draco's is that of its own quantiser, since it reorders vertices. animation: 60 frames
of one morph, the same. static: one mesh, Draco against the codec at the same spacing of its lattice. surfaces: one mesh whose
vertices and faces may change, at equal root mean square distance, 55 to 75 dB below the diagonal: all that `encode_surface` tries
(but networks), against Draco for the mesh and for decimated ones (three face counts, quadrics of libigl and of
fast_simplification, each on the coarsest lattice that holds; the least counts). order: what keeping the caller's order costs.
speed: CPU milliseconds per frame after a first run, medians. A tool that is not there is named as absent.
Bytes are exact; with --json the curves of `surfaces` come as a picture beside it.
Public meshes are needed: MORPHLET_DATA, or --data, names their folder. Holes are filled first where a mesh's name
is followed by "closed".
"""

import argparse
import os
import statistics
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from book import Sheet, add_options, keyed
from codec_pictures import draw
from morphlet import CodecOptions, Mesh, MeshSequence, Morph, RepairOptions, decode, encode, encode_surface, read, repair
from morphlet.codec.auto import fewer_faces, finest_file
from morphlet.codec.container import DECIMATED
from morphlet.codec.draco import draco_size

SECTIONS = ("sequences", "animation", "static", "surfaces", "order", "speed")
QUALITIES = (8, 10, 12)
"""Bits of Draco's quantiser."""
LEVEL = 10
"""Of Draco's compression, its highest."""
SETS = {"horse": ("meshes/horse.obj", "horse-poses/horse-[0-9]*.obj"), "cat": ("meshes/cat.obj", "cat-poses/cat-[0-9]*.obj")}
STATIC = ("meshes/horse.obj", "meshes/cat.obj", "meshes/bunny.off", "meshes/fertility.off", "meshes/face.obj", "meshes/horse-48k.ply")
SURFACES = (
    "meshes/bunny.off",
    "meshes/horse.obj closed",
    "meshes/horse.obj",
    "meshes/fandisk.obj",
    "meshes/face.obj closed",
    "meshes/bumpy-cube.obj",
    "meshes/armadillo.obj",
)
DECIBELS = (55, 60, 65, 70, 75)
BISECTIONS = 11
"""Of the error's logarithm, between a millionth and a tenth of the diagonal: to half a percent of the error, a fifth of that in bytes."""
LEAST, MOST = 1e-5, 3e-2
"""Errors searched, in diagonals."""
FRAMES = 60
ROUNDS = 5
COMPONENTS = 4096
"""Share of a component's weight that is stored: 1/4096."""
ZSTANDARD = 19
UNITS = "Bytes; KG in percent; CPU milliseconds."


def packages(sheet: Sheet) -> tuple[Any, Any]:
    """DracoPy and zstandard, None where absent."""
    found: list[Any] = []
    for name in ("DracoPy", "zstandard", "fast_simplification"):
        try:
            found.append(__import__(name))
        except ImportError:
            sheet.miss(name, "not installed")
            found.append(None)
    return found[0], found[1]


def poses_of(data: Path, name: str) -> tuple[Mesh, np.ndarray]:
    """A rest mesh, and positions of it and its poses."""
    rest, pattern = SETS[name]
    files = [data / rest, *sorted(data.glob(pattern))]
    meshes = [read(file) for file in files]
    return meshes[0], np.stack([mesh.vertices for mesh in meshes])


def kg(meant: np.ndarray, found: np.ndarray) -> float:
    """The error of Karni and Gotsman, in percent."""
    return float(100 * np.sqrt(np.sum((meant - found) ** 2) / np.sum((meant - meant.mean(axis=1, keepdims=True)) ** 2)))


def quantised(points: np.ndarray, bits: int) -> np.ndarray:
    """Where Draco puts points."""
    spacing = np.ptp(points, axis=0).max() / ((1 << bits) - 1)
    return np.round((points - points.min(axis=0)) / spacing) * spacing + points.min(axis=0)


def draco_bytes(draco: Any, points: np.ndarray, faces: np.ndarray, bits: int) -> int:
    """Bytes of one mesh."""
    points, faces = points.astype(np.float32), faces.astype(np.uint32)
    return len(draco.encode(points, faces=faces, quantization_bits=bits, compression_level=LEVEL))


def smallest(measure: Callable[[float], tuple[float, Any]], goal: float, scale: float) -> Any:
    """What `measure` gives beside the error measure, for the largest setting that keeps the measure at most at the goal."""
    low, high, best = np.log(LEAST), np.log(MOST), None
    for _ in range(BISECTIONS):
        middle = 0.5 * (low + high)
        reached, result = measure(float(np.exp(middle)) * scale)
        low, high, best = (middle, high, result) if reached <= goal else (low, middle, best)
    return best


def own(rest: Mesh, positions: np.ndarray, options: CodecOptions | None = None) -> Callable[[float], tuple[float, Any]]:
    """The codec as a function of its error: KG of the poses, and its report."""
    sequence = MeshSequence(rest.topology, positions, np.arange(float(len(positions))))

    def measure(error: float) -> tuple[float, Any]:
        file = encode(sequence, error=error, options=options)
        back = decode(file.data).positions
        return kg(positions[1:, file.permutation], back[1:]), file.report

    return measure


def components(zstandard: Any, positions: np.ndarray, rest_bytes: int) -> Callable[[float], tuple[float, int]]:
    """All principal components of the displacements, quantised, as a function of the step; the rest mesh as the codec tells it."""
    frames, n = positions.shape[0] - 1, positions.shape[1]
    moved = (positions[1:] - positions[0]).reshape(frames, -1)
    mean = moved.mean(axis=0)
    left, sizes, right = np.linalg.svd(moved - mean, full_matrices=False)
    weights = np.round(left * np.sqrt(frames) * COMPONENTS) / COMPONENTS
    basis = np.vstack([mean, sizes[:, None] / np.sqrt(frames) * right])
    packer = zstandard.ZstdCompressor(level=ZSTANDARD)

    def measure(step: float) -> tuple[float, int]:
        whole = np.round(basis / step).astype(np.int32)
        axes = whole.reshape(len(basis), n, 3).transpose(0, 2, 1)
        planes = np.ascontiguousarray(axes).view(np.uint8).reshape(-1, 4).T.tobytes()
        found = positions[0] + (whole[0] * step + weights @ (whole[1:] * step)).reshape(frames, n, 3)
        return kg(positions[1:], found), len(packer.compress(planes)) + 2 * weights.size + rest_bytes

    return measure


def against_draco(name: str, rest: Mesh, positions: np.ndarray, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """A row per quality of Draco."""
    draco, zstandard = tools
    rows = []
    for bits in QUALITIES:
        goal = kg(positions[1:], np.stack([quantised(points, bits) for points in positions[1:]]))
        report = smallest(own(rest, positions), goal, rest.bbox_diagonal)
        row = {
            "set": name,
            "frames": len(positions),
            "quality": f"q{bits}",
            "KG": goal,
            "morphlet": report.bytes,
            "rest": report.rest_bytes,
        }
        row["bits/vertex/frame"] = report.bits_per_vertex
        if draco is not None:
            row["Draco"] = sum(draco_bytes(draco, points, rest.faces, bits) for points in positions)
            row["ratio"] = row["Draco"] / report.bytes
        if zstandard is not None and len(positions) < FRAMES:
            row["PCA+zstd"] = smallest(components(zstandard, positions, report.rest_bytes), goal, rest.bbox_diagonal)
        rows.append(row)
    return rows


def sequences(data: Path, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """Rest meshes with their poses."""
    return [row for name in SETS for row in against_draco(name, *poses_of(data, name), tools)]


def animation(data: Path, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """One morph of the horse."""
    rest, positions = poses_of(data, "horse")
    frames = Morph(rest, positions[3], "gradient").frames(FRAMES).positions
    return against_draco("morph of horse", rest, frames, tools)


def static(data: Path, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """One mesh at Draco's spacing: the error asked for is that of its quantiser."""
    rows = []
    for file in STATIC:
        mesh = read(data / file)
        for bits in QUALITIES:
            spacing = float(np.ptp(mesh.vertices, axis=0).max()) / ((1 << bits) - 1)
            report = encode(mesh, error=np.sqrt(0.75) * spacing).report
            row = {"mesh": Path(file).stem, "vertices": mesh.n_vertices, "quality": f"q{bits}", "morphlet": report.bytes}
            row["dB"] = report.psnr
            if tools[0] is not None:
                row["Draco"] = draco_bytes(tools[0], mesh.vertices, mesh.faces, bits)
                row["ratio"] = row["Draco"] / report.bytes
            rows.append(row)
    return rows


def surfaces(data: Path, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """One mesh whose vertices and faces may change."""
    rows = []
    for name in SURFACES:
        file, *closed = name.split()
        mesh = repair(read(data / file), RepairOptions(fill="all")).mesh if closed else read(data / file)
        for decibel in DECIBELS:
            rms = mesh.bbox_diagonal * 10 ** (-decibel / 20)
            report = encode_surface(mesh, rms=rms).report
            row: dict[str, Any] = {"mesh": " ".join([Path(file).stem, *closed]), "vertices": mesh.n_vertices, "dB": decibel}
            row |= {trial.mode: trial.bytes or "-" for trial in report.candidates if trial.mode != "mlwnn"}
            row |= {"auto": report.bytes, "hausdorff %": 100 * report.hausdorff / mesh.bbox_diagonal}
            if tools[0] is not None:
                row["Draco"] = draco_size(next(trial.data for trial in report.candidates if trial.mode == "exact"))
                row["decimation + Draco"] = decimated_draco(mesh, rms)
                row["ratio"] = min(row["Draco"], row["decimation + Draco"]) / report.bytes
            rows.append(row)
            print(row, file=sys.stderr, flush=True)
    return rows


def decimated_draco(mesh: Mesh, rms: float) -> int:
    """The least that Draco takes for meshes of fewer faces, by two decimators, on lattices on which they hold."""
    coarse = fewer_faces(mesh, rms)
    try:
        import fast_simplification

        flat = mesh.vertices.astype(np.float32), mesh.faces.astype(np.int32)
        found = [fast_simplification.simplify(*flat, target_count=c.n_faces, agg=1) for c in coarse]
        coarse += [Mesh(points.astype(float), faces.astype(np.int64)) for points, faces in found]
    except ImportError:  # named as absent by `packages`
        pass
    files = [finest_file(mesh, c, DECIMATED, rms) for c in coarse]
    return min((draco_size(f) for f in files if f is not None), default=sys.maxsize)


def order(data: Path, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """Bytes of the caller's order."""
    rows = []
    for name in SETS:
        rest, _ = poses_of(data, name)
        report = encode(rest, options=CodecOptions(order="kept")).report
        rows.append(
            {"mesh": name, "rest": report.rest_bytes, "order": report.order_bytes, "bits/vertex": 8 * report.order_bytes / rest.n_vertices}
        )
    return rows


def speed(data: Path, tools: tuple[Any, Any]) -> list[dict[str, Any]]:
    """CPU time per frame, the rest mesh and the check of the result in it."""
    rows = []
    for name in SETS:
        rest, positions = poses_of(data, name)
        sequence = MeshSequence(rest.topology, positions, np.arange(float(len(positions))))
        for reference in ("rest", "previous", "best"):
            options = CodecOptions(reference=reference)
            error = 2e-3 * rest.bbox_diagonal
            file = encode(sequence, error=error, options=options)
            decode(file.data)
            writing = median_time(lambda s=sequence, e=error, o=options: encode(s, error=e, options=o))
            reading = median_time(lambda d=file.data: decode(d))
            count = len(positions)
            rows.append(
                {"set": name, "reference": reference, "bytes": len(file.data), "encode ms": writing / count, "decode ms": reading / count}
            )
    return rows


def median_time(call: Callable[[], Any]) -> float:
    """CPU milliseconds."""
    times = []
    for _ in range(ROUNDS):
        start = time.process_time()
        call()
        times.append(1e3 * (time.process_time() - start))
    return statistics.median(times)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA"))
    parser.add_argument("--only", default=",".join(SECTIONS))
    add_options(parser)
    options = parser.parse_args()
    sheet = Sheet.of(options)
    if options.data is None:
        sheet.miss("public meshes", "set MORPHLET_DATA to their folder")
        return
    tools = packages(sheet)
    for section in options.only.split(","):
        found = {s.__name__: s for s in (sequences, animation, static, surfaces, order, speed)}[section](Path(options.data), tools)
        sheet.figures[section] = found
        sheet.add(keyed(section, found, UNITS))
    if options.json is not None and "surfaces" in sheet.figures:
        draw(sheet.figures["surfaces"], options.json.with_suffix(".png"))


if __name__ == "__main__":
    main()
