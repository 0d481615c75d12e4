"""Distortion of a mesh laid onto the surface of another: each triangle against the chord triangle of its three images.

The images q of the source's vertices lie on the target's surface, under their unit vectors. With b the mean of the target's normals
at the three corners, N = (q_1 - q_0) x (q_2 - q_0) and c = N . b / |N|,

    n = sum_i k_i |q_j - q_k|^2,   D = |N| / (2 A), times c / 0.3 if c < 0.3: negative where the image lies face down,
    f = 1 + (D + h(D) - 2) / 2 + (n - 2 D) (1 + g(D)) / 4,   h = 1 / D,  g = 1 / D^2

which is n (1 + 1 / D^2) / 4, written as one part for the area and one for the shape, both never negative. Below D = tau, h and g go on
as parabolas (twice continuously differentiable), so that a folded triangle costs much, but not infinitely much, and can be mended.
Below D = 0 they grow no faster than f on stretched triangles does: slivers, whose D errs by any amount, do not drown the rest.
E = sum w sqrt(f - 1 + delta^2). Derivatives go through the images by a smoothed Jacobian of the map from sphere to surface: the exact
one jumps across the target's edges. Second derivatives of that map, and those of b, are left out. Both surfaces have area 4 pi.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from morphlet.mapping.metric import Ground, Source, under
from morphlet.numerics.compiled import inner_kernel, kernel
from morphlet.sphere.energy import by_pieces, project_psd
from morphlet.sphere.map import SphericalMap

UPRIGHT = 0.3
"""Cosine between the normals of an image and of the target below which the image counts as tilting over."""
TINY = 1e-300
"""Keeps quotients of lengths finite."""


class Images(NamedTuple):
    """Where the source's vertices lie (numba type): the target's face (n,), and (n, 15): position, normal, smoothed Jacobian."""

    face: Int[np.ndarray, "n"]
    row: Float[np.ndarray, "n 15"]


class Chord(NamedTuple):
    """The terms of the triangles (numba type): their energies and the weights w psi'(f), both (m,), and tau."""

    energy: Float[np.ndarray, "m"]
    majorant: Float[np.ndarray, "m"]
    tau: float


def sheet(target: SphericalMap) -> Float[np.ndarray, "N 15"]:
    """What a target's vertices carry: position (scaled to area 4 pi), normal, smoothed Jacobian from sphere to surface."""
    mesh, points, faces = target.surface.mesh, target.closed_points, target.surface.mesh.faces
    X = mesh.vertices * np.sqrt(4 * np.pi / mesh.area)
    first, second = points[faces[:, 1]] - points[faces[:, 0]], points[faces[:, 2]] - points[faces[:, 0]]
    normal = np.cross(first, second)
    share = np.linalg.norm(normal, axis=1)
    below = np.stack([first, second, normal / np.maximum(share, np.finfo(float).tiny)[:, None]], axis=2)
    above = np.zeros_like(below)
    above[:, :, 0], above[:, :, 1] = X[faces[:, 1]] - X[faces[:, 0]], X[faces[:, 2]] - X[faces[:, 0]]
    jacobian = (share[:, None, None] * (above @ np.linalg.inv(below))).reshape(-1, 9)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(column, 3), len(points)) for column in jacobian.T], axis=1)
    mean = total / np.bincount(faces.ravel(), np.repeat(share, 3), len(points))[:, None]
    tangent = np.eye(3) - points[:, :, None] * points[:, None, :]
    return np.concatenate([X, mesh.vertex_normals, (mean.reshape(-1, 3, 3) @ tangent).reshape(-1, 9)], axis=1)


def locate(S: Float[np.ndarray, "n 3"], ground: Ground, rows: Float[np.ndarray, "N 15"], images: Images) -> None:
    """Bring the images up to S, walking from where they were."""
    by_pieces(_locate, len(S), S, ground, rows, images)


def value(source: Source, images: Images, chord: Chord) -> float:
    """E of the images; fills the energies and weights of the triangles."""
    return sum(by_pieces(_value, len(source.F), source, images, chord))


