"""Newton and trust region on problems small enough to know the answer of."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pytest
import scipy.sparse as sp

from morphlet.errors import Cancelled, SolveError
from morphlet.numerics.linalg import Analysis, analyse
from morphlet.numerics.optimize import NewtonOptions, RegionOptions, Step, Trace, newton, trust_region


@dataclass
class Plane:
    """A function of two variables as a problem; `border` bounds the first variable from above."""

    energy: Callable[[np.ndarray], float]
    gradient: Callable[[np.ndarray], np.ndarray]
    hessian: Callable[[np.ndarray], np.ndarray]
    border: float = np.inf
    projections: list[bool] = field(default_factory=list)

    @cached_property
    def analysis(self) -> Analysis:
        return analyse(np.array([0, 2, 3]), np.array([0, 1, 1]))

    @property
    def diagonal(self) -> np.ndarray:
        return np.array([0, 2])

    def value(self, x: np.ndarray) -> float:
        return float(self.energy(x)) if x[0] < self.border else np.inf

    def model(self, x: np.ndarray, project: bool) -> tuple[np.ndarray, np.ndarray]:
        self.projections.append(project)
        H = np.asarray(self.hessian(x), float)
        if project:
            values, vectors = np.linalg.eigh(H)
            H = vectors @ np.diag(np.maximum(values, 0)) @ vectors.T
        return np.asarray(self.gradient(x), float), np.array([H[0, 0], H[1, 0], H[1, 1]])

    def matrix(self, hessian: np.ndarray) -> sp.csc_matrix:
        return sp.csc_matrix([[hessian[0], hessian[1]], [hessian[1], hessian[2]]])

    def direction(self, x: np.ndarray, step: np.ndarray) -> np.ndarray:
        return step

    def largest_step(self, x: np.ndarray, direction: np.ndarray, limit: float) -> float:
        return min(limit, (self.border - x[0]) / direction[0]) if direction[0] > 0 else limit

    def moved(self, x: np.ndarray, direction: np.ndarray, alpha: float) -> np.ndarray:
        return x + alpha * direction


def quadratic(border: float = np.inf) -> Plane:
    """Least value 0 at (1, 2)."""
    A, x0 = np.array([[3.0, 1.0], [1.0, 2.0]]), np.array([1.0, 2.0])
    return Plane(lambda x: (x - x0) @ A @ (x - x0) / 2, lambda x: A @ (x - x0), lambda x: A, border)


def rosenbrock() -> Plane:
    """Least value 0 at (1, 1), at the end of a bent valley."""
    return Plane(
        lambda x: (1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2,
        lambda x: [-2 * (1 - x[0]) - 400 * x[0] * (x[1] - x[0] ** 2), 200 * (x[1] - x[0] ** 2)],
        lambda x: [[2 - 400 * (x[1] - 3 * x[0] ** 2), -400 * x[0]], [-400 * x[0], 200.0]],
    )


def saddle() -> Plane:
    """x^4 / 4 - x^2 / 2 + y^2: a saddle at the origin, least value -1/4 at (1, 0) and (-1, 0)."""
    return Plane(
        lambda x: x[0] ** 4 / 4 - x[0] ** 2 / 2 + x[1] ** 2,
        lambda x: [x[0] ** 3 - x[0], 2 * x[1]],
        lambda x: np.diag([3 * x[0] ** 2 - 1, 2.0]),
    )


class Log:
    """What the solver reported."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, float, float, bool]] = []

    def __call__(self, iteration: int, energy: float, length: float, accepted: bool) -> None:
        self.rows.append((iteration, energy, length, accepted))

    @property
    def energies(self) -> list[float]:
        return [energy for _, energy, _, accepted in self.rows if accepted]


def test_newton_needs_one_step_on_a_quadratic() -> None:
    log = Log()
    x, reason = newton(quadratic(), np.array([-5.0, 9.0]), NewtonOptions(10, 1e-6), log)
    np.testing.assert_allclose(x, [1, 2], atol=1e-5)  # the damping of 1e-8 of the diagonal keeps it from being exact
    assert log.energies[0] < 1e-12
    assert reason == "gradient is zero"


def test_newton_walks_down_the_bent_valley() -> None:
    log = Log()
    x, _ = newton(rosenbrock(), np.array([-1.2, 1.0]), NewtonOptions(60, 1e-9, try_raw=True), log)
    np.testing.assert_allclose(x, [1, 1], atol=1e-6)
    assert (np.diff(log.energies) < 0).all()


