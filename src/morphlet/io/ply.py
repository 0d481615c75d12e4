"""Polygon File Format: a header that names elements and their properties, then their rows, as text or binary.

Triangles come from `face` lists (polygons as fans) and from `tristrips` (strips end at -1; every second triangle of a strip is turned;
those with a repeated corner only join strips and are dropped). Any further elements and properties are stepped over.
"""

import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.errors import FileError
from morphlet.io import _text
from morphlet.io._text import Text
from morphlet.io.content import RESTART, Attributes, Content, File, byte_colors, ragged, renewed_normals, strip, triangles, whole
from morphlet.surface.mesh import Mesh

ENDINGS = (".ply",)
ORDERS = {b"ascii": "", b"binary_little_endian": "<", b"binary_big_endian": ">"}
KINDS = {
    kind.encode(): code
    for names, code in (
        ("char int8", "i1"),
        ("uchar uint8", "u1"),
        ("short int16", "i2"),
        ("ushort uint16", "u2"),
        ("int int32", "i4"),
        ("uint uint32", "u4"),
        ("float float32", "f4"),
        ("double float64", "f8"),
    )
    for kind in names.split()
}
INDEX_LISTS = ("vertex_indices", "vertex_index")
POSITION, NORMAL = ("x", "y", "z"), ("nx", "ny", "nz")
COLORS = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"), ("r", "g", "b"))
TEXTURES = (("s", "t"), ("u", "v"), ("texture_u", "texture_v"))
MOST_NAMES = 1000
"""Elements of a file, and properties of an element: files of today have some sixty, and each new name is compared with all before it."""
BLOCK_VALUES = 2**27
"""Most values of a row that is read as one numpy record, whose bytes must fit 31 bits."""

Column = tuple[np.ndarray, np.ndarray | None]
"""The values of a property over all rows, and for lists how many each row has."""
Table = dict[str, Column]


@dataclass(frozen=True)
class Property:
    """A number per row, or (with the type of its count) a list of them; types are numpy codes."""

    name: str
    kind: str
    count: str | None = None


@dataclass(frozen=True)
class Element:
    """So many rows of the same properties."""

    name: str
    count: int
    properties: tuple[Property, ...]


@dataclass(frozen=True, eq=False)
class Part:
    """The rows of an element, and the bytes (or, in a text file, lines) they take, from `start` to `stop`."""

    element: Element
    table: Table
    start: int
    stop: int
    lines: Int[np.ndarray, "r"] | None = None


@dataclass(frozen=True)
class Header:
    """Byte order (empty for text), elements in file order, and the length of the header in bytes."""

    order: str
    elements: tuple[Element, ...]
    length: int


def recognises(data: bytes) -> bool:
    """Whether the bytes begin as every PLY file does."""
    return re.match(rb"ply[ \t]*[\r\n]", data) is not None


def parse(file: File) -> Content:
    """The positions and triangles of a PLY file."""
    parts = {part.element.name: part for part in _parts(file.data)}
    if "vertex" not in parts:
        raise FileError("an element 'vertex' in the header", f"{', '.join(parts) or 'none'}", "check that this is a mesh")
    vertices = _columns(parts["vertex"], POSITION)
    if vertices is None:
        raise FileError("vertex properties x, y, z", ", ".join(parts["vertex"].table) or "none", "check that this is a mesh")
    pieces = [read(parts[name]) for name, read in (("face", _polygons), ("tristrips", _strips)) if name in parts]
    if len(pieces) == 1:
        return Content(vertices, *pieces[0])
    return Content(vertices, np.concatenate([np.zeros((0, 3), np.int64), *(faces for faces, _ in pieces)]))


def attributes(file: File) -> Attributes:
    """Vertex colours and texture coordinates."""
    part = next(part for part in _parts(file.data) if part.element.name == "vertex")
    colors = next((c for c in (_columns(part, names) for names in COLORS) if c is not None), None)
    uv = next((c for c in (_columns(part, names) for names in TEXTURES) if c is not None), None)
    return Attributes(None if colors is None else byte_colors(colors), uv)


