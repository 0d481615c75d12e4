"""Mothers of one's own: normalised like those of the table, used like them, and what is refused."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.errors import FileError, InputError
from morphlet.wavenet.blocks import NetworkTable
from morphlet.wavenet.fit import FitOptions, fit, fit_rows
from morphlet.wavenet.library import Library, dyadic_library
from morphlet.wavenet.mothers import MOTHERS, SHAPES, Mother, beta, coherence, make_mother, mother
from morphlet.wavenet.network import WaveletNetwork

T = np.linspace(-5, 5, 401)
X = np.linspace(0, 1, 128)


def ripple(t):
    """t^3 under exp(-t^2): odd, one vanishing moment."""
    return t**3 * np.exp(-(t**2))


def ripple_slope(t):
    return (3 * t**2 - 2 * t**4) * np.exp(-(t**2))


def notch(t):
    """An odd polynomial, to be cut off at -1 and 1."""
    return t * (1 - t**2) ** 3


def notch_slope(t):
    return (1 - t**2) ** 2 * (1 - 7 * t**2)


RIPPLE = make_mother("ripple", ripple, ripple_slope)
NOTCH = make_mother("notch", notch, notch_slope, (-1, 1))


def energies(psi):
    """Norm, center and squared radius."""
    t = np.linspace(-30, 30, 60001)
    y = psi(t) ** 2
    return [float(np.trapezoid(t**k * y, t)) for k in range(3)]


@pytest.mark.parametrize("name", SHAPES)
def test_every_shape_made_again_is_the_mother_of_the_table(name):
    shape, known = SHAPES[name], MOTHERS[name]
    made = make_mother(f"my {name}", shape.function, shape.derivative, shape.support)
    np.testing.assert_allclose(made(T), known(T), atol=1e-13)
    np.testing.assert_allclose(made.derivative(T), known.derivative(T), atol=1e-12)
    assert (made.parity, made.vanishing_moments) == (known.parity, known.vanishing_moments)
    assert made.support == pytest.approx(known.support, rel=1e-12)
    assert made.reach == pytest.approx(known.reach, abs=0.005)
    assert made.name == f"my {name}"


@pytest.mark.parametrize(("n", "p", "q"), [(1, 3, 8), (2, 4, 8), (3, 9, 5)])
def test_lopsided_ones_are_centred(n, p, q):
    """The beta wavelet itself serves as the function, moved and scaled."""
    known = beta(n, p, q)
    made = make_mother("moved", lambda t: 7 * known(3 * (t - 2)), lambda t: 21 * known.derivative(3 * (t - 2)), (0, 5))
    np.testing.assert_allclose(made(T), known(T), atol=1e-8)
    assert (made.parity, made.vanishing_moments) == ("none", n)


@given(st.floats(0.02, 2.5), st.floats(-1e6, 1e6).filter(lambda a: abs(a) > 1e-6), st.floats(-3, 3))
def test_width_height_and_place_do_not_matter(width, height, place):
    made = make_mother(
        "moved", lambda t: height * ripple((t - place) / width), lambda t: height / width * ripple_slope((t - place) / width)
    )
    np.testing.assert_allclose(made(T), np.sign(height) * RIPPLE(T), atol=1e-9)
    np.testing.assert_allclose(made.derivative(T), np.sign(height) * RIPPLE.derivative(T), atol=1e-8)
    assert made.vanishing_moments == 1
    assert made.reach == pytest.approx(RIPPLE.reach, abs=0.02)


@pytest.mark.parametrize("psi", [RIPPLE, NOTCH], ids=lambda psi: psi.name)
def test_own_mothers_have_unit_norm_and_radius_at_zero(psi):
    np.testing.assert_allclose(energies(psi), [1, 0, 1], atol=1e-7)
    assert (psi.parity, psi.vanishing_moments) == ("odd", 1)


def test_it_is_zero_outside_its_support_whatever_the_function_is_there():
    low, high = NOTCH.support
    assert (NOTCH([low - 1e-6, high + 1e-6, 1e6]) == 0).all()
    assert (NOTCH.derivative([low - 1e-6, high + 1e-6, 1e6]) == 0).all()
    assert abs(NOTCH(high * 0.9)) > 1e-4
    root = make_mother("root", lambda t: t * (1 - t**2) ** 2.5, lambda t: (1 - t**2) ** 1.5 * (1 - 6 * t**2), (-1, 1))
    assert np.isfinite(root(T)).all()


def test_a_function_may_jump_or_bend_here_and_there():
    """Haar's wavelet: its slope is 0 almost everywhere."""
    haar = make_mother("haar", lambda t: np.sign(t), lambda t: np.zeros_like(t), (-0.5, 0.5))
    assert haar.vanishing_moments == 1
    assert haar.parity == "odd"
    np.testing.assert_allclose(energies(haar), [1, 0, 1], atol=1e-3)


