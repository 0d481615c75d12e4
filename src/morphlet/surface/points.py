"""Places on a mesh, by face and barycentric weights."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh

WEIGHT_TOLERANCE = 1e-9
"""How far weights may be negative or miss the sum 1 (relative rounding of a few operations)."""


@dataclass(frozen=True, eq=False)
class SurfacePoints:
    """k places: the face each lies in, and its weights in the order of that face's corners.

    Parameters
    ----------
    faces
        Face index of each place.
    weights
        Barycentric weights, non-negative, summing to 1.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> triangle = Mesh([[0, 0, 0], [3, 0, 0], [0, 3, 0]], [[0, 1, 2]])
    >>> SurfacePoints([0], [[1 / 3, 1 / 3, 1 / 3]]).positions(triangle)
    array([[1., 1., 0.]])
    """

    faces: Int[np.ndarray, "k"]
    weights: Float[np.ndarray, "k 3"]

    def __post_init__(self) -> None:
        faces = _arrays.index(self.faces, "faces", (None,), np.iinfo(np.int64).max)
        weights = _arrays.real(self.weights, "weights", (len(faces), 3))
        wrong = np.nonzero((weights.min(axis=1) < -WEIGHT_TOLERANCE) | (np.abs(weights.sum(axis=1) - 1) > WEIGHT_TOLERANCE))[0]
        if len(wrong):
            raise InputError("weights >= 0 that sum to 1", f"{len(wrong)} rows that do not", "normalise the rows", wrong)
        object.__setattr__(self, "faces", faces)
        object.__setattr__(self, "weights", weights)

    def __reduce__(self) -> tuple[Any, ...]:
        return SurfacePoints, (np.array(self.faces), np.array(self.weights))

    def __len__(self) -> int:
        return len(self.faces)

    def positions(self, mesh: Mesh) -> Float[np.ndarray, "k 3"]:
        """Where the places are on this mesh."""
        return np.einsum("kc,kcd->kd", self.weights, mesh.vertices[mesh.faces[self.faces]])

    def matrix(self, mesh: Mesh) -> sp.csr_matrix:
        """(k, n) matrix that interpolates values at the vertices of `mesh` to the places."""
        rows = np.repeat(np.arange(len(self)), 3)
        columns = mesh.faces[self.faces].ravel()
        return sp.csr_matrix((self.weights.ravel(), (rows, columns)), shape=(len(self), mesh.n_vertices))
