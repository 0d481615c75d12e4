"""How cost grows with size: sphere, edit, correspondence and codec on one animal, subdivided from 1,500 to a million vertices.

    python benchmarks/growth.py [--most 1024000] [--jobs sphere,edit,correspond,codec] [--seconds 1800] [--json FILE] [--markdown]

The animal is meshed with at most 4,000 vertices and then subdivided by Loop's rule, each triangle in four, its target for the
correspondence in the same way. Each job on each size runs in a process of its own, after a small mesh that compiles its kernels; what
takes longer than `--seconds`, or more memory than there is, is told, and larger sizes of that job are left out. sphere: `spherical_map`.
edit: the as-rigid-as-possible editor on a region within half a diagonal of a limb's tip: set-up, and a frame of one iteration, the
median of five. correspond: `correspond_maps` onto the animal in another pose, without markers, both spherical maps made before. codec:
`encode` at an error of a 2,000th of the diagonal, `decode`; a subdivided mesh costs fewer bytes than others of its size. CPU time
counts all threads. Peak MB is the most that the process held during a step, more MB is that beyond what it held before. Exponents are
slopes of the logarithms, over all sizes and between the last two.
"""

import argparse
import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from book import Sheet, Table, add_options
from editing_problems import pulled
from morphlet import Mesh, correspond_maps, decode, encode, spherical_map
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor
from morphlet.editing.method import Pull
from morphlet.samples.creatures import Creature
from morphlet.samples.poses import POSES
from sphere_map import timed

SIZES = (1_500, 4_000, 16_000, 64_000, 256_000, 1_024_000)
BASE = 4_000
"""Most vertices that are not made by subdivision."""
SPECIES, POSE = "grazer", "walking"
RADIUS = 0.5
"""Of the edited region, in diagonals."""
FRAMES = 5
ERROR = 1 / 2000
"""Of the codec, in diagonals."""
SECONDS = 1800.0
OWN = "--one"
"""What tells a process that it is to run one job on one size."""


@dataclass(frozen=True)
class Step:
    """What a part of a job costs on one size."""

    name: str
    vertices: int
    wall_s: float
    cpu_s: float
    peak_mb: float
    more_mb: float
    remark: str = ""


