"""Exact signs, against integers of any length."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import support
from morphlet.numerics.predicates import determinant_signs

DOUBLES = st.floats(allow_nan=False, allow_infinity=False, allow_subnormal=True, width=64)
ROWS = st.lists(st.lists(DOUBLES, min_size=9, max_size=9), min_size=1, max_size=5)


@given(ROWS)
def test_any_doubles(rows: list[list[float]]) -> None:
    a, b, c = np.array(rows).reshape(-1, 3, 3).transpose(1, 0, 2)
    np.testing.assert_array_equal(determinant_signs(a, b, c)[0], support.determinant_signs(a, b, c))


@given(st.integers(0, 2**32 - 1), st.integers(0, 80))
def test_nearly_coplanar_unit_vectors(seed: int, closeness: int) -> None:
    rng = np.random.default_rng(seed)
    a, b = rng.normal(size=(2, 40, 3))
    c = rng.normal(size=(40, 1)) * a + rng.normal(size=(40, 1)) * b + 2.0**-closeness * rng.normal(size=(40, 3))
    a, b, c = (x / np.linalg.norm(x, axis=1, keepdims=True) for x in (a, b, c))
    signs, uncertain = determinant_signs(a, b, c)
    np.testing.assert_array_equal(signs, support.determinant_signs(a, b, c))
    assert uncertain == 0 or closeness > 30


def test_collinear_and_repeated_vectors_are_zero_and_neighbours_are_not() -> None:
    a = np.array([[0.1, 0.2, 0.3]])
    b = np.array([[0.7, -0.4, 0.9]])
    assert determinant_signs(a, b, a)[0].tolist() == [0]
    assert determinant_signs(a, b, 3 * a)[0].tolist() == support.determinant_signs(a, b, 3 * a).tolist()
    assert determinant_signs(a, b, 4 * b)[0].tolist() == [0]
    nudged = a.copy()
    nudged[0, 2] = np.nextafter(0.3, 1)
    signs, uncertain = determinant_signs(a, b, nudged)
    assert uncertain == 1
    assert abs(signs[0]) == 1
    assert signs.tolist() == support.determinant_signs(a, b, nudged).tolist()


TINY = 5e-324


@pytest.mark.parametrize("scale", [TINY, 1e-320, 1e-200, 1e-100, 1e100, 1e200, 1e307])
def test_scales_at_which_products_underflow_or_overflow(scale: float) -> None:
    rows = np.array([np.eye(3), np.eye(3)[[1, 0, 2]], np.ones((3, 3)), np.diag([1, 1, 0])]) * scale
    signs, _ = determinant_signs(*rows.transpose(1, 0, 2))
    assert signs.tolist() == [1, -1, 0, 0]


def test_products_that_underflow_beside_a_huge_factor() -> None:
    # b1 c2 = 2.4e-324 rounds to 0, yet times a0 = 1e300 it outweighs a1 b0 c2 = 1e-24
    a, b, c = np.array([[1e300, 1, 0]]), np.array([[1e138, 2.4e-162, 0]]), np.array([[0, 0, 1e-162]])
    assert determinant_signs(a, b, c)[0].tolist() == support.determinant_signs(a, b, c).tolist() == [1]


def test_swapping_two_vectors_swaps_the_sign() -> None:
    rng = np.random.default_rng(3)
    a, b, c = rng.integers(-3, 4, size=(3, 500, 3)).astype(float)
    signs = determinant_signs(a, b, c)[0]
    assert set(signs.tolist()) == {-1, 0, 1}
    np.testing.assert_array_equal(determinant_signs(b, a, c)[0], -signs)
    np.testing.assert_array_equal(determinant_signs(b, c, a)[0], signs)
    np.testing.assert_array_equal(signs, np.sign(np.round(np.linalg.det(np.stack([a, b, c], axis=1)))))


def test_no_rows() -> None:
    nothing = np.empty((0, 3))
    signs, uncertain = determinant_signs(nothing, nothing, nothing)
    assert (len(signs), uncertain) == (0, 0)
