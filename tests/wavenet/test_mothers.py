"""Mother wavelets: moments, norm, radius, slopes, support and parity of every row of the table, and how alike they are."""

import pickle
from itertools import combinations
from math import factorial
from pathlib import Path

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.special import beta as euler_beta
from scipy.special import expit

from morphlet.errors import InputError
from morphlet.wavenet.mothers import ENERGY_OUTSIDE, MOTHERS, PAPER_SIX, beta, coherence, mother

BETAS = [beta(n, p, q) for n in (1, 2, 3) for p, q in ((4, 4), (4, 8), (8, 4), (4.5, 6), (30, 30))]
ALL = [*MOTHERS.values(), *BETAS]
each = pytest.mark.parametrize("psi", ALL, ids=lambda psi: psi.name)
compact = pytest.mark.parametrize("psi", [psi for psi in ALL if np.isfinite(psi.support[0])], ids=lambda psi: psi.name)
T_INSIDE = np.linspace(0.01, 0.99, 99)
QUADRATURE = 1e-9
"""An integer beta is integrated exactly, the others converge faster than any power; (4.5, 6) only to its kink."""
FAR = 20.0
"""The slowest, slog1, is exp(-2.6 t): 1e-22."""


def integral(psi, weight):
    """Of weight(t, psi(t)), on panels that end where the support does."""
    ends = np.linspace(max(-FAR, psi.support[0]), min(FAR, psi.support[1]), 41)
    nodes, weights = leggauss(24)
    half, middle = np.diff(ends) / 2, (ends[1:] + ends[:-1]) / 2
    t = middle[:, None] + half[:, None] * nodes
    return float((weight(t, psi(t)) * weights * half[:, None]).sum())


@each
def test_exactly_the_stated_moments_vanish(psi):
    moments = [integral(psi, lambda t, y, k=k: t**k * y) for k in range(psi.vanishing_moments + 1)]
    assert np.abs(moments[:-1]).max() < QUADRATURE * 10  # t^3 weighs the tails of the kinked one
    assert abs(moments[-1]) > 0.1


@each
def test_norm_radius_and_centre_are_one_one_zero(psi):
    assert integral(psi, lambda t, y: y**2) == pytest.approx(1, abs=QUADRATURE)
    assert integral(psi, lambda t, y: t * y**2) == pytest.approx(0, abs=QUADRATURE)
    assert integral(psi, lambda t, y: t**2 * y**2) == pytest.approx(1, abs=QUADRATURE)


@each
def test_the_derivative_is_that_of_the_function(psi):
    """The remainder of the first Taylor term falls with the square of the step."""
    low, high = np.maximum(psi.support[0], -4) + 0.05, np.minimum(psi.support[1], 4) - 0.05
    t = np.random.default_rng(0).uniform(low, high, 200)
    steps = np.array([1e-2, 1e-3, 1e-4])
    rests = [np.linalg.norm(psi(t + h) - psi(t) - h * psi.derivative(t)) for h in steps]
    assert np.polyfit(np.log(steps), np.log(rests), 1)[0] == pytest.approx(2, abs=0.02)


@each
def test_parity_is_as_stated(psi):
    t = np.linspace(0.1, 3, 30)
    mirrored = {"even": psi(t), "odd": -psi(t)}
    if psi.parity == "none":
        assert all(np.abs(psi(-t) - values).max() > 0.1 for values in mirrored.values())
    else:
        np.testing.assert_allclose(psi(-t), mirrored[psi.parity], atol=1e-12)


@each
def test_the_energy_beyond_the_reach_is_a_thousandth(psi):
    t = np.linspace(-psi.reach, psi.reach, 20001)
    assert 1 - np.trapezoid(psi(t) ** 2, t) == pytest.approx(ENERGY_OUTSIDE, rel=0.02)  # the reach is rounded up to 0.003
    assert psi.reach <= max(np.abs(psi.support))


@compact
def test_beta_wavelets_are_zero_outside_their_support_and_continuous_at_its_ends(psi):
    for end, outward in zip(psi.support, (-1, 1), strict=True):
        assert psi(np.array(end + outward * 1e-9)) == 0
        assert psi.derivative(np.array(end + outward * 1e-9)) == 0
        assert psi(np.array(end - outward * 1e-3)) != 0
        assert abs(psi(np.array(end - outward * 1e-9))) < 1e-3


