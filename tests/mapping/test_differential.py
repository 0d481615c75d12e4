"""Surfaces rebuilt from differential coordinates: exact cases, invariances, and what is refused."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.errors import InputError
from morphlet.mapping.differential import laplacian_warp, reconstruct
from morphlet.numerics.unit_sphere import icosphere, rotations_about
from morphlet.sphere.quality import certificate
from morphlet.surface.operators import laplacian, mass

POINTS, FACES = icosphere(2)
BALL = Mesh(POINTS * [1.0, 1.5, 0.7], FACES)
SOME = np.array([0, 11, 30, 77, 160])
vectors = st.tuples(*[st.floats(-5, 5)] * 3)


def test_known_places_of_the_mesh_itself_give_the_mesh():
    np.testing.assert_allclose(reconstruct(BALL, SOME, BALL.vertices[SOME]).vertices, BALL.vertices, atol=1e-9)


@given(vectors)
def test_a_shift_of_all_known_places_shifts_the_mesh(shift):
    np.testing.assert_allclose(reconstruct(BALL, SOME, BALL.vertices[SOME] + shift).vertices, BALL.vertices + shift, atol=1e-8)


@given(vectors, st.floats(0.01, 100))
def test_it_turns_and_scales_with_the_mesh(vector, scale):
    R = rotations_about(np.array([vector]))[0]
    places = BALL.vertices[SOME] + np.arange(15).reshape(5, 3) / 20
    moved = reconstruct(BALL.with_vertices(scale * BALL.vertices @ R.T), SOME, scale * places @ R.T)
    np.testing.assert_allclose(moved.vertices, scale * reconstruct(BALL, SOME, places).vertices @ R.T, atol=1e-8 * scale)


def test_it_is_the_least_of_the_energy():
    """No random change lowers |L X - L V|^2 / mass + w |x - place|^2, and the change is of second order."""
    places = BALL.vertices[SOME] + 0.3
    X = reconstruct(BALL, SOME, places, np.full(5, 2.0)).vertices
    L, m = laplacian(BALL), mass(BALL).diagonal()[:, None]
    w = 2 * (L @ (L / m)).diagonal().mean()

    def energy(Y):
        return ((L @ (Y - BALL.vertices)) ** 2 / m).sum() + w * ((Y[SOME] - places) ** 2).sum()

    change = np.random.default_rng(0).normal(size=X.shape)
    rises = [energy(X + h * change) - energy(X) for h in (1e-3, 1e-4)]
    assert rises[0] == pytest.approx(100 * rises[1], rel=1e-3)
    assert rises[1] > 0


def test_a_larger_weight_meets_the_places_more_closely():
    places = BALL.vertices[SOME] + 0.3 * np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 0, 1], [0, -1, 0]])
    errors = [np.abs(reconstruct(BALL, SOME, places, np.full(5, w)).vertices[SOME] - places).max() for w in (0.1, 10, 1000)]
    assert errors[0] > 5 * errors[1] > 25 * errors[2]


def test_a_small_warp_of_the_sphere_meets_its_goals_without_folds_and_a_large_one_folds():
    goals = POINTS[[5]] @ rotations_about(np.array([[0.2, 0.1, 0.0]]))[0].T
    fixed = [0, 11, 30]
    warped = laplacian_warp(POINTS, BALL.topology, [5, *fixed], np.vstack([goals, POINTS[fixed]]))
    assert certificate(warped, FACES).inverted == 0
    assert np.abs(warped[5] - goals[0]).max() < 0.05
    crossed = laplacian_warp(POINTS, BALL.topology, [5, 0, 11, 30], np.vstack([POINTS[[0]], POINTS[[5]], POINTS[[30]], POINTS[[11]]]))
    assert certificate(crossed, FACES).inverted > 0


def test_a_part_without_a_known_vertex_is_refused():
    two = Mesh(np.vstack([POINTS, POINTS + 5]), np.vstack([FACES, FACES + len(POINTS)]))
    with pytest.raises(InputError, match="needed a known vertex on each part of the mesh; found 1 parts without"):
        reconstruct(two, [0], POINTS[[0]])


def test_a_vertex_without_faces_stays():
    lone = Mesh(np.vstack([BALL.vertices, [[7, 8, 9]]]), FACES)
    np.testing.assert_allclose(reconstruct(lone, SOME, BALL.vertices[SOME] + 1).vertices[-1], [7, 8, 9], atol=1e-12)


@pytest.mark.parametrize(
    ("vertices", "places", "weight", "message"),
    [
        ([], np.zeros((0, 3)), None, "needed known vertices, each once; found 0"),
        ([3, 3], np.zeros((2, 3)), None, "found 2, 1 different"),
        ([999], np.zeros((1, 3)), None, "needed indices from 0 to 161 in vertices"),
        ([3], np.full((1, 3), np.nan), None, "needed finite numbers in places"),
        ([3], np.zeros((2, 3)), None, r"needed places of shape \(1, 3\)"),
        ([3], np.zeros((1, 3)), [0.0], "needed positive weights"),
    ],
)
def test_unfit_places_are_refused(vertices, places, weight, message):
    with pytest.raises(InputError, match=message):
        reconstruct(BALL, vertices, places, weight)
