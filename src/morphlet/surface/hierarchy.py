"""A closed genus-0 mesh down to a tetrahedron and back, one vertex at a time.

Half-edge collapses u -> v keep v where it is, so the vertex sets are nested. Each collapse leaves a record (u, its ring
of neighbours counter-clockwise starting at v, and the face that spans each sector); undoing it rewrites those face rows
and needs no other connectivity. Only the link condition is a hard constraint: a simplicial sphere other than the
tetrahedron always has a contractible edge, so the bottom is always reached; shape is penalised, never forbidden.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from heapq import heapify, heappop, heappush
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from morphlet.errors import MeshError
from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel
from morphlet.surface.mesh import Mesh

CollapseCost = Literal["shape", "valence"]

FIRST_VALENCE_CAP = np.int64(24)  # a Python integer is a type of its own to numba
"""Vertices of higher valence wait: collapsing a hub scans its whole ring (a bipyramid of 1000: 13 s without, 0.1 s with)."""
CAP_RAISES = 12
"""The cap grows by 4 whenever nothing is left to collapse: 24 * 4**12 exceeds any valence."""
EAGER_BELOW = 8000
"""With fewer vertices left, costs around a collapse are renewed at once; above, only when their turn comes (three times faster)."""
STALE_SLACK = 1.0 + 1e-7
"""A vertex whose ring changed is only re-queued if its collapse became dearer than that."""
WORST_SHAPE = 1e3
"""Cap of the shape measure of a triangle (1 for an equilateral one)."""
SHAPE_WEIGHT = 1e-3
VALENCE_WEIGHT = 2.5e-3
VALENCE_LIMIT = 10
FLIP_COSINE = 0.1
"""A new triangle whose normal turns by more than acos(0.1) from the old one counts as flipped."""
LATE = 1e3
"""Added to the cost of vertices that shall stay longest: on a mesh of size 1 those of others are below 1, or absurd."""


class Star(NamedTuple):
    """Connectivity as arrays, edited in place by the collapses (numba type)."""

    corner: Int[np.ndarray, "h"]
    twin: Int[np.ndarray, "h"]
    start: Int[np.ndarray, "n"]
    valence: Int[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Hierarchy:
    """The records of all collapses from a mesh of n vertices to a tetrahedron.

    `removed[i]` left at step i; its ring is `ring_vertices[ring_offsets[i]:ring_offsets[i + 1]]`, and `ring_faces` holds
    the row of the face (removed[i], ring j, ring j + 1).
    """

    n_vertices: int
    n_faces: int
    removed: Int[np.ndarray, "r"]
    ring_offsets: Int[np.ndarray, "r1"]
    ring_vertices: Int[np.ndarray, "s"]
    ring_faces: Int[np.ndarray, "s"]
    base_rows: Int[np.ndarray, "4"]
    base_faces: Int[np.ndarray, "4 3"]

    @property
    def base_vertices(self) -> Int[np.ndarray, "4"]:
        """The four vertices that were never removed."""
        return np.unique(self.base_faces)

    @property
    def max_ring(self) -> int:
        """Length of the longest ring of the records."""
        return int(np.diff(self.ring_offsets).max(initial=3))

    def bottom(self) -> Int[np.ndarray, "m 3"]:
        """Face rows of the tetrahedron; rows that do not exist yet are -1."""
        faces = np.full((self.n_faces, 3), -1, np.int64)
        faces[self.base_rows] = self.base_faces
        return faces

    def faces_after(self, remaining: int) -> Int[np.ndarray, "m 3"]:
        """Face rows with the last records undone, until `remaining` records are left."""
        faces = self.bottom()
        undo_faces(len(self.removed), remaining, self.removed, self.ring_offsets, self.ring_vertices, self.ring_faces, faces)
        return faces

    def batches(self, growth: float, jump: float) -> Iterator[tuple[int, int]]:
        """Ranges (high, low) of records to undo so that the vertex count grows by `growth` each time.

        Beyond the fraction `jump` of all vertices the rest comes at once.
        """
        high, n = len(self.removed), 4
        while high > 0:
            goal = max(int(n * growth), n + 4)
            goal = self.n_vertices if goal > jump * self.n_vertices else goal
            low = max(high - (goal - n), 0)
            yield high, low
            n, high = n + high - low, low


def decimate(mesh: Mesh, cost: CollapseCost = "shape", late: Int[np.ndarray, "k"] | None = None) -> Hierarchy:
    """Collapse a closed genus-0 mesh to a tetrahedron.

    Parameters
    ----------
    mesh
        Closed, manifold, oriented, connected, genus 0 (see `requirements`).
    cost
        "shape": quadric error plus penalties on triangle shape, valence and flips; "valence": connectivity alone.
    late
        Vertices that shall stay while others can go, on a mesh scaled to about size 1.

    Raises
    ------
    MeshError
        If the collapses stop above four vertices, which happens only when the mesh is not a simplicial sphere.

    Notes
    -----
    O(n log n): 0.5 s at 48k vertices. Quadrics after Garland & Heckbert 1997; the link condition after Dey et al. 1999.
    """
    positions = np.array(mesh.vertices)
    star = _star(mesh)
    quadrics, extra = _vertex_quadrics(positions, star.corner), np.zeros(mesh.n_vertices)
    if late is not None:
        extra[late] = LATE
    removed, offsets, vertices, faces, dead = _collapse_all(positions, star, quadrics, extra, cost == "valence")
    left = mesh.n_vertices - len(removed)
    if left != 4:
        found = f"no edge to contract at {left} vertices"
        raise MeshError("a surface that collapses to a tetrahedron", found, "check genus and manifoldness")
    rows = np.nonzero(~dead)[0]
    base = star.corner.reshape(-1, 3)[rows]
    return Hierarchy(mesh.n_vertices, mesh.n_faces, removed, offsets, vertices, faces, rows, base)


def _star(mesh: Mesh) -> Star:
    """Editable connectivity of a closed mesh."""
    corner = np.array(mesh.faces).ravel()
    start = np.empty(mesh.n_vertices, np.int64)
    start[corner] = np.arange(len(corner))
    return Star(corner, np.array(mesh.topology.twins), start, np.bincount(corner, minlength=mesh.n_vertices))


def _vertex_quadrics(positions: Float[np.ndarray, "n 3"], corner: Int[np.ndarray, "h"]) -> Float[np.ndarray, "n 10"]:
    """Sum over the faces at each vertex of (area / 3) times the squared distance to their plane, as 10 coefficients."""
    a, b, c = (positions[corner[k::3]] for k in range(3))
    normal = np.cross(b - a, c - a)
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    plane = np.concatenate([normal, -np.sum(normal * a, axis=1, keepdims=True)], axis=1)
    upper = np.triu_indices(4)
    quadric = plane[:, upper[0]] * plane[:, upper[1]] * (length / 6)
    columns = [np.bincount(corner, np.repeat(q, 3), len(positions)) for q in quadric.T]
    return np.ascontiguousarray(np.stack(columns, axis=1))


@inlined_kernel
def following(h):  # half-edge after h in its face
    return h - 2 if h % 3 == 2 else h + 1


@inlined_kernel
def preceding(h):  # half-edge before h in its face
    return h + 2 if h % 3 == 0 else h - 1


@inner_kernel
def ring_halfedges(u, star, out):  # out (>= valence,): half-edges u -> neighbour, counter-clockwise; returns their count
    h = star.start[u]
    k = 0
    while True:
        out[k] = h
        k += 1
        h = star.twin[preceding(h)]
        if h == out[0]:
            return k


@inner_kernel
def _quadric_at(q, x, y, z):  # q (10,)
    return (
        q[0] * x * x + 2 * q[1] * x * y + 2 * q[2] * x * z + 2 * q[3] * x + q[4] * y * y + 2 * q[5] * y * z + 2 * q[6] * y
        + q[7] * z * z + 2 * q[8] * z + q[9]
    )  # fmt: skip


@inner_kernel
def _old_normals(u, k, ring, star, V, out):  # out (k, 4): normal of sector j and its length
    for j in range(k):
        a, b = star.corner[following(ring[j])], star.corner[preceding(ring[j])]
        px, py, pz = V[a, 0] - V[u, 0], V[a, 1] - V[u, 1], V[a, 2] - V[u, 2]
        qx, qy, qz = V[b, 0] - V[u, 0], V[b, 1] - V[u, 1], V[b, 2] - V[u, 2]
        out[j, 0], out[j, 1], out[j, 2] = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        out[j, 3] = np.sqrt(out[j, 0] ** 2 + out[j, 1] ** 2 + out[j, 2] ** 2)


@inner_kernel
def _moved_cost(v, i, k, ring, star, V, old, base, e4, limit):  # cost of the sectors once u sits at v = ring i; inf beyond limit
    worst, flips = 0.0, 0.0
    for step in range(1, k - 1):
        j = i + step if i + step < k else i + step - k
        a, b = star.corner[following(ring[j])], star.corner[preceding(ring[j])]
        px, py, pz = V[a, 0] - V[v, 0], V[a, 1] - V[v, 1], V[a, 2] - V[v, 2]
        qx, qy, qz = V[b, 0] - V[v, 0], V[b, 1] - V[v, 1], V[b, 2] - V[v, 2]
        nx, ny, nz = py * qz - pz * qy, pz * qx - px * qz, px * qy - py * qx
        area2 = np.sqrt(nx * nx + ny * ny + nz * nz)
        length2 = px * px + py * py + pz * pz + qx * qx + qy * qy + qz * qz + (px - qx) ** 2 + (py - qy) ** 2 + (pz - qz) ** 2
        shape = length2 / (2 * np.sqrt(3.0) * area2) if area2 > 1e-12 * length2 else WORST_SHAPE
        worst = max(worst, min(shape, WORST_SHAPE))
        if old[j, 0] * nx + old[j, 1] * ny + old[j, 2] * nz < FLIP_COSINE * area2 * old[j, 3]:
            flips += 1.0
        if base + e4 * (SHAPE_WEIGHT * worst + flips) >= limit:
            return np.inf
    return base + e4 * (SHAPE_WEIGHT * (worst if k > 3 else 1.0) + flips)


@inner_kernel
def _common_neighbours(h, star, mark, stamp):  # neighbours of the head of h that carry the stamp
    g0 = star.twin[h]
    g = g0
    count = 0
    while True:
        if mark[star.corner[following(g)]] == stamp:
            count += 1
        g = star.twin[preceding(g)]
        if g == g0:
            return count


@inner_kernel
def _best_collapse(u, star, V, Q, work, combinatorial, cap):  # (cost, half-edge u -> v); cost inf if there is none
    ring, mark, old, stamp, extra = work
    best, best_h = np.inf, -1
    if star.valence[u] > cap:
        return best, best_h
    k = ring_halfedges(u, star, ring)
    stamp[0] += 1
    for j in range(k):
        mark[star.corner[following(ring[j])]] = stamp[0]
    _old_normals(u, k, ring, star, V, old)
    for i in range(k):
        v = star.corner[following(ring[i])]
        crowd = max(0, star.valence[v] + k - 4 - VALENCE_LIMIT) ** 2
        e2 = (V[v, 0] - V[u, 0]) ** 2 + (V[v, 1] - V[u, 1]) ** 2 + (V[v, 2] - V[u, 2]) ** 2
        base = max(0.0, _quadric_at(Q[u], V[v, 0], V[v, 1], V[v, 2])) + e2 * e2 * VALENCE_WEIGHT * crowd
        if combinatorial:
            base = k + VALENCE_LIMIT / 4 * crowd
        if base >= best or _common_neighbours(ring[i], star, mark, stamp[0]) != 2:
            continue
        cost = base if combinatorial else _moved_cost(v, i, k, ring, star, V, old, base, e2 * e2, best)
        if cost < best:
            best, best_h = cost, ring[i]
    return best + extra[u], best_h


@inner_kernel
def _remove(u, k, ring, star):  # collapse u onto the head of ring[0]; the two faces beside that edge die
    first, last = ring[0], ring[k - 1]
    v, r1, rk = star.corner[following(first)], star.corner[preceding(first)], star.corner[following(last)]
    a1, a2 = star.twin[following(first)], star.twin[preceding(first)]
    b1, b2 = star.twin[following(last)], star.twin[last]
    for j in range(1, k - 1):
        star.corner[ring[j]] = v
    star.twin[a1], star.twin[a2], star.twin[b1], star.twin[b2] = a2, a1, b2, b1
    star.start[v], star.start[r1], star.start[rk] = a2, a1, b2
    star.valence[v] += k - 4
    star.valence[r1] -= 1
    star.valence[rk] -= 1
    return v


@kernel
def _collapse_all(V, star, Q, extra, combinatorial):
    n = V.shape[0]
    work = (np.empty(n + 8, np.int64), np.zeros(n, np.int64), np.empty((n + 8, 4)), np.zeros(1, np.int64), extra)
    ring, around = work[0], np.empty(n + 8, np.int64)
    version, alive = np.zeros(n, np.int64), np.ones(n, np.bool_)
    stale, waiting = np.zeros(n, np.bool_), np.zeros(n, np.bool_)  # cost to be renewed; in the heap
    dead = np.zeros(star.corner.shape[0] // 3, np.bool_)
    removed, offsets = np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    ring_vertices, ring_faces = np.empty(8 * n + 64, np.int64), np.empty(8 * n + 64, np.int64)
    left, count, used, cap, raises = n, 0, 0, FIRST_VALENCE_CAP, 0
    heap = [(0.0, 0, 0)]
    heap.pop()
    fresh = True
    while left > 4 and raises <= CAP_RAISES:
        if fresh:
            fresh = False
            for u in range(n):
                if alive[u]:
                    version[u] += 1
                    stale[u] = False
                    cost, h = _best_collapse(u, star, V, Q, work, combinatorial, cap)
                    waiting[u] = h >= 0
                    if h >= 0:
                        heap.append((cost, u, version[u]))
            heapify(heap)
        if len(heap) == 0:
            fresh, cap, raises = True, 4 * cap, raises + 1
            continue
        old, u, stamp = heappop(heap)
        if not alive[u] or stamp != version[u]:
            continue
        cost, h = _best_collapse(u, star, V, Q, work, combinatorial, cap)
        waiting[u] = h >= 0
        if h < 0:
            continue
        if stale[u] and cost > old * STALE_SLACK:
            stale[u] = False
            heappush(heap, (cost, u, stamp))
            continue
        star.start[u] = h
        k = ring_halfedges(u, star, ring)
        if used + k > ring_vertices.shape[0]:
            ring_vertices, ring_faces = _grown(ring_vertices, k), _grown(ring_faces, k)
        for j in range(k):
            ring_vertices[used + j] = star.corner[following(ring[j])]
            ring_faces[used + j] = ring[j] // 3
        removed[count], offsets[count + 1] = u, used + k
        used, count, left, alive[u] = used + k, count + 1, left - 1, False
        dead[ring[0] // 3], dead[ring[k - 1] // 3] = True, True
        v = _remove(u, k, ring, star)
        for j in range(10):
            Q[v, j] += Q[u, j]
        k = ring_halfedges(v, star, around)
        for j in range(k + 1):
            w = v if j == k else star.corner[following(around[j])]
            stale[w] = True
            if w == v or not waiting[w] or left < EAGER_BELOW:
                version[w] += 1
                cost, h = _best_collapse(w, star, V, Q, work, combinatorial, cap)
                stale[w], waiting[w] = False, h >= 0
                if h >= 0:
                    heappush(heap, (cost, w, version[w]))
    return removed[:count].copy(), offsets[: count + 1].copy(), ring_vertices[:used].copy(), ring_faces[:used].copy(), dead


@inner_kernel
def _grown(array, extra):  # a copy at least twice as long
    bigger = np.empty(2 * array.shape[0] + extra, np.int64)
    for i in range(array.shape[0]):
        bigger[i] = array[i]
    return bigger


@kernel
def undo_faces(high, low, removed, offsets, ring_vertices, ring_faces, faces):  # faces (m, 3), rewritten in place
    for i in range(high - 1, low - 1, -1):
        first, k = offsets[i], offsets[i + 1] - offsets[i]
        for j in range(k):
            row = ring_faces[first + j]
            faces[row, 0] = removed[i]
            faces[row, 1] = ring_vertices[first + j]
            faces[row, 2] = ring_vertices[first + (j + 1) % k]


@kernel
def push_down(removed, offsets, ring_vertices, mass):  # mass (n,): hand each removed vertex's mass to its ring, in order
    for i in range(removed.shape[0]):
        for j in range(offsets[i], offsets[i + 1]):
            mass[ring_vertices[j]] += mass[removed[i]] / (offsets[i + 1] - offsets[i])


@kernel
def pull_up(high, low, removed, offsets, ring_vertices, mass):  # mass (n,): take it back, in reverse order
    for i in range(high - 1, low - 1, -1):
        for j in range(offsets[i], offsets[i + 1]):
            mass[ring_vertices[j]] -= mass[removed[i]] / (offsets[i + 1] - offsets[i])
