"""Distortion of a mesh laid into the sphere of another, measured in the other's metric.

The target's spherical map pulls the metric of its surface back to the sphere; averaged at the vertices (as a logarithm, so that
stretch and compression weigh the same) and smoothed to a scale, it is a field M of 3x3 matrices, zero along the normal. A source
triangle with unit vectors p_i, opposite edges e_i and the reference metric k_i, A of `sphere.energy` then has

    n = sum_i k_i e_i^T M e_i,   D = m det(p_0, p_1, p_2) / (2 A),   m = sqrt((tr(M)^2 - M : M) / 2),   f = n (1 + 1 / D^2) / 4

with M taken at its centroid x: f = 1 where source and target agree. E = sum w psi(f) with psi(f) = f, or, for delta > 0, the robust
psi(f) = sqrt(f - 1 + delta^2), concave in f and therefore majorised by the weights w psi'(f); E is infinite where a triangle folds.
The gradient holds the force through x (without it Newton stalls at once), the Hessian does not. Both surfaces have area 4 pi here.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.numerics.compiled import inner_kernel, kernel
from morphlet.numerics.linalg import Analysis, analyse
from morphlet.sphere.energy import by_pieces, determinant, frames, project_psd
from morphlet.sphere.locate import WALK_FACTOR, pierced
from morphlet.sphere.map import SphericalMap
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.operators import laplacian

STRETCH_LIMITS = (1e-4, 1e4)
"""Eigenvalues of a triangle's metric are kept within these: degenerate triangles say nothing."""
DIFFUSIONS = 3
"""Implicit steps per smoothing: together close to a Gaussian."""
ROWS, COLUMNS = np.array([0, 0, 0, 1, 1, 2]), np.array([0, 1, 2, 1, 2, 2])
"""Order of the six entries of a symmetric matrix."""
FLAT_ROOT = 1e-15
"""Floor of m, the area factor of M."""


class Ground(NamedTuple):
    """A target's sphere with a metric on it (numba type): points (N, 3), corners and twins of its faces (3 M,), metric (N, 6)."""

    points: Float[np.ndarray, "N 3"]
    corner: Int[np.ndarray, "h"]
    twin: Int[np.ndarray, "h"]
    metric: Float[np.ndarray, "N 6"]


class Source(NamedTuple):
    """The triangles that are laid in, and the metric they would keep (numba type), as `sphere.energy.Reference` has it."""

    F: Int[np.ndarray, "m 3"]
    k: Float[np.ndarray, "m 3"]
    inverse: Float[np.ndarray, "m"]
    weight: Float[np.ndarray, "m"]
    delta: float


class Seats(NamedTuple):
    """Where each source triangle sits (numba type): the target's face under its centroid, weights, M, m, and w psi'(f)."""

    face: Int[np.ndarray, "m"]
    weights: Float[np.ndarray, "m 3"]
    metric: Float[np.ndarray, "m 6"]
    root: Float[np.ndarray, "m"]
    majorant: Float[np.ndarray, "m"]