def render(mesh: Mesh, attributes: Attributes) -> bytes:
    """A binary PLY file, little endian, with positions as double."""
    fields = [(name, "<f8", mesh.vertices[:, k]) for k, name in enumerate(POSITION)]
    if attributes.colors is not None:
        fields += [(name, "u1", attributes.colors[:, k]) for k, name in enumerate(COLORS[0])]
    if attributes.uv is not None:
        fields += [(name, "<f8", attributes.uv[:, k]) for k, name in enumerate(TEXTURES[0])]
    rows = np.empty(mesh.n_vertices, [(name, kind) for name, kind, _ in fields])
    for name, _, values in fields:
        rows[name] = values
    faces = np.empty(mesh.n_faces, [("count", "u1"), ("corners", "<i4", (3,))])
    faces["count"], faces["corners"] = 3, mesh.faces
    properties = "".join(f"property {'uchar' if kind == 'u1' else 'double'} {name}\n" for name, kind, _ in fields)
    header = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {mesh.n_vertices}\n{properties}"
        f"element face {mesh.n_faces}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    return header.encode("ascii") + rows.tobytes() + faces.tobytes()


def rewriter(file: File) -> Callable[[Mesh], bytes]:
    """Other positions, as double, in the same file; normals, if it has them, recomputed; all else stays as it is."""
    header = _header(file.data)
    part = next(part for part in _parts(file.data) if part.element.name == "vertex")
    if any(p.count for p in part.element.properties):
        raise FileError("vertices without list properties", "a list in the element 'vertex'", "write the mesh without a template")
    head = _promoted(file.data[: header.length])
    normals, positions = _columns(part, NORMAL), _columns(part, POSITION)
    rows = _rows_of_text if not header.order else _rows_of_bytes

    def rewritten(mesh: Mesh) -> bytes:
        values = dict(zip(POSITION, mesh.vertices.T, strict=True))
        if normals is not None and positions is not None:
            values |= dict(zip(NORMAL, renewed_normals(mesh, positions, normals).T, strict=True))
        return head + rows(file.data, header, part, values)

    return rewritten


def _header(data: bytes) -> Header:
    opening = re.match(rb"ply[ \t]*(\r\n|\r|\n)", data)
    if not opening:
        raise FileError("a file that begins with 'ply'", f"{data[:8]!r}", "check that this is a PLY file")
    end = re.compile(rb"[\r\n][ \t]*end_header[ \t]*(?:" + opening[1] + rb"|\Z)").search(data)
    if not end:
        raise FileError("the line 'end_header'", f"none in {len(data)} bytes", "the file is cut short; get it again")
    lines = [line.split() for line in re.split(rb"\r\n|\r|\n", data[: end.start()])]
    order, elements = "", list[Element]()
    for number, words in enumerate(lines, 1):
        try:
            order, elements = _after(words, order, elements)
        except (KeyError, IndexError, ValueError) as error:
            shown = b" ".join(words)[:60].decode("ascii", "backslashreplace")
            raise FileError(f"a PLY header on line {number}", f"'{shown}'", "export the mesh again") from error
    if not any(words[:1] == [b"format"] for words in lines):
        raise FileError("a line 'format' in the PLY header", "none", "export the mesh again")
    return Header(order, tuple(elements), end.end())


def _after(words: list[bytes], order: str, elements: list[Element]) -> tuple[str, list[Element]]:
    """Byte order and elements once this line is read."""
    match words[:1]:
        case [b"format"]:
            return ORDERS[words[1]], elements
        case [b"element"]:
            _new(words[1].decode(), [element.name for element in elements])
            return order, [*elements, Element(words[1].decode(), _count(words[2]), ())]
        case [b"property"]:
            last, own = elements[-1], _property(words[1:])
            _new(own.name, [prop.name for prop in last.properties])
            return order, [*elements[:-1], Element(last.name, last.count, (*last.properties, own))]
    return order, elements


def _new(name: str, taken: list[str]) -> None:
    if name in taken or len(taken) == MOST_NAMES:
        raise ValueError(name)


def _count(word: bytes) -> int:
    if not re.fullmatch(rb"\d{1,18}", word):
        raise ValueError(word)
    return int(word)


def _property(words: list[bytes]) -> Property:
    if words[0] == b"list":
        count = KINDS[words[1]]
        if count[0] == "f":
            raise ValueError(words[1])
        return Property(words[3].decode(), KINDS[words[2]], count)
    return Property(words[1].decode(), KINDS[words[0]])


def _parts(data: bytes) -> Iterator[Part]:
    """The elements one after another."""
    header = _header(data)
    if not header.order:
        yield from _text_parts(data, header)
        return
    start = header.length
    for element in header.elements:
        table, stop = _binary(data, start, element, header.order)
        yield Part(element, table, start, stop)
        start = stop


