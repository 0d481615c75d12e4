"""Linear editing: by hand, what each energy leaves free, soft handles, and regions that nothing holds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.editing.linear import DualLaplacian, Laplacian, SimilarityLaplacian
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError, MeshError, SolveError
from morphlet.surface.operators import laplacian, mass
from support import beside, blob, icosphere, random_rotation

METHODS = [
    *(Laplacian(order, weights) for weights in ("cotangent", "clamped") for order in (1, 2)),
    SimilarityLaplacian(),
    DualLaplacian(),
    DualLaplacian(3),
]
each_method = pytest.mark.parametrize("method", METHODS, ids=str)


def region(mesh):
    """Pull the top, keep the bottom."""
    z = mesh.vertices[:, 2]
    return Roi(mesh, np.nonzero(z > 0.6)[0], np.nonzero(abs(z) <= 0.6)[0])


def deformed(roi, positions):
    whole = np.array(roi.mesh.vertices)
    whole[roi.moving] = positions
    return whole


BALL = region(icosphere(2))
ONE_HANDLE = Roi(BALL.mesh, BALL.handle, np.union1d(BALL.free, BALL.anchors))
"""Without anchors: all that the energy leaves free comes out exactly."""


@each_method
def test_they_are_methods(method):
    assert isinstance(method, Method)
    assert isinstance(method.prepare(BALL), Prepared)


@each_method
def test_a_handle_that_stays_moves_nothing(method):
    for roi in (BALL, region(blob(2))):
        np.testing.assert_array_equal(method.prepare(roi)(Pull(roi.mesh.vertices[roi.handle])), roi.mesh.vertices[roi.moving])


@each_method
def test_handle_on_its_targets_and_anchors_in_place(method):
    targets = BALL.mesh.vertices[BALL.handle] + [0.3, 0, 0.5]
    out = method.prepare(BALL)(Pull(targets))
    np.testing.assert_array_equal(out[np.searchsorted(BALL.moving, BALL.handle)], targets)
    assert np.linalg.norm(out - BALL.mesh.vertices[BALL.moving], axis=1).min() > 1e-4


@each_method
def test_without_anchors_all_follow_a_translation(method):
    out = method.prepare(ONE_HANDLE)(Pull(ONE_HANDLE.mesh.vertices[ONE_HANDLE.handle] + np.array([1, -2, 3])))
    np.testing.assert_allclose(out, ONE_HANDLE.mesh.vertices + np.array([1, -2, 3]), atol=1e-8)


@pytest.mark.parametrize("method", METHODS[:6], ids=str)
def test_answers_add_up(method):
    prepared, rest = method.prepare(BALL), BALL.mesh.vertices[BALL.moving]
    rng = np.random.default_rng(0)
    a, b = rng.normal(size=(2, len(BALL.handle), 3))
    at = [prepared(Pull(BALL.mesh.vertices[BALL.handle] + shift)) - rest for shift in (a, b, 2 * a - b)]
    np.testing.assert_allclose(at[2], 2 * at[0] - at[1], atol=1e-9)


@pytest.mark.parametrize("method", [*METHODS[:2], *METHODS[4:]], ids=str)
@settings(deadline=None, max_examples=5)
@given(seed=st.integers(0, 1000))
def test_answers_turn_with_the_mesh(method, seed):
    turn, shift = random_rotation(seed), np.array([[0.2, 0.5, -0.1]])
    other = Roi(BALL.mesh.with_vertices(BALL.mesh.vertices @ turn.T + 5), BALL.handle, BALL.free)
    here = method.prepare(BALL)(Pull(BALL.mesh.vertices[BALL.handle] * 1.3 + shift))
    there = method.prepare(other)(Pull((BALL.mesh.vertices[BALL.handle] * 1.3 + shift) @ turn.T + 5))
    np.testing.assert_allclose(there, here @ turn.T + 5, atol=1e-9)


@each_method
def test_the_rest_of_the_mesh_does_not_matter(method):
    """A far part, and vertices in another order."""
    roi, targets = BALL, BALL.mesh.vertices[BALL.handle] + [0, 0.4, 0.1]
    here = deformed(roi, method.prepare(roi)(Pull(targets)))
    order = np.random.default_rng(1).permutation(roi.mesh.n_vertices)
    place = np.argsort(order)
    other = beside(Mesh(roi.mesh.vertices[order], place[roi.mesh.faces]), blob(1))
    there = deformed(
        Roi(other, place[roi.handle], place[roi.free]), method.prepare(Roi(other, place[roi.handle], place[roi.free]))(Pull(targets))
    )
    np.testing.assert_allclose(there[: len(order)], here[order], atol=1e-9)


@pytest.mark.parametrize("order", [1, 2])
def test_laplacian_against_the_whole_matrix(order):
    roi = region(blob(2))
    targets = roi.mesh.vertices[roi.handle] + [0, 0.4, 0.1]
    matrix = laplacian(roi.mesh).toarray()
    if order == 2:
        matrix = matrix @ np.diag(1 / mass(roi.mesh).diagonal()) @ matrix
    shift = np.zeros_like(roi.mesh.vertices)
    shift[roi.handle] = targets - roi.mesh.vertices[roi.handle]
    shift[roi.free] = np.linalg.solve(matrix[np.ix_(roi.free, roi.free)], -(matrix @ shift)[roi.free])
    np.testing.assert_allclose(Laplacian(order).prepare(roi)(Pull(targets)), (roi.mesh.vertices + shift)[roi.moving], atol=1e-10)


def test_harmonic_displacements_of_clamped_weights_stay_between():
    roi = region(blob(2))
    up = Laplacian(1, "clamped").prepare(roi)(Pull(roi.mesh.vertices[roi.handle] + [0, 0, 1])) - roi.mesh.vertices[roi.moving]
    assert up[:, 2].min() >= 0
    assert up[:, 2].max() <= 1


@settings(deadline=None, max_examples=10)
@given(st.floats(0.2, 5), st.integers(0, 100))
def test_similarity_leaves_scaling_and_translation_free(scale, seed):
    shift = np.random.default_rng(seed).normal(size=3)
    out = SimilarityLaplacian().prepare(ONE_HANDLE)(Pull(scale * ONE_HANDLE.mesh.vertices[ONE_HANDLE.handle] + shift))
    np.testing.assert_allclose(out, scale * ONE_HANDLE.mesh.vertices + shift, atol=1e-6)


def test_similarity_leaves_small_rotations_free_and_laplacian_does_not():
    spin = np.array([[0, -0.2, 0.1], [0.2, 0, 0.3], [-0.1, -0.3, 0]])
    targets = ONE_HANDLE.mesh.vertices[ONE_HANDLE.handle] @ (np.eye(3) + spin).T
    expected = ONE_HANDLE.mesh.vertices @ (np.eye(3) + spin).T
    np.testing.assert_allclose(SimilarityLaplacian().prepare(ONE_HANDLE)(Pull(targets)), expected, atol=1e-6)
    assert np.abs(Laplacian(2).prepare(ONE_HANDLE)(Pull(targets)) - expected).max() > 0.05


def test_dual_heights_follow_a_rotation_when_iterated():
    turn = random_rotation(3)
    targets, expected = ONE_HANDLE.mesh.vertices[ONE_HANDLE.handle] @ turn.T, ONE_HANDLE.mesh.vertices @ turn.T
    errors = [np.abs(DualLaplacian(k).prepare(ONE_HANDLE)(Pull(targets)) - expected).max() for k in (0, 10, 100)]
    assert errors[1] < 0.7 * errors[0]
    assert errors[2] < 0.1 * errors[0]


def test_dual_iterations_are_told():
    seen = []
    DualLaplacian(4).prepare(BALL)(Pull(BALL.mesh.vertices[BALL.handle] + [0, 0, 1]), seen.append)
    assert [step.iteration for step in seen] == [0, 1, 2, 3]
    assert seen[-1].progress == 1


@each_method
def test_soft_handles_come_nearer_with_weight(method):
    targets = BALL.mesh.vertices[BALL.handle] + [0, 0, 0.4]
    away = []
    for weight in (0.01, 1.0, 100.0):
        soft = Roi(BALL.mesh, BALL.handle, BALL.free, np.full(len(BALL.handle), weight))
        out = method.prepare(soft)(Pull(targets))
        away.append(np.linalg.norm(out[np.searchsorted(soft.moving, soft.handle)] - targets, axis=1).max())
    assert away[0] > away[1] > away[2] > 0
    hard = method.prepare(BALL)(Pull(targets))
    np.testing.assert_allclose(out, hard, atol=0.05)


def test_one_soft_vertex_by_hand():
    """A pyramid's tip with weight w: its diagonal d (t - u) w = d (u - v) puts it at w / (1 + w) of the way."""
    tip = Mesh([[1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0], [0, 0, 1]], [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    out = Laplacian(1).prepare(Roi(tip, [4], [], [3.0]))(Pull([[0, 0, 3]]))
    np.testing.assert_allclose(out, [[0, 0, 1 + 2 * 0.75]], atol=1e-12)


@each_method
def test_everything_a_handle(method):
    roi = Roi(BALL.mesh, np.arange(BALL.mesh.n_vertices), [])
    np.testing.assert_array_equal(method.prepare(roi)(Pull(2 * BALL.mesh.vertices)), 2 * BALL.mesh.vertices)


@each_method
def test_a_loose_piece_is_refused(method):
    two = beside(icosphere(1), icosphere(1))
    with pytest.raises(MeshError, match=r"touch the handle or an anchor.*1 pieces of 42 vertices") as caught:
        method.prepare(Roi(two, np.arange(10), np.arange(20, 84)))
    assert caught.value.elements[0] == 42


def test_a_similarity_about_one_vertex_is_not_determined():
    ball = icosphere(1)
    with pytest.raises(SolveError, match="determines its deformation"):
        SimilarityLaplacian().prepare(Roi(ball, [0], np.arange(1, 42)))


@each_method
@pytest.mark.parametrize("targets", [np.zeros((2, 3)), [[np.nan] * 3] * len(BALL.handle)])
def test_bad_targets_are_refused(method, targets):
    with pytest.raises(InputError, match="targets"):
        method.prepare(BALL)(Pull(targets))


def test_bad_options_are_refused():
    with pytest.raises(InputError, match="order 1"):
        Laplacian(3)
    with pytest.raises(InputError, match="cotangent, clamped"):
        Laplacian(1, "uniform")
    with pytest.raises(InputError, match="iterations from 0"):
        DualLaplacian(-1)


def test_a_border_within_the_region():
    ball = icosphere(2)
    cut = Mesh(ball.vertices, ball.faces[np.abs(ball.vertices[ball.faces].mean(axis=1) - [0.9, 0, 0]).max(axis=1) > 0.4])
    roi = region(cut)
    roi = Roi(cut, roi.handle, roi.free[cut.topology.referenced[roi.free]])
    assert any(np.isin(loop, roi.free).any() for loop in cut.topology.boundary_loops)
    for method in METHODS:
        out = deformed(roi, method.prepare(roi)(Pull(cut.vertices[roi.handle] + [0, 0, 1])))
        assert np.isfinite(out).all()
        assert out[:, 2].max() < 2.5
