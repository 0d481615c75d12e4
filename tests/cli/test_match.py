"""`match`: pairs of vertices of both files, and how far they can be trusted."""

import re

import numpy as np
import pytest

from cli.calls import call
from cli.test_indices import STRAY, messy
from cli.test_verbs import told
from features.test_matching import mirrored
from morphlet import Picture, VertexPairs, correspond, read, read_pairs, write, write_pairs
from morphlet.features.matching import match
from morphlet.features.regions import find_regions
from morphlet.samples.anatomy import SPECIES
from morphlet.samples.creatures import Creature
from support import bumpy, data_file, icosphere, relabelled, torus

KEYS = ["pairs", "cost", "margin", "ambiguous", "runner_up", "reflected", "tips", "regions", "warnings", "repairs"]
STAR = bumpy(level=3)
"""A ball with six bumps and no symmetry."""
OTHER, PLACE = relabelled(STAR)
"""The same in another order, and where each vertex went."""


@pytest.fixture
def stars(tmp_path):
    write(tmp_path / "a.ply", STAR)
    write(tmp_path / "b.obj", OTHER)
    return tmp_path / "a.ply", tmp_path / "b.obj"


def matched(capsys, folder, *words):
    """What `match` tells of a run that ended well, and the pairs it wrote."""
    answer = call(capsys, "match", *words, "-o", folder / "pairs.csv", "--json")
    return told(answer, "match", *KEYS), read_pairs(folder / "pairs.csv")


def test_the_same_surface_in_another_order(capsys, tmp_path, stars):
    result, pairs = matched(capsys, tmp_path, *stars)
    found = match(find_regions(STAR), find_regions(OTHER))
    assert (result["pairs"], result["tips"], result["ambiguous"], result["warnings"]) == (len(pairs), [6, 6], False, [])
    assert (result["cost"], result["margin"], result["runner_up"]) == (found.cost, found.margin, found.runner_up)
    assert result["outputs"] == [str(tmp_path / "pairs.csv")]
    assert result["regions"] == found.regions.tolist()
    tips = np.array([label.startswith("tip-") for label in pairs.labels])
    assert sorted(np.array(pairs.labels)[tips]) == [f"tip-{k}" for k in range(6)]
    assert pairs.labels[-1] == "core"
    np.testing.assert_array_equal(pairs.target[tips], PLACE[pairs.source[tips]])
    assert np.linalg.norm(STAR.vertices[pairs.source] - OTHER.vertices[pairs.target], axis=1).max() < 0.1


def test_vertices_are_those_of_torn_files(capsys, tmp_path, stars):
    """A soup with strays before and a speck behind has other numbers than its surface, on either side."""
    mesh, _ = messy(STAR)
    write(tmp_path / "soup.ply", mesh)
    clean = matched(capsys, tmp_path, stars[0], stars[0])[1]
    for names, ends in (((tmp_path / "soup.ply", stars[0]), (mesh, STAR)), ((stars[0], tmp_path / "soup.ply"), (STAR, mesh))):
        result, pairs = matched(capsys, tmp_path, *names, "--component", "largest", "--force")
        np.testing.assert_array_equal(ends[0].vertices[pairs.source], STAR.vertices[clean.source])
        np.testing.assert_array_equal(ends[1].vertices[pairs.target], STAR.vertices[clean.target])
        assert {repair["what"].split()[0] for side in result["repairs"].values() for repair in side} >= {"dropped", "welded"}


