"""Edited shapes as pictures: one line per tool, handle and anchors in colour, triangles that cut through others in red."""

from dataclasses import dataclass

import numpy as np

from editing_judge import Figures, crossing
from editing_problems import Problem
from morphlet import Mesh, Picture, render
from morphlet.report import canvas
from morphlet.report.camera import Camera
from morphlet.report.canvas import Tile
from morphlet.report.look import Look

LOOK = Look(size=(240, 190))
"""A tile."""
CLAY, HANDLE, ANCHOR, CUT = (0.87, 0.85, 0.82), (0.95, 0.66, 0.25), (0.45, 0.58, 0.72), (0.80, 0.12, 0.12)
"""Colours of what follows, what is pulled, what stays, what cuts through."""
AZIMUTH, ELEVATION = np.radians(20), np.radians(16)
"""The shapes stand on z and bend in the plane of x and z: they are looked at nearly along y."""
ROOM = 1.08
"""Around all shapes, in tile sizes."""
COLUMNS = 2
"""Tools side by side."""
PAD = 10
"""Space around the sheet, in pixels."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A shape to be drawn: the edit, all positions, whose they are, how they were judged."""

    problem: Problem
    positions: np.ndarray
    name: str
    figures: Figures | None = None


def picture_of(shown: dict[str, list[Shown]]) -> Picture:
    """One line of tiles per tool, two tools side by side."""
    names = list(dict.fromkeys(one.name for found in shown.values() for one in found))
    width, height = LOOK.size[0], LOOK.size[1] + canvas.CAPTION
    block, lines = width * len(shown), -(-len(names) // COLUMNS)
    figure = canvas.sheet(2 * PAD + COLUMNS * block + (COLUMNS - 1) * PAD, 2 * PAD + height * lines)
    for place, found in enumerate(shown.values()):
        camera = camera_of([one.positions for one in found], found[0].problem)
        for one in found:
            column, line = divmod(names.index(one.name), lines)
            canvas.place(figure, _tile(one, camera), PAD + column * (block + PAD) + place * width, PAD + line * height)
    engine = render(next(iter(shown.values()))[0].problem.mesh, look=LOOK)
    return Picture(canvas.pixels(figure), engine.engine, engine.reason)


def camera_of(positions: list[np.ndarray], problem: Problem) -> Camera:
    """Nearly along y; the shape at rest and under every tool is in the picture."""
    eye = np.array([np.sin(AZIMUTH) * np.cos(ELEVATION), -np.cos(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION)])
    right = np.cross([0, 0, 1], eye)
    right /= np.linalg.norm(right)
    points = np.concatenate([*positions, problem.pose()])
    camera = Camera(np.stack([right, np.cross(eye, right), eye]), np.zeros(3), np.ones(2))
    framed = camera.framed(Mesh(points, np.arange(3 * (len(points) // 3)).reshape(-1, 3)))
    return Camera(framed.axes, framed.centre, ROOM * framed.extent)


def _tile(one: Shown, camera: Camera) -> Tile:
    """A shape and its caption."""
    mesh = one.problem.mesh.with_vertices(one.positions)
    colors = np.tile(CLAY, (mesh.n_faces, 1))
    for part, color in ((one.problem.handle, HANDLE), (one.problem.anchors, ANCHOR)):
        colors[np.isin(mesh.faces, part).all(axis=1)] = color
    colors[crossing(mesh)] = CUT
    said = "" if one.figures is None else f"  {one.figures.energy:.3f}  {one.figures.pairs}"
    return Tile(render(mesh, colors=colors, camera=camera, look=LOOK).pixels, one.name.replace("morphlet ", "") + said)
