"""Edits to compare methods on: a mesh, what is pulled, what follows, what stays, and the path that the handle takes.

`pulled` draws the region on any mesh: round the vertex that lies farthest from the middle. The plane, cylinder, bar and cactus are the four
shapes that Botsch and Sorkine compare linear methods with (On linear variational surface deformation methods, IEEE TVCG 14, 2008),
made anew here: sizes are not theirs, and the cactus is a stand-in.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import igl
import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from morphlet import Mesh
from morphlet.editing.roi import Roi
from morphlet.metrics import edge_lengths
from morphlet.samples.meshing import edge_middles, midpoint_faces

HANDLE_RADIUS, SHIFT, TURN = 0.05, 0.3, np.radians(60)
"""Of `pulled`: size of the handle and way of its centre in bounding-box diagonals, and its turn."""
BUMPS = 16 * np.pi
"""Waves of the bumpy plane."""
ROUNDS, STEP = 10, 0.7
"""Tangential smoothing of the cactus, which takes the slivers out of marching cubes."""
DIGITS = 9
"""Marching cubes' vertices that agree to so many digits are one."""


@dataclass(frozen=True, eq=False)
class Problem:
    """An edit: the handle turns about its centre by a rotation vector and is then moved."""

    name: str
    mesh: Mesh
    handle: np.ndarray
    anchors: np.ndarray
    turn: np.ndarray
    shift: np.ndarray

    @cached_property
    def roi(self) -> Roi:
        """As the package has it."""
        stays = np.zeros(self.mesh.n_vertices, bool)
        stays[self.handle] = stays[self.anchors] = True
        return Roi(self.mesh, self.handle, np.nonzero(~stays)[0])

    def pose(self, fraction: float = 1.0) -> np.ndarray:
        """Where the handle's vertices are after this part of the way."""
        rest = self.mesh.vertices[self.handle]
        centre = rest.mean(axis=0)
        return Rotation.from_rotvec(fraction * self.turn).apply(rest - centre) + centre + fraction * self.shift

    @cached_property
    def held(self) -> np.ndarray:
        """Handle, then anchors: what peers call constrained."""
        return np.concatenate([self.handle, self.anchors])

    def places(self, fraction: float = 1.0) -> np.ndarray:
        """Where `held` is then."""
        return np.concatenate([self.pose(fraction), self.mesh.vertices[self.anchors]])

    def with_more_handle(self, count: int) -> tuple["Problem", np.ndarray]:
        """The same with a larger handle: the free vertices nearest to it join; which ones these are."""
        distance = _along_edges(self.mesh, self.handle)[self.roi.free]
        more = np.sort(self.roi.free[np.argsort(distance, kind="stable")[:count]])
        return Problem(self.name, self.mesh, np.concatenate([self.handle, more]), self.anchors, self.turn, self.shift), more


def pulled(name: str, mesh: Mesh, radius: float) -> Problem:
    """The region within a radius (in bounding-box diagonals, along edges) of the vertex farthest from the vertices' mean.

    Its innermost part is the handle; it turns about the coordinate axis most square to the direction outwards, and moves sideways.
    """
    middle = mesh.vertices.mean(axis=0)
    distance = _along_edges(mesh, [int(np.argmax(((mesh.vertices - middle) ** 2).sum(axis=1)))])
    handle = np.nonzero(distance <= HANDLE_RADIUS * mesh.bbox_diagonal)[0]
    outward = mesh.vertices[handle].mean(axis=0) - middle
    outward /= np.linalg.norm(outward)
    axis = np.eye(3)[np.argmin(np.abs(outward))]
    axis = axis - outward * (outward @ axis)
    axis /= np.linalg.norm(axis)
    anchors = np.nonzero(distance > radius * mesh.bbox_diagonal)[0]
    return Problem(name, mesh, handle, anchors, TURN * axis, SHIFT * mesh.bbox_diagonal * np.cross(axis, outward))


