"""The wavelets that a file may name: bands, places, mothers and turns, numbered alike on every machine.

A band has one width, and its centers are the points of a subdivided icosahedron: level l has 10 4^l + 2, two bands a level, the
wider first. A wavelet is a band, a center, a mother of the paper's six and, if that is odd, one of a few turns of its direction.
In the order of a file wavelets stand by band, center, mother and turn; 1, x, y and z come before all of them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.numerics.unit_sphere import icosphere
from morphlet.wavenet.mothers import PAPER_SIX, Mother
from morphlet.wavenet.spherical import WIDTH, SphericalLibrary, SphericalNetwork

FINEST_LEVEL = 6
"""Of the centers: 40962 of them."""
VOICES = 2
"""Bands per level."""
TURNS = 8
"""Directions of an odd wavelet over a half turn; its weights have both signs."""
STEEP = 0.8
"""Up to this height (of 1) a direction starts along the parallel, beyond along that of the x axis. No center is within 1e-5 of it."""
AFFINE = 4
"""Terms before the wavelets: 1, x, y, z."""


@dataclass(frozen=True, eq=False)
class Level:
    """Centers of one level. Those of the level before come first; each of the others lies between two of them.

    `parents` are these two, or twice the center itself where it was there before; `neighbours` are filled up with -1.
    """

    points: Float[np.ndarray, "n 3"]
    parents: Int[np.ndarray, "n 2"]
    neighbours: Int[np.ndarray, "n 6"]


@dataclass(frozen=True, eq=False)
class Atoms:
    """k wavelets in the order of a file. `kinds` number the mothers of `PAPER_SIX`; even ones have turn 0."""

    bands: Int[np.ndarray, "k"]
    centers: Int[np.ndarray, "k"]
    kinds: Int[np.ndarray, "k"]
    turns: Int[np.ndarray, "k"]

    def __len__(self) -> int:
        return len(self.bands)

    def __getitem__(self, chosen: np.ndarray) -> "Atoms":
        return Atoms(self.bands[chosen], self.centers[chosen], self.kinds[chosen], self.turns[chosen])

    def library(self, levels: Sequence[Level]) -> SphericalLibrary:
        """These wavelets as candidates, for their values anywhere."""
        centers = np.array([levels[b // VOICES].points[c] for b, c in zip(self.bands, self.centers, strict=True)]).reshape(-1, 3)
        directions = turned(centers, self.turns) * ODD[self.kinds, None]
        return SphericalLibrary(PAPER_SIX, self.kinds, centers, directions, dilations(self.bands), self.bands)

    def network(self, levels: Sequence[Level], weights: Float[np.ndarray, "a k"]) -> SphericalNetwork:
        """With the weights of 1, x, y, z and of these wavelets."""
        its = self.library(levels)
        return SphericalNetwork(its.mothers, its.kinds, its.centers, its.directions, its.dilations, weights[AFFINE:], weights[:AFFINE])


ODD = np.array([psi.parity == "odd" for psi in PAPER_SIX])
"""Which of the mothers have a direction."""


def kinds_of(mothers: Sequence[Mother]) -> Int[np.ndarray, "m"]:
    """The numbers of some of the paper's mothers."""
    names = [psi.name for psi in PAPER_SIX]
    return np.array([names.index(psi.name) for psi in mothers], np.int64)


def dilations(bands: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k"]:
    """1.2 times the distance of neighbours among so many points; less by the root of 2 in the second band of a level."""
    count = 10 * 4.0 ** (bands // VOICES) + 2
    return WIDTH * np.sqrt(4 * np.pi / count * 2 / np.sqrt(3)) * np.where(bands % VOICES == 1, np.sqrt(0.5), 1.0)


def levels_up_to(finest: int) -> list[Level]:
    """The centers of levels 0 to `finest`."""
    points, faces = icosphere(0)
    itself = np.arange(len(points))
    found = [Level(points, np.stack([itself, itself], axis=1), _neighbours(faces, len(points)))]
    for level in range(1, finest + 1):
        edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1), axis=0)
        before = np.arange(len(points))
        points, faces = icosphere(level)
        parents = np.concatenate([np.stack([before, before], axis=1), edges])
        found.append(Level(points, parents, _neighbours(faces, len(points))))
    return found


def turned(centers: Float[np.ndarray, "k 3"], turns: Int[np.ndarray, "k"]) -> Float[np.ndarray, "k 3"]:
    """Unit tangents at the centers."""
    east, north = compass(centers)
    angle = np.pi / TURNS * turns[:, None]
    return np.cos(angle) * east + np.sin(angle) * north


def compass(centers: Float[np.ndarray, "k 3"]) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
    """Two unit tangents at each center, square to each other."""
    axis = np.where(np.abs(centers[:, 2:]) < STEEP, np.array([[0.0, 0.0, 1.0]]), np.array([[1.0, 0.0, 0.0]]))
    east = np.cross(axis, centers)
    east /= np.linalg.norm(east, axis=1, keepdims=True)
    return east, np.cross(centers, east)


def _neighbours(faces: Int[np.ndarray, "m 3"], n: int) -> Int[np.ndarray, "n 6"]:
    """Of each point, in ascending order; -1 where there are but five."""
    pairs = np.concatenate([faces[:, [k, (k + 1) % 3]] for k in range(3)])  # each edge in both directions
    pairs = pairs[np.lexsort((pairs[:, 1], pairs[:, 0]))]
    starts = np.searchsorted(pairs[:, 0], np.arange(n))
    out = np.full((n, 6), -1, np.int64)
    out[pairs[:, 0], np.arange(len(pairs)) - starts[pairs[:, 0]]] = pairs[:, 1]
    return out
