"""Distortion of a spherical mesh: value, gradient, Hessian.

Every triangle of the surface, scaled so that the total area is 4 pi, is compared with the chord triangle (a, b, c) of its
three unit vectors. With squared reference lengths l_i opposite corner i and reference area A,

    k_i = cot_i / (2 A),   n = sum_i k_i |edge_i|^2 = |J|_F^2,   D = det(a, b, c) / (2 A),
    f = n (1 + 1 / D^2) / 4   (symmetric Dirichlet energy, 1 at an isometry),   E = sum_t w_t f_t^p,   +infinity if any D <= 0.

D is the orientation predicate itself (chord area times the distance of its plane from the centre, over A): a barrier on
the chord area would let a triangle grow to a hemisphere and pass through the centre. Weights sum to 4 pi.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from morphlet.numerics.compiled import inlined_kernel, inner_kernel, kernel
from morphlet.numerics.threads import each

ISOMETRIC, HINGE, ANGLE_AREA = 0, 1, 2
"""Forms of f: the symmetric Dirichlet energy; max(0, a - D)^2, which pulls folded triangles open; and
(1 - a) n / (2 D) + a (D + 1 / D) / 2, which weighs angles against areas."""
PIECES = 16
"""Large meshes are summed in 16 fixed pieces, then in order: the same bits for any number of threads."""
SERIAL_BELOW = 3000
"""Faces below which one thread is faster: waking others costs more."""
SHAPE_FLOOR = 1e-3
"""Smallest 4 A / (longest edge)^2 of a reference triangle: a sliver has no barrier of its own."""
AREA_SLACK = 1e-4
"""Share of its squared edge lengths added to a triangle's area in weights and scale: finite on degenerate input."""
JACOBI_SWEEPS = 7
"""Cyclic Jacobi sweeps on a 6x6 block; convergence is quadratic and 5 to 6 reach rounding."""
JACOBI_TOLERANCE = 1e-4
"""Off-diagonal, relative to its diagonal, that is left standing: far below what a descent direction can feel."""
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


@kernel
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


@inlined_kernel
def distance2(X, i, j):
    return (X[i, 0] - X[j, 0]) ** 2 + (X[i, 1] - X[j, 1]) ** 2 + (X[i, 2] - X[j, 2]) ** 2


@kernel
def _reference(V, F, scale2, floor2, k, inverse):
    for t in range(F.shape[0]):
        a, b, c = F[t, 0], F[t, 1], F[t, 2]
        k[t, 0], k[t, 1], k[t, 2], area = triangle_reference(
            distance2(V, b, c) * scale2, distance2(V, c, a) * scale2, distance2(V, a, b) * scale2, floor2
        )
        inverse[t] = 0.5 / area


@inlined_kernel
def determinant(X, i, j, k):  # det(x_i, x_j, x_k) by differences: accurate on tiny triangles
    ex, ey, ez = X[j, 0] - X[i, 0], X[j, 1] - X[i, 1], X[j, 2] - X[i, 2]
    gx, gy, gz = X[k, 0] - X[i, 0], X[k, 1] - X[i, 1], X[k, 2] - X[i, 2]
    return X[i, 0] * (ey * gz - ez * gy) + X[i, 1] * (ez * gx - ex * gz) + X[i, 2] * (ex * gy - ey * gx)


@inlined_kernel
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


@kernel
def _value(first, last, S, F, ref, form, a, p, majorant):  # the sum over faces first .. last - 1
    total = 0.0
    for t in range(first, last):
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


def value(
    S: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"], ref: Reference, form: int, a: float, p: float, majorant: Float[np.ndarray, "m"]
) -> float:
    """E of a spherical mesh; `majorant` receives w p f^(p-1), the weights that majorise f^p for p <= 1."""
    return sum(by_pieces(_value, len(F), S, F, ref, form, a, p, majorant))


