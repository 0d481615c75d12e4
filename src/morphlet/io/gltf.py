"""glTF 2 scenes, read as one static mesh in world coordinates: the triangles of all nodes, depth first in file order.

Vertices keep the order of their buffers; texture seams are split, as glTF stores them, and texture coordinates are turned to the lower
left origin of the other formats. Animation, skins and morph targets are stepped over. Written files are binary (`.glb`), with positions
in single precision.
"""

import base64
import copy
import json
import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Float, Int

from morphlet.errors import FileError
from morphlet.io.content import COLOR_MAX, Attributes, Content, File, byte_colors, renewed_normals, single, strip
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

ENDINGS = (".glb", ".gltf")
MAGIC, VERSION = b"glTF", 2
JSON_CHUNK, BINARY_CHUNK = b"JSON", b"BIN\0"
JSON_SCENE = re.compile(rb'\s*\{[\s\S]*"asset"')
KINDS = {5120: "i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
TRIANGLES, STRIP, FAN = 4, 5, 6
ROUGHNESS = 0.8
"""Of written surfaces: without a material, viewers show metal."""
NORMAL_DECIMALS = 6
"""Decimals to which normals of one position count as one: single precision."""
ALIGNMENT = 4
"""Bytes to which chunks and accessors are padded."""

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


def recognises(data: bytes) -> bool:
    """Whether the bytes are a binary glTF file, or JSON with the key every glTF file has."""
    return data.startswith(MAGIC) or JSON_SCENE.match(data) is not None


def parse(file: File) -> Content:
    """The triangles of all nodes, in world coordinates."""
    with _guarded():
        scene = _scene(file)
        pieces = [_geometry(scene, piece) for piece in _pieces(scene.tree)]
    if not pieces:
        raise FileError("a scene with triangles", "none", "check that the file holds a mesh")
    before = np.cumsum([0, *(len(vertices) for vertices, _ in pieces)])
    _check_ranges(pieces)
    faces = [faces + start for (_, faces), start in zip(pieces, before[:-1], strict=True)]
    return Content(np.concatenate([vertices for vertices, _ in pieces]), np.concatenate(faces))


def attributes(file: File) -> Attributes:
    """Vertex colours and texture coordinates, where every node has them."""
    with _guarded():
        scene = _scene(file)
        pieces = list(_pieces(scene.tree))
        colors, uv = (_joined([_attribute(scene, piece, name) for piece in pieces]) for name in ("COLOR_0", "TEXCOORD_0"))
        upright = None if uv is None else np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
        return Attributes(None if colors is None else byte_colors(colors[:, :3]), upright)


def render(mesh: Mesh, attributes: Attributes) -> bytes:
    """A binary glTF file with normals."""
    tree, buffer = _still(mesh, attributes)
    return _packed(tree, buffer)


def animated(sequence: MeshSequence, attributes: Attributes, duration: float) -> bytes:
    """A binary glTF file that shows the first frame and plays all of them: a morph target for each further one, with its normals."""
    tree, buffer = _still(sequence[0], attributes)
    rest, count = sequence[0], len(sequence) - 1
    targets = []
    for k in range(1, len(sequence)):
        apart = {"POSITION": (rest.vertices, sequence[k].vertices), "NORMAL": (rest.vertex_normals, sequence[k].vertex_normals)}
        targets.append({name: _append(tree, buffer, single(after) - single(before)) for name, (before, after) in apart.items()})
    tree["meshes"][0]["primitives"][0]["targets"] = targets
    tree["meshes"][0]["weights"] = [0.0] * count
    times = duration * (sequence.times - sequence.times[0]) / (sequence.times[-1] - sequence.times[0])
    input, output = (_append(tree, buffer, single(values)) for values in (times[:, None], np.eye(count + 1)[:, 1:].reshape(-1, 1)))
    sampler = {"input": input, "output": output, "interpolation": "LINEAR"}
    tree["animations"] = [{"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}]
    return _packed(tree, buffer)


def _still(mesh: Mesh, attributes: Attributes) -> tuple[Tree, bytearray]:
    """The scene of one mesh, with normals, and its buffer."""
    tree: Tree = {
        "asset": {"version": "2.0", "generator": "morphlet"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "materials": [{"pbrMetallicRoughness": {"metallicFactor": 0, "roughnessFactor": ROUGHNESS}}],
    }
    buffer = bytearray()
    named = {"POSITION": single(mesh.vertices), "NORMAL": single(mesh.vertex_normals)}
    if attributes.colors is not None:
        named["COLOR_0"] = np.insert(attributes.colors, 3, COLOR_MAX, axis=1)
    if attributes.uv is not None:
        named["TEXCOORD_0"] = single(np.stack([attributes.uv[:, 0], 1 - attributes.uv[:, 1]], axis=1))
    primitive = {"attributes": {name: _append(tree, buffer, values) for name, values in named.items()}, "material": 0}
    primitive["indices"] = _append(tree, buffer, mesh.faces.astype("<u4").reshape(-1, 1))
    tree["meshes"] = [{"primitives": [primitive]}]
    return tree, buffer


def rewriter(file: File) -> Callable[[Mesh], bytes]:
    """Other positions in the same scene: all else stays; normals are recomputed if there are any; nodes get meshes of their own."""
    with _guarded():
        scene = _scene(file)
        pieces = list(_pieces(scene.tree))
        _part(scene.tree, pieces)
        before = np.concatenate([_geometry(scene, piece)[0] for piece in pieces])
        splits = np.cumsum([len(_geometry(scene, piece)[0]) for piece in pieces])[:-1]
        normals = np.concatenate([_world_normals(scene, piece) for piece in pieces])
        inverses = [np.linalg.inv(piece.matrix) for piece in pieces]

    def rewritten(mesh: Mesh) -> bytes:
        tree, buffer = copy.deepcopy(scene.tree), bytearray(scene.buffer)
        positions, renewed = np.split(mesh.vertices, splits), np.split(renewed_normals(mesh, before, normals), splits)
        for piece, inverse, own, normal in zip(pieces, inverses, positions, renewed, strict=True):
            named = _primitive(tree, piece)["attributes"]
            named["POSITION"] = _append(tree, buffer, single(own @ inverse[:3, :3].T + inverse[:3, 3]))
            if "NORMAL" in named:
                named["NORMAL"] = _append(tree, buffer, single(_turned(normal, inverse)))
        return _packed(tree, buffer)

    return rewritten


@contextmanager
def _guarded() -> Iterator[None]:
    """JSON may hold anything anywhere: what does not fit is a `FileError`."""
    try:
        yield
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, OverflowError, RecursionError) as error:
        found = f"{type(error).__name__}: {error}"
        raise FileError("a glTF 2 scene", found, "the file is damaged; export it again") from error


def _scene(file: File) -> Scene:
    text, binary = _chunks(file.data) if file.data.startswith(MAGIC) else (file.data, b"")
    tree: Tree = json.loads(text.decode("utf-8-sig"))
    buffer = bytearray()
    starts = []
    for entry in tree.get("buffers", []):
        starts.append(_pad(buffer))
        buffer += _buffer(entry, binary, file.path.parent)
    for view in tree.get("bufferViews", []):
        view["byteOffset"] = starts[view["buffer"]] + view.get("byteOffset", 0)
        view["buffer"] = 0
    return Scene(tree, bytes(buffer))


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


def _buffer(entry: Tree, binary: bytes, folder: Path) -> bytes:
    """The bytes of a buffer: the binary chunk, a data URI, or a file in the same folder."""
    uri = entry.get("uri")
    data = binary if uri is None else base64.b64decode(uri.split(",", 1)[1]) if uri.startswith("data:") else _beside(folder, unquote(uri))
    if len(data) < entry["byteLength"]:
        raise FileError(f"{entry['byteLength']} bytes in a glTF buffer", str(len(data)), "the file is cut short; get it again")
    return data[: entry["byteLength"]]


def _beside(folder: Path, name: str) -> bytes:
    place = (folder / name).resolve()
    if not place.is_relative_to(folder.resolve()):
        raise FileError("glTF buffers in the folder of the file", f"'{name}'", "move them there, or export a .glb")
    try:
        return place.read_bytes()
    except OSError as error:
        raise FileError(f"the glTF buffer '{name}'", error.strerror or str(error), "put it beside the file, or export a .glb") from error


def _pieces(tree: Tree) -> Iterator[Piece]:
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
    turn = Rotation.from_quat(node.get("rotation", [0, 0, 0, 1])).as_matrix()
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]), np.float64).reshape(1, 3)
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def _primitive(tree: Tree, piece: Piece) -> Tree:
    return tree["meshes"][tree["nodes"][piece.node]["mesh"]]["primitives"][piece.primitive]