def _binary(data: bytes, start: int, element: Element, order: str) -> tuple[Table, int]:
    """Rows in one block if their lists are as long as those of the first row, one by one if not."""
    if not element.count or not element.properties:
        return {p.name: (np.zeros(0, order + p.kind), np.zeros(0, np.int64) if p.count else None) for p in element.properties}, start
    _, sizes, _ = _walk(data, start, Element(element.name, 1, element.properties), order)
    block = _block(data, start, element, (order, [size[0] for size in sizes]))
    if block is not None:
        return block
    begins, sizes, stop = _walk(data, start, element, order)
    table: Table = {}
    for prop, begin, size in zip(element.properties, begins, sizes, strict=True):
        places = ragged(np.array(begin), np.array(size) * np.dtype(prop.kind).itemsize)
        values = np.frombuffer(data, np.uint8)[places].view(order + prop.kind)
        table[prop.name] = values, np.array(size) if prop.count else None
    return table, stop


def _block(data: bytes, start: int, element: Element, layout: tuple[str, list[int]]) -> tuple[Table, int] | None:
    """All rows at once, if their lists have these sizes."""
    order, sizes = layout
    if sum(sizes) > BLOCK_VALUES:
        return None
    fields: list[tuple[str, str]] = []
    for k, (prop, size) in enumerate(zip(element.properties, sizes, strict=True)):
        fields += [(f"count {k}", order + prop.count)] if prop.count else []
        fields += [(f"values {k}", f"V{size * np.dtype(prop.kind).itemsize}" if prop.count else order + prop.kind)]
    row = np.dtype(fields)
    stop = start + element.count * row.itemsize
    if stop > len(data) and not any(prop.count for prop in element.properties):
        raise _truncated(element, stop - start, len(data) - start)
    if stop > len(data):
        return None
    rows = np.frombuffer(data, row, element.count, start)
    if any(prop.count and np.any(rows[f"count {k}"] != sizes[k]) for k, prop in enumerate(element.properties)):
        return None
    table: Table = {}
    for k, (prop, size) in enumerate(zip(element.properties, sizes, strict=True)):
        values = rows[f"values {k}"]
        listed = np.ascontiguousarray(values).view(order + prop.kind) if size else np.zeros(0, order + prop.kind)
        table[prop.name] = (listed, np.broadcast_to(size, len(rows))) if prop.count else (values, None)
    return table, stop


def _walk(data: bytes, start: int, element: Element, order: str) -> tuple[list[list[int]], list[list[int]], int]:
    """Where the values of each property begin and how many there are, row by row; the end."""
    steps = [(p.count, np.dtype(p.count or "u1").itemsize, np.dtype(p.kind).itemsize) for p in element.properties]
    begins: list[list[int]] = [[] for _ in steps]
    sizes: list[list[int]] = [[] for _ in steps]
    endian, at = "big" if order == ">" else "little", start
    for row in range(element.count):
        for k, (count, width, item) in enumerate(steps):
            size = 1
            if count:
                size = int.from_bytes(data[at : at + width], endian, signed=count[0] == "i")  # type: ignore[arg-type]
                at += width
            begins[k].append(at)
            sizes[k].append(size)
            at += size * item
            if size < 0 or at > len(data):
                raise _short_list(element, row, size, max(at - len(data), 0))
    return begins, sizes, at


def _truncated(element: Element, needed: int, found: int) -> FileError:
    return FileError(
        f"{needed} bytes for {element.count} rows of element '{element.name}'",
        f"{max(found, 0)}",
        "the file is cut short or its header is wrong; get it again",
    )


def _short_list(element: Element, row: int, size: int, missing: int) -> FileError:
    found = f"{missing} bytes too few" if missing else "a negative count"
    needed = f"{element.count} rows of element '{element.name}', of which row {row} has {size} values"
    return FileError(needed, found, "the file is cut short or its header is wrong; get it again", [row])


def _text_parts(data: bytes, header: Header) -> Iterator[Part]:
    """The elements of a text file; `start` and `stop` count lines with words after the header."""
    head = data[: header.length]
    blank = b"\n" * len(re.findall(rb"\r\n|\r|\n", head))
    text = _text.scan(blank + _text.ended_by_newlines(data[header.length :]))
    rows = np.flatnonzero(text.counts)
    start = 0
    for element in header.elements:
        stop = start + (element.count if element.properties else 0)
        if stop > len(rows):
            needed = f"{element.count} lines for element '{element.name}'"
            raise FileError(needed, f"{len(rows) - start}", "the file is cut short; get it again")
        yield Part(element, _text_table(text, rows[start:stop], element), start, stop, rows[start:stop] + 1)
        start = stop


