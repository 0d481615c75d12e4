"""Ways of deforming a mesh, the package's own and others', each a function from a job to positions and to what it cost.

A `Job` is a drag: frames of a handle's way, so many iterations each. A tool that is not installed raises `Absent`. Inputs are put into
the tool's own types outside the times, as is a mesh structure that does not depend on the region. Set-up is all work per region,
a frame is new targets in and positions out.

CGAL is driven by `cgal_deformation.cpp`, compiled here where a compiler, CGAL and Eigen are found; its headers are GPL, and neither they
nor what is compiled from them are part of the package. Open3D may live in another interpreter.
"""

import hashlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cache, partial
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.sparse as sp

from editing_problems import Problem
from machine import PEER_PYTHON
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor
from morphlet.editing.estimated import EstimatedRotations
from morphlet.editing.falloff import Direct
from morphlet.editing.guard import Guarded
from morphlet.editing.lattice import Lattice
from morphlet.editing.linear import DualLaplacian, Laplacian, SimilarityLaplacian
from morphlet.editing.method import Method, Pull
from morphlet.editing.moving_least_squares import MovingLeastSquares
from morphlet.editing.roi import Roi
from morphlet.editing.shell import Shell

HERE = Path(__file__).parent
EIGEN = Path(os.environ.get("EIGEN3_INCLUDE", "/usr/include/eigen3"))
"""Where Debian puts Eigen's headers."""
FLAGS = ("-std=c++17", "-O3", "-DNDEBUG", "-DCGAL_EIGEN3_ENABLED")
"""CGAL as its manual wants it compiled."""
ALPHA = 0.02
"""CGAL's own default weight of smooth rotations."""
SMOOTHING = 2e-4
"""The same of this package: of 2e-5 to 2e-2, the least that spares the bar's volume; from 2e-2 on all ends as the estimated rotations."""


class Absent(Exception):
    """A tool is not installed."""


@dataclass(frozen=True)
class Spent:
    """Seconds."""

    wall: float
    cpu: float


@dataclass(frozen=True, eq=False)
class Job:
    """A drag: where on its way the handle is in each frame, iterations per frame, the frames whose positions are wanted."""

    problem: Problem
    way: tuple[float, ...]
    iterations: int = 1
    kept: tuple[int, ...] = ()
    more: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))
    """Free vertices that join the handle in the end: what does the new set-up cost?"""

    @staticmethod
    def drag(problem: Problem, frames: int, iterations: int = 1) -> "Job":
        """All the way in equal steps; the last frame is kept."""
        return Job(problem, tuple((k + 1) / frames for k in range(frames)), iterations, (frames - 1,))

    @staticmethod
    def still(problem: Problem, counts: tuple[int, ...]) -> "Job":
        """Straight to the target, one iteration a frame; kept after so many."""
        return Job(problem, (1.0,) * max(counts), 1, tuple(count - 1 for count in counts))


@dataclass(frozen=True, eq=False)
class Answer:
    """Positions of all vertices after the kept frames, and times."""

    setup: Spent
    frames: list[Spent]
    positions: list[np.ndarray]
    more: Spent | None = None
    later: list[Spent] = field(default_factory=list)
    """The same way with the larger handle, where that was run."""


Kind = Literal["goes on", "starts anew", "one answer"]
"""Iterations of which a frame may do some and the next one more; iterations that start anew with every answer; none to be told."""


@dataclass(frozen=True)
class Tool:
    """A way of deforming."""

    name: str
    run: Callable[[Job], Answer]
    kind: Kind = "goes on"

    def after(self, problem: Problem, counts: tuple[int, ...]) -> list[np.ndarray]:
        """Positions after so many iterations from the tool's own start, counts ascending."""
        if self.kind == "goes on":
            return self.run(Job.still(problem, counts)).positions
        if self.kind == "one answer":
            return self.run(Job(problem, (1.0,), 1, (0,))).positions * len(counts)
        return [self.run(Job(problem, (1.0,), count, (0,))).positions[0] for count in counts]


def spent(call: Callable[[], Any]) -> tuple[Any, Spent]:
    """What the call returns, and its cost."""
    wall, cpu = time.perf_counter(), time.process_time()
    found = call()
    return found, Spent(time.perf_counter() - wall, time.process_time() - cpu)


def frames_of(job: Job, setup: Spent, frame: Callable[[float, np.ndarray], Callable[[], np.ndarray]]) -> Answer:
    """Run through the frames of a tool that lives in this process; `frame` gets the handle's part of the way and the last positions."""
    last, times, kept = np.array(job.problem.mesh.vertices), [], []
    for k, part in enumerate(job.way):
        last, cost = spent(frame(part, last))
        times.append(cost)
        if k in job.kept:
            kept.append(np.array(last))
    return Answer(setup, times, kept)


# libigl ---------------------------------------------------------------------------------------------------------------------------------


