"""Values at vertices: from mesh files and from files beside them, at places on the mesh, and into tables."""

import pickle

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphlet import FileError, InputError, Mesh, SurfacePoints, read, write
from morphlet.io.attributes import Attribute, parted, read_columns, read_own, save_arrays, write_table
from support import tetrahedron

MESH = tetrahedron()
PLACES = SurfacePoints([0, 2, 3], [[0.2, 0.3, 0.5], [0.5, 0.5, 0], [0, 1, 0]])
"""Faces are 0 2 1, 1 2 3 and 0 3 2."""
SEAMED = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\nvt 0.5 0.5\nf 1/1 2/2 3/3 4/4\nf -5/5 -4/-4 -1/-3\n"
"""A square and a triangle beyond a seam along its side from 1 to 2; the triangle counts back."""


def test_real_numbers_are_interpolated():
    found = Attribute("weight", [0.0, 10.0, 20.0, 30.0], MESH.faces)
    assert (found.kind, found.columns) == ("real", 1)
    np.testing.assert_allclose(found.at(PLACES), [0.3 * 20 + 0.5 * 10, 0.5 * 10 + 0.5 * 20, 30])


@pytest.mark.parametrize("values", [[5, 6, 7, 8], ["a", "b", "c", "d"], [False, True, False, True], [[5, 1], [6, 2], [7, 3], [8, 4]]])
def test_labels_come_from_the_nearest_corner(values):
    """Of two as near the first in the order of the face; nothing lies between labels."""
    found = Attribute("part", np.array(values), MESH.faces)
    assert found.kind == "label"
    np.testing.assert_array_equal(found.at(PLACES), np.array(values)[[1, 1, 3]])
    assert found.at(PLACES).dtype == found.values.dtype


def test_constants_stay_and_rows_survive_pickling():
    found = Attribute("color", np.full((4, 3), 0.7), MESH.faces)
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_allclose(again.at(PLACES), 0.7)
    assert (again.name, again.columns, again.values.flags.writeable) == ("color", 3, False)


def test_what_mesh_files_hold(tmp_path):
    colors = np.arange(12, dtype=np.uint8).reshape(4, 3)
    write(tmp_path / "a.ply", MESH, colors=colors)
    write(tmp_path / "b.off", MESH)
    own = read_own(tmp_path / "a.ply", MESH)
    assert list(own) == ["color"]
    np.testing.assert_array_equal(own["color"].values, colors)
    assert own["color"].kind == "real"
    assert read_own(tmp_path / "b.off", MESH) == {}


def test_each_side_of_a_seam_has_its_own_coordinates(tmp_path):
    (tmp_path / "a.obj").write_text(SEAMED, encoding="utf-8")
    mesh = read(tmp_path / "a.obj")
    uv = read_own(tmp_path / "a.obj", mesh)["uv"]
    middle = SurfacePoints([0, 1, 2], np.full((3, 3), 1 / 3))
    expected = [
        np.mean([[0, 0], [1, 0], [1, 1]], axis=0),
        np.mean([[0, 0], [1, 1], [0, 1]], axis=0),
        np.mean([[0.5, 0.5], [1, 0], [1, 1]], axis=0),
    ]
    np.testing.assert_allclose(uv.at(middle), expected)


def test_coordinates_that_some_corners_lack_are_none(tmp_path):
    (tmp_path / "a.obj").write_text(SEAMED.replace("-1/-3", "-1"), encoding="utf-8")
    assert read_own(tmp_path / "a.obj", read(tmp_path / "a.obj")) == {}


def test_arrays_and_columns(tmp_path):
    np.save(tmp_path / "skin.npy", np.float32([[1, 2], [3, 4], [5, 6], [7, 8]]))
    np.savez(tmp_path / "more.npz", part=np.arange(4), kind=np.array("mine"), weight=np.ones(4))
    (tmp_path / "t.csv").write_text('\ufeffbone, w ,n\n"left, hip",1,3\nknee,2.5,-4\n\ntoe,1e3,5\n x ,0,007\n', encoding="utf-8")
    skin = read_columns(str(tmp_path / "skin.npy"), MESH)
    assert [(one.name, one.kind, one.columns, one.values.dtype) for one in skin] == [("skin", "real", 2, np.float64)]
    assert [(one.name, one.kind) for one in read_columns(str(tmp_path / "more.npz"), MESH)] == [("part", "label"), ("weight", "real")]
    assert [one.name for one in read_columns(f"{tmp_path / 'more.npz'}:part", MESH)] == ["part"]
    table = {one.name: one.values.tolist() for one in read_columns(str(tmp_path / "t.csv"), MESH)}
    assert table == {"bone": ["left, hip", "knee", "toe", "x"], "w": [1, 2.5, 1000, 0], "n": [3, -4, 5, 7]}
    assert read_columns(f"{tmp_path / 't.csv'}:n", MESH)[0].kind == "label"


