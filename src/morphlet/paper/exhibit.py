"""An exhibit: one table or figure of the paper, computed, and what there is to say about it."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from morphlet.errors import InputError
from morphlet.report.page import Plate, Value

TABLES, FIGURES = "tables", "figures"
"""Folders beside the report."""


@dataclass(frozen=True)
class Table:
    """Named columns.

    Parameters
    ----------
    heads
        Names of the columns, with their units.
    rows
        One value per column each.

    Raises
    ------
    InputError
        If a row has another length than the heads.

    Examples
    --------
    >>> from morphlet.paper.exhibit import Table
    >>> print(Table(("object", "faces"), (("ball", 80),)).csv, end="")
    object,faces
    ball,80
    """

    heads: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]

    def __post_init__(self) -> None:
        wrong = [k for k, row in enumerate(self.rows) if len(row) != len(self.heads)]
        if wrong:
            raise InputError(f"{len(self.heads)} values in each row", f"{len(wrong)} rows of another length", "fill with None", wrong)

    @property
    def csv(self) -> str:
        """As text: one line per row, all digits."""
        stream = io.StringIO()
        csv.writer(stream, lineterminator="\n").writerows([self.heads, *self.rows])
        return stream.getvalue()

    @property
    def records(self) -> list[dict[str, Value]]:
        """The rows as objects, NaN and infinity as None."""
        return [dict(zip(self.heads, map(_finite, row), strict=True)) for row in self.rows]


@dataclass(frozen=True)
class Exhibit:
    """A table or figure of the paper.

    Parameters
    ----------
    caption
        What it shows, and how it was made.
    table
        Its numbers.
    plates
        Its pictures.
    remarks
        Where the paper is wrong or silent, and what was found instead: one sentence or two each.
    """

    caption: str
    table: Table | None = None
    plates: tuple[Plate, ...] = ()
    remarks: tuple[str, ...] = ()

    def save(self, folder: Path, name: str) -> None:
        """Write `tables/<name>.csv` and `.json`, and `figures/<name>.png`, numbered where there are several pictures."""
        if self.table is not None:
            (folder / TABLES).mkdir(exist_ok=True)
            (folder / TABLES / f"{slug(name)}.csv").write_text(self.table.csv, encoding="utf-8", newline="\n")
            told = {"name": name, "caption": self.caption, "rows": self.table.records, "remarks": list(self.remarks)}
            (folder / TABLES / f"{slug(name)}.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
        for number, plate in enumerate(self.plates, 1):
            (folder / FIGURES).mkdir(exist_ok=True)
            place = f"{slug(name)}-{number}.png" if len(self.plates) > 1 else f"{slug(name)}.png"
            (folder / FIGURES / place).write_bytes(plate.png)


def slug(name: str) -> str:
    """A name as part of file names and addresses.

    Examples
    --------
    >>> from morphlet.paper.exhibit import slug
    >>> slug("Figure 9")
    'figure-9'
    """
    return name.lower().replace(" ", "-")


def table_of(heads: Sequence[str], rows: Sequence[Sequence[Any]]) -> Table:
    """A table from any numbers: those of numpy become plain ones."""
    return Table(tuple(heads), tuple(tuple(_plain(value) for value in row) for row in rows))


def _plain(value: Any) -> Value:
    """A value without numpy's type."""
    return value.item() if isinstance(value, np.generic) else value


def _finite(value: Value) -> Value:
    """A value as JSON has it."""
    return None if isinstance(value, float) and not np.isfinite(value) else value
