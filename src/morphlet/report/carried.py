"""Attributes shown as colours, on the mesh they came from and the one they were carried to."""

import numpy as np
from jaxtyping import Float, Shaped

from morphlet.io.attributes import Attribute
from morphlet.io.content import COLOR_MAX
from morphlet.report.color import ColorScale, place_colors
from morphlet.report.features import HUES
from morphlet.report.render import Picture, render
from morphlet.report.rows import tiled
from morphlet.surface.mesh import Mesh


def carried_picture(ends: tuple[Mesh, Mesh], attribute: Attribute, carried: Shaped[np.ndarray, "n *d"]) -> Picture:
    """A mesh in the colours of an attribute, and beside it the mesh that received it.

    Parameters
    ----------
    ends
        The mesh that gives, and the one that receives.
    attribute
        What is carried, at the corners of the faces of the first.
    carried
        A row per vertex of the second.

    Returns
    -------
    Picture
        Equal values in equal colours on both.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.io.attributes import Attribute
    >>> from morphlet.report.carried import carried_picture
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> height = Attribute("height", [0.0, 0.0, 0.0, 1.0], tetrahedron.faces)
    >>> carried_picture((tetrahedron, tetrahedron), height, np.array(height.values)).pixels.shape
    (600, 1600, 3)
    """
    row = np.zeros(ends[0].n_vertices, np.int64)
    row[ends[0].faces] = attribute.rows
    shades = _shades(attribute.name, np.concatenate([attribute.values[row], carried]))
    parts = np.split(shades, [len(row)])
    return tiled([render(mesh, colors=colors) for mesh, colors in zip(ends, parts, strict=True)], 2)


def _shades(name: str, values: Shaped[np.ndarray, "k *d"]) -> Float[np.ndarray, "k 3"]:
    """A colour per row: itself, one per label, along a scale, or red and green along two columns, and blue along a third."""
    table = values.reshape(len(values), -1)
    if name == "color":
        return values / COLOR_MAX
    if values.dtype.kind != "f":
        return np.array(HUES)[np.unique(table, axis=0, return_inverse=True)[1].ravel() % len(HUES)]
    if table.shape[1] == 1:
        return ColorScale.of(table[:, 0])(table[:, 0])
    return place_colors(np.pad(table, ((0, 0), (0, 3)))[:, :3])
