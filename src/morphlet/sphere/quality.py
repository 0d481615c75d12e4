"""How good a spherical mesh is: inverted faces, degree, distortion of shape, angle and area.

J maps a surface triangle (surface scaled to area 4 pi) to its chord triangle, with singular values s1 >= s2:
iso = max(s1, 1 / s2), symmetric Dirichlet = |J|^2 (1 + 1 / det^2) / 4, both 1 at an isometry.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.numerics.predicates import determinant_signs
from morphlet.surface.mesh import Mesh

DEGREE_TOLERANCE = 1e-6
"""The degree is an integer: floating point is enough to tell which."""
DEGENERATE_HEIGHT = 1e-9
"""Faces whose height is below this share of their first edge have no shape to compare with."""


@dataclass(frozen=True)
class Certificate:
    """Proof that the radial map of a spherical mesh is a homeomorphism, or what is wrong with it.

    All faces positive AND degree 1 holds exactly for one-to-one maps; positive faces alone admit branched covers.
    """

    negative: int
    zero: int
    uncertain: int
    degree: float

    @property
    def inverted(self) -> int:
        """Faces that are not strictly positive."""
        return self.negative + self.zero

    @property
    def holds(self) -> bool:
        """Whether the map is one-to-one."""
        return self.inverted == 0 and abs(self.degree - 1) < DEGREE_TOLERANCE


@dataclass(frozen=True)
class Quality:
    """Distortion figures of a map; means, percentiles and maxima over real, non-degenerate faces."""

    inverted: int
    degree: float
    iso_mean: float
    iso_p99: float
    iso_max: float
    angle_mean_deg: float
    area_log_std: float
    symmetric_dirichlet: float
    degenerate: int


def certificate(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Certificate:
    """Exact signs of all faces of a closed spherical mesh, and its degree (sum of solid angles over 4 pi).

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.sphere.quality import certificate
    >>> octahedron = [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]]
    >>> points = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    >>> certificate(points, np.array(octahedron)).holds
    True
    """
    corners = [points[faces[:, k]] for k in range(3)]
    signs, uncertain = determinant_signs(*corners)
    degree = float(solid_angles(points, faces).sum() / (4 * np.pi))
    return Certificate(int(np.sum(signs < 0)), int(np.sum(signs == 0)), uncertain, degree)


def solid_angles(points: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m"]:
    """Signed solid angle of each face, in steradians (van Oosterom & Strackee 1983)."""
    a, b, c = (points[faces[:, k]] for k in range(3))
    volume = np.sum(a * np.cross(b - a, c - a), axis=1)
    return 2 * np.arctan2(volume, 1 + np.sum(a * b, axis=1) + np.sum(b * c, axis=1) + np.sum(c * a, axis=1))


def singular_values(
    mesh: Mesh, points: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Bool[np.ndarray, "m"]]:
    """s1 >= s2 of the map from each face of a mesh to the triangle of its points, and which faces have a shape.

    The mesh is scaled to area 4 pi first. s2 is negative nowhere: orientation is the certificate's business.
    """
    l, x, y = _flattened(mesh.vertices * (np.sqrt(4 * np.pi) / np.sqrt(max(mesh.area, np.finfo(float).tiny))), mesh.faces)
    L, X, Y = _flattened(points, mesh.faces)
    shaped = (y > DEGENERATE_HEIGHT * l) & (l > 0) & (Y > 0) & (L > 0)
    l, x, y = np.where(shaped, l, 1.0), np.where(shaped, x, 0.0), np.where(shaped, y, 1.0)
    stretch, shear, height = L / l, (X - x * L / l) / y, Y / y
    square, det = stretch**2 + shear**2 + height**2, stretch * height
    larger = np.sqrt((square + np.sqrt(np.maximum(square**2 - 4 * det**2, 0))) / 2)
    return larger, np.divide(det, larger, out=np.zeros_like(det), where=larger > 0), shaped


def isometric_distortion(mesh: Mesh, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m"]:
    """max(s1, 1 / s2) of every face; NaN where a face has no shape."""
    larger, smaller, shaped = singular_values(mesh, points)
    with np.errstate(divide="ignore"):
        return np.where(shaped, np.maximum(larger, 1 / smaller), np.nan)


def measure(mesh: Mesh, points: Float[np.ndarray, "n 3"], found: Certificate) -> Quality:
    """Distortion figures of the real faces of a mesh, beside the certificate of the closed one."""
    larger, smaller, shaped = singular_values(mesh, points)
    if not shaped.any():
        nothing = float("nan")
        return Quality(found.inverted, found.degree, nothing, nothing, nothing, nothing, nothing, nothing, mesh.n_faces)
    s1, s2 = larger[shaped], np.maximum(smaller[shaped], np.finfo(float).tiny)
    iso = np.maximum(s1, 1 / s2)
    weight = mesh.face_areas[shaped] / max(mesh.face_areas[shaped].sum(), np.finfo(float).tiny)
    dirichlet = (s1**2 + s2**2) * (1 + 1 / (s1 * s2) ** 2) / 4
    area_share = 4 * np.pi * mesh.face_areas[shaped] / mesh.area
    angles = np.maximum(solid_angles(points, mesh.faces[shaped]), np.finfo(float).tiny)
    log_ratio = np.log(angles / np.maximum(area_share, np.finfo(float).tiny))
    turned = np.abs(_corner_angles(mesh.vertices, mesh.faces) - _corner_angles(points, mesh.faces))[shaped]
    spread = float(np.sqrt(np.sum(weight * (log_ratio - np.sum(weight * log_ratio)) ** 2)))
    return Quality(
        inverted=found.inverted, degree=found.degree, degenerate=int(np.sum(~shaped)), area_log_std=spread,
        iso_mean=float(iso.mean()), iso_p99=float(np.percentile(iso, 99)), iso_max=float(iso.max()),
        angle_mean_deg=float(np.degrees(turned.mean())), symmetric_dirichlet=float(np.sum(weight * dirichlet)),
    )  # fmt: skip


def _flattened(
    X: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Each triangle in its plane, as (0, 0), (l, 0), (x, y)."""
    e, g = X[F[:, 1]] - X[F[:, 0]], X[F[:, 2]] - X[F[:, 0]]
    length = np.linalg.norm(e, axis=1)
    safe = np.where(length > 0, length, 1.0)
    return length, np.sum(e * g, axis=1) / safe, np.linalg.norm(np.cross(e, g), axis=1) / safe


def _corner_angles(X: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Angle at each corner, in radians."""
    angles = []
    for i in range(3):
        u, v = X[F[:, (i + 1) % 3]] - X[F[:, i]], X[F[:, (i + 2) % 3]] - X[F[:, i]]
        angles.append(np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), np.sum(u * v, axis=1)))
    return np.stack(angles, axis=1)
