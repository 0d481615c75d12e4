"""Some vertices of a mesh, and the patch they span."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Int

from morphlet import _arrays
from morphlet.surface.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Region:
    """A set of vertices of a mesh, sorted.

    Examples
    --------
    >>> from morphlet import Mesh, Region
    >>> square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> Region(square, [2, 0, 1]).patch.n_faces
    1
    """

    mesh: Mesh
    vertices: Int[np.ndarray, "k"]

    def __post_init__(self) -> None:
        vertices = _arrays.index(self.vertices, "vertices", (None,), self.mesh.n_vertices)
        object.__setattr__(self, "vertices", _arrays.freeze(np.unique(vertices)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Region, (self.mesh, np.array(self.vertices))

    def __len__(self) -> int:
        return len(self.vertices)

    @cached_property
    def boundary(self) -> Int[np.ndarray, "b"]:
        """Vertices of the region that have a neighbour outside it."""
        inside = np.zeros(self.mesh.n_vertices, bool)
        inside[self.vertices] = True
        leaving = inside[self.mesh.topology.edges[:, 0]] != inside[self.mesh.topology.edges[:, 1]]
        ends = np.unique(self.mesh.topology.edges[leaving])
        return _arrays.freeze(ends[inside[ends]])

    @cached_property
    def patch(self) -> Mesh:
        """The faces whose three corners are in the region; its vertex i is `vertices[i]` of the whole mesh."""
        local = np.full(self.mesh.n_vertices, -1, np.int64)
        local[self.vertices] = np.arange(len(self.vertices))
        faces = local[self.mesh.faces]
        return Mesh(self.mesh.vertices[self.vertices], faces[np.all(faces >= 0, axis=1)])
