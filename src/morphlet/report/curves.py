"""Curves on axes: trade-offs, convergence, rates, coordinates."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.report import canvas
from morphlet.report.render import Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SIZE = (720, 480)
"""Size of a plot, in pixels."""
ROOM = (84, 24, 24, 60)
"""Space left of, above, right of and below the axes, in pixels: room for numbers and labels."""
COLORS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000")
"""Colours that people of every colour vision can tell apart (Okabe and Ito)."""
MARKERS = "os^Dv<>"
"""A second way to tell curves apart."""
TALL = (720, 720)
"""Size of three plots, one below the other, in pixels."""
WIDTH, THIN = 1.6, 0.7
"""Of curves, in points; thin ones run up and down too often for more."""
LEGEND: dict[str, Any] = {"frameon": False, "fontsize": canvas.FONT, "labelcolor": canvas.INK}
"""How names of curves are written."""
MARKED = 40
"""Curves of more points than this are drawn without markers."""


@dataclass(frozen=True)
class Axis:
    """What an axis shows, and whether evenly or by powers."""

    label: str
    scale: Literal["linear", "log"] = "linear"


def curve_picture(curves: Mapping[str, Float[np.ndarray, "k 2"]], x: Axis, y: Axis, size: tuple[int, int] = SIZE) -> Picture:
    """Curves by name on common axes.

    Parameters
    ----------
    curves
        Points (x, y) of each curve, in drawing order.
    x, y
        The axes.
    size
        Width and height, in pixels.

    Returns
    -------
    Picture
        The plot, with a legend where there are several curves.

    Raises
    ------
    InputError
        If a logarithmic axis is given numbers that are not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.report.curves import Axis, curve_picture
    >>> curve_picture({"rate": np.array([[1.0, 4.0], [2.0, 1.0]])}, Axis("bits"), Axis("error", "log"), (300, 200)).pixels.shape
    (200, 300, 3)
    """
    checked = {name: _arrays.real(points, f"curve '{name}'", (None, 2)) for name, points in curves.items()}
    for axis, column in ((x, 0), (y, 1)):
        wrong = sum(int(np.sum(points[:, column] <= 0)) for points in checked.values()) if axis.scale == "log" else 0
        if wrong:
            raise InputError(f"positive numbers on the logarithmic axis '{axis.label}'", f"{wrong} that are not", "use a linear axis")
    figure = canvas.sheet(*size)
    left, top, right, bottom = ROOM
    drawn = canvas.axes(figure, canvas.Box(left, top, size[0] - left - right, size[1] - top - bottom))
    _draw(drawn, checked)
    if len(checked) > 1:
        drawn.legend(**LEGEND)
    drawn.set(xlabel=x.label, ylabel=y.label, xscale=x.scale, yscale=y.scale)
    return Picture(canvas.pixels(figure), "matplotlib", "curves need no other")


def coordinate_picture(original: Float[np.ndarray, "n 3"], deformed: Float[np.ndarray, "n 3"], size: tuple[int, int] = TALL) -> Picture:
    """x, y and z of an object before and after, over the number of the vertex: the paper's Figure 12.

    Parameters
    ----------
    original, deformed
        Positions of the same vertices.
    size
        Width and height, in pixels.

    Returns
    -------
    Picture
        Three plots, one below the other, the legend above.

    Raises
    ------
    InputError
        If the shapes differ, or there is no vertex.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.report.curves import coordinate_picture
    >>> coordinate_picture(np.zeros((9, 3)), np.ones((9, 3)), (300, 400)).pixels.shape
    (400, 300, 3)
    """
    before = _arrays.real(original, "original", (None, 3))
    after = _arrays.real(deformed, "deformed", before.shape)
    if not len(before):
        raise InputError("at least one vertex", "none", "pass the positions of a mesh")
    figure = canvas.sheet(*size)
    left, top, right, bottom = ROOM
    number, step = np.arange(len(before)), (size[1] - bottom) / 3
    for k, name in enumerate("xyz"):
        drawn = canvas.axes(figure, canvas.Box(left, top + k * step, size[0] - left - right, step - 1.5 * top))
        _draw(drawn, {shape: np.stack([number, x[:, k]], axis=1) for shape, x in (("original", before), ("deformed", after))}, THIN)
        drawn.set(ylabel=name, xlim=(0, max(len(before) - 1, 1)), xlabel="vertex" if k == 2 else "")
        if k == 0:  # above: where vertices jump to and fro, curves leave no room inside
            drawn.legend(**LEGEND, loc="lower right", bbox_to_anchor=(1, 0.96), ncols=2, borderaxespad=0)
    return Picture(canvas.pixels(figure), "matplotlib", "curves need no other")


def _draw(drawn: "Axes", curves: Mapping[str, Float[np.ndarray, "k 2"]], width: float = WIDTH) -> None:
    """All curves, and a light grid."""
    for number, (name, points) in enumerate(curves.items()):
        marker = MARKERS[number % len(MARKERS)] if len(points) <= MARKED else ""
        drawn.plot(*points.T, color=COLORS[number % len(COLORS)], marker=marker, markersize=5, linewidth=width, label=name)
    drawn.grid(color="#dddddd", linewidth=0.6)
    drawn.set_axisbelow(True)
