"""Moving least squares and lattices: interpolation, the motions they reproduce, smoothness, what they leave alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.interpolate import BSpline

from morphlet import InputError, Mesh
from morphlet.editing.lattice import BENDING, Lattice
from morphlet.editing.method import Method, Pull
from morphlet.editing.moving_least_squares import MovingLeastSquares
from morphlet.editing.roi import Roi
from support import icosphere, noisy, random_rotation

BOX = np.array([[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
METHODS = [MovingLeastSquares(), MovingLeastSquares("similarity", 2.0), Lattice((5, 5, 5)), Lattice((4, 5, 6), "bernstein")]


def cloud(n, seed=0):
    return np.random.default_rng(seed).normal(size=(n, 3))


def cap(seed=0):
    """A region of a bumpy ball with a handle of several vertices."""
    mesh = noisy(3, 0.2, seed)
    handle = Roi.within(mesh, [0], 0.25, "edges").moving
    return Roi.within(mesh, handle, 0.8)


def whole(seed=0):
    """A region without anchors."""
    mesh = noisy(2, 0.2, seed)
    handle = np.array([40, 3, 7, 21, 100, 130])
    return Roi(mesh, handle, np.setdiff1d(np.arange(mesh.n_vertices), handle))


def brute_force(kind, alpha, p, q, x):
    """Eqs. 1-2 at one place, as they are written, by a singular value decomposition."""
    w = np.linalg.norm(p - x, axis=1) ** (-2 * alpha)
    centre, goal = w @ p / w.sum(), w @ q / w.sum()
    a, b = p - centre, q - goal
    u, s, vt = np.linalg.svd((w[:, None] * a).T @ b)
    signs = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    turn = (vt.T * signs) @ u.T
    scale = s @ signs / (w @ np.sum(a**2, axis=1)) if kind == "similarity" else 1.0
    return scale * turn @ (x - centre) + goal


@pytest.mark.parametrize("kind", ["rigid", "similarity"])
@pytest.mark.parametrize("alpha", [0.7, 1.0, 2.0])
def test_eqs_1_and_2_as_they_are_written(kind, alpha):
    p, x = cloud(9), cloud(30, 1)
    q = p + 0.5 * cloud(9, 2)
    found = MovingLeastSquares(kind, alpha).field(p, x)(q)
    np.testing.assert_allclose(found, [brute_force(kind, alpha, p, q, point) for point in x], atol=1e-10)


def test_the_energy_of_eq_1_is_least():
    """No small turn or shift about the answer does better."""
    p, x = cloud(7), np.array([0.3, -0.2, 0.5])
    q = p + 0.4 * cloud(7, 2)
    w = np.linalg.norm(p - x, axis=1) ** -2.0
    near = np.vstack([x, x + 1e-6 * np.eye(3)])
    to = np.array([brute_force("rigid", 1.0, p, q, x)])
    np.testing.assert_allclose(MovingLeastSquares().field(p, near[:1])(q), to, atol=1e-12)
    centre, goal = w @ p / w.sum(), w @ q / w.sum()
    u, _, vt = np.linalg.svd((w[:, None] * (p - centre)).T @ (q - goal))
    best = (vt.T * [1, 1, np.sign(np.linalg.det(u @ vt))]) @ u.T
    energy = lambda turn, shift: w @ np.sum(((p - centre) @ turn.T + goal + shift - q) ** 2, axis=1)  # noqa: E731
    for seed in range(20):
        axis, angle = cloud(1, seed)[0], 0.01
        k = angle * np.cross(np.eye(3), axis / np.linalg.norm(axis))
        other = best @ (np.eye(3) + k + k @ k / 2)
        assert energy(other, 0) > energy(best, 0)
        assert energy(best, 0.01 * axis) > energy(best, 0)


@given(st.integers(0, 1000), st.sampled_from(["rigid", "similarity"]), st.floats(0.5, 3))
@settings(max_examples=30)
def test_controls_reach_their_targets(seed, kind, alpha):
    """The paper's weight of 1 at a control point would not."""
    p, q = cloud(12, seed), cloud(12, seed + 1)
    np.testing.assert_allclose(MovingLeastSquares(kind, alpha).field(p, p)(q), q, atol=1e-12)