def by_pieces(work: Callable[..., float], m: int, *arguments: object) -> list[float]:
    """work(first, last, ...) over fixed pieces of m faces: one piece of a small mesh, many of a large one; results in order."""
    pieces = 1 if m < SERIAL_BELOW else PIECES
    return each(lambda i: work(m * i // pieces, m * (i + 1) // pieces, *arguments), pieces)


@inlined_kernel
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


@kernel
def frames(S, T):  # T (n, 2, 3): tangent basis of each vertex
    for i in range(S.shape[0]):
        T[i, 0, 0], T[i, 0, 1], T[i, 0, 2], T[i, 1, 0], T[i, 1, 1], T[i, 1, 2] = tangents(S[i, 0], S[i, 1], S[i, 2])


@inner_kernel
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


@inner_kernel
def _rotate(A, U, p, q):  # one Jacobi rotation of rows p < q; A: lower triangle, U: eigenvectors as rows
    x, d = A[q, p], A[q, q] - A[p, p]
    t = np.copysign(2.0, d) * x / (abs(d) + np.sqrt(d * d + 4 * x * x) + 1e-300)
    c = 1 / np.sqrt(1 + t * t)
    s = t * c
    A[p, p] -= t * x
    A[q, q] += t * x
    A[q, p] = 0.0
    for k in range(p):
        y, z = A[p, k], A[q, k]
        A[p, k], A[q, k] = c * y - s * z, s * y + c * z
    for k in range(p + 1, q):
        y, z = A[k, p], A[q, k]
        A[k, p], A[q, k] = c * y - s * z, s * y + c * z
    for k in range(q + 1, 6):
        y, z = A[k, p], A[k, q]
        A[k, p], A[k, q] = c * y - s * z, s * y + c * z
    for k in range(6):
        y, z = U[p, k], U[q, k]
        U[p, k], U[q, k] = c * y - s * z, s * y + c * z


@kernel
def project_psd(A, U):  # A (6, 6) lower triangle -> its nearest positive semi-definite matrix; U (6, 6) scratch
    for i in range(6):
        for j in range(6):
            U[i, j] = 1.0 if i == j else 0.0
    for _ in range(JACOBI_SWEEPS):
        done = True
        for p in range(5):
            for q in range(p + 1, 6):
                if A[q, p] * A[q, p] > JACOBI_TOLERANCE**2 * abs(A[p, p] * A[q, q]):
                    done = False
                    _rotate(A, U, p, q)
        if done:
            break
    e0, e1, e2, e3, e4, e5 = A[0, 0], A[1, 1], A[2, 2], A[3, 3], A[4, 4], A[5, 5]
    for i in range(6):
        for j in range(i + 1):
            A[i, j] = 0.0
    for k, e in enumerate((e0, e1, e2, e3, e4, e5)):
        if e > 0.0:
            for i in range(6):
                y = e * U[k, i]
                for j in range(i + 1):
                    A[i, j] += y * U[k, j]


@kernel
def _derivatives(first, last, S, F, T, ref, form, a, weight, project, g, H):
    work = (np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6))
    A, U = np.empty((6, 6)), np.empty((6, 6))
    for t in range(first, last):
        _triangle_terms(t, S, F, T, ref, form, a, weight[t], work, g, A)
        if project:
            project_psd(A, U)
        for i in range(6):
            for j in range(i + 1):
                H[t, i * (i + 1) // 2 + j] = A[i, j]
    return 0.0


def derivatives(
    S: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"], ref: Reference, form: int, a: float,
    weight: Float[np.ndarray, "m"], T: Float[np.ndarray, "n 2 3"], project: bool,
) -> tuple[Float[np.ndarray, "m 6"], Float[np.ndarray, "m 21"]]:  # fmt: skip
    """Gradient and lower triangle of the Hessian of every face in the tangent frames T, blocks made PSD if `project`."""
    g, H = np.empty((len(F), 6)), np.empty((len(F), 21))
    by_pieces(_derivatives, len(F), S, F, T, ref, form, a, weight, project, g, H)
    return g, H


@kernel
def move(S, U, alpha, out):  # out = S + alpha U, back on the sphere
    for i in range(S.shape[0]):
        x, y, z = S[i, 0] + alpha * U[i, 0], S[i, 1] + alpha * U[i, 1], S[i, 2] + alpha * U[i, 2]
        s = 1 / np.sqrt(x * x + y * y + z * z)
        out[i, 0], out[i, 1], out[i, 2] = x * s, y * s, z * s


@inlined_kernel
def _cross_dot(a, b, c, d, e, f, x, y, z):  # (x, y, z) . ((a, b, c) x (d, e, f))
    return x * (b * f - c * e) + y * (c * d - a * f) + z * (a * e - b * d)


@kernel
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


@inlined_kernel
def _face_step(S, U, i, j, k, limit):  # a step up to `limit` before which det(s_i + t u_i, s_j + t u_j, s_k + t u_k) stays positive
    ax, ay, az, ux, uy, uz = S[i, 0], S[i, 1], S[i, 2], U[i, 0], U[i, 1], U[i, 2]
    ex, ey, ez, gx, gy, gz = S[j, 0] - ax, S[j, 1] - ay, S[j, 2] - az, S[k, 0] - ax, S[k, 1] - ay, S[k, 2] - az
    dx, dy, dz, hx, hy, hz = U[j, 0] - ux, U[j, 1] - uy, U[j, 2] - uz, U[k, 0] - ux, U[k, 1] - uy, U[k, 2] - uz
    c0 = _cross_dot(ex, ey, ez, gx, gy, gz, ax, ay, az)
    mixed_a = _cross_dot(ex, ey, ez, hx, hy, hz, ax, ay, az) + _cross_dot(dx, dy, dz, gx, gy, gz, ax, ay, az)
    mixed_u = _cross_dot(ex, ey, ez, hx, hy, hz, ux, uy, uz) + _cross_dot(dx, dy, dz, gx, gy, gz, ux, uy, uz)
    c1 = mixed_a + _cross_dot(ex, ey, ez, gx, gy, gz, ux, uy, uz)
    c2 = _cross_dot(dx, dy, dz, hx, hy, hz, ax, ay, az) + mixed_u
    c3 = _cross_dot(dx, dy, dz, hx, hy, hz, ux, uy, uz)
    return _first_fold(c0, c1, c2, c3, limit)


@kernel
def _largest_step(first, last, S, U, F, limit):
    least = limit
    for t in range(first, last):
        least = min(least, _face_step(S, U, F[t, 0], F[t, 1], F[t, 2], least))
    return least


def largest_step(S: Float[np.ndarray, "n 3"], U: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"], limit: float) -> float:
    """A step up to `limit` along U before which no det(a + t u, b + t v, c + t w) reaches 0."""
    return min(by_pieces(_largest_step, len(F), S, U, F, limit))


@kernel
def _face_steps(first, last, S, U, F, limit, out):
    for t in range(first, last):
        out[t] = _face_step(S, U, F[t, 0], F[t, 1], F[t, 2], limit)
    return 0.0


def face_steps(S: Float[np.ndarray, "n 3"], U: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"], limit: float) -> Float[np.ndarray, "m"]:
    """For each face, a step up to `limit` along U before which it does not fold."""
    out = np.empty(len(F))
    by_pieces(_face_steps, len(F), S, U, F, limit, out)
    return out
