"""What a mesh file holds, before it becomes a `Mesh`.

Every format turns a `File` into a `Content` (positions and triangles in the file's indexing) and into `Attributes`
(what else each vertex carries). `mesh_of` is the one place where a content is checked and its faults are told in the
words of the file: line numbers where the format has lines, face indices where it has not.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from morphlet.errors import FileError, InputError
from morphlet.surface.mesh import Mesh, Topology

COLOR_MAX = 255
"""Largest value of a colour channel in one byte."""

RESTART = -1
"""Where a triangle strip ends and the next begins."""


@dataclass(frozen=True, eq=False)
class File:
    """The bytes of a file, and where they came from (glTF names further files beside itself)."""

    path: Path
    data: bytes


@dataclass(frozen=True, eq=False)
class Content:
    """Positions and triangles of a file; `lines` is the line each triangle stands on, where the format has lines."""

    vertices: Float[np.ndarray, "n 3"]
    faces: Int[np.ndarray, "m 3"]
    lines: Int[np.ndarray, "m"] | None = None


@dataclass(frozen=True, eq=False)
class Attributes:
    """What a file carries per vertex beside its position; None where it carries nothing, or nothing unambiguous."""

    colors: UInt8[np.ndarray, "n 3"] | None = None
    uv: Float[np.ndarray, "n 2"] | None = None


@dataclass(frozen=True, eq=False)
class Shapes:
    """The shapes that the mesh of a file goes through, and what each is called; `times` in seconds, where the file has them."""

    mesh: Mesh
    positions: Float[np.ndarray, "t n 3"]
    names: tuple[str, ...]
    times: Float[np.ndarray, "t"] | None = None


def mesh_of(content: Content) -> Mesh:
    """The mesh of a content, or a `FileError` that says what the file lacks."""
    if not len(content.vertices):
        raise FileError("vertices", "none", "check that this is a mesh file")
    if not len(content.faces):
        raise FileError("faces", f"{len(content.vertices)} vertices and no face with three corners", "export the mesh with its faces")
    try:
        return Mesh(content.vertices, Topology(content.faces, len(content.vertices)))
    except InputError as error:
        raise _fault(content, error) from error


def triangles(
    corners: Int[np.ndarray, "c"], sizes: Int[np.ndarray, "p"], lines: Int[np.ndarray, "p"] | None
) -> tuple[Int[np.ndarray, "m 3"], Int[np.ndarray, "m"] | None]:
    """Polygons as fans about their first corner, in file order, and their lines; a polygon below three corners has none."""
    if np.all(sizes == 3):
        return corners.reshape(-1, 3), lines
    fans = np.maximum(sizes - 2, 0)
    apex = np.repeat(np.cumsum(sizes) - sizes, fans)
    second = ragged(np.cumsum(sizes) - sizes + 1, fans)
    return corners[np.stack([apex, second, second + 1], axis=1)], None if lines is None else np.repeat(lines, fans)


def strip(corners: Int[np.ndarray, "c"]) -> Int[np.ndarray, "m 3"]:
    """Triangles of strips that end at -1: every three corners in a row, every second one turned, those with a repeated corner left out."""
    if len(corners) < 3:
        return np.zeros((0, 3), np.int64)
    place = np.arange(len(corners))
    begin = np.maximum.accumulate(np.where(corners == RESTART, place + 1, 0))
    windows = np.stack([corners[:-2], corners[1:-1], corners[2:]], axis=1)
    odd = (place - begin)[:-2] % 2 == 1
    windows[odd] = windows[odd][:, [1, 0, 2]]
    a, b, c = windows.T
    return windows[np.all(windows != RESTART, axis=1) & (a != b) & (b != c) & (c != a)]


def ragged(starts: Int[np.ndarray, "r"], sizes: Int[np.ndarray, "r"]) -> Int[np.ndarray, "t"]:
    """The indices starts[0], starts[0] + 1, ... (sizes[0] of them), then those of the next row."""
    return np.repeat(starts - np.cumsum(sizes) + sizes, sizes) + np.arange(int(np.sum(sizes)))


def whole(values: Float[np.ndarray, "k"], lines: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
    """Indices read as numbers, as integers; too large ones become -1, which no mesh has either."""
    broken = np.flatnonzero(values != np.floor(values))
    if len(broken):
        first = broken[0]
        raise FileError(f"whole numbers as indices on line {lines[first]}", f"{values[first]:g}", "correct this line", lines[broken])
    return np.where(np.abs(values) < np.iinfo(np.int32).max, values, -1).astype(np.int64)


def single(values: Float[np.ndarray, "k d"]) -> Float[np.ndarray, "k d"]:
    """The values in single precision; an `InputError` if one is too large for it."""
    with np.errstate(over="ignore"):
        rounded = values.astype("<f4")
    large = np.flatnonzero(~np.isfinite(rounded).all(axis=1))
    if len(large):
        raise InputError("numbers that fit single precision", f"{len(large)} rows with larger ones", "write .ply, .obj or .off", large)
    return rounded


def byte_colors(values: Float[np.ndarray, "n 3"]) -> UInt8[np.ndarray, "n 3"]:
    """Channels as bytes; values that are all within 0 and 1 are fractions."""
    known = np.nan_to_num(np.asarray(values, np.float64))
    scale = COLOR_MAX if known.max(initial=0.0) <= 1 else 1
    return np.clip(np.round(scale * known), 0, COLOR_MAX).astype(np.uint8)


def one_per_vertex(vertex: Int[np.ndarray, "c"], values: Float[np.ndarray, "c d"], n: int) -> Float[np.ndarray, "n d"] | None:
    """The value of each vertex if all its corners agree on it, else None; zero for vertices without corners."""
    table = np.zeros((n, values.shape[1]))
    table[vertex] = values
    return table if np.array_equal(table[vertex], values) else None


def renewed_normals(mesh: Mesh, positions: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Normals of `mesh`, where vertices of one position and normal before have one normal again: seams stay smooth, creases sharp."""
    keys = np.hstack([positions, normals]) + 0.0
    _, group = np.unique(keys, axis=0, return_inverse=True)
    group = group.ravel()
    corners = mesh.faces.ravel()
    vectors = np.repeat(mesh.face_normals * mesh.face_areas[:, None], 3, axis=0)
    total = np.stack([np.bincount(group[corners], v, group.max(initial=-1) + 1) for v in vectors.T], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.divide(total, length, out=np.zeros_like(total), where=length > 0)[group]


def _fault(content: Content, error: InputError) -> FileError:
    bad = np.nonzero(~np.isfinite(content.vertices).all(axis=1))[0]
    if len(bad):
        return FileError("finite coordinates", f"NaN or infinite ones at {len(bad)} vertices", "remove or replace them", bad)
    n = len(content.vertices)
    outside = np.nonzero(((content.faces < 0) | (content.faces >= n)).any(axis=1))[0]
    if len(outside):
        return _outside(content, outside, n)
    return FileError(error.needed, error.found, error.advice, error.elements)


def _outside(content: Content, faces: Int[np.ndarray, "k"], n: int) -> FileError:
    found = f"{len(faces)} faces with vertex indices outside 0 to {n - 1}"
    if content.lines is None:
        return FileError(f"faces of {n} vertices", f"{found}, by face index", "export the mesh again", faces)
    lines = content.lines[faces]
    return FileError(f"faces of {n} vertices", f"{found}, the first on line {lines[0]}", "correct these lines", np.unique(lines))
