"""Wavelet paths: bands add up, linear schedules are straight lines, mirrored ones the way back, coarse parts move first."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet.approximation.surface import ApproximationOptions
from morphlet.errors import InputError
from morphlet.motion.bands import Bands, wavelet_bands
from morphlet.motion.morph import Morph
from morphlet.motion.schedule import Schedule
from morphlet.sphere.map import SphericalMap, spherical_map
from support import blob

BODY = blob(3)
x, y, z = BODY.vertices.T
TARGET = BODY.vertices * [1.2, 0.9, 1.1] + 0.1 * np.stack([np.sin(9 * y), np.sin(2 * z), np.cos(7 * x)], axis=1)
FEW = ApproximationOptions(levels=4)


@pytest.fixture(scope="module")
def mapped() -> SphericalMap:
    return spherical_map(BODY)


@pytest.fixture(scope="module")
def bands(mapped) -> Bands:
    return wavelet_bands(mapped, TARGET, 80, FEW)


def test_bands_add_up_to_both_shapes(bands):
    assert len(bands) > 2
    np.testing.assert_allclose(bands.source.sum(axis=0), BODY.vertices, atol=1e-14)
    np.testing.assert_allclose(bands.target.sum(axis=0), TARGET, atol=1e-14)


def test_the_first_band_is_affine_in_the_sphere(bands, mapped):
    columns = np.column_stack([np.ones(BODY.n_vertices), mapped.points])
    both = np.hstack([bands.source[0], bands.target[0]])
    rest = both - columns @ np.linalg.lstsq(columns, both, rcond=None)[0]
    assert np.abs(rest).max() < 1e-12


def test_finer_bands_are_rougher(bands):
    i, j = BODY.topology.edges.T
    roughness = [np.linalg.norm(part[i] - part[j]) / np.linalg.norm(part) for part in bands.source[1:]]
    assert roughness[-1] > 2 * roughness[0]


def test_affine_targets_of_a_round_source_need_no_wavelets(mapped):
    ball = BODY.with_vertices(mapped.points)
    round_body = SphericalMap(replace(mapped.surface, source=ball, mesh=ball), mapped.points, mapped.trace)
    found = wavelet_bands(round_body, mapped.points @ np.diag([1, 2, 3.0]), 20, FEW)
    np.testing.assert_allclose(found.source[0], mapped.points, atol=1e-9)
    assert np.abs(found.target[1:]).max() < 1e-9
    assert len(wavelet_bands(round_body, mapped.points, 0, FEW)) == 2


@settings(max_examples=10)
@given(t=st.floats(0, 1))
def test_linear_schedules_are_straight_lines(bands, t):
    morph = Morph(BODY, TARGET, "wavelet", bands, Schedule.together(len(bands)))
    np.testing.assert_allclose(morph(t).vertices, Morph(BODY, TARGET)(t).vertices, atol=1e-13)


@settings(max_examples=10)
@given(t=st.floats(0, 1), duration=st.floats(0.1, 0.9))
def test_the_way_back_is_the_mirrored_schedule(bands, t, duration):
    schedule = Schedule.coarse_first(len(bands), duration)
    there = Morph(BODY, TARGET, "wavelet", bands, schedule)
    back = Morph(BODY.with_vertices(TARGET), BODY.vertices, "wavelet", Bands(bands.target, bands.source), schedule.mirrored())
    np.testing.assert_allclose(back(1 - t).vertices, there(t).vertices, atol=1e-7)


def test_ends_are_exact_and_near_them_nothing_jumps(bands):
    morph = Morph(BODY, TARGET, "wavelet", bands)
    assert morph(0).vertices.tobytes() == BODY.vertices.tobytes()
    assert morph(1).vertices.tobytes() == TARGET.tobytes()
    np.testing.assert_allclose(morph(1e-9).vertices, BODY.vertices, atol=1e-12)
    np.testing.assert_allclose(morph(1 - 1e-9).vertices, TARGET, atol=1e-12)


def test_coarse_parts_move_first(bands):
    halves = {}
    for make in (Schedule.coarse_first, Schedule.fine_first):
        moved = Morph(BODY, TARGET, "wavelet", bands, make(len(bands), 0.5))(0.25).vertices - BODY.vertices
        coarse, fine = bands.target[0] - bands.source[0], bands.target[-1] - bands.source[-1]
        weights = np.linalg.lstsq(np.stack([d.ravel() for d in bands.target - bands.source], axis=1), moved.ravel(), rcond=None)[0]
        halves[make.__name__] = weights[[0, -1]]
        assert min(np.abs(coarse).max(), np.abs(fine).max()) > 1e-4
    np.testing.assert_allclose(halves["coarse_first"], [0.5, 0], atol=1e-9)
    np.testing.assert_allclose(halves["fine_first"], [0, 0.5], atol=1e-9)


def test_bands_and_schedules_that_do_not_fit_are_refused(bands):
    with pytest.raises(InputError, match="bands, for the path"):
        Morph(BODY, TARGET, "wavelet")
    with pytest.raises(InputError, match="for bands and a schedule; found 'linear'"):
        Morph(BODY, TARGET, "linear", bands)
    with pytest.raises(InputError, match="for a schedule; found none"):
        Morph(BODY, TARGET, "gradient", None, Schedule.together(2))
    with pytest.raises(InputError, match=f"a schedule for {len(bands)} bands; found one for 1"):
        Morph(BODY, TARGET, "wavelet", bands, Schedule.together(1))
    with pytest.raises(InputError, match="add up to the target positions"):
        Morph(BODY, 2 * TARGET, "wavelet", bands)
    with pytest.raises(InputError, match="bands of 642 vertices; found bands of 1"):
        Morph(BODY, TARGET, "wavelet", Bands(np.zeros((2, 1, 3)), np.zeros((2, 1, 3))))
    with pytest.raises(InputError, match="at least one band"):
        Bands(np.zeros((0, 4, 3)), np.zeros((0, 4, 3)))
    with pytest.raises(InputError, match="target of shape"):
        Bands(np.zeros((2, 4, 3)), np.zeros((3, 4, 3)))


def test_bad_targets_are_refused(mapped):
    with pytest.raises(InputError, match="target_positions of shape"):
        wavelet_bands(mapped, TARGET[1:])
    with pytest.raises(InputError, match="finite numbers in target_positions"):
        wavelet_bands(mapped, np.where(np.arange(642)[:, None] == 3, np.nan, TARGET))


def test_wavelet_morphs_survive_pickling(bands):
    morph = Morph(BODY, TARGET, "wavelet", bands)
    copy = pickle.loads(pickle.dumps(morph))
    np.testing.assert_array_equal(copy(0.4).vertices, morph(0.4).vertices)
