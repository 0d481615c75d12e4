"""Fits: what each pick gains, least squares on the picks, known signals found again, and signals that are hardly any."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.errors import InputError
from morphlet.numerics import threads
from morphlet.numerics.threads import limited
from morphlet.wavenet.fit import FitOptions, fit, fit_rows
from morphlet.wavenet.library import Library, dyadic_library
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX
from morphlet.wavenet.pursuit import RULES, prepare, pursue

X = np.linspace(0, 1, 128)
SIX = dyadic_library(PAPER_SIX, X)
HATS = dyadic_library([MOTHERS["mexican_hat"]], X)
EXACT = 1e-12
each_method = pytest.mark.parametrize("method", RULES)
seeds = st.integers(0, 10**6)


def signal(seed, k=1, n=128):
    """Smooth waves with a kink."""
    rng, x = np.random.default_rng(seed), np.linspace(0, 1, n)
    waves = np.arange(1, 20)
    phases = rng.uniform(0, 6, (k, 19))
    values = (rng.normal(size=(k, 19)) / waves**1.5 * np.cos(2 * np.pi * np.multiply.outer(x, waves)[:, None] + phases)).sum(axis=2)
    return values + rng.normal(size=k) * np.abs(x - rng.uniform(0.2, 0.8))[:, None]


def least_squares(columns, y):
    """Sum of squares that the columns leave of y, by orthogonal projection."""
    Q, _ = np.linalg.qr(columns)
    return float(((y - Q @ (Q.T @ y)) ** 2).sum())


def columns(library, net, m):
    """The affine functions and the first m wavelets of a network."""
    part = Library(net.mothers, net.kinds[:m], net.centers[:m], net.dilations[:m], np.zeros(m))
    return np.column_stack([np.ones_like(X), X, part.values(X)])


@pytest.mark.parametrize("method", ["ols", "omp"])
@pytest.mark.parametrize("outputs", [1, 3])
def test_each_pick_lowers_the_error_to_that_of_least_squares(method, outputs):
    """The trace is what is left at the end and the gains c^2 / n behind it: no projection in it but the last."""
    y = signal(1, outputs)
    found = fit(X, y, SIX, FitOptions(12, method=method))
    direct = [least_squares(columns(SIX, found.network, m), y) for m in range(13)]
    np.testing.assert_allclose(found.sse, direct, atol=EXACT * direct[0])


@given(seeds)
def test_the_first_picks_are_the_best_there_are(seed):
    """Orthogonal least squares, each step by brute force over the library."""
    y, library = signal(seed), dyadic_library([MOTHERS["mexican_hat"], MOTHERS["polywog1"]], X, levels=3)
    found = fit(X, y, library, FitOptions(3))
    values, chosen = library.values(X), np.column_stack([np.ones_like(X), X])
    for m in range(3):
        errors = [least_squares(np.column_stack([chosen, v]), y) for v in values.T]
        assert found.sse[m + 1] == pytest.approx(min(errors), rel=1e-6)
        chosen = columns(library, found.network, m + 1)


@given(seeds)
def test_gains_are_squared_correlations_over_squared_norms(seed):
    """c^2 / n of what the picks before leave of the signal and of the candidate, by projection with QR."""
    y = signal(seed)
    found = fit(X, y, SIX, FitOptions(6))
    basis = columns(SIX, found.network, 6)
    for m, gain in enumerate(-np.diff(found.sse)):
        Q, _ = np.linalg.qr(basis[:, : m + 2])
        left, candidate = (v - Q @ (Q.T @ v) for v in (y[:, 0], basis[:, m + 2]))
        candidate -= Q @ (Q.T @ candidate)
        assert gain == pytest.approx((candidate @ left) ** 2 / (candidate @ candidate), rel=EXACT, abs=EXACT * found.sse[0])


def test_gains_are_exact_where_they_are_large():
    """The same to 1e-12 of the gain itself, straight from the choice, for picks that lower the error much."""
    y = signal(1)
    candidates = prepare(X, SIX, 4)
    rests = (y - candidates.basis @ (candidates.basis.T @ y))[None]
    picks = pursue(candidates, rests, np.array([(y**2).sum()]), ("ols", 4, 0.0))
    for m in range(4):
        Q, _ = np.linalg.qr(candidates.design[:, picks.picks[0, :m]])
        left, candidate = (v - Q @ (Q.T @ v) for v in (rests[0, :, 0], candidates.design[:, picks.picks[0, m]]))
        assert picks.gains[0, m] == pytest.approx((candidate @ left) ** 2 / (candidate @ candidate), rel=EXACT)


@each_method
@pytest.mark.parametrize("normalisation", ["unit", "literal"])
def test_weights_are_those_of_the_wavelets_whatever_their_normalisation(method, normalisation):
    """Orthogonal rules leave what least squares on the bare wavelets leaves; the affine part is fitted beside all of them."""
    y = signal(5, 2)
    net = fit(X, y, replace(SIX, normalisation=normalisation), FitOptions(9, method=method)).network
    bare = columns(SIX, net, len(net))
    np.testing.assert_allclose(net(X), bare @ np.concatenate([net.affine, net.weights]), atol=1e-12 * np.abs(net.weights).max())
    residual = net(X) - y
    np.testing.assert_allclose(bare[:, :2].T @ residual, 0, atol=1e-9)
    if method != "mp":
        solution = np.linalg.lstsq(bare, y, rcond=None)[0]
        np.testing.assert_allclose(np.concatenate([net.affine, net.weights]), solution, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("normalisation", ["unit", "literal"])
def test_one_step_of_matching_pursuit_is_the_projection_on_the_pick(normalisation):
    y = signal(6)
    found = fit(X, y, replace(SIX, normalisation=normalisation), FitOptions(1, method="mp"))
    assert found.sse[-1] == pytest.approx(least_squares(columns(SIX, found.network, 1), y), rel=1e-10)


def test_matching_pursuits_pick_what_correlates_most():
    y, design = signal(4), HATS.design(X)
    Q, _ = np.linalg.qr(np.column_stack([np.ones_like(X), X]))
    best = np.argmax(np.abs(design.T @ (y - Q @ (Q.T @ y))))
    for method in ("omp", "mp"):
        assert fit(X, y, HATS, FitOptions(1, method=method)).network.centers[0] == HATS.centers[best]


@each_method
@given(seed=seeds)
def test_the_trace_ends_with_the_error_of_the_network_and_never_rises(method, seed):
    y = signal(seed, 2)
    found = fit(X, y, HATS, FitOptions(10, method=method))
    assert found.sse[-1] == pytest.approx(((found.network(X) - y) ** 2).sum(), rel=1e-9)
    assert (np.diff(found.sse) <= 0).all()
    assert found.sse[0] == pytest.approx(least_squares(columns(HATS, found.network, 0), y), rel=1e-9)
    assert (found.reason, len(found.sse)) == ("count", 11)


@given(seeds, st.integers(1, 4))
def test_a_network_of_the_library_is_found_again(seed, p):
    """So far apart that none reaches another: then least squares picks exactly these."""
    rng = np.random.default_rng(seed)
    narrow = np.nonzero((HATS.bands == 4) & (np.abs(HATS.centers - 0.5) < 0.4))[0][::8]
    of = np.sort(rng.choice(narrow, min(p, len(narrow)), replace=False))
    weights = rng.uniform(1, 2, (len(of), 2)) * rng.choice([-1, 1], (len(of), 2))
    y = HATS.values(X)[:, of] @ weights + 3 - 5 * X[:, None]
    found = fit(X, y, HATS, FitOptions(20))
    order = np.argsort(found.network.centers)
    np.testing.assert_array_equal(found.network.centers[order], HATS.centers[of])
    np.testing.assert_allclose(found.network.weights[order], weights, atol=1e-9)
    np.testing.assert_allclose(found.network.affine, [[3, 3], [-5, -5]], atol=1e-9)
    assert found.reason == "exhausted"


@each_method
@pytest.mark.parametrize("options", [{}, {"tolerance": 3e-3}, {"stop": "gcv"}])
def test_rows_give_what_single_fits_give(method, options):
    """To rounding: single fits compute only the inner products that they need."""
    rows = np.stack([signal(seed, 2) for seed in range(40)])
    together = fit_rows(X, rows, HATS, FitOptions(8, method=method, **options))
    assert (len(together.table), len(together.sse), len(together.reasons)) == (40, 40, 40)
    for i, y in enumerate(rows):
        alone = fit(X, y, HATS, FitOptions(8, method=method, **options))
        assert together.reasons[i] == alone.reason
        assert together.sse[i] == pytest.approx(alone.sse[-1], rel=1e-10)
        for name in ("kinds", "centers", "dilations"):
            np.testing.assert_array_equal(getattr(together.table[i], name), getattr(alone.network, name))
        np.testing.assert_allclose(together.table[i].weights, alone.network.weights, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(together.table[i].affine, alone.network.affine, rtol=1e-9, atol=1e-11)


@each_method
def test_a_row_does_not_depend_on_the_others(method):
    """To rounding: products of matrices are summed in an order that depends on their size."""
    rows = np.stack([signal(seed, 2) for seed in range(50)])
    options = FitOptions(8, method=method)
    every, few = fit_rows(X, rows, HATS, options), fit_rows(X, rows[10:37], HATS, options)
    for i in range(27):
        np.testing.assert_array_equal(few.table[i].centers, every.table[10 + i].centers)
        np.testing.assert_allclose(few.table[i].weights, every.table[10 + i].weights, rtol=1e-10, atol=1e-12)


@each_method
def test_the_number_of_threads_changes_no_bit(method):
    rows = np.stack([signal(seed, 2) for seed in range(70)])
    results = []
    for count in (1, 2, 5, None):
        with limited(count):
            results.append(fit_rows(X, rows, HATS, FitOptions(8, method=method)))
    for other in results[1:]:
        for name in ("offsets", "kinds", "centers", "dilations", "weights", "affine"):
            assert getattr(other.table, name).tobytes() == getattr(results[0].table, name).tobytes(), name
        assert other.sse.tobytes() == results[0].sse.tobytes()
        assert other.reasons == results[0].reasons


def test_the_kernels_run_in_pieces_on_several_threads(monkeypatch):
    """What the test above relies on even where there is one core."""
    monkeypatch.setattr(threads, "available", lambda: 4)
    rows = np.stack([signal(seed, 2) for seed in range(70)])
    several = fit_rows(X, rows, HATS, FitOptions(8))
    monkeypatch.setattr(threads, "available", lambda: 1)
    assert several.table.weights.tobytes() == fit_rows(X, rows, HATS, FitOptions(8)).table.weights.tobytes()


@given(seeds)
def test_the_normalisation_does_not_matter_to_orthogonal_least_squares(seed):
    y = signal(seed)
    literal = fit(X, y, replace(SIX, normalisation="literal"), FitOptions(6))
    np.testing.assert_allclose(fit(X, y, SIX, FitOptions(6)).sse, literal.sse, rtol=1e-6)


def test_the_published_normalisation_harms_matching_pursuit():
    """Broad candidates win whatever the signal: a geometric mean of 12 signals, not a theorem."""
    rows = np.stack([signal(seed) for seed in range(12)])
    libraries = (SIX, replace(SIX, normalisation="literal"))
    ends = [np.log(fit_rows(X, rows, library, FitOptions(10, method="omp")).sse).mean() for library in libraries]
    assert ends[1] > ends[0] + np.log(1.3)


def test_rules_rank_as_known():
    """Geometric means over signals; for a single signal any order can happen."""
    rows = np.stack([signal(seed) for seed in range(30)])
    ols, omp, mp = (np.log(fit_rows(X, rows, SIX, FitOptions(12, method=method)).sse).mean() for method in RULES)
    assert ols < omp < mp


@given(seeds, st.floats(-10, 10), st.floats(0.1, 10))
def test_errors_follow_the_scale_and_ignore_affine_functions(seed, slope, scale):
    y = signal(seed)
    moved = fit(X, scale * y + slope * X[:, None] - 1, HATS, FitOptions(5))
    np.testing.assert_allclose(moved.sse, scale**2 * fit(X, y, HATS, FitOptions(5)).sse, rtol=1e-6)


@each_method
def test_it_stops_at_the_tolerance(method):
    found = fit(X, signal(2, 3), SIX, FitOptions(40, tolerance=1e-3, method=method))
    assert found.reason == "tolerance"
    assert found.sse[-1] / len(X) <= 1e-3 < found.sse[-2] / len(X)


def test_no_wavelets_asked_for_leave_the_affine_part():
    found = fit(X, 1 + 2 * X[:, None], SIX, FitOptions(0))
    np.testing.assert_allclose(found.network.affine, [[1], [2]], atol=EXACT)
    assert (len(found.network), len(found.sse), found.reason) == (0, 1, "count")


@each_method
@pytest.mark.parametrize("y", [np.zeros(128), np.full(128, 7.0), 1e9 + 1e9 * X, np.full(128, 1e-200)])
def test_affine_signals_need_no_wavelet(y, method):
    found = fit(X, y[:, None], SIX, FitOptions(5, method=method))
    assert (len(found.network), found.reason) == (0, "exhausted")
    np.testing.assert_allclose(found.network(X)[:, 0], y, rtol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 5, 9])
def test_more_wavelets_than_samples_meet_them_or_say_that_they_are_exhausted(n):
    x, y = np.linspace(0, 1, n), np.random.default_rng(n).normal(size=(n, 1))
    found = fit(x, y, dyadic_library(PAPER_SIX, X), FitOptions(200))
    assert found.reason == "exhausted"
    assert len(found.network) <= n - 2
    np.testing.assert_allclose(found.network(x), y, atol=1e-9)


def test_copies_of_a_candidate_are_chosen_once():
    copies = Library((MOTHERS["slog1"],), [0] * 4, [0.4] * 4, [0.1, 0.1, 0.1, 0.1 * (1 + 1e-9)], [0] * 4)
    found = fit(X, signal(0), copies, FitOptions(4))
    assert (len(found.network), found.reason) == (1, "exhausted")
    assert np.abs(found.network.weights).max() < 10


def test_matching_pursuit_counts_picks_and_keeps_one_wavelet_for_each_candidate():
    pair = Library((MOTHERS["slog1"],), [0, 0], [0.4, 0.5], [0.2, 0.2], [0, 0])
    found = fit(X, signal(0), pair, FitOptions(9, method="mp"))
    assert (len(found.network), len(found.sse)) == (2, 10)
    assert found.sse[-1] == pytest.approx(fit(X, signal(0), pair, FitOptions(2)).sse[-1], rel=0.05)


def test_matching_pursuit_keeps_the_order_of_first_choices():
    """Beside a plain pursuit on the columns; it comes back to some of them."""
    library, y = dyadic_library([MOTHERS["mexican_hat"]], X, levels=3), signal(3)
    design, affine = library.design(X), columns(HATS, fit(X, y, HATS, FitOptions(0)).network, 0)
    left, picks = y[:, 0] - affine @ np.linalg.lstsq(affine, y[:, 0], rcond=None)[0], []
    for _ in range(20):
        picks.append(int(np.argmax(np.abs(design.T @ left))))
        left = left - design[:, picks[-1]] * (design[:, picks[-1]] @ left)
    order = list(dict.fromkeys(picks))
    assert 5 < len(order) < 20
    found = fit(X, y, library, FitOptions(20, method="mp"))
    np.testing.assert_array_equal(found.network.centers, library.centers[order])
    assert found.sse[-1] == pytest.approx(float(left @ left), rel=1e-9)


@each_method
def test_an_empty_library_leaves_the_affine_part(method):
    found = fit([0.0, 1.0], [[3.0], [5.0]], dyadic_library(PAPER_SIX, [0.0, 1.0]), FitOptions(5, method=method))
    np.testing.assert_allclose(found.network([0.5]), [[4]])
    assert (found.reason, len(found.sse)) == ("exhausted", 1)
    assert found.network.counts() == dict.fromkeys(["mexican_hat", "slog1", "polywog1", "beta1", "beta2", "beta3"], 0)


def test_no_rows_have_no_fits():
    found = fit_rows(X, np.zeros((0, 128, 1)), HATS, FitOptions(3))
    assert (len(found.table), found.sse.shape, found.reasons) == (0, (0,), ())
    assert found.table(X).shape == (0, 128, 1)


@each_method
def test_signals_of_no_outputs_have_networks_of_none(method):
    found = fit(X, np.zeros((128, 0)), HATS, FitOptions(3, method=method))
    assert (len(found.network), found.network(X).shape, found.reason) == (0, (128, 0), "exhausted")


def noisy(seed, amplitude=0.05):
    """A smooth signal, and the same with noise."""
    truth = (np.sin(9 * X) + 1.5 * np.exp(-(((X - 0.6) / 0.08) ** 2)))[:, None]
    return truth, truth + amplitude * np.random.default_rng(seed).normal(size=(128, 1))


def test_validation_takes_few_wavelets_for_noise():
    """The best of 154 candidates fits noise better than one fixed in advance does, which validation does not know."""
    noise = np.random.default_rng(0).normal(size=(30, 128, 1))
    found = fit_rows(X, noise, HATS, FitOptions(30, stop="gcv"))
    counts = np.diff(found.table.offsets)
    assert np.median(counts) <= 2
    assert counts.max() <= 6
    assert set(found.reasons) == {"gcv"}


def test_validation_stops_a_noisy_fit_nearer_to_the_truth():
    """In the mean over 30 draws of the noise; fewer wavelets than asked for in each."""
    draws = [noisy(seed) for seed in range(30)]
    rows = np.stack([y for _, y in draws])
    errors = {}
    for stop in ("count", "gcv"):
        found = fit_rows(X, rows, HATS, FitOptions(40, stop=stop))
        errors[stop] = float(((found.table(X) - draws[0][0]) ** 2).mean())
        assert set(found.reasons) == {stop}
        assert (np.diff(found.table.offsets) < 40).all() == (stop == "gcv")
    assert errors["gcv"] < 0.8 * errors["count"]


def test_validation_lets_signals_without_noise_go_on():
    rows = np.stack([signal(seed) for seed in range(30)])
    found = fit_rows(X, rows, SIX, FitOptions(15, stop="gcv"))
    assert found.reasons.count("count") >= 27


@each_method
def test_validation_is_least_at_its_count(method):
    """SSE / (1 - (3 m + 2) / n)^2 over the trace of a fit without it."""
    _, y = noisy(3)
    trace = fit(X, y, HATS, FitOptions(30, method=method)).sse
    score = trace / (1 - (3 * np.arange(31) + 2) / 128) ** 2
    found = fit(X, y, HATS, FitOptions(30, method=method, stop="gcv"))
    assert len(found.sse) == np.argmin(score) + 1 < 31
    np.testing.assert_allclose(found.sse, trace[: len(found.sse)], rtol=1e-9)
    assert found.reason == "gcv"


def test_validation_counts_common_parameters_once_for_all_outputs():
    y = np.concatenate([noisy(seed)[1] for seed in range(3)], axis=1)
    trace = fit(X, y, HATS, FitOptions(30)).sse
    score = trace / (1 - (np.arange(31) * (1 + 2 / 3) + 2) / 128) ** 2
    assert len(fit(X, y, HATS, FitOptions(30, stop="gcv")).network) == np.argmin(score)


def test_validation_of_very_few_samples_takes_none():
    x = np.linspace(0, 1, 4)
    found = fit(x, [[0.0], [1.0], [0.0], [1.0]], dyadic_library(PAPER_SIX, X), FitOptions(5, stop="gcv"))
    assert (len(found.network), found.reason) == (0, "gcv")


def test_samples_may_be_scattered_and_repeated():
    x = np.sort(np.append(np.random.default_rng(0).uniform(0, 1, 100), [0, 0.5, 0.5, 1]))
    y = np.sin(9 * x)[:, None]
    found = fit(x, y, dyadic_library([MOTHERS["polywog1"]], x), FitOptions(12))
    assert np.abs(found.network(x) - y).max() < 0.01


def test_fits_survive_pickling():
    found = fit(X, signal(0), HATS, FitOptions(3))
    copy = pickle.loads(pickle.dumps(found))
    assert copy.reason == found.reason
    np.testing.assert_array_equal(copy.sse, found.sse)
    np.testing.assert_array_equal(copy.network(X), found.network(X))
    rows = fit_rows(X, np.stack([signal(0), signal(1)]), HATS, FitOptions(3))
    again = pickle.loads(pickle.dumps(rows))
    assert again.reasons == rows.reasons
    np.testing.assert_array_equal(again.sse, rows.sse)
    np.testing.assert_array_equal(again.table(X), rows.table(X))


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [
        (X, np.where(X > 0.5, np.nan, 1)[:, None], "needed finite numbers in y; found 64 NaN"),
        (np.where(X > 0.5, np.inf, 1), X[:, None], "needed finite numbers in x"),
        (X, 1e200 * X[:, None], r"needed values up to 1e\+150; found 1e\+200; change the unit"),
        (X, X, r"needed y of shape \(any, any\); found shape \(128,\)"),
        (X, X[:50, None], "needed 128 values for 128 places; found 50"),
        ([0.5], [[1.0]], "needed samples at 2 or more different places; found 1"),
        ([0.5, 0.5], [[1.0], [2.0]], "needed samples at 2 or more different places; found 1"),
        ([], np.zeros((0, 1)), "needed samples at 2 or more different places; found 0"),
    ],
)
def test_unfit_samples_are_refused(x, y, message):
    with pytest.raises(InputError, match=message):
        fit(x, y, HATS, FitOptions(3))


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (X, r"needed rows of shape \(any, any, any\); found shape \(128,\)"),
        (np.zeros((2, 50, 1)), "needed 128 values for 128 places; found 50"),
        (np.full((2, 128, 1), np.nan), "needed finite numbers in rows"),
    ],
)
def test_unfit_rows_are_refused(rows, message):
    with pytest.raises(InputError, match=message):
        fit_rows(X, rows, HATS)


@pytest.mark.parametrize(
    ("n_wavelets", "options", "message"),
    [
        (-1, {}, "needed n_wavelets >= 0 and a finite tolerance >= 0; found n_wavelets -1"),
        (3, {"tolerance": -1.0}, r"tolerance -1\.0; ask"),
        (3, {"tolerance": np.nan}, "tolerance nan; ask"),
        (3, {"tolerance": np.inf}, "tolerance inf; ask"),
        (3, {"method": "best"}, "needed a method of ols, omp, mp; found 'best'"),
        (3, {"stop": "aic"}, "needed a stop of count, gcv; found 'aic'"),
    ],
)
def test_unfit_options_are_refused(n_wavelets, options, message):
    with pytest.raises(InputError, match=message):
        fit(X, X[:, None], HATS, FitOptions(n_wavelets, **options))


@pytest.mark.parametrize("refinement", ["final", "interleaved"])
def test_refinement_follows_the_samples_more_closely(refinement):
    """A geometric mean over signals; wavelets move and the count stays."""
    rows = np.stack([signal(seed) for seed in range(12)])
    plain, moved = fit_rows(X, rows, HATS, FitOptions(8)), fit_rows(X, rows, HATS, FitOptions(8, refinement=refinement))
    assert len(moved.table.centers) == len(plain.table.centers) == 96
    assert np.log(moved.sse).mean() < np.log(plain.sse).mean() - np.log(1.5)
    np.testing.assert_allclose(((moved.table(X) - rows) ** 2).sum(axis=(1, 2)), moved.sse, rtol=1e-9)
    alone = fit(X, rows[3], HATS, FitOptions(8, refinement=refinement))
    assert alone.sse[-1] == pytest.approx(moved.sse[3], rel=1e-9)
    assert (len(alone.sse), alone.reason) == (9, "count")
    assert (np.diff(alone.sse) <= 0).all()


def test_final_refinement_never_harms():
    rows = np.stack([signal(seed, 2) for seed in range(6)])
    plain, moved = fit_rows(X, rows, HATS, FitOptions(5)), fit_rows(X, rows, HATS, FitOptions(5, refinement="final"))
    assert (moved.sse <= plain.sse * (1 + 1e-12)).all()


def test_interleaved_refinement_stops_at_the_tolerance_and_by_cross_validation():
    rng = np.random.default_rng(0)
    smooth = np.sin(7 * X)[None, :, None]
    near = fit_rows(X, smooth, HATS, FitOptions(20, tolerance=1e-4, refinement="interleaved"))
    assert near.reasons == ("tolerance",)
    assert near.sse[0] <= 1e-4 * len(X)
    noisy = smooth + 0.1 * rng.normal(size=(1, 128, 1))
    few = fit_rows(X, noisy, HATS, FitOptions(20, stop="gcv", refinement="interleaved"))
    full = fit_rows(X, noisy, HATS, FitOptions(20, refinement="interleaved"))
    assert few.reasons == ("gcv",)
    assert len(few.table.centers) < 12
    assert np.abs(few.table(X) - smooth).mean() < np.abs(full.table(X) - smooth).mean()


def test_refinement_of_no_rows_is_nothing():
    assert len(fit_rows(X, np.zeros((0, 128, 1)), HATS, FitOptions(3, stop="gcv", refinement="interleaved")).table) == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"refinement": "much"}, "needed a refinement of none, final, interleaved; found 'much'"),
        ({"refinement": "interleaved", "method": "mp"}, "needed method ols with interleaved refinement; found mp"),
    ],
)
def test_unfit_refinement_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        FitOptions(**options)
