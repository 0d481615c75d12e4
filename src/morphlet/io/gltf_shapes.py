"""Morph targets of glTF scenes, and the animations that blend them: the shapes that one mesh goes through.

A scene whose weights are animated has a shape per keyframe, with its time in seconds; any other one its rest shape and one shape per
target. Targets of one name move together, whichever node they belong to. Positions are in world coordinates.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.sparse import csr_array

from morphlet.errors import FileError
from morphlet.io.content import Attributes, File, Shapes, mesh_of, single
from morphlet.io.gltf import content_of, still
from morphlet.io.gltf_scene import (
    SHOWN,
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
from morphlet.surface.sequence import MeshSequence

UNMOVED = {"translation": (0, 0, 0), "rotation": (0, 0, 0, 1), "scale": (1, 1, 1)}
"""Properties of nodes that an animation may change, and their values where a node does not say."""
PARTS = {"LINEAR": 1, "STEP": 1, "CUBICSPLINE": 3}
"""Rows of numbers per keyframe, by the way between keyframes; of three, the middle one holds the values."""
STILL = 1e-5
"""How far an animated property may lie from its value at rest, relative to this or to 1, to count as unmoved: single precision, with room
for an exporter's own rounding."""


@dataclass(frozen=True, eq=False)
class Targets:
    """What the targets of a piece add to its positions, in the world."""

    names: tuple[str, ...]
    deltas: Float[np.ndarray, "k n 3"]

    def at(self, weights: Float[np.ndarray, "t k"]) -> Float[np.ndarray, "t n 3"]:
        """What they add under each row of weights."""
        count, n, _ = self.deltas.shape
        if not count:
            return np.zeros((len(weights), n, 3))
        return (csr_array(weights) @ self.deltas.reshape(count, -1)).reshape(-1, n, 3)


@dataclass(frozen=True, eq=False)
class Curve:
    """Numbers that change with time, between keyframes; `slopes` before and after each, where the way between them is cubic."""

    way: str
    keys: Float[np.ndarray, "t"]
    values: Float[np.ndarray, "t k"]
    slopes: Float[np.ndarray, "2 t k"] | None

    def at(self, times: Float[np.ndarray, "s"]) -> Float[np.ndarray, "s k"]:
        """Their values; those of the first and last keyframe beyond these."""
        if len(self.keys) == 1:
            return np.repeat(self.values, len(times), axis=0)
        before = np.clip(np.searchsorted(self.keys, times, "right") - 1, 0, len(self.keys) - 2)
        span = np.diff(self.keys)[before][:, None]
        u = np.clip((times - self.keys[before])[:, None] / span, 0, 1)
        start, end = self.values[before], self.values[before + 1]
        if self.way == "STEP":
            return np.where(u < 1, start, end)
        if self.slopes is None:
            return (1 - u) * start + u * end
        leaving, arriving = self.slopes[1][before] * span, self.slopes[0][before + 1] * span
        return (1 - u) ** 2 * ((1 + 2 * u) * start + u * leaving) + u**2 * ((3 - 2 * u) * end - (1 - u) * arriving)


def shapes(file: File) -> Shapes:
    """The rest shape and one per target, or the keyframes of the first animation that blends them."""
    with guarded():
        scene = opened(file)
        pieces = list(pieces_of(scene.tree))
        rest = content_of(scene, pieces)
        require_room(scene, sum(_added(scene.tree, piece) for piece in pieces), "morph targets")
        targets = [_targets(scene, piece) for piece in pieces]
        played = _played(scene, pieces)
        count = 1 + len({name for each in targets for name in each.names}) if played is None else len(played[0])
        require_room(scene, count * (rest.vertices.size + sum(len(each.names) for each in targets)), "shapes")
        times, weights = played or (None, _one_by_one(targets))
    mesh = mesh_of(rest)
    first = _name_of_rest(scene.tree, pieces, file.path.stem)
    added = np.concatenate([each.at(own) for each, own in zip(targets, weights, strict=True)], axis=1)
    positions, names = mesh.vertices + added, _names(first, targets, weights)
    broken = np.flatnonzero(~np.isfinite(positions).all(axis=(1, 2)))
    if len(broken):
        found = f"NaN or infinite ones in {len(broken)} of {len(names)} shapes, the first '{names[broken[0]]}'"
        raise FileError("finite coordinates", found, "export the morph targets again", broken)
    return Shapes(mesh, positions, names, times)


