"""Reading mesh files: CPU time of morphlet beside trimesh in the same run, on a generated mesh.

`python benchmarks/reading.py [--rounds 5] [--json FILE] [--markdown]` prints one line per format: both medians in milliseconds, and how
many times faster morphlet reads.
trimesh splits OBJ vertices at texture seams and checks less; it is called with `process=False`.
"""

import argparse
import statistics
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

from book import Sheet, Table, add_options
from morphlet import Mesh
from morphlet.io.formats import read, write

RINGS, SEGMENTS = 200, 250
"""Sides of the grid on the torus: 2 RINGS SEGMENTS = 100 000 faces."""
ROUNDS, RUNS = 5, 6
"""Each round runs every reader so many times in a row, then the next one, so that all see the same machine."""


def torus() -> Mesh:
    """A torus whose coordinates need all their digits."""
    i, j = (grid.ravel() for grid in np.indices((RINGS, SEGMENTS)))
    u, v = 2 * np.pi * i / RINGS, 2 * np.pi * j / SEGMENTS
    radius = 1 + 0.3 * np.cos(u)
    below, right = (i + 1) % RINGS * SEGMENTS, (j + 1) % SEGMENTS
    a, b, c, d = i * SEGMENTS + j, below + j, below + right, i * SEGMENTS + right
    faces = np.concatenate([np.stack([a, d, c], axis=1), np.stack([a, c, b], axis=1)])
    return Mesh(np.stack([radius * np.cos(v), radius * np.sin(v), 0.3 * np.sin(u)], axis=1), faces)


def medians(calls: list[Callable[[], object]], rounds: int) -> list[float]:
    """Median CPU time of each call in milliseconds."""
    times: list[list[float]] = [[] for _ in calls]
    for _ in range(rounds):
        for call, own in zip(calls, times, strict=True):
            own += [1e3 * timed(call) for _ in range(RUNS)]
    return [statistics.median(own) for own in times]


def timed(call: Callable[[], object]) -> float:
    """CPU seconds of one call."""
    start = time.process_time()
    call()
    return time.process_time() - start


def main() -> None:
    """Write the mesh in each format, read it with both libraries."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    add_options(parser)
    chosen = parser.parse_args()
    mesh, rows = torus(), []
    single = mesh.with_vertices(mesh.vertices.astype(np.float32))
    with tempfile.TemporaryDirectory() as folder:
        names = ("full digits.obj", "six digits.obj", "double.ply", "single.ply", "text.ply", "full digits.off")
        files = {name: Path(folder, name) for name in names}
        write(files["full digits.obj"], mesh)
        write(files["six digits.obj"], mesh.with_vertices(np.round(mesh.vertices, 6)))
        write(files["double.ply"], mesh)
        write(files["full digits.off"], mesh)
        peer = single.to_trimesh()
        peer.export(files["single.ply"], encoding="binary")
        peer.export(files["text.ply"], encoding="ascii")
        for name, file in files.items():
            ours, theirs = medians([lambda f=file: read(f), lambda f=file: trimesh.load(f, process=False)], chosen.rounds)
            rows.append([name, f"{ours:.1f}", f"{theirs:.1f}", f"{theirs / ours:.2f}"])
    heads = ["file", "morphlet CPU ms", "trimesh CPU ms", "times faster"]
    Sheet.of(chosen).add(Table(f"Reading {mesh.n_faces} faces", heads, rows, f"Medians of {chosen.rounds * RUNS} runs."))


if __name__ == "__main__":
    main()
