"""The differential operators of a mesh, as sparse matrices.

`laplacian` is POSITIVE semi-definite (``x^T L x`` is the Dirichlet energy of x), `mass` is lumped, `gradient` is constant
per face, and ``gradient^T diag(areas) gradient = laplacian``. A face without area contributes nothing to any of them.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from morphlet.surface.mesh import Mesh

FLAT = 1e-14
"""A face whose area is below this share of its longest edge squared has no area: its angles are rounding errors."""


def laplacian(mesh: Mesh) -> sp.csr_matrix:
    """The cotangent Laplacian (n, n): off the diagonal -w_ij with w = (cot a + cot b) / 2, rows sum to zero.

    a and b are the angles opposite the edge ij; an edge at the boundary has one of them. The matrix depends on the shape of
    the faces only, not on their size. Divide by `mass` for the pointwise operator.

    Returns
    -------
    matrix
        Symmetric and positive semi-definite; constants are in its kernel.

    Notes
    -----
    O(n).

    References
    ----------
    Pinkall and Polthier, Computing discrete minimal surfaces and their conjugates, Experimental Mathematics 2, 1993.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> laplacian(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])).toarray()
    array([[ 1. , -0.5, -0.5],
           [-0.5,  0.5,  0. ],
           [-0.5,  0. ,  0.5]])
    """
    half = 0.5 * _cotangents(mesh)
    i, j = np.roll(mesh.faces, -1, axis=1).ravel(), np.roll(mesh.faces, -2, axis=1).ravel()
    w = half.ravel()
    values = np.concatenate([w, w, -w, -w])
    rows, columns = np.concatenate([i, j, i, j]), np.concatenate([i, j, j, i])
    matrix = sp.csr_matrix((values, (rows, columns)), shape=(mesh.n_vertices, mesh.n_vertices))
    matrix.eliminate_zeros()
    return matrix


def mass(mesh: Mesh) -> sp.dia_matrix:
    """The lumped mass matrix (n, n): a third of the area around each vertex, on the diagonal.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> mass(Mesh([[0, 0, 0], [3, 0, 0], [0, 2, 0]], [[0, 1, 2]])).diagonal()
    array([1., 1., 1.])
    """
    return sp.dia_matrix((mesh.vertex_areas[None, :], [0]), shape=(mesh.n_vertices, mesh.n_vertices))


def gradient(mesh: Mesh) -> sp.csr_matrix:
    """The gradient (3m, n) of functions that are linear on each face: row 3 f + c is its component c on face f.

    Notes
    -----
    The gradient of the hat function of corner i is ``n x e_i / (2 A)``, e_i the opposite edge, counter-clockwise. O(n).

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> gradient(triangle) @ [0.0, 2.0, 1.0]
    array([1., 1., 0.])
    """
    edges = _opposite_edges(mesh)
    turned = np.cross(mesh.face_normals[:, None, :], edges)
    hats = turned * (0.5 * _inverse_areas(mesh))[:, None, None]
    rows = np.repeat(np.arange(3 * mesh.n_faces), 3)
    columns = np.repeat(mesh.faces, 3, axis=0).ravel()
    return sp.csr_matrix((hats.transpose(0, 2, 1).ravel(), (rows, columns)), shape=(3 * mesh.n_faces, mesh.n_vertices))


def _opposite_edges(mesh: Mesh) -> Float[np.ndarray, "m 3 3"]:
    """Edge vector opposite each corner, counter-clockwise."""
    corners = mesh.vertices[mesh.faces]
    return np.roll(corners, -2, axis=1) - np.roll(corners, -1, axis=1)


def _cotangents(mesh: Mesh) -> Float[np.ndarray, "m 3"]:
    """Cotangent of the angle at each corner; zero in a face without area."""
    e = _opposite_edges(mesh)
    dots = -np.einsum("fcd,fcd->fc", np.roll(e, -1, axis=1), np.roll(e, -2, axis=1))
    return dots * (0.5 * _inverse_areas(mesh))[:, None]


def _inverse_areas(mesh: Mesh) -> Float[np.ndarray, "m"]:
    """1 / area of each face; zero where it has none."""
    longest = np.max(np.sum(_opposite_edges(mesh) ** 2, axis=2), axis=1)
    solid = mesh.face_areas > FLAT * longest
    return np.divide(1.0, mesh.face_areas, out=np.zeros(mesh.n_faces), where=solid)