@pytest.mark.parametrize("distance", [1e-3, 1e-6, 1e-9, 1e-200])
def test_near_a_control_places_go_near_its_target(distance):
    p, q = cloud(5), cloud(5, 1)
    found = MovingLeastSquares(alpha=2.0).field(p, p[[2]] + distance * np.array([[0.6, 0.0, 0.8]]))(q)
    assert np.linalg.norm(found - q[2]) < 5 * distance + 1e-12


@given(st.integers(0, 1000), st.sampled_from(["rigid", "similarity"]))
@settings(max_examples=30)
def test_rigid_motions_are_reproduced(seed, kind):
    p, x, turn = cloud(6, seed), cloud(20, seed + 1), random_rotation(seed)
    found = MovingLeastSquares(kind).field(p, x)(p @ turn.T + 3)
    np.testing.assert_allclose(found, x @ turn.T + 3, atol=1e-9)


def test_only_similarities_scale():
    p, x, turn = cloud(6), cloud(20, 1), random_rotation(5)
    q = 2.5 * p @ turn.T - 1
    np.testing.assert_allclose(MovingLeastSquares("similarity").field(p, x)(q), 2.5 * x @ turn.T - 1, atol=1e-9)
    assert np.abs(MovingLeastSquares("rigid").field(p, x)(q) - 2.5 * x @ turn.T + 1).max() > 0.1


def test_a_half_turn_is_no_trouble():
    p, x = cloud(6), cloud(20, 1)
    np.testing.assert_allclose(MovingLeastSquares().field(p, x)(p * [-1, -1, 1]), x * [-1, -1, 1], atol=1e-9)


@pytest.mark.parametrize("kind", ["rigid", "similarity"])
def test_one_control_shifts_all(kind):
    found = MovingLeastSquares(kind).field([[1, 2, 3]], cloud(5))(np.array([[1.0, 2.0, 5.0]]))
    np.testing.assert_allclose(found, cloud(5) + np.array([0, 0, 2]), atol=1e-12)


def test_controls_on_a_line_turn_no_more_than_they_must():
    """About the line itself nothing is known: the turn of least angle has its axis across the line."""
    p, x = np.outer(np.arange(4.0), [1, 0, 0]), np.array([[1.5, 0.0, 1.0], [1.5, 1.0, 0.0]])
    found = MovingLeastSquares().field(p, x)(p @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]))
    np.testing.assert_allclose(found, [[0, 1.5, 1], [-1, 1.5, 0]], atol=1e-9)


def test_controls_at_one_place_share_it():
    p = np.array([[0.0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]])
    found = MovingLeastSquares().field(p, p[:1])(p + np.array([[0, 0, 1.0], [0, 0, 3.0], [0, 0, 0], [0, 0, 0]]))
    np.testing.assert_allclose(found, [[0, 0, 2]], atol=1e-12)


def test_alpha_is_how_local_it_is():
    """Midway between a control that moves and nearer ones that stay, a larger alpha moves less."""
    p = np.array([[2.0, 0, 0], [-1, 0, 0], [-1, 1, 0], [-1, 0, 1]])
    q = p + np.array([[0, 0, 1.0], [0, 0, 0], [0, 0, 0], [0, 0, 0]])
    way = [MovingLeastSquares(alpha=alpha).field(p, np.zeros((1, 3)))(q)[0, 2] for alpha in (0.5, 1.0, 2.0, 4.0)]
    assert (np.diff(way) < 0).all()


@pytest.mark.parametrize(("kind", "alpha", "message"), [("affine", 1.0, "as kind; found 'affine'"), ("rigid", 0.0, "alpha above 0")])
def test_bad_moving_least_squares(kind, alpha, message):
    with pytest.raises(InputError, match=message):
        MovingLeastSquares(kind, alpha)


def test_bad_controls():
    with pytest.raises(InputError, match="at least one control point"):
        MovingLeastSquares().field(np.zeros((0, 3)), cloud(3))
    with pytest.raises(InputError, match="targets of shape"):
        MovingLeastSquares().field(cloud(4), cloud(3))(cloud(3))


@pytest.mark.parametrize("method", METHODS)
def test_no_pull_no_move(method):
    roi = cap()
    found = method.prepare(roi)(Pull(roi.mesh.vertices[roi.handle]))
    np.testing.assert_allclose(found, roi.mesh.vertices[roi.moving], atol=1e-14)


