"""Pictures and captions laid out on one sheet of white paper, to the pixel."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import UInt8

from morphlet.report.color import ColorScale

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DPI = 100
"""Pixels per inch: only the size of letters depends on it."""
FONT, SMALL = 10.0, 8.5
"""Size of captions and of the numbers at axes, in points."""
INK = "#333333"
"""Colour of captions and axes."""
CAPTION = 26
"""Height of the line of text under a tile, in pixels."""
BAR = 12
"""Height of a colour bar, in pixels."""
BAR_BAND = 56
"""Height of a colour bar with its numbers and label, in pixels."""


@dataclass(frozen=True, eq=False)
class Tile:
    """A picture and what is written under it."""

    pixels: UInt8[np.ndarray, "h w 3"]
    caption: str


@dataclass(frozen=True)
class Box:
    """A rectangle of the sheet in pixels: left, top, width, height."""

    left: float
    top: float
    width: float
    height: float


def sheet(width: int, height: int) -> "Figure":
    """An empty white sheet."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / DPI, height / DPI), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    return figure


def pixels(figure: "Figure") -> UInt8[np.ndarray, "h w 3"]:
    """What is on the sheet."""
    canvas: Any = figure.canvas
    canvas.draw()
    return np.array(np.asarray(canvas.buffer_rgba())[..., :3])


def place(figure: "Figure", tile: Tile, left: int, top: int) -> None:
    """Put a tile with its upper left corner here, and its caption below."""
    height, width = tile.pixels.shape[:2]
    figure.figimage(tile.pixels, left, _height(figure) - top - height, origin="upper")
    write(figure, tile.caption, left + width / 2, top + height + CAPTION / 2)


def write(figure: "Figure", text: str, x: float, y: float) -> None:
    """Put a line of text with its middle here."""
    across, up = x / (DPI * figure.get_figwidth()), 1 - y / _height(figure)
    figure.text(across, up, text, ha="center", va="center", fontsize=FONT, color=INK, parse_math=False)


def axes(figure: "Figure", box: Box) -> "Axes":
    """Quiet axes in this box."""
    width, height = DPI * figure.get_figwidth(), _height(figure)
    drawn = figure.add_axes((box.left / width, 1 - (box.top + box.height) / height, box.width / width, box.height / height))
    drawn.tick_params(labelsize=SMALL, colors=INK, length=3)
    drawn.xaxis.label.set(color=INK, fontsize=FONT, parse_math=False)
    drawn.yaxis.label.set(color=INK, fontsize=FONT, parse_math=False)
    drawn.spines[["top", "right"]].set_visible(False)
    drawn.spines[["left", "bottom"]].set_color(INK)
    return drawn


def color_bar(figure: "Figure", scale: ColorScale, box: Box) -> None:
    """A horizontal colour bar at the top of this box, its numbers and label below."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    drawn = axes(figure, Box(box.left, box.top, box.width, BAR))
    bar = figure.colorbar(ScalarMappable(Normalize(scale.low, scale.high), scale.palette), cax=drawn, orientation="horizontal")
    bar.outline.set_visible(False)
    bar.set_label(scale.label)


def _height(figure: "Figure") -> int:
    """Height of the sheet in pixels."""
    return round(DPI * figure.get_figheight())
