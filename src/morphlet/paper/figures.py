"""Figures 1 to 4, 8 and 10 to 16 of the paper, each a function of the stock of objects."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np
from jaxtyping import Float, Int

from morphlet import metrics
from morphlet.editing.arap import Arap
from morphlet.editing.editor import edit
from morphlet.editing.estimated import EstimatedRotations
from morphlet.editing.falloff import ratios
from morphlet.editing.lattice import Lattice
from morphlet.editing.method import Method
from morphlet.editing.roi import Roi, vertex_path
from morphlet.mapping.correspondence import Correspondence
from morphlet.motion.morph import MorphPath
from morphlet.paper.exhibit import Exhibit, table_of
from morphlet.paper.marks import Painted, arrows, dots, painted, rods, together
from morphlet.paper.plates import PART, WIDE, Captioned, parts, plate, shot, wide_view
from morphlet.paper.stopwatch import clocked
from morphlet.paper.subjects import Stock, Subject, farthest
from morphlet.pipeline.morph import morph_along
from morphlet.pipeline.results import CorrespondResult
from morphlet.report.camera import Camera, view
from morphlet.report.curves import coordinate_picture
from morphlet.report.features import regions_picture
from morphlet.report.page import Plate, Value
from morphlet.report.render import CLAY, Picture, render
from morphlet.report.sheet import sphere_picture
from morphlet.report.story import end_of
from morphlet.report.strip import frame_strip
from morphlet.surface.distance import farthest_points
from morphlet.surface.intersections import self_intersections
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

GREEN, RED, BLUE, DARK = (0.16, 0.60, 0.25), (0.82, 0.16, 0.14), (0.20, 0.42, 0.72), (0.18, 0.19, 0.22)
"""Arrows there and back, lattices and dots."""
CONTROL = (4, 4, 4)
"""Control points of the lattice of Figure 1."""
BEND, SWELL = 0.35, 0.25
"""How far the top of the lattice goes aside, and how much wider it grows, over the size of its box."""
THIN, DOT = 0.0028, 0.005
"""Radius of rods and dots, over the bounding-box diagonal."""
MOUTHS = (("lifted", (0.0, 0.08, 0.02)), ("drawn aside", (0.13, 0.02, 0.03)))
"""Ways of the curve of Figure 2, over the diagonal."""
SNOUT = 0.16
"""Of the diagonal round the snout's tip: the curve goes through the ends of that part on either side."""
RADII = (0.07, 0.22)
"""The two regions of Figure 3, over the diagonal."""
NOSE = (0.0, 0.0, 0.06)
"""Way of the handle of Figure 3, over the diagonal."""
ARROWS = 26
"""Arrows each way in Figure 4."""
APART = 1.15
"""Distance of the two meshes of Figure 4, over the width of the first."""
CURVES = (620, 560)
"""Size of a part of Figure 12, in pixels."""


def figure_1(stock: Stock) -> Exhibit:
    """Free-form deformation of the bunny."""
    mesh, cage = stock.bunny.mesh, Lattice(CONTROL, "bernstein")
    box = np.stack([mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)])
    rest = cage.points(box)
    share = np.linspace(0, 1, CONTROL[1])[None, :, None, None] ** 2
    middle = box.mean(axis=0)
    shifts = share * (np.array([BEND, 0, 0]) * np.ptp(box[:, 0]) + SWELL * (rest - middle) * [1, 0, 1])
    shapes = (
        ("at rest, in a regular lattice", mesh, rest),
        ("deformed by its control points", cage.deform(mesh, shifts, box), rest + shifts),
    )
    seen = [(name, _caged(shape, points)) for name, shape, points in shapes]
    camera = wide_view(*(thing.mesh for _, thing in seen))
    drawn = [(name, render(thing.mesh, colors=thing.colors, camera=camera, look=PART)) for name, thing in seen]
    caption = f"Free-form deformation of the {stock.bunny.name} in a lattice of {CONTROL[0]} x {CONTROL[1]} x {CONTROL[2]} control points."
    return Exhibit(caption, plates=(plate(drawn, 2, "The bunny and its lattice, before and after"),))


def _caged(mesh: Mesh, points: Float[np.ndarray, "l m n 3"]) -> Painted:
    """A mesh among the lines and control points of a lattice."""
    size = float(np.linalg.norm(np.ptp(points.reshape(-1, 3), axis=0)))
    lines = [(np.delete(points, -1, axis), np.delete(points, 0, axis)) for axis in range(3)]
    starts, ends = (np.concatenate([line[k].reshape(-1, 3) for line in lines]) for k in range(2))
    cage = painted(rods(starts, ends, THIN * size), BLUE), painted(dots(points.reshape(-1, 3), 2 * DOT * size), BLUE)
    return together(painted(mesh, CLAY), *cage)


