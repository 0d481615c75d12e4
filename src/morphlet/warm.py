"""Compiled kernels: whether they are in the cache yet, and how they get there.

The first call of a numba kernel compiles it and keeps the result on disk. A second process compiles its share of them, in the order in
which the first will ask for them. A small marker remembers for which versions that was done, so that a person is told why the first run
takes longer.
"""

import gc
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from importlib.metadata import version
from pathlib import Path

import numpy as np

from morphlet import metrics
from morphlet.codec.auto import encode_surface
from morphlet.codec.reading import decode
from morphlet.codec.results import CodecOptions
from morphlet.codec.sequence import encode
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor
from morphlet.editing.lattice import Lattice
from morphlet.editing.linear import Laplacian
from morphlet.editing.moving_least_squares import MovingLeastSquares
from morphlet.editing.roi import Roi
from morphlet.editing.shell import Shell
from morphlet.mapping.chord import Images
from morphlet.mapping.laying import Target
from morphlet.mapping.polish import Goals, Polish
from morphlet.motion.face_pairs import pair_faces
from morphlet.motion.registration import register
from morphlet.motion.transfer import transfer
from morphlet.numerics.linalg import factorize
from morphlet.numerics.optimize import Trace
from morphlet.numerics.unit_sphere import icosphere
from morphlet.pipeline.morph import morph
from morphlet.sphere.energy import reference
from morphlet.sphere.level import Level
from morphlet.sphere.map import SphericalMap
from morphlet.surface.intersections import self_intersections
from morphlet.surface.mesh import Mesh
from morphlet.surface.operators import laplacian, mass
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.repair import close
from morphlet.surface.sequence import MeshSequence
from morphlet.wavenet.fit import FitOptions, fit_rows
from morphlet.wavenet.library import dyadic_library
from morphlet.wavenet.mothers import MOTHERS

LEVEL = 3
"""Subdivisions of the icosphere that exercises every kernel (642 vertices)."""
SECOND = "from morphlet.warm import compile_share; compile_share()"
COLLECT_AFTER = 200_000
"""New objects between garbage collections while compiling: at the usual 700 they take a ninth of the time, to save 40 MB."""


def marker(of: str = "kernels") -> Path:
    """The file that says these versions' kernels are compiled: those of the main job, or another of `COMPILERS`."""
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    newest = max(int(file.stat().st_mtime) for file in Path(__file__).parent.rglob("*.py"))
    return Path(cache) / "morphlet" / f"{of}-{version('morphlet')}-numba-{version('numba')}-{newest}"


def compiled(of: str = "kernels") -> bool:
    """Whether the kernels have been compiled here before."""
    return marker(of).exists()


def compile_kernels() -> None:
    """Run the main job on small shapes, which compiles and caches every kernel it needs."""
    silent = subprocess.DEVNULL
    with subprocess.Popen([sys.executable, "-c", SECOND], stdin=silent, stdout=silent, stderr=silent), _few_collections():
        points, faces = icosphere(LEVEL)
        ball, egg = Mesh(points, faces), Mesh(points * [1.0, 1.3, 1.7] + 0.2 * points[:, [0]] ** 2, faces)
        morph(ball, egg, VertexPairs(np.array([0, 1, 2]), np.array([0, 1, 2])), frames=3)
        morph(egg, egg, frames=2).figures()
    _mark(marker())


def compile_edits() -> None:
    """Make small edits, which compiles and caches every kernel that editing needs beside those of the main job."""
    ball = Mesh(*icosphere(LEVEL))
    roi = Roi.within(ball, np.arange(3), 1.0)
    with _few_collections():
        for method in (
            MovingLeastSquares(),
            Lattice(),
            Laplacian(),
            Arap(iterations=2),
            Arap(iterations=2, smoothing=0.01),
            Shell(iterations=2),
        ):
            editor = RoiEditor.prepare(roi, method)
            edited = editor.solve(1.1 * ball.vertices[roi.handle])
        larger = editor.with_handle(np.append(roi.handle, roi.free[:2]))
        larger.solve(1.1 * ball.vertices[larger.roi.handle])
        self_intersections(edited)
        metrics.arap_energy(ball, edited)
    _mark(marker("edits"))


def compile_poses() -> None:
    """Give a small ball a pose, which compiles and caches every kernel of transfer that the main job has no use for."""
    ball, chosen = Mesh(*icosphere(1)), np.arange(4)
    with _few_collections():
        transfer(ball, ball, ball, pair_faces(register(ball, ball, VertexPairs(chosen, chosen)), ball))
    _mark(marker("poses"))


def compile_codec() -> None:
    """Tell a ball and its poses, and read them back, which compiles and caches every kernel of the codec."""
    ball = Mesh(*icosphere(LEVEL))
    moves = MeshSequence(ball.topology, np.stack([ball.vertices * (1 + k / 8) for k in range(4)]), np.arange(4.0))
    with _few_collections():
        decode(encode(moves, options=CodecOptions(order="kept")).data)
    _mark(marker("codec"))


def compile_surfaces() -> None:
    """Tell a ball by each way that keeps its surface alone, which compiles and caches every kernel of these."""
    ball = Mesh(*icosphere(LEVEL))
    with _few_collections():
        encode_surface(ball, rms=0.05)
    _mark(marker("surfaces"))


COMPILERS = {
    "kernels": compile_kernels,
    "edits": compile_edits,
    "poses": compile_poses,
    "codec": compile_codec,
    "surfaces": compile_surfaces,
}
"""What compiles each of the sets of kernels."""


def _mark(done: Path) -> None:
    """Leave a marker; in a read-only home the next run announces once more, and finds the kernels compiled."""
    with suppress(OSError):
        done.parent.mkdir(parents=True, exist_ok=True)
        done.touch()


def compile_share() -> None:
    """The share of the second process: linear solves, point location, the last stage of dense maps, and wavelet networks of rows."""
    points, faces = icosphere(LEVEL)
    ball, even, x = Mesh(points, faces), np.ones(len(points)), np.linspace(0, 1, 32)
    with _few_collections():
        factorize((laplacian(ball) + mass(ball)).tocsc()).solve(even)
        _polish(ball)
        fit_rows(x, x[None, :, None] ** 2, dyadic_library([MOTHERS["beta2"]], x, levels=2), FitOptions(2))


def _polish(ball: Mesh) -> None:
    """Polish a sphere that lies on itself."""
    points, faces = np.array(ball.vertices), np.array(ball.faces)
    level = Level(points, faces, points, reference(points, faces, 0.0))
    target = Target.prepare(SphericalMap(close(ball), points, Trace((), "the sphere itself")))
    images = Images(target.faces_under(points), np.empty((len(points), 15)))
    goals = Goals(np.arange(1), points[:1], np.ones(1))
    problem = Polish(level, target.finest, target.rows, goals, 1.0, target.seats(level), images)
    problem.newton(problem.sweep(points, 1), 1, 0.0, lambda *step: None)


@contextmanager
def _few_collections() -> Iterator[None]:
    """Collect garbage rarely."""
    before = gc.get_threshold()
    gc.set_threshold(COLLECT_AFTER)
    try:
        yield
    finally:
        gc.set_threshold(*before)
