"""A gradient path on which each resolution has its own time, and turns with the faces that it is part of."""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from morphlet.motion.bands import Bands
from morphlet.motion.mixture import SYMMETRIC, Mixture, stretches_of
from morphlet.numerics.rotations import exponential
from morphlet.surface.mesh import Mesh

SMOOTHINGS = 10
"""Means over neighbours by which the turns of faces become those of what a wrinkle lies on; without them a wrinkle that goes makes
a surface a fifth rougher on the way, with five or more not a hundredth."""


@dataclass(frozen=True, eq=False)
class BandedMixture:
    """Source and target, mixed with a share for each band.

    Faces turn by the mean of the shares. To the gradients of a face is added, turned as its surroundings are, what each band that
    is ahead or behind makes of it: so a wrinkle on a limb turns with the limb, which positions in space do not know of.

    Parameters
    ----------
    mixture
        Of source and target.
    turns
        Rotation vector of the surroundings of each face, beside the turn of the whole.
    differences
        Gradients of each band of the target, turned back with the surroundings, less those of the source.
    """

    mixture: Mixture
    turns: Float[np.ndarray, "m 3"]
    differences: Float[np.ndarray, "b m 2 3"]

    @staticmethod
    def prepare(mixture: Mixture, bands: Bands) -> "BandedMixture":
        """From the bands of the two shapes of a mixture.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.motion.banded import BandedMixture
        >>> from morphlet.motion.bands import Bands
        >>> from morphlet.motion.mixture import Mixture
        >>> from morphlet.numerics.unit_sphere import icosphere
        >>> points, faces = icosphere(2)
        >>> ends = np.stack([points, 2 * points])
        >>> path = BandedMixture.prepare(Mixture.prepare(Mesh(points, faces), ends), Bands(ends[:1], ends[1:]))
        >>> bool(abs(path(np.array([[0.5]])) - 1.5 * points).max() < 1e-12)
        True
        """
        system, changes = mixture.system, mixture.changes
        turns = _smoothed(system.rest, changes.turns[1])
        back = exponential(changes.whole[1:]) @ exponential(turns)
        found = [system.gradients(b) @ back - system.gradients(a) for a, b in zip(bands.source, bands.target, strict=True)]
        return BandedMixture(mixture, turns, np.stack(found))

    def __call__(self, shares: Float[np.ndarray, "b q"]) -> Float[np.ndarray, "n 3"]:
        """Positions where each band has gone this share of its way: one column for all vertices, or one for each.

        Notes
        -----
        20 CPU ms for 8k vertices and six bands.
        """
        mean, changes = shares.mean(axis=0), self.mixture.changes
        plane, wanted = self.mixture.mixed(weights := np.stack([1 - mean, mean]))
        own = self.mixture.of_faces(weights)[1][:, None]
        apart = np.einsum("bm,bmij->mij", self.mixture.of_faces(shares - mean), self.differences)
        turns = exponential(own * changes.whole[1]) @ exponential(own * self.turns)
        wanted = wanted + apart @ turns.transpose(0, 2, 1)
        plane = np.ascontiguousarray(stretches_of(wanted)[:, SYMMETRIC])
        reached = np.array([shares.min(), shares.max()])
        return self.mixture.settled(plane, wanted, weights, np.stack([1 - reached, reached]))


def _smoothed(mesh: Mesh, turns: Float[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Means over neighbours, weighted by area, again and again; faces without an area among their like keep what they have."""
    m = mesh.n_faces
    around = sp.csr_matrix((np.repeat(mesh.face_areas, 3), (mesh.faces.ravel(), np.repeat(np.arange(m), 3))), shape=(mesh.n_vertices, m))
    total = np.asarray(around.sum(axis=1))
    known = (total[mesh.faces, 0] > 0).all(axis=1, keepdims=True)
    for _ in range(SMOOTHINGS):
        at_vertices = (around @ turns) / np.where(total > 0, total, 1.0)
        turns = np.where(known, at_vertices[mesh.faces].mean(axis=1), turns)
    return turns