@pytest.mark.parametrize(
    ("name", "moments", "parity"),
    [("mexican_hat", 2, "even"), ("polywog1", 1, "odd"), ("polywog2", 3, "odd"), ("polywog3", 4, "even"), ("polywog5", 2, "even")],
)
def test_moments_and_parity_are_found_out(name, moments, parity):
    psi = MOTHERS[name]
    made = make_mother("moved", lambda t: psi(t + 1), lambda t: psi.derivative(t + 1))
    assert made.vanishing_moments == moments
    assert made.parity == "none"  # not about 0; then it is centred
    np.testing.assert_allclose(made(T), psi(T), atol=1e-12)
    assert make_mother("same", psi.function, psi.derivative).parity == parity


def test_parity_is_none_however_little_is_amiss():
    nearly = make_mother("nearly", lambda t: ripple(t - 1e-7), lambda t: ripple_slope(t - 1e-7))
    assert nearly.parity == "none"
    np.testing.assert_allclose(nearly(T), RIPPLE(T), atol=1e-13)


def test_moments_are_counted_up_to_eight():
    smooth = beta(10, 20, 20)
    made = make_mother("tenth", smooth.function, smooth.derivative, smooth.support)
    assert made.vanishing_moments == 8


def bump(t):
    return np.exp(-(t**2))


def bump_slope(t):
    return -2 * t * np.exp(-(t**2))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("slog1", ripple, ripple_slope), "needed a new name for the mother; found 'slog1'; choose another one"),
        (("beta2(4,8)", ripple, ripple_slope), r"needed a new name for the mother; found 'beta2\(4,8\)'"),
        (("beta9(1,1)", ripple, ripple_slope), "needed a new name"),
        (("", ripple, ripple_slope), "needed a new name for the mother; found ''"),
        (("own", ripple, ripple_slope, (1, -1)), r"needed a support from its left to its right end, within 30 of 0; found \(1, -1\)"),
        (("own", ripple, ripple_slope, (1, 1)), "needed a support from its left"),
        (("own", ripple, ripple_slope, (40, 50)), r"needed a support .* found \(40, 50\); shift or scale"),
        (("own", ripple, ripple_slope, (-100, 100)), r"within 30 of 0; found \(-100, 100\)"),
        (("own", ripple, ripple_slope, (np.nan, 1)), r"needed a support .* found \(nan, 1\)"),
        (("own", lambda t: np.where(t > 2, np.nan, ripple(t)), ripple_slope), "needed finite numbers in the values of mother own"),
        (("own", ripple, lambda t: np.where(t > 2, np.nan, ripple_slope(t))), "needed finite numbers in the slopes of mother own"),
        (("own", lambda t: 1 / t, lambda t: -1 / t**2, (0, 1)), "needed finite numbers in the values of mother own; found 1 NaN or inf"),
        (("own", lambda t: 0 * t, lambda t: 0 * t), "needed a function that is not 0 as mother own; found 0 everywhere"),
        (("own", lambda t: 0.0, lambda t: 0.0), "needed a function that is not 0"),
        (("own", ripple, ripple, (-6, 6)), r"needed the derivative of mother own; found other slopes .* at \d+ of 2001 places; derive"),
        (("own", ripple, lambda t: 1.001 * ripple_slope(t)), "needed the derivative of mother own"),
        (("own", ripple, lambda t: 0 * t), "needed the derivative of mother own; found other slopes"),
        (("own", np.sin, np.cos), r"needed a function that has faded out 30 from 0 as mother own; found 0\.988 there; scale its argument"),
        (("own", lambda t: t / (1 + t**2) ** 2, lambda t: (1 - 3 * t**2) / (1 + t**2) ** 3), "needed a function that has faded out 30"),
        (("own", lambda t: np.exp(-t), lambda t: -np.exp(-t), (-np.inf, 0)), "needed a function that has faded out 30"),
        (("own", bump, bump_slope), "needed a function of zero mean as mother own; found another mean; subtract a bump of the same mean"),
        (("own", ripple, ripple_slope, (-1, 2)), "needed a function of zero mean"),
    ],
)
@pytest.mark.filterwarnings("ignore:divide by zero")
def test_what_is_no_mother_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        make_mother(*arguments)


