"""The verb batch: other verbs over many meshes, and the maps between every two of them.

Each item runs the verb itself, with its own words, in a process that serves one after another.
"""

import inspect
import re
from collections.abc import Callable
from dataclasses import asdict, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cyclopts import App

from morphlet.cli import compression, features, networks, spheres
from morphlet.cli.many import MANY, Many, executed, meshes_of, require_no_picture, started, told
from morphlet.cli.options import DEFAULTS, MENDING, Mending, Output
from morphlet.cli.steps import present
from morphlet.console import Common, Run, plain
from morphlet.errors import FileError, InputError, MeshError

if TYPE_CHECKING:
    from morphlet.batch.items import Item
    from morphlet.batch.manifest import Line

FEWEST = 2
"""Meshes between which there are maps."""
ENTRY = re.compile(r"^    (\w+)\n((?:        .*\n?|\n(?=        ))+)", flags=re.MULTILINE)
"""An option and its lines in the docstring of a verb."""
EACH = """{first}

    Parameters
    ----------
    inputs
        Mesh files, or folders of them; no two of one stem.
    output
        Folder for a file of each input's stem ({ending}), what the verb tells of it (.json), and manifest.jsonl: what became of each.
        Started again, a batch goes on where it stopped.
{own}"""
app = App(name="batch", help="A verb over many meshes, or the map between every two of them: on this machine, or on a cluster.")


def over_many(verb: Callable[..., int], ending: str, without: tuple[str, ...] = ()) -> Callable[..., int]:
    """A verb over many meshes: with its options, but those that name one file, and those of a batch."""

    def many(*inputs: Path, output: Path, many: Many = MANY, common: Common = DEFAULTS, **chosen: Any) -> int:
        options = _options(verb, without, chosen)

        def work(run: Run) -> dict[str, Any]:
            require_no_picture(run)
            parameters = plain({"verb": verb.__name__} | options | {"seed": common.seed})
            words = _words(options | {"seed": common.seed})
            items = [_item(file, (verb.__name__, str(file.absolute()), *words), ending, parameters) for file in meshes_of(inputs)]
            with started(run, output, many, items) as batch:
                batch.warm(*(("codec", "surfaces") if verb is compression.encode else ("kernels",)))
                return told(batch, batch.lines(items, verb.__name__))

        return executed(inputs, common, work)

    return _signed(many, verb, (ending, without))


def correspond(
    *inputs: Path,
    to: Path,
    output: Output,
    pairs: Path | None = None,
    mending: Mending = MENDING,
    many: Many = MANY,
    common: Common = DEFAULTS,
) -> int:
    """Find where each vertex of each input lies on one target, whose spherical map is made once.

    Parameters
    ----------
    inputs
        Source meshes, or folders of them; no two of one stem.
    to
        Target mesh.
    output
        Folder for a file of each input's stem (.npz), what the verb tells of it (.json), and manifest.jsonl: what became of each. Started
        again, a batch goes on where it stopped.
    pairs
        Folder of CSV files of the inputs' stems: vertices that belong together. Inputs without one have their regions matched.
    """

    def work(run: Run) -> dict[str, Any]:
        from morphlet.batch.items import fingerprint

        require_no_picture(run)
        options = asdict(mending) | {"seed": common.seed}
        target = _sphere_item(to, options)
        shared = options | {"to": to.name, "to_fingerprint": fingerprint(to)}
        items = [_towards(file, to, target.outputs[0], _csv(file, pairs), (output, shared)) for file in meshes_of(inputs)]
        with started(run, output, many, [*items, target]) as batch:
            batch.warm("kernels")
            (line,) = batch.lines([target], f"sphere of {to.name}")
            if line.error is not None:
                raise MeshError(f"a spherical map of {to}", line.error, "mend it, or choose another target")
            return told(batch, batch.lines(items, "correspond"))

    return executed(present(*inputs, to), common, work)


