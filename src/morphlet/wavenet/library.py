"""The candidates of a wavelet network: every mother dilated and shifted (Eq. 5).

A candidate is alpha psi((x - center) / dilation). Mothers have unit rms radius, so a dilation is the rms radius of the
wavelet in units of x. (The paper multiplies by a_i where the dilation d_i divides: a_i = 1 / d_i.)

Published, alpha is (sum over samples of psi^2)^(+1/2), which gives a candidate the norm sum psi^2, not 1; unit norm needs
the exponent -1/2. Networks also fit an affine part, so alpha is taken after that is projected out of the candidates.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol, get_args, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.wavenet.mothers import Mother

Normalisation = Literal["unit", "literal"]

WIDEST = 0.5
"""Dilation of band 0: half the length of the signal."""
MARGIN = 1.0
"""How far outside [0, 1] a center may lie: a signal's length."""
FEWEST_SAMPLES = 3
"""Samples within a candidate's reach; with fewer it is not seen to be a wavelet."""
LEAST_NORM = 1e-3
"""Sampled norm of a candidate that is worth keeping, relative to one that lies inside the signal wholly."""
LARGEST = 1e150
"""Largest value whose square is a number with room for sums."""
AFFINE_ROUNDING = 1e-8
"""A candidate of which less than this share is left beside the affine part is itself affine on the samples."""


