"""The distortion of a spherical mesh: values by hand, derivatives by Taylor's slopes, steps that stop before a fold."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.sphere import energy
from morphlet.sphere.embed import FINE_FLOOR
from morphlet.sphere.level import Level
from morphlet.sphere.quality import singular_values
from morphlet.sphere.relax import relax_vertex, ring_buffer, ring_energy, set_sector
from support import blob, icosphere, positive_sphere

CUBE = np.array([[1.0, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]])
BASE = np.array([[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]])
STEPS = 2.0 ** -np.arange(9, 14)
SLOPE_SLACK = 0.15
"""Slopes over four halvings come out this near to the whole number; a wrong derivative makes them 1 or 2."""


def problem(form: int = energy.ISOMETRIC, p: float = 1.0, shape: float = 0.3, seed: int = 0) -> Level:
    """A lopsided metric with random weights on a wildly moved, fold-free icosphere."""
    points, faces = positive_sphere(2, seed)
    surface = blob(2)
    weight = np.random.default_rng(seed).random(len(faces)) + 0.1
    metric = energy.reference(np.array(surface.vertices), faces, FINE_FLOOR)._replace(weight=weight)
    return Level(np.array(surface.vertices), faces, points, metric, p, form, shape)


def path(level: Level, seed: int) -> np.ndarray:
    """A random step in the tangent planes of the last model."""
    return np.random.default_rng(seed).normal(size=2 * len(level.S)) * 0.05


def slope(lengths: np.ndarray, residuals: np.ndarray) -> float:
    """How many times the residual halves when the step does."""
    return float(np.polyfit(np.log(lengths), np.log(np.abs(residuals)), 1)[0])


FORMS = [
    pytest.param(energy.ISOMETRIC, 1.0, id="isometric"),
    pytest.param(energy.ISOMETRIC, 0.5, id="isometric, root"),
    pytest.param(energy.ANGLE_AREA, 1.0, id="angle and area"),
    pytest.param(energy.HINGE, 1.0, id="hinge"),
]


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize(("form", "p"), FORMS)
def test_gradient_leaves_a_residual_of_second_order(form: int, p: float, seed: int) -> None:
    level = problem(form, p, 0.6, seed)
    start = level.value(level.S)
    gradient, _ = level.model(level.S, False)
    step = path(level, seed)
    along = level.direction(level.S, step)
    values = np.array([level.value(level.moved(level.S, along, t)) for t in STEPS])
    assert abs(gradient @ step) > 0
    assert slope(STEPS, values - start - STEPS * (gradient @ step)) == pytest.approx(2, abs=SLOPE_SLACK)


@pytest.mark.parametrize("seed", [0, 1])
@pytest.mark.parametrize("form", [energy.ISOMETRIC, energy.ANGLE_AREA])
def test_hessian_leaves_a_residual_of_third_order(form: int, seed: int) -> None:
    level = problem(form, 1.0, 0.3, seed)
    start = level.value(level.S)
    gradient, values = level.model(level.S, False)
    step = path(level, seed)
    along, curvature = level.direction(level.S, step), step @ (level.matrix(values) @ step)
    reached = np.array([level.value(level.moved(level.S, along, t)) for t in 4 * STEPS])
    residual = reached - start - 4 * STEPS * (gradient @ step) - (4 * STEPS) ** 2 / 2 * curvature
    assert slope(STEPS, residual) == pytest.approx(3, abs=SLOPE_SLACK)


def test_hinge_pulls_only_where_a_face_is_nearly_flat_and_has_no_other_value() -> None:
    level = problem(energy.HINGE, 1.0, 1e-6)
    assert level.value(level.S) == 0
    assert not np.any(level.model(level.S, False)[0])
    level.shape = 0.7
    corners = level.S[level.F]
    gap = np.maximum(0.7 - np.linalg.det(corners) * level.reference.inverse, 0)
    assert level.value(level.S) == pytest.approx(np.sum(level.reference.weight * gap**2), rel=1e-12)


def test_the_energy_of_a_tetrahedron_by_hand() -> None:
    points = CUBE / np.sqrt(3)
    area, determinant, squared_edges = 2 / np.sqrt(3), 4 * np.sqrt(3) / 9, 8.0  # of one chord triangle
    scale2 = 4 * np.pi / (4 * (area + energy.AREA_SLACK * squared_edges))
    n, D = 2 / scale2, determinant / (2 * area * scale2)
    metric = energy.reference(points, BASE, FINE_FLOOR)
    found = energy.value(points, BASE, metric, energy.ISOMETRIC, 0.0, 1.0, np.empty(4))
    assert found == pytest.approx(4 * np.pi * n * (1 + D**-2) / 4, rel=1e-13)
    found = energy.value(points, BASE, metric, energy.ANGLE_AREA, 0.25, 1.0, np.empty(4))
    assert found == pytest.approx(4 * np.pi * (0.75 * n / D + 0.25 * (D + 1 / D)) / 2, rel=1e-13)


def test_a_fine_sphere_on_itself_has_no_distortion_up_to_the_square_of_its_edges() -> None:
    excess = []
    for level in (2, 3, 4):
        ball = icosphere(level)
        V, F = np.array(ball.vertices), np.array(ball.faces)
        metric = energy.reference(V, F, FINE_FLOOR)
        excess.append(energy.value(V, F, metric, energy.ISOMETRIC, 0.0, 1.0, np.empty(len(F))) / (4 * np.pi) - 1)
    assert excess[2] < 2e-3
    assert excess[1] / excess[2] == pytest.approx(4, rel=0.1)


def test_n_is_the_square_of_the_jacobian() -> None:
    level = problem()
    surface = blob(2)
    larger, smaller, shaped = singular_values(surface, level.S)
    slack = surface.area / energy.slack_areas(level.V, level.F).sum()
    n = sum(level.reference.k[:, i] * np.sum((level.S[level.F[:, i - 2]] - level.S[level.F[:, i - 1]]) ** 2, axis=1) for i in range(3))
    assert shaped.all()
    np.testing.assert_allclose(n * slack, larger**2 + smaller**2, rtol=1e-9)


@pytest.mark.parametrize("form", [energy.ISOMETRIC, energy.ANGLE_AREA])
@pytest.mark.parametrize("level", [1, 5])
def test_one_folded_face_costs_infinitely_much(form: int, level: int) -> None:
    ball = icosphere(level)
    V, F = np.array(ball.vertices), np.array(ball.faces)
    metric = energy.reference(V, F, FINE_FLOOR)
    folded = V.copy()
    folded[7] = -folded[7]
    assert np.isfinite(energy.value(V, F, metric, form, 0.5, 1.0, np.empty(len(F))))
    assert energy.value(folded, F, metric, form, 0.5, 1.0, np.empty(len(F))) == np.inf
    assert np.isfinite(energy.value(folded, F, metric, energy.HINGE, 0.5, 1.0, np.empty(len(F))))


def test_a_flat_face_costs_infinitely_much() -> None:
    flat = np.array([[1.0, 0, 0], [0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    metric = energy.reference(CUBE, BASE, FINE_FLOOR)
    assert energy.value(flat, BASE[:1], metric, energy.ISOMETRIC, 0.0, 1.0, np.empty(1)) == np.inf


def test_weights_of_a_power_majorise_it() -> None:
    level = problem(p=0.4)
    at = level.value(level.S)
    linear = Level(level.V, level.F, level.S, level.reference._replace(weight=level.majorant.copy()))
    tangent = linear.value(level.S)
    for seed in range(20):
        other = positive_sphere(2, seed + 5)[0]
        assert level.value(other) - at <= linear.value(other) - tangent + 1e-9 * abs(tangent)


def blocks(level: Level, project: bool) -> tuple[np.ndarray, np.ndarray]:
    """Gradients (m, 6) and whole 6x6 Hessians (m, 6, 6) of the faces."""
    level.value(level.S)
    frames = np.empty((len(level.S), 2, 3))
    energy.frames(level.S, frames)
    g, H = energy.derivatives(level.S, level.F, level.reference, level.form, level.shape, level.majorant, frames, project)
    whole = np.zeros((len(level.F), 6, 6))
    i, j = np.tril_indices(6)
    whole[:, i, j] = whole[:, j, i] = H
    return g, whole


@pytest.mark.parametrize("form", [energy.ISOMETRIC, energy.ANGLE_AREA, energy.HINGE])
def test_projected_blocks_have_their_negative_eigenvalues_clamped(form: int) -> None:
    level = problem(form, 1.0, 0.7)
    _, raw = blocks(level, False)
    _, projected = blocks(level, True)
    values, vectors = np.linalg.eigh(raw)
    clamped = np.einsum("mik,mk,mjk->mij", vectors, np.maximum(values, 0), vectors)
    size = np.abs(values).max(axis=1).clip(1e-30)
    assert (np.abs(projected - clamped).max(axis=(1, 2)) <= 10 * energy.JACOBI_TOLERANCE * size).all()
    assert (np.linalg.eigvalsh(projected).min(axis=1) >= -1e-13 * size).all()
    if form != energy.HINGE:
        assert values.min() < 0  # otherwise the projection had nothing to do


def test_the_sparse_hessian_is_the_sum_of_its_blocks() -> None:
    level = problem()
    level.value(level.S)
    gradient, values = level.model(level.S, False)
    g, H = blocks(level, False)
    unknowns = 2 * level.F[:, [0, 0, 1, 1, 2, 2]] + np.array([0, 1] * 3)
    dense, sums = np.zeros((2 * len(level.S),) * 2), np.zeros(2 * len(level.S))
    np.add.at(dense, (unknowns[:, :, None], unknowns[:, None, :]), H)
    np.add.at(sums, unknowns, g)
    scale = np.abs(dense).max()
    np.testing.assert_allclose(level.matrix(values).toarray(), dense, rtol=0, atol=1e-13 * scale)
    np.testing.assert_allclose(gradient, sums, rtol=0, atol=1e-13 * np.abs(sums).max())
    np.testing.assert_array_equal(values[level.diagonal], level.matrix(values).diagonal())


@given(st.integers(0, 2**32 - 1), st.integers(0, 12))
def test_graded_matrices_are_projected(seed: int, grades: int) -> None:
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(6, 6)) * 10.0 ** rng.integers(-grades, 1, size=(6, 1))
    A = A + A.T
    values, vectors = np.linalg.eigh(A)
    lower = np.tril(A)
    energy.project_psd(lower, np.empty((6, 6)))
    found = np.tril(lower) + np.tril(lower, -1).T
    size = np.abs(values).max()
    clamped = vectors @ np.diag(np.maximum(values, 0)) @ vectors.T
    np.testing.assert_allclose(found, clamped, rtol=0, atol=10 * energy.JACOBI_TOLERANCE * size)
    assert np.linalg.eigvalsh(found).min() >= -1e-13 * size


def test_a_matrix_that_is_positive_already_is_left_alone_and_zero_stays_zero() -> None:
    A = np.diag([1.0, 2, 3, 4, 5, 6])
    energy.project_psd(A, np.empty((6, 6)))
    np.testing.assert_array_equal(A, np.diag([1.0, 2, 3, 4, 5, 6]))
    nothing = np.zeros((6, 6))
    energy.project_psd(nothing, np.empty((6, 6)))
    assert not nothing.any()


@given(st.lists(st.floats(-8, 8).map(lambda c: round(c, 6)), min_size=3, max_size=3), st.floats(0.1, 10))
def test_the_march_stops_short_of_the_first_root(c: list[float], limit: float) -> None:
    polynomial = np.array([c[2], c[1], c[0], 1.0])
    found = energy._first_fold(1.0, c[0], c[1], c[2], limit)
    t = np.linspace(0, found, 2000)
    assert 0 < found <= limit
    assert np.polyval(polynomial, t).min() > -1e-12
    roots = np.roots(polynomial)
    real = roots[(np.abs(roots.imag) < 1e-9) & (roots.real > 0) & (roots.real < limit)].real
    border = real.min(initial=limit)
    # it also stops where the determinant has fallen to a thousandth, near a double root at worst sqrt(1e-3) before it
    assert found >= 0.95 * border or np.polyval(polynomial, found) <= 1.1e-3


@pytest.mark.parametrize("level", [1, 5])
@pytest.mark.parametrize("seed", range(3))
def test_the_largest_step_folds_nothing_and_is_nearly_the_largest(level: int, seed: int) -> None:
    points, faces = positive_sphere(1, seed) if level == 1 else tuple(map(np.array, (icosphere(5).vertices, icosphere(5).faces)))
    moves = np.random.default_rng(seed).normal(size=points.shape)
    moves -= np.sum(moves * points, axis=1, keepdims=True) * points
    moves *= 1e-2 if level == 5 else 1.0

    def least(t: float) -> float:
        return float(np.linalg.det((points + t * moves)[faces]).min())

    step = energy.largest_step(points, moves, faces, 10.0)
    assert 0 < step < 10
    assert min(least(t) for t in np.linspace(0, step, 400 if level == 1 else 20)) > 0
    assert min(least(t) for t in np.linspace(step, 1.06 * step, 200 if level == 1 else 20)) <= 0
    assert energy.largest_step(points, np.zeros_like(points), faces, 2.5) == 2.5


def ring(seed: int) -> tuple[int, np.ndarray, np.ndarray]:
    """The ring of a vertex in a wild, fold-free mesh: its size, its buffer, and where the vertex is."""
    level = problem(seed=seed)
    corner, twin, start = level.star
    R, h, m = ring_buffer(level.max_valence), start[20], 0
    while True:
        t, c = divmod(int(h), 3)
        k, b = level.reference.k[t], 3 * t
        head, tail = corner[b + (c + 1) % 3], corner[b + (c + 2) % 3]
        weight, inverse = level.reference.weight[t], level.reference.inverse[t]
        set_sector(R, m, level.S, head, tail, k[(c + 2) % 3], k[(c + 1) % 3], k[c], inverse, weight)
        h, m = twin[b + (c + 2) % 3], m + 1
        if h == start[20]:
            return m, R, level.S[20]


@pytest.mark.parametrize("seed", range(6))
def test_one_newton_step_lowers_the_energy_of_a_ring_and_several_settle(seed: int) -> None:
    m, R, x = ring(seed)
    before = ring_energy(*x, m, R)
    once = relax_vertex(*x, m, R, 1)
    after = ring_energy(*once, m, R)
    assert after < before
    assert np.linalg.norm(once) == pytest.approx(1, abs=1e-15)
    settled = np.array(relax_vertex(*x, m, R, 60))
    least = ring_energy(*settled, m, R)
    nearby = settled + 1e-3 * np.random.default_rng(0).normal(size=(200, 3))
    nearby /= np.linalg.norm(nearby, axis=1, keepdims=True)
    assert least <= after
    assert min(ring_energy(*y, m, R) for y in nearby) >= least * (1 - 1e-10)


def test_the_ring_energy_is_the_part_of_the_whole_that_moves_with_its_vertex() -> None:
    level = problem()
    m, R, x = ring(0)
    moved = level.S.copy()
    moved[20] = relax_vertex(*x, m, R, 1)
    change = level.value(moved) - level.value(level.S)
    assert change == pytest.approx((ring_energy(*moved[20], m, R) - ring_energy(*x, m, R)) / 4, rel=1e-9)
    assert ring_energy(*-x, m, R) == np.inf


def test_slivers_and_points_keep_a_metric() -> None:
    area = energy.triangle_reference(1.0, 1.0, 0.0, 1e-6)[3]
    assert area >= 1e-3 / 4 / 2
    for lengths in [(1.0, 1.0, 1e-30), (4.0, 1.0, 1.0), (1.0, 4.0, 1.0), (1.0, 1.0, 4.0), (0.0, 0.0, 0.0), (1e-9, 1e-9, 1e-9)]:
        values = energy.triangle_reference(*lengths, 1e-6)
        assert np.isfinite(values).all()
        assert values[3] > 0
        assert values[0] * values[1] + values[1] * values[2] + values[2] * values[0] == pytest.approx(1 / (4 * values[3] ** 2), rel=1e-6)
