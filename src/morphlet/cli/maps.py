"""Verbs of the map from mesh to mesh: the map, and what is carried through it."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from morphlet.cli import steps
from morphlet.cli.options import COLORED, DEFAULTS, MENDING, Mending, Output, Pairs
from morphlet.cli.pictures import draw_carried, draw_correspondence
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from morphlet.io.attributes import Attribute
    from morphlet.mapping.correspondence import Correspondence
    from morphlet.surface.mesh import Mesh


def correspond(
    a: Path,
    b: Path,
    /,
    *,
    output: Output,
    pairs: Pairs = None,
    a_sphere: Path | None = None,
    b_sphere: Path | None = None,
    mending: Mending = MENDING,
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
    a_sphere
        .npz file that sphere wrote for A, which is taken instead of making the map again.
    b_sphere
        The same for B.
    """

    def work(run: Run) -> dict[str, Any]:
        run.file(output, ".npz")
        matched = steps.matched(run, (a, b), pairs, mending, (a_sphere, b_sphere))
        matched.correspondence.save(run.place(output))
        draw_correspondence(run, matched)
        return matched.figures() | steps.circumstances(matched)

    return execute("correspond", steps.present(a, b, pairs, a_sphere, b_sphere), common, work)


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
        draw_carried(run, (target, source), chosen[0], carried[chosen[0].name])
        told = [{"name": one.name, "kind": one.kind, "rows": len(carried[one.name]), "columns": one.columns} for one in chosen]
        return {"attributes": told, "unanswered": int(np.sum(~np.asarray(found.valid)))}

    return execute("carry", [a, b, map, *_files(attribute)], common, work)


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
