"""A report as one HTML file that needs nothing else: text, tables, pictures."""

import base64
import html
import os
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from morphlet import _store
from morphlet.errors import InputError

PNG = b"\x89PNG\r\n\x1a\n"
"""How every PNG file begins."""
DIGITS = 6
"""Significant digits of numbers in tables: what a person compares."""
STYLE = """
:root { color-scheme: light dark; --ink: #222; --soft: #666; --paper: #fff; --line: #ddd; --band: #f6f6f4; }
@media (prefers-color-scheme: dark) { :root { --ink: #e6e6e3; --soft: #a5a5a0; --paper: #1b1c1e; --line: #3a3b3e; --band: #242528; } }
body { margin: 0 auto; max-width: 76rem; padding: 2rem 1.25rem 4rem; background: var(--paper); color: var(--ink);
  font: 16px/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.25; margin: 0 0 1.5rem; }
h2 { font-size: 1.2rem; margin: 2.5rem 0 .75rem; padding-top: .75rem; border-top: 1px solid var(--line); }
p { max-width: 46rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; margin: 1rem 0; }
th, td { padding: .35rem .9rem; text-align: left; border-bottom: 1px solid var(--line); vertical-align: top; }
tbody tr:nth-child(odd) { background: var(--band); }
td.value { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
td.meaning { color: var(--soft); }
figure { margin: 1.25rem 0; }
img { display: block; max-width: 100%; height: auto; background: #fff; border: 1px solid var(--line); border-radius: 6px; }
figcaption { margin-top: .4rem; color: var(--soft); font-size: .9rem; }
"""
"""Plain, readable, light or dark as the reader's system is."""

Value = str | int | float | bool | None
Row = tuple[str, Value, str]


@dataclass(frozen=True)
class Plate:
    """A picture on a page: the content of a PNG file, and what it shows, in words."""

    png: bytes
    alt: str

    def __post_init__(self) -> None:
        if not self.png.startswith(PNG):
            raise InputError("the content of a PNG file", f"{len(self.png)} other bytes", "pass picture.png")


@dataclass(frozen=True)
class Section:
    """A part of a report.

    Parameters
    ----------
    heading
        What it is about.
    paragraphs
        Plain text.
    table
        Rows of name, value, and unit or meaning.
    plates
        Pictures.
    """

    heading: str
    paragraphs: tuple[str, ...] = ()
    table: tuple[Row, ...] = ()
    plates: tuple[Plate, ...] = ()


def write_page(path: str | os.PathLike[str], title: str, sections: Iterable[Section]) -> None:
    """Write a report as one HTML file, pictures included.

    Parameters
    ----------
    path
        The file, replaced if it exists.
    title
        The headline.
    sections
        The parts, in order.

    Raises
    ------
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> import tempfile, pathlib
    >>> from morphlet.report.page import Section, write_page
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     file = pathlib.Path(folder) / "report.html"
    ...     write_page(file, "Cat & lion", [Section("Figures", table=(("energy", 1.25, "mean"),))])
    ...     "<h1>Cat &amp; lion</h1>" in file.read_text(encoding="utf-8")
    True
    """
    text = page(title, sections)
    with _store.beside(path) as temporary:
        Path(temporary).write_text(text, encoding="utf-8", newline="\n")


def page(title: str, sections: Iterable[Section]) -> str:
    """The text of the HTML file."""
    name = html.escape(title)
    head = f'<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n<title>{name}</title>'
    body = "\n".join(_section(section) for section in sections)
    style = f"<style>{STYLE}</style>"
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n{style}\n</head>\n<body>\n<h1>{name}</h1>\n{body}\n</body>\n</html>\n'


def _section(section: Section) -> str:
    parts = [f"<h2>{html.escape(section.heading)}</h2>"]
    parts += [f"<p>{html.escape(text)}</p>" for text in section.paragraphs]
    parts += [_table(section.table)] if section.table else []
    parts += [_figure(plate) for plate in section.plates]
    return "<section>\n" + "\n".join(parts) + "\n</section>"


def _table(rows: Iterable[Row]) -> str:
    lines = [
        f'<tr><th scope="row">{html.escape(name)}</th><td class="value">{html.escape(shown(value))}</td>'
        f'<td class="meaning">{html.escape(meaning)}</td></tr>'
        for name, value, meaning in rows
    ]
    return '<div class="wide"><table>\n<tbody>\n' + "\n".join(lines) + "\n</tbody>\n</table></div>"


def _figure(plate: Plate) -> str:
    data, alt = base64.b64encode(plate.png).decode("ascii"), html.escape(plate.alt)
    return f'<figure><img src="data:image/png;base64,{data}" alt="{alt}"><figcaption>{alt}</figcaption></figure>'


def shown(value: Value) -> str:
    """A value as people read it: numbers to six digits, yes and no, a dash for what is unknown."""
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return f"{value:.{DIGITS}g}" if isinstance(value, float) else str(value)
