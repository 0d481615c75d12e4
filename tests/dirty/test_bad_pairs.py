"""Markers as people make them: whatever they say, the map is one-to-one and tells what it could not do, or a typed error says why not."""

from pathlib import Path

import numpy as np
import pytest

from cli.calls import call
from morphlet import (
    CorrespondResult,
    InputError,
    Mesh,
    MeshError,
    VertexPairs,
    correspond,
    correspond_maps,
    spherical_map,
    write,
    write_pairs,
)
from morphlet.mapping.correspondence import doubts
from morphlet.samples.copies import remeshed
from morphlet.sphere.map import SphericalMap, map_surface
from morphlet.surface.repair import RepairOptions, close
from support import assert_one_to_one, beside, blob, icosphere

FIVE = np.array([0, 100, 200, 300, 400])
UNMET = "could not be brought together"


@pytest.fixture(scope="module")
def lump() -> SphericalMap:
    """A lopsided body of 642 vertices."""
    return spherical_map(blob(3))


def sound(found: CorrespondResult) -> CorrespondResult:
    """One-to-one by a test that shares no code with the package, finite, and every figure told."""
    assert_one_to_one(found.laid.closed_points, found.laid.surface.mesh.faces)
    assert np.isfinite(found.correspondence.positions).all()
    assert np.isfinite(found.inverse.positions).all()
    assert found.figures()["folds_sphere"] == 0
    assert all(value is None or np.isfinite(value) for value in found.figures().values())
    return found


def neighbours(mesh: Mesh, vertex: int) -> list[int]:
    return sorted(set(mesh.faces[(mesh.faces == vertex).any(axis=1)].ravel().tolist()) - {vertex})


def test_two_sources_for_one_target(lump: SphericalMap) -> None:
    found = sound(correspond_maps(lump, lump, VertexPairs([*FIVE, 50, 350], [*FIVE, 50, 50])))
    assert any(UNMET in told for told in found.warnings)
    assert found.figures()["pairs_rmse"] > 0


def test_one_source_for_two_targets(lump: SphericalMap) -> None:
    found = sound(correspond_maps(lump, lump, VertexPairs([*FIVE, 50, 50], [*FIVE, 50, 350])))
    assert any(told.startswith("2 of 7 pairs") and UNMET in told for told in found.warnings)


def test_all_sources_for_one_target_and_one_source_for_all(lump: SphericalMap) -> None:
    for pairs in (VertexPairs(FIVE, [0] * 5), VertexPairs([0] * 5, FIVE)):
        found = sound(correspond_maps(lump, lump, pairs))
        assert any(UNMET in told for told in found.warnings)
        assert any("determine no rotation" in told for told in found.warnings)


def test_pairs_that_turn_a_triangle_over(lump: SphericalMap) -> None:
    face = np.array(lump.mesh.faces[200])
    found = sound(correspond_maps(lump, lump, VertexPairs(face, face[::-1])))
    assert any(UNMET in told for told in found.warnings)


def test_a_mirror_image_of_the_pairs_is_told_by_its_strain() -> None:
    """As many pairs on the left as on the right, all exchanged: they can be met, at a price."""
    body = icosphere(3)
    body = body.with_vertices(body.vertices * [1.0, 1.4, 2.0] * (1 + 0.25 * body.vertices[:, [2]]))
    both = spherical_map(body)
    ends = np.array(
        [[0.8, 0.5, 0.6], [-0.8, 0.5, 0.6], [0.8, -0.9, 0.6], [-0.8, -0.9, 0.6], [0.9, 0.3, -1.2], [-0.9, 0.3, -1.2], [0, 0, 2.5]]
    )
    marks = np.array([int(np.argmin(np.linalg.norm(body.vertices - end, axis=1))) for end in ends])
    right = sound(correspond_maps(both, both, VertexPairs(marks, marks)))
    assert doubts(right.correspondence, right.pairs) == ()
    crossed = sound(correspond_maps(both, both, VertexPairs(marks, marks[[1, 0, 3, 2, 5, 4, 6]])))
    told = (*crossed.warnings, *doubts(crossed.correspondence, crossed.pairs))
    assert any("exchanged" in one or "doubtful" in one for one in told)


