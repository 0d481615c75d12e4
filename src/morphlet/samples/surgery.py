# mypy: disable-error-code="untyped-decorator"
"""Edge collapses and edge flips on a closed triangle mesh.

A mesh is `start`, the vertex at which each half-edge begins (three half-edges per face), with `twins`, the opposite
half-edge of each; faces that are gone start at -1. No operation moves a vertex, changes the genus or opens the surface.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.numerics.compiled import njit
from morphlet.surface.mesh import Topology

CANDIDATES = 0.3
"""Share of the edges, cheapest first, that one pass may collapse: keeps the thinning even."""

TINY = np.finfo(float).tiny
"""Keeps divisions by areas defined."""

SHAPE_FLOOR = 0.3
"""Least shape quality (1 = equilateral, 0 = flat) of a face that a collapse may make, before it is relaxed."""

SHAPE_RELAXED = 1e-3
"""Where relaxing the floor ends: below it no more vertices are removed."""

TURN = 0.5
"""Least cosine between a face before and after an operation: a face turns by at most 60 degrees."""

MOST_NEIGHBOURS = 8
"""A collapse leaves no vertex with more neighbours than this."""

SWEEPS = 12
"""Most sweeps of flips over all edges; Delaunay flips come to rest after three or four."""

ROUNDING = 1e-9
"""A sum of two cotangents must be below minus this for a flip, so that cocircular faces do not flip for ever."""

NONE = np.zeros(0, np.int64)
"""No vertices."""


def thinned(
    vertices: Float[np.ndarray, "n 3"],
    faces: Int[np.ndarray, "m 3"],
    lengths: Float[np.ndarray, "n"],
    wanted: int,
    held: Int[np.ndarray, "k"] = NONE,
    fidelity: float = 0.0,
) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, "w"]]:
    """Faces over the `wanted` vertices that stay, the held ones among them, and which these are.

    Edges short beside `lengths` collapse first; with a fidelity, `fidelity` times their height over the surface counts as length too.
    """
    start, twins = faces.ravel().copy(), np.array(Topology(faces, len(vertices)).twins)
    free = ~np.isin(np.arange(len(vertices)), held)
    points = np.array(vertices, order="C")
    surplus, floor = len(vertices) - wanted, SHAPE_FLOOR
    while surplus > 0 and floor > SHAPE_RELAXED:
        order = _cheapest(start, free, points, lengths, fidelity)
        removed = int(_collapse(start, twins, points, order, np.array([surplus, floor])))
        surplus -= removed
        if removed < 0.01 * len(points) and surplus > removed:
            floor *= 0.5
    left = start.reshape(-1, 3)
    kept, compact = np.unique(left[left[:, 0] >= 0], return_inverse=True)
    return compact.reshape(-1, 3).astype(np.int64), kept


def flipped(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], turn: float = TURN) -> Int[np.ndarray, "m 3"]:
    """The faces after flips of all edges that are not Delaunay, where no face turns farther than this cosine says."""
    start, twins = faces.ravel().copy(), np.array(Topology(faces, len(vertices)).twins)
    points = np.array(vertices, order="C")
    for _ in range(SWEEPS):
        if _flip(start, twins, points, turn) == 0:
            break
    return start.reshape(-1, 3)


def _cheapest(
    start: Int[np.ndarray, "h"],
    free: Bool[np.ndarray, "n"],
    points: Float[np.ndarray, "n 3"],
    lengths: Float[np.ndarray, "n"],
    fidelity: float,
) -> Int[np.ndarray, "c"]:
    """Half-edges that begin at a free vertex, in order of cost over wanted length, the first share of them."""
    alive = np.nonzero((start >= 0) & free[start])[0]
    u, v = start[alive], start[_after(alive)]
    cost = np.linalg.norm(points[u] - points[v], axis=1)
    if fidelity > 0:
        cost += fidelity * _heights(start, points, u, v)
    return alive[np.argsort(cost / (lengths[u] + lengths[v]), kind="stable")[: int(CANDIDATES * len(alive)) + 1]]


def _heights(
    start: Int[np.ndarray, "h"], points: Float[np.ndarray, "n 3"], u: Int[np.ndarray, "k"], v: Int[np.ndarray, "k"]
) -> Float[np.ndarray, "k"]:
    """How far each vertex v lies off the planes of the faces around u, rms by area."""
    edge, planes = points[v] - points[u], _planes(start, points)[u]
    square = np.einsum("ei,eij,ej->e", edge, planes, edge) / np.maximum(np.trace(planes, axis1=1, axis2=2), TINY)
    return np.sqrt(np.maximum(square, 0.0))  # rounding may leave a flat place below zero


def _planes(start: Int[np.ndarray, "h"], points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """Sum over the faces at each vertex of area times normal times normal."""
    faces = start.reshape(-1, 3)
    corners = points[faces[faces[:, 0] >= 0]]
    vector = 0.5 * np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(vector, axis=1)
    outer = vector[:, :, None] * (vector / np.maximum(area, TINY)[:, None])[:, None, :]
    at = faces[faces[:, 0] >= 0].ravel()
    sums = [np.bincount(at, np.repeat(entry, 3), len(points)) for entry in outer.reshape(-1, 9).T]
    return np.stack(sums, axis=1).reshape(-1, 3, 3)


def _after(h: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
    return np.where(h % 3 == 2, h - 2, h + 1)


@njit(cache=True)
def _next(h: int) -> int:
    return h - 2 if h % 3 == 2 else h + 1


@njit(cache=True)
def _collapse(start: np.ndarray, twins: np.ndarray, points: np.ndarray, order: np.ndarray, limits: np.ndarray) -> int:
    """Collapse the half-edges of `order` towards their end where allowed; how many. limits: most, least shape."""
    locked = np.zeros(len(points), np.bool_)
    mark = np.full(len(points), -1, np.int64)
    done = 0
    for h in order:
        if done >= limits[0]:
            break
        u, v = start[h], start[_next(h)]
        if u < 0 or locked[u] or locked[v] or not _may_collapse(h, start, twins, mark):
            continue
        if not _stays_fair(h, start, twins, points, limits[1]):
            continue
        e = h
        while True:
            start[e] = v
            locked[start[_next(e)]] = True
            e = twins[_next(_next(e))]
            if e == h:
                break
        for side in (h, twins[h]):
            a, b = twins[_next(side)], twins[_next(_next(side))]
            twins[a], twins[b] = b, a
            start[3 * (side // 3) : 3 * (side // 3) + 3] = -1
        done += 1
    return done


@njit(cache=True)
def _may_collapse(h: int, start: np.ndarray, twins: np.ndarray, mark: np.ndarray) -> bool:
    """The link condition: the ends share exactly two neighbours, and no vertex keeps fewer than three or too many."""
    g = twins[h]
    for e in (_next(_next(h)), _next(_next(g))):
        if _valence(e, twins) <= 3:
            return False
    if _valence(h, twins) + _valence(g, twins) - 4 > MOST_NEIGHBOURS:
        return False
    e = h
    while True:
        mark[start[_next(e)]] = h
        e = twins[_next(_next(e))]
        if e == h:
            break
    common, e = 0, g
    while True:
        common += mark[start[_next(e)]] == h
        e = twins[_next(_next(e))]
        if e == g:
            break
    return common == 2


@njit(cache=True)
def _valence(h: int, twins: np.ndarray) -> int:
    """Number of neighbours of the vertex at which half-edge h begins."""
    count, e = 1, twins[_next(_next(h))]
    while e != h:
        count += 1
        e = twins[_next(_next(e))]
    return count


@njit(cache=True)
def _stays_fair(h: int, start: np.ndarray, twins: np.ndarray, points: np.ndarray, floor: float) -> bool:
    """Whether the faces that a collapse drags along keep their direction and a fair shape."""
    u, v = points[start[h]], points[start[_next(h)]]
    e, last = twins[_next(_next(h))], _next(twins[h])
    while e != last:
        p, q = points[start[_next(e)]], points[start[_next(_next(e))]]
        if not _keeps(u, v, p, q, floor):
            return False
        e = twins[_next(_next(e))]
    return True


@njit(cache=True)
def _keeps(u: np.ndarray, v: np.ndarray, p: np.ndarray, q: np.ndarray, floor: float) -> bool:
    """Whether face (v, p, q) looks where (u, p, q) looked and is fair: 2 sqrt(3) |n| / (sum of squared edges)."""
    old, new = _normal(u, p, q), _normal(v, p, q)
    size = np.sqrt(np.dot(new, new))
    squares = np.dot(p - v, p - v) + np.dot(q - v, q - v) + np.dot(q - p, q - p)
    return np.dot(old, new) > TURN * size * np.sqrt(np.dot(old, old)) and 2.0 * np.sqrt(3.0) * size > floor * squares


@njit(cache=True)
def _normal(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Twice the area vector of a triangle."""
    return np.cross(b - a, c - a)