def subdivided(mesh: Mesh) -> Mesh:
    """Each triangle in four, flat ones."""
    edges, edge_of = edge_middles(mesh.faces, mesh.n_vertices)
    middles = mesh.vertices[edges].mean(axis=1)
    return Mesh(np.concatenate([mesh.vertices, middles]), midpoint_faces(mesh.faces, edge_of).reshape(-1, 3))


def plane(side: int = 101) -> Problem:
    """A bumpy square, its middle lifted: what becomes of fine detail?"""
    grid = np.linspace(-1, 1, side)
    x, y = (part.ravel() for part in np.meshgrid(grid, grid, indexing="ij"))
    mesh = Mesh(np.column_stack([x, y, 0.02 * np.sin(BUMPS * x) * np.sin(BUMPS * y)]), _grid(side, side, side - 1))
    inner, outer = np.hypot(x, y) < 0.15, np.maximum(abs(x), abs(y)) > 0.95
    return Problem("plane", mesh, np.nonzero(inner)[0], np.nonzero(outer)[0], np.zeros(3), np.array([0, 0, 0.8]))


def cylinder(rings: int = 67, around: int = 72, angle: float = np.radians(120)) -> Problem:
    """An open tube, bent as if its free part were an arc of a circle."""
    length, radius = 3.0, 0.5
    turns = 2 * np.pi * np.arange(around) / around
    ring = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    mesh = _tube(ring, np.linspace(0, length, rings))
    arc = 0.8 * length / angle
    turn = Rotation.from_rotvec([0, angle, 0])
    end = np.array([arc, 0, 0.1 * length]) + turn.apply([-arc, 0, 0])
    return _ends("cylinder", mesh, length, lambda x: turn.apply(x - [0, 0, 0.9 * length]) + end, np.array([0, angle, 0]))


def bar(rings: int = 121, per_side: int = 12, angle: float = np.radians(135)) -> Problem:
    """An open square tube, twisted about its axis."""
    length, half = 3.0, 0.5
    along = -half + 2 * half * np.arange(per_side) / per_side
    edge = np.full(per_side, half)
    x, y = np.concatenate([along, edge, -along, -edge]), np.concatenate([-edge, along, edge, -along])
    turn = Rotation.from_rotvec([0, 0, angle])
    return _ends("bar", _tube(np.column_stack([x, y]), np.linspace(0, length, rings)), length, turn.apply, np.array([0, 0, angle]))


def cactus(size: int = 64, angle: float = np.radians(70)) -> Problem:
    """A closed trunk with two arms, bent: what becomes of the parts that stick out?"""
    mesh = _cactus_mesh(size)
    x, _, z = mesh.vertices.T
    handle, anchors = np.nonzero((z > 1.95) & (abs(x) < 0.5))[0], np.nonzero(z < 0.3)[0]
    turn, foot = Rotation.from_rotvec([0, angle, 0]), np.array([0, 0, 0.3])
    targets = turn.apply(mesh.vertices[handle] - foot) + foot + [0.25, 0, 0.35]
    return Problem("cactus", mesh, handle, anchors, turn.as_rotvec(), (targets - mesh.vertices[handle]).mean(axis=0))


SHAPES: dict[str, Callable[[], Problem]] = {"plane": plane, "cylinder": cylinder, "bar": bar, "cactus": cactus}
"""By name."""


def _along_edges(mesh: Mesh, sources: np.ndarray | list[int]) -> np.ndarray:
    """Length of the shortest path along edges from the nearest of these vertices; infinite where there is none."""
    i, j = mesh.topology.edges.T
    graph = sp.csr_matrix((edge_lengths(mesh), (i, j)), shape=(mesh.n_vertices, mesh.n_vertices))
    return dijkstra(graph, directed=False, indices=sources, min_only=True)


def _grid(rows: int, columns: int, across: int) -> np.ndarray:
    """Faces of a grid, two per cell, diagonals alternating; columns wrap round where `across` is their number."""
    i, j = (part.ravel() for part in np.meshgrid(np.arange(rows - 1), np.arange(across), indexing="ij"))
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = a + columns, b + columns
    odd = ((i + j) % 2 == 1)[:, None, None]
    faces = np.where(odd, np.stack([a, c, b, b, c, d], axis=1).reshape(-1, 2, 3), np.stack([a, c, d, a, d, b], axis=1).reshape(-1, 2, 3))
    return faces.reshape(-1, 3)


