"""As-rigid-as-possible editing: every cell keeps its shape as well as a rotation of its own lets it.

The spokes-and-rims energy is lowered in turns: the best rotation of every cell, then the positions that fit these
rotations best, by one solve with a factor that never changes. The first positions come from the linear method with estimated
rotations, and the iteration is accelerated by combining its last steps, unless that would raise the energy.
"""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.editing.estimated import checked_targets, checked_turns, estimated, spread
from morphlet.editing.kernels import Stars, sweep
from morphlet.editing.method import Pull
from morphlet.editing.roi import Roi
from morphlet.editing.smoothing import SmoothedSweep, coloured
from morphlet.editing.system import System, regripped, system
from morphlet.errors import InputError
from morphlet.numerics.anderson import Anderson
from morphlet.numerics.optimize import OnStep, Step
from morphlet.numerics.rotations import exponential


@dataclass(frozen=True, eq=False)
class PlainSweep:
    """One pass over the cells, each with the rotation that fits it best."""

    stars: Stars
    gain: ClassVar[float] = 0.0  # these rotations are the best there are

    def __call__(self, positions: Float[np.ndarray, "p 3"], residual: Float[np.ndarray, "p 3"]) -> float:
        """Write the residual of each unknown; the energy but for a constant."""
        return sweep(self.stars, positions, residual)

    def accept(self) -> None:
        """Nothing to remember."""


Visits = tuple[Int[np.ndarray, "c"], Int[np.ndarray, "k"]]
"""The cells sorted by colour, and where each colour starts."""

Local = PlainSweep | SmoothedSweep
"""A pass over the cells."""

STILL = 1e-24
"""Promised decrease, relative to the patch's energy, that no longer moves anything: steps of some 1e-12 of the patch."""

ROUNDING = 1e-13
"""Rise of the energy, relative to the patch's, that is rounding: the energy is a difference of two sums of that size."""


@dataclass(frozen=True)
class Arap:
    """Spokes-and-rims as-rigid-as-possible editing.

    Parameters
    ----------
    iterations
        At most so many pairs of a local and a global step.
    tolerance
        Stop when a global step promises to lower the energy by less than this share of it; with smoothing, what the last pass over
        the rotations gained counts too. With 3e-5, the bends and twists of Botsch & Sorkine's survey end within 0.6 % of the
        lowest energy seen, a bar twisted with smoothing within 0.2 %.
    anderson
        How many past steps to combine; 0 for the plain iteration. With smoothing, the rotations are part of the state and no steps
        are combined: that would gain nothing.
    smoothing
        How strongly the rotations of neighbours are drawn together (alpha of Levi & Gotsman), whatever the size of the mesh. A bar of
        square section, twisted by 135 degrees, loses 48, 34, 23, 22 and 25 % of its volume with 0, 2e-5, 2e-4, 0.002 and 0.02;
        edges change by 6.8, 8.7, 11.7, 12.3 and 13.0 %, and triangles cross with 0 alone. From about 0.002 on, a cell's own shape
        hardly counts: with 0.02 the bar is within a thousandth of its length of what `EstimatedRotations` makes. 0, the
        default, is the plain energy.
    least_cotangent
        Half cotangents below this are raised to it. By default they are left alone: the energy is never negative.

    Notes
    -----
    An iteration costs one pass over the cells and one solve with three right-hand sides.

    References
    ----------
    Chao, Pinkall, Sanan, Schroeder, A simple geometric model for elastic deformations, ACM Transactions on Graphics 29, 2010.
    Levi and Gotsman, Smooth rotation enhanced as-rigid-as-possible mesh animation, IEEE TVCG 21, 2015.
    Peng et al., Anderson acceleration for geometry optimization and physics simulation, ACM Transactions on Graphics 37, 2018.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.arap import Arap
    >>> from morphlet.editing.editor import edit
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> edit(Roi(strip, [4, 5], [2, 3]), strip.vertices[[4, 5]], Arap()).vertices[2:4].round(12).tolist()
    [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]
    """

    iterations: int = 100
    tolerance: float = 3e-5
    anderson: int = 5
    smoothing: float = 0.0
    least_cotangent: float = -np.inf

    def __post_init__(self) -> None:
        if self.iterations < 1 or self.anderson < 0 or not self.tolerance >= 0 or not 0 <= self.smoothing < np.inf:
            raise InputError(
                "at least 1 iteration; a tolerance, a number of past steps and a smoothing that are not negative",
                f"iterations {self.iterations}, tolerance {self.tolerance}, anderson {self.anderson}, smoothing {self.smoothing}",
                "change these options",
            )

    def prepare(self, roi: Roi) -> "PreparedArap":
        """Factor the region's system."""
        known = system(roi, self.least_cotangent)
        visits = coloured(known.patch.stars, len(known.patch.vertices)) if self.smoothing else None
        return PreparedArap(self, known, visits)


