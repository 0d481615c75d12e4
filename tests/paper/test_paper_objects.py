"""Objects and stand-ins, marks, simplified meshes, what sizes say."""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh, write
from morphlet.errors import FileError
from morphlet.paper.diagrams import Call, _calls_below
from morphlet.paper.exhibit import Table, slug, table_of
from morphlet.paper.marks import arrows, dots, rods
from morphlet.paper.networks import lone_library
from morphlet.paper.simplified import Bound
from morphlet.paper.stopwatch import median_seconds
from morphlet.paper.subjects import HORSE, ROWS, Recipe, Stock, Subject, at_hand, farthest, simplified
from morphlet.paper.tables import reading
from morphlet.pipeline.correspond import aligned, correspond, correspond_maps
from morphlet.sphere.map import spherical_map
from morphlet.wavenet.library import dyadic_library
from morphlet.wavenet.mothers import PAPER_SIX
from support import blob, icosphere, random_rotation, tetrahedron

sizes = st.integers(4, 10_000)


@pytest.mark.parametrize(
    ("vertices", "faces", "said"),
    [
        (8431, 16843, "an odd number of faces"),
        (352, 671, "an odd number of faces"),
        (29299, 69473, "genus 2720 or more"),
        (58895, 57836, "more vertices than 57836 faces in one piece"),
        (352, 700, "can be closed, of genus 0"),
        (352, 698, "has boundaries"),
    ],
)
def test_what_sizes_say(vertices: int, faces: int, said: str) -> None:
    assert said in reading(vertices, faces)


@given(sizes, st.integers(0, 50))
def test_a_closed_surface_is_read_as_its_genus(vertices: int, genus: int) -> None:
    found = reading(vertices, 2 * (vertices - 2 + 2 * genus))
    assert f"genus {genus}" in found


def test_a_public_mesh_is_taken_only_where_it_lies(tmp_path: Path) -> None:
    assert at_hand("horse.obj", tmp_path) is None
    (tmp_path / "sub").mkdir()
    write(tmp_path / "sub" / "horse.obj", tetrahedron())
    with pytest.raises(FileError, match=r"SHA-256 0706.* for .*horse\.obj"):
        at_hand("horse.obj", tmp_path)


def test_subjects_are_made_once(tmp_path: Path) -> None:
    stock = Stock(tmp_path, 1500)
    assert stock.horse is stock.horse
    assert stock.horse.origin == "grazer, procedural"


def test_handles_and_paths() -> None:
    subject = Subject(HORSE, blob(3), "a blob")
    roi, path, size = subject.roi, subject.path, subject.mesh.bbox_diagonal
    assert subject.tip == farthest(subject.mesh, (0, 1, 1))
    assert subject.tip in roi.handle
    np.testing.assert_allclose(path[0], subject.mesh.vertices[roi.handle], atol=1e-12)
    assert np.linalg.norm(subject.mesh.vertices[roi.handle] - subject.mesh.vertices[subject.tip], axis=1).max() <= 0.08 * size
    gaps = [np.linalg.norm(frame[:, None] - frame[None], axis=2) for frame in path]
    np.testing.assert_allclose(gaps[-1], gaps[0], atol=1e-9)  # it turns as one
    np.testing.assert_array_equal(subject.deformed.vertices[roi.anchors], subject.mesh.vertices[roi.anchors])
    np.testing.assert_allclose(subject.deformed.vertices[roi.handle], path[-1], atol=1e-12)


def test_the_deformed_object_lies_on_the_sphere_of_the_one_at_rest() -> None:
    subject = Subject(HORSE, Mesh(blob(3).vertices, blob(3).faces[6:]), "a blob with a hole")
    own = subject.sphere.valid  # a vertex in no face goes with the nearest, which may be another one after the edit
    np.testing.assert_array_equal(subject.deformed_map.points[own], subject.sphere.points[own])
    np.testing.assert_array_equal(subject.deformed_map.mesh.vertices, subject.deformed.vertices)


def test_a_handle_is_found_on_a_coarse_mesh() -> None:
    ball = icosphere(1)
    coarse = Subject(HORSE.__class__("ball", "none", "none", Recipe((0, 0, 1), 1e-6, 0.5)), ball, "a ball")
    assert len(coarse.roi.handle) > 1
    assert len(coarse.roi.free)


