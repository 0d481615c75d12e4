"""The verb of editing: a mesh deformed as a file tells."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, FILM, MESHES, Film, Output
from morphlet.cli.pictures import draw_edit, promise_film, shoot
from morphlet.console import Common, Run, execute

if TYPE_CHECKING:
    from morphlet.editing.script import Edit, EditSpec
    from morphlet.numerics.optimize import OnStep
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.repair import Repaired
    from morphlet.surface.sequence import MeshSequence


def deform(mesh: Path, spec: Path, /, *, output: Output, film: Film = FILM, common: Common = DEFAULTS) -> int:
    """Edit a mesh as a TOML file tells: pull a handle, keep anchors, let the rest follow.

    handle = [1, 2, 3] or {center = [x, y, z], radius = "5%"}; anchors = [7, 8] or roi = {radius = "30%", metric = "geodesic"}; translate,
    rotate = {axis, degrees, center}, scale, or targets, or path = [{translate = ...}, ...]; method = "arap", "rotations", "laplacian",
    "biharmonic", "similarity", "dual" (iterations), "direct" (falloff), "mls" ([mls] kind, alpha) or "ffd" ([ffd] lattice, basis); weight
    for a soft handle; for arap also smoothing = 2e-4, volume = true, guard = "self-intersection"; detail = "multiresolution".

    Parameters
    ----------
    mesh
        File to edit. Seams are closed for the edit: vertices at one place move together.
    spec
        TOML file; vertices are numbered as in the mesh file, radii are in mesh units or in percent of the bounding-box diagonal.
    output
        Mesh file that keeps colours, texture coordinates and materials; with a path a folder for frame-000 ... and result.json, whose
        figures are those of the last frame.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.editing.script import read_spec
            from morphlet.io.formats import rewrite
            from morphlet.io.sequences import write_sequence

        promise_film(run, film)
        told = read_spec(spec)
        if told.sequence:
            run.folder(output)
        else:
            run.file(output, *MESHES)
        surface = steps.welded(run, mesh)
        steps.warm(run, "edits")
        edited, figures = _edited(run, surface, told)
        frames = steps.as_in_file(surface, edited)
        if told.sequence:
            ending = mesh.suffix.lower() if mesh.suffix.lower() in MESHES else MESHES[0]
            write_sequence(run.place(output), frames, template=mesh, ending=ending)
            steps.write_result(run, (output, run.place(output)), figures)
        else:
            rewrite(mesh, frames[0], run.place(output))
        shoot(run, film, frames)
        return figures

    return execute("deform", [mesh, spec], common, work)


def _edited(run: Run, surface: "Repaired", told: "EditSpec") -> "tuple[MeshSequence, dict[str, Any]]":
    """The edit of a welded mesh, frame by frame, and what `deform` tells of it; its picture, if one was asked for."""
    with run.uncounted():
        import time
        from dataclasses import replace

        import numpy as np

        from morphlet.editing.editor import RoiEditor
        from morphlet.surface.sequence import MeshSequence

    edit = told.on(surface.mesh, np.where(surface.valid, surface.vertex_map, -1))
    run.stage(f"prepare {edit.name}")
    began = time.perf_counter()
    editor = RoiEditor.prepare(edit.roi, edit.method)
    spent = [time.perf_counter() - began]
    run.stage("frames")
    positions, start = np.repeat(surface.mesh.vertices[None], len(edit.pulls), axis=0), None
    for frame, pull in zip(positions, edit.pulls, strict=True):
        taken = list[Any]()
        began = time.perf_counter()
        start = editor.positions(replace(pull, start=start), _both(taken.append, run.on_step))
        spent.append(time.perf_counter() - began)
        frame[edit.roi.moving] = start
    frames = MeshSequence(surface.mesh.topology, positions, np.arange(len(positions), dtype=float))
    figures = _strain(edit, frames[len(frames) - 1]) | {"iterations": max(len(taken), 1), "frames": len(frames)}
    draw_edit(run, edit, frames)
    times = {"prepare_seconds": spent[0], "frame_seconds": spent[-1], "repairs": steps.repairs(surface)}
    return frames, {"method": edit.name} | figures | times


def _both(first: "OnStep", second: "OnStep") -> "OnStep":
    """Tell two about a step."""

    def tell(step: Any) -> None:
        first(step)
        second(step)

    return tell


def _strain(edit: "Edit", deformed: "Mesh") -> dict[str, Any]:
    """What an edit did to the shape."""
    from dataclasses import asdict

    from morphlet import metrics
    from morphlet.editing.falloff import rate
    from morphlet.surface.intersections import self_intersections

    rest, roi = edit.roi.mesh, edit.roi
    return {
        "energy": metrics.arap_energy(rest, deformed),
        "volume_change": metrics.volume_change(rest, deformed),
        "edge_strain_rms": metrics.edge_strain_rms(rest, deformed),
        "laplacian_error": metrics.laplacian_error(rest, deformed),
        "self_intersections": len(self_intersections(deformed)),
        "deformation_rate": asdict(rate(roi, deformed)) if len(roi.anchors) else None,
        "handle_rms": metrics.rms(deformed.vertices[roi.handle], edit.pulls[-1].targets),
        "handle": len(roi.handle),
        "free": len(roi.free),
        "anchors": len(roi.anchors),
    }
