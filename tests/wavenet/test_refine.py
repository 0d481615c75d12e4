"""Refinement: slopes against differences, planted wavelets found again, errors that never rise, bounds, and hardly any signal."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet.errors import InputError
from morphlet.numerics import threads
from morphlet.wavenet import descent, refine
from morphlet.wavenet.blocks import NetworkTable
from morphlet.wavenet.library import Library, affine_basis, dyadic_library
from morphlet.wavenet.mothers import MOTHERS, beta, make_mother
from morphlet.wavenet.network import WaveletNetwork
from morphlet.wavenet.refine import Growth, interleave_rows, refine_rows

X = np.linspace(0, 1, 128)
HAT = MOTHERS["mexican_hat"]
OWN = make_mother(
    "gauss_cosine", lambda t: np.sin(3 * t) * np.exp(-t * t), lambda t: (3 * np.cos(3 * t) - 2 * t * np.sin(3 * t)) * np.exp(-t * t)
)
KINKED = beta(1, 1.5, 1.5)
"""Its slopes are infinite at the ends."""
ALL = (*MOTHERS.values(), beta(2, 4, 8), KINKED, OWN)
MIXED = (HAT, MOTHERS["beta1"], MOTHERS["polywog1"])
HATS = dyadic_library([HAT], X)
ROUNDING = 1 + 1e-9
"""Squared errors computed twice, in different orders."""
each_mother = pytest.mark.parametrize("psi", ALL, ids=lambda psi: psi.name)
seeds = st.integers(0, 10**6)


def signal(seed, k=1, x=X):
    """Smooth waves with a kink."""
    rng, waves = np.random.default_rng(seed), np.arange(1, 20)
    phases = 2 * np.pi * np.multiply.outer(x, waves)[:, None] + rng.uniform(0, 6, (k, 19))
    values = (rng.normal(size=(k, 19)) / waves**1.5 * np.cos(phases)).sum(axis=2)
    return values + rng.normal(size=k) * np.abs(x - rng.uniform(0.2, 0.8))[:, None]


def wavelets(seed, p, mothers=MIXED):
    """Kinds, centers and dilations anywhere among the samples."""
    rng = np.random.default_rng(seed)
    return rng.integers(0, len(mothers), p), rng.uniform(-0.1, 1.1, p), np.exp(rng.uniform(np.log(0.01), np.log(0.5), p))


def table(mothers, *rows, k=1):
    """Rows of (kinds, centers, dilations), without weights."""
    offsets = np.append(0, np.cumsum([len(row[0]) for row in rows]))
    kinds, centers, dilations = (np.concatenate([row[i] for row in rows]) for i in range(3))
    return NetworkTable(
        mothers, offsets.astype(int), kinds.astype(int), centers, dilations, np.zeros((len(kinds), k)), np.zeros((len(rows), 2, k))
    )


def least(net, y, x=X):
    """Sum of squares that the affine functions and the wavelets of a network leave of y, by their definition."""
    columns = [psi((x - t) / d) for psi, t, d in zip((net.mothers[kind] for kind in net.kinds), net.centers, net.dilations, strict=True)]
    A = np.column_stack([np.ones_like(x), x, *columns])
    return float(((y - A @ np.linalg.lstsq(A, y, rcond=None)[0]) ** 2).sum())


def same(a, b):
    """Bit for bit."""
    for name in ("offsets", "kinds", "centers", "dilations", "weights", "affine"):
        np.testing.assert_array_equal(getattr(a.table, name), getattr(b.table, name))
    np.testing.assert_array_equal(a.sse, b.sse)
    for first, second in zip(a.traces, b.traces, strict=True):
        np.testing.assert_array_equal(first, second)


@each_mother
def test_tables_hold_the_mother_and_its_slope(psi):
    """Cubic pieces: fourth order in the cell, third for slopes; not where a slope is infinite or leaps, in the cells at the ends."""
    (low, high, per, cells), cubics = (rows := refine._table(psi))[0], rows[1:]
    z = np.random.default_rng(0).uniform(low + 1 / per, high - 1 / per, 5000)
    c = ((z - low) * per).astype(int)
    u, (a, b, q, e) = (z - low) * per - c, cubics[c].T
    assert len(cubics) == cells
    np.testing.assert_allclose(a + u * (b + u * (q + u * e)), psi(z), atol=3e-3 if psi is KINKED else 2e-9)
    if psi is not KINKED:
        np.testing.assert_allclose(per * (b + u * (2 * q + 3 * u * e)), psi.derivative(z), atol=1e-6)
    outside = np.array([low - 1e-6, high + 1e-6, low - 5, high + 5])
    assert np.abs(psi(outside)).max() < 1e-9


def objective(mothers, kinds, theta, y):
    """Value, matrix and gradient of what is minimised, from the kernels."""
    samples, w = np.vstack([X, affine_basis(X).T]), len(kinds)
    columns, ranges, rest = np.zeros((3, w + 2, len(X))), np.zeros((w + 2, 2), np.int64), y.copy()
    factor, weights, sizes = np.zeros((w + 2, w + 2)), np.zeros((len(y), w + 2)), len(X) * np.exp(theta[1])
    descent._columns(samples, refine._tables(mothers), kinds, theta, columns, ranges)
    value, _ = descent._evaluate(columns[0], ranges, sizes, factor, weights, rest)
    hessian, gradient = descent._derivatives(columns, ranges, sizes, factor, weights, rest)
    return value, 2 * hessian, 2 * gradient, columns, weights, rest


@each_mother
def test_the_gradient_is_that_of_the_objective(psi):
    """Taylor: what the slope leaves of a change falls with the square of the step. Kaufman's Jacobian leaves the gradient exact."""
    kinds, theta = np.zeros(4, int), np.array([[0.2, 0.45, 0.5, 0.9], np.log([0.1, 0.2, 0.07, 0.15])])
    y, direction = np.ascontiguousarray(signal(3, 2).T), np.random.default_rng(0).normal(size=(2, 4))
    value, _, gradient, *_ = objective((psi,), kinds, theta, y)
    slope = gradient @ np.append(direction[0] / np.exp(theta[1]), direction[1])
    steps = np.array([1e-2, 1e-3]) * 0.1
    rest = [abs(objective((psi,), kinds, theta + h * direction, y)[0] - value - h * slope) for h in steps]
    if psi is not KINKED:
        assert np.log10(rest[0] / rest[1]) == pytest.approx(2, abs=0.25)


