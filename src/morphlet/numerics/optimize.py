"""Projected Newton for any smooth energy on a manifold, and the trace of its steps.

The energy may be +infinity outside its domain: a step is first cut to the domain by the problem's own bound, then halved
until it decreases enough, so every iterate stays inside.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from morphlet.errors import SolveError
from morphlet.numerics.linalg import Analysis

ARMIJO = 1e-4
"""Share of the linear decrease that an accepted step must reach."""
SAFE_SHARE = 0.8
"""Share of the way to the border of the domain that a step may take."""
LONGEST_STEP = 10.0
"""Multiple of the Newton step up to which the border is looked for: a projected Hessian is too stiff, longer steps may pay."""
HALVINGS = 15
DAMPING_PROJECTED = 1e-8
"""Added to the diagonal, relative to its mean, when every block is already positive semi-definite."""
DAMPING_RAW = 1e-6
DAMPING_RELATIVE = 1e-9
RAW_FAILURES = 2
"""After so many indefinite unprojected Hessians they are no longer tried."""


@dataclass(frozen=True)
class Step:
    """One iteration: the energy after it, the step length, whether it was accepted, the share of the whole job done."""

    stage: str
    iteration: int
    objective: float
    length: float
    accepted: bool
    progress: float


@dataclass(frozen=True)
class Trace:
    """Why and how an iteration stopped, and how many attempts failed before it."""

    steps: tuple[Step, ...]
    reason: str
    attempt: int = 0

    @property
    def iterations(self) -> int:
        """Number of accepted steps."""
        return sum(step.accepted for step in self.steps)


OnStep = Callable[[Step], None]


@runtime_checkable
class Problem(Protocol):
    """An energy on points x of a manifold, with d unknowns in its tangent space."""

    @property
    def analysis(self) -> Analysis:
        """Analysis of the Hessian's lower triangle."""

    @property
    def diagonal(self) -> np.ndarray:
        """Places of the diagonal among the Hessian's values."""

    def value(self, x: np.ndarray) -> float:
        """Energy at x, possibly +infinity."""

    def model(self, x: np.ndarray, project: bool) -> tuple[np.ndarray, np.ndarray]:
        """Gradient (d,) and Hessian values, with each block made positive semi-definite if `project`."""

    def matrix(self, hessian: Float[np.ndarray, "z"]) -> sp.csc_matrix:
        """The whole symmetric matrix with these Hessian values."""

    def direction(self, x: np.ndarray, step: Float[np.ndarray, "d"]) -> np.ndarray:
        """The step as a displacement of x."""

    def largest_step(self, x: np.ndarray, direction: np.ndarray, limit: float) -> float:
        """A multiple of the direction, at most `limit`, that stays in the domain."""

    def moved(self, x: np.ndarray, direction: np.ndarray, alpha: float) -> np.ndarray:
        """x moved along the direction, back on the manifold."""


@dataclass(frozen=True)
class NewtonOptions:
    """At most `iterations` steps, until the energy falls by less than `tolerance` of itself."""

    iterations: int
    tolerance: float
    try_raw: bool = False
    """Try the Hessian without projection first: pays on small problems only."""


def newton(
    problem: Problem, x: np.ndarray, options: NewtonOptions, report: Callable[[int, float, float, bool], None]
) -> tuple[np.ndarray, str]:
    """Minimise from x; the result and the reason for stopping.

    Raises
    ------
    SolveError
        If no positive definite model is found.

    Notes
    -----
    One factorization per iteration (two when the raw Hessian is tried and fails).
    """
    energy, failures = problem.value(x), 0 if options.try_raw else RAW_FAILURES
    for iteration in range(options.iterations):
        direction, slope, failures = _newton_direction(problem, x, failures)
        if slope == 0:
            return x, "gradient is zero"
        longest = SAFE_SHARE * problem.largest_step(x, direction, LONGEST_STEP)
        alpha = min(1.0, longest)
        for _ in range(HALVINGS):
            trial = problem.moved(x, direction, alpha)
            reached = problem.value(trial)
            if reached <= energy + ARMIJO * alpha * slope:
                break
            alpha /= 2
        else:
            report(iteration, energy, alpha, False)
            problem.value(x)
            return x, "no step decreases the energy"
        while 2 * alpha <= longest:
            further = problem.moved(x, direction, 2 * alpha)
            lower = problem.value(further)
            if lower >= reached:
                problem.value(trial)
                break
            alpha, trial, reached = 2 * alpha, further, lower
        decrease, x, energy = energy - reached, trial, reached
        report(iteration, energy, alpha, True)
        if decrease < options.tolerance * energy:
            return x, "energy settled"
    return x, "iteration limit"