def test_given_pairs_stay_as_they_are(capsys, tmp_path, stars):
    """Also where a vertex has a twin in the soup, and even if they are wrong."""
    mesh, origin = messy(STAR)
    write(tmp_path / "soup.ply", mesh)
    first, second = find_regions(STAR).tips[:2]
    twin = STRAY + np.flatnonzero(origin == first)[-1]
    given = VertexPairs([twin], [PLACE[second]], [2.5], ("a left ear",))
    write_pairs(tmp_path / "given.csv", given)
    result, pairs = matched(capsys, tmp_path, tmp_path / "soup.ply", stars[1], "--pairs", tmp_path / "given.csv", "--component", "largest")
    assert (pairs.source[0], pairs.target[0], pairs.weight[0], pairs.labels[0]) == (twin, PLACE[second], 2.5, "a left ear")
    assert [0, 1] in result["regions"]
    assert result["inputs"][-1] == str(tmp_path / "given.csv")
    write_pairs(tmp_path / "given.csv", VertexPairs([PLACE[second]], [twin]))
    words = (stars[1], tmp_path / "soup.ply", "--pairs", tmp_path / "given.csv", "--component", "largest", "--force")
    back, turned = matched(capsys, tmp_path, *words)
    assert (turned.source[0], turned.target[0]) == (PLACE[second], twin)
    assert sorted(map(tuple, back["regions"])) == sorted((j, i) for i, j in result["regions"])
    taken = np.linalg.norm(OTHER.vertices[pairs.target[1:]] - STAR.vertices[second], axis=1)
    assert taken.min() > 0.1


def test_what_cannot_be_trusted_is_said_loudly_and_is_no_error(capsys, tmp_path, stars):
    write(tmp_path / "mirror.ply", mirrored(STAR))
    words = ("match", stars[0], tmp_path / "mirror.ply", "-o", tmp_path / "pairs.csv", "--json")
    answer = call(capsys, *words)
    result = told(answer, "match")
    assert result["ambiguous"] is True
    assert "AMBIGUOUS: the mirror image of the target is much more alike" in answer.err
    assert any("mirror image" in warning for warning in result["warnings"])
    assert len(read_pairs(tmp_path / "pairs.csv")) == result["pairs"]
    quiet = call(capsys, *words, "--quiet", "--force")
    assert (quiet.err, quiet.result["ambiguous"]) == ("", True)


def test_what_is_contested_is_decided_as_correspond_decides(capsys, tmp_path):
    """The cheapest pairing of a grazer and its like with the proportions of a predator is head to tail; coarse maps know better."""
    animal = Creature.prepare("grazer", n_vertices=1500)
    other = animal.posed(proportions=SPECIES["predator"])
    write(tmp_path / "a.ply", animal.mesh)
    write(tmp_path / "b.ply", other)
    result, pairs = matched(capsys, tmp_path, tmp_path / "a.ply", tmp_path / "b.ply")
    found = correspond(animal.mesh, other)
    assert (result["margin"], result["ambiguous"]) == (found.margin, found.ambiguous)
    assert result["cost"] == found.matching.cost > match(find_regions(animal.mesh), find_regions(other)).cost
    assert result["warnings"][0] == found.warnings[0]
    tips = [label.startswith("tip-") for label in pairs.labels]
    nose, tail = (animal.landmarks[name] for name in ("nose", "tail tip"))
    own = int(np.argmin(np.linalg.norm(animal.mesh.vertices[pairs.source[tips]] - animal.mesh.vertices[nose], axis=1)))
    image = other.vertices[pairs.target[tips][own]]
    assert np.linalg.norm(image - other.vertices[nose]) < np.linalg.norm(image - other.vertices[tail])


def test_few_pairs_are_noted(capsys, tmp_path):
    """Landmarks stand in for regions, where a surface has none."""
    write(tmp_path / "ball.ply", icosphere(3))
    write_pairs(tmp_path / "given.csv", VertexPairs([0, 1, 2], [0, 1, 2]))
    words = (tmp_path / "ball.ply", tmp_path / "ball.ply", "--pairs", tmp_path / "given.csv", "-o", tmp_path / "pairs.csv")
    answer = call(capsys, "match", *words, "--json")
    assert told(answer, "match")["ambiguous"] is False
    assert answer.err == "note: only 3 pairs of regions or landmarks, of 0 and 0 tips: give more landmarks\n"
    assert read_pairs(tmp_path / "pairs.csv").labels == ("given", "given", "given", "core")