def igl_arap(job: Job, energy: str) -> Answer:
    """libigl's as-rigid-as-possible deformation, on the whole mesh as it works."""
    import igl

    V, F = np.array(job.problem.mesh.vertices), np.array(job.problem.mesh.faces)

    def prepared(held: np.ndarray) -> Any:
        data = igl.ARAPData()
        data.energy = getattr(igl, f"ARAP_ENERGY_TYPE_{energy}")
        data.max_iter = job.iterations
        igl.arap_precomputation(V, F, 3, held.astype(np.int32), data)
        return data

    data, setup = spent(lambda: prepared(job.problem.held))

    def frame(part: float, last: np.ndarray) -> Callable[[], np.ndarray]:
        places = job.problem.places(part)
        return lambda: igl.arap_solve(places, data, last)

    answer = frames_of(job, setup, frame)
    if not len(job.more):
        return answer
    larger = np.concatenate([job.problem.handle, job.more, job.problem.anchors])
    return Answer(answer.setup, answer.frames, answer.positions, spent(lambda: prepared(larger))[1])


def igl_linear(job: Job, order: int) -> Answer:
    """Harmonic or biharmonic displacements by libigl's quadratic solver, on the whole mesh."""
    import igl

    mesh = job.problem.mesh
    V, F, n = np.array(mesh.vertices), np.array(mesh.faces), mesh.n_vertices

    def prepared() -> Any:
        L = igl.cotmatrix(V, F)
        Q = -L if order == 1 else L @ sp.diags(1 / igl.massmatrix(V, F, igl.MASSMATRIX_TYPE_VORONOI).diagonal()) @ L
        data = igl.min_quad_with_fixed_data()
        igl.min_quad_with_fixed_precompute(sp.csc_matrix(Q), job.problem.held, sp.csc_matrix((0, n)), True, data)
        return data

    data, setup = spent(prepared)

    def frame(part: float, _: np.ndarray) -> Callable[[], np.ndarray]:
        moved = job.problem.places(part) - V[job.problem.held]
        return lambda: V + _first(igl.min_quad_with_fixed_solve(data, np.zeros((n, 3)), moved, np.zeros((0, 3))))

    return frames_of(job, setup, frame)


def _first(found: Any) -> np.ndarray:
    """The solution, with or without multipliers."""
    return found[0] if isinstance(found, tuple) else found


# CGAL -----------------------------------------------------------------------------------------------------------------------------------


@cache
def cgal_program() -> Path:
    """The driver, compiled; kept under out/, by the text it came from."""
    source, compiler = HERE / "cgal_deformation.cpp", shutil.which("g++") or shutil.which("clang++")
    if compiler is None:
        raise Absent("no C++ compiler")
    text = source.read_bytes() + " ".join(FLAGS).encode()
    program = HERE.parent / "out" / "benchmarks" / f"cgal_deformation-{hashlib.sha256(text).hexdigest()[:12]}"
    if not program.exists():
        program.parent.mkdir(parents=True, exist_ok=True)
        sys.stderr.write("compiling the driver of CGAL\n")
        beside = program.with_suffix(".part")
        made = subprocess.run([compiler, *FLAGS, f"-I{EIGEN}", source, "-o", beside], capture_output=True, text=True, check=False)
        if made.returncode:
            raise Absent("CGAL does not compile: " + made.stderr.strip().splitlines()[0][:120])
        beside.replace(program)
    return program


