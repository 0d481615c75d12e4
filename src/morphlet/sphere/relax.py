"""One vertex at a time: Newton on the ring energy, and coloured sweeps of it.

Around a vertex x the energy of its ring is sum_j w_j n_j (1 + D_j^-2) with D_j = x . N_j LINEAR in x, where
N_j = (b_j x c_j) / (2 A_j); it is infinite only where some D_j <= 0, that is outside the kernel of the ring.
"""

from itertools import pairwise

import numpy as np
from jaxtyping import Int

from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel
from morphlet.numerics.threads import each
from morphlet.sphere.energy import distance2, tangents, triangle_reference
from morphlet.surface.hierarchy import following, preceding

ONE_STEP, INSERTION_STEPS = np.int64(1), np.int64(3)  # Python integers are types of their own to numba
"""Newton steps of a vertex in a sweep, and of one that was just put back."""
ARMIJO = 1e-4
"""Share of the linear decrease that an accepted step must reach."""
LUNE = np.int64(4)
"""Corners of the polygon that a lune is kept as."""
LONGEST_MOVE = 0.5
"""Radians a vertex may move in one step."""
CUTS = 12
"""Times a step is cut to 0.4 before it is given up."""
SLICES = 8
"""Pieces a colour class is cut into for the threads."""
SMALL_CLASS = 512
"""Colour classes below this size are swept by one thread: waking the others costs more."""


@kernel
def ring_buffer(size):  # one row per ring triangle (x, b, c): b (3), c (3), N (3), k_b, k_c, constant part of n, weight
    return np.empty((size, 13))


@kernel
def set_sector(R, j, S, b, c, kb, kc, ka, inverse, weight):
    bx, by, bz, cx, cy, cz = S[b, 0], S[b, 1], S[b, 2], S[c, 0], S[c, 1], S[c, 2]
    ex, ey, ez = cx - bx, cy - by, cz - bz
    R[j, 0], R[j, 1], R[j, 2], R[j, 3], R[j, 4], R[j, 5] = bx, by, bz, cx, cy, cz
    R[j, 6], R[j, 7], R[j, 8] = (by * ez - bz * ey) * inverse, (bz * ex - bx * ez) * inverse, (bx * ey - by * ex) * inverse
    R[j, 9], R[j, 10], R[j, 11], R[j, 12] = kb, kc, ka * (ex * ex + ey * ey + ez * ez), weight


@kernel
def ring_energy(x, y, z, m, R):  # inf if some D <= 0
    E = 0.0
    for j in range(m):
        D = x * R[j, 6] + y * R[j, 7] + z * R[j, 8]
        if D <= 0.0:
            return np.inf
        n = R[j, 11] + R[j, 9] * ((x - R[j, 0]) ** 2 + (y - R[j, 1]) ** 2 + (z - R[j, 2]) ** 2)
        n += R[j, 10] * ((x - R[j, 3]) ** 2 + (y - R[j, 4]) ** 2 + (z - R[j, 5]) ** 2)
        E += R[j, 12] * n * (1 + 1 / (D * D))
    return E


@inlined_kernel
def downhill(g1, g2, h11, h12, h22):  # Newton step in two unknowns, its matrix shifted until it is positive definite
    mean, spread = 0.5 * (h11 + h22), np.sqrt(0.25 * (h11 - h22) ** 2 + h12 * h12)
    low, high = mean - spread, mean + spread
    high = high if high > 0 else 1.0
    shift = max(1e-3 * high - low, -2 * low if low < 0 else 0.0) if low < 1e-3 * high else 0.0
    h11 += shift
    h22 += shift
    det = h11 * h22 - h12 * h12
    s1, s2 = -(h22 * g1 - h12 * g2) / det, -(h11 * g2 - h12 * g1) / det
    return s1, s2


@inlined_kernel
def longest_inside(x, y, z, dx, dy, dz, m, R):  # how much of a step stays strictly inside the ring, where every D > 0
    alpha = min(1.0, LONGEST_MOVE / np.sqrt(dx * dx + dy * dy + dz * dz))
    for j in range(m):  # D is linear along the step
        rate = dx * R[j, 6] + dy * R[j, 7] + dz * R[j, 8]
        if rate < 0:
            alpha = min(alpha, -0.9 * (x * R[j, 6] + y * R[j, 7] + z * R[j, 8]) / rate)
    return alpha


