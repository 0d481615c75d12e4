"""Best rotations: exact cases, det = +1 always, recovery of known motions, refusal where no single rotation is best."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from morphlet.errors import InputError
from morphlet.numerics.rigid import kabsch, rigid

ROUNDING = 1e-9
clouds = arrays(float, (7, 3), elements=st.floats(-5, 5, width=32))
seeds = st.integers(0, 10**6)


def turn(seed):
    return Rotation.random(random_state=seed).as_matrix()


def cloud(seed, k=8):
    return np.random.default_rng(seed).normal(size=(k, 3))


@settings(deadline=None)
@given(seeds, seeds)
def test_a_known_rotation_is_found(points_seed, turn_seed):
    points, rotation = cloud(points_seed), turn(turn_seed)
    np.testing.assert_allclose(kabsch(points, points @ rotation.T), rotation, atol=ROUNDING)


@settings(deadline=None)
@given(clouds, clouds)
def test_the_result_is_a_rotation_and_beats_others(source, target):
    try:
        rotation = kabsch(source, target)
    except InputError:
        return
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=ROUNDING)
    assert np.linalg.det(rotation) == pytest.approx(1, abs=ROUNDING)
    cost = np.sum((source @ rotation.T - target) ** 2)
    for seed in range(5):
        assert cost <= np.sum((source @ turn(seed).T - target) ** 2) + 1e-9 * (1 + np.sum(source**2) + np.sum(target**2))


def test_a_mirrored_cloud_is_turned_not_mirrored():
    points = cloud(0) * [3, 2, 1]
    rotation = kabsch(points, points * [1, 1, -1])
    assert np.linalg.det(rotation) == pytest.approx(1)


@settings(deadline=None)
@given(seeds, seeds, seeds)
def test_turning_both_clouds_turns_the_answer(points_seed, first, second):
    source, target = cloud(points_seed), cloud(points_seed + 1)
    p, q = turn(first), turn(second)
    np.testing.assert_allclose(kabsch(source @ p.T, target @ q.T), q @ kabsch(source, target) @ p.T, atol=1e-6)


def test_weights_count_as_repetitions():
    source, target = cloud(1, 4), cloud(2, 4)
    repeated = kabsch(source[[0, 1, 1, 1, 2, 3]], target[[0, 1, 1, 1, 2, 3]])
    np.testing.assert_allclose(kabsch(source, target, [1, 3, 1, 1]), repeated, atol=ROUNDING)


def test_two_pairs_in_different_directions_are_enough():
    rotation = turn(5)
    source = np.array([[1.0, 0, 0], [1.0, 1, 0]])
    np.testing.assert_allclose(kabsch(source, source @ rotation.T), rotation, atol=ROUNDING)


@pytest.mark.parametrize(
    "source",
    [np.zeros((4, 3)), np.array([[1.0, 0, 0]]), np.outer([1, -2, 3], [1.0, 1, 1])],
    ids=["all zero", "one pair", "parallel"],
)
def test_no_single_best_rotation_is_refused(source):
    with pytest.raises(InputError, match="non-parallel"):
        kabsch(source, source)


def test_a_point_reflection_has_no_single_best_rotation():
    with pytest.raises(InputError, match="orientation -1"):
        kabsch(np.eye(3), -np.eye(3))


@settings(deadline=None)
@given(seeds, st.floats(1e-150, 1e150))
def test_size_does_not_matter(seed, scale):
    source, rotation = cloud(seed), turn(seed)
    np.testing.assert_allclose(kabsch(scale * source, scale * source @ rotation.T), rotation, atol=1e-8)


def test_bad_weights_and_shapes_are_refused():
    with pytest.raises(InputError, match="non-negative weights"):
        kabsch(np.eye(3), np.eye(3), [1, -1, 1])
    with pytest.raises(InputError, match="target of shape"):
        kabsch(np.eye(3), np.eye(4)[:, :3])


@settings(deadline=None)
@given(seeds, seeds, arrays(float, 3, elements=st.floats(-100, 100)))
def test_a_known_rigid_motion_is_found(points_seed, turn_seed, shift):
    points, rotation = cloud(points_seed), turn(turn_seed)
    motion = rigid(points, points @ rotation.T + shift)
    np.testing.assert_allclose(motion.rotation, rotation, atol=1e-8)
    np.testing.assert_allclose(motion(points), points @ rotation.T + shift, atol=1e-8)


def test_points_on_a_line_have_no_single_rigid_motion():
    with pytest.raises(InputError, match="non-parallel"):
        rigid([[0, 0, 0], [1, 1, 1], [2, 2, 2]], [[0, 0, 0], [1, 0, 0], [2, 0, 0]])
