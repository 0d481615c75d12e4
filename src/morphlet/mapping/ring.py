"""One vertex at a time on a target's sphere: put into its ring, and relaxed there.

As in `sphere.relax`, with lengths in the target's metric M, which is taken at one place and held while the vertex moves: the energy of
the ring of x is sum_j w_j n_j (1 + D_j^-2) with D_j = x . N_j linear in x and n_j a quadratic form in M.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Int

from morphlet.mapping.metric import Ground, form, metric_under, product
from morphlet.numerics.compiled import inner_kernel, kernel
from morphlet.sphere.energy import distance2, tangents, triangle_reference
from morphlet.sphere.relax import ARMIJO, CUTS, INSERTION_STEPS, ONE_STEP, downhill, kernel_point, longest_inside, ring_buffer, set_sector
from morphlet.surface.hierarchy import following, preceding


@inner_kernel
def _energy(x, y, z, m, R, M):  # of the ring; inf if some D <= 0
    E = 0.0
    for j in range(m):
        D = x * R[j, 6] + y * R[j, 7] + z * R[j, 8]
        if D <= 0.0:
            return np.inf
        n = R[j, 11] + R[j, 9] * form(M, x - R[j, 0], y - R[j, 1], z - R[j, 2])
        n += R[j, 10] * form(M, x - R[j, 3], y - R[j, 4], z - R[j, 5])
        E += R[j, 12] * n * (1 + 1 / (D * D))
    return E


@inner_kernel
def _newton(x, y, z, m, R, M):  # step in the tangent plane (3 numbers) and its slope g . s
    ax, ay, az, bx, by, bz = tangents(x, y, z)
    px, py, pz = product(M, ax, ay, az)
    qx, qy, qz = product(M, bx, by, bz)
    m11, m12, m22 = ax * px + ay * py + az * pz, ax * qx + ay * qy + az * qz, bx * qx + by * qy + bz * qz
    g1 = g2 = h11 = h12 = h22 = bend = 0.0
    for j in range(m):
        nx, ny, nz, kb, kc, w = R[j, 6], R[j, 7], R[j, 8], R[j, 9], R[j, 10], R[j, 12]
        r = 1 / (x * nx + y * ny + z * nz)
        ux, uy, uz, vx, vy, vz = x - R[j, 0], y - R[j, 1], z - R[j, 2], x - R[j, 3], y - R[j, 4], z - R[j, 5]
        n = kb * form(M, ux, uy, uz) + kc * form(M, vx, vy, vz) + R[j, 11]
        gx, gy, gz = product(M, 2 * (kb * ux + kc * vx), 2 * (kb * uy + kc * vy), 2 * (kb * uz + kc * vz))
        cn, cd, cnd, cdd = w * (1 + r * r), -2 * w * n * r * r * r, -2 * w * r * r * r, 6 * w * n * r * r * r * r
        bend += x * (cn * gx + cd * nx) + y * (cn * gy + cd * ny) + z * (cn * gz + cd * nz)
        n1, n2 = gx * ax + gy * ay + gz * az, gx * bx + gy * by + gz * bz
        d1, d2 = nx * ax + ny * ay + nz * az, nx * bx + ny * by + nz * bz
        g1 += cn * n1 + cd * d1
        g2 += cn * n2 + cd * d2
        h11 += 2 * cn * (kb + kc) * m11 + 2 * cnd * n1 * d1 + cdd * d1 * d1
        h22 += 2 * cn * (kb + kc) * m22 + 2 * cnd * n2 * d2 + cdd * d2 * d2
        h12 += 2 * cn * (kb + kc) * m12 + cnd * (n1 * d2 + n2 * d1) + cdd * d1 * d2
    s1, s2 = downhill(g1, g2, h11 - bend, h12, h22 - bend)
    return s1 * ax + s2 * bx, s1 * ay + s2 * by, s1 * az + s2 * bz, g1 * s1 + g2 * s2


@inner_kernel
def _relax(at, m, R, M, steps):  # damped Newton from a point whose ring energy must be finite
    x, y, z = at
    E = _energy(x, y, z, m, R, M)
    for _ in range(steps):
        dx, dy, dz, slope = _newton(x, y, z, m, R, M)
        if not (slope < 0) or -slope < 1e-12 * E:
            break
        alpha = longest_inside(x, y, z, dx, dy, dz, m, R)
        accepted = False
        for _ in range(CUTS):
            px, py, pz = x + alpha * dx, y + alpha * dy, z + alpha * dz
            s = 1 / np.sqrt(px * px + py * py + pz * pz)
            trial = _energy(px * s, py * s, pz * s, m, R, M)
            if trial <= E + ARMIJO * alpha * slope:
                accepted = True
                break
            alpha *= 0.4
        if not accepted:
            break
        x, y, z, E = px * s, py * s, pz * s, trial
    return x, y, z


@inner_kernel
def _measure(m, R, ka, M, root):  # finish the sectors for a metric: N gets its area factor, the edge opposite x its length
    for j in range(m):
        R[j, 6], R[j, 7], R[j, 8] = R[j, 6] * root, R[j, 7] * root, R[j, 8] * root
        R[j, 11] = ka[j] * form(M, R[j, 3] - R[j, 0], R[j, 4] - R[j, 1], R[j, 5] - R[j, 2])


@kernel
def sweep(vertices, S, star, ref, ground, face):
    """One Newton step per listed vertex, in place; face (n,): the target's face under each."""
    corner, twin, start, size = star
    R, ka, M = ring_buffer(size), np.empty(size), np.empty(6)
    for u in vertices:
        h = start[u]
        for j in range(size):
            t, c = h // 3, h % 3
            kb, kc = ref.k[t, (c + 2) % 3], ref.k[t, (c + 1) % 3]
            set_sector(R, j, S, corner[following(h)], corner[preceding(h)], kb, kc, 0.0, ref.inverse[t], ref.weight[t])
            ka[j], m = ref.k[t, c], j + 1
            h = twin[preceding(h)]
            if h == start[u]:
                break
        face[u], _, _, _, root = metric_under(ground, face[u], S[u, 0], S[u, 1], S[u, 2], M)
        _measure(m, R, ka, M, root)
        S[u, 0], S[u, 1], S[u, 2] = _relax((S[u, 0], S[u, 1], S[u, 2]), m, R, M, ONE_STEP)


