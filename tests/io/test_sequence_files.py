"""Sequences as numbered files, and as animations."""

import json
import struct

import numpy as np
import pytest
import trimesh

from morphlet import FileError, InputError, Mesh, MeshSequence
from morphlet.io.formats import read, read_attributes, write
from morphlet.io.sequences import write_animation, write_sequence
from support import icosphere

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
