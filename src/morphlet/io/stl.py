"""STL: triangles by their corners' positions, text or binary.

An STL file has no indexing: corners at exactly the same position become one vertex, in order of first appearance. Positions are
single precision in binary files, and normals are ignored.
"""

import re

import numpy as np

from morphlet.errors import FileError
from morphlet.io import _text
from morphlet.io.content import Attributes, Content, File, single
from morphlet.surface.mesh import Mesh

ENDINGS = (".stl",)
HEAD = 80
"""Bytes of free text before the count of a binary file."""
TRIANGLE = np.dtype([("normal", "<f4", (3,)), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
FACET = re.compile(rb"\s*solid\b[\s\S]{0,4096}?(?:\bfacet\s+normal|\bendsolid)", re.IGNORECASE)


def recognises(data: bytes) -> bool:
    """Whether the length is that of a binary file, or the words are those of a text file."""
    return is_binary(data) or FACET.match(data) is not None


def parse(file: File) -> Content:
    """The triangles of an STL file, corners at one position merged."""
    data = file.data
    corners = _text_corners(data) if FACET.match(data) and not is_binary(data) else _binary_corners(data)
    _, first, inverse = np.unique(corners + 0.0, axis=0, return_index=True, return_inverse=True)
    rank = np.argsort(np.argsort(first))
    return Content(corners[np.sort(first)], rank[inverse.ravel()].reshape(-1, 3))


def attributes(file: File) -> Attributes:
    """Nothing: merged corners carry nothing of their own."""
    return Attributes()


def render(mesh: Mesh, attributes: Attributes) -> bytes:
    """A binary STL file of the geometry alone, in single precision."""
    rows = np.zeros(mesh.n_faces, TRIANGLE)
    rows["normal"], rows["corners"] = mesh.face_normals, single(mesh.vertices)[mesh.faces]
    return b"binary STL".ljust(HEAD) + np.uint32(mesh.n_faces).astype("<u4").tobytes() + rows.tobytes()


def is_binary(data: bytes) -> bool:
    """Whether the length is that of a binary file."""
    return len(data) > HEAD + 4 and len(data) == _wanted(data)


def _wanted(data: bytes) -> int:
    return HEAD + 4 + TRIANGLE.itemsize * int.from_bytes(data[HEAD : HEAD + 4], "little")


def _binary_corners(data: bytes) -> np.ndarray:
    if len(data) < HEAD + 4 or len(data) < _wanted(data):
        needed = f"{_wanted(data)} bytes" if len(data) >= HEAD + 4 else f"a header of {HEAD + 4} bytes"
        raise FileError(f"{needed} of binary STL", f"{len(data)}", "the file is cut short, or no STL; get it again")
    if len(data) > _wanted(data):
        found = f"{len(data)}: bytes were put in, or its count is wrong"
        raise FileError(f"{_wanted(data)} bytes of binary STL", found, "the file is damaged, or no STL; get it again")
    count = int.from_bytes(data[HEAD : HEAD + 4], "little")
    return np.frombuffer(data, TRIANGLE, count, HEAD + 4)["corners"].reshape(-1, 3).astype(np.float64)


def _text_corners(data: bytes) -> np.ndarray:
    """The numbers after each `vertex`; three of them a facet."""
    found = re.findall(rb"^[ \t]*vertex\b([^\n]*)", _text.plain(data).replace(b"#", b""), re.MULTILINE | re.IGNORECASE)
    text = _text.scan(b"\n".join(found))
    if np.any(text.counts[: len(found)] != 3) or len(found) % 3:
        raise FileError("three corners of three numbers per facet", f"{len(found)} corners", "the file is cut short; get it again")
    return _text.numbers(text, np.ones(len(text.starts), bool)).reshape(-1, 3)
