"""Colours: ends, order, refusals."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import InputError
from morphlet.report.color import ColorScale, place_colors


def test_a_scale_is_linear_between_its_ends_and_constant_beyond():
    gray = ColorScale(2.0, 4.0, "gray")([1.0, 2.0, 3.0, 4.0, 9.0])
    np.testing.assert_allclose(gray[:, 0], [0, 0, 128 / 255, 1, 1], atol=1 / 255)
    np.testing.assert_array_equal(gray[:, 0], gray[:, 2])


def test_a_scale_of_values_leaves_the_extremes_out():
    values = np.r_[np.linspace(0, 1, 1001), 1e6]
    scale = ColorScale.of(values, "mm")
    assert 0 < scale.low < 0.02
    assert 0.98 < scale.high < 1
    assert scale.label == "mm"


@given(st.floats(-1e6, 1e6), st.integers(1, 5))
def test_equal_values_have_a_scale_too(value, count):
    scale = ColorScale.of(np.full(count, value))
    assert scale.low == value < scale.high


def test_no_values_have_a_scale():
    assert ColorScale.of(np.zeros(0)).low == 0


@pytest.mark.parametrize(("low", "high"), [(1.0, 1.0), (2.0, 1.0), (float("nan"), 1.0)])
def test_a_scale_without_width_is_refused(low, high):
    with pytest.raises(InputError, match="low < high"):
        ColorScale(low, high)


def test_an_unknown_palette_is_refused():
    with pytest.raises(InputError, match="'no-such-map'"):
        ColorScale(0.0, 1.0, "no-such-map")


def test_nan_has_no_color():
    with pytest.raises(InputError, match="finite numbers in values"):
        ColorScale(0.0, 1.0)([np.nan])


def test_places_differ_in_color_along_each_axis_on_its_own():
    colors = place_colors(np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0], [0, 0, 4.0]]))
    np.testing.assert_array_equal((colors - colors[0] > 0.5)[1:], np.eye(3, dtype=bool))
    assert place_colors(np.zeros((0, 3))).shape == (0, 3)
    np.testing.assert_array_equal(place_colors(np.ones((2, 3)))[0], place_colors(np.ones((2, 3)))[1])
