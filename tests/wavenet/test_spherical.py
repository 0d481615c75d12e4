"""Wavelets on the sphere: their shapes, their candidates, the fits, the files; signals that are hardly any."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import _store
from morphlet.errors import FileError, InputError
from morphlet.numerics.unit_sphere import fibonacci, icosphere
from morphlet.wavenet import spherical_fit
from morphlet.wavenet.mothers import MOTHERS, make_mother, mother
from morphlet.wavenet.spherical import WIDTH, SphericalLibrary, SphericalNetwork, spherical_library, tangents
from morphlet.wavenet.spherical_fit import fit_sphere
from support import random_rotation

PARITIES = [name for name, psi in MOTHERS.items() if psi.parity != "none"]
TWO = (MOTHERS["beta2"], MOTHERS["beta1"])
N = 400
POINTS, AREAS = fibonacci(N), np.ones(N)
LIBRARY = spherical_library(TWO, POINTS, AREAS, levels=2)
EXACT = 1e-12
TABLE = 1e-8
"""What the cubic pieces of a profile are off, generously."""
seeds = st.integers(0, 10**6)
few = settings(max_examples=6)
each_mother = pytest.mark.parametrize("name", PARITIES)


def atom(name, center, direction=None, dilation=0.2):
    """A library of one wavelet."""
    psi = mother(name)
    center = np.asarray(center, float)[None]
    direction = np.zeros((1, 3)) if psi.parity == "even" else tangents(center) if direction is None else np.asarray(direction)[None]
    return SphericalLibrary((psi,), [0], center, direction, [dilation], [0])


def at(library, points):
    return library.values(points).toarray()


def quadrature(rings=160):
    """Points and weights that integrate smooth functions over the sphere."""
    z, w = np.polynomial.legendre.leggauss(rings)
    phi = 2 * np.pi * np.arange(2 * rings) / (2 * rings)
    ring = np.sqrt(1 - z**2)[:, None]
    points = np.stack([ring * np.cos(phi), ring * np.sin(phi), np.broadcast_to(z[:, None], (rings, len(phi)))], axis=2)
    return points.reshape(-1, 3), np.repeat(w, len(phi)) * 2 * np.pi / len(phi)


def network(seed, p=12, k=3):
    rng = np.random.default_rng(seed)
    psis = tuple(MOTHERS[name] for name in PARITIES)
    kinds = rng.integers(len(psis), size=p)
    centers = rng.normal(size=(p, 3))
    centers /= np.linalg.norm(centers, axis=1, keepdims=True)
    odd = np.array([psi.parity == "odd" for psi in psis])[kinds]
    dilations = rng.uniform(0.1, 0.6, p)
    return SphericalNetwork(
        psis, kinds, centers, tangents(centers) * odd[:, None], dilations, rng.normal(size=(p, k)), rng.normal(size=(4, k))
    )


def signal(seed, k=1, points=POINTS):
    """A few bumps and ramps."""
    rng = np.random.default_rng(seed)
    places = rng.normal(size=(12, 3))
    places /= np.linalg.norm(places, axis=1, keepdims=True)
    bumps = np.exp(-((points[:, None] - places) ** 2).sum(axis=2) / (2 * rng.uniform(0.1, 0.6, 12) ** 2))
    return bumps @ rng.normal(size=(12, k)) + points @ rng.normal(size=(3, k))


def columns(net, points=POINTS):
    """1, x, y, z and the wavelets of a network."""
    library = SphericalLibrary(net.mothers, net.kinds, net.centers, net.directions, net.dilations, np.zeros(len(net)))
    return np.column_stack([np.ones(len(points)), points, at(library, points)])


def least_squares(design, y, areas):
    """Sum of squares, weighted, that the columns leave of y."""
    root = np.sqrt(areas / areas.sum())[:, None]
    Q, _ = np.linalg.qr(design * root)
    rest = y * root - Q @ (Q.T @ (y * root))
    return float((rest**2).sum())


# shapes


def test_the_isotropic_mexican_hat_is_the_laplacian_of_a_gaussian():
    psi, points = MOTHERS["mexican_hat"], fibonacci(2000)
    s = np.linalg.norm(points - [0, 0, 1], axis=1) / 0.3
    t = np.sqrt(7 / 6) * s  # rms radius of (1 - t^2) exp(-t^2 / 2) is sqrt(7 / 6)
    expected = psi(np.zeros(1)) * (2 - t**2) * np.exp(-(t**2) / 2)
    np.testing.assert_allclose(at(atom("mexican_hat", [0, 0, 1], dilation=0.3), points)[:, 0], expected, atol=3e-6)


def test_the_directional_polywog1_is_the_slope_of_a_gaussian():
    points, d = fibonacci(2000), 0.3
    s = np.linalg.norm(points - [0, 0, 1], axis=1) / d
    psi = MOTHERS["polywog1"]
    slope = float(psi.derivative(np.zeros(1))[0])
    t = np.sqrt(3 / 2) * s  # rms radius of t exp(-t^2 / 2) is sqrt(3 / 2)
    expected = slope * np.exp(-(t**2) / 2) * points[:, 0] / d
    np.testing.assert_allclose(at(atom("polywog1", [0, 0, 1], [1, 0, 0], d), points)[:, 0], expected, atol=2e-5)


@each_mother
def test_wavelets_have_zero_mean_on_the_sphere(name):
    points, weights = quadrature()
    values = at(atom(name, [0.36, -0.48, 0.8], dilation=0.2), points)[:, 0]
    assert abs(weights @ values) < 1e-5 * (weights @ np.abs(values))


def test_odd_ones_have_zero_mean_however_wide():
    points, weights = quadrature()
    values = at(atom("beta1", [0.36, -0.48, 0.8], dilation=1.4), points)[:, 0]
    assert abs(weights @ values) < 1e-12


@each_mother
def test_values_are_those_of_the_mother_along_the_great_circle(name):
    """An odd wavelet is its mother where x . e is the chord, to second order; an even one with its average."""
    angle, d, psi = np.linspace(-0.02, 0.02, 9), 0.01, MOTHERS[name]
    points = np.stack([np.sin(angle), 0 * angle, np.cos(angle)], axis=1)
    s = np.sign(angle) * 2 * np.sin(np.abs(angle) / 2) / d
    fine = np.linspace(0, np.abs(s), 4001)
    average = psi(fine).mean(axis=0) if psi.parity == "even" else 0
    expected = psi(s) + average if psi.parity == "even" else psi(s) * np.cos(angle / 2)
    got = at(atom(name, [0, 0, 1], None if psi.parity == "even" else [1, 0, 0], d), points)[:, 0]
    np.testing.assert_allclose(got, expected, atol=2e-4 if psi.parity == "even" else 2e-6)


def test_even_wavelets_are_the_same_all_round_their_center():
    center = np.array([0.36, -0.48, 0.8])
    e = tangents(center[None])[0]
    turn = np.linspace(0, 2 * np.pi, 50)
    ring = np.cos(0.2) * center + np.sin(0.2) * (np.multiply.outer(np.cos(turn), e) + np.multiply.outer(np.sin(turn), np.cross(center, e)))
    values = at(atom("beta2", center), ring)
    np.testing.assert_allclose(values, values[:1].repeat(50, axis=0), atol=TABLE)
    assert abs(values[0, 0]) > 0.01


def test_any_direction_is_a_sum_of_two():
    center, e, f = [0, 0, 1.0], np.array([1.0, 0, 0]), np.array([0, 1.0, 0])
    turned = at(atom("beta3", center, 0.6 * e + 0.8 * f), POINTS)
    np.testing.assert_allclose(turned, 0.6 * at(atom("beta3", center, e), POINTS) + 0.8 * at(atom("beta3", center, f), POINTS), atol=EXACT)


@given(seeds)
@few
def test_networks_turn_with_their_wavelets(seed):
    net, R = network(seed), random_rotation(seed)
    affine = np.vstack([net.affine[:1], R @ net.affine[1:]])
    turned = SphericalNetwork(net.mothers, net.kinds, net.centers @ R.T, net.directions @ R.T, net.dilations, net.weights, affine)
    np.testing.assert_allclose(turned(POINTS @ R.T), net(POINTS), atol=1e-5)  # 1e-6 of a maximum where a wavelet ends


@given(seeds)
@few
def test_jacobians_are_the_slopes_of_the_values(seed):
    points, h, rng = np.vstack([fibonacci(60), network(seed).centers]), 1e-5, np.random.default_rng(seed)
    compact = [kind for kind, name in enumerate(PARITIES) if name.startswith("beta")]
    net = network(seed, 40)
    keep = np.isin(net.kinds, compact)
    net = SphericalNetwork(
        net.mothers, *(a[keep] for a in (net.kinds, net.centers, net.directions, net.dilations, net.weights)), net.affine
    )
    along = rng.normal(size=points.shape)
    along -= (along * points).sum(axis=1, keepdims=True) * points
    central = (net(points + h * along) - net(points - h * along)) / (2 * h)
    slopes = net.jacobian(points)
    np.testing.assert_allclose(np.einsum("nkc,nc->nk", slopes, along), central, atol=2e-4 * np.abs(central).max())
    np.testing.assert_allclose(np.einsum("nkc,nc->nk", slopes, points), 0, atol=1e-10 * np.abs(slopes).max())


def test_compact_wavelets_are_sparse():
    values = LIBRARY.values(POINTS)
    assert values.nnz < 0.5 * N * len(LIBRARY)
    far = np.linalg.norm(POINTS[:, None] - LIBRARY.centers, axis=2) > LIBRARY.dilations * MOTHERS["beta2"].support[1]
    assert not values.toarray()[far].any()


# libraries


def test_libraries_have_the_centers_of_icospheres():
    dense = fibonacci(20000)
    library = spherical_library(TWO, dense, np.ones(len(dense)), levels=2, voices=2)
    np.testing.assert_array_equal(np.bincount(library.bands), 2 * np.array([12, 12, 42, 42, 162, 162]))
    np.testing.assert_allclose(library.centers[(library.bands == 5) & (library.kinds == 1)], icosphere(2)[0])
    widest = WIDTH * np.sqrt(4 * np.pi / 12 * 2 / np.sqrt(3))
    assert library.dilations[0] == pytest.approx(widest)
    np.testing.assert_allclose(np.unique(library.dilations[library.bands < 2]), [widest / np.sqrt(2), widest])


def test_candidates_with_few_samples_are_left_out():
    library = spherical_library(TWO, POINTS, AREAS, levels=5, voices=1)
    chord = np.linalg.norm(POINTS[:, None] - library.centers, axis=2)
    for kind, psi in enumerate(TWO):
        of = library.kinds == kind
        assert ((chord[:, of] <= library.dilations[of] * psi.support[1]).sum(axis=0) >= 6).all()
    assert (library.bands == 3).sum() == 2 * 642
    assert 0 < (library.bands == 4).sum() < 2 * 2562
    assert not (library.bands == 5).any()


def test_samples_count_by_their_area():
    """On one half of the sphere only every tenth sample has any."""
    areas = np.where((POINTS[:, 2] > 0) | (np.arange(N) % 10 == 0), 1.0, 0.0)
    library = spherical_library(TWO, POINTS, areas, levels=3, voices=1)
    fine = library.centers[library.bands == 3]
    assert (fine[:, 2] > -0.3).all()
    assert len(fine) > 600
    heavy = np.where(np.arange(N) % 10 == 0, 1e6, areas)
    assert len(spherical_library(TWO, POINTS, heavy, 3, 1)) < 0.6 * len(spherical_library(TWO, POINTS, AREAS, 3, 1))


def test_without_mothers_there_are_no_candidates():
    assert len(spherical_library((), POINTS, AREAS, 1)) == 0


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((TWO, POINTS, AREAS, -1), "levels >= 0 and voices >= 1; found levels -1"),
        ((TWO, POINTS, AREAS, 2, 0), "voices 0"),
        ((TWO, POINTS, 0 * AREAS), "stands for some area; found 400 samples without"),
        ((TWO, POINTS, -AREAS), "areas >= 0; found 400 negative ones"),
        ((TWO, POINTS, AREAS[1:]), "areas of shape"),
        ((TWO, POINTS * np.nan, AREAS), "finite numbers in points"),
        ((TWO, 0 * POINTS, AREAS), "non-zero directions"),
        ((("beta2",), POINTS, AREAS), "mothers"),
        (((mother("beta2(4,8)"),), POINTS, AREAS), r"beta2\(4,8\) without parity"),
    ],
)
def test_libraries_refuse(arguments, message):
    with pytest.raises(InputError, match=message):
        spherical_library(*arguments)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kinds": [2]}, "kinds"),
        ({"centers": [[0, 0, 2.0]]}, "centers of length 1"),
        ({"directions": [[0, 0, 0]]}, "directions of length 1 for odd mothers"),
        ({"kinds": [0]}, "0 for even ones"),
        ({"directions": [[0, 0, 1.0]]}, "tangent"),
        ({"dilations": [0.0]}, "dilations > 0"),
        ({"dilations": [np.inf]}, "finite"),
        ({"weights": [[1.0, 2.0]]}, "weights"),
        ({"affine": np.zeros((2, 1))}, "affine"),
        ({"mothers": (MOTHERS["beta2"], MOTHERS["beta2"])}, "each mother once"),
    ],
)
def test_networks_refuse(change, message):
    good = {"mothers": TWO, "kinds": [1], "centers": [[0, 0, 1.0]], "directions": [[1.0, 0, 0]], "dilations": [0.1]}
    good |= {"weights": [[1.0]], "affine": np.zeros((4, 1))}
    SphericalNetwork(**good)
    with pytest.raises(InputError, match=message):
        SphericalNetwork(**good | change)


# fits


@given(seed=seeds, k=st.sampled_from([1, 3]))
@few
def test_each_pick_lowers_the_error_to_that_of_least_squares(seed, k):
    y, areas = signal(seed, k), np.random.default_rng(seed).uniform(0.1, 2, N)
    found = fit_sphere(POINTS, y, areas, LIBRARY, 20)
    design = columns(found.network)
    direct = [least_squares(design[:, : 4 + m], y, areas) for m in range(21)]
    np.testing.assert_allclose(found.sse, direct, atol=EXACT * direct[0])
    assert (np.diff(found.sse) < 0).all()
    assert found.reason == "count"
    rest = found.network(POINTS) - y
    np.testing.assert_allclose((rest**2).sum(axis=1) @ areas / areas.sum(), found.sse[-1], rtol=1e-9)


@given(seeds)
@few
def test_stages_change_the_picks_but_not_what_they_gain(seed):
    """With hardly any shortlist: the errors stay those of least squares, and are not much larger."""
    y = signal(seed, 3)
    whole = fit_sphere(POINTS, y, AREAS, LIBRARY, 40)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(spherical_fit, "SHORTLIST", 60)
        patch.setattr(spherical_fit, "PER_PICK", 2)
        patch.setattr(spherical_fit, "FIRST_STAGE", 4)
        staged = fit_sphere(POINTS, y, AREAS, LIBRARY, 40)
    design = columns(staged.network)
    direct = [least_squares(design[:, : 4 + m], y, AREAS) for m in range(41)]
    np.testing.assert_allclose(staged.sse, direct, atol=EXACT * direct[0])
    assert staged.sse[-1] < 3 * whole.sse[-1]


@given(seeds)
@few
def test_the_first_pick_is_the_best_in_any_direction(seed):
    y, library = signal(seed, 2), spherical_library(TWO, POINTS, AREAS, 1, 1)
    found = fit_sphere(POINTS, y, AREAS, library, 2)
    across, columns_of = np.cross(library.centers, library.directions), columns(found.network)
    turns = np.linspace(0, np.pi, 24, endpoint=False)
    along = [np.cos(t) * library.directions + np.sin(t) * across for t in turns]
    every = [SphericalLibrary(TWO, library.kinds, library.centers, e, library.dilations, library.bands) for e in along]
    candidates = np.hstack([at(turned, POINTS) for turned in every])
    for m in range(2):
        Q, _ = np.linalg.qr(columns_of[:, : 4 + m])
        rest, beside = (a - Q @ (Q.T @ a) for a in (y, candidates))
        gain = (((beside.T @ rest) ** 2).sum(axis=1) / (beside**2).sum(axis=0)).max() / N
        assert gain * (1 - 1e-9) <= found.sse[m] - found.sse[m + 1] <= gain + 0.01 * found.sse[m]  # 7.5 degrees apart


def test_a_network_of_the_library_is_found_again():
    apart = np.array([0, 7, 50, 90])
    first = spherical_library(TWO, POINTS, AREAS, 2, 1)
    fine = np.flatnonzero(first.bands == 2)[apart * 2]
    weights = np.array([[1.0, 2], [-2, 1], [1.5, -1], [1, 1]])
    y = at(first, POINTS)[:, fine] @ weights + 3 - 5 * POINTS[:, :1]
    found = fit_sphere(POINTS, y, AREAS, first, 30)
    assert found.reason == "exhausted"
    assert len(found.network) <= 8
    np.testing.assert_allclose(found.network(POINTS), y, atol=1e-9)
    best = np.argsort(np.linalg.norm(found.network.weights, axis=1))[-4:]
    distance = np.linalg.norm(found.network.centers[best][:, None] - first.centers[fine], axis=2)
    np.testing.assert_allclose(distance.min(axis=0), 0, atol=EXACT)


def test_a_turned_wavelet_is_found_with_one_pick():
    library = spherical_library(TWO[1:], POINTS, AREAS, 1, 1)
    i = 30
    e, f = library.directions[i], np.cross(library.centers[i], library.directions[i])
    y = at(atom("beta1", library.centers[i], np.cos(1) * e + np.sin(1) * f, library.dilations[i]), POINTS)
    found = fit_sphere(POINTS, y, AREAS, library, 10)
    assert (len(found.network), found.reason) == (1, "exhausted")
    np.testing.assert_allclose(abs(found.network.directions[0] @ (np.cos(1) * e + np.sin(1) * f)), 1, atol=1e-9)


@pytest.mark.parametrize(("tolerance", "reason"), [(0.0, "exhausted"), (1e-20, "tolerance")])
@pytest.mark.parametrize("slope", [0.0, 2.0])
def test_affine_fields_need_no_wavelets(tolerance, reason, slope):
    y = 7 + slope * POINTS @ [[1.0, 0], [2, 1], [0, 3]]
    found = fit_sphere(POINTS, y, AREAS, LIBRARY, 5, tolerance=tolerance)
    assert (len(found.network), found.reason) == (0, reason)
    np.testing.assert_allclose(found.network(POINTS), y, atol=1e-12)


def test_zero_is_met_by_nothing():
    found = fit_sphere(POINTS, np.zeros((N, 2)), AREAS, LIBRARY, 5)
    assert (len(found.network), found.reason, found.sse.tolist()) == (0, "exhausted", [0.0])


def test_the_tolerance_stops_it():
    y = signal(3, 2)
    whole = fit_sphere(POINTS, y, AREAS, LIBRARY, 30)
    found = fit_sphere(POINTS, y, AREAS, LIBRARY, 30, tolerance=whole.sse[12] * 1.0001)
    assert (len(found.network), found.reason) == (12, "tolerance")
    np.testing.assert_allclose(found.sse, whole.sse[:13], rtol=1e-9)


def test_more_wavelets_than_samples():
    points = fibonacci(60)
    y = np.random.default_rng(0).normal(size=(60, 3))
    library = spherical_library(TWO, points, np.ones(60), 2, 3)
    found = fit_sphere(points, y, np.ones(60), library, 500)
    assert found.reason == "exhausted"
    assert len(found.network) <= 56
    np.testing.assert_allclose(found.network(points), y, atol=0.2)


@pytest.mark.parametrize("count", [1, 2, 3])
def test_hardly_any_points(count):
    points = np.eye(3)[:count]
    found = fit_sphere(points, [[float(i)] for i in range(count)], np.ones(count), spherical_library(TWO, points, np.ones(count), 1), 5)
    assert (len(found.network), found.reason) == (0, "exhausted")
    np.testing.assert_allclose(found.network(points)[:, 0], np.arange(count), atol=EXACT)


def test_points_that_coincide():
    points, y = np.repeat(POINTS[:30], 2, axis=0), np.repeat(signal(1)[:30], 2, axis=0)
    one = fit_sphere(POINTS[:30], y[::2], np.ones(30), LIBRARY, 4)
    two = fit_sphere(points, y, np.ones(60), LIBRARY, 4)
    np.testing.assert_allclose(one.sse, two.sse, rtol=1e-9)


def test_samples_without_area_do_not_count():
    y, areas = signal(5), np.array(AREAS)
    areas[::7] = 0
    wild = np.where((areas == 0)[:, None], 1e6, y)
    kept = areas > 0
    found, alone = (fit_sphere(*a, LIBRARY, 15) for a in ((POINTS, wild, areas), (POINTS[kept], y[kept], areas[kept])))
    np.testing.assert_allclose(found.sse, alone.sse, rtol=1e-9)
    np.testing.assert_allclose(found.network(POINTS), alone.network(POINTS), atol=1e-9)


@given(seeds, st.floats(1e-6, 1e6))
@few
def test_units_do_not_matter(seed, factor):
    y = signal(seed, 2)
    found, scaled = fit_sphere(POINTS, y, AREAS, LIBRARY, 10), fit_sphere(POINTS, factor * y, AREAS / factor, LIBRARY, 10)
    np.testing.assert_array_equal(found.network.centers, scaled.network.centers)
    np.testing.assert_allclose(factor * found.network(POINTS), scaled.network(POINTS), atol=1e-8 * factor)


@given(seeds)
@few
def test_fits_turn_with_the_sphere(seed):
    y, R = signal(seed, 2), random_rotation(seed)
    turned = SphericalLibrary(TWO, LIBRARY.kinds, LIBRARY.centers @ R.T, LIBRARY.directions @ R.T, LIBRARY.dilations, LIBRARY.bands)
    found, other = fit_sphere(POINTS, y, AREAS, LIBRARY, 10), fit_sphere(POINTS @ R.T, y, AREAS, turned, 10)
    np.testing.assert_allclose(found.sse, other.sse, rtol=1e-6)
    np.testing.assert_allclose(found.network.centers @ R.T, other.network.centers, atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.full((N, 1), np.nan)}, "finite numbers in values; found 400"),
        ({"values": np.ones((N, 1)) * 1e200}, "values up to 1e.150"),
        ({"values": np.ones((N - 1, 1))}, "values of shape"),
        ({"areas": np.zeros(N)}, "some area"),
        ({"areas": -AREAS}, "negative"),
        ({"n_wavelets": -1}, "n_wavelets -1"),
        ({"tolerance": np.nan}, "tolerance nan"),
        ({"points": POINTS * np.nan}, "finite numbers in points"),
        ({"points": np.zeros((0, 3)), "values": np.zeros((0, 1)), "areas": []}, "some area; found 0 samples"),
    ],
)
def test_fits_refuse(change, message):
    good = {"points": POINTS, "values": signal(1), "areas": AREAS, "library": LIBRARY, "n_wavelets": 3}
    with pytest.raises(InputError, match=message):
        fit_sphere(**good | change)


def test_the_same_input_gives_the_same_bits():
    first, second = (fit_sphere(POINTS, signal(2, 3), AREAS, LIBRARY, 25) for _ in range(2))
    np.testing.assert_array_equal(first.network.weights, second.network.weights)
    np.testing.assert_array_equal(first.sse, second.sse)


# files


@pytest.mark.parametrize("p", [0, 12])
def test_files_and_pickles_give_the_same_network(tmp_path, p):
    net = network(3, p)
    net.save(tmp_path / "net.npz")
    for copy in (SphericalNetwork.load(tmp_path / "net.npz"), pickle.loads(pickle.dumps(net))):
        np.testing.assert_array_equal(copy(POINTS), net(POINTS))
        assert copy.counts() == net.counts()
    library = pickle.loads(pickle.dumps(LIBRARY))
    np.testing.assert_array_equal(at(library, POINTS), at(LIBRARY, POINTS))
    fit = fit_sphere(POINTS, signal(1), AREAS, LIBRARY, 3)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(fit)).sse, fit.sse)


def test_own_mothers_work_and_have_to_be_passed_again(tmp_path):
    own = make_mother("ripple", lambda t: t**3 * np.exp(-(t**2)), lambda t: (3 * t**2 - 2 * t**4) * np.exp(-(t**2)))
    library = spherical_library([own], POINTS, AREAS, 1)
    found = fit_sphere(POINTS, signal(4), AREAS, library, 8)
    assert found.network.counts() == {"ripple": 8}
    found.network.save(tmp_path / "own.npz")
    np.testing.assert_array_equal(SphericalNetwork.load(tmp_path / "own.npz", [own])(POINTS), found.network(POINTS))
    with pytest.raises(FileError, match="ripple"):
        SphericalNetwork.load(tmp_path / "own.npz")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("centers", np.zeros((12, 3))),
        ("weights", np.zeros((3, 3))),
        ("kinds", np.full(12, 99)),
        ("dilations", -np.ones(12)),
        ("mothers", np.array(["nobody"])),
    ],
)
def test_damaged_networks_are_refused(tmp_path, name, value):
    net = network(3)
    net.save(tmp_path / "net.npz")
    with np.load(tmp_path / "net.npz") as file:
        arrays = {key: file[key] for key in file.files if key not in ("kind", "version")}
    _store.save(tmp_path / "net.npz", "spherical wavelet network", 1, arrays | {name: value})
    with pytest.raises(FileError, match="spherical wavelet network in"):
        SphericalNetwork.load(tmp_path / "net.npz")


def test_no_network_in_a_file(tmp_path):
    (tmp_path / "text.npz").write_text("no archive")
    with pytest.raises(FileError, match="spherical wavelet network file at"):
        SphericalNetwork.load(tmp_path / "text.npz")


def test_representations():
    assert repr(network(0)) == "SphericalNetwork(12 wavelets, 3 outputs)"
    assert repr(LIBRARY).endswith("candidates of beta2, beta1)")
