"""The parts of a glTF 2 file: its JSON tree, its buffers joined into one, accessors in them, and the primitives that its nodes place.

What is damaged is a `FileError` within `guarded`. Trees and buffers grow by `append` and become a binary file by `packed`.
"""

import base64
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Shaped

from morphlet.errors import FileError
from morphlet.io.content import File

MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
KINDS = {5120: "i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TRIANGLES, STRIP, FAN = 4, 5, 6
ALIGNMENT = 4
"""Bytes to which chunks and accessors are padded."""
ROOM, TIMES = 1 << 26, 8
"""Numbers that a scene may unfold to: so many (512 MB), and so many more for each byte of its buffers. Nodes may share meshes, targets
accessors, keyframes targets: a small file can ask for all of the memory."""
SHOWN = 60
"""Letters of a name in a message."""

Tree = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Scene:
    """The JSON of a file, and its buffers joined into one."""

    tree: Tree
    buffer: bytes


@dataclass(frozen=True, eq=False)
class Piece:
    """One primitive of the mesh of one node, and how it is placed in the world."""

    node: int
    primitive: int
    matrix: Float[np.ndarray, "4 4"]


@contextmanager
def guarded() -> Iterator[None]:
    """JSON may hold anything anywhere: what does not fit is a `FileError`."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        found = f"{type(error).__name__}: {error}"
        raise FileError("a glTF 2 scene", found, "the file is damaged; export it again") from error


def opened(file: File) -> Scene:
    """The tree of a file, its buffers joined into one that every view points into."""
    text, binary = _chunks(file.data) if file.data.startswith(MAGIC) else (file.data, b"")
    tree: Tree = json.loads(text.decode("utf-8-sig"))
    buffer, starts, taken = bytearray(), list[tuple[int, int]](), set[Path]()
    for number, entry in enumerate(tree.get("buffers", [])):
        data = _buffer(entry, b"" if number else binary, file.path.parent, taken)
        starts.append((_pad(buffer), len(data)))
        buffer += data
    for view in tree.get("bufferViews", []):
        start, length = starts[view["buffer"]]
        first = view.get("byteOffset", 0)
        if not 0 <= first <= first + view["byteLength"] <= length:
            raise FileError(f"{first + view['byteLength']} bytes in a glTF buffer", str(length), "the file is damaged; get it again")
        view["byteOffset"], view["buffer"] = start + first, 0
    return Scene(tree, bytes(buffer))


def require_room(scene: Scene, numbers: int, what: str) -> None:
    """Refuse what would unfold to more than a file of this size may."""
    most = ROOM + TIMES * len(scene.buffer)
    if numbers > most:
        raise FileError(f"{what} of at most {most} numbers in a glTF file of its size", str(numbers), "export them apart")


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """The JSON and the binary chunk of a `.glb` file."""
    version, wanted = (int.from_bytes(data[k : k + 4], "little") for k in (4, 8))
    if version != VERSION:
        raise FileError(f"glTF version {VERSION}", str(version), "export it as glTF 2")
    if wanted > len(data) or len(data) < 12:
        raise FileError(f"{max(wanted, 12)} bytes of binary glTF", str(len(data)), "the file is cut short; get it again")
    chunks: dict[bytes, bytes] = {}
    at = 12
    while at + 8 <= len(data):
        length = int.from_bytes(data[at : at + 4], "little")
        chunks.setdefault(data[at + 4 : at + 8], data[at + 8 : at + 8 + length])
        at += 8 + length
    return chunks[JSON_CHUNK], chunks.get(BINARY_CHUNK, b"")


def _buffer(entry: Tree, binary: bytes, folder: Path, taken: set[Path]) -> bytes:
    """The bytes of a buffer: the binary chunk, a data URI, or a file in the same folder."""
    uri = entry.get("uri")
    if uri is None:
        data = binary
    else:
        data = base64.b64decode(uri.split(",", 1)[1]) if uri.startswith("data:") else _beside(folder, unquote(uri), taken)
    if len(data) < entry["byteLength"]:
        raise FileError(f"{entry['byteLength']} bytes in a glTF buffer", str(len(data)), "the file is cut short; get it again")
    return data[: entry["byteLength"]]


def _beside(folder: Path, name: str, taken: set[Path]) -> bytes:
    """A file in the folder or below it, wherever links lead, and each once."""
    try:
        place = (folder / name).resolve()
        if not place.is_relative_to(folder.resolve()):
            raise FileError("glTF buffers in the folder of the file", f"'{name[:SHOWN]}'", "move them there, or export a .glb")
        if place in taken or (place.exists() and not place.is_file()):
            raise FileError("files as glTF buffers, each once", f"'{name[:SHOWN]}'", "export a .glb")
        taken.add(place)
        return place.read_bytes()
    except (OSError, RuntimeError) as error:  # a ring of links is the one or the other
        if isinstance(error, FileError):
            raise
        reason = getattr(error, "strerror", None) or "a ring of links"
        raise FileError(f"the glTF buffer '{name[:SHOWN]}'", reason, "put it beside the file, or export a .glb") from error


def pieces_of(tree: Tree) -> Iterator[Piece]:
    """All triangle primitives, depth first in file order."""
    nodes = tree.get("nodes", [])
    children = {child for node in nodes for child in node.get("children", [])}
    free = [k for k in range(len(nodes)) if k not in children]
    roots = tree["scenes"][tree.get("scene", 0)].get("nodes", []) if tree.get("scenes") else free
    stack, seen = [(root, np.eye(4)) for root in reversed(roots)], set[int]()
    while stack:
        index, above = stack.pop()
        if index in seen or index < 0:
            raise ValueError(f"node {index} has two parents")
        seen.add(index)
        node, matrix = nodes[index], above @ _matrix(nodes[index])
        stack += [(child, matrix) for child in reversed(node.get("children", []))]
        primitives = tree["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []
        yield from (Piece(index, k, matrix) for k, p in enumerate(primitives) if p.get("mode", TRIANGLES) in (TRIANGLES, STRIP, FAN))


def _matrix(node: Tree) -> Float[np.ndarray, "4 4"]:
    from scipy.spatial.transform import Rotation

    if "matrix" in node:
        return np.array(node["matrix"], np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    turn = Rotation.from_quat(node["rotation"]).as_matrix() if "rotation" in node else np.eye(3)
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]), np.float64).reshape(1, 3)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def primitive_of(tree: Tree, piece: Piece) -> Tree:
    """The entry of a piece in the tree."""
    return tree["meshes"][tree["nodes"][piece.node]["mesh"]]["primitives"][piece.primitive]


def accessor(scene: Scene, index: int) -> Float[np.ndarray, "k d"]:
    """The values of an accessor, as double; normalised integers as fractions."""
    entry = scene.tree["accessors"][index]
    kind, shape = np.dtype(KINDS[entry["componentType"]]), (entry["count"], WIDTHS[entry["type"]])
    raw = _stored(scene, entry, kind, shape) if "bufferView" in entry else _zeros(scene, shape)
    with np.errstate(invalid="ignore"):  # a NaN that signals
        values = raw.astype(np.float64)
    if "sparse" in entry:
        _put_sparse(scene, entry["sparse"], kind, values)
    return np.maximum(values / np.iinfo(kind).max, -1) if entry.get("normalized") and kind.kind in "iu" else values


def _stored(scene: Scene, entry: Tree, kind: np.dtype, shape: tuple[int, int]) -> Shaped[np.ndarray, "k d"]:
    """The numbers that an entry points to in the buffer."""
    view = scene.tree["bufferViews"][entry["bufferView"]]
    if view.get("extensions"):
        raise FileError("a glTF scene without compression", "compressed data", "export it without compression")
    count, width = shape
    stride = view.get("byteStride", kind.itemsize * width)
    start = view["byteOffset"] + entry.get("byteOffset", 0)
    stop = start + max(count - 1, 0) * stride + kind.itemsize * width
    end = view["byteOffset"] + view["byteLength"]
    if stop > end or stride < kind.itemsize * width:
        raise FileError(f"{stop} bytes in the glTF buffers", str(end), "the file is damaged; get it again")
    return np.ndarray(shape, kind, scene.buffer, start, (stride, kind.itemsize))


def _zeros(scene: Scene, shape: tuple[int, int]) -> Float[np.ndarray, "k d"]:
    """What an accessor without data holds; no more rows than the file has bytes, which some index in it must name."""
    if shape[0] > len(scene.buffer):
        raise FileError(
            f"at most {len(scene.buffer)} rows without data in a glTF scene", str(shape[0]), "the file is damaged; get it again"
        )
    return np.zeros(shape)


def _put_sparse(scene: Scene, entry: Tree, kind: np.dtype, values: Float[np.ndarray, "k d"]) -> None:
    """Put the values of a sparse accessor in their rows."""
    places, rows = entry["indices"], (entry["count"], values.shape[1])
    at = _stored(scene, places, np.dtype(KINDS[places["componentType"]]), (entry["count"], 1))[:, 0].astype(np.int64)
    outside = np.flatnonzero((at < 0) | (at >= len(values)))
    if len(outside):
        raise FileError(f"sparse indices below {len(values)}", f"{len(outside)} others", "export the mesh again", at[outside])
    values[at] = _stored(scene, entry["values"], kind, rows)


def append(tree: Tree, buffer: bytearray, values: np.ndarray) -> int:
    """Add an accessor with these values; its index."""
    start = _pad(buffer)
    data = np.ascontiguousarray(values).tobytes()
    buffer += data
    views, accessors = tree.setdefault("bufferViews", []), tree.setdefault("accessors", [])
    views.append({"buffer": 0, "byteOffset": start, "byteLength": len(data)})
    component = next(code for code, kind in KINDS.items() if np.dtype(kind) == values.dtype)
    shape = next(name for name, width in WIDTHS.items() if width == values.shape[1])
    entry = {"bufferView": len(views) - 1, "componentType": component, "count": len(values), "type": shape}
    if values.dtype.kind == "f":
        entry |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
    accessors.append(entry)
    return len(accessors) - 1


def _pad(buffer: bytearray) -> int:
    """Pad to the alignment; the length."""
    buffer += bytes(-len(buffer) % ALIGNMENT)
    return len(buffer)


def packed(tree: Tree, buffer: bytearray) -> bytes:
    """The bytes of a binary glTF file."""
    tree["buffers"] = [{"byteLength": _pad(buffer)}]
    text = json.dumps(tree, separators=(",", ":")).encode("utf-8")
    text += b" " * (-len(text) % ALIGNMENT)
    chunks = [len(chunk).to_bytes(4, "little") + kind + chunk for kind, chunk in ((JSON_CHUNK, text), (BINARY_CHUNK, bytes(buffer)))]
    length = 12 + sum(len(chunk) for chunk in chunks)
    return MAGIC + VERSION.to_bytes(4, "little") + length.to_bytes(4, "little") + b"".join(chunks)
