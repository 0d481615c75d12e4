"""Finding the face of 50 000 directions on a spherical map of some 43 000 vertices.

`python benchmarks/point_location.py [--data DIR] [--json FILE] [--markdown]` maps the armadillo of the data folder (or MORPHLET_DATA),
or a generated body of 41 000 vertices, and prints the time to build the search and to answer random and sorted directions, with the
largest miss: how far the weighted mean of the corners is from the direction's ray.
"""

import argparse
import os
import statistics
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from book import Sheet, Table, add_options
from morphlet.io.formats import read
from morphlet.sphere.locate import Locator
from morphlet.sphere.map import spherical_map
from sphere_map import generated

QUERIES = 50_000
RUNS = 7


def median(call: Callable[[], object]) -> tuple[float, float]:
    """Median wall and CPU time in milliseconds."""
    walls, cpus = [], []
    for _ in range(RUNS):
        wall, cpu = time.perf_counter(), time.process_time()
        call()
        walls.append(1e3 * (time.perf_counter() - wall))
        cpus.append(1e3 * (time.process_time() - cpu))
    return statistics.median(walls), statistics.median(cpus)


def main() -> None:
    """Map, build, ask."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    add_options(parser)
    chosen = parser.parse_args()
    data = chosen.data
    file = None if data is None else Path(data, "meshes/armadillo.obj")
    mesh = read(file) if file is not None and file.exists() else generated(6, 0.1)
    sphere = spherical_map(mesh)
    points, topology = sphere.closed_points, sphere.surface.mesh.topology
    x = np.random.default_rng(0).normal(size=(QUERIES, 3))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    along = x[np.lexsort(np.floor(16 * x).T)]  # neighbours follow one another, as in a grid of directions
    search = Locator.prepare(points, topology)
    search.locate(x)
    jobs: dict[str, Callable[[], object]] = {
        "build the search": lambda: Locator.prepare(points, topology),
        "random directions": lambda: search.locate(x),
        "sorted directions": lambda: search.locate(along),
        "one direction": lambda: search.locate(x[:1]),
        "SphericalMap.locate": lambda: sphere.locate(x),
    }
    rows = [[name, *(f"{ms:.2f}" for ms in median(job))] for name, job in jobs.items()]
    faces, weights = search.locate(x)
    ray = np.einsum("kc,kcd->kd", weights, points[topology.faces[faces]])
    miss = np.abs(ray / np.linalg.norm(ray, axis=1, keepdims=True) - x).max()
    title = f"{mesh.n_vertices} vertices, {QUERIES} directions"
    Sheet.of(chosen).add(Table(title, ["", "wall ms", "CPU ms"], rows, f"Medians of {RUNS} runs.", [f"largest miss {miss:.1e}"]))


if __name__ == "__main__":
    main()
