# mypy: disable-error-code="untyped-decorator"
"""Solids bounded by the zero set of a smooth field: tapered capsules, melted together.

A part is one row of twelve numbers, made by `part`. The field is negative inside; the union is the polynomial smooth
minimum, part after part, each with its own blending width [1]_. Next to the value the field carries the local
thickness of the body, the radius of the part that is nearest, blended in the same way.

References
----------
.. [1] I. Quilez, "Smooth minimum", 2013: the quadratic polynomial kernel.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.numerics.compiled import njit

PART_NUMBERS = 12
"""Start, end (3 + 3), two radii, blending width, flattening vector (3)."""

GRADIENT_STEP = 1e-5
"""Finite-difference step, in units of the body: far above rounding (1e-16 / 1e-5), far below any radius (1e-2)."""

TETRAHEDRON = np.array([[1.0, 1.0, 1.0], [1.0, -1.0, -1.0], [-1.0, 1.0, -1.0], [-1.0, -1.0, 1.0]])
"""Directions of the four differences that give a gradient."""

NEWTON_STEPS = 3
"""Steps of a projection: the start is at most a grid cell away, where three steps reach 1e-6 of the body."""

LONGEST_STEP = 0.05
"""Newton steps are cut at this length: beside the medial axis the gradient vanishes."""


@dataclass(frozen=True, eq=False)
class Solid:
    """The smooth union of its parts, in their order."""

    parts: Float[np.ndarray, "p 12"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "parts", _arrays.real(self.parts, "parts", (None, PART_NUMBERS)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Solid, (np.array(self.parts),)

    @property
    def box(self) -> Float[np.ndarray, "2 3"]:
        """Two corners of an axis-parallel box that holds the solid."""
        reach = (self.parts[:, 6:8].max(axis=1) + self.parts[:, 8])[:, None]
        ends = np.stack([self.parts[:, :3], self.parts[:, 3:6]])
        return np.stack([(ends - reach).min(axis=(0, 1)), (ends + reach).max(axis=(0, 1))])

    @property
    def thinnest(self) -> float:
        """Half the thickness of the thinnest place of any part."""
        return float(np.min(self.parts[:, 6:8].min(axis=1) / (1 + np.sum(self.parts[:, 9:12] ** 2, axis=1))))

    def field(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 2"]:
        """Value of the field and local thickness at each point."""
        return _field(np.array(points), np.array(self.parts))

    def gradient(self, points: Float[np.ndarray, "k 3"]) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k 3"]]:
        """Value and gradient of the field at each point, from four evaluations."""
        moved = points[:, None, :] + GRADIENT_STEP * TETRAHEDRON
        values = self.field(moved.reshape(-1, 3))[:, 0].reshape(-1, 4)
        return values.mean(axis=1), values @ TETRAHEDRON / (4 * GRADIENT_STEP)

    def project(self, points: Float[np.ndarray, "k 3"], steps: int = NEWTON_STEPS) -> Float[np.ndarray, "k 3"]:
        """The points moved to the surface by Newton steps along the gradient."""
        for _ in range(steps):
            value, slope = self.gradient(points)
            square = np.maximum(np.sum(slope**2, axis=1), np.abs(value) / LONGEST_STEP)
            points = points - (value / np.maximum(square, GRADIENT_STEP))[:, None] * slope
        return points


def part(
    start: Float[np.ndarray, "3"],
    end: Float[np.ndarray, "3"],
    radii: tuple[float, float],
    blend: float,
    flat: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> Float[np.ndarray, "12"]:
    """A tapered capsule; `flat` makes it 1 + |flat|^2 times thinner along that vector."""
    return np.concatenate([start, end, radii, [blend], flat])


@njit(cache=True)
def _field(points: np.ndarray, parts: np.ndarray) -> np.ndarray:
    """(k, 3), (p, 12) -> (k, 2): value and local thickness."""
    out = np.empty((len(points), 2))
    for i in range(len(points)):
        value, radius = _distance(points[i], parts[0])
        for j in range(1, len(parts)):
            distance, own = _distance(points[i], parts[j])
            blend = parts[j, 8]
            share = min(max(0.5 + 0.5 * (value - distance) / blend, 0.0), 1.0)
            value = value + share * (distance - value) - blend * share * (1.0 - share)
            radius = radius + share * (own - radius)
        out[i, 0], out[i, 1] = value, radius
    return out


@njit(cache=True)
def _distance(point: np.ndarray, row: np.ndarray) -> tuple[float, float]:
    """Distance of a point to a tapered capsule, and the capsule's radius there."""
    px, py, pz = point[0] - row[0], point[1] - row[1], point[2] - row[2]
    ax, ay, az = row[3] - row[0], row[4] - row[1], row[5] - row[2]
    square = ax * ax + ay * ay + az * az
    along = 0.0 if square == 0.0 else min(max((px * ax + py * ay + pz * az) / square, 0.0), 1.0)
    px, py, pz = px - along * ax, py - along * ay, pz - along * az
    flat = px * row[9] + py * row[10] + pz * row[11]
    px, py, pz = px + flat * row[9], py + flat * row[10], pz + flat * row[11]
    radius = row[6] + along * (row[7] - row[6])
    return np.sqrt(px * px + py * py + pz * pz) - radius, radius
