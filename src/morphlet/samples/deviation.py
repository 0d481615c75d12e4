"""How far answers lie from true places, along a surface.

Near the true place the distance is exact: the shortest path over the triangles of a patch that holds it. Farther away, where it only
matters that an answer is wrong, it is that of a front (`surface.distance`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.distance import distances
from morphlet.surface.mesh import Mesh
from morphlet.surface.points import SurfacePoints

NEAR = 0.1
"""Answers on faces nearer than this share of sqrt(area) are measured exactly: their patches take milliseconds, whole meshes seconds."""
REACH = 1.15
"""A patch reaches this much farther than the front says the answer lies: fronts are at most 7 % off."""
SNAP = 1e-4
"""Weights below this are raised to it before a place becomes a vertex, so that no face without area comes about."""

Piece = tuple[Int[np.ndarray, "3"], Float[np.ndarray, "3 3"]]
"""A part of a face: its vertices, and their weights in the corners of the whole face."""


@dataclass(frozen=True, eq=False)
class Deviation:
    """A ruler laid at some places of a mesh: distances along its surface to any answer.

    Parameters
    ----------
    mesh
        One connected surface.
    places
        From where to measure.
    fields
        Distance by fronts of every vertex from each place.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.samples.deviation import Deviation
    >>> roof = Mesh([[0, 0, 0], [0, 2, 0], [1, 1, 1], [-1, 1, 1]], [[0, 2, 1], [0, 1, 3]])
    >>> ruler = Deviation.prepare(roof, SurfacePoints([0], [[0.25, 0.5, 0.25]]))
    >>> ruler.of(SurfacePoints([1], [[0.25, 0.25, 0.5]])).round(3)
    array([1.414])
    """

    mesh: Mesh
    places: SurfacePoints
    fields: Float[np.ndarray, "k n"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "fields", _arrays.real(self.fields, "fields", (len(self.places), self.mesh.n_vertices)))

    @staticmethod
    def prepare(mesh: Mesh, places: SurfacePoints) -> "Deviation":
        """Lay the ruler: one front per place.

        Raises
        ------
        InputError
            If a place is on no face of the mesh, or a vertex cannot be reached from one.

        Notes
        -----
        O(n log n) per place, about 8 ms at 8,000 vertices.
        """
        _arrays.index(places.faces, "the faces of the places", (None,), mesh.n_faces)
        refined, seats = inserted(mesh, places)
        return Deviation(mesh, places, distances(refined, seats)[:, : mesh.n_vertices])

    def of(self, answers: SurfacePoints) -> Float[np.ndarray, "k"]:
        """Distance of each answer from its place, in mesh units.

        Parameters
        ----------
        answers
            One place of the mesh per place of the ruler.

        Raises
        ------
        InputError
            If there are more or fewer answers, or one is on no face of the mesh.

        Notes
        -----
        Some milliseconds per answer nearer than `NEAR`, nothing for the others.
        """
        if len(answers) != len(self.places):
            raise InputError(f"{len(self.places)} answers", str(len(answers)), "pass one answer per place")
        _arrays.index(answers.faces, "the faces of the answers", (None,), self.mesh.n_faces)
        corners = np.take_along_axis(self.fields, self.mesh.faces[answers.faces], axis=1)
        found = np.sum(corners * answers.weights, axis=1)
        sides = _longest_sides(self.mesh, answers.faces)
        reach = REACH * (corners.max(axis=1) + sides) + sides
        for k in np.flatnonzero(corners.min(axis=1) - sides < NEAR * np.sqrt(self.mesh.area)).tolist():
            found[k] = self._exact(k, answers, float(reach[k]))
        return found

    def _exact(self, k: int, answers: SurfacePoints, radius: float) -> float:
        """Length of the shortest path from place k to its answer that stays within a radius."""
        two = SurfacePoints(np.array([self.places.faces[k], answers.faces[k]]), np.array([self.places.weights[k], answers.weights[k]]))
        within = (self.fields[k][self.mesh.faces] <= radius).any(axis=1)
        within[two.faces] = True
        part = np.flatnonzero(within)
        used, corners = np.unique(self.mesh.faces[part], return_inverse=True)
        patch = Mesh(self.mesh.vertices[used], corners.reshape(-1, 3))
        return _shortest(*inserted(patch, SurfacePoints(np.searchsorted(part, two.faces), two.weights)))


def inserted(mesh: Mesh, places: SurfacePoints) -> tuple[Mesh, Int[np.ndarray, "k"]]:
    """The same surface with the places among its vertices, and which vertices they are.

    Parameters
    ----------
    mesh
        Any mesh.
    places
        Places on it. One within `SNAP` of a corner of its face is that corner; one within `SNAP` of a side moves that far inside.

    Returns
    -------
    mesh, vertices
        The old vertices come first, in their order.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.samples.deviation import inserted
    >>> triangle = Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [[0, 1, 2]])
    >>> inserted(triangle, SurfacePoints([0, 0], [[1 / 3, 1 / 3, 1 / 3], [0, 1, 0]]))
    (Mesh(4 vertices, 3 faces), array([3, 1]))
    """
    seats, n = np.empty(len(places), np.int64), mesh.n_vertices
    split: dict[int, list[Piece]] = {}
    positions: list[np.ndarray] = []
    for k, (face, weights) in enumerate(zip(places.faces.tolist(), places.weights, strict=True)):
        pieces = split.setdefault(face, [(mesh.faces[face], np.eye(3))])
        place = max(range(len(pieces)), key=lambda i: float(_local(weights, pieces[i][1]).min()))
        corners, frame = pieces[place]
        local = _local(weights, frame)
        if local.max() > 1 - 2 * SNAP:
            seats[k] = corners[np.argmax(local)]
            continue
        local = np.maximum(local, SNAP) / np.maximum(local, SNAP).sum()
        seats[k] = n + len(positions)
        positions.append(local @ frame @ mesh.vertices[mesh.faces[face]])
        pieces[place : place + 1] = [_piece(pieces[place], c, int(seats[k]), local @ frame) for c in range(3)]
    whole = np.delete(mesh.faces, list(split), axis=0)
    faces = [corners for pieces in split.values() for corners, _ in pieces]
    vertices = np.concatenate([mesh.vertices, np.array(positions).reshape(-1, 3)])
    return Mesh(vertices, np.concatenate([whole, np.array(faces, np.int64).reshape(-1, 3)])), seats


def _piece(whole: Piece, corner: int, vertex: int, weights: Float[np.ndarray, "3"]) -> Piece:
    """The part of a triangle whose corner has moved to a vertex inside."""
    corners, frame = np.array(whole[0]), np.array(whole[1])
    corners[corner], frame[corner] = vertex, weights
    return corners, frame


def _local(weights: Float[np.ndarray, "3"], frame: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Weights in the corners of a part of the face."""
    return np.linalg.solve(frame.T, weights)


def _longest_sides(mesh: Mesh, faces: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k"]:
    """Length of the longest side of some faces."""
    corners = mesh.vertices[mesh.faces[faces]]
    return np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)


def _shortest(mesh: Mesh, ends: Int[np.ndarray, "2"]) -> float:
    """Length of the shortest path over the triangles between two vertices."""
    if ends[0] == ends[1]:
        return 0.0
    import igl

    none = np.zeros(0, np.int64)
    return float(igl.exact_geodesic(np.array(mesh.vertices), np.array(mesh.faces), ends[:1].copy(), none, ends[1:].copy(), none)[0])
