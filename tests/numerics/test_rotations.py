"""Rotations by the thousand against singular values, above all where two rotations fit nearly as well."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from morphlet import InputError
from morphlet.numerics.rotations import best_rotations, exponential, logarithm

COUNT = 300


def random_rotations(rng: np.random.Generator, angle: float | None = None) -> np.ndarray:
    axes = rng.normal(size=(COUNT, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    return Rotation.from_rotvec(axes * (rng.uniform(0, np.pi, (COUNT, 1)) if angle is None else angle)).as_matrix()


def with_values(rng: np.random.Generator, values: list[float]) -> np.ndarray:
    """Covariances with these singular values, the last with a sign."""
    return random_rotations(rng) @ np.diag(values) @ random_rotations(rng)


def assert_best(covariances: np.ndarray, loss: float = 1e-14) -> None:
    found = best_rotations(covariances)
    u, s, vt = np.linalg.svd(covariances)
    best = s[:, 0] + s[:, 1] + s[:, 2] * np.sign(np.linalg.det(u @ vt))
    traces = np.einsum("nij,nji->n", found, covariances)
    norms = np.linalg.norm(covariances, axis=(1, 2))
    assert np.max((best - traces) / np.where(norms > 0, norms, 1)) < loss
    np.testing.assert_allclose(found @ found.transpose(0, 2, 1), np.broadcast_to(np.eye(3), found.shape), atol=2e-14)
    np.testing.assert_allclose(np.linalg.det(found), 1.0, atol=2e-14)


FAMILIES = {
    "random": [],
    "rank 1": [1, 0, 0],
    "rank 2": [1, 0.3, 0],
    "flat": [1, 1, 0],
    "round": [1, 1, 1],
    "reflected": [1, 0.5, -0.2],
    "fully reflected": [1, 1, -1],
    "double": [1, 0.5, -0.5],
}


@pytest.mark.parametrize("values", FAMILIES.values(), ids=FAMILIES)
def test_the_trace_is_the_best(values):
    rng = np.random.default_rng(0)
    assert_best(with_values(rng, values) if values else rng.normal(size=(COUNT, 3, 3)))


@pytest.mark.parametrize("near", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12])
@pytest.mark.parametrize("kind", ["rank 1", "double", "half turn"])
def test_the_trace_is_the_best_near_a_double_root(near, kind):
    rng = np.random.default_rng(1)
    if kind == "rank 1":
        covariances = with_values(rng, [1, 0, 0]) + near * rng.normal(size=(COUNT, 3, 3))
    elif kind == "double":
        covariances = with_values(rng, [1, 0.5, near - 0.5])
    else:
        vectors = rng.normal(size=(COUNT, 4, 3))
        covariances = np.einsum("nka,nkb->nab", vectors, vectors @ random_rotations(rng, np.pi - near).transpose(0, 2, 1))
    assert_best(covariances, 1e-12)


@pytest.mark.parametrize("scale", [1e-140, 1e-30, 1e30, 1e140])
def test_size_does_not_matter(scale):
    covariances = np.random.default_rng(2).normal(size=(COUNT, 3, 3))
    np.testing.assert_allclose(best_rotations(scale * covariances), best_rotations(covariances), atol=1e-10)


def test_negative_weights_are_fine():
    """A sum with a negative weight is a covariance like others."""
    a, turn = np.random.default_rng(3).normal(size=(5, 3)), Rotation.from_rotvec([0.3, 0.4, 0.5]).as_matrix()
    weights = np.array([1.0, 2.0, 1.5, -0.2, 0.5])
    found = best_rotations(((weights[:, None] * a).T @ (a @ turn.T))[None])
    np.testing.assert_allclose(found[0], turn, atol=1e-12)


def test_nothing_to_fit_is_identity():
    np.testing.assert_array_equal(best_rotations(np.zeros((3, 3, 3))), np.broadcast_to(np.eye(3), (3, 3, 3)))


def test_of_equal_fits_the_least_turn():
    """One pair of vectors: about their common plane's normal, and not about themselves."""
    a, b = np.array([1.0, 0, 0]), np.array([np.cos(0.7), np.sin(0.7), 0])
    np.testing.assert_allclose(best_rotations(np.outer(a, b)[None])[0], Rotation.from_rotvec([0, 0, 0.7]).as_matrix(), atol=1e-7)


def test_opposite_vectors_turn_by_half():
    found = best_rotations(np.outer([1.0, 0, 0], [-1.0, 0, 0])[None])[0]
    np.testing.assert_allclose(found[:, 0], [-1, 0, 0], atol=1e-12)
    np.testing.assert_allclose(np.linalg.det(found), 1, atol=1e-12)


def test_counts_around_a_block():
    """The last block may be partly filled."""
    covariances = np.random.default_rng(4).normal(size=(200, 3, 3))
    for count in (0, 1, 63, 64, 65, 128):
        np.testing.assert_array_equal(best_rotations(covariances[:count]), best_rotations(covariances)[:count])


def test_numbers_must_be_finite():
    with pytest.raises(InputError, match="finite numbers in covariances"):
        best_rotations(np.full((1, 3, 3), np.nan))


@settings(max_examples=30)
@given(st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_exponential_is_the_rotation(vector):
    np.testing.assert_allclose(exponential(np.array([vector]))[0], Rotation.from_rotvec(vector).as_matrix(), atol=1e-13)


@pytest.mark.parametrize("angle", [0.0, 1e-300, 1e-12, 1e-6, 0.99e-4, 1.01e-4, 1.0, 3.0, np.pi - 1e-9, np.pi])
def test_logarithm_undoes_exponential(angle):
    axis = np.array([0.48, -0.6, 0.64])
    found = logarithm(exponential(angle * axis[None])[0])
    if angle == np.pi:
        found = found * np.sign(found @ axis)
    np.testing.assert_allclose(found, angle * axis, rtol=1e-7, atol=1e-15)
