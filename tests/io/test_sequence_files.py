"""Sequences as numbered files, and as animations: written, read back here and by trimesh, and what cannot be one."""

import json
import os
import struct
from pathlib import Path

import numpy as np
import pytest
import trimesh

from morphlet import FileError, InputError, Mesh, MeshSequence, Poses, read_poses, read_sequence
from morphlet.io.formats import read, read_attributes, write
from morphlet.io.sequences import write_animation, write_sequence
from support import icosphere

DATA = os.environ.get("MORPHLET_DATA")

MESH = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def growing(frames):
    return MeshSequence(MESH.topology, np.stack([MESH.vertices * (1 + k) / 3 for k in range(frames)]), np.arange(float(frames)))


@pytest.mark.parametrize("ending", [".ply", ".obj", ".off"])
def test_frames_come_back_exactly(tmp_path, ending):
    sequence = growing(3)
    files = write_sequence(tmp_path / "deep" / "er", sequence, ending=ending)
    assert [file.name for file in files] == [f"frame-00{k}{ending}" for k in range(3)]
    for k, file in enumerate(files):
        assert read(file).fingerprint == sequence[k].fingerprint


def test_more_than_a_thousand_frames_get_more_digits(tmp_path):
    files = write_sequence(tmp_path, growing(1001), ending=".off")
    assert (files[0].name, files[-1].name) == ("frame-0000.off", "frame-1000.off")
    assert len(write_sequence(tmp_path / "b", growing(1000), ending=".off")[-1].stem) == len("frame-999")


def test_frames_keep_what_the_template_carries(tmp_path):
    colors = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 9]], np.uint8)
    write(tmp_path / "template.obj", MESH, colors=colors)
    for ending in (".ply", ".obj", ".glb"):
        for k, file in enumerate(write_sequence(tmp_path, growing(2), template=tmp_path / "template.obj", ending=ending)):
            assert np.allclose(read(file).vertices, growing(2).positions[k], atol=1e-7)
            assert np.array_equal(read_attributes(file).colors, colors)


def test_template_of_another_size_and_unknown_ending(tmp_path):
    write(tmp_path / "template.ply", Mesh(np.eye(4, 3), [[0, 1, 2]]))
    with pytest.raises(InputError, match="4 vertices, as in"):
        write_sequence(tmp_path / "out", growing(2), template=tmp_path / "template.ply")
    with pytest.raises(FileError, match="an ending out of"):
        write_sequence(tmp_path / "out", growing(2), ending=".fbx")
    (tmp_path / "file").write_text("")
    with pytest.raises(FileError, match="a folder at"):
        write_sequence(tmp_path / "file", growing(2))


def opened(path):
    """The JSON of a binary glTF file, and its accessors as arrays, by the words of the format alone."""
    data = path.read_bytes()
    magic, version, length, size, kind = struct.unpack_from("<4sII I4s", data)
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    tree, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    arrays = []
    for entry in tree["accessors"]:
        view, width = tree["bufferViews"][entry["bufferView"]], {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}[entry["type"]]
        dtype = {5121: "u1", 5125: "<u4", 5126: "<f4"}[entry["componentType"]]
        array = np.frombuffer(binary, dtype, entry["count"] * width, view["byteOffset"]).reshape(-1, width)
        if dtype == "<f4":
            assert (entry["min"], entry["max"]) == (array.min(axis=0).tolist(), array.max(axis=0).tolist())
        arrays.append(array)
    return tree, arrays


def test_an_animation_plays_every_frame_at_its_time(tmp_path):
    """Positions and normals, as a viewer sums them up."""
    ball = icosphere(1)
    times = np.array([3.0, 3.5, 5.0, 7.0])
    shapes = np.stack(
        [ball.vertices, ball.vertices * [1, 1, 2], ball.vertices @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + 3, 0.5 * ball.vertices]
    )
    sequence = MeshSequence(ball.topology, shapes, times)
    colors = np.arange(3 * ball.n_vertices, dtype=np.uint8).reshape(-1, 3)
    write(tmp_path / "ball.ply", ball, colors=colors)
    write_animation(tmp_path / "ball.glb", sequence, template=tmp_path / "ball.ply", duration=8.0)
    tree, arrays = opened(tmp_path / "ball.glb")
    (mesh,), (animation,) = tree["meshes"], tree["animations"]
    (primitive,), (sampler,), (channel,) = mesh["primitives"], animation["samplers"], animation["channels"]
    assert channel == {"sampler": 0, "target": {"node": 0, "path": "weights"}}
    assert sampler["interpolation"] == "LINEAR"
    assert mesh["weights"] == [0.0] * 3
    np.testing.assert_allclose(arrays[sampler["input"]][:, 0], [0, 1, 4, 8])
    weights = arrays[sampler["output"]].reshape(4, 3)
    for k in range(4):
        for name, wanted in (("POSITION", shapes[k]), ("NORMAL", sequence[k].vertex_normals)):
            base, apart = arrays[primitive["attributes"][name]], [arrays[target[name]] for target in primitive["targets"]]
            np.testing.assert_allclose(base + np.tensordot(weights[k], apart, 1), wanted, atol=1e-6)
    np.testing.assert_array_equal(arrays[primitive["indices"]].reshape(-1, 3), ball.faces)
    still = trimesh.load(tmp_path / "ball.glb", force="mesh", process=False)
    np.testing.assert_allclose(still.vertices, ball.vertices, atol=1e-6)
    np.testing.assert_allclose(read(tmp_path / "ball.glb").vertices, ball.vertices, atol=1e-6)
    np.testing.assert_array_equal(read_attributes(tmp_path / "ball.glb").colors, colors)


