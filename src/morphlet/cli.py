"""The command line: one verb, one call of the library.

Verbs import what they need when they run, so that `morphlet --help` is instant.
"""

import json
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter, UnknownOptionError

from morphlet import __version__
from morphlet.console import Common, Run, execute, plain, refuse
from morphlet.errors import InputError, MeshError, SolveError

if TYPE_CHECKING:
    import numpy as np

    from morphlet.editing.script import Edit, EditSpec
    from morphlet.features.matching import Matching
    from morphlet.features.regions import RegionOptions, Regions
    from morphlet.io.attributes import Attribute
    from morphlet.mapping.correspondence import Correspondence
    from morphlet.motion.morph import MorphPath
    from morphlet.motion.schedule import Schedule
    from morphlet.numerics.optimize import OnStep
    from morphlet.pipeline import Candidate, CorrespondResult
    from morphlet.report.render import Picture
    from morphlet.sphere.embed import SphereOptions
    from morphlet.sphere.map import SphericalMap
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.pairs import VertexPairs
    from morphlet.surface.repair import Repaired
    from morphlet.surface.sequence import MeshSequence
    from morphlet.wavenet.mothers import Mother

    RowChoices = tuple[
        int | None,
        Literal["octahedral", "latlong"],
        Literal["ols", "omp", "mp"],
        Literal["joint", "separate"],
        int,
        Literal["none", "final", "interleaved"],
    ]
    Ends = tuple[Repaired, Repaired]
    Travel = tuple[int, MorphPath, Schedule | None]
    Approximator = Callable[[SphericalMap, bool], tuple[Any, dict[str, Any]]]

Which = Literal["all", "largest"]
Output = Annotated[Path, Parameter(name=["--output", "-o"])]
Kept = Annotated[Which, Parameter(help="Keep all parts (and refuse a mesh with several), or the one with the largest area.")]
Cuts = Annotated[int, Parameter(help="Cut and cap at most so many handles.")]
Pairs = Annotated[Path | None, Parameter(help="CSV of vertices that belong together: source,target[,weight][,label].")]
DEFAULTS = Common()
MESHES = (".ply", ".obj", ".off", ".stl", ".glb")
"""Endings of mesh files that can be written."""
COLORED = (".ply", ".obj", ".glb")
"""Endings of mesh files that hold colours and texture coordinates."""
HANDLE, FREE = (0.85, 0.30, 0.28), (0.95, 0.75, 0.35)
"""The colours of what is pulled and what follows; what stays is clay."""
TILE, TILES, TILE_COLUMNS = (400, 300), 12, 4
"""Size in pixels of a picture of an edit among others, most of them on a sheet, and in a row."""
DEMO_FRAMES = 24
TURNED = 45.0
"""Degrees from which a target of a transfer is said to stand otherwise than its reference: half of the way to another axis."""
RESULT = "result.json"
NEXT_MOTHER = re.compile(r",(?![^(]*\))")
"""The comma between two mothers, not that within beta2(4,8)."""

