"""FacePairs: which triangles of one mesh go with which of another, many to many: what a transfer of deformations follows."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from morphlet import _arrays
from morphlet.errors import MeshError
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import NO_BOUND

NEAREST = 20
"""Faces among which the first is taken that looks the same way (Sumner and Popovic's corresponding tool takes as many)."""


@dataclass(frozen=True, eq=False)
class FacePairs:
    """p pairs of faces; a face may be in none or in several.

    Parameters
    ----------
    source, target
        Face index in the source and in the target mesh.

    Examples
    --------
    >>> from morphlet.motion.face_pairs import FacePairs
    >>> len(FacePairs([0, 0, 1], [4, 5, 5]))
    3
    """

    source: Int[np.ndarray, "p"]
    target: Int[np.ndarray, "p"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "source", _arrays.index(self.source, "source", (None,), NO_BOUND))
        object.__setattr__(self, "target", _arrays.index(self.target, "target", (len(self.source),), NO_BOUND))

    def __reduce__(self) -> tuple[Any, ...]:
        return FacePairs, (np.array(self.source), np.array(self.target))

    def __len__(self) -> int:
        return len(self.source)

    def checked(self, source: Mesh, target: Mesh) -> "FacePairs":
        """These pairs, once it is certain that both meshes have their faces.

        Raises
        ------
        InputError
            If an index is not a face of its mesh.
        """
        _arrays.index(self.source, "the source column of the pairs", (None,), source.n_faces)
        _arrays.index(self.target, "the target column of the pairs", (None,), target.n_faces)
        return self


def pair_faces(laid: Mesh, target: Mesh) -> FacePairs:
    """Pairs of faces that lie side by side, for a source that was laid onto the target.

    Each face of either mesh is paired with the nearest of the other whose normal is within 90 degrees of its own, if that is
    among the 20 with the nearest centroids.

    Parameters
    ----------
    laid
        The source, its vertices where they belong on the target: from `register`, or `mesh.with_vertices(c.positions)` for
        a correspondence c.
    target
        What it was laid on.

    Returns
    -------
    FacePairs
        From the source's faces to the target's, each pair once. Faces without an area are in none.

    Raises
    ------
    MeshError
        If a mesh has no face with an area.

    Notes
    -----
    O(m log m); 0.1 CPU s for 14k and 10k faces.

    References
    ----------
    Sumner and Popovic, Deformation transfer for triangle meshes, SIGGRAPH 2004.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.motion.face_pairs import pair_faces
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(1))
    >>> pairs = pair_faces(ball, ball)
    >>> len(pairs), bool((pairs.source == pairs.target).all())
    (80, True)
    """
    there, back = _nearest_alike(laid, target), _nearest_alike(target, laid)[:, ::-1]
    both = np.unique(np.vstack([there, back]), axis=0)
    return FacePairs(both[:, 0], both[:, 1])


def _nearest_alike(first: Mesh, second: Mesh) -> Int[np.ndarray, "k 2"]:
    """Each face of the first mesh with the nearest of the second that looks to the same side."""
    own, other = _solid(first), _solid(second)
    count = min(NEAREST, len(other))
    near = other[cKDTree(_centroids(second, other)).query(_centroids(first, own), k=np.arange(1, count + 1))[1]]
    alike = np.einsum("nkd,nd->nk", second.face_normals[near], first.face_normals[own]) > 0
    found = alike.any(axis=1)
    return np.stack([own[found], near[found, np.argmax(alike[found], axis=1)]], axis=1)


def _centroids(mesh: Mesh, faces: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k 3"]:
    """Centroids of some faces."""
    return mesh.vertices[mesh.faces[faces]].mean(axis=1)


def _solid(mesh: Mesh) -> Int[np.ndarray, "k"]:
    """Faces that have a normal."""
    solid = np.flatnonzero(mesh.face_areas > 0)
    if not len(solid):
        raise MeshError("faces that have an area", f"none among {mesh.n_faces}", "pass a mesh that has a surface")
    return solid