def test_newton_stops_at_its_limit_and_says_so() -> None:
    log = Log()
    _, reason = newton(rosenbrock(), np.array([-1.2, 1.0]), NewtonOptions(3, 1e-12), log)
    assert reason == "iteration limit"
    assert [row[0] for row in log.rows] == [0, 1, 2]


def test_newton_never_leaves_the_domain() -> None:
    log = Log()
    x, _ = newton(quadratic(border=0.5), np.array([-5.0, 9.0]), NewtonOptions(30, 1e-12), log)
    assert np.isfinite(log.energies).all()
    assert x[0] < 0.5
    assert x[0] == pytest.approx(0.5, abs=1e-3)


def test_an_indefinite_hessian_is_tried_raw_then_projected_and_raw_is_given_up() -> None:
    problem = saddle()
    newton(problem, np.array([0.1, 1.0]), NewtonOptions(1, 1e-12, try_raw=True), Log())
    assert problem.projections == [False, True]
    nothing_left = Plane(problem.energy, problem.gradient, lambda x: -np.eye(2))  # projected: zero, and so is its damping
    with pytest.raises(SolveError, match="positive definite"):
        newton(nothing_left, np.array([0.1, 1.0]), NewtonOptions(1, 1e-12), Log())


def test_derivatives_that_are_not_finite_are_a_solve_error() -> None:
    problem = quadratic()
    problem.gradient = lambda x: np.array([np.nan, 1.0])
    with pytest.raises(SolveError, match="NaN or infinite"):
        newton(problem, np.zeros(2), NewtonOptions(3, 1e-6), Log())
    problem = quadratic()
    problem.hessian = lambda x: np.diag([np.inf, 1.0])
    with pytest.raises(SolveError, match="NaN or infinite"):
        newton(problem, np.zeros(2), NewtonOptions(3, 1e-6, try_raw=True), Log())


def test_newton_at_the_minimum_keeps_it() -> None:
    problem = quadratic()
    problem.gradient = lambda x: np.array([0.0, 0.0])
    x, reason = newton(problem, np.array([1.0, 2.0]), NewtonOptions(3, 1e-6), Log())
    assert (x.tolist(), reason) == ([1, 2], "gradient is zero")


def test_the_trust_region_walks_down_the_bent_valley() -> None:
    log = Log()
    x, reason = trust_region(rosenbrock(), np.array([-1.2, 1.0]), RegionOptions(1.0, 10.0, 200, 1e-12), log)
    np.testing.assert_allclose(x, [1, 1], atol=1e-4)
    assert (np.diff(log.energies) < 0).all()
    assert reason in ("energy settled", "trust region shrank to nothing", "energy is zero")


def test_steps_stay_in_the_region_which_grows_no_further_than_allowed() -> None:
    log = Log()
    trust_region(quadratic(), np.array([-500.0, 900.0]), RegionOptions(1.0, 8.0, 30, 1e-12), log)
    lengths = [length for _, _, length, _ in log.rows]
    assert lengths[:4] == pytest.approx([1, 2, 4, 8])
    assert max(lengths) <= 8 * (1 + 1e-12)


def test_the_trust_region_stops_at_zero_and_at_a_saddle() -> None:
    assert trust_region(quadratic(), np.array([1.0, 2.0]), RegionOptions(1.0, 8.0, 9, 0.0), Log())[1] == "energy is zero"
    problem = saddle()
    shifted = Plane(lambda x: problem.energy(x) + 1, problem.gradient, problem.hessian)
    x, reason = trust_region(shifted, np.array([0.0, 0.0]), RegionOptions(1.0, 8.0, 60, 0.0), Log())
    assert (x == 0).all()
    assert reason == "trust region shrank to nothing"


def test_the_trust_region_never_leaves_the_domain() -> None:
    x, _ = trust_region(quadratic(border=0.5), np.array([-5.0, 9.0]), RegionOptions(1.0, 8.0, 60, 1e-9), Log())
    assert x[0] < 0.5
    assert quadratic().value(x) < quadratic().value(np.array([-5.0, 9.0])) / 10


def test_whoever_listens_may_stop_either_method() -> None:
    def stop(*_: object) -> None:
        raise Cancelled

    for call in (
        lambda: newton(rosenbrock(), np.array([-1.2, 1.0]), NewtonOptions(5, 1e-6), stop),
        lambda: trust_region(rosenbrock(), np.array([-1.2, 1.0]), RegionOptions(1.0, 10.0, 5, 1e-6), stop),
    ):
        with pytest.raises(Cancelled, match="a request to stop"):
            call()


def test_a_trace_counts_accepted_steps() -> None:
    steps = tuple(Step("newton", i, 1.0, 0.5, i != 1, 0.1) for i in range(4))
    assert Trace(steps, "energy settled").iterations == 3
