"""What several tests share: where public meshes are, small generated meshes, and exact signs that owe nothing to the package."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from morphlet import Mesh
from morphlet.io.formats import read
from morphlet.numerics import unit_sphere

SIDE_SLACK = 1e-9
"""Far above the rounding of a determinant of unit vectors: what is left out surely does not hold the direction."""
GENERIC = (0.5257311121191336, 0.3090169943749474, 0.7926544117465372)
"""A direction that no test puts a vertex or an edge on."""
DIRECTIONS = np.array([[0, 0, 1], [0.9, 0, 0.436], [-0.6, 0.8, 0], [0, -1, 0], [0.5, 0.5, -0.707], [-0.8, -0.3, -0.52]])
HEIGHTS = (1.0, 1.2, 1.5, 1.9, 1.1, 1.7)
"""Of the bumps of a ball without symmetry."""
GLTF_POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
"""Of one triangle."""


def data_file(name: str) -> Path:
    """A public test mesh; the test is skipped where it cannot be had."""
    folder = os.environ.get("MORPHLET_DATA")
    if not folder:
        pytest.skip("set MORPHLET_DATA to the folder of public test meshes")
    path = Path(folder, name)
    if not path.exists():
        pytest.skip(f"{name} is not in the folder that MORPHLET_DATA names")
    return path


def data_mesh(name: str) -> Mesh:
    """A public test mesh, as its file has it."""
    return read(data_file(name))


def icosphere(level: int) -> Mesh:
    """The unit sphere, 10 4^level + 2 vertices."""
    return Mesh(*unit_sphere.icosphere(level))


def noisy(level: int, amount: float, seed: int = 0) -> Mesh:
    """An icosphere with vertices moved along their radii by up to `amount`."""
    ball = icosphere(level)
    radius = 1 + amount * (2 * np.random.default_rng(seed).random((ball.n_vertices, 1)) - 1)
    return ball.with_vertices(ball.vertices * radius)


def blob(level: int) -> Mesh:
    """A smooth, lopsided body without symmetry: no two collapses cost the same."""
    ball = icosphere(level)
    x, y, z = ball.vertices.T
    radius = 1 + 0.3 * np.sin(2 * x + 0.7) * np.cos(1.5 * y - 0.3) + 0.2 * np.sin(3 * z + x * y)
    return ball.with_vertices(ball.vertices * radius[:, None] * [1.0, 1.37, 0.81])


def tetrahedron() -> Mesh:
    """The corner of a cube."""
    return Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def torus(centre: tuple[float, float, float] = (0, 0, 0)) -> Mesh:
    """A torus of major radius 1 and minor radius 0.3 about the z axis."""
    return Mesh.from_trimesh(trimesh.creation.torus(1.0, 0.3, 24, 9).apply_translation(centre))


def beside(first: Mesh, second: Mesh) -> Mesh:
    """Both meshes in one, not connected."""
    return Mesh(np.vstack([first.vertices, second.vertices]), np.vstack([first.faces, second.faces + first.n_vertices]))


def bipyramid(sides: int) -> Mesh:
    """Two hubs of valence `sides` over a circle."""
    turn = 2 * np.pi * np.arange(sides) / sides
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    circle = np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)
    top, bottom = np.full(sides, sides), np.full(sides, sides + 1)
    return Mesh(np.vstack([circle, [[0, 0, 1], [0, 0, -1]]]), np.vstack([np.stack([i, j, top], 1), np.stack([j, i, bottom], 1)]))


def stacked(n: int, seed: int = 1) -> Mesh:
    """A tetrahedron with n - 4 vertices put into random faces, one after the other, at random positions: hubs and slivers."""
    rng = np.random.default_rng(seed)
    faces = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]]
    for vertex in range(4, n):
        row = int(rng.integers(len(faces)))
        a, b, c = faces[row]
        faces[row] = [a, b, vertex]
        faces += [[b, c, vertex], [c, a, vertex]]
    return Mesh(rng.normal(size=(n, 3)), faces)


def positive_sphere(level: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Points of an icosphere pushed about as far as no face folds, and its faces."""
    points, faces = unit_sphere.icosphere(level)
    rng, spread = np.random.default_rng(seed), 0.25 / 2**level
    while True:
        moved = points + spread * rng.normal(size=points.shape)
        moved /= np.linalg.norm(moved, axis=1, keepdims=True)
        if (exact_signs(moved, faces) > 0).all():
            return moved, faces
        spread *= 0.9


