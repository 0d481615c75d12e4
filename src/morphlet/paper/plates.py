"""Pictures with captions, laid out as the plates of a figure."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from morphlet.editing.roi import Roi
from morphlet.paper.marks import Painted
from morphlet.report import canvas
from morphlet.report.camera import Camera, view
from morphlet.report.canvas import Tile
from morphlet.report.look import Look
from morphlet.report.page import Plate
from morphlet.report.render import CLAY, Picture, render
from morphlet.report.rows import FREE, HANDLE
from morphlet.surface.mesh import Mesh

PART = Look(size=(440, 340))
"""A picture of a plate."""
WIDE = Look(size=(960, 420))
"""A picture of two meshes side by side."""
PAD = 10
"""Space round a plate, in pixels."""

Captioned = tuple[str, Picture]


def plate(pictures: Sequence[Captioned], columns: int, alt: str) -> Plate:
    """Pictures with captions in rows, as one; each row as high as its highest.

    Examples
    --------
    >>> from morphlet.paper.plates import plate
    >>> from morphlet.report.render import Picture
    >>> dot = Picture(np.zeros((9, 9, 3)), "none", "an example")
    >>> plate([("a dot", dot), ("another", dot)], 2, "two dots").alt
    'two dots'
    """
    rows = [pictures[k : k + columns] for k in range(0, len(pictures), columns)]
    widths = [max(row[c][1].pixels.shape[1] for row in rows if c < len(row)) for c in range(min(columns, len(pictures)))]
    heights = [max(picture.pixels.shape[0] for _, picture in row) + canvas.CAPTION for row in rows]
    figure = canvas.sheet(sum(widths) + 2 * PAD, sum(heights) + 2 * PAD)
    for r, row in enumerate(rows):
        for c, (caption, picture) in enumerate(row):
            canvas.place(figure, Tile(picture.pixels, caption), PAD + sum(widths[:c]), PAD + sum(heights[:r]))
    return Plate(replace(pictures[0][1], pixels=canvas.pixels(figure)).png, alt)


def shot(thing: Painted, camera: Camera, look: Look = PART) -> Picture:
    """A painted mesh, all of it, from this direction."""
    return render(thing.mesh, colors=thing.colors, camera=camera.framed(thing.mesh), look=look)


def wide_view(*meshes: Mesh) -> Camera:
    """The usual view of the first mesh, wide enough for all."""
    both = np.concatenate([mesh.vertices for mesh in meshes])
    return view(meshes[0]).framed(Mesh(both, np.arange(3 * -(-len(both) // 3)).reshape(-1, 3) % len(both)))


def parts(roi: Roi) -> Float[np.ndarray, "n 3"]:
    """What is pulled in red, what follows in yellow, what stays as clay."""
    colors = np.tile(CLAY, (roi.mesh.n_vertices, 1))
    colors[roi.free], colors[roi.handle] = FREE, HANDLE
    return colors