def test_the_gradient_holds_the_penalty_too():
    """Where the wavelets can make the signal, squared errors have no slope, and what is left is that of the penalty."""
    kinds, theta = np.array([0, 1, 2]), np.array([[0.2, 0.5, 0.7], np.log([0.1, 0.2, 0.05])])
    *_, columns, _, _ = objective(MIXED, kinds, theta, np.zeros((1, len(X))))
    y = columns[0, 2:].sum(axis=0)[None]
    gradient, h = objective(MIXED, kinds, theta, y)[2], 1e-6
    for i in range(3):
        shift = np.zeros((2, 3))
        shift[1, i] = h
        ahead, behind = (objective(MIXED, kinds, theta + sign * shift, y)[0] for sign in (1, -1))
        assert gradient[3 + i] == pytest.approx((ahead - behind) / (2 * h), rel=0.01)


def test_the_matrix_is_that_of_the_projected_jacobian():
    """Kaufman: derivatives of the columns times weights, less their projection, computed in the space of the samples."""
    kinds, theta = np.array([0, 1, 2]), np.array([[0.2, 0.5, 0.7], np.log([0.1, 0.2, 0.05])])
    _, hessian, _, columns, weights, _ = objective(MIXED, kinds, theta, np.ascontiguousarray(signal(5, 2).T))
    sizes = np.sqrt(descent.RIDGE * len(X) * np.exp(theta[1]))
    A = np.vstack([columns[0].T, np.hstack([np.zeros((3, 2)), np.diag(sizes)])])
    Q, _ = np.linalg.qr(A)
    jacobian = []
    for w in weights:
        J = np.vstack([np.column_stack([columns[1, 2:].T * w[2:], columns[2, 2:].T * w[2:]]), np.zeros((3, 6))])
        jacobian.append(J - Q @ (Q.T @ J))
    expected = 2 * sum(J.T @ J for J in jacobian)
    np.testing.assert_allclose(np.tril(hessian), np.tril(expected), rtol=1e-6, atol=1e-9 * np.abs(expected).max())