def add_derivatives(
    T: Float[np.ndarray, "n 2 3"], source: Source, images: Images, chord: Chord, g: Float[np.ndarray, "m 6"], H: Float[np.ndarray, "m 21"]
) -> None:
    """Add gradient and Hessian per triangle, in the tangent frames T, to those of another energy, and make the sums PSD."""
    pulled = np.einsum("nij,naj->nai", images.row[:, 6:].reshape(-1, 3, 3), T)
    by_pieces(_derivatives, len(source.F), source, images, chord, (pulled, g, H))


@kernel
def _locate(first, last, S, ground, rows, images):  # images of the points first .. last - 1 of S (n, 3); rows (N, 15)
    for i in range(first, last):
        face, u, v, w = under(ground, images.face[i], S[i, 0], S[i, 1], S[i, 2])
        a, b, c = ground.corner[3 * face], ground.corner[3 * face + 1], ground.corner[3 * face + 2]
        images.face[i] = face
        for e in range(15):
            images.row[i, e] = u * rows[a, e] + v * rows[b, e] + w * rows[c, e]


@inner_kernel
def inverses(D, tau):
    """The functions h, h', h'', g, g', g'': of 1 / D and 1 / D^2; below tau parabolas, below 0 h straight and g bounded."""
    if tau <= D:
        r = 1 / D
        return r, -r * r, 2 * r * r * r, r * r, -2 * r * r * r, 6 * r * r * r * r
    s = 1 / tau
    s2, s3, s4 = s * s, s * s * s, s * s * s * s
    if D < 0.0:
        r = 1 / (1 - D * s)
        return 3 * (s - D * s2), -3 * s2, 0.0, 6 * s2 - 8 * s3 * D * r, -8 * s3 * r * r, -16 * s4 * r * r * r
    z = D - tau
    return s - z * s2 + z * z * s3, -s2 + 2 * z * s3, 2 * s3, s2 - 2 * z * s3 + 3 * z * z * s4, -2 * s3 + 6 * z * s4, 6 * s4


@inner_kernel
def stretch(n, D, tau):
    """The distortion f and its derivatives f_n, f_D, f_nD, f_DD."""
    h, h1, h2, g, g1, g2 = inverses(D, tau)
    shape = 0.25 * (n - 2 * D)
    f = 0.5 * (D + h) + shape * (1 + g)
    return f, 0.25 * (1 + g), 0.5 * (h1 - g) + shape * g1, 0.25 * g1, 0.5 * h2 - g1 + shape * g2


@inner_kernel
def upright(nx, ny, nz, bx, by, bz):
    """The length |N|, and c for the sum of normals b."""
    size = np.sqrt(nx * nx + ny * ny + nz * nz) + TINY
    return size, (nx * bx + ny * by + nz * bz) / (size * (np.sqrt(bx * bx + by * by + bz * bz) + TINY))


@inner_kernel
def pair(kt, inverse, p, q, r):
    """The invariants n and D of a triangle whose corners have position and normal in p, q, r."""
    ux, uy, uz, vx, vy, vz = q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2]
    wx, wy, wz = vx - ux, vy - uy, vz - uz
    n = kt[0] * (wx * wx + wy * wy + wz * wz) + kt[1] * (vx * vx + vy * vy + vz * vz) + kt[2] * (ux * ux + uy * uy + uz * uz)
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    size, c = upright(nx, ny, nz, p[3] + q[3] + r[3], p[4] + q[4] + r[4], p[5] + q[5] + r[5])
    return n, size * inverse * min(1.0, c / UPRIGHT)


@kernel
def _value(first, last, source, images, chord):  # the sum over triangles first .. last - 1
    total = 0.0
    for t in range(first, last):
        c = source.F[t]
        n, D = pair(source.k[t], source.inverse[t], images.row[c[0]], images.row[c[1]], images.row[c[2]])
        root = np.sqrt(max(stretch(n, D, chord.tau)[0] - 1, 0.0) + source.delta * source.delta)
        chord.energy[t] = source.weight[t] * root
        chord.majorant[t] = 0.5 * source.weight[t] / root
        total += chord.energy[t]
    return total


