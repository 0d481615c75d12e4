"""Where a surface passes through itself: the pairs of triangles that cross.

Two triangles cross if they have more than a point in common without merely touching: each has corners strictly on both
sides of the other's plane and the two pieces of the common line overlap, or both lie in one plane and their interiors
overlap. Every sign is exact, so the answer does not depend on rounding; it holds for coordinates whose sixth powers
neither overflow nor underflow. A surface that runs exactly through an edge of another one touches there, and is not found.
"""

import numpy as np
from jaxtyping import Int

from morphlet import _arrays
from morphlet.numerics.compiled import njit
from morphlet.surface.mesh import Mesh

FILTER = 8e-16
"""Relative error bound of a 3 x 3 determinant of rounded differences: Shewchuk's (7 + 56 u) u with u = 2^-53 is 7.8e-16."""
FILTER_FLAT = 4e-16
"""The same for a 2 x 2 determinant: (3 + 16 u) u is 3.4e-16."""
SPLITTER = 134217729.0
"""2^27 + 1 cuts a double into two halves whose products are exact (Veltkamp)."""
MOST_TERMS = 192
"""Terms of a 3 x 3 determinant of exact differences: 6 products of 2^3 parts, four terms each."""
CELLS = 1024
"""Cells along each axis of the curve that orders the triangles: ten bits of each coordinate."""
DEEPEST = 64
"""Open nodes of a search: the tree has at most 63 levels."""


def self_intersections(mesh: Mesh, faces: Int[np.ndarray, "k"] | None = None) -> Int[np.ndarray, "p 2"]:
    """Pairs of triangles that cross and share no vertex.

    Parameters
    ----------
    mesh
        Any mesh, also open or non-manifold.
    faces
        Only pairs with at least one of these faces; all faces if left out.

    Returns
    -------
    pairs
        Numbers of the two faces, the smaller first, in lexicographic order.

    Raises
    ------
    InputError
        If a face does not exist.

    Notes
    -----
    A tree of boxes over the faces: O(m log m + pairs of boxes that meet). Triangles that share a vertex are neighbours and are
    looked at by `folds`. Triangles at the same place that only touch, such as on both sides of a seam of doubled vertices, do not cross.

    References
    ----------
    Guigue and Devillers, Fast and robust triangle-triangle overlap test using orientation predicates, Journal of Graphics
    Tools 8, 2003. Shewchuk, Adaptive precision floating-point arithmetic and fast robust geometric predicates, Discrete and
    Computational Geometry 18, 1997.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.intersections import self_intersections
    >>> upright = [[0.2, 0.2, -1], [0.2, 0.2, 1], [0.2, 2, 0]]
    >>> self_intersections(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], *upright], [[0, 1, 2], [3, 4, 5]])).tolist()
    [[0, 1]]
    """
    return _crossing(mesh, faces, 0)


def folds(mesh: Mesh, faces: Int[np.ndarray, "k"] | None = None) -> Int[np.ndarray, "p 2"]:
    """Pairs of neighbouring triangles that cross: the surface passes through itself next to their common vertex.

    Two triangles with one common vertex cross if they share more than that vertex; two with a common edge only if one is
    folded flat onto the other.

    Parameters
    ----------
    mesh, faces
        See `self_intersections`.

    Returns
    -------
    pairs
        As from `self_intersections`.

    Raises
    ------
    InputError
        If a face does not exist.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.intersections import folds
    >>> folds(Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [1, 1, -1], [1, 1, 3]], [[0, 1, 2], [0, 3, 4]])).tolist()
    [[0, 1]]
    """
    return np.concatenate([_crossing(mesh, faces, shared) for shared in (1, 2)]) if mesh.n_faces else np.empty((0, 2), np.int64)


def _crossing(mesh: Mesh, faces: Int[np.ndarray, "k"] | None, shared: int) -> Int[np.ndarray, "p 2"]:
    """Sorted pairs that cross among those with this number of common vertices."""
    asked = np.arange(mesh.n_faces) if faces is None else np.unique(_arrays.index(faces, "faces", (None,), mesh.n_faces))
    if not len(asked):
        return np.empty((0, 2), np.int64)
    wanted = np.zeros(mesh.n_faces, bool)
    wanted[asked] = True
    order = _along_curve(mesh)
    pairs = _pairs(np.array(mesh.vertices), mesh.faces[order], order, wanted, shared)
    pairs.sort(axis=1)
    return pairs[np.lexsort(pairs.T[::-1])]


def _along_curve(mesh: Mesh) -> Int[np.ndarray, "m"]:
    """The faces in an order in which neighbours in space are near: by the interleaved bits of their centres."""
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    low, size = centres.min(axis=0), float(np.ptp(centres, axis=0).max(initial=0.0))
    cells = np.minimum((centres - low) * (CELLS / size), CELLS - 1).astype(np.int64) if size > 0 else np.zeros(centres.shape, np.int64)
    code = np.zeros(len(centres), np.int64)
    for bit in range(CELLS.bit_length() - 1):
        for axis in range(3):
            code |= (cells[:, axis] >> bit & 1) << (3 * bit + axis)
    return np.argsort(code, kind="stable")


