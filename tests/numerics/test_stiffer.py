"""Factors of stiffer matrices, made from one factor: against matrices that were stiff from the start."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet.errors import InputError
from morphlet.numerics import linalg, stiffer
from numerics.test_linalg import grid_laplacian, lower

GRID = grid_laplacian(40, 50)
FACTOR = linalg.factorize(GRID)
ORDER = linalg.analyse(lower(GRID).indptr, lower(GRID).indices).order
BEND = sp.csc_matrix(GRID @ GRID)


def expected(A: sp.csc_matrix, unknowns: np.ndarray, stiffness: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Soft ones on the diagonal, hard ones left out; by SuperLU."""
    soft, n = np.isfinite(stiffness), A.shape[0]
    whole = sp.csc_matrix(A + sp.csc_matrix((stiffness[soft], (unknowns[soft], unknowns[soft])), shape=A.shape))
    kept = np.setdiff1d(np.arange(n), unknowns[~soft])
    x = np.zeros(b.shape)
    x[kept] = linalg.factorize(sp.csc_matrix(whole[kept][:, kept]), backend="superlu").solve(b[kept])
    return x


def near(answer: np.ndarray, wanted: np.ndarray, share: float = 1e-10) -> None:
    np.testing.assert_allclose(answer, wanted, rtol=0, atol=share * np.abs(wanted).max())


def test_exact_two_unknowns():
    """[[2, 1], [1, 2 + s]] x = (3, 3): x = (3 + 3 s, 3) / (3 + 2 s); others beside them, so that one of two is few."""
    factor = linalg.factorize(sp.csc_matrix(sp.block_diag([[[2.0, 1.0], [1.0, 2.0]], sp.identity(8)])))
    b = np.full(10, 3.0)
    for s in (0.5, 1.0, 7.0):
        np.testing.assert_allclose(factor.stiffened([1], [s]).solve(b)[:2], np.array([3 + 3 * s, 3]) / (3 + 2 * s), rtol=1e-14)
    np.testing.assert_allclose(factor.stiffened([1], [np.inf]).solve(b), [1.5, 0, *b[2:]], atol=1e-15)


@settings(max_examples=20, deadline=None, derandomize=True)
@given(seed=st.integers(0, 2**20), count=st.integers(1, 16), hard=st.floats(0, 1), close=st.booleans())
def test_it_is_the_stiffer_matrix(seed, count, hard, close):
    """Anywhere on a grid or side by side, soft or hard, in double and in single precision."""
    rng = np.random.default_rng(seed)
    n = GRID.shape[0]
    unknowns = rng.integers(0, n - count) + np.arange(count) if close else np.sort(rng.choice(n, count, replace=False))
    stiffness = np.where(rng.random(count) < hard, np.inf, 10.0 ** rng.uniform(-3, 5, count))
    b = rng.normal(size=(n, 3))
    found, wanted = FACTOR.stiffened(unknowns, stiffness), expected(GRID, unknowns, stiffness, b)
    near(found.solve(b), wanted)
    near(found.rough()(b[ORDER]), wanted[ORDER], 1e-4)


def test_a_plate_keeps_its_digits():
    """Bending: a solve loses more, and so does holding neighbours."""
    unknowns, b = 700 + np.arange(20), np.random.default_rng(2).normal(size=(BEND.shape[0], 2))
    near(linalg.factorize(BEND).stiffened(unknowns, np.full(20, np.inf)).solve(b), expected(BEND, unknowns, np.full(20, np.inf), b))


def test_any_number_of_right_hand_sides():
    found, b = FACTOR.stiffened([3, 900], [1.0, np.inf]), np.random.default_rng(3).normal(size=(GRID.shape[0], 5))
    whole = found.solve(b)
    for column in range(5):
        np.testing.assert_allclose(found.solve(b[:, column]), whole[:, column], rtol=1e-13, atol=1e-15)


def test_the_same_numbers_whatever_came_before():
    first, b = FACTOR.stiffened([5, 6, 7], np.full(3, np.inf)), np.ones((GRID.shape[0], 3))
    FACTOR.stiffened([100], [2.0]).rough()(b)
    again = FACTOR.stiffened([5, 6, 7], np.full(3, np.inf))
    np.testing.assert_array_equal(first.solve(b), again.solve(b))
    np.testing.assert_array_equal(first.rough()(b), again.rough()(b))
    np.testing.assert_array_equal(FACTOR.solve(b), linalg.factorize(GRID).solve(b))


def test_two_pieces():
    A = sp.csc_matrix(sp.block_diag([grid_laplacian(20, 20), grid_laplacian(15, 30)]))
    unknowns, b = np.array([7, 200, 600]), np.random.default_rng(4).normal(size=(A.shape[0], 2))
    near(linalg.factorize(A).stiffened(unknowns, np.full(3, np.inf)).solve(b), expected(A, unknowns, np.full(3, np.inf), b))


def test_nothing_stiffer_is_the_factor_itself():
    b = np.random.default_rng(5).normal(size=(GRID.shape[0], 2))
    np.testing.assert_array_equal(FACTOR.stiffened(np.zeros(0, int), np.zeros(0)).solve(b), FACTOR.solve(b))


def test_it_declines():
    """Too many; a stiffened one; another backend."""
    assert FACTOR.stiffened(np.arange(600), np.full(600, np.inf)) is None
    assert FACTOR.stiffened([3], [1.0]).stiffened([4], [1.0]) is None
    assert linalg.factorize(GRID, backend="superlu").stiffened([3], [1.0]) is None


def test_what_was_hardly_held_is_factored_anew(monkeypatch):
    """Only a spring of 1e-11 keeps the grid from floating off: pins beside each other would cancel all its digits."""
    n = GRID.shape[0]
    loose = sp.csc_matrix(GRID - 0.1 * sp.identity(n) + sp.csc_matrix(([1e-11], ([0], [0])), shape=(n, n)))
    factor, unknowns, hard = linalg.factorize(loose), np.arange(900, 904), np.full(4, np.inf)
    assert factor.stiffened(unknowns, hard) is None
    monkeypatch.setattr(stiffer, "LEAST", 0.0)
    b = np.random.default_rng(6).normal(size=(n, 1))
    with pytest.raises(AssertionError):
        near(factor.stiffened(unknowns, hard).solve(b), expected(loose, unknowns, hard, b))


@pytest.mark.parametrize(
    ("unknowns", "stiffness"), [([3, 2], [1.0, 1.0]), ([2, 2], [1.0, 1.0]), ([2], [0.0]), ([2], [np.nan]), ([2], [-1.0]), ([2, 3], [1.0])]
)
def test_bad_unknowns_and_stiffness(unknowns, stiffness):
    with pytest.raises(InputError, match="ascending unknowns, a positive stiffness"):
        FACTOR.stiffened(unknowns, stiffness)


def test_unknowns_that_there_are_not():
    with pytest.raises(InputError, match="unknowns"):
        FACTOR.stiffened([GRID.shape[0]], [1.0])
