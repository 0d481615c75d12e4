"""This vertex of one mesh goes with that of another: what matching yields, and what a marker file is."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh

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
        weight = _arrays.real(np.ones(len(source)) if self.weight is None else self.weight, "weight", (len(source),))
        if np.any(weight <= 0):
            raise InputError("positive weights", f"{int(np.sum(weight <= 0))} that are not", "drop these pairs", np.nonzero(weight <= 0)[0])
        labels = tuple(self.labels) or ("",) * len(source)
        if len(labels) != len(source):
            raise InputError(f"{len(source)} labels", str(len(labels)), "give one label per pair, or none")
        for name, value in (("source", source), ("target", target), ("weight", weight), ("labels", labels)):
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return VertexPairs, (np.array(self.source), np.array(self.target), np.array(self.weight), self.labels)

    def __len__(self) -> int:
        return len(self.source)

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
