"""Pictures of feature regions: each in a colour of its own, and matched regions of two meshes in the same one."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from morphlet.features.matching import Matching
from morphlet.features.regions import Regions
from morphlet.report import canvas
from morphlet.report.camera import view
from morphlet.report.canvas import Tile
from morphlet.report.look import Look
from morphlet.report.render import Picture, render
from morphlet.surface.distance import distances
from morphlet.surface.mesh import Mesh

REGION_LOOK = Look(size=(560, 480))
"""A picture of one mesh from one side."""
HUES = (
    (0.90, 0.45, 0.40), (0.42, 0.66, 0.88), (0.55, 0.78, 0.45), (0.95, 0.75, 0.35), (0.70, 0.55, 0.85),
    (0.45, 0.80, 0.75), (0.92, 0.60, 0.75), (0.75, 0.62, 0.45), (0.62, 0.75, 0.30), (0.50, 0.52, 0.75),
)  # fmt: skip
"""One per region, told apart at a glance and light enough for shading to show; used again from the eleventh on."""
REST = (0.87, 0.85, 0.82)
"""The colour of what belongs to no region."""
ALONE = (0.62, 0.60, 0.58)
"""The colour of regions without partner."""
MARK = (0.15, 0.16, 0.20)
"""The colour of the spots on tips and details."""
TIP, LESSER = 0.03, 0.018
"""Radius of the spot on a tip, and on a detail, over sqrt(area)."""
PAD = 12
"""Space around the sheet, in pixels."""
HALF_TURN = np.diag([-1.0, 1.0, -1.0])
"""From the front to the back."""


def regions_picture(regions: Regions, look: Look = REGION_LOOK) -> Picture:
    """A mesh from both sides, its regions coloured, dark spots on tips and details.

    Parameters
    ----------
    regions
        The regions of the mesh.
    look
        Size of each of the two parts, and engine.

    Returns
    -------
    Picture
        Two parts wide.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.features.regions import find_regions
    >>> from morphlet.report.features import regions_picture
    >>> from morphlet.report.look import Look
    >>> regions_picture(find_regions(sample("spiky", n_vertices=1500)), Look((80, 60), "matplotlib")).pixels.shape[1]
    184
    """
    colors = _spotted(_colors(regions, np.arange(len(regions))), regions.mesh, regions.landmarks[len(regions) :], LESSER)
    colors = _spotted(colors, regions.mesh, regions.tips, TIP)
    count = f"{len(regions)} region{'' if len(regions) == 1 else 's'}"
    return _sheet([_both_sides(regions.mesh, colors, count, look)], look)


def matching_picture(source: Regions, target: Regions, matching: Matching, look: Look = REGION_LOOK) -> Picture:
    """Two meshes from both sides, paired regions in the same colour, those without partner in grey; spots on the paired vertices.

    Parameters
    ----------
    source, target
        The regions that were matched.
    matching
        What belongs together.
    look
        Size of each of the four parts, and engine.

    Returns
    -------
    Picture
        Two parts wide and two high: the source above the target.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.features.matching import match
    >>> from morphlet.features.regions import find_regions
    >>> from morphlet.report.features import matching_picture
    >>> from morphlet.report.look import Look
    >>> star = find_regions(sample("spiky", n_vertices=1500))
    >>> matching_picture(star, star, match(star, star), Look((80, 60), "matplotlib")).pixels.shape
    (196, 184, 3)
    """
    hues = np.full((2, max(len(source), len(target))), -1)
    for number, (i, j) in enumerate(matching.regions):
        hues[0, i] = hues[1, j] = number
    spots = matching.pairs.source, matching.pairs.target
    rows = [
        _both_sides(regions.mesh, _spotted(_colors(regions, own[: len(regions)]), regions.mesh, vertices, TIP), name, look)
        for regions, own, vertices, name in zip((source, target), hues, spots, ("source", "target"), strict=True)
    ]
    return _sheet(rows, look)


def _colors(regions: Regions, hue: Int[np.ndarray, "k"]) -> Float[np.ndarray, "n 3"]:
    """A colour per vertex: that of its region's hue, grey for a negative one, clay outside the regions."""
    own = np.where(hue[:, None] < 0, ALONE, np.array(HUES)[hue % len(HUES)])
    return np.vstack([own, [REST]])[np.minimum(regions.nodes, len(regions))]


def _spotted(colors: Float[np.ndarray, "n 3"], mesh: Mesh, vertices: Int[np.ndarray, "s"], radius: float) -> Float[np.ndarray, "n 3"]:
    """The same colours with dark spots round some vertices."""
    near = np.min(distances(mesh, vertices), axis=0, initial=np.inf) < radius * np.sqrt(mesh.area)
    near[vertices] = True
    return np.where(near[:, None], MARK, colors)


def _both_sides(mesh: Mesh, colors: Float[np.ndarray, "n 3"], name: str, look: Look) -> list[tuple[str, Picture]]:
    """A mesh from the front and from the back, with captions."""
    front = view(mesh)
    eyes = ((name, front), (f"{name} (back)", replace(front, axes=HALF_TURN @ front.axes)))
    return [(caption, render(mesh, colors=colors, camera=eye.framed(mesh), look=look)) for caption, eye in eyes]


def _sheet(rows: list[list[tuple[str, Picture]]], look: Look) -> Picture:
    """Pictures in rows of two."""
    width, height = look.size
    step = height + canvas.CAPTION
    figure = canvas.sheet(2 * (width + PAD), len(rows) * step + 2 * PAD)
    for row, pictures in enumerate(rows):
        for column, (caption, picture) in enumerate(pictures):
            canvas.place(figure, Tile(picture.pixels, caption), PAD + column * width, PAD + row * step)
    return replace(rows[0][0][1], pixels=canvas.pixels(figure))
