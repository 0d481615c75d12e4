"""The order in which vertices of a sequence are told: coarse to fine, each by the ring of those around it.

Half-edge collapses u -> w on the decoded integers of the rest mesh, cheapest first, until none is legal; reversed, each
record names a vertex and the ring it lies in, all of which are there before it. Writer and reader both build it, so a single
swap would spoil all that follows: it is done in 64-bit integers alone, with ties broken by index, and its checksum is in the
file. Boundary vertices collapse along the boundary; a vertex whose faces form no single fan never does. What is left, one part
of a surface or twenty, are the roots.
"""

import zlib
from dataclasses import dataclass
from heapq import heapify, heappop, heappush

import numpy as np
from jaxtyping import Int

from morphlet.codec.connectivity import pred, succ
from morphlet.numerics.compiled import inner_kernel, kernel

COORDINATE_BITS = 10
"""Positions are halved until they are below 2^10: finer ones cost sizes and gain nothing, and every product stays within 64 bits."""
VALENCE_CAP = 24
"""No collapse makes a vertex of higher valence, none removes one."""
EDGE_WEIGHT = 32
"""Of squared edge length against the volume that a collapse sweeps: few flat vertices are worth a long edge."""
CROWD, CROWD_SCALE = 14, 50
"""Valences of both ends beyond 14 make an edge dearer: by (excess squared) / 50."""
FEWEST = 3
"""Valence below which no vertex falls."""
NEVER = np.int64(1) << 62


@dataclass(frozen=True, eq=False)
class Records:
    """What was removed when, and the ring it left; `roots` stayed.

    Ring i is `rings[offsets[i]:offsets[i + 1]]`, counter-clockwise; a closed one starts at the vertex that took the removed
    one's place, an open one (`closed[i]` is 0) runs from boundary to boundary.
    """

    removed: Int[np.ndarray, "r"]
    offsets: Int[np.ndarray, "r1"]
    rings: Int[np.ndarray, "s"]
    closed: Int[np.ndarray, "r"]
    roots: Int[np.ndarray, "k"]

    @property
    def checksum(self) -> int:
        """CRC-32 of removed vertices, offsets, rings, closedness and roots as little-endian 32-bit integers."""
        value = 0
        for part in (self.removed, self.offsets, self.rings, self.closed, self.roots):
            value = zlib.crc32(part.astype("<u4").tobytes(), value)
        return value


def coarse_to_fine(corner: Int[np.ndarray, "h"], twin: Int[np.ndarray, "h"], lattice: Int[np.ndarray, "n 3"]) -> Records:
    """The records of a mesh given by its corners, their twins and its integer positions."""
    n = len(lattice)
    bits = max(int(np.ptp(lattice, axis=0).max(initial=0)).bit_length() - COORDINATE_BITS, 0)
    small = np.ascontiguousarray((lattice - lattice.min(axis=0)) >> bits) if n else lattice
    removed, offsets, rings, closed, alive = _collapse_all(corner.copy(), twin.copy(), small)
    return Records(removed, offsets, rings, closed, np.nonzero(alive)[0])


@inner_kernel
def _rim(u, corner, twin, start, inside):  # first half-edge out of u, counter-clockwise; kept in start
    h = start[u]
    if inside[u]:
        return h
    while True:
        t = twin[h]
        if t < 0:
            break
        h = succ(t)
        if h == start[u]:
            break
    start[u] = h
    return h


@inner_kernel
def _ring(u, corner, twin, start, inside, out):  # out: neighbours of u, counter-clockwise, at most its length; (how many, whether closed)
    first = _rim(u, corner, twin, start, inside)
    h, k = first, 0
    while k < out.shape[0]:
        out[k] = corner[succ(h)]
        k += 1
        e = pred(h)
        h = twin[e]
        if h == first:
            return k, True
        if h < 0:
            if k < out.shape[0]:
                out[k] = corner[e]
            return k + 1, False
    return k, True


@inner_kernel
def _marked(w, corner, twin, start, inside, mark, stamp):  # how many neighbours of w carry the stamp
    first = _rim(w, corner, twin, start, inside)
    h, count = first, 0
    while True:
        count += 1 if mark[corner[succ(h)]] == stamp else 0
        e = pred(h)
        h = twin[e]
        if h < 0:
            return count + (1 if mark[corner[e]] == stamp else 0)
        if h == first:
            return count


@inner_kernel
def _swept(u, w, ring, k, closed, X):  # six times the volume between the faces at u and where they go
    ex, ey, ez = X[w, 0] - X[u, 0], X[w, 1] - X[u, 1], X[w, 2] - X[u, 2]
    volume = np.int64(0)
    for j in range(k if closed else k - 1):
        p, q = ring[j], ring[j + 1 if j + 1 < k else 0]
        px, py, pz = X[p, 0] - X[u, 0], X[p, 1] - X[u, 1], X[p, 2] - X[u, 2]
        qx, qy, qz = X[q, 0] - X[u, 0], X[q, 1] - X[u, 1], X[q, 2] - X[u, 2]
        volume += abs((py * qz - pz * qy) * ex + (pz * qx - px * qz) * ey + (px * qy - py * qx) * ez)
    return volume