@njit(cache=True, error_model="numpy")
def _sum(a, b):  # a + b as two doubles, exactly
    s = a + b
    v = s - a
    return s, (a - (s - v)) + (b - v)


@njit(cache=True, error_model="numpy")
def _product(a, b):  # a b as two doubles, exactly
    p = a * b
    t = SPLITTER * a
    ah = t - (t - a)
    t = SPLITTER * b
    bh = t - (t - b)
    al, bl = a - ah, b - bh
    return p, al * bl - (((p - ah * bh) - al * bh) - ah * bl)


@njit(cache=True, error_model="numpy")
def _exact(Q):  # sign of det(a - d, b - d, c - d) of the rows a, b, c, d of Q (4, 3), whatever the cost
    D = np.empty((3, 3, 2))
    for row in range(3):
        for axis in range(3):
            D[row, axis, 0], D[row, axis, 1] = _sum(Q[row, axis], -Q[3, axis])
    E, n = np.empty(MOST_TERMS), 0  # a sum of doubles that do not overlap, the largest last
    part = np.empty(4)
    for way in range(6):
        i = way % 3
        j, k, sign = (i + 1) % 3, (i + 2) % 3, 1.0
        if way >= 3:
            j, k, sign = k, j, -1.0
        for bits in range(8):
            x, y, z = sign * D[0, i, bits & 1], D[1, j, bits >> 1 & 1], D[2, k, bits >> 2]
            if x == 0.0 or y == 0.0 or z == 0.0:
                continue
            high, low = _product(x, y)
            part[0], part[1] = _product(high, z)
            part[2], part[3] = _product(low, z)
            for t in range(4):
                rest, kept = part[t], 0
                for m in range(n):
                    rest, small = _sum(rest, E[m])
                    if small != 0.0:
                        E[kept] = small
                        kept += 1
                if rest != 0.0:
                    E[kept] = rest
                    kept += 1
                n = kept
    return 0 if n == 0 else (1 if E[n - 1] > 0.0 else -1)


@njit(cache=True, error_model="numpy")
def _side(P, a, b, c, d):  # exact sign of det(a - d, b - d, c - d): on which side of the plane of b, c, d point a is
    ax, ay, az = P[a, 0] - P[d, 0], P[a, 1] - P[d, 1], P[a, 2] - P[d, 2]
    bx, by, bz = P[b, 0] - P[d, 0], P[b, 1] - P[d, 1], P[b, 2] - P[d, 2]
    cx, cy, cz = P[c, 0] - P[d, 0], P[c, 1] - P[d, 1], P[c, 2] - P[d, 2]
    p, q, r, s, t, u = by * cz, bz * cy, bz * cx, bx * cz, bx * cy, by * cx
    total = ax * (p - q) + ay * (r - s) + az * (t - u)
    bound = FILTER * (abs(ax) * (abs(p) + abs(q)) + abs(ay) * (abs(r) + abs(s)) + abs(az) * (abs(t) + abs(u)))
    if total > bound or -total > bound:
        return 1 if total > 0.0 else -1
    if bound == 0.0:
        return 0
    Q = np.empty((4, 3))
    for axis in range(3):
        Q[0, axis], Q[1, axis], Q[2, axis], Q[3, axis] = P[a, axis], P[b, axis], P[c, axis], P[d, axis]
    return _exact(Q)


@njit(cache=True, error_model="numpy")
def _flat_side(P, a, b, c, u, v):  # exact sign of the area of a, b, c in the plane of the axes u and v
    p, q = (P[a, u] - P[c, u]) * (P[b, v] - P[c, v]), (P[a, v] - P[c, v]) * (P[b, u] - P[c, u])
    total, bound = p - q, FILTER_FLAT * (abs(p) + abs(q))
    if total > bound or -total > bound:
        return 1 if total > 0.0 else -1
    if bound == 0.0:
        return 0
    Q = np.zeros((4, 3))
    Q[0, 0], Q[1, 0], Q[2, 0], Q[3, 0] = P[a, u], P[b, u], P[c, u], P[c, u]
    Q[0, 1], Q[1, 1], Q[2, 1], Q[3, 1], Q[3, 2] = P[a, v], P[b, v], P[c, v], P[c, v], -1.0
    return _exact(Q)