def figure_2(stock: Stock) -> Exhibit:
    """A mouth deformed in different ways by a handle that is a curve."""
    mesh = stock.dragon.mesh
    curve = _across_snout(stock.dragon)
    roi = Roi.within(mesh, curve, stock.dragon.model.recipe.region * mesh.bbox_diagonal)
    rest = mesh.vertices[curve]
    shapes = [("original, with the handle's curve", mesh)]
    shapes += [(name, edit(roi, rest + np.array(way) * mesh.bbox_diagonal)) for name, way in MOUTHS]
    camera = wide_view(*(shape for _, shape in shapes))
    drawn = [(name, _with_curve(shape, curve, camera)) for name, shape in shapes]
    caption = (
        f"A handle that is a curve of {len(curve)} vertices across the snout, pulled in two ways; the region is {len(roi.free)} vertices."
    )
    remark = f"The paper's dragon is not public: {stock.dragon.origin} stands in."
    return Exhibit(caption, plates=(plate(drawn, 3, "A snout at rest and deformed in two ways"),), remarks=(remark,))


def _across_snout(subject: Subject) -> Int[np.ndarray, "k"]:
    """The way along edges from one side of the snout over its tip to the other."""
    mesh = subject.mesh
    near = Roi.within(mesh, np.array([subject.tip]), SNOUT * mesh.bbox_diagonal).moving
    picks = [farthest(mesh, (1, 0, 0), near), subject.tip, farthest(mesh, (-1, 0, 0), near)]
    return vertex_path(mesh, np.array(picks))


def _with_curve(mesh: Mesh, curve: Int[np.ndarray, "k"], camera: Camera) -> Picture:
    """A mesh and the handle's curve on it."""
    places = mesh.vertices[curve]
    thing = together(painted(mesh, CLAY), painted(rods(places[:-1], places[1:], 2 * THIN * mesh.bbox_diagonal), RED))
    return render(thing.mesh, colors=thing.colors, camera=camera, look=PART)


def figure_3(stock: Stock) -> Exhibit:
    """One handle, one drag, two radii of the region."""
    mesh, tip = stock.face.mesh, np.array([stock.face.tip])
    goal = mesh.vertices[tip] + np.array(NOSE) * mesh.bbox_diagonal
    rois = [Roi.within(mesh, tip, share * mesh.bbox_diagonal) for share in RADII]
    edited = [edit(roi, goal) for roi in rois]
    camera = wide_view(mesh, *edited)
    drawn = list[Captioned]()
    for letters, share, roi, shape in zip(("ab", "cd"), RADII, rois, edited, strict=True):
        drawn.append((f"({letters[0]}) region of radius {100 * share:.0f} % of the diagonal", _anchored(mesh, roi, camera)))
        drawn.append((f"({letters[1]}) its nose dragged", _anchored(shape, roi, camera)))
    rows = [_reach(share, roi, shape) for share, roi, shape in zip(RADII, rois, edited, strict=True)]
    heads = ("radius, % of diagonal", "free vertices", "anchors on the rim", "mean way of the region, % of the drag")
    caption = "The same vertex at the tip of the nose is dragged along the same way; the dots are the anchors that surround the region."
    remark = f"The paper's Mannequin is not public: {stock.face.origin} stands in."
    return Exhibit(caption, table_of(heads, rows), (plate(drawn, 2, "A nose dragged with a small and with a large region"),), (remark,))


def _anchored(shape: Mesh, roi: Roi, camera: Camera) -> Picture:
    """A mesh with dots on the anchors round the region and on its handle."""
    size = shape.bbox_diagonal
    marks = painted(dots(shape.vertices[roi.rim], DOT * size), DARK), painted(dots(shape.vertices[roi.handle], 2 * DOT * size), RED)
    thing = together(painted(shape, CLAY), *marks)
    return render(thing.mesh, colors=thing.colors, camera=camera, look=PART)


def _reach(share: float, roi: Roi, shape: Mesh) -> tuple[Value, ...]:
    """A line of the table of Figure 3."""
    way = np.linalg.norm(shape.vertices - roi.mesh.vertices, axis=1)
    return 100 * share, len(roi.free), len(roi.rim), 100 * float(way[roi.free].mean() / way[roi.handle].max())