BAD = [
    ("a.csv", b"", FileError, "a first line with the names of the columns in .*a.csv; found ''"),
    ("a.csv", b"1,2\n3,4\n", FileError, "a first line with the names.*found '1,2'"),
    ("a.csv", b"a,a\n1,2\n", FileError, "each name once"),
    ("a.csv", b"a,\n1,2\n", FileError, "found 'a,'"),
    ("a.csv", b"a,b\n1,2\n3\n", FileError, "2 columns on line 3 of .*a.csv; found 1"),
    ("a.csv", b"a\n1\n2\n3\n", InputError, r"4 rows, one per vertex, in .*a.csv; found 'a' of shape \(3,\)"),
    ("a.csv", b"a,b\n1,1\n2,\n3,1\n4,1\n", FileError, "a number in each row of column b of .*; found 1 empty cell"),
    ("a.csv", b"a\n1\nnan\n3\n4\n", InputError, "finite numbers in a"),
    ("a.csv", b"\xff\xfe\x00", FileError, "save it as UTF-8"),
    ("a.npy", b"", FileError, "arrays of numbers or texts at .*a.npy"),
    ("a.npy", b"words", FileError, "save them again with numpy.save"),
    ("a.npz", b"PK\x03\x04", FileError, "arrays of numbers or texts at"),
]


@pytest.mark.parametrize(("name", "content", "error", "match"), BAD)
def test_bad_files(tmp_path, name, content, error, match):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(error, match=match):
        read_columns(str(tmp_path / name), MESH)


def test_missing_files_and_arrays(tmp_path):
    for name in ("gone.npy", "gone.npz", "gone.csv"):
        with pytest.raises(FileError, match="No such file"):
            read_columns(str(tmp_path / name), MESH)
    np.savez(tmp_path / "a.npz", part=np.arange(4), tips=np.arange(2), area=np.array(3.0))
    with pytest.raises(InputError, match=r"an array of .*a.npz: part, tips; found 'nose'"):
        read_columns(f"{tmp_path / 'a.npz'}:nose", MESH)
    with pytest.raises(InputError, match=r"4 rows.*found 'tips' of shape \(2,\); .*name one array as in a.npz:NAME \(part, tips\)"):
        read_columns(str(tmp_path / "a.npz"), MESH)
    np.savez(tmp_path / "b.npz", area=np.array(3.0))
    with pytest.raises(InputError, match="found no array"):
        read_columns(str(tmp_path / "b.npz"), MESH)


def test_nothing_is_unpickled(tmp_path):
    np.save(tmp_path / "a.npy", np.array([{}, 1, 2, 3], object), allow_pickle=True)
    with pytest.raises(FileError, match="Object arrays cannot be loaded"):
        read_columns(str(tmp_path / "a.npy"), MESH)


@pytest.mark.parametrize("values", [np.ones((4, 2, 2)), np.ones(4, complex), np.array(1.0)])
def test_values_that_are_no_attribute(values):
    with pytest.raises(InputError, match="numbers or texts in one or two dimensions as a"):
        Attribute("a", values, MESH.faces)


@pytest.mark.parametrize("word", ["colour", "skin.txt", "skin.csv:", ".npy", ""])
def test_words_that_name_no_file(word):
    with pytest.raises(InputError, match=r"color, uv or a file ending in \.npy or \.npz or \.csv as attribute"):
        parted(word)


def test_tables_have_a_name_per_column(tmp_path):
    arrays = {"color": np.uint8([[1, 2, 3], [4, 5, 6]]), "bone": np.array([[0.5, 0.25], [0, 1]]), "seen": np.array([True, False])}
    write_table(tmp_path / "a.csv", arrays)
    assert (tmp_path / "a.csv").read_text("utf-8") == "red,green,blue,bone_0,bone_1,seen\n1,2,3,0.5,0.25,1\n4,5,6,0.0,1.0,0\n"
    with pytest.raises(InputError, match="'u' twice"):
        write_table(tmp_path / "b.csv", {"uv": np.eye(2), "u": np.ones(2)})


def test_names_that_a_file_of_arrays_needs_itself(tmp_path):
    for name in ("valid", "kind", "file"):
        with pytest.raises(InputError, match=f"names other than kind, .*found '{name}'"):
            save_arrays(tmp_path / "a.npz", MESH, {name: np.ones(4)}, np.ones(4, bool))
    save_arrays(tmp_path / "a.npz", MESH, {"part": np.arange(4)}, np.ones(4, bool))
    with np.load(tmp_path / "a.npz", allow_pickle=False) as file:
        assert (str(file["kind"]), str(file["fingerprint"]), file["valid"].all()) == ("attributes", MESH.fingerprint, True)
    assert read_columns(f"{tmp_path / 'a.npz'}:part", MESH)[0].values.tolist() == [0, 1, 2, 3]


texts = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), max_size=6).map(lambda text: f"x{text}x")
four = {"min_size": 4, "max_size": 4}


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    real=st.lists(st.floats(allow_nan=False, allow_infinity=False), **four),
    part=st.lists(st.integers(-(10**17), 10**17), **four),
    name=st.lists(texts, **four),
)
def test_tables_come_back(tmp_path, real, part, name):
    write_table(tmp_path / "a.csv", {"real": np.array(real), "part": np.array(part), "name": np.array(name)})
    back = {one.name: one.values.tolist() for one in read_columns(str(tmp_path / "a.csv"), Mesh(MESH.vertices, MESH.faces))}
    assert back == {"real": real, "part": part, "name": name}