def animal(count: int, pose: str) -> Mesh:
    """With about so many vertices."""
    halvings = max(0, math.ceil(math.log(count / BASE, 4)))
    coarse = Creature.prepare(SPECIES, count // 4**halvings).posed(POSES[pose])
    vertices, faces = (
        trimesh.remesh.subdivide_loop(coarse.vertices, coarse.faces, halvings) if halvings else (coarse.vertices, coarse.faces)
    )
    return Mesh(np.ascontiguousarray(vertices, float), np.ascontiguousarray(faces, np.int64))


def resident() -> float:
    """Megabytes of this process; what its peak reads where the system does not say."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
        return next(float(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS"))
    except (OSError, StopIteration):
        return float("nan")


def step(name: str, mesh: Mesh, call: Callable[[], Any]) -> tuple[Any, Step]:
    """What a call returns and costs."""
    before = resident()
    found, wall, cpu, peak = timed(call)
    return found, Step(name, mesh.n_vertices, wall, cpu, peak, peak - before)


def sphere(count: int) -> Iterator[Step]:
    """A spherical map."""
    mesh = animal(count, "standing")
    yield step("sphere", mesh, lambda: spherical_map(mesh))[1]


def edit(count: int) -> Iterator[Step]:
    """Set-up and frames."""
    mesh = animal(count, "standing")
    problem = pulled("limb", mesh, RADIUS)
    region = problem.roi
    editor, setup = step("edit, set-up", mesh, lambda: RoiEditor.prepare(region, Arap(1, tolerance=0.0)))
    yield setup
    frames, start = [], None
    for part in np.linspace(1 / FRAMES, 1, FRAMES):
        pull = Pull(problem.pose(float(part)), None, start)
        start, frame = step("edit, frame", mesh, lambda pull=pull: editor.positions(pull))
        frames.append(frame)
    median = sorted(frames, key=lambda frame: frame.cpu_s)[FRAMES // 2]
    yield replace(median, remark=f"{len(region.free)} free vertices")


def correspond(count: int) -> Iterator[Step]:
    """A map between two poses."""
    source, target = animal(count, "standing"), animal(count, POSE)
    maps = spherical_map(source), spherical_map(target)
    yield step("correspond", source, lambda: correspond_maps(*maps))[1]


def codec(count: int) -> Iterator[Step]:
    """To bytes and back."""
    mesh = animal(count, "standing")
    file, writing = step("codec, encode", mesh, lambda: encode(mesh, error=ERROR * mesh.bbox_diagonal))
    size = f"{8 * len(file.data) / mesh.n_vertices:.2f} bits per vertex"
    yield replace(writing, remark=size)
    yield step("codec, decode", mesh, lambda: decode(file.data))[1]


JOBS: dict[str, Callable[[int], Iterator[Step]]] = {"sphere": sphere, "edit": edit, "correspond": correspond, "codec": codec}
"""By the names of `--jobs`."""


def one(job: str, count: int) -> None:
    """What a process of its own does: the job on the smallest size, then on its size."""
    for _ in JOBS[job](SIZES[0]):
        pass
    sys.stdout.write(json.dumps([asdict(found) for found in JOBS[job](count)]))


def measured(job: str, count: int, seconds: float) -> list[Step] | str:
    """Steps of a job, or why there are none."""
    call = [sys.executable, __file__, OWN, job, str(count)]
    try:
        made = subprocess.run(call, capture_output=True, text=True, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        return f"more than {seconds:g} s"
    if made.returncode:
        last = made.stderr.strip().splitlines()
        return f"killed by signal {-made.returncode}" if made.returncode < 0 else (last or ["failed"])[-1][:120]
    return [Step(**found) for found in json.loads(made.stdout)]


def grown(sheet: Sheet, jobs: list[str], most: int, seconds: float) -> tuple[list[Step], list[str]]:
    """All steps, and what was left out."""
    steps, notes = [], []
    for job in jobs:
        for count in (size for size in SIZES if size <= most):
            found = measured(job, count, seconds)
            if isinstance(found, str):
                notes.append(f"{job} stops before {count} vertices: {found}")
                break
            steps += found
            sheet.figures["steps"] = [asdict(part) for part in steps]
            sys.stderr.write("".join(f"{part.name}  {part.vertices}  {part.cpu_s:.3g} CPU s  {part.peak_mb:.0f} MB\n" for part in found))
    return steps, notes


def exponent(sizes: list[int], values: list[float]) -> str:
    """Slope of the logarithms; a dash where there are none."""
    if len(sizes) < 2 or not all(value > 0 for value in values):
        return "-"
    return f"{np.polyfit(np.log(sizes), np.log(values), 1)[0]:.2f}"


def exponents(steps: list[Step]) -> list[list[str]]:
    """A line per step: CPU time over all sizes and the last two, memory the same."""
    lines = []
    for name in dict.fromkeys(found.name for found in steps):
        own = [found for found in steps if found.name == name]
        sizes = [found.vertices for found in own]
        figures = [[found.cpu_s for found in own], [found.more_mb for found in own]]
        slopes = [slope for values in figures for slope in (exponent(sizes, values), exponent(sizes[-2:], values[-2:]))]
        lines.append([name, f"{sizes[0]} .. {sizes[-1]}", *slopes])
    return lines


def main() -> None:
    """Run the jobs, fit, write."""
    if OWN in sys.argv[1:2]:
        one(sys.argv[2], int(sys.argv[3]))
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--most", type=int, default=SIZES[-1], help="vertices of the largest mesh")
    parser.add_argument("--jobs", default=",".join(JOBS))
    parser.add_argument("--seconds", type=float, default=SECONDS, help="that one job on one size may take")
    add_options(parser)
    chosen = parser.parse_args()
    sheet = Sheet.of(chosen)
    steps, notes = grown(sheet, chosen.jobs.split(","), chosen.most, chosen.seconds)
    rows = [[s.name, s.vertices, f"{s.wall_s:.3g}", f"{s.cpu_s:.3g}", f"{s.peak_mb:.0f}", f"{s.more_mb:.1f}", s.remark] for s in steps]
    sheet.add(Table("Growth", ["step", "vertices", "wall s", "CPU s", "peak MB", "more MB", ""], rows, notes=notes))
    heads = ["step", "vertices", "CPU time", "last two sizes", "more memory", "last two sizes"]
    sheet.add(Table("Exponents over vertices", heads, exponents(steps)))


if __name__ == "__main__":
    main()
