"""`regions`: limbs and their tips, told in vertices of the file."""

import re

import numpy as np
import pytest

from cli.calls import call
from cli.test_indices import STRAY, messy
from cli.test_verbs import told
from morphlet import Correspondence, Mesh, Picture, write
from morphlet.features.regions import find_regions
from morphlet.surface.nearest import nearest
from support import bumpy, data_file, icosphere, torus

KEYS = ["regions", "core", "gap", "core_node", "edges", "details", "persistence", "repairs"]
STAR = bumpy(level=3)
"""A ball with six bumps."""


@pytest.fixture
def star(tmp_path):
    write(tmp_path / "star.ply", STAR)
    return tmp_path / "star.ply"


def regions(capsys, *words):
    return told(call(capsys, "regions", *words, "--json"), "regions", *KEYS)


def test_a_clean_mesh_is_told_as_it_is(capsys, star):
    result, found = regions(capsys, star), find_regions(STAR)
    assert [one["tip"] for one in result["regions"]] == found.tips.tolist()
    assert [one["persistence"] for one in result["regions"]] == found.persistence.tolist()
    assert [one["area"] for one in result["regions"]] == found.areas.tolist()
    assert [one["vertices"] for one in result["regions"]] == np.bincount(found.nodes)[:6].tolist()
    assert (result["core"], result["gap"], result["core_node"], result["edges"]) == (found.core, found.gap, 6, found.edges.tolist())
    assert result["persistence"][:6] == found.persistence.tolist()
    assert len(result["persistence"]) == 6 + len(result["details"])
    assert (result["outputs"], result["repairs"]) == ([], [])


def test_vertices_are_those_of_a_torn_file(capsys, tmp_path, star):
    """A soup in another order, with strays before and a speck behind."""
    mesh, origin = messy(STAR)
    write(tmp_path / "soup.ply", mesh)
    clean = regions(capsys, star, "-o", tmp_path / "clean.npz")
    torn = regions(capsys, tmp_path / "soup.ply", "-o", tmp_path / "torn.npz", "--component", "largest")
    tips = [one["tip"] for one in torn["regions"]]
    assert min(tips) >= STRAY
    np.testing.assert_array_equal(mesh.vertices[tips], STAR.vertices[[one["tip"] for one in clean["regions"]]])
    np.testing.assert_array_equal(mesh.vertices[torn["core"]], STAR.vertices[clean["core"]])
    np.testing.assert_array_equal(mesh.vertices[torn["details"]], STAR.vertices[clean["details"]])
    with np.load(tmp_path / "clean.npz", allow_pickle=False) as one, np.load(tmp_path / "torn.npz", allow_pickle=False) as other:
        assert (str(other["kind"]), str(other["fingerprint"])) == ("regions", mesh.fingerprint)
        np.testing.assert_array_equal(other["labels"][STRAY:-4], one["labels"][origin])
        assert other["valid"].tolist() == [False] * STRAY + [True] * len(origin) + [False] * 4
        assert other["tips"].tolist() == tips
        assert set(one["labels"].tolist()) == set(range(-1, 6))
        np.testing.assert_array_equal(one["labels"] < 0, one["nodes"] >= 6)
    count = np.bincount(find_regions(STAR).nodes[origin])[:6]  # corners of the soup
    assert [one["vertices"] for one in torn["regions"]] == count.tolist()
    assert {repair["what"].split()[0] for repair in torn["repairs"]} >= {"dropped", "welded"}


def test_a_tip_on_a_filled_hole_is_a_vertex_of_its_rim(capsys, tmp_path, star):
    """The lid's middle, which is no vertex of the file, is the tip: the vertex nearest to it stands for it."""
    tip = regions(capsys, star)["regions"][0]["tip"]
    fan = (STAR.faces == tip).any(axis=1)
    write(tmp_path / "open.ply", Mesh(STAR.vertices, STAR.faces[~fan]))
    result = regions(capsys, tmp_path / "open.ply")
    rim = np.setdiff1d(STAR.faces[fan], [tip])
    away = np.linalg.norm(STAR.vertices[rim] - STAR.vertices[rim].mean(axis=0), axis=1)
    assert result["regions"][0]["tip"] == rim[np.argmin(away)]
    assert "filled" in result["repairs"][-1]["what"]


