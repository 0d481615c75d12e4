"""The place of a surface nearest to a point of space."""

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import MeshError
from morphlet.surface.mesh import Mesh
from morphlet.surface.points import SurfacePoints


def nearest(mesh: Mesh, positions: Float[np.ndarray, "k 3"]) -> SurfacePoints:
    """The nearest place on `mesh` to each position.

    Parameters
    ----------
    mesh
        Any mesh with at least one face; faces without area are met as the segments or points they are.
    positions
        Points of space, in mesh units.

    Returns
    -------
    SurfacePoints
        One place per position.

    Raises
    ------
    MeshError
        If the mesh has no faces.

    Notes
    -----
    O((m + k) log m): a bounding-box tree over the faces, built at each call.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.nearest import nearest
    >>> triangle = Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [[0, 1, 2]])
    >>> nearest(triangle, [[1, 1, 7], [-5, -5, 0]]).positions(triangle)
    array([[1., 1., 0.],
           [0., 0., 0.]])
    """
    points = _arrays.real(positions, "positions", (None, 3))
    if not mesh.n_faces:
        raise MeshError("a mesh with faces", "none", "pass a mesh that has a surface")
    if not len(points):
        return SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3)))
    import igl

    _, face, _ = igl.point_mesh_squared_distance(np.array(points), np.array(mesh.vertices), np.array(mesh.faces))
    return SurfacePoints(face.astype(np.int64), nearest_weights(points, mesh.vertices[mesh.faces[face]]))


def nearest_weights(points: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 3"]:
    """Weights of the nearest place of triangle i to point i: the best of the inside and the three sides."""
    candidates = np.stack([_inside(points, corners), *(_side(points, corners, c) for c in range(3))], axis=1)
    distance = np.linalg.norm(np.einsum("ksc,kcd->ksd", candidates, corners) - points[:, None], axis=2)
    return candidates[np.arange(len(points)), np.argmin(distance, axis=1)]


def _inside(points: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 3"]:
    """Weights of the foot of the perpendicular; those of corner 0 where it falls outside or there is no plane."""
    u, v, p = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], points - corners[:, 0]
    normal = np.cross(u, v)
    square = np.einsum("ij,ij->i", normal, normal)
    beta, gamma = np.einsum("ij,ij->i", np.cross(p, v), normal), np.einsum("ij,ij->i", np.cross(u, p), normal)
    area = np.where(square > 0, square, 1.0)
    weights = np.stack([1 - (beta + gamma) / area, beta / area, gamma / area], axis=1)
    inside = (square > 0) & (weights.min(axis=1) >= 0)
    return np.where(inside[:, None], weights, np.array([1.0, 0.0, 0.0]))


def _side(points: Float[np.ndarray, "k 3"], corners: Float[np.ndarray, "k 3 3"], c: int) -> Float[np.ndarray, "k 3"]:
    """Weights of the nearest place on the side from corner c to the next."""
    start, along = corners[:, c], corners[:, (c + 1) % 3] - corners[:, c]
    square = np.einsum("ij,ij->i", along, along)
    t = np.einsum("ij,ij->i", points - start, along) / np.where(square > 0, square, 1.0)
    t = np.clip(t, 0.0, 1.0)
    weights = np.zeros_like(points)
    weights[:, c], weights[:, (c + 1) % 3] = 1 - t, t
    return weights