def test_slopes_of_narrow_functions_are_looked_at_too():
    with pytest.raises(InputError, match="needed the derivative of mother own"):
        make_mother("own", lambda t: ripple(t / 0.02), ripple_slope)


def test_a_mean_is_seen_however_small_it_is():
    with pytest.raises(InputError, match="needed a function of zero mean"):
        make_mother("own", lambda t: ripple(t) + 1e-7 * bump(t), lambda t: ripple_slope(t) + 1e-7 * bump_slope(t))


def test_own_mothers_are_not_known_by_name():
    with pytest.raises(InputError, match=r"needed one of mexican_hat, .*; found 'ripple'"):
        mother("ripple")


@pytest.mark.parametrize("psi", [RIPPLE, NOTCH], ids=lambda psi: psi.name)
def test_pickles_hold_the_functions_themselves(psi):
    copy = pickle.loads(pickle.dumps(psi))
    assert isinstance(copy, Mother)
    assert (copy.name, copy.support, copy.reach, copy.parity, copy.vanishing_moments) == (
        psi.name,
        psi.support,
        psi.reach,
        psi.parity,
        psi.vanishing_moments,
    )
    np.testing.assert_array_equal(copy(T), psi(T))
    np.testing.assert_array_equal(copy.derivative(T), psi.derivative(T))


def test_coherence_takes_them():
    assert coherence(
        make_mother("hat", lambda t: MOTHERS["mexican_hat"](2 * t), lambda t: 2 * MOTHERS["mexican_hat"].derivative(2 * t)),
        MOTHERS["mexican_hat"],
    ) == pytest.approx(1, abs=1e-5)


def test_libraries_hold_them_beside_known_ones():
    both = dyadic_library([RIPPLE, MOTHERS["beta2"]], X)
    first = both.kinds == 0
    z = (X[:, None] - both.centers[first]) / both.dilations[first]
    np.testing.assert_array_equal(both.values(X)[:, first], RIPPLE(z))
    assert (np.abs(z) <= RIPPLE.reach).sum(axis=0).min() >= 3
    assert repr(both).endswith("candidates of ripple, beta2)")
    copy = pickle.loads(pickle.dumps(both))
    np.testing.assert_array_equal(copy.design(X), both.design(X))


def test_a_network_of_them_is_found_again():
    library = dyadic_library([NOTCH], X)
    of = [20, 40, 47]
    y = library.values(X)[:, of] @ [[1.0], [-2.0], [1.5]] + 0.5
    found = fit(X, y, library, FitOptions(10))
    order = np.argsort(found.network.centers)
    np.testing.assert_array_equal(found.network.centers[order], np.sort(library.centers[of]))
    assert found.network.counts() == {"notch": 3}
    np.testing.assert_allclose(found.network(X), y, atol=1e-10)


def fitted():
    y = np.sin(9 * X)[:, None]
    return fit(X, y, dyadic_library([MOTHERS["slog1"], RIPPLE], X), FitOptions(8)).network


def test_files_keep_the_name_and_are_read_with_the_mother(tmp_path):
    net, path = fitted(), tmp_path / "net.npz"
    net.save(path)
    again = WaveletNetwork.load(path, mothers=[RIPPLE])
    np.testing.assert_array_equal(again(X), net(X))
    np.testing.assert_array_equal(again.jacobian(X), net.jacobian(X))
    assert again.counts() == net.counts()
    assert again.mothers == (MOTHERS["slog1"], RIPPLE)
    with pytest.raises(FileError, match=r"needed a wavelet network in .*: one of mexican_hat, .*; found 'ripple'; write it again"):
        WaveletNetwork.load(path)
    with pytest.raises(FileError, match="found 'ripple'"):
        WaveletNetwork.load(path, mothers=[NOTCH])


def test_tables_keep_it_too(tmp_path):
    rows = np.sin(np.multiply.outer([3.0, 7.0], X))[:, :, None]
    found, path = fit_rows(X, rows, dyadic_library([RIPPLE], X), FitOptions(6)).table, tmp_path / "blocks.npz"
    found.save(path)
    np.testing.assert_array_equal(NetworkTable.load(path, [NOTCH, RIPPLE])(X), found(X))
    with pytest.raises(FileError, match=r"needed a wavelet network table in .* found 'ripple'"):
        NetworkTable.load(path)


def test_networks_of_them_survive_pickling():
    net = fitted()
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(net))(X), net(X))


def test_the_two_of_one_name_are_refused():
    other = make_mother("ripple", notch, notch_slope, (-1, 1))
    with pytest.raises(InputError, match="needed each mother once; found ripple, ripple"):
        Library((RIPPLE, other), [0], [0], [1], [0])