@app.command(name="all-pairs")
def all_pairs(*inputs: Path, output: Output, mending: Mending = MENDING, many: Many = MANY, common: Common = DEFAULTS) -> int:
    """Find the maps between every two meshes, how far each is from each, and a picture of all as points in the plane.

    Parameters
    ----------
    inputs
        Mesh files, or folders of them; no two of one stem.
    output
        Folder for spheres (a spherical map of each mesh, made once), pairs (A--B.npz: where each vertex of A lies on B), distances.npz,
        distances.csv, embedding.png, and manifest.jsonl: what became of each. Started again, a batch goes on where it stopped.
    """

    def work(run: Run) -> dict[str, Any]:
        files, options = meshes_of(inputs), asdict(mending) | {"seed": common.seed}
        if len(files) < FEWEST:
            raise InputError(f"{FEWEST} meshes or more", str(len(files)), "name more of them, or a folder")
        mapped = [_sphere_item(file, options) for file in files]
        with started(run, output, many, mapped) as batch:
            batch.warm("kernels")
            lines = batch.lines(mapped, "spheres")
            known = {line.input: line for line in lines if line.status != "failed"}
            pairs = [(a, b) for place, a in enumerate(files) for b in files[place + 1 :]]
            whole = [pair for pair in pairs if all(str(file) in known for file in pair)]
            lines += batch.lines(_pair_items(whole, known, (output, options)), "pairs")
            lines += batch.written(_without_sphere(pair, known, options) for pair in pairs if not all(str(file) in known for file in pair))
            return told(batch, lines) | _distances(run, output, files)

    return executed(inputs, common, work)


