"""The network's warp of the sphere: it is a flow, meets its goals the better the more wavelets it has, and folds nothing."""

import numpy as np
import pytest

from morphlet.errors import InputError
from morphlet.mapping.warp import Warp, warp_by_pairs
from morphlet.numerics.unit_sphere import exponential, fibonacci, icosphere, rotations_about
from morphlet.sphere.quality import certificate
from morphlet.wavenet.spherical import SphericalNetwork

POINTS = fibonacci(6)
BALL, FACES = icosphere(3)


def moved(points, length, seed=0):
    """Goals at random bearings."""
    rng = np.random.default_rng(seed)
    ways = np.cross(points, rng.normal(size=points.shape))
    return exponential(points, length * ways / np.linalg.norm(ways, axis=1, keepdims=True))


def gap(warp, points, goals):
    return np.linalg.norm(warp(points) - goals, axis=1)


@pytest.mark.parametrize("length", [0.1, 0.5])
def test_fifteen_wavelets_bring_spread_out_pairs_together_without_folds(length):
    goals = moved(POINTS, length)
    warp = warp_by_pairs(POINTS, goals)
    assert len(warp.network) == 15
    assert gap(warp, POINTS, goals).max() < 0.1 * length
    there = warp(BALL)
    np.testing.assert_allclose(np.linalg.norm(there, axis=1), 1, atol=1e-12)
    proof = certificate(there, FACES)
    assert (proof.inverted, round(proof.degree, 6)) == (0, 1)


def test_more_wavelets_come_nearer():
    points = fibonacci(10)
    goals = moved(points, 0.4)
    gaps = [gap(warp_by_pairs(points, goals, m), points, goals).mean() for m in (2, 10, 60)]
    assert gaps[0] > 2 * gaps[1] > 8 * gaps[2]


def test_pairs_that_are_met_already_need_no_wavelet():
    warp = warp_by_pairs(POINTS, POINTS)
    assert len(warp.network) == 0
    np.testing.assert_allclose(warp(BALL), BALL, atol=1e-12)


def test_the_flow_of_a_rotation_is_that_rotation():
    """Velocities w x x are affine on the sphere: the network needs no wavelet, and the flow turns by |w|."""
    w = np.array([0.3, -0.8, 0.5])
    affine = np.zeros((4, 3))
    affine[1:] = np.array([[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]]).T
    warp = Warp(SphericalNetwork((), [], np.zeros((0, 3)), np.zeros((0, 3)), [], np.zeros((0, 3)), affine))
    np.testing.assert_allclose(warp(BALL), BALL @ rotations_about(w[None])[0].T, atol=1e-7)


def test_heavy_pairs_are_met_more_closely():
    """Two neighbours that part ways: with few wavelets, the one that counts more is followed."""
    points = np.array([[1, 0, 0], [np.cos(0.25), np.sin(0.25), 0], [-1, 0, 0]])
    goals = exponential(points, np.array([[0, 0, 0.3], [0, 0, -0.3], [0, 0, 0]]))
    gaps = [gap(warp_by_pairs(points, goals, 3, weight), points, goals) for weight in ([100, 1, 1], [1, 100, 1])]
    assert gaps[0][0] < gaps[1][0]
    assert gaps[0][1] > gaps[1][1]


@pytest.mark.parametrize(
    ("points", "goals", "weight", "message"),
    [
        (POINTS, POINTS[:3], None, "needed one goal per point, and positive weights; found 6 points, 3 goals"),
        (np.zeros((0, 3)), np.zeros((0, 3)), None, "found 0 points"),
        (POINTS, POINTS, np.zeros(6), "6 weights that are not"),
        (POINTS, -POINTS, None, "needed goals that are not opposite their points; found 6 that are"),
        (POINTS * np.nan, POINTS, None, "needed finite numbers in points"),
    ],
)
def test_unfit_pairs_are_refused(points, goals, weight, message):
    with pytest.raises(InputError, match=message):
        warp_by_pairs(points, goals, weight=weight)


def test_a_network_of_other_outputs_is_refused():
    with pytest.raises(InputError, match="needed a network with 3 outputs; found 1"):
        Warp(SphericalNetwork((), [], np.zeros((0, 3)), np.zeros((0, 3)), [], np.zeros((0, 1)), np.zeros((4, 1))))
