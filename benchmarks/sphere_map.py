"""Spherical maps of many meshes: time, memory and distortion, beside reference measurements of an earlier prototype.

    python benchmarks/sphere_map.py [--data DIR] [--all] [--lapy] [--tradeoff] [--json FILE] [--markdown]

Without a data folder (`--data`, or the variable MORPHLET_DATA) it maps generated bodies. `--all` adds open meshes, poses and the
large classes; `--lapy` maps with lapy's conformal method as well, where lapy is installed; `--tradeoff` tables weights,
exponents and balances on the meshes with long limbs. Times are of one warm run; CPU time counts all threads.
"""

import argparse
import contextlib
import importlib.util
import os
import resource
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar, get_args

import numpy as np

from book import Sheet, Table, add_options
from morphlet import Mesh
from morphlet.errors import MorphletError
from morphlet.io.formats import read
from morphlet.numerics.linalg import Backend, analyse
from morphlet.numerics.unit_sphere import icosphere
from morphlet.report.curves import Axis, curve_picture
from morphlet.sphere import level as level_module
from morphlet.sphere.embed import SphereOptions
from morphlet.sphere.map import spherical_map
from morphlet.sphere.quality import Quality, certificate, measure

T = TypeVar("T")

REFERENCE = {
    "meshes/decimated-knight.off": (1.12, 2.79, 5.2, 5.6, 3.24, 33.1, 0.761),
    "meshes/screwdriver.off": (2.76, 2.05, 6.2, 9.41, 2.33, 19.7, 0.555),
    "meshes/bunny.off": (1.77, 1.6, 3.87, 5.14, 1.49, 14.1, 0.413),
    "tosca/wolf0.off": (1.71, 2.15, 4.5, 5.81, 2.88, 21.6, 0.431),
    "meshes/lion.obj": (1.92, 2.16, 5.99, 8.26, 3.31, 19.5, 0.496),
    "meshes/homer.obj": (2.78, 1.92, 3.93, 6.07, 2.2, 20.6, 0.469),
    "meshes/elephant.obj": (1.36, 2.03, 5.44, 6.73, 1.86, 21.9, 0.571),
    "meshes/fandisk.obj": (1.6, 1.35, 1.92, 2.64, 1.14, 9.84, 0.277),
    "meshes/cheburashka.obj": (2.25, 1.84, 3.78, 6.03, 1.79, 19.2, 0.482),
    "meshes/cat.obj": (2.56, 2.05, 4.6, 6.48, 3.05, 19.2, 0.436),
    "tosca/horse0.off": (5.95, 2.49, 5.61, 9.0, 3.43, 23.9, 0.542),
    "meshes/bumpy-cube.obj": (2.43, 1.22, 1.43, 1.44, 1.07, 7.07, 0.157),
    "meshes/armadillo.obj": (8.34, 2.21, 4.71, 9.42, 2.55, 26.8, 0.6),
    "meshes/horse-48k.ply": (10.13, 2.31, 4.71, 10.6, 2.75, 26.9, 0.66),
}
"""CPU s, iso mean, p99, max, area-weighted symmetric Dirichlet, angle (degrees), area log std: reference measurements of a
prototype of this algorithm with CHOLMOD (p = 1, uniform weights, 2 cores)."""
MORE = (
    "meshes/cow.off", "bad/spot.obj", "meshes/horse.obj", "meshes/stanford-bunny.obj", "meshes/face.obj", "meshes/camelhead.off",
    "horse-poses/horse-05.obj", "cat-poses/cat-03.obj", "tosca/cat0.off", "tosca/cat3.off", "tosca/dog0.off", "tosca/horse5.off",
    "tosca/horse6.off", "tosca/horse7.off", "tosca/wolf1.off", "tosca/wolf2.off",
)  # fmt: skip
GROWTH = ("meshes/lion.obj", "tosca/horse0.off", "meshes/armadillo.obj", "meshes/horse-48k.ply")
LIMBS = ("meshes/homer.obj", "meshes/elephant.obj")
HEADS = ["mesh", "V", "wall s", "CPU s", "peak MB", "attempt", "inverted", "degree", "iso mean", "p99", "max", "sdA", "ang", "lar"]


