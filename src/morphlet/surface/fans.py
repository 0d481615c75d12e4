"""How faces meet: half-edges paired along edges, corners joined into fans round vertices.

Pure functions of a face array; they accept any faces without a repeated index, however badly these are connected.
Half-edge h = 3 f + c and corner h (the corner the half-edge leaves) carry the same number.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Int
from scipy.sparse.csgraph import connected_components


@dataclass(frozen=True, eq=False)
class EdgeUses:
    """Half-edges grouped by the undirected edge they run along: group k is `order[first[k] : first[k] + count[k]]`."""

    order: Int[np.ndarray, "h"]
    first: Int[np.ndarray, "e"]
    count: Int[np.ndarray, "e"]

    def used(self, times: int) -> Int[np.ndarray, "k t"]:
        """The half-edges of the edges with exactly this many faces, one row per edge."""
        return self.order[self.first[self.count == times][:, None] + np.arange(times)]


def edge_uses(faces: Int[np.ndarray, "m 3"], n_vertices: int) -> EdgeUses:
    """Which half-edges run along each undirected edge. O(m log m)."""
    ends = np.sort(np.stack([faces.ravel(), following(faces).ravel()], axis=1), axis=1)
    key = ends[:, 0] * n_vertices + ends[:, 1]
    order = np.argsort(key, kind="stable")
    first = np.flatnonzero(np.diff(key[order], prepend=-1))
    return EdgeUses(order, first, np.diff(first, append=len(order)))


def following(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 3"]:
    """End vertex of each half-edge."""
    return np.roll(faces, -1, axis=1)


def next_corner(halfedge: Int[np.ndarray, "*k"]) -> Int[np.ndarray, "*k"]:
    """The next half-edge of the same face."""
    return halfedge - halfedge % 3 + (halfedge + 1) % 3


def opposed(faces: Int[np.ndarray, "m 3"], pairs: Int[np.ndarray, "k 2"]) -> np.ndarray:
    """Whether the two half-edges of each pair run in opposite directions."""
    start = faces.ravel()
    return start[pairs[:, 0]] != start[pairs[:, 1]]


def fans(faces: Int[np.ndarray, "m 3"], pairs: Int[np.ndarray, "k 2"]) -> Int[np.ndarray, "h"]:
    """Fan of each corner, numbered by first corner: corners of one vertex that the paired half-edges join.

    A corner has at most two neighbours in its fan, so that a fan is a strip or a full turn of faces.
    """
    h, g = pairs.T
    across = opposed(faces, pairs)
    at_start, at_end = np.where(across, next_corner(g), g), np.where(across, g, next_corner(g))
    return components(faces.size, np.r_[h, next_corner(h)], np.r_[at_start, at_end])


def components(n: int, i: Int[np.ndarray, "k"], j: Int[np.ndarray, "k"]) -> Int[np.ndarray, "n"]:
    """Connected part of each of n nodes with links i - j, parts numbered by first node."""
    links = sp.coo_matrix((np.ones(len(i), np.int8), (i, j)), shape=(n, n)).tocsr()
    label = connected_components(links, directed=False)[1].astype(np.int64)
    _, first, inverse = np.unique(label, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[inverse]


def separate(
    faces: Int[np.ndarray, "m 3"], n_vertices: int, pairs: Int[np.ndarray, "k 2"]
) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "n2"]]:
    """Give every fan a vertex of its own.

    The fan of a vertex's first corner keeps its number; the others get new ones at the end, in order of first corner.

    Returns
    -------
    faces, origin
        The new faces; for each new vertex number, the old vertex it is a copy of.
    """
    label = fans(faces, pairs)
    _, first = np.unique(label, return_index=True)
    vertex = faces.ravel()[first]
    copy = np.ones(len(vertex), bool)
    copy[np.unique(vertex, return_index=True)[1]] = False
    number = np.where(copy, n_vertices + np.cumsum(copy) - 1, vertex)
    return number[label].reshape(-1, 3), np.r_[np.arange(n_vertices), vertex[copy]]