def random_rotation(seed: int) -> np.ndarray:
    """A rotation matrix."""
    q, r = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return q * np.sign(np.linalg.det(q))


def exact_signs(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Sign of det(a, b, c) of each face, in integers of any length: each row is scaled by a power of two until it is whole."""
    return determinant_signs(*(points[faces[:, k]] for k in range(3)))


def determinant_signs(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Exact sign of det(a, b, c), row by row."""
    (a0, a1, a2), (b0, b1, b2), (c0, c1, c2) = (_whole(x).T for x in (a, b, c))
    total = a0 * (b1 * c2 - b2 * c1) + a1 * (b2 * c0 - b0 * c2) + a2 * (b0 * c1 - b1 * c0)
    return np.array([(t > 0) - (t < 0) for t in total])


def exact_degree(points: np.ndarray, faces: np.ndarray) -> int:
    """How often the faces cover a generic direction, each counted with its exact sign: the degree of the radial map."""
    x = np.array(GENERIC)
    corners = [points[faces[:, k]] for k in range(3)]
    sides = np.stack([np.cross(corners[i - 2], corners[i - 1]) @ x for i in range(3)])
    near = np.flatnonzero((sides > -SIDE_SLACK).all(axis=0) | (sides < SIDE_SLACK).all(axis=0))
    a, b, c = (p[near] for p in corners)
    query = np.broadcast_to(x, a.shape)
    signs = determinant_signs(a, b, c)
    turns = np.stack([determinant_signs(query, p, q) for p, q in ((a, b), (b, c), (c, a))])
    return int(signs[(turns == signs).all(axis=0)].sum())


def assert_one_to_one(points: np.ndarray, faces: np.ndarray) -> None:
    """No face is inverted or flat, and the sphere is covered once, by tests that share no code with the package."""
    assert (exact_signs(points, faces) > 0).all()
    assert exact_degree(points, faces) == 1


def bumpy(directions: Any = DIRECTIONS, heights: Any = HEIGHTS, level: int = 4) -> Mesh:
    """A ball with round bumps in some directions; as it is, without symmetry."""
    ball = icosphere(level)
    lift = np.exp(12 * (ball.vertices @ np.transpose(directions) - 1)) @ np.asarray(heights, float)
    return ball.with_vertices(ball.vertices * (1 + lift[:, None]))


def relabelled(mesh: Mesh, seed: int = 0) -> tuple[Mesh, np.ndarray]:
    """The same surface with vertices and faces in another order, and where each old vertex went."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(mesh.n_vertices)
    place = np.argsort(order)
    faces = place[mesh.faces][rng.permutation(mesh.n_faces)]
    return Mesh(mesh.vertices[order], np.roll(faces, 1, axis=1)), place


def gltf_triangle(uri: str, **changes: Any) -> str:
    """A glTF scene of one triangle whose positions, `GLTF_POSITIONS`, are at a URI; `changes` replace parts of it."""
    tree = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"byteLength": 36, "uri": uri}],
    }
    return json.dumps(tree | changes)


def _whole(rows: np.ndarray) -> np.ndarray:
    """Each row times a power of two, as Python integers."""
    out = np.empty(rows.shape, object)
    for place, row in enumerate(rows.tolist()):
        ratios = [value.as_integer_ratio() for value in row]
        common = max(bottom for _, bottom in ratios)
        out[place] = [top * (common // bottom) for top, bottom in ratios]
    return out
