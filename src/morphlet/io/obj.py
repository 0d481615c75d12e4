"""Wavefront OBJ, by position index: vertex i is the i-th `v` line, however texture coordinates and normals split it.

Read are `v` (with colours, if any) and `f` lines of all groups and objects; polygons become fans, negative indices count
back from the line they stand on, a backslash continues a line.
"""

import re
from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.errors import FileError
from morphlet.io import _text
from morphlet.io._text import Text
from morphlet.io.content import COLOR_MAX, Attributes, Content, File, byte_colors, one_per_vertex, triangles
from morphlet.surface.mesh import Mesh

ENDINGS = (".obj",)
MAX_DIGITS = 18
"""Longest index: more digits do not fit 64 bits."""
COLOR_DECIMALS = 6
"""Decimals of a colour fraction; three would tell 256 steps apart."""
LINES = re.compile(rb"^[ \t]*(?:v|f|vt|vn|o|g|usemtl|mtllib|s)[ \t]", re.MULTILINE)
SLASH, MINUS, PLUS, ZERO = b"/-+0"
ENDS = re.compile(rb"\\\r?\n")
CONTINUED = re.compile(rb"^(?:[^\n#]*\\\r?\n)+[^\n]*", re.MULTILINE)
NORMAL_REFERENCE = re.compile(rb"(\d)/(-?\d*)/[+-]?\d+")


def recognises(data: bytes) -> bool:
    """Whether the bytes look like OBJ: text with lines that begin as its lines do."""
    return b"\0" not in data and LINES.search(data) is not None


def parse(file: File) -> Content:
    """The positions and triangles of an OBJ file."""
    text = _text.scan(_joined(_text.plain(file.data)))
    faces, lines = _faces(text)
    return Content(_values(text, b"v", 3)[:, :3], faces, lines)


def attributes(file: File) -> Attributes:
    """Vertex colours, and texture coordinates where every vertex has one pair only."""
    text = _text.scan(_joined(_text.plain(file.data)))
    table = _values(text, b"v", 3)
    colors = byte_colors(table[:, 3:6]) if table.shape[1] >= 6 else None
    return Attributes(colors, _uv(text, len(table)))


def render(mesh: Mesh, attributes: Attributes) -> bytes:
    """An OBJ file: every number in the fewest digits that give it back exactly."""
    rows = mesh.vertices
    if attributes.colors is not None:
        rows = np.hstack([rows, np.round(attributes.colors / COLOR_MAX, COLOR_DECIMALS)])
    parts = [_text.lettered(rows.tolist(), "v ")]
    faces = _text.lettered((mesh.faces + 1).tolist(), "f ")
    if attributes.uv is not None:
        parts.append(_text.lettered(np.asarray(attributes.uv, np.float64).tolist(), "vt "))
        faces = re.sub(r"(\d+)", r"\1/\1", faces)
    return "".join([*parts, faces]).encode("ascii")


def rewriter(file: File) -> Callable[[Mesh], bytes]:
    """Other positions in the same file: all else stays as it is.

    Normals are recomputed where each `vn` line belongs to one vertex and each vertex has one; otherwise they and the
    references to them are dropped (creases cannot be told from the positions).
    """
    lines = _joined(re.sub(rb"\r(?!\n)", b"\n", file.data)).split(b"\n")
    owner = _normal_owner(_text.scan(_joined(_text.plain(file.data))))
    if owner is None:
        lines = [_without_normal(line) for line in lines if not _is(line, b"vn")]
    places = [[k for k, line in enumerate(lines) if _is(line, key)] for key in (b"v", b"vn")]

    def rewritten(mesh: Mesh) -> bytes:
        renewed = lines.copy()
        _put(renewed, places[0], mesh.vertices)
        if owner is not None:
            _put(renewed, places[1], mesh.vertex_normals[owner])
        return b"\n".join(renewed)

    return rewritten


def _joined(data: bytes) -> bytes:
    """Continued lines in one, with as many newlines after it as it had within: later lines keep their numbers."""
    if b"\\" not in data:
        return data
    return CONTINUED.sub(lambda found: ENDS.sub(b" ", found[0]) + b"\n" * len(ENDS.findall(found[0])), data)


def _lines(text: Text, key: bytes) -> Bool[np.ndarray, "l"]:
    """Which lines begin with this word."""
    chosen = text.counts > 0
    start = text.starts[text.first[chosen]] if len(text.starts) else np.zeros(0, np.int64)
    room = start + len(key) < len(text.buffer)
    match = room.copy()
    for k, letter in enumerate(key):
        match[room] &= text.buffer[start[room] + k] == letter
    match[room] &= text.buffer[start[room] + len(key)] <= _text.SPACE
    chosen[chosen] = match
    return chosen