app = App(
    name="morphlet",
    version=__version__,
    help="Deform, morph, match, transfer and compress triangle meshes through a common sphere.",
    help_format="plaintext",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and return the exit code."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # names of files need not be text
            stream.reconfigure(errors="backslashreplace")
    try:
        command, bound, _ = app.parse_args(given, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        return refuse(_usage(error), "--json" in given)
    result = command(*bound.args, **bound.kwargs)
    return result if isinstance(result, int) else 0


def _usage(error: CycloptsError) -> str:
    """What was wrong with the arguments, and what there is instead."""
    verb = " ".join(error.command_chain or ())
    hint = f"try morphlet {verb} --help" if verb else "try morphlet --help"
    if verb and isinstance(error, UnknownOptionError):
        options = [argument.names[0] for argument in app[verb].assemble_argument_collection()]
        hint = f"{verb} of this version has {', '.join(name for name in options if name.startswith('--'))}; {hint}"
    text = str(error)
    return f"{text if text.endswith('...') else text.rstrip('.')}; {hint}"


@app.command
def info(mesh: Path, /, *, common: Common = DEFAULTS) -> int:
    """What a mesh is, and what it lacks.

    Parameters
    ----------
    mesh
        OBJ, PLY, OFF, STL or GLB file.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from dataclasses import asdict

            from morphlet.io.formats import read
            from morphlet.surface.description import describe

        shape = read(mesh)
        _draw(run, shape)
        return asdict(describe(shape))

    return execute("info", [mesh], common, work)


@app.command
def repair(
    mesh: Path,
    /,
    *,
    output: Output,
    drop: bool = True,
    weld: bool = True,
    orient: bool = True,
    split: bool = True,
    fill: Literal["none", "small", "all"] = "small",
    component: Kept = "largest",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Mend a mesh: weld seams, orient, split what is not manifold, fill small holes, keep the largest part.

    Parameters
    ----------
    mesh
        File to mend.
    output
        File to write.
    drop
        Drop faces that repeat a vertex, lie back to back, or occur twice.
    weld
        Join vertices of open edges at exactly equal positions.
    orient
        Reverse faces until neighbours agree and closed parts look outwards.
    split
        Part faces that meet only at a vertex or along a non-manifold edge.
    fill
        Which holes to fill; small ones have a rim below 10 % of the bounding-box diagonal.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from dataclasses import asdict

            from morphlet.io.formats import read, write
            from morphlet.surface.description import describe
            from morphlet.surface.repair import RepairOptions
            from morphlet.surface.repair import repair as mend

        run.file(output, *MESHES)
        shape = read(mesh)
        mended = mend(shape, RepairOptions(weld, orient, split, fill, component, cut_handles, drop))
        write(run.place(output), mended.mesh)
        _draw(run, mended.mesh)
        return {"before": asdict(describe(shape)), "after": asdict(describe(mended.mesh)), "repairs": _repairs(mended)}

    return execute("repair", [mesh], common, work)


@app.command
def sphere(
    mesh: Path,
    /,
    *,
    output: Output,
    p: float = 1.0,
    weights: Literal["uniform", "area"] = "uniform",
    balance: float | None = None,
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Map a mesh one-to-one to the unit sphere.

    Parameters
    ----------
    mesh
        One piece of genus 0; holes are filled for the map only.
    output
        .npz file: points, faces.
    p
        Exponent of the distortion, in (0, 1]: smaller gives a lower mean and a longer tail.
    weights
        Whether triangles count the same, or by area.
    balance
        Relax once more, from angles alone (0) to areas alone (1); isometric if left out.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from dataclasses import asdict

            from morphlet.sphere.embed import SphereOptions

        run.file(output, ".npz")
        options = SphereOptions(p, weights, balance)
        mapped = _mapped(run, _closed(run, mesh, (component, cut_handles)), mesh.name, options)
        mapped.save(run.place(output))
        _draw_sphere(run, mapped)
        virtual = mapped.surface.mesh.n_vertices - mapped.surface.n_real_vertices
        how = {
            "iterations": mapped.trace.iterations,
            "attempt": mapped.trace.attempt,
            "virtual_vertices": virtual,
            "repairs": _repairs(mapped.surface),
        }
        return asdict(mapped.quality()) | how

    return execute("sphere", [mesh], common, work)


@app.command
def image(
    mesh: Path,
    /,
    *,
    output: Output,
    size: int = 128,
    layout: Literal["octahedral", "latlong"] = "octahedral",
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Sample a mesh into a spherical geometry image.

    Parameters
    ----------
    mesh
        A mesh that has a spherical map.
    output
        .png (a picture) or .npz (exact positions and mask).
    size
        Number of rows.
    layout
        How the sphere is unfolded: onto a square, or by latitude and longitude (twice as many columns as rows).
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.sphere.image import SMALLEST, spherical_image

        run.file(output, ".png", ".npz")
        if size < SMALLEST:
            raise InputError(f"a size of {SMALLEST} or more", str(size), "ask for more rows")
        mapped = _mapped(run, _closed(run, mesh, (component, cut_handles)), mesh.name)
        sampled = spherical_image(mapped, size, layout)
        keep = sampled.write_png if output.suffix.lower() == ".png" else sampled.save
        keep(run.place(output))
        _draw(run, sampled.to_mesh())
        return {"size": size, "rmse": sampled.rmse(mapped), "repairs": _repairs(mapped.surface)}

    return execute("image", [mesh], common, work)


@app.command
def approximate(
    mesh: Path,
    /,
    *,
    output: Output,
    wavelets: int | None = None,
    error: str | None = None,
    size: int | None = None,
    layout: Literal["octahedral", "latlong"] = "octahedral",
    mothers: str | None = None,
    method: Literal["ols", "omp", "mp"] = "ols",
    coordinates: Literal["joint", "separate"] = "joint",
    block_rows: int = 1,
    refinement: Literal["none", "final", "interleaved"] = "none",
    residual: Annotated[bool, Parameter(negative=())] = False,
    over: Literal["rows", "sphere"] = "rows",
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Approximate a mesh by wavelet networks, block by block; reconstruct brings it back.

    Parameters
    ----------
    mesh
        A mesh that has a spherical map.
    output
        .npz file: the matrix IC of all networks, and the directions and faces of the mesh.
    wavelets
        Most of each block: 15 if left out, or with an error as many as it takes (up to 128). Over the sphere, of the whole: 500.
    error
        What every block has to meet, rms: a distance in mesh units, or like 0.1% of the bounding-box diagonal.
    size
        Number of rows of the geometry image; 129 if left out.
    layout
        How the sphere is unfolded: onto a square, or by latitude and longitude (twice as many columns as rows).
    mothers
        Mother wavelets, comma between (an unknown name lists them): the paper's six if left out, or beta2,beta1 over the sphere.
    method
        Rule by which wavelets are chosen: orthogonal least squares, or a matching pursuit.
    coordinates
        Whether x, y and z share their wavelets.
    block_rows
        Rows of the image in a block.
    refinement
        Whether wavelets move to where they fit best: not at all, once all are chosen, or after each choice (10 to 100 times slower).
    residual
        Store what the networks miss too: the mesh comes back exactly.
    over
        Networks over the rows of the geometry image, as in the paper, or one network over the whole sphere.
    """

    def work(run: Run) -> dict[str, Any]:
        run.file(output, ".npz")
        rows = (size, layout, method, coordinates, block_rows, refinement)
        how = _over_sphere(wavelets, error, mothers, rows) if over == "sphere" else _over_rows(wavelets, error, mothers, rows)
        mapped = _mapped(run, _closed(run, mesh, (component, cut_handles)), mesh.name)
        run.stage("networks")
        found, figures = how(mapped, residual)
        found.save(run.place(output))
        _draw_beside(run, mapped.mesh, found.mesh())
        return figures | {"over": over, "bytes": run.place(output).stat().st_size, "repairs": _repairs(mapped.surface)}

    return execute("approximate", [mesh], common, work)


@app.command
def reconstruct(ic: Path, /, *, output: Output, common: Common = DEFAULTS) -> int:
    """Bring a mesh back from the file that approximate wrote, and from nothing else.

    Parameters
    ----------
    ic
        .npz file that approximate wrote.
    output
        Mesh file, with the vertices in the order and the faces of the mesh that was approximated.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.approximation.stored import load
            from morphlet.io.formats import write

        run.file(output, *MESHES)
        found = load(ic)
        shape = found.mesh()
        write(run.place(output), shape)
        _draw(run, shape)
        counts = found.counts()
        return {
            "vertices": shape.n_vertices,
            "faces": shape.n_faces,
            "wavelets": sum(counts.values()),
            "blocks": found.blocks,
            "counts": counts,
        }

    return execute("reconstruct", [ic], common, work)


@app.command
def regions(
    mesh: Path,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    never: float | None = None,
    always: float | None = None,
    most: int | None = None,
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Find the feature regions of a mesh: its limbs, each grown from its tip.

    Lengths are told over the square root of the area of the closed surface, areas as shares of it.

    Parameters
    ----------
    mesh
        One piece of genus 0; holes are filled for the search only.
    output
        .npz file: labels (the region of each vertex, -1 outside), nodes and edges of their graph.
    never
        Persistence below which no peak is a tip; 0.025 if left out.
    always
        Persistence above which each peak is a tip; 0.16 if left out. In between the widest gap decides.
    most
        How many tips are kept, the most persistent ones; 10 if left out.
    """

    def work(run: Run) -> dict[str, Any]:
        if output is not None:
            run.file(output, ".npz")
        options = _region_options(never, always, most)
        surface = _closed(run, mesh, (component, cut_handles))
        found = _regions(run, surface, mesh, options)
        if output is not None:
            _save_regions(run.place(output), found, surface)
        if common.picture is not None:
            with run.uncounted():
                from morphlet.report.features import regions_picture

            regions_picture(found).save(run.place(common.picture))
        return _limbs(found, surface) | {"repairs": _repairs(surface)}

    return execute("regions", [mesh], common, work)


@app.command
def match(
    a: Path,
    b: Path,
    /,
    *,
    output: Output,
    pairs: Pairs = None,
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Pair the feature regions of A with those of B, and say how far that can be trusted.

    Pairs that are given stay, and decide about the tips near them.

    Parameters
    ----------
    a
        Source mesh.
    b
        Target mesh.
    output
        CSV file for correspond and morph: the given pairs, tips and details of paired regions, and the core.
    """

    def work(run: Run) -> dict[str, Any]:
        run.file(output, ".csv")
        with run.uncounted():
            from morphlet.io.pairs import write_pairs
            from morphlet.pipeline import trust

        ends = _closed(run, a, (component, cut_handles)), _closed(run, b, (component, cut_handles))
        given = _given(pairs, ends)
        found_a, found_b = (_regions(run, end, path) for end, path in zip(ends, (a, b), strict=True))
        found, tried, told = _settled(run, (found_a, found_b), _inside(given, ends), ends, (a.name, b.name))
        margin, ambiguous = trust(found, tried)
        for warning in told:
            run.say(f"{'AMBIGUOUS' if ambiguous else 'note'}: {warning}")
        write_pairs(run.place(output), _outside(found, given, ends))
        if common.picture is not None:
            with run.uncounted():
                from morphlet.report.features import matching_picture

            matching_picture(found_a, found_b, found).save(run.place(common.picture))
        sure = {"margin": margin, "ambiguous": ambiguous, "warnings": told}
        return _trust(found) | sure | {"repairs": {"source": _repairs(ends[0]), "target": _repairs(ends[1])}}

    return execute("match", _inputs(a, b, pairs), common, work)


@app.command
def correspond(
    a: Path,
    b: Path,
    /,
    *,
    output: Output,
    pairs: Pairs = None,
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Find where each vertex of A lies on B.

    Parameters
    ----------
    a
        Source mesh.
    b
        Target mesh.
    output
        .npz file: a face of B and weights for each vertex of A.
    """

    def work(run: Run) -> dict[str, Any]:
        run.file(output, ".npz")
        matched = _matched(run, (a, b), pairs, (component, cut_handles))
        matched.correspondence.save(run.place(output))
        if common.picture is not None:
            with run.uncounted():
                from morphlet.report.story import correspondence_picture

            correspondence_picture(matched).save(run.place(common.picture))
        return _found(matched)

    return execute("correspond", _inputs(a, b, pairs), common, work)


@app.command
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
    format: Literal["ply", "obj"] = "ply",
    component: Kept = "all",
    cut_handles: Cuts = 0,
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
        TOML file for --path wavelet that says when each resolution moves, from coarse to fine, as many as you like:
        [[band]] start = 0.0, duration = 0.5, easing = "smoothstep" (or "linear", "smootherstep").
    format
        File format of the frames.
    """

    def work(run: Run) -> dict[str, Any]:
        run.folder(output)
        if frames < 2:
            raise InputError("at least 2 frames, the source and the target", str(frames), "ask for more frames")
        travel = (frames, path, _schedule(schedule, path))
        matched = _matched(run, (a, b), pairs, (component, cut_handles))
        return _tell(run, matched, travel, (output, run.place(output)), (a, format))

    return execute("morph", [*_inputs(a, b, pairs), *([] if schedule is None else [schedule])], common, work)


@app.command
def deform(mesh: Path, spec: Path, /, *, output: Output, common: Common = DEFAULTS) -> int:
    """Edit a mesh as a TOML file tells: pull a handle, keep anchors, let the rest follow.

    handle = [1, 2, 3] or {center = [x, y, z], radius = "5%"}; anchors = [7, 8] or roi = {radius = "30%", metric = "geodesic"}; translate,
    rotate = {axis, degrees, center}, scale, or targets, or path = [{translate = ...}, ...]; method = "arap", "rotations", "laplacian",
    "biharmonic", "direct" (falloff), "mls" ([mls] kind, alpha) or "ffd" ([ffd] lattice, basis); weight for a soft handle; for arap also
    smoothing = 2e-4, volume = true, guard = "self-intersection"; detail = "multiresolution".

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

        told = read_spec(spec)
        if told.sequence:
            run.folder(output)
        else:
            run.file(output, *MESHES)
        surface = _welded(run, mesh)
        _warm_edits(run)
        edited, figures = _edited(run, surface, told)
        frames = _as_in_file(surface, edited)
        if told.sequence:
            ending = mesh.suffix.lower() if mesh.suffix.lower() in MESHES else MESHES[0]
            made = write_sequence(run.place(output), frames, template=mesh, ending=ending)
            outputs = [*(output / file.name for file in made), output / RESULT]
            text = json.dumps(plain(run.head(outputs) | figures), indent=1)
            (run.place(output) / RESULT).write_text(text, encoding="utf-8")
        else:
            rewrite(mesh, frames[0], run.place(output))
        return figures

    return execute("deform", [mesh, spec], common, work)


@app.command
def transfer(
    reference: Path,
    /,
    *pose: Path,
    to: Path,
    output: Output,
    pairs: Pairs = None,
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
        Files of the same mesh in other poses: vertices and faces in its order. One or more.
    to
        The target: the mesh that is to take the poses.
    output
        Folder for a file per pose: its name, with the ending, colours, texture coordinates and materials of the target.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.io.formats import format_by_ending, prepare_rewrite, put, read

        run.folder(output)
        _require_poses(pose)
        format_by_ending(to)
        rest, ending = read(reference), to.suffix.lower()
        poses = [_pose(rest, file) for file in pose]
        target, solved, figures = _transferred(run, (reference, to), poses, pairs)
        moved, rendered = _as_in_file(target, solved), prepare_rewrite(to, ending)
        run.place(output).mkdir(exist_ok=True)
        for k, file in enumerate(pose):
            put(run.place(output) / f"{file.stem}{ending}", rendered(moved[k]))
        _draw_rows(run, [[rest, *poses], [target.source, *(moved[k] for k in range(len(moved)))]])
        return {"poses": len(poses)} | figures

    return execute("transfer", [reference, *pose, to, *([] if pairs is None else [pairs])], common, work)


@app.command
def carry(
    a: Path,
    b: Path,
    map: Path,
    /,
    *,
    attribute: Annotated[tuple[str, ...], Parameter(consume_multiple=True, negative=())],
    output: Output,
    common: Common = DEFAULTS,
) -> int:
    """Carry colours, texture coordinates, labels or weights of B onto A, through a map that correspond wrote.

    Real numbers are interpolated; labels (whole numbers, truth values, texts) come from the nearest corner.

    Each vertex of A gets the coordinates of the side of a texture's seam it falls on: triangles across a seam are smeared.

    Parameters
    ----------
    a
        The mesh that receives: the source of the map.
    b
        The mesh that gives: the target of the map.
    map
        .npz file that correspond wrote for A and B.
    attribute
        color, uv, or a file with a row per vertex of B: .npy, .npz or .csv (FILE:NAME takes one of its arrays or columns). One or more.
    output
        .ply, .obj or .glb: A with colours and texture coordinates, its own where none are carried; .npz or .csv: a row per vertex of A.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            import numpy as np

            from morphlet.io.formats import read
            from morphlet.mapping.correspondence import Correspondence

        run.file(output, *COLORED, ".npz", ".csv")
        _require_carriable(attribute, output)
        source, target = read(a), read(b)
        found = Correspondence.load(map, source, target)
        chosen = _attributes(attribute, b, target)
        carried = {one.name: one.at(found.points) for one in chosen}
        if "color" in attribute:
            carried["color"] = np.clip(np.round(carried["color"]), 0, 255).astype(np.uint8)
        _write_carried(run.place(output), a, found, carried)
        _draw_carried(run, (target, source), chosen[0], carried[chosen[0].name])
        told = [{"name": one.name, "kind": one.kind, "rows": len(carried[one.name]), "columns": one.columns} for one in chosen]
        return {"attributes": told, "unanswered": int(np.sum(~np.asarray(found.valid)))}

    return execute("carry", [a, b, map, *_files(attribute)], common, work)


@app.command
def compare(a: Path, b: Path, /, *, common: Common = DEFAULTS) -> int:
    """Measure how far two meshes are apart.

    Parameters
    ----------
    a
        The mesh to compare with.
    b
        The mesh to measure; with the same faces they are compared vertex by vertex.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet import metrics
            from morphlet.io.formats import read

        first, second = read(a), read(b)
        _draw(run, second)
        return dict(metrics.compare(first, second))

    return execute("compare", [a, b], common, work)


@app.command
def sample(name: str, /, *, output: Output, vertices: int | None = None, common: Common = DEFAULTS) -> int:
    """Write a procedural mesh.

    Parameters
    ----------
    name
        grazer, predator, blob (another one for each seed), spiky, ... (an unknown name lists them).
    output
        Mesh file.
    vertices
        How many.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.io.formats import write
            from morphlet.samples import creatures

        run.file(output, *MESHES)
        count = creatures.DEFAULT_VERTICES if vertices is None else vertices
        made = creatures.blob(common.seed, n_vertices=count) if name == "blob" else creatures.sample(name, n_vertices=count)
        write(run.place(output), made)
        _draw(run, made)
        return {"vertices": made.n_vertices, "faces": made.n_faces}

    return execute("sample", [name], common, work)


@app.command
def fetch(
    name: str,
    /,
    *,
    output: Annotated[Path | None, Parameter(name=["--output", "-o"])] = None,
    mirror: Path | None = None,
    common: Common = DEFAULTS,
) -> int:
    """Download a public mesh, its checksum verified.

    Parameters
    ----------
    name
        Name in the catalogue (an unknown name lists close ones).
    output
        Copy it here; otherwise its place in the cache is printed.
    mirror
        A folder that holds the files; used instead of the network.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.io.formats import read
            from morphlet.samples import catalogue

        if output is not None:
            run.file(output)
        found = catalogue.fetch(name, mirror=mirror)
        if output is not None:
            run.place(output).write_bytes(found.read_bytes())
        else:
            run.outputs.append(found)
        if common.picture is not None:
            _draw(run, read(found))
        entry = catalogue.CATALOGUE[name]
        return {"path": str(output or found), "sha256": entry.sha256, "licence": entry.licence}

    return execute("fetch", [name], common, work)


@app.command
def demo(*, output: Output = Path("morphlet-demo"), vertices: int | None = None, common: Common = DEFAULTS) -> int:
    """The main job on procedural creatures: a grazer becomes a predator.

    Parameters
    ----------
    output
        Folder for meshes, markers, frames, contact sheet and report.
    vertices
        Of each creature.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.demo import true_error, write_inputs
            from morphlet.samples import creatures

        run.folder(output)
        _warm(run)
        meshes, morphed = run.place(output) / "meshes", run.place(output) / "morph"
        meshes.mkdir()
        morphed.mkdir()
        run.stage("creatures")
        a, b, pairs = write_inputs(meshes, creatures.DEFAULT_VERTICES if vertices is None else vertices)
        matched = _matched(run, (a, b), pairs, ("all", 0))
        run.say(f"mean distance to the known true places: {true_error(matched):.1f} % of sqrt(area)")
        found = _tell(run, matched, (DEMO_FRAMES, "gradient", None), (output / "morph", morphed), (a, "ply"))
        run.say(f"\nLook at  {output / 'morph' / 'contact-sheet.png'}\nand open {output / 'morph' / 'report.html'}")
        return found

    return execute("demo", [], common, work)


@app.command
def warmup(*, common: Common = DEFAULTS) -> int:
    """Compile the kernels, so that the next run starts at once."""

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.warm import compile_edits, compile_kernels, compiled

        if common.picture is not None:
            raise InputError("no --picture for warmup", "one", "leave it out: there is nothing to draw")
        before = compiled() and compiled("edits")
        run.stage("compiling kernels")
        compile_kernels()
        compile_edits()
        return {"compiled_before": before}

    return execute("warmup", [], common, work)


def _warm(run: Run) -> None:
    """Compile the kernels if this is the first run, and say so."""
    with run.uncounted():
        from morphlet.warm import compile_kernels, compiled

        if not compiled():
            run.say("compiling the kernels: once, about 40 seconds on two cores; later runs start at once")
            run.stage("compiling kernels")
            compile_kernels()


def _inputs(a: Path, b: Path, pairs: Path | None) -> list[Path | str]:
    return [a, b] if pairs is None else [a, b, pairs]


def _repairs(mended: "Repaired") -> list[dict[str, Any]]:
    return [{"what": done.what, "count": done.count} for done in mended.repairs]


def _closed(run: Run, path: Path, mending: tuple[Which, int]) -> "Repaired":
    """A mesh file as a surface that has a spherical map, what was mended said aloud; errors name the file."""
    with run.uncounted():
        from morphlet.io.formats import read
        from morphlet.surface.repair import RepairOptions, close

    shape = read(path)
    try:
        surface = close(shape, RepairOptions(fill="all", component=mending[0], cut_handles=mending[1]))
    except MeshError as error:
        raise MeshError(f"{error.needed} in {path}", error.found, error.advice, error.elements) from error
    for done in surface.repairs:
        run.say(f"{path.name}: {done.what} ({done.count})")
    return surface


def _mapped(run: Run, surface: "Repaired", name: str, options: "SphereOptions | None" = None) -> "SphericalMap":
    """The spherical map of a surface; `name` is what the progress bar calls it."""
    with run.uncounted():
        from morphlet.sphere.map import map_surface

    _warm(run)
    run.stage(f"sphere of {name}")
    return map_surface(surface, options, run.on_step)


def _matched(run: Run, ends: tuple[Path, Path], pairs: Path | None, mending: tuple[Which, int]) -> "CorrespondResult":
    """Read, map, match, align, lay one into the other's sphere."""
    with run.uncounted():
        from morphlet.io.pairs import read_pairs
        from morphlet.pipeline import correspond_maps

    source, target = _closed(run, ends[0], mending), _closed(run, ends[1], mending)
    given = None if pairs is None else read_pairs(pairs).checked(source.source, target.source).answered(source.valid, target.valid)
    if given is not None and not len(given):
        raise InputError(f"pairs in {pairs}", "a header without any", "add pairs, or leave --pairs out to have regions matched")
    maps = _mapped(run, source, ends[0].name), _mapped(run, target, ends[1].name)
    run.stage("regions, alignment, dense map")
    matched = correspond_maps(*maps, given, run.on_step)
    kept = 0 if given is None else len(given)
    told = f"{kept} given, {len(matched.pairs) - kept} from matched regions"
    run.say(f"pairs: {told}" if len(matched.pairs) else "no pairs: the spheres were turned by a search")
    for warning in matched.warnings:
        run.say(f"{'AMBIGUOUS' if matched.ambiguous else 'note'}: {warning}")
    return matched


def _region_options(never: float | None, always: float | None, most: int | None) -> "RegionOptions":
    """What is left out stays at its default."""
    from morphlet.features.regions import RegionOptions

    plain_rule = RegionOptions()
    least, sure = plain_rule.never if never is None else never, plain_rule.always if always is None else always
    return RegionOptions(least, sure, plain_rule.most if most is None else most)


def _regions(run: Run, surface: "Repaired", path: Path, options: "RegionOptions | None" = None) -> "Regions":
    """The feature regions of a closed surface; errors name the file."""
    with run.uncounted():
        from morphlet.features.regions import find_regions

    _warm(run)
    run.stage(f"regions of {path.name}")
    try:
        return find_regions(surface.mesh, options)
    except MeshError as error:
        raise MeshError(f"{error.needed} in {path}", error.found, error.advice) from error


def _limbs(found: "Regions", surface: "Repaired") -> dict[str, Any]:
    """What `regions` tells, in vertices of the file."""
    import numpy as np

    back, k = surface.source_vertices, len(found)
    counts = np.bincount(found.nodes[surface.vertex_map][surface.valid], minlength=k)[:k]
    rows = zip(back[found.tips], found.persistence, found.areas, counts, strict=True)
    return {
        "regions": [{"tip": tip, "persistence": stands, "area": area, "vertices": count} for tip, stands, area, count in rows],
        "core": back[found.core],
        "gap": found.gap,
        "core_node": found.core_node,
        "edges": found.edges,
        "details": back[found.landmarks[k:]],
        "persistence": found.peaks.persistence[: len(found.landmarks)],
    }


def _save_regions(path: Path, found: "Regions", surface: "Repaired") -> None:
    """A label per vertex of the file, and the graph of the regions."""
    import numpy as np

    from morphlet import _store

    nodes, back = found.nodes[surface.vertex_map], surface.source_vertices
    arrays = {
        "labels": np.where(nodes < len(found), nodes, -1), "nodes": nodes, "edges": found.edges, "tips": back[found.tips],
        "persistence": found.persistence, "areas": found.areas, "core": back[found.core],
        "valid": surface.valid, "fingerprint": np.array(surface.source.fingerprint),
    }  # fmt: skip
    _store.save(path, "regions", 1, arrays)


def _given(pairs: Path | None, ends: "Ends") -> "VertexPairs | None":
    """The pairs of a file, once it is certain that they name vertices of both files, each place once."""
    import numpy as np

    from morphlet.io.pairs import read_pairs

    if pairs is None:
        return None
    given = read_pairs(pairs).checked(ends[0].source, ends[1].source).answered(ends[0].valid, ends[1].valid)
    if not len(given):
        raise InputError(f"pairs in {pairs}", "a header without any", "add pairs, or leave --pairs out")
    for name, surface, vertices in zip(("source", "target"), ends, (given.source, given.target), strict=True):
        _, place, counts = np.unique(surface.vertex_map[vertices], return_inverse=True, return_counts=True)
        again = vertices[counts[place] > 1]
        if len(again):
            found = f"{len(again)} pairs at {name} vertices, or joined ones, of others"
            raise InputError(f"pairs in {pairs} that name each place once", found, "keep one pair of each", again)
    return given


def _inside(given: "VertexPairs | None", ends: "Ends") -> "VertexPairs | None":
    """Pairs of the files' vertices as pairs of the closed surfaces'."""
    from morphlet.surface.pairs import VertexPairs

    if given is None:
        return None
    return VertexPairs(ends[0].vertex_map[given.source], ends[1].vertex_map[given.target], given.weight, given.labels)


def _outside(found: "Matching", given: "VertexPairs | None", ends: "Ends") -> "VertexPairs":
    """What was matched as pairs of the files' vertices, those that were given as they were."""
    import numpy as np

    from morphlet.surface.pairs import VertexPairs

    pairs, kept = found.pairs, 0 if given is None else len(given)
    source, target = ends[0].source_vertices[pairs.source], ends[1].source_vertices[pairs.target]
    if given is not None:
        source, target = np.concatenate([given.source, source[kept:]]), np.concatenate([given.target, target[kept:]])
    labels = (*pairs.labels[:kept], *(label.replace(" ", "-") for label in pairs.labels[kept:]))
    return VertexPairs(source, target, pairs.weight, labels)


def _settled(
    run: Run, regions: "tuple[Regions, Regions]", given: "VertexPairs | None", ends: "Ends", names: tuple[str, str]
) -> "tuple[Matching, tuple[Candidate, ...], tuple[str, ...]]":
    """Regions matched, what was tried, what is doubtful; spheres are made only where several matchings are nearly as good."""
    with run.uncounted():
        from morphlet.features.matching import candidates
        from morphlet.pipeline import settled

    run.stage("matching")
    found = candidates(*regions, given)
    if len(found) == 1:
        return found[0], (), found[0].warnings
    maps = [_mapped(run, end, name) for end, name in zip(ends, names, strict=True)]
    run.stage("coarse maps")
    return settled(maps[0], maps[1], found, run.on_step)


def _trust(found: "Matching") -> dict[str, Any]:
    """What `match` tells of a matching as such."""
    figures = {"pairs": len(found.pairs)} | {name: getattr(found, name) for name in ("cost", "runner_up", "reflected")}
    return figures | {"tips": found.n_tips, "regions": found.regions}


def _files(words: Sequence[str]) -> list[Path | str]:
    """The files among the attributes that are to be carried."""
    from morphlet.io.attributes import IN_FILE

    return list(dict.fromkeys(Path(named["path"]) for word in words if (named := IN_FILE.fullmatch(word))))


def _require_carriable(words: Sequence[str], output: Path) -> None:
    """Refuse what cannot be carried, or not into such a file, before anything is read."""
    from morphlet.io.attributes import OWN, parted

    files = [word for word in words if word not in OWN and parted(word)]
    if files and output.suffix.lower() in COLORED:
        raise InputError("an output ending in .npz or .csv for values of files", str(output), "mesh files hold color and uv")
    if len(set(words)) < len(words):
        raise InputError("different attributes", ", ".join(words), "name each once")


def _attributes(words: Sequence[str], path: Path, mesh: "Mesh") -> "list[Attribute]":
    """What is to be carried: of the mesh file, or of files beside it; each under a name of its own."""
    from morphlet.io.attributes import OWN, Attribute, listed, read_columns, read_own

    own, chosen = read_own(path, mesh), list[Attribute]()
    for word in words:
        if word in OWN and word not in own:
            raise InputError(
                f"attributes that {path} has ({listed(own)})", f"'{word}'", "name one of these, or a file with a row per vertex"
            )
        chosen += [own[word]] if word in OWN else read_columns(word, mesh)
    names = [one.name for one in chosen]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError("attributes with different names", f"'{twice[0]}' twice", "take one, as in FILE:NAME, or rename it")
    return chosen


def _write_carried(path: Path, a: Path, found: "Correspondence", carried: "dict[str, np.ndarray]") -> None:
    """A with what was carried, or a row per vertex of A."""
    import numpy as np

    from morphlet.io.attributes import save_arrays, write_table
    from morphlet.io.content import Attributes
    from morphlet.io.formats import format_by_ending, put, read_attributes

    if path.suffix.lower() in COLORED:
        own = read_attributes(a)
        both = Attributes(carried.get("color", own.colors), carried.get("uv", own.uv))
        put(path, format_by_ending(path).render(found.source, both))
    elif path.suffix.lower() == ".csv":
        write_table(path, carried)
    else:
        save_arrays(path, found.source, carried, np.asarray(found.valid))


def _draw_carried(run: Run, ends: "tuple[Mesh, Mesh]", attribute: "Attribute", carried: "np.ndarray") -> None:
    """The picture of B and A in the colours of an attribute, if one was asked for."""
    if run.common.picture is None:
        return
    with run.uncounted():
        from dataclasses import replace

        import numpy as np

        from morphlet.report.render import render

    row = np.zeros(ends[0].n_vertices, np.int64)
    row[ends[0].faces] = attribute.rows
    shades = _shades(attribute.name, np.concatenate([attribute.values[row], carried]))
    parts = np.split(shades, [len(row)])
    left, right = (render(mesh, colors=colors) for mesh, colors in zip(ends, parts, strict=True))
    replace(left, pixels=np.hstack([left.pixels, right.pixels])).save(run.place(run.common.picture))


def _shades(name: str, values: "np.ndarray") -> "np.ndarray":
    """A colour per row: itself, one per label, along a scale, or red and green along two columns, and blue along a third."""
    import numpy as np

    from morphlet.io.content import COLOR_MAX
    from morphlet.report.color import ColorScale, place_colors
    from morphlet.report.features import HUES

    table = values.reshape(len(values), -1)
    if name == "color":
        return values / COLOR_MAX
    if values.dtype.kind != "f":
        return np.array(HUES)[np.unique(table, axis=0, return_inverse=True)[1].ravel() % len(HUES)]
    if table.shape[1] == 1:
        return ColorScale.of(table[:, 0])(table[:, 0])
    return place_colors(np.pad(table, ((0, 0), (0, 3)))[:, :3])


def _over_rows(wavelets: int | None, error: str | None, mothers: str | None, rows: "RowChoices") -> "Approximator":
    """Networks over the rows of the geometry image; what cannot be is refused before the work."""
    from dataclasses import replace

    from morphlet.approximation.quality import diagonal
    from morphlet.approximation.rows import ENOUGH, SIZE, RowOptions, approximate_by_rows, rows_of_blocks
    from morphlet.sphere.image import directions

    size, layout, method, coordinates, block_rows, refinement = rows
    height, plain_rule = SIZE if size is None else size, RowOptions()
    most = wavelets if wavelets is not None else plain_rule.n_wavelets if error is None else ENOUGH
    options = RowOptions(most, _length(error, 1.0), method, _mothers(mothers) or plain_rule.mothers, coordinates, block_rows, refinement)
    directions(layout, height)
    rows_of_blocks(height, block_rows)

    def made(mapped: "SphericalMap", residual: bool) -> tuple[Any, dict[str, Any]]:
        meant = replace(options, error=_length(error, diagonal(mapped)))
        found = approximate_by_rows(mapped, height, layout, meant)
        found = found.with_residual(mapped.mesh) if residual else found
        figures = found.figures(mapped) | {"size": height, "layout": layout}
        _require_met(figures["block_error_max"], meant.error, meant.n_wavelets)
        return found, figures

    return made


def _over_sphere(wavelets: int | None, error: str | None, mothers: str | None, rows: "RowChoices") -> "Approximator":
    """One network over the whole sphere."""
    import numpy as np

    from morphlet.approximation.quality import diagonal
    from morphlet.approximation.surface import DEFAULT, WAVELETS, ApproximationOptions, approximate

    if rows != (None, "octahedral", "ols", "joint", 1, "none"):
        needed = "no --size, --layout, --method, --coordinates, --block-rows or --refinement with --over sphere"
        raise InputError(needed, "one of them", "leave it out: there are no rows, and orthogonal least squares is the rule")
    most, chosen = WAVELETS if wavelets is None else wavelets, _mothers(mothers) or DEFAULT.mothers
    _length(error, 1.0)

    def made(mapped: "SphericalMap", residual: bool) -> tuple[Any, dict[str, Any]]:
        length = _length(error, diagonal(mapped))
        found = approximate(mapped, mapped.mesh.vertices, most, ApproximationOptions(chosen, tolerance=length**2))
        _require_met(float(np.sqrt(found.fit.sse[-1])), length, most)
        found = found.with_residual(mapped.mesh.vertices) if residual else found
        return found, found.figures(mapped)

    return made


def _mothers(names: str | None) -> "tuple[Mother, ...]":
    """Mothers by their names."""
    from morphlet.wavenet.mothers import mother

    return tuple(mother(name.strip()) for name in ([] if names is None else NEXT_MOTHER.split(names)))


def _length(text: str | None, diagonal: float) -> float:
    """A length in mesh units, or in percent of the bounding-box diagonal; 0 if there is none."""
    if text is None:
        return 0.0
    try:
        return float(text.removesuffix("%")) * (diagonal / 100 if text.endswith("%") else 1)
    except ValueError as error:
        raise InputError("a length like 0.01, or 0.1% of the bounding-box diagonal", repr(text), "give a number") from error


def _require_met(worst: float, error: float, wavelets: int) -> None:
    """Refuse networks that miss the error that was demanded."""
    if 0 < error < worst:
        most = f"{worst:.4g} in the worst, with at most {wavelets} wavelets"
        raise SolveError(f"an rms error of {error:.4g} in each block", most, "allow more --wavelets, or a larger --error")


def _found(matched: "CorrespondResult") -> dict[str, Any]:
    """What `correspond` tells."""
    return matched.figures() | _circumstances(matched)


def _circumstances(matched: "CorrespondResult") -> dict[str, Any]:
    """How a map came about."""
    repairs = {"source": _repairs(matched.source_map.surface), "target": _repairs(matched.target_map.surface)}
    return {"alignment": matched.alignment.method, "warnings": list(matched.warnings), "repairs": repairs}


def _schedule(path: Path | None, travel: str) -> "Schedule | None":
    """The schedule of a file, for the only path that has use for one."""
    from morphlet.motion.schedule import Schedule

    if path is None:
        return None
    if travel != "wavelet":
        raise InputError("--path wavelet for a --schedule", f"--path {travel}", "add --path wavelet, or leave the schedule out")
    return Schedule.read(path)


def _tell(run: Run, matched: "CorrespondResult", travel: "Travel", folder: tuple[Path, Path], template: tuple[Path, str]) -> dict[str, Any]:
    """Morph along a correspondence and write everything `morph` promises: for the first folder, into the second."""
    with run.uncounted():
        from morphlet.pipeline import morph_along
        from morphlet.report.story import write_morph

        _compile_frames()
    run.stage("frames")
    result = morph_along(matched, *travel)
    figures = result.figures() | _circumstances(matched) | {"path": result.morph.path}
    run.stage("pictures")
    final, made = folder
    sheet = write_morph(made, result, figures, template)
    if run.common.picture is not None:
        sheet.save(run.place(run.common.picture))
    outputs = [final / name for name in sorted([*(file.name for file in made.iterdir()), RESULT])]
    (made / RESULT).write_text(json.dumps(plain(run.head(outputs) | figures), indent=1), encoding="utf-8")
    return figures


def _compile_frames() -> None:
    """Move a small ball on its way and measure it, so that all kernels are compiled."""
    from morphlet.motion.morph import Morph, self_intersections_max
    from morphlet.numerics.unit_sphere import icosphere
    from morphlet.surface.mesh import Mesh

    ball = Mesh(*icosphere(1))
    self_intersections_max(Morph(ball, 2 * ball.vertices, "gradient").frames(3))


def _welded(run: Run, path: Path) -> "Repaired":
    """A mesh file with its seams closed and its faces turned alike, what was mended said aloud."""
    with run.uncounted():
        from morphlet.io.formats import read
        from morphlet.surface.repair import RepairOptions, repair

    surface = repair(read(path), RepairOptions(split=False))
    for done in surface.repairs:
        run.say(f"{path.name}: {done.what} ({done.count})")
    return surface


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
        steps = list[Any]()
        began = time.perf_counter()
        start = editor.positions(replace(pull, start=start), _both(steps.append, run.on_step))
        spent.append(time.perf_counter() - began)
        frame[edit.roi.moving] = start
    frames = MeshSequence(surface.mesh.topology, positions, np.arange(len(positions), dtype=float))
    figures = _strain(edit, frames[len(frames) - 1]) | {"iterations": max(len(steps), 1), "frames": len(frames)}
    _draw_edit(run, edit, frames)
    times = {"prepare_seconds": spent[0], "frame_seconds": spent[-1], "repairs": _repairs(surface)}
    return frames, {"method": edit.name} | figures | times


def _require_poses(files: Sequence[Path]) -> None:
    """Refuse no poses, and such that would be written to one file."""
    stems = [file.stem for file in files]
    if not stems:
        raise InputError("at least one pose", "none", "name the files of the poses after the reference")
    twice = next((stem for stem in stems if stems.count(stem) > 1), None)
    if twice is not None:
        raise InputError("poses with different names", f"{twice} twice", "rename one of the files")


def _pose(rest: "Mesh", path: Path) -> "Mesh":
    """A pose of the reference; errors name the file."""
    import numpy as np

    from morphlet.io.formats import read

    found = read(path)
    if found.n_vertices != rest.n_vertices or not np.array_equal(found.faces, rest.faces):
        needed = f"a pose of the reference's {rest.n_vertices} vertices and {rest.n_faces} faces in {path}"
        told = f"{found.n_vertices} vertices, {found.n_faces} faces" + ("" if found.faces.shape != rest.faces.shape else " of others")
        raise InputError(needed, told, "export the pose with the faces of the reference, in its order")
    return rest.with_vertices(found.vertices)


def _transferred(
    run: Run, ends: tuple[Path, Path], poses: "list[Mesh]", pairs: Path | None
) -> "tuple[Repaired, MeshSequence, dict[str, Any]]":
    """The target without seams, in every pose, and what `transfer` tells of it."""
    with run.uncounted():
        import time

        import numpy as np

        from morphlet.motion.face_pairs import FacePairs, pair_faces
        from morphlet.motion.transfer import TransferSolver
        from morphlet.surface.sequence import MeshSequence

        _compile_transfer()
    if pairs is None:
        _warm(run)
    began = time.perf_counter()
    target = _welded(run, ends[1])
    surface, laid, used, told = _laid(run, ends, target, pairs)
    told = (*told, *_standing(run, surface.mesh, laid))
    run.stage("prepare")
    found = pair_faces(laid, target.mesh)
    own = surface.face_map[found.source]
    links = FacePairs(own[own >= 0], found.target[own >= 0])
    solver = TransferSolver.prepare(surface.source, target.mesh, links)
    spent = [time.perf_counter() - began]
    run.stage("poses")
    solved = []
    for pose in poses:
        began = time.perf_counter()
        solved.append(solver.solve(pose).vertices)
        spent.append(time.perf_counter() - began)
    frames = MeshSequence(target.mesh.topology, np.stack(solved), np.arange(len(solved), dtype=float))
    times = {"prepare_seconds": spent[0], "pose_seconds": float(np.median(spent[1:]))}
    mended = {"source": _repairs(surface), "target": _repairs(target)}
    return target, frames, times | {"pairs": used, "face_pairs": len(links), "warnings": told, "repairs": mended}


def _laid(run: Run, ends: tuple[Path, Path], target: "Repaired", pairs: Path | None) -> "tuple[Repaired, Mesh, int, tuple[str, ...]]":
    """The reference as a surface, laid on the target; how many pairs were used; what is doubtful. By pairs, or through the spheres."""
    if pairs is None:
        matched = _matched(run, ends, None, ("all", 0))
        return matched.source_map.surface, matched.carried, len(matched.pairs), matched.warnings
    with run.uncounted():
        from morphlet.io.pairs import read_pairs
        from morphlet.motion.registration import register

    surface = _welded(run, ends[0])
    given = read_pairs(pairs).checked(surface.source, target.source).answered(surface.valid, target.valid)
    inside = _inside(given, (surface, target))
    run.stage("registration")
    return surface, register(surface.mesh, target.mesh, given if inside is None else inside), len(given), ()


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


def _compile_transfer() -> None:
    """Give a small ball a pose, so that all kernels are compiled."""
    import numpy as np

    from morphlet.motion.face_pairs import pair_faces
    from morphlet.motion.registration import register
    from morphlet.motion.transfer import transfer as give
    from morphlet.numerics.unit_sphere import icosphere
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.pairs import VertexPairs

    ball, chosen = Mesh(*icosphere(1)), np.arange(4)
    give(ball, ball, ball, pair_faces(register(ball, ball, VertexPairs(chosen, chosen)), ball))


def _both(first: "OnStep", second: "OnStep") -> "OnStep":
    """Tell two about a step."""

    def tell(step: Any) -> None:
        first(step)
        second(step)

    return tell


def _warm_edits(run: Run) -> None:
    """Compile the kernels of editing if this is the first edit, and say so."""
    with run.uncounted():
        from morphlet.warm import compile_edits, compiled

        if not compiled("edits"):
            run.say("compiling the kernels of editing: once, about a quarter of a minute; later edits start at once")
            run.stage("compiling kernels")
            compile_edits()


def _as_in_file(surface: "Repaired", frames: "MeshSequence") -> "MeshSequence":
    """Frames of a welded mesh with the vertices of its file; one in no face moves as the nearest that is in one."""
    import numpy as np

    from morphlet.surface.sequence import MeshSequence

    moved = frames.positions[:, surface.vertex_map]
    carried = surface.source.vertices + (moved - surface.mesh.vertices[surface.vertex_map])
    positions = np.where(surface.valid[:, None], moved, carried)
    return MeshSequence(surface.source.topology, positions, frames.times)


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


def _draw_edit(run: Run, edit: "Edit", frames: "MeshSequence") -> None:
    """The picture of rest and edit, handle, free vertices and anchors in their colours, if one was asked for."""
    if run.common.picture is None:
        return
    with run.uncounted():
        import numpy as np

        from morphlet.report.camera import view
        from morphlet.report.look import Look
        from morphlet.report.render import CLAY, render

    rest, n = edit.roi.mesh, edit.roi.mesh.n_vertices
    colors = np.tile(CLAY, (n, 1))
    colors[edit.roi.free], colors[edit.roi.handle] = FREE, HANDLE
    picked = np.unique(np.linspace(0, len(frames) - 1, min(len(frames), TILES - 1)).round()).astype(int)
    shown = [rest, *(frames[k] for k in picked.tolist())]
    look = Look() if len(shown) == 2 else Look(size=TILE)
    camera = view(rest).framed(_together(shown))
    _tiled([render(shape, colors=colors, camera=camera, look=look) for shape in shown], TILE_COLUMNS).save(run.place(run.common.picture))


def _draw_rows(run: Run, rows: "list[list[Mesh]]") -> None:
    """The picture of rows of meshes above each other, the first of each and others evenly chosen, if one was asked for."""
    if run.common.picture is None:
        return
    with run.uncounted():
        import numpy as np

        from morphlet.report.camera import view
        from morphlet.report.look import Look
        from morphlet.report.render import render

    count = len(rows[0])
    picked = np.unique(np.linspace(0, count - 1, min(count, TILES // 2)).round()).astype(int).tolist()
    seen, tiles = view(rows[0][0]), []
    for row in ([meshes[k] for k in picked] for meshes in rows):
        centred = [shape.with_vertices(shape.vertices - shape.vertices.mean(axis=0)) for shape in row]
        camera = seen.framed(_together(centred))
        tiles += [render(shape, camera=camera, look=Look(size=TILE)) for shape in centred]
    _tiled(tiles, len(picked)).save(run.place(run.common.picture))


def _together(shapes: "Sequence[Mesh]") -> "Mesh":
    """Several meshes of one connectivity as one."""
    import numpy as np

    from morphlet.surface.mesh import Mesh

    faces, n = shapes[0].faces, shapes[0].n_vertices
    return Mesh(np.concatenate([shape.vertices for shape in shapes]), np.concatenate([faces + k * n for k in range(len(shapes))]))


def _tiled(tiles: "Sequence[Picture]", most: int) -> "Picture":
    """Pictures in rows of at most so many, white where the last is not full."""
    from dataclasses import replace

    import numpy as np

    columns = min(len(tiles), most)
    pixels = [tile.pixels for tile in tiles] + [np.full_like(tiles[0].pixels, 255)] * (-len(tiles) % columns)
    rows = [np.hstack(pixels[k : k + columns]) for k in range(0, len(pixels), columns)]
    return replace(tiles[0], pixels=np.vstack(rows))


def _draw(run: Run, shape: "Mesh") -> None:
    """The picture of a mesh, if one was asked for."""
    if run.common.picture is not None:
        with run.uncounted():
            from morphlet.report.render import render

        render(shape).save(run.place(run.common.picture))


def _draw_beside(run: Run, first: "Mesh", second: "Mesh") -> None:
    """The picture of two meshes from one side, if one was asked for."""
    if run.common.picture is not None:
        with run.uncounted():
            from dataclasses import replace

            import numpy as np

            from morphlet.report.camera import view
            from morphlet.report.render import render

        left, right = (render(shape, camera=view(first)) for shape in (first, second))
        replace(left, pixels=np.hstack([left.pixels, right.pixels])).save(run.place(run.common.picture))


def _draw_sphere(run: Run, mapped: "SphericalMap") -> None:
    """The picture of a map, if one was asked for."""
    if run.common.picture is not None:
        with run.uncounted():
            from morphlet.report.sheet import sphere_picture
            from morphlet.report.story import end_of

        sphere_picture(end_of(mapped)).save(run.place(run.common.picture))


if __name__ == "__main__":
    sys.exit(main())