@dataclass(frozen=True, eq=False)
class PreparedArap:
    """`Arap` for one region."""

    options: Arap
    system: System
    visits: Visits | None = None

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`."""
        roi = self.system.roi
        targets = checked_targets(roi, pull)
        if pull.start is None:
            positions = estimated(self.system, self.system.correct, targets, checked_turns(roi, pull, targets))
        else:
            positions = self._started(targets, _arrays.real(pull.start, "start", (len(roi.moving), 3)))
        _minimise(self, self._local(pull, targets), positions, targets, on_step)
        return self.system.grip.answer(positions, targets)

    def with_roi(self, roi: Roi) -> "PreparedArap | None":
        """The same method with another handle, if its free vertices are among this one's; None elsewhere, and with smoothing."""
        fresh = regripped(self.system, roi) if self.visits is None else None
        return None if fresh is None else PreparedArap(self.options, fresh)

    def _started(self, targets: Float[np.ndarray, "h 3"], start: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "p 3"]:
        """The patch with its handle at the targets, the others where the start says."""
        grip = self.system.grip
        positions = grip.begin(self.system.patch.rest, targets)
        positions[grip.own] = start[grip.own_place]
        return positions

    def _local(self, pull: Pull, targets: Float[np.ndarray, "h 3"]) -> Local:
        """The pass over the cells."""
        whole, grip, roi = self.system.patch, self.system.grip, self.system.roi
        if self.visits is None:
            return PlainSweep(whole.stars)
        turns = checked_turns(roi, pull, targets)
        rotations = np.tile(np.eye(3).ravel(), (len(whole.vertices), 1))
        rotations[grip.held] = exponential(turns).reshape(-1, 9)[roi.handle_parts[grip.held_index]]
        rotations[: whole.n_cells] = spread(self.system, self.system.correct, turns)
        return SmoothedSweep(whole.stars, self.visits, self.options.smoothing * roi.mesh.area, rotations)


def _minimise(
    prepared: PreparedArap, local: Local, positions: Float[np.ndarray, "p 3"], targets: Float[np.ndarray, "h 3"], on_step: OnStep | None
) -> None:
    """Lower the energy of the positions, in place; the last step is a plain one, which cannot raise it."""
    known, options = prepared.system, prepared.options
    whole, grip, n = known.patch, known.grip, known.patch.n_unknowns
    residual, safe = np.empty_like(positions), positions[:n].copy()
    memory = Anderson(options.anderson if prepared.visits is None else 0)
    constant, highest = whole.constant(positions), np.inf
    for iteration in range(options.iterations if n else 0):
        energy = constant + local(positions, residual) + grip.pull(positions, targets, residual)
        accepted = energy <= highest
        if not accepted:
            positions[:n] = safe
            memory.forget()
            energy = constant + local(positions, residual) + grip.pull(positions, targets, residual)
        local.accept()
        highest, step = energy + ROUNDING * whole.scale, known.correct(residual)
        if on_step is not None:
            on_step(Step("arap", iteration, energy, 1.0, accepted, (iteration + 1) / options.iterations))
        safe = positions[:n] + step
        promised = np.einsum("kd,kd->", residual[:n], step) + local.gain
        if promised <= max(options.tolerance * energy, STILL * whole.scale) or iteration + 1 == options.iterations:
            break
        positions[:n] = memory.next(positions[:n], step)
    positions[:n] = safe
