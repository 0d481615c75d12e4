"""What files say of each vertex of a mesh: colours and texture coordinates of the mesh file, arrays and columns of files beside it.

Real numbers may be interpolated between vertices. Whole numbers, truth values and texts are labels: between two of them there is nothing.
"""

import csv
import io
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Int, Shaped

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.io import _text, obj
from morphlet.io.content import triangles
from morphlet.io.formats import read_attributes
from morphlet.surface.mesh import Mesh
from morphlet.surface.points import SurfacePoints
from morphlet.surface.requirements import many

KIND, VERSION = "attributes", 1
RESERVED = ("kind", "version", "valid", "fingerprint", "file", "allow_pickle")
"""Names in an .npz file that are not those of attributes, and words of `numpy.savez`."""
OWN = ("color", "uv")
"""What a mesh file itself may hold."""
FILES = (".npy", ".npz", ".csv")
"""Endings of files with a row per vertex."""
IN_FILE = re.compile(r"(?P<path>.+\.(?:npy|npz|csv))(?::(?P<name>[^:/\\]+))?", re.IGNORECASE | re.DOTALL)
"""The name of such a file, and perhaps of one array or column in it."""
WHOLE = re.compile(r"[+-]?\d{1,18}")
"""A whole number that fits 64 bits."""
COLUMNS = {"color": ("red", "green", "blue"), "uv": ("u", "v")}
"""Names of their columns in a table."""
LISTED = 8
"""How many names a message lists."""