def test_colors_in_glb_are_amounts_of_light(tmp_path):
    """Half of white's light looks like sRGB 188, and every byte comes back."""
    everything = np.repeat(np.arange(256, dtype=np.uint8)[:, None], 3, axis=1)
    strip = Mesh(np.random.default_rng(0).random((256, 3)), np.arange(255).reshape(85, 3))
    write(tmp_path / "strip.glb", strip, colors=everything)
    np.testing.assert_array_equal(read_attributes(tmp_path / "strip.glb").colors, everything)
    (found,) = trimesh.load_scene(tmp_path / "strip.glb", process=False).geometry.values()
    light = found.visual.vertex_attributes["color"]
    np.testing.assert_allclose(light[[0, 188, 255], 0], [0, 0.5, 1], atol=0.01)


def test_what_no_animation_can_be(tmp_path):
    with pytest.raises(FileError, match=r"an animation ending in \.glb"):
        write_animation(tmp_path / "a.ply", growing(2))
    with pytest.raises(InputError, match="at least 2 frames; found 1"):
        write_animation(tmp_path / "a.glb", growing(1))
    for duration in (0.0, -1.0, np.inf, np.nan):
        with pytest.raises(InputError, match="a positive number of seconds"):
            write_animation(tmp_path / "a.glb", growing(2), duration=duration)
    write(tmp_path / "other.ply", icosphere(0), colors=np.zeros((12, 3), np.uint8))
    with pytest.raises(InputError, match="a template of 3 vertices; found 12"):
        write_animation(tmp_path / "a.glb", growing(2), template=tmp_path / "other.ply")
    assert [file.name for file in tmp_path.iterdir()] == ["other.ply"]


def named(folder, *names):
    """A file of each name, the k-th with the triangle k + 1 times as large."""
    for k, name in enumerate(names):
        write(folder / name, MESH.with_vertices(MESH.vertices * (k + 1)))
    return folder


@pytest.mark.parametrize("ending", [".ply", ".obj", ".off", ".glb"])
def test_a_folder_of_frames_comes_back(tmp_path, ending):
    sequence = growing(12)
    write_sequence(tmp_path, sequence, ending=ending)
    poses = read_poses(tmp_path)
    np.testing.assert_array_equal(poses.sequence.topology.faces, MESH.faces)
    np.testing.assert_allclose(poses.sequence.positions, sequence.positions, atol=1e-6 if ending == ".glb" else 0)
    np.testing.assert_array_equal(poses.sequence.times, np.arange(12))
    assert poses.names == tuple(f"frame-{k:03d}" for k in range(12))
    np.testing.assert_array_equal(read_sequence(tmp_path).positions, poses.sequence.positions)


def test_numbers_sort_by_value_and_text_without_regard_to_case(tmp_path):
    named(tmp_path, "pose9.obj", "pose10.obj", "pose11.obj", "pose8.obj")
    assert read_poses(tmp_path).names == ("pose8", "pose9", "pose10", "pose11")
    named(tmp_path, "B.OBJ", "a.obj", "c.obj", ".d.obj")
    assert read_poses(tmp_path).names == ("pose8", "pose9", "pose10", "pose11")
    for number in (8, 9, 10):
        (tmp_path / f"pose{number}.obj").unlink()
    assert read_poses(tmp_path).names == ("a", "B", "c", "pose11")


def test_a_series_is_read_whatever_lies_beside_it(tmp_path):
    named(tmp_path, "rest.ply", "frame-000.ply", "frame-001.ply", "morph.glb", ".frame-002.ply")
    (tmp_path / "notes.txt").write_text("")
    (tmp_path / "frame-002.ply").mkdir()
    assert read_poses(tmp_path).names == ("frame-000", "frame-001")


