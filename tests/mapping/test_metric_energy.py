"""The metric energy: derivatives by differences, the field on surfaces whose metric is known, robustness, folds."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping import stars
from morphlet import Mesh
from morphlet.mapping import metric, ring
from morphlet.mapping.metric import Ground, MetricField, Seats, Source
from morphlet.sphere import energy
from morphlet.sphere.embed import FINE_FLOOR
from morphlet.sphere.level import Level
from morphlet.sphere.locate import Locator
from morphlet.sphere.map import SphericalMap
from morphlet.sphere.relax import relax_range
from morphlet.surface.hierarchy import decimate
from support import blob, exact_signs, icosphere, positive_sphere, random_rotation

STEP = 1e-6
"""Of central differences: their error is far below `CLOSE`, and no centroid crosses an edge of the target on the way."""
CLOSE = 1e-4


def laid(target: SphericalMap, level: int, delta: float = 0.0, seed: int = 0) -> tuple[np.ndarray, Source, Seats]:
    """A lopsided mesh with random weights on a wildly moved icosphere over the target's sphere."""
    points, faces = positive_sphere(level, seed)
    reference = energy.reference(np.array(blob(level).vertices), faces, FINE_FLOOR)
    weight = np.random.default_rng(seed).random(len(faces)) + 0.1
    centroids = points[faces].sum(axis=1)
    locator = Locator.prepare(target.closed_points, target.surface.mesh.topology)
    face = locator.locate(centroids / np.linalg.norm(centroids, axis=1, keepdims=True))[0]
    return points, Source(faces, reference.k, reference.inverse, weight, delta), metric.empty_seats(face)


def gradient(points: np.ndarray, source: Source, ground: Ground, seats: Seats) -> tuple[np.ndarray, np.ndarray]:
    """Tangent frames and the gradient in them."""
    T = np.empty((len(points), 2, 3))
    energy.frames(points, T)
    metric.value(points, source, ground, seats)
    g, _ = metric.derivatives(points, T, source, ground, seats, False)
    unknowns = 2 * source.F[:, [0, 0, 1, 1, 2, 2]] + np.tile([0, 1], 3)
    return T, np.bincount(unknowns.ravel(), g.ravel(), 2 * len(points))


def moved(points: np.ndarray, along: np.ndarray, length: float) -> np.ndarray:
    out = np.empty_like(points)
    energy.move(points, along, length, out)
    return out


@pytest.mark.parametrize("delta", [0.0, 0.3])
@pytest.mark.parametrize("sigma", [0.0, 0.2])
def test_gradient_agrees_with_differences_force_through_the_centroid_included(delta: float, sigma: float) -> None:
    target = stars.radial_map(stars.blob(3))
    ground = MetricField.prepare(target).at_scale(sigma)
    points, source, seats = laid(target, 2, delta)
    T, g = gradient(points, source, ground, seats)
    rng = np.random.default_rng(1)
    errors = []
    for vertex in rng.choice(len(points), 40, replace=False):
        turn, along = rng.normal(size=2), np.zeros_like(points)
        along[vertex] = turn @ T[vertex]
        both = [metric.value(moved(points, along, s * STEP), source, ground, seats) for s in (1, -1)]
        difference, expected = (both[0] - both[1]) / (2 * STEP), turn @ g[2 * vertex : 2 * vertex + 2]
        errors.append(abs(difference - expected) / (np.abs(g).mean() + abs(difference)))
    assert np.median(errors) < 1e-7
    assert np.max(errors) < CLOSE


def test_hessian_is_the_derivative_of_the_gradient_where_the_metric_does_not_change() -> None:
    """Exactly so on a constant metric of space, which is no metric of the sphere but satisfies the same formulas."""
    target = stars.radial_map(stars.blob(3))
    constant = np.array([1.3, 0.2, -0.1, 0.8, 0.15, 1.1])
    ground = MetricField.prepare(target).bare._replace(metric=np.tile(constant, (target.mesh.n_vertices, 1)))
    points, source, seats = laid(target, 1)
    T, _ = gradient(points, source, ground, seats)
    _, H = metric.derivatives(points, T, source, ground, seats, False)
    rng = np.random.default_rng(2)
    step = rng.normal(size=2 * len(points))
    along = np.einsum("ne,ned->nd", step.reshape(-1, 2), T)
    unknowns = 2 * source.F[:, [0, 0, 1, 1, 2, 2]] + np.tile([0, 1], 3)
    lower = np.tril_indices(6)
    whole = np.zeros((len(source.F), 6, 6))
    whole[:, lower[0], lower[1]] = whole[:, lower[1], lower[0]] = H
    local = step[unknowns]
    curvature = float(np.einsum("fi,fij,fj->", local, whole, local))
    values = [metric.value(moved(points, along, t), source, ground, seats) for t in (-1e-4, 0.0, 1e-4)]
    assert (values[0] - 2 * values[1] + values[2]) / 1e-8 == pytest.approx(curvature, rel=1e-4)


