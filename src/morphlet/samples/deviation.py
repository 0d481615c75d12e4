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
from morphlet.surface.insertion import inserted
from morphlet.surface.mesh import Mesh
from morphlet.surface.points import SurfacePoints

NEAR = 0.1
"""Answers on faces nearer than this share of sqrt(area) are measured exactly: their patches take milliseconds, whole meshes seconds."""
REACH = 1.15
"""A patch reaches this much farther than the front says the answer lies: fronts are at most 7 % off."""
SNAP = 1e-4
"""Weights below this are raised to it before a place becomes a vertex, so that no face without area comes about."""


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
        refined = inserted(mesh, places, SNAP)
        return Deviation(mesh, places, distances(refined.mesh, refined.vertices)[:, : mesh.n_vertices])

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
        refined = inserted(patch, SurfacePoints(np.searchsorted(part, two.faces), two.weights), SNAP)
        return _shortest(refined.mesh, refined.vertices)


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
