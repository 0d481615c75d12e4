"""Delays: fronts over the surface, exact ends, each vertex on its own time, times of their own for bands, the way back."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Bands, Morph, Schedule, sweep
from morphlet.errors import InputError
from support import beside, blob, icosphere

BODY = blob(2)
A, B = np.random.default_rng(5).normal(size=(2, 3, 3))
TARGET = BODY.vertices + 0.2 * np.sin(BODY.vertices @ A) @ B
DELAY = sweep(BODY, [0])
WIDE = np.array([1.0, 1.0, 1.0])
BANDS = Bands(
    np.stack([BODY.vertices * WIDE - np.sin(5 * BODY.vertices), np.sin(5 * BODY.vertices)]),
    np.stack([TARGET - np.sin(7 * TARGET), np.sin(7 * TARGET)]),
)
PATHS = {"linear": (), "gradient": (), "wavelet": (BANDS,), "turning": (BANDS,)}
times = st.floats(0, 1)


def morph(path: str, delay: np.ndarray | None = DELAY) -> Morph:
    name = "gradient" if path == "turning" else path
    bands = PATHS[path][0] if PATHS[path] else None
    return Morph(BODY, TARGET, name, bands, Schedule.coarse_first(2) if bands else None, delay)


def test_delays_grow_with_the_distance():
    assert DELAY[0] == 0
    assert DELAY.max() == 0.5
    np.testing.assert_array_equal(sweep(BODY, [0], 0.25), DELAY / 2)
    assert (sweep(BODY, [0, 7]) <= sweep(BODY, [0]) * 1.5).all()
    assert sweep(BODY, np.arange(BODY.n_vertices)).tolist() == [0.0] * BODY.n_vertices


def test_parts_that_no_face_leads_to_are_last():
    both = beside(icosphere(1), icosphere(1).with_vertices(icosphere(1).vertices + 5))
    assert sweep(both, [0])[42:].tolist() == [0.5] * 42


@pytest.mark.parametrize("path", PATHS)
def test_ends_are_exact_and_near_them_nothing_jumps(path):
    found = morph(path)
    assert found(0).vertices.tobytes() == BODY.vertices.tobytes()
    assert found(1).vertices.tobytes() == TARGET.tobytes()
    np.testing.assert_allclose(found(1e-9).vertices, BODY.vertices, atol=1e-7)
    np.testing.assert_allclose(found(1 - 1e-9).vertices, TARGET, atol=1e-7)


@settings(max_examples=15)
@given(times)
def test_each_vertex_moves_on_its_own_straight_line(t):
    share = np.clip((t - DELAY) / 0.5, 0, 1)[:, None]
    np.testing.assert_allclose(morph("linear")(t).vertices, (1 - share) * BODY.vertices + share * TARGET, atol=1e-14)


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("t", [0.2, 0.5, 0.8])
def test_equal_delays_are_an_even_time(path, t):
    later = morph(path, np.full(BODY.n_vertices, 0.5))
    np.testing.assert_allclose(later(0.5 + t / 2).vertices, morph(path, None)(t).vertices, atol=1e-9)
    np.testing.assert_allclose(later(t / 2).vertices, BODY.vertices, atol=1e-9)
    np.testing.assert_allclose(morph(path, np.zeros(BODY.n_vertices))(t).vertices, morph(path, None)(t).vertices, atol=1e-9)


@pytest.mark.parametrize("t", [0.2, 0.5, 0.8])
def test_the_way_back_is_this_way_reversed(t):
    mirrored = Bands(BANDS.target, BANDS.source)
    there = BODY.with_vertices(TARGET)
    back = Morph(there, BODY.vertices, "wavelet", mirrored, Schedule.coarse_first(2).mirrored(), 0.5 - DELAY)
    np.testing.assert_allclose(back(1 - t).vertices, morph("wavelet")(t).vertices, atol=1e-12)


def test_what_has_not_set_out_keeps_its_shape():
    frame, early = morph("gradient")(0.25), DELAY > 0.4
    i, j = BODY.topology.edges[early[BODY.topology.edges].all(axis=1)].T
    before, after = (np.linalg.norm(x[i] - x[j], axis=1) for x in (BODY.vertices, frame.vertices))
    moving = np.linalg.norm(TARGET[i] - TARGET[j], axis=1)
    assert np.abs(after / before - 1).max() < 0.3 * np.abs(moving / before - 1).max()


def test_bad_delays_are_refused():
    with pytest.raises(InputError, match="delays of at least 0 and less than 1; found 1 that are not, such as -0"):
        morph("linear", np.append(np.zeros(BODY.n_vertices - 1), -0.1))
    with pytest.raises(InputError, match="such as 1 "):
        morph("linear", np.append(np.zeros(BODY.n_vertices - 1), 1.0))
    with pytest.raises(InputError, match="delay of shape"):
        morph("linear", np.zeros(3))
    with pytest.raises(InputError, match="finite numbers in delay"):
        morph("linear", np.full(BODY.n_vertices, np.nan))
    with pytest.raises(InputError, match="a last delay"):
        sweep(BODY, [0], 1.0)
    with pytest.raises(InputError, match="at least one vertex to start from"):
        sweep(BODY, np.zeros(0, int))
    with pytest.raises(InputError, match="starts"):
        sweep(BODY, [999])


def test_delayed_morphs_survive_pickling():
    found = morph("gradient")
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(found))(0.4).vertices, found(0.4).vertices)