def test_files_follow_one_another_as_named(tmp_path):
    named(tmp_path, "rest.obj")
    write_sequence(tmp_path / "poses", growing(2))
    write_animation(tmp_path / "a.glb", growing(3), names=["rest", "up", "down"])
    paths = tmp_path / "rest.obj", tmp_path / "poses", tmp_path / "a.glb", tmp_path / "poses" / "frame-001.ply"
    poses = read_poses(*paths)
    assert poses.names == ("rest", "frame-000", "frame-001", "rest-2", "up", "down", "frame-001-2")
    np.testing.assert_allclose(poses.sequence.positions[:, 1, 0] * 3, [3, 1, 2, 1, 2, 3, 2], rtol=1e-6)
    np.testing.assert_array_equal(poses.sequence.times, np.arange(7))
    assert read_poses(str(paths[0])).names == ("rest",)


@pytest.mark.parametrize(
    ("names", "match"),
    [
        (["p-1.obj", "p-2.obj", "p-4.obj"], r"one file for each number from 1 to 4 in .*; found no p-3\.obj \(first: 3\)"),
        (["p-08.obj", "p-09.obj", "p-11.obj"], r"found no p-10\.obj"),
        (["p-001-clean.obj", "p-003-clean.obj"], r"found no p-002-clean\.obj"),
        (["p-1.obj", "p-999999999999999999999.obj"], r"found no p-2\.obj"),
        (["p-1.obj", "p-2.obj", "p-02.obj"], r"found number 2 twice, the second time in p-2\.obj"),
        (["a-1.obj", "a-2.obj", "b-1.obj", "b-3.obj"], r"found no b-2\.obj"),
        (["a.obj", "b.ply"], r"one numbered series or mesh files of one kind in .*; found \.obj and \.ply"),
        (["a.png"], "files ending in .ply, .glb, .gltf, .off, .stl, .obj in .*; found none"),
        ([], "found none; name the folder"),
    ],
)
def test_folders_that_hold_no_sequence(tmp_path, names, match):
    for name in names:
        (tmp_path / name).write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FileError, match=match):
        read_sequence(tmp_path)
    if names and match.startswith(("found no p", "one file")):
        assert len(read_sequence(*sorted(tmp_path.iterdir()))) == len(names)


def test_frames_with_other_faces_are_told_apart(tmp_path):
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    write(tmp_path / "p-0.obj", square)
    write(tmp_path / "p-1.obj", Mesh(square.vertices, [[0, 1, 2], [1, 2, 3]]))
    with pytest.raises(
        FileError, match=r"the 4 vertices and 2 faces of .*p-0\.obj in .*p-1\.obj; found 1 face with other corners, face 1"
    ) as told:
        read_sequence(tmp_path)
    assert told.value.elements == [1]
    assert "[1, 2, 3] instead of [0, 2, 3]" in str(told.value)
    write(tmp_path / "p-1.obj", MESH)
    with pytest.raises(FileError, match=r"found 3 vertices and 1 face; export it with"):
        read_sequence(tmp_path)