@settings(max_examples=40)
@given(seeds, st.integers(0, 12), st.integers(1, 3), st.integers(0, 12))
def test_errors_never_rise_and_belong_to_the_networks(seed, p, k, steps):
    start, y = table(MIXED, wavelets(seed, p), k=k), signal(seed, k)
    found = refine_rows(X, y[None], start, steps)
    before, after = found.traces[0]
    assert after == found.sse[0] <= before
    assert after == pytest.approx(((found.table[0](X) - y) ** 2).sum(), rel=1e-6, abs=1e-20)
    np.testing.assert_array_equal(found.table.kinds, start.kinds)


def test_no_steps_leave_the_wavelets_where_they_are():
    start = table(MIXED, wavelets(0, 5))
    found = refine_rows(X, signal(0)[None], start, steps=0)
    np.testing.assert_array_equal(found.table.centers, start.centers)
    np.testing.assert_array_equal(found.table.dilations, start.dilations)
    assert found.sse[0] == pytest.approx(least(start[0], signal(0)), rel=1e-9)


@each_mother
def test_planted_wavelets_are_found_again(psi):
    """From starts a fifth of a dilation away. The ridge moves the minimum by 1e-6 dilations at most."""
    centers, dilations = np.array([0.2, 0.5, 0.8]), np.array([0.05, 0.08, 0.04])
    planted = WaveletNetwork((psi,), [0, 0, 0], centers, dilations, [[1.0, 0.5], [-2.0, 1.0], [1.5, -1.0]], [[1.0, 2.0], [0.5, -1.0]])
    start = table((psi,), ([0, 0, 0], centers + 0.2 * dilations * [1, -1, 1], dilations * [1.1, 0.9, 1.1]), k=2)
    found = refine_rows(X, planted(X)[None], start).table
    exact = 3e-3 if psi is KINKED else 1e-6
    np.testing.assert_allclose((found.centers - centers) / dilations, 0, atol=exact)
    np.testing.assert_allclose(found.dilations / dilations, 1, atol=exact)
    np.testing.assert_allclose(found.weights, planted.weights, atol=10 * exact)
    np.testing.assert_allclose(found.affine[0], planted.affine, atol=10 * exact)


def test_refinement_pays():
    """A third of the squared error, or less: a geometric mean of 8 signals."""
    rows = np.stack([signal(seed) for seed in range(8)])
    start = table((HAT,), *[(np.zeros(8), np.linspace(0.05, 0.95, 8), np.full(8, 0.08))] * 8)
    found = refine_rows(X, rows, start)
    ratios = [after / before for before, after in found.traces]
    assert np.exp(np.log(ratios).mean()) < 1 / 3


@settings(max_examples=25)
@given(seeds, st.integers(1, 8))
def test_bounds_are_kept(seed, p):
    x = 5 + 3 * X
    kinds, centers, dilations = wavelets(seed, p)
    found = refine_rows(x, signal(seed)[None], table(MIXED, (kinds, 5 + 3 * centers, 3 * dilations))).table
    slack = 1e-12
    assert found.centers.min() >= 2 - slack
    assert found.centers.max() <= 11 + slack
    assert found.dilations.min() >= 3 / 128 * (1 - slack) or (found.dilations == 3 * dilations).any()
    assert found.dilations.max() <= 3 * (1 + slack)


