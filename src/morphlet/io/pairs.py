"""Marker files: pairs of vertices as CSV.

The header is `source,target[,weight][,label]`; indices are 0-based vertices of the two meshes' files.
"""

import csv
import io
import math
import os
from pathlib import Path

import numpy as np

from morphlet import _store
from morphlet.errors import FileError
from morphlet.io import _text
from morphlet.surface.pairs import VertexPairs

REQUIRED = ("source", "target")
HEADERS = (REQUIRED, (*REQUIRED, "weight"), (*REQUIRED, "label"), (*REQUIRED, "weight", "label"))
MAX_INDEX = np.iinfo(np.int64).max - 1


def read_pairs(path: str | os.PathLike[str]) -> VertexPairs:
    """Read pairs of vertices.

    Parameters
    ----------
    path
        A CSV file in UTF-8 with the header `source,target[,weight][,label]`.

    Returns
    -------
    VertexPairs
        In file order; weight 1 and empty labels where the file has none. `checked` compares them with their meshes.

    Raises
    ------
    FileError
        If the file cannot be read, its header is another, or a line (named) does not hold indices from 0 and a positive weight.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet.io.pairs import read_pairs
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "markers.csv")
    ...     _ = file.write_text("source,target,label\\n7,12,nose\\n")
    ...     pairs = read_pairs(file)
    >>> pairs.source, pairs.target, pairs.labels
    (array([7]), array([12]), ('nose',))
    """
    reader = csv.reader(io.StringIO(_text_of(Path(path)), newline=""))
    try:
        header = _header(path, next(reader, []))
        rows = [_row(path, reader.line_num, header, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise FileError(f"CSV on line {reader.line_num} of {path}", str(error), "correct this line") from error
    return VertexPairs(
        np.array([row[0] for row in rows], np.int64),
        np.array([row[1] for row in rows], np.int64),
        np.array([row[2] for row in rows], np.float64),
        tuple(row[3] for row in rows),
    )


def write_pairs(path: str | os.PathLike[str], pairs: VertexPairs) -> None:
    """Write pairs of vertices; the columns for weights and labels only if a weight is not 1, a label not empty.

    Raises
    ------
    FileError
        If the file cannot be written.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import VertexPairs
    >>> from morphlet.io.pairs import write_pairs
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "markers.csv")
    ...     write_pairs(file, VertexPairs([7], [12], [0.5]))
    ...     file.read_text()
    'source,target,weight\\n7,12,0.5\\n'
    """
    columns: dict[str, list[object]] = {"source": pairs.source.tolist(), "target": pairs.target.tolist()}
    if pairs.weight is not None and np.any(pairs.weight != 1):
        columns["weight"] = pairs.weight.tolist()
    if any(pairs.labels):
        columns["label"] = list(pairs.labels)
    stream = io.StringIO(newline="")
    returns = any("\r" in label for label in pairs.labels)  # older Pythons leave these unquoted
    writer = csv.writer(stream, lineterminator="\n", quoting=csv.QUOTE_NONNUMERIC if returns else csv.QUOTE_MINIMAL)
    writer.writerow(columns)
    writer.writerows(zip(*columns.values(), strict=True))
    with _store.beside(path) as temporary:
        temporary.write_bytes(stream.getvalue().encode("utf-8"))


def _text_of(path: Path) -> str:
    try:
        return _store.contents(path).decode("utf-8-sig")
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"a CSV file of vertex pairs at {path}", reason, "check the path, and save it as UTF-8") from error


def _header(path: str | os.PathLike[str], cells: list[str]) -> tuple[str, ...]:
    header = tuple(cell.strip() for cell in cells)
    if header not in HEADERS:
        found = f"'{_text.printable(','.join(cells)[:60])}'"
        raise FileError(f"the header source,target[,weight][,label] in {path}", found, "put this line first")
    return header


def _row(path: str | os.PathLike[str], line: int, header: tuple[str, ...], cells: list[str]) -> tuple[int, int, float, str]:
    place = f"on line {line} of {path}"
    if len(cells) != len(header):
        raise FileError(f"{len(header)} columns {place}", str(len(cells)), "correct this line", [line])
    named = dict(zip(header, cells, strict=True))
    source, target = (_index(named[key], f"{key} {place}", line) for key in REQUIRED)
    return source, target, _weight(named.get("weight", "1"), f"weight {place}", line), named.get("label", "")


def _index(cell: str, name: str, line: int) -> int:
    text = cell.strip()
    if not (text.isascii() and text.isdigit() and len(text) < len(str(MAX_INDEX))):
        raise FileError(f"a vertex index from 0 as {name}", f"'{_text.printable(cell[:24])}'", "correct this line", [line])
    return int(text)


def _weight(cell: str, name: str, line: int) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise FileError(f"a positive number as {name}", f"'{_text.printable(cell[:24])}'", "correct this line", [line])
    return value