@inner_kernel
def _ring_newton(x, y, z, m, R):  # step in the tangent plane (3 numbers) and its slope g . s
    ax, ay, az, bx, by, bz = tangents(x, y, z)
    g1 = g2 = h11 = h12 = h22 = bend = 0.0
    for j in range(m):
        nx, ny, nz, kb, kc, w = R[j, 6], R[j, 7], R[j, 8], R[j, 9], R[j, 10], R[j, 12]
        r = 1 / (x * nx + y * ny + z * nz)
        ux, uy, uz, vx, vy, vz = x - R[j, 0], y - R[j, 1], z - R[j, 2], x - R[j, 3], y - R[j, 4], z - R[j, 5]
        n = kb * (ux * ux + uy * uy + uz * uz) + kc * (vx * vx + vy * vy + vz * vz) + R[j, 11]
        gx, gy, gz = 2 * (kb * ux + kc * vx), 2 * (kb * uy + kc * vy), 2 * (kb * uz + kc * vz)
        cn, cd, cnd, cdd = w * (1 + r * r), -2 * w * n * r * r * r, -2 * w * r * r * r, 6 * w * n * r * r * r * r
        bend += x * (cn * gx + cd * nx) + y * (cn * gy + cd * ny) + z * (cn * gz + cd * nz)
        n1, n2 = gx * ax + gy * ay + gz * az, gx * bx + gy * by + gz * bz
        d1, d2 = nx * ax + ny * ay + nz * az, nx * bx + ny * by + nz * bz
        g1 += cn * n1 + cd * d1
        g2 += cn * n2 + cd * d2
        h11 += 2 * cn * (kb + kc) + 2 * cnd * n1 * d1 + cdd * d1 * d1
        h22 += 2 * cn * (kb + kc) + 2 * cnd * n2 * d2 + cdd * d2 * d2
        h12 += cnd * (n1 * d2 + n2 * d1) + cdd * d1 * d2
    s1, s2 = downhill(g1, g2, h11 - bend, h12, h22 - bend)
    return s1 * ax + s2 * bx, s1 * ay + s2 * by, s1 * az + s2 * bz, g1 * s1 + g2 * s2


@kernel
def relax_vertex(x, y, z, m, R, steps):  # damped Newton from (x, y, z), whose ring energy must be finite
    E = ring_energy(x, y, z, m, R)
    for _ in range(steps):
        dx, dy, dz, slope = _ring_newton(x, y, z, m, R)
        if not (slope < 0) or -slope < 1e-12 * E:
            break
        alpha = longest_inside(x, y, z, dx, dy, dz, m, R)
        accepted = False
        for _ in range(CUTS):
            px, py, pz = x + alpha * dx, y + alpha * dy, z + alpha * dz
            s = 1 / np.sqrt(px * px + py * py + pz * pz)
            trial = ring_energy(px * s, py * s, pz * s, m, R)
            if trial <= E + ARMIJO * alpha * slope:
                accepted = True
                break
            alpha *= 0.4
        if not accepted:
            break
        x, y, z, E = px * s, py * s, pz * s, trial
    return x, y, z


@kernel
def relax_range(vertices, first, last, S, corner, twin, start, ref, weight, size):  # one Newton step per vertex, in place
    R = ring_buffer(size)
    for i in range(first, last):
        u = vertices[i]
        h = start[u]
        for m in range(size):
            t, c = h // 3, h % 3
            kb, kc = ref.k[t, (c + 2) % 3], ref.k[t, (c + 1) % 3]
            set_sector(R, m, S, corner[following(h)], corner[preceding(h)], kb, kc, ref.k[t, c], ref.inverse[t], weight[t])
            h = twin[preceding(h)]
            if h == start[u]:
                break
        S[u, 0], S[u, 1], S[u, 2] = relax_vertex(S[u, 0], S[u, 1], S[u, 2], m + 1, R, ONE_STEP)


