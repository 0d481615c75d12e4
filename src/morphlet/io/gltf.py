"""glTF 2 scenes, read as one static mesh in world coordinates: the triangles of all nodes, depth first in file order.

Vertices keep the order of their buffers; texture seams are split, as glTF stores them, and texture coordinates are turned to the lower
left origin of the other formats. Animation, skins and morph targets are stepped over (`gltf_shapes` reads the last). Written files are
binary (`.glb`), with positions in single precision.
"""

import copy
import re
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int, UInt8

from morphlet.errors import FileError
from morphlet.io.content import COLOR_MAX, Attributes, Content, File, byte_colors, renewed_normals, single, strip
from morphlet.io.gltf_scene import (
    MAGIC,
    SHOWN,
    STRIP,
    TRIANGLES,
    Piece,
    Scene,
    Tree,
    accessor,
    append,
    guarded,
    opened,
    packed,
    pieces_of,
    primitive_of,
    require_room,
)
from morphlet.surface.mesh import Mesh

ENDINGS = (".glb", ".gltf")
JSON_SCENE = re.compile(rb'\s*\{[\s\S]*"asset"')
ROUGHNESS = 0.8
"""Of written surfaces: without a material, viewers show metal."""
NORMAL_DECIMALS = 6
"""Decimals to which normals of one position count as one: single precision."""


def recognises(data: bytes) -> bool:
    """Whether the bytes are a binary glTF file, or JSON with the key every glTF file has."""
    return data.startswith(MAGIC) or JSON_SCENE.match(data) is not None


def parse(file: File) -> Content:
    """The triangles of all nodes, in world coordinates."""
    with guarded():
        scene = opened(file)
        return content_of(scene, list(pieces_of(scene.tree)))


def attributes(file: File) -> Attributes:
    """Vertex colours and texture coordinates, where every node has them."""
    with guarded():
        scene = opened(file)
        pieces = list(pieces_of(scene.tree))
        colors, uv = (_joined([_attribute(scene, piece, name) for piece in pieces]) for name in ("COLOR_0", "TEXCOORD_0"))
        upright = None if uv is None else np.stack([uv[:, 0], 1 - uv[:, 1]], axis=1)
        return Attributes(None if colors is None else byte_colors(_shown(colors[:, :3])), upright)


def render(mesh: Mesh, attributes: Attributes) -> bytes:
    """A binary glTF file with normals."""
    tree, buffer = still(mesh, attributes)
    return packed(tree, buffer)


def rewriter(file: File) -> Callable[[Mesh], bytes]:
    """Other positions in the same scene: all else stays; normals are recomputed if there are any; nodes get meshes of their own."""
    with guarded():
        scene = opened(file)
        pieces = list(pieces_of(scene.tree))
        _part(scene.tree, pieces)
        before = np.concatenate([geometry(scene, piece)[0] for piece in pieces])
        splits = np.cumsum([len(geometry(scene, piece)[0]) for piece in pieces])[:-1]
        normals = np.concatenate([_world_normals(scene, piece) for piece in pieces])
        inverses = [np.linalg.inv(piece.matrix) for piece in pieces]

    def rewritten(mesh: Mesh) -> bytes:
        tree, buffer = copy.deepcopy(scene.tree), bytearray(scene.buffer)
        positions, renewed = np.split(mesh.vertices, splits), np.split(renewed_normals(mesh, before, normals), splits)
        for piece, inverse, own, normal in zip(pieces, inverses, positions, renewed, strict=True):
            named = primitive_of(tree, piece)["attributes"]
            named["POSITION"] = append(tree, buffer, single(own @ inverse[:3, :3].T + inverse[:3, 3]))
            if "NORMAL" in named:
                named["NORMAL"] = append(tree, buffer, single(_turned(normal, inverse)))
        return packed(tree, buffer)

    return rewritten


def still(mesh: Mesh, attributes: Attributes) -> tuple[Tree, bytearray]:
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
        named["COLOR_0"] = single(np.insert(_light(attributes.colors), 3, 1.0, axis=1))
    if attributes.uv is not None:
        named["TEXCOORD_0"] = single(np.stack([attributes.uv[:, 0], 1 - attributes.uv[:, 1]], axis=1))
    primitive = {"attributes": {name: append(tree, buffer, values) for name, values in named.items()}, "material": 0}
    primitive["indices"] = append(tree, buffer, mesh.faces.astype("<u4").reshape(-1, 1))
    tree["meshes"] = [{"primitives": [primitive]}]
    return tree, buffer


def content_of(scene: Scene, pieces: list[Piece]) -> Content:
    """The triangles of all pieces, one after the other."""
    parts, numbers = list[tuple[np.ndarray, np.ndarray]](), 0
    for piece in pieces:
        parts.append(geometry(scene, piece))
        numbers += sum(part.size for part in parts[-1])
        require_room(scene, numbers, "triangles")
    if not parts:
        raise FileError("a scene with triangles", "none", "check that the file holds a mesh")
    before = np.cumsum([0, *(len(vertices) for vertices, _ in parts)])
    _check_ranges(parts)
    faces = [faces + start for (_, faces), start in zip(parts, before[:-1], strict=True)]
    return Content(np.concatenate([vertices for vertices, _ in parts]), np.concatenate(faces))


def geometry(scene: Scene, piece: Piece) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Positions in the world and triangles; those of a mirrored node are turned, so that their outside stays outside."""
    primitive = primitive_of(scene.tree, piece)
    if "KHR_draco_mesh_compression" in primitive.get("extensions", {}):
        raise FileError("a glTF scene without compression", "Draco", "export it without compression")
    local = accessor(scene, primitive["attributes"]["POSITION"])
    corners = accessor(scene, primitive["indices"])[:, 0].astype(np.int64) if "indices" in primitive else np.arange(len(local))
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
    """The rows of an attribute, one per vertex; None if the primitive has none."""
    named = primitive_of(scene.tree, piece)["attributes"]
    if name not in named:
        return None
    wanted, found = (scene.tree["accessors"][named[key]]["count"] for key in ("POSITION", name))
    if found != wanted:
        raise FileError(f"{wanted} rows of {name}, one per vertex", repr(found)[:SHOWN], "export the mesh again")
    return accessor(scene, named[name])


def _joined(parts: list[Float[np.ndarray, "n d"] | None]) -> Float[np.ndarray, "n d"] | None:
    """The rows of all parts; None if one has none."""
    found = [part for part in parts if part is not None]
    return np.concatenate(found) if found and len(found) == len(parts) else None


def _light(colors: UInt8[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Amounts of light of sRGB bytes (IEC 61966-2-1), which is what vertex colours are in this format."""
    share = colors / COLOR_MAX
    return np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)


def _shown(light: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The sRGB fractions of amounts of light (IEC 61966-2-1)."""
    share = np.clip(np.nan_to_num(light), 0, 1)
    return np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)


def _world_normals(scene: Scene, piece: Piece) -> Float[np.ndarray, "n 3"]:
    """The normals of a primitive in the world; zero if it has none."""
    normals = _attribute(scene, piece, "NORMAL")
    if normals is None:
        return np.zeros_like(geometry(scene, piece)[0])
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
