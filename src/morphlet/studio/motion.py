"""How a handle is moved: scaled, turned and shifted, on one side of a plane or on both."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet.numerics.rotations import exponential

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)
ONE: Vector = (1.0, 1.0, 1.0)
AXES: dict[str, Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
FULL = 2 * math.pi
STEP = math.pi / 2
"""Radians that a handle may turn from one place of its way to the next, so that the turns can be told from the places."""


@dataclass(frozen=True)
class Motion:
    """The way of a handle from rest: scaled about its middle, turned about it, then shifted.

    Parameters
    ----------
    translate
        In mesh units.
    turn
        Rotation vector: radians times axis, more than one turn allowed.
    scale
        Factors along x, y and z.
    """

    translate: Vector = ZERO
    turn: Vector = ZERO
    scale: Vector = ONE

    @staticmethod
    def of(told: Mapping[str, Any], before: "Motion") -> "Motion":
        """The motion that a message tells, its turn counted on from the last one's.

        Examples
        --------
        >>> from morphlet.studio.motion import Motion
        >>> half_back = {"translate": (0, 0, 0), "rotate": (0, 0, -0.6, 0.8), "scale": (1, 1, 1)}
        >>> [round(Motion.of(half_back, Motion(turn=(0, 0, z))).turn[2], 3) for z in (0, 3)]
        [-1.287, 4.996]
        """
        return Motion(tuple(told["translate"]), _turn(told["rotate"], before.turn), tuple(told["scale"]))

    @property
    def still(self) -> bool:
        """Whether nothing moves."""
        return self == Motion()

    @property
    def even(self) -> bool:
        """Whether it is a similarity."""
        return self.scale[0] == self.scale[1] == self.scale[2]

    @property
    def angle(self) -> float:
        """In radians."""
        return math.hypot(*self.turn)

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        half = self.angle / 2
        factor = math.sin(half) / (2 * half) if half else 0.5
        rotate = (*(factor * x for x in self.turn), math.cos(half))
        return {"translate": self.translate, "rotate": rotate, "scale": self.scale}

    def __call__(self, points: Float[np.ndarray, "k 3"], center: Float[np.ndarray, "3"], share: float = 1.0) -> Float[np.ndarray, "k 3"]:
        """Where points go on this share of the way."""
        rotation = exponential(share * np.array([self.turn]))[0]
        scale = 1.0 + share * (np.array(self.scale) - 1.0)
        return scale * (points - center) @ rotation.T + center + share * np.array(self.translate)


@dataclass(frozen=True)
class Mirror:
    """A plane that a handle is mirrored at.

    Parameters
    ----------
    point
        On the plane.
    normal
        Of unit length.
    """

    point: Vector
    normal: Vector

    @staticmethod
    def of(told: Mapping[str, Any], middle: Float[np.ndarray, "3"]) -> "Mirror":
        """The plane that a message tells: by its normal, or by an axis through the middle of the mesh."""
        if "axis" in told:
            return Mirror(_vector(middle), AXES[told["axis"]])
        normal = np.array(told["normal"])
        return Mirror(tuple(told["point"]), _vector(normal / np.linalg.norm(normal)))

    def __call__(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
        """The mirror images of points."""
        normal = np.array(self.normal)
        return points - 2 * ((points - np.array(self.point)) @ normal)[:, None] * normal

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        return {"point": self.point, "normal": self.normal}


def _vector(values: Float[np.ndarray, "3"]) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _turn(quaternion: tuple[float, ...], before: Vector) -> Vector:
    """Of the rotation vectors of a quaternion, the one next to the last."""
    part = np.array(quaternion[:3])
    sine = float(np.linalg.norm(part))
    last = np.array(before)
    axis = part / sine if sine else last / (np.linalg.norm(last) or 1.0)
    angle = 2 * math.atan2(sine, quaternion[3])
    return _vector((angle + FULL * round((float(last @ axis) - angle) / FULL)) * axis)
