"""Blends and tours: shapes themselves to the last bit, laws of mixtures, straight growth, stops met in time, bad weights refused."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Blend, MeshSequence, Morph, Tour, measure
from morphlet.errors import InputError
from support import blob, icosphere, random_rotation

BODY = blob(2)
seeds = st.integers(0, 10**6)
times = st.floats(0, 1)


def posed(seed: int, size: float = 0.2) -> np.ndarray:
    """Smoothly moved positions."""
    a, b = np.random.default_rng(seed).normal(size=(2, 3, 3))
    return BODY.vertices + size * np.sin(BODY.vertices @ a) @ b


SHAPES = np.stack([BODY.vertices, posed(1), posed(2), posed(3)])
BLEND = Blend(BODY, SHAPES)
STOPS = MeshSequence(BODY.topology, SHAPES, [0.0, 1.0, 1.5, 4.0])


def test_a_shape_with_all_the_weight_is_met_to_the_last_bit():
    for k in range(4):
        assert BLEND(np.eye(4)[k]).vertices.tobytes() == SHAPES[k].tobytes()


def test_near_a_shape_nothing_jumps():
    for k in range(4):
        weights = np.full(4, 1e-12) + (1 - 4e-12) * np.eye(4)[k]
        np.testing.assert_allclose(BLEND(weights).vertices, SHAPES[k], atol=1e-10)


@settings(max_examples=15)
@given(times, seeds)
def test_two_shapes_are_a_gradient_path(t, seed):
    pair = Blend(BODY, np.stack([BODY.vertices, posed(seed)]))
    np.testing.assert_allclose(pair([1 - t, t]).vertices, Morph(BODY, posed(seed), "gradient")(t).vertices, atol=1e-10)


@settings(max_examples=15)
@given(seeds)
def test_the_order_of_shapes_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    weights, order = rng.dirichlet(np.ones(4)), rng.permutation(4)
    np.testing.assert_allclose(Blend(BODY, SHAPES[order])(weights[order]).vertices, BLEND(weights).vertices, atol=1e-10)


@settings(max_examples=15)
@given(seeds)
def test_a_shape_given_twice_shares_its_weight(seed):
    a, b, c = np.random.default_rng(seed).dirichlet(np.ones(3))
    twice = Blend(BODY, SHAPES[[1, 2, 2]])([a, b, c])
    np.testing.assert_allclose(twice.vertices, Blend(BODY, SHAPES[[1, 2]])([a, b + c]).vertices, atol=1e-10)


@settings(max_examples=15)
@given(seeds)
def test_turned_shapes_have_turned_blends(seed):
    rotation, weights = random_rotation(seed), np.random.default_rng(seed).dirichlet(np.ones(4))
    turned = Blend(BODY.with_vertices(BODY.vertices @ rotation.T), SHAPES @ rotation.T)
    np.testing.assert_allclose(turned(weights).vertices, BLEND(weights).vertices @ rotation.T, atol=1e-9)


@settings(max_examples=15)
@given(seeds)
def test_sizes_are_mixed_in_proportion(seed):
    weights = np.random.default_rng(seed).dirichlet(np.ones(3))
    sizes = np.array([1.0, 2.0, 5.0])
    found = Blend(BODY, sizes[:, None, None] * BODY.vertices)(weights)
    np.testing.assert_allclose(found.vertices, (weights @ sizes) * BODY.vertices, atol=1e-10)


def test_equal_shapes_stand_still():
    np.testing.assert_allclose(Blend(BODY, SHAPES[[1, 1, 1]])([0.2, 0.3, 0.5]).vertices, SHAPES[1], atol=1e-10)


def test_turns_about_one_axis_are_mixed_by_their_angles():
    angles = np.radians([0, 60, 150])
    turns = np.stack([[[np.cos(a), -np.sin(a), 0], [np.sin(a), np.cos(a), 0], [0, 0, 1]] for a in angles])
    ball = icosphere(2).with_vertices(icosphere(2).vertices * [1, 2, 3])
    found = Blend(ball, np.einsum("kde,ne->knd", turns, ball.vertices))([0.2, 0.5, 0.3])
    mean = 0.5 * angles[1] + 0.3 * angles[2]
    c, s = np.cos(mean), np.sin(mean)
    np.testing.assert_allclose(found.vertices, ball.vertices @ np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]).T, atol=1e-10)


@pytest.mark.parametrize("weights", [[0.5, 0.6, 0, 0], [1.5, -0.5, 0, 0], [0, 0, 0, 0]])
def test_weights_that_are_no_mixture_are_refused(weights):
    with pytest.raises(InputError, match="weights of at least 0 that add up to 1"):
        BLEND(weights)


def test_bad_shapes_and_weights_are_refused():
    with pytest.raises(InputError, match="weights of shape"):
        BLEND([0.5, 0.5])
    with pytest.raises(InputError, match="finite numbers in weights"):
        BLEND([np.nan, 1, 0, 0])
    with pytest.raises(InputError, match="at least one shape"):
        Blend(BODY, np.zeros((0, BODY.n_vertices, 3)))
    with pytest.raises(InputError, match="shapes of shape"):
        Blend(BODY, SHAPES[:, 1:])
    with pytest.raises(InputError, match="finite numbers in shapes"):
        Blend(BODY, np.where(np.arange(4)[:, None, None] == 2, np.nan, SHAPES))


def test_blends_and_tours_survive_pickling():
    blend, tour = pickle.loads(pickle.dumps((BLEND, Tour(STOPS))))
    np.testing.assert_array_equal(blend([0.25] * 4).vertices, BLEND([0.25] * 4).vertices)
    np.testing.assert_array_equal(tour(1.2).vertices, Tour(STOPS)(1.2).vertices)


@pytest.mark.parametrize("path", ["gradient", "linear"])
def test_stops_are_met_in_time_to_the_last_bit(path):
    tour = Tour(STOPS, path)
    for k, t in enumerate(STOPS.times):
        assert tour(float(t)).vertices.tobytes() == SHAPES[k].tobytes()
    for t, k in ((1 - 1e-9, 1), (1 + 1e-9, 1), (1.5 + 1e-9, 2)):
        np.testing.assert_allclose(tour(t).vertices, SHAPES[k], atol=1e-7)


def test_frames_of_a_tour_hold_its_stops():
    frames = Tour(STOPS).frames(5)
    assert len(frames) == 16
    np.testing.assert_array_equal(frames.times[::5], STOPS.times)
    np.testing.assert_array_equal(frames.positions[::5], SHAPES)
    np.testing.assert_allclose(np.diff(frames.times[10:]), 0.5)


def test_the_speed_of_an_eased_tour_has_no_jump_at_a_stop():
    speeds = {}
    for easing in ("linear", "smoothstep"):
        tour = Tour(STOPS, "linear", easing)
        before, after = ((tour(1 + h).vertices - tour(1.0).vertices) / h for h in (-1e-5, 1e-5))
        speeds[easing] = np.abs(before - after).max()
    assert speeds["smoothstep"] < 1e-3 < 0.1 < speeds["linear"]


def test_a_leg_of_a_tour_is_a_morph():
    middle = Tour(STOPS, easing="linear")(2.75).vertices
    np.testing.assert_array_equal(middle, Morph(STOPS[2], SHAPES[3], "gradient")(0.5).vertices)


def test_a_tour_may_stay():
    still = MeshSequence(BODY.topology, SHAPES[[1, 1, 2]], [0.0, 1.0, 2.0])
    np.testing.assert_allclose(Tour(still)(0.4).vertices, SHAPES[1], atol=1e-10)


def test_bad_tours_are_refused():
    with pytest.raises(InputError, match="at least 2 stops; found 1"):
        Tour(MeshSequence(BODY.topology, SHAPES[:1], [0.0]))
    with pytest.raises(InputError, match="path out of linear, gradient"):
        Tour(STOPS, "wavelet")
    with pytest.raises(InputError, match="an easing out of"):
        Tour(STOPS, easing="bounce")
    with pytest.raises(InputError, match="time from 0 to 4"):
        Tour(STOPS)(4.1)
    with pytest.raises(InputError, match="at least 1 step per leg"):
        Tour(STOPS).frames(0)


def test_a_tour_is_measured_between_its_stops():
    frames = Tour(STOPS).frames(4)
    by_stops, by_ends = measure(frames, [0, 4, 8, -1]), measure(frames)
    np.testing.assert_allclose(by_stops.edge_log_rms[[0, 4, 8, 12]], 0, atol=1e-12)
    assert by_ends.edge_log_rms[4] > 0.01
    assert by_stops.edge_log_rms.max() < by_ends.edge_log_rms.max()
