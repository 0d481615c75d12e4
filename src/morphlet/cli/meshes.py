"""Verbs of meshes as such: what one is, mending it, how far two are apart, and where meshes come from."""

from pathlib import Path
from typing import Any, Literal

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, MESHES, Cuts, Kept, MaybeOutput, Output
from morphlet.cli.pictures import draw_mesh
from morphlet.console import Common, Run, execute
from morphlet.errors import MeshError


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
        draw_mesh(run, shape)
        return asdict(describe(shape))

    return execute("info", [mesh], common, work)


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
        if mended.mesh.n_faces == 0:
            advice = "mend it where it comes from: faces that repeat a vertex, lie back to back or occur twice are dropped"
            raise MeshError(f"faces to keep in {mesh}", f"none of {shape.n_faces}", advice)
        write(run.place(output), mended.mesh)
        draw_mesh(run, mended.mesh)
        return {"before": asdict(describe(shape)), "after": asdict(describe(mended.mesh)), "repairs": steps.repairs(mended)}

    return execute("repair", [mesh], common, work)


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
        draw_mesh(run, second)
        return dict(metrics.compare(first, second))

    return execute("compare", [a, b], common, work)


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
        draw_mesh(run, made)
        return {"vertices": made.n_vertices, "faces": made.n_faces}

    return execute("sample", [name], common, work)


def fetch(
    name: str,
    /,
    *,
    output: MaybeOutput = None,
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
            draw_mesh(run, read(found))
        entry = catalogue.CATALOGUE[name]
        return {"path": str(output or found), "sha256": entry.sha256, "licence": entry.licence}

    return execute("fetch", [name], common, work)
