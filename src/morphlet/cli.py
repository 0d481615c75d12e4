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
    from morphlet.pipeline import CorrespondResult
    from morphlet.sphere.embed import SphereOptions
    from morphlet.sphere.map import SphericalMap
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.repair import Repaired
    from morphlet.wavenet.mothers import Mother

    RowChoices = tuple[
        int | None,
        Literal["octahedral", "latlong"],
        Literal["ols", "omp", "mp"],
        Literal["joint", "separate"],
        int,
        Literal["none", "final", "interleaved"],
    ]
    Approximator = Callable[[SphericalMap, bool], tuple[Any, dict[str, Any]]]

Which = Literal["all", "largest"]
Output = Annotated[Path, Parameter(name=["--output", "-o"])]
Kept = Annotated[Which, Parameter(help="Keep all parts (and refuse a mesh with several), or the one with the largest area.")]
Cuts = Annotated[int, Parameter(help="Cut and cap at most so many handles.")]
Pairs = Annotated[Path | None, Parameter(help="CSV of vertices that belong together: source,target[,weight][,label].")]
DEFAULTS = Common()
MESHES = (".ply", ".obj", ".off", ".stl", ".glb")
"""Endings of mesh files that can be written."""
DEMO_FRAMES = 24
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
    path: Literal["linear"] = "linear",
    format: Literal["ply", "obj"] = "ply",
    component: Kept = "all",
    cut_handles: Cuts = 0,
    common: Common = DEFAULTS,
) -> int:
    """Morph A into B: frames, a contact sheet, a report.

    Without pairs the spheres are turned onto each other by a search.

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
        Trajectory of the vertices.
    format
        File format of the frames.
    """

    def work(run: Run) -> dict[str, Any]:
        run.folder(output)
        if frames < 2:
            raise InputError("at least 2 frames, the source and the target", str(frames), "ask for more frames")
        matched = _matched(run, (a, b), pairs, (component, cut_handles))
        return _tell(run, matched, frames, (output, run.place(output)), (a, format))

    return execute("morph", _inputs(a, b, pairs), common, work)


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
        run.say(f"mean distance to the known true places: {true_error(matched):.1f} % of sqrt(area), by a rotation alone")
        found = _tell(run, matched, DEMO_FRAMES, (output / "morph", morphed), (a, "ply"))
        run.say(f"\nLook at  {output / 'morph' / 'contact-sheet.png'}\nand open {output / 'morph' / 'report.html'}")
        return found

    return execute("demo", [], common, work)


@app.command
def warmup(*, common: Common = DEFAULTS) -> int:
    """Compile the kernels, so that the next run starts at once."""

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.warm import compile_kernels, compiled

        if common.picture is not None:
            raise InputError("no --picture for warmup", "one", "leave it out: there is nothing to draw")
        before = compiled()
        run.stage("compiling kernels")
        compile_kernels()
        return {"compiled_before": before}

    return execute("warmup", [], common, work)


def _warm(run: Run) -> None:
    """Compile the kernels if this is the first run, and say so."""
    with run.uncounted():
        from morphlet.warm import compile_kernels, compiled

        if not compiled():
            run.say("compiling the kernels: once, about 20 s; later runs start at once")
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
    """Read, map, align, compose."""
    with run.uncounted():
        from morphlet.io.pairs import read_pairs
        from morphlet.pipeline import correspond_maps

    source, target = _closed(run, ends[0], mending), _closed(run, ends[1], mending)
    given = None if pairs is None else read_pairs(pairs).checked(source.source, target.source)
    if given is not None and not len(given):
        raise InputError(f"pairs in {pairs}", "a header without any", "add pairs, or leave --pairs out to have the rotation searched for")
    maps = _mapped(run, source, ends[0].name), _mapped(run, target, ends[1].name)
    run.stage("alignment")
    matched = correspond_maps(*maps, given)
    how = f"rotation from {len(given)} pairs" if given else "rotation found by a search (no pairs were given)"
    run.say(f"alignment: {how}" + ("; AMBIGUOUS: another rotation fits nearly as well, give pairs" if matched.alignment.ambiguous else ""))
    return matched


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
    repairs = {"source": _repairs(matched.source_map.surface), "target": _repairs(matched.target_map.surface)}
    return matched.figures() | {"alignment": matched.alignment.method, "repairs": repairs}


def _tell(run: Run, matched: "CorrespondResult", frames: int, folder: tuple[Path, Path], template: tuple[Path, str]) -> dict[str, Any]:
    """Morph along a correspondence and write everything `morph` promises: for the first folder, into the second."""
    with run.uncounted():
        from morphlet.pipeline import morph_along
        from morphlet.report.story import write_morph

    run.stage("frames")
    result = morph_along(matched, frames)
    figures = _found(matched) | result.figures() | {"path": result.morph.path}
    run.stage("pictures")
    final, made = folder
    sheet = write_morph(made, result, figures, template)
    if run.common.picture is not None:
        sheet.save(run.place(run.common.picture))
    outputs = [final / name for name in sorted([*(file.name for file in made.iterdir()), RESULT])]
    (made / RESULT).write_text(json.dumps(plain(run.head(outputs) | figures), indent=1), encoding="utf-8")
    return figures


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