@dataclass(frozen=True, eq=False)
class Attribute:
    """Something that is known at the corners of a mesh's faces.

    Parameters
    ----------
    name
        What it is.
    values
        Rows of real numbers, or of labels: whole numbers, truth values, texts.
    rows
        Which row each corner of each face has: the faces of the mesh, where there is a row per vertex.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> from morphlet.io.attributes import Attribute
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> place = SurfacePoints([0], [[0.25, 0.75, 0.0]])
    >>> Attribute("weight", [0.0, 1.0, 5.0], mesh.faces).at(place), Attribute("bone", ["hip", "knee", "toe"], mesh.faces).at(place)
    (array([0.75]), array(['knee'], dtype='<U4'))
    """

    name: str
    values: Shaped[np.ndarray, "r *d"]
    rows: Int[np.ndarray, "m 3"]

    def __post_init__(self) -> None:
        values = np.array(self.values, order="C")
        if values.dtype.kind not in "biufU" or values.ndim not in (1, 2):
            found = f"{values.ndim} dimensions of type {values.dtype}"
            raise InputError(f"numbers or texts in one or two dimensions as {self.name}", found, "convert the array")
        if values.dtype.kind == "f":
            values = _arrays.real(values, self.name, (None,) * values.ndim)
        object.__setattr__(self, "values", _arrays.freeze(values))
        object.__setattr__(self, "rows", _arrays.index(self.rows, f"rows of {self.name}", (None, 3), len(values)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Attribute, (self.name, np.array(self.values), np.array(self.rows))

    @property
    def kind(self) -> Literal["real", "label"]:
        """Whether its values may be interpolated."""
        return "real" if self.values.dtype.kind == "f" else "label"

    @property
    def columns(self) -> int:
        """Numbers or labels per row."""
        return 1 if self.values.ndim == 1 else self.values.shape[1]

    def at(self, points: SurfacePoints) -> Shaped[np.ndarray, "k *d"]:
        """Its values at places on the mesh: interpolated, or those of the corner with the largest weight (of equal ones the first)."""
        corners = self.rows[points.faces]
        if self.kind == "real":
            return np.einsum("kc,kc...->k...", points.weights, self.values[corners])
        return self.values[corners[np.arange(len(corners)), np.argmax(points.weights, axis=1)]]


def read_own(path: str | os.PathLike[str], mesh: Mesh) -> dict[str, Attribute]:
    """What a mesh file itself says: `color`, three channels from 0 to 255, and `uv`, two coordinates.

    Parameters
    ----------
    path
        A mesh file.
    mesh
        The mesh in it.

    Returns
    -------
    dict
        What there is of both. An OBJ file may hold several texture coordinates at one vertex, on both sides of a seam: each face has its
        own there. In PLY and glTF files such vertices are split, so that each has one.

    Raises
    ------
    FileError
        If the file cannot be read.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet.io.attributes import read_own
    >>> from morphlet.io.formats import read
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "a.obj")
    ...     _ = file.write_text("v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nvt 0 0\\nvt 1 0\\nvt 0 1\\nf 1/1 2/2 3/3\\n")
    ...     read_own(file, read(file))["uv"].values.tolist()
    [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]
    """
    found = read_attributes(path)
    own: dict[str, Attribute] = {}
    if found.colors is not None:
        own["color"] = Attribute("color", found.colors.astype(np.float64), mesh.faces)
    if found.uv is not None:
        own["uv"] = Attribute("uv", np.asarray(found.uv, np.float64), mesh.faces)
    else:
        seamed = _seamed(Path(path))
        own |= {} if seamed is None else {"uv": seamed}
    return own


def _seamed(path: Path) -> Attribute | None:
    """Texture coordinates of an OBJ file whose seams split them; None of any other file, and where a corner has none."""
    data = path.read_bytes().removeprefix(_text.BOM)
    if path.suffix.lower() not in obj.ENDINGS or not obj.recognises(data):
        return None
    text = _text.scan(obj._joined(_text.plain(data)))
    lines, table = obj._lines(text, b"f"), obj._values(text, b"vt", 2)
    _, value = obj._references(text, lines, 1)
    index = obj._absolute(text, lines, value, b"vt")
    if not np.all((value != 0) & (index >= 0) & (index < len(table))):
        return None
    rows, _ = triangles(index, text.counts[lines] - 1, None)
    return Attribute("uv", table[:, :2], rows)


def read_columns(word: str, mesh: Mesh) -> list[Attribute]:
    """The arrays of a file that has a row for each vertex of a mesh.

    Parameters
    ----------
    word
        Name of an .npy, .npz or .csv file; `FILE:NAME` takes one array, or one column, of several.
    mesh
        The mesh they belong to.

    Returns
    -------
    list
        The array of an .npy file, under the file's stem; all arrays of an .npz file but scalars; all columns of a table, whose first line
        names them: whole numbers if all its cells are, else real numbers, else texts.

    Raises
    ------
    FileError
        If the file cannot be read, or is no such file.
    InputError
        If it does not have the array asked for, or an array has not one row per vertex.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh
    >>> from morphlet.io.attributes import read_columns
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "skin.csv")
    ...     _ = file.write_text("bone,weight\\nhip,1\\nhip,0.5\\nknee,0\\n")
    ...     [(found.name, found.kind) for found in read_columns(str(file), triangle)]
    [('bone', 'label'), ('weight', 'real')]
    """
    path, name = parted(word)
    arrays = _table(path) if path.suffix.lower() == ".csv" else _arrays_of(path)
    if name is not None and name not in arrays:
        raise InputError(f"an array of {path}: {listed(arrays)}", f"'{name}'", "name one of these, or none for all")
    chosen = arrays if name is None else {name: arrays[name]}
    wrong = {key: values.shape for key, values in chosen.items() if values.shape[:1] != (mesh.n_vertices,)}
    if wrong or not chosen:
        found = " and ".join(f"'{key}' of shape {shape}" for key, shape in list(wrong.items())[:2]) or "no array"
        advice = f"pass the values of this mesh, or name one array as in {path.name}:NAME ({listed(arrays)})"
        raise InputError(f"{many(mesh.n_vertices, 'row')}, one per vertex, in {path}", found, advice)
    return [Attribute(key, values, mesh.faces) for key, values in chosen.items()]


def parted(word: str) -> tuple[Path, str | None]:
    """The file that a word names, and the array in it if it names one; an `InputError` if it names none."""
    match = IN_FILE.fullmatch(word)
    if match is None:
        endings = " or ".join(FILES)
        raise InputError(f"{', '.join(OWN)} or a file ending in {endings} as attribute", f"'{word}'", "name one of these")
    return Path(match["path"]), match["name"]


def listed(names: dict[str, Any]) -> str:
    """Names in a message; `nothing` if there are none."""
    shown = list(names)[:LISTED]
    return ", ".join(shown) + (", ..." if len(names) > LISTED else "") or "nothing"


def save_arrays(
    path: str | os.PathLike[str], mesh: Mesh, arrays: dict[str, Shaped[np.ndarray, "n *d"]], valid: Bool[np.ndarray, "n"]
) -> None:
    """Write arrays with a row per vertex of a mesh to an .npz file, and which of the vertices have an answer of their own.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If an array has a name that the file needs itself.
    """
    taken = [name for name in arrays if name in RESERVED]
    if taken:
        raise InputError(f"names other than {', '.join(RESERVED)}", f"'{taken[0]}'", "write a .csv file, or rename the array")
    marks = {"valid": valid, "fingerprint": np.array(mesh.fingerprint)}
    _store.save(path, KIND, VERSION, arrays | marks)


def write_table(path: str | os.PathLike[str], arrays: dict[str, Shaped[np.ndarray, "n *d"]]) -> None:
    """Write arrays as the columns of a CSV file: what `read_columns` reads; truth values as 0 and 1.

    Raises
    ------
    FileError
        If the file cannot be written.
    InputError
        If two columns have the same name.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet.io.attributes import write_table
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "a.csv")
    ...     write_table(file, {"uv": np.eye(2), "part": np.array([3, 4])})
    ...     file.read_text()
    'u,v,part\\n1.0,0.0,3\\n0.0,1.0,4\\n'
    """
    columns: dict[str, list[Any]] = {}
    for name, values in arrays.items():
        table = (values.astype(np.int64) if values.dtype.kind == "b" else values).reshape(len(values), -1)
        plain = (name,) if values.ndim == 1 else tuple(f"{name}_{k}" for k in range(table.shape[1]))
        heads = COLUMNS.get(name, plain) if table.shape[1] == len(COLUMNS.get(name, plain)) else plain
        twice = columns.keys() & set(heads)
        if twice:
            raise InputError("columns with different names", f"'{min(twice)}' twice", "write an .npz file, or rename a column")
        columns |= dict(zip(heads, table.T.tolist(), strict=True))
    stream = io.StringIO(newline="")
    writer = csv.writer(stream, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC if _returns(arrays) else csv.QUOTE_MINIMAL)
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    with _store.beside(path) as temporary:
        temporary.write_bytes(stream.getvalue().encode("utf-8"))


def _returns(arrays: dict[str, np.ndarray]) -> bool:
    """Whether a text holds a carriage return: older Pythons leave these unquoted."""
    texts = [values for values in arrays.values() if values.dtype.kind == "U"]
    return any(bool(np.any(np.char.find(values, "\r") >= 0)) for values in texts) or any("\r" in name for name in arrays)


def _arrays_of(path: Path) -> dict[str, np.ndarray]:
    """The array of an .npy file, those of an .npz file but scalars."""
    found = _store.arrays_of(path, f"arrays of numbers or texts at {path}", "save them again with numpy.save or numpy.savez")
    return found if path.suffix.lower() == ".npy" else {name: values for name, values in found.items() if values.ndim}


def _table(path: Path) -> dict[str, np.ndarray]:
    """The columns of a CSV file."""
    try:
        text = _store.contents(path).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"a CSV file at {path}", reason, "check the path, and save it as UTF-8") from error
    reader = csv.reader(io.StringIO(text, newline=""))
    try:
        header = _header(path, next(reader, []))
        rows = [_of_length(row, len(header), f"on line {reader.line_num} of {path}") for row in reader if _filled(row)]
    except csv.Error as error:
        raise FileError(f"CSV on line {reader.line_num} of {path}", str(error), "correct this line") from error
    cells = zip(*rows, strict=True) if rows else [()] * len(header)
    return {
        name: _column([cell.strip() for cell in column], f"column {name} of {path}") for name, column in zip(header, cells, strict=True)
    }


def _header(path: Path, cells: list[str]) -> list[str]:
    """Names of the columns, each another; a first line of numbers is none."""
    names = [cell.strip() for cell in cells]
    if not names or not all(names) or len(set(names)) < len(names) or all(_number(name) is not None for name in names):
        needed = f"a first line with the names of the columns in {path}"
        raise FileError(needed, f"'{_text.printable(','.join(cells)[:60])}'", "put this line first, each name once")
    return names


def _filled(row: list[str]) -> bool:
    """Whether a line is more than blanks; an empty text in quotes is a cell."""
    return len(row) > 1 or bool(row and (not row[0] or row[0].strip()))


def _of_length(row: list[str], length: int, place: str) -> list[str]:
    if len(row) != length:
        raise FileError(f"{many(length, 'column')} {place}", str(len(row)), "correct this line")
    return row


def _column(cells: list[str], name: str) -> np.ndarray:
    """Whole numbers if all cells are, else real numbers, else texts; a column of numbers must have no empty cell."""
    if cells and all(WHOLE.fullmatch(cell) for cell in cells):
        return np.array([int(cell) for cell in cells], np.int64)
    numbers = [_number(cell) for cell in cells]
    if all(number is not None for number in numbers):
        return np.array(numbers, np.float64)
    empty = [k for k, cell in enumerate(cells) if not cell]
    if empty and len(empty) < len(cells) and all(number is not None or not cell for number, cell in zip(numbers, cells, strict=True)):
        raise FileError(f"a number in each row of {name}", f"{many(len(empty), 'empty cell')}", "fill them in", empty)
    return np.array(cells, np.str_)


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None