@dataclass(frozen=True)
class Run:
    """One mesh mapped: cost, rung of the ladder, figures."""

    vertices: int
    wall: float
    cpu: float
    megabytes: float
    attempt: int
    quality: Quality


def generated(level: int, amount: float) -> Mesh:
    """A lopsided body with rough skin."""
    points, faces = icosphere(level)
    x, y, z = points.T
    rough = amount * np.random.default_rng(0).random(len(points))
    radius = 1 + 0.5 * np.sin(2 * x + 0.7) * np.cos(3 * y - 0.3) + 0.3 * np.sin(4 * z + x * y) + rough
    return Mesh(points * radius[:, None], faces)


def timed(call: Callable[[], T]) -> tuple[T, float, float, float]:
    """What the call returns, its wall and CPU time, and the peak of resident memory meanwhile (in MB)."""
    with contextlib.suppress(OSError):
        Path("/proc/self/clear_refs").write_text("5")  # Linux: start the high-water mark afresh
    wall, cpu = time.perf_counter(), time.process_time()
    result = call()
    return result, time.perf_counter() - wall, time.process_time() - cpu, peak_memory()


def peak_memory() -> float:
    """High-water mark of resident memory in MB."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM"))
    except (OSError, StopIteration):
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(mesh: Mesh, options: SphereOptions) -> Run:
    """Mend and map a mesh."""
    sphere, wall, cpu, megabytes = timed(lambda: spherical_map(mesh, options))
    return Run(mesh.n_vertices, wall, cpu, megabytes, sphere.trace.attempt, sphere.quality())


def row(name: str, found: Run) -> list[str]:
    """A line of the table; with the ratio to the reference where there is one."""
    q, known = found.quality, REFERENCE.get(name)

    def beside(value: float, place: int) -> str:
        return f"{value:.3g}" if known is None else f"{value:.3g} ({value / known[place]:.2f})"

    figures = (q.iso_mean, q.iso_p99, q.iso_max, q.symmetric_dirichlet, q.angle_mean_deg, q.area_log_std)
    cost = [f"{found.wall:.2f}", beside(found.cpu, 0), f"{found.megabytes:.0f}"]
    proof = [str(found.attempt), str(q.inverted), f"{q.degree:.6f}"]
    return [Path(name).name, str(found.vertices), *cost, *proof, *(beside(v, i) for i, v in enumerate(figures, start=1))]


def conformal(mesh: Mesh) -> list[str]:
    """The same figures for lapy's map; it raises on many meshes, and then says so."""
    from lapy import TriaMesh
    from lapy.conformal import spherical_conformal_map

    try:
        points, _, cpu, _ = timed(lambda: spherical_conformal_map(TriaMesh(np.array(mesh.vertices), np.array(mesh.faces))))
    except Exception as error:  # whatever a peer raises is its result
        return [f"{type(error).__name__}: {str(error)[:60]}"]
    x = np.asarray(points) / np.linalg.norm(points, axis=1, keepdims=True)
    q = measure(mesh, x, certificate(x, mesh.faces))
    return [f"{cpu:.2f}", str(q.inverted), f"{q.degree:.3f}", f"{q.iso_mean:.3g}", f"{q.iso_max:.3g}", f"{q.angle_mean_deg:.3g}"]


def meshes(data: Path | None, everything: bool) -> Iterator[tuple[str, Mesh]]:
    """Names and meshes, small ones first."""
    if data is None:
        for level in (4, 5, 6):
            yield f"generated-{level}", generated(level, 0.1)
        return
    names = [name for name in (*REFERENCE, *(MORE if everything else ())) if (data / name).exists()]
    yield from sorted(((name, read(data / name)) for name in names), key=lambda pair: pair[1].n_vertices)


def growth(runs: dict[str, Run]) -> str:
    """Exponent of CPU time over vertices."""
    some = [runs[name] for name in (GROWTH if GROWTH[0] in runs else runs) if name in runs]
    slope = np.polyfit(np.log([r.vertices for r in some]), np.log([r.cpu for r in some]), 1)[0]
    return f"growth exponent of CPU time, {some[0].vertices} to {some[-1].vertices} vertices: {slope:.2f}"


