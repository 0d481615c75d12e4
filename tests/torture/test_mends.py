"""What `benchmarks/torture.py` once found, each by itself."""

import io
import json
import os
import zipfile

import numpy as np
import pytest

from cli.calls import call
from morphlet import FileError, InputError, Mesh, MeshError, MeshSequence, _store, read, read_pairs, rewrite, write, write_animation
from morphlet.cli.compression import _anchor
from morphlet.cli.motion import _poses
from morphlet.codec.decimation import decimated
from morphlet.io import gltf_scene
from morphlet.io._text import printable
from morphlet.io.attributes import read_columns
from morphlet.io.formats import read_attributes
from support import GLTF_POSITIONS, gltf_triangle, icosphere, tetrahedron

BOM = b"\xef\xbb\xbf"
TRIANGLE = b"v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf -4 -3 -2\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"


def put(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


# Text


@pytest.mark.parametrize("ending", [".obj", ".off", ".ply", ".stl"])
def test_a_byte_order_mark_changes_nothing(tmp_path, ending):
    if ending in (".obj", ".off"):
        write(tmp_path / f"a{ending}", tetrahedron())
        data = (tmp_path / f"a{ending}").read_bytes()
    elif ending == ".ply":
        data = (PLY + FACE).encode()
    else:
        data = b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n"
    whole, marked = read(put(tmp_path, f"b{ending}", data)), read(put(tmp_path, f"c{ending}", BOM + data))
    assert marked.fingerprint == whole.fingerprint
    rewrite(tmp_path / f"c{ending}", marked, tmp_path / f"d{ending}")
    assert read(tmp_path / f"d{ending}").fingerprint == whole.fingerprint


def test_a_byte_order_mark_does_not_hide_the_first_vertex(tmp_path):
    """By negative indices the mesh was another one, without a word."""
    assert read(put(tmp_path, "a.obj", BOM + TRIANGLE)).n_vertices == 4
    assert read(put(tmp_path, "a.obj", BOM + TRIANGLE)).faces.tolist() == [[0, 1, 2]]


def test_a_binary_stl_may_begin_as_text_does(tmp_path):
    write(tmp_path / "a.stl", tetrahedron())
    data = (tmp_path / "a.stl").read_bytes()
    assert read(put(tmp_path, "b.stl", BOM.ljust(80) + data[80:])).n_faces == 4


@pytest.mark.parametrize("more", [b"\0", b"\n", bytes(50)])
def test_a_binary_stl_that_is_longer_than_it_says_is_refused(tmp_path, more):
    write(tmp_path / "a.stl", tetrahedron())
    data = (tmp_path / "a.stl").read_bytes()
    with pytest.raises(FileError, match=f"284 bytes of binary STL in .*; found {284 + len(more)}: bytes were put in"):
        read(put(tmp_path, "b.stl", data[:100] + more + data[100:]))


def test_a_ply_header_has_a_bounded_number_of_names(tmp_path):
    many = "".join(f"property uchar p{k}\n" for k in range(1000))
    with pytest.raises(FileError, match="a PLY header on line 1004"):
        read(put(tmp_path, "a.ply", PLY + many + FACE))


def test_a_ply_header_of_blank_lines_is_written_again(tmp_path):
    """Its blank lines took the square of their number."""
    path = put(tmp_path, "a.ply", PLY + "\n" * 60_000 + FACE)
    rewrite(path, read(path), tmp_path / "b.ply")
    assert read(tmp_path / "b.ply").n_faces == 1


def test_messages_hold_nothing_that_a_terminal_obeys(tmp_path):
    with pytest.raises(FileError) as caught:
        read(put(tmp_path, "a.ply", "ply\nformat \x1b[2Jascii 1.0\nend_header\n"))
    assert "\\x1b[2Jascii" in str(caught.value)
    assert str(caught.value).isprintable()
    for text in ("source,\x1b[2Jtarget\n", "source,target\n1,\x1b[2J\n", "source,target,weight\n1,1,\x07\n"):
        with pytest.raises(FileError) as caught:
            read_pairs(put(tmp_path, "a.csv", text))
        assert str(caught.value).isprintable()
    assert printable("a\té\x7f\u202e") == "a\\té\\x7f\\u202e"


def test_lines_of_blanks_end_a_table(tmp_path):
    mesh = tetrahedron()
    found = read_columns(str(put(tmp_path, "a.csv", "a,b\n1,2\n3,4\n5,6\n7,8\n\n  \n")), mesh)
    assert found[0].values.tolist() == [1, 3, 5, 7]
    one = read_columns(str(put(tmp_path, "b.csv", 'a\nx\n""\ny\n""\n  \n')), mesh)
    assert one[0].values.tolist() == ["x", "", "y", ""]


@pytest.mark.skipif(not os.path.exists("/dev/zero"), reason="no such device here")
def test_devices_are_no_files(capsys, tmp_path):
    """They have no end: all of the memory went to them."""
    for reader in (read, read_pairs):
        with pytest.raises(FileError, match="a device"):
            reader("/dev/zero")
    with pytest.raises(FileError, match="a device"):
        _store.arrays_of("/dev/zero", "arrays")
    answer = call(capsys, "decode", "/dev/zero", "-o", tmp_path / "d", "--json")
    assert (answer.code, "a device" in answer.err) == (4, True)


# glTF


def scene(folder, **changes):
    """A triangle whose buffer lies beside it."""
    put(folder, "x.bin", GLTF_POSITIONS)
    return put(folder, "a.gltf", gltf_triangle("x.bin", **changes))


BUFFER = {"byteLength": 36, "uri": "x.bin"}
SCENES = {
    "as it is": ({}, None),
    "an accessor beyond its view": ({"bufferViews": [{"buffer": 0, "byteLength": 35}]}, "36 bytes in the glTF buffers.*found 35"),
    "a view beyond its buffer": ({"bufferViews": [{"buffer": 0, "byteLength": 37}]}, "37 bytes in a glTF buffer.*found 36"),
    "a view before its buffer": ({"bufferViews": [{"buffer": 1, "byteOffset": -4, "byteLength": 36}]}, "a glTF 2 scene"),
    "a file twice": ({"buffers": [BUFFER, BUFFER]}, "files as glTF buffers, each once"),
    "a file twice by another name": ({"buffers": [BUFFER, BUFFER | {"uri": "./x.bin"}]}, "files as glTF buffers, each once"),
    "a second buffer without a name": ({"buffers": [BUFFER, {"byteLength": 1}]}, "1 bytes in a glTF buffer.*found 0"),
    "a folder": ({"buffers": [BUFFER | {"uri": "."}]}, "files as glTF buffers"),
    "a long name": ({"buffers": [BUFFER | {"uri": "y" * 3000}]}, "the glTF buffer 'y{60}'"),
}


@pytest.mark.parametrize("name", SCENES)
def test_buffers_of_a_scene(tmp_path, name):
    changes, match = SCENES[name]
    path = scene(tmp_path, **changes)
    if match is None:
        assert read(path).n_faces == 1
        return
    with pytest.raises(FileError, match=match):
        read(path)


@pytest.mark.skipif(os.name == "nt", reason="links and pipes are POSIX")
def test_buffers_by_links(tmp_path):
    inside = tmp_path / "inside"
    inside.mkdir()
    path = scene(inside)
    (inside / "x.bin").rename(tmp_path / "y.bin")
    for target, match in (("../y.bin", "in the folder of the file"), ("x.bin", "the glTF buffer 'x.bin'"), ("/dev/zero", "in the folder")):
        (inside / "x.bin").symlink_to(target)
        with pytest.raises(FileError, match=match):
            read(path)
        (inside / "x.bin").unlink()
    os.mkfifo(inside / "x.bin")
    with pytest.raises(FileError, match="files as glTF buffers"):
        read(path)


def test_what_a_scene_says_instead_of_a_number_is_shown(tmp_path):
    """A refusal without what was found says nothing."""
    write(tmp_path / "a.glb", icosphere(0), colors=np.zeros((12, 3), np.uint8))
    data = (tmp_path / "a.glb").read_bytes()
    length = int.from_bytes(data[12:16], "little")
    tree = json.loads(data[20 : 20 + length])
    tree["accessors"][tree["meshes"][0]["primitives"][0]["attributes"]["COLOR_0"]]["count"] = ""
    path = put(tmp_path, "b.glb", gltf_scene.packed(tree, bytearray(data[28 + length :])))
    with pytest.raises(FileError, match=r"12 rows of COLOR_0, one per vertex in .*; found '';"):
        read_attributes(path)


def test_small_scenes_unfold_to_a_bounded_size(tmp_path, monkeypatch):
    path = scene(tmp_path, nodes=[{"mesh": 0}] * 50, scenes=[{"nodes": list(range(50))}])
    assert read(path).n_vertices == 150
    monkeypatch.setattr(gltf_scene, "ROOM", 300)
    with pytest.raises(FileError, match=r"triangles of at most 588 numbers in a glTF file of its size in .*; found 600"):
        read(path)


def test_targets_and_shapes_unfold_to_a_bounded_size(tmp_path, monkeypatch):
    from morphlet import read_poses

    ball = icosphere(0)
    frames = MeshSequence(ball.topology, np.stack([ball.vertices * (1 + k) for k in range(9)]), np.arange(9.0))
    write_animation(tmp_path / "a.glb", frames)
    assert len(read_poses(tmp_path / "a.glb").names) == 9
    monkeypatch.setattr(gltf_scene, "TIMES", 0)
    monkeypatch.setattr(gltf_scene, "ROOM", 300)
    with pytest.raises(FileError, match=r"shapes of at most 300 numbers.*found 396"):
        read_poses(tmp_path / "a.glb")
    for room, what in ((100, "morph targets"), (90, "triangles")):
        monkeypatch.setattr(gltf_scene, "ROOM", room)
        with pytest.raises(FileError, match=f"{what} of at most {room} numbers"):
            read_poses(tmp_path / "a.glb")


def test_poses_whose_names_are_alike_as_files_are_all_kept(tmp_path):
    ball = icosphere(0)
    frames = MeshSequence(ball.topology, np.stack([ball.vertices * (1 + k) for k in range(3)]), np.arange(3.0))
    write_animation(tmp_path / "a.glb", frames, names=("rest", "a/b", "a_b"))
    names, poses = _poses(read(tmp_path / "a.glb"), [tmp_path / "a.glb"])
    assert len(set(names)) == len(poses) == 3


# Arrays


def zipped(members, method=zipfile.ZIP_DEFLATED):
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method) as archive:
        for name, data in members.items():
            archive.writestr(name, data)
    return stream.getvalue()


