"""Figure 9: the bunny and the cat deformed by way of a simplified mesh, and directly in the region, side by side and timed."""

from functools import partial

import numpy as np

from morphlet import metrics
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor
from morphlet.mapping.differential import reconstruct
from morphlet.paper.exhibit import Exhibit, table_of
from morphlet.paper.figures import JUDGED, judged
from morphlet.paper.networks import SIX, WAVELETS
from morphlet.paper.plates import PART, Captioned, parts, plate, wide_view
from morphlet.paper.simplified import Detour
from morphlet.paper.stopwatch import clocked, median_seconds
from morphlet.paper.subjects import FEW, Stock, Subject
from morphlet.report.camera import Camera
from morphlet.report.page import Plate, Value
from morphlet.report.render import CLAY, Picture, render
from morphlet.surface.distance import farthest_points
from morphlet.surface.intersections import self_intersections
from morphlet.surface.mesh import Mesh

COARSE, COARSER = 2000, 4
"""Vertices of the simplified bunny, and how many times fewer than before at least; the simplified cat has as many as the paper's."""
FEATURES = 100
"""Vertices spread over the surface whose places the network tells in step 11, beside those of the handle."""
CUT = (0.80, 0.12, 0.12)
"""Colour of triangles that cross others."""

Line = tuple[str, Mesh, float | None, float | None]
"""What was made how, and the seconds of preparing and of a frame."""


def figure_9(stock: Stock) -> Exhibit:
    """Simplify, deform, bind back, against the edit in the region, and against the network."""
    pairs = (stock.bunny, min(COARSE, stock.bunny.mesh.n_vertices // COARSER)), (stock.cat, FEW)
    rows, plates, remarks = list[tuple[Value, ...]](), list[Plate](), list[str]()
    for subject, count in pairs:
        detour, prepared = clocked(partial(Detour.prepare, subject, count))
        lines = [
            (f"(a) simplified to {count} vertices, deformed, bound back", detour.solve(), prepared, median_seconds(detour.solve)),
            *_direct(subject),
        ]
        rows += [_row(subject, line) for line in (("original", subject.mesh, None, None), *lines)]
        plates.append(_plate(subject, detour, lines))
        remarks.append(_verdict(subject, lines))
    heads = ("object", "way", "prepare s", "frame s", "mean distance from the edit frame by frame, %", *JUDGED)
    caption = (
        "(a) Another method: a surface that is detached from a simplified mesh, and bound back to it once that is deformed. (b) "
        "Directly in the "
        "region of interest. Below, step 11 as the text has it: Laplacian coordinates, and the places that the network gives some "
        "vertices. "
        "Triangles that cross others are red."
    )
    return Exhibit(caption, table_of(heads, rows), tuple(plates), (*remarks, _ON_STEP_11))


_ON_STEP_11 = (
    'Step 11 reconstructs the object from differential coordinates "using the MLWNN", without a formula. Read as: keep the Laplacian '
    "coordinates, "
    "and pull the handle and some feature vertices to where the network has them. The coordinates do not turn with the surface, so "
    "details shear."
)


def _direct(subject: Subject) -> list[Line]:
    """The edit in the region, and the reconstruction from the network."""
    editor, prepared = clocked(lambda: RoiEditor.prepare(subject.roi, Arap()))
    frame = median_seconds(lambda: editor.solve(subject.path[-1]))
    network, trained = clocked(lambda: SIX.vertices(subject))
    rebuilt, solved = clocked(lambda: _rebuilt(subject, network))
    return [
        ("(b) directly in the region", editor.solve(subject.path[-1]), prepared, frame),
        (f"step 11, networks of {WAVELETS} wavelets", rebuilt, trained, solved),
    ]


def _rebuilt(subject: Subject, network: np.ndarray) -> Mesh:
    """The object from its Laplacian coordinates and the places that a network gives some vertices (step 11)."""
    surface = subject.sphere.surface
    spread = surface.source_vertices[farthest_points(surface.mesh, FEATURES)[0]]
    chosen = np.union1d(spread, subject.roi.handle)
    return reconstruct(subject.mesh, chosen, network[chosen])


def _row(subject: Subject, line: Line) -> tuple[Value, ...]:
    """A line of the table."""
    name, shape, prepared, frame = line
    apart = metrics.deformation_rate(shape.vertices, subject.deformed.vertices)
    return (subject.name, name, prepared, frame, apart, *judged(subject.mesh, shape))


def _plate(subject: Subject, detour: Detour, lines: list[Line]) -> Plate:
    """At rest, the simplified mesh, and what came of each way."""
    coarse = detour.editor.solve(detour.goals)
    camera = wide_view(subject.mesh, subject.deformed, *(shape for _, shape, _, _ in lines))
    drawn: list[Captioned] = [("original", render(subject.mesh, colors=parts(subject.roi), camera=camera, look=PART))]
    drawn.append(
        (f"the simplified mesh, {coarse.n_vertices} vertices", render(coarse, colors=parts(detour.editor.roi), camera=camera, look=PART))
    )
    drawn += [(name, _with_cuts(shape, camera)) for name, shape, _, _ in lines]
    return plate(drawn, 3, f"The {subject.name} deformed by way of a simplified mesh, and directly")


def _with_cuts(shape: Mesh, camera: Camera) -> Picture:
    """A mesh, its crossing triangles in red."""
    colors = np.tile(CLAY, (shape.n_faces, 1))
    colors[np.unique(self_intersections(shape))] = CUT
    return render(shape, colors=colors, camera=camera, look=PART)


def _verdict(subject: Subject, lines: list[Line]) -> str:
    """What of the paper's claim, less time without simplification, holds."""
    (_, _, slow, slow_frame), (_, _, quick, quick_frame) = lines[0], lines[1]
    prepared, frame = (slow or 0) / (quick or 1), (slow_frame or 0) / (quick_frame or 1)
    return (
        f"{subject.name}: without simplification, preparing takes {prepared:.2g} times less time, and a frame {_less(frame)}. "
        "The paper claims less time without simplifying."
    )


def _less(ratio: float) -> str:
    """A ratio in words."""
    return f"{ratio:.2g} times less" if ratio >= 1 else f"{1 / ratio:.2g} times more"
