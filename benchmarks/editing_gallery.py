"""Every editing method on one animal: the pictures of docs/editing.

    python benchmarks/editing_gallery.py --pictures docs/pictures

The head of the grazer is pulled up and forward without a turn, and turned down without a pull. Handle, free vertices and anchors have
their colours; triangles that cut through others are red. `editing-NAME-limit.png` shows a shape of `editing_problems` that the method does
not manage, beside a method that does better. Nothing here is a time: the same pictures on any machine.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from editing_judge import crossing
from editing_pictures import ANCHOR, CLAY, CUT, HANDLE, camera_of
from editing_problems import SHAPES
from morphlet import (
    Arap,
    Direct,
    DualLaplacian,
    EstimatedRotations,
    Guarded,
    Laplacian,
    Lattice,
    Mesh,
    MovingLeastSquares,
    Multiresolution,
    Picture,
    Roi,
    Shell,
    SimilarityLaplacian,
    edit,
    render,
    sample,
    vertices_within,
)  # fmt: skip
from morphlet.editing.method import Method
from morphlet.numerics.rotations import exponential
from morphlet.report import canvas
from morphlet.report.camera import Camera
from morphlet.report.canvas import Tile
from morphlet.report.look import Look

LOOK = Look(size=(320, 220), engine="matplotlib")
"""A tile; the painter on matplotlib's canvas draws the same bits everywhere."""
HEAD, SIZE = (0.0, 1.58, 1.5), 0.33
"""Middle and radius of the handle, in mesh units: the head with its ears."""
REACH, SHORT = 0.6, 0.2
"""Radius of the region, and of a smaller one; the grazer is 2.8 long."""
SHIFT = (0.0, 0.15, 0.35)
"""The pull without a turn: up and forward."""
PIVOT, NOD = (0.0, 1.2, 1.0), np.radians(85)
"""The turn, about the foot of the neck."""
BUMP, WAVES, FINE = 0.015, 45.0, 14000
"""Height of the bumps of the shaggy grazer, how many radians of them there are in a unit of length, and vertices that show them."""
LOOSE = 1e-5
"""Weight of a soft handle that gives way visibly."""
AZIMUTH, ELEVATION = np.radians(65), np.radians(8)
"""Seen from the animal's left front."""
FRONT, NECK = ((0.0, 1.28, 1.2), (1.0, 0.72)), ((0.0, 1.1, 1.22), (0.55, 0.4))
"""What the pictures show: the front half and where the head goes, or the neck alone. Middle, half the width and height."""

METHODS: dict[str, Method] = {
    "direct": Direct(), "mls": MovingLeastSquares(), "lattice": Lattice(), "harmonic": Laplacian(1), "biharmonic": Laplacian(2),
    "similarity": SimilarityLaplacian(), "dual": DualLaplacian(), "rotations": EstimatedRotations(), "arap": Arap(),
    "smoothed": Arap(smoothing=2e-4), "shell": Shell(),
}  # fmt: skip
"""Shown pulled and turned."""
CALLS = {"harmonic": "Laplacian(1)", "biharmonic": "Laplacian(2)"}
"""What those are called by that are not a class without parameters."""
LIMITS = {
    "direct": ("cactus", "arap"), "mls": ("cylinder", "shell"), "lattice": ("bar", "shell"), "harmonic": ("cylinder", "shell"),
    "biharmonic": ("cactus", "arap"), "similarity": ("cactus", "arap"), "dual": ("bar", "shell"), "rotations": ("plane", "arap"),
    "arap": ("cylinder", "shell"),
}  # fmt: skip
"""What each does not manage, and what does better."""

Frame = tuple[tuple[float, float, float], tuple[float, float]]


@dataclass(frozen=True, eq=False)
class Nod:
    """A region about the head, and where the handle goes."""

    roi: Roi
    targets: np.ndarray
    frame: Frame = FRONT

    @staticmethod
    def pulled(mesh: Mesh) -> "Nod":
        """Up and forward, without a turn."""
        roi = region(mesh, REACH)
        return Nod(roi, mesh.vertices[roi.handle] + SHIFT)

    @staticmethod
    def turned(mesh: Mesh, frame: Frame = FRONT) -> "Nod":
        """Down, about the foot of the neck."""
        roi = region(mesh, REACH)
        rotation = exponential(np.array([[NOD, 0.0, 0.0]])).reshape(3, 3)
        return Nod(roi, (mesh.vertices[roi.handle] - PIVOT) @ rotation.T + PIVOT, frame)

    def by(self, method: Method, caption: str) -> Tile:
        """What a method makes of it."""
        return tile(self.roi, edit(self.roi, self.targets, method), caption, camera(*self.frame))