@dataclass(frozen=True, eq=False)
class MetricField:
    """The metric of a target's surface on its sphere, ready to be smoothed to any scale.

    Parameters
    ----------
    points
        Unit vectors of the target's vertices.
    topology
        Its faces.
    tangents
        Two orthonormal tangents at each point.
    logarithms
        Logarithm of the metric at each point, as a 2x2 matrix in these tangents.
    """

    points: Float[np.ndarray, "N 3"]
    topology: Topology
    tangents: Float[np.ndarray, "N 2 3"]
    logarithms: Float[np.ndarray, "N 2 2"]

    @staticmethod
    def prepare(target: SphericalMap) -> "MetricField":
        """Pull the surface's metric back; O(N)."""
        mesh, points = target.surface.mesh, np.array(target.closed_points)
        logs, shares = _triangle_logarithms(points, mesh)
        total = np.zeros((len(points), 9))
        for column in range(9):
            total[:, column] = np.bincount(mesh.faces.ravel(), np.repeat(shares * logs[:, column], 3), len(points))
        share = np.bincount(mesh.faces.ravel(), np.repeat(shares, 3), len(points))
        tangents = np.empty((len(points), 2, 3))
        frames(points, tangents)
        mean = (total / share[:, None]).reshape(-1, 3, 3)
        return MetricField(points, mesh.topology, tangents, np.einsum("nai,nij,nbj->nab", tangents, mean, tangents))

    @cached_property
    def _diffusion(self) -> tuple[Analysis, Float[np.ndarray, "z"], Float[np.ndarray, "N"], Int[np.ndarray, "N"]]:
        """Analysis and values of the sphere's Laplacian with positive weights, its masses, and where its diagonal stands."""
        sphere = Mesh(self.points, self.topology)
        off = laplacian(sphere)
        off.setdiag(0)
        off.data = np.minimum(off.data, 0)
        whole = sp.diags_array(-np.asarray(off.sum(axis=1)).ravel()) + off
        lower = sp.tril(whole, format="csc")
        lower.sort_indices()
        return analyse(lower.indptr, lower.indices, self.points), lower.data, sphere.vertex_areas, lower.indptr[:-1]

    def at_scale(self, sigma: float) -> Ground:
        """The field smoothed over about `sigma` radians; 0 leaves it as it is.

        Notes
        -----
        One factorization and three solves with six right-hand sides.
        """
        logs = self.logarithms
        if sigma > 0:
            analysis, values, mass, diagonal = self._diffusion
            system = sigma**2 / (2 * DIFFUSIONS) * values
            system[diagonal] += mass
            factor = analysis.factor(system)
            spread = self._embedded(logs)[:, ROWS, COLUMNS]
            for _ in range(DIFFUSIONS):
                spread = factor.solve(mass[:, None] * spread)
            whole = np.empty((len(spread), 3, 3))
            whole[:, ROWS, COLUMNS] = whole[:, COLUMNS, ROWS] = spread
            logs = np.einsum("nai,nij,nbj->nab", self.tangents, whole, self.tangents)
        metric = self._embedded(_exponential(logs))[:, ROWS, COLUMNS]
        return self._ground(metric)

    @cached_property
    def bare(self) -> Ground:
        """The sphere's own metric."""
        metric = self._embedded(np.broadcast_to(np.eye(2), (len(self.points), 2, 2)))[:, ROWS, COLUMNS]
        return self._ground(metric)

    def _ground(self, metric: Float[np.ndarray, "N 6"]) -> Ground:
        """The sphere with a metric, as kernels take it."""
        return Ground(self.points, np.array(self.topology.faces).ravel(), np.array(self.topology.twins), np.ascontiguousarray(metric))

    def _embedded(self, planar: Float[np.ndarray, "N 2 2"]) -> Float[np.ndarray, "N 3 3"]:
        """Matrices of the tangent planes as matrices of space."""
        return np.einsum("nai,nab,nbj->nij", self.tangents, planar, self.tangents)


def blended(one: Ground, other: Ground, share: float) -> Ground:
    """The metric between two: `share` of the other, the rest of the one."""
    return one._replace(metric=(1 - share) * one.metric + share * other.metric)


def _triangle_logarithms(points: Float[np.ndarray, "N 3"], mesh: Mesh) -> tuple[Float[np.ndarray, "M 9"], Float[np.ndarray, "M"]]:
    """Logarithm of each triangle's metric in its chord plane, and its weight: the geometric mean of both areas."""
    X = mesh.vertices * np.sqrt(4 * np.pi / mesh.area)
    below, above = _edge_pairs(points, mesh.faces), _edge_pairs(X, mesh.faces)
    first = below[:, 0] / np.linalg.norm(below[:, 0], axis=1, keepdims=True)
    normal = np.cross(below[:, 0], below[:, 1])
    second = np.cross(normal, first) / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    basis = np.stack([first, second], axis=1)
    inverse = np.linalg.inv(np.einsum("mai,mei->mae", basis, below))
    metric = np.einsum("mea,mei,mfi,mfb->mab", inverse, above, above, inverse)
    stretch, axes = np.linalg.eigh(metric)
    logs = np.einsum("mae,me,mbe->mab", axes, np.log(np.clip(stretch, *STRETCH_LIMITS)), axes)
    areas = np.linalg.norm(normal, axis=1) * np.linalg.norm(np.cross(above[:, 0], above[:, 1]), axis=1)
    return np.einsum("mai,mab,mbj->mij", basis, logs, basis).reshape(-1, 9), np.sqrt(np.maximum(areas, np.finfo(float).tiny))


