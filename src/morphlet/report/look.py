"""How a picture is drawn: size, engine, edges, colour scale."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from morphlet.errors import InputError
from morphlet.report.color import ColorScale

WIDTH, HEIGHT = 800, 600
"""Size of a picture unless said, in pixels."""
LARGEST = 8192
"""Largest side of a picture, in pixels: what graphics drivers commonly allow, with two-fold oversampling on the painter's canvas."""


@dataclass(frozen=True)
class Look:
    """How a picture is drawn.

    Parameters
    ----------
    size
        Width and height, in pixels.
    engine
        `pyvista`, `matplotlib`, or `auto`: pyvista where it works, else matplotlib.
    edges
        Width of the lines along the edges, in pixels; 0 for none.
    scale
        Which colour shows which value; made for the values if left out.
    """

    size: tuple[int, int] = (WIDTH, HEIGHT)
    engine: Literal["auto", "pyvista", "matplotlib"] = "auto"
    edges: float = 0.0
    scale: ColorScale | None = None

    def __post_init__(self) -> None:
        if not all(1 <= side <= LARGEST for side in self.size):
            raise InputError(f"a picture of 1 to {LARGEST} pixels a side", f"{self.size}", "choose another size")
        if self.engine not in ("auto", "pyvista", "matplotlib"):
            raise InputError("engine 'auto', 'pyvista' or 'matplotlib'", f"'{self.engine}'", "choose one of them")
        if not (np.isfinite(self.edges) and self.edges >= 0):
            raise InputError("a width of edges >= 0", f"{self.edges}", "use 0 for no edges")


PLAIN = Look()
"""The look of a picture unless said."""
