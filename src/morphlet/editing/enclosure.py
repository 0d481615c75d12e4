"""The volume that a mesh encloses, as a function of the vertices that an edit moves.

Holes count as closed by fans from their rims to the mean of these. Only the faces that move are looked at: the others
contribute a constant.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.editing.roi import Roi
from morphlet.surface.mesh import Mesh

OPEN_SHARE = 1 / 3
"""Fans larger than this share of the mesh's area do not close a body: those of a tube three diameters long are a sixth, that
of a disc is as large as the disc."""


@dataclass(frozen=True, eq=False)
class Enclosure:
    """The change of the enclosed volume.

    Parameters
    ----------
    rest
        Positions of the vertices and fan centres that the moving faces join, about a point among them.
    faces
        The moving faces, of the mesh and of the fans.
    spread
        From displacements of `Roi.moving` to those of these vertices and fan centres.
    volume
        What the moving faces contribute at rest.
    """

    rest: Float[np.ndarray, "q 3"]
    faces: Int[np.ndarray, "m 3"]
    spread: sp.csr_matrix
    volume: float

    @staticmethod
    def of(roi: Roi) -> "Enclosure | None":
        """The enclosure of the mesh; None if it encloses nothing: its holes are too large for what is left of it.

        Raises
        ------
        MeshError
            If the borders of the mesh are not loops.

        Examples
        --------
        >>> import numpy as np
        >>> from morphlet import Mesh
        >>> from morphlet.editing.enclosure import Enclosure
        >>> from morphlet.editing.roi import Roi
        >>> corner = Mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
        >>> round(6 * Enclosure.of(Roi(corner, [3], [])).change(np.array([[0, 0, 2.0]])), 12)
        2.0
        """
        closed, centres = _closed(roi.mesh)
        if closed.area > (1 + OPEN_SHARE) * roi.mesh.area:
            return None
        moving = centres[:, roi.moving]
        touched = np.diff(moving.indptr) > 0
        faces = closed.faces[touched[closed.faces].any(axis=1)]
        vertices, local = np.unique(faces, return_inverse=True)
        rest = closed.vertices[vertices]
        rest = rest - rest.mean(axis=0, keepdims=True) if len(rest) else rest
        local = local.reshape(-1, 3).astype(np.int64)
        return Enclosure(rest, local, moving[vertices], _volume(rest, local))

    def change(self, shift: Float[np.ndarray, "k 3"]) -> float:
        """How much more is enclosed when `Roi.moving` is displaced so."""
        return _volume(self.rest + self.spread @ shift, self.faces) - self.volume

    def gradient(self, shift: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
        """Derivative of the volume with respect to each position."""
        corner = (self.rest + self.spread @ shift)[self.faces]
        parts = np.cross(np.roll(corner, -1, axis=1), np.roll(corner, -2, axis=1)) / 6
        sums = [np.bincount(self.faces.ravel(), column, len(self.rest)) for column in parts.reshape(-1, 3).T]
        return self.spread.T @ np.stack(sums, axis=1)


def _closed(mesh: Mesh) -> tuple[Mesh, sp.csr_matrix]:
    """The mesh with a fan over each loop, and the matrix from its vertices to those and the fan centres."""
    loops, n = mesh.topology.boundary_loops, mesh.n_vertices
    fans = [np.stack([np.roll(loop, -1), loop, np.full(len(loop), n + i)], axis=1) for i, loop in enumerate(loops)]
    means = [sp.csr_matrix((np.full(len(loop), 1 / len(loop)), (np.zeros(len(loop), int), loop)), (1, n)) for loop in loops]
    centres = sp.vstack([sp.identity(n, format="csr"), *means]).tocsr()
    return Mesh(centres @ mesh.vertices, np.concatenate([mesh.faces, *fans])), centres


def _volume(x: Float[np.ndarray, "q 3"], faces: Int[np.ndarray, "m 3"]) -> float:
    """Signed volume of the cones from the origin over the faces."""
    a, b, c = (x[faces[:, k]] for k in range(3))
    return float(np.einsum("fd,fd->", a, np.cross(b, c))) / 6