@kernel
def _derivatives(first, last, source, images, chord, laid):  # laid: J T (n, 2, 3); added to g (m, 6) and H (m, 21)
    pulled, g, H = laid
    A, U, work = np.empty((6, 6)), np.empty((6, 6)), (np.empty((3, 3)), np.empty(6), np.empty(6), np.empty((6, 3)))
    for t in range(first, last):
        for i in range(6):
            for j in range(i + 1):
                A[i, j] = H[t, i * (i + 1) // 2 + j]
        _triangle_terms(t, source, images, (chord, pulled), (work, g), A)
        project_psd(A, U)
        for i in range(6):
            for j in range(i + 1):
                H[t, i * (i + 1) // 2 + j] = A[i, j]
    return 0.0


@inner_kernel
def _triangle_terms(t, source, images, terms, out, H):  # to row t of g and H (6, 6), lower triangle
    chord, pulled = terms
    (e, tn, td, J), g = out
    c, kt, Q = source.F[t], source.k[t], images.row
    n, D = pair(kt, source.inverse[t], Q[c[0]], Q[c[1]], Q[c[2]])
    bx, by, bz, scale = _lagged(c, Q, source.inverse[t])
    _, fn, fd, fnd, fdd = stretch(n, D, chord.tau)
    w = chord.majorant[t]
    fn, fd, fnd, fdd = w * fn, w * fd, w * fnd, w * fdd
    for i in range(3):
        for d in range(3):
            e[i, d] = Q[c[(i + 2) % 3], d] - Q[c[(i + 1) % 3], d]
    for i in range(6):
        a = i // 2
        j, k = (a + 1) % 3, (a + 2) % 3
        x = pulled[c[a], i % 2]
        tn[i], td[i] = 0.0, 0.0
        dx, dy, dz = by * e[a, 2] - bz * e[a, 1], bz * e[a, 0] - bx * e[a, 2], bx * e[a, 1] - by * e[a, 0]
        td[i] = scale * (dx * x[0] + dy * x[1] + dz * x[2])
        for d in range(3):
            J[i, d] = x[d]
            tn[i] += 2 * (kt[j] * e[j, d] - kt[k] * e[k, d]) * x[d]
        g[t, i] += fn * tn[i] + fd * td[i]
        for q in range(i + 1):
            H[i, q] += fnd * (tn[i] * td[q] + td[i] * tn[q]) + fdd * td[i] * td[q]
    for i in range(6):
        for q in range(i + 1):
            a, b = i // 2, q // 2
            inner = J[i, 0] * J[q, 0] + J[i, 1] * J[q, 1] + J[i, 2] * J[q, 2]
            if a == b:
                H[i, q] += 2 * fn * (kt[(a + 1) % 3] + kt[(a + 2) % 3]) * inner
                continue
            x, y = (J[i], J[q]) if a == (b + 2) % 3 else (J[q], J[i])  # x at the corner before that of y
            turn = bx * (x[1] * y[2] - x[2] * y[1]) + by * (x[2] * y[0] - x[0] * y[2]) + bz * (x[0] * y[1] - x[1] * y[0])
            H[i, q] += fd * scale * turn - 2 * fn * kt[3 - a - b] * inner


@inner_kernel
def _lagged(c, Q, inverse):  # unit b, and the factor with which D = factor N . b
    p, q, r = Q[c[0]], Q[c[1]], Q[c[2]]
    ux, uy, uz, vx, vy, vz = q[0] - p[0], q[1] - p[1], q[2] - p[2], r[0] - p[0], r[1] - p[1], r[2] - p[2]
    nx, ny, nz = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
    bx, by, bz = p[3] + q[3] + r[3], p[4] + q[4] + r[4], p[5] + q[5] + r[5]
    size, c_ = upright(nx, ny, nz, bx, by, bz)
    if c_ >= UPRIGHT:
        return nx / size, ny / size, nz / size, inverse
    size = np.sqrt(bx * bx + by * by + bz * bz) + TINY
    return bx / size, by / size, bz / size, inverse / UPRIGHT