def _geometry(scene: Scene, piece: Piece) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Positions in the world and triangles; those of a mirrored node are turned, so that their outside stays outside."""
    primitive = _primitive(scene.tree, piece)
    if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
        raise FileError("a glTF scene without compression", "Draco", "export it without compression")
    local = _accessor(scene, primitive["attributes"]["POSITION"])
    corners = _accessor(scene, primitive["indices"])[:, 0].astype(np.int64) if "indices" in primitive else np.arange(len(local))
    faces = _triangles(corners, primitive.get("mode", TRIANGLES))
    linear = piece.matrix[:3, :3]
    return local @ linear.T + piece.matrix[:3, 3], faces[:, [0, 2, 1]] if np.linalg.det(linear) < 0 else faces


def _triangles(corners: Int[np.ndarray, "c"], mode: int) -> Int[np.ndarray, "m 3"]:
    if mode == TRIANGLES:
        return corners.reshape(-1, 3)
    if mode == STRIP:
        return strip(corners)
    return np.stack([np.full(max(len(corners) - 2, 0), corners[0]), corners[1:-1], corners[2:]], axis=1)


def _check_ranges(pieces: list[tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]]) -> None:
    """Each primitive must stay within its own vertices."""
    for number, (vertices, faces) in enumerate(pieces):
        outside = np.flatnonzero((faces >= len(vertices)).any(axis=1))
        if len(outside):
            needed = f"faces of {len(vertices)} vertices in primitive {number}"
            raise FileError(needed, f"{len(outside)} with larger indices", "export the mesh again", outside)


def _attribute(scene: Scene, piece: Piece, name: str) -> Float[np.ndarray, "n d"] | None:
    named = _primitive(scene.tree, piece)["attributes"]
    return _accessor(scene, named[name]) if name in named else None


def _joined(parts: list[Float[np.ndarray, "n d"] | None]) -> Float[np.ndarray, "n d"] | None:
    """The rows of all parts; None if one has none."""
    found = [part for part in parts if part is not None]
    return np.concatenate(found) if found and len(found) == len(parts) else None


def _accessor(scene: Scene, index: int) -> Float[np.ndarray, "k d"]:
    """The values of an accessor, as double; normalised integers as fractions."""
    entry = scene.tree["accessors"][index]
    view = scene.tree["bufferViews"][entry["bufferView"]]
    if "sparse" in entry or view.get("extensions"):
        raise FileError("a glTF scene without compression", "sparse or compressed data", "export it without compression")
    kind, width, count = np.dtype(KINDS[entry["componentType"]]), WIDTHS[entry["type"]], entry["count"]
    stride = view.get("byteStride", kind.itemsize * width)
    start = view["byteOffset"] + entry.get("byteOffset", 0)
    stop = start + max(count - 1, 0) * stride + kind.itemsize * width
    if stop > len(scene.buffer) or stride < kind.itemsize * width:
        raise FileError(f"{stop} bytes in the glTF buffers", str(len(scene.buffer)), "the file is damaged; get it again")
    values = np.ndarray((count, width), kind, scene.buffer, start, (stride, kind.itemsize)).astype(np.float64)
    return np.maximum(values / np.iinfo(kind).max, -1) if entry.get("normalized") and kind.kind in "iu" else values


def _world_normals(scene: Scene, piece: Piece) -> Float[np.ndarray, "n 3"]:
    """The normals of a primitive in the world; zero if it has none."""
    normals = _attribute(scene, piece, "NORMAL")
    if normals is None:
        return np.zeros_like(_geometry(scene, piece)[0])
    return np.round(_turned(normals, piece.matrix), NORMAL_DECIMALS)


def _turned(normals: Float[np.ndarray, "n 3"], matrix: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "n 3"]:
    """Unit normals after a linear map: by its inverse transposed."""
    turned = normals @ np.linalg.inv(matrix[:3, :3])
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    return np.divide(turned, length, out=np.zeros_like(turned), where=length > 0)


def _part(tree: Tree, pieces: list[Piece]) -> None:
    """Give every node a mesh of its own."""
    taken = set[int]()
    for index in dict.fromkeys(piece.node for piece in pieces):
        node = tree["nodes"][index]
        if node["mesh"] in taken:
            tree["meshes"].append(copy.deepcopy(tree["meshes"][node["mesh"]]))
            node["mesh"] = len(tree["meshes"]) - 1
        taken.add(node["mesh"])


def _append(tree: Tree, buffer: bytearray, values: np.ndarray) -> int:
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
    accessors.append(entry | ({"normalized": True} if values.dtype == np.uint8 else {}))
    return len(accessors) - 1


def _pad(buffer: bytearray) -> int:
    """Pad to the alignment; the length."""
    buffer += bytes(-len(buffer) % ALIGNMENT)
    return len(buffer)


def _packed(tree: Tree, buffer: bytearray) -> bytes:
    tree["buffers"] = [{"byteLength": _pad(buffer)}]
    text = json.dumps(tree, separators=(",", ":")).encode("utf-8")
    text += b" " * (-len(text) % ALIGNMENT)
    chunks = [len(chunk).to_bytes(4, "little") + kind + chunk for kind, chunk in ((JSON_CHUNK, text), (BINARY_CHUNK, bytes(buffer)))]
    length = 12 + sum(len(chunk) for chunk in chunks)
    return MAGIC + VERSION.to_bytes(4, "little") + length.to_bytes(4, "little") + b"".join(chunks)
