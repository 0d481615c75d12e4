"""Spherical maps of input made to break them: every one must come out one-to-one.

`python benchmarks/sphere_torture.py [--json FILE] [--markdown]` prints per case the time of one warm run, the rung of the ladder that
held, the certificate and the distortion (which proves nothing here but that it is finite).
"""

import argparse

import numpy as np

from book import Sheet, Table, add_options
from morphlet import Mesh
from morphlet.numerics.unit_sphere import icosphere
from morphlet.sphere.embed import SphereOptions
from sphere_map import Run, run


def bipyramid(sides: int) -> Mesh:
    """Two hubs over a circle."""
    turn = 2 * np.pi * np.arange(sides) / sides
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    top, bottom = np.full(sides, sides), np.full(sides, sides + 1)
    return Mesh(np.vstack([circle, [[0, 0, 1], [0, 0, -1]]]), np.vstack([np.stack([i, j, top], 1), np.stack([j, i, bottom], 1)]))


def stacked(n: int) -> Mesh:
    """A tetrahedron with vertices put into random faces, one after the other, at random positions."""
    rng = np.random.default_rng(1)
    faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
    for vertex in range(4, n):
        row = int(rng.integers(len(faces)))
        a, b, c = faces[row]
        faces[row] = [a, b, vertex]
        faces += [[b, c, vertex], [c, a, vertex]]
    return Mesh(rng.normal(size=(n, 3)), faces)


def cases() -> dict[str, Mesh]:
    """Names and meshes."""
    V, F = icosphere(4)
    W, G = icosphere(5)
    spikes, drawn = V.copy(), V.copy()
    spikes[::97] *= 100
    drawn[drawn[:, 2] > 0.9] *= [1, 1, 1e6]
    noise = np.random.default_rng(1).normal(size=V.shape)
    return {
        "tetrahedron": Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
        "icosahedron": Mesh(*icosphere(0)),
        "noise": Mesh(noise, F),
        "all vertices equal": Mesh(0 * V, F),
        "flat": Mesh(V * [1, 1, 0], F),
        "on a line": Mesh(V * [1, 0, 0], F),
        "spikes of 100": Mesh(spikes, F),
        "cap drawn out 1e6 times": Mesh(drawn, F),
        "ellipsoid 1:1:1000": Mesh(W * [1, 1, 1000], G),
        "stacked 1500": stacked(1500),
        "stacked 6000": stacked(6000),
        "bipyramid 1000": bipyramid(1000),
        "bipyramid 3000": bipyramid(3000),
        "scale 1e-12": Mesh(1e-12 * V, F),
        "offset 1e12": Mesh(1e6 * V + 1e12, F),
    }


def row(name: str, found: Run) -> list[str]:
    """A line of the table."""
    q = found.quality
    figures = [f"{found.cpu:.2f}", str(found.attempt), str(q.inverted), f"{q.degree:.6f}", f"{q.iso_mean:.3g}", f"{q.iso_max:.3g}"]
    return [name, str(found.vertices), f"{found.wall:.2f}", *figures, str(q.degenerate)]


def main() -> None:
    """Warm up, map, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    sheet = Sheet.of(parser.parse_args())
    for level in (3, 5):
        run(Mesh(*icosphere(level)), SphereOptions())
    rows = [row(name, run(mesh, SphereOptions())) for name, mesh in cases().items()]
    heads = ["case", "V", "wall s", "CPU s", "attempt", "inverted", "degree", "iso mean", "iso max", "degenerate faces"]
    sheet.add(Table("Input made to break maps", heads, rows))


if __name__ == "__main__":
    main()