def test_options_decide_what_is_a_tip(capsys, star):
    every = regions(capsys, star)
    tips, between = [one["tip"] for one in every["regions"]], sum(every["persistence"][2:4]) / 2
    assert [one["tip"] for one in regions(capsys, star, "--most", 2)["regions"]] == tips[:2]
    assert [one["tip"] for one in regions(capsys, star, "--never", between, "--always", between)["regions"]] == tips[:3]
    assert len(regions(capsys, star, "--never", 9, "--always", 9)["regions"]) == 0


@pytest.mark.parametrize("words", [("--never", 0), ("--never", 0.5), ("--always", 0.01), ("--most", 0), ("--never", "nan")])
def test_options_out_of_range_are_refused_before_the_work(capsys, star, monkeypatch, words):
    monkeypatch.setattr("morphlet.surface.repair.close", lambda *_: pytest.fail("the work began"))
    answer = call(capsys, "regions", star, *words, "--json")
    assert answer.code == answer.result["exit_code"] == 2
    assert "0 < never <= always and most >= 1; found never = " in answer.err


def test_a_ball_has_no_regions_and_that_is_an_answer(capsys, tmp_path):
    write(tmp_path / "ball.ply", icosphere(3))
    result = regions(capsys, tmp_path / "ball.ply", "-o", tmp_path / "r.npz")
    assert (result["regions"], result["edges"]) == ([], [])
    with np.load(tmp_path / "r.npz", allow_pickle=False) as file:
        assert (file["labels"] == -1).all()


UNFIT = {
    "a torus": (torus(), "genus 0.*--cut-handles 1"),
    "a point": (icosphere(2).with_vertices(np.ones((162, 3))), r"a surface with area in .*mesh\.ply; found 320 faces without any"),
    "a triangle": (Mesh(np.eye(3), [[0, 1, 2]]), "at least 4 vertices"),
}


@pytest.mark.parametrize("name", UNFIT)
def test_unfit_meshes_are_refused_with_the_reason(capsys, tmp_path, name):
    mesh, match = UNFIT[name]
    write(tmp_path / "mesh.ply", mesh)
    answer = call(capsys, "regions", tmp_path / "mesh.ply", "-o", tmp_path / "r.npz", "--json")
    assert answer.code == answer.result["exit_code"] == 3
    assert re.search(match, answer.err), answer.err
    assert not (tmp_path / "r.npz").exists()


def test_outputs_for_people_and_files(capsys, tmp_path, star, monkeypatch):
    pixel = Picture(np.zeros((1, 1, 3), np.uint8), "none", "a test")
    monkeypatch.setattr("morphlet.report.features.regions_picture", lambda found: pixel)
    words = (star, "-o", tmp_path / "r.npz", "--picture", tmp_path / "p.png")
    assert regions(capsys, *words)["outputs"] == [str(tmp_path / "r.npz"), str(tmp_path / "p.png")]
    assert call(capsys, "regions", star, "-o", tmp_path / "r.obj").code == 4
    assert re.search(r"^core +\d+\n", call(capsys, "regions", star).out, re.MULTILINE)


def test_labels_can_be_carried(capsys, tmp_path, star):
    """One file serves the other verb."""
    regions(capsys, star, "-o", tmp_path / "r.npz")
    Correspondence(STAR, STAR, nearest(STAR, STAR.vertices)).save(tmp_path / "map.npz")
    words = (star, star, tmp_path / "map.npz", "--attribute", f"{tmp_path / 'r.npz'}:labels", "-o", tmp_path / "o.npz", "--json")
    assert told(call(capsys, "carry", *words), "carry")["attributes"][0]["kind"] == "label"
    with np.load(tmp_path / "r.npz", allow_pickle=False) as one, np.load(tmp_path / "o.npz", allow_pickle=False) as other:
        np.testing.assert_array_equal(one["labels"], other["labels"])


def test_a_public_cat_has_six_limbs(capsys):
    result = regions(capsys, data_file("meshes/cat.obj"))
    assert len(result["regions"]) == 6
    assert 0.3 < sum(one["area"] for one in result["regions"]) < 0.7
