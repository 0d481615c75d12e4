"""Loop subdivision of closed triangle meshes: each face in four, level by level, the surface ever smoother.

Vertices of a level keep their numbers on the next; the vertex of edge e comes after them, as number n + e. Edges are numbered by
their ends, the smaller end first. All that decides order is integer arithmetic; masks use + - * / alone.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

EDGE_ENDS, EDGE_SIDES = 3 / 8, 1 / 8
"""Mask of an edge's vertex: each end, each vertex opposite."""
RING_SHARE = 3 / 8
"""Share of a vertex's new place that its neighbours have together; half of it where there are but three (Warren's masks)."""
FEWEST_NEIGHBOURS = 3


@dataclass(frozen=True, eq=False)
class Refinement:
    """From one level of a subdivision to the next.

    Parameters
    ----------
    faces, finer
        Of this level, and of the next: face f becomes 4 f to 4 f + 3, the middle one last.
    ends
        Per edge: its ends, the smaller first; the vertex opposite on the side where they come in this order, and on the other.
    near
        Per edge: those from its first end and its second to the first vertex opposite, then to the other.
    even, odd
        Masks: where vertices go, and where the vertices of edges are.
    """

    faces: Int[np.ndarray, "m 3"]
    finer: Int[np.ndarray, "k 3"]
    ends: Int[np.ndarray, "e 4"]
    near: Int[np.ndarray, "e 4"]
    even: sp.csr_matrix
    odd: sp.csr_matrix

    @property
    def masks(self) -> sp.csr_matrix:
        """All of the next level's vertices from this level's."""
        return sp.vstack([self.even, self.odd], format="csr")


def refinements(faces: Int[np.ndarray, "m 3"], n: int, count: int) -> list[Refinement]:
    """So many levels of a closed mesh of n vertices."""
    levels = []
    for _ in range(count):
        levels.append(_refinement(faces, n))
        faces, n = levels[-1].finer, n + len(levels[-1].ends)
    return levels


def refined_sizes(n: int, m: int, count: int) -> tuple[int, int]:
    """Vertices and faces of a closed mesh of n and m, after so many levels."""
    return n + m // 2 * (4**count - 1), m * 4**count


def edge_normals(positions: Float[np.ndarray, "n 3"], level: Refinement) -> Float[np.ndarray, "e 3"]:
    """Unit normals at a level's edges: those of the ends' faces, weighted with their areas; zero where they cancel."""
    normal = vertex_normals(positions, level.faces)
    total = normal[level.ends[:, 0]] + normal[level.ends[:, 1]]
    length = np.sqrt(total[:, 0] ** 2 + total[:, 1] ** 2 + total[:, 2] ** 2)
    return total / np.where(length > 0, length, 1.0)[:, None]


def vertex_normals(positions: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "n 3"]:
    """Sums of the normals of the faces at each vertex, as long as twice their areas."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    normal = np.repeat(np.cross(b - a, c - a), 3, axis=0)
    return np.stack([np.bincount(faces.ravel(), normal[:, k], len(positions)) for k in range(3)], axis=1)


def _refinement(faces: Int[np.ndarray, "m 3"], n: int) -> Refinement:
    """One level: edges, their neighbours, the next level's faces, masks."""
    start, end, apex = faces, np.roll(faces, -1, axis=1), np.roll(faces, 1, axis=1)
    key = np.minimum(start, end) * n + np.maximum(start, end)
    keys, edge = np.unique(key, return_inverse=True)
    edge = edge.reshape(faces.shape)
    ends = np.empty((len(keys), 4), np.int64)
    ends[:, 0], ends[:, 1] = keys // n, keys % n
    forward = start < end
    ends[edge[forward], 2], ends[edge[~forward], 3] = apex[forward], apex[~forward]
    a, b, c, d = ends.T
    sides = ((a, c), (b, c), (a, d), (b, d))
    near = np.stack([np.searchsorted(keys, np.minimum(p, q) * n + np.maximum(p, q)) for p, q in sides], axis=1)
    return Refinement(faces, _split(faces, n + edge), ends, near, *_masks(ends, n))


def _split(faces: Int[np.ndarray, "m 3"], middle: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "k 3"]:
    """Each face in four; `middle` are the vertices of its edges, the first between its corners 0 and 1."""
    a, b, c = faces.T
    ab, bc, ca = middle.T
    rows = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.stack([np.stack(row, axis=1) for row in rows], axis=1).reshape(-1, 3)


def _masks(ends: Int[np.ndarray, "e 4"], n: int) -> tuple[sp.csr_matrix, sp.csr_matrix]:
    """Where vertices go, and where the vertices of edges are."""
    count = len(ends)
    a, b = ends[:, 0], ends[:, 1]
    weights = np.tile([EDGE_ENDS, EDGE_ENDS, EDGE_SIDES, EDGE_SIDES], count)
    odd = sp.csr_matrix((weights, (np.repeat(np.arange(count), 4), ends.ravel())), (count, n))
    valence = np.bincount(ends[:, :2].ravel(), minlength=n)
    share = np.where(valence > FEWEST_NEIGHBOURS, RING_SHARE, RING_SHARE / 2)
    each = share / np.maximum(valence, 1)
    rows, columns = np.concatenate([np.arange(n), a, b]), np.concatenate([np.arange(n), b, a])
    even = sp.csr_matrix((np.concatenate([1 - each * valence, each[a], each[b]]), (rows, columns)), (n, n))
    return even, odd