@pytest.mark.parametrize("count", [1, 2])
def test_too_few_pairs_are_completed_or_searched_for(lump: SphericalMap, count: int) -> None:
    found = sound(correspond_maps(lump, lump, VertexPairs(FIVE[:count], FIVE[:count])))
    assert found.figures()["pairs"] > count or any("give pairs" in told for told in found.warnings)


def test_duplicates_change_nothing(lump: SphericalMap) -> None:
    once = sound(correspond_maps(lump, lump, VertexPairs(FIVE, FIVE)))
    twice = sound(correspond_maps(lump, lump, VertexPairs([*FIVE, *FIVE], [*FIVE, *FIVE])))
    np.testing.assert_array_equal(twice.correspondence.positions, once.correspondence.positions)
    assert twice.warnings == ()


@pytest.mark.parametrize(("source", "target", "side"), [(642, 0, "source"), (0, 642, "target"), (-1, 0, "source"), (0, 10**12, "target")])
def test_a_marker_outside_the_mesh_is_refused(lump: SphericalMap, source: int, target: int, side: str) -> None:
    with pytest.raises(InputError, match=f"indices from 0 to .* in (the )?{side}"):
        correspond_maps(lump, lump, VertexPairs([*FIVE, source], [*FIVE, target]))


def test_parts_that_cannot_be_mapped_together_are_refused_and_markers_on_the_dropped_one(lump: SphericalMap) -> None:
    two = beside(blob(3), icosphere(1).with_vertices(0.1 * icosphere(1).vertices + 9))
    on_speck = VertexPairs([*FIVE, 650], [*FIVE, 20])
    with pytest.raises(MeshError, match="one connected surface; found 2 connected components"):
        correspond(two, lump.mesh, on_speck)
    largest = map_surface(close(two, RepairOptions(fill="all", component="largest")))
    with pytest.raises(InputError, match=r"1 source vertices in no face, or on a dropped part \(first: 650\)"):
        on_speck.answered(largest.valid, lump.valid)
    with pytest.raises(InputError, match="1 target vertices in no face"):
        VertexPairs(on_speck.target, on_speck.source).answered(lump.valid, largest.valid)
    sound(correspond_maps(largest, lump, VertexPairs(FIVE, FIVE).answered(largest.valid, lump.valid)))


def test_balls_have_nothing_to_go_by_and_that_is_said() -> None:
    one = icosphere(3)
    found = sound(correspond(one, remeshed(one)[0]))
    assert found.ambiguous
    assert any("feature regions could not be matched" in told for told in found.warnings)
    assert found.figures()["pairs"] == 0


def test_a_ball_takes_any_three_pairs() -> None:
    ball = spherical_map(icosphere(2))
    sound(correspond_maps(ball, ball, VertexPairs([0, 50, 100], [7, 90, 30])))


def test_a_hundred_markers_are_met(lump: SphericalMap) -> None:
    chosen = np.random.default_rng(0).choice(642, 100, replace=False)
    found = sound(correspond_maps(lump, lump, VertexPairs(chosen, chosen)))
    assert found.warnings == ()
    assert found.figures()["pairs_rmse"] < 1e-3
    assert len(doubts(found.correspondence, found.pairs)) == 0


def test_a_hundred_markers_at_random_are_told(lump: SphericalMap) -> None:
    rng = np.random.default_rng(0)
    chosen = rng.choice(642, 100, replace=False)
    found = sound(correspond_maps(lump, lump, VertexPairs(chosen, rng.permutation(chosen))))
    assert any(UNMET in told for told in found.warnings)
    assert any("strained all over" in told for told in doubts(found.correspondence, found.pairs))


