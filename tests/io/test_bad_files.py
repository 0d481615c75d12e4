"""Broken files: a `FileError` with what was needed and found, never another error, never a hang."""

import base64

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphlet import FileError, InputError, Mesh
from morphlet.io.content import File
from morphlet.io.formats import FORMATS, read, read_attributes, rewrite, write
from morphlet.io.ply import rewriter as ply_rewriter
from support import GLTF_POSITIONS, gltf_triangle

TETRAHEDRON = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1 / 3]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
BINARY = PLY.replace("ascii", "binary_little_endian") + FACE
ROWS = "0 0 0\n1 0 0\n0 1 0\n"


def put(folder, name, content):
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def test_missing_file_folder_and_empty_file(tmp_path):
    with pytest.raises(FileError, match=r"a mesh file at .*; found No such file"):
        read(tmp_path / "no.obj")
    with pytest.raises(FileError, match="Is a directory"):
        read(tmp_path)
    with pytest.raises(FileError, match="an empty file"):
        read(put(tmp_path, "a.obj", b""))
    with pytest.raises(FileError, match="null"):
        read("a\0b.obj")


@pytest.mark.parametrize("junk", [b"\0" * 500, bytes(range(256)) * 4, b"PK\x03\x04" + b"\x7f" * 99, b"hello world\n", b"\n"])
def test_other_content_names_the_known_formats(tmp_path, junk):
    with pytest.raises(FileError, match=r"a PLY, glTF, OFF, STL, OBJ file in .*junk\.dat; found none of these"):
        read(put(tmp_path, "junk.dat", junk))
    for known in FORMATS:
        with pytest.raises(FileError, match="junk"):
            read(put(tmp_path, f"junk{known.endings[0]}", junk))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        (TRIANGLE, "needed faces in .*; found 3 vertices and no face"),
        (TRIANGLE + "f 1 2\n", "no face with three corners"),
        ("f 1 2 3\n", "needed vertices in .*; found none"),
        (TRIANGLE + "f 1 2 4\n", "faces of 3 vertices in .*; found 1 faces with vertex indices outside 0 to 2, the first on line 4"),
        (TRIANGLE + "f 1 2 3\n\nf 1 2 -4\n", "the first on line 6"),
        (TRIANGLE + "f 0 1 2\n", "vertex indices from 1, .* on line 4 .*'0'"),
        (TRIANGLE + "f 1 2 3.5\n", "on line 4 .*'3.5'"),
        (TRIANGLE + "f 1 2 x\n", "on line 4 .*'x'"),
        (TRIANGLE + "f 1 2 " + "9" * 30 + "\n", "on line 4 .*'999"),
        (TRIANGLE + "f 1 2 /3\n", "on line 4 .*'/3'"),
        ("v 0 0 0\nv 1 2 abc\nv 0 1 0\nf 1 2 3\n", "a number on line 2 .*'abc'"),
        ("v 0 0 0\nv 1 \\\n 2 0\n\nv 1,5 2 0\nf 1 2 3\n", "a number on line 5 .*'1,5'"),
        ("v 0 0 0\nv 1.5.3 abc 1\nv 0 1 0\nf 1 2 3\n", "a number on line 2 .*'1.5.3'"),
        ("v 0 0 0\nv 1 2\nv 0 1 0\nf 1 2 3\n", "3 numbers after 'v' in .*; found 2 on line 2"),
        ("v 0 0 0\nv nan 0 0\nv 0 inf 0\nf 1 2 3\n", r"finite coordinates in .*; found NaN or infinite ones at 2 vertices \(first: 1, 2\)"),
        ("v 0 0 0\nv 1e400 0 0\nv 0 1 0\nf 1 2 3\n", "infinite ones at 1 vertices"),
    ],
)
def test_obj(tmp_path, text, match):
    with pytest.raises(FileError, match=match):
        read(put(tmp_path, "a.obj", text))


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("OFF\n", "the counts of vertices and faces after 'OFF'"),
        ("OFF\n3 1 0\n0 0 0\n1 0 0\n", "3 vertex lines and 1 face lines in .*; found 2 lines"),
        ("OFF\n999999999999 999999999999 0\n0 0 0\n", "found 1 lines"),
        ("OFF\n1e300 1 0\n0 0 0\n", "two counts after 'OFF'"),
        ("OFF\n-3 1 0\n0 0 0\n", "two counts after 'OFF'"),
        (f"OFF\n3 1 0\n{ROWS}3 0 1 3\n", "vertex indices outside 0 to 2, the first on line 6"),
        (f"OFF\n3 1 0\n{ROWS}3 0 1 1e300\n", "the first on line 6"),
        (f"OFF\n3 1 0\n{ROWS}3 0 1\n", "a count of corners, then so many indices on line 6"),
        (f"OFF\n3 1 0\n{ROWS}-3 0 1 2\n", "on line 6 .*count -3"),
        (f"OFF\n3 1 0\n{ROWS}3 0 1 1.5\n", "whole numbers as indices on line 6"),
        (f"OFF\n3 1 0\n{ROWS}3 0 1 z\n", "a number on line 6 .*'z'"),
        ("OFF\n3 1 0\n0 0 0\n1 0\n0 1 0\n3 0 1 2\n", "three coordinates per vertex line in .*; found 2 on line 4"),
        ("OFF BINARY\n\0\0\0\3", "a text OFF file in three dimensions"),
    ],
)
def test_off(tmp_path, text, match):
    with pytest.raises(FileError, match=match):
        read(put(tmp_path, "a.off", text))


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (PLY, "the line 'end_header'"),
        (PLY + FACE + ROWS, "1 lines for element 'face' in .*; found 0"),
        (PLY + FACE + ROWS + "3 0 1\n", "all properties of an element on line 13"),
        (PLY + FACE + ROWS + "3 0 1 5\n", "outside 0 to 2, the first on line 13"),
        (PLY + FACE + ROWS.replace("1 0 0", "1 oh 0") + "3 0 1 2\n", "a number on line 11 .*'oh'"),
        (PLY + FACE + ROWS + "3 0 1 1.5\n", "whole numbers as indices on line 13"),
        (PLY + FACE + ROWS + "-1 0 1 2\n", "all properties of an element on line 13"),
        (PLY + "end_header\n" + ROWS, "needed faces"),
        (PLY.replace(" x", " a") + FACE + ROWS + "3 0 1 2\n", "vertex properties x, y, z in .*; found a, y, z"),
        (PLY.replace("vertex", "vortex") + FACE + ROWS + "3 0 1 2\n", "an element 'vertex' in the header"),
        (PLY.replace("vertex 3", "vertex 0") + FACE + "3 0 1 2\n", "needed vertices"),
        (PLY.replace("vertex 3", "vertex -3") + FACE, "a PLY header on line 3 .*'element vertex -3'"),
        (PLY.replace("vertex 3", "vertex " + "9" * 5000) + FACE, "a PLY header on line 3"),
        (PLY.replace(" y", " x") + FACE, "a PLY header on line 5"),
        (PLY + FACE.replace("face", "vertex"), "a PLY header on line 7"),
        (PLY + FACE + ROWS.replace("1 0 0", "1 0 0 # here") + "3 0 1 2\n", "a number on line 11 .*'#'"),
        (PLY.replace("float x", "quad x") + FACE, "a PLY header on line 4"),
        (PLY.replace("ascii", "binary_middle_endian") + FACE, "a PLY header on line 2"),
        (PLY.replace("format ascii 1.0\n", "") + FACE, "a line 'format'"),
        (PLY + FACE.replace("vertex_indices", "corners") + ROWS + "3 0 1 2\n", "a list 'vertex_indices'"),
        ("ply\nproperty float x\n", "the line 'end_header'"),
        ("ply\nproperty float x\nend_header\n", "a PLY header on line 2"),
        (BINARY.encode() + bytes(20), "36 bytes for 3 rows of element 'vertex' in .*; found 20"),
        (BINARY.encode() + bytes(36), "1 rows of element 'face', of which row 0 has 0 values"),
        (BINARY.encode() + bytes(36) + b"\x03" + bytes(11), "row 0 has 3 values in .*; found 1 bytes too few"),
        (BINARY.replace("vertex 3", "vertex 999999999999").encode() + bytes(99), "11999999999988 bytes for 999999999999 rows"),
        (BINARY.replace("face 1", "face 999999999999").encode() + bytes(99), "999999999999 rows of element 'face'"),
        (BINARY.replace("uchar int", "int int").encode() + bytes(36) + b"\xff\xff\xff\x7f", "row 0 has 2147483647 values"),
        (BINARY.replace("uchar int", "int int").encode() + bytes(36) + b"\xff\xff\xff\xff", "a negative count"),
        (BINARY.encode() + bytes(36) + b"\x03" + np.array([0, 1, 3], "<i4").tobytes(), "1 faces with .* by face index"),
        (BINARY.encode() + np.full(9, np.nan, "<f4").tobytes() + b"\x03" + bytes(12), r"infinite ones at 3 vertices \(first: 0, 1, 2\)"),
    ],
)
def test_ply(tmp_path, content, match):
    with pytest.raises(FileError, match=match):
        read(put(tmp_path, "a.ply", content))


