"""Marks beside a mesh: dots, rods and arrows, as small solids that the renderer draws with it."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.numerics.unit_sphere import icosphere
from morphlet.surface.mesh import Mesh

SIDES = 8
"""Of a rod."""
DOT = 1
"""Subdivisions of the icosahedron that is a dot."""
HEAD, WIDE = 9.0, 3.2
"""Length and radius of an arrow's head, over the radius of its rod; no head is longer than half the arrow."""
LONGEST = 0.5

Color = tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class Painted:
    """A mesh and the colour of each of its vertices."""

    mesh: Mesh
    colors: Float[np.ndarray, "n 3"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "colors", _arrays.real(self.colors, "colors", (self.mesh.n_vertices, 3)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Painted, (self.mesh, np.array(self.colors))


def painted(mesh: Mesh, color: Color) -> Painted:
    """A mesh in one colour."""
    return Painted(mesh, np.tile(color, (mesh.n_vertices, 1)))


def together(*parts: Painted) -> Painted:
    """Several meshes as one.

    Examples
    --------
    >>> from morphlet.paper.marks import dots, painted, together
    >>> both = together(painted(dots(np.zeros((1, 3)), 0.1), (1, 0, 0)), painted(dots(np.ones((2, 3)), 0.1), (0, 1, 0)))
    >>> both.mesh.n_vertices
    126
    """
    first = np.cumsum([0, *(part.mesh.n_vertices for part in parts)])
    faces = np.concatenate([part.mesh.faces + k for part, k in zip(parts, first, strict=False)])
    return Painted(Mesh(np.concatenate([p.mesh.vertices for p in parts]), faces), np.concatenate([p.colors for p in parts]))


def dots(places: Float[np.ndarray, "k 3"], radius: float) -> Mesh:
    """A small ball at each place."""
    points, faces = icosphere(DOT)
    return _copies(places[:, None] + radius * points, faces)


def rods(starts: Float[np.ndarray, "k 3"], ends: Float[np.ndarray, "k 3"], radius: float) -> Mesh:
    """A closed prism from each start to its end.

    Examples
    --------
    >>> from morphlet.paper.marks import rods
    >>> rod = rods(np.zeros((1, 3)), np.array([[0.0, 0.0, 2.0]]), 0.1)
    >>> rod.topology.euler_characteristic, bool(rod.volume > 0)
    (2, True)
    """
    rings = _rings(ends - starts)
    return _copies(np.concatenate([starts[:, None] + radius * rings, ends[:, None] + radius * rings], axis=1), _prism())


def arrows(starts: Float[np.ndarray, "k 3"], ends: Float[np.ndarray, "k 3"], radius: float) -> Mesh:
    """A rod with a pointed head from each start to its end."""
    length = np.maximum(np.linalg.norm(ends - starts, axis=1, keepdims=True), np.finfo(float).tiny)
    neck, rings = ends + np.minimum(HEAD * radius / length, LONGEST) * (starts - ends), _rings(ends - starts)
    base, tip = neck[:, None] + WIDE * radius * rings, ends[:, None]
    k = np.arange(SIDES)
    cone = np.stack([k, (k + 1) % SIDES, np.full(SIDES, SIDES)], axis=1)
    heads = _copies(np.concatenate([base, tip], axis=1), np.concatenate([cone, _lid()]))
    return together(painted(rods(starts, neck, radius), (0, 0, 0)), painted(heads, (0, 0, 0))).mesh


def _rings(along: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k s 3"]:
    """A unit circle across each direction, counter-clockwise about it."""
    w = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), np.finfo(float).tiny)
    u = np.cross(w, np.eye(3)[np.argmin(np.abs(w), axis=1)])
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), np.finfo(float).tiny)
    v, angle = np.cross(w, u), 2 * np.pi * np.arange(SIDES) / SIDES
    return np.cos(angle)[:, None] * u[:, None] + np.sin(angle)[:, None] * v[:, None]


def _prism() -> np.ndarray:
    """Faces of a prism whose lower ring comes first."""
    k, after = np.arange(SIDES), (np.arange(SIDES) + 1) % SIDES
    sides = np.concatenate([np.stack([k, after, after + SIDES], 1), np.stack([k, after + SIDES, k + SIDES], 1)])
    return np.concatenate([sides, _lid(), _lid()[:, ::-1] + SIDES])


def _lid() -> np.ndarray:
    """Faces over a ring that look against its direction."""
    k = np.arange(1, SIDES - 1)
    return np.stack([np.zeros(len(k), np.int64), k + 1, k], axis=1)


def _copies(vertices: Float[np.ndarray, "k p 3"], faces: np.ndarray) -> Mesh:
    """The same faces over each row of vertices."""
    count, size = vertices.shape[:2]
    return Mesh(vertices.reshape(-1, 3), (faces[None] + size * np.arange(count)[:, None, None]).reshape(-1, 3))