def _text_table(text: Text, rows: Int[np.ndarray, "r"], element: Element) -> Table:
    chosen = np.zeros(len(text.counts), bool)
    chosen[rows] = True
    values, counts = _text.numbers(text, _text.words(text, chosen, 0)), text.counts[rows]
    at = np.cumsum(counts) - counts
    end = at + counts
    table: Table = {}
    for prop in element.properties:
        sizes = np.ones(len(rows), np.int64)
        if prop.count:
            _enough(at + 1, end, rows)
            sizes = whole(values[at], rows + 1)
            at = at + 1
        _enough(np.where(sizes < 0, end + 1, at + sizes), end, rows)
        table[prop.name] = values[ragged(at, sizes)], sizes if prop.count else None
        at = at + sizes
    return table


def _enough(wanted: Int[np.ndarray, "r"], end: Int[np.ndarray, "r"], rows: Int[np.ndarray, "r"]) -> None:
    short = rows[wanted > end] + 1
    if len(short):
        raise FileError(f"all properties of an element on line {short[0]}", "too few numbers", "correct this line", short)


def _columns(part: Part, names: tuple[str, ...]) -> Float[np.ndarray, "n d"] | None:
    """These properties side by side; None if one is missing."""
    if any(name not in part.table or part.table[name][1] is not None for name in names):
        return None
    return _side_by_side([part.table[name][0] for name in names])


def _side_by_side(columns: list[np.ndarray]) -> np.ndarray:
    """The columns as one array: a view, where they are neighbours in the rows of the file."""
    first = columns[0]
    places = [column.__array_interface__["data"][0] - k * first.itemsize for k, column in enumerate(columns)]
    if any(c.dtype != first.dtype or c.strides != first.strides for c in columns) or len(set(places)) > 1:
        return np.stack(columns, axis=1)
    return np.lib.stride_tricks.as_strided(first, (len(first), len(columns)), (first.strides[0], first.itemsize), writeable=False)


def _index_list(part: Part) -> tuple[Int[np.ndarray, "c"], Int[np.ndarray, "p"]]:
    for name in INDEX_LISTS:
        values, sizes = part.table.get(name, (None, None))
        if values is not None and sizes is not None:
            return _integers(part, values, sizes), sizes
    raise FileError(f"a list 'vertex_indices' in element '{part.element.name}'", ", ".join(part.table) or "none", "export the mesh again")


def _integers(part: Part, values: np.ndarray, sizes: Int[np.ndarray, "p"]) -> Int[np.ndarray, "c"]:
    if values.dtype.kind != "f":
        return values
    return whole(values, np.repeat(np.arange(len(sizes)) if part.lines is None else part.lines, sizes))


def _polygons(part: Part) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "m"] | None]:
    corners, sizes = _index_list(part)
    return triangles(corners, sizes, part.lines)


def _strips(part: Part) -> tuple[Int[np.ndarray, "m 3"], None]:
    """The triangles of the strips of all rows."""
    corners, sizes = _index_list(part)
    return strip(np.insert(corners.astype(np.int64), np.cumsum(sizes), RESTART)), None


def _promoted(head: bytes) -> bytes:
    """The header with positions of vertices as double."""
    before, keyword, after = re.split(rb"((?<![^\r\n])[ \t]*element\s+vertex\s)", head, maxsplit=1)
    own, *rest = re.split(rb"((?<![^\r\n])[ \t]*(?:element|end_header)\b)", after, maxsplit=1)
    own = re.sub(rb"((?<![^\r\n])[ \t]*property\s+)\w+(\s+[xyz]\s)", rb"\1double\2", own)
    return before + keyword + own + b"".join(rest)


def _rows_of_bytes(data: bytes, header: Header, part: Part, values: dict[str, np.ndarray]) -> bytes:
    kinds = [(p.name, header.order + ("f8" if p.name in POSITION else p.kind)) for p in part.element.properties]
    rows = np.empty(part.element.count, kinds)
    for prop in part.element.properties:
        rows[prop.name] = values.get(prop.name, part.table[prop.name][0])
    return data[header.length : part.start] + rows.tobytes() + data[part.stop :]


def _rows_of_text(data: bytes, header: Header, part: Part, values: dict[str, np.ndarray]) -> bytes:
    """The body line by line; the numbers of the changed properties replaced, the others as they were written."""
    lines = re.split(rb"\r\n|\r|\n", data[header.length :])
    filled = [k for k, line in enumerate(lines) if line.split()][part.start : part.stop]
    column = {p.name: k for k, p in enumerate(part.element.properties)}
    shown = {column[name]: [repr(v).encode() for v in column_values.tolist()] for name, column_values in values.items()}
    for row, place in enumerate(filled):
        words = lines[place].split()
        for k, texts in shown.items():
            words[k] = texts[row]
        lines[place] = b" ".join(words)
    return b"\n".join(lines)
