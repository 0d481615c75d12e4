"""Verbs of motion: from shape to shape, and from body to body."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, FILM, MENDING, Film, Mending, Output, Pairs
from morphlet.cli.pictures import draw_poses, promise_film, shoot
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from morphlet.motion.morph import MorphPath
    from morphlet.motion.schedule import Schedule
    from morphlet.motion.transfer import Anchor
    from morphlet.pipeline.results import CorrespondResult
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.repair import Repaired
    from morphlet.surface.sequence import MeshSequence

    Travel = tuple[int, MorphPath, Schedule | None, np.ndarray | None]

UNNAMEABLE = r"[^\w .+-]"
"""What a file's name had better not hold, and a morph target's may."""
TURNED = 45.0
"""Degrees from which a target of a transfer is said to stand otherwise than its reference: half of the way to another axis."""


@Parameter(name="*")
@dataclass(frozen=True)
class Stance:
    """What of the target of a transfer stays where it is."""

    pin: Annotated[tuple[int, ...], Parameter(negative=(), show_default=False)] = ()
    """Vertices of the target that keep their places, such as feet; the rest follows smoothly."""
    ground: Literal["x", "y", "z"] | None = None
    """The axis that is up: the lowest vertex keeps its height. Otherwise the middle of the mesh keeps its place."""


FREE = Stance()


def morph(
    a: Path,
    b: Path,
    /,
    *,
    output: Output,
    pairs: Pairs = None,
    frames: int = 24,
    path: Literal["gradient", "linear", "wavelet"] = "gradient",
    schedule: Path | None = None,
    sweep: Annotated[tuple[int, ...], Parameter(negative=(), show_default=False)] = (),
    format: Literal["ply", "obj"] = "ply",
    film: Film = FILM,
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Morph A into B: frames, a contact sheet, a report.

    Without pairs, feature regions are found on both and matched.

    Parameters
    ----------
    a
        Source mesh.
    b
        Target mesh.
    output
        Folder for frame-000.ply ..., morph.glb, contact-sheet.png, report.html, result.json.
    frames
        How many, both ends included.
    path
        How vertices travel: faces turn and stretch (gradient), straight lines (linear), or the coarse shape first and details later
        (wavelet).
    schedule
        TOML file that says when each resolution moves, from coarse to fine, as many as you like: [[band]] start = 0.0, duration = 0.5,
        easing = "smoothstep" (or "linear", "smootherstep"). On the gradient path details turn with the faces that carry them.
    sweep
        Vertices of A from which the morph sweeps over the surface; all of it sets out at once if left out.
    format
        File format of the frames.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            import numpy as np

        run.folder(output)
        promise_film(run, film)
        if frames < 2:
            raise InputError("at least 2 frames, the source and the target", str(frames), "ask for more frames")
        travel = (frames, path, _schedule(schedule, path), np.array(sweep, np.int64) if sweep else None)
        matched = steps.matched(run, (a, b), pairs, mending)
        return write_frames(run, matched, travel, (output, run.place(output)), (a, format), film)

    return execute("morph", steps.present(a, b, pairs, schedule), common, work)


def transfer(
    reference: Path,
    /,
    *pose: Path,
    to: Path,
    output: Output,
    pairs: Pairs = None,
    stance: Stance = FREE,
    film: Film = FILM,
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Give another mesh the poses of a reference.

    The target has to stand as the reference does. With three pairs or more it may have holes, handles and several parts; without pairs
    both must have a spherical map, and feature regions are found and matched.

    Parameters
    ----------
    reference
        Mesh at rest.
    pose
        The same mesh in other poses, vertices and faces in its order: files, folders of files, or a .glb with morph targets.
    to
        The target: the mesh that is to take the poses.
    output
        Folder for a file per pose: its name, with the ending, colours, texture coordinates and materials of the target.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.io.formats import format_by_ending, prepare_rewrite, put, read

        run.folder(output)
        promise_film(run, film)
        _require_poses(pose)
        format_by_ending(to)
        rest, ending = read(reference), to.suffix.lower()
        names, poses = _poses(rest, pose)
        target, solved, figures = _transferred(run, (reference, to), poses, (pairs, mending, stance))
        moved, rendered = steps.as_in_file(target, solved), prepare_rewrite(to, ending)
        run.place(output).mkdir(exist_ok=True)
        for k, name in enumerate(names):
            put(run.place(output) / f"{name}{ending}", rendered(moved[k]))
        draw_poses(run, [[rest, *poses], [target.source, *(moved[k] for k in range(len(moved)))]])
        shoot(run, film, moved)
        return {"poses": len(poses)} | figures

    return execute("transfer", steps.present(reference, *pose, to, pairs), common, work)


def _schedule(path: Path | None, travel: str) -> "Schedule | None":
    """The schedule of a file, for a path that has use for one."""
    from morphlet.motion.schedule import Schedule

    if path is None:
        return None
    if travel == "linear":
        raise InputError("--path wavelet or gradient for a --schedule", "--path linear", "choose such a path, or leave the schedule out")
    return Schedule.read(path)


def write_frames(
    run: Run, matched: "CorrespondResult", travel: "Travel", folder: tuple[Path, Path], template: tuple[Path, str], film: Film
) -> dict[str, Any]:
    """Morph along a correspondence and write everything `morph` promises: for the first folder, into the second."""
    with run.uncounted():
        from morphlet.pipeline.morph import morph_along
        from morphlet.report.story import write_morph

    run.stage("frames")
    result = morph_along(matched, *travel)
    figures = result.figures() | steps.circumstances(matched) | {"path": result.morph.path}
    run.stage("pictures")
    sheet = write_morph(folder[1], result, figures, template)
    if run.common.picture is not None:
        sheet.save(run.place(run.common.picture))
    shoot(run, film, result.frames)
    steps.write_result(run, folder, figures)
    return figures


def _require_poses(files: Sequence[Path]) -> None:
    """Refuse no poses, and such that would be written to one file."""
    stems = [file.stem for file in files]
    if not stems:
        raise InputError("at least one pose", "none", "name the files of the poses after the reference")
    twice = next((stem for stem in stems if stems.count(stem) > 1), None)
    if twice is not None:
        raise InputError("poses with different names", f"{twice} twice", "rename one of the files")


def _poses(rest: "Mesh", paths: Sequence[Path]) -> "tuple[list[str], list[Mesh]]":
    """Names that files may have, and poses of the reference."""
    import re

    import numpy as np

    from morphlet.io.gltf_shapes import unique
    from morphlet.io.sequences import read_poses

    found = read_poses(*paths)
    faces = found.sequence.topology.faces
    if found.sequence.topology.n_vertices != rest.n_vertices or not np.array_equal(faces, rest.faces):
        needed = f"a pose of the reference's {rest.n_vertices} vertices and {rest.n_faces} faces in {paths[0]}"
        told = f"{found.sequence.topology.n_vertices} vertices, {len(faces)} faces" + (
            "" if faces.shape != rest.faces.shape else " of others"
        )
        raise InputError(needed, told, "export the pose with the faces of the reference, in its order")
    return list(unique(re.sub(UNNAMEABLE, "_", name) for name in found.names)), [rest.with_vertices(x) for x in found.sequence.positions]


def _transferred(
    run: Run, ends: tuple[Path, Path], poses: "list[Mesh]", given: tuple[Path | None, Mending, Stance]
) -> "tuple[Repaired, MeshSequence, dict[str, Any]]":
    """The target without seams, in every pose, and what `transfer` tells of it."""
    with run.uncounted():
        import time

        import numpy as np

        from morphlet.motion.face_pairs import FacePairs, pair_faces
        from morphlet.motion.transfer import TransferSolver
        from morphlet.surface.sequence import MeshSequence

    steps.warm(run, "poses")
    pairs, mending, stance = given
    if pairs is None:
        steps.warm(run)
    began = time.perf_counter()
    target = steps.welded(run, ends[1])
    stand = _stand(target, stance)
    surface, laid, used, told = _laid(run, ends, target, (pairs, mending))
    told = (*told, *_standing(run, surface.mesh, laid))
    run.stage("prepare")
    found = pair_faces(laid, target.mesh)
    own = surface.face_map[found.source]
    links = FacePairs(own[own >= 0], found.target[own >= 0])
    solver = TransferSolver.prepare(surface.source, target.mesh, links, _anchor(stance))
    spent = [time.perf_counter() - began]
    run.stage("poses")
    solved = []
    for pose in poses:
        began = time.perf_counter()
        solved.append(stand(solver.solve(pose)).vertices)
        spent.append(time.perf_counter() - began)
    frames = MeshSequence(target.mesh.topology, np.stack(solved), np.arange(len(solved), dtype=float))
    times = {"prepare_seconds": spent[0], "pose_seconds": float(np.median(spent[1:]))}
    mended = {"source": steps.repairs(surface), "target": steps.repairs(target)}
    return target, frames, times | {"pairs": used, "face_pairs": len(links), "warnings": told, "repairs": mended}


def _anchor(stance: Stance) -> "Anchor":
    """Where a pose is put as a whole."""
    import numpy as np

    from morphlet.motion.transfer import Anchor

    return Anchor() if stance.ground is None else Anchor(up=np.eye(3)["xyz".index(stance.ground)])


def _stand(target: "Repaired", stance: Stance) -> "Callable[[Mesh], Mesh]":
    """What puts the pinned vertices of a pose back to where they are at rest; refused before the work if there are no such vertices."""
    import numpy as np

    from morphlet import _arrays
    from morphlet.motion.pins import Pins

    chosen = np.unique(target.vertex_map[_arrays.index(np.array(stance.pin, np.int64), "--pin", (None,), target.source.n_vertices)])
    if not len(chosen):
        return lambda pose: pose
    pins = Pins.prepare(target.mesh, chosen)
    return lambda pose: pins.hold(pose, target.mesh.vertices[chosen])


def _laid(
    run: Run, ends: tuple[Path, Path], target: "Repaired", given: tuple[Path | None, Mending]
) -> "tuple[Repaired, Mesh, int, tuple[str, ...]]":
    """The reference as a surface, laid on the target; how many pairs were used; what is doubtful. By pairs, or through the spheres."""
    pairs, mending = given
    if pairs is None:
        matched = steps.matched(run, ends, None, mending)
        return matched.source_map.surface, matched.carried, len(matched.pairs), matched.warnings
    with run.uncounted():
        from morphlet.motion.registration import register

    surface = steps.welded(run, ends[0])
    kept = steps.answered(pairs, (surface, target))
    run.stage("registration")
    return surface, register(surface.mesh, target.mesh, steps.inside(kept, (surface, target))), len(kept), ()


def _standing(run: Run, reference: "Mesh", laid: "Mesh") -> tuple[str, ...]:
    """What is to be said, and is, if the target stands turned against the reference: deformations know no other directions than space's."""
    import numpy as np

    from morphlet.numerics.rigid import kabsch

    try:
        before, after = (mesh.vertices - mesh.vertices.mean(axis=0) for mesh in (reference, laid))
        turn = kabsch(before, after, reference.vertex_areas)
    except InputError:  # several rotations fit as well: a ball has no side
        return ()
    degrees = float(np.degrees(np.arccos(np.clip((np.trace(turn) - 1) / 2, -1, 1))))
    if degrees < TURNED:
        return ()
    told = f"the target stands turned by {degrees:.0f} degrees against the reference, which poses do not follow: turn one of them first"
    run.say(f"note: {told}")
    return (told,)
