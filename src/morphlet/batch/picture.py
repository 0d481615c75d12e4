"""The meshes of a collection as points in the plane, each drawn where it is."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, UInt8

from morphlet.batch.all_pairs import Distances
from morphlet.errors import MorphletError
from morphlet.io.formats import read
from morphlet.report.canvas import FONT, INK, SMALL, pixels, sheet
from morphlet.report.look import Look
from morphlet.report.render import Picture, render

if TYPE_CHECKING:
    from matplotlib.axes import Axes

WIDTH, HEIGHT = 1000, 800
"""Of the picture, in pixels."""
FRAME = (0.07, 0.07, 0.9, 0.86)
"""Left, bottom, width and height of the diagram, as shares of the picture's."""
SMALL_PICTURE = Look(size=(120, 100))
"""Of a mesh."""
ROOM = (108.0, 110.0)
"""Of a mesh and its name."""
ROUNDS, SLIGHT = 200, 1e-6
"""How often pictures are moved apart, and by how much those in one place at first."""
LINE = "#bbbbbb"
"""Colour of the line from a place to a picture that had to give way."""
MOST_DRAWN = 40
"""Meshes that are drawn; of more, points and names."""
MARGIN = 0.18
"""Space beyond the outermost points, as a share of the diagram: for meshes that had to give way."""
LEAST_SCALE = 1e-6
"""Distance of a pixel where all meshes are in one place."""


def draw(found: Distances, files: list[Path], path: Path) -> None:
    """Draw the places of the meshes, with their names.

    Parameters
    ----------
    found
        Their distances.
    files
        The meshes, in the same order.
    path
        A PNG file.

    Raises
    ------
    FileError
        If it cannot be written.
    """
    places = found.places()
    shown = np.flatnonzero(np.isfinite(places[:, 0]))
    pictures = [_small(files[k]) for k in shown] if len(shown) <= MOST_DRAWN else [None] * len(shown)
    figure = sheet(WIDTH, HEIGHT)
    axes = figure.add_axes(FRAME)
    x, y = _reach(places[shown])
    axes.set(xlim=x, ylim=y)
    scale = (x[1] - x[0]) / (WIDTH * FRAME[2])
    free = apart(places[shown] / scale, ROOM) * scale if len(shown) <= MOST_DRAWN else places[shown]
    for k, at, picture in zip(shown, free, pictures, strict=True):
        axes.plot(*zip(places[k], at, strict=True), color=LINE, linewidth=0.8, zorder=1)
        axes.plot(*places[k], "o", color=INK, markersize=3, zorder=3)
        _place(axes, at, picture, found.names[k])
    left_out = len(found.names) - len(shown)
    told = f"Stress {found.stress:.3f}." + (f" Not shown, for want of maps: {left_out}." if left_out else "")
    axes.set_title(f"Distances of {len(shown)} meshes, as near as a plane shows them. {told}", fontsize=FONT, color=INK)
    axes.tick_params(labelsize=SMALL, colors=INK)
    Picture(pixels(figure), "matplotlib", "a diagram").save(path)


def _small(file: Path) -> UInt8[np.ndarray, "h w 4"] | None:
    """A small picture of a mesh, white become clear; None if it cannot be read any more."""
    try:
        seen = render(read(file), look=SMALL_PICTURE).pixels
    except MorphletError:
        return None
    return np.dstack([seen, np.where((seen == 255).all(axis=2), 0, 255).astype(np.uint8)])


def _place(axes: "Axes", place: Float[np.ndarray, "2"], picture: UInt8[np.ndarray, "h w 4"] | None, name: str) -> None:
    """A mesh, or a point, and its name below."""
    from matplotlib.offsetbox import AnnotationBbox, OffsetImage

    drop = -4.0 if picture is None else -SMALL_PICTURE.size[1] / 2.4
    if picture is not None:
        axes.add_artist(AnnotationBbox(OffsetImage(picture, zoom=0.72), tuple(place), frameon=False, zorder=2))
    axes.annotate(name, tuple(place), xytext=(0, drop), textcoords="offset points", ha="center", va="top", fontsize=SMALL, color=INK)


def apart(centres: Float[np.ndarray, "k 2"], room: tuple[float, float]) -> Float[np.ndarray, "k 2"]:
    """Centres of rectangles, moved until none covers another, or a number of rounds is over.

    Examples
    --------
    >>> import numpy as np
    >>> apart(np.array([[0.0, 0.0], [6.0, 1.0]]), (10.0, 10.0)).round(3).tolist()
    [[-2.0, 0.0], [8.0, 1.0]]
    """
    found = centres + SLIGHT * np.arange(len(centres))[:, None]  # none in one place
    for _ in range(ROUNDS):
        gaps = found[:, None] - found[None]
        short = np.array(room) - np.abs(gaps)
        covers = (short > 0).all(axis=2) & ~np.eye(len(found), dtype=bool)
        if not covers.any():
            break
        shorter = short == short.min(axis=2, keepdims=True)  # out by the shorter way
        found = found + np.sum(np.where(covers[:, :, None] & shorter, 0.5 * short * np.where(gaps < 0, -1, 1), 0.0), axis=1)
    return np.where(np.abs(found - centres) < 2 * SLIGHT * len(centres), centres, found)


def _reach(places: Float[np.ndarray, "k 2"]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Limits of both axes, lengths alike in both."""
    low, high = places.min(axis=0), places.max(axis=0)
    frame = np.array([WIDTH * FRAME[2], HEIGHT * FRAME[3]])
    scale = max(float(np.max((high - low) / (frame * (1 - 2 * MARGIN)))), LEAST_SCALE)
    (left, bottom), (right, top) = (low + high) / 2 - scale * frame / 2, (low + high) / 2 + scale * frame / 2
    return (float(left), float(right)), (float(bottom), float(top))
