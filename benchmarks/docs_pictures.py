"""The pictures of docs/concepts: one per noun, of animals that the package makes itself.

    python benchmarks/docs_pictures.py [--out docs/pictures] [--only NAME ...]

Nothing here is a time, and the painter on matplotlib's canvas draws the same bits everywhere: the same pictures on any machine.
"""

import argparse
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from morphlet import (
    Alignment,
    ApproximationOptions,
    CorrespondResult,
    Creature,
    Mesh,
    Morph,
    Picture,
    Region,
    Roi,
    RoiEditor,
    Schedule,
    SphericalMap,
    SurfacePoints,
    VertexPairs,
    approximate,
    correspond_maps,
    decode,
    encode,
    find_regions,
    match,
    render,
    spherical_image,
    spherical_map,
    vertices_within,
)
from morphlet.metrics import psnr
from morphlet.numerics.unit_sphere import icosphere
from morphlet.pipeline.correspond import aligned
from morphlet.report import canvas
from morphlet.report.camera import Camera, view
from morphlet.report.canvas import Tile
from morphlet.report.color import place_colors
from morphlet.report.curves import Axis, curve_picture
from morphlet.report.features import HUES, matching_picture, regions_picture
from morphlet.report.look import Look
from morphlet.report.sheet import image_picture, sphere_picture
from morphlet.report.story import carried_colors, end_of
from morphlet.samples.poses import POSES

PAINTER = "matplotlib"
LOOK = Look(size=(300, 230), engine=PAINTER)
"""A tile."""
SMALL = Look(size=(180, 200), engine=PAINTER)
"""A tile among many."""
PLOT = (520, 300)
"""A plot, in pixels."""
VERTICES = 4000
"""Of an animal, unless its triangles are to be seen."""
FEW = 1500
"""Where they are."""
WIRE = 0.5
"""Width of edges, in pixels."""
CLAY, ORANGE, BLUE, DARK = (0.87, 0.85, 0.82), (0.95, 0.66, 0.25), (0.45, 0.58, 0.72), (0.15, 0.16, 0.20)
"""What follows, what is pulled, what stays, a mark."""
HEAD, SIZE = (0.0, 1.58, 1.5), 0.33
"""Middle and radius of the grazer's head, in mesh units."""
DOT, SPOT = 0.025, 0.04
"""Radius of a mark among many, and of one among few, in mesh units; the animals are two to three long."""
LARGEST, COLORS = 60_000, 256
"""Bytes of a picture, and the colours that it is brought to where it has more."""


@cache
def animal(species: str, n_vertices: int = VERTICES) -> Creature:
    """One of the package's animals."""
    return Creature.prepare(species, n_vertices)


def pairs() -> VertexPairs:
    """Places that both have."""
    ends = [list(animal(species).landmarks.values()) for species in ("grazer", "predator")]
    return VertexPairs(*ends, labels=tuple(animal("grazer").landmarks))


@cache
def mapped(species: str) -> SphericalMap:
    """An animal on the sphere."""
    return spherical_map(animal(species).mesh)


@cache
def matched() -> CorrespondResult:
    """Where the grazer's vertices lie on the predator."""
    return correspond_maps(mapped("grazer"), mapped("predator"), pairs())