@inner_kernel
def _best(u, corner, twin, start, inside, X, fan, valence, ring, mark, stamp):  # (cost, w) of the cheapest legal collapse of u; w -1: none
    best, target = NEVER, np.int64(-1)
    if not fan[u] or valence[u] > VALENCE_CAP:
        return best, target
    k, closed = _ring(u, corner, twin, start, inside, ring)
    stamp[0] += 1
    for i in range(k):
        if mark[ring[i]] == stamp[0]:
            return best, target
        mark[ring[i]] = stamp[0]
    lost = 2 if closed else 1
    for i in range(k):
        w = ring[i]
        if not fan[w] or not (closed or i == 0 or i == k - 1):
            continue
        a = ring[i + 1 if i + 1 < k else 0] if closed or i == 0 else ring[i - 1]
        b = ring[i - 1 if i > 0 else k - 1] if closed else a
        after = k + valence[w] - 2 - lost
        if after > VALENCE_CAP or after < FEWEST - (0 if closed else 1) or valence[a] <= FEWEST or valence[b] <= FEWEST:
            continue
        length, crowd = np.int64(0), max(k + valence[w] - CROWD, 0)
        for j in range(3):
            length += (X[w, j] - X[u, j]) * (X[w, j] - X[u, j])
        cost = EDGE_WEIGHT * length * (CROWD_SCALE + crowd * crowd) // CROWD_SCALE * (3 - lost)
        if cost > best:  # as it stands: the volume only adds to it
            continue
        cost += _swept(u, w, ring, k, closed, X) * (3 - lost)
        better = cost < best or (cost == best and w < target)
        if better and _marked(w, corner, twin, start, inside, mark, stamp[0]) == lost:
            best, target = cost, w
    return best, target


@inner_kernel
def _drop_face(x, w, corner, twin, start, valence):  # the face of half-edge x between u and w goes
    p, q = succ(x), pred(x)
    tp, tq, opposite = twin[p], twin[q], corner[q]
    if tp >= 0:
        twin[tp] = tq
    if tq >= 0:
        twin[tq] = tp
    valence[opposite] -= 1
    start[opposite] = tp if tp >= 0 else succ(tq)
    start[w] = tq if tq >= 0 else succ(tp)


@inner_kernel
def _remove(u, w, corner, twin, start, inside, valence):  # u becomes w
    first = _rim(u, corner, twin, start, inside)
    h, out, back = first, np.int64(-1), np.int64(-1)
    while True:
        e = pred(h)
        out = h if corner[succ(h)] == w else out
        back = e if corner[e] == w else back
        corner[h] = w
        h = twin[e]
        if h < 0 or h == first:
            break
    if out >= 0:
        _drop_face(out, w, corner, twin, start, valence)
    if back >= 0:
        _drop_face(back, w, corner, twin, start, valence)


@inner_kernel
def _fans(corner, twin, start, inside, fan, valence):  # neighbours of each vertex, and whether its faces form a single fan
    n = start.shape[0]
    corners, ring = np.zeros(n, np.int64), np.empty(corner.shape[0] + 1, np.int64)
    for h in range(corner.shape[0]):
        start[corner[h]] = h
        corners[corner[h]] += 1
    for v in range(n):
        if start[v] >= 0:
            k, closed = _ring(v, corner, twin, start, inside, ring)
            valence[v], fan[v], inside[v] = k, k == corners[v] + (0 if closed else 1), closed


@kernel
def _collapse_all(corner, twin, X):  # corner, twin (h,) are used up
    n = X.shape[0]
    start, valence, fan = np.full(n, -1, np.int64), np.zeros(n, np.int64), np.zeros(n, np.bool_)
    inside = np.zeros(n, np.bool_)
    _fans(corner, twin, start, inside, fan, valence)
    mark, stamp = np.zeros(n, np.int64), np.zeros(1, np.int64)
    ring, around = np.empty(VALENCE_CAP + 2, np.int64), np.empty(VALENCE_CAP + 2, np.int64)
    version, alive = np.zeros(n, np.int64), np.ones(n, np.bool_)
    removed, closedness, offsets = np.empty(n, np.int64), np.empty(n, np.int64), np.zeros(n + 1, np.int64)
    rings = np.empty(8 * n + VALENCE_CAP + 2, np.int64)
    heap = [(np.int64(0), np.int64(0), np.int64(0), np.int64(0))]
    heap.pop()
    for v in range(n):
        cost, w = _best(np.int64(v), corner, twin, start, inside, X, fan, valence, ring, mark, stamp)
        if w >= 0:
            heap.append((cost, np.int64(v), w, np.int64(0)))
    heapify(heap)
    count = used = np.int64(0)
    while len(heap) > 0:
        cost, u, w, seen = heappop(heap)
        if not alive[u] or seen != version[u]:
            continue
        now, target = _best(u, corner, twin, start, inside, X, fan, valence, ring, mark, stamp)
        if target < 0:
            continue
        if now > cost or (now == cost and target > w):
            version[u] += 1
            heappush(heap, (now, u, target, version[u]))
            continue
        k, closed = _ring(u, corner, twin, start, inside, ring)
        if used + k > rings.shape[0]:
            longer = np.empty(2 * rings.shape[0], np.int64)
            for j in range(used):
                longer[j] = rings[j]
            rings = longer
        turn = 0
        while closed and ring[turn] != target:
            turn += 1
        for j in range(k):
            rings[used + j] = ring[(turn + j) % k]
        used += k
        removed[count], closedness[count], alive[u] = u, 1 if closed else 0, False
        count += 1
        offsets[count] = used
        _remove(u, target, corner, twin, start, inside, valence)
        valence[target] += k - (4 if closed else 3)
        k, closed = _ring(target, corner, twin, start, inside, around)
        for j in range(k + 1):
            v = target if j == k else around[j]
            version[v] += 1
            cost, w = _best(v, corner, twin, start, inside, X, fan, valence, ring, mark, stamp)
            if w >= 0:
                heappush(heap, (cost, v, w, version[v]))
    return removed[:count].copy(), offsets[: count + 1].copy(), rings[:used].copy(), closedness[:count].copy(), alive