@pytest.mark.parametrize("method", METHODS)
def test_without_anchors_a_shift_is_a_shift(method):
    roi = whole()
    found = method.prepare(roi)(Pull(roi.mesh.vertices[roi.handle] + [1, 2, 3]))
    np.testing.assert_allclose(found, roi.mesh.vertices + np.array([1, 2, 3]), atol=1e-6)


@pytest.mark.parametrize("method", METHODS)
def test_turning_all_turns_the_answer(method):
    """By quarter turns, which a lattice along the axes knows; moving least squares know all of them."""
    roi, turn = cap(), np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    if isinstance(method, Lattice):
        method = Lattice((5, 5, 5), method.basis)
    targets = roi.mesh.vertices[roi.handle] * 1.3 + [0.1, 0.2, 0]
    turned = Roi(roi.mesh.with_vertices(roi.mesh.vertices @ turn.T), roi.handle, roi.free)
    expected = method.prepare(roi)(Pull(targets)) @ turn.T
    np.testing.assert_allclose(method.prepare(turned)(Pull(targets @ turn.T)), expected, atol=1e-8)


@pytest.mark.parametrize("method", METHODS)
def test_size_does_not_matter(method):
    roi = cap()
    targets = roi.mesh.vertices[roi.handle] + [0.1, 0.2, 0.3]
    large = Roi(roi.mesh.with_vertices(1e6 * roi.mesh.vertices), roi.handle, roi.free)
    expected = method.prepare(roi)(Pull(targets))
    np.testing.assert_allclose(method.prepare(large)(Pull(1e6 * targets)) / 1e6, expected, atol=1e-9)


@pytest.mark.parametrize("method", METHODS)
def test_it_is_a_method_and_checks_its_targets(method):
    assert isinstance(method, Method)
    prepared = method.prepare(cap())
    with pytest.raises(InputError, match="targets"):
        prepared(Pull(np.zeros((1, 3))))


def test_moving_least_squares_hold_the_handle_exactly_and_join_the_rim():
    """Free vertices next to anchors move less the nearer they are: by a third of the pull at most on this coarse ball."""
    roi = cap()
    rest, pull = roi.mesh.vertices, np.array([0.0, 0.0, 0.6])
    targets = rest[roi.handle] + pull
    found = MovingLeastSquares().prepare(roi)(Pull(targets))
    np.testing.assert_array_equal(found[np.searchsorted(roi.moving, roi.handle)], targets)
    way = np.linalg.norm(found - rest[roi.moving], axis=1)
    beside = np.isin(roi.moving, np.setdiff1d(roi.free, roi.shrunk(1).free))
    assert way[beside].mean() < 0.2 < way[~beside].mean()


def test_a_handle_in_any_order():
    mesh = cap().mesh
    free = cap().free
    handle = cap().handle
    for method in METHODS:
        one = method.prepare(Roi(mesh, handle, free))(Pull(mesh.vertices[handle] * 1.2))
        other = method.prepare(Roi(mesh, handle[::-1], free))(Pull(mesh.vertices[handle[::-1]] * 1.2))
        np.testing.assert_allclose(one, other, atol=1e-9)


@pytest.mark.parametrize("basis", ["bspline", "bernstein"])
@pytest.mark.parametrize("shape", [(2, 2, 2), (3, 4, 5), (7, 2, 6)])
def test_affine_displacements_of_the_control_points_deform_by_that_map(basis, shape):
    cage, map_, mesh = Lattice(shape, basis), cloud(3, 4), noisy(2, 0.2)
    box = np.stack([mesh.vertices.min(axis=0) - 0.1, mesh.vertices.max(axis=0) + 0.3])
    places = cage.points(box)
    found = cage.deform(mesh, places @ map_.T + 0.7 - places, box)
    np.testing.assert_allclose(found.vertices, mesh.vertices @ map_.T + 0.7, atol=1e-12)