def side_by_side(tiles: list[Tile], columns: int = 0) -> Picture:
    """Tiles of one size in rows, captions below."""
    columns = columns or len(tiles)
    height, width = tiles[0].pixels.shape[:2]
    step = height + canvas.CAPTION
    figure = canvas.sheet(width * columns, step * -(-len(tiles) // columns))
    for number, tile in enumerate(tiles):
        row, column = divmod(number, columns)
        canvas.place(figure, tile, column * width, row * step)
    return Picture(canvas.pixels(figure), PAINTER, "drawn alike everywhere")


def tile(mesh: Mesh, caption: str, camera: Camera, colors: np.ndarray | None = None, look: Look = LOOK) -> Tile:
    """A mesh with a caption."""
    return Tile(render(mesh, colors=colors, camera=camera, look=look).pixels, caption)


def around(*meshes: Mesh) -> Camera:
    """One camera for several shapes: the first one's direction, and room for all."""
    together = np.concatenate([mesh.vertices for mesh in meshes])
    spare = Mesh(together, np.arange(3 * (len(together) // 3)).reshape(-1, 3))
    return view(meshes[0]).framed(spare)


def dotted(mesh: Mesh, places: np.ndarray, colors: np.ndarray, radius: float = DOT) -> tuple[Mesh, np.ndarray]:
    """A mesh with a small ball at each place, and the colours of all vertices."""
    points, faces = icosphere(1)
    vertices, corners, shades = [mesh.vertices], [mesh.faces], [np.tile(CLAY, (mesh.n_vertices, 1))]
    for number, (place, color) in enumerate(zip(places, colors, strict=True)):
        vertices.append(place + radius * points)
        corners.append(faces + mesh.n_vertices + number * len(points))
        shades.append(np.tile(color, (len(points), 1)))
    return Mesh(np.vstack(vertices), np.vstack(corners)), np.vstack(shades)


def mesh() -> Picture:
    """A topology at two positions."""
    grazer = animal("grazer", FEW).mesh
    tall = grazer.with_vertices(grazer.vertices * [1, 1.3, 1])
    camera, look = around(grazer, tall), Look(LOOK.size, PAINTER, WIRE)
    return side_by_side([tile(grazer, "mesh", camera, look=look), tile(tall, "mesh.with_vertices(x)", camera, look=look)])


def surface_points() -> Picture:
    """The same places on two poses."""
    grazer = animal("grazer")
    shapes = grazer.posed(), grazer.posed(POSES["walking"])
    faces = np.linspace(0, grazer.mesh.n_faces - 1, 120).astype(np.int64)
    places = SurfacePoints(faces, np.full((len(faces), 3), 1 / 3))
    colors = place_colors(places.positions(shapes[0]))
    shown = [dotted(shape, places.positions(shape), colors) for shape in shapes]
    camera = around(*(shape for shape, _ in shown))
    return side_by_side([tile(shape, name, camera, own) for (shape, own), name in zip(shown, ("standing", "walking"), strict=True)])


def region() -> Picture:
    """A region and its patch."""
    grazer = animal("grazer").mesh
    head = Region(grazer, vertices_within(grazer, HEAD, SIZE))
    colors = np.tile(CLAY, (grazer.n_vertices, 1))
    colors[head.vertices], colors[head.boundary] = ORANGE, BLUE
    camera = view(grazer)
    patch = tile(head.patch, "region.patch", camera.framed(head.patch), colors[head.vertices])
    return side_by_side([tile(grazer, "region", camera, colors), patch])


def vertex_pairs() -> Picture:
    """Both animals with their common places."""
    told = pairs()
    hues = np.array(HUES)[np.arange(len(told)) % len(HUES)]
    tiles = []
    for species, vertices in (("grazer", told.source), ("predator", told.target)):
        shape, colors = dotted(animal(species).mesh, animal(species).mesh.vertices[vertices], hues, SPOT)
        tiles.append(tile(shape, species, view(shape), colors))
    return side_by_side(tiles)


def mesh_sequence() -> Picture:
    """Poses as frames."""
    grazer = animal("grazer")
    poses = [grazer.posed(POSES[name]) for name in ("standing", "walking", "leaping", "rearing", "grazing")]
    camera, colors = around(*poses), place_colors(poses[0].vertices)
    return side_by_side([tile(pose, f"t = {k}", camera, colors, SMALL) for k, pose in enumerate(poses)])


def sphere() -> Picture:
    """An animal and its sphere."""
    return sphere_picture(end_of(mapped("predator")), Look((280, 230), PAINTER))


def image() -> Picture:
    """An animal, its image, and the mesh made of that."""
    sampled = spherical_image(mapped("grazer"), 65)
    pixels = image_picture(sampled.positions).pixels
    shown = np.full((LOOK.size[1], LOOK.size[0], 3), 255, np.uint8)
    large = np.repeat(np.repeat(pixels, 3, axis=0), 3, axis=1)
    top, left = (shown.shape[0] - len(large)) // 2, (shown.shape[1] - large.shape[1]) // 2
    shown[top : top + len(large), left : left + large.shape[1]] = large
    grazer = animal("grazer").mesh
    ends = tile(grazer, "mesh", view(grazer)), tile(sampled.to_mesh(), "image.to_mesh()", view(grazer))
    return side_by_side([ends[0], Tile(shown, "x, y, z as red, green, blue"), ends[1]])


def networks() -> Picture:
    """An animal as more and more wavelets."""
    predator = mapped("predator")
    camera, diagonal, tiles = view(predator.mesh), predator.mesh.bbox_diagonal, []
    for count in (30, 120, 500):
        near = approximate(predator, predator.mesh.vertices, count, ApproximationOptions(levels=5)).mesh()
        rms = np.sqrt(np.mean(np.sum((near.vertices - predator.mesh.vertices) ** 2, axis=1)))
        tiles.append(tile(near, f"{count} wavelets, {psnr(float(rms), diagonal):.0f} dB", camera))
    return side_by_side(tiles)


def regions() -> Picture:
    """The limbs of an animal."""
    return regions_picture(find_regions(animal("grazer").mesh), LOOK)


def matching() -> Picture:
    """Two poses, matched."""
    predator = animal("predator")
    found = [find_regions(shape) for shape in (predator.posed(), predator.posed(POSES["leaping"]))]
    return matching_picture(*found, match(*found), Look((260, 190), PAINTER))


def alignment() -> Picture:
    """A sphere before and after, and the one that it is turned to."""
    source, target = mapped("grazer"), mapped("predator")
    found: Alignment = aligned(source, target, pairs())
    camera = view(target.mesh)
    colors = place_colors(source.mesh.vertices), matched().inverse.pull(place_colors(source.mesh.vertices))
    spheres = (
        ("grazer", Mesh(source.points, source.mesh.topology), colors[0]),
        ("turned and warped", Mesh(found(source.points), source.mesh.topology), colors[0]),
        ("predator", Mesh(target.points, target.mesh.topology), colors[1]),
    )
    return side_by_side([tile(ball, name, camera.framed(ball), own, Look((240, 220), PAINTER)) for name, ball, own in spheres])


def correspondence() -> Picture:
    """Colours of places, carried."""
    grazer, predator = animal("grazer").mesh, animal("predator").mesh
    ends = (grazer, "source", place_colors(grazer.vertices)), (predator, "target", carried_colors(matched()))
    return side_by_side([tile(shape, name, view(shape), colors) for shape, name, colors in ends])


def roi() -> Picture:
    """Regions of interest: by radius, and painted."""
    grazer = animal("grazer").mesh
    head = vertices_within(grazer, HEAD, SIZE)
    shown = [(Roi.within(grazer, head, radius), f"Roi.within(mesh, head, {radius})") for radius in (0.3, 0.8)]
    shown.append((Roi.painted(grazer, np.clip(grazer.vertices[:, 2] - 0.5, 0, 1)), "Roi.painted(mesh, weights)"))
    return side_by_side([tile(grazer, caption, view(grazer), _roles(one)) for one, caption in shown])


def _roles(one: Roi) -> np.ndarray:
    """Handle orange, free clay, anchors blue."""
    colors = np.tile(BLUE, (one.mesh.n_vertices, 1))
    colors[one.free], colors[one.handle] = CLAY, ORANGE
    return colors


def roi_editor() -> Picture:
    """Frames of a drag."""
    grazer = animal("grazer").mesh
    region_ = Roi.within(grazer, vertices_within(grazer, HEAD, SIZE), 0.8)
    head = grazer.vertices[region_.handle]
    path = RoiEditor.prepare(region_).sequence(np.stack([head + step * np.array([0.0, 0.1, 0.2]) for step in range(4)]))
    frames = [path[k] for k in range(4)]
    camera = around(*frames)
    return side_by_side([tile(shape, f"frame {k}", camera, _roles(region_), Look((220, 200), PAINTER)) for k, shape in enumerate(frames)])


def morph() -> Picture:
    """An animal that rears, with turning faces and on straight lines."""
    grazer = animal("grazer")
    grazing, rearing = grazer.posed(POSES["grazing"]), grazer.posed(POSES["rearing"])
    colors = place_colors(grazing.vertices)
    camera, tiles = around(grazing, rearing), []
    for path in ("gradient", "linear"):
        travel = Morph(grazing, rearing.vertices, path)
        tiles += [tile(travel(t), f"{path}, t = {t:g}", camera, colors, SMALL) for t in (0, 0.25, 0.5, 0.75, 1)]
    return side_by_side(tiles, 5)


def schedule() -> Picture:
    """Shares of four bands."""
    t = np.linspace(0, 1, 101)
    shares = Schedule.coarse_first(4)(t)
    curves = {f"band {k}": np.stack([t, share], axis=1) for k, share in enumerate(shares)}
    return curve_picture(curves, Axis("t"), Axis("share of the way"), PLOT)


def trace() -> Picture:
    """The energy of a spherical map: on the coarse meshes, then on the whole one."""
    steps = mapped("predator").trace.steps
    stages = list(dict.fromkeys(step.stage for step in steps if step.stage.startswith("newton")))[-3:]
    curves = {f"{stage.split()[1]} vertices": [step.objective for step in steps if step.stage == stage] for stage in stages}
    points = {name: np.stack([np.arange(len(values)), values], axis=1) for name, values in curves.items()}
    return curve_picture(points, Axis("step"), Axis("energy"), PLOT)


def encoded() -> Picture:
    """A mesh within three errors."""
    grazer = animal("grazer").mesh
    camera, tiles = view(grazer), []
    for percent in (1.0, 0.2, 0.05):
        file = encode(grazer, error=percent / 100 * grazer.bbox_diagonal)
        tiles.append(tile(decode(file.data)[0], f"{percent:g} %: {file.report.bytes} bytes", camera))
    return side_by_side(tiles)


PICTURES: dict[str, Callable[[], Picture]] = {
    "mesh": mesh, "surface-points": surface_points, "region": region, "vertex-pairs": vertex_pairs, "mesh-sequence": mesh_sequence,
    "spherical-map": sphere, "spherical-image": image, "wavelet-network": networks, "regions": regions, "matching": matching,
    "alignment": alignment, "correspondence": correspondence, "roi": roi, "roi-editor": roi_editor, "morph": morph,
    "schedule": schedule, "trace": trace, "encoded": encoded,
}  # fmt: skip
"""One per page."""


def save(picture: Picture, path: Path) -> None:
    """A PNG file, in fewer colours if it were too large."""
    from PIL import Image

    whole = Image.fromarray(picture.pixels)
    whole.save(path, optimize=True)
    if path.stat().st_size > LARGEST:
        whole.quantize(COLORS, dither=Image.Dither.NONE).save(path, optimize=True)


def main() -> None:
    """Draw them, or some of them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "docs" / "pictures")
    parser.add_argument("--only", nargs="*", choices=PICTURES, default=list(PICTURES))
    chosen = parser.parse_args()
    for name in chosen.only:
        save(PICTURES[name](), chosen.out / f"concept-{name}.png")


if __name__ == "__main__":
    main()