def _distances(run: Run, output: Path, files: list[Path]) -> dict[str, Any]:
    """Write how far meshes are from each other, and draw them; what is told of it."""
    from morphlet.batch.all_pairs import read_distances
    from morphlet.batch.picture import draw

    run.stage("distances")
    found = read_distances(output / "pairs", [file.stem for file in files])
    run.outputs += found.write(output)
    picture = run.common.picture or output / "embedding.png"
    if found.known.any():
        draw(found, files, run.place(picture) if run.common.picture else picture)
        run.outputs += [] if run.common.picture else [picture]
    return {"meshes": len(files), "pairs": int(found.known.sum()) // 2, "distance_max": found.largest, "stress": found.stress}


def _item(file: Path, words: tuple[str, ...], ending: str, parameters: dict[str, Any], name: str | None = None) -> "Item":
    """An item whose outputs have the stem of its input, or another name."""
    from morphlet.batch.items import Item

    stem = file.stem if name is None else name
    return Item(str(file), str(file.absolute()), words, (f"{stem}{ending}", f"{stem}.json"), parameters)


def _sphere_item(file: Path, options: dict[str, Any]) -> "Item":
    """The spherical map of a mesh, which several maps to other meshes share."""
    words = ("sphere", str(file.absolute()), *_words(options))
    return _item(file, words, ".npz", {"verb": "sphere"} | options, f"spheres/{file.stem}")


def _towards(file: Path, to: Path, sphere: str, pairs: Path | None, kept: tuple[Path, dict[str, Any]]) -> "Item":
    """The map from a mesh to one whose spherical map is stored."""
    from morphlet.batch.items import fingerprint

    output, shared = kept
    own = {name: shared[name] for name in shared if not name.startswith("to")}
    words = ["correspond", str(file.absolute()), str(to.absolute()), f"--b-sphere={(output / sphere).absolute()}", *_words(own)]
    words += [] if pairs is None else [f"--pairs={pairs.absolute()}"]
    parameters = {"verb": "correspond", "pairs": None if pairs is None else fingerprint(pairs)} | shared
    return _item(file, tuple(words), ".npz", parameters)


def _pair_items(pairs: "list[tuple[Path, Path]]", known: "dict[str, Line]", kept: tuple[Path, dict[str, Any]]) -> "list[Item]":
    """The maps between meshes whose spherical maps are stored; of thousands of meshes there are millions, so they share what they can."""
    output, options = kept
    ends = {file for pair in pairs for file in pair}
    stored = {file: (str(file.absolute()), f"-sphere={(output / 'spheres' / file.stem).absolute()}.npz") for file in ends}
    first, second = ({file: f"--{side}{word}" for file, (_, word) in stored.items()} for side in "ab")
    shared = {"verb": "correspond"} | options
    towards = {b: shared | {"to": b.name, "to_fingerprint": known[str(b)].fingerprint} for b in ends}
    seed = f"--seed={options['seed']}"
    words = ((a, b, ("correspond", stored[a][0], stored[b][0], first[a], second[b], seed)) for a, b in pairs)
    return [_item(a, told, ".npz", towards[b], f"pairs/{a.stem}--{b.stem}") for a, b, told in words]


def _without_sphere(pair: tuple[Path, Path], known: "dict[str, Line]", options: dict[str, Any]) -> "Line":
    """What is told of two meshes of which one has no spherical map."""
    from morphlet.batch.manifest import Line

    a, b = pair
    missing = " and ".join(str(file) for file in pair if str(file) not in known)
    parameters = {"verb": "correspond", "to": b.name, "to_fingerprint": None} | options
    return Line(str(a), known[str(a)].fingerprint if str(a) in known else None, parameters, "failed", f"no spherical map of {missing}")


def _csv(file: Path, pairs: Path | None) -> Path | None:
    """The pairs of an input, if there are any."""
    if pairs is None:
        return None
    if not pairs.is_dir():
        raise FileError(f"a folder of pairs at {pairs}", "none", "name a folder that holds a CSV file of each input's stem")
    found = pairs / f"{file.stem}.csv"
    return found if found.is_file() else None


def _own_parameters(verb: Callable[..., int], without: tuple[str, ...]) -> list[inspect.Parameter]:
    """The options of a verb that go for many meshes."""
    every = inspect.signature(verb).parameters.values()
    return [one for one in every if one.kind is one.KEYWORD_ONLY and one.name not in {"output", "common", *without}]


def _options(verb: Callable[..., int], without: tuple[str, ...], chosen: dict[str, Any]) -> dict[str, Any]:
    """All options of a verb by name, those that were left out at their defaults."""
    found = dict[str, Any]()
    for one in _own_parameters(verb, without):
        value = chosen.get(one.name, one.default)
        found |= asdict(value) if is_dataclass(value) and not isinstance(value, type) else {one.name: value}
    return found


def _words(options: dict[str, Any]) -> list[str]:
    """Options as words; flags that are not set, and what has no value, need none."""
    names = {name: f"--{name.replace('_', '-')}" for name in options}
    given = {name: value for name, value in options.items() if value is not None and value is not False}
    return [names[name] if value is True else f"{names[name]}={value}" for name, value in given.items()]


def _signed(many: Callable[..., int], verb: Callable[..., int], what: tuple[str, tuple[str, ...]]) -> Callable[..., int]:
    """A function with the name, the options and the explanations of a verb, but many inputs."""
    ending, without = what
    inputs = inspect.Parameter("inputs", inspect.Parameter.VAR_POSITIONAL, annotation=Path)
    own = inspect.signature(many).parameters
    kept = [inputs, own["output"].replace(annotation=Output), *_own_parameters(verb, without), own["many"], own["common"]]
    texts = {name: text for name, text in ENTRY.findall((verb.__doc__ or "") + "\n") if name in {one.name for one in kept[2:]}}
    first = (verb.__doc__ or "").split("\n\n")[0]
    many.__signature__ = inspect.Signature(kept, return_annotation=int)  # type: ignore[attr-defined]
    many.__annotations__ = {one.name: one.annotation for one in kept}
    many.__doc__ = EACH.format(first=first, ending=ending, own="".join(f"    {name}\n{text}" for name, text in texts.items()))
    many.__name__ = verb.__name__
    return many


for made in (
    over_many(spheres.sphere, ".npz"),
    correspond,
    over_many(compression.encode, ".mlw", ("permutation",)),
    over_many(networks.approximate, ".npz"),
    over_many(features.regions, ".npz"),
):
    app.command(made)
