"""The best rotation between two clouds of paired points.

Rotations are (3, 3) matrices R with det R = +1 that act on column vectors: row points turn by `points @ R.T`.
A reflection is never returned, however much better it would fit: it would turn every triangle inside out.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError

UNIQUE_TOLERANCE = 1e-9
"""Share of the largest singular value below which the sum of the two others counts as zero (rounding of the covariance)."""


@dataclass(frozen=True, eq=False)
class RigidMotion:
    """A rotation, then a translation.

    Parameters
    ----------
    rotation
        Rotation matrix, det = +1.
    translation
        In the unit of the points.

    Examples
    --------
    >>> import numpy as np
    >>> RigidMotion(np.eye(3), np.array([0.0, 0.0, 2.0]))(np.array([[1.0, 0.0, 0.0]]))
    array([[1., 0., 2.]])
    """

    rotation: Float[np.ndarray, "3 3"]
    translation: Float[np.ndarray, "3"]

    def __call__(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
        """The moved points."""
        return points @ self.rotation.T + self.translation


def kabsch(
    source: Float[np.ndarray, "k 3"], target: Float[np.ndarray, "k 3"], weight: Float[np.ndarray, "k"] | None = None
) -> Float[np.ndarray, "3 3"]:
    """The rotation about the origin that brings the source points closest to the target points.

    Minimises ``sum_j w_j |R a_j - b_j|^2`` over the rotations (Eq. 7 of the paper, for two meshes).

    Parameters
    ----------
    source, target
        Paired points a_j and b_j.
    weight
        Non-negative importance w_j of each pair; 1 if left out.

    Returns
    -------
    rotation
        Matrix R with det R = +1.

    Raises
    ------
    InputError
        If no single rotation is best: fewer than two pairs in non-parallel directions, or a cloud that fits a reflection
        in several ways.

    Notes
    -----
    ``sum_j w_j b_j a_j^T = U S V^T`` gives ``R = U diag(1, 1, det(U V^T)) V^T``; it is unique when ``s_2 + det(U V^T) s_3 > 0``.
    Costs O(k).

    References
    ----------
    Kabsch, A solution for the best rotation to relate two sets of vectors, Acta Crystallographica A32, 1976.

    Examples
    --------
    >>> import numpy as np
    >>> kabsch([[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [-1, 0, 0]]).round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    a, b, w = _pairs(source, target, weight)
    u, s, vt = np.linalg.svd((_scaled(b) * _scaled(w)[:, None]).T @ _scaled(a))
    sign = 1.0 if np.linalg.det(u @ vt) > 0 else -1.0
    if s[1] + sign * s[2] <= UNIQUE_TOLERANCE * s[0] or s[0] == 0:
        raise InputError(
            "at least two pairs in non-parallel directions, so that one rotation is best",
            f"{len(a)} pairs with singular values {s[0]:.3g}, {s[1]:.3g}, {s[2]:.3g} and orientation {sign:+.0f}",
            "add pairs that are spread out",
        )
    return (u * [1.0, 1.0, sign]) @ vt


def rigid(source: Float[np.ndarray, "k 3"], target: Float[np.ndarray, "k 3"], weight: Float[np.ndarray, "k"] | None = None) -> RigidMotion:
    """The rotation and translation that bring the source points closest to the target points.

    Parameters
    ----------
    source, target
        Paired points.
    weight
        Non-negative importance of each pair; 1 if left out.

    Returns
    -------
    motion
        Callable on points; its rotation has det = +1.

    Raises
    ------
    InputError
        If no single rotation is best (points on one line, or fewer than three pairs).

    Examples
    --------
    >>> points = [[0, 0, 0], [1, 0, 0], [0, 2, 0]]
    >>> rigid(points, [[5, 0, 0], [6, 0, 0], [5, 2, 0]]).translation.round(12) + 0.0
    array([5., 0., 0.])
    """
    a, b, w = _pairs(source, target, weight)
    centre_a, centre_b = (np.average(x, axis=0, weights=w) for x in (a, b))
    rotation = kabsch(a - centre_a, b - centre_b, w)
    return RigidMotion(rotation, centre_b - rotation @ centre_a)


def _pairs(source: np.ndarray, target: np.ndarray, weight: np.ndarray | None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The three arguments, checked."""
    a = _arrays.real(source, "source", (None, 3))
    b = _arrays.real(target, "target", (len(a), 3))
    w = _arrays.real(np.ones(len(a)) if weight is None else weight, "weight", (len(a),))
    if np.any(w < 0) or not np.any(w > 0):
        raise InputError("non-negative weights, one of them positive", f"{int(np.sum(w < 0))} negative of {len(w)}", "drop these pairs")
    return a, b, w


def _scaled(values: np.ndarray) -> np.ndarray:
    """Values of size one, which changes no rotation and keeps products in range."""
    size = float(np.abs(values).max(initial=0.0))
    return values / size if size > 0 else values