def test_blocks_are_made_positive_semidefinite_on_demand() -> None:
    target = stars.radial_map(stars.blob(3))
    ground = MetricField.prepare(target).at_scale(0.1)
    points, source, seats = laid(target, 2)
    T, _ = gradient(points, source, ground, seats)
    lower = np.tril_indices(6)
    least = []
    for project in (False, True):
        whole = np.zeros((len(source.F), 6, 6))
        whole[:, lower[0], lower[1]] = metric.derivatives(points, T, source, ground, seats, project)[1]
        values = np.linalg.eigvalsh(whole)
        least.append((values[:, 0] / values[:, -1]).min())
    assert least[0] < -0.01
    assert least[1] > -1e-6


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.5])
def test_a_sphere_has_the_metric_of_the_sphere_at_every_scale(sigma: float) -> None:
    field = MetricField.prepare(stars.radial_map(icosphere(3)))
    found, bare = field.at_scale(sigma).metric, field.bare.metric
    np.testing.assert_allclose(found, bare, atol=0.01)  # area of the polyhedron against that of the sphere
    points = field.points
    for row, column in ((0, (0, 1, 2)), (1, (1, 3, 4)), (2, (2, 4, 5))):
        assert np.abs(np.sum(found[:, column] * points, axis=1)).max() < 1e-12, row


def test_an_ellipsoid_has_the_metric_of_its_affine_map_up_to_the_square_of_the_edges() -> None:
    errors = []
    for level in (2, 3, 4):
        ball = icosphere(level)
        affine = np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.2], [0.0, 0.0, 1.0]])
        field = MetricField.prepare(SphericalMap(stars.radial_map(ball).surface, ball.vertices, stars.Trace((), "given")))
        shaped = SphericalMap(stars.close(ball.with_vertices(ball.vertices @ affine.T)), ball.vertices, stars.Trace((), "given"))
        field = MetricField.prepare(shaped)
        tangent = np.eye(3) - field.points[:, :, None] * field.points[:, None, :]
        scale = 4 * np.pi / shaped.mesh.area
        exact = scale * (tangent @ affine.T @ affine @ tangent)[:, metric.ROWS, metric.COLUMNS]
        errors.append(np.sqrt(np.mean((field.at_scale(0.0).metric - exact) ** 2)))
    assert errors[2] < 0.01
    assert errors[1] / errors[2] > 3


def test_smoothing_lowers_the_variation_and_keeps_the_mean_of_the_logarithm() -> None:
    field = MetricField.prepare(stars.radial_map(stars.blob(3)))
    mass = Mesh(field.points, field.topology).vertex_areas

    def log_areas(sigma: float) -> np.ndarray:
        M = field.at_scale(sigma).metric
        return np.log(M[:, 0] * M[:, 3] + M[:, 0] * M[:, 5] + M[:, 3] * M[:, 5] - M[:, 1] ** 2 - M[:, 2] ** 2 - M[:, 4] ** 2)

    logs = [log_areas(sigma) for sigma in (0.0, 0.1, 0.3, 0.5)]
    spread = [np.average((x - np.average(x, weights=mass)) ** 2, weights=mass) for x in logs]
    assert spread == sorted(spread, reverse=True)
    assert spread[3] < spread[0] / 2
    assert np.average(logs[2], weights=mass) == pytest.approx(np.average(logs[0], weights=mass), abs=0.02)


def test_the_metric_of_a_surface_makes_its_own_map_isometric() -> None:
    """Source and target are one mesh: every triangle on its own place has f near 1, on another surface's sphere far from it."""
    target = stars.radial_map(stars.blob(4))
    field, F = MetricField.prepare(target), np.array(target.mesh.faces)
    reference = energy.reference(np.array(target.mesh.vertices), F, FINE_FLOOR)
    source = Source(F, reference.k, reference.inverse, np.full(len(F), 1 / len(F)), 0.0)
    seats, points = metric.empty_seats(np.arange(len(F))), np.array(target.closed_points)
    own, other = (metric.value(points, source, g, seats) for g in (field.at_scale(0.0), field.bare))
    assert own == pytest.approx(1, abs=0.01)
    assert other > 1.05


@settings(max_examples=10, deadline=None)
@given(st.integers(0, 10**6), st.floats(0.01, 100))
def test_energy_does_not_depend_on_place_and_size_of_the_target(seed: int, size: float) -> None:
    target, turn = stars.radial_map(stars.blob(2)), random_rotation(seed)
    other = stars.radial_map(target.mesh.with_vertices(size * target.mesh.vertices @ turn.T))
    points, source, seats = laid(target, 2, 0.3)
    here = metric.value(points, source, MetricField.prepare(target).at_scale(0.15), seats)
    turned = np.ascontiguousarray(points @ turn.T)
    there = metric.value(turned, source, MetricField.prepare(other).at_scale(0.15), metric.empty_seats(seats.face))
    assert there == pytest.approx(here, rel=1e-9)


