"""Distortion of a spherical mesh: value, gradient, Hessian.

Every triangle of the surface, scaled so that the total area is 4 pi, is compared with the chord triangle (a, b, c) of its
three unit vectors. With squared reference lengths l_i opposite corner i and reference area A,

    k_i = cot_i / (2 A),   n = sum_i k_i |edge_i|^2 = |J|_F^2,   D = det(a, b, c) / (2 A),
    f = n (1 + 1 / D^2) / 4   (symmetric Dirichlet energy, 1 at an isometry),   E = sum_t w_t f_t^p,   +infinity if any D <= 0.

D is the orientation predicate itself (chord area times the distance of its plane from the centre, over A): a barrier on
the chord area would let a triangle grow to a hemisphere and pass through the centre. Weights sum to 4 pi.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int
from numba import njit, prange

ISOMETRIC, HINGE, ANGLE_AREA = 0, 1, 2
"""Forms of f: the symmetric Dirichlet energy; max(0, a - D)^2, which pulls folded triangles open; and
(1 - a) n / (2 D) + a (D + 1 / D) / 2, which weighs angles against areas."""
CHUNKS = 64
"""Sums are taken in 64 fixed pieces, then in order (no `.sum()` under parallel=True, which numba splits among the threads):
the same bits for any number of threads."""
SERIAL_BELOW = 6000
"""Faces below which one thread does the work: waking the others can cost 20 ms a call. No array is made under parallel=True
(filling it is a parallel loop too)."""
LANES = 8
"""Triangles whose 6x6 blocks are projected side by side, one per SIMD lane."""
SHAPE_FLOOR = 1e-3
"""Smallest 4 A / (longest edge)^2 of a reference triangle: a sliver has no barrier of its own."""
AREA_SLACK = 1e-4
"""Share of its squared edge lengths added to a triangle's area in weights and scale: finite on degenerate input."""
JACOBI_SWEEPS = 7
"""Cyclic Jacobi sweeps on a 6x6 block; convergence is quadratic and 5 to 6 reach rounding."""
JACOBI_TOLERANCE = 1e-9
"""Relative off-diagonal at which sweeps stop: far below what a descent direction can feel."""
MARCH_STEPS = 200
"""Bound on the march towards a fold; the step grows by 1.6, so it is never reached in practice."""


class Reference(NamedTuple):
    """The metric that a map is compared with, per face (numba type): k (m, 3), 1 / (2 A) (m,), weight (m,)."""

    k: Float[np.ndarray, "m 3"]
    inverse: Float[np.ndarray, "m"]
    weight: Float[np.ndarray, "m"]


def slack_areas(V: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
    """Face areas with a little of the squared edge lengths, positive on any input."""
    e, g = V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]]
    squares = np.sum(e * e, axis=1) + np.sum(g * g, axis=1) + np.sum((g - e) ** 2, axis=1)
    return 0.5 * np.linalg.norm(np.cross(e, g), axis=1) + AREA_SLACK * squares + 1e-30


