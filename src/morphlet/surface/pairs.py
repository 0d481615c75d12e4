"""This place of one mesh goes with that of another: vertices, which are what matching yields and marker files hold, or any points."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh
from morphlet.surface.points import SurfacePoints

NO_BOUND = np.iinfo(np.int64).max
"""Pairs do not know their meshes: `checked` compares them with their vertex counts."""


@dataclass(frozen=True, eq=False)
class VertexPairs:
    """p pairs of vertices, with weights and labels.

    Parameters
    ----------
    source, target
        Vertex index in the source and in the target mesh.
    weight
        Positive importance of each pair; 1 if left out.
    labels
        A name per pair; empty if left out.

    Examples
    --------
    >>> from morphlet import VertexPairs
    >>> pairs = VertexPairs([0, 5], [3, 9], labels=("nose", "tail"))
    >>> len(pairs), pairs.weight
    (2, array([1., 1.]))
    """

    source: Int[np.ndarray, "p"]
    target: Int[np.ndarray, "p"]
    weight: Float[np.ndarray, "p"] | None = None
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        source = _arrays.index(self.source, "source", (None,), NO_BOUND)
        target = _arrays.index(self.target, "target", (len(source),), NO_BOUND)
        weight, labels = _told(self.weight, self.labels, len(source))
        for name, value in (("source", source), ("target", target), ("weight", weight), ("labels", labels)):
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return VertexPairs, (np.array(self.source), np.array(self.target), np.array(self.weight), self.labels)

    def __len__(self) -> int:
        return len(self.source)

    def chosen(self, kept: Int[np.ndarray, "k"]) -> "VertexPairs":
        """Some of them."""
        return VertexPairs(self.source[kept], self.target[kept], np.array(self.weight)[kept], tuple(self.labels[k] for k in kept))

    def distinct(self) -> "VertexPairs":
        """These pairs without repeats: the first of each stays."""
        columns = np.stack([self.source, self.target], axis=1)
        return self.chosen(np.sort(np.unique(columns, axis=0, return_index=True)[1]))

    def checked(self, source: Mesh, target: Mesh) -> "VertexPairs":
        """These pairs, once it is certain that both meshes have their vertices.

        Raises
        ------
        InputError
            If an index is not a vertex of its mesh.
        """
        _arrays.index(self.source, "the source column of the pairs", (None,), source.n_vertices)
        _arrays.index(self.target, "the target column of the pairs", (None,), target.n_vertices)
        return self

    def answered(self, source: Bool[np.ndarray, "n"], target: Bool[np.ndarray, "n"]) -> "VertexPairs":
        """These pairs, once it is certain that all their vertices take part in what is made of their meshes.

        Parameters
        ----------
        source, target
            Which vertices do: `valid` of a `Repaired` or a `SphericalMap`.

        Raises
        ------
        InputError
            If a vertex is in no face, or on a part that was dropped.
        """
        for name, vertices, valid in (("source", self.source, source), ("target", self.target, target)):
            lost = vertices[~np.asarray(valid)[vertices]]
            if len(lost):
                found = f"{len(lost)} {name} vertices in no face, or on a dropped part"
                raise InputError("paired vertices on the surfaces that are mapped", found, "drop these pairs", lost)
        return self


@dataclass(frozen=True, eq=False)
class PointPairs:
    """p pairs of places anywhere on the faces of two meshes, with weights and labels.

    Parameters
    ----------
    source, target
        Places on the source and on the target mesh.
    weight
        Positive importance of each pair; 1 if left out.
    labels
        A name per pair; empty if left out.

    Examples
    --------
    >>> from morphlet import SurfacePoints
    >>> from morphlet.surface.pairs import PointPairs
    >>> middle = SurfacePoints([4], [[1 / 3, 1 / 3, 1 / 3]])
    >>> pairs = PointPairs(middle, SurfacePoints([9], [[0.5, 0.5, 0.0]]), labels=("navel",))
    >>> len(pairs), pairs.weight
    (1, array([1.]))
    """

    source: SurfacePoints
    target: SurfacePoints
    weight: Float[np.ndarray, "p"] | None = None
    labels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        p = len(self.source)
        if len(self.target) != p:
            raise InputError(f"{p} places on the target", str(len(self.target)), "give one place per place of the source")
        for name, value in zip(("weight", "labels"), _told(self.weight, self.labels, p), strict=True):
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return PointPairs, (self.source, self.target, np.array(self.weight), self.labels)

    def __len__(self) -> int:
        return len(self.source)

    def checked(self, source: Mesh, target: Mesh) -> "PointPairs":
        """These pairs, once it is certain that both meshes have their faces.

        Raises
        ------
        InputError
            If an index is not a face of its mesh.
        """
        _arrays.index(self.source.faces, "the source's faces in the pairs", (None,), source.n_faces)
        _arrays.index(self.target.faces, "the target's faces in the pairs", (None,), target.n_faces)
        return self


def _told(weight: Float[np.ndarray, "p"] | None, labels: tuple[str, ...], p: int) -> tuple[np.ndarray, tuple[str, ...]]:
    """Weights and labels of p pairs, checked."""
    checked = _arrays.real(np.ones(p) if weight is None else weight, "weight", (p,))
    if np.any(checked <= 0):
        found = f"{int(np.sum(checked <= 0))} that are not"
        raise InputError("positive weights", found, "drop these pairs", np.nonzero(checked <= 0)[0])
    names = tuple(labels) or ("",) * p
    if len(names) != p:
        raise InputError(f"{p} labels", str(len(names)), "give one label per pair, or none")
    return checked, names


NO_PAIRS = VertexPairs(np.zeros(0, np.int64), np.zeros(0, np.int64))
