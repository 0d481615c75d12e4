"""The verb of the paper: every table and figure of it, computed."""

import os
from pathlib import Path
from typing import Any

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, Output
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError

DATA = "MORPHLET_DATA"
"""Names the folder of public meshes where --data does not."""
REPORT = "report.html"


def paper(*, output: Output, data: Path | None = None, vertices: int | None = None, common: Common = DEFAULTS) -> int:
    """Compute every table and figure of the paper.

    What cannot be made is told, and the rest goes on; the exit code is 1 then.

    Parameters
    ----------
    output
        Folder for report.html, tables (CSV and JSON) and figures.
    data
        Folder of public meshes; what MORPHLET_DATA names, or else the cache of fetch, if left out. Procedural ones stand in for what is
        missing.
    vertices
        Of each procedural stand-in.
    """
    lost = list[dict[str, str]]()

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.paper import book, page
            from morphlet.paper.subjects import Stock
            from morphlet.samples.creatures import DEFAULT_VERTICES

        if common.picture is not None:
            raise InputError("no --picture for paper", "one", "leave it out: all pictures are in the report")
        run.folder(output)
        steps.warm(run)
        steps.warm(run, "edits")
        stock = Stock(_folder(data), DEFAULT_VERTICES if vertices is None else vertices, run.on_step)
        place, made = run.place(output), list[book.Made]()
        for entry in book.ENTRIES:
            run.stage(entry.name)
            made.append(book.make(entry, stock, place))
            lost.extend(_told(run, made[-1]))
        page.write(place / REPORT, made, [(subject.name, subject.origin) for subject in stock.four])
        done = [one.entry.name for one in made if one.ok]
        return {"tables": _of(done, "Table"), "figures": _of(done, "Figure"), "equations": "Equations" in done, "failed": lost}

    return execute("paper", [], common, work) or (1 if lost else 0)


def _folder(data: Path | None) -> Path | None:
    """The folder of public meshes; none if the cache is meant."""
    named = os.environ.get(DATA)
    folder = data if data is not None else Path(named) if named else None
    if folder is not None and not folder.is_dir():
        raise InputError(
            "a folder of public meshes", f"{folder}, which is none", f"name another with --data, or leave --data and {DATA} out"
        )
    return folder


def _of(names: list[str], kind: str) -> list[str]:
    """The names of one kind."""
    return [name for name in names if name.startswith(kind)]


def _told(run: Run, made: Any) -> list[dict[str, str]]:
    """What went wrong with an exhibit, said aloud."""
    if made.ok:
        return []
    why = made.failure or f"does not hold: {', '.join(made.broken)}"
    run.say(f"{made.entry.name}: {why}")
    return [{"name": made.entry.name, "error": why}]
