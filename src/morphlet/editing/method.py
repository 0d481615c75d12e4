"""What a way of deforming has to offer: prepared once for a region, it answers any pull on its handle."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from morphlet.editing.roi import Roi
from morphlet.numerics.optimize import OnStep


@dataclass(frozen=True, eq=False)
class Pull:
    """Where the handle goes, and how it turned on its way.

    Parameters
    ----------
    targets
        Position of each handle vertex, in the order of `Roi.handle`.
    turns
        Accumulated rotation vector (radians times axis) of each piece of the handle, `Roi.handle_parts`; estimated from
        the targets where left out. A drag that turns by more than 180 degrees, or a handle of fewer than three
        vertices that are not on a line, needs it.
    start
        Positions of `Roi.moving` that iterations start from, such as the last frame's; the method's own start if left out.
    """

    targets: Float[np.ndarray, "h 3"]
    turns: Float[np.ndarray, "g 3"] | None = None
    start: Float[np.ndarray, "k 3"] | None = None


@runtime_checkable
class Prepared(Protocol):
    """A method made ready for one region."""

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`."""


@runtime_checkable
class Method(Protocol):
    """A way of deforming, with its options."""

    def prepare(self, roi: Roi) -> Prepared:
        """Everything that does not depend on where the handle goes."""