def figure_4(stock: Stock) -> Exhibit:
    """Source vertices to places of the target, and the other way."""
    found = stock.cat_to_lion
    ways = ("source vertices to the target", found.correspondence, GREEN), ("target vertices to the source", found.inverse, RED)
    drawn = [(name, _arrowed(there, color, found)) for name, there, color in ways]
    caption = (
        f"The {stock.cat.name} and what it becomes ({stock.lion.origin}), mapped to each other through the sphere: green arrows from "
        "vertices of the "
        f"source to places on the target's surface, red ones from vertices of the target to places on the source's; {ARROWS} of each "
        "are drawn."
    )
    plates = (plate(drawn, 1, "Arrows from source to target, and back"),)
    return Exhibit(caption, table_of(("figure", "value"), list(_told(found))), plates, tuple(found.warnings))


def _arrowed(there: Correspondence, color: tuple[float, float, float], found: CorrespondResult) -> Picture:
    """Both meshes side by side, and arrows from some vertices of one to their places on the other."""
    source, target = found.source_map.mesh, found.target_map.mesh
    camera = view(source)
    aside = _aside(source, target, camera)
    back = there.source is not source
    closed = (found.target_map if back else found.source_map).surface
    chosen = closed.source_vertices[farthest_points(closed.mesh, ARROWS)[0]]
    starts, ends = there.source.vertices[chosen], there.positions[chosen]
    starts, ends = (starts + aside, ends) if back else (starts, ends + aside)
    pair = painted(source, CLAY), painted(target.with_vertices(target.vertices + aside), CLAY)
    radius = THIN * source.bbox_diagonal
    return shot(together(*pair, painted(arrows(starts, ends, radius), color)), camera, WIDE)


def _aside(source: Mesh, target: Mesh, camera: Camera) -> Float[np.ndarray, "3"]:
    """Where to put the target so that it stands right of the source, at its height."""
    widths = [camera.framed(mesh) for mesh in (source, target)]
    gap = APART * (widths[0].extent[0] + widths[1].extent[0])
    return np.asarray(widths[0].centre - widths[1].centre + gap * camera.axes[0])


def _told(found: CorrespondResult) -> Iterator[tuple[str, Value]]:
    """The figures of a map, by name."""
    yield from found.figures().items()


def figure_8(stock: Stock) -> Exhibit:
    """Original and target objects."""
    others = {stock.horse.name: stock.camel, stock.cat.name: stock.lion}
    drawn = list[Captioned]()
    for subject in stock.four:
        camera = wide_view(subject.mesh, subject.deformed)
        drawn.append((f"{subject.name}: {subject.origin}", render(subject.mesh, camera=camera, look=PART)))
        drawn.append(("target: its handle moved", render(subject.deformed, colors=parts(subject.roi), camera=camera, look=PART)))
        other = others.get(subject.name)
        if other is not None:
            drawn.append((f"target: {other.origin}", render(other.mesh, camera=view(other.mesh), look=PART)))
        else:
            drawn.append(("no other object of its kind is public", _nothing()))
    caption = (
        "Originals and targets: each object with its own edit (red: handle, yellow: what follows), and where there is one, with another."
    )
    remark = (
        "The paper shows its targets without saying what they are. Here a target is, after its Section 3, given by a target position "
        "for each "
        "handle vertex; and after its Section 6, by another object that the first one is mapped to."
    )
    return Exhibit(caption, plates=(plate(drawn, 3, "Originals and targets"),), remarks=(remark,))


def _nothing() -> Picture:
    """White paper."""
    return Picture(np.full((*PART.size[::-1], 3), 255, np.uint8), "none", "nothing to draw")


def figure_10(stock: Stock) -> Exhibit:
    """Feature regions."""
    rows = [(s.name, len(s.regions), len(s.regions.landmarks) - len(s.regions)) for s in stock.four]
    plates = tuple(Plate(regions_picture(s.regions).png, f"Feature regions of the {s.name}, from both sides") for s in stock.four)
    remark = (
        "The paper grows regions without saying from where, or when to stop. Here they start at the ends of limbs, peaks of the mean "
        "distance to "
        "the surface, and end at the pass to the next; a surface without limbs, such as a face, rightly has few or none."
    )
    caption = "Feature regions (step 2), each in its colour; dark spots on their tips and on lesser details."
    return Exhibit(caption, table_of(("object", "regions", "details"), rows), plates, (remark,))


def figure_11(stock: Stock) -> Exhibit:
    """Spherical parameterizations of originals and targets."""
    ends = (*stock.four, stock.small_cat, stock.camel, stock.lion)
    rows = [_sphere_row(subject) for subject in ends]
    heads = ("object", "vertices", "inverted", "degree", "iso mean", "iso max", "angle, mean degrees", "spread of log area")
    plates = tuple(Plate(sphere_picture(end_of(s.sphere)).png, f"{s.name} on the sphere, coloured by distortion") for s in ends)
    inverted = sum(int(str(row[2])) for row in rows)
    remarks = (
        f"Inverted triangles, filled holes included, by exact signs: {inverted} of all; every map covers the sphere once.",
        "The paper minimises the ratio of inverted triangles by a trust region. That ratio is piecewise constant and has no "
        "gradient; and a map "
        "without inverted triangles may still cover the sphere twice, so that the degree is told too.",
    )
    caption = "Each object on the sphere (step 1), coloured by its isometric distortion max(s1, 1/s2), 1 for an isometry."
    return Exhibit(caption, table_of(heads, rows), plates, remarks)


