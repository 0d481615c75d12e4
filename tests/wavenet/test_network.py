"""Wavelet networks: values, slopes, counts, files."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import _store
from morphlet.errors import FileError, InputError
from morphlet.wavenet.mothers import MOTHERS, beta
from morphlet.wavenet.network import WaveletNetwork

SLOG1 = MOTHERS["slog1"]
ALL = (*MOTHERS.values(), beta(2, 4, 8))


def network(seed, p=9, k=3):
    rng = np.random.default_rng(seed)
    kinds = rng.integers(0, len(ALL), p)
    return WaveletNetwork(ALL, kinds, rng.uniform(0, 1, p), rng.uniform(0.05, 0.5, p), rng.normal(size=(p, k)), rng.normal(size=(2, k)))


def test_the_value_is_the_sum_of_the_paper():
    net = WaveletNetwork((beta(2, 4, 8), SLOG1), [1, 0], [0.2, 0.7], [0.1, 0.3], [[2.0], [-1.0]], [[5.0], [3.0]])
    x = np.linspace(-1, 2, 40)
    by_hand = 5 + 3 * x + 2 * SLOG1((x - 0.2) / 0.1) - beta(2, 4, 8)((x - 0.7) / 0.3)
    np.testing.assert_allclose(net(x)[:, 0], by_hand, atol=1e-12)


@given(st.integers(0, 10**6))
def test_slopes_are_those_of_the_values(seed):
    net, x, h = network(seed), np.linspace(-0.2, 1.2, 50), 1e-5
    central = (net(x + h) - net(x - h)) / (2 * h)
    np.testing.assert_allclose(net.jacobian(x), central, atol=1e-5 * np.abs(central).max())


@given(st.integers(0, 10**6), st.floats(-3, 3))
def test_networks_are_linear_in_their_weights(seed, factor):
    net, x = network(seed), np.linspace(0, 1, 20)
    scaled = WaveletNetwork(net.mothers, net.kinds, net.centers, net.dilations, factor * net.weights, factor * net.affine)
    np.testing.assert_allclose(scaled(x), factor * net(x), atol=1e-10)


def test_without_wavelets_it_is_affine():
    net = WaveletNetwork((), [], [], [], np.zeros((0, 2)), [[1, 2], [3, 4]])
    np.testing.assert_array_equal(net([0.0, 2.0]), [[1, 2], [7, 10]])
    np.testing.assert_array_equal(net.jacobian([0.0, 2.0]), [[3, 4], [3, 4]])
    assert (len(net), net.counts(), repr(net)) == (0, {}, "WaveletNetwork(0 wavelets, 2 outputs)")


def test_no_places_have_no_values():
    assert network(0)([]).shape == (0, 3)


def test_counts_list_every_mother_in_order_unused_ones_too():
    mothers = tuple(MOTHERS[name] for name in ("slog1", "beta3", "beta1"))
    net = WaveletNetwork(mothers, [2, 0, 2], [0, 0, 0], [1, 1, 1], np.ones((3, 1)), np.zeros((2, 1)))
    assert list(net.counts().items()) == [("slog1", 1), ("beta3", 0), ("beta1", 2)]


@pytest.mark.parametrize("p", [0, 9])
def test_files_and_pickles_give_the_same_network(tmp_path, p):
    net, x = network(3, p), np.linspace(0, 1, 11)
    net.save(tmp_path / "net.npz")
    for copy in (WaveletNetwork.load(tmp_path / "net.npz"), pickle.loads(pickle.dumps(net))):
        assert [psi.name for psi in copy.mothers] == [psi.name for psi in net.mothers]
        assert copy.counts() == net.counts()
        np.testing.assert_array_equal(copy(x), net(x))


def test_arrays_are_copied_and_read_only():
    weights = np.ones((1, 1))
    net = WaveletNetwork((SLOG1,), [0], [0], [1], weights, np.zeros((2, 1)))
    weights[:] = 7
    assert net.weights[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        net.weights[0] = 2


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((SLOG1,), [0], [0], [1], [[1, 2]], [[0], [0]]), r"needed weights of shape \(1, 1\); found shape \(1, 2\)"),
        (((SLOG1,), [0], [0], [1], [[1]], [[0]]), r"needed affine of shape \(2, any\)"),
        (((SLOG1,), [0], [np.nan], [1], [[1]], [[0], [0]]), "needed finite numbers in centers"),
        (((SLOG1,), [0], [0], [-1], [[1]], [[0], [0]]), "needed dilations > 0"),
        (((SLOG1,), [1], [0], [1], [[1]], [[0], [0]]), "needed indices from 0 to 0 in kinds; found 1 outside"),
        (((SLOG1,), [0, 0], [0], [1], [[1]], [[0], [0]]), r"needed dilations of shape \(2\)"),
        ((("slog1",), [0], [0], [1], [[1]], [[0], [0]]), "needed mothers; found str; take them from MOTHERS"),
        (((SLOG1, SLOG1), [0], [0], [1], [[1]], [[0], [0]]), "needed each mother once; found slog1, slog1"),
    ],
)
def test_unfit_parts_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        WaveletNetwork(*arguments)


@pytest.mark.parametrize("call", ["__call__", "jacobian"])
def test_places_that_are_no_numbers_are_refused(call):
    with pytest.raises(InputError, match="needed finite numbers in x; found 1 NaN"):
        getattr(network(0), call)([0.0, np.nan])


def test_files_that_hold_no_network_are_refused(tmp_path):
    path = tmp_path / "other.npz"
    _store.save(path, "image", 1, {"positions": np.zeros(3)})
    with pytest.raises(FileError, match="needed a file of kind 'wavelet network'"):
        WaveletNetwork.load(path)
    arrays = {"mothers": np.array(["slog1"]), "kinds": np.zeros(1, int), "centers": np.zeros(1), "dilations": np.zeros(1)}
    _store.save(path, "wavelet network", 1, arrays | {"weights": np.ones((1, 1)), "affine": np.ones((2, 1))})
    with pytest.raises(FileError, match=r"needed a wavelet network in .*: dilations > 0; found 1 that are not"):
        WaveletNetwork.load(path)
    _store.save(
        path, "wavelet network", 1, arrays | {"mothers": np.array(["sine"])} | {"weights": np.ones((1, 1)), "affine": np.ones((2, 1))}
    )
    with pytest.raises(FileError, match=r"needed a wavelet network in .*: one of mexican_hat, .*; found 'sine'"):
        WaveletNetwork.load(path)
    _store.save(path, "wavelet network", 1, arrays)
    with pytest.raises(FileError, match="2 missing: weights, affine"):
        WaveletNetwork.load(path)
    path.write_bytes(b"PK\x03\x04 half a file")
    with pytest.raises(FileError, match="needed a morphlet wavelet network file"):
        WaveletNetwork.load(path)


def test_files_are_read_with_mothers_only(tmp_path):
    network(0).save(tmp_path / "net.npz")
    with pytest.raises(InputError, match="needed mothers; found str"):
        WaveletNetwork.load(tmp_path / "net.npz", ["slog1"])