def test_balls_have_too_little_to_match(capsys, tmp_path):
    write(tmp_path / "ball.ply", icosphere(3))
    answer = call(capsys, "match", tmp_path / "ball.ply", tmp_path / "ball.ply", "-o", tmp_path / "pairs.csv", "--json")
    assert answer.code == answer.result["exit_code"] == 3
    assert "at least 3 pairs of feature regions; found 0, of 0 and 0 tips; give landmarks" in answer.err
    assert not (tmp_path / "pairs.csv").exists()


def test_an_unfit_mesh_is_named(capsys, tmp_path, stars):
    write(tmp_path / "ring.ply", torus())
    write(tmp_path / "point.ply", STAR.with_vertices(0 * STAR.vertices))
    for name in ("ring.ply", "point.ply"):
        answer = call(capsys, "match", stars[0], tmp_path / name, "-o", tmp_path / "pairs.csv", "--json")
        assert answer.code == answer.result["exit_code"] == 3
        assert name in answer.err


PAIRS = {
    "another header": ("a,b\n1,2\n", 4, "the header source,target"),
    "out of range": ("source,target\n3,99999\n", 2, "indices from 0 to 641 in the target column of the pairs"),
    "none": ("source,target\n", 2, "needed pairs in .*; found a header without any"),
    "twice": ("source,target\n3,4\n7,8\n9,4\n", 2, r"name each place once; found 2 pairs at target vertices.*\(first: 4, 4\)"),
}


@pytest.mark.parametrize("name", PAIRS)
def test_pairs_that_cannot_be_used_are_refused(capsys, tmp_path, stars, name):
    text, code, match = PAIRS[name]
    (tmp_path / "given.csv").write_text(text, encoding="utf-8")
    words = (*stars, "--pairs", tmp_path / "given.csv", "-o", tmp_path / "pairs.csv", "--quiet", "--json")
    answer = call(capsys, "match", *words)
    assert answer.code == answer.result["exit_code"] == code
    assert re.search(match, answer.err), answer.err
    assert not (tmp_path / "pairs.csv").exists()


def test_two_twins_of_a_seam_are_one_place(capsys, tmp_path, stars):
    mesh, origin = messy(STAR)
    write(tmp_path / "soup.ply", mesh)
    one, other = STRAY + np.flatnonzero(origin == 5)[:2]
    write_pairs(tmp_path / "given.csv", VertexPairs([one, other], [3, 4]))
    words = ("--pairs", tmp_path / "given.csv", "-o", tmp_path / "pairs.csv", "--component", "largest", "--json")
    answer = call(capsys, "match", tmp_path / "soup.ply", stars[1], *words)
    assert answer.code == 2
    assert answer.result["error"]["elements"] == [one, other]


def test_the_picture_is_of_both(capsys, tmp_path, stars, monkeypatch):
    seen = []

    def draw(source, target, found):
        seen.extend([source.mesh.n_vertices, target.mesh.n_vertices, len(found.regions)])
        return Picture(np.zeros((1, 1, 3), np.uint8), "none", "a test")

    monkeypatch.setattr("morphlet.report.features.matching_picture", draw)
    result, _ = matched(capsys, tmp_path, *stars, "--picture", tmp_path / "p.png")
    assert result["outputs"] == [str(tmp_path / "pairs.csv"), str(tmp_path / "p.png")]
    assert seen == [642, 642, 6]
    assert call(capsys, "match", *stars, "-o", tmp_path / "pairs.npz").code == 4


def test_public_poses_of_a_cat(capsys, tmp_path):
    """One numbering in both files: a limb's tip lies where it lay."""
    names = data_file("meshes/cat.obj"), data_file("cat-poses/cat-01.obj")
    result, pairs = matched(capsys, tmp_path, *names)
    assert (result["tips"], result["ambiguous"]) == ([6, 6], False)
    mesh = read(names[1])
    moved = np.linalg.norm(mesh.vertices[pairs.source] - mesh.vertices[pairs.target], axis=1)
    assert moved.max() < 0.1 * mesh.bbox_diagonal