@pytest.mark.parametrize(
    ("name", "reach", "radius", "norm2"),
    [
        ("mexican_hat", 3.17, 1.0801, 0.75 * np.sqrt(np.pi)),
        ("polywog1", 2.85, 1.2247, 0.5 * np.sqrt(np.pi)),
        ("polywog2", 3.39, 1.0488, 15 / 8 * np.sqrt(np.pi)),
        ("polywog3", 3.54, 1.0351, 105 / 16 * np.sqrt(np.pi)),
        ("polywog5", 3.86, 1.8464, 33 / 16 * np.sqrt(np.pi)),
        ("slog1", 6.32, 2.6113, 0.8947693969),
        ("slog2", 6.30, 1.8938, 0.5253242074),
    ],
)
def test_published_mothers_are_scaled_by_their_known_norm_and_radius(name, reach, radius, norm2):
    published = {
        "mexican_hat": lambda t: (1 - t**2) * np.exp(-(t**2) / 2),
        "polywog1": lambda t: t * np.exp(-(t**2) / 2),
        "polywog2": lambda t: (t**3 - 3 * t) * np.exp(-(t**2) / 2),
        "polywog3": lambda t: (t**4 - 6 * t**2 + 3) * np.exp(-(t**2) / 2),
        "polywog5": lambda t: (3 * t**2 - t**4) * np.exp(-(t**2) / 2),
        "slog1": lambda t: expit(t - 1) - expit(t - 3) - expit(t + 3) + expit(t + 1),
        "slog2": lambda t: 3 * expit(t + 1) - 3 * expit(t - 1) - expit(t + 3) + expit(t - 3),
    }[name]
    t = np.linspace(-3, 3, 61)
    np.testing.assert_allclose(MOTHERS[name](t), published(radius * t) * np.sqrt(radius / norm2), atol=2e-4)  # radii have 4 digits
    assert MOTHERS[name].reach == pytest.approx(reach / radius, abs=0.01)


def test_beta_wavelets_are_the_known_polynomials():
    """p = q = 5 on [-1, 1]: 10 (1 - x^2)^3 (9 x^2 - 1) for the second order, of norm 7.16585."""
    psi = MOTHERS["beta2"]
    radius = 1 / psi.support[1]
    x = np.linspace(-1, 1, 41)
    polynomial = 10 * (1 - x**2) ** 3 * (9 * x**2 - 1)
    np.testing.assert_allclose(psi(x / radius), polynomial * np.sqrt(radius) / 7.16585, atol=1e-5)


@pytest.mark.parametrize(
    ("p", "norms"),
    [
        (4, (1.70581, 6.26756, 29.1739)),
        (5, (1.77568, 7.16585, 36.1858)),
        (6, (1.8396, 8.05372, 44.1121)),
        (30, (2.64492, 25.2054, 307.577)),
    ],
)
def test_derivatives_of_the_bump_have_their_known_norms(p, norms):
    """On [-1, 1], by the formulas for p = q; the wavelet is the n-th times sqrt(radius) / norm."""
    x = np.linspace(-0.95, 0.95, 39)
    w = 1 - x**2
    powers = (-2 * p * x * w ** (p - 1), 2 * p * w ** (p - 2) * ((2 * p - 1) * x**2 - 1))
    powers += (-4 * p * (p - 1) * x * w ** (p - 3) * ((2 * p - 1) * x**2 - 3),)
    for n, norm, power in zip((1, 2, 3), norms, powers, strict=True):
        psi = beta(n, p, p)
        radius = 1 / psi.support[1]
        np.testing.assert_allclose(psi(x / radius) / np.sqrt(radius), power / norm, rtol=1e-5, atol=1e-12)  # norms have 6 digits


@pytest.mark.parametrize(("n", "norm"), [(1, 1.63087), (2, 5.40899)])
def test_low_exponents_have_their_known_norms_too(n, norm):
    """p = q = 3; of order 3 it would jump."""
    x = np.linspace(-1, 1, 20001)
    y = SHAPE_OF_ORDER[n](x, 3.0, 3.0)
    assert np.sqrt(np.trapezoid(y**2, x)) == pytest.approx(norm, rel=1e-5)
    psi = beta(n, 3, 3)
    np.testing.assert_allclose(psi(x * psi.support[1]) * np.sqrt(psi.support[1]), y / norm, rtol=1e-4, atol=1e-5)


def bump(x, p, q):
    """1 at its top."""
    top = (p - q) / (p + q)
    return ((1 + x) / (1 + top)) ** p * ((1 - x) / (1 - top)) ** q


