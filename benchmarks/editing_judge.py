"""What became of a mesh under an edit.

`energy`: spokes-and-rims, half-cotangents unclamped, best rotations over all vertices, over the area at rest; it shares no code
with the methods that it judges (rotations by singular values). `strain`: rms of the relative change of edge lengths, percent.
`laplacian`: relative L2 error, over the surface, of the length of the mass-normalised Laplacian of the positions, by the rest's
operator. `volume`: signed change in percent, boundary loops closed by fans to their means; none for a surface without inside.
`pairs`: triangles that cut through each other and share no vertex.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from morphlet import Mesh
from morphlet.metrics import edge_strain_rms, laplacian_error
from morphlet.surface.intersections import self_intersections

FLAT = 1e-3
"""A closed surface whose volume is less than this share of its area to the power 3/2 has no inside to speak of."""


@dataclass(frozen=True)
class Figures:
    """What an edit is judged by."""

    energy: float
    strain: float
    laplacian: float
    volume: float | None
    pairs: int


@dataclass(frozen=True, eq=False)
class Judge:
    """A mesh at rest, made ready to judge its edits."""

    mesh: Mesh
    cotangents: np.ndarray
    around: sp.csr_matrix
    caps: np.ndarray

    @staticmethod
    def prepare(mesh: Mesh) -> "Judge":
        """Weights, faces round vertices, and fans of the mesh at rest."""
        F, n = mesh.faces, mesh.n_vertices
        around = sp.csr_matrix((np.ones(F.size), (F.ravel(), np.repeat(np.arange(len(F)), 3))), shape=(n, len(F)))
        loops = mesh.topology.boundary_loops
        caps = [np.column_stack([np.roll(loop, -1), loop, np.full(len(loop), n + k)]) for k, loop in enumerate(loops)]
        return Judge(mesh, _half_cotangents(mesh), around, np.concatenate([F, *caps]))

    def energy(self, positions: np.ndarray) -> float:
        """Spokes and rims, over the area at rest."""
        rest, now = _edges(self.mesh.vertices, self.mesh.faces), _edges(positions, self.mesh.faces)
        spread = np.einsum("fk,fki,fkj->fij", self.cotangents, rest, now)
        size = np.einsum("fk,fki,fki->f", self.cotangents, rest, rest) + np.einsum("fk,fki,fki->f", self.cotangents, now, now)
        cells = (self.around @ spread.reshape(-1, 9)).reshape(-1, 3, 3)
        values = np.linalg.svd(cells, compute_uv=False)
        best = values[:, 0] + values[:, 1] + np.sign(np.linalg.det(cells)) * values[:, 2]
        return float((3 * size.sum() - 2 * best.sum()) / 3 / self.mesh.area)

    def volume(self, positions: np.ndarray) -> float | None:
        """Signed change in percent."""
        before, after = self._enclosed(self.mesh.vertices), self._enclosed(positions)
        return None if abs(before) < FLAT * self.mesh.area**1.5 else 100 * (after - before) / abs(before)

    def figures(self, positions: np.ndarray) -> Figures:
        """All of them."""
        now = self.mesh.with_vertices(positions)
        strain, bent = edge_strain_rms(self.mesh, now), laplacian_error(self.mesh, now) / 100
        return Figures(self.energy(positions), strain, bent, self.volume(positions), len(self_intersections(now)))

    def _enclosed(self, positions: np.ndarray) -> float:
        """Volume within the faces and the fans."""
        means = [positions[loop].mean(axis=0) for loop in self.mesh.topology.boundary_loops]
        a, b, c = np.concatenate([positions, np.reshape(means, (-1, 3))])[self.caps].transpose(1, 0, 2)
        return float(np.einsum("fi,fi->", a, np.cross(b, c))) / 6


def crossing(mesh: Mesh) -> np.ndarray:
    """The triangles that cut through others that they share no vertex with."""
    return np.unique(self_intersections(mesh))


def _edges(positions: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """The edge across from each corner, as a vector, (m, 3, 3)."""
    corners = positions[faces]
    return np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)


def _half_cotangents(mesh: Mesh) -> np.ndarray:
    """Half the cotangent at each corner."""
    corners = mesh.vertices[mesh.faces]
    u, v = np.roll(corners, -1, axis=1) - corners, np.roll(corners, -2, axis=1) - corners
    return 0.5 * (u * v).sum(axis=2) / np.maximum(np.linalg.norm(np.cross(u, v), axis=2), np.finfo(float).tiny)
