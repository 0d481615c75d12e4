"""Steps of several verbs: a mesh read and mended, its spherical map, the map to another mesh, and what is told of them."""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from morphlet.cli.options import MENDING, Mending
from morphlet.console import Run, plain
from morphlet.errors import InputError, MeshError

if TYPE_CHECKING:
    from morphlet.pipeline.results import CorrespondResult
    from morphlet.sphere.embed import SphereOptions
    from morphlet.sphere.map import SphericalMap
    from morphlet.surface.pairs import VertexPairs
    from morphlet.surface.repair import Repaired
    from morphlet.surface.sequence import MeshSequence

    Ends = tuple[Repaired, Repaired]

RESULT = "result.json"
FIRST_USE = {
    "kernels": "compiling the kernels: once, about 40 seconds on two cores; later runs start at once",
    "edits": "compiling the kernels of editing: once, about a quarter of a minute; later edits start at once",
    "poses": "compiling the kernels of pose transfer: once, about ten seconds; later transfers start at once",
    "codec": "compiling the kernels of the codec: once, about a quarter of a minute; later files start at once",
    "surfaces": "compiling the kernels of coded surfaces: once, about ten seconds; later files start at once",
}
"""What is said before kernels are compiled."""


def present(*files: Path | None) -> list[Path | str]:
    """The files that were named."""
    return [file for file in files if file is not None]


def warm(run: Run, of: str = "kernels") -> None:
    """Compile the kernels of the main job, or of another set, if this is their first use, and say so."""
    with run.uncounted():
        from morphlet.warm import COMPILERS, compiled

        if not compiled(of):
            run.say(FIRST_USE[of])
            run.stage("compiling kernels")
            COMPILERS[of]()


def welded(run: Run, path: Path) -> "Repaired":
    """A mesh file with its seams closed and its faces turned alike, what was mended said aloud."""
    with run.uncounted():
        from morphlet.io.formats import read
        from morphlet.surface.repair import RepairOptions, repair

    return _said(run, repair(read(path), RepairOptions(split=False)), path)


def closed(run: Run, path: Path, mending: Mending) -> "Repaired":
    """A mesh file as a surface that has a spherical map, what was mended said aloud; errors name the file."""
    with run.uncounted():
        from morphlet.io.formats import read
        from morphlet.surface.repair import RepairOptions, close

    shape = read(path)
    with naming(path):
        surface = close(shape, RepairOptions(fill="all", component=mending.component, cut_handles=mending.cut_handles))
    return _said(run, surface, path)


@contextmanager
def naming(path: Path) -> Iterator[None]:
    """What is wrong with a mesh names its file."""
    try:
        yield
    except MeshError as error:
        raise MeshError(f"{error.needed} in {path}", error.found, error.advice, error.elements) from error


def _said(run: Run, surface: "Repaired", path: Path) -> "Repaired":
    """A mended mesh, what was done said aloud."""
    for done in surface.repairs:
        run.say(f"{path.name}: {done.what} ({done.count})")
    return surface


def repairs(mended: "Repaired") -> list[dict[str, Any]]:
    """What was mended, as verbs tell it."""
    return [{"what": done.what, "count": done.count} for done in mended.repairs]


def mapped(run: Run, surface: "Repaired", name: str, options: "SphereOptions | None" = None) -> "SphericalMap":
    """The spherical map of a surface; `name` is what the progress bar calls it."""
    with run.uncounted():
        from morphlet.sphere.map import map_surface

    warm(run)
    run.stage(f"sphere of {name}")
    return map_surface(surface, options, run.on_step)


def answered(pairs: Path, ends: "Ends") -> "VertexPairs":
    """The pairs of a file, once it is certain that they name vertices of both files that stand for themselves."""
    from morphlet.io.pairs import read_pairs

    return read_pairs(pairs).checked(ends[0].source, ends[1].source).answered(ends[0].valid, ends[1].valid)


def given(pairs: Path | None, ends: "Ends") -> "VertexPairs | None":
    """The same where pairs may be left out, but not be none."""
    if pairs is None:
        return None
    found = answered(pairs, ends)
    if not len(found):
        raise InputError(f"pairs in {pairs}", "a header without any", "add pairs, or leave --pairs out to have regions matched")
    return found


def inside(pairs: "VertexPairs", ends: "Ends") -> "VertexPairs":
    """Pairs of the files' vertices as pairs of the mended surfaces'."""
    from morphlet.surface.pairs import VertexPairs

    return VertexPairs(ends[0].vertex_map[pairs.source], ends[1].vertex_map[pairs.target], pairs.weight, pairs.labels)


def stored(file: Path, sphere: Path | None) -> "SphericalMap | None":
    """The spherical map of a mesh file that was stored, if one is named."""
    from morphlet.io.formats import read
    from morphlet.sphere.map import SphericalMap

    return None if sphere is None else SphericalMap.load(sphere, read(file))


def matched(
    run: Run,
    files: tuple[Path, Path],
    pairs: Path | None,
    mending: Mending = MENDING,
    spheres: tuple[Path | None, Path | None] = (None, None),
) -> "CorrespondResult":
    """Read, map (unless the maps are stored), match, align, lay one into the other's sphere."""
    with run.uncounted():
        from morphlet.pipeline.correspond import correspond_maps
        from morphlet.surface.requirements import require_area

    a, b = stored(files[0], spheres[0]), stored(files[1], spheres[1])
    ends = a.surface if a else closed(run, files[0], mending), b.surface if b else closed(run, files[1], mending)
    for end, file in zip(ends, files, strict=True):
        with naming(file):
            require_area(end.mesh)
    told = given(pairs, ends)
    maps = a or mapped(run, ends[0], files[0].name), b or mapped(run, ends[1], files[1].name)
    warm(run)
    run.stage("regions, alignment, dense map")
    found = correspond_maps(*maps, told, run.on_step)
    kept = 0 if told is None else len(told)
    text = f"pairs: {kept} given, {len(found.pairs) - kept} from matched regions"
    run.say(text if len(found.pairs) else "no pairs: the spheres were turned by a search")
    warn(run, found.warnings, found.ambiguous)
    return found


def warn(run: Run, warnings: Sequence[str], ambiguous: bool) -> None:
    """Say aloud what is doubtful about a matching."""
    for warning in warnings:
        run.say(f"{'AMBIGUOUS' if ambiguous else 'note'}: {warning}")


def circumstances(found: "CorrespondResult") -> dict[str, Any]:
    """How a map came about."""
    mended = {"source": repairs(found.source_map.surface), "target": repairs(found.target_map.surface)}
    return {"alignment": found.alignment.method, "warnings": list(found.warnings), "repairs": mended}


def as_in_file(surface: "Repaired", frames: "MeshSequence") -> "MeshSequence":
    """Frames of a welded mesh with the vertices of its file; one in no face moves as the nearest that is in one."""
    import numpy as np

    from morphlet.surface.sequence import MeshSequence

    moved = frames.positions[:, surface.vertex_map]
    carried = surface.source.vertices + (moved - surface.mesh.vertices[surface.vertex_map])
    positions = np.where(surface.valid[:, None], moved, carried)
    return MeshSequence(surface.source.topology, positions, frames.times)


def write_result(run: Run, folder: tuple[Path, Path], figures: dict[str, Any]) -> None:
    """What is told of a sequence, beside its files: in the name of the first folder, into the second."""
    final, made = folder
    outputs = [final / name for name in sorted([*(file.name for file in made.iterdir()), RESULT])]
    (made / RESULT).write_text(json.dumps(plain(run.head(outputs) | figures), indent=1), encoding="utf-8")
