"""Pairs of meshes whose true correspondence is known, to judge found ones by.

Two poses over one connectivity know it from their vertex numbers. So that a method cannot know it too, the source is remeshed: other
vertices, otherwise joined and in another order, each with its true place on the target. Markers know it at a few vertices.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.samples.copies import remeshed
from morphlet.surface.distance import distances, farthest_points
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints
from morphlet.surface.repair import Repaired, close

LANDMARKS = 16
"""Landmarks of a remeshed pair: the ends of limbs come first, then what lies farthest from them."""


@dataclass(frozen=True, eq=False)
class KnownPair:
    """Two meshes, and where vertices of the source truly lie on the target.

    Parameters
    ----------
    source, target
        Closed meshes.
    vertices
        The vertices of the source whose place is known.
    truth
        Their places on the target.
    landmarks
        True pairs of vertices, each far from those before: the first few are landmarks spread over the shape.

    Examples
    --------
    >>> from morphlet.samples.creatures import blob
    >>> from morphlet.samples.truth import known_pair
    >>> lump = blob(n_vertices=1500)
    >>> pair = known_pair(lump, lump.with_vertices(lump.vertices * [1, 1, 2]))
    >>> pair.source, pair.target, len(pair.vertices)
    (Mesh(1275 vertices, 2546 faces), Mesh(1500 vertices, 2996 faces), 1275)
    """

    source: Mesh
    target: Mesh
    vertices: Int[np.ndarray, "k"]
    truth: SurfacePoints
    landmarks: VertexPairs

    def __post_init__(self) -> None:
        vertices = _arrays.index(self.vertices, "vertices", (len(self.truth),), self.source.n_vertices)
        _arrays.index(self.truth.faces, "the target's faces in the truth", (None,), self.target.n_faces)
        self.landmarks.checked(self.source, self.target)
        object.__setattr__(self, "vertices", vertices)

    def __reduce__(self) -> tuple[Any, ...]:
        return KnownPair, (self.source, self.target, np.array(self.vertices), self.truth, self.landmarks)

    def first_landmarks(self, count: int) -> VertexPairs:
        """The first few landmarks.

        Raises
        ------
        InputError
            If there are not so many.
        """
        if not 0 <= count <= len(self.landmarks):
            raise InputError(f"0 to {len(self.landmarks)} landmarks", str(count), "ask for fewer")
        marks = self.landmarks
        return VertexPairs(marks.source[:count], marks.target[:count], labels=marks.labels[:count])

    def drawn(self, count: int, used: VertexPairs, seed: int = 0) -> Int[np.ndarray, "c"]:
        """Rows of `truth` to judge by: drawn by area, without the landmarks that a method was given; all if there are no more."""
        rows = np.flatnonzero(~np.isin(self.vertices, used.source))
        if len(rows) <= count:
            return rows
        share = self.source.vertex_areas[self.vertices[rows]]
        return np.sort(np.random.default_rng(seed).choice(rows, count, replace=False, p=share / share.sum()))


def known_pair(source: Mesh, target: Mesh, seed: int = 0) -> KnownPair:
    """A remeshed copy of the source, and the true place of each of its vertices on the target.

    Parameters
    ----------
    source, target
        Two poses of one shape: equal face numbers join equal vertex numbers, in any orientation. Holes are filled on both
        sides; what lies on a filled hole of the source is not known.
    seed
        Another copy for each.

    Raises
    ------
    InputError
        If the faces do not join the same vertices.
    MeshError
        If a mesh cannot be closed.

    Notes
    -----
    About a second for 10,000 vertices.

    Examples
    --------
    >>> from morphlet.samples.creatures import blob
    >>> from morphlet.samples.truth import known_pair
    >>> lump = blob(n_vertices=1500)
    >>> twice = known_pair(lump, lump.with_vertices(2 * lump.vertices))
    >>> bool(abs(twice.truth.positions(twice.target) - 2 * twice.source.vertices).max() < 1e-12)
    True
    """
    if source.faces.shape != target.faces.shape:
        found = f"{source.n_faces} and {target.n_faces} faces"
        raise InputError("two meshes of the same connectivity", found, "pass two poses of one shape, or markers")
    shape, pose = close(source), close(target)
    held = farthest_points(shape.mesh, LANDMARKS)[0]
    copy, places = remeshed(shape.mesh, seed, held)
    known = np.flatnonzero(_on_both(shape, pose)[places.faces])
    truth = carried(SurfacePoints(places.faces[known], places.weights[known]), shape, pose)
    return KnownPair(copy, pose.mesh, known, truth, _landmarks(held, known, truth, (shape.mesh, places, pose.mesh)))


def marked_pair(source: Mesh, target: Mesh, markers: VertexPairs) -> KnownPair:
    """Two meshes, and the truth at markers; the landmarks are all of them, each far from those before.

    Raises
    ------
    InputError
        If a marker is no vertex of its mesh or in none of its faces.
    MeshError
        If a mesh cannot be closed.

    Examples
    --------
    >>> from morphlet import VertexPairs
    >>> from morphlet.samples.creatures import blob
    >>> from morphlet.samples.truth import marked_pair
    >>> one, other = blob(0, n_vertices=1500), blob(1, n_vertices=2000)
    >>> pair = marked_pair(one, other, VertexPairs([3, 700, 20], [8, 900, 1500]))
    >>> sorted(pair.landmarks.source.tolist())
    [3, 20, 700]
    """
    markers.checked(source, target)
    shape, other = close(source), close(target)
    for repaired, marked in ((shape, markers.source), (other, markers.target)):
        lost = np.flatnonzero(~repaired.valid[marked])
        if len(lost):
            raise InputError("markers on the surface", f"{len(lost)} in no face of it", "drop these markers", lost)
    own, goal = shape.vertex_map[markers.source], other.vertex_map[markers.target]
    order = _spread(shape.mesh, own)
    labels = tuple(markers.labels[i] for i in order)
    marks = VertexPairs(own[order], goal[order], labels=labels)
    return KnownPair(shape.mesh, other.mesh, own, at_vertices(other.mesh, goal), marks)


def carried(points: SurfacePoints, source: Repaired, target: Repaired) -> SurfacePoints:
    """Places on a closed mesh, on another that was closed from the same faces with other positions.

    Raises
    ------
    InputError
        If the faces as given do not join the same vertices, or a place lies on a face that the target was not given.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.samples.truth import carried
    >>> from morphlet.surface.repair import close
    >>> solid = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> turned = Mesh(solid.vertices, [[2, 1, 0], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> carried(SurfacePoints([0], [[0.5, 0.3, 0.2]]), close(solid), close(turned)).weights
    array([[0.3, 0.2, 0.5]])
    """
    given = source.to_source(points)
    row = np.full(target.source.n_faces, -1)
    real = np.flatnonzero(target.face_map >= 0)
    row[target.face_map[real]] = real
    if np.any(row[given.faces] < 0):
        raise InputError("places on faces of both meshes", f"{int(np.sum(row[given.faces] < 0))} that the target lost", "drop these places")
    same = source.source.faces[given.faces][:, None, :] == target.source.faces[given.faces][:, :, None]
    if not np.all(same.sum(axis=2) == 1):
        found = f"{int(np.sum(np.any(same.sum(axis=2) != 1, axis=1)))} faces that do not"
        raise InputError("faces that join the same vertices in both meshes", found, "pass two poses of one shape")
    weights = np.einsum("kab,kb->ka", same.astype(float), given.weights)
    rows = row[given.faces]
    return SurfacePoints(rows, np.where(target.flipped[rows, None], weights[:, [0, 2, 1]], weights))


def at_vertices(mesh: Mesh, vertices: Int[np.ndarray, "k"]) -> SurfacePoints:
    """Vertices as places.

    Raises
    ------
    InputError
        If one is in no face.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.samples.truth import at_vertices
    >>> at_vertices(Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [[0, 1, 2]]), [2]).weights
    array([[0., 0., 1.]])
    """
    wanted = _arrays.index(vertices, "vertices", (None,), mesh.n_vertices)
    lost = np.flatnonzero(~mesh.topology.referenced[wanted])
    if len(lost):
        raise InputError("vertices in faces", f"{len(lost)} in none", "drop these vertices", lost)
    corner = np.zeros(mesh.n_vertices, np.int64)
    corner[mesh.faces.ravel()] = np.arange(mesh.faces.size)
    return SurfacePoints(corner[wanted] // 3, np.eye(3)[corner[wanted] % 3])


def _on_both(source: Repaired, target: Repaired) -> np.ndarray:
    """Which faces of the closed source are faces of both meshes as given."""
    left = np.zeros(target.source.n_faces + 1, bool)
    left[target.face_map[target.face_map >= 0]] = True
    return left[source.face_map]


def _landmarks(
    held: Int[np.ndarray, "h"], known: Int[np.ndarray, "k"], truth: SurfacePoints, meshes: tuple[Mesh, SurfacePoints, Mesh]
) -> VertexPairs:
    """The held vertices of the original as vertices of the copy, with their true vertices on the target."""
    original, places, target = meshes
    vertex = _vertex_at(original, SurfacePoints(places.faces[known], places.weights[known]))
    rows = [np.flatnonzero(vertex == v) for v in held]
    found = np.array([row[0] for row in rows if len(row)], np.int64)
    return VertexPairs(known[found], _vertex_at(target, truth)[found])


def _vertex_at(mesh: Mesh, points: SurfacePoints) -> Int[np.ndarray, "k"]:
    """The vertex at which a place lies exactly; -1 where it lies at none."""
    corner = np.argmax(points.weights, axis=1)
    rows = np.arange(len(points))
    return np.where(points.weights[rows, corner] == 1.0, mesh.faces[points.faces, corner], -1)


def _spread(mesh: Mesh, vertices: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
    """An order of some vertices: first the one farthest from the others in the mean, then always the one farthest from those before."""
    between: Float[np.ndarray, "k k"] = distances(mesh, vertices)[:, vertices]
    order = [int(np.argmax(between.mean(axis=1)))]
    while len(order) < len(vertices):
        gap = between[order].min(axis=0)
        gap[order] = -1.0
        order.append(int(np.argmax(gap)))
    return np.array(order, np.int64)
