"""Alignment: the rotation that lays one sphere over another before two spherical maps are composed.

With paired points the rotation is Kabsch's (Eq. 7). Without, it is searched for over all of SO(3): the one under which smooth
fields on both spheres agree best. Rotations keep orientation, so left and right are never exchanged. The answer of a search
comes with its best rival; when both are nearly as good, the alignment calls itself ambiguous.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.mapping.warp import Warp
from morphlet.numerics.rigid import kabsch
from morphlet.numerics.unit_sphere import fibonacci, rotation_angles, rotations, rotations_about

N_POINTS = 642
"""Sample points of the search, 8 degrees apart: finer than `SMOOTHING`, so that nothing is lost between them."""
SMOOTHING = 0.2
"""Radians. Width of the Gaussian that smooths the fields: wider than the gaps of the coarse grid, narrower than a limb's image."""
N_ROTATIONS, N_COARSE = 4608, 162
"""Coarse grid of rotations, about 15 degrees apart, judged at so many points: 16 degrees apart, still within twice `SMOOTHING`."""
N_REFINED, N_FINALISTS = 20, 5
"""Rotations of the coarse grid that are refined at the coarse points, and those of them that are refined at all points."""
SEPARATION = np.pi / 6
"""Rotations closer than this count as one candidate (two cells of the coarse grid)."""
DIFFERENCE = np.radians(1)
"""Angle of the central differences of the refinement: half a cell of `RASTER`."""
N_STEPS, FIRST_DAMPING, DAMPING_FACTOR = 10, 1e-2, 10.0
"""Levenberg-Marquardt steps of the refinement, and the damping of the first, relative to the diagonal; it converges in 4 to 8."""
FLATNESS = 0.01
"""A descriptor that varies by less than this share of its mean tells nothing: it is not blown up to unit variance."""
LEAST_LOG_SPREAD = 0.25
"""The same for the log of the area density: a sphere sampled unevenly by less than 28 % counts as even."""
RASTER = (90, 180)
"""Steps in polar angle and in longitude of the table in which the target's fields are looked up: two degrees each."""
ORTHONORMAL = 1e-9
"""Largest error of R R^T against the identity: rounding of a product of rotations."""
LEAST_MISMATCH = 0.1
"""Two unrelated fields differ by about 2; a mean over all rotations below this one says that nothing on the sphere stands out."""
BLOCK = 256
"""Rotations that are judged at once: bounds the memory to some tens of MB."""
SPREAD = 1e-3
"""Radians that pairs must leave a common line: rounding and the maps' own accuracy would decide the turn about it otherwise."""
AMBIGUOUS = 0.06
"""A margin below this share of the mean mismatch leaves the choice of the rotation open: with the descriptors of `features.signature`,
wrong rotations were seen up to 0.03 and right ones from 0.09."""


