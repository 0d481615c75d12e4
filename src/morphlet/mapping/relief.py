"""Relief: how far a surface stands out from its smoothed self, the muscles and bones that the poses of one animal share.

A map that stretches little is still free to slide along a back or a neck. What holds it there is what the surfaces look like: h, the
height of a vertex above the surface smoothed over some distance, along the normal and in units of that distance, changes little with the
pose. With k the relief of the target under the images,

    R = SHARE sum_v a_v EASE log(1 + |h_v - k(p_v)|^2 / EASE^2)

is added to the energy of the last relaxation: what is unlike by far hardly pulls, since different animals do not share all of it.
Derivatives go through a smoothed gradient of k on the target's sphere, as those of the chords do.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.numerics.linalg import analyse
from morphlet.sphere.map import SphericalMap
from morphlet.surface.mesh import Mesh
from morphlet.surface.operators import laplacian

SCALES = (0.01, 0.02, 0.04)
"""Distances of smoothing, over the square root of the area: at twice the last, true places are no more alike than others near them."""
DIFFUSIONS = 2
"""Implicit steps of the smoothing."""
SPREAD = 0.13
"""Relief is told in this unit: its standard deviation on horses, cats, wolves and the package's creatures is 0.09 to 0.19 at each scale."""
SHARE, EASE = 0.5, 0.3
"""Weight beside the chord energy, and the difference, in spreads, that pulls most."""
LEAST_MASS = 1e-12
"""Share of the area that a vertex has at least: degenerate faces leave some without."""
TINY = np.finfo(float).tiny


def relief(mesh: Mesh) -> Float[np.ndarray, "n s"]:
    """Height of each vertex above the surface smoothed over each of `SCALES`, along its normal, in units of scale and spread.

    Parameters
    ----------
    mesh
        A closed surface; without area it has no relief.

    Notes
    -----
    One factorization per scale and three solves with it. Lengths are relative to the square root of the area.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.mapping.relief import relief
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = relief(Mesh(*icosphere(3)))
    >>> ball.shape, bool(np.ptp(ball, axis=0).max() < 0.1)
    ((642, 3), True)
    """
    if not mesh.area > 0:
        return np.zeros((mesh.n_vertices, len(SCALES)))
    X, mass = mesh.vertices / np.sqrt(mesh.area), np.maximum(mesh.vertex_areas / mesh.area, LEAST_MASS)
    lower = _stiffness(mesh)
    analysis, diagonal = analyse(lower.indptr.astype(np.int64), lower.indices.astype(np.int64), mesh.vertices), lower.indptr[:-1]
    heights = []
    for scale in SCALES:
        system = scale**2 / (2 * DIFFUSIONS) * lower.data
        system[diagonal] += mass
        factor, smooth = analysis.factor(system), X
        for _ in range(DIFFUSIONS):
            smooth = factor.solve(mass[:, None] * smooth)
        height = np.einsum("nd,nd->n", X - smooth, mesh.vertex_normals)
        heights.append(factor.solve(mass * height) / (scale * SPREAD))
    return np.stack(heights, axis=1)


def _stiffness(mesh: Mesh) -> sp.csc_array:
    """Lower triangle of the Laplacian with weights that are not negative; each diagonal entry is there, be it zero."""
    off = laplacian(mesh)
    off.setdiag(0)
    off.data = np.minimum(off.data, 0)
    below, own = sp.tril(off, -1, format="coo"), np.arange(mesh.n_vertices)
    values = np.concatenate([-np.asarray(off.sum(axis=1)).ravel(), below.data])
    lower = sp.csc_array((values, (np.concatenate([own, below.row]), np.concatenate([own, below.col]))), shape=off.shape)
    lower.sort_indices()
    return lower


@dataclass(frozen=True, eq=False)
class Likeness:
    """The relief of a source, and that of a target where a sphere leads to it, ready to be compared.

    Parameters
    ----------
    own
        Relief of the source's vertices.
    weight
        Area of each, times `SHARE`.
    points, corners
        The target's sphere and its faces.
    other, slopes
        Relief of the target's vertices and its smoothed gradient along the sphere.
    """

    own: Float[np.ndarray, "n s"]
    weight: Float[np.ndarray, "n"]
    points: Float[np.ndarray, "N 3"]
    corners: Int[np.ndarray, "M 3"]
    other: Float[np.ndarray, "N s"]
    slopes: Float[np.ndarray, "N s 3"]

    @staticmethod
    def prepare(source: Mesh, area: Float[np.ndarray, "n"], target: SphericalMap) -> "Likeness":
        """Both reliefs; `area` is that of the source's vertices, 4 pi in all."""
        surface, points = target.surface.mesh, target.closed_points
        other = relief(surface)
        return Likeness(relief(source), SHARE * area, points, surface.faces, other, _slopes(points, surface.faces, other))

    def value(self, S: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "n"]) -> float:
        """R for images in these faces of the target."""
        gap = self._compared(S, faces)[0]
        return float(np.einsum("n,n->", self.weight, EASE * np.log1p(np.einsum("ns,ns->n", gap, gap) / EASE**2)))

    def add(
        self,
        frames: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 2 3"]],
        faces: Int[np.ndarray, "n"],
        gradient: Float[np.ndarray, "d"],
        hessian: Float[np.ndarray, "z"],
        diagonal: Int[np.ndarray, "d"],
    ) -> None:
        """Add its derivatives at points S with tangents T (`frames`); of second ones those of a majorant with k taken as linear."""
        S, T = frames
        gap, weights = self._compared(S, faces)
        slope = np.einsum("nk,nksd,nad->nsa", weights, self.slopes[self.corners[faces]], T)
        pull = 2 * EASE * self.weight / (EASE**2 + np.einsum("ns,ns->n", gap, gap))
        gradient -= np.einsum("n,ns,nsa->na", pull, gap, slope).ravel()
        block = np.einsum("n,nsa,nsb->nab", pull, slope, slope)
        for row, column in ((0, 0), (1, 0), (1, 1)):
            hessian[diagonal[column::2] + row - column] += block[:, row, column]

    def _compared(self, S: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "n"]) -> tuple[np.ndarray, np.ndarray]:
        """Difference of relief, and the weights of the corners under each point."""
        at = self.corners[faces]
        a, b, c = self.points[at[:, 0]], self.points[at[:, 1]], self.points[at[:, 2]]
        weights = np.stack([np.einsum("nd,nd->n", np.cross(x, y), S) for x, y in ((b, c), (c, a), (a, b))], axis=1)
        weights /= weights.sum(axis=1, keepdims=True)
        return self.own - np.einsum("nk,nks->ns", weights, self.other[at]), weights


def _slopes(
    points: Float[np.ndarray, "N 3"], faces: Int[np.ndarray, "M 3"], values: Float[np.ndarray, "N s"]
) -> Float[np.ndarray, "N s 3"]:
    """Gradient of values along the chord triangles, averaged at their corners by area."""
    corner = points[faces]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    share = np.linalg.norm(normal, axis=1)
    opposite = np.roll(corner, 1, axis=1) - np.roll(corner, -1, axis=1)  # from corner i + 1 to corner i + 2
    turned = np.cross(normal[:, None] / np.maximum(share, TINY)[:, None, None], opposite)  # of length 2 A / height
    gradient = np.einsum("mis,mid->msd", values[faces], turned).reshape(len(faces), -1)
    total = np.stack([np.bincount(faces.ravel(), np.repeat(column, 3), len(points)) for column in gradient.T], axis=1)
    return (total / np.bincount(faces.ravel(), np.repeat(share, 3), len(points))[:, None]).reshape(len(points), -1, 3)