@njit(cache=True)
def _flip(start: np.ndarray, twins: np.ndarray, points: np.ndarray, turn: float) -> int:
    """One sweep of Delaunay flips; how many."""
    done = 0
    for h in range(len(start)):
        g = twins[h]
        if h < g and _should_flip(h, start, twins, points, turn):
            h1, h2, g1, g2 = _next(h), _next(_next(h)), _next(g), _next(_next(g))
            c, d = start[h2], start[g2]
            outer_h, outer_g = twins[h1], twins[g1]  # v -> c and u -> d change face
            start[h1], start[g1] = d, c  # faces become (u, d, c) and (v, c, d)
            twins[h], twins[outer_g] = outer_g, h
            twins[g], twins[outer_h] = outer_h, g
            twins[h1], twins[g1] = g1, h1
            done += 1
    return done


@njit(cache=True)
def _should_flip(h: int, start: np.ndarray, twins: np.ndarray, points: np.ndarray, turn: float) -> bool:
    """Whether the opposite angles exceed pi and the new edge is free, folds nothing and leaves enough neighbours."""
    g = twins[h]
    u, v, c, d = start[h], start[g], start[_next(_next(h))], start[_next(_next(g))]
    if _cotangent(points[c], points[u], points[v]) + _cotangent(points[d], points[v], points[u]) > -ROUNDING:
        return False
    if _valence(h, twins) <= 3 or _valence(g, twins) <= 3:
        return False
    old = _normal(points[u], points[v], points[c]) + _normal(points[v], points[u], points[d])
    for new in (_normal(points[u], points[d], points[c]), _normal(points[v], points[c], points[d])):
        if np.dot(new, old) <= turn * np.sqrt(np.dot(new, new) * np.dot(old, old)):
            return False
    e = _next(_next(h))
    while start[_next(e)] != d:
        e = twins[_next(_next(e))]
        if e == _next(_next(h)):
            return True
    return False


@njit(cache=True)
def _cotangent(apex: np.ndarray, a: np.ndarray, b: np.ndarray) -> float:
    """Cotangent of the angle at the apex; minus infinity stands for a flat face."""
    ax, ay, az = a[0] - apex[0], a[1] - apex[1], a[2] - apex[2]  # scalars: no array is made in the inner loop
    bx, by, bz = b[0] - apex[0], b[1] - apex[1], b[2] - apex[2]
    size = np.sqrt((ay * bz - az * by) ** 2 + (az * bx - ax * bz) ** 2 + (ax * by - ay * bx) ** 2)
    return (ax * bx + ay * by + az * bz) / size if size > 0.0 else -np.inf
