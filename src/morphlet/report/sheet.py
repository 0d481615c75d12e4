"""Results on one sheet: a morph with both spheres, a sphere with its distortion, a geometry image.

Everything comes as plain meshes and arrays. A sphere is a `Mesh` of unit vectors over the faces of the mesh it maps.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.report import canvas
from morphlet.report.camera import Camera, view
from morphlet.report.canvas import Box, Tile
from morphlet.report.color import ColorScale, place_colors
from morphlet.report.look import Look
from morphlet.report.render import Picture, render
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

COLUMNS = 4
"""Tiles in a row of the contact sheet."""
FRAMES = 12
"""Frames of a morph on the contact sheet: three rows."""
SHEET = Look(size=(360, 256))
"""A tile of the contact sheet."""
BESIDE = Look(size=(560, 480))
"""A picture beside the histogram of the distortion."""
WIRE = 0.6
"""Width of the edges drawn on a sphere, in pixels."""
BINS = 60
"""Bars of a histogram."""
PAD = 16
"""Space around the sheet and around plots, in pixels."""
AXIS_ROOM = 70
"""Space for the numbers and label beside an axis, in pixels."""
HALF_TURN = np.diag([-1.0, 1.0, -1.0])
"""From the front to the back: right becomes left, toward becomes away."""


@dataclass(frozen=True, eq=False)
class Mapped:
    """A mesh, the sphere it is mapped to, and a number per face that says how much the map distorts it.

    Parameters
    ----------
    mesh
        The mesh.
    sphere
        The same faces over unit vectors.
    distortion
        One number per face.
    """

    mesh: Mesh
    sphere: Mesh
    distortion: Float[np.ndarray, "m"]

    def __post_init__(self) -> None:
        if not np.array_equal(self.sphere.faces, self.mesh.faces):
            raise InputError("a sphere over the faces of its mesh", f"{self.sphere.n_faces} others", "pass Mesh(points, mesh.topology)")
        object.__setattr__(self, "distortion", _arrays.real(self.distortion, "distortion", (self.mesh.n_faces,)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Mapped, (self.mesh, self.sphere, np.array(self.distortion))


def contact_sheet(
    source: Mapped,
    target: Mapped,
    frames: MeshSequence,
    *,
    target_colors: Float[np.ndarray, "n 3"] | None = None,
    look: Look = SHEET,
) -> Picture:
    """A morph on one sheet: source and target with their spheres, up to twelve frames, and what corresponds to what.

    Parameters
    ----------
    source, target
        Both ends, with their spheres and the distortion of these.
    frames
        The morph; its vertices wear the colours of their places in the first frame.
    target_colors
        The colours of the source's places (`place_colors`), carried to each vertex or face of the target through the correspondence. If
        given, one more row shows source and target in these colours from both sides.
    look
        Size of a tile, engine, and the scale of the distortion.

    Returns
    -------
    Picture
        Four tiles wide.

    Raises
    ------
    InputError
        If the sequence is empty, or the colours do not fit the target.

    Notes
    -----
    16 to 20 pictures, at the cost of `render` each.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh, MeshSequence
    >>> from morphlet.report.look import Look
    >>> from morphlet.report.sheet import Mapped, contact_sheet
    >>> ball = Mesh([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    >>> end = Mapped(ball, ball, np.ones(4))
    >>> morph = MeshSequence(ball.topology, np.stack([ball.vertices, 2 * ball.vertices]), [0.0, 1.0])
    >>> contact_sheet(end, end, morph, look=Look((80, 60), "matplotlib")).pixels.shape[1]
    352
    """
    if not len(frames):
        raise InputError("a morph of at least one frame", "none", "pass morph.frames(n)")
    look = replace(look, scale=look.scale or ColorScale.of(np.concatenate([source.distortion, target.distortion]), "distortion"))
    axes = view(source.mesh)
    tiles = _ends(source, target, axes, look)
    if target_colors is not None:
        tiles += _colored_ends(source.mesh, target.mesh, target_colors, axes, look)
    tiles += _frame_tiles(frames, axes, look)
    drawn = _laid_out([tile for tile, _ in tiles], look)
    return replace(tiles[0][1], pixels=drawn)


Drawn = tuple[Tile, Picture]


def _drawn(caption: str, picture: Picture) -> Drawn:
    """A tile, and the picture it came from."""
    return Tile(picture.pixels, caption), picture


def _ends(source: Mapped, target: Mapped, camera: Camera, look: Look) -> list[Drawn]:
    """Source, its sphere, the target's sphere, target."""

    def sphere(end: Mapped) -> Picture:
        return render(end.sphere, values=end.distortion, camera=camera.framed(end.sphere), look=look)

    def shape(end: Mapped) -> Picture:
        return render(end.mesh, camera=camera.framed(end.mesh), look=look)

    return [
        _drawn("source", shape(source)),
        _drawn("sphere of the source", sphere(source)),
        _drawn("sphere of the target", sphere(target)),
        _drawn("target", shape(target)),
    ]


def _colored_ends(source: Mesh, target: Mesh, target_colors: Float[np.ndarray, "n 3"], camera: Camera, look: Look) -> list[Drawn]:
    """Source and target in the source's colours, from both sides."""
    back = replace(camera, axes=HALF_TURN @ camera.axes)
    ends = ("source, coloured by place", source, place_colors(source.vertices)), ("target, the same places", target, target_colors)
    return [
        _drawn(f"{name}{side}", render(mesh, colors=colors, camera=eye.framed(mesh), look=look))
        for side, eye in (("", camera), (" (back)", back))
        for name, mesh, colors in ends
    ]


def _frame_tiles(frames: MeshSequence, camera: Camera, look: Look) -> list[Drawn]:
    """Some frames, the first and the last among them, in the colours of their places in the first."""
    chosen = np.unique(np.rint(np.linspace(0, len(frames) - 1, min(FRAMES, len(frames)))).astype(np.int64))
    colors = place_colors(frames.positions[0])
    cameras = follow(frames, chosen, camera)
    return [
        _drawn(f"t = {frames.times[k]:.3g}", render(frames[int(k)], colors=colors, camera=eye, look=look))
        for k, eye in zip(chosen, cameras, strict=True)
    ]


def follow(frames: MeshSequence, chosen: Int[np.ndarray, "k"], camera: Camera) -> Iterator[Camera]:
    """A camera per chosen frame: one direction, a frame that changes evenly in time from the first to the last and cuts nothing off."""
    framed = [camera.framed(frames[int(k)]) for k in chosen]
    times = frames.times[chosen]
    share = (times - times[0]) / (times[-1] - times[0]) if len(times) > 1 else np.zeros(1)
    centres = framed[0].centre + share[:, None] * (framed[-1].centre - framed[0].centre)
    extents = framed[0].extent + share[:, None] * (framed[-1].extent - framed[0].extent)
    own = np.array([eye.extent for eye in framed])
    off = np.abs(np.array([eye.centre for eye in framed]) - centres) @ np.abs(camera.axes[:2].T)
    enlarged = extents + np.maximum(own + off - extents, 0).max(axis=0)
    return (Camera(camera.axes, centre, extent) for centre, extent in zip(centres, enlarged, strict=True))


def _laid_out(tiles: list[Tile], look: Look) -> np.ndarray:
    """The tiles in rows, the colour bar of the distortion under the spheres of the first row."""
    width, height = look.size
    rows = -(-len(tiles) // COLUMNS)
    step = height + canvas.CAPTION
    figure = canvas.sheet(COLUMNS * width + 2 * PAD, rows * step + canvas.BAR_BAND + 2 * PAD)
    for number, tile in enumerate(tiles):
        row, column = divmod(number, COLUMNS)
        canvas.place(figure, tile, PAD + column * width, PAD + row * step + canvas.BAR_BAND * (row > 0))
    if look.scale:
        canvas.color_bar(figure, look.scale, Box(PAD + 1.25 * width, PAD + step, 1.5 * width, canvas.BAR_BAND))
    return canvas.pixels(figure)


def sphere_picture(mapped: Mapped, look: Look = BESIDE) -> Picture:
    """A mesh and its sphere, both coloured by the distortion, beside the distortion's histogram.

    Parameters
    ----------
    mapped
        Mesh, sphere, distortion.
    look
        Size of each of the three parts, engine, and scale.

    Returns
    -------
    Picture
        Three parts wide; the histogram counts area of the mesh.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.report.look import Look
    >>> from morphlet.report.sheet import Mapped, sphere_picture
    >>> ball = Mesh([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    >>> sphere_picture(Mapped(ball, ball, np.arange(4.0)), Look((200, 160), "matplotlib")).engine
    'matplotlib'
    """
    scale = look.scale or ColorScale.of(mapped.distortion, "distortion")
    look = replace(look, scale=scale)
    camera = view(mapped.mesh)
    shape = render(mapped.mesh, values=mapped.distortion, camera=camera, look=look)
    wired = replace(look, edges=look.edges or WIRE)
    sphere = render(mapped.sphere, values=mapped.distortion, camera=camera.framed(mapped.sphere), look=wired)
    width, height = look.size
    figure = canvas.sheet(3 * width + 2 * PAD, height + canvas.CAPTION + canvas.BAR_BAND + 2 * PAD)
    canvas.place(figure, Tile(shape.pixels, "mesh"), PAD, PAD)
    canvas.place(figure, Tile(sphere.pixels, "sphere"), PAD + width, PAD)
    canvas.color_bar(figure, scale, Box(PAD + width / 2, PAD + height + canvas.CAPTION, width, canvas.BAR_BAND))
    _histogram(figure, mapped, scale, Box(PAD + 2 * width + AXIS_ROOM, 2 * PAD, width - AXIS_ROOM - PAD, height - 2 * PAD))
    return replace(shape, pixels=canvas.pixels(figure))


def _histogram(figure: Any, mapped: Mapped, scale: ColorScale, box: Box) -> None:
    """Percent of the mesh's area for each interval of the distortion; what lies beyond the scale counts in its last bars."""
    bounds = np.linspace(scale.low, scale.high, BINS + 1)
    inside = np.clip(mapped.distortion, scale.low, scale.high)
    area, _ = np.histogram(inside, bounds, weights=100 * mapped.mesh.face_areas / mapped.mesh.area)
    drawn = canvas.axes(figure, box)
    middle = (bounds[1:] + bounds[:-1]) / 2
    drawn.bar(middle, area, width=np.diff(bounds), color=scale(middle))
    drawn.set_xlim(scale.low, scale.high)
    drawn.set_xlabel(scale.label)
    drawn.set_ylabel("area of the mesh, %")


def image_picture(image: Float[np.ndarray, "h w 3"], mask: Bool[np.ndarray, "h w"] | None = None) -> Picture:
    """A geometry image as colours: x, y, z as red, green, blue, each from its lowest to its highest value.

    Parameters
    ----------
    image
        A position per pixel, in mesh units.
    mask
        Which pixels hold a position; the others are white. All of them if left out.

    Returns
    -------
    Picture
        One pixel per position.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.report.sheet import image_picture
    >>> image_picture(np.array([[[0.0, 0.0, 0.0], [2.0, 1.0, 0.0]]])).pixels.tolist()
    [[[0, 0, 0], [255, 255, 0]]]
    """
    positions = np.asarray(image, dtype=np.float64)
    known = np.ones(positions.shape[:2], bool) if mask is None else np.asarray(mask, dtype=bool)
    if positions.ndim != 3 or positions.shape[2] != 3 or known.shape != positions.shape[:2]:
        raise InputError("an image (h, w, 3) and a mask (h, w)", f"{positions.shape} and {known.shape}", "pass both of one image")
    inside = _arrays.real(positions[known], "the image within its mask", (None, 3))
    rgb = np.full(positions.shape, 255, np.uint8)
    if len(inside):
        low, size = inside.min(axis=0), np.ptp(inside, axis=0)
        rgb[known] = np.rint(255 * (inside - low) / np.where(size > 0, size, 1.0)).astype(np.uint8)
    return Picture(rgb, "none", "an image is its own picture")