def _sphere_row(subject: Subject) -> tuple[Value, ...]:
    """A line of the table of Figure 11."""
    q = subject.sphere.quality()
    return subject.origin, subject.mesh.n_vertices, q.inverted, q.degree, q.iso_mean, q.iso_max, q.angle_mean_deg, q.area_log_std


def figure_12(stock: Stock) -> Exhibit:
    """x, y and z of original and deformed object."""
    drawn = [(s.name, _coordinates(s)) for s in stock.four]
    caption = "x, y and z of the region's vertices, in the original and in the deformed object, from the handle outwards to the fixed ones."
    remark = (
        "The paper draws these curves over an axis that it does not name. In the order of a file they would show how the file is sorted."
    )
    return Exhibit(caption, plates=(plate(drawn, 2, "Coordinates before and after"),), remarks=(remark,))


def _coordinates(subject: Subject) -> Picture:
    """The curves of one object."""
    order = subject.roi.moving[np.argsort(ratios(subject.roi), kind="stable")]
    return coordinate_picture(subject.mesh.vertices[order], subject.deformed.vertices[order], CURVES)


METHODS: tuple[tuple[str, Method], ...] = (
    ("estimated rotations (the paper's)", EstimatedRotations()),
    ("as rigid as possible (ours)", Arap()),
)
"""How the deformations of Figures 13 to 16 are made."""
JUDGED = ("energy", "volume change %", "edge strain %", "Laplacian error %", "crossing triangles")
"""What is told of a deformed object."""


def judged(rest: Mesh, deformed: Mesh) -> tuple[Value, ...]:
    """The figures of `JUDGED`."""
    return (
        metrics.arap_energy(rest, deformed),
        metrics.volume_change(rest, deformed),
        metrics.edge_strain_rms(rest, deformed),
        metrics.laplacian_error(rest, deformed),
        len(self_intersections(deformed)),
    )


def deformation_of(
    chosen: Callable[[Stock], Subject], matched: Callable[[Stock], CorrespondResult] | None = None
) -> Callable[[Stock], Exhibit]:
    """The figure of an object's deformation (Figures 13 to 16): its edit, and its morph where there is something to become."""

    def figure(stock: Stock) -> Exhibit:
        subject = chosen(stock)
        made = [(name, *clocked(partial(subject.frames_by, method))) for name, method in METHODS]
        strips = [_strip(f"{subject.name}, {name}", frames, parts(subject.roi)) for name, frames, _ in made]
        rest = [("at rest", *judged(subject.mesh, subject.mesh), None)]
        rows = rest + [(name, *judged(subject.mesh, frames[len(frames) - 1]), seconds) for name, frames, seconds in made]
        morphs = list(_morphs(subject, matched(stock))) if matched is not None else []
        caption = f"The {subject.name} ({subject.origin}) in {len(subject.frames)} frames of its edit: red pulls, yellow follows."
        caption += " Below: morphs along the map to another object." if morphs else ""
        heads = ("method", *JUDGED, "seconds, prepared and all frames")
        return Exhibit(caption, table_of(heads, rows), (*strips, *morphs), () if morphs else (ALONE,))

    return figure


ALONE = "No other object of its kind is public: it is deformed by its own handle only."


def _strip(alt: str, frames: MeshSequence, colors: Float[np.ndarray, "n 3"] | None = None) -> Plate:
    """A strip of frames."""
    return Plate(frame_strip(frames, colors=colors).png, alt)


PATHS: tuple[tuple[MorphPath, str], ...] = (
    ("gradient", "faces turn and stretch"),
    ("wavelet", "in the wavelet domain, coarse before fine"),
)
"""The morphs that are shown."""


def _morphs(subject: Subject, matched: CorrespondResult) -> Iterator[Plate]:
    """A morph whose faces turn and stretch, and one in the wavelet domain."""
    for path, what in PATHS:
        frames = morph_along(matched, len(subject.frames), path).frames
        yield _strip(f"{subject.name}, morph: {what}", frames)


figure_13 = deformation_of(lambda stock: stock.horse, lambda stock: stock.horse_to_camel)
figure_14 = deformation_of(lambda stock: stock.cat, lambda stock: stock.cat_to_lion)
figure_15 = deformation_of(lambda stock: stock.face)
figure_16 = deformation_of(lambda stock: stock.bunny)
