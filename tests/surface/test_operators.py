"""Differential operators: one triangle by hand, identities between them, faces without area."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.numerics.unit_sphere import icosphere
from morphlet.surface.operators import gradient, laplacian, mass

EQUILATERAL = Mesh([[0, 0, 0], [2, 0, 0], [1, np.sqrt(3), 0]], [[0, 1, 2]])


def bumpy(seed, s=1):
    points, faces = icosphere(s)
    return Mesh(points * np.random.default_rng(seed).uniform(0.5, 2, (len(points), 1)), faces)


def test_equilateral_triangle_has_cotangents_of_sixty_degrees():
    w = 0.5 / np.sqrt(3)
    np.testing.assert_allclose(laplacian(EQUILATERAL).toarray(), w * (3 * np.eye(3) - np.ones((3, 3))), atol=1e-15)


def test_an_edge_opposite_right_angles_has_no_weight():
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    matrix = laplacian(square).toarray()
    assert matrix[0, 2] == pytest.approx(0, abs=1e-15)
    assert matrix[0, 1] == pytest.approx(-0.5)


def test_an_obtuse_pair_has_a_negative_weight():
    kite = Mesh([[0, 0, 0], [4, 0, 0], [2, 1, 0], [2, -1, 0]], [[0, 1, 2], [1, 0, 3]])
    angle = 2 * np.arctan(2.0)
    assert laplacian(kite)[0, 1] == pytest.approx(-1 / np.tan(angle))
    assert laplacian(kite)[0, 1] > 0


@settings(deadline=None)
@given(st.integers(0, 1000))
def test_laplacian_is_gradient_transposed_areas_gradient(seed):
    mesh = bumpy(seed)
    g = gradient(mesh)
    areas = np.repeat(mesh.face_areas, 3)
    np.testing.assert_allclose((g.T @ (areas[:, None] * g.toarray())), laplacian(mesh).toarray(), atol=1e-11)


@settings(deadline=None)
@given(st.integers(0, 1000), st.floats(0.1, 10))
def test_laplacian_is_symmetric_positive_and_free_of_size(seed, scale):
    mesh = bumpy(seed)
    matrix = laplacian(mesh).toarray()
    np.testing.assert_allclose(matrix, matrix.T, atol=1e-14)
    np.testing.assert_allclose(matrix.sum(axis=1), 0, atol=1e-11)
    eigenvalues = np.linalg.eigvalsh(matrix)
    assert eigenvalues[0] > -1e-11
    assert eigenvalues[1] > 1e-3  # one part: only constants in the kernel
    np.testing.assert_allclose(laplacian(mesh.with_vertices(scale * mesh.vertices)).toarray(), matrix, atol=1e-10)


def test_mass_is_a_third_of_the_areas():
    mesh = bumpy(4)
    assert mass(mesh).diagonal().sum() == pytest.approx(mesh.area)
    assert mass(EQUILATERAL).diagonal() == pytest.approx(np.sqrt(3) / 3)


def test_gradient_of_a_linear_function_is_its_tangential_part():
    mesh = bumpy(2)
    direction = np.array([1.0, -2.0, 0.5])
    found = (gradient(mesh) @ (mesh.vertices @ direction + 7)).reshape(-1, 3)
    expected = direction - (mesh.face_normals @ direction)[:, None] * mesh.face_normals
    np.testing.assert_allclose(found, expected, atol=1e-11)


@pytest.mark.parametrize("extra", [[0.5, 0, 0], [0, 0, 0]], ids=["on an edge", "on a vertex"])
def test_a_face_without_area_contributes_nothing(extra):
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], extra], [[0, 1, 2], [0, 1, 3]])
    alone = laplacian(Mesh(mesh.vertices, [[0, 1, 2]]))
    assert np.isfinite(laplacian(mesh).data).all()
    np.testing.assert_array_equal(laplacian(mesh).toarray(), alone.toarray())
    assert not gradient(mesh)[3:].toarray().any()