def tradeoff(data: Path | None, picture: Path | None) -> Table:
    """Weights, exponents and balances on limbs, as a table and as curves of angle against area distortion."""
    names = [name for name in LIMBS if data is not None and (data / name).exists()]
    bodies = {Path(name).name: read(data / name) for name in names if data is not None} or {"generated-4": generated(4, 0.1)}
    families = {
        "isometric, uniform weights, p = 1 .. 0.5": [SphereOptions(p, "uniform") for p in (1.0, 0.7, 0.5)],
        "isometric, area weights, p = 1 .. 0.5": [SphereOptions(p, "area") for p in (1.0, 0.7, 0.5)],
        "balance 0.05 .. 0.95, uniform weights": [SphereOptions(1.0, "uniform", b) for b in (0.05, 0.2, 0.5, 0.8, 0.95)],
        "balance 0.05 .. 0.95, area weights": [SphereOptions(1.0, "area", b) for b in (0.05, 0.2, 0.5, 0.8, 0.95)],
    }
    rows, curves = [], {}
    for name, mesh in bodies.items():
        for family, settings in families.items():
            found = [run(mesh, options) for options in settings]
            for options, one in zip(settings, found, strict=True):
                q = one.quality
                figures = (q.iso_mean, q.iso_p99, q.iso_max, q.symmetric_dirichlet, q.angle_mean_deg, q.area_log_std, one.cpu)
                balance = "-" if options.balance is None else str(options.balance)
                rows.append([name, options.weights, str(options.p), balance, *(f"{v:.3g}" for v in figures)])
            curves[f"{name}: {family}"] = np.array([[one.quality.angle_mean_deg, one.quality.area_log_std] for one in found])
    if picture is not None:
        first = next(iter(bodies))
        shown = {label.split(": ")[1]: points for label, points in curves.items() if label.startswith(first)}
        drawn = curve_picture(shown, Axis("mean change of angle, degrees"), Axis("spread of the log area ratio"))
        drawn.save(picture)
    heads = ["mesh", "weights", "p", "balance", "iso mean", "p99", "max", "sdA", "ang", "lar", "CPU s"]
    return Table("Isometry, angles, areas", heads, rows)


def main() -> None:
    """Parse the arguments, warm up, map, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    for name in ("all", "lapy", "tradeoff"):
        parser.add_argument(f"--{name}", action="store_true")
    add_options(parser)
    parser.add_argument("--backend", choices=get_args(Backend), help="who factors; the package's own Cholesky if left out")
    parser.add_argument("--picture", type=Path, help="with --tradeoff: the curves as a PNG")
    chosen = parser.parse_args()
    sheet = Sheet.of(chosen)
    data = None if chosen.data is None else Path(chosen.data)
    if chosen.backend:
        level_module.analyse = partial(analyse, backend=chosen.backend)
    for level in (3, 5):  # compile the serial and the parallel kernels
        run(generated(level, 0.1), SphereOptions())
    if chosen.tradeoff:
        sheet.add(tradeoff(data, chosen.picture))
        return
    lapy = chosen.lapy and importlib.util.find_spec("lapy") is not None
    if chosen.lapy and not lapy:
        sheet.miss("lapy", "not installed")
    runs, rows, peers = {}, [], []
    for name, mesh in meshes(data, chosen.all):
        sys.stderr.write(f"{name}\n")
        try:
            runs[name] = run(mesh, SphereOptions())
        except MorphletError as error:
            rows.append([Path(name).name, str(mesh.n_vertices), str(error)])
            continue
        rows.append(row(name, runs[name]))
        if lapy:
            peers.append([Path(name).name, *conformal(mesh)])
    sheet.add(Table("Spherical maps", HEADS, rows, "In brackets: the ratio to the reference measurements.", [growth(runs)]))
    if peers:
        sheet.add(Table("lapy, conformal", ["mesh", "CPU s", "inverted", "degree", "iso mean", "iso max", "ang"], peers))


if __name__ == "__main__":
    main()