def animated(sequence: MeshSequence, attributes: Attributes, names: tuple[str, ...], duration: float) -> bytes:
    """A binary glTF file that shows the first frame and plays all of them: a morph target for each further one, with its normals."""
    tree, buffer = still(sequence[0], attributes)
    rest, count = sequence[0], len(sequence) - 1
    targets = []
    for k in range(1, len(sequence)):
        apart = {"POSITION": (rest.vertices, sequence[k].vertices), "NORMAL": (rest.vertex_normals, sequence[k].vertex_normals)}
        targets.append({name: append(tree, buffer, single(after) - single(before)) for name, (before, after) in apart.items()})
    tree["meshes"][0]["primitives"][0]["targets"] = targets
    tree["meshes"][0] |= {"name": names[0], "weights": [0.0] * count, "extras": {"targetNames": list(names[1:])}}
    times = duration * (sequence.times - sequence.times[0]) / (sequence.times[-1] - sequence.times[0])
    input, output = (append(tree, buffer, single(values)) for values in (times[:, None], np.eye(count + 1)[:, 1:].reshape(-1, 1)))
    sampler = {"input": input, "output": output, "interpolation": "LINEAR"}
    tree["animations"] = [{"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": 0, "path": "weights"}}]}]
    return packed(tree, buffer)


def unique(names: Iterable[str]) -> tuple[str, ...]:
    """The names, each once: a repeated one gets a number."""
    given, taken = list(names), dict[str, None]()
    known = set(given)
    for name in given:
        free, number = name, 1
        while free in taken or (number > 1 and free in known):
            number += 1
            free = f"{name}-{number}"
        taken[free] = None
    return tuple(taken)


def _targets(scene: Scene, piece: Piece) -> Targets:
    """The targets of a piece; each must have a row per vertex, and each primitive of a mesh as many targets."""
    mesh, primitive, entries = _mesh(scene.tree, piece.node), primitive_of(scene.tree, piece), scene.tree["accessors"]
    counts = [len(other.get("targets", [])) for other in mesh["primitives"]]
    if len(set(counts)) > 1:
        raise FileError(f"{counts[0]} morph targets in each primitive of a mesh", f"{counts} of them", "export the mesh again")
    n = entries[primitive["attributes"]["POSITION"]]["count"]
    deltas = np.zeros((counts[0], n, 3))
    for k, target in enumerate(primitive.get("targets", [])):
        if "POSITION" in target and entries[target["POSITION"]]["count"] != n:
            found = repr(entries[target["POSITION"]]["count"])[:SHOWN]
            raise FileError(f"{n} rows in morph target {k}, one per vertex", found, "export the mesh again", [k])
        deltas[k] = accessor(scene, target["POSITION"]) @ piece.matrix[:3, :3].T if "POSITION" in target else 0
    return Targets(_target_names(mesh, counts[0]), deltas)


def _added(tree: Tree, piece: Piece) -> int:
    """How many numbers the targets of a piece are."""
    primitive = primitive_of(tree, piece)
    return int(3 * tree["accessors"][primitive["attributes"]["POSITION"]]["count"] * len(primitive.get("targets", [])))


def _target_names(mesh: Tree, count: int) -> tuple[str, ...]:
    """What exporters call the targets of a mesh; numbers where they do not."""
    extras = mesh.get("extras")
    told = extras.get("targetNames") if isinstance(extras, dict) else None
    if isinstance(told, list) and len(told) == count and all(isinstance(name, str) for name in told):
        return unique(told)
    return tuple(f"target-{k:03d}" for k in range(count))


def _one_by_one(targets: list[Targets]) -> list[Float[np.ndarray, "t k"]]:
    """Weights of the pieces that show no target, then each alone."""
    names = dict.fromkeys(name for each in targets for name in each.names)
    return [np.array([[name == own for own in each.names] for name in (None, *names)], np.float64) for each in targets]


def _names(first: str, targets: list[Targets], weights: list[Float[np.ndarray, "t k"]]) -> tuple[str, ...]:
    """The name of each shape: that of the one target it shows in full, the first one where it shows none, else a number."""
    names = []
    for k, rows in enumerate(zip(*weights, strict=True)):
        shown = {(each.names[j], float(row[j])) for each, row in zip(targets, rows, strict=True) for j in np.flatnonzero(row)}
        alone = next(iter(shown)) if len(shown) == 1 else ("", 0.0)
        names.append(first if not shown else alone[0] if alone[1] == 1 else f"frame-{k:03d}")
    return unique(names)


def _name_of_rest(tree: Tree, pieces: list[Piece], stem: str) -> str:
    """What the shape without targets is called: the mesh where there is one, the file where there are no targets."""
    meshes = {tree["nodes"][piece.node]["mesh"] for piece in pieces}
    if not any(primitive_of(tree, piece).get("targets") for piece in pieces):
        return stem
    name = _mesh(tree, pieces[0].node).get("name") if len(meshes) == 1 else None
    return name if isinstance(name, str) and name else "rest"