def test_wavelets_that_are_hardly_seen_get_no_huge_weights():
    """One far outside, one between two samples, one pair that differs by a hair."""
    start = table((HAT,), ([0, 0, 0, 0], [1.9, 0.5 + 0.5 / 127, 0.3, 0.3 + 1e-9], [0.1, 1e-4, 0.1, 0.1]))
    found = refine_rows(X, signal(1)[None], start)
    assert np.abs(found.table.weights).max() < 1e3 * np.abs(signal(1)).max()
    assert found.sse[0] <= found.traces[0][0]


def test_copies_of_a_wavelet_part():
    y = (HAT((X - 0.4) / 0.06) + HAT((X - 0.5) / 0.1))[:, None]
    found = refine_rows(X, y[None], table((HAT,), ([0, 0], [0.45, 0.45], [0.08, 0.08])))
    assert found.sse[0] <= found.traces[0][0]
    assert np.isfinite(found.table.weights).all()


@pytest.mark.parametrize("y", [np.zeros(128), np.full(128, 7.0), 1e9 + 1e9 * X, np.full(128, 1e-200)])
def test_affine_signals_need_no_wavelet(y):
    start = table(MIXED, wavelets(0, 4))
    moved = refine_rows(X, y[None, :, None], start)
    np.testing.assert_array_equal(moved.table.centers, start.centers)
    np.testing.assert_allclose(moved.table[0](X)[:, 0], y, rtol=1e-9)
    assert len(interleave_rows(X, y[None, :, None], HATS).table[0]) == 0


@pytest.mark.parametrize("n", [2, 3, 5, 9])
def test_more_wavelets_than_samples(n):
    x = np.linspace(0, 1, n)
    y = np.random.default_rng(n).normal(size=(1, n, 1))
    found = refine_rows(x, y, table((HAT,), (np.zeros(12), np.linspace(0, 1, 12), np.full(12, 0.2))))
    assert found.sse[0] <= found.traces[0][0]
    grown = interleave_rows(x, y, HATS, Growth(12))
    assert (np.diff(grown.traces[0]) <= 0).all()
    assert grown.sse[0] < 1e-9 * (y**2).sum() + 0.5 * grown.traces[0][0]


def test_rows_may_have_different_numbers_of_wavelets():
    rows = np.stack([signal(seed, 2) for seed in range(4)])
    starts = [wavelets(seed, p) for seed, p in enumerate((3, 0, 7, 1))]
    together = refine_rows(X, rows, table(MIXED, *starts, k=2))
    np.testing.assert_array_equal(np.diff(together.table.offsets), [3, 0, 7, 1])
    for i, start in enumerate(starts):
        alone = refine_rows(X, rows[[i]], table(MIXED, start, k=2))
        assert alone.sse[0] == together.sse[i]
        np.testing.assert_array_equal(alone.table[0].centers, together.table[i].centers)
        np.testing.assert_array_equal(alone.table[0].weights, together.table[i].weights)


def test_neither_company_nor_threads_change_a_bit():
    rows = np.stack([signal(seed) for seed in range(5)])
    together = interleave_rows(X, rows, HATS, Growth(5))
    for i in range(5):
        alone = interleave_rows(X, rows[[i]], HATS, Growth(5))
        np.testing.assert_array_equal(alone.traces[0], together.traces[i])
        np.testing.assert_array_equal(alone.table[0].centers, together.table[i].centers)
    moved = refine_rows(X, rows[::-1], together.table, 5)
    with threads.limited(1):
        same(interleave_rows(X, rows, HATS, Growth(5)), together)
        same(refine_rows(X, rows[::-1], together.table, 5), moved)


