"""Wavelets on the sphere: the candidates, and the network they make.

A wavelet is known by its mother psi, a center c, a dilation d and, if its mother is odd, a direction e tangent at c. With
the chord r = |x - c| and s = r / d, its value at the unit vector x is

    psi(s) + (psi averaged over [0, s])     psi even: the same all round c;
    psi(s) / s  (x . e) / d                 psi odd: psi along the great circle through c and e, its negative on the other side.

Both have zero mean over the sphere, odd ones by symmetry. For even ones, the first form is the divergence of the radial
field that has psi as its derivative, and chords preserve areas (Lambert): so the mean over the sphere is that over the
plane, 0 as soon as the wavelet ends before the antipode. From mexican_hat, exp(-s^2 / 2) (1 - s^2), comes exp(-s^2 / 2) (2 - s^2),
the Laplacian of a Gaussian. Any direction e is a sum of two, with the coordinates of e as weights.

A wavelet ends where its mother does, or where it has fallen to a millionth. A network adds an affine part, of 1, x, y, z.
"""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from morphlet import _arrays, _store
from morphlet.errors import InputError
from morphlet.numerics.unit_sphere import icosphere
from morphlet.wavenet.library import different
from morphlet.wavenet.mothers import FAR, Mother
from morphlet.wavenet.network import counted, found, named, refused_as_file

KIND, VERSION = "spherical wavelet network", 1
ARRAYS = ("mothers", "kinds", "centers", "directions", "dilations", "weights", "affine")

WIDTH = 1.2
"""Widest dilation of a level over the distance of its centers. With 500 wavelets and one voice, 1.7 gains 0.0 and 0.2 dB on two
public meshes and has twice as many values to compute; 0.8 loses 0.4 dB on one."""
FEWEST_SAMPLES = 6
"""Samples within a candidate's reach, counted by area: (sum of areas)^2 / (sum of squared areas). With fewer it is not seen to be
a wavelet. 3 makes half as many candidates again, and no better fits."""
NEGLIGIBLE = 1e-6
"""Share of its maximum at which an unbounded wavelet ends."""
KNOTS = 2048
"""Cubic pieces of a profile: 2e-11 of its maximum off at most, for all of `MOTHERS` that have a parity."""
NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)
"""Quadrature over one piece."""
TANGENT = 1e-9
"""How far a direction may be off its tangent plane and off unit length."""
BUCKETS_PER_OCTAVE = 2
"""Wavelets whose dilations differ by less than a half octave look for their samples together."""
FARTHEST = 2.0
"""No chord is longer."""


SphericalWavelets: TypeAlias = "SphericalLibrary | SphericalNetwork"
"""What has mothers, kinds, centers, directions and dilations."""


@dataclass(frozen=True, eq=False)
class SphericalLibrary:
    """l candidates on the sphere.

    Parameters
    ----------
    mothers
        Different mothers, each even or odd.
    kinds
        Which of the mothers each candidate has.
    centers
        Unit vectors.
    directions
        Unit tangents at the centers for odd mothers, zero for even ones. A fit may turn a candidate about its center.
    dilations
        Rms radii of the mothers, as chords of the unit sphere: radians, where small.
    bands
        Which of its widths a candidate has: 0 for the widest.

    Raises
    ------
    InputError
        If lengths differ, a mother is neither even nor odd, a center or direction is not what it must be, or a dilation is
        not positive.

    Examples
    --------
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> from morphlet.wavenet.spherical import SphericalLibrary
    >>> hat = SphericalLibrary((MOTHERS["beta2"],), [0], [[0, 0, 1]], [[0, 0, 0]], [0.3], [0])
    >>> hat.values(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])).toarray().round(3)
    array([[-1.708],
           [ 0.   ]])
    """

    mothers: tuple[Mother, ...]
    kinds: Int[np.ndarray, "l"]
    centers: Float[np.ndarray, "l 3"]
    directions: Float[np.ndarray, "l 3"]
    dilations: Float[np.ndarray, "l"]
    bands: Int[np.ndarray, "l"]

    def __post_init__(self) -> None:
        _freeze(self)
        object.__setattr__(self, "bands", _arrays.index(self.bands, "bands", (len(self),), np.iinfo(np.int64).max))

    def __reduce__(self) -> tuple[Any, ...]:
        names = ("kinds", "centers", "directions", "dilations", "bands")
        return SphericalLibrary, (self.mothers, *(np.array(getattr(self, name)) for name in names))

    def __len__(self) -> int:
        return len(self.dilations)

    def __repr__(self) -> str:
        return f"SphericalLibrary({len(self)} candidates of {', '.join(psi.name for psi in self.mothers)})"

    def values(self, points: Float[np.ndarray, "n 3"]) -> sp.csr_matrix:
        """The candidates at the points: a sparse matrix (n, l).

        Raises
        ------
        InputError
            If a point is zero or not finite; its length is ignored.
        """
        return _values(self, _arrays.unit(points, "points"))