def test_ply_template_with_lists_at_its_vertices_is_refused(tmp_path):
    head = PLY.replace("property float z\n", "property float z\nproperty list uchar int ring\n")
    data = (head + FACE + "0 0 0 1 7\n1 0 0 0\n0 1 0 2 1 2\n3 0 1 2\n").encode()
    assert read(put(tmp_path, "a.ply", data)).n_faces == 1
    with pytest.raises(FileError, match="vertices without list properties"):
        ply_rewriter(File(tmp_path / "a.ply", data))


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\n", "three corners of three numbers per facet"),
        (b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 zero\nvertex 0 1 0\n", "a number on line .*'zero'"),
        (b"solid a\nendsolid a\n", "needed vertices"),
        (bytes(80) + b"\x02\0\0\0" + bytes(60), "184 bytes of binary STL in .*; found 144"),
        (bytes(80) + b"\xff\xff\xff\xff" + bytes(60), "214748364834 bytes of binary STL"),
        (bytes(30), "a header of 84 bytes of binary STL"),
    ],
)
def test_stl(tmp_path, content, match):
    with pytest.raises(FileError, match=match):
        read(put(tmp_path, "a.stl", content))


def gltf(**changes):
    uri = "data:application/octet-stream;base64," + base64.b64encode(GLTF_POSITIONS).decode()
    return gltf_triangle(uri, **changes)


