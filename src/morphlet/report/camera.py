"""From where a mesh is looked at.

A `Camera` is a parallel projection: right-handed `axes` (right, up, toward the eye), the point in the middle of the picture and
half the width and height that must be visible. Models are taken to stand on their feet with y or z up and to face +z (y up) or
-y (z up), as most files do.
"""

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull, QhullError

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh

Up = Literal["auto", "x", "y", "z"]
FRONTS = {"x": (0.0, 0.0, 1.0), "y": (0.0, 0.0, 1.0), "z": (0.0, -1.0, 0.0)}
"""The direction a model faces, for each axis that may be up: the habit of modelling programs."""
SIDE_SHARE = 0.6
"""How much the side counts against the front where the sign of a direction is chosen: less than 1, so that front wins."""
AZIMUTH = np.radians(32.0)
"""A three-quarter view: turned this far from the side view towards the front."""
ELEVATION = np.radians(14.0)
"""The eye is slightly above the horizon, so that the far legs of an animal show beside the near ones."""
ROUND = 1.15
"""Two horizontal spreads whose ratio is below this have no longest direction: the side is then taken from the axes."""
FOOT = 0.03
"""The lowest part of a model that counts as touching the ground, as a share of its height."""
STANDS = 1.5
"""z is taken as up only if the ground under z is this many times larger than under y, each as a share of the model's shadow."""
GROUND = 0.05
"""Less ground than this share of the shadow is no stand: a mask lying on its rim, a horse rearing."""
ORTHONORMAL = 1e-9
"""Rounding allowed in a camera's axes."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A parallel projection.

    Parameters
    ----------
    axes
        Unit vectors to the right, up, and toward the eye: a rotation.
    centre
        The point shown in the middle of the picture, in mesh units.
    extent
        Half the width and half the height that must be visible, in mesh units.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.report.camera import Camera
    >>> Camera(np.eye(3), [1, 0, 0], [2, 1]).project(np.array([[1.0, 2.0, 3.0]]))
    array([[0., 2., 3.]])
    """

    axes: Float[np.ndarray, "3 3"]
    centre: Float[np.ndarray, "3"]
    extent: Float[np.ndarray, "2"]

    def __post_init__(self) -> None:
        axes = _arrays.real(self.axes, "axes", (3, 3))
        error = float(np.abs(axes @ axes.T - np.eye(3)).max())
        if error > ORTHONORMAL or np.linalg.det(axes) < 0:
            raise InputError("right-handed orthonormal axes", f"rows that miss it by {error:.2g}", "take the axes of view(mesh)")
        object.__setattr__(self, "axes", axes)
        object.__setattr__(self, "centre", _arrays.real(self.centre, "centre", (3,)))
        object.__setattr__(self, "extent", _arrays.real(self.extent, "extent", (2,)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Camera, (np.array(self.axes), np.array(self.centre), np.array(self.extent))

    def project(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
        """Points as seen: to the right, up, toward the eye, from the centre, in mesh units."""
        return (points - self.centre) @ self.axes.T

    def framed(self, mesh: Mesh) -> "Camera":
        """The same direction of view, with all faces of this mesh tightly in the picture."""
        seen = mesh.vertices[mesh.topology.referenced] @ self.axes.T
        if not len(seen):
            return self
        low, high = seen.min(axis=0), seen.max(axis=0)
        return replace(self, centre=(low + high) / 2 @ self.axes, extent=(high - low)[:2] / 2)


def view(mesh: Mesh, up: Up = "auto") -> Camera:
    """A three-quarter view of a mesh, tightly framed: its longest horizontal extent lies across the picture.

    Parameters
    ----------
    mesh
        The mesh to look at.
    up
        The axis that points up in the picture; `auto` takes z where the model clearly stands better on it, else y.

    Returns
    -------
    Camera
        A camera that shows the whole mesh.

    Notes
    -----
    O(n log n), for two convex hulls.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.report.camera import view
    >>> float(view(Mesh([[0, 0, 0], [4, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "y").axes[1, 1].round(2))
    0.97
    """
    name = _standing(mesh) if up == "auto" else up
    upward, front = np.eye(3)["xyz".index(name)], np.array(FRONTS[name])
    across = _across(mesh, upward, front)
    side = _towards(np.cross(across, upward), _facing(upward, front))
    eye = np.cos(AZIMUTH) * side + np.sin(AZIMUTH) * across
    right = np.cross(upward, eye)
    toward = np.cos(ELEVATION) * eye + np.sin(ELEVATION) * upward
    return Camera(np.stack([right, np.cross(toward, right), toward]), np.zeros(3), np.ones(2)).framed(mesh)


def _facing(upward: Float[np.ndarray, "3"], front: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The horizontal direction towards which signs are chosen: to the front, and less so to the model's left."""
    return front + SIDE_SHARE * np.cross(upward, front)


def _across(mesh: Mesh, upward: Float[np.ndarray, "3"], front: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The horizontal direction of the model's longest spread, pointing towards its front where it can."""
    side = np.cross(upward, front)
    weight = mesh.vertex_areas[:, None] / max(mesh.area, np.finfo(float).tiny)
    flat = (mesh.vertices - (weight * mesh.vertices).sum(axis=0)) @ np.stack([side, front]).T
    spread, directions = np.linalg.eigh(flat.T @ (weight * flat))
    if np.sqrt(spread[1]) <= ROUND * np.sqrt(max(spread[0], 0.0)):
        return side
    return _towards(directions[:, 1] @ np.stack([side, front]), _facing(upward, front))


def _towards(direction: Float[np.ndarray, "3"], reference: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """The direction or its opposite, whichever is nearer to the reference."""
    return direction if direction @ reference >= 0 else -direction


def _standing(mesh: Mesh) -> Literal["y", "z"]:
    """The axis on which the model stands: the one under which its feet span the larger share of its shadow; y if unclear."""
    used = mesh.vertices[mesh.topology.referenced]
    return "z" if len(used) and _ground(used, 2) > max(STANDS * _ground(used, 1), GROUND) else "y"


def _ground(points: Float[np.ndarray, "k 3"], axis: int) -> float:
    """Area spanned by the lowest points along an axis, as a share of the area of all points' shadow."""
    height = points[:, axis]
    low = height <= height.min() + FOOT * np.ptp(height)
    shadow = np.delete(points, axis, axis=1)
    return _hull_area(shadow[low]) / max(_hull_area(shadow), np.finfo(float).tiny)


def _hull_area(points: Float[np.ndarray, "k 2"]) -> float:
    """Area of the convex hull of points of the plane; 0 where they span none."""
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0
