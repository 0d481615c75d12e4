"""The camera: a rotation, a tight frame, and a sensible side."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import InputError, Mesh
from morphlet.report.camera import Camera, view

CUBE = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
QUADS = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
CUBE_FACES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])


def box(centre, half):
    return Mesh(CUBE * half + centre, CUBE_FACES)


def joined(*meshes):
    offsets = np.cumsum([0] + [mesh.n_vertices for mesh in meshes[:-1]])
    faces = [mesh.faces + offset for mesh, offset in zip(meshes, offsets, strict=True)]
    return Mesh(np.concatenate([mesh.vertices for mesh in meshes]), np.concatenate(faces))


def animal(up):
    """A body along its front direction, four legs, a head in front and a tail behind that hangs in the air."""
    legs = [box((x, -2, z), (0.1, 1.2, 0.1)) for x in (-0.5, 0.5) for z in (-1.5, 1.5)]
    y_up = joined(box((0, 0, 0), (0.6, 0.8, 2)), box((0, 1.5, 2.5), (0.3, 0.4, 0.7)), box((0, 0.5, -2.5), (0.1, 0.1, 0.6)), *legs)
    turn = {"y": np.eye(3), "z": np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])}[up]
    return y_up.with_vertices(y_up.vertices @ turn)


@pytest.mark.parametrize(("up", "upward", "front"), [("y", (0, 1, 0), (0, 0, 1)), ("z", (0, 0, 1), (0, -1, 0))])
def test_an_animal_stands_upright_seen_from_the_front_left_quarter(up, upward, front):
    right, above, toward = view(animal(up)).axes
    assert above @ upward > 0.9
    assert 0.3 < toward @ front < 0.7
    assert abs(right @ front) > 0.8, "its length lies across the picture"


def test_a_chosen_axis_is_kept():
    assert view(animal("y"), "z").axes[1] @ (0, 0, 1) > 0.9
    assert view(animal("y"), "x").axes[1] @ (1, 0, 0) > 0.9


def test_a_person_with_spread_arms_is_seen_from_the_front():
    person = joined(box((0, 2, 0), (0.5, 2, 0.3)), box((0, 3, 0), (2, 0.2, 0.2)))
    assert view(person).axes[2] @ (0, 0, 1) > 0.7


def test_the_frame_is_tight_and_ignores_vertices_without_faces():
    mesh = Mesh([[0, 0, 0], [4, 0, 0], [0, 2, 0], [99, 99, 99]], [[0, 1, 2]])
    camera = Camera(np.eye(3), np.zeros(3), np.ones(2)).framed(mesh)
    np.testing.assert_allclose(camera.centre, [2, 1, 0])
    np.testing.assert_allclose(camera.extent, [2, 1])


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(["auto", "x", "y", "z"]))
def test_any_mesh_gets_a_rotation_that_frames_it_and_moves_with_it(seed, up):
    points = np.random.default_rng(seed).normal(size=(8, 3)) * [3, 2, 1]
    mesh = Mesh(points, CUBE_FACES)
    camera = view(mesh, up)
    np.testing.assert_allclose(camera.axes @ camera.axes.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(camera.axes) > 0
    seen = camera.project(mesh.vertices)[:, :2]
    np.testing.assert_allclose(np.abs(seen).max(axis=0), camera.extent, rtol=1e-9)
    moved = view(mesh.with_vertices(2 * points + [5, -3, 1]), up)
    np.testing.assert_allclose(moved.axes, camera.axes, atol=1e-7)
    np.testing.assert_allclose(moved.extent, 2 * camera.extent, rtol=1e-6)


def test_a_mirror_is_no_camera():
    with pytest.raises(InputError, match="right-handed orthonormal axes"):
        Camera(np.diag([1.0, 1.0, -1.0]), np.zeros(3), np.ones(2))


def test_a_flat_mesh_and_an_empty_one_have_a_view():
    flat = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert np.isfinite(view(flat).extent).all()
    assert view(Mesh(np.zeros((0, 3)), np.zeros((0, 3)))).axes.shape == (3, 3)


def test_a_camera_survives_a_journey():
    camera = view(animal("y"))
    again = pickle.loads(pickle.dumps(camera))
    np.testing.assert_array_equal(again.axes, camera.axes)
    assert not again.axes.flags.writeable
