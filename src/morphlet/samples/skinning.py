"""Flesh that follows bones: smooth weights, a change of proportions, and a pose by blended dual quaternions.

References
----------
.. [1] L. Kavan, S. Collins, J. Zara, C. O'Sullivan, "Skinning with Dual Quaternions", I3D 2007.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from morphlet.samples.anatomy import BONES, Skeleton
from morphlet.samples.implicit import Solid
from morphlet.surface.mesh import Mesh

AVERAGING_SHARE = 3e-3
"""Rounds of averaging per vertex: their width, in units of the body, is then the same at every resolution."""


def bone_weights(mesh: Mesh, body: Solid, owners: tuple[str, ...]) -> Float[np.ndarray, "n b"]:
    """Share of each bone in each vertex: the bone of the nearest part, averaged along the surface."""
    distance = [Solid(row[None, :]).field(mesh.vertices)[:, 0] for row in body.parts]
    bone = np.array([BONES.index(name) for name in owners])[np.argmin(distance, axis=0)]
    weights = np.eye(len(BONES))[bone]
    around = mesh.topology.adjacency + sp.identity(mesh.n_vertices, format="csr")
    average = sp.diags(1.0 / np.diff(around.indptr)) @ around
    for _ in range(max(int(AVERAGING_SHARE * mesh.n_vertices), 1)):
        weights = average @ weights
    return weights


def reproportioned(
    vertices: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n b"], old: Skeleton, new: Skeleton
) -> Float[np.ndarray, "n 3"]:
    """Vertices after each bone has been laid on its new place, stretched along itself and across by the two ratios."""
    matrices = np.array([_stretch(*rows) for rows in zip(old.ends - old.starts, new.ends - new.starts, new.radii / old.radii, strict=True)])
    shifts = new.starts - np.einsum("bij,bj->bi", matrices, old.starts)
    return np.einsum("nb,bij,nj->ni", weights, matrices, vertices, optimize=True) + weights @ shifts


def reposed(
    vertices: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "n b"], turns: Rotation, shifts: Float[np.ndarray, "b 3"]
) -> Float[np.ndarray, "n 3"]:
    """Vertices moved by the blended rigid motions of their bones."""
    real = turns.as_quat()
    dual = 0.5 * _product(np.concatenate([shifts, np.zeros((len(shifts), 1))], axis=1), real)
    lead = np.argmax(weights, axis=1)
    signed = weights * np.where(real[lead] @ real.T < 0, -1.0, 1.0)
    turn, move = signed @ real, signed @ dual
    size = np.linalg.norm(turn, axis=1, keepdims=True)
    turn, move = turn / size, move / size
    return Rotation.from_quat(turn).apply(np.array(vertices)) + 2 * _product(move, turn * (-1, -1, -1, 1))[:, :3]


def _stretch(old: Float[np.ndarray, "3"], new: Float[np.ndarray, "3"], across: float) -> Float[np.ndarray, "3 3"]:
    """The map that takes one bone to the other by the shortest turn, and scales lengths across it."""
    was, now = np.linalg.norm(old), np.linalg.norm(new)
    axis = np.cross(old, new)
    sine, cosine = np.linalg.norm(axis) / (was * now), np.dot(old, new) / (was * now)
    turn = Rotation.from_rotvec(axis / max(sine * was * now, np.finfo(float).tiny) * np.arctan2(sine, cosine))
    along = np.outer(old, old) / was**2
    return turn.as_matrix() @ (across * (np.eye(3) - along) + now / was * along)


def _product(p: Float[np.ndarray, "k 4"], q: Float[np.ndarray, "k 4"]) -> Float[np.ndarray, "k 4"]:
    """Product of quaternions, scalar last."""
    vector = p[:, 3:] * q[:, :3] + q[:, 3:] * p[:, :3] + np.cross(p[:, :3], q[:, :3])
    scalar = p[:, 3:] * q[:, 3:] - np.sum(p[:, :3] * q[:, :3], axis=1, keepdims=True)
    return np.concatenate([vector, scalar], axis=1)
