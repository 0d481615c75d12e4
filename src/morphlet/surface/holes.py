"""Boundary loops closed by a lid: one face over a loop of three, a fan from a new vertex over a longer one."""

import numpy as np
from jaxtyping import Float, Int


def perimeter(vertices: Float[np.ndarray, "n 3"], loop: Int[np.ndarray, "k"]) -> float:
    """Length of a closed loop of vertices."""
    return float(np.linalg.norm(vertices[loop] - vertices[np.roll(loop, -1)], axis=1).sum())


def lids(vertices: Float[np.ndarray, "n 3"], loops: list[Int[np.ndarray, "_"]]) -> tuple[Float[np.ndarray, "v 3"], Int[np.ndarray, "f 3"]]:
    """New vertices (numbered from n) and new faces that close the loops; a new vertex is the mean of its loop."""
    centres = [vertices[loop].mean(axis=0) for loop in loops if len(loop) > 3]
    faces, apex = [np.zeros((0, 3), np.int64)], len(vertices)
    for loop in loops:
        faces.append(_lid(loop, apex))
        apex += len(loop) > 3
    return np.array(centres).reshape(-1, 3), np.concatenate(faces)


def _lid(loop: Int[np.ndarray, "k"], apex: int) -> Int[np.ndarray, "f 3"]:
    """Faces over one loop; they run against its half-edges."""
    if len(loop) == 3:
        return loop[None, ::-1]
    return np.stack([np.roll(loop, -1), loop, np.full(len(loop), apex)], axis=1)
