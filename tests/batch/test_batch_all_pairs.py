"""Distances, and the plane that shows them."""

import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import write
from morphlet.batch.all_pairs import Distances, distance, read_distances
from morphlet.batch.picture import MOST_DRAWN, draw
from support import icosphere

NAN = float("nan")


def apart(places):
    return np.linalg.norm(places[:, None] - places[None], axis=2)


@given(st.integers(2, 8), st.integers(0, 1000))
def test_points_of_a_plane_come_back(k, seed):
    points = np.random.default_rng(seed).normal(size=(k, 2))
    found = Distances(tuple("abcdefgh"[:k]), apart(points))
    np.testing.assert_allclose(apart(found.places()), apart(points), atol=1e-7)
    assert found.stress == pytest.approx(0, abs=1e-7)


def test_the_order_of_other_meshes_turns_nothing():
    points = np.random.default_rng(1).normal(size=(5, 2))
    order = np.array([0, 3, 1, 4, 2])
    first, second = (Distances(tuple("abcde"), apart(p)).places() for p in (points, points[order]))
    np.testing.assert_allclose(first[order], second, atol=1e-9)


def test_stress_of_what_no_plane_holds():
    regular = 1.0 - np.eye(4)  # the corners of a tetrahedron
    assert 0.05 < Distances(tuple("abcd"), regular).stress < 0.5


def test_ways_through_others_stand_in_for_missing_maps():
    line = np.array([[0, 1, NAN], [1, 0, 2], [NAN, 2, 0]])
    found = Distances(tuple("abc"), line)
    assert found.complete[0, 2] == found.complete[2, 0] == 3
    assert found.known.sum() == 4
    np.testing.assert_allclose(apart(found.places())[0], [0, 1, 3], atol=1e-7)


def test_meshes_without_any_map_are_left_out():
    found = Distances(tuple("abc"), np.array([[0, NAN, NAN], [NAN, 0, 2], [NAN, 2, 0]]))
    assert found.connected.tolist() == [False, True, True]
    places = found.places()
    assert np.isnan(places[0]).all()
    assert apart(places[1:])[0, 1] == pytest.approx(2)


def test_nothing_known():
    found = Distances(("a", "b"), np.array([[0, NAN], [NAN, 0]]))
    assert (found.largest, found.stress) == (None, None)


def test_distances_from_energies():
    assert distance(1.0) == distance(1 - 1e-12) == 0
    s, r = 0.3, -0.7  # logarithms of stretches
    alike = (np.exp(2 * s) + np.exp(-2 * s)) / 2
    assert distance(alike) == pytest.approx(np.sqrt(2) * s)
    small = 1e-3
    energy = sum(np.exp(2 * small * x) + np.exp(-2 * small * x) for x in (s, r)) / 4
    assert distance(energy) == pytest.approx(small * np.hypot(s, r), rel=1e-5)


def test_what_is_told_beside_maps_is_read_and_written(tmp_path):
    (tmp_path / "a--b.json").write_text(json.dumps({"energy": 1.21}))
    (tmp_path / "b--c.json").write_text(json.dumps({"energy": 1.0}))
    found = read_distances(tmp_path, ["a", "b", "c"])
    np.testing.assert_array_equal(found.values, [[0, distance(1.21), NAN], [distance(1.21), 0, 0], [NAN, 0, 0]])
    assert [path.name for path in found.write(tmp_path)] == ["distances.npz", "distances.csv"]
    with np.load(tmp_path / "distances.npz", allow_pickle=False) as file:
        assert file["names"].tolist() == ["a", "b", "c"]
        np.testing.assert_array_equal(file["distances"], found.values)
    rows = (tmp_path / "distances.csv").read_text("utf-8").splitlines()
    assert rows[0] == ",a,b,c"
    assert rows[1] == f"a,0,{distance(1.21):.6g},"


@pytest.mark.parametrize("count", [2, MOST_DRAWN + 1])
def test_pictures_show_every_mesh(tmp_path, count):
    from matplotlib.image import imread

    write(tmp_path / "ball.ply", icosphere(1))
    points = np.random.default_rng(0).normal(size=(count, 2))
    found = Distances(tuple(f"m{k}" for k in range(count)), apart(points))
    draw(found, count * [tmp_path / "ball.ply"], tmp_path / "p.png")
    seen = imread(tmp_path / "p.png")[120:700, 80:960, :3]
    ink = (seen < 0.95).any(axis=2)
    columns = np.flatnonzero(ink.any(axis=0))
    assert (columns[-1] - columns[0]) / ink.shape[1] > 0.5 or np.ptp(np.flatnonzero(ink.any(axis=1))) > 0.5 * ink.shape[0]


def test_a_mesh_that_is_gone_is_a_point(tmp_path):
    write(tmp_path / "ball.ply", icosphere(1))
    draw(Distances(("a", "b"), np.array([[0, 1], [1, 0.0]])), [tmp_path / "ball.ply", tmp_path / "gone.ply"], tmp_path / "p.png")
    assert (tmp_path / "p.png").stat().st_size > 1000
