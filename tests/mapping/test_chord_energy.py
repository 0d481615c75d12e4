"""The chord energy: derivatives by differences, single triangles by hand, the smoothed Jacobian, sweeps and damped steps."""

import numpy as np
import pytest

from mapping import stars
from morphlet.mapping import chord, metric
from morphlet.mapping.chord import Chord, Images
from morphlet.mapping.metric import MetricField, Source
from morphlet.mapping.polish import Goals, Polish
from morphlet.sphere import energy
from morphlet.sphere.embed import FINE_FLOOR
from morphlet.sphere.level import Level
from morphlet.sphere.locate import Locator
from morphlet.sphere.map import SphericalMap
from support import blob, exact_signs, icosphere, positive_sphere

TRIANGLE = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]])
HALF, DELTA = 0.5, 0.1


def one_triangle(corners: np.ndarray, tau: float = HALF) -> float:
    """The term of a right triangle whose corners went to `corners`, on a surface that looks along z; weight 1."""
    k0, k1, k2, area = energy.triangle_reference(2.0, 1.0, 1.0, 0.0)
    source = Source(np.array([[0, 1, 2]]), np.array([[k0, k1, k2]]), np.array([0.5 / area]), np.ones(1), DELTA)
    row = np.zeros((3, 15))
    row[:, :3], row[:, 5] = corners, 1
    return chord.value(source, Images(np.zeros(3, np.int64), row), Chord(np.empty(1), np.empty(1), tau))


def dirichlet(s: float, r: float) -> float:
    """The term for singular values s and r."""
    return float(np.sqrt((s * s + r * r) * (1 + 1 / (s * r) ** 2) / 4 - 1 + DELTA**2))


@pytest.mark.parametrize(("s", "r"), [(1, 1), (2, 1), (0.8, 0.9), (3, 0.5), (1, 0.6)])
def test_a_triangle_by_hand(s: float, r: float) -> None:
    turn = np.array([[0.6, 0.8, 0], [-0.8, 0.6, 0], [0, 0, 1]])
    assert one_triangle(TRIANGLE * [s, r, 1] @ turn) == pytest.approx(dirichlet(s, r), rel=1e-12)


def test_below_tau_the_price_rises_on_smoothly_through_flat_and_folded_images() -> None:
    heights = np.linspace(1.0, -1.0, 401)
    prices = np.array([one_triangle(TRIANGLE * [1, h, 1]) for h in heights])
    assert np.all(np.diff(prices) > 0)
    assert np.isfinite(prices).all()
    second = np.diff(prices[heights > 0] ** 2, 2)  # at 0 the slope changes, by 1 / 0.3
    assert np.abs(np.diff(second)).max() < 0.03 * np.abs(second).max()
    steep = [one_triangle(TRIANGLE * [1, 0.3, 1], tau) for tau in (0.5, 0.2)]
    assert steep[1] == pytest.approx(dirichlet(1, 0.3), rel=1e-12)
    assert steep[0] < steep[1]


def test_a_collapsed_image_costs_more_than_an_isometric_one() -> None:
    sizes = [1.0, 0.7, 0.5, 0.3, 0.1, 0.01]
    prices = [one_triangle(TRIANGLE * size) for size in sizes]
    assert prices == sorted(prices)


def scene(level: int = 2, seed: int = 0) -> tuple[np.ndarray, Source, Images, np.ndarray]:
    """A lopsided mesh on a bumpy target, its images, tangent frames."""
    target = stars.radial_map(stars.blob(3))
    points, faces = positive_sphere(level, seed)
    reference = energy.reference(np.array(blob(level).vertices), faces, FINE_FLOOR)
    source = Source(faces, reference.k, reference.inverse, np.random.default_rng(seed).random(len(faces)) + 0.1, DELTA)
    face = Locator.prepare(target.closed_points, target.mesh.topology).locate(points)[0]
    images = Images(np.array(face), np.empty((len(points), 15)))
    chord.locate(points, MetricField.prepare(target).bare, chord.sheet(target), images)
    T = np.empty((len(points), 2, 3))
    energy.frames(points, T)
    return points, source, images, T


