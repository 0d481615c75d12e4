"""`carry`: colours, texture coordinates, labels and weights, through a map, into meshes and tables."""

import re

import numpy as np
import pytest

from cli.calls import call
from cli.test_verbs import told
from mapping.stars import blob
from morphlet import Correspondence, Mesh, Picture, SurfacePoints, read, write
from morphlet.io.formats import read_attributes
from morphlet.surface.nearest import nearest
from support import data_file, icosphere, relabelled

BALL = blob(1)
OTHER, PLACE = relabelled(BALL)
"""The same ball in another order, and where each of its vertices went."""


def coloring(points):
    """Colours that change linearly with the place, rounded to bytes."""
    return np.round(100 + 40 * points).astype(np.uint8)


@pytest.fixture
def files(tmp_path):
    """A, B with colours, and the map from A to B that puts each vertex on its twin."""
    write(tmp_path / "a.ply", BALL)
    write(tmp_path / "b.ply", OTHER, colors=coloring(OTHER.vertices))
    Correspondence(BALL, OTHER, nearest(OTHER, BALL.vertices)).save(tmp_path / "map.npz")
    return tmp_path / "a.ply", tmp_path / "b.ply", tmp_path / "map.npz"


@pytest.mark.parametrize("ending", ["ply", "obj", "glb"])
def test_colours_arrive_at_their_vertices(capsys, tmp_path, files, ending):
    output = tmp_path / f"out.{ending}"
    result = told(call(capsys, "carry", *files, "--attribute", "color", "-o", output, "--json"), "carry", "attributes", "unanswered")
    assert result["attributes"] == [{"name": "color", "kind": "real", "rows": 42, "columns": 3}]
    assert (result["unanswered"], result["inputs"], result["outputs"]) == (0, [str(file) for file in files], [str(output)])
    np.testing.assert_array_equal(read_attributes(output).colors, coloring(BALL.vertices))
    np.testing.assert_array_equal(read(output).faces, BALL.faces)
    if ending != "glb":  # single precision there
        np.testing.assert_array_equal(read(output).vertices, BALL.vertices)


def test_numbers_are_interpolated_and_labels_are_not(capsys, tmp_path, files):
    """A finer ball onto a coarser one: most vertices fall inside a triangle."""
    fine = icosphere(3).with_vertices(icosphere(3).vertices * 2)
    write(tmp_path / "fine.off", fine)
    where = nearest(OTHER, fine.vertices)
    Correspondence(fine, OTHER, where).save(tmp_path / "fine.npz")
    part = np.arange(OTHER.n_vertices) % 3
    np.savez(tmp_path / "b.npz", part=part, height=OTHER.vertices[:, 2], place=OTHER.vertices, name=np.array(["u", "v", "w"])[part])
    words = (tmp_path / "fine.off", files[1], tmp_path / "fine.npz", "--attribute", tmp_path / "b.npz", "color", "-o", tmp_path / "o.npz")
    result = told(call(capsys, "carry", *words, "--json"), "carry")
    assert [(one["name"], one["kind"], one["columns"]) for one in result["attributes"]] == [
        ("part", "label", 1), ("height", "real", 1), ("place", "real", 3), ("name", "label", 1), ("color", "real", 3),
    ]  # fmt: skip
    assert str(tmp_path / "b.npz") in result["inputs"]
    with np.load(tmp_path / "o.npz", allow_pickle=False) as file:
        found = dict(file)
    np.testing.assert_allclose(found["place"], where.positions(OTHER), atol=1e-12)
    np.testing.assert_allclose(found["height"], found["place"][:, 2], atol=1e-12)
    np.testing.assert_array_equal(found["part"], part[OTHER.faces[where.faces][np.arange(fine.n_vertices), where.weights.argmax(axis=1)]])
    np.testing.assert_array_equal(found["name"], np.array(["u", "v", "w"])[found["part"]])
    assert found["color"].dtype == np.uint8
    assert np.abs(found["color"] - (100 + 40 * found["place"])).max() <= 1  # rounded before and after
    assert (str(found["kind"]), str(found["fingerprint"]), found["valid"].all()) == ("attributes", fine.fingerprint, True)