def test_the_order_of_the_samples_does_not_matter():
    order = np.random.default_rng(0).permutation(len(X))
    y, start = signal(2), table(MIXED, wavelets(1, 5))
    straight, mixed = refine_rows(X, y[None], start), refine_rows(X[order], y[order][None], start)
    np.testing.assert_array_equal(mixed.table.centers, straight.table.centers)
    np.testing.assert_allclose(mixed.sse, straight.sse, rtol=1e-9)


def test_units_do_not_matter():
    """Places shifted and scaled, values scaled, an affine function added."""
    kinds, centers, dilations = wavelets(1, 5)
    y = signal(2)
    a = refine_rows(X, y[None], table(MIXED, (kinds, centers, dilations)))
    b = refine_rows(8 * X - 2, 1e6 * (y + X[:, None])[None], table(MIXED, (kinds, 8 * centers - 2, 8 * dilations)))
    np.testing.assert_allclose(b.sse, 1e12 * a.sse, rtol=1e-5)
    np.testing.assert_allclose((b.table.centers + 2) / 8, a.table.centers, atol=1e-5)


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_growing_networks_ask_for_no_unit(scale):
    y = signal(2)
    a, b = (interleave_rows(X, factor * y[None], HATS, Growth(7)) for factor in (1.0, scale))
    assert len(a.table[0]) == len(b.table[0]) == 7
    np.testing.assert_allclose(b.sse, scale**2 * a.sse, rtol=1e-5)


def test_samples_may_be_scattered_and_repeated():
    x = np.append(np.random.default_rng(0).uniform(0, 1, 100), [0, 0.5, 0.5, 1])
    found = interleave_rows(x, np.sin(9 * x)[None, :, None], dyadic_library([MOTHERS["polywog1"]], X), Growth(6))
    assert np.abs(found.table[0](x) - np.sin(9 * x)[:, None]).max() < 1e-3


@settings(max_examples=15)
@given(seeds, st.integers(1, 2))
def test_the_trace_never_rises_and_ends_with_the_error_of_the_network(seed, k):
    y = signal(seed, k)
    found = interleave_rows(X, y[None], HATS, Growth(7))
    trace = found.traces[0]
    assert len(trace) == len(found.table[0]) + 1 == 8
    assert (np.diff(trace) <= 0).all()
    assert trace[0] == pytest.approx(least(WaveletNetwork((HAT,), [], [], [], np.zeros((0, k)), np.zeros((2, k))), y), rel=1e-9)
    assert trace[-1] == found.sse[0] == pytest.approx(((found.table[0](X) - y) ** 2).sum(), rel=1e-6)


@given(seeds)
def test_the_first_pick_is_the_best_there_is(seed):
    """By brute force; without steps it stays where the library has it."""
    y = signal(seed)
    found = interleave_rows(X, y[None], HATS, Growth(1, steps=0, last_steps=0))
    few = np.random.default_rng(seed).choice(len(HATS), 40)
    errors = [least(WaveletNetwork((HAT,), [0], HATS.centers[[i]], HATS.dilations[[i]], [[1]], [[0], [0]]), y) for i in few]
    assert found.sse[0] <= min(errors) * ROUNDING
    assert np.isclose(HATS.centers, found.table.centers[0], atol=1e-12).any()