def test_gltf_by_hand_reads(tmp_path):
    assert read(put(tmp_path, "a.gltf", gltf())).faces.tolist() == [[0, 1, 2]]


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"nodes": []}, "a glTF 2 scene"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "two parents"),
        ({"nodes": [{}]}, "a scene with triangles"),
        ({"nodes": [{"mesh": 0, "rotation": [0, 0, 0, 0]}]}, "a glTF 2 scene"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 10**12, "type": "VEC3"}]}, "12000000000000 bytes"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": -3, "type": "VEC3"}]}, "a glTF 2 scene"),
        ({"accessors": [{"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3", "sparse": {}}]}, "a glTF 2 scene"),
        ({"bufferViews": [{"buffer": 0, "byteLength": 36, "byteStride": 0}]}, "in the glTF buffers"),
        ({"buffers": [{"byteLength": 36, "uri": "gone.bin"}]}, "the glTF buffer 'gone.bin'"),
        ({"buffers": [{"byteLength": 36, "uri": "../x.bin"}]}, "glTF buffers in the folder of the file"),
        ({"buffers": [{"byteLength": 99, "uri": "data:,AAAA"}]}, "99 bytes in a glTF buffer"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "extensions": {"KHR_draco_mesh_compression": {}}}]}]}, "Draco"),
    ],
)
def test_gltf(tmp_path, changes, match):
    with pytest.raises(FileError, match=match):
        read(put(tmp_path, "a.gltf", gltf(**changes)))


