"""Morph targets and their animations, as scenes written by hand say them; what cannot be a sequence of shapes."""

import base64
import json
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import FileError, Mesh, MeshSequence, read, read_poses, read_sequence, write_animation
from morphlet.io.gltf_shapes import unique
from support import icosphere

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
UP = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 0]], np.float32)
OUT = np.array([[0, 0, 0], [0, 0, 0], [0, 3, 0]], np.float32)
KINDS = {"f": 5126, "I": 5125, "H": 5123, "b": 5120}
SHAPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}


def scene(arrays, **tree):
    """A glTF text with an accessor per array; keys of the tree replace those of a triangle's scene with two targets."""
    views, entries, data = [], [], b""
    for array in arrays:
        table = array.reshape(len(array), -1)
        views.append({"buffer": 0, "byteOffset": len(data), "byteLength": table.nbytes})
        kind, shape = KINDS[table.dtype.char], SHAPES[table.shape[1]]
        entries.append({"bufferView": len(views) - 1, "componentType": kind, "count": len(table), "type": shape})
        data += table.tobytes() + bytes(-table.nbytes % 4)
    uri = "data:application/octet-stream;base64," + base64.b64encode(data).decode()
    primitive = {"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}, {"POSITION": 2}]}
    usual = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(data), "uri": uri}],
        "bufferViews": views,
        "accessors": entries,
        "meshes": [{"primitives": [primitive]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    return usual | tree


def put(folder, tree, name="a.gltf"):
    path = folder / name
    path.write_text(json.dumps(tree))
    return path


def f4(*values):
    return np.array(values, np.float32)


def animation(input, output, way=None, node=0, path="weights"):
    sampler = {"input": input, "output": output} | ({"interpolation": way} if way else {})
    return {"samplers": [sampler], "channels": [{"sampler": 0, "target": {"node": node, "path": path}}]}


def test_without_animation_rest_and_each_target(tmp_path):
    poses = read_poses(put(tmp_path, scene([TRIANGLE, UP, OUT])))
    np.testing.assert_array_equal(poses.sequence.positions, [TRIANGLE, TRIANGLE + UP, TRIANGLE + OUT])
    assert poses.names == ("rest", "target-000", "target-001")
    np.testing.assert_array_equal(poses.sequence.times, [0, 1, 2])


def test_names_of_mesh_and_targets_are_kept_where_there_is_one_per_target(tmp_path):
    mesh = scene([TRIANGLE, UP, OUT])["meshes"][0] | {"name": "face"}
    for told, names in (
        (["smile", "frown"], ("face", "smile", "frown")),
        (["smile", "smile"], ("face", "smile", "smile-2")),
        (["face", "smile"], ("face", "face-2", "smile")),
        (["smile"], ("face", "target-000", "target-001")),
        ("ab", ("face", "target-000", "target-001")),
        ([1, 2], ("face", "target-000", "target-001")),
    ):
        tree = scene([TRIANGLE, UP, OUT], meshes=[mesh | {"extras": {"targetNames": told}}])
        assert read_poses(put(tmp_path, tree)).names == names
    assert read_poses(put(tmp_path, scene([TRIANGLE, UP, OUT], meshes=[mesh | {"extras": [1]}]))).names[1] == "target-000"


def test_a_target_without_positions_and_a_file_without_targets(tmp_path):
    tree = scene([TRIANGLE, UP, OUT])
    tree["meshes"][0]["primitives"][0]["targets"][0] = {"NORMAL": 1}
    np.testing.assert_array_equal(read_sequence(put(tmp_path, tree)).positions, [TRIANGLE, TRIANGLE, TRIANGLE + OUT])
    del tree["meshes"][0]["primitives"][0]["targets"]
    poses = read_poses(put(tmp_path, tree, "still.gltf"))
    assert (poses.names, len(poses.sequence)) == (("still",), 1)


WEIGHTS = f4([0, 0], [1, 0], [0.5, 2])


@pytest.mark.parametrize("way", [None, "LINEAR", "STEP"])
def test_keyframes_of_an_animation(tmp_path, way):
    tree = scene([TRIANGLE, UP, OUT, f4(1, 1.5, 4), WEIGHTS.ravel()], animations=[animation(3, 4, way)])
    poses = read_poses(put(tmp_path, tree))
    np.testing.assert_array_equal(poses.sequence.times, [1, 1.5, 4])
    np.testing.assert_array_equal(poses.sequence.positions, [TRIANGLE, TRIANGLE + UP, TRIANGLE + 0.5 * UP + 2 * OUT])
    assert poses.names == ("rest", "target-000", "frame-002")


def test_one_keyframe(tmp_path):
    sequence = read_sequence(put(tmp_path, scene([TRIANGLE, UP, OUT, f4(2), f4(0, 1)], animations=[animation(3, 4)])))
    np.testing.assert_array_equal(sequence.positions, [TRIANGLE + OUT])
    np.testing.assert_array_equal(sequence.times, [2])


def two_nodes(ways, extra=()):
    """Two triangles with a target each, moved by weights with keyframes at 0, 2 and at 0, 1, 2."""
    one = {"primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}]}]}
    other = {"primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 2}]}]}
    channels = [{"sampler": k, "target": {"node": k, "path": "weights"}} for k in (0, 1)]
    samplers = [{"input": 3, "output": 4, "interpolation": ways}, {"input": 5, "output": 6}]
    return scene(
        [TRIANGLE, UP, OUT, f4(0, 2), f4(*extra), f4(0, 1, 2), f4(0, 1, 0)],
        meshes=[one, other],
        nodes=[{"mesh": 0}, {"mesh": 1}],
        scenes=[{"nodes": [0, 1]}],
        animations=[{"samplers": samplers, "channels": channels}],
    )


@pytest.mark.parametrize(
    ("way", "values", "middle"),
    [("LINEAR", (0, 1), 0.5), ("STEP", (0.25, 1), 0.25), ("CUBICSPLINE", (9, 0, 0.5, 0.25, 1, 9), 0.5 + 2 * (0.5 - 0.25) / 8)],
)
def test_nodes_with_keyframes_at_other_times_are_shown_at_all_of_them(tmp_path, way, values, middle):
    """In the middle of a cubic way: half of both ends, and an eighth of the span times the difference of the slopes."""
    sequence = read_sequence(put(tmp_path, two_nodes(way, values)))
    start = 0.25 if way == "STEP" else 0
    np.testing.assert_array_equal(sequence.times, [0, 1, 2])
    np.testing.assert_allclose(sequence.positions[:, 1, 2], [start, middle, 1])
    np.testing.assert_allclose(sequence.positions[:, 5, 1], [1, 4, 1])


def test_a_node_without_animation_keeps_its_own_weights(tmp_path):
    tree = two_nodes("LINEAR", (0, 1))
    tree["animations"][0]["channels"].pop(0)
    for node, mesh, weight in ({"weights": [0.5]}, {}, 0.5), ({}, {"weights": [0.25]}, 0.25), ({"weights": [0]}, {"weights": [1]}, 0):
        changed = tree | {"nodes": [{"mesh": 0} | node, {"mesh": 1}], "meshes": [tree["meshes"][0] | mesh, tree["meshes"][1]]}
        np.testing.assert_allclose(read_sequence(put(tmp_path, changed)).positions[:, 1, 2], weight)


def test_targets_of_one_name_move_together_in_the_world(tmp_path):
    """A face and its teeth: the second node is moved, turned and mirrored."""
    part = {"primitives": [{"attributes": {"POSITION": 0}, "targets": [{"POSITION": 1}, {"POSITION": 2}]}]}
    meshes = [part | {"extras": {"targetNames": ["smile", "frown"]}}, part | {"extras": {"targetNames": ["bite", "smile"]}}]
    nodes = [{"mesh": 0}, {"mesh": 1, "translation": [5, 0, 0], "scale": [1, 1, -2]}]
    poses = read_poses(put(tmp_path, scene([TRIANGLE, UP, OUT], meshes=meshes, nodes=nodes, scenes=[{"nodes": [0, 1]}])))
    assert poses.names == ("rest", "smile", "frown", "bite")
    rest = np.concatenate([TRIANGLE, TRIANGLE + f4(5, 0, 0)])
    added = [np.zeros((6, 3)), np.concatenate([UP, OUT]), np.concatenate([OUT, 0 * UP]), np.concatenate([0 * UP, -2 * UP])]
    np.testing.assert_array_equal(poses.sequence.positions, rest + np.array(added))


def test_sparse_targets_with_and_without_data_below(tmp_path):
    tree = scene([TRIANGLE, UP, np.array([2], np.uint16), f4([7, 8, 9])])
    sparse = {"count": 1, "indices": {"bufferView": 2, "componentType": 5123}, "values": {"bufferView": 3}}
    bare = {"componentType": 5126, "count": 3, "type": "VEC3", "sparse": sparse}
    tree["accessors"] = [*tree["accessors"][:2], bare]
    expected = np.array([[0, 0, 0], [0, 0, 0], [7, 8, 9]])
    np.testing.assert_array_equal(read_sequence(put(tmp_path, tree)).positions[2], TRIANGLE + expected)
    tree["accessors"][2] = bare | {"bufferView": 1}
    np.testing.assert_array_equal(read_sequence(put(tmp_path, tree)).positions[2], TRIANGLE + UP + expected)
    tree["accessors"][2] = {"componentType": 5126, "count": 3, "type": "VEC3"}
    np.testing.assert_array_equal(read_sequence(put(tmp_path, tree)).positions[2], TRIANGLE)
    tree["accessors"][0] = bare | {"bufferView": 0}
    np.testing.assert_array_equal(read(put(tmp_path, tree)).vertices, [*TRIANGLE[:2], [7, 8, 9]])


def test_whole_numbers_as_targets(tmp_path):
    tree = scene([TRIANGLE, np.array([[0, 0, 127], [0, 0, 0], [0, 0, 0]], np.int8), OUT])
    tree["accessors"][1] |= {"normalized": True}
    assert read_sequence(put(tmp_path, tree)).positions[1, 0].tolist() == [0, 0, 1]


def test_still_nodes_and_animations_of_other_things_are_no_hindrance(tmp_path):
    still = animation(3, 5, node=0, path="translation")
    arrays = [TRIANGLE, UP, OUT, f4(0, 1), f4(0, 0, 1, 0), np.zeros((2, 3), np.float32), f4([0, 0, 0], [5, 0, 0])]
    camera, played = animation(3, 6, node=1, path="translation"), animation(3, 4)
    tree = scene(arrays, nodes=[{"mesh": 0}, {}], animations=[still, camera, played])
    np.testing.assert_array_equal(read_sequence(put(tmp_path, tree)).positions, [TRIANGLE, TRIANGLE + UP])


@pytest.mark.parametrize(
    ("nodes", "roots"),
    [
        ([{"mesh": 0}], [0]),
        ([{"children": [1]}, {"mesh": 0}], [0]),
        ([{}, {"mesh": 0, "skin": 0}, {}], [0, 1]),
        ([{"children": [2]}, {"mesh": 0, "skin": 0}, {}], [0, 1]),
    ],
)
def test_moving_nodes_and_bones_are_refused(tmp_path, nodes, roots):
    """The node of the mesh, one above it, a joint of its skin, one above a joint."""
    arrays = [TRIANGLE, UP, OUT, f4(0, 1), f4([0, 0, 0], [5, 0, 0])]
    joints = [2] if "children" in nodes[0] else [0]
    more = {"nodes": nodes, "scenes": [{"nodes": roots}], "skins": [{"joints": joints}]}
    tree = scene(arrays, animations=[animation(3, 4, path="translation")], **more)
    with pytest.raises(FileError, match=r"an animation of morph targets alone in .*; found the translation of node 0 animated"):
        read_sequence(put(tmp_path, tree))
    tree["accessors"][4]["count"] = 1
    tree["accessors"][3]["count"] = 1
    assert len(read_sequence(put(tmp_path, tree))) == 3


def broken(tree, *path, value):
    """The tree with another value at a place."""
    *above, last = path
    place = tree
    for key in above:
        place = place[key]
    place[last] = value
    return tree


def usual():
    return scene([TRIANGLE, UP, OUT, f4(0, 1), f4(0, 0, 1, 0)], animations=[animation(3, 4)])


BAD = {
    "fewer rows in a target": (
        lambda: broken(usual(), "accessors", 2, "count", value=2),
        "3 rows in morph target 1, one per vertex in .*; found 2",
    ),
    "primitives with other targets": (
        lambda: broken(usual(), "meshes", 0, "primitives", value=[{"attributes": {"POSITION": 0}}, usual()["meshes"][0]["primitives"][0]]),
        r"0 morph targets in each primitive of a mesh in .*; found \[0, 2\]",
    ),
    "too few weights": (lambda: broken(usual(), "accessors", 4, "count", value=2), "2 weights in each keyframe of node 0 in .*; found 1"),
    "odd weights": (
        lambda: broken(usual(), "accessors", 4, "count", value=3),
        "a multiple of 2 numbers in an animation in .*; found 3 for 2",
    ),
    "weights of the mesh": (
        lambda: broken(usual(), "meshes", 0, "weights", value=[1.0]),
        "2 weights of node 0, one per morph target in .*; found 1",
    ),
    "times that stand still": (
        lambda: scene([TRIANGLE, UP, OUT, f4(1, 1), f4(0, 0, 1, 0)], animations=[animation(3, 4)]),
        "keyframes at increasing times",
    ),
    "times that are none": (
        lambda: scene([TRIANGLE, UP, OUT, f4(np.nan), f4(0, 0)], animations=[animation(3, 4)]),
        "keyframes at increasing times",
    ),
    "no keyframes": (lambda: broken(usual(), "accessors", 3, "count", value=0), "keyframes at increasing times"),
    "an unknown way": (lambda: broken(usual(), "animations", value=[animation(3, 4, "WAVY")]), "a glTF 2 scene"),
    "NaN in a target": (
        lambda: scene([TRIANGLE, UP, OUT * f4(np.nan, 1, 1)]),
        "finite coordinates in .*; found NaN or infinite ones in 1 of 3 shapes, the first 'target-001' .*first: 2",
    ),
    "NaN weights": (
        lambda: scene([TRIANGLE, UP, OUT, f4(0, 1), f4(0, 0, np.nan, 0)], animations=[animation(3, 4)]),
        "finite numbers in an animation",
    ),
    "a sampler that is not there": (lambda: broken(usual(), "animations", 0, "channels", 0, "sampler", value=5), "a glTF 2 scene"),
    "two numbers a row": (lambda: broken(usual(), "accessors", 2, "type", value="VEC2"), "a glTF 2 scene"),
    "rows without data": (
        lambda: broken(usual(), "accessors", 0, value={"componentType": 5126, "count": 10**12, "type": "VEC3"}),
        "at most .* rows without data in a glTF scene",
    ),
    "sparse rows outside": (
        lambda: broken(
            scene([TRIANGLE, UP, OUT, np.array([3], np.uint16), f4([7, 8, 9])]),
            *("accessors", 2, "sparse"),
            value={"count": 1, "indices": {"bufferView": 3, "componentType": 5123}, "values": {"bufferView": 4}},
        ),
        r"sparse indices below 3 in .*; found 1 others \(first: 3\)",
    ),
    "sparse data that is not there": (
        lambda: broken(usual(), "accessors", 2, "sparse", value={"count": 99, "indices": {"bufferView": 3, "componentType": 5123}}),
        "bytes in the glTF buffers",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_no_scene_may_say(tmp_path, case):
    make, match = BAD[case]
    path = put(tmp_path, make())
    with pytest.raises(FileError, match=match):
        read_sequence(path)


def test_colors_of_another_count(tmp_path):
    path = put(tmp_path, broken(usual(), "meshes", 0, "primitives", 0, "attributes", value={"POSITION": 0, "COLOR_0": 3}))
    with pytest.raises(FileError, match=r"3 rows of COLOR_0, one per vertex in .*; found 2"):
        write_animation(tmp_path / "b.glb", read_sequence(path), template=path)


@settings(max_examples=40, deadline=None)
@given(st.binary(min_size=1, max_size=8), st.integers(0, 10**6))
def test_damaged_bytes_are_typed_errors_or_shapes(tmp_path_factory, noise, place):
    folder = tmp_path_factory.mktemp("noise", numbered=True)
    write_animation(folder / "a.glb", MeshSequence(icosphere(0).topology, [icosphere(0).vertices, 2 * icosphere(0).vertices], [0, 1]))
    data = bytearray((folder / "a.glb").read_bytes())
    start = place % len(data)
    data[start : start + len(noise)] = noise
    (folder / "a.glb").write_bytes(data)
    with suppress(FileError):
        assert len(read_sequence(folder / "a.glb")) > 0


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 6), st.integers(0, 2**32 - 1), st.floats(0.1, 100))
def test_an_animation_comes_back(tmp_path_factory, frames, seed, duration):
    """Up to single precision, of which positions take two roundings: their own and that of the way from the first frame."""
    rng = np.random.default_rng(seed)
    positions, steps = rng.normal(size=(frames, 12, 3)), rng.uniform(0.1, 1, frames)
    sequence = MeshSequence(icosphere(0).topology, positions, np.cumsum(steps))
    names = [f"pose {k}" for k in rng.permutation(frames)]
    path = tmp_path_factory.mktemp("a", numbered=True) / "a.glb"
    write_animation(path, sequence, names=names, duration=duration)
    back = read_poses(path)
    assert back.names == tuple(names)
    np.testing.assert_array_equal(back.sequence.topology.faces, sequence.topology.faces)
    np.testing.assert_allclose(back.sequence.positions, positions, atol=4e-7 * np.abs(positions).max())
    span = sequence.times - sequence.times[0]
    np.testing.assert_allclose(back.sequence.times, span / span[-1] * duration, rtol=1e-6, atol=1e-6)


def test_equal_shapes_and_triangles_without_area_come_back(tmp_path):
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3], [1, 1, 1]])
    positions = np.stack([mesh.vertices, mesh.vertices, 0 * mesh.vertices, mesh.vertices])
    write_animation(tmp_path / "a.glb", MeshSequence(mesh.topology, positions, np.arange(4.0)))
    poses = read_poses(tmp_path / "a.glb")
    np.testing.assert_array_equal(poses.sequence.positions, positions)
    assert poses.names == ("frame-000", "frame-001", "frame-002", "frame-003")


def test_names_are_made_unique_without_taking_others():
    assert unique(["a", "a", "a-2", "a"]) == ("a", "a-3", "a-2", "a-4")
    assert unique([]) == ()