def _edge_pairs(X: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 2 3"]:
    """The two edges from corner 0 of each face."""
    return np.stack([X[F[:, 1]] - X[F[:, 0]], X[F[:, 2]] - X[F[:, 0]]], axis=1)


def _exponential(logs: Float[np.ndarray, "N 2 2"]) -> Float[np.ndarray, "N 2 2"]:
    """exp of symmetric 2x2 matrices."""
    values, axes = np.linalg.eigh(logs)
    return np.einsum("nae,ne,nbe->nab", axes, np.exp(values), axes)


def empty_seats(face: Int[np.ndarray, "m"]) -> Seats:
    """Seats with a first guess of their faces."""
    m = len(face)
    return Seats(np.array(face), np.empty((m, 3)), np.empty((m, 6)), np.empty(m), np.empty(m))


def value(S: Float[np.ndarray, "n 3"], source: Source, ground: Ground, seats: Seats) -> float:
    """E; the seats follow S."""
    return sum(by_pieces(_value, len(source.F), S, source, ground, seats))


def derivatives(
    S: Float[np.ndarray, "n 3"], T: Float[np.ndarray, "n 2 3"], source: Source, ground: Ground, seats: Seats, project: bool
) -> tuple[Float[np.ndarray, "m 6"], Float[np.ndarray, "m 21"]]:
    """Gradient and lower triangle of the Hessian per triangle in the tangent frames T, of the majorant at the S of the last `value`."""
    laid = (S, T, np.empty((len(source.F), 6)), np.empty((len(source.F), 21)), project)
    by_pieces(_derivatives, len(source.F), laid, source, ground, seats)
    return laid[2], laid[3]


@inner_kernel
def robust(f, delta):
    """The robust psi(f) and psi'(f); below f = 1, where rounding and interpolation may lead, its tangent."""
    if delta == 0.0:
        return f, 1.0
    root = np.sqrt(max(f - 1, 0.0) + delta * delta)
    return root + min(f - 1, 0.0) / (2 * delta), 0.5 / root


@inner_kernel
def form(M, x, y, z):
    """The quadratic form (x, y, z) M (x, y, z) for the six entries M."""
    return M[0] * x * x + M[3] * y * y + M[5] * z * z + 2 * (M[1] * x * y + M[2] * x * z + M[4] * y * z)


@inner_kernel
def product(M, x, y, z):
    """The vector M (x, y, z)."""
    return M[0] * x + M[1] * y + M[2] * z, M[1] * x + M[3] * y + M[4] * z, M[2] * x + M[4] * y + M[5] * z


@inner_kernel
def under(ground, face, x, y, z):
    """Face of the target under (x, y, z), walking from `face`, and weights."""
    limit = int(WALK_FACTOR * np.sqrt(ground.corner.shape[0] / 3)) + 10
    found, u, v, w = pierced(ground.points, ground.corner, ground.twin, face, limit, face, x, y, z)
    if found >= 0:
        return found, u, v, w
    best = np.inf
    for h in range(ground.corner.shape[0]):  # a walk lost in rounding: a face of the nearest vertex
        p = ground.corner[h]
        away = (ground.points[p, 0] - x) ** 2 + (ground.points[p, 1] - y) ** 2 + (ground.points[p, 2] - z) ** 2
        if away < best:
            best, found = away, h
    corner = found % 3
    return found // 3, 1.0 if corner == 0 else 0.0, 1.0 if corner == 1 else 0.0, 1.0 if corner == 2 else 0.0


@inner_kernel
def area_factor(M):
    """The area factor m: the square root of the sum of the 2x2 minors of M."""
    return np.sqrt(max(M[0] * M[3] + M[0] * M[5] + M[3] * M[5] - M[1] * M[1] - M[2] * M[2] - M[4] * M[4], FLAT_ROOT**2))


@inner_kernel
def metric_under(ground, face, x, y, z, M):
    """The metric (6,) at a direction, into M; the face there, weights, m."""
    face, u, v, w = under(ground, face, x, y, z)
    a, b, c = ground.corner[3 * face], ground.corner[3 * face + 1], ground.corner[3 * face + 2]
    for e in range(6):
        M[e] = u * ground.metric[a, e] + v * ground.metric[b, e] + w * ground.metric[c, e]
    return face, u, v, w, area_factor(M)


@kernel
def _value(first, last, S, source, ground, seats):  # the sum over triangles first .. last - 1; their seats follow S (n, 3)
    total = 0.0
    for t in range(first, last):
        i, j, k = source.F[t, 0], source.F[t, 1], source.F[t, 2]
        D = determinant(S, i, j, k) * source.inverse[t]
        if D <= 0.0:
            return np.inf
        x, y, z = S[i, 0] + S[j, 0] + S[k, 0], S[i, 1] + S[j, 1] + S[k, 1], S[i, 2] + S[j, 2] + S[k, 2]
        s, M = 1 / np.sqrt(x * x + y * y + z * z), seats.metric[t]
        seats.face[t], seats.weights[t, 0], seats.weights[t, 1], seats.weights[t, 2], seats.root[t] = metric_under(
            ground, seats.face[t], x * s, y * s, z * s, M
        )
        D *= seats.root[t]
        n = source.k[t, 0] * form(M, S[j, 0] - S[k, 0], S[j, 1] - S[k, 1], S[j, 2] - S[k, 2])
        n += source.k[t, 1] * form(M, S[k, 0] - S[i, 0], S[k, 1] - S[i, 1], S[k, 2] - S[i, 2])
        n += source.k[t, 2] * form(M, S[i, 0] - S[j, 0], S[i, 1] - S[j, 1], S[i, 2] - S[j, 2])
        energy, slope = robust(0.25 * n * (1 + 1 / (D * D)), source.delta)
        total += source.weight[t] * energy
        seats.majorant[t] = source.weight[t] * slope
    return total


@kernel
def _derivatives(first, last, laid, source, ground, seats):  # laid: S (n, 3), T (n, 2, 3), into g (m, 6) and H (m, 21), project
    H, project = laid[3], laid[4]
    work = (np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(6), np.empty(6), np.empty((6, 3)))
    A, U = np.empty((6, 6)), np.empty((6, 6))
    for t in range(first, last):
        fn, fd, D = _triangle_terms(t, laid, source, seats, work, A)
        _add_force(t, (fn, fd, D), laid, source, ground, seats)
        if project:
            project_psd(A, U)
        for i in range(6):
            for j in range(i + 1):
                H[t, i * (i + 1) // 2 + j] = A[i, j]
    return 0.0


@inner_kernel
def _triangle_terms(t, laid, source, seats, work, H):  # row t of g, H (6, 6) lower triangle; f_n, f_D and D
    S, T, g = laid[0], laid[1], laid[2]
    gn, gd, e, tn, td, MT = work
    M, c, inverse = seats.metric[t], source.F[t], source.inverse[t] * seats.root[t]
    n, D = 0.0, determinant(S, c[0], c[1], c[2]) * inverse
    for i in range(3):
        y, z = c[(i + 1) % 3], c[(i + 2) % 3]
        for d in range(3):
            e[i, d] = S[z, d] - S[y, d]
            f, h = (d + 1) % 3, (d + 2) % 3  # x_y x (x_z - x_y)
            gd[i, d] = (S[y, f] * (S[z, h] - S[y, h]) - S[y, h] * (S[z, f] - S[y, f])) * inverse
        n += source.k[t, i] * form(M, e[i, 0], e[i, 1], e[i, 2])
    w, r = seats.majorant[t], 1 / D
    fn, fd = 0.25 * w * (1 + r * r), -0.5 * w * n * r * r * r
    fnd, fdd = -0.5 * w * r * r * r, 1.5 * w * n * r * r * r * r
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3  # x_i - x_j = -e_k, x_i - x_k = e_j
        kj, kk = 2 * source.k[t, j], 2 * source.k[t, k]
        gn[i, 0], gn[i, 1], gn[i, 2] = product(M, kj * e[j, 0] - kk * e[k, 0], kj * e[j, 1] - kk * e[k, 1], kj * e[j, 2] - kk * e[k, 2])
    for i in range(6):
        a, x = i // 2, T[c[i // 2], i % 2]
        tn[i] = gn[a, 0] * x[0] + gn[a, 1] * x[1] + gn[a, 2] * x[2]
        td[i] = gd[a, 0] * x[0] + gd[a, 1] * x[1] + gd[a, 2] * x[2]
        MT[i, 0], MT[i, 1], MT[i, 2] = product(M, x[0], x[1], x[2])
        g[t, i] = fn * tn[i] + fd * td[i]
        for j in range(i + 1):
            H[i, j] = fnd * (tn[i] * td[j] + td[i] * tn[j]) + fdd * td[i] * td[j]
    _add_second(c, (S, T, gn, gd, MT), source.k[t], (fn, fd, inverse), H)
    return fn, fd, D


@inner_kernel
def _add_second(c, tables, kt, factors, H):  # the second derivatives of n and D, and the curvature of the sphere
    S, T, gn, gd, MT = tables
    fn, fd, inverse = factors
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        bend, stiff, x, y, z = 0.0, 2 * fn * (kt[j] + kt[k]), c[i], c[j], c[k]
        for d in range(3):
            bend += (fn * gn[i, d] + fd * gd[i, d]) * S[x, d]
        for a in range(2):
            for b in range(a + 1):
                inner = T[x, a, 0] * MT[2 * i + b, 0] + T[x, a, 1] * MT[2 * i + b, 1] + T[x, a, 2] * MT[2 * i + b, 2]
                H[2 * i + a, 2 * i + b] += stiff * inner - (bend if a == b else 0.0)
        for row in range(2):
            for column in range(2):
                mixed = 0.0
                for d in range(3):
                    e, f = (d + 1) % 3, (d + 2) % 3
                    cross = T[y, column, e] * S[z, f] - T[y, column, f] * S[z, e]
                    mixed += T[x, row, d] * (fd * inverse * cross - 2 * fn * kt[k] * MT[2 * j + column, d])
                if j > i:
                    H[2 * j + column, 2 * i + row] += mixed
                else:
                    H[2 * i + row, 2 * j + column] += mixed


@inner_kernel
def _add_force(t, factors, laid, source, ground, seats):  # to row t of g: the change of M as the centroid moves
    S, T, g = laid[0], laid[1], laid[2]
    fn, fd, D = factors
    M, c, h = seats.metric[t], source.F[t], 3 * seats.face[t]
    scale = fd * D / (2 * seats.root[t] * seats.root[t])
    trace = M[0] + M[3] + M[5]
    px, py, pz = 0.0, 0.0, 0.0  # sum of z_k o_k
    qx, qy, qz = 0.0, 0.0, 0.0  # o
    zl = 0.0
    for k in range(3):
        N = ground.metric[ground.corner[h + k]]
        z = 0.0
        for i in range(3):
            a, b = c[(i + 1) % 3], c[(i + 2) % 3]
            z += fn * source.k[t, i] * form(N, S[a, 0] - S[b, 0], S[a, 1] - S[b, 1], S[a, 2] - S[b, 2])
        inner = M[0] * N[0] + M[3] * N[3] + M[5] * N[5] + 2 * (M[1] * N[1] + M[2] * N[2] + M[4] * N[4])
        z += scale * (trace * (N[0] + N[3] + N[5]) - inner)
        u, v = ground.points[ground.corner[h + (k + 1) % 3]], ground.points[ground.corner[h + (k + 2) % 3]]
        ox, oy, oz = u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]
        px, py, pz, qx, qy, qz = px + z * ox, py + z * oy, pz + z * oz, qx + ox, qy + oy, qz + oz
        zl += z * seats.weights[t, k]
    a, b, d = c[0], c[1], c[2]
    height = qx * (S[a, 0] + S[b, 0] + S[d, 0]) + qy * (S[a, 1] + S[b, 1] + S[d, 1]) + qz * (S[a, 2] + S[b, 2] + S[d, 2])
    px, py, pz = (px - zl * qx) / height, (py - zl * qy) / height, (pz - zl * qz) / height
    for i in range(6):
        x = T[c[i // 2], i % 2]
        g[t, i] += px * x[0] + py * x[1] + pz * x[2]