def reference(V: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"], floor: float) -> Reference:
    """The metric of a mesh scaled to area 4 pi, with uniform weights.

    Triangles whose squared edges are all below `floor` times the mean triangle area become equilateral.
    """
    k, inverse = np.empty((len(F), 3)), np.empty(len(F))
    scale2 = 4 * np.pi / slack_areas(V, F).sum()
    _reference(V, F, scale2, floor * 4 * np.pi / len(F), k, inverse)
    return Reference(k, inverse, np.full(len(F), 4 * np.pi / len(F)))


@njit(cache=True)
def triangle_reference(l0, l1, l2, floor2):  # squared edges opposite corners 0, 1, 2 -> k0, k1, k2, area
    longest = max(l0, max(l1, l2))
    if longest < floor2:
        l0 = l1 = l2 = longest = floor2
    s = 2 * (l0 * l1 + l1 * l2 + l2 * l0) - (l0 * l0 + l1 * l1 + l2 * l2)  # 16 A^2
    least = SHAPE_FLOOR * longest
    if s < least * least:  # lift the apex over the longest edge
        h2 = least * least / (4 * longest)
        if longest == l0:
            t = min(max((l0 + l1 - l2) / (2 * l0), 0.05), 0.95)
            l1, l2 = t * t * longest + h2, (1 - t) ** 2 * longest + h2
        elif longest == l1:
            t = min(max((l1 + l0 - l2) / (2 * l1), 0.05), 0.95)
            l0, l2 = t * t * longest + h2, (1 - t) ** 2 * longest + h2
        else:
            t = min(max((l2 + l0 - l1) / (2 * l2), 0.05), 0.95)
            l0, l1 = t * t * longest + h2, (1 - t) ** 2 * longest + h2
        s = max(2 * (l0 * l1 + l1 * l2 + l2 * l0) - (l0 * l0 + l1 * l1 + l2 * l2), 0.25 * least * least)
    return 2 * (l1 + l2 - l0) / s, 2 * (l0 + l2 - l1) / s, 2 * (l0 + l1 - l2) / s, 0.25 * np.sqrt(s)


@njit(inline="always")
def distance2(X, i, j):
    return (X[i, 0] - X[j, 0]) ** 2 + (X[i, 1] - X[j, 1]) ** 2 + (X[i, 2] - X[j, 2]) ** 2


@njit(cache=True)
def _reference(V, F, scale2, floor2, k, inverse):
    for t in range(F.shape[0]):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        k[t, 0], k[t, 1], k[t, 2], area = triangle_reference(
            distance2(V, b, c) * scale2, distance2(V, c, a) * scale2, distance2(V, a, b) * scale2, floor2
        )
        inverse[t] = 0.5 / area


@njit(inline="always")
def determinant(X, i, j, k):  # det(x_i, x_j, x_k) by differences: accurate on tiny triangles
    ex, ey, ez = X[j, 0] - X[i, 0], X[j, 1] - X[i, 1], X[j, 2] - X[i, 2]
    gx, gy, gz = X[k, 0] - X[i, 0], X[k, 1] - X[i, 1], X[k, 2] - X[i, 2]
    return X[i, 0] * (ey * gz - ez * gy) + X[i, 1] * (ez * gx - ex * gz) + X[i, 2] * (ex * gy - ey * gx)


@njit(inline="always")
def density(form, a, n, D):  # f(n, D) and its derivatives: f, f_n, f_D, f_nD, f_DD (f_nn = 0 in every form)
    if form == HINGE:
        gap = max(a - D, 0.0)
        return gap * gap, 0.0, -2 * gap, 0.0, 2.0 if gap > 0 else 0.0
    r = 1 / D
    if form == ISOMETRIC:
        return 0.25 * n * (1 + r * r), 0.25 * (1 + r * r), -0.5 * n * r * r * r, -0.5 * r * r * r, 1.5 * n * r * r * r * r
    angle, area = 0.5 * (1 - a), 0.5 * a
    first, second = area * (1 - r * r) - angle * n * r * r, 2 * r * r * r * (angle * n + area)
    return angle * n * r + area * (D + r), angle * r, first, -angle * r * r, second


@njit(cache=True, error_model="numpy")
def _value_piece(chunk, S, F, ref, form, a, p, majorant):  # the sum over one of the pieces
    m, total = F.shape[0], 0.0
    for t in range(m * chunk // CHUNKS, m * (chunk + 1) // CHUNKS):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        D = determinant(S, i, j, k) * ref.inverse[t]
        if D <= 0.0 and form != HINGE:
            return np.inf
        n = ref.k[t, 0] * distance2(S, j, k) + ref.k[t, 1] * distance2(S, k, i) + ref.k[t, 2] * distance2(S, i, j)
        f = density(form, a, n, D)[0]
        power = 1.0 if p == 1.0 else f ** (p - 1.0)
        total += ref.weight[t] * f * power
        majorant[t] = ref.weight[t] * p * power
    return total


@njit(parallel=True, cache=True, error_model="numpy")
def _value_pieces(partial, S, F, ref, form, a, p, majorant):  # partial (CHUNKS,), by all threads
    for chunk in prange(CHUNKS):
        partial[chunk] = _value_piece(chunk, S, F, ref, form, a, p, majorant)


@njit(cache=True, error_model="numpy")
def value(S, F, ref, form, a, p, majorant):  # E; majorant (m,) receives w p f^(p-1), the weights that majorise f^p for p <= 1
    partial, total = np.zeros(CHUNKS), 0.0
    if F.shape[0] < SERIAL_BELOW:
        for chunk in range(CHUNKS):
            partial[chunk] = _value_piece(chunk, S, F, ref, form, a, p, majorant)
    else:
        _value_pieces(partial, S, F, ref, form, a, p, majorant)
    for chunk in range(CHUNKS):
        total += partial[chunk]
    return total


@njit(inline="always")
def tangents(x, y, z):  # two unit tangents of the sphere at (x, y, z)
    if abs(x) < 0.6:
        ex, ey, ez = 1 - x * x, -x * y, -x * z
    elif abs(y) < 0.6:
        ex, ey, ez = -x * y, 1 - y * y, -y * z
    else:
        ex, ey, ez = -x * z, -y * z, 1 - z * z
    s = 1 / np.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex * s, ey * s, ez * s
    return ex, ey, ez, y * ez - z * ey, z * ex - x * ez, x * ey - y * ex


@njit(cache=True)
def frames(S, T):  # T (n, 2, 3): tangent basis of each vertex
    for i in range(S.shape[0]):
        T[i, 0, 0], T[i, 0, 1], T[i, 0, 2], T[i, 1, 0], T[i, 1, 1], T[i, 1, 2] = tangents(S[i, 0], S[i, 1], S[i, 2])


@njit(cache=True, error_model="numpy")
def _triangle_terms(t, S, F, T, ref, form, a, weight, work, g, H):  # g (m, 6) row t and H (6, 6) lower triangle of one triangle
    gn, gd, tn, td = work
    c = (F[t, 0], F[t, 1], F[t, 2])
    inverse = ref.inverse[t]
    n = 0.0
    D = determinant(S, c[0], c[1], c[2]) * inverse
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        x, y, z = c[i], c[j], c[k]
        n += ref.k[t, i] * distance2(S, y, z)
        for d in range(3):
            gn[i, d] = 2 * (ref.k[t, k] * (S[x, d] - S[y, d]) + ref.k[t, j] * (S[x, d] - S[z, d]))
            e, f = (d + 1) % 3, (d + 2) % 3  # x_y x (x_z - x_y)
            gd[i, d] = (S[y, e] * (S[z, f] - S[y, f]) - S[y, f] * (S[z, e] - S[y, e])) * inverse
    _, fn, fd, fnd, fdd = density(form, a, n, D)
    fn, fd, fnd, fdd = weight * fn, weight * fd, weight * fnd, weight * fdd
    for i in range(6):
        x, e = c[i // 2], i % 2
        tn[i] = gn[i // 2, 0] * T[x, e, 0] + gn[i // 2, 1] * T[x, e, 1] + gn[i // 2, 2] * T[x, e, 2]
        td[i] = gd[i // 2, 0] * T[x, e, 0] + gd[i // 2, 1] * T[x, e, 1] + gd[i // 2, 2] * T[x, e, 2]
        g[t, i] = fn * tn[i] + fd * td[i]
        for j in range(i + 1):
            H[i, j] = fnd * (tn[i] * td[j] + td[i] * tn[j]) + fdd * td[i] * td[j]
    if form == HINGE:  # Gauss-Newton: first derivatives only
        return
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        x, y, z = c[i], c[j], c[k]
        bend = 0.0  # curvature of the sphere
        for d in range(3):
            bend += (fn * gn[i, d] + fd * gd[i, d]) * S[x, d]
        H[2 * i, 2 * i] += 2 * fn * (ref.k[t, j] + ref.k[t, k]) - bend
        H[2 * i + 1, 2 * i + 1] += 2 * fn * (ref.k[t, j] + ref.k[t, k]) - bend
        for row in range(2):
            for column in range(2):
                mixed = 0.0
                for d in range(3):
                    e, f = (d + 1) % 3, (d + 2) % 3
                    cross = T[y, column, e] * S[z, f] - T[y, column, f] * S[z, e]
                    mixed += T[x, row, d] * (fd * inverse * cross - 2 * fn * ref.k[t, k] * T[y, column, d])
                if j > i:
                    H[2 * j + column, 2 * i + row] += mixed
                else:
                    H[2 * i + row, 2 * j + column] += mixed


@njit(cache=True, error_model="numpy")
def _rotate(A, U, p, q, cosine, sine):  # one Jacobi rotation of rows and columns p, q, in all lanes
    for l in range(LANES):
        d, x = A[q, q, l] - A[p, p, l], A[p, q, l]
        t = np.copysign(2.0, d) * x / (abs(d) + np.sqrt(d * d + 4 * x * x) + 1e-300)
        cosine[l] = 1 / np.sqrt(1 + t * t)
        sine[l] = t * cosine[l]
        A[p, p, l] -= t * x
        A[q, q, l] += t * x
        A[p, q, l] = A[q, p, l] = 0.0
    for k in range(6):
        if k != p and k != q:
            for l in range(LANES):
                x, y = A[k, p, l], A[k, q, l]
                A[k, p, l] = cosine[l] * x - sine[l] * y
                A[k, q, l] = sine[l] * x + cosine[l] * y
            for l in range(LANES):
                A[p, k, l], A[q, k, l] = A[k, p, l], A[k, q, l]
        for l in range(LANES):
            x, y = U[k, p, l], U[k, q, l]
            U[k, p, l] = cosine[l] * x - sine[l] * y
            U[k, q, l] = sine[l] * x + cosine[l] * y


@njit(cache=True, error_model="numpy")
def diagonalise(A, U):  # A (6, 6, LANES) symmetric -> eigenvalues on its diagonals; U (6, 6, LANES) the eigenvectors
    cosine, sine = np.empty(LANES), np.empty(LANES)
    U[:] = 0.0
    for i in range(6):
        U[i, i, :] = 1.0
    for _ in range(JACOBI_SWEEPS):
        off = 0.0
        for i in range(6):
            for j in range(i):
                for l in range(LANES):
                    off = max(off, abs(A[i, j, l]) / (abs(A[i, i, l]) + abs(A[j, j, l]) + 1e-300))
        if off <= JACOBI_TOLERANCE:
            break
        for p in range(5):
            for q in range(p + 1, 6):
                _rotate(A, U, p, q, cosine, sine)


@njit(cache=True, error_model="numpy")
def _derivatives_piece(chunk, S, F, T, ref, form, a, weight, project, g, H):
    m = F.shape[0]
    work = (np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6))
    h, A, U = np.empty((6, 6)), np.empty((6, 6, LANES)), np.empty((6, 6, LANES))
    last = m * (chunk + 1) // CHUNKS
    for first in range(m * chunk // CHUNKS, last, LANES):
        for l in range(LANES):
            t = min(first + l, last - 1)
            _triangle_terms(t, S, F, T, ref, form, a, weight[t], work, g, h)
            for i in range(6):
                for j in range(i + 1):
                    A[i, j, l] = A[j, i, l] = h[i, j]
        if project:
            diagonalise(A, U)
        for l in range(min(LANES, last - first)):
            for i in range(6):
                for j in range(i + 1):
                    total = A[i, j, l]
                    if project:
                        total = 0.0
                        for k in range(6):
                            total += U[i, k, l] * max(A[k, k, l], 0.0) * U[j, k, l]
                    H[first + l, i * (i + 1) // 2 + j] = total


@njit(parallel=True, cache=True, error_model="numpy")
def derivatives(S, F, T, ref, form, a, weight, project, g, H):  # g (m, 6), H (m, 21): gradient and lower Hessian of every triangle
    if F.shape[0] < SERIAL_BELOW:
        for chunk in range(CHUNKS):
            _derivatives_piece(chunk, S, F, T, ref, form, a, weight, project, g, H)
    else:
        for chunk in prange(CHUNKS):
            _derivatives_piece(chunk, S, F, T, ref, form, a, weight, project, g, H)


@njit(cache=True)
def move(S, U, alpha, out):  # out = S + alpha U, back on the sphere
    for i in range(S.shape[0]):
        x, y, z = S[i, 0] + alpha * U[i, 0], S[i, 1] + alpha * U[i, 1], S[i, 2] + alpha * U[i, 2]
        s = 1 / np.sqrt(x * x + y * y + z * z)
        out[i, 0], out[i, 1], out[i, 2] = x * s, y * s, z * s


@njit(inline="always")
def _cross_dot(a, b, c, d, e, f, x, y, z):  # (x, y, z) . ((a, b, c) x (d, e, f))
    return x * (b * f - c * e) + y * (c * d - a * f) + z * (a * e - b * d)


@njit(cache=True)
def _first_fold(c0, c1, c2, c3, limit):  # a lower bound of the first root of c0 + c1 t + c2 t^2 + c3 t^3 in (0, limit)
    if c0 > -min(c1, 0.0) * limit - min(c2, 0.0) * limit**2 - min(c3, 0.0) * limit**3:
        return limit
    low, d = 0.0, limit / 4
    for _ in range(MARCH_STEPS):
        d = min(d, limit - low)
        b0 = c0 + low * (c1 + low * (c2 + low * c3))
        b1, b2 = c1 + low * (2 * c2 + low * 3 * c3), c2 + 3 * low * c3
        if b0 <= 1e-3 * c0:
            return low
        if b0 + min(b1, 0.0) * d + min(b2, 0.0) * d * d + min(c3, 0.0) * d * d * d > 0:
            low += d
            d *= 1.6
        else:
            d *= 0.5
        if low >= limit or d < 1e-6 * limit:
            return low
    return low


@njit(cache=True)
def _largest_piece(chunk, S, U, F, limit):
    m, least = F.shape[0], limit
    for t in range(m * chunk // CHUNKS, m * (chunk + 1) // CHUNKS):
        i, j, k = F[t, 0], F[t, 1], F[t, 2]
        ax, ay, az, ux, uy, uz = S[i, 0], S[i, 1], S[i, 2], U[i, 0], U[i, 1], U[i, 2]
        ex, ey, ez, gx, gy, gz = S[j, 0] - ax, S[j, 1] - ay, S[j, 2] - az, S[k, 0] - ax, S[k, 1] - ay, S[k, 2] - az
        dx, dy, dz, hx, hy, hz = U[j, 0] - ux, U[j, 1] - uy, U[j, 2] - uz, U[k, 0] - ux, U[k, 1] - uy, U[k, 2] - uz
        c0 = _cross_dot(ex, ey, ez, gx, gy, gz, ax, ay, az)
        mixed_a = _cross_dot(ex, ey, ez, hx, hy, hz, ax, ay, az) + _cross_dot(dx, dy, dz, gx, gy, gz, ax, ay, az)
        mixed_u = _cross_dot(ex, ey, ez, hx, hy, hz, ux, uy, uz) + _cross_dot(dx, dy, dz, gx, gy, gz, ux, uy, uz)
        c1 = mixed_a + _cross_dot(ex, ey, ez, gx, gy, gz, ux, uy, uz)
        c2 = _cross_dot(dx, dy, dz, hx, hy, hz, ax, ay, az) + mixed_u
        c3 = _cross_dot(dx, dy, dz, hx, hy, hz, ux, uy, uz)
        least = min(least, _first_fold(c0, c1, c2, c3, least))
    return least


@njit(parallel=True, cache=True)
def _largest_pieces(least, S, U, F, limit):  # least (CHUNKS,), by all threads
    for chunk in prange(CHUNKS):
        least[chunk] = _largest_piece(chunk, S, U, F, limit)


@njit(cache=True)
def largest_step(S, U, F, limit):  # a step below `limit` up to which no det(a + t u, b + t v, c + t w) reaches 0
    least = np.full(CHUNKS, limit)
    if F.shape[0] < SERIAL_BELOW:
        for chunk in range(CHUNKS):
            least[0] = _largest_piece(chunk, S, U, F, least[0])
    else:
        _largest_pieces(least, S, U, F, limit)
    return least.min()