def test_two_neighbours_exchanged(lump: SphericalMap) -> None:
    near = neighbours(lump.mesh, 50)[0]
    found = sound(correspond_maps(lump, lump, VertexPairs([*FIVE, 50, near], [*FIVE, near, 50])))
    gaps = np.linalg.norm(found.correspondence.positions[found.pairs.source] - lump.mesh.vertices[found.pairs.target], axis=1)
    assert gaps[:5].max() < 1e-3
    assert doubts(found.correspondence, found.pairs) != () or any(UNMET in told for told in found.warnings)


def test_weights_that_differ_beyond_reason(lump: SphericalMap) -> None:
    target = FIVE[[1, 0, 2, 3, 4]]
    found = sound(correspond_maps(lump, lump, VertexPairs(FIVE, target, [1e-6, 1e6, 1, 1, 1])))
    assert any(UNMET in told for told in found.warnings)


def test_identical_meshes_and_mirror_images(lump: SphericalMap) -> None:
    same = sound(correspond_maps(lump, lump, VertexPairs(FIVE, FIVE)))
    assert same.figures()["energy"] == pytest.approx(1, abs=0.01)
    mirror = Mesh(blob(3).vertices * [-1, 1, 1], blob(3).faces[:, ::-1])
    for pairs in (None, VertexPairs(FIVE, FIVE)):
        sound(correspond_maps(lump, spherical_map(mirror), pairs))


@pytest.fixture
def bodies(tmp_path: Path) -> tuple[Path, Path]:
    """Files of a body, and of another that has a speck beside it."""
    write(tmp_path / "a.ply", blob(3))
    write(tmp_path / "b.ply", beside(blob(3), icosphere(0).with_vertices(0.01 * icosphere(0).vertices + 9)))
    return tmp_path / "a.ply", tmp_path / "b.ply"


def test_the_command_line_tells_a_wrong_pair(capsys: pytest.CaptureFixture[str], tmp_path: Path, bodies: tuple[Path, Path]) -> None:
    marks = np.array([*FIVE, 50])
    near = np.linalg.norm(blob(3).vertices - blob(3).vertices[50], axis=1) / np.sqrt(blob(3).area)
    wrong = int(np.argmin(np.abs(near - 0.2)))
    words = (
        "correspond",
        *bodies,
        "--component",
        "largest",
        "-o",
        tmp_path / "map.npz",
        "--json",
        "--force",
        "--pairs",
        tmp_path / "pairs.csv",
    )
    write_pairs(tmp_path / "pairs.csv", VertexPairs(marks, marks))
    right = call(capsys, *words)
    assert (right.code, right.result["warnings"]) == (0, [])
    write_pairs(tmp_path / "pairs.csv", VertexPairs(marks, [*FIVE, wrong], labels=(*"abcde", "left ear")))
    told = call(capsys, *words)
    assert told.code == 0
    assert told.result["folds_sphere"] == 0
    (warning,) = told.result["warnings"]
    assert warning.startswith(f"1 of 6 pairs are doubtful, most of all 50,{wrong} left ear: around it the map's energy is ")
    assert f"note: {warning}" in told.err


@pytest.mark.parametrize("verb", ["correspond", "morph", "match"])
def test_the_command_line_refuses_a_marker_on_a_speck(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, bodies: tuple[Path, Path], verb: str
) -> None:
    write_pairs(tmp_path / "pairs.csv", VertexPairs([*FIVE, 7], [*FIVE, 645]))
    output = {"correspond": "map.npz", "morph": "frames", "match": "out.csv"}[verb]
    answer = call(capsys, verb, *bodies, "--component", "largest", "-o", tmp_path / output, "--json", "--pairs", tmp_path / "pairs.csv")
    assert answer.code == 2
    assert "1 target vertices in no face, or on a dropped part (first: 645)" in answer.err
    assert answer.result["exit_code"] == 2
    assert not (tmp_path / output).exists()