def relax_colours(order: Int[np.ndarray, "n"], offsets: Int[np.ndarray, "c"], *arguments: object) -> None:
    """`relax_range` of every vertex, colour by colour: vertices of one colour are independent."""
    for first, last in pairwise(offsets.tolist()):
        slices = SLICES if last - first >= SMALL_CLASS else 1
        cuts = [first + (last - first) * s // slices for s in range(slices + 1)]
        each(lambda s, cuts=cuts: relax_range(order, cuts[s], cuts[s + 1], *arguments), slices)  # type: ignore[misc]


@kernel
def colour_order(corner, twin, start, size):  # greedy colouring: vertices sorted by colour, and where each colour starts
    n = start.shape[0]
    colour, used, most = np.full(n, -1, np.int64), np.full(size + 1, -1, np.int64), 0
    for u in range(n):
        h = start[u]
        while True:
            c = colour[corner[following(h)]]
            if c >= 0:
                used[c] = u
            h = twin[preceding(h)]
            if h == start[u]:
                break
        c = 0
        while used[c] == u:
            c += 1
        colour[u] = c
        most = max(most, c + 1)
    offsets = np.zeros(most + 1, np.int64)
    for u in range(n):
        offsets[colour[u] + 1] += 1
    for c in range(most):
        offsets[c + 1] += offsets[c]
    order, place = np.empty(n, np.int64), offsets.copy()
    for u in range(n):
        order[place[colour[u]]] = u
        place[colour[u]] += 1
    return order, offsets


@inner_kernel
def _lune(
    k, R, x, y, z, P
):  # (x, y, z): first ring vertex v -> the lune of the first and last plane, apexes v and -v, into P; its corner count
    for e in range(2):
        first, other = (0, k - 1) if e == 0 else (k - 1, 0)
        nx, ny, nz = R[first, 6], R[first, 7], R[first, 8]
        mx, my, mz = y * nz - z * ny, z * nx - x * nz, x * ny - y * nx
        s = 1 / (np.sqrt(mx * mx + my * my + mz * mz) + 1e-300)
        if mx * R[other, 6] + my * R[other, 7] + mz * R[other, 8] < 0:
            s = -s
        P[2 * e + 1, 0], P[2 * e + 1, 1], P[2 * e + 1, 2] = mx * s, my * s, mz * s
    P[0, 0], P[0, 1], P[0, 2], P[2, 0], P[2, 1], P[2, 2] = x, y, z, -x, -y, -z
    return LUNE


@inner_kernel
def _clip(n, nx, ny, nz, P, Q):  # the part of the polygon P (n corners) where N . x >= 0, into Q; its corner count
    m = 0
    for a in range(n):
        b = a + 1 if a + 1 < n else 0
        sa = P[a, 0] * nx + P[a, 1] * ny + P[a, 2] * nz
        sb = P[b, 0] * nx + P[b, 1] * ny + P[b, 2] * nz
        if sa >= 0:
            Q[m, 0], Q[m, 1], Q[m, 2] = P[a, 0], P[a, 1], P[a, 2]
            m += 1
        if (sa > 0 and sb < 0) or (sa < 0 and sb > 0):
            ta, tb = abs(sb), abs(sa)
            x, y, z = P[a, 0] * ta + P[b, 0] * tb, P[a, 1] * ta + P[b, 1] * tb, P[a, 2] * ta + P[b, 2] * tb
            s = 1 / (np.sqrt(x * x + y * y + z * z) + 1e-300)
            Q[m, 0], Q[m, 1], Q[m, 2] = x * s, y * s, z * s
            m += 1
    return m


@inner_kernel
def kernel_point(k, R, x, y, z, P, Q):  # a point inside {p : p . N_j > 0}, ring from v = (x, y, z); its least p . N_j (<= 0: none)
    n = _lune(k, R, x, y, z, P)
    for j in range(1, k - 1):
        n = _clip(n, R[j, 6], R[j, 7], R[j, 8], P, Q)
        P, Q = Q, P
        if n < 3:
            return x, y, z, -1.0
    x = y = z = 0.0
    for a in range(n):
        x, y, z = x + P[a, 0], y + P[a, 1], z + P[a, 2]
    s = 1 / (np.sqrt(x * x + y * y + z * z) + 1e-300)
    x, y, z, margin = x * s, y * s, z * s, np.inf
    for j in range(k):
        margin = min(margin, x * R[j, 6] + y * R[j, 7] + z * R[j, 8])
    return x, y, z, margin


@kernel
def insert(high, low, records, V, S, F, scale2, floor2, size):  # undo records high-1 .. low; returns the one that failed, or -1
    removed, offsets, ring_vertices, ring_faces = records
    R, P, Q = ring_buffer(size), np.empty((2 * size + 8, 3)), np.empty((2 * size + 8, 3))
    for i in range(high - 1, low - 1, -1):
        u, first, k = removed[i], offsets[i], offsets[i + 1] - offsets[i]
        mx = my = mz = 0.0
        for j in range(k):
            b, c, row = ring_vertices[first + j], ring_vertices[first + (j + 1) % k], ring_faces[first + j]
            F[row, 0], F[row, 1], F[row, 2] = u, b, c
            lb, lc = distance2(V, u, b) * scale2, distance2(V, c, u) * scale2
            k0, k1, k2, area = triangle_reference(distance2(V, b, c) * scale2, lc, lb, floor2)
            set_sector(R, j, S, b, c, k2, k1, k0, 0.5 / area, area)
            pull = 1 / np.sqrt(lb + 1e-300)
            mx, my, mz = mx + pull * S[b, 0], my + pull * S[b, 1], mz + pull * S[b, 2]
        s = 1 / (np.sqrt(mx * mx + my * my + mz * mz) + 1e-300)
        v = ring_vertices[first]
        x, y, z, margin = kernel_point(k, R, S[v, 0], S[v, 1], S[v, 2], P, Q)
        if ring_energy(mx * s, my * s, mz * s, k, R) < (ring_energy(x, y, z, k, R) if margin > 0 else np.inf):
            x, y, z = mx * s, my * s, mz * s
        elif not margin > 0:
            return i
        if ring_energy(x, y, z, k, R) < np.inf:
            x, y, z = relax_vertex(x, y, z, k, R, INSERTION_STEPS)
        S[u, 0], S[u, 1], S[u, 2] = x, y, z
    return -1