def test_glb_cut_short_and_of_version_1(tmp_path):
    write(tmp_path / "a.glb", TETRAHEDRON)
    data = (tmp_path / "a.glb").read_bytes()
    with pytest.raises(FileError, match=rf"{len(data)} bytes of binary glTF in .*; found {len(data) - 9}"):
        read(put(tmp_path, "b.glb", data[:-9]))
    with pytest.raises(FileError, match=r"glTF version 2 in .*; found 1"):
        read(put(tmp_path, "b.glb", data[:4] + b"\1" + data[5:]))


@pytest.mark.parametrize("ending", [".stl", ".glb"])
def test_numbers_too_large_for_single_precision_are_not_written(tmp_path, ending):
    with pytest.raises(InputError, match="single precision"):
        write(tmp_path / f"a{ending}", TETRAHEDRON.with_vertices(1e60 * (TETRAHEDRON.vertices + 1)))
    assert not list(tmp_path.iterdir())


VALID = {
    "obj": b"# made\nmtllib a.mtl\nv 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 \\\n0 0 0 1\nv 0 0 1 1 1 1\n"
    b"vt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf -1 1 2\n",
    "off": b"COFF # made\n4 2 0\n0 0 0 255 0 0\n1 0 0 9 9 9\n0 1 0 1 2 3\n0 0 1 4 5 6\n3 0 1 2\n4 0 1 2 3 1 2 3\n",
    "ply": (PLY + FACE.replace("face 1", "face 2") + ROWS + "3 0 1 2\n4 0 1 2 0\n").encode(),
    "stl": b"solid a\nfacet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\nendsolid a\n",
    "gltf": gltf().encode(),
}


def binary(folder):
    for ending in ("ply", "stl", "glb"):
        write(folder / f"a.{ending}", TETRAHEDRON)
        yield ending, (folder / f"a.{ending}").read_bytes()
    mixed = b"\x03" + np.array([0, 1, 2], "<i4").tobytes() + b"\x04" + np.array([0, 1, 2, 0], "<i4").tobytes()
    yield "ply", BINARY.replace("face 1", "face 2").encode() + np.eye(3, dtype="<f4").tobytes() + mixed


def attempt(folder, ending, data):
    """Everything that reads a file may only succeed or raise a `FileError`."""
    path = put(folder, f"mutant.{ending}", data)
    try:
        mesh = read(path)
    except FileError:
        return
    try:
        read_attributes(path)
        rewrite(path, mesh, folder / f"again.{'glb' if ending == 'gltf' else ending}")
    except FileError:
        pass
    except InputError as error:
        if "single precision" not in error.needed:
            raise


def test_files_cut_anywhere(tmp_path):
    for ending, data in (*VALID.items(), *binary(tmp_path)):
        read(put(tmp_path, f"whole.{ending}", data))
        for stop in range(0, len(data), max(1, len(data) // 150)):
            attempt(tmp_path, ending, data[:stop])


@settings(max_examples=400, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(draw=st.data())
def test_files_with_changed_bytes(tmp_path, draw):
    ending, data = draw.draw(st.sampled_from([*VALID.items(), *binary(tmp_path)]))
    mutant = bytearray(data)
    words = [*b"-1 999999999999 1e999 nan / \\ 0.5 {} \x00 [] # x".split(), b"\n", b" ", b"\r"]
    pieces = st.one_of(st.binary(max_size=4), st.sampled_from(words))
    for _ in range(draw.draw(st.integers(1, 4))):
        place = draw.draw(st.integers(0, len(mutant)))
        mutant[place : place + draw.draw(st.integers(0, 6))] = draw.draw(pieces)
    attempt(tmp_path, ending, bytes(mutant))
