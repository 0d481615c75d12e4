"""Colours for values and places: functions from numbers to RGB in [0, 1]."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError

PERCENTILES = (1.0, 99.0)
"""A scale made for values leaves their extreme hundredths out: a few bad faces must not make all others look alike."""
PALETTE = "YlOrRd"
"""Pale where little happens, dark red where much does: shading stays visible on the pale parts, which are most."""
LOWEST, HIGHEST = 0.12, 0.92
"""Lowest and highest channel of colours for places: pure black and white would hide the shading."""


@dataclass(frozen=True)
class ColorScale:
    """Which colour shows which value.

    Parameters
    ----------
    low, high
        The values shown by the first and the last colour; beyond them the colour stays the same.
    palette
        Name of a matplotlib colour map.
    label
        What the values are, with their unit: it stands beside the colour bar.

    Examples
    --------
    >>> from morphlet.report.color import ColorScale
    >>> ColorScale(0.0, 1.0, "gray")([-1.0, 0.0, 2.0])[:, 0]
    array([0., 0., 1.])
    """

    low: float
    high: float
    palette: str = PALETTE
    label: str = ""

    def __post_init__(self) -> None:
        from matplotlib import colormaps

        if not self.low < self.high:
            raise InputError("low < high in a colour scale", f"{self.low} and {self.high}", "widen the range")
        if self.palette not in colormaps:
            raise InputError("a colour map known to matplotlib", f"'{self.palette}'", "try 'YlOrRd' or 'coolwarm'")

    @staticmethod
    def of(values: Float[np.ndarray, "k"], label: str = "") -> "ColorScale":
        """A scale from the lowest to the highest of these values, extremes left out."""
        checked = _arrays.real(values, "values", (None,))
        low, high = np.percentile(checked, PERCENTILES) if len(checked) else (0.0, 1.0)
        wide = high - low > np.finfo(float).eps * max(abs(low), abs(high))
        return ColorScale(float(low), float(high) if wide else float(low) + max(abs(float(low)), 1.0), label=label)

    def __call__(self, values: Float[np.ndarray, "k"]) -> Float[np.ndarray, "k 3"]:
        """The colour of each value."""
        from matplotlib import colormaps

        share = (_arrays.real(values, "values", (None,)) - self.low) / (self.high - self.low)
        return np.ascontiguousarray(colormaps[self.palette](np.clip(share, 0, 1))[:, :3])


def place_colors(points: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    """A colour for each point that changes smoothly with its place in the bounding box: what carries them shows where they went.

    Parameters
    ----------
    points
        Places, for example the vertices of a mesh.

    Returns
    -------
    Float[np.ndarray, "k 3"]
        Red along x, green along y, blue along z, each from dark to light.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.report.color import place_colors
    >>> place_colors(np.array([[0.0, 0.0, 5.0], [1.0, 2.0, 7.0]]))
    array([[0.12, 0.12, 0.12],
           [0.92, 0.92, 0.92]])
    """
    places = _arrays.real(points, "points", (None, 3))
    if not len(places):
        return np.zeros((0, 3))
    low, size = places.min(axis=0), np.ptp(places, axis=0)
    return LOWEST + (HIGHEST - LOWEST) * (places - low) / np.where(size > 0, size, 1.0)