def _tube(ring: np.ndarray, heights: np.ndarray) -> Mesh:
    """A ring at several heights, faces outwards."""
    vertices = np.column_stack([np.tile(ring, (len(heights), 1)), np.repeat(heights, len(ring))])
    return Mesh(vertices, _grid(len(heights), len(ring), len(ring))[:, ::-1])


def _ends(name: str, mesh: Mesh, length: float, motion: Callable[[np.ndarray], np.ndarray], turn: np.ndarray) -> Problem:
    """A tube whose upper end is moved and whose lower end stays."""
    z = mesh.vertices[:, 2]
    handle = np.nonzero(z > 0.9 * length)[0]
    shift = (motion(mesh.vertices[handle]) - mesh.vertices[handle]).mean(axis=0)
    return Problem(name, mesh, handle, np.nonzero(z < 0.1 * length)[0], turn, shift)


def _cactus_mesh(size: int) -> Mesh:
    """Marching cubes on the field, vertices welded, slivers smoothed away along the surface."""
    shape, low, high = (size, size // 2, size), (-1.3, -0.6, -0.1), (1.3, 0.6, 2.7)
    axes = [np.linspace(a, b, k) for a, b, k in zip(low, high, shape, strict=True)]
    points = np.column_stack([part.ravel(order="F") for part in np.meshgrid(*axes, indexing="ij")])
    vertices, faces, _ = igl.marching_cubes(_cactus_field(points), points, *shape, 0.0)
    vertices, index = np.unique(np.round(vertices, DIGITS), axis=0, return_inverse=True)
    faces = index.ravel()[faces]
    faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
    mesh = Mesh(vertices, faces)
    mesh = mesh if mesh.volume > 0 else Mesh(vertices, faces[:, ::-1])
    count = np.asarray(mesh.topology.adjacency.sum(axis=1)).ravel()
    for _ in range(ROUNDS):
        normals = igl.per_vertex_normals(np.array(mesh.vertices), np.array(mesh.faces))
        pull = mesh.topology.adjacency @ mesh.vertices / count[:, None] - mesh.vertices
        mesh = mesh.with_vertices(mesh.vertices + STEP * (pull - (pull * normals).sum(axis=1, keepdims=True) * normals))
    return mesh


def _cactus_field(points: np.ndarray) -> np.ndarray:
    """Negative inside: a ribbed trunk and two bent arms, smoothly joined."""
    ribs = 0.33 + 0.015 * np.cos(10 * np.arctan2(points[:, 1], points[:, 0]))
    field = _capsule(points, (0, 0, 0.3), (0, 0, 2.2)) - ribs
    for start, end, radius in (
        ((0, 0, 0.9), (0.8, 0, 0.9), 0.2),
        ((0.8, 0, 0.9), (0.8, 0, 1.6), 0.2),
        ((0, 0, 1.3), (-0.75, 0, 1.3), 0.18),
        ((-0.75, 0, 1.3), (-0.75, 0, 1.9), 0.18),
    ):
        field = _joined(field, _capsule(points, start, end) - radius)
    return field


def _capsule(points: np.ndarray, start: tuple[float, ...], end: tuple[float, ...]) -> np.ndarray:
    """Distance to a segment."""
    a, d = np.array(start), np.subtract(end, start)
    along = np.clip((points - a) @ d / (d @ d), 0, 1)
    return np.linalg.norm(points - a - along[:, None] * d, axis=1)


def _joined(first: np.ndarray, second: np.ndarray, width: float = 0.15) -> np.ndarray:
    """The smaller of two fields, smoothly."""
    share = np.clip(0.5 + 0.5 * (second - first) / width, 0, 1)
    return second + (first - second) * share - width * share * (1 - share)
