"""Alignment: by pairs and by search; equivariance, left and right, ambiguity made visible."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mapping.stars import blob, radial_map
from morphlet.errors import InputError
from morphlet.features.signature import signature
from morphlet.mapping.alignment import Alignment, SphereSamples, align_by_pairs, align_by_search
from morphlet.numerics.unit_sphere import fibonacci, rotation_angles

seeds = st.integers(0, 10**6)


def turn(seed):
    return Rotation.random(random_state=seed).as_matrix()


def samples(mesh, rotation=None):
    return SphereSamples(radial_map(mesh, rotation).points, signature(mesh), mesh.vertex_areas)


@settings(deadline=None)
@given(seeds, st.integers(2, 10))
def test_pairs_give_the_rotation_they_were_made_with(seed, count):
    points, rotation = fibonacci(50)[np.random.default_rng(seed).permutation(49)[:count]], turn(seed)
    found = align_by_pairs(points, points @ rotation.T)
    np.testing.assert_allclose(found.rotation, rotation, atol=1e-6)
    np.testing.assert_allclose(found(points), points @ rotation.T, atol=1e-6)
    assert found.score == pytest.approx(0, abs=1e-6)
    assert (found.method, found.margin, found.ambiguous) == ("pairs", None, False)


def test_weight_draws_the_rotation_towards_a_pair():
    source = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]])
    target = np.array([[1.0, 0, 0], [0, 0.8, 0.6], [0, 0, 1]])
    gaps = [np.linalg.norm(align_by_pairs(source, target, [1, w, 1])(source)[1] - target[1]) for w in (0.1, 1, 10)]
    assert gaps[0] > gaps[1] > gaps[2]


def test_one_pair_is_refused():
    with pytest.raises(InputError, match="at least two pairs"):
        align_by_pairs([[1, 0, 0]], [[0, 1, 0]])


@pytest.mark.parametrize("tilt", [0.0, 1e-5])
def test_pairs_on_one_line_through_the_centre_are_refused(tilt):
    line = [[0, 0, 1], [0, tilt, -1], [0, 0, 1]]
    spread = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]
    for pairs, side in (((line, spread), "source"), ((spread, line), "target")):
        with pytest.raises(InputError, match=f"3 pairs whose {side} points lie within 0.001 rad of one line"):
            align_by_pairs(*pairs)


@pytest.mark.parametrize("seed", [0, 1])
def test_search_finds_a_known_rotation(seed):
    rotation = turn(seed)
    found = align_by_search(samples(blob()), samples(blob(scale=7), rotation))
    assert np.degrees(rotation_angles(found.rotation, rotation)) < 1
    assert found.method == "search"
    assert not found.ambiguous
    assert found.score < 0.01 < found.runner_up


def test_search_works_across_resolutions():
    found = align_by_search(samples(blob(3)), samples(blob(4), turn(5)))
    assert np.degrees(rotation_angles(found.rotation, turn(5))) < 3


def test_search_never_mirrors():
    mesh = blob()
    mirror = np.diag([-1.0, 1, 1])
    mirrored = SphereSamples(radial_map(mesh).points @ mirror, signature(mesh), mesh.vertex_areas)
    found = align_by_search(samples(mesh), mirrored)
    assert np.linalg.det(found.rotation) == pytest.approx(1)
    assert found.score > 0.02  # the right rotation of the shape itself scores below 0.01


def test_search_says_the_same_twice():
    first, second = (align_by_search(samples(blob(2)), samples(blob(2), turn(1))) for _ in range(2))
    np.testing.assert_array_equal(first.rotation, second.rotation)
    assert first.runner_up == second.runner_up


def test_shapes_of_revolution_and_balls_are_ambiguous():
    points = fibonacci(500)
    lemon = SphereSamples(points, np.exp(2 * points[:, [2]]), np.ones(500))
    assert align_by_search(lemon, lemon).ambiguous
    ball = SphereSamples(points, np.ones((500, 1)), np.ones(500))
    assert align_by_search(ball, ball).ambiguous


def test_empty_parts_of_the_sphere_do_no_harm():
    points = fibonacci(2000)
    half = points[points[:, 2] > 0.2]
    values = np.exp(3 * half @ [[1], [0], [0]])
    found = align_by_search(SphereSamples(half, values, np.ones(len(half))), SphereSamples(half @ turn(3).T, values, np.ones(len(half))))
    assert np.degrees(rotation_angles(found.rotation, turn(3))) < 3


def test_different_descriptors_are_refused():
    points = fibonacci(10)
    one, two = (SphereSamples(points, np.ones((10, d)), np.ones(10)) for d in (1, 2))
    with pytest.raises(InputError, match="as many descriptors"):
        align_by_search(one, two)


def test_samples_without_weight_are_refused():
    with pytest.raises(InputError, match="one of them positive"):
        SphereSamples(fibonacci(3), np.ones((3, 1)), np.zeros(3))


@pytest.mark.parametrize("matrix", [np.diag([1.0, 1, -1]), 2 * np.eye(3)], ids=["mirror", "scaled"])
def test_only_rotations_are_alignments(matrix):
    with pytest.raises(InputError, match="rotation matrix"):
        Alignment(matrix, "given", 0.0)


def test_alignments_survive_pickling():
    found = align_by_pairs(np.eye(3), np.roll(np.eye(3), 1, axis=0))
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(found)).rotation, found.rotation)
