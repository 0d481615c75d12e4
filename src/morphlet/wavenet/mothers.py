"""Mother wavelets, each with its derivative.

Every mother is normalised: unit L2 norm, energy centred at 0 with unit rms radius. So one grid of centers and dilations
serves them all, and a dilation means the same width for each. `MOTHERS` holds the table; `mother` finds a mother by its name,
such as "slog1" or the names that `beta` gives; `make_mother` makes one of your own.

The six mothers of the paper (`PAPER_SIX`) are three shapes only, as `coherence` shows: slog1, polywog1 and beta1 all look
like the first derivative of a bump, mexican_hat and beta2 like the second, and beta3 is the third. A library of the six has
six times as many candidates as one of a single mother on the same grid, but only three times as many that differ.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, fields
from math import comb, inf, perm
from types import MappingProxyType
from typing import Any, Literal

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial
from scipy.special import expit

from morphlet import _arrays
from morphlet.errors import InputError

Curve = Callable[[np.ndarray], np.ndarray]
Parity = Literal["even", "odd", "none"]

NODES, WEIGHTS = np.polynomial.legendre.leggauss(256)
"""Quadrature on [-1, 1]: exact for the beta wavelets up to p + q = 250, to rounding for the others over `FAR`."""
HIGHEST_EXPONENT = 100
"""Of `beta`: far below the quadrature's degree, and far above any use."""
FAR = 30.0
"""Half-width beyond which the unbounded mothers hold less than 1e-20 of their energy (slog1 decays slowest)."""
ENERGY_OUTSIDE = 0.001
"""Share of the energy that lies farther out than `reach`."""
REACH_SAMPLES = 8001
"""Samples from which `reach` is read: to 0.01."""
CHECKS = 2001
"""Places at which the functions of `make_mother` are looked at."""
DIFFERENCE = 1e-6
"""Step of the differences that check a derivative, over the width of the support."""
SLOPE_TOLERANCE = 1e-4
"""Error allowed to a slope, over the largest one."""
KINKS = 0.01
"""Share of the places at which differences may contradict the derivative."""
FADED = 1e-9
"""What counts as 0 at the end of an unbounded mother, over its maximum."""
NEGLIGIBLE = 1e-16
"""Rounding, over the maximum: the quadrature is spread over the places with more than that, however narrow the function is."""
PARITY = 1e-9
"""Difference of a function and its mirror image, over the maximum, that is rounding."""
MOST_MOMENTS, MOMENT_TOLERANCE = 8, 1e-9
"""`make_mother` counts vanishing moments up to 8; one vanishes below this share of the moment of the absolute values."""
DILATION_SPAN, DILATION_SAMPLES = 4.0, 1001
"""`coherence` tries dilations from 1/4 to 4 in steps of 0.3 %: 1e-6 below the maximum at most."""
COHERENCE_HALF_WIDTH, COHERENCE_SAMPLES = 16.0, 4001


