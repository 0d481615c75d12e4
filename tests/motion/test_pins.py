"""Pins: exact places, smooth displacements without peaks, whole moves, loose parts, and what is refused."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh, Pins
from morphlet.errors import InputError
from support import beside, blob, icosphere, random_rotation

BODY = blob(3)
CHOSEN = np.array([0, 1, 2, 5])
PINS = Pins.prepare(BODY, CHOSEN)
seeds = st.integers(0, 10**6)


@settings(max_examples=15)
@given(seeds)
def test_pinned_vertices_are_in_their_places(seed):
    goal = BODY.vertices[CHOSEN] + np.random.default_rng(seed).normal(size=(4, 3))
    np.testing.assert_array_equal(PINS.hold(BODY, goal).vertices[CHOSEN], goal)


def test_vertices_in_place_change_nothing():
    np.testing.assert_allclose(PINS.hold(BODY, BODY.vertices[CHOSEN]).vertices, BODY.vertices, atol=1e-12)


@settings(max_examples=15)
@given(seeds)
def test_pins_that_move_alike_move_the_whole(seed):
    offset = np.random.default_rng(seed).normal(size=3)
    np.testing.assert_allclose(PINS.hold(BODY, BODY.vertices[CHOSEN] + offset).vertices, BODY.vertices + offset, atol=1e-10)


@settings(max_examples=15)
@given(seeds)
def test_turned_places_turn_the_displacement(seed):
    rotation, moved = random_rotation(seed), BODY.vertices[CHOSEN] + np.random.default_rng(seed).normal(size=(4, 3))
    turned = PINS.hold(BODY.with_vertices(BODY.vertices @ rotation.T), moved @ rotation.T)
    np.testing.assert_allclose(turned.vertices, PINS.hold(BODY, moved).vertices @ rotation.T, atol=1e-10)


def test_a_single_displaced_pin_makes_no_peak():
    goal = np.array(BODY.vertices[CHOSEN])
    goal[0] += [0, 0, 0.3]
    shift = np.linalg.norm(PINS.hold(BODY, goal).vertices - BODY.vertices, axis=1)
    ring = np.delete(BODY.topology.edges[(BODY.topology.edges == 0).any(axis=1)].ravel(), 0)
    assert shift[ring[ring != 0]].min() > 0.25
    assert shift[0] == pytest.approx(0.3)
    assert shift.max() < 0.4


def test_parts_without_pins_go_with_the_body():
    both = beside(BODY, icosphere(1).with_vertices(0.1 * icosphere(1).vertices + np.array([2, 0, 0])))
    both = Mesh(np.vstack([both.vertices, [[0, 0, 3]]]), both.faces)
    moved = Pins.prepare(both, CHOSEN).hold(both, both.vertices[CHOSEN] + [1, 2, 3])
    np.testing.assert_allclose(moved.vertices, both.vertices + np.array([1, 2, 3]), atol=1e-9)
    ear = Pins.prepare(both, [0, 650]).hold(both, both.vertices[[0, 650]] + [[0, 0, 0], [0, 0, 5]])
    np.testing.assert_allclose(ear.vertices[642:-1], both.vertices[642:-1] + np.array([0, 0, 5]), atol=1e-9)
    np.testing.assert_allclose(ear.vertices[:642], BODY.vertices, atol=1e-9)


def test_bad_pins_are_refused():
    with pytest.raises(InputError, match="at least one vertex to pin, each once; found 0"):
        Pins.prepare(BODY, np.zeros(0, int))
    with pytest.raises(InputError, match="each once; found 3, 2 of them different"):
        Pins.prepare(BODY, [0, 1, 1])
    with pytest.raises(InputError, match="vertices"):
        Pins.prepare(BODY, [642])
    with pytest.raises(InputError, match="places of shape"):
        PINS.hold(BODY, np.zeros((3, 3)))
    with pytest.raises(InputError, match="finite numbers in places"):
        PINS.hold(BODY, np.full((4, 3), np.nan))
    with pytest.raises(InputError, match="a mesh of 642 vertices"):
        PINS.hold(icosphere(1), BODY.vertices[CHOSEN])


def test_pins_survive_pickling():
    goal = BODY.vertices[CHOSEN] * 1.1
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(PINS)).hold(BODY, goal).vertices, PINS.hold(BODY, goal).vertices)