def putter(ground: Ground, face: Int[np.ndarray, "n"]) -> Callable[..., int]:
    """What puts vertices back on the target's sphere; `face` holds the target's face under each vertex and is kept up."""

    def put(high: int, low: int, records: tuple[np.ndarray, ...], *mesh: np.ndarray | float) -> int:
        V, S, F, *scales = mesh
        return int(_insert((high, low), records, (V, S, F, face), tuple(scales), ground))

    return put


@kernel
def _insert(span, records, mesh, scales, ground):  # undo records high - 1 .. low; the one that failed, or -1
    removed, offsets, ring_vertices, ring_faces = records
    V, S, F, face = mesh
    scale2, floor2, size = scales
    R, P, Q = ring_buffer(size), np.empty((2 * size + 8, 3)), np.empty((2 * size + 8, 3))
    ka, M = np.empty(size), np.empty(6)
    for i in range(span[0] - 1, span[1] - 1, -1):
        u, first, k = removed[i], offsets[i], offsets[i + 1] - offsets[i]
        v = ring_vertices[first]
        mx = my = mz = 0.0
        for j in range(k):
            b, c, row = ring_vertices[first + j], ring_vertices[first + (j + 1) % k], ring_faces[first + j]
            F[row, 0], F[row, 1], F[row, 2] = u, b, c
            lb, lc = distance2(V, u, b) * scale2, distance2(V, c, u) * scale2
            ka[j], k1, k2, area = triangle_reference(distance2(V, b, c) * scale2, lc, lb, floor2)
            set_sector(R, j, S, b, c, k2, k1, 0.0, 0.5 / area, area)
            pull = 1 / np.sqrt(lb + 1e-300)
            mx, my, mz = mx + pull * S[b, 0], my + pull * S[b, 1], mz + pull * S[b, 2]
        s = 1 / (np.sqrt(mx * mx + my * my + mz * mz) + 1e-300)
        x, y, z, margin = kernel_point(k, R, S[v, 0], S[v, 1], S[v, 2], P, Q)
        face[u], _, _, _, root = metric_under(ground, face[v], x, y, z, M)
        _measure(k, R, ka, M, root)
        if _energy(mx * s, my * s, mz * s, k, R, M) < (_energy(x, y, z, k, R, M) if margin > 0 else np.inf):
            x, y, z = mx * s, my * s, mz * s
        elif not margin > 0:
            return i
        if _energy(x, y, z, k, R, M) < np.inf:
            x, y, z = _relax((x, y, z), k, R, M, INSERTION_STEPS)
        S[u, 0], S[u, 1], S[u, 2] = x, y, z
    return -1
