"""Gradient systems: affine maps come back exactly, parts and flat faces do no harm, the nearest turn is that of an SVD."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.motion.gradients import GradientSystem, adjacent_faces, tangent_frames, turned
from morphlet.surface.mesh import Topology
from morphlet.surface.operators import laplacian
from support import beside, blob, icosphere, random_rotation

BODY = blob(2)
FAR = np.array([5, 0, 0])
SYSTEM = GradientSystem.prepare(BODY, BODY.face_areas)
seeds = st.integers(0, 10**6)


def random(seed, *shape):
    return np.random.default_rng(seed).normal(size=shape)


def test_frames_are_orthonormal_tangents_and_counter_clockwise():
    frames = tangent_frames(BODY)
    np.testing.assert_allclose(frames @ frames.transpose(0, 2, 1), np.broadcast_to(np.eye(2), (BODY.n_faces, 2, 2)), atol=1e-14)
    np.testing.assert_allclose(np.cross(frames[:, 0], frames[:, 1]), BODY.face_normals, atol=1e-14)


def test_the_system_is_the_laplacian_when_faces_weigh_their_areas():
    difference = SYSTEM.gather @ SYSTEM.operator - laplacian(BODY)
    assert abs(difference).max() < 1e-13


@settings(max_examples=15)
@given(seeds)
def test_affine_maps_have_their_matrix_as_gradient_and_come_back(seed):
    matrix, offset = random(seed, 3, 3), random(seed + 1, 3)
    mapped = BODY.vertices @ matrix.T + offset
    gradients = SYSTEM.gradients(mapped)
    np.testing.assert_allclose(gradients, SYSTEM.frames @ matrix.T, atol=1e-12)
    centred = mapped - mapped.mean(axis=0) + BODY.vertices.mean(axis=0)
    np.testing.assert_allclose(SYSTEM.solve(gradients), centred, atol=1e-12)


@settings(max_examples=15)
@given(seeds)
def test_any_positions_come_back_whatever_the_weights(seed):
    system = GradientSystem.prepare(BODY, np.random.default_rng(seed).uniform(0.1, 10, BODY.n_faces))
    x = random(seed, BODY.n_vertices, 3)
    found = system.solve(system.gradients(x))
    np.testing.assert_allclose(found - found.mean(axis=0), x - x.mean(axis=0), atol=1e-10)


def test_gradients_that_fit_nothing_are_met_in_least_squares():
    wanted = random(3, BODY.n_faces, 2, 3)
    rest = (SYSTEM.gradients(SYSTEM.solve(wanted)) - wanted) * BODY.face_areas[:, None, None]
    assert abs(SYSTEM.operator.T @ rest.reshape(-1, 3)).max() < 1e-12


def test_each_part_and_each_lone_vertex_keeps_its_mean():
    both = beside(icosphere(1), icosphere(1).with_vertices(icosphere(1).vertices + FAR))
    mesh = Mesh(np.vstack([both.vertices, [[9, 9, 9]]]), both.faces)
    system = GradientSystem.prepare(mesh, mesh.face_areas)
    found = system.solve(3 * system.frames)
    np.testing.assert_allclose(found[:42], 3 * mesh.vertices[:42], atol=1e-12)
    np.testing.assert_allclose(found[42:84], 3 * (mesh.vertices[42:84] - [5, 0, 0]) + [5, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(found[84], [9, 9, 9])


@pytest.mark.parametrize("height", [0.0, 1e-15, 1e-12, 1e-9, 1e-6])
def test_flat_faces_and_slivers_leave_the_others_alone(height):
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0.4, 1, 0], [0.5, -height, 0], [0.5, -1, 0]], [[0, 1, 2], [1, 0, 3], [0, 4, 3], [3, 4, 1]])
    system = GradientSystem.prepare(mesh, mesh.face_areas)
    target = np.array(mesh.vertices) * [2, 3, 1]
    found = system.solve(system.gradients(target))
    np.testing.assert_allclose(found - found.mean(axis=0), target - target.mean(axis=0), atol=1e-7)


def test_nothing_but_flat_faces_stays():
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    system = GradientSystem.prepare(mesh, mesh.face_areas)
    np.testing.assert_array_equal(system.solve(system.gradients(5 * mesh.vertices)), mesh.vertices)


@settings(max_examples=15)
@given(seeds)
def test_the_nearest_turn_is_the_one_of_the_singular_vectors(seed):
    gradients, half = random(seed, 4, 2, 3), random(seed + 1, 4, 2, 2)
    shapes = half @ half.transpose(0, 2, 1) + 0.1 * np.eye(2)
    u, _, vt = np.linalg.svd(shapes @ gradients, full_matrices=False)
    np.testing.assert_allclose(turned(gradients, shapes, np.zeros((4, 2, 3))), shapes @ (u @ vt), atol=1e-9)


def test_what_has_no_nearest_turn_stays_as_before():
    before = random(0, 3, 2, 3)
    gradients = np.array([np.zeros((2, 3)), [[1, 2, 3], [2, 4, 6]], [[1, 0, 0], [0, 1, 0]]])
    found = turned(gradients, np.broadcast_to(np.eye(2), (3, 2, 2)), before)
    np.testing.assert_array_equal(found[:2], before[:2])
    np.testing.assert_allclose(found[2], [[1, 0, 0], [0, 1, 0]], atol=1e-15)


def test_a_turned_shape_is_found_again():
    rotation = random_rotation(4)
    turn = turned(SYSTEM.frames @ rotation.T, np.broadcast_to(np.eye(2), (BODY.n_faces, 2, 2)), SYSTEM.frames)
    np.testing.assert_allclose(turn, SYSTEM.frames @ rotation.T, atol=1e-13)


def test_neighbours_share_an_edge():
    assert adjacent_faces(Topology([[0, 1, 2], [2, 1, 3], [1, 2, 4]], 5)).tolist() == [[0, 1], [1, 2]]
    assert len(adjacent_faces(BODY.topology)) == len(BODY.topology.edges)
    assert adjacent_faces(Topology(np.zeros((0, 3), int), 0)).shape == (0, 2)
