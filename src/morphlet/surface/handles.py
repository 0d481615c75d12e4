"""Handles cut open along short loops that do not separate the surface.

Loops come from a tree-cotree decomposition [1]: shortest paths from a base point span the vertices, a spanning tree of
the remaining edges (longest loops first) spans the faces and holes, and each of the 2 g edges left over closes a loop
that no cut of the surface into two parts contains. The surface must be manifold and consistently oriented; it may have
boundary loops.

References
----------
[1] Erickson, Whittlesey: Greedy optimal homotopy and homology generators. SODA 2005.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import dijkstra, minimum_spanning_tree

from morphlet.surface.fans import components, edge_uses, separate
from morphlet.surface.holes import perimeter
from morphlet.surface.mesh import Topology

BASES = 8
"""Base points tried per handle, far from each other: the shortest loop through the best of them is then shortened."""
ROUNDS = 10
"""How often a loop is replaced by the shortest one through its own middle; it settles in two or three."""
LENGTH_FLOOR = 1e-9
"""Of the mean edge: added to each edge, so that coincident vertices are still neighbours in a sparse graph."""


@dataclass(frozen=True, eq=False)
class _Loop:
    """A simple closed path and its length; no vertices and infinite length if there is none."""

    vertices: Int[np.ndarray, "k"]
    length: float


@dataclass(frozen=True, eq=False)
class _Graph:
    """Edges of a surface with their lengths and the two faces (or holes) they lie between."""

    edges: Int[np.ndarray, "e 2"]
    lengths: Float[np.ndarray, "e"]
    sides: Int[np.ndarray, "e 2"]
    paths: sp.csr_matrix


def genera(topology: Topology) -> Int[np.ndarray, "c"]:
    """Number of handles of each connected part of a manifold, oriented surface."""
    part, n = topology.components, topology.n_components
    size = np.bincount(part[topology.referenced], minlength=n)
    edges, faces = np.bincount(part[topology.edges[:, 0]], minlength=n), np.bincount(part[topology.faces[:, 0]], minlength=n)
    holes = np.bincount([part[loop[0]] for loop in topology.boundary_loops] or np.zeros(0, np.int64), minlength=n)
    return (2 - (size - edges + faces) - holes) // 2


def cut_handles(
    vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], budget: int
) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "n2"], list[float]]:
    """Cut at most `budget` handles, shortest loop first within each part.

    Returns
    -------
    faces, origin, lengths
        Faces over the old vertices and copies of those cut through; the old vertex of each; the length of each cut.
    """
    origin, lengths = np.arange(len(vertices)), list[float]()
    while len(lengths) < budget:
        topology = Topology(faces, len(origin))
        handled = np.flatnonzero(genera(topology))
        if not len(handled):
            break
        loop = shortest_loop(vertices[origin], topology, int(handled[0]))
        faces, copies = _cut(faces, len(origin), loop)
        lengths.append(perimeter(vertices[origin], loop))
        origin = origin[copies]
    return faces, origin, lengths


def shortest_loop(vertices: Float[np.ndarray, "n 3"], topology: Topology, part: int) -> Int[np.ndarray, "k"]:
    """A short simple loop round or through a handle of a connected part; locally the shortest, not always globally."""
    graph = _graph(vertices, topology)
    best = _Loop(np.zeros(0, np.int64), np.inf)
    remoteness = np.where(topology.components == part, np.inf, -1.0)
    for _ in range(BASES):
        base = int(np.argmax(remoteness))
        loop, distance = _loop_through(graph, base)
        remoteness = np.where(remoteness < 0, remoteness, np.minimum(remoteness, distance))
        best = min(best, loop, key=lambda candidate: candidate.length)
    return _tightened(graph, best).vertices


def _tightened(graph: _Graph, loop: _Loop) -> _Loop:
    """The loop replaced by the shortest one through its middle, until that is no shorter."""
    for _ in range(ROUNDS):
        shorter, _ = _loop_through(graph, int(loop.vertices[len(loop.vertices) // 2]))
        if shorter.length >= loop.length:
            break
        loop = shorter
    return loop


def _graph(vertices: Float[np.ndarray, "n 3"], topology: Topology) -> _Graph:
    """Primal and dual graph; each boundary loop is one dual node, numbered after the faces."""
    uses = edge_uses(topology.faces, len(vertices))
    inner, outer = uses.used(2), uses.used(1)[:, 0]
    rim = components(len(vertices), *topology.halfedges[outer].T)
    holes = np.unique(rim[topology.halfedges[outer, 0]], return_inverse=True)[1] + topology.faces.shape[0]
    edges = topology.halfedges[np.r_[inner[:, 0], outer]]
    lengths = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
    lengths = lengths + (LENGTH_FLOOR * lengths.mean() or 1.0)
    n = len(vertices)
    paths = sp.coo_matrix((np.r_[lengths, lengths], (np.r_[edges[:, 0], edges[:, 1]], np.r_[edges[:, 1], edges[:, 0]])), shape=(n, n))
    return _Graph(edges, lengths, np.concatenate([inner // 3, np.stack([outer // 3, holes], axis=1)]), paths.tocsr())


def _loop_through(graph: _Graph, base: int) -> tuple[_Loop, Float[np.ndarray, "n"]]:
    """The shortest left-over loop of the tree-cotree decomposition at a base point; distances from that point."""
    distances, predecessors = dijkstra(graph.paths, directed=False, indices=np.array([base]), return_predecessors=True)
    distance, before = distances[0], predecessors[0]
    i, j = graph.edges.T
    free = np.flatnonzero((before[i] != j) & (before[j] != i) & np.isfinite(distance[i]))
    length = distance[i[free]] + distance[j[free]] + graph.lengths[free]
    order = np.argsort(-length, kind="stable")
    left = free[order[~_spanning(graph.sides[free[order]])]]
    loops = [_Loop(np.array(_closed(before, *graph.edges[e].tolist())), 0.0) for e in left]
    measured = [_Loop(loop.vertices, _length(graph, loop.vertices)) for loop in loops]
    return min(measured, key=lambda loop: loop.length, default=_Loop(np.zeros(0, np.int64), np.inf)), distance


def _spanning(links: Int[np.ndarray, "k 2"]) -> Bool[np.ndarray, "k"]:
    """Which links form the spanning forest that prefers earlier ones (Kruskal); one of parallel links."""
    low, high = np.sort(links, axis=1).T
    n = int(links.max(initial=0)) + 1
    _, earliest = np.unique(low * n + high, return_index=True)
    weights = sp.coo_matrix((earliest + 1.0, (low[earliest], high[earliest])), shape=(n, n)).tocsr()
    chosen = np.zeros(len(links), bool)
    chosen[minimum_spanning_tree(weights).data.astype(np.int64) - 1] = True
    return chosen


def _closed(before: Int[np.ndarray, "n"], u: int, v: int) -> list[int]:
    """The tree paths to u and v joined by the edge u v, without the part they share."""
    down, up = _path(before, u), _path(before, v)
    shared = sum(1 for a, b in zip(down, up, strict=False) if a == b)
    return down[shared - 1 :] + up[shared:][::-1]


def _path(before: Int[np.ndarray, "n"], vertex: int) -> list[int]:
    """From the base to a vertex."""
    path = [vertex]
    while before[path[-1]] >= 0:
        path.append(int(before[path[-1]]))
    return path[::-1]


def _length(graph: _Graph, loop: Int[np.ndarray, "k"]) -> float:
    """Length along a loop of edges."""
    return float(np.asarray(graph.paths[loop, np.roll(loop, -1)]).sum())


def _cut(
    faces: Int[np.ndarray, "m 3"], n_vertices: int, loop: Int[np.ndarray, "k"]
) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "n2"]]:
    """Open the surface along a loop of edges."""
    pairs = edge_uses(faces, n_vertices).used(2)
    ends = np.sort(Topology(faces, n_vertices).halfedges[pairs[:, 0]], axis=1)
    sides = np.sort(np.stack([loop, np.roll(loop, -1)], axis=1), axis=1)
    on_loop = np.isin(ends[:, 0] * n_vertices + ends[:, 1], sides[:, 0] * n_vertices + sides[:, 1])
    return separate(faces, n_vertices, pairs[~on_loop])
