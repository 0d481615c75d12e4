"""Laplacian editing with estimated rotations (paper, Sect. 8.1): linear, two solves with one factor.

Each piece of the handle turns by a rotation vector, estimated from its targets or told. The vectors spread over the patch
harmonically, 0 at the anchors; each cell's rest parts are turned by its own rotation, and the positions with those
differential coordinates are solved for.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.editing.kernels import laplacian_pull, turned
from morphlet.editing.method import Pull
from morphlet.editing.patch import SMALLEST
from morphlet.editing.roi import Roi
from morphlet.editing.system import System, regripped, system
from morphlet.numerics.optimize import OnStep
from morphlet.numerics.rotations import best_rotations, exponential, logarithm

Solve = Callable[[Float[np.ndarray, "p 3"]], Float[np.ndarray, "u 3"]]
"""From a residual to displacements of the unknowns."""

NO_TURN = 1e-9
"""Angle (radians) below which a rotation has no axis of its own; full turns are then added along the last one."""


@dataclass(frozen=True)
class EstimatedRotations:
    """Linear editing with rotations spread harmonically from the handle.

    Parameters
    ----------
    least_cotangent
        Half cotangents below this are raised to it; left alone by default.

    Notes
    -----
    A frame costs two solves with three right-hand sides. Blind to translation: where the handle does not turn, the result is the
    harmonic displacement. Each piece of the handle turns by itself, as `Pull.turns` says or as its targets suggest.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.editor import edit
    >>> from morphlet.editing.estimated import EstimatedRotations
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> edit(Roi(strip, [4, 5], [2, 3]), [[0, 2, 2], [1, 2, 2]], EstimatedRotations()).vertices[2:4, 2].round(12).tolist()
    [1.0, 1.0]
    """

    least_cotangent: float = -np.inf

    def prepare(self, roi: Roi) -> "PreparedEstimate":
        """Factor the region's system."""
        return PreparedEstimate(system(roi, self.least_cotangent))


@dataclass(frozen=True, eq=False)
class PreparedEstimate:
    """`EstimatedRotations` for one region."""

    system: System

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`; `Pull.start` does not matter."""
        targets, turns = checked(self.system.roi, pull)
        return self.system.grip.answer(estimated(self.system, self.system.solve, targets, turns), targets)

    def with_roi(self, roi: Roi) -> "PreparedEstimate | None":
        """The same method with another handle, if its free vertices are among this one's; None elsewhere."""
        fresh = regripped(self.system, roi)
        return None if fresh is None else PreparedEstimate(fresh)


def checked(roi: Roi, pull: Pull) -> tuple[Float[np.ndarray, "h 3"], Float[np.ndarray, "g 3"]]:
    """The targets, and the turns told or estimated."""
    targets = checked_targets(roi, pull)
    return targets, checked_turns(roi, pull, targets)


def checked_targets(roi: Roi, pull: Pull) -> Float[np.ndarray, "h 3"]:
    """The targets, one per handle vertex."""
    return _arrays.real(pull.targets, "targets", (len(roi.handle), 3))


def checked_turns(roi: Roi, pull: Pull, targets: Float[np.ndarray, "h 3"]) -> Float[np.ndarray, "g 3"]:
    """The turns told, one per piece of the handle, or estimated."""
    if pull.turns is None:
        return handle_turns(roi, targets)
    return _arrays.real(pull.turns, "turns", (int(roi.handle_parts.max()) + 1, 3))


def handle_turns(roi: Roi, targets: Float[np.ndarray, "h 3"], before: Float[np.ndarray, "g 3"] | None = None) -> Float[np.ndarray, "g 3"]:
    """The rotation vector of each piece of the handle that fits its targets best, about the centroids.

    Parameters
    ----------
    roi
        Whose handle is pulled.
    targets
        Position of each handle vertex.
    before
        Turns of the last frame of a drag: of the vectors with the same rotation, those nearest to it are taken, so that
        turns add up beyond 180 degrees. Without it, angles are at most pi.

    Returns
    -------
    turns
        Zero for pieces of one vertex; for those on a line, the least turn that lays the line where it goes.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.estimated import handle_turns
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4]])
    >>> handle_turns(Roi(strip, [2, 3, 4], [0, 1]), np.array([[0, 0, 0], [0, 1, 0], [-1, 0, 0]])).round(6) + 0.0
    array([[0.      , 0.      , 1.570796]])
    """
    part = roi.handle_parts
    n_parts = int(part.max()) + 1
    rest = roi.mesh.vertices[roi.handle]
    a, b = rest - _means(rest, part, n_parts)[part], targets - _means(targets, part, n_parts)[part]
    products = (a[:, :, None] * b[:, None, :]).reshape(-1, 9)
    covariances = np.stack([np.bincount(part, column, n_parts) for column in products.T], axis=1)
    turns = np.array([logarithm(rotation) for rotation in best_rotations(covariances.reshape(-1, 3, 3))])
    return turns if before is None else _unwound(turns, before)


def estimated(known: System, solve: Solve, targets: Float[np.ndarray, "h 3"], turns: Float[np.ndarray, "g 3"]) -> Float[np.ndarray, "p 3"]:
    """Positions of the patch with turned differential coordinates, by the system's `solve`, or by its `correct` for a first guess."""
    whole, grip = known.patch, known.grip
    positions = grip.begin(whole.rest, targets)
    residual = np.empty_like(positions)
    turned(whole.stars, positions, spread(known, solve, turns), residual)
    grip.pull(positions, targets, residual)
    positions[: whole.n_unknowns] += solve(residual)
    return positions


def spread(known: System, solve: Solve, turns: Float[np.ndarray, "g 3"]) -> Float[np.ndarray, "c 9"]:
    """Rotation of each cell: the handle's rotation vectors, spread harmonically; none is longer than the longest of them."""
    whole, grip = known.patch, known.grip
    of_handle = turns[known.roi.handle_parts]
    vectors = np.zeros_like(whole.rest)
    vectors[grip.held] = of_handle[grip.held_index]
    residual = laplacian_pull(whole.stars, vectors)
    grip.pull(vectors, of_handle, residual)
    vectors[: whole.n_unknowns] += solve(residual)
    longest = max(float(np.linalg.norm(turns, axis=1).max()), SMALLEST)
    vectors *= (longest / np.maximum(np.linalg.norm(vectors, axis=1), longest))[:, None]
    return exponential(vectors[: whole.n_cells]).reshape(-1, 9)


def _means(points: Float[np.ndarray, "h 3"], part: Int[np.ndarray, "h"], n_parts: int) -> Float[np.ndarray, "g 3"]:
    """Centroid of each part."""
    sums = np.stack([np.bincount(part, column, n_parts) for column in points.T], axis=1)
    return sums / np.bincount(part, minlength=n_parts)[:, None]


def _unwound(turns: Float[np.ndarray, "g 3"], before: Float[np.ndarray, "g 3"]) -> Float[np.ndarray, "g 3"]:
    """The same rotations, as the vectors nearest to those before: full turns added along each axis."""
    angle, past = np.linalg.norm(turns, axis=1), np.linalg.norm(before, axis=1)
    still = angle < NO_TURN
    axis = np.where(still[:, None], before / np.maximum(past, SMALLEST)[:, None], turns / np.maximum(angle, SMALLEST)[:, None])
    full = 2 * np.pi * np.round((np.einsum("gd,gd->g", axis, before) - np.where(still, 0.0, angle)) / (2 * np.pi))
    return turns + full[:, None] * axis
