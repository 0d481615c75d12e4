"""Fits: what each pick gains, least squares on the picks, known signals found again, and signals that are hardly any."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.errors import InputError
from morphlet.wavenet.fit import RULES, fit, fit_rows
from morphlet.wavenet.library import Library, dyadic_library
from morphlet.wavenet.mothers import PAPER_SIX

X = np.linspace(0, 1, 128)
SIX = dyadic_library(PAPER_SIX, X)
HATS = dyadic_library(["mexican_hat"], X)
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
    part = Library(net.mothers[:m], net.centers[:m], net.dilations[:m], np.zeros(m))
    return np.column_stack([np.ones_like(X), X, part.values(X)])


@pytest.mark.parametrize("method", ["ols", "omp"])
@pytest.mark.parametrize("outputs", [1, 3])
def test_each_pick_lowers_the_error_to_that_of_least_squares(method, outputs):
    """The trace is what is left at the end and the gains c^2 / n behind it: no projection in it but the last."""
    y = signal(1, outputs)
    found = fit(X, y, SIX, 12, method=method)
    direct = [least_squares(columns(SIX, found.network, m), y) for m in range(13)]
    np.testing.assert_allclose(found.sse, direct, atol=EXACT * direct[0])


@given(seeds)
def test_the_first_picks_are_the_best_there_are(seed):
    """Orthogonal least squares, each step by brute force over the library."""
    y, library = signal(seed), dyadic_library(["mexican_hat", "polywog1"], X, levels=3)
    found = fit(X, y, library, 3)
    values, chosen = library.values(X), np.column_stack([np.ones_like(X), X])
    for m in range(3):
        errors = [least_squares(np.column_stack([chosen, v]), y) for v in values.T]
        assert found.sse[m + 1] == pytest.approx(min(errors), rel=1e-6)
        chosen = columns(library, found.network, m + 1)


def test_matching_pursuits_pick_what_correlates_most():
    y, design = signal(4), HATS.design(X)
    Q, _ = np.linalg.qr(np.column_stack([np.ones_like(X), X]))
    best = np.argmax(np.abs(design.T @ (y - Q @ (Q.T @ y))))
    for method in ("omp", "mp"):
        assert fit(X, y, HATS, 1, method=method).network.centers[0] == HATS.centers[best]


@each_method
@given(seed=seeds)
def test_the_trace_ends_with_the_error_of_the_network_and_never_rises(method, seed):
    y = signal(seed, 2)
    found = fit(X, y, HATS, 10, method=method)
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
    found = fit(X, y, HATS, 20)
    order = np.argsort(found.network.centers)
    np.testing.assert_array_equal(found.network.centers[order], HATS.centers[of])
    np.testing.assert_allclose(found.network.weights[order], weights, atol=1e-9)
    np.testing.assert_allclose(found.network.affine, [[3, 3], [-5, -5]], atol=1e-9)
    assert found.reason == "exhausted"


@each_method
def test_rows_give_what_single_fits_give(method):
    rows = np.stack([signal(seed, 2) for seed in range(40)])
    together = fit_rows(X, rows, HATS, 8, method=method)
    for found, y in zip(together, rows, strict=True):
        alone = fit(X, y, HATS, 8, method=method)
        np.testing.assert_allclose(found.sse, alone.sse, rtol=1e-8)
        np.testing.assert_array_equal(found.network.centers, alone.network.centers)


@given(seeds)
def test_the_normalisation_does_not_matter_to_orthogonal_least_squares(seed):
    y = signal(seed)
    literal = fit(X, y, replace(SIX, normalisation="literal"), 6)
    np.testing.assert_allclose(fit(X, y, SIX, 6).sse, literal.sse, rtol=1e-6)


def test_the_published_normalisation_harms_matching_pursuit():
    """Broad candidates win whatever the signal: a geometric mean of 12 signals, not a theorem."""
    rows = np.stack([signal(seed) for seed in range(12)])
    ends = [
        np.log([found.sse[-1] for found in fit_rows(X, rows, library, 10, method="omp")]).mean()
        for library in (SIX, replace(SIX, normalisation="literal"))
    ]
    assert ends[1] > ends[0] + np.log(1.3)


def test_rules_rank_as_known():
    """Geometric means over signals; for a single signal any order can happen."""
    rows = np.stack([signal(seed) for seed in range(30)])
    ols, omp, mp = (np.log([found.sse[-1] for found in fit_rows(X, rows, SIX, 12, method=method)]).mean() for method in RULES)
    assert ols < omp < mp


@given(seeds, st.floats(-10, 10), st.floats(0.1, 10))
def test_errors_follow_the_scale_and_ignore_affine_functions(seed, slope, scale):
    y = signal(seed)
    moved = fit(X, scale * y + slope * X[:, None] - 1, HATS, 5)
    np.testing.assert_allclose(moved.sse, scale**2 * fit(X, y, HATS, 5).sse, rtol=1e-6)


@each_method
def test_it_stops_at_the_tolerance(method):
    found = fit(X, signal(2, 3), SIX, 40, tolerance=1e-3, method=method)
    assert found.reason == "tolerance"
    assert found.sse[-1] / len(X) <= 1e-3 < found.sse[-2] / len(X)


def test_no_wavelets_asked_for_leave_the_affine_part():
    found = fit(X, 1 + 2 * X[:, None], SIX, 0)
    np.testing.assert_allclose(found.network.affine, [[1], [2]], atol=EXACT)
    assert (len(found.network), len(found.sse), found.reason) == (0, 1, "count")


@each_method
@pytest.mark.parametrize("y", [np.zeros(128), np.full(128, 7.0), 1e9 + 1e9 * X, np.full(128, 1e-200)])
def test_affine_signals_need_no_wavelet(y, method):
    found = fit(X, y[:, None], SIX, 5, method=method)
    assert (len(found.network), found.reason) == (0, "exhausted")
    np.testing.assert_allclose(found.network(X)[:, 0], y, rtol=1e-12)


@pytest.mark.parametrize("n", [2, 3, 5, 9])
def test_more_wavelets_than_samples_meet_them_or_say_that_they_are_exhausted(n):
    x, y = np.linspace(0, 1, n), np.random.default_rng(n).normal(size=(n, 1))
    found = fit(x, y, dyadic_library(PAPER_SIX, X), 200)
    assert found.reason == "exhausted"
    assert len(found.network) <= n - 2
    np.testing.assert_allclose(found.network(x), y, atol=1e-9)


def test_copies_of_a_candidate_are_chosen_once():
    copies = Library(("slog1",) * 4, [0.4] * 4, [0.1, 0.1, 0.1, 0.1 * (1 + 1e-9)], [0] * 4)
    found = fit(X, signal(0), copies, 4)
    assert (len(found.network), found.reason) == (1, "exhausted")
    assert np.abs(found.network.weights).max() < 10


def test_matching_pursuit_counts_picks_and_keeps_one_wavelet_for_each_candidate():
    pair = Library(("slog1", "slog1"), [0.4, 0.5], [0.2, 0.2], [0, 0])
    found = fit(X, signal(0), pair, 9, method="mp")
    assert (len(found.network), len(found.sse)) == (2, 10)
    assert found.sse[-1] == pytest.approx(fit(X, signal(0), pair, 2).sse[-1], rel=0.05)


def test_an_empty_library_leaves_the_affine_part():
    found = fit([0.0, 1.0], [[3.0], [5.0]], dyadic_library(PAPER_SIX, [0.0, 1.0]), 5)
    np.testing.assert_allclose(found.network([0.5]), [[4]])
    assert found.reason == "exhausted"


def test_no_rows_have_no_fits():
    assert fit_rows(X, np.zeros((0, 128, 1)), HATS, 3) == ()


def test_samples_may_be_scattered_and_repeated():
    x = np.sort(np.append(np.random.default_rng(0).uniform(0, 1, 100), [0, 0.5, 0.5, 1]))
    y = np.sin(9 * x)[:, None]
    found = fit(x, y, dyadic_library(["polywog1"], x), 12)
    assert np.abs(found.network(x) - y).max() < 0.01


def test_fits_survive_pickling():
    found = fit(X, signal(0), HATS, 3)
    copy = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(copy.sse, found.sse)
    np.testing.assert_array_equal(copy.network(X), found.network(X))


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
        fit(x, y, HATS, 3)


@pytest.mark.parametrize(
    ("n_wavelets", "options", "message"),
    [
        (-1, {}, "needed n_wavelets >= 0 and a finite tolerance >= 0; found n_wavelets -1"),
        (3, {"tolerance": -1.0}, r"tolerance -1\.0; ask"),
        (3, {"tolerance": np.nan}, "tolerance nan; ask"),
        (3, {"method": "best"}, "needed a method of ols, omp, mp; found 'best'"),
    ],
)
def test_unfit_options_are_refused(n_wavelets, options, message):
    with pytest.raises(InputError, match=message):
        fit(X, X[:, None], HATS, n_wavelets, **options)