@njit(cache=True, error_model="numpy")
def _overlap(P, a, b):  # whether two triangles (3,) of one plane have common inner points
    area = np.empty(3)  # as seen along each axis
    for k in range(3):
        i, j = (k + 1) % 3, (k + 2) % 3
        x, y = P[a[1], i] - P[a[0], i], P[a[1], j] - P[a[0], j]
        area[k] = abs(x * (P[a[2], j] - P[a[0], j]) - y * (P[a[2], i] - P[a[0], i]))
    axis = np.argmax(area)
    u, v = (axis + 1) % 3, (axis + 2) % 3
    for turn in range(2):  # apart if some edge of one has the other on its outer side
        s, t = (a, b) if turn == 0 else (b, a)
        inner = _flat_side(P, s[0], s[1], s[2], u, v)
        if inner == 0:
            return False
        for k in range(3):
            i, j = s[k], s[(k + 1) % 3]
            outside = True
            for m in range(3):
                if _flat_side(P, i, j, t[m], u, v) == inner:
                    outside = False
            if outside:
                return False
    return True


@njit(inline="always", error_model="numpy")
def _alone(s0, s1, s2):  # corner that is alone on its side, and that side, of three exact signs on both sides
    if s0 > 0:
        return (0, 1) if s1 <= 0 and s2 <= 0 else ((1, -1) if s1 < 0 else (2, -1))
    if s1 > 0:
        return (1, 1) if s2 <= 0 else (0, -1)
    return 2, 1


@njit(cache=True, error_model="numpy")
def crosses(P, a, b):
    # Whether the triangles a, b (3,) of points P (n, 3) cross (Guigue and Devillers, with zeros of the signs told apart).
    s0, s1, s2 = _side(P, a[0], b[0], b[1], b[2]), _side(P, a[1], b[0], b[1], b[2]), _side(P, a[2], b[0], b[1], b[2])
    if s0 == 0 and s1 == 0 and s2 == 0:
        return _overlap(P, a, b)
    if not (min(s0, s1, s2) < 0 < max(s0, s1, s2)):
        return False
    t0, t1, t2 = _side(P, b[0], a[0], a[1], a[2]), _side(P, b[1], a[0], a[1], a[2]), _side(P, b[2], a[0], a[1], a[2])
    if not (min(t0, t1, t2) < 0 < max(t0, t1, t2)):
        return False
    i, up = _alone(s0, s1, s2)
    j, over = _alone(t0, t1, t2)
    p, q, r = a[i], a[(i + 1) % 3], a[(i + 2) % 3]
    k, m, n = b[j], b[(j + 1) % 3], b[(j + 2) % 3]
    if up < 0:
        m, n = n, m
    if over < 0:
        q, r = r, q
    return _side(P, p, q, k, m) > 0 and _side(P, p, r, n, k) > 0


@njit(cache=True, error_model="numpy")
def _boxes(P, faces, first):  # boxes of a balanced tree: node i has the children 2 i, 2 i + 1; leaf i is node first + i
    low, high = np.empty((2 * first, 3)), np.empty((2 * first, 3))
    low[:], high[:] = np.inf, -np.inf
    for f in range(len(faces)):
        for axis in range(3):
            x, y, z = P[faces[f, 0], axis], P[faces[f, 1], axis], P[faces[f, 2], axis]
            low[first + f, axis], high[first + f, axis] = min(x, y, z), max(x, y, z)
    for node in range(first - 1, 0, -1):
        for axis in range(3):
            low[node, axis] = min(low[2 * node, axis], low[2 * node + 1, axis])
            high[node, axis] = max(high[2 * node, axis], high[2 * node + 1, axis])
    return low, high


@njit(inline="always", error_model="numpy")
def _meet(low, high, i, j):  # whether the boxes of two nodes have a common point
    x = low[i, 0] <= high[j, 0] and low[j, 0] <= high[i, 0]
    y = low[i, 1] <= high[j, 1] and low[j, 1] <= high[i, 1]
    return x and y and low[i, 2] <= high[j, 2] and low[j, 2] <= high[i, 2]


@njit(cache=True, error_model="numpy")
def _pairs(P, faces, number, wanted, shared):
    # Pairs (p, 2) of numbers of faces (m, 3) that cross and have `shared` common corners, one of the two wanted (m,).
    m, first = len(faces), 1
    while first < m:
        first *= 2
    low, high = _boxes(P, faces, first)
    pairs, count = np.empty((64, 2), np.int64), 0
    stack = np.empty(DEEPEST, np.int64)
    for f in range(m):
        if not wanted[number[f]]:
            continue
        stack[0], top = 1, 1
        while top > 0:
            top -= 1
            node = stack[top]
            if not _meet(low, high, node, first + f):
                continue
            if node < first:
                stack[top], stack[top + 1] = 2 * node, 2 * node + 1
                top += 2
                continue
            g = node - first
            if g == f or (g < f and wanted[number[g]]):
                continue
            common = 0
            for i in range(3):
                for j in range(3):
                    common += faces[f, i] == faces[g, j]
            if common == shared and crosses(P, faces[f], faces[g]):
                if count == len(pairs):
                    pairs = np.concatenate((pairs, np.empty_like(pairs)))
                pairs[count, 0], pairs[count, 1] = number[f], number[g]
                count += 1
    return pairs[:count]
