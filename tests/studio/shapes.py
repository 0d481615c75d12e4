"""A mesh to edit, and a handle on it."""

import numpy as np

from morphlet import Mesh
from support import icosphere


def egg(level: int = 3) -> Mesh:
    """A lumpy egg, 10 4^level + 2 vertices."""
    ball = icosphere(level)
    x = ball.vertices
    return ball.with_vertices(x * [1.0, 1.3, 1.7] * (1 + 0.15 * np.cos(3 * x[:, [0]]) + 0.1 * x[:, [2]] ** 2))


def top(mesh: Mesh, count: int = 12) -> list[int]:
    """The highest vertices."""
    return np.sort(np.argsort(mesh.vertices[:, 2])[-count:]).tolist()
