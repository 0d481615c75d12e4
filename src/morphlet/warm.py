"""Compiled kernels: whether they are in the cache yet, and how they get there.

The first call of a numba kernel compiles it and keeps the result on disk. Half of the kernels are compiled by a second process. A
small marker remembers for which versions that was done, so that a person is told why the first run takes longer.
"""

import os
import subprocess
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np

from morphlet.numerics.linalg import factorize
from morphlet.numerics.unit_sphere import icosphere
from morphlet.pipeline import morph
from morphlet.sphere.locate import Locator
from morphlet.surface.distance import distances
from morphlet.surface.mesh import Mesh
from morphlet.surface.operators import laplacian, mass
from morphlet.surface.pairs import VertexPairs
from morphlet.wavenet.fit import FitOptions, fit_rows
from morphlet.wavenet.library import dyadic_library
from morphlet.wavenet.mothers import MOTHERS
from morphlet.wavenet.spherical import spherical_library
from morphlet.wavenet.spherical_fit import fit_sphere

LEVEL = 4
"""Subdivisions of the icosphere that exercises every kernel (2562 vertices)."""
SECOND = "from morphlet.warm import compile_solves; compile_solves()"


def marker() -> Path:
    """The file that says these versions' kernels are compiled."""
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    newest = max(int(file.stat().st_mtime) for file in Path(__file__).parent.rglob("*.py"))
    return Path(cache) / "morphlet" / f"kernels-{version('morphlet')}-numba-{version('numba')}-{newest}"


def compiled() -> bool:
    """Whether the kernels have been compiled here before."""
    return marker().exists()


def compile_kernels() -> None:
    """Run the main job on small shapes, which compiles and caches every kernel it needs."""
    silent = subprocess.DEVNULL
    with subprocess.Popen([sys.executable, "-c", SECOND], stdin=silent, stdout=silent, stderr=silent):
        points, faces = icosphere(LEVEL)
        ball, egg = Mesh(points, faces), Mesh(points * [1.0, 1.3, 1.7] + 0.2 * points[:, [0]] ** 2, faces)
        morph(ball, egg, VertexPairs(np.array([0, 1, 2]), np.array([0, 1, 2])), frames=2)
        morph(egg, egg, frames=2).figures()
    try:
        marker().parent.mkdir(parents=True, exist_ok=True)
        marker().touch()
    except OSError:
        return  # a read-only home: the next run announces once more, and finds the kernels compiled


def compile_solves() -> None:
    """The share of the second process: wavelet networks, distances, linear solves and point location."""
    points, faces = icosphere(LEVEL)
    ball = Mesh(points, faces)
    x = np.linspace(0, 1, 32)
    distances(ball, np.zeros(1, np.int64))
    fit_rows(x, x[None, :, None] ** 2, dyadic_library([MOTHERS["beta2"]], x, levels=2), FitOptions(2))
    fit_sphere(points, points**2, np.ones(len(points)), spherical_library([MOTHERS["beta2"]], points, np.ones(len(points)), levels=1), 2)
    factorize((laplacian(ball) + mass(ball)).tocsc()).solve(np.ones(ball.n_vertices))
    Locator.prepare(points, ball.topology).locate(points[:3])