def npy(array, **how):
    stream = io.BytesIO()
    np.save(stream, array, **how)
    return stream.getvalue()


def header(shape, kind="<f8"):
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return stream.getvalue()


ARRAYS = {
    "8 TB": (header((10**12,)), "0 bytes for an array of 1000000000000 times float64"),
    "10^300": (header((10**300,)), "0 bytes for an array"),
    "negative": (header((-2, -3)) + bytes(48), "48 bytes for an array"),
    "no bytes each": (header((10**12,), "<U0"), "."),
    "a byte more": (npy(np.zeros(2)) + b"\0", "17 bytes for an array of 2 times float64"),
    "objects": (npy(np.array([{}], object), allow_pickle=True), "Object arrays cannot be loaded"),
    "brackets": (b"\x93NUMPY\x01\x00\x28\x23" + b"[" * 9000, "."),
    "an open string": (b"\x93NUMPY\x01\x00\x10\x00" + b"{'descr': '''   ", "."),
    "a later version": (b"\x93NUMPY\x03\x00" + bytes(100), "version"),
}


@pytest.mark.parametrize("name", ARRAYS)
def test_arrays_hold_the_bytes_that_are_there(tmp_path, name):
    data, match = ARRAYS[name]
    for path in (put(tmp_path, "a.npy", data), put(tmp_path, "a.npz", zipped({"a.npy": data}))):
        with pytest.raises(FileError, match=match) as caught:
            _store.arrays_of(path, "arrays")
        assert len(str(caught.value)) < 500