@pytest.mark.parametrize("count", [4, 40, 641, 642, 1000])
def test_simplified_meshes_keep_vertices_of_their_own(count: int) -> None:
    body = blob(3)
    coarse = simplified(body, count)
    assert coarse.n_vertices == min(count, 642)
    assert coarse.n_faces == 2 * coarse.n_vertices - 4
    assert coarse.topology.euler_characteristic == 2
    rows = {tuple(row) for row in body.vertices.tolist()}
    assert all(tuple(row) in rows for row in coarse.vertices.tolist())
    if count >= 40:
        assert coarse.volume == pytest.approx(body.volume, rel=0.2)


@cache
def coarse_and_fine() -> tuple[Mesh, Mesh]:
    return simplified(blob(3), 100), blob(3)


@settings(max_examples=20)
@given(st.integers(0, 100))
def test_a_bound_surface_follows_every_motion(seed: int) -> None:
    coarse, fine = coarse_and_fine()
    turn, shift = random_rotation(seed), np.random.default_rng(seed).normal(size=3)
    followed = Bound.prepare(coarse, fine).follow(coarse.with_vertices(coarse.vertices @ turn.T + shift))
    np.testing.assert_allclose(followed.vertices, fine.vertices @ turn.T + shift, atol=1e-9)


def test_marks_are_closed_and_look_outwards() -> None:
    starts, ends = np.random.default_rng(0).normal(size=(2, 5, 3))
    for mesh, parts in ((dots(starts, 0.1), 5), (rods(starts, ends, 0.05), 5), (arrows(starts, ends, 0.02), 10)):
        assert mesh.topology.n_components == parts
        assert mesh.topology.euler_characteristic == 2 * parts
        assert not mesh.topology.boundary_loops
        for part in range(parts):
            faces = mesh.faces[mesh.topology.components[mesh.faces[:, 0]] == part]
            assert Mesh(mesh.vertices, faces).volume > 0


def test_rods_have_their_length_and_radius() -> None:
    rod = rods(np.zeros((1, 3)), np.array([[0.0, 0.0, 3.0]]), 0.5)
    assert np.ptp(rod.vertices[:, 2]) == 3.0
    np.testing.assert_allclose(np.linalg.norm(rod.vertices[:, :2], axis=1), 0.5)


def test_flows_are_the_calls_of_the_code() -> None:
    calls = list(_calls_below(correspond))
    top = [call.function for call in calls if call.depth == 0]
    assert top == [spherical_map, correspond_maps]
    below = [call.name for call in calls[calls.index(Call(correspond_maps, 0)) :] if call.depth == 1]
    assert below[:2] == ["pipeline.candidates.matched_regions", "pipeline.candidates.landmark_pairs"]
    assert below[2:4] == ["pipeline.correspond.aligned", "mapping.embedding.embed"]
    assert [call.name for call in _calls_below(aligned, 0, 1)][-2:] == ["mapping.alignment.align_by_pairs", "mapping.warp.warp_by_pairs"]
    assert all(call.says for call in calls)


def test_tables_refuse_rows_of_other_lengths() -> None:
    with pytest.raises(ValueError, match="2 values in each row; found 1 rows of another length"):
        Table(("a", "b"), ((1, 2), (3,)))


def test_tables_are_plain() -> None:
    table = table_of(["a", "b"], [[np.float64("nan"), np.int64(3)]])
    assert table.records == [{"a": None, "b": 3}]
    assert table.csv == "a,b\nnan,3\n"
    assert slug("Table 4") == "table-4"


def test_long_calls_are_not_repeated(monkeypatch: pytest.MonkeyPatch) -> None:
    ticks, calls = iter([0.0, 5.0, 5.0, 5.5]), []
    monkeypatch.setattr("morphlet.paper.stopwatch.time.perf_counter", lambda: next(ticks))
    assert median_seconds(lambda: calls.append(1)) == 5.0
    assert len(calls) == 1


def test_one_mother_has_as_many_candidates_as_the_six() -> None:
    """To a tenth, on the rows of the report's geometry images."""
    x = np.linspace(0, 1, ROWS)
    assert len(lone_library(x)) == pytest.approx(len(dyadic_library(PAPER_SIX, x)), rel=0.1)