@pytest.mark.parametrize("basis", ["bspline", "bernstein"])
def test_control_displacements_by_the_formula(basis):
    """The sum over all control points of the products of three basis functions."""
    cage, shifts, mesh = Lattice((6, 5, 4), basis), cloud(6 * 5 * 4).reshape(6, 5, 4, 3), Mesh(0.3 * cloud(20, 1), [[0, 1, 2]])
    found = cage.deform(mesh, shifts, BOX).vertices
    inside = np.abs(mesh.vertices).max(axis=1) <= 1
    assert inside.sum() > 15
    expected = np.array(mesh.vertices)
    for v in np.flatnonzero(inside):
        weights = []
        for a, n in enumerate(cage.shape):
            degree = n - 1 if basis == "bernstein" else 3
            knots = np.concatenate([np.zeros(degree), np.linspace(0, 1, n - degree + 1), np.ones(degree)])
            share = (mesh.vertices[v, a] + 1) / 2
            weights.append([BSpline(knots, np.eye(n)[i], degree)(share) for i in range(n)])
        expected[v] += np.einsum("i,j,k,ijkd->d", *weights, shifts)
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_bernstein_by_hand():
    """B_1^2(s) = 2 s (1 - s), in the middle of the other axes 1/4 each."""
    cage, shifts = Lattice((3, 3, 3), "bernstein"), np.zeros((3, 3, 3, 3))
    shifts[1, 1, 1] = [0, 0, 1]
    mesh = Mesh([[0.25, 0.5, 0.5], [0, 0.5, 0.5], [0.5, 0.5, 0.5]], [[0, 1, 2]])
    found = cage.deform(mesh, shifts, [[0, 0, 0], [1, 1, 1]])
    np.testing.assert_allclose(found.vertices[:, 2] - 0.5, [0.375 * 0.25, 0, 0.125], atol=1e-15)


def test_b_splines_are_local():
    """A control point at one end does not reach the other."""
    cage, shifts = Lattice((9, 4, 4)), np.zeros((9, 4, 4, 3))
    shifts[0] = 1
    mesh = Mesh(np.stack([np.linspace(0, 1, 13), np.full(13, 0.5), np.full(13, 0.5)], axis=1), [[0, 1, 2]])
    way = cage.deform(mesh, shifts, [[0, 0, 0], [1, 1, 1]]).vertices[:, 0] - mesh.vertices[:, 0]
    assert way[0] == pytest.approx(1)
    assert (way[3:] == 0).all()


@pytest.mark.parametrize("basis", ["bspline", "bernstein"])
@pytest.mark.parametrize("planes", [1, 2, 3])
def test_fixed_planes_join_box_and_outside(basis, planes):
    """k + 1 still planes: the shift leaves a face of the box with the power k + 1 of the distance from it."""
    cage, shifts = Lattice((8, 8, 8), basis, planes), np.zeros((8, 8, 8, 3))
    shifts[planes:-planes, planes:-planes, planes:-planes] = 1
    depth = 2.0 ** -np.arange(7, 11)
    mesh = Mesh(np.stack([depth, np.full(4, 0.4), np.full(4, 0.6)], axis=1), [[0, 1, 2]])
    way = cage.deform(mesh, shifts, [[0, 0, 0], [1, 1, 1]]).vertices[:, 0] - depth
    np.testing.assert_allclose(np.log2(way[:-1] / way[1:]), planes, atol=0.12)


def test_outside_the_box_nothing_moves():
    mesh = icosphere(3)
    found = Lattice((4, 4, 4)).deform(mesh, np.ones((4, 4, 4, 3)), [[0, -1, -1], [1, 1, 1]])
    left = mesh.vertices[:, 0] < 0
    np.testing.assert_array_equal(found.vertices[left], mesh.vertices[left])
    np.testing.assert_allclose(found.vertices[~left], mesh.vertices[~left] + 1, atol=1e-14)


@pytest.mark.parametrize("shape", [(8, 8, 8), (6, 7, 8)])
def test_a_pulled_handle_arrives_and_the_rim_stays(shape):
    """Within 1 % of the pull where there are enough control points."""
    roi = cap()
    targets = roi.mesh.vertices[roi.handle] + [0, 0, 0.5]
    found = Lattice(shape).prepare(roi)(Pull(targets))
    miss = found[np.searchsorted(roi.moving, roi.handle)] - targets
    assert np.abs(miss).max() < 0.01
    smooth = found - roi.mesh.vertices[roi.moving]
    last = np.isin(roi.moving, np.setdiff1d(roi.free, roi.shrunk(1).free))
    assert np.linalg.norm(smooth[last], axis=1).mean() < 0.1


