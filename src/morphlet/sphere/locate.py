"""Which face of a spherical triangulation a direction falls in.

A cube-map grid gives a face nearby, a walk across edges finds the face. Both sides of an edge evaluate the same
expression, so they agree bit for bit; what rounding leaves open is settled with exact signs.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.errors import SolveError
from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel
from morphlet.numerics.predicates import determinant_signs
from morphlet.numerics.threads import each
from morphlet.surface.hierarchy import following
from morphlet.surface.mesh import Topology

CELL_VERTICES = 6
"""Vertices per grid row squared: cells hold about one vertex each."""
WALK_FACTOR = 10
"""A walk longer than 10 sqrt(faces) is going in circles."""
PARALLEL_FROM = 2000
"""Queries below which one thread is faster."""
SLICES = 16
"""Pieces that many queries are cut into for the threads."""


@dataclass(frozen=True, eq=False)
class Locator:
    """A prepared search over a closed triangulation of the sphere without inverted faces."""

    points: Float[np.ndarray, "n 3"]
    corner: Int[np.ndarray, "h"]
    twin: Int[np.ndarray, "h"]
    grid: Int[np.ndarray, "c"]

    @staticmethod
    def prepare(points: Float[np.ndarray, "n 3"], topology: Topology) -> "Locator":
        """Fill the grid; O(n)."""
        cells = max(4, int(np.sqrt(len(points) / CELL_VERTICES)))
        points, corner, twin = np.array(points), np.array(topology.faces).ravel(), np.array(topology.twins)
        grid = np.full(6 * cells * cells, -1, np.int64)
        _fill(points, corner, cells, grid)
        return Locator(points, corner, twin, grid)

    def locate(self, directions: Float[np.ndarray, "k 3"]) -> tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k 3"]]:
        """Face of each direction, and gnomonic weights: the weighted mean of the corners lies on the direction's ray.

        Notes
        -----
        About 7 steps of the walk per query: 50 000 queries in 0.04 s at 43k vertices.
        """
        directions = np.array(directions)
        face, weights = np.empty(len(directions), np.int64), np.empty((len(directions), 3))
        cells = int(np.sqrt(len(self.grid) / 6))
        limit = int(WALK_FACTOR * np.sqrt(len(self.corner) / 3)) + 10
        mesh = (self.points, self.corner, self.twin, self.grid, cells, limit)
        k, slices = len(directions), SLICES if len(directions) >= PARALLEL_FROM else 1
        each(lambda i: _walk_range(*mesh, k * i // slices, k * (i + 1) // slices, directions, face, weights), slices)
        for query in np.nonzero(face < 0)[0]:
            face[query], weights[query] = self._exhaustive(directions[query])
        return face, weights

    def _exhaustive(self, x: Float[np.ndarray, "3"]) -> tuple[int, Float[np.ndarray, "3"]]:
        """The first face none of whose edges has x strictly outside, by exact signs."""
        faces = self.corner.reshape(-1, 3)
        a, b, c = (self.points[faces[:, k]] for k in range(3))
        query = np.broadcast_to(x, a.shape)
        sides = [determinant_signs(query, p, q)[0] for p, q in ((b, c), (c, a), (a, b))]
        inside = np.all([s >= 0 for s in sides], axis=0)
        if not inside.any():
            raise SolveError("a triangulation that covers the sphere", f"no face around {x}", "map the mesh again: faces are inverted")
        hit = int(np.argmax(inside))
        raw = np.array([np.dot(x, np.cross(p[hit], q[hit])) for p, q in ((b, c), (c, a), (a, b))])
        raw = np.maximum(raw, 0)
        return hit, raw / raw.sum() if raw.sum() > 0 else np.full(3, 1 / 3)


@inlined_kernel
def _cell(x, y, z, cells):  # equi-angular cell of the cube face under (x, y, z)
    ax, ay, az = abs(x), abs(y), abs(z)
    if ax >= ay and ax >= az:
        side, u, v = 0 if x > 0 else 1, y / ax, z / ax
    elif ay >= az:
        side, u, v = 2 if y > 0 else 3, x / ay, z / ay
    else:
        side, u, v = 4 if z > 0 else 5, x / az, y / az
    i = min(max(int((np.arctan(u) * 4 / np.pi + 1) * 0.5 * cells), 0), cells - 1)
    j = min(max(int((np.arctan(v) * 4 / np.pi + 1) * 0.5 * cells), 0), cells - 1)
    return (side * cells + i) * cells + j


@inlined_kernel
def _centre(cell, cells):  # direction through the middle of a cell
    side, rest = cell // (cells * cells), cell % (cells * cells)
    u = np.tan(((rest // cells + 0.5) / cells * 2 - 1) * np.pi / 4)
    v = np.tan(((rest % cells + 0.5) / cells * 2 - 1) * np.pi / 4)
    s = 1.0 if side % 2 == 0 else -1.0
    if side < 2:
        return s, u, v
    if side < 4:
        return u, s, v
    return u, v, s


@kernel
def _fill(points, corner, cells, grid):  # one face per cell; empty cells take a neighbour's, breadth first
    for h in range(corner.shape[0]):
        p = corner[h]
        grid[_cell(points[p, 0], points[p, 1], points[p, 2], cells)] = h // 3
    queue = np.empty(grid.shape[0], np.int64)
    head, tail = 0, 0
    for cell in range(grid.shape[0]):
        if grid[cell] >= 0:
            queue[tail] = cell
            tail += 1
    while head < tail:
        cell = queue[head]
        head += 1
        x, y, z = _centre(cell, cells)
        width = 2.0 / cells
        for k in range(6):
            d = width if k % 2 == 0 else -width
            near = _cell(x + (d if k < 2 else 0.0), y + (d if 2 <= k < 4 else 0.0), z + (d if k >= 4 else 0.0), cells)
            if grid[near] < 0:
                grid[near] = grid[cell]
                queue[tail] = near
                tail += 1


@inlined_kernel
def _side(points, i, j, x, y, z):  # det(x, p_i, p_j), the same bits up to sign for (j, i)
    s = 1.0
    if i > j:
        i, j, s = j, i, -1.0
    ax, ay, az = points[i, 0] - x, points[i, 1] - y, points[i, 2] - z
    bx, by, bz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
    return s * (x * (ay * bz - az * by) + y * (az * bx - ax * bz) + z * (ax * by - ay * bx))


@inner_kernel
def _walk(points, corner, twin, face, limit, seed, x, y, z):  # face that holds (x, y, z), or -1
    came = -1
    for _ in range(limit):
        seed = (seed * 1103515245 + 12345) % 2147483648  # which edge is tried first: avoids cycles
        onward = -1
        for e in range(3):
            h = 3 * face + (seed // 65536 + e) % 3
            if h != came and _side(points, corner[h], corner[following(h)], x, y, z) < 0:
                onward = twin[h]
                break
        if onward < 0:
            for c in range(3):  # some corner lies ahead, unless rounding stopped the walk at the antipode
                p = corner[3 * face + c]
                if x * points[p, 0] + y * points[p, 1] + z * points[p, 2] > 0:
                    return face
            return -1
        came, face = onward, onward // 3
    return -1


@inlined_kernel
def _weights(points, corner, f, x, y, z):  # gnomonic weights of (x, y, z) in face f, and their sum: all >= 0 inside
    i, j, k = corner[3 * f], corner[3 * f + 1], corner[3 * f + 2]
    u, v, w = _side(points, j, k, x, y, z), _side(points, k, i, x, y, z), _side(points, i, j, x, y, z)
    return u, v, w, u + v + w


@inner_kernel
def pierced(points, corner, twin, face, limit, seed, x, y, z):  # face that holds (x, y, z), walking from `face`, and weights; -1 if lost
    u, v, w, total = _weights(points, corner, face, x, y, z)
    p = corner[3 * face]
    if u < 0 or v < 0 or w < 0 or not total > 0 or x * points[p, 0] + y * points[p, 1] + z * points[p, 2] <= 0:
        face = _walk(points, corner, twin, face, limit, seed, x, y, z)
        if face < 0:
            return -1, 0.0, 0.0, 0.0
        u, v, w, _ = _weights(points, corner, face, x, y, z)
        u, v, w = max(u, 0.0), max(v, 0.0), max(w, 0.0)
        total = u + v + w
        if not total > 0:
            return -1, 0.0, 0.0, 0.0
    return face, u / total, v / total, w / total


@kernel
def _walk_range(points, corner, twin, grid, cells, limit, first, last, directions, face, weights):
    for q in range(first, last):
        x, y, z = directions[q, 0], directions[q, 1], directions[q, 2]
        start = grid[_cell(x, y, z, cells)]
        face[q], weights[q, 0], weights[q, 1], weights[q, 2] = pierced(points, corner, twin, start, limit, q, x, y, z)
