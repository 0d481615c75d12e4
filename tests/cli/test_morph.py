"""`morph`: paths and schedules, what is told of them, and the file that plays. Its files and indices: `test_outputs`, `test_indices`."""

import json

import numpy as np
import pytest

from cli.calls import call
from cli.test_verbs import told
from morphlet import Schedule, VertexPairs, read, write, write_pairs
from support import blob, random_rotation

KEYS = ["path", "frames", "volume_change_max", "edge_log_rms_max", "self_intersections_max", "mse", "deformation_rate"]
CORRESPOND = ["folds_sphere", "folds_surface_percent", "energy", "energy_mean", "pairs", "pairs_rmse", "margin", "ambiguous", "alignment"]
SOME = np.arange(0, 162, 9)


@pytest.fixture
def ends(tmp_path):
    """A body, the same turned and grown, and pairs between them."""
    body = blob(2)
    write(tmp_path / "a.ply", body)
    write(tmp_path / "b.ply", body.with_vertices(1.5 * body.vertices @ random_rotation(3)))
    write_pairs(tmp_path / "p.csv", VertexPairs(SOME, SOME))
    return tmp_path / "a.ply", tmp_path / "b.ply", "--pairs", tmp_path / "p.csv", "-o", tmp_path / "out", "--json"


def frame(folder, k):
    return read(folder / "out" / f"frame-{k:03d}.ply").vertices


def test_faces_turn_unless_told_otherwise(capsys, tmp_path, no_drawing, ends):
    result = told(call(capsys, "morph", *ends, "--frames", 3), "morph", *KEYS, *CORRESPOND)
    assert (result["path"], result["frames"], result["self_intersections_max"]) == ("gradient", 3, 0)
    assert (result["pairs"], result["alignment"], result["warnings"]) == (len(SOME), "pairs", [])
    assert json.loads((tmp_path / "out" / "result.json").read_text("utf-8"))["path"] == "gradient"
    turned = read(tmp_path / "out" / "frame-001.ply").volume
    straight = told(call(capsys, "morph", *ends, "--frames", 3, "--path", "linear", "--force"), "morph")
    assert (straight["path"], straight["mse"]) == ("linear", result["mse"])
    np.testing.assert_allclose(frame(tmp_path, 1), (frame(tmp_path, 0) + frame(tmp_path, 2)) / 2, atol=1e-12)
    assert read(tmp_path / "out" / "frame-001.ply").volume < 0.9 * turned
    assert straight["volume_change_max"] < result["volume_change_max"]


def test_a_schedule_says_when_each_resolution_moves(capsys, tmp_path, no_drawing, ends):
    Schedule([0.5, 0.5], [0.5, 0.25], ("linear", "smoothstep")).write(tmp_path / "late.toml")
    words = ("morph", *ends, "--frames", 5, "--path", "wavelet")
    result = told(call(capsys, *words, "--schedule", tmp_path / "late.toml"), "morph", *KEYS)
    assert result["path"] == "wavelet"
    assert result["inputs"] == [str(tmp_path / name) for name in ("a.ply", "b.ply", "p.csv", "late.toml")]
    for k in (1, 2):
        np.testing.assert_allclose(frame(tmp_path, k), frame(tmp_path, 0), atol=1e-12)
    assert np.abs(frame(tmp_path, 3) - frame(tmp_path, 0)).max() > 0.1
    told(call(capsys, *words, "--force"), "morph", *KEYS)
    assert np.abs(frame(tmp_path, 1) - frame(tmp_path, 0)).max() > 0.1


def test_a_schedule_that_cannot_be_read_stops_the_work_before_it_begins(capsys, tmp_path, ends):
    (tmp_path / "bad.toml").write_text("[[band]]\nstart = 0.75\nduration = 0.5\n")
    words = ("morph", *ends, "--path", "wavelet", "--schedule")
    for name, match in (("bad.toml", "start 0.75 with duration 0.5"), ("none.toml", "a TOML file of a schedule")):
        answer = call(capsys, *words, tmp_path / name)
        assert answer.code == answer.result["exit_code"] == 4
        assert match in answer.err
        assert not (tmp_path / "out").exists()


def test_the_animation_has_all_frames(capsys, tmp_path, no_drawing, ends):
    told(call(capsys, "morph", *ends, "--frames", 4), "morph")
    data = (tmp_path / "out" / "morph.glb").read_bytes()
    tree = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert len(tree["meshes"][0]["primitives"][0]["targets"]) == 3
    (animation,) = tree["animations"]
    assert tree["accessors"][animation["samplers"][0]["input"]]["count"] == 4
    assert tree["accessors"][animation["samplers"][0]["output"]]["count"] == 12


def test_it_sweeps_over_the_surface_from_some_vertices(capsys, tmp_path, no_drawing, ends):
    told(call(capsys, "morph", *ends, "--frames", 5, "--path", "linear", "--sweep", 3, "--sweep", 5), "morph", *KEYS)
    way = [np.linalg.norm(frame(tmp_path, k) - frame(tmp_path, 0), axis=1) for k in (2, 4)]
    share = way[0] / way[1]
    np.testing.assert_allclose(share[[3, 5]], 1, atol=1e-6)
    assert share.min() < 1e-6
    answer = call(capsys, "morph", *ends, "--sweep", 162, "--force")
    assert (answer.code, "starts" in answer.err) == (2, True)


def test_details_turn_with_the_faces_at_times_of_their_own(capsys, tmp_path, no_drawing, ends):
    Schedule([0.0, 0.0], [0.5, 0.5], ("linear", "smoothstep")).write(tmp_path / "early.toml")
    result = told(call(capsys, "morph", *ends, "--frames", 3, "--schedule", tmp_path / "early.toml"), "morph", *KEYS)
    assert result["path"] == "gradient"
    np.testing.assert_allclose(frame(tmp_path, 1), frame(tmp_path, 2), atol=1e-6)
