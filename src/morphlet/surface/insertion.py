"""Places of a mesh made vertices: the same surface with more corners, the old vertices first and in their order."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.surface.mesh import Mesh
from morphlet.surface.points import SurfacePoints

SNAP = 0.02
"""Weights below this are raised to it, so that no sliver comes about; a place moves by some hundredths of an edge at most."""

Piece = tuple[Int[np.ndarray, "3"], Float[np.ndarray, "3 3"]]
"""A part of a face: its vertices, and their weights in the corners of the whole face."""


@dataclass(frozen=True, eq=False)
class Inserted:
    """A mesh with places among its vertices.

    Parameters
    ----------
    mesh
        The same surface; the old vertices come first, in their order.
    vertices
        Which vertex each place became.
    origins
        The old face that each face is a part of.
    places
        The new vertices, on the old mesh.
    """

    mesh: Mesh
    vertices: Int[np.ndarray, "k"]
    origins: Int[np.ndarray, "m"]
    places: SurfacePoints

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", _arrays.index(self.vertices, "vertices", (None,), self.mesh.n_vertices))
        object.__setattr__(self, "origins", _arrays.index(self.origins, "origins", (self.mesh.n_faces,), np.iinfo(np.int64).max))

    def __reduce__(self) -> tuple[Any, ...]:
        return Inserted, (self.mesh, np.array(self.vertices), np.array(self.origins), self.places)


def inserted(mesh: Mesh, places: SurfacePoints, snap: float = SNAP) -> Inserted:
    """Make places vertices, each by a split of its face in three.

    Parameters
    ----------
    mesh
        Any mesh.
    places
        Places on it; any number in one face.
    snap
        A place with a weight above 1 - 2 snap is that corner; of any other, weights below snap are raised to it.

    Raises
    ------
    InputError
        If a place is on no face of the mesh.

    Notes
    -----
    O(n + k). Places at one spot share a vertex.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.surface.insertion import inserted
    >>> triangle = Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [[0, 1, 2]])
    >>> found = inserted(triangle, SurfacePoints([0, 0], [[1 / 3, 1 / 3, 1 / 3], [0, 1, 0]]))
    >>> found.mesh, found.vertices
    (Mesh(4 vertices, 3 faces), array([3, 1]))
    """
    _arrays.index(places.faces, "faces of the places", (None,), mesh.n_faces)
    split: dict[int, list[Piece]] = {}
    seats, faces, weights = np.empty(len(places), np.int64), list[int](), list[np.ndarray]()
    for k, (face, given) in enumerate(zip(places.faces.tolist(), places.weights, strict=True)):
        pieces = split.setdefault(face, [(mesh.faces[face], np.eye(3))])
        place = max(range(len(pieces)), key=lambda i, p=pieces, g=given: float(_local(g, p[i][1]).min()))  # type: ignore[misc]
        corners, frame = pieces[place]
        local = _local(given, frame)
        if local.max() > 1 - 2 * snap:
            seats[k] = corners[np.argmax(local)]
            continue
        within = np.maximum(local, snap) / np.maximum(local, snap).sum() @ frame
        seats[k] = mesh.n_vertices + len(faces)
        faces.append(face)
        weights.append(within)
        pieces[place : place + 1] = [_piece(pieces[place], corner, int(seats[k]), within) for corner in range(3)]
    new = SurfacePoints(np.array(faces, np.int64), np.array(weights).reshape(-1, 3))
    return Inserted(*_assembled(mesh, split, new, seats), new)


def _assembled(
    mesh: Mesh, split: dict[int, list[Piece]], new: SurfacePoints, seats: Int[np.ndarray, "k"]
) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """The mesh, the vertices of the places, and the origin of each face: whole faces first."""
    whole = np.delete(np.arange(mesh.n_faces), list(split))
    parts = np.array([corners for pieces in split.values() for corners, _ in pieces], np.int64).reshape(-1, 3)
    owner = np.repeat(np.array(list(split), np.int64), [len(pieces) for pieces in split.values()])
    vertices = np.concatenate([mesh.vertices, new.positions(mesh)])
    return Mesh(vertices, np.concatenate([mesh.faces[whole], parts])), seats, np.concatenate([whole, owner])


def _piece(whole: Piece, corner: int, vertex: int, weights: Float[np.ndarray, "3"]) -> Piece:
    """The part of a triangle whose corner has moved to a vertex inside."""
    corners, frame = np.array(whole[0]), np.array(whole[1])
    corners[corner], frame[corner] = vertex, weights
    return corners, frame


def _local(weights: Float[np.ndarray, "3"], frame: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Weights in the corners of a part of the face."""
    return np.linalg.solve(frame.T, weights)