def test_archives_unpack_to_a_bounded_size(tmp_path, monkeypatch):
    path = put(tmp_path, "a.npz", zipped({"a.npy": npy(np.zeros(100_000))}))
    assert _store.arrays_of(path, "arrays")["a"].shape == (100_000,)
    monkeypatch.setattr(_store, "ROOM", 1000)
    with pytest.raises(FileError, match="bytes that unpack to 800128, more than"):
        _store.arrays_of(path, "arrays")


def test_other_members_and_other_ways_to_pack(tmp_path):
    members = {"../../a.npy": npy(np.ones(2)), "run.pickle": b"cos\nsystem\n", "b.npy": npy(np.asfortranarray(np.eye(3)[:2]))}
    found = _store.arrays_of(put(tmp_path, "a.npz", zipped(members)), "arrays")
    assert set(found) == {"../../a", "b"}
    assert found["b"].tolist() == [[1, 0, 0], [0, 1, 0]]
    assert {path.name for path in tmp_path.iterdir()} == {"a.npz"}
    with pytest.raises(FileError, match="packed in a way that numpy has not"):
        _store.arrays_of(put(tmp_path, "b.npz", zipped(members, zipfile.ZIP_BZIP2)), "arrays")


@pytest.mark.parametrize("version", [np.zeros(3), np.array("x"), np.array(np.nan), np.array(9)])
def test_versions_are_whole_numbers(tmp_path, version):
    np.savez(tmp_path / "a.npz", kind=np.array("x"), version=version)
    with pytest.raises(FileError, match="version 1 or older of x"):
        _store.load(tmp_path / "a.npz", "x", 1, ())