def test_a_single_handle_vertex_arrives_exactly():
    mesh = noisy(3, 0.2)
    roi = Roi.within(mesh, [0], 0.9)
    found = Lattice((7, 7, 7)).prepare(roi)(Pull(mesh.vertices[[0]] + [0.3, 0.2, 0.1]))
    np.testing.assert_allclose(found[np.searchsorted(roi.moving, 0)], mesh.vertices[0] + [0.3, 0.2, 0.1], atol=2e-3)


def test_without_anchors_an_affine_pull_is_affine():
    """It neither bends nor misses: only the tiny weight of first differences is in the way, 3e-5 on a mesh of size 2."""
    roi, map_ = whole(), np.eye(3) + 0.2 * cloud(3)
    for method in (Lattice((5, 4, 6)), Lattice((4, 4, 3), "bernstein")):
        found = method.prepare(roi)(Pull(roi.mesh.vertices[roi.handle] @ map_.T))
        np.testing.assert_allclose(found, roi.mesh.vertices @ map_.T, atol=1e-4)


def test_fixed_planes_stay_when_a_handle_is_pulled():
    """Vertices at the sides of the box do not move, whatever the handle does."""
    roi = cap()
    found = Lattice((9, 9, 9), fixed_planes=1).prepare(roi)(Pull(roi.mesh.vertices[roi.handle] + [0, 0, 0.3]))
    rest = roi.mesh.vertices[roi.moving]
    box = roi.mesh.vertices[np.concatenate([roi.moving, roi.rim])]
    at_side = ((rest == box.min(axis=0)) | (rest == box.max(axis=0))).any(axis=1)
    assert at_side.any()
    np.testing.assert_allclose(found[at_side], rest[at_side], atol=1e-14)


def test_a_flat_mesh_has_a_lattice():
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0), indexing="ij")
    quads = [(5 * i + j, 5 * i + j + 5, 5 * i + j + 6, 5 * i + j + 1) for i in range(4) for j in range(4)]
    faces = [[a, b, c] for a, b, c, d in quads] + [[a, c, d] for a, b, c, d in quads]
    mesh = Mesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces)
    roi = Roi.within(mesh, [12], 1.5)
    found = Lattice((4, 4, 4)).prepare(roi)(Pull(mesh.vertices[[12]] + [0, 0, 1]))
    assert found[np.searchsorted(roi.moving, 12), 2] == pytest.approx(1, abs=0.02)
    still = Lattice((3, 3, 3)).deform(mesh, np.zeros((3, 3, 3, 3)))
    np.testing.assert_array_equal(still.vertices, mesh.vertices)


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("basis", ["bspline", "bernstein"])
def test_bending_is_measured_in_one_length_along_all_axes(axis, basis):
    """The square of a coordinate, in units of the longest side, has the second derivative 2 wherever it can be told."""
    cage, box = Lattice((6, 5, 7), basis), np.array([[0.0, 0.0, 0.0], [4.0, 1.0, 2.0]])
    displaced = (cage.points(box)[..., axis] / 4) ** 2
    places = [6, 5, 7]
    rows = (places[axis] - 2) * np.prod(np.delete(places, axis))
    np.testing.assert_allclose(displaced.ravel() @ cage._stiffness(box) @ displaced.ravel(), BENDING * 4 * rows, rtol=5e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((1, 4, 4),), "at least 2 control points along each axis"),
        (((4, 4),), "shape of shape .3."),
        (((4, 4, 4), "spline"), "as basis; found 'spline'"),
        (((4, 4, 4), "bspline", 2), "at least 5 control points along each axis; found shape .4, 4, 4. with 2 fixed"),
        (((4, 4, 4), "bspline", -1), "with -1 fixed planes"),
    ],
)
def test_bad_lattices(arguments, message):
    with pytest.raises(InputError, match=message):
        Lattice(*arguments)


def test_bad_displacements():
    cage, mesh = Lattice((4, 4, 4), fixed_planes=1), icosphere(1)
    with pytest.raises(InputError, match=r"displacements of shape \(4, 4, 4, 3\)"):
        cage.deform(mesh, np.zeros((3, 4, 4, 3)))
    with pytest.raises(InputError, match="fixed planes that stay; found displacements on the outermost 1 planes"):
        cage.deform(mesh, np.ones((4, 4, 4, 3)))
    with pytest.raises(InputError, match="a box with its lower corner first"):
        cage.deform(mesh, np.zeros((4, 4, 4, 3)), [[1, 0, 0], [0, 1, 1]])
