"""Even stretch: the metric that a source's triangles would have if what its map stretches were spread over their neighbourhood.

Animals of different proportions are not isometric. An energy that compares each triangle with its own shape pays for a longer leg
wherever the leg is stretched, and shifts the stretch to where it is cheapest: knees slide. What makes a map wrong is not that it
stretches but that it does so unevenly. So, once a map is nearly right, the metric C that each triangle has in its image, as the logarithm
of a matrix in the triangle's plane, is averaged over the surface, and the triangles are compared with that: a leg that is stretched
evenly is as good as one that is not stretched at all. Repeated, the map and the metric follow each other. Matrices are averaged as
matrices of space: where planes turn within the reach, as around a limb, part of the stretch is lost, so that girth holds more firmly
than length. Poses of one animal hardly stretch at all: there the triangles' own shape is the better guide, and the less stretch is left
after averaging, the less of it is excused.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet.mapping.metric import COLUMNS, ROWS
from morphlet.numerics.linalg import Factor, analyse
from morphlet.sphere.energy import Reference
from morphlet.sphere.level import Level

REACH = 0.3
"""Radians of a sphere of equal area over which stretch is averaged, 8 % of sqrt(area): about the width of a leg (0.15 to 0.6 made errors
smaller on the same pairs, 0.3 most)."""
DIFFUSIONS = 3
"""Implicit steps of the averaging: together close to a Gaussian."""
PROPORTIONS = 0.18
"""Averaged stretch (root mean square over the surface of the norm of the logarithm of the metric) of which half is excused: 0.10 was seen
between poses of one animal, up to 0.24 with strong bends, from 0.27 between different ones."""
MOST = float(np.log(9.0))
"""Logarithm of the largest squared stretch that counts: images that are three times as long or more are degenerate."""
TINY = np.finfo(float).tiny


@dataclass(frozen=True, eq=False)
class Evening:
    """A level of the source, ready to have the stretch of its images spread.

    Parameters
    ----------
    faces
        The triangles.
    own
        Their own metric, in which images are compared, and their weights.
    axes
        Two orthonormal vectors in the plane of each triangle, the first along the edge from corner 0 to corner 1.
    edges
        The edges from corner 0 to corners 1 and 2 in these axes, as columns.
    mass
        Area of each vertex.
    factor
        Of one step of diffusion.
    """

    faces: Int[np.ndarray, "m 3"]
    own: Reference
    axes: Float[np.ndarray, "m 2 3"]
    edges: Float[np.ndarray, "m 2 2"]
    mass: Float[np.ndarray, "n"]
    factor: Factor

    @staticmethod
    def prepare(level: Level) -> "Evening":
        """Frames and the factorization; about that of one Laplacian."""
        F, n = level.F, len(level.V)
        mass = np.bincount(F.ravel(), np.repeat(1 / (6 * level.reference.inverse), 3), n)
        system = sp.tril(sp.diags_array(mass) + REACH**2 / (2 * DIFFUSIONS) * _laplacian(level), format="csc")
        system.sort_indices()
        factor = analyse(system.indptr.astype(np.int64), system.indices.astype(np.int64), level.V).factor(system.data)
        return Evening(F, level.reference, _axes(level.V, F), _edges(level.reference), mass, factor)

    def reference(self, images: Float[np.ndarray, "n 3"]) -> Reference:
        """The metric of triangles whose images stretch the surface evenly; weights as they were."""
        logs = self._excused(self._spread(self._logarithms(images)))
        metric = np.swapaxes(self.edges, 1, 2) @ _through(logs, np.exp) @ self.edges
        inverse = self.own.inverse * np.exp(-(logs[:, 0, 0] + logs[:, 1, 1]) / 2)
        first, mixed, second = metric[:, 0, 0], metric[:, 0, 1], metric[:, 1, 1]
        k = np.stack([mixed, first - mixed, second - mixed], axis=1)
        return self.own._replace(k=k * inverse[:, None] ** 2, inverse=inverse)

    def _logarithms(self, images: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 2 2"]:
        """Logarithm of each triangle's metric in its image."""
        F = self.faces
        sides = np.stack([images[F[:, 1]] - images[F[:, 0]], images[F[:, 2]] - images[F[:, 0]]], axis=2)
        stretched = sides @ np.linalg.inv(self.edges)
        return _through(np.swapaxes(stretched, 1, 2) @ stretched, _bounded_log)

    def _excused(self, logs: Float[np.ndarray, "m 2 2"]) -> Float[np.ndarray, "m 2 2"]:
        """The share of averaged stretch that proportions may explain: nearly all where there is much, nearly none where there is little."""
        much = float(np.average(np.einsum("mab,mab->m", logs, logs), weights=self.own.weight)) ** 2
        return logs * (much / (much + PROPORTIONS**4))

    def _spread(self, logs: Float[np.ndarray, "m 2 2"]) -> Float[np.ndarray, "m 2 2"]:
        """Averaged over the surface, as matrices of space."""
        corners, weight, n = self.faces.ravel(), self.own.weight, len(self.mass)
        solid = np.einsum("mai,mab,mbj->mij", self.axes, logs, self.axes)[:, ROWS, COLUMNS]
        total = np.stack([np.bincount(corners, np.repeat(weight * entry, 3), n) for entry in solid.T], axis=1)
        mean = total / np.maximum(np.bincount(corners, np.repeat(weight, 3), n), TINY)[:, None]
        for _ in range(DIFFUSIONS):
            mean = self.factor.solve(self.mass[:, None] * mean)
        whole = np.empty((len(self.faces), 3, 3))
        whole[:, ROWS, COLUMNS] = whole[:, COLUMNS, ROWS] = mean[self.faces].mean(axis=1)
        return np.einsum("mai,mij,mbj->mab", self.axes, whole, self.axes)