def test_stored_arrays_are_numbers_and_texts(tmp_path):
    np.savez(tmp_path / "a.npz", kind=np.array("x"), version=np.array(1), a=np.zeros(3, "M8[s]"))
    with pytest.raises(FileError, match=r"numbers and texts in .*; found 'a' of type datetime64"):
        _store.load(tmp_path / "a.npz", "x", 1, ("a",))


# Edits and schedules


TOMLS = {
    "nested lists": "x = " + "[" * 100_000,
    "nested tables": "x = " + "{a=" * 100_000,
    "dotted keys": ".".join(["a"] * 100_000) + " = 1",
    "digits": "x = " + "9" * 100_000,
    "65 bits": "x = 18446744073709551616",
    "Latin-1": "x = 'caf\xe9'",
}


@pytest.mark.parametrize("name", TOMLS)
def test_toml_is_bounded(tmp_path, name):
    with pytest.raises(FileError, match="needed a script; found"):
        _store.toml(put(tmp_path, "a.toml", TOMLS[name].encode("latin-1")), "a script")


def test_toml_as_people_write_it(tmp_path):
    text = "a.b = [1, -2.5, 9223372036854775807]\nc = 'https://a.b.c/d.e'\n[d]\ne = {f = true}\n"
    found = _store.toml(put(tmp_path, "a.toml", BOM + text.replace("\n", "\r\n").encode()), "a script")
    assert found == {"a": {"b": [1, -2.5, 2**63 - 1]}, "c": "https://a.b.c/d.e", "d": {"e": {"f": True}}}


@pytest.mark.parametrize(
    ("text", "code"),
    [
        *((text, 4) for text in TOMLS.values()),
        ("method = 'ffd'\nhandle = [0]\nanchors = [5]\nscale = 2\nffd.lattice = [1000000, 1000000, 1000000]\n", 2),
        ("method = 'ffd'\nhandle = [0]\nanchors = [5]\nscale = 2\nffd.lattice = []\n", 2),
        ("method = 'dual'\nhandle = [0]\nanchors = [5]\nscale = 2\niterations = 1000000000000\n", 2),
    ],
)
def test_edits_that_no_machine_can_do_are_refused(capsys, tmp_path, text, code):
    write(tmp_path / "a.ply", icosphere(1))
    spec = put(tmp_path, "a.toml", text.encode("latin-1"))
    answer = call(capsys, "deform", tmp_path / "a.ply", spec, "-o", tmp_path / "b.ply", "--json")
    assert (answer.code, answer.err.startswith("morphlet deform: needed ")) == (code, True)


def test_schedules_are_bounded_too(capsys, tmp_path):
    write(tmp_path / "a.ply", icosphere(1))
    plan = put(tmp_path, "a.toml", TOMLS["dotted keys"])
    words = ("morph", tmp_path / "a.ply", tmp_path / "a.ply", "-o", tmp_path / "m", "--schedule", plan)
    assert call(capsys, *words).code == 4


# Companions


def test_a_figure_to_compare_with_may_fail():
    """DracoPy ends its process for meshes of a trillionth of a unit."""
    assert _anchor(b"no such file") is None


def test_the_studio_without_its_extras_says_so(capsys, monkeypatch):
    import builtins

    genuine = builtins.__import__

    def without(name, *rest, **more):
        if name.startswith("morphlet.studio.server"):
            raise ModuleNotFoundError("No module named 'starlette'", name="starlette")
        return genuine(name, *rest, **more)

    monkeypatch.setattr(builtins, "__import__", without)
    answer = call(capsys, "studio", "--no-browser")
    assert (answer.code, "pip install morphlet[studio]" in answer.err) == (2, True)


def test_what_is_too_large_for_a_refusal_is_cut(tmp_path):
    with pytest.raises((FileError, InputError)) as caught:
        read(put(tmp_path, "a.ply", "ply\nformat " + "x" * 10**6 + "\nend_header\n"))
    assert len(str(caught.value)) < 1000


def test_decimation_refuses_what_would_end_the_process():
    ball = icosphere(1)
    for faces, found in (
        ([*ball.faces, [0, 1, 1]], "1 face with fewer"),
        (np.vstack([ball.faces[:40], ball.faces[40:, ::-1]]), "directed edges used twice"),
    ):
        with pytest.raises(MeshError, match=found):
            decimated(Mesh(ball.vertices, faces), 20)
