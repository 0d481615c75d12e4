"""Libraries of wavelets: what the grid holds, what is left out, and how candidates are normalised (Eq. 5)."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.errors import InputError
from morphlet.wavenet.library import Library, dyadic_library
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX, beta

X = np.linspace(0, 1, 128)
HAT, SLOG1, BETA2 = (MOTHERS[name] for name in ("mexican_hat", "slog1", "beta2"))
SIX = dyadic_library(PAPER_SIX, X)
ROUNDING = 1e-12


def test_dilations_halve_from_a_half_down_to_the_distance_of_the_samples():
    hats = dyadic_library([HAT], X, levels=9)
    assert np.unique(hats.dilations).tolist() == [2.0**-k for k in range(6, 0, -1)]
    np.testing.assert_array_equal(hats.dilations, 0.5 * 0.5**hats.bands)


def test_levels_and_voices_say_how_many_bands_there_are():
    assert np.unique(dyadic_library([SLOG1], X, levels=0).dilations).tolist() == [0.5]
    third = dyadic_library([SLOG1], X, levels=2, voices=3)
    np.testing.assert_allclose(np.unique(third.dilations), 0.5 * 2.0 ** (-np.arange(6, -1, -1) / 3), rtol=ROUNDING)
    np.testing.assert_allclose(third.dilations, 0.5 * 2.0 ** (-third.bands / 3), rtol=ROUNDING)


@pytest.mark.parametrize("spacing", [1.0, 0.5])
def test_centers_step_by_the_dilation_and_mirror_about_the_middle(spacing):
    hats = dyadic_library([HAT], X, spacing=spacing)
    for band in np.unique(hats.bands):
        of = hats.bands == band
        np.testing.assert_allclose(np.diff(hats.centers[of]), spacing * hats.dilations[of][1:], rtol=1e-9)
        np.testing.assert_allclose(hats.centers[of] + hats.centers[of][::-1], 1, atol=ROUNDING)
        assert hats.centers[of].min() <= 0
        assert hats.centers[of].max() >= 1


def test_the_grids_of_several_mothers_are_interleaved():
    both = dyadic_library([HAT, BETA2], X)
    narrow = np.sort(both.centers[(both.bands == 5) & (np.abs(both.centers - 0.5) < 0.4)])
    np.testing.assert_allclose(np.diff(narrow), 1 / 128, rtol=1e-9)
    assert dyadic_library(PAPER_SIX, X).centers.tolist() == SIX.centers.tolist()


def test_every_candidate_has_three_samples_in_reach_and_a_norm():
    reach = np.array([psi.reach for psi in SIX.mothers])[SIX.kinds]
    z = np.abs(X[:, None] - SIX.centers) / SIX.dilations
    assert (z <= reach).sum(axis=0).min() >= 3
    whole = SIX.dilations * (len(X) - 1)
    assert ((SIX.values(X) ** 2).sum(axis=0) / whole).min() >= 1e-6


def test_a_candidate_that_all_samples_in_reach_see_at_its_zero_is_left_out():
    crowd = np.concatenate([[0], np.linspace(0.5 - 1e-7, 0.5 + 1e-7, 60), [1]])
    at_middle = {}
    for psi in (MOTHERS["polywog1"], HAT):
        library = dyadic_library([psi], crowd)
        at_middle[psi.name] = bool((library.centers[library.bands == 4] == 0.5).any())
    assert at_middle == {"polywog1": False, "mexican_hat": True}


def test_a_gap_in_the_samples_holds_no_candidates():
    """Nothing is seen of a narrow wavelet between 0.2 and 0.8."""
    gapped = np.concatenate([np.linspace(0, 0.2, 60), np.linspace(0.8, 1, 60)])
    library = dyadic_library([BETA2], gapped)
    narrow = library.centers[library.bands == library.bands.max()]
    edge = BETA2.reach * library.dilations.min()
    assert len(narrow) > 20
    assert not ((narrow > 0.2 + edge) & (narrow < 0.8 - edge)).any()


def test_values_are_mothers_dilated_and_shifted():
    library = Library((beta(2, 4, 8), SLOG1), [1, 0], [0.2, 0.6], [0.1, 0.3], [0, 1])
    np.testing.assert_allclose(library.values(X)[:, 0], SLOG1((X - 0.2) / 0.1), atol=ROUNDING)
    np.testing.assert_allclose(library.values(X)[:, 1], beta(2, 4, 8)((X - 0.6) / 0.3), atol=ROUNDING)


def test_columns_are_of_unit_norm_and_orthogonal_to_affine_functions():
    design = SIX.design(X)
    np.testing.assert_allclose(np.linalg.norm(design, axis=0), 1, rtol=ROUNDING)
    np.testing.assert_allclose(np.stack([np.ones_like(X), X]) @ design, 0, atol=1e-10)
    parts = np.linalg.lstsq(np.column_stack([np.ones_like(X), X, SIX.values(X)[:, 100]]), design[:, 100], rcond=None)
    assert parts[1][0] < 1e-20  # nothing but the candidate and an affine function


def test_columns_that_are_nearly_affine_are_orthogonal_to_rounding_too():
    near = np.linspace(-1e-3, 1e-3, 50)
    design = Library((MOTHERS["polywog1"], SLOG1), [0, 1], [0, 0], [1, 1], [0, 0]).design(near)
    np.testing.assert_allclose(np.stack([np.full(50, 50**-0.5), near / np.linalg.norm(near)]) @ design, 0, atol=1e-14)


def test_the_published_exponent_gives_the_norm_psi_squared():
    """Far from the ends the affine part is nothing: the norm of alpha psi is sum psi^2, about samples times dilation."""
    literal = replace(SIX, normalisation="literal")
    norms = np.linalg.norm(literal.design(X), axis=0)
    inside = (np.abs(SIX.centers - 0.5) < 0.1) & (SIX.dilations < 0.03)
    np.testing.assert_allclose(norms[inside], ((len(X) - 1) * SIX.dilations)[inside], rtol=0.06)
    assert norms.max() / norms.min() > 10


def test_a_candidate_that_is_affine_on_the_samples_is_zero():
    two = np.array([0.0, 1.0])
    assert not Library((HAT, SLOG1), [0, 1], [0.3, 0.6], [0.5, 0.5], [0, 0]).design(two).any()


@given(st.floats(-5, 5), st.floats(0.1, 10))
def test_columns_do_not_change_when_everything_is_shifted_and_scaled(shift, scale):
    small = dyadic_library([MOTHERS["polywog1"], MOTHERS["beta3"]], X, levels=3)
    moved = Library(small.mothers, small.kinds, small.centers * scale + shift, small.dilations * scale, small.bands)
    np.testing.assert_allclose(moved.design(X * scale + shift), small.design(X), atol=1e-7)


def test_it_is_read_only_and_survives_pickling():
    with pytest.raises(ValueError, match="read-only"):
        SIX.centers[0] = 1
    copy = pickle.loads(pickle.dumps(replace(SIX, normalisation="literal")))
    assert ([psi.name for psi in copy.mothers], copy.normalisation) == ([psi.name for psi in SIX.mothers], "literal")
    assert copy.mothers == SIX.mothers  # those of the table themselves
    for name in ("kinds", "centers", "dilations", "bands"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(SIX, name))


def test_two_samples_see_no_wavelet():
    assert len(dyadic_library(PAPER_SIX, [0.0, 1.0])) == 0


@pytest.mark.parametrize(
    ("points", "options", "message"),
    [
        ([0.5], {}, "needed 2 or more different points; found 1"),
        ([0.5, 0.5], {}, "needed 2 or more different points; found 1"),
        ([0, 0.5, 2], {}, r"needed points from 0 to 1; found 1 outside \(first: 2\); shift and scale"),
        ([0, np.nan, 1], {}, "needed finite numbers in points"),
        ([[0, 1]], {}, r"needed points of shape \(any\)"),
        (X, {"levels": -1}, "needed levels >= 0, voices >= 1, spacing > 0; found levels -1"),
        (X, {"voices": 0}, "found levels 6, voices 0"),
        (X, {"spacing": 0.0}, r"spacing 0\.0; start from"),
        (X, {"spacing": np.nan}, "spacing nan; start from"),
    ],
)
def test_unfit_points_and_options_are_refused(points, options, message):
    with pytest.raises(InputError, match=message):
        dyadic_library([SLOG1], points, **options)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (((SLOG1,), [1], [0], [1], [0]), "needed indices from 0 to 0 in kinds; found 1 outside"),
        (((SLOG1,), [-1], [0], [1], [0]), "needed indices from 0 to 0 in kinds"),
        (((SLOG1,), [0], [0, 1], [1], [0]), r"needed centers of shape \(1\)"),
        (((SLOG1,), [0], [0], [1, 1], [0]), r"needed dilations of shape \(1\)"),
        (((SLOG1,), [0], [0], [0], [0]), "needed dilations > 0; found 1 that are not"),
        (((SLOG1,), [0], [0], [1], [-1]), "indices from 0"),
        (((SLOG1,), [0], [0], [1], [0], "both"), "needed a normalisation 'unit' or 'literal'; found 'both'"),
        ((("slog1",), [0], [0], [1], [0]), r"needed mothers; found str; take them from MOTHERS, or call mother\(name\)"),
        (((SLOG1, SLOG1), [0], [0], [1], [0]), "needed each mother once; found slog1, slog1; name each once"),
    ],
)
def test_unfit_libraries_are_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        Library(*arguments)


@pytest.mark.parametrize(
    ("mothers", "message"),
    [
        ([SLOG1, SLOG1], "needed each mother once; found slog1, slog1"),
        (["slog1"], "needed mothers; found str"),
        ([SLOG1, None], "needed mothers; found Mother, NoneType"),
        ("slog1", "needed mothers; found str, str, str, str, str"),
    ],
)
def test_grids_need_mothers_each_once(mothers, message):
    with pytest.raises(InputError, match=message):
        dyadic_library(mothers, X)