def _values(text: Text, key: bytes, least: int) -> Float[np.ndarray, "k d"]:
    """The numbers on the lines of a key: as many columns as the shortest of them has."""
    lines = _lines(text, key)
    counts = text.counts[lines] - 1
    short = np.flatnonzero(counts < least)
    if len(short):
        line = int(np.flatnonzero(lines)[short[0]]) + 1
        raise FileError(f"{least} numbers after '{key.decode()}'", f"{counts[short[0]]} on line {line}", "correct this line", [line])
    values = _text.numbers(text, _text.words(text, lines, 1))
    width = int(counts.min(initial=7))
    if np.all(counts == width):
        return values.reshape(-1, width)
    return values[(np.cumsum(counts) - counts)[:, None] + np.arange(width)]


def _faces(text: Text) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "m"] | None]:
    lines = _lines(text, b"f")
    vertex, _ = _corners(text, lines)
    return triangles(vertex, text.counts[lines] - 1, np.flatnonzero(lines) + 1)


def _corners(text: Text, lines: Bool[np.ndarray, "l"]) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "c"]]:
    """The position index (from 0) of each corner on the face lines, and where its digits end."""
    chosen = _text.words(text, lines, 1)
    value, stop = _integers(text.buffer, text.starts[chosen])
    after = text.buffer[stop]
    bad = np.flatnonzero((value == 0) | ((after != SLASH) & (after > _text.SPACE)))
    if len(bad):
        raise _text.unreadable(text, int(np.flatnonzero(chosen)[bad[0]]), "vertex indices from 1, or back from -1,")
    return _absolute(text, lines, value, b"v"), stop


def _absolute(text: Text, lines: Bool[np.ndarray, "l"], value: Int[np.ndarray, "c"], key: bytes) -> Int[np.ndarray, "c"]:
    """Indices from 0; negative ones count back from the elements above their line."""
    if not np.any(value < 0):
        return value - 1
    above = np.repeat(np.cumsum(_lines(text, key))[lines], text.counts[lines] - 1)
    return np.where(value < 0, np.where(above + value < 0, -1, above + value), value - 1)


def _integers(buffer: np.ndarray, start: Int[np.ndarray, "k"]) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """The signed integers that start at these places, 0 where none does, and where they end."""
    sign = buffer[start]
    stop = start + ((sign == MINUS) | (sign == PLUS))
    value = np.zeros(len(start), np.int64)
    for _ in range(MAX_DIGITS):
        digit = buffer[stop] - np.uint8(ZERO)
        going = digit < 10
        if not going.any():
            break
        value = np.where(going, 10 * value + digit, value)
        stop = stop + going
    return np.where(sign == MINUS, -value, value), stop


def _references(text: Text, lines: Bool[np.ndarray, "l"], slashes: int) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "c"]]:
    """Vertex index and raw index after one slash (`vt`) or two (`vn`) of each corner; 0 where there is none."""
    vertex, stop = _corners(text, lines)
    value = np.zeros(len(vertex), np.int64)
    for _ in range(slashes):
        more = text.buffer[stop] == SLASH
        value = np.zeros(len(vertex), np.int64)
        value[more], stop[more] = _integers(text.buffer, stop[more] + 1)
    return vertex, value


def _uv(text: Text, n: int) -> Float[np.ndarray, "n 2"] | None:
    lines = _lines(text, b"f")
    vertex, value = _references(text, lines, 1)
    table = _values(text, b"vt", 2)
    index = _absolute(text, lines, value, b"vt")
    if not len(table) or not np.all((value != 0) & (index >= 0) & (index < len(table))):
        return None
    return one_per_vertex(vertex, table[index, :2], n)


def _normal_owner(text: Text) -> Int[np.ndarray, "k"] | None:
    """The vertex each `vn` line belongs to; None unless every corner has a normal and vertices and normals go one to one."""
    lines = _lines(text, b"f")
    vertex, value = _references(text, lines, 2)
    index, n = _absolute(text, lines, value, b"vn"), int(_lines(text, b"vn").sum())
    pairs = np.unique(np.stack([vertex, index], axis=1), axis=0)
    paired = len(pairs) == n and np.array_equal(np.unique(pairs[:, 1]), np.arange(n)) and len(np.unique(pairs[:, 0])) == n
    return pairs[np.argsort(pairs[:, 1]), 0] if n and paired and np.all(value != 0) else None


def _is(line: bytes, key: bytes) -> bool:
    words = line.split(maxsplit=1)
    return bool(words) and words[0] == key


def _without_normal(line: bytes) -> bytes:
    """A face line without its references to normals: a/b/c becomes a/b, a//c becomes a."""
    return NORMAL_REFERENCE.sub(lambda m: m[1] + (b"/" + m[2] if m[2] else b""), line) if _is(line, b"f") else line


def _put(lines: list[bytes], places: list[int], rows: Float[np.ndarray, "k 3"]) -> None:
    """Replace the first three numbers of these lines; what follows them stays."""
    shown = _text.lettered(rows.tolist(), "").encode("ascii").split(b"\n")
    for place, numbers in zip(places, shown, strict=False):
        old = lines[place]
        found = re.match(rb"\s*\S+\s+\S+\s+\S+\s+[^\s#]+", old)
        lines[place] = old.split(maxsplit=1)[0] + b" " + numbers + (old[found.end() :] if found else b"")
