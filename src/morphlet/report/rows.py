"""Meshes side by side: two of them, an edit after its rest, poses above what they became."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from morphlet.editing.script import Edit
from morphlet.report.camera import view
from morphlet.report.look import Look
from morphlet.report.render import CLAY, Picture, render
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

HANDLE, FREE = (0.85, 0.30, 0.28), (0.95, 0.75, 0.35)
"""The colours of what is pulled and what follows; what stays is clay."""
SMALL = Look(size=(400, 300))
"""A picture among others."""
TILES, COLUMNS = 12, 4
"""Most pictures of one sequence, and in a row."""


def beside(first: Mesh, second: Mesh) -> Picture:
    """Two meshes from one side.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.report.rows import beside
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> beside(tetrahedron, tetrahedron).pixels.shape
    (600, 1600, 3)
    """
    camera = view(first)
    return tiled([render(first, camera=camera), render(second, camera=camera)], 2)


def edit_picture(edit: Edit, frames: MeshSequence) -> Picture:
    """A mesh at rest and frames of its edit: what is pulled in red, what follows in yellow, what stays as clay.

    Parameters
    ----------
    edit
        The edit.
    frames
        What came out; the last one and up to ten before it are shown.

    Returns
    -------
    Picture
        Rest and edit side by side; smaller, in rows of four, where there are several frames.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Arap, Mesh, MeshSequence, Roi
    >>> from morphlet.editing.script import Edit
    >>> from morphlet.report.rows import edit_picture
    >>> rest = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> frames = MeshSequence(rest.topology, np.stack([rest.vertices] * 5), np.arange(5.0))
    >>> edit_picture(Edit("arap", Arap(), Roi(rest, [0], [1]), (), True), frames).pixels.shape
    (600, 1600, 3)
    """
    rest = edit.roi.mesh
    colors = np.tile(CLAY, (rest.n_vertices, 1))
    colors[edit.roi.free], colors[edit.roi.handle] = FREE, HANDLE
    shown = [rest, *(frames[k] for k in _picked(len(frames), TILES - 1))]
    look = Look() if len(shown) == 2 else SMALL
    camera = view(rest).framed(_together(shown))
    return tiled([render(shape, colors=colors, camera=camera, look=look) for shape in shown], COLUMNS)


def poses_picture(rows: Sequence[Sequence[Mesh]]) -> Picture:
    """Rows of meshes above each other, each row of one connectivity.

    Parameters
    ----------
    rows
        Two rows of the same length: poses and what they became. The first, the last and others evenly chosen are shown.

    Returns
    -------
    Picture
        Every row in a scale of its own, all from one side.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.report.rows import poses_picture
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> poses_picture([[tetrahedron] * 3, [tetrahedron] * 3]).pixels.shape
    (600, 1200, 3)
    """
    picked = _picked(len(rows[0]), TILES // 2)
    seen, tiles = view(rows[0][0]), list[Picture]()
    for row in rows:
        centred = [row[k].with_vertices(row[k].vertices - row[k].vertices.mean(axis=0)) for k in picked]
        camera = seen.framed(_together(centred))
        tiles += [render(shape, camera=camera, look=SMALL) for shape in centred]
    return tiled(tiles, len(picked))


def tiled(tiles: Sequence[Picture], columns: int) -> Picture:
    """Pictures of one size in rows of at most so many, white where the last is not full.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Picture
    >>> from morphlet.report.rows import tiled
    >>> dot = Picture(np.zeros((1, 1, 3)), "none", "an example")
    >>> tiled([dot, dot, dot], 2).pixels[..., 0]
    array([[  0,   0],
           [  0, 255]], dtype=uint8)
    """
    wide = min(len(tiles), columns)
    pixels = [tile.pixels for tile in tiles] + [np.full_like(tiles[0].pixels, 255)] * (-len(tiles) % wide)
    rows = [np.hstack(pixels[k : k + wide]) for k in range(0, len(pixels), wide)]
    return replace(tiles[0], pixels=np.vstack(rows))


def _picked(count: int, most: int) -> list[int]:
    """The first, the last and others evenly between."""
    picked: list[int] = np.unique(np.linspace(0, count - 1, min(count, most)).round()).astype(int).tolist()
    return picked


def _together(shapes: Sequence[Mesh]) -> Mesh:
    """Several meshes of one connectivity as one."""
    faces, n = shapes[0].faces, shapes[0].n_vertices
    return Mesh(np.concatenate([shape.vertices for shape in shapes]), np.concatenate([faces + k * n for k in range(len(shapes))]))