def cgal(job: Job, algorithm: int) -> Answer:
    """CGAL's Surface_mesh_deformation, in a process of its own that takes the times itself."""
    program, problem = cgal_program(), job.problem
    mesh, roi = problem.mesh, problem.roi
    head = [algorithm, job.iterations, mesh.n_vertices, mesh.n_faces, len(roi.moving), len(problem.handle), len(job.more), len(job.way)]
    targets = np.concatenate([problem.pose(part) for part in job.way])
    whole, real = partial(np.asarray, dtype=np.int64), partial(np.asarray, dtype=np.float64)
    lists = [whole(roi.moving), whole(problem.handle), whole(job.more), real(targets), whole(job.kept)]
    parts = [whole([*head, len(job.kept)]), real([ALPHA]), real(mesh.vertices), whole(mesh.faces), *lists]
    with tempfile.TemporaryDirectory() as folder:
        edit, positions = Path(folder) / "edit", Path(folder) / "positions"
        edit.write_bytes(b"".join(np.ascontiguousarray(part).tobytes() for part in parts))
        done = subprocess.run([program, edit, positions], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError(done.stderr.strip() or f"exit code {done.returncode}")
        told, kept = json.loads(done.stdout), np.fromfile(positions).reshape(-1, mesh.n_vertices, 3)
    more = Spent(*told["more"]) if "more" in told else None
    return Answer(Spent(*told["setup"]), [Spent(*frame) for frame in told["frames"]], list(kept), more)


# Open3D ---------------------------------------------------------------------------------------------------------------------------------


def peer_python() -> str:
    """An interpreter with Open3D."""
    return os.environ.get(PEER_PYTHON) or sys.executable


@cache
def open3d_works(python: str) -> bool:
    """Whether the interpreter has Open3D."""
    return subprocess.run([python, "-c", "import open3d"], capture_output=True, check=False).returncode == 0


def open3d(job: Job, energy: str) -> Answer:
    """Open3D's deformation, in a process of its own: the job's last frame, from rest; `frames` is the time of one iteration."""
    if not open3d_works(peer_python()):
        raise Absent(f"Open3D is not installed ({PEER_PYTHON} names an interpreter that has it)")
    mesh, counts = job.problem.mesh, [job.iterations] if job.kept else []
    given = {"vertices": mesh.vertices, "faces": mesh.faces, "held": job.problem.held, "places": job.problem.places(job.way[-1])}
    with tempfile.TemporaryDirectory() as folder:
        edit, answer = Path(folder) / "edit.npz", Path(folder) / "answer.npz"
        np.savez(edit, energy=energy, counts=np.array(counts, np.int64), timed=0 if job.kept else len(job.way), **given)
        done = subprocess.run([peer_python(), HERE / "editing_open3d.py", edit, answer], capture_output=True, text=True, check=False)
        if done.returncode:
            raise RuntimeError((done.stderr.strip() or f"exit code {done.returncode}").splitlines()[-1])
        with np.load(answer) as found:
            return Answer(Spent(*found["setup"].tolist()), [Spent(*found["iteration"].tolist())], list(found["positions"]))


PEERS = (
    Tool("libigl harmonic", partial(igl_linear, order=1), "one answer"),
    Tool("libigl biharmonic", partial(igl_linear, order=2), "one answer"),
    Tool("libigl spokes", partial(igl_arap, energy="SPOKES")),
    Tool("libigl spokes+rims", partial(igl_arap, energy="SPOKES_AND_RIMS")),
    Tool("CGAL spokes", partial(cgal, algorithm=0)),
    Tool("CGAL spokes+rims", partial(cgal, algorithm=1)),
    Tool("CGAL smoothed", partial(cgal, algorithm=2)),
    Tool("Open3D spokes", partial(open3d, energy="spokes"), "starts anew"),
    Tool("Open3D smoothed", partial(open3d, energy="smoothed"), "starts anew"),
)
"""Others' tools."""


# morphlet -------------------------------------------------------------------------------------------------------------------------------


def own(job: Job, make: Callable[[int], Method]) -> Answer:
    """The package: a method with so many iterations, a region without anything kept from before; a frame starts from the last one's."""
    problem, before = job.problem, job.problem.roi
    editor, setup = spent(lambda: RoiEditor.prepare(Roi(problem.mesh, np.array(before.handle), before.free), make(job.iterations)))
    times, places = dragged(editor, [problem.pose(part) for part in job.way])
    kept = []
    for k in job.kept:
        whole = np.array(problem.mesh.vertices)
        whole[before.moving] = places[k]
        kept.append(whole)
    if not len(job.more):
        return Answer(setup, times, kept)
    larger = replace(problem, handle=np.concatenate([problem.handle, job.more]))
    editor, more = spent(partial(editor.with_handle, larger.handle))
    return Answer(setup, times, kept, more, dragged(editor, [larger.pose(part) for part in job.way])[0])


def dragged(editor: RoiEditor, way: list[np.ndarray]) -> tuple[list[Spent], list[np.ndarray]]:
    """Frames of an editor, each from the last one's positions: their costs, and these."""
    times, places, start = [], [], None
    for targets in way:
        start, cost = spent(partial(editor.positions, Pull(targets, None, start)))
        times.append(cost)
        places.append(start)
    return times, places


def mine(name: str, method: Method) -> Tool:
    """A method that is linear, or stops by itself."""
    return Tool(f"morphlet {name}", partial(own, make=lambda _: method), "one answer")


def iterated(name: str, make: Callable[[int], Method]) -> Tool:
    """A method made with a number of iterations."""
    return Tool(f"morphlet {name}", partial(own, make=make), "starts anew")


OWN = (
    mine("direct", Direct()),
    mine("moving least squares", MovingLeastSquares()),
    mine("lattice", Lattice()),
    mine("harmonic", Laplacian(1)),
    mine("biharmonic", Laplacian(2)),
    mine("similarity", SimilarityLaplacian()),
    mine("dual", DualLaplacian()),
    mine("estimated rotations", EstimatedRotations()),
    iterated("ARAP", lambda count: Arap(count, tolerance=0.0)),
    iterated("ARAP plain", lambda count: Arap(count, tolerance=0.0, anderson=0)),
    iterated("ARAP smoothed", lambda count: Arap(count, tolerance=0.0, smoothing=SMOOTHING)),
    mine("shell", Shell()),
    mine("guarded", Guarded()),
)
"""The package's."""
