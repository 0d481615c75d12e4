"""The unit sphere and its rotations, as arrays: exponential and logarithm, and points spread evenly over them.

Points are unit vectors (k, 3); tangents at a point are vectors (k, 3) orthogonal to it; angles are in radians.
Rotations are matrices that act on column vectors: row points turn by `points @ R.T`.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from morphlet.errors import InputError

GOLDEN_ANGLE = np.pi * (3 - np.sqrt(5))
"""Turn between consecutive points of the Fibonacci spiral: the golden section of a full turn."""
SUPER_FIBONACCI = (np.sqrt(2), 1.533751168755204288118041413)
"""phi and psi of Alexa's spiral (psi^4 = psi + 4): the pair with the least discrepancy that he found."""
SMALL_ANGLE = 1e-12
"""Below this angle sin(a)/a is 1 in double precision, and directions between points are not defined."""


def exponential(points: Float[np.ndarray, "k 3"], tangents: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """Where great circles lead that leave the points along the tangents, after the length of the tangents.

    Examples
    --------
    >>> import numpy as np
    >>> exponential(np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, np.pi / 2, 0.0]])).round(12)
    array([[0., 1., 0.]])
    """
    angle = np.linalg.norm(tangents, axis=1, keepdims=True)
    moved = np.cos(angle) * points + np.sinc(angle / np.pi) * tangents
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def logarithm(points: Float[np.ndarray, "k 3"], others: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """The tangents at the points that lead to the others along the shorter great circle.

    Opposite points have no shorter great circle: their logarithm is zero.

    Examples
    --------
    >>> import numpy as np
    >>> logarithm(np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])).round(6)
    array([[0.      , 1.570796, 0.      ]])
    """
    sideways = others - np.sum(points * others, axis=1, keepdims=True) * points
    sine = np.linalg.norm(sideways, axis=1, keepdims=True)
    angle = np.arctan2(sine, np.sum(points * others, axis=1, keepdims=True))
    return sideways * np.divide(angle, sine, out=np.zeros_like(sine), where=sine > SMALL_ANGLE)


def fibonacci(count: int) -> Float[np.ndarray, "k 3"]:
    """Points of a spiral from the north pole to the south pole, each with the same share of the area.

    Raises
    ------
    InputError
        If `count` is not positive.

    Examples
    --------
    >>> fibonacci(1000).mean(axis=0).round(3) + 0.0
    array([0., 0., 0.])
    """
    i = np.arange(_positive(count)) + 0.5
    z = 1 - 2 * i / count
    ring, turn = np.sqrt(1 - z * z), GOLDEN_ANGLE * i
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)


def icosphere(subdivisions: int) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Points and outward faces of an icosahedron whose faces are split in four, `subdivisions` times: 10 4^s + 2 points.

    Raises
    ------
    InputError
        If `subdivisions` is negative.

    Examples
    --------
    >>> points, faces = icosphere(2)
    >>> len(points), len(faces)
    (162, 320)
    """
    if subdivisions < 0:
        raise InputError("subdivisions >= 0", str(subdivisions), "pass 0 for the icosahedron")
    points, faces = _icosahedron()
    for _ in range(subdivisions):
        points, faces = _split(points, faces)
    return points, faces


def rotations(count: int) -> Float[np.ndarray, "k 3 3"]:
    """Rotations spread evenly over SO(3), by the super-Fibonacci spiral; the same ones for the same count.

    Raises
    ------
    InputError
        If `count` is not positive.

    References
    ----------
    Alexa, Super-Fibonacci spirals: fast, low-discrepancy sampling of SO(3), CVPR 2022.

    Examples
    --------
    >>> rotations(2000).shape
    (2000, 3, 3)
    """
    s = np.arange(_positive(count)) + 0.5
    phi, psi = SUPER_FIBONACCI
    inner, outer = np.sqrt(s / count), np.sqrt(1 - s / count)
    alpha, beta = 2 * np.pi * s / phi, 2 * np.pi * s / psi
    quaternions = np.stack([inner * np.sin(alpha), inner * np.cos(alpha), outer * np.sin(beta), outer * np.cos(beta)], axis=1)
    return Rotation.from_quat(quaternions).as_matrix()


def rotations_about(vectors: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3 3"]:
    """The rotation about each vector by its length (exponential of so(3)).

    Examples
    --------
    >>> import numpy as np
    >>> rotations_about(np.array([[0.0, 0.0, np.pi / 2]])).round(12)[0, 1]
    array([1., 0., 0.])
    """
    return Rotation.from_rotvec(vectors).as_matrix()


def rotation_angles(first: Float[np.ndarray, "*#k 3 3"], second: Float[np.ndarray, "*#k 3 3"]) -> Float[np.ndarray, "*k"]:
    """Angle of the rotation from the first to the second, in [0, pi].

    Examples
    --------
    >>> import numpy as np
    >>> float(rotation_angles(np.eye(3), np.diag([1.0, -1.0, -1.0])).round(6))
    3.141593
    """
    chord = np.linalg.norm(first - second, axis=(-2, -1)) / np.sqrt(8)
    return 2 * np.arcsin(np.clip(chord, 0, 1))


def _positive(count: int) -> int:
    """The count, if it is one."""
    if count < 1:
        raise InputError("a positive count", str(count), "ask for at least one")
    return count


def _icosahedron() -> tuple[np.ndarray, np.ndarray]:
    """Two poles between two rings of five points."""
    turn = 2 * np.pi * np.arange(5) / 5
    height, radius = 1 / np.sqrt(5), 2 / np.sqrt(5)
    upper = np.stack([radius * np.cos(turn), radius * np.sin(turn), np.full(5, height)], axis=1)
    points = np.vstack([[[0, 0, 1]], upper, -upper, [[0, 0, -1]]])
    i, j = np.arange(5), (np.arange(5) + 1) % 5
    below = 6 + (i + 3) % 5  # the lower ring's point between i and j
    north, south = np.zeros(5, np.int64), np.full(5, 11)
    after = 6 + (j + 3) % 5
    rows = [[north, 1 + i, 1 + j], [1 + i, below, 1 + j], [1 + j, below, after], [below, south, after]]
    return points, np.concatenate([np.stack(row, axis=1) for row in rows])


def _split(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Each face in four, the new points pushed out to the sphere."""
    pairs = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, place = np.unique(pairs, axis=0, return_inverse=True)
    middle = points[edges].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    a, b, c = faces.T
    ab, bc, ca = (len(points) + place.reshape(-1, 3)).T
    rows = [[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]
    return np.vstack([points, middle]), np.concatenate([np.stack(row, axis=1) for row in rows])
