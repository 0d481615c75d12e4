"""What every benchmark writes: tables, as text or markdown for people and as JSON for `python -m benchmarks`, which binds them.

A script adds `--json FILE` and `--markdown` to its arguments with `add_options`, makes a `Sheet` of what was chosen, and adds a `Table` as
soon as it has one: it is printed at once, and the file is written anew, so that a run that is broken off leaves what it had.
"""

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

Cell = str | int | float | None
"""Strings stay as they are, real numbers are shown with four digits, None is empty."""
HIDDEN = {"--json": 2, "--markdown": 1}
"""Arguments that a command is told without, and how many words they are: they change nothing that is measured."""
PRIVATE = {"--data": "DIR", "--peer-python": "PYTHON", "--reference": "DIR"}
"""Arguments that name places on this machine, and what stands for those."""


def shown(cell: Cell) -> str:
    """A cell for people."""
    return "" if cell is None else f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def plain(cell: Cell) -> Cell:
    """A cell for programs: a number where it reads as one."""
    if not isinstance(cell, str):
        return None if isinstance(cell, float) and cell != cell else cell
    for kind in (int, float):
        try:
            number = kind(cell.replace("_", "?"))
        except ValueError:
            continue
        return number if abs(number) < float("inf") else cell
    return cell


def table(heads: Sequence[str], rows: Sequence[Sequence[Cell]], markdown: bool) -> str:
    """Rows as text, in columns or as markdown."""
    cells = [[shown(cell) for cell in row] for row in rows]
    if markdown:
        lines = [list(heads), ["---"] * len(heads), *cells]
        return "".join(f"| {' | '.join(line)} |\n" for line in lines)
    lines = [list(heads), *cells]
    widths = [max(len(line[k]) for line in lines if k < len(line)) for k in range(len(heads))]
    return "".join("  ".join(cell.ljust(w) for cell, w in zip(line, widths, strict=False)).rstrip() + "\n" for line in lines)


@dataclass(frozen=True, eq=False)
class Table:
    """One table: a title, heads, rows that may be shorter than them, the units of what has no unit in its head, remarks below."""

    title: str
    heads: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    units: str = ""
    notes: Sequence[str] = ()

    def text(self, markdown: bool = False) -> str:
        """For people."""
        head = f"### {self.title}\n\n" if markdown else f"{self.title}\n\n"
        units = f"{self.units}\n\n" if self.units else ""
        notes = "".join(f"- {note}\n" for note in self.notes)
        return head + units + (table(self.heads, self.rows, markdown) if self.heads else "") + (f"\n{notes}" if notes else "")

    def record(self) -> dict[str, Any]:
        """For programs."""
        rows = [[plain(cell) for cell in row] for row in self.rows]
        shown_rows = [[shown(cell) for cell in row] for row in self.rows]
        same = {"title": self.title, "units": self.units, "heads": list(self.heads), "notes": list(self.notes)}
        return same | {"rows": rows, "shown": shown_rows}

    @staticmethod
    def of(record: dict[str, Any]) -> "Table":
        """Back from a record, for people."""
        return Table(record["title"], record["heads"], record["shown"], record["units"], record["notes"])


def keyed(title: str, rows: Sequence[dict[str, Cell]], units: str = "") -> Table:
    """A table of rows by name; where a row has no such cell stands a dash."""
    heads = list(dict.fromkeys(key for row in rows for key in row))
    return Table(title, heads, [[row.get(key, "-") for key in heads] for row in rows], units)


def add_options(parser: argparse.ArgumentParser) -> None:
    """What all benchmarks understand."""
    parser.add_argument("--json", type=Path, help="all tables, and figures that are not in them")
    parser.add_argument("--markdown", action="store_true")


@dataclass(eq=False)
class Sheet:
    """What a benchmark has found so far, printed and written as it comes."""

    file: Path | None = None
    markdown: bool = False
    tables: list[Table] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)
    """Peers that are not there, and why."""
    figures: dict[str, Any] = field(default_factory=dict)
    """What tables leave out."""

    @staticmethod
    def of(chosen: argparse.Namespace) -> "Sheet":
        """By the arguments of `add_options`."""
        return Sheet(chosen.json, chosen.markdown)

    def add(self, found: Table) -> None:
        """Print a table, keep it."""
        sys.stdout.write(found.text(self.markdown) + "\n")
        sys.stdout.flush()
        self.tables.append(found)
        self.save()

    def miss(self, name: str, why: str) -> None:
        """Say that a peer is not there, once."""
        if name not in self.absent:
            sys.stdout.write(f"absent: {name}: {why}\n")
            self.absent[name] = why
            self.save()

    def record(self) -> dict[str, Any]:
        """For programs."""
        tables = [found.record() for found in self.tables]
        return {"command": command(sys.argv), "tables": tables, "absent": self.absent, "figures": self.figures}

    def save(self) -> None:
        """Write all that there is, by way of a file beside."""
        if self.file is None:
            return
        beside = self.file.with_name(self.file.name + ".part")
        beside.write_text(json.dumps(self.record(), indent=1))
        beside.replace(self.file)


def command(words: Sequence[str]) -> str:
    """How a script was called, without what only says where its figures go, and without this machine's places."""
    left, told = list(words[1:]), ["python", f"benchmarks/{Path(words[0]).name}"]
    while left:
        word = left.pop(0)
        if word in HIDDEN:
            del left[: HIDDEN[word] - 1]
            continue
        told.append(f"'{word}'" if set(word) & set(" *") else word)
        if word in PRIVATE:
            told.append(PRIVATE[word])
            del left[:1]
    return " ".join(told)
