"""What it costs to pair the landmarks of two surfaces, and the cheapest pairings: a beam search.

Tips are alike if as much of the surface lies within each distance of them. Sets of tips are alike if they are as far apart, but for the
lengths of their limbs: what of the distances between them cannot be explained by making some limbs longer says where they sit. Triples are
alike if the surface, drawn in space with its distances from the three tips as coordinates, encloses as much volume: a mirror image
encloses the negative, so this alone tells left from right, on the surface itself, without a map to the sphere.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.errors import InputError
from morphlet.features.regions import Regions
from morphlet.surface.distance import distances
from morphlet.surface.mesh import Mesh

RADII = np.geomspace(0.08, 1.2, 12)
"""Distances within which the share of the surface is compared, over sqrt(area): from the width of a leg to the length of the body."""
BLUR = 0.04
"""Width of the rim of these discs, over sqrt(area): about an edge, so that no vertex counts by itself."""
LEAST_SHARE = 1e-4
"""Shares below are not told apart."""
VOLUME = 0.02
"""Enclosed volumes are measured in this unit, over area^(3/2): the rms over the triples of an animal's tips is 0.012 to 0.025."""
SHAPE, LENGTH, TURN, MISS = 4.0, 2.0, 1.0, 3.0
"""Weights of the three likenesses, and cost of two tips that stay alone. On 31 pairs of poses of horses, cats and wolves no limb was paired
wrongly with shape weights of 2 to 6, lengths 0 to 3, turns 0.7 to 1.5, misses 2 to 4; without turns, left and right are the same."""
BEAM = 400
"""Pairings kept from tip to tip: more than all that are worth a thought with six tips."""
LIMBS = 4
"""Pairs from which on limbs may be longer or shorter at no cost: the distances of three tips could all be explained by that."""
NEAR = 0.1
"""A pair of the user stands for tips within this distance, over sqrt(area)."""
Pairing = tuple[tuple[int, int], ...]
"""Landmarks of the source and of the target that go together."""
Comparison = Callable[[np.ndarray, np.ndarray], float]
"""How unlike two matrices of distances are."""


@dataclass(frozen=True)
class MatchOptions:
    """How much each likeness counts.

    Parameters
    ----------
    shape
        Weight of the share of the surface within some distances of a tip (mean absolute difference of logarithms).
    length
        Weight of the distances between tips (relative difference, as far as limbs that are longer as a whole do not explain it).
    turn
        Weight of the volumes of triples, which tell left from right, in units of `VOLUME`.
    miss
        Cost of two tips without partner.

    Examples
    --------
    >>> from morphlet.features.pairing import MatchOptions
    >>> MatchOptions(miss=1.0).shape
    4.0
    """

    shape: float = SHAPE
    length: float = LENGTH
    turn: float = TURN
    miss: float = MISS

    def __post_init__(self) -> None:
        weights = (self.shape, self.length, self.turn, self.miss)
        if not (np.all(np.isfinite(weights)) and min(weights) >= 0 and self.miss > 0):
            raise InputError("weights >= 0 and a cost of misses > 0", f"{weights}", "leave them at their defaults")


@dataclass(frozen=True, eq=False)
class Marks:
    """What is compared of one surface: its landmarks, then the places of the user's pairs.

    Parameters
    ----------
    fields
        Distances from each, over sqrt(area).
    shares
        Share of the surface within each of `RADII`.
    apart
        Distance of each from each other one, over sqrt(area).
    volumes
        What the distances from three of them enclose, in units of `VOLUME`; changes sign when two are exchanged.
    """

    fields: Float[np.ndarray, "l n"]
    shares: Float[np.ndarray, "l r"]
    apart: Float[np.ndarray, "l l"]
    volumes: Float[np.ndarray, "l l l"]

    def free(self, wanted: Iterable[int], given: int) -> list[int]:
        """Those of some landmarks that no place of the user's pairs, the last ones here, stands for."""
        last = len(self.apart) - given
        return [k for k in wanted if np.min(self.apart[k, last:], initial=NEAR) >= NEAR]


def marks_of(regions: Regions, given: Int[np.ndarray, "f"]) -> Marks:
    """The landmarks of one surface, and what is known of them."""
    mesh = regions.mesh
    fields = np.vstack([regions.distance, distances(mesh, given) / np.sqrt(mesh.area)])
    shares = np.stack([np.clip((radius - fields) / BLUR + 0.5, 0, 1) @ mesh.vertex_areas for radius in RADII], axis=1) / mesh.area
    apart = fields[:, np.concatenate([regions.landmarks, given])]
    return Marks(fields, np.maximum(shares, LEAST_SHARE), (apart + apart.T) / 2, _volumes(mesh, fields))