def test_a_broken_frame_is_named(tmp_path):
    write_sequence(tmp_path, growing(3), ending=".obj")
    (tmp_path / "frame-001.obj").write_text("v 0 0 0\nv 1 nan 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(FileError, match=r"finite coordinates in .*frame-001\.obj; found NaN or infinite ones at 1 vert.* \(first: 1\)"):
        read_sequence(tmp_path)
    (tmp_path / "frame-001.obj").write_text("")
    with pytest.raises(FileError, match=r"a mesh in .*frame-001\.obj; found an empty file"):
        read_sequence(tmp_path)
    with pytest.raises(FileError, match=r"a mesh file at .*gone"):
        read_sequence(tmp_path / "gone")
    with pytest.raises(InputError, match="at least one path; found none"):
        read_sequence()
    with pytest.raises(InputError, match=r"paths, each an argument of its own; found a list; pass a list of files as \*files"):
        read_sequence([tmp_path])


def test_one_frame_equal_frames_and_no_area_are_sequences(tmp_path):
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    sequence = MeshSequence(flat.topology, np.stack([flat.vertices] * 3), np.arange(3.0))
    write_sequence(tmp_path / "three", sequence)
    np.testing.assert_array_equal(read_sequence(tmp_path / "three").positions, sequence.positions)
    write_sequence(tmp_path / "one", growing(1))
    assert len(read_sequence(tmp_path / "one")) == 1


def test_texture_seams_split_no_vertices_of_frames(tmp_path):
    """OBJ frames keep their position indices, as single OBJ files do."""
    for k in range(2):
        text = f"v 0 0 {k}\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5\nf 1/1 2/2 3/3\nf 1/5 3/3 4/4\n"
        (tmp_path / f"frame-{k}.obj").write_text(text)
    assert read_sequence(tmp_path).positions.shape == (2, 4, 3)


def test_names_and_colors_of_an_animation(tmp_path):
    colors = np.array([[1, 2, 3], [4, 5, 6], [7, 8, 255]], np.uint8)
    write(tmp_path / "template.ply", MESH, colors=colors[::-1])
    write_animation(tmp_path / "a.glb", growing(2), template=tmp_path / "template.ply", colors=colors, names=["small", "large"])
    np.testing.assert_array_equal(read_attributes(tmp_path / "a.glb").colors, colors)
    tree, _ = opened(tmp_path / "a.glb")
    assert (tree["meshes"][0]["name"], tree["meshes"][0]["extras"]) == ("small", {"targetNames": ["large"]})
    for names in (["a"], ["a", "a"], ["a", "b", "c"]):
        with pytest.raises(InputError, match="2 names, each another"):
            write_animation(tmp_path / "b.glb", growing(2), names=names)
    with pytest.raises(InputError, match=r"colors of shape \(3, 3\)"):
        write_animation(tmp_path / "b.glb", growing(2), colors=colors[:2])
    assert not (tmp_path / "b.glb").exists()
    with pytest.raises(InputError, match="1 name, each another; found 0 names"):
        Poses(growing(1), ())


@pytest.mark.parametrize("ending", [".ply", ".obj", ".glb"])
def test_trimesh_reads_every_frame(tmp_path, ending):
    ball = icosphere(2)
    shapes = np.stack([ball.vertices, ball.vertices * [1, 1, 3], ball.vertices[:, [1, 2, 0]] - 5])
    files = write_sequence(tmp_path, MeshSequence(ball.topology, shapes, np.arange(3.0)), ending=ending)
    for file, shape in zip(files, shapes, strict=True):
        found = trimesh.load(file, process=False, force="mesh")
        np.testing.assert_allclose(found.vertices, shape, atol=1e-6)
        np.testing.assert_array_equal(found.faces, ball.faces)


def test_trimesh_reads_an_animation_as_its_first_frame(tmp_path):
    ball = icosphere(2)
    colors = np.random.default_rng(0).integers(0, 256, (ball.n_vertices, 3)).astype(np.uint8)
    sequence = MeshSequence(ball.topology, np.stack([ball.vertices, 2 * ball.vertices]), [0.0, 1.0])
    write_animation(tmp_path / "a.glb", sequence, colors=colors)
    (found,) = trimesh.load_scene(tmp_path / "a.glb", process=False).geometry.values()
    assert found.vertices.shape == (162, 3)
    np.testing.assert_allclose(found.vertices, ball.vertices, atol=1e-6)
    np.testing.assert_array_equal(found.faces, ball.faces)
    light = found.visual.vertex_attributes["color"][:, :3]
    np.testing.assert_allclose(light ** (1 / 2.2), colors / 255, atol=0.04)


@pytest.mark.skipif(not DATA, reason="MORPHLET_DATA is not set: no public meshes")
@pytest.mark.parametrize(("name", "frames"), [("horse-poses", 10), ("cat-poses", 5)])
def test_public_poses_and_their_rest_shape(tmp_path, name, frames):
    rest = Path(DATA, "meshes", f"{name.split('-')[0]}.obj")
    poses = read_poses(rest, Path(DATA, name))
    assert poses.names == (rest.stem, *(f"{rest.stem}-{k:02d}" for k in range(1, frames + 1)))
    np.testing.assert_array_equal(poses.sequence.positions[3], read(Path(DATA, name, f"{poses.names[3]}.obj")).vertices)
    write_animation(tmp_path / "poses.glb", poses.sequence, names=poses.names)
    back = read_poses(tmp_path / "poses.glb")
    assert back.names == poses.names
    np.testing.assert_allclose(back.sequence.positions, poses.sequence.positions, atol=5e-7 * np.abs(poses.sequence.positions).max())


@pytest.mark.skipif(not DATA, reason="MORPHLET_DATA is not set: no public meshes")
def test_public_poses_of_several_animals_are_no_sequence():
    folder = Path(DATA, "tosca")
    assert read_sequence(*(folder / f"cat{k}.off" for k in range(4))).positions.shape == (4, 27894, 3)
    with pytest.raises(FileError, match=r"the 27894 vertices and 55712 faces of .*cat0\.off in .*dog0\.off; found 25290 vertices"):
        read_sequence(folder / "cat0.off", folder / "dog0.off")
    with pytest.raises(FileError, match=r"one file for each number from 0 to 7 in .*tosca; found no horse1\.off"):
        read_sequence(folder)