def test_a_table_of_columns(capsys, tmp_path, files):
    rows = "".join(f"{k},{k / 8},limb {k % 2}\n" for k in range(42))
    (tmp_path / "skin.csv").write_text("id,weight,limb\n" + rows, encoding="utf-8")
    words = ("--attribute", tmp_path / "skin.csv", "-o", tmp_path / "out.csv", "--json")
    result = told(call(capsys, "carry", *files, *words), "carry")
    assert [(one["name"], one["kind"]) for one in result["attributes"]] == [("id", "label"), ("weight", "real"), ("limb", "label")]
    lines = (tmp_path / "out.csv").read_text("utf-8").splitlines()
    assert lines[0] == "id,weight,limb"
    assert [line.split(",")[0] for line in lines[1:]] == [str(k) for k in PLACE]
    assert lines[1].split(",")[2] == f"limb {PLACE[0] % 2}"
    one = ("--attribute", f"{tmp_path / 'skin.csv'}:limb", "-o", tmp_path / "one.csv", "--json")
    assert [a["name"] for a in told(call(capsys, "carry", *files, *one), "carry")["attributes"]] == ["limb"]


def test_uv_across_a_seam_come_from_the_side_one_falls_on(capsys, tmp_path):
    """A square whose two halves lie on different parts of the texture; A has its vertices inside them."""
    lines = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 0.1 0\nvt 0.1 0.1\nvt 0.9 0.9\nvt 1 1\nvt 0.9 1\n"
    (tmp_path / "b.obj").write_text(lines + "f 1/1 2/2 3/3\nf 1/4 3/5 4/6\n", encoding="utf-8")
    b = read(tmp_path / "b.obj")
    a = Mesh([[0.7, 0.2, 0], [0.3, 0.8, 0], [1.0, 0, 0], [0, 1, 0]], [[0, 2, 1], [0, 1, 3]])
    write(tmp_path / "a.ply", a, colors=np.uint8(np.arange(12).reshape(4, 3)))
    Correspondence(a, b, nearest(b, a.vertices)).save(tmp_path / "map.npz")
    names = [tmp_path / name for name in ("a.ply", "b.obj", "map.npz")]
    told(call(capsys, "carry", *names, "--attribute", "uv", "-o", tmp_path / "o.ply", "--json"), "carry")
    found = read_attributes(tmp_path / "o.ply")
    np.testing.assert_allclose(found.uv, [[0.07, 0.02], [0.93, 0.98], [0.1, 0], [0.9, 1]], atol=1e-12)
    np.testing.assert_array_equal(found.colors, np.arange(12).reshape(4, 3))  # A's own, since none were carried


def test_vertices_without_an_answer_are_marked(capsys, tmp_path, files):
    valid = np.arange(42) % 4 > 0
    Correspondence(BALL, OTHER, nearest(OTHER, BALL.vertices), valid).save(tmp_path / "some.npz")
    words = (*files[:2], tmp_path / "some.npz", "--attribute", "color", "-o", tmp_path / "o.npz", "--json")
    assert told(call(capsys, "carry", *words), "carry")["unanswered"] == 11
    with np.load(tmp_path / "o.npz", allow_pickle=False) as file:
        np.testing.assert_array_equal(file["valid"], valid)


def test_through_a_map_that_correspond_wrote(capsys, tmp_path, files):
    assert call(capsys, "correspond", *files[:2], "-o", tmp_path / "c.npz", "--quiet").code == 0
    words = (*files[:2], tmp_path / "c.npz", "--attribute", "color", "-o", tmp_path / "o.ply", "--json")
    assert told(call(capsys, "carry", *words), "carry")["unanswered"] == 0
    off = np.abs(read_attributes(tmp_path / "o.ply").colors.astype(int) - coloring(BALL.vertices))
    assert off.max() < 20  # of 100 and more from side to side: the map is not exact


@pytest.mark.parametrize("attribute", ["color", "part.npy", "height.npy", "place.npy"])
def test_pictures_show_both_meshes_alike(capsys, tmp_path, files, monkeypatch, attribute):
    np.save(tmp_path / "part.npy", np.arange(42) % 3)
    np.save(tmp_path / "height.npy", OTHER.vertices[:, 2])
    np.save(tmp_path / "place.npy", OTHER.vertices[:, :2])
    seen = []

    def draw(mesh, *, colors):
        seen.append((mesh, colors))
        return Picture(np.zeros((2, 3, 3), np.uint8), "none", "a test")

    monkeypatch.setattr("morphlet.report.carried.render", draw)
    word = attribute if attribute == "color" else tmp_path / attribute
    words = ("--attribute", word, "-o", tmp_path / "o.npz", "--picture", tmp_path / "p.png", "--json")
    assert told(call(capsys, "carry", *files, *words), "carry")["outputs"] == [str(tmp_path / "o.npz"), str(tmp_path / "p.png")]
    (b, left), (a, right) = seen
    assert (b.fingerprint, a.fingerprint) == (OTHER.fingerprint, BALL.fingerprint)
    np.testing.assert_allclose(right, left[PLACE], atol=1e-9)
    assert len(np.unique(left, axis=0)) > 2
    assert left.min() >= 0
    assert left.max() <= 1


