"""Anderson acceleration on linear maps, where it is known what it does: after enough steps it is exact."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.numerics.anderson import Anderson


def affine(seed: int, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A contraction x -> A x + b and its fixed point."""
    rng = np.random.default_rng(seed)
    Q = np.linalg.qr(rng.normal(size=(n, n)))[0]
    A, b = Q @ np.diag(rng.uniform(0.1, 0.95, n)) @ Q.T, rng.normal(size=n)
    return A, b, np.linalg.solve(np.eye(n) - A, b)


def run(faster: Anderson, A: np.ndarray, b: np.ndarray, x: np.ndarray, steps: int) -> np.ndarray:
    for _ in range(steps):
        x = faster.next(x, A @ x + b - x)
    return x


@given(seed=st.integers(0, 1000), n=st.integers(1, 3))
def test_exact_after_as_many_steps_as_unknowns(seed, n):
    """A window of n steps spans the space: the n+1st combination is the fixed point."""
    A, b, fixed = affine(seed, n)
    assert np.linalg.norm(run(Anderson(n), A, b, np.zeros(n), n + 1) - fixed) < 1e-3 * np.linalg.norm(fixed)


def test_without_a_window_it_is_the_plain_iteration():
    A, b, _ = affine(0, 5)
    x = np.ones(5)
    for _ in range(7):
        x = A @ x + b
    np.testing.assert_allclose(run(Anderson(0), A, b, np.ones(5), 7), x, rtol=1e-14)


def test_a_short_window_still_beats_the_plain_iteration():
    A, b, fixed = affine(1, 40)
    plain, fast = (np.linalg.norm(run(Anderson(m), A, b, np.zeros(40), 30) - fixed) for m in (0, 5))
    assert fast < 1e-2 * plain


def test_forgetting_starts_anew():
    A, b, _ = affine(2, 6)
    faster = Anderson(3)
    run(faster, A, b, np.ones(6), 9)
    faster.forget()
    np.testing.assert_allclose(run(faster, A, b, np.zeros(6), 5), run(Anderson(3), A, b, np.zeros(6), 5), rtol=1e-9)


@pytest.mark.parametrize("window", [1, 4])
def test_steps_that_repeat_do_no_harm(window):
    """At the fixed point all steps are zero; so are their differences."""
    faster = Anderson(window)
    for _ in range(6):
        assert faster.next(np.ones(3), np.zeros(3)).tolist() == [1, 1, 1]
        assert np.isfinite(faster.next(np.ones(3), np.full(3, 0.1))).all()


def test_points_keep_their_shape():
    assert Anderson(2).next(np.zeros((4, 3)), np.ones((4, 3))).tolist() == np.ones((4, 3)).tolist()