def _volumes(mesh: Mesh, fields: Float[np.ndarray, "l n"]) -> Float[np.ndarray, "l l l"]:
    """Integral of f_i df_j df_k over the surface, in units of `VOLUME`: what it encloses with these three fields as coordinates."""
    a, b, c = (fields[:, mesh.faces[:, k]] for k in range(3))
    mean, first, second = (a + b + c) / 3, b - a, c - a
    forms = np.empty((len(fields),) * 3)
    for j in range(len(fields)):
        forms[:, j] = mean @ (first[j] * second - second[j] * first).T / 2
    cyclic = (forms + forms.transpose(2, 0, 1) + forms.transpose(1, 2, 0)) / 3  # equal but for holes
    return cyclic * (-1.0 if mesh.volume < 0 else 1.0) / VOLUME


@dataclass(frozen=True, eq=False)
class Problem:
    """Two sets of landmarks and what it costs to pair them.

    Parameters
    ----------
    unary
        Cost of each pair by itself; infinite where it is forbidden.
    compared
        How unlike the distances between some landmarks are: sum of relative differences.
    """

    source: Marks
    target: Marks
    unary: Float[np.ndarray, "a b"]
    options: MatchOptions
    compared: Comparison

    def added(self, pairing: Pairing, i: int) -> Float[np.ndarray, "b"]:
        """Cost of landmark i with each of the target, beside pairs already made."""
        cost = self.unary[i].copy()
        if pairing:
            k, m = np.array(pairing).T
            cost[m] = np.inf
            near, far = self.source.apart[i, k], self.target.apart[:, m]
            cost += self.options.length * np.mean(_difference(near, far), axis=1)
        if len(pairing) > 1:
            turned = self.source.volumes[i][np.ix_(k, k)] - self.target.volumes[:, m][:, :, m]
            cost += self.options.turn * np.abs(turned).sum(axis=(1, 2)) / (len(k) * (len(k) - 1))
        return cost

    def total(self, pairing: Pairing, misses: int) -> float:
        """Cost of a whole pairing: the same in whatever order it was made."""
        p = len(pairing)
        cost = self.options.miss * misses / 2
        if p:
            k, m = np.array(pairing).T
            cost += self.unary[k, m].sum()
        if p > 1:
            cost += self.options.length * self.compared(self.source.apart[np.ix_(k, k)], self.target.apart[np.ix_(m, m)]) / (p - 1)
        if p > 2:
            turned = self.source.volumes[np.ix_(k, k, k)] - self.target.volumes[np.ix_(m, m, m)]
            cost += self.options.turn * np.abs(turned).sum() / ((p - 1) * (p - 2))
        return float(cost)

    def cheapest(self, start: Pairing, rows: list[int], columns: list[int]) -> list[tuple[float, Pairing]]:
        """Pairings of these landmarks beside pairs already made, cheapest first: a beam search."""
        open_columns = np.isin(np.arange(self.unary.shape[1]), columns)
        beam: list[tuple[float, Pairing]] = [(0.0, start)]
        for i in rows:
            grown = [(cost + self.options.miss, pairing) for cost, pairing in beam]
            for cost, pairing in beam:
                added = np.where(open_columns, self.added(pairing, i), np.inf)
                grown += [(cost + float(added[j]), (*pairing, (i, int(j)))) for j in np.flatnonzero(np.isfinite(added))]
            beam = sorted(grown)[:BEAM]
        tips = len(rows) + len(columns) + 2 * len(start)
        return sorted((self.total(pairing, tips - 2 * len(pairing)), pairing) for _, pairing in beam)


def _difference(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Relative difference of distances."""
    return np.abs(a - b) / np.maximum(np.maximum(a, b), np.finfo(float).tiny)


def plain_differences(near: Float[np.ndarray, "p p"], far: Float[np.ndarray, "p p"]) -> float:
    """Sum of the relative differences of distances."""
    return float(_difference(near, far).sum())


def _displaced(near: Float[np.ndarray, "p p"], far: Float[np.ndarray, "p p"]) -> float:
    """Sum of the relative differences of distances that remain when each limb may be longer by some length (least squares)."""
    p, (i, j) = len(near), np.triu_indices(len(near), 1)
    if p < LIMBS:
        return plain_differences(near, far)
    scale = np.maximum(np.maximum(near, far)[i, j], np.finfo(float).tiny)
    limbs = (np.eye(p)[i] + np.eye(p)[j]) / scale[:, None]
    gaps = (near - far)[i, j] / scale
    return 2 * float(np.abs(gaps - limbs @ np.linalg.lstsq(limbs, gaps)[0]).sum())


def problem_of(source: Marks, target: Marks, options: MatchOptions) -> Problem:
    """Everything allowed."""
    ratio = np.log(source.shares)[:, None] - np.log(target.shares)
    return Problem(source, target, options.shape * np.mean(np.abs(ratio), axis=2), options, _displaced)


def contradicts(one: Pairing, other: Pairing) -> bool:
    """Whether two pairings give one landmark different partners; a pairing contradicts no part of itself."""
    forth, back = dict(one), {j: i for i, j in one}
    return any(forth.get(i, j) != j or back.get(j, i) != i for i, j in other)