def test_the_robust_energy_is_majorised_by_its_weights() -> None:
    target = stars.radial_map(stars.blob(2))
    ground = MetricField.prepare(target).at_scale(0.2)
    points, source, seats = laid(target, 2, 0.3)
    plain = source._replace(delta=0.0, weight=np.ones(len(source.F)))
    here = metric.value(points, source, ground, seats)
    weights = seats.majorant.copy()
    rng = np.random.default_rng(3)
    for amount in (1e-3, 1e-2, 3e-2):
        there = moved(points, rng.normal(size=points.shape), amount)
        before, after = (metric.value(x, plain._replace(weight=weights), ground, seats) for x in (points, there))
        assert metric.value(there, source, ground, seats) <= here + after - before + 1e-12


def test_a_fold_costs_infinitely_much() -> None:
    target = stars.radial_map(stars.blob(2))
    ground = MetricField.prepare(target).at_scale(0.2)
    points, source, seats = laid(target, 2, 0.3)
    assert np.isfinite(metric.value(points, source, ground, seats))
    points[7] = -points[7]
    assert metric.value(points, source, ground, seats) == np.inf


def test_a_centroid_far_from_the_first_guess_is_found_all_the_same() -> None:
    target = stars.radial_map(stars.blob(3))
    ground = MetricField.prepare(target).at_scale(0.0)
    points, source, seats = laid(target, 2)
    known = metric.value(points, source, ground, seats)
    lost = metric.empty_seats(np.zeros(len(source.F), np.int64))
    assert metric.value(points, source, ground, lost) == pytest.approx(known, rel=1e-12)


def test_one_vertex_at_a_time_agrees_with_the_sphere_where_the_metric_is_flat() -> None:
    """The identity of space as metric: its area factor is sqrt(3), which the reference areas take back."""
    points, faces = positive_sphere(3, 1)
    surface = np.array(blob(3).vertices)
    reference = energy.reference(surface, faces, FINE_FLOOR)
    level = Level(surface, faces, points, reference)
    target = stars.radial_map(stars.blob(3))
    flat = np.tile([1.0, 0, 0, 1, 0, 1], (target.mesh.n_vertices, 1))
    ground = MetricField.prepare(target).bare._replace(metric=flat)
    expected, found, everyone = points.copy(), points.copy(), np.arange(len(points))
    relax_range(everyone, 0, len(points), expected, *level.star, reference, reference.weight, level.max_valence)
    scaled = reference._replace(inverse=reference.inverse / np.sqrt(3))
    under = np.zeros(len(points), np.int64)
    ring.sweep(everyone, found, (*level.star, level.max_valence), scaled, ground, under)
    np.testing.assert_allclose(found, expected, atol=1e-9)
    assert np.abs(found - points).max() > 0.01
    assert (under == Locator.prepare(target.closed_points, target.mesh.topology).locate(points)[0]).all()


def test_vertices_come_back_without_folds_and_near_their_place() -> None:
    """The last batch of a mesh on its own sphere, in its own metric."""
    target = stars.radial_map(stars.blob(4))
    hierarchy = decimate(target.mesh)
    high = target.mesh.n_vertices // 2
    F, S = hierarchy.faces_after(high), np.array(target.closed_points)
    assert (exact_signs(S, F[F[:, 0] >= 0]) > 0).all()
    S[hierarchy.removed[:high]] = np.nan
    V = np.array(target.mesh.vertices)
    put = ring.putter(MetricField.prepare(target).at_scale(0.0), np.zeros(len(S), np.int64))
    records = (hierarchy.removed, hierarchy.ring_offsets, hierarchy.ring_vertices, hierarchy.ring_faces)
    assert put(high, 0, records, V, S, F, 4 * np.pi / target.mesh.area, 1e-9, hierarchy.max_ring) == -1
    assert (exact_signs(S, F) > 0).all()
    apart = np.linalg.norm(S - target.closed_points, axis=1)[hierarchy.removed[:high]]
    assert np.median(apart) < 0.1 * np.sqrt(4 * np.pi / high)


def test_a_vertex_without_room_is_told() -> None:
    """All ring points in one place leave no kernel: the number of the record comes back."""
    target = stars.radial_map(stars.blob(2))
    hierarchy = decimate(target.mesh)
    S = np.tile(target.closed_points[:1], (target.mesh.n_vertices, 1))
    put = ring.putter(MetricField.prepare(target).bare, np.zeros(len(S), np.int64))
    records = (hierarchy.removed, hierarchy.ring_offsets, hierarchy.ring_vertices, hierarchy.ring_faces)
    high = len(hierarchy.removed)
    scales = (4 * np.pi / target.mesh.area, 1e-9, hierarchy.max_ring)
    assert put(high, 0, records, np.array(target.mesh.vertices), S, hierarchy.bottom(), *scales) == high - 1
