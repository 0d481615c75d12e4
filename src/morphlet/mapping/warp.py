"""The wavelet network that moves feature points of one sphere onto those of another (section 6.2).

A rotation brings paired points near each other, and no rotation can do more without moving points of one sphere against each
other. The rest is done by a network whose value at a point of the sphere is a velocity: fitted to the great circles from each
point to its goal, spread smoothly over the sphere, followed for one unit of time. A flow turns nothing over, however far it
goes; the triangles that it carries are flat only as far as they are small, so that `embedding` takes it as a start and not as
the map. The number of wavelets is the paper's knob: more of them follow the paths more closely.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.numerics.unit_sphere import exponential, fibonacci, logarithm
from morphlet.wavenet.mothers import PAPER_SIX
from morphlet.wavenet.spherical import SphericalNetwork, spherical_library
from morphlet.wavenet.spherical_fit import fit_sphere

SAMPLES = 2000
"""Points of the sphere at which the network follows the spread velocities, 4 degrees apart."""
LEVELS = 2
"""Of the finest centers: 162, 15 degrees apart."""
STATIONS = 5
"""Points of each path."""
WIDTH = 0.5
"""Radians. How far the velocity of a path reaches: half the distance of neighbouring limbs."""
SOFTNESS = 1e-3
"""Of the spreading, against its diagonal: paths that cross share their velocities."""
STEPS = 24
"""Runge-Kutta steps of the flow: 1e-8 rad off for a turn of one radian."""
FARTHEST = np.pi - 1e-3
"""A point opposite its goal has no shortest way there."""


@dataclass(frozen=True, eq=False)
class Warp:
    """A smooth one-to-one map of the sphere to itself: the flow of a wavelet network after one unit of time.

    Parameters
    ----------
    network
        Velocities, three outputs; what does not lie in the tangent plane is ignored.

    Examples
    --------
    >>> from morphlet.mapping.warp import warp_by_pairs
    >>> points = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [-0.6, 0, -0.8]])
    >>> goals = np.array([[0.96, 0.28, 0], [0, 1, 0], [0, 0, 1], [-0.6, 0, -0.8]])
    >>> warp = warp_by_pairs(points, goals, 60)
    >>> bool(np.abs(warp(points) - goals).max() < 0.05)
    True
    """

    network: SphericalNetwork

    def __post_init__(self) -> None:
        if self.network.affine.shape[1] != 3:
            raise InputError("a network with 3 outputs", str(self.network.affine.shape[1]), "fit it to velocities (n, 3)")

    def __call__(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Where the flow carries the points: unit vectors.

        Raises
        ------
        InputError
            If a point is zero or not finite; its length is ignored.

        Notes
        -----
        O(n) with a large constant: about 100 evaluations of the network.
        """
        points, step = _arrays.unit(points, "points"), 1 / STEPS
        for _ in range(STEPS):
            first = self.velocity(points)
            second = self.velocity(_unit(points + 0.5 * step * first))
            third = self.velocity(_unit(points + 0.5 * step * second))
            last = self.velocity(_unit(points + step * third))
            points = _unit(points + step * (first + 2 * second + 2 * third + last) / 6)
        return points

    def velocity(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Tangent velocity at unit vectors, in radians per unit of time."""
        return _tangent(points, self.network(points))


def warp_by_pairs(
    points: Float[np.ndarray, "p 3"], goals: Float[np.ndarray, "p 3"], n_wavelets: int = 15, weight: Float[np.ndarray, "p"] | None = None
) -> Warp:
    """The wavelet network's warp that moves points of the sphere towards their goals.

    Parameters
    ----------
    points, goals
        Unit vectors that belong together, after a rotation has brought them as near as it can.
    n_wavelets
        Of the network, all three outputs use the same; 15 in the paper.
    weight
        Importance of each pair; 1 if left out.

    Returns
    -------
    Warp
        How far the points stay from their goals is to be measured: it falls with the number of wavelets, not to zero.

    Raises
    ------
    InputError
        If shapes differ, there are no pairs, weights are not positive, or a goal lies opposite its point.

    Notes
    -----
    Velocities on the paths are spread over the sphere by Gaussians, then the network is fitted to them by orthogonal least
    squares from a library of the paper's six mothers. About 1 s.

    Examples
    --------
    >>> from morphlet.mapping.warp import warp_by_pairs
    >>> warp_by_pairs(np.eye(3), np.eye(3)).network
    SphericalNetwork(0 wavelets, 3 outputs)
    """
    points, goals = _arrays.unit(points, "points"), _arrays.unit(goals, "goals")
    weight = _arrays.real(np.ones(len(points)) if weight is None else weight, "weight", (len(points),))
    if len(points) != len(goals) or not len(points) or (weight <= 0).any():
        found = f"{len(points)} points, {len(goals)} goals, {int((weight <= 0).sum())} weights that are not"
        raise InputError("one goal per point, and positive weights", found, "pass pairs")
    ways = logarithm(points, goals)
    lengths = np.linalg.norm(ways, axis=1)
    lost = np.nonzero((np.einsum("pk,pk->p", points, goals) < 0) & ((lengths == 0) | (lengths > FARTHEST)))[0]
    if len(lost):
        raise InputError("goals that are not opposite their points", f"{len(lost)} that are", "turn the sphere first: align_by_pairs", lost)
    places, velocities = _paths(points, ways)
    grid = np.vstack([fibonacci(SAMPLES), places])
    areas = np.append(np.full(SAMPLES, 1 / SAMPLES), np.tile(weight / weight.sum() / STATIONS, STATIONS))
    library = spherical_library(PAPER_SIX, grid, areas, LEVELS)
    return Warp(fit_sphere(grid, _spread(places, velocities, grid), areas, library, n_wavelets).network)


def _paths(points: Float[np.ndarray, "p 3"], ways: Float[np.ndarray, "p 3"]) -> tuple[Float[np.ndarray, "q 3"], Float[np.ndarray, "q 3"]]:
    """Stations on the great circles, and the velocity there: constant, and tangent."""
    times = np.linspace(0, 1, STATIONS)
    places = np.concatenate([exponential(points, t * ways) for t in times])
    length = np.linalg.norm(ways, axis=1, keepdims=True)
    ahead = np.concatenate([-np.sin(t * length) * length * points + np.cos(t * length) * ways for t in times])
    return places, ahead


def _spread(
    places: Float[np.ndarray, "q 3"], velocities: Float[np.ndarray, "q 3"], grid: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Velocities on the paths, spread by Gaussians that meet them there nearly."""
    inner = np.exp((places @ places.T - 1) / WIDTH**2)
    factors = np.linalg.solve(inner + SOFTNESS * np.eye(len(places)), velocities)
    return _tangent(grid, np.exp((grid @ places.T - 1) / WIDTH**2) @ factors)


def _tangent(points: Float[np.ndarray, "n 3"], vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """What lies in the tangent planes."""
    return vectors - np.einsum("nk,nk->n", points, vectors)[:, None] * points


def _unit(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Back to the sphere: velocities do not change along a ray, so that this costs the steps no accuracy."""
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
