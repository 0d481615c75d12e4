"""Enclosed: the volume inside a surface, its small holes closed, as a function of the positions."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.errors import MeshError
from morphlet.numerics.compiled import kernel
from morphlet.surface.mesh import Mesh

OPEN_SHARE = 0.1
"""Share of the surface's area that the fans over its holes may have: a body with small holes still encloses a volume, a bowl or a
cloth does not."""


@dataclass(frozen=True, eq=False)
class Enclosed:
    """The volume inside a surface.

    Parameters
    ----------
    faces
        Of the surface, and of a fan over each hole from its rim to the mean of it.
    centres
        From positions to those of the vertices and fan centres.
    """

    faces: Int[np.ndarray, "f 3"]
    centres: sp.csr_matrix

    @staticmethod
    def of(mesh: Mesh) -> "Enclosed | None":
        """What a mesh encloses; None if it has no faces, its holes are large, or its borders are not loops.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> open_corner = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3]])
        >>> Enclosed.of(open_corner) is None
        True
        """
        try:
            loops = mesh.topology.boundary_loops
        except MeshError:
            return None
        n = mesh.n_vertices
        fans = [np.stack([np.roll(loop, -1), loop, np.full(len(loop), n + i)], axis=1) for i, loop in enumerate(loops)]
        means = [sp.csr_matrix((np.full(len(loop), 1 / len(loop)), (np.zeros(len(loop), int), loop)), (1, n)) for loop in loops]
        found = Enclosed(np.concatenate([mesh.faces, *fans]), sp.vstack([sp.identity(n, format="csr"), *means]).tocsr())
        area = Mesh(found.centres @ mesh.vertices, found.faces).area
        return found if 0 < area <= (1 + OPEN_SHARE) * mesh.area else None

    def slopes(self, positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """How the volume changes with each position; a third of their product with the positions is the volume."""
        slopes = np.zeros((self.centres.shape[0], 3))
        _add_area_vectors(self.centres @ positions, self.faces, slopes)
        return self.centres.T @ slopes

    def volume(self, positions: Float[np.ndarray, "n 3"]) -> float:
        """Volume inside, signed."""
        return float(np.sum(positions * self.slopes(positions))) / 3


@kernel
def _add_area_vectors(x, faces, out):  # type: ignore[no-untyped-def]
    # A third of the area vector of each face to its corners: x (n, 3), faces (m, 3), out (n, 3).
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        for k in range(3):
            i, j = (k + 1) % 3, (k + 2) % 3
            part = ((x[b, i] - x[a, i]) * (x[c, j] - x[a, j]) - (x[b, j] - x[a, j]) * (x[c, i] - x[a, i])) / 6
            out[a, k] += part
            out[b, k] += part
            out[c, k] += part
