"""Regions for tests: a body held at the bottom and pulled at the top; and the energy of the whole mesh, told independently."""

import numpy as np

from morphlet import Mesh
from morphlet.editing.roi import Roi
from morphlet.numerics.rotations import exponential


def capped(mesh: Mesh, top: float = 0.15, bottom: float = 0.3, weight: float | None = None) -> Roi:
    """The highest share of the vertices is the handle, the lowest stays, the rest follows."""
    order = np.argsort(mesh.vertices[:, 2], kind="stable")
    n_low, n_high = int(bottom * len(order)), int(top * len(order))
    handle = np.sort(order[len(order) - n_high :])
    return Roi(mesh, handle, order[n_low : len(order) - n_high], None if weight is None else np.full(n_high, weight))


def moved(points: np.ndarray, turn: list[float], shift: list[float]) -> np.ndarray:
    """The points turned about their centre by a rotation vector, then shifted."""
    centre = points.mean(axis=0)
    return (points - centre) @ exponential(np.array([turn]))[0].T + centre + np.array(shift)


def patch_of_grid(n: int) -> Mesh:
    """A square of n x n vertices, bent; it has a boundary."""
    x, y = (part.ravel() for part in np.meshgrid(np.arange(n), np.arange(n), indexing="ij"))
    number = np.arange(n * n).reshape(n, n)
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    return Mesh(np.column_stack([x, y, 0.1 * np.sin(x) * y]), np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])]))


def covariances(mesh: Mesh, positions: np.ndarray, least: float = -np.inf) -> np.ndarray:
    """Sum of c e e'^T over all edges of all faces around each vertex."""
    out = np.zeros((mesh.n_vertices, 3, 3))
    for face in mesh.faces:
        c = cotangents(mesh.vertices[face], least)
        for k in range(3):
            i, j = face[k - 2], face[k - 1]
            out[face] += c[k] * np.outer(mesh.vertices[i] - mesh.vertices[j], positions[i] - positions[j])
    return out


def whole_energy(mesh: Mesh, positions: np.ndarray, least: float = -np.inf) -> float:
    """The spokes-and-rims energy over all vertices, each with its best rotation, by singular values."""
    u, s, vt = np.linalg.svd(covariances(mesh, positions, least))
    best = s[:, 0] + s[:, 1] + s[:, 2] * np.sign(np.linalg.det(u @ vt))
    squares = 0.0
    for face in mesh.faces:
        c = cotangents(mesh.vertices[face], least)
        for k in range(3):
            i, j = face[k - 2], face[k - 1]
            squares += c[k] * (np.sum((mesh.vertices[i] - mesh.vertices[j]) ** 2) + np.sum((positions[i] - positions[j]) ** 2))
    return float(squares - 2 / 3 * best.sum())


def cotangents(corners: np.ndarray, least: float = -np.inf) -> np.ndarray:
    """Half the cotangent at each corner of one triangle."""
    out = np.empty(3)
    for k in range(3):
        u, v = corners[k - 2] - corners[k], corners[k - 1] - corners[k]
        out[k] = max(0.5 * (u @ v) / np.linalg.norm(np.cross(u, v)), least)
    return out