def test_later_picks_are_the_best_beside_the_wavelets_that_have_moved():
    """Nearly all of a candidate may lie in the span of the others: those are left alone, the rest is compared by brute force."""
    y, samples = np.ascontiguousarray(signal(4).T), np.vstack([X, affine_basis(X).T])
    theta = np.array([[0.21, 0.55, 0.8, 0.55 + 3e-7], np.log([0.3, 0.1, 0.05, 0.1])])  # two that are nearly one
    signals = refine._prepare(X, signal(4)[None], (HAT,))
    pool = refine._pool(signals, HATS)
    y = signals.unit(0)[0]
    Q, rest = descent.project(samples, signals.tables, y, np.zeros(4, int), theta)
    np.testing.assert_allclose(Q @ Q.T, np.eye(6), atol=1e-13)
    np.testing.assert_allclose(rest @ Q.T, 0, atol=1e-13)
    values = np.zeros((len(pool.first), len(X)))
    for i, first in enumerate(pool.first):
        part = pool.values[pool.offsets[i] : pool.offsets[i + 1]]
        values[i, first : first + len(part)] = part
    np.testing.assert_allclose(np.linalg.norm(values, axis=1), 1, rtol=1e-9)
    left = pool.inside - ((values @ Q[2:].T) ** 2).sum(axis=1)
    scores = np.where(left > descent.LEAST_REMAINDER * pool.inside, (values @ rest[0]) ** 2 / left, 0)
    assert descent.best_candidate(Q, rest, pool.values, pool.offsets, pool.first, pool.inside) == np.argmax(scores)


def test_interleaving_beats_refining_at_the_end():
    """A geometric mean of 8 signals, not a theorem."""
    rows = np.stack([signal(seed) for seed in range(8)])
    picked = interleave_rows(X, rows, HATS, Growth(8, steps=0, last_steps=0))
    late, inter = refine_rows(X, rows, picked.table), interleave_rows(X, rows, HATS, Growth(8))
    means = [np.exp(np.log(found.sse).mean()) for found in (picked, late, inter)]
    assert means[0] > 1.5 * means[1] > 1.5 * 1.2 * means[2]


def test_it_stops_at_the_tolerance():
    found = interleave_rows(X, signal(2, 3)[None], HATS, Growth(40, tolerance=1e-3))
    assert found.sse[0] / len(X) <= 1e-3 < found.traces[0][-2] / len(X)


def test_nothing_asked_for_nothing_found():
    assert len(interleave_rows(X, signal(0)[None], HATS, Growth(0)).table[0]) == 0
    assert len(interleave_rows(X, np.zeros((0, 128, 1)), HATS).table) == 0
    assert len(interleave_rows(X, signal(0)[None], Library((HAT,), [], [], [], []), Growth(3)).table[0]) == 0
    assert len(refine_rows(X, signal(0)[None], table((), ([], [], []))).table[0]) == 0


def test_refined_networks_survive_pickling():
    found = interleave_rows(X, signal(0)[None], HATS, Growth(3))
    same(pickle.loads(pickle.dumps(found)), found)


@pytest.mark.parametrize(
    ("x", "rows", "message"),
    [
        (X, np.where(X > 0.5, np.nan, 1)[None, :, None], "needed finite numbers in rows"),
        (X, X[:, None], r"needed rows of shape \(any, any, any\)"),
        (X, X[None, :50, None], "needed 128 values for 128 places; found 50"),
        (X, 1e200 * X[None, :, None], r"needed values up to 1e\+150; found 1e\+200; change the unit"),
        ([0.5, 0.5], [[[1.0], [2.0]]], "needed samples at 2 or more different places; found 1"),
        (X, np.zeros((2, 128, 1)), "needed a network for each of 2 rows; found 1"),
    ],
)
def test_unfit_samples_are_refused(x, rows, message):
    with pytest.raises(InputError, match=message):
        refine_rows(x, rows, table(MIXED, wavelets(0, 2)))


@pytest.mark.parametrize("options", [{"n_wavelets": -1}, {"tolerance": np.nan}, {"steps": -1}, {"last_steps": -2}])
def test_unfit_options_are_refused(options):
    with pytest.raises(InputError, match="needed counts >= 0 and a finite tolerance >= 0; found Growth"):
        Growth(**options)
    with pytest.raises(InputError, match="needed steps >= 0; found -1"):
        refine_rows(X, signal(0)[None], table(MIXED, wavelets(0, 2)), steps=-1)
