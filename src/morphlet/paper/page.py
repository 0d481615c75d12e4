"""The report of all exhibits as one HTML file that needs nothing else."""

import base64
import html
from collections.abc import Sequence
from pathlib import Path

from morphlet.paper.book import Made
from morphlet.paper.exhibit import Exhibit, Table, slug
from morphlet.report.page import STYLE, Value, shown

TITLE = "3D high-resolution mesh deformation based on multi-library wavelet neural networks"
LEAD = (
    "Every table and figure of the paper, computed: what the paper left out is filled in, and where it is wrong or silent, that is "
    "said beside. "
    "Numbers are those of this run; the same are in the folder tables as CSV and JSON, the pictures in the folder figures."
)
OWN_STYLE = """
html { scroll-behavior: smooth; scroll-padding-top: 1rem; }
header p { font-size: 1.05rem; }
nav ol { columns: 17rem; column-gap: 2rem; padding: 0; margin: 1rem 0 2rem; list-style: none; font-size: .92rem; }
nav li { break-inside: avoid; padding: .12rem 0; } nav a { display: flex; }
nav b { flex: 0 0 5.6rem; font-weight: 600; }
a { color: inherit; text-decoration: none; } a:hover { text-decoration: underline; }
h2 small { display: block; font-size: .8rem; font-weight: 600; letter-spacing: .06em; text-transform: uppercase; color: #0072b2; }
p.caption { color: var(--soft); max-width: 60rem; }
table { font-size: .9rem; } thead th { vertical-align: bottom; font-size: .82rem; border-bottom: 2px solid var(--line); max-width: 11rem; }
td.text { min-width: 7rem; max-width: 26rem; } th.value { text-align: right; }
aside { border-left: 3px solid #d55e00; padding: .1rem 0 .1rem 1rem; margin: 1.2rem 0; max-width: 60rem; font-size: .94rem; }
aside h3 { margin: .3rem 0 .4rem; font-size: .82rem; letter-spacing: .05em; text-transform: uppercase; color: #d55e00; }
aside ul { margin: 0; padding-left: 1.1rem; } aside li { margin: .25rem 0; }
p.failed { background: var(--band); border: 1px solid #d55e00; border-radius: 6px; padding: .7rem 1rem; }
"""
"""Beside the style of all reports."""


def text_of(made: Sequence[Made], objects: Sequence[tuple[str, str]]) -> str:
    """The report.

    Parameters
    ----------
    made
        The exhibits in order, those that failed among them.
    objects
        Name and origin of each object.

    Examples
    --------
    >>> from morphlet.paper.book import ENTRIES, Made
    >>> from morphlet.paper.page import text_of
    >>> "no data &amp; no hope" in text_of([Made(ENTRIES[1], None, "no data & no hope")], [("Horse", "horse.obj")])
    True
    """
    style = f"<style>{STYLE}{OWN_STYLE}</style>"
    meta = '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">'
    head = f"{meta}\n<title>{html.escape(TITLE)}</title>\n{style}"
    body = "\n".join([_header(made, objects), *(_section(one) for one in made)])
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{body}\n</body>\n</html>\n'


def write(path: Path, made: Sequence[Made], objects: Sequence[tuple[str, str]]) -> None:
    """Write the report."""
    path.write_text(text_of(made, objects), encoding="utf-8", newline="\n")


def _header(made: Sequence[Made], objects: Sequence[tuple[str, str]]) -> str:
    """Title, what was used, what failed, contents."""
    used = "; ".join(f"{name}: {origin}" for name, origin in objects)
    lost = [one.entry.name for one in made if not one.ok]
    summary = f"{len(made) - len(lost)} of {len(made)} exhibits" + (f"; failed: {', '.join(lost)}" if lost else ", all of them made")
    links = "\n".join(
        f'<li><a href="#{slug(one.entry.name)}"><b>{html.escape(one.entry.name)}</b><span>{html.escape(one.entry.title)}</span></a></li>'
        for one in made
    )
    told = "".join(f"<p>{html.escape(line)}</p>\n" for line in (LEAD, f"Objects. {used}.", f"{summary}."))
    return f"<header>\n<h1>{html.escape(TITLE)}</h1>\n{told}</header>\n<nav><ol>\n{links}\n</ol></nav>"


def _section(made: Made) -> str:
    """An exhibit, or why there is none."""
    name, title = html.escape(made.entry.name), html.escape(made.entry.title)
    heading = f"<h2><small>{name}</small>{title}</h2>"
    body = _body(made.exhibit) if made.exhibit is not None else f'<p class="failed">This could not be made. {html.escape(made.failure)}</p>'
    broken = f'<p class="failed">Does not hold: {html.escape(", ".join(made.broken))}</p>\n' if made.broken else ""
    return f'<section id="{slug(made.entry.name)}">\n{heading}\n{broken}{body}\n</section>'


def _body(exhibit: Exhibit) -> str:
    """Caption, table, pictures, remarks."""
    parts = [f'<p class="caption">{html.escape(exhibit.caption)}</p>']
    parts += [_table(exhibit.table)] if exhibit.table is not None else []
    parts += [_figure(plate.png, plate.alt) for plate in exhibit.plates]
    parts += [_remarks(exhibit.remarks)] if exhibit.remarks else []
    return "\n".join(parts)


def _remarks(remarks: Sequence[str]) -> str:
    """What is said beside."""
    items = "\n".join(f"<li>{html.escape(remark)}</li>" for remark in remarks)
    return f"<aside>\n<h3>Where the paper is wrong or silent, and what was found</h3>\n<ul>\n{items}\n</ul>\n</aside>"


def _table(table: Table) -> str:
    """A table with heads, numbers to the right."""
    numeric = [all(isinstance(row[k], int | float | None) for row in table.rows) for k in range(len(table.heads))]
    heads = "".join(f"<th{_kind(right, '')}>{html.escape(head)}</th>" for head, right in zip(table.heads, numeric, strict=True))
    rows = "\n".join(f"<tr>{''.join(_cell(value, numeric[k]) for k, value in enumerate(row))}</tr>" for row in table.rows)
    return f'<div class="wide"><table>\n<thead><tr>{heads}</tr></thead>\n<tbody>\n{rows}\n</tbody>\n</table></div>'


def _cell(value: Value, right: bool) -> str:
    """A value in its cell; numbers to four digits."""
    text = f"{value:.4g}" if isinstance(value, float) else shown(value)
    return f"<td{_kind(right, 'text')}>{html.escape(text)}</td>"


def _kind(right: bool, other: str) -> str:
    """The class of a cell."""
    name = "value" if right else other
    return f' class="{name}"' if name else ""


def _figure(png: bytes, alt: str) -> str:
    """A picture with its words."""
    data, words = base64.b64encode(png).decode("ascii"), html.escape(alt)
    return f'<figure><img src="data:image/png;base64,{data}" alt="{words}"><figcaption>{words}</figcaption></figure>'