def region(mesh: Mesh, radius: float) -> Roi:
    """The head is the handle; what lies within a radius of it along the surface follows."""
    return Roi.within(mesh, vertices_within(mesh, HEAD, SIZE), radius)


def tile(roi: Roi, mesh: Mesh, caption: str, seen: Camera) -> Tile:
    """A mesh with the region in its colours."""
    colors = np.tile(ANCHOR, (mesh.n_faces, 1))
    colors[np.isin(mesh.faces, roi.moving).any(axis=1)] = CLAY
    colors[np.isin(mesh.faces, roi.handle).all(axis=1)] = HANDLE
    colors[crossing(mesh)] = CUT
    return Tile(render(mesh, colors=colors, camera=seen, look=LOOK).pixels, caption)


def camera(centre: tuple[float, ...], extent: tuple[float, ...]) -> Camera:
    """From the same side for all."""
    eye = np.array([np.sin(AZIMUTH) * np.cos(ELEVATION), np.sin(ELEVATION), np.cos(AZIMUTH) * np.cos(ELEVATION)])
    right = np.cross([0, 1, 0], eye)
    right /= np.linalg.norm(right)
    return Camera(np.stack([right, np.cross(eye, right), eye]), np.array(centre), np.array(extent))


def shaggy(mesh: Mesh) -> Mesh:
    """The same with small bumps all over."""
    x, y, z = (WAVES * mesh.vertices).T
    return mesh.with_vertices(mesh.vertices + BUMP * (np.sin(x) * np.sin(y) * np.sin(z))[:, None] * mesh.vertex_normals)


def gallery() -> dict[str, list[Tile]]:
    """The tiles of every picture."""
    grazer = sample("grazer")
    bumpy = shaggy(sample("grazer", n_vertices=FINE))
    pulled, turned, rough = Nod.pulled(grazer), Nod.turned(grazer), Nod.turned(bumpy, NECK)
    soft = Nod(turned.roi.softened(LOOSE), turned.targets)
    shown = {"regions": [tile(region(grazer, radius), grazer, f"radius {radius}", camera(*FRONT)) for radius in (SHORT, REACH)]}
    shown |= {name: [pulled.by(method, "pulled"), turned.by(method, "turned")] for name, method in METHODS.items()}
    shown |= {f"{name}-limit": compared(name, *other) for name, other in LIMITS.items()}
    shown["guarded"] = [turned.by(Shell(), "turned: Shell()"), turned.by(Guarded(), "turned: Guarded()")]
    plain, fine = Laplacian(2), Multiresolution(Laplacian(2))
    shown["multiresolution"] = [rough.by(plain, "turned: Laplacian(2)"), rough.by(fine, "turned: Multiresolution(Laplacian(2))")]
    shown["soft"] = [turned.by(Arap(), "turned: held exactly"), soft.by(Arap(), f"turned: weight {LOOSE:g}")]
    return shown


def compared(name: str, shape: str, better: str) -> list[Tile]:
    """A method, and one that does better, on one of the hard shapes."""
    problem = SHAPES[shape]()
    edited = {one: edit(problem.roi, problem.pose(), METHODS[one]) for one in (name, better)}
    seen = camera_of([mesh.vertices for mesh in edited.values()], problem)
    return [tile(problem.roi, mesh, CALLS.get(one, f"{type(METHODS[one]).__name__}()"), seen) for one, mesh in edited.items()]


def laid_out(tiles: list[Tile]) -> Picture:
    """Side by side, captions below."""
    width, height = LOOK.size
    figure = canvas.sheet(width * len(tiles), height + canvas.CAPTION)
    for place, one in enumerate(tiles):
        canvas.place(figure, one, place * width, 0)
    return Picture(canvas.pixels(figure), LOOK.engine, "drawn alike everywhere")


def main() -> None:
    """Write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, required=True, help="folder for editing-NAME.png")
    folder = parser.parse_args().pictures
    for name, tiles in gallery().items():
        laid_out(tiles).save(folder / f"editing-{name}.png")


if __name__ == "__main__":
    main()
