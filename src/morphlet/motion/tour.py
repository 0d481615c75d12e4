"""Tour: the path of a mesh through several shapes, one after the other."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, get_args

import numpy as np
from jaxtyping import Float

from morphlet.errors import InputError
from morphlet.motion.morph import PATHS, Morph, MorphPath
from morphlet.motion.schedule import Easing, eased
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence


@dataclass(frozen=True, eq=False)
class Tour:
    """A mesh that goes from stop to stop, and is at each at its time, to the last bit.

    Parameters
    ----------
    stops
        At least two shapes, and when they are met. For a round trip repeat the first at the end.
    path
        How vertices travel from one stop to the next: "gradient" or "linear".
    easing
        "smoothstep" or "smootherstep" rests at each stop, so that the speed has no jump there; "linear" passes through.

    Raises
    ------
    InputError
        If there are fewer than two stops, or there is no such path or easing.

    Notes
    -----
    Each leg factors a sparse system when it is first entered, which the tour keeps: as a `Morph` does.

    Examples
    --------
    >>> from morphlet import Mesh, MeshSequence, Tour
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> stops = MeshSequence(triangle.topology, [k * triangle.vertices for k in (1, 3, 1)], [0.0, 1.0, 3.0])
    >>> tour = Tour(stops, easing="linear")
    >>> [round(tour(t).area, 12) for t in (0, 0.5, 1, 2, 3)]
    [0.5, 2.0, 4.5, 2.0, 0.5]
    """

    stops: MeshSequence
    path: MorphPath = "gradient"
    easing: Easing = "smoothstep"

    def __post_init__(self) -> None:
        if len(self.stops) < 2:
            raise InputError("at least 2 stops", str(len(self.stops)), "add shapes")
        if self.path not in PATHS or self.path == "wavelet":
            raise InputError("a path out of linear, gradient", repr(self.path), "choose one of these")
        if self.easing not in get_args(Easing):
            raise InputError(f"an easing out of {', '.join(get_args(Easing))}", repr(self.easing), "choose one of these")

    def __reduce__(self) -> tuple[Any, ...]:
        return Tour, (self.stops, self.path, self.easing)

    def __call__(self, t: float) -> Mesh:
        """The mesh at time t.

        Raises
        ------
        InputError
            If t is before the first stop or after the last.
        """
        times = self.stops.times
        if not times[0] <= t <= times[-1]:
            raise InputError(f"a time from {times[0]:g} to {times[-1]:g}", str(t), "ask for a time between the first stop and the last")
        leg = min(int(np.searchsorted(times, t, side="right")) - 1, len(times) - 2)
        share = (t - times[leg]) / (times[leg + 1] - times[leg])
        return self._legs[leg](float(eased(self.easing, share)))

    def frames(self, per_leg: int) -> MeshSequence:
        """All stops, and `per_leg` - 1 meshes at equal steps of time from each to the next.

        Raises
        ------
        InputError
            If `per_leg` is below 1.
        """
        if per_leg < 1:
            raise InputError("at least 1 step per leg", str(per_leg), "ask for more steps")
        times = self._times(per_leg)
        return MeshSequence(self.stops.topology, np.stack([self(float(t)).vertices for t in times]), times)

    def _times(self, per_leg: int) -> Float[np.ndarray, "t"]:
        """The times of the stops, and between."""
        knots, whole = self.stops.times, per_leg * np.arange(len(self.stops))
        times = np.interp(np.arange(whole[-1] + 1), whole, knots)
        times[whole] = knots
        return times

    @cached_property
    def _legs(self) -> list[Morph]:
        """From each stop to the next."""
        ends = self.stops.positions
        return [Morph(self.stops[k], ends[k + 1], self.path) for k in range(len(self.stops) - 1)]
