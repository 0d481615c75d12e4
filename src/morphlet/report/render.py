"""Pictures of meshes.

Two engines draw the same scene: pyvista (VTK), where it is installed and a trial in a process of its own succeeds, and a painter on
matplotlib's canvas, which needs no graphics driver. Which one drew a picture, and why, is written in the `Picture`.
"""

import io
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from morphlet import _arrays, _store
from morphlet.errors import InputError
from morphlet.report import engines
from morphlet.report.camera import Camera, view
from morphlet.report.color import ColorScale
from morphlet.report.look import PLAIN, Look
from morphlet.report.scene import scene
from morphlet.surface.mesh import Mesh

CLAY = (0.87, 0.85, 0.82)
"""The colour of a mesh without colours: light, slightly warm grey."""
SOFT = 0.65
"""Share of the shading that coloured meshes keep: their colours must be recognisable beside a colour bar."""


@dataclass(frozen=True, eq=False)
class Picture:
    """Pixels, and how they came about.

    Parameters
    ----------
    pixels
        Red, green, blue, rows from the top.
    engine
        What drew them: `pyvista` or `matplotlib`.
    reason
        Why it was this engine.
    """

    pixels: UInt8[np.ndarray, "h w 3"]
    engine: str
    reason: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "pixels", _arrays.freeze(np.array(self.pixels, dtype=np.uint8, order="C")))

    def __reduce__(self) -> tuple[Any, ...]:
        return Picture, (np.array(self.pixels), self.engine, self.reason)

    @property
    def png(self) -> bytes:
        """The content of a PNG file."""
        from matplotlib.image import imsave

        stream = io.BytesIO()
        imsave(stream, self.pixels, format="png")
        return stream.getvalue()

    def _repr_png_(self) -> bytes:
        """The picture itself in a notebook."""
        return self.png

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a PNG file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        with _store.beside(path) as temporary:
            Path(temporary).write_bytes(self.png)


def render(
    mesh: Mesh,
    *,
    values: Float[np.ndarray, "k"] | None = None,
    colors: Float[np.ndarray, "k 3"] | None = None,
    camera: Camera | None = None,
    look: Look = PLAIN,
) -> Picture:
    """A picture of a mesh on white.

    Parameters
    ----------
    mesh
        The mesh to draw; both sides of its faces show.
    values
        One number per vertex or per face, shown by the colours of `look.scale`. If both counts are equal, they belong to vertices.
    colors
        RGB in [0, 1] per vertex or per face, instead of values.
    camera
        From where to look; `view(mesh)` if left out.
    look
        Size, engine, edges and scale.

    Returns
    -------
    Picture
        Pixels, with the name of the engine that drew them.

    Raises
    ------
    InputError
        If values or colours fit neither the vertices nor the faces, or both are given.
    MissingExtra
        If pyvista is asked for by name and does not work here.

    Notes
    -----
    O(m log m): some tenths of a second for 20 000 faces. The first picture with pyvista takes seconds more, for its trial. The
    same input gives the same bits with matplotlib; with pyvista only on the same driver.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.report.look import Look
    >>> from morphlet.report.render import render
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> picture = render(tetrahedron, look=Look((64, 48), "matplotlib"))
    >>> picture.pixels.shape, picture.engine
    ((48, 64, 3), 'matplotlib')
    """
    choice = engines.choose(look.engine)
    at_corners = _corner_colors(mesh, values, colors, look)
    contrast = 1.0 if values is None and colors is None else SOFT
    ready = scene(mesh, at_corners, view(mesh) if camera is None else camera, look, contrast)
    return Picture(choice.paint(ready), choice.name, choice.reason)


def _corner_colors(
    mesh: Mesh, values: Float[np.ndarray, "k"] | None, colors: Float[np.ndarray, "k 3"] | None, look: Look
) -> Float[np.ndarray, "m 3 3"]:
    """The colour at each corner of each face."""
    if values is not None and colors is not None:
        raise InputError("values or colors", "both", "leave one out")
    if values is not None:
        numbers = _arrays.real(values, "values", (None,))
        colors = (look.scale or ColorScale.of(numbers))(numbers)
    if colors is None:
        return np.broadcast_to(np.array(CLAY), (mesh.n_faces, 3, 3))
    rgb = np.clip(_arrays.real(colors, "colors", (None, 3)), 0, 1)
    if len(rgb) == mesh.n_vertices:
        return rgb[mesh.faces]
    if len(rgb) == mesh.n_faces:
        return np.repeat(rgb[:, None], 3, axis=1)
    raise InputError(f"one row per vertex ({mesh.n_vertices}) or face ({mesh.n_faces})", f"{len(rgb)} rows", "pass the mesh they belong to")
