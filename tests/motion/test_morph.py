"""Morph: both ends to the last bit, straight lines between, figures of its frames by hand."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh, MeshSequence
from morphlet.errors import InputError
from morphlet.motion.morph import Morph, edge_log_rms_max, volume_change_max
from morphlet.numerics.unit_sphere import icosphere

BALL = Mesh(*icosphere(1))


def scattered(seed):
    return np.random.default_rng(seed).normal(size=BALL.vertices.shape) * 1e3


@settings(deadline=None)
@given(st.integers(0, 10**6))
def test_both_ends_are_exact(seed):
    target = scattered(seed)
    target[0] = -0.0
    morph = Morph(BALL, target)
    frames = morph.frames(7)
    for first, last in ((morph(0.0), morph(1.0)), (morph(0), morph(1)), (frames[0], frames[6])):
        assert first.vertices.tobytes() == BALL.vertices.tobytes()
        assert last.vertices.tobytes() == target.tobytes()
    assert morph(0.3).topology is BALL.topology


@settings(deadline=None)
@given(st.integers(0, 10**6), st.floats(0, 1))
def test_vertices_move_on_straight_lines(seed, t):
    target = scattered(seed)
    expected = BALL.vertices + t * (target - BALL.vertices)
    np.testing.assert_allclose(Morph(BALL, target)(t).vertices, expected, atol=1e-9)


def test_equal_ends_stand_still():
    frames = Morph(BALL, BALL.vertices).frames(5)
    np.testing.assert_allclose(frames.positions, np.broadcast_to(BALL.vertices, (5, *BALL.vertices.shape)), atol=1e-15)


def test_frames_are_spread_over_time():
    frames = Morph(BALL, 2 * BALL.vertices).frames(5)
    assert isinstance(frames, MeshSequence)
    np.testing.assert_array_equal(frames.times, [0, 0.25, 0.5, 0.75, 1])
    np.testing.assert_array_equal(frames[2].vertices, Morph(BALL, 2 * BALL.vertices)(0.5).vertices)


@pytest.mark.parametrize("t", [-0.1, 1.1, float("nan")])
def test_times_outside_are_refused(t):
    with pytest.raises(InputError, match="time from 0 to 1"):
        Morph(BALL, BALL.vertices)(t)


def test_bad_arguments_are_refused():
    with pytest.raises(InputError, match="path out of linear"):
        Morph(BALL, BALL.vertices, "teleport")
    with pytest.raises(InputError, match="target_positions of shape"):
        Morph(BALL, BALL.vertices[1:])
    with pytest.raises(InputError, match="finite numbers in target_positions"):
        Morph(BALL, np.where(np.arange(42)[:, None] == 3, np.nan, BALL.vertices))
    with pytest.raises(InputError, match="target_positions of shape"):
        Morph(BALL, Mesh(*icosphere(2)).vertices)
    with pytest.raises(InputError, match="at least 2 frames"):
        Morph(BALL, BALL.vertices).frames(1)


def test_volume_dips_when_a_ball_turns_over():
    morph = Morph(BALL, BALL.vertices * [-1, -1, 1])  # half a turn: flat in the middle
    assert volume_change_max(morph.frames(3)) == pytest.approx(-100)
    assert edge_log_rms_max(morph.frames(5)) > 0.3


def test_volume_of_a_stretch_along_one_axis_is_straight():
    morph = Morph(BALL, BALL.vertices * [1, 1, 5])
    assert volume_change_max(morph.frames(6)) == pytest.approx(0, abs=1e-9)


def test_growth_keeps_edges_in_step():
    assert edge_log_rms_max(Morph(BALL, 3 * BALL.vertices).frames(5)) == pytest.approx(0, abs=1e-12)


def test_edges_without_length_are_left_out():
    assert edge_log_rms_max(Morph(BALL, 0 * BALL.vertices).frames(3)) == 0.0


def test_morphs_survive_pickling():
    copy = pickle.loads(pickle.dumps(Morph(BALL, scattered(0))))
    np.testing.assert_array_equal(copy(0.5).vertices, Morph(BALL, scattered(0))(0.5).vertices)