def _newton_direction(problem: Problem, x: np.ndarray, failures: int) -> tuple[np.ndarray, float, int]:
    """Descent direction, its slope, and how often a raw Hessian has failed so far."""
    if failures < RAW_FAILURES:
        try:
            return *_solved(problem, x, DAMPING_RAW, False), failures
        except SolveError:
            failures += 1
    return *_solved(problem, x, DAMPING_PROJECTED, True), failures


def _solved(problem: Problem, x: np.ndarray, damping: float, project: bool) -> tuple[np.ndarray, float]:
    gradient, hessian = problem.model(x, project)
    if not (np.isfinite(gradient).all() and np.isfinite(hessian).all()):
        raise SolveError("a finite model of the energy", "NaN or infinite derivatives", "start farther from the border of the domain")
    diagonal = np.abs(hessian[problem.diagonal])
    hessian[problem.diagonal] += damping * diagonal.mean() + DAMPING_RELATIVE * diagonal
    step = -problem.analysis.factor(hessian).solve(gradient)
    slope = float(gradient @ step)
    if not slope <= 0:
        raise SolveError("a descent direction", f"slope {slope:.3g}", "check the Hessian")
    return problem.direction(x, step), slope


@dataclass(frozen=True)
class RegionOptions:
    """A trust region: first and largest radius (in the units of x), and when to stop."""

    radius: float
    largest: float
    iterations: int
    tolerance: float


ACCEPT, POOR, GOOD = 0.1, 0.25, 0.75
"""Ratio of actual to predicted decrease: accept above 0.1, shrink below 1/4, grow above 3/4 (Conn, Gould & Toint 2000)."""
SMALLEST_RADIUS = 1e-10
CONJUGATE_STEPS = 200
FORCING = 0.1
"""Conjugate gradients stop once the residual is a tenth of the gradient."""


def trust_region(
    problem: Problem, x: np.ndarray, options: RegionOptions, report: Callable[[int, float, float, bool], None]
) -> tuple[np.ndarray, str]:
    """Minimise from x within a trust region, its model solved by truncated conjugate gradients (Steihaug 1983).

    Stops as soon as the energy reaches 0, settles, or the region has shrunk to nothing; x never leaves the domain.
    """
    energy, radius = problem.value(x), options.radius
    for iteration in range(options.iterations):
        if energy <= 0:
            return x, "energy is zero"
        gradient, values = problem.model(x, True)
        matrix = problem.matrix(values)
        step = _steihaug(matrix, gradient, radius)
        direction = problem.direction(x, step)
        step = step * problem.largest_step(x, direction, 1.0)
        predicted = -float(gradient @ step + step @ (matrix @ step) / 2)
        trial = problem.moved(x, problem.direction(x, step), 1.0)
        reached = problem.value(trial)
        ratio = (energy - reached) / predicted if predicted > 0 and np.isfinite(reached) else -1.0
        length = float(np.linalg.norm(step))
        report(iteration, min(energy, reached), length, ratio > ACCEPT)
        if ratio < POOR:
            radius = min(radius, length) / 4
        elif ratio > GOOD and length > 0.9 * radius:
            radius = min(2 * radius, options.largest)
        if ratio > ACCEPT:
            settled = energy - reached < options.tolerance * energy
            x, energy = trial, reached
            if settled:
                return x, "energy settled"
        if radius < SMALLEST_RADIUS:
            return x, "trust region shrank to nothing"
    return x, "iteration limit"


def _steihaug(matrix: sp.csc_matrix, gradient: Float[np.ndarray, "d"], radius: float) -> Float[np.ndarray, "d"]:
    """The step of least model value that conjugate gradients find within the radius."""
    step, residual = np.zeros_like(gradient), -gradient
    search, square = residual.copy(), float(residual @ residual)
    goal = FORCING**2 * square
    for _ in range(CONJUGATE_STEPS):
        image = matrix @ search
        curvature = float(search @ image)
        alpha = square / curvature if curvature > 0 else np.inf
        if not np.isfinite(alpha) or np.linalg.norm(step + alpha * search) >= radius:
            return step + _to_border(step, search, radius) * search
        step = step + alpha * search
        residual = residual - alpha * image
        fresh = float(residual @ residual)
        if fresh <= goal:
            break
        search, square = residual + (fresh / square) * search, fresh
    return step


def _to_border(step: Float[np.ndarray, "d"], search: Float[np.ndarray, "d"], radius: float) -> float:
    """The positive t with |step + t search| = radius."""
    a, b, c = float(search @ search), float(step @ search), float(step @ step) - radius**2
    return (-b + np.sqrt(max(b * b - a * c, 0.0))) / a if a > 0 else 0.0