@dataclass(frozen=True, eq=False)
class Alignment:
    """A rotation of the source's sphere, and how it was found.

    Parameters
    ----------
    rotation
        Matrix with det = +1.
    method
        "pairs", "search" or "given".
    score
        Mismatch that was minimised, lower is better: rms distance of the pairs on the sphere, or, for a search, the mean
        squared difference of the fields over that of a typical rotation (0 perfect, 1 no better than chance).
    runner_up
        Score of the best rotation that is clearly another one; None if there was no search.
    warp
        Moves the points further after the rotation; None if nothing does.

    Examples
    --------
    >>> import numpy as np
    >>> alignment = Alignment(np.eye(3), "given", 0.0)
    >>> alignment(np.array([[0.0, 0.0, 1.0]])), alignment.ambiguous
    (array([[0., 0., 1.]]), False)
    """

    rotation: Float[np.ndarray, "3 3"]
    method: str
    score: float
    runner_up: float | None = None
    warp: Warp | None = None

    def __post_init__(self) -> None:
        rotation = _arrays.real(self.rotation, "rotation", (3, 3))
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > ORTHONORMAL or np.linalg.det(rotation) < 0:
            found = f"det {np.linalg.det(rotation):.6g}"
            raise InputError("a rotation matrix with det +1", found, "use kabsch, or orthonormalise the matrix")
        object.__setattr__(self, "rotation", rotation)

    def __call__(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
        """The points of the source's sphere, turned and moved onto the target's."""
        turned = points @ self.rotation.T
        return turned if self.warp is None else self.warp(turned)

    @property
    def margin(self) -> float | None:
        """How much worse the runner-up is; None if there was no search."""
        return None if self.runner_up is None else self.runner_up - self.score

    @property
    def ambiguous(self) -> bool:
        """Whether another rotation is nearly as good."""
        return self.margin is not None and self.margin < AMBIGUOUS


@dataclass(frozen=True, eq=False)
class SphereSamples:
    """Values at scattered points of the unit sphere, each standing for some area of the surface.

    Parameters
    ----------
    points
        Unit vectors, as dense or sparse as they come.
    values
        d numbers at each point.
    weight
        Surface area that each point stands for.
    """

    points: Float[np.ndarray, "n 3"]
    values: Float[np.ndarray, "n d"]
    weight: Float[np.ndarray, "n"]

    def __post_init__(self) -> None:
        points = _arrays.unit(self.points, "points")
        values = _arrays.real(self.values, "values", (len(points), None))
        weight = _arrays.real(self.weight, "weight", (len(points),))
        if np.any(weight < 0) or not np.any(weight > 0):
            raise InputError("non-negative weights, one of them positive", f"{int(np.sum(weight < 0))} negative", "pass vertex areas")
        for name, value in (("points", points), ("values", values), ("weight", weight)):
            object.__setattr__(self, name, value)


def align_by_pairs(
    source_points: Float[np.ndarray, "p 3"], target_points: Float[np.ndarray, "p 3"], weight: Float[np.ndarray, "p"] | None = None
) -> Alignment:
    """The rotation that brings paired points of two unit spheres closest to each other (Eq. 7).

    Parameters
    ----------
    source_points, target_points
        Unit vectors that belong together.
    weight
        Importance of each pair; 1 if left out.

    Raises
    ------
    InputError
        If fewer than two pairs lie in non-parallel directions: the rotation would not be unique.

    Notes
    -----
    O(p). Section 6.2 of the paper.

    Examples
    --------
    >>> align_by_pairs([[1, 0, 0], [0, 1, 0]], [[0, 1, 0], [-1, 0, 0]])([[1, 0, 0]]).round(12) + 0.0
    array([[0., 1., 0.]])
    """
    source, target = _arrays.unit(source_points, "source_points"), _arrays.unit(target_points, "target_points")
    for name, points in (("source", source), ("target", target)):
        spread = np.linalg.svd(points, compute_uv=False)
        if len(spread) < 2 or spread[1] < SPREAD * spread[0]:
            found = f"{len(points)} pairs whose {name} points lie within {SPREAD:g} rad of one line through the centre"
            raise InputError("at least two pairs in non-parallel directions", found, "add pairs that are spread out")
    rotation = kabsch(source, target, weight)
    squares = np.sum((source @ rotation.T - target) ** 2, axis=1)
    return Alignment(rotation, "pairs", float(np.sqrt(np.average(squares, weights=weight))))


def align_by_search(source: SphereSamples, target: SphereSamples) -> Alignment:
    """The rotation under which the smoothed fields of both spheres agree best, out of all rotations.

    Parameters
    ----------
    source, target
        Descriptors on both spheres, of the same number; how much area lies where is one more, taken from the weights.

    Returns
    -------
    alignment
        With the score of the best rotation and of the best other one, at least `SEPARATION` away.

    Raises
    ------
    InputError
        If the numbers of descriptors differ.

    Notes
    -----
    Each field is standardised on its own sphere, so that units and sizes do not matter. A coarse grid of `N_ROTATIONS`
    rotations, then a pattern search from the `N_REFINED` best. Deterministic. Costs O(n) plus about half a second, whatever n.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.unit_sphere import fibonacci
    >>> points = fibonacci(800)
    >>> bumps = np.exp(2 * points @ [1, 0, 0]) + 2 * np.exp(3 * points @ [0, 0.8, 0.6]) + np.exp(4 * points @ [-0.6, 0, -0.8])
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> samples = SphereSamples(points, bumps[:, None], np.ones(800))
    >>> turned = SphereSamples(points @ quarter.T, bumps[:, None], np.ones(800))
    >>> bool(np.abs(align_by_search(samples, turned).rotation - quarter).max() < 0.02)
    True
    """
    if source.values.shape[1] != target.values.shape[1]:
        found = f"{source.values.shape[1]} and {target.values.shape[1]}"
        raise InputError("as many descriptors on both spheres", found, "compute both with the same function")
    table, coarse, fine = _standard(target, _raster_nodes()), _Probe.of(source, N_COARSE), _Probe.of(source, N_POINTS)
    grid = rotations(N_ROTATIONS)
    mismatches = _mismatches(grid, coarse, table)
    starts = grid[_separated(grid, mismatches, N_REFINED)]
    middle = _refined(starts, coarse, table)
    ends = _refined(middle[_separated(middle, _mismatches(middle, coarse, table), N_FINALISTS)], fine, table)
    tried = np.concatenate([ends, middle, starts])  # where many rotations fit, refinement may have led all to one of them
    scores = _mismatches(tried, fine, table) / max(mismatches.mean(), LEAST_MISMATCH)
    best, rival = _separated(tried, scores, 2)
    return Alignment(tried[best], "search", float(scores[best]), float(scores[rival]))


@dataclass(frozen=True, eq=False)
class _Centres:
    """Some hundred places on the sphere with area-weighted sums (1, values) of the samples around each."""

    points: Float[np.ndarray, "c 3"]
    sums: Float[np.ndarray, "c d1"]

    @staticmethod
    def of(samples: SphereSamples) -> "_Centres":
        """Samples gathered by the nearest sample point; each cell stands at the mean of its samples."""
        cell = np.asarray(cKDTree(fibonacci(N_POINTS)).query(samples.points)[1])
        columns = np.column_stack([samples.points, np.ones(len(cell)), samples.values])
        sums = np.stack([np.bincount(cell, samples.weight * v, N_POINTS) for v in columns.T], axis=1)
        sums = sums[sums[:, 3] > 0]
        return _Centres(sums[:, :3] / np.linalg.norm(sums[:, :3], axis=1, keepdims=True), sums[:, 3:])

    def fields(self, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k d2"]:
        """Smoothed values at the points, the log of the area density, the density; far from every centre the nearest decide."""
        kernel = np.exp((points @ self.points.T - 1) / SMOOTHING**2)
        density, *sums = (kernel @ self.sums).T
        return np.column_stack([*[v / density for v in sums], np.log(density), density])


def _standard(samples: SphereSamples, points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k d2"]:
    """Fields at the points, of mean 0 and deviation 1 over the sphere; last column the weight of the place, of mean about 1."""
    centres = _Centres.of(samples)
    even = centres.fields(fibonacci(N_POINTS))
    least = FLATNESS * np.abs(even).mean(axis=0)
    least[-2:] = LEAST_LOG_SPREAD, 0
    spread = np.maximum(even.std(axis=0), np.maximum(least, np.finfo(float).tiny))
    fields = centres.fields(points)
    weight = np.sqrt(fields[:, -1] / even[:, -1].mean())
    return np.column_stack([((fields - even.mean(axis=0)) / spread)[:, :-1], weight])


@dataclass(frozen=True, eq=False)
class _Probe:
    """Even points of the source's sphere and its fields there, to be compared with the target's."""

    points: Float[np.ndarray, "k 3"]
    fields: Float[np.ndarray, "k d"]

    @staticmethod
    def of(samples: SphereSamples, count: int) -> "_Probe":
        """The fields of the samples at `count` points."""
        points = fibonacci(count)
        return _Probe(points, _standard(samples, points))


def _raster_nodes() -> Float[np.ndarray, "nodes 3"]:
    """Directions of the nodes of the table, row by row from pole to pole, longitude from -pi to pi."""
    polar, turn = np.linspace(0, np.pi, RASTER[0] + 1)[:, None], np.linspace(-np.pi, np.pi, RASTER[1] + 1)
    nodes = [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0 * turn]
    return np.stack(nodes, axis=2).reshape(-1, 3)


def _looked_up(table: Float[np.ndarray, "nodes d"], directions: Float[np.ndarray, "r k 3"]) -> Float[np.ndarray, "r k d"]:
    """Values of the table at unit vectors, bilinear in polar angle and longitude."""
    x, y, z = np.moveaxis(directions, 2, 0)
    row = np.arccos(np.clip(z, -1, 1)) * (RASTER[0] / np.pi)
    column = (np.arctan2(y, x) + np.pi) * (RASTER[1] / (2 * np.pi))
    i, j = np.minimum(row.astype(np.int64), RASTER[0] - 1), np.minimum(column.astype(np.int64), RASTER[1] - 1)
    u, v = (row - i)[..., None], (column - j)[..., None]
    place = i * (RASTER[1] + 1) + j
    upper = (1 - v) * table[place] + v * table[place + 1]
    below = place + RASTER[1] + 1
    return (1 - u) * upper + u * ((1 - v) * table[below] + v * table[below + 1])


def _mismatches(turns: Float[np.ndarray, "r 3 3"], probe: _Probe, table: Float[np.ndarray, "nodes d"]) -> Float[np.ndarray, "r"]:
    """Mean squared difference of the fields under each rotation, weighted with the area on both sides."""
    blocks = np.split(turns, range(BLOCK, len(turns), BLOCK))
    return np.concatenate([_block_mismatches(block, probe, table) for block in blocks])


def _block_mismatches(turns: Float[np.ndarray, "r 3 3"], probe: _Probe, table: np.ndarray) -> Float[np.ndarray, "r"]:
    """The same for one block."""
    return np.sum(_residuals(turns, probe, table) ** 2, axis=1)


def _residuals(turns: Float[np.ndarray, "r 3 3"], probe: _Probe, table: np.ndarray) -> Float[np.ndarray, "r kd"]:
    """Weighted differences of the fields, whose squares sum to the mismatch."""
    seen = _looked_up(table, probe.points @ turns.transpose(0, 2, 1))
    weight = probe.fields[:, -1] + seen[..., -1]
    share = np.sqrt(weight / (np.sum(weight, axis=1, keepdims=True) * (probe.fields.shape[1] - 1)))
    return (share[..., None] * (seen[..., :-1] - probe.fields[:, :-1])).reshape(len(turns), -1)


def _separated(turns: Float[np.ndarray, "r 3 3"], scores: Float[np.ndarray, "r"], count: int) -> list[int]:
    """Indices of the best rotations, best first, leaving out those within `SEPARATION` of a better one."""
    kept: list[int] = []
    for i in np.argsort(scores, kind="stable"):
        if len(kept) == count:
            break
        if not kept or rotation_angles(turns[kept], turns[i]).min() > SEPARATION:
            kept.append(int(i))
    return kept


def _refined(turns: Float[np.ndarray, "r 3 3"], probe: _Probe, table: np.ndarray) -> Float[np.ndarray, "r 3 3"]:
    """Each rotation at a local minimum of the mismatch (Levenberg-Marquardt on the three angles)."""
    offsets = rotations_about(DIFFERENCE * np.vstack([np.eye(3), -np.eye(3)]))
    damping = np.full(len(turns), FIRST_DAMPING)
    for _ in range(N_STEPS):
        here = _residuals(turns, probe, table)
        around = _residuals((offsets[None] @ turns[:, None]).reshape(-1, 3, 3), probe, table).reshape(len(turns), 6, -1)
        jacobian = (around[:, :3] - around[:, 3:]) / (2 * DIFFERENCE)
        tried = rotations_about(_damped_steps(jacobian, here, damping)) @ turns
        better = _mismatches(tried, probe, table) < np.sum(here**2, axis=1)
        turns = np.where(better[:, None, None], tried, turns)
        damping = np.where(better, damping / DAMPING_FACTOR, damping * DAMPING_FACTOR)
    return turns


def _damped_steps(jacobian: Float[np.ndarray, "r 3 k"], residuals: Float[np.ndarray, "r k"], damping: Float[np.ndarray, "r"]) -> np.ndarray:
    """Steps (r, 3) of the damped normal equations; fields that do not change give none."""
    normal = jacobian @ jacobian.transpose(0, 2, 1)
    size = np.maximum(np.trace(normal, axis1=1, axis2=2), np.finfo(float).eps)
    gradient = np.einsum("rak,rk->ra", jacobian, residuals)
    return -np.linalg.solve(normal + (damping * size)[:, None, None] * np.eye(3), gradient[..., None])[..., 0]