def first(x, p, q):
    """Derivatives by the logarithm of the bump: h = p / u - q / v."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(bump(x, p, q) * (p / (1 + x) - q / (1 - x)))


def second(x, p, q):
    u, v = 1 + x, 1 - x
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.nan_to_num(bump(x, p, q) * ((p / u - q / v) ** 2 - p / u**2 - q / v**2))


def third(x, p, q):
    u, v = 1 + x, 1 - x
    with np.errstate(divide="ignore", invalid="ignore"):
        h = p / u - q / v
        return np.nan_to_num(bump(x, p, q) * (h**3 - 3 * h * (p / u**2 + q / v**2) + 2 * p / u**3 - 2 * q / v**3))


SHAPE_OF_ORDER = {1: first, 2: second, 3: third}


@pytest.mark.parametrize("n", [1, 2, 3])
@pytest.mark.parametrize(("p", "q"), [(5.0, 5.0), (4.0, 8.0), (8.0, 4.0), (4.5, 6.0), (30.0, 30.0)])
def test_beta_wavelets_are_derivatives_of_the_bump(n, p, q):
    """By another formula; and their first moment that does not vanish is (-1)^n n! times the integral of the bump."""
    psi = beta(n, p, q)
    radius = 2 / (psi.support[1] - psi.support[0])
    x = -1 + radius * (T_INSIDE * (psi.support[1] - psi.support[0]))
    y = SHAPE_OF_ORDER[n](x, p, q)
    values = psi((x + 1) / radius + psi.support[0])
    height = float(values @ y / (y @ y))
    np.testing.assert_allclose(values, height * y, rtol=1e-9, atol=1e-9)
    top = (p - q) / (p + q)
    integral_of_bump = 2 ** (p + q + 1) * euler_beta(p + 1, q + 1) * (1 + top) ** -p * (1 - top) ** -q
    moment = integral(psi, lambda t, y: t**n * y)
    assert moment * radius ** (n + 1) / height == pytest.approx((-1) ** n * factorial(n) * integral_of_bump, rel=1e-8)


def test_slog2_as_it_is_often_printed_is_no_wavelet():
    t = np.linspace(-60, 60, 120001)
    printed = 3 * expit(t + 1) - 3 * expit(t - 1) - 3 * expit(t + 3) + 3 * expit(t + 3)
    assert np.trapezoid(printed, t) == pytest.approx(6, abs=1e-9)


@pytest.mark.parametrize(
    ("a", "b", "known"),
    [
        ("slog1", "polywog1", 0.9997),
        ("slog2", "mexican_hat", 0.9988),
        ("polywog5", "mexican_hat", 0.739),
        ("beta1", "polywog1", 0.997),
        ("beta2", "mexican_hat", 0.990),
        ("beta3", "polywog2", 0.972),
        ("beta3(4,4)", "polywog2", 0.938),
        ("beta1(30,30)", "polywog1", 0.9999),
        ("polywog4", "mexican_hat", 1.0),
        ("slog1", "mexican_hat", 0.0),
    ],
)
def test_mothers_are_as_alike_as_known(a, b, known):
    assert coherence(mother(a), mother(b)) == pytest.approx(known, abs=6e-4)
    assert coherence(mother(b), mother(a)) == pytest.approx(known, abs=6e-4)


def test_the_six_of_the_paper_are_three_shapes():
    shapes = [{"slog1", "polywog1", "beta1"}, {"mexican_hat", "beta2"}, {"beta3"}]
    of = {name: number for number, names in enumerate(shapes) for name in names}
    assert set(of) == {psi.name for psi in PAPER_SIX}
    for a, b in combinations(PAPER_SIX, 2):
        assert (coherence(a, b) > 0.98) == (of[a.name] == of[b.name]), (a, b)


@pytest.mark.parametrize(("a", "b", "least"), [("slog1", "polywog1", 0.99965), ("slog2", "mexican_hat", 0.99875)])
def test_superposed_logistics_are_as_good_as_polynomials_under_gaussians(a, b, least):
    """0.9997 and 0.9988, rounded to the last digit."""
    assert coherence(mother(a), mother(b)) > least


@each
def test_a_mother_is_found_by_its_name_and_survives_pickling(psi):
    t = np.linspace(-3, 3, 13)
    for copy in (mother(psi.name), pickle.loads(pickle.dumps(psi))):
        assert copy.name == psi.name
        np.testing.assert_array_equal(copy(t), psi(t))


@pytest.mark.parametrize("name", ["morlet", "Beta2", "beta4", "beta2(4;8)", "beta2(4..1,8)"])
def test_unknown_names_are_refused_with_the_names_there_are(name):
    with pytest.raises(InputError, match=r"needed one of mexican_hat, slog1, .*choose a mother that is there"):
        mother(name)


@pytest.mark.parametrize(("n", "p", "q"), [(0, 5, 5), (3, 3, 5), (3, 5, 3), (2, 2, 2), (1, np.nan, 5), (1, np.inf, 5), (1, 5, 101)])
def test_betas_that_would_jump_or_are_none_are_refused(n, p, q):
    with pytest.raises(InputError, match=r"needed n >= 1 and n < p, q <= 100; found n ="):
        beta(n, p, q)


@pytest.mark.parametrize("name", ["beta3(2,2)", "beta0(4,8)", "beta2(4,800)"])
def test_names_of_impossible_betas_are_refused(name):
    with pytest.raises(InputError, match="needed n >= 1 and n < p, q <= 100"):
        mother(name)


def test_the_page_of_mothers_tells_the_truth():
    """The first columns of its table: parity, vanishing moments and reach of every mother."""
    page = Path(__file__).parents[2] / "docs" / "mothers.md"
    rows = [[cell.strip() for cell in line.split("|")[1:5]] for line in page.read_text("utf-8").splitlines() if line.count("|") == 8]
    assert {name for name, *_ in rows} >= set(MOTHERS)
    for name, parity, moments, reach in rows[2:]:
        psi = mother(name)
        assert (parity, moments, reach) == (psi.parity, str(psi.vanishing_moments), f"{psi.reach:.2f}"), name
