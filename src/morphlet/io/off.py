"""Object File Format: a header with counts, a line per vertex, a line per face.

All text variants of three-dimensional OFF are read (`OFF`, `COFF`, `NOFF`, `STOFF` and their mixtures; counts on the line of the keyword
or on their own; comments; further columns), by their positions; four-dimensional and binary ones are refused.
"""

import re

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.errors import FileError
from morphlet.io import _text
from morphlet.io._text import Text
from morphlet.io.content import Attributes, Content, File, byte_colors, ragged, triangles, whole
from morphlet.surface.mesh import Mesh

ENDINGS = (".off",)
KEYWORD = re.compile(rb"\s*(ST)?(C)?(N)?(4)?(n)?OFF(?![A-Za-z_])([ \t]+BINARY)?")


def recognises(data: bytes) -> bool:
    """Whether the bytes begin with one of the keywords (after comments)."""
    return KEYWORD.match(re.sub(rb"\A(?:\s*#[^\n]*\n)+", b"", data)) is not None


def parse(file: File) -> Content:
    """The positions and triangles of an OFF file."""
    text, n, m, _ = _opened(file.data)
    vertices = _vertex_table(text, n)[:, :3]
    faces, lines = _faces(text, n, m)
    return Content(vertices, faces, lines)


def attributes(file: File) -> Attributes:
    """The vertex colours of a COFF file."""
    text, n, _, keyword = _opened(file.data)
    table = _vertex_table(text, n)
    column = 6 if b"N" in keyword else 3
    colored = b"C" in keyword and table.shape[1] >= column + 3
    return Attributes(byte_colors(table[:, column : column + 3]) if colored else None)


def render(mesh: Mesh, attributes: Attributes) -> bytes:
    """An OFF file of the geometry alone: every number in the fewest digits that give it back exactly."""
    vertices = _text.lettered(mesh.vertices.tolist(), "")
    return f"OFF\n{mesh.n_vertices} {mesh.n_faces} 0\n{vertices}{_text.lettered(mesh.faces.tolist(), '3 ')}".encode("ascii")


def _opened(data: bytes) -> tuple[Text, int, int, bytes]:
    """The words after the keyword, the counts of vertices and faces, the keyword."""
    data = _text.plain(data)
    found = KEYWORD.match(data)
    keyword = found[0].strip() if found else b""
    if found and (found[4] or found[5] or found[6]):
        raise FileError("a text OFF file in three dimensions", f"'{keyword.decode()}'", "export it as plain OFF")
    text = _text.scan(re.sub(rb"\S", b" ", found[0]) + data[found.end() :] if found else data)
    return text, *_counts(text), keyword


def _counts(text: Text) -> tuple[int, int]:
    """Numbers of vertices and faces, from the first line with words; as many lines must follow."""
    rows = np.flatnonzero(text.counts)
    if not len(rows) or text.counts[rows[0]] < 2:
        raise FileError("the counts of vertices and faces after 'OFF'", "none", "check that this is an OFF file")
    values = _text.numbers(text, _text.words(text, np.arange(len(text.counts)) == rows[0], 0))[:2]
    if np.any(values != np.floor(values)) or np.any(values < 0) or np.any(values > np.iinfo(np.int64).max // 2):
        raise FileError("two counts after 'OFF'", f"{values[0]:g} {values[1]:g}", "correct the header", [int(rows[0]) + 1])
    n, m = int(values[0]), int(values[1])
    if len(rows) - 1 < n + m:
        raise FileError(f"{n} vertex lines and {m} face lines", f"{len(rows) - 1} lines after the counts", "export the mesh again")
    return n, m


def _rows(text: Text, start: int, stop: int) -> Bool[np.ndarray, "l"]:
    """The lines of elements start to stop, counted over lines with words after the header."""
    chosen = np.zeros(len(text.counts), bool)
    chosen[np.flatnonzero(text.counts)[1 + start : 1 + stop]] = True
    return chosen


def _vertex_table(text: Text, n: int) -> Float[np.ndarray, "n d"]:
    lines = _rows(text, 0, n)
    counts = text.counts[lines]
    short = np.flatnonzero(counts < 3)
    if len(short):
        line = int(np.flatnonzero(lines)[short[0]]) + 1
        raise FileError("three coordinates per vertex line", f"{counts[short[0]]} on line {line}", "correct this line", [line])
    width = int(counts.min(initial=10))
    values = _text.numbers(text, _text.words(text, lines, 0))
    return values[(np.cumsum(counts) - counts)[:, None] + np.arange(width)]


def _faces(text: Text, n: int, m: int) -> tuple[Int[np.ndarray, "f 3"], Int[np.ndarray, "f"] | None]:
    lines = _rows(text, n, n + m)
    numbers, counts, line = _text.numbers(text, _text.words(text, lines, 0)), text.counts[lines], np.flatnonzero(lines) + 1
    start = np.cumsum(counts) - counts
    sizes = numbers[start]
    wrong = np.flatnonzero((sizes < 0) | (sizes >= counts) | (sizes != np.floor(sizes)))
    if len(wrong):
        needed = f"a count of corners, then so many indices on line {line[wrong[0]]}"
        raise FileError(needed, f"count {sizes[wrong[0]]:g} and {counts[wrong[0]] - 1} numbers", "correct this line", line[wrong])
    sizes = sizes.astype(np.int64)
    corners = whole(numbers[ragged(start + 1, sizes)], np.repeat(line, sizes))
    return triangles(corners, sizes, line)
