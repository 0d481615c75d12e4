"""The unit sphere: logarithm inverts exponential, point sets are even, rotation grids cover SO(3)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree

from morphlet.errors import InputError
from morphlet.numerics import unit_sphere as us

seeds = st.integers(0, 10**6)


def directions(seed, k=5):
    x = np.random.default_rng(seed).normal(size=(k, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


@settings(deadline=None)
@given(seeds)
def test_exponential_undoes_logarithm(seed):
    p, q = directions(seed), directions(seed + 1)
    tangents = us.logarithm(p, q)
    np.testing.assert_allclose(np.sum(p * tangents, axis=1), 0, atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(tangents, axis=1), np.arccos(np.clip(np.sum(p * q, axis=1), -1, 1)), atol=1e-7)
    np.testing.assert_allclose(us.exponential(p, tangents), q, atol=1e-12)


def test_logarithm_of_equal_and_opposite_points_is_zero():
    p = directions(3)
    assert not np.any(np.abs(us.logarithm(p, p)) > 1e-12)
    assert np.isfinite(us.logarithm(p, -p)).all()


def test_half_a_turn_leads_to_the_opposite_point():
    np.testing.assert_allclose(us.exponential(np.array([[1.0, 0, 0]]), np.array([[0, 0, np.pi]])), [[-1, 0, 0]], atol=1e-15)


@pytest.mark.parametrize("count", [1, 2, 500])
def test_fibonacci_points_are_unit_vectors(count):
    points = us.fibonacci(count)
    assert points.shape == (count, 3)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-14)


def test_fibonacci_points_are_even():
    points = us.fibonacci(1000)
    gap = cKDTree(points).query(points, k=2)[0][:, 1]
    ideal = np.sqrt(8 * np.pi / (np.sqrt(3) * 1000))  # edge of the hexagonal lattice of that density
    assert gap.min() > 0.75 * ideal
    np.testing.assert_allclose(points.T @ points / 1000, np.eye(3) / 3, atol=1e-3)


@pytest.mark.parametrize("s", [0, 1, 3])
def test_icosphere_is_closed_outward_and_round(s):
    points, faces = us.icosphere(s)
    assert (len(points), len(faces)) == (10 * 4**s + 2, 20 * 4**s)
    np.testing.assert_allclose(np.linalg.norm(points, axis=1), 1, atol=1e-14)
    assert np.all(np.linalg.det(points[faces]) > 0)
    half = {(int(f[k]), int(f[(k + 1) % 3])) for f in faces for k in range(3)}
    assert len(half) == 3 * len(faces)
    assert all((b, a) in half for a, b in half)


def test_icosahedron_has_one_edge_length():
    points, faces = us.icosphere(0)
    lengths = np.linalg.norm(points[faces] - points[np.roll(faces, 1, axis=1)], axis=2)
    np.testing.assert_allclose(lengths, 1 / np.sin(0.4 * np.pi), atol=1e-14)


def test_rotations_are_rotations_and_cover_everything():
    grid = us.rotations(4608)
    np.testing.assert_allclose(grid @ grid.transpose(0, 2, 1), np.broadcast_to(np.eye(3), grid.shape), atol=1e-12)
    assert np.all(np.linalg.det(grid) > 0)
    queries = us.rotations_about(directions(0, 60) * np.linspace(0.1, 3, 60)[:, None])
    nearest = [us.rotation_angles(grid, q[None]).min() for q in queries]
    assert np.degrees(max(nearest)) < 15


@settings(deadline=None)
@given(seeds, st.floats(0, np.pi))
def test_rotation_angles(seed, angle):
    one = us.rotations_about(directions(seed, 1))[0]
    other = us.rotations_about(angle * directions(seed + 1, 1))[0] @ one
    assert us.rotation_angles(one, other) == pytest.approx(angle, abs=1e-7)


@pytest.mark.parametrize("make", [us.fibonacci, us.rotations])
def test_no_points_are_refused(make):
    with pytest.raises(InputError, match="positive count"):
        make(0)


def test_negative_subdivision_is_refused():
    with pytest.raises(InputError, match="subdivisions >= 0"):
        us.icosphere(-1)