@dataclass(frozen=True, eq=False)
class Library:
    """l candidates: the mother, the center and the dilation of each, and how they are normalised.

    Parameters
    ----------
    mothers
        Different mothers.
    kinds
        Which of the mothers each candidate has.
    centers, dilations
        Places and rms radii, in units of x; dilations are positive.
    bands
        Which of its widths a candidate has: 0 for the widest.
    normalisation
        "unit", or "literal" for Eq. 5 as printed (exponent +1/2, affine part not projected out before).

    Raises
    ------
    InputError
        If lengths differ, two mothers have one name, a kind is no mother's, or a dilation is not positive.

    Examples
    --------
    >>> from morphlet.wavenet.library import Library
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> two = Library((MOTHERS["slog1"], MOTHERS["beta2"]), [0, 1], [0.2, 0.7], [0.1, 0.1], [0, 0])
    >>> two.values(np.array([0.3, 0.7])).round(2)
    array([[ 0.7 ,  0.  ],
           [ 0.  , -0.85]])
    """

    mothers: tuple[Mother, ...]
    kinds: Int[np.ndarray, "l"]
    centers: Float[np.ndarray, "l"]
    dilations: Float[np.ndarray, "l"]
    bands: Int[np.ndarray, "l"]
    normalisation: Normalisation = "unit"

    def __post_init__(self) -> None:
        if self.normalisation not in get_args(Normalisation):
            raise InputError("a normalisation 'unit' or 'literal'", repr(self.normalisation), "choose one of them")
        freeze_wavelets(self)
        object.__setattr__(self, "bands", _arrays.index(self.bands, "bands", (len(self),), np.iinfo(np.int64).max))

    def __reduce__(self) -> tuple[Any, ...]:
        arrays = (np.array(getattr(self, name)) for name in ("kinds", "centers", "dilations", "bands"))
        return Library, (self.mothers, *arrays, self.normalisation)

    def __len__(self) -> int:
        return len(self.centers)

    def __repr__(self) -> str:
        return f"Library({len(self)} candidates of {', '.join(psi.name for psi in self.mothers)})"

    def values(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n l"]:
        """The candidates at x before normalisation: psi((x - center) / dilation)."""
        return sampled(self, _arrays.real(x, "x", (None,)))

    def design(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n l"]:
        """The candidates at x, without their affine parts, normalised: what a fit chooses from.

        Parameters
        ----------
        x
            Places of the samples.

        Returns
        -------
        Float[np.ndarray, "n l"]
            Columns of unit norm, orthogonal to 1 and x; 0 for a candidate that is affine on these samples. With the
            literal normalisation, columns have the norms that Eq. 5 as printed gives them.

        Raises
        ------
        InputError
            If a place is not finite.

        Notes
        -----
        About 25 ms for 256 samples and 1700 candidates.

        Examples
        --------
        >>> from morphlet.wavenet.library import dyadic_library
        >>> from morphlet.wavenet.mothers import MOTHERS
        >>> x = np.linspace(0, 1, 64)
        >>> design = dyadic_library([MOTHERS["mexican_hat"]], x).design(x)
        >>> np.allclose(np.linalg.norm(design, axis=0), 1)
        True
        """
        x = _arrays.real(x, "x", (None,))
        return normalised(self.values(x), x, self.normalisation)[0]


def dyadic_library(
    mothers: Sequence[Mother], points: Float[np.ndarray, "n"], levels: int = 6, voices: int = 1, spacing: float = 1.0
) -> Library:
    """Candidates on a grid: dilations that halve from band to band, centers in steps of the dilation.

    The grids of several mothers are interleaved: the j-th of J is shifted by j / J of a step. Mothers of nearly the same
    shape, as the paper's six are, then stand in different places.

    Parameters
    ----------
    mothers
        Different ones, such as `PAPER_SIX`.
    points
        Places of the samples, from 0 to 1.
    levels
        How often the dilation is halved at most, from 1/2; it does not fall below the mean distance of the samples.
    voices
        Bands per halving.
    spacing
        Distance of neighbouring centers over their dilation.

    Returns
    -------
    Library
        By mother, from wide to narrow, from left to right. Candidates that the samples hardly see are left out: those
        with fewer than 3 samples in reach, or with less than a thousandth of their norm on the samples [1]_.

    Raises
    ------
    InputError
        If points are fewer than 2, not finite, or outside [0, 1]; if levels are negative; if voices or spacing are not
        positive; if two mothers have one name.

    References
    ----------
    .. [1] Q. Zhang, "Using wavelet network in nonparametric estimation", IEEE Transactions on Neural Networks 8 (1997).

    Examples
    --------
    >>> from morphlet.wavenet.library import dyadic_library
    >>> from morphlet.wavenet.mothers import PAPER_SIX
    >>> dyadic_library(PAPER_SIX, np.linspace(0, 1, 256))
    Library(1693 candidates of mexican_hat, slog1, polywog1, beta1, beta2, beta3)
    """
    points = _places(points)
    mothers = different(mothers)
    if levels < 0 or voices < 1 or not 0 < spacing < np.inf:
        found = f"levels {levels}, voices {voices}, spacing {spacing}"
        raise InputError("levels >= 0, voices >= 1, spacing > 0", found, "start from 6, 1 and 1")
    gap = float(np.ptp(points)) / (len(points) - 1)
    dilations = WIDEST * 2.0 ** -(np.arange(levels * voices + 1) / voices)
    grids = [
        (kind, band, d, _grid(psi, points, float(d), (spacing * float(d), kind / len(mothers))))
        for kind, psi in enumerate(mothers)
        for band, d in enumerate(dilations[dilations >= gap])
    ]
    sizes = [len(grid[3]) for grid in grids]
    kinds, bands, widths = (np.repeat([grid[k] for grid in grids], sizes) for k in range(3))
    return Library(tuple(mothers), kinds, np.concatenate([np.zeros(0), *(grid[3] for grid in grids)]), widths, bands)


def _places(points: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Checked sample places in [0, 1]."""
    points = _arrays.real(points, "points", (None,))
    if len(points) < 2 or np.ptp(points) == 0:
        raise InputError("2 or more different points", f"{len(np.unique(points))}", "sample the signal more densely")
    outside = np.nonzero((points < 0) | (points > 1))[0]
    if len(outside):
        raise InputError("points from 0 to 1", f"{len(outside)} outside", "shift and scale them: (x - min) / (max - min)", outside)
    return points


def _grid(psi: Mother, points: Float[np.ndarray, "n"], dilation: float, grid: tuple[float, float]) -> Float[np.ndarray, "c"]:
    """Centers of one band that the samples see: so many steps, and this share of one, from the middle of [0, 1]."""
    step, share = grid
    farthest = 0.5 + min(MARGIN, psi.reach * dilation)
    centers = 0.5 + step * np.arange(np.ceil(-farthest / step - share), np.floor(farthest / step - share) + 1) + step * share
    return centers[_seen(psi, scaled(points, centers, np.full(len(centers), dilation)))]


def _seen(psi: Mother, z: Float[np.ndarray, "n c"]) -> Bool[np.ndarray, "c"]:
    """Which candidates have samples enough within their reach, and norm enough on them."""
    enough = (np.abs(z) <= psi.reach).sum(axis=0) >= FEWEST_SAMPLES
    whole = (len(z) - 1) / np.ptp(z[:, 0])  # sum of psi^2 if the samples went on outside
    return enough & ((psi(z) ** 2).sum(axis=0) >= LEAST_NORM**2 * whole)


@runtime_checkable
class Wavelets(Protocol):
    """Anything that holds wavelets: candidates, or those of a network."""

    @property
    def mothers(self) -> tuple[Mother, ...]:
        """Different mothers."""

    @property
    def kinds(self) -> Int[np.ndarray, "p"]:
        """Which of the mothers each wavelet has."""

    @property
    def centers(self) -> Float[np.ndarray, "p"]:
        """Places."""

    @property
    def dilations(self) -> Float[np.ndarray, "p"]:
        """Rms radii."""


def freeze_wavelets(owner: Wavelets) -> None:
    """Check the mothers, kinds, centers and dilations of a new value, and put copies in their places."""
    mothers = different(owner.mothers)
    kinds = _arrays.index(owner.kinds, "kinds", (None,), len(mothers))
    dilations = _arrays.real(owner.dilations, "dilations", (len(kinds),))
    bad = np.nonzero(dilations <= 0)[0]
    if len(bad):
        raise InputError("dilations > 0", f"{len(bad)} that are not", "remove these wavelets", bad)
    centers = _arrays.real(owner.centers, "centers", (len(kinds),))
    for name, value in (("mothers", mothers), ("kinds", kinds), ("centers", centers), ("dilations", dilations)):
        object.__setattr__(owner, name, value)


def different(mothers: Sequence[Mother]) -> tuple[Mother, ...]:
    """The mothers, if each has a name of its own."""
    if not all(isinstance(psi, Mother) for psi in mothers):
        raise InputError("mothers", ", ".join(type(psi).__name__ for psi in mothers), "take them from MOTHERS, or call mother(name)")
    if len({psi.name for psi in mothers}) < len(mothers):
        raise InputError("each mother once", ", ".join(psi.name for psi in mothers), "name each once")
    return tuple(mothers)


def scaled(x: Float[np.ndarray, "n"], centers: Float[np.ndarray, "p"], dilations: Float[np.ndarray, "p"]) -> Float[np.ndarray, "n p"]:
    """Where each sample lies in the mother of each wavelet."""
    return np.subtract.outer(x, centers) / dilations


def sampled(wavelets: Wavelets, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n p"]:
    """psi((x - center) / dilation), a column per wavelet."""
    z = scaled(x, wavelets.centers, wavelets.dilations)
    for kind, psi in enumerate(wavelets.mothers):
        columns = wavelets.kinds == kind
        z[:, columns] = psi(z[:, columns])
    return z


def fitting(x: Any, rows: Any) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "r n k"]]:
    """Checked places of samples, and signals on them."""
    x, rows = _arrays.real(x, "x", (None,)), _arrays.real(rows, "rows", (None, None, None))
    if rows.shape[1] != len(x):
        raise InputError(f"{len(x)} values for {len(x)} places", f"{rows.shape[1]}", "pass one value per place and output")
    if len(np.unique(x)) < 2:
        raise InputError("samples at 2 or more different places", f"{len(np.unique(x))}", "sample the signal more densely")
    if np.abs(rows).max(initial=0) > LARGEST:
        raise InputError(f"values up to {LARGEST:g}", f"{np.abs(rows).max():g}", "change the unit: squares must not overflow")
    return x, rows


def affine_basis(x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n a"]:
    """Orthonormal columns that span 1 and x; the second is missing if all x are equal."""
    one = np.full((len(x), 1), len(x) ** -0.5)
    slope = x - x.mean()
    length = np.linalg.norm(slope)
    return np.column_stack([one, slope / length]) if length > 0 else one


def normalised(
    values: Float[np.ndarray, "n l"], x: Float[np.ndarray, "n"], normalisation: Normalisation
) -> tuple[Float[np.ndarray, "n l"], Float[np.ndarray, "l"]]:
    """Candidates without their affine part, times alpha (Eq. 5); and alpha."""
    basis = affine_basis(x)
    rest = values - basis @ (basis.T @ values)
    rest -= basis @ (basis.T @ rest)  # twice is enough for orthogonality to rounding
    before, left = (np.sqrt(np.einsum("nl,nl->l", columns, columns)) for columns in (values, rest))
    affine = left <= AFFINE_ROUNDING * before
    alpha = np.where(affine, 0, before if normalisation == "literal" else 1 / np.where(affine, 1, left))
    rest *= alpha
    return rest, alpha