def _played(scene: Scene, pieces: list[Piece]) -> tuple[Float[np.ndarray, "t"], list[Float[np.ndarray, "t k"]]] | None:
    """Times and weights of the pieces in the first animation that has weights; None if none has."""
    for animation in scene.tree.get("animations", []):
        _require_still(scene, animation, pieces)
        curves = dict(_curves(scene, animation, {piece.node for piece in pieces}))
        if curves:
            times = np.unique(np.concatenate([curve.keys for curve in curves.values()]))
            resting = {piece.node: _resting(scene.tree, piece.node) for piece in pieces}
            own = {node: curves[node].at(times) if node in curves else np.tile(resting[node], (len(times), 1)) for node in resting}
            return times, [own[piece.node] for piece in pieces]
    return None


def _curves(scene: Scene, animation: Tree, nodes: set[int]) -> Iterator[tuple[int, Curve]]:
    """The weights of those of the nodes that have targets."""
    for channel in animation["channels"]:
        node = channel["target"].get("node")
        if channel["target"]["path"] == "weights" and node in nodes:
            curve = _curve(scene, animation["samplers"][channel["sampler"]])
            count, found = len(_resting(scene.tree, node)), curve.values.shape[1]
            if found != count:
                raise FileError(f"{count} weights in each keyframe of node {node}", str(found), "export the animation again")
            if count:
                yield node, curve


def _resting(tree: Tree, node: int) -> Float[np.ndarray, "k"]:
    """The weights of a node that nothing animates."""
    mesh = _mesh(tree, node)
    count = len(mesh["primitives"][0].get("targets", []))
    weights = np.array(tree["nodes"][node].get("weights", mesh.get("weights", [0.0] * count)), np.float64)
    if weights.shape != (count,):
        raise FileError(f"{count} weights of node {node}, one per morph target", str(weights.size), "export the mesh again")
    return weights


def _curve(scene: Scene, sampler: Tree) -> Curve:
    """The keyframes of a sampler."""
    keys, output = accessor(scene, sampler["input"])[:, 0], accessor(scene, sampler["output"])
    if not (len(keys) and np.isfinite(keys).all() and np.all(np.diff(keys) > 0)):
        raise FileError("keyframes at increasing times", f"{len(keys)} that are not", "export the animation again")
    if not np.isfinite(output).all():
        raise FileError("finite numbers in an animation", "NaN or infinite ones", "export the animation again")
    way = sampler.get("interpolation", "LINEAR")
    parts = PARTS[way]
    if output.size % (len(keys) * parts):
        found = f"{output.size} for {len(keys)} keyframes"
        raise FileError(f"a multiple of {len(keys) * parts} numbers in an animation", found, "export the animation again")
    table = output.reshape(len(keys), parts, -1)
    slopes = np.stack([table[:, 0], table[:, -1]]) if way == "CUBICSPLINE" else None
    return Curve(way, keys, table[:, parts // 2], slopes)


def _require_still(scene: Scene, animation: Tree, pieces: list[Piece]) -> None:
    """Refuse an animation that moves nodes: its shapes are not those of the targets alone."""
    movers = _movers(scene.tree, pieces)
    for channel in animation["channels"]:
        node, path = channel["target"].get("node"), channel["target"]["path"]
        if node not in movers or path not in UNMOVED:
            continue
        own = np.array(scene.tree["nodes"][node].get(path, UNMOVED[path]), np.float64)
        moved = np.abs(_curve(scene, animation["samplers"][channel["sampler"]]).values - own).max(initial=0)
        if moved > STILL * max(1, np.abs(own).max()):
            advice = "bake the motion into shape keys, or export its poses as files"
            raise FileError("an animation of morph targets alone", f"the {path} of node {node} animated", advice, [node])


def _movers(tree: Tree, pieces: list[Piece]) -> set[int]:
    """The nodes whose motion moves vertices: those of the pieces, the joints of their skins, and all above them."""
    nodes = tree["nodes"]
    above = {child: k for k, node in enumerate(nodes) for child in node.get("children", [])}
    todo = {piece.node for piece in pieces}
    todo |= {joint for k in todo if "skin" in nodes[k] for joint in tree["skins"][nodes[k]["skin"]]["joints"]}
    found = set[int]()
    while todo:
        node = todo.pop()
        found.add(node)
        todo |= {above[node]} - found if node in above else set()
    return found


def _mesh(tree: Tree, node: int) -> Tree:
    return tree["meshes"][tree["nodes"][node]["mesh"]]