def _laplacian(level: Level) -> sp.csc_array:
    """The source's Laplacian, with weights that are not negative."""
    F, n = level.F, len(level.V)
    weight = (level.reference.k / (2 * level.reference.inverse[:, None])).ravel()
    i, j = np.roll(F, -1, axis=1).ravel(), np.roll(F, -2, axis=1).ravel()
    edges = sp.csc_array((weight, (np.maximum(i, j), np.minimum(i, j))), shape=(n, n))
    edges.data = np.maximum(edges.data, 0.0)
    both = edges + edges.T
    return sp.csc_array(sp.diags_array(both.sum(axis=1)) - both)


def _axes(V: Float[np.ndarray, "n 3"], F: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 2 3"]:
    """Orthonormal vectors in the planes of triangles; zero where a triangle has none."""
    along, other = V[F[:, 1]] - V[F[:, 0]], V[F[:, 2]] - V[F[:, 0]]
    first = along / np.maximum(np.linalg.norm(along, axis=1, keepdims=True), TINY)
    second = other - np.sum(other * first, axis=1, keepdims=True) * first
    return np.stack([first, second / np.maximum(np.linalg.norm(second, axis=1, keepdims=True), TINY)], axis=1)


def _edges(reference: Reference) -> Float[np.ndarray, "m 2 2"]:
    """Two edges of each triangle in its plane, from its metric: the squared edge opposite corner i is (k_j + k_k) / inverse^2."""
    squares = (reference.k.sum(axis=1, keepdims=True) - reference.k) / reference.inverse[:, None] ** 2
    length = np.sqrt(squares[:, 2])
    edges = np.zeros((len(squares), 2, 2))
    edges[:, 0, 0], edges[:, 0, 1] = length, reference.k[:, 0] / reference.inverse**2 / length
    edges[:, 1, 1] = 1 / (reference.inverse * length)
    return edges


def _through(matrices: Float[np.ndarray, "m 2 2"], function: Callable[[np.ndarray], np.ndarray]) -> Float[np.ndarray, "m 2 2"]:
    """A function of symmetric matrices."""
    values, vectors = np.linalg.eigh(matrices)
    return np.einsum("mae,me,mbe->mab", vectors, function(values), vectors)


def _bounded_log(values: np.ndarray) -> np.ndarray:
    """The logarithm, within `MOST` of 0."""
    return np.clip(np.log(np.maximum(values, TINY)), -MOST, MOST)