WRONG = [
    (("uv", "-o", "o.ply"), 2, r"attributes that .*b.ply has \(color\); found 'uv'"),
    (("colour", "-o", "o.ply"), 2, "color, uv or a file ending in .npy or .npz or .csv as attribute; found 'colour'"),
    (("short.npy", "-o", "o.npz"), 2, r"42 rows, one per vertex, in .*short.npy; found 'short' of shape \(41,\)"),
    (("gone.csv", "-o", "o.npz"), 4, "a CSV file at gone.csv; found No such file"),
    (("full.npy", "-o", "o.ply"), 2, "an output ending in .npz or .csv for values of files"),
    (("color", "-o", "o.stl"), 4, "an output ending in .ply or .obj or .glb or .npz or .csv"),
    (("color", "color", "-o", "o.ply"), 2, "different attributes; found color, color"),
    (("full.npy", "./full.npy", "-o", "o.npz"), 2, "attributes with different names; found 'full' twice"),
    (("full.npy:half", "-o", "o.npz"), 2, "an array of full.npy: full; found 'half'"),
    (("valid.npy", "-o", "o.npz"), 2, "names other than .*; found 'valid'"),
    (("nan.npy", "-o", "o.npz"), 2, "finite numbers in nan"),
]


@pytest.mark.parametrize(("words", "code", "match"), WRONG)
def test_what_cannot_be_carried_is_refused(capsys, tmp_path, files, monkeypatch, words, code, match):
    monkeypatch.chdir(tmp_path)
    for name, values in (("short", np.ones(41)), ("full", np.ones(42)), ("valid", np.ones(42)), ("nan", np.full(42, np.nan))):
        np.save(f"{name}.npy", values)
    before = sorted(tmp_path.iterdir())
    answer = call(capsys, "carry", *files, "--attribute", *words, "--json")
    assert answer.code == answer.result["exit_code"] == code, answer.err
    assert re.search(match, answer.err), answer.err
    assert sorted(tmp_path.iterdir()) == before


def test_no_attribute_is_a_usage_error(capsys, tmp_path, files):
    answer = call(capsys, "carry", *files, "-o", tmp_path / "o.ply")
    assert answer.code == 2
    assert "--attribute" in answer.err


def test_maps_belong_to_their_meshes(capsys, tmp_path, files):
    a, b, path = files
    words = ("--attribute", "color", "-o", tmp_path / "o.ply", "--json")
    turned = call(capsys, "carry", b, a, path, *words)
    assert turned.code == turned.result["exit_code"] == 4
    assert "a map made for this source; found one for another mesh" in turned.err
    for wrong in (a, tmp_path / "gone.npz"):
        answer = call(capsys, "carry", a, b, wrong, *words)
        assert answer.code == 4
        assert wrong.name in answer.err
    assert not (tmp_path / "o.ply").exists()


def test_public_meshes(capsys, tmp_path):
    """Texture coordinates of a cow with seams, onto itself: at each vertex those of one of its corners."""
    spot = data_file("bad/spot.obj")
    mesh = read(spot)
    corner = np.zeros(mesh.n_vertices, np.int64)
    corner[mesh.faces] = np.arange(mesh.n_faces)[:, None]
    at = np.argmax(mesh.faces[corner] == np.arange(mesh.n_vertices)[:, None], axis=1)
    Correspondence(mesh, mesh, SurfacePoints(corner, np.eye(3)[at])).save(tmp_path / "map.npz")
    words = (spot, spot, tmp_path / "map.npz", "--attribute", "uv", "-o", tmp_path / "o.obj", "--json")
    assert told(call(capsys, "carry", *words), "carry")["attributes"][0]["rows"] == 2930
    uv = read_attributes(tmp_path / "o.obj").uv
    lines = [line.split()[1:] for line in spot.read_text("utf-8").splitlines() if line.startswith(("vt ", "f "))]
    table = np.array([row for row in lines if len(row) == 2], float)
    corners = {tuple(int(x) - 1 for x in word.split("/")[:2]) for row in lines if len(row) > 2 for word in row}
    own = {(v, *table[t]) for v, t in corners}
    assert all((v, *pair) in own for v, pair in enumerate(uv.tolist()))