@dataclass(frozen=True, eq=False)
class SphericalNetwork:
    """p wavelets on the sphere, that map unit vectors to k outputs.

    Parameters
    ----------
    mothers, kinds, centers, directions, dilations
        The wavelets, as in a `SphericalLibrary`.
    weights
        Of the wavelets in each output.
    affine
        Of 1, x, y and z in each output.

    Raises
    ------
    InputError
        As for `SphericalLibrary`, or if the weights do not fit.

    Examples
    --------
    >>> from morphlet.wavenet.spherical import SphericalNetwork
    >>> tilted = SphericalNetwork((), [], np.zeros((0, 3)), np.zeros((0, 3)), [], np.zeros((0, 1)), [[1.0], [0.0], [0.0], [5.0]])
    >>> tilted(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    array([[6.],
           [1.]])
    """

    mothers: tuple[Mother, ...]
    kinds: Int[np.ndarray, "p"]
    centers: Float[np.ndarray, "p 3"]
    directions: Float[np.ndarray, "p 3"]
    dilations: Float[np.ndarray, "p"]
    weights: Float[np.ndarray, "p k"]
    affine: Float[np.ndarray, "4 k"]

    def __post_init__(self) -> None:
        _freeze(self)
        affine = _arrays.real(self.affine, "affine", (4, None))
        object.__setattr__(self, "weights", _arrays.real(self.weights, "weights", (len(self), affine.shape[1])))
        object.__setattr__(self, "affine", affine)

    def __reduce__(self) -> tuple[Any, ...]:
        return SphericalNetwork, (self.mothers, *(np.array(getattr(self, name)) for name in ARRAYS[1:]))

    def __len__(self) -> int:
        return len(self.dilations)

    def __repr__(self) -> str:
        return f"SphericalNetwork({len(self)} wavelets, {self.affine.shape[1]} outputs)"

    def __call__(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n k"]:
        """The outputs in each direction.

        Parameters
        ----------
        points
            Non-zero vectors; their length is ignored.

        Raises
        ------
        InputError
            If a point is zero or not finite.

        Notes
        -----
        Proportional to the pairs of a point and a wavelet in whose reach it lies: 0.3 CPU s for 43k points and 2000 wavelets.
        """
        points = _arrays.unit(points, "points")
        return self.affine[0] + points @ self.affine[1:] + _values(self, points) @ self.weights

    def jacobian(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n k 3"]:
        """Gradients of the outputs along the sphere, as tangent vectors.

        Raises
        ------
        InputError
            If a point is zero or not finite.

        Examples
        --------
        >>> from morphlet.wavenet.spherical import SphericalNetwork
        >>> tilted = SphericalNetwork((), [], np.zeros((0, 3)), np.zeros((0, 3)), [], np.zeros((0, 1)), [[1.0], [0.0], [0.0], [5.0]])
        >>> tilted.jacobian(np.array([[1.0, 0.0, 0.0]]))
        array([[[0., 0., 5.]]])
        """
        points = _arrays.unit(points, "points")
        space = np.stack([self.affine[1 + c] + _slopes(self, points, c) @ self.weights for c in range(3)], axis=2)
        return space - np.einsum("nkc,nc->nk", space, points)[:, :, None] * points[:, None, :]

    def counts(self) -> dict[str, int]:
        """How many wavelets there are of each mother."""
        return counted(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to an `.npz` file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        _store.save(path, KIND, VERSION, network_arrays(self))

    @classmethod
    def load(cls, path: str | os.PathLike[str], mothers: Sequence[Mother] = ()) -> "SphericalNetwork":
        """Read what `save` wrote; own mothers have to be passed.

        Raises
        ------
        FileError
            If the file is no such network, or has a mother that is not known.
        """
        arrays = _store.load(path, KIND, VERSION, ARRAYS)
        with refused_as_file(KIND, path):
            return stored_network(arrays, mothers)


def spherical_library(
    mothers: Sequence[Mother], points: Float[np.ndarray, "n 3"], areas: Float[np.ndarray, "n"], levels: int = 6, voices: int = 2
) -> SphericalLibrary:
    """Candidates on subdivided icosahedra: centers twice as dense from level to level, dilations in proportion.

    Parameters
    ----------
    mothers
        Even or odd ones. Compact ones make the fit fast: `MOTHERS["beta2"]` and `MOTHERS["beta1"]` do well together.
    points, areas
        Samples and what each stands for. Their length, and that of the areas, is ignored.
    levels
        Of the finest centers: 10 4^levels + 2 of them.
    voices
        Dilations per level; the widest is 1.2 times the distance of the centers.

    Returns
    -------
    SphericalLibrary
        By level, from wide to narrow. Candidates with fewer than 6 samples in reach are left out.

    Raises
    ------
    InputError
        If samples are not finite, areas are negative or all 0, levels are negative, or voices not positive.

    Notes
    -----
    About 0.8 CPU s for 8k samples and 3 for 43k.

    Examples
    --------
    >>> from morphlet.numerics.unit_sphere import fibonacci
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> from morphlet.wavenet.spherical import spherical_library
    >>> spherical_library([MOTHERS["beta2"], MOTHERS["beta1"]], fibonacci(500), np.ones(500), levels=2, voices=1)
    SphericalLibrary(432 candidates of beta2, beta1)
    """
    points, areas = samples(points, areas)
    if levels < 0 or voices < 1:
        raise InputError("levels >= 0 and voices >= 1", f"levels {levels}, voices {voices}", "start from 6 and 2")
    kept = _even_or_odd(mothers)
    tree, weights = cKDTree(points[areas > 0]), areas[areas > 0]
    bands = []
    for band in range((levels + 1) * voices):
        centers, _ = icosphere(band // voices)
        dilation = WIDTH * _gap(len(centers)) * 2.0 ** -(band % voices / voices)
        for kind, psi in enumerate(kept):
            seen = centers[_seen(tree, weights, centers, dilation * _profile(psi).end)]
            bands.append((seen, np.full(len(seen), kind), np.full(len(seen), dilation), np.full(len(seen), band)))
    centers, kinds, dilations, numbers = (np.concatenate(parts) for parts in zip(*bands, strict=True)) if bands else _nothing()
    odd = np.array([psi.parity == "odd" for psi in kept], bool)[kinds.astype(np.int64)]
    return SphericalLibrary(kept, kinds, centers, tangents(centers) * odd[:, None], dilations, numbers)


def samples(points: Any, areas: Any) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n"]]:
    """Checked unit vectors and areas, these scaled to the sum 1."""
    points = _arrays.unit(points, "points")
    areas = _arrays.real(areas, "areas", (len(points),))
    negative = np.flatnonzero(areas < 0)
    if len(negative):
        raise InputError("areas >= 0", f"{len(negative)} negative ones", "turn or remove these samples", negative)
    if not areas.any():
        raise InputError("a sample that stands for some area", f"{len(areas)} samples without", "pass areas that are not all 0")
    areas = areas / areas.max()  # no overflow in the sum
    return points, areas / areas.sum()


def tangents(centers: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "p 3"]:
    """A unit tangent at each center, square to the axis from which it is farthest."""
    axis = np.eye(3)[np.argmin(np.abs(centers), axis=1)] if len(centers) else centers
    across = np.cross(axis, centers)
    return across / np.linalg.norm(across, axis=1, keepdims=True)


def network_arrays(network: SphericalNetwork) -> dict[str, np.ndarray]:
    """What files keep of a network."""
    return {name: getattr(network, name) for name in ARRAYS[1:]} | named(network.mothers)


def stored_network(arrays: dict[str, np.ndarray], mothers: Sequence[Mother]) -> SphericalNetwork:
    """The network of the arrays of a file."""
    return SphericalNetwork(found(arrays["mothers"], mothers), *(arrays[name] for name in ARRAYS[1:]))


@dataclass(frozen=True, eq=False)
class _Profile:
    """How a wavelet falls off with s: pieces of a cubic (constant first) in the share of a step, and where they end."""

    pieces: Float[np.ndarray, "m 4"]
    end: float

    def values(self, s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """At each s."""
        piece, t = self._split(s)
        a, b, c, d = piece
        return a + t * (b + t * (c + t * d))

    def slopes(self, s: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Derivatives over s; 0 at 0, where they are not needed."""
        piece, t = self._split(s)
        _, b, c, d = piece * (len(self.pieces) / self.end)
        return np.divide(b + t * (2 * c + t * 3 * d), s, out=np.zeros_like(s), where=s > 0)

    def _split(self, s: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "4 n"], Float[np.ndarray, "n"]]:
        """The piece of each s, and the share of the step within it."""
        steps = s * (len(self.pieces) / self.end)
        number = np.minimum(steps.astype(np.int64), len(self.pieces) - 1)
        return self.pieces[number].T, steps - number


def _profile(psi: Mother) -> _Profile:
    """Of an even mother, psi and its average from 0; of an odd one, psi(s) / s."""
    end = min(psi.support[1], FAR)
    value, _ = _shape(psi, np.linspace(0, end, KNOTS + 1))
    if np.isinf(psi.support[1]):
        end *= np.flatnonzero(np.abs(value) > NEGLIGIBLE * np.abs(value).max())[-1] / KNOTS
    value, slope = _shape(psi, np.linspace(0, end, KNOTS + 1))
    v, w, p, q = value[:-1], value[1:], slope[:-1] * end / KNOTS, slope[1:] * end / KNOTS
    return _Profile(np.stack([v, p, 3 * (w - v) - 2 * p - q, 2 * (v - w) + p + q], axis=1), end)


def _shape(psi: Mother, s: Float[np.ndarray, "m"]) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Values and slopes of a profile at equal steps from 0."""
    step, far, zero = s[1], s[1:], np.zeros(1)
    value, slope = psi(far), psi.derivative(far)
    if psi.parity == "odd":
        return np.append(psi.derivative(zero), value / far), np.append(0.0, (slope - value / far) / far)
    places = s[:-1, None] + step / 2 * (1 + NODES)
    average = np.cumsum(psi(places) @ WEIGHTS * step / 2) / far
    return np.append(2 * psi(zero), value + average), np.append(0.0, slope + (value - average) / far)


@dataclass(frozen=True, eq=False)
class Pairs:
    """Wavelets of one mother and the points in their reach: pair by pair the wavelet, the point, and s."""

    profile: _Profile
    wavelets: Int[np.ndarray, "q"]
    points: Int[np.ndarray, "q"]
    s: Float[np.ndarray, "q"]


def pairs(wavelets: SphericalWavelets, points: Float[np.ndarray, "n 3"]) -> Iterator[Pairs]:
    """All pairs, in groups of one mother and similar dilations."""
    if not len(points) or not len(wavelets.dilations):
        return
    tree = cKDTree(points)
    buckets = np.floor(BUCKETS_PER_OCTAVE * np.log2(wavelets.dilations)).astype(np.int64)
    for kind, psi in enumerate(wavelets.mothers):
        profile = _profile(psi)
        for bucket in np.unique(buckets[wavelets.kinds == kind]):
            group = np.flatnonzero((buckets == bucket) & (wavelets.kinds == kind))
            d = wavelets.dilations[group]
            near = _near(tree, wavelets.centers[group], d.max() * profile.end)
            s = near["v"] / d[near["i"]]
            inside = s <= profile.end
            yield Pairs(profile, group[near["i"][inside]], near["j"][inside], s[inside])


def _near(tree: cKDTree, centers: Float[np.ndarray, "c 3"], chord: float) -> np.ndarray:
    """Centers i, points j and distances v of all pairs within a chord."""
    return cKDTree(centers).sparse_distance_matrix(tree, min(chord, FARTHEST), output_type="ndarray")


def along(wavelets: SphericalWavelets, points: Float[np.ndarray, "n 3"], of: Pairs) -> Float[np.ndarray, "q"]:
    """The factor (x . e) / d of odd wavelets, 1 for even ones."""
    if wavelets.mothers[wavelets.kinds[of.wavelets[0]]].parity == "even":
        return np.ones(len(of.s))
    return np.einsum("qc,qc->q", points[of.points], wavelets.directions[of.wavelets]) / wavelets.dilations[of.wavelets]


def _values(wavelets: SphericalWavelets, points: Float[np.ndarray, "n 3"]) -> sp.csr_matrix:
    """Each wavelet at each point."""
    parts = [(of.profile.values(of.s) * along(wavelets, points, of), of) for of in pairs(wavelets, points) if len(of.s)]
    return _gathered(parts, (len(points), len(wavelets.dilations)))


def _slopes(wavelets: SphericalWavelets, points: Float[np.ndarray, "n 3"], coordinate: int) -> sp.csr_matrix:
    """Derivatives of each wavelet at each point along one coordinate of space; s^2 counts as 2 (1 - x . c) / d^2."""
    parts = []
    for of in pairs(wavelets, points):
        if len(of.s):
            d, c, e = (a[of.wavelets] for a in (wavelets.dilations, wavelets.centers[:, coordinate], wavelets.directions[:, coordinate]))
            turned = of.profile.values(of.s) * e / d  # zero for even ones
            parts.append((turned - of.profile.slopes(of.s) * c / d**2 * along(wavelets, points, of), of))
    return _gathered(parts, (len(points), len(wavelets.dilations)))


def _gathered(parts: list[tuple[Float[np.ndarray, "_"], Pairs]], shape: tuple[int, int]) -> sp.csr_matrix:
    """Values of pairs as one sparse matrix, points by wavelets."""
    if not parts:
        return sp.csr_matrix(shape)
    values, rows, columns = (np.concatenate(c) for c in zip(*((v, of.points, of.wavelets) for v, of in parts), strict=True))
    return sp.csr_matrix((values, (rows, columns)), shape=shape)


def _seen(tree: cKDTree, areas: Float[np.ndarray, "n"], centers: Float[np.ndarray, "c 3"], chord: float) -> Bool[np.ndarray, "c"]:
    """Which centers have samples enough within a chord."""
    near = _near(tree, centers, chord)
    total, squares = (np.bincount(near["i"], areas[near["j"]] ** power, len(centers)) for power in (1, 2))
    return total**2 > (FEWEST_SAMPLES - 0.5) * squares


def _gap(count: int) -> float:
    """Distance of neighbours among so many points that are spread in a hexagonal pattern."""
    return float(np.sqrt(4 * np.pi / count * 2 / np.sqrt(3)))


def _nothing() -> Any:
    return np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0), np.zeros(0, np.int64)


def _even_or_odd(mothers: Sequence[Mother]) -> tuple[Mother, ...]:
    """The mothers, if each is different and has a parity."""
    kept = different(mothers)
    without = [psi.name for psi in kept if psi.parity == "none"]
    if without:
        raise InputError(
            "mothers that are even or odd", f"{', '.join(without)} without parity", "choose others: beta2 and beta1, for instance"
        )
    return kept


def _freeze(owner: SphericalLibrary | SphericalNetwork) -> None:
    """Check the wavelets of a new value, and put copies in their places."""
    mothers = _even_or_odd(owner.mothers)
    kinds = _arrays.index(owner.kinds, "kinds", (None,), len(mothers))
    dilations = _arrays.real(owner.dilations, "dilations", (len(kinds),))
    bad = np.flatnonzero(dilations <= 0)
    if len(bad):
        raise InputError("dilations > 0", f"{len(bad)} that are not", "remove these wavelets", bad)
    centers = _arrays.real(owner.centers, "centers", (len(kinds), 3))
    directions = _arrays.real(owner.directions, "directions", (len(kinds), 3))
    lengths = np.array([psi.parity == "odd" for psi in mothers], float)[kinds]
    _require_lengths(centers, np.ones(len(kinds)), "centers of length 1")
    _require_lengths(directions, lengths, "directions of length 1 for odd mothers, 0 for even ones")
    slanted = np.flatnonzero(np.abs(np.einsum("pc,pc->p", centers, directions)) > TANGENT)
    if len(slanted):
        raise InputError("directions tangent at their centers", f"{len(slanted)} that are not", "project them", slanted)
    values = {"mothers": mothers, "kinds": kinds, "centers": centers, "directions": directions, "dilations": dilations}
    for name, value in values.items():
        object.__setattr__(owner, name, value)


def _require_lengths(vectors: Float[np.ndarray, "p 3"], lengths: Float[np.ndarray, "p"], needed: str) -> None:
    """Refuse vectors of other lengths."""
    wrong = np.flatnonzero(np.abs(np.linalg.norm(vectors, axis=1) - lengths) > TANGENT)
    if len(wrong):
        raise InputError(needed, f"{len(wrong)} of other lengths", "normalise or clear them", wrong)