@dataclass(frozen=True, eq=False)
class Mother:
    """A mother wavelet: a function of zero mean, unit norm, unit rms radius, centred at 0.

    Parameters
    ----------
    name
        By which `mother` finds it again.
    function, derivative
        Its values and slopes, at any array of places. The derivative holds almost everywhere: a beta wavelet of order n
        with p or q below n + 2 has a kink at an end of its support.
    support
        It is exactly 0 outside this interval; infinite for most.
    reach
        Half-width within which 99.9 % of the energy lies.
    parity
        Of the function: "even", "odd" or "none".
    vanishing_moments
        How many moments vanish: those of orders 0 to this less one, and not the next.

    Examples
    --------
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> hat = MOTHERS["mexican_hat"]
    >>> hat.parity, hat.vanishing_moments
    ('even', 2)
    >>> float(hat(np.array(0.0)).round(4))
    0.9014
    """

    name: str
    function: Curve
    derivative: Curve
    support: tuple[float, float]
    reach: float
    parity: Parity
    vanishing_moments: int

    def __reduce__(self) -> tuple[Any, ...]:
        return (mother, (self.name,)) if _reserved(self.name) else (Mother, tuple(getattr(self, field.name) for field in fields(self)))

    def __repr__(self) -> str:
        return f"Mother({self.name})"

    def __call__(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Its values."""
        return self.function(t)


@dataclass(frozen=True, eq=False)
class _Scaled:
    """height curve(radius t + center): a class, since files and other processes know no functions made by functions."""

    curve: Curve
    height: float
    radius: float
    center: float

    def __call__(self, t: np.ndarray) -> np.ndarray:
        return self.height * self.curve(self.radius * np.asarray(t, float) + self.center)


@dataclass(frozen=True, eq=False)
class _Clipped:
    """A curve inside an interval, and 0 outside, where the curve is not asked."""

    curve: Curve
    low: float
    high: float

    def __call__(self, t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, float)
        return np.where((self.low <= t) & (t <= self.high), self.curve(np.clip(t, self.low, self.high)), 0.0)


@dataclass(frozen=True, eq=False)
class Shape:
    """A mother as it is published, before normalisation: values, slopes, and what is known of them."""

    function: Curve
    derivative: Curve
    support: tuple[float, float]
    parity: Parity
    vanishing_moments: int


def polywog(coefficients: tuple[float, ...], vanishing_moments: int) -> Shape:
    """A polynomial, lowest power first, under the window exp(-t^2 / 2)."""
    polynomial = Polynomial(coefficients)
    slope = polynomial.deriv() - Polynomial([0, 1]) * polynomial

    def windowed(p: Polynomial) -> Curve:
        return lambda t: np.asarray(p(t) * np.exp(-0.5 * np.square(t)))

    parity: Parity = "odd" if coefficients[0] == 0 and coefficients[1] != 0 else "even"
    return Shape(windowed(polynomial), windowed(slope), (-inf, inf), parity, vanishing_moments)


def slog(steps: tuple[tuple[float, float], ...], parity: Parity, vanishing_moments: int) -> Shape:
    """A sum of logistic steps, given as (height, place)."""

    def function(t: np.ndarray) -> np.ndarray:
        return np.asarray(sum(height * expit(t - place) for height, place in steps))

    def derivative(t: np.ndarray) -> np.ndarray:
        return np.asarray(sum(height * expit(t - place) * expit(place - t) for height, place in steps))

    return Shape(function, derivative, (-inf, inf), parity, vanishing_moments)


def beta(n: int, p: float, q: float) -> Mother:
    """The n-th derivative of the bump u^p v^q, with u and v the distances from the ends of its support.

    Parameters
    ----------
    n
        Order of the derivative, and number of vanishing moments; at least 1.
    p, q
        Exponents at the left and the right end; above n, so that the wavelet is continuous, and at most 100.

    Returns
    -------
    Mother
        Of compact support, without parity unless p = q.

    Raises
    ------
    InputError
        If n is below 1, or p or q is not above n, or above 100.

    Notes
    -----
    With p or q between n - 1 and n it would still have zero mean but jump at the ends; below, n - 1 moments or fewer
    vanish. With p = q = 30 it is a derivative of a Gaussian to 3 digits; 4 or 5 keep it distinct.

    Examples
    --------
    >>> from morphlet.wavenet.mothers import beta
    >>> lopsided = beta(2, 4, 8)
    >>> lopsided
    Mother(beta2(4,8))
    >>> lopsided.parity, [round(end, 2) for end in lopsided.support]
    ('none', [-1.84, 4.8])
    """
    if n < 1 or not n < min(p, q) or not max(p, q) <= HIGHEST_EXPONENT:
        needed = f"n >= 1 and n < p, q <= {HIGHEST_EXPONENT}"
        raise InputError(needed, f"n = {n}, p = {p}, q = {q}", "choose other exponents: 5 suits orders up to 3")
    return _normalised(f"beta{n}({_plain(p)},{_plain(q)})", _beta_shape(n, p, q), (-1.0, 1.0))


def _plain(number: float) -> str:
    """The shortest text that is read as this number."""
    return str(int(number)) if number == int(number) else repr(float(number))


def _beta_shape(n: int, p: float, q: float) -> Shape:
    parity: Parity = "none" if p != q else "odd" if n % 2 else "even"
    return Shape(_beta_derivative(n, p, q), _beta_derivative(n + 1, p, q), (-1.0, 1.0), parity, n)


def _beta_derivative(n: int, p: float, q: float) -> Curve:
    """The n-th derivative, by Leibniz' rule: no division at the ends."""
    top = (p - q) / (p + q)
    scale = (top + 1) ** -p * (1 - top) ** -q
    factors = [scale * comb(n, k) * _falling(p, k) * (-1) ** (n - k) * _falling(q, n - k) for k in range(n + 1)]
    terms = [(factor, p - k, q - n + k) for k, factor in enumerate(factors) if factor]

    def function(t: np.ndarray) -> np.ndarray:
        t = np.asarray(t, float)
        inside = np.abs(t) < 1
        u, v, values = 1 + t[inside], 1 - t[inside], np.zeros(t.shape)
        values[inside] = sum(factor * u**a * v**b for factor, a, b in terms)
        return values

    return function


def _falling(p: float, k: int) -> float:
    """p (p - 1) ... with k factors."""
    return float(perm(int(p), k)) if p == int(p) else float(np.prod(p - np.arange(k)))


def make_mother(name: str, function: Curve, derivative: Curve, support: tuple[float, float] = (-inf, inf)) -> Mother:
    """A mother wavelet of your own, from any function of zero mean.

    Parameters
    ----------
    name
        Its name, in files too; not one of `MOTHERS` and not like those that `beta` gives.
    function, derivative
        Values and slopes at an array of places. They need no norm and no particular width.
    support
        Interval outside of which the function is taken for 0; without one it must have faded out 30 from 0.

    Returns
    -------
    Mother
        Of unit norm and unit rms radius, centred at 0; its parity and its vanishing moments are found out.

    Raises
    ------
    InputError
        If the name is taken, or the function is not finite, is 0, has not faded out, has no zero mean, or has another derivative.

    Examples
    --------
    >>> from morphlet.wavenet.mothers import make_mother
    >>> mine = make_mother("ripple", lambda t: t**3 * np.exp(-(t**2)), lambda t: (3 * t**2 - 2 * t**4) * np.exp(-(t**2)))
    >>> mine.parity, mine.vanishing_moments
    ('odd', 1)
    """
    if not name or _reserved(name):
        raise InputError("a new name for the mother", repr(name), "choose another one")
    if not support[0] < support[1] or any(abs(end) > FAR for end in support if not np.isinf(end)):
        advice = "shift or scale the function, or leave an end infinite"
        raise InputError(f"a support from its left to its right end, within {FAR:g} of 0", str(support), advice)
    values, slopes = _Clipped(function, *support), _Clipped(derivative, *support)
    bounds = _extent(name, values, support)
    _require_slopes(name, values, slopes, np.linspace(*bounds, CHECKS))
    moments = _vanishing_moments(values, bounds)
    if not moments:
        raise InputError(f"a function of zero mean as mother {name}", "another mean", "subtract a bump of the same mean")
    return _normalised(name, Shape(values, slopes, support, _parity(values, bounds), moments), bounds)


def _reserved(name: str) -> bool:
    """Whether `mother` knows this name."""
    return name in MOTHERS or BETA_NAME.fullmatch(name) is not None


def _bounds(support: tuple[float, float]) -> tuple[float, float]:
    """The support, or as much of it as counts."""
    return max(-FAR, support[0]), min(FAR, support[1])


def _checked(name: str, values: np.ndarray, t: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """The values of a mother, one finite number per place and not all 0."""
    values = _arrays.real(values, f"the values of mother {name}", t.shape)
    if not values.any():
        raise InputError(f"a function that is not 0 as mother {name}", "0 everywhere", "check its formula and its support")
    return values


def _extent(name: str, function: Curve, support: tuple[float, float]) -> tuple[float, float]:
    """The part of the support in which the function is more than rounding."""
    t = np.linspace(*_bounds(support), CHECKS)
    values = _checked(name, function(t), t)
    _require_fading(name, values, support)
    seen = np.nonzero(np.abs(values) > NEGLIGIBLE * np.abs(values).max())[0]
    return float(t[max(seen[0] - 1, 0)]), float(t[min(seen[-1] + 1, CHECKS - 1)])


def _require_fading(name: str, values: Float[np.ndarray, "n"], support: tuple[float, float]) -> None:
    """Refuse a function that is cut off where it has not faded out."""
    cut = [abs(values[end]) for end in (0, -1) if np.isinf(support[end])]
    if max(cut, default=0) > FADED * np.abs(values).max():
        advice = "scale its argument, or give its support"
        raise InputError(f"a function that has faded out {FAR:g} from 0 as mother {name}", f"{max(cut):.3g} there", advice)


def _require_slopes(name: str, function: Curve, derivative: Curve, t: Float[np.ndarray, "n"]) -> None:
    """Refuse a derivative that central differences contradict; a kink here and there is none of their business."""
    slopes = _arrays.real(derivative(t), f"the slopes of mother {name}", t.shape)
    step = DIFFERENCE * (t[-1] - t[0])
    differences = (function(t + step) - function(t - step)) / (2 * step)
    wrong = np.abs(slopes - differences) > SLOPE_TOLERANCE * np.abs(slopes).max()
    if wrong.mean() > KINKS:
        found = f"other slopes than its differences at {wrong.sum()} of {len(t)} places"
        raise InputError(f"the derivative of mother {name}", found, "derive the function again")


def _parity(function: Curve, bounds: tuple[float, float]) -> Parity:
    """Of a function, from its mirror image."""
    places, _ = _quadrature((-max(-bounds[0], bounds[1]), max(-bounds[0], bounds[1])))
    values = function(places)
    small = PARITY * np.abs(values).max()
    return "even" if np.abs(values - values[::-1]).max() <= small else "odd" if np.abs(values + values[::-1]).max() <= small else "none"


def _quadrature(bounds: tuple[float, float]) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Places and weights of integrals from the one bound to the other."""
    low, high = bounds
    return (low + high) / 2 + (high - low) / 2 * NODES, (high - low) / 2 * WEIGHTS


def _vanishing_moments(function: Curve, bounds: tuple[float, float]) -> int:
    """How many moments vanish, from the mean on."""
    places, weights = _quadrature(bounds)
    values = weights * function(places)
    moments = np.array([values @ places**k for k in range(MOST_MOMENTS)])
    sizes = np.array([np.abs(values) @ np.abs(places) ** k for k in range(MOST_MOMENTS)])
    return int(np.argmax(np.append(np.abs(moments) > MOMENT_TOLERANCE * sizes, True)))


def _normalised(name: str, shape: Shape, bounds: tuple[float, float]) -> Mother:
    """The shape with unit norm and unit rms radius, moved so that its energy is centred at 0."""
    places, weights = _quadrature(bounds)
    energy = weights * shape.function(places) ** 2
    center = 0.0 if shape.parity != "none" else float(energy @ places / energy.sum())
    radius = float(np.sqrt(energy @ (places - center) ** 2 / energy.sum()))
    height = float(np.sqrt(radius / energy.sum()))
    function = _Scaled(shape.function, height, radius, center)
    support = ((shape.support[0] - center) / radius, (shape.support[1] - center) / radius)
    reach = _reach(function, (max(-bounds[0], bounds[1]) + abs(center)) / radius)
    derivative = _Scaled(shape.derivative, height * radius, radius, center)
    return Mother(name, function, derivative, support, reach, shape.parity, shape.vanishing_moments)


def _reach(function: Curve, far: float) -> float:
    """The half-width beyond which `ENERGY_OUTSIDE` of the energy lies."""
    places = np.linspace(0, far, REACH_SAMPLES)
    outward = np.cumsum(function(places) ** 2 + function(-places) ** 2)
    return float(places[np.searchsorted(outward, (1 - ENERGY_OUTSIDE) * outward[-1])])


SHAPES = {
    "mexican_hat": polywog((1, 0, -1), 2),
    "slog1": slog(((1, 1), (-1, 3), (-1, -3), (1, -1)), "odd", 1),
    "polywog1": polywog((0, 1), 1),
    "beta1": _beta_shape(1, 5, 5),
    "beta2": _beta_shape(2, 5, 5),
    "beta3": _beta_shape(3, 5, 5),
    "polywog2": polywog((0, -3, 0, 1), 3),
    "polywog3": polywog((3, 0, -6, 0, 1), 4),
    "polywog4": polywog((1, 0, -1), 2),
    "polywog5": polywog((0, 0, 3, 0, -1), 2),
    "slog2": slog(((3, -1), (-3, 1), (-1, -3), (1, 3)), "even", 2),
}
"""One row per mother, as published: another is one more row. polywog4 is mexican_hat under its other name. slog2 is
often printed with its last two terms at one place, where they cancel: that has mean 6 and is no wavelet."""

MOTHERS = MappingProxyType({name: _normalised(name, shape, _bounds(shape.support)) for name, shape in SHAPES.items()})
"""The mothers by name."""

PAPER_SIX = tuple(MOTHERS[name] for name in ("mexican_hat", "slog1", "polywog1", "beta1", "beta2", "beta3"))
"""The mothers of the paper's library."""

BETA_NAME = re.compile(r"beta(\d+)\((\d+(?:\.\d+)?),(\d+(?:\.\d+)?)\)")


def mother(name: str) -> Mother:
    """The mother of this name: one of `MOTHERS`, or one that `beta` makes, such as "beta2(4,8)".

    Raises
    ------
    InputError
        If there is none, or the numbers in the name suit no beta wavelet.

    Examples
    --------
    >>> from morphlet.wavenet.mothers import mother
    >>> mother("slog1"), mother("beta3(6,6)")
    (Mother(slog1), Mother(beta3(6,6)))
    """
    if name in MOTHERS:
        return MOTHERS[name]
    match = BETA_NAME.fullmatch(name)
    if match is None:
        raise InputError(f"one of {', '.join(MOTHERS)}, or a name like beta2(4,8)", repr(name), "choose a mother that is there")
    return beta(int(match[1]), float(match[2]), float(match[3]))


def coherence(a: Mother, b: Mother) -> float:
    """How alike two mothers are: the largest cosine, by its size, between one and the dilations of the other, 1 if of one shape.

    Parameters
    ----------
    a, b
        Mothers, both centred at 0; they are not shifted against each other.

    Returns
    -------
    float
        From 0 to 1; 0 for mothers of opposite parity.

    Notes
    -----
    About 0.1 s.

    Examples
    --------
    Three of the paper's mothers are one shape, beta3 is another:

    >>> from morphlet.wavenet.mothers import MOTHERS, coherence
    >>> [round(coherence(MOTHERS[name], MOTHERS["polywog1"]), 3) for name in ("slog1", "beta1", "beta3")]
    [1.0, 0.997, 0.884]
    """
    t = np.linspace(-COHERENCE_HALF_WIDTH, COHERENCE_HALF_WIDTH, COHERENCE_SAMPLES)
    dilations = np.geomspace(1 / DILATION_SPAN, DILATION_SPAN, DILATION_SAMPLES)
    values = a(t) * (t[1] - t[0])
    return max(abs(float(values @ b(t / d))) / float(np.sqrt(d)) for d in dilations)
