"""Correspondences as pictures: the target's colours and checkers, carried to the source by each map."""

from dataclasses import dataclass

import numpy as np

from morphlet import Mesh, Picture, SurfacePoints, render
from morphlet.report import canvas
from morphlet.report.camera import view
from morphlet.report.canvas import Tile
from morphlet.report.color import HIGHEST, LOWEST
from morphlet.report.look import Look
from morphlet.samples.truth import KnownPair

LOOK = Look(size=(300, 230))
"""A tile."""
CHECKS = 14
"""Checkers along the diagonal of the target's bounding box."""
DARK = 0.62
"""Brightness of the dark checkers."""
PAD = 10
"""Space around the sheet, in pixels."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A map to be drawn: the pair, the places, its name and its mean error (None where there is none)."""

    pair: KnownPair
    points: SurfacePoints
    name: str
    error: float | None


def colors_at(target: Mesh, positions: np.ndarray) -> np.ndarray:
    """The colour of each place of the target: by its place in the bounding box, in checkers."""
    low, size = target.vertices.min(axis=0), np.ptp(target.vertices, axis=0)
    colors = LOWEST + (HIGHEST - LOWEST) * (positions - low) / np.where(size > 0, size, 1.0)
    parity = np.floor((positions - low) * (CHECKS / target.bbox_diagonal)).sum(axis=1) % 2
    return np.clip(np.where(parity[:, None] > 0, colors, DARK * colors), 0, 1)


def tiles_of(name: str, maps: list[Shown]) -> list[Tile]:
    """The target, the source by the truth where all of it is known, the source by each map."""
    pair = maps[0].pair
    target, camera = pair.target, view(pair.target)
    middles = target.vertices[target.faces].mean(axis=1)
    tiles = [Tile(render(target, colors=colors_at(target, middles), camera=camera, look=LOOK).pixels, f"{name}: target")]
    if len(pair.vertices) > 0.9 * pair.source.n_vertices:
        truth = np.zeros((pair.source.n_vertices, 3))
        truth[pair.vertices] = pair.truth.positions(target)
        tiles.append(_source_tile(pair, truth, "truth"))
    for one in maps:
        error = "" if one.error is None else f": {one.error:.2f}"
        tiles.append(_source_tile(pair, one.points.positions(target), one.name + error))
    return tiles


def _source_tile(pair: KnownPair, positions: np.ndarray, caption: str) -> Tile:
    """The source in the colours of the places where the middles of its faces arrive."""
    middles = positions[pair.source.faces].mean(axis=1)
    camera = view(pair.target).framed(pair.source)
    return Tile(render(pair.source, colors=colors_at(pair.target, middles), camera=camera, look=LOOK).pixels, caption)


def picture_of(shown: list[tuple[str, list[Shown]]]) -> Picture:
    """One line of tiles per pair."""
    lines = [tiles_of(name, maps) for name, maps in shown if maps]
    width, height = LOOK.size[0], LOOK.size[1] + canvas.CAPTION
    figure = canvas.sheet(2 * PAD + width * max(map(len, lines), default=1), 2 * PAD + height * len(lines))
    for i, tiles in enumerate(lines):
        for k, tile in enumerate(tiles):
            canvas.place(figure, tile, PAD + k * width, PAD + i * height)
    engine = render(shown[0][1][0].pair.target, look=LOOK) if lines else None
    return Picture(canvas.pixels(figure), engine.engine if engine else "matplotlib", engine.reason if engine else "no maps")