def derivatives(source: Source, images: Images, terms: Chord, T: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient over all unknowns, and the blocks of the Hessian."""
    chord.value(source, images, terms)
    g, H = np.zeros((len(source.F), 6)), np.zeros((len(source.F), 21))
    chord.add_derivatives(T, source, images, terms, g, H)
    unknowns = 2 * source.F[:, [0, 0, 1, 1, 2, 2]] + np.tile([0, 1], 3)
    return np.bincount(unknowns.ravel(), g.ravel(), 2 * len(T)), H


def test_gradient_in_the_images_agrees_with_differences_also_where_they_fold() -> None:
    _, source, images, T = scene()
    images.row[:, 6:] = np.eye(3).ravel()  # steps of the points are steps of the images
    images.row[:30, :3] += 0.3 * np.random.default_rng(5).normal(size=(30, 3))
    terms = Chord(np.empty(len(source.F)), np.empty(len(source.F)), HALF)
    g, _ = derivatives(source, images, terms, T)
    rng, errors = np.random.default_rng(1), []
    normals = np.cross(*(images.row[source.F[:, i], :3] - images.row[source.F[:, 0], :3] for i in (1, 2)))
    assert np.sum(np.einsum("fd,fd->f", normals, images.row[source.F, 3:6].sum(axis=1)) < 0) > 5
    for vertex in range(60):
        turn = rng.normal(size=2)
        home = images.row[vertex, :3].copy()
        both = []
        for step in (1e-6, -1e-6):
            images.row[vertex, :3] = home + step * turn @ T[vertex]
            both.append(chord.value(source, images, terms))
        images.row[vertex, :3] = home
        difference = (both[0] - both[1]) / 2e-6
        errors.append(abs(difference - turn @ g[2 * vertex : 2 * vertex + 2]) / (np.abs(g).mean() + abs(difference)))
    assert np.median(errors) < 1e-6
    assert np.mean(np.array(errors) < 1e-4) > 0.8  # where c < 0.3 the normal b is lagged: the direction of N follows it


def test_hessian_agrees_with_differences_on_flat_images() -> None:
    """In a plane the normal does not turn, and a large delta leaves f itself: then nothing is left out of the Hessian."""
    k0, k1, k2, area = energy.triangle_reference(2.0, 1.3, 0.9, 0.0)
    source = Source(np.array([[0, 1, 2]]), np.array([[k0, k1, k2]]), np.array([0.5 / area]), np.ones(1), 1e3)
    row, T, terms = np.zeros((3, 15)), np.tile(np.eye(3)[:2], (3, 1, 1)), Chord(np.empty(1), np.empty(1), HALF)
    row[:, :2], row[:, 5], row[:, 6:] = [[0, 0], [1.1, 0.1], [0.2, 0.5]], 1, np.eye(3).ravel()
    images, stiff, lower = Images(np.zeros(3, np.int64), row), 0.05, np.tril_indices(6)
    chord.value(source, images, terms)
    g, H = np.zeros((1, 6)), np.where(lower[0] == lower[1], stiff, 0.0)[None]
    chord.add_derivatives(T, source, images, terms, g, H)
    whole = np.zeros((6, 6))
    whole[lower] = whole[lower[::-1]] = H[0]
    whole -= stiff * np.eye(6)
    home, steps = row[:, :2].copy(), np.random.default_rng(0).normal(size=(8, 3, 2))
    for step in steps:
        values = []
        for t in (-1e-3, 0.0, 1e-3):
            row[:, :2] = home + t * step
            values.append(chord.value(source, images, terms))
        curvature = (values[0] - 2 * values[1] + values[2]) / 1e-6
        assert curvature == pytest.approx(step.ravel() @ whole @ step.ravel(), rel=1e-2)


def test_steps_of_single_faces_contain_the_largest_step_of_all() -> None:
    points, faces = positive_sphere(2)
    along = np.random.default_rng(0).normal(size=points.shape)
    each = energy.face_steps(points, along, faces, 1.25)
    assert each.min() == pytest.approx(energy.largest_step(points, along, faces, 1.25), rel=1e-2)  # both are lower bounds
    assert each.max() == 1.25
    for face in np.argsort(each)[:20]:
        corners, move = points[faces[face]], along[faces[face]]
        assert np.linalg.det(corners + 0.99 * each[face] * move) > 0


def test_blocks_of_the_sum_are_positive_semidefinite() -> None:
    _, source, images, T = scene()
    _, H = derivatives(source, images, Chord(np.empty(len(source.F)), np.empty(len(source.F)), HALF), T)
    whole, lower = np.zeros((len(H), 6, 6)), np.tril_indices(6)
    whole[:, lower[0], lower[1]] = H
    values = np.linalg.eigvalsh(whole)
    assert (values[:, 0] > -1e-6 * values[:, -1]).all()


def test_the_jacobian_of_an_affine_map_approaches_that_map_faster_than_the_edges_shrink() -> None:
    errors, affine = [], np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.2], [0.3, 0.0, 1.0]])
    for level in (2, 3, 4):
        ball = icosphere(level)
        shaped = SphericalMap(stars.close(ball.with_vertices(ball.vertices @ affine.T)), ball.vertices, stars.Trace((), "given"))
        rows, scale = chord.sheet(shaped), np.sqrt(4 * np.pi / shaped.mesh.area)
        tangent = np.eye(3) - ball.vertices[:, :, None] * ball.vertices[:, None, :]
        np.testing.assert_allclose(rows[:, :3], scale * shaped.mesh.vertices, rtol=1e-13)
        errors.append(np.sqrt(np.mean((rows[:, 6:].reshape(-1, 3, 3) - scale * affine @ tangent) ** 2)))
    assert errors[2] < 2e-3
    assert errors[1] / errors[2] > 2.5


def test_images_of_the_vertices_are_the_vertices() -> None:
    target = stars.radial_map(stars.blob(3))
    rows = chord.sheet(target)
    images = Images(np.zeros(target.mesh.n_vertices, np.int64), np.empty((target.mesh.n_vertices, 15)))
    chord.locate(np.array(target.closed_points), MetricField.prepare(target).bare, rows, images)
    np.testing.assert_allclose(images.row, rows, atol=1e-9)


def problem(delta: float = DELTA) -> Polish:
    """A mesh roughly on its place: the target's own vertices, pushed about, with three landmarks."""
    target = stars.radial_map(stars.blob(3))
    mesh, rng = target.mesh, np.random.default_rng(0)
    points = target.closed_points + 0.02 * rng.normal(size=(mesh.n_vertices, 3))
    points = np.ascontiguousarray(points / np.linalg.norm(points, axis=1, keepdims=True))
    faces = np.array(mesh.faces)
    points[np.unique(faces[exact_signs(points, faces) <= 0])] = target.closed_points[np.unique(faces[exact_signs(points, faces) <= 0])]
    assert (exact_signs(points, faces) > 0).all()
    level = Level(np.array(mesh.vertices), faces, points, energy.reference(np.array(mesh.vertices), faces, FINE_FLOOR))
    locator = Locator.prepare(target.closed_points, mesh.topology)
    centroids = points[faces].sum(axis=1)
    seats = metric.empty_seats(locator.locate(centroids / np.linalg.norm(centroids, axis=1, keepdims=True))[0])
    goals = Goals(np.array([3, 40, 200]), target.closed_points[[3, 40, 200]], np.full(3, 100.0))
    images = Images(np.array(locator.locate(points)[0]), np.empty((len(points), 15)))
    return Polish(level, MetricField.prepare(target).at_scale(0.0), chord.sheet(target), goals, delta, seats, images)


def test_energy_falls_at_every_accepted_step_and_no_step_folds() -> None:
    polish, seen = problem(), []
    start = polish.value(polish.level.S)
    S = polish.newton(polish.level.S, 20, 1e-4, lambda *step: seen.append(step))
    reached = [value for _, value, _, accepted in seen if accepted]
    assert len(reached) > 3
    assert np.all(np.diff([start, *reached]) < 0)
    assert (exact_signs(S, polish.level.F) > 0).all()
    assert polish.value(S) == pytest.approx(reached[-1], rel=1e-12)
    assert reached[-1] < 0.5 * start


def test_sweeps_lower_the_energy_without_folds() -> None:
    polish = problem()
    values, S = [polish.value(polish.level.S)], polish.level.S
    for _ in range(3):
        S = polish.sweep(S, 2)
        values.append(polish.value(S))
        assert (exact_signs(S, polish.level.F) > 0).all()
    assert np.all(np.diff(values) < 0)
    assert values[-1] < 0.7 * values[0]


def test_landmarks_hold_in_the_polish() -> None:
    polish = problem()
    S = polish.newton(polish.sweep(polish.level.S, 4), 20, 1e-4, lambda *_: None)
    assert np.linalg.norm(S[polish.goals.vertices] - polish.goals.places, axis=1).max() < 1e-3
