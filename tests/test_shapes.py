"""The shapes in the annotations are true: the main job runs with every annotation checked (jaxtyping + beartype).

In a process of its own, since the doors of the package accept lists, which the annotations do not say.
"""

import re
import subprocess
import sys
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src"
UNCHECKED = ("cli", "console", "__main__")
"""The command line reads its own annotations."""

JOB = """
import sys, types
from beartype import BeartypeConf, beartype
from jaxtyping import install_import_hook
checks = types.ModuleType("checks")
checks.typed = beartype(conf=BeartypeConf(is_pep484_tower=True))  # an int is a float, as for type checkers
sys.modules["checks"] = checks
install_import_hook(sys.argv[1].split(","), "checks.typed")

import numpy as np
from morphlet import (
    Arap, Blend, CodecOptions, Direct, DualLaplacian, EstimatedRotations, Guarded, Laplacian, Lattice, MeshSequence, Morph,
    MovingLeastSquares, Multiresolution, Pins, Roi, RoiEditor, Schedule, Shell, SimilarityLaplacian, Tour, decode, encode, measure,
    metrics, pair_faces, self_intersections, sweep, transfer, wavelet_bands,
)
from morphlet.approximation.rows import RowOptions, approximate_by_rows
from morphlet.approximation.surface import approximate
from morphlet.editing.falloff import rate
from morphlet.numerics.unit_sphere import icosphere
from morphlet.pipeline.morph import morph
from morphlet.report.color import place_colors
from morphlet.report.look import Look
from morphlet.report.sheet import contact_sheet
from morphlet.report.story import carried_colors, end_of
from morphlet.sphere.image import spherical_image
from morphlet.sphere.untangle import untangle
from morphlet.surface.description import describe
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.repair import RepairOptions, repair

points, faces = icosphere(3)
bumps = 1 + 0.3 * points[:, [0]] + 0.2 * points[:, [1]] ** 2
source = Mesh(points * bumps, Topology(faces, len(points)))
target = Mesh(points * [1.0, 1.2, 1.6] * bumps, Topology(faces[5:], len(points)))
describe(target)
repair(target, RepairOptions(fill="small"))
for pairs in (None, VertexPairs(np.array([1, 5, 9]), np.array([1, 5, 9]))):
    result = morph(source, target, pairs, frames=3)
    result.figures()
ends = end_of(result.matched.source_map), end_of(result.matched.target_map)
look = Look((60, 40), "matplotlib")
contact_sheet(*ends, result.frames, target_colors=carried_colors(result.matched), look=look)
spherical_image(result.matched.source_map, 9).rmse(result.matched.source_map)
metrics.compare(source, source.with_vertices(2 * source.vertices))
untangle(source)
result.matched.inverse, result.matched.refinement()
mapped = result.matched.source_map
for refinement in ("none", "final", "interleaved"):
    approximate_by_rows(mapped, 9, "latlong", RowOptions(3, refinement=refinement)).figures(mapped)
approximate(mapped, source.vertices, 5).with_residual(source.vertices).figures(mapped)

roi = Roi.within(source, np.arange(6), 0.8)
linear = (Laplacian(), SimilarityLaplacian(), DualLaplacian(), EstimatedRotations())
space = (Direct(), MovingLeastSquares("similarity"), Lattice((4, 4, 4)))
for method in (*space, *linear, Arap(), Arap(smoothing=0.01), Shell(), Guarded(), Multiresolution(Arap())):
    edited = RoiEditor.prepare(roi, method).solve(1.2 * source.vertices[roi.handle])
editor = RoiEditor.prepare(Roi(source, roi.handle, roi.free, np.full(6, 2.0)))
path = np.stack([source.vertices[roi.handle] * (1 + 0.1 * k) for k in range(3)])
editor.sequence(path), editor.with_handle(roi.handle[:3]).solve(source.vertices[roi.handle[:3]])
rate(roi, edited)
metrics.edge_strain_rms(source, edited), metrics.laplacian_error(source, edited), metrics.arap_energy(source, edited)
self_intersections(edited)
for path_name in ("linear", "gradient"):
    Morph(source, edited.vertices, path_name).frames(3)
bands = wavelet_bands(mapped, edited.vertices, 20)
Morph(source, edited.vertices, "wavelet", bands, Schedule.coarse_first(len(bands))).frames(3)
Morph(source, edited.vertices, "gradient", bands, delay=sweep(source, np.arange(2))).frames(3)
transfer(source, edited, source, pair_faces(source, source))
Pins.prepare(source, np.arange(3)).hold(edited, source.vertices[:3])
shapes = MeshSequence(source.topology, np.stack([source.vertices, edited.vertices, 2 * source.vertices]), np.arange(3.0))
Blend(source, shapes.positions)(np.array([0.2, 0.3, 0.5]))
measure(Tour(shapes).frames(2)).rows()
for options in (CodecOptions(), CodecOptions(order="kept", layers=3), CodecOptions("previous", packet_frames=1)):
    decode(encode(shapes, options=options).data)
encode(source)
print("shapes hold")
"""


def checked_modules() -> list[str]:
    """Modules whose annotations can be checked; numba compiles the others."""
    compiled = re.compile(r"@(njit|OUTER|INNER|\w*kernel)\b")
    files = [file for file in SOURCE.rglob("*.py") if not {file.stem, file.parent.name} & set(UNCHECKED)]
    files = [file for file in files if not compiled.search(file.read_text(encoding="utf-8"))]
    return sorted(".".join(file.relative_to(SOURCE).with_suffix("").parts) for file in files if file.stem != "__init__")


def test_main_job_with_every_annotation_checked() -> None:
    run = subprocess.run([sys.executable, "-c", JOB, ",".join(checked_modules())], capture_output=True, text=True, check=False)
    assert run.stdout.strip() == "shapes hold", run.stderr[-3000:]
