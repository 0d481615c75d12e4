"""The paper on one page, end to end: known answers on procedural shapes, and on public ones where they are at hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mapping.stars import blob, radial_map
from morphlet import Mesh, VertexPairs
from morphlet.errors import Cancelled, InputError
from morphlet.motion.morph import PATHS
from morphlet.motion.schedule import Schedule
from morphlet.pipeline.candidates import CLEAR
from morphlet.pipeline.correspond import correspond, correspond_maps
from morphlet.pipeline.morph import morph, morph_along
from morphlet.samples.anatomy import SPECIES
from morphlet.samples.creatures import Creature
from morphlet.samples.poses import POSES
from support import relabelled

CORRESPOND_KEYS = ["folds_sphere", "folds_surface_percent", "energy", "energy_mean", "pairs", "pairs_rmse", "margin", "ambiguous"]
MORPH_KEYS = ["frames", "volume_change_max", "edge_log_rms_max", "self_intersections_max", "mse", "deformation_rate"]
EVERY = VertexPairs(np.arange(0, 642, 40), np.arange(0, 642, 40))
TURN = Rotation.from_rotvec([0.4, -1.9, 0.8]).as_matrix()


def test_a_mesh_without_features_meets_itself_by_a_search_and_says_so():
    mesh = blob()
    result = correspond_maps(radial_map(mesh), radial_map(mesh, TURN))
    error = np.linalg.norm(result.correspondence.positions - mesh.vertices, axis=1) / np.sqrt(mesh.area)
    assert error.mean() < 0.003
    assert error.max() < 0.02
    figures = result.figures()
    assert figures["folds_sphere"] == 0
    assert figures["energy"] == pytest.approx(1, abs=0.01)
    assert (figures["pairs"], figures["pairs_rmse"], figures["ambiguous"]) == (0, None, False)
    assert any("give pairs" in told for told in result.warnings)


@pytest.fixture(scope="module")
def deer():
    """A grazer standing and walking, automatic."""
    animal = Creature.prepare("grazer", n_vertices=1500)
    walking = animal.posed(POSES["walking"])
    return animal.mesh, walking, correspond(animal.mesh, walking)


def test_poses_of_one_animal_find_each_other_without_help(deer):
    _standing, walking, result = deer
    error = np.linalg.norm(result.correspondence.positions - walking.vertices, axis=1) / np.sqrt(walking.area)
    assert np.average(error, weights=walking.vertex_areas) < 0.02
    figures = result.figures()
    assert figures["folds_sphere"] == 0
    assert figures["folds_surface_percent"] < 1
    assert figures["pairs"] >= 6
    assert not figures["ambiguous"]
    assert result.warnings == ()
    assert figures["pairs_rmse"] < 1e-3 * np.sqrt(walking.area)


def test_the_inverse_leads_back(deer):
    standing, walking, result = deer
    back = result.inverse.matrix @ result.correspondence.positions
    assert np.linalg.norm(back - walking.vertices, axis=1).mean() < 0.015 * np.sqrt(walking.area)  # flat triangles, twice
    np.testing.assert_allclose(result.inverse.pull(np.ones(standing.n_vertices)), 1, atol=1e-12)


def test_the_common_refinement_meets_both_shapes(deer):
    _standing, _walking, result = deer
    both = result.refinement()
    for mesh, places in ((result.source_map.surface.mesh, both.source_places), (result.target_map.surface.mesh, both.target_places)):
        assert Mesh(places.positions(mesh), both.topology).volume == pytest.approx(mesh.volume, rel=1e-9)


def test_the_network_brings_the_pairs_nearer_than_the_rotation(deer):
    _, _, result = deer
    points, goals = result.source_map.points[result.pairs.source], result.target_map.points[result.pairs.target]
    turned, warped = points @ result.alignment.rotation.T, result.alignment(points)
    assert np.linalg.norm(warped - goals, axis=1).mean() < 0.2 * np.linalg.norm(turned - goals, axis=1).mean()
    assert len(result.alignment.warp.network) == 15


def test_two_pairs_are_completed_by_the_regions_matching():
    animal = Creature.prepare("grazer", n_vertices=1500)
    nose, tail = animal.landmarks["nose"], animal.landmarks["tail tip"]
    result = correspond(animal.mesh, animal.mesh, VertexPairs([nose, tail], [nose, tail]))
    assert len(result.pairs) >= 6
    assert {(nose, nose), (tail, tail)} <= set(zip(result.pairs.source.tolist(), result.pairs.target.tolist(), strict=True))


@pytest.fixture(scope="module")
def bred():
    """A grazer, the same with the proportions of a predator, automatic."""
    animal = Creature.prepare("grazer", n_vertices=1500)
    other = animal.posed(proportions=SPECIES["predator"])
    return other, correspond(animal.mesh, other)


def test_animals_of_other_proportions_are_matched_head_to_head(bred):
    other, result = bred
    error = np.linalg.norm(result.correspondence.positions - other.vertices, axis=1) / np.sqrt(other.area)
    assert np.average(error, weights=other.vertex_areas) < 0.035
    assert result.figures()["folds_sphere"] == 0


def test_candidates_that_were_tried_are_told(bred):
    _, result = bred
    scores = [one.score for one in result.candidates]
    assert len(scores) > 1
    assert scores == sorted(scores)
    assert result.candidates[0].matching is result.matching
    assert "coarse maps" in result.warnings[0]
    assert result.figures()["margin"] == result.margin > 0
    cheapest = min(result.candidates, key=lambda one: one.matching.cost)
    assert cheapest.matching is not result.matching, "the cheapest matching is head to tail: nothing was decided here"


def test_ambiguity_is_that_of_the_scores(bred):
    _, result = bred
    first, *others = result.candidates
    far = [one for one in others if first.matching.contradictions(one.matching) > 1]
    assert result.ambiguous == (far[0].score - first.score < CLEAR or first.matching.strange)
    level = replace(result, candidates=(first, replace(far[0], energy=first.energy, unlikeness=first.unlikeness)))
    assert level.margin == pytest.approx(far[0].matching.cost - first.matching.cost)
    assert level.ambiguous == (level.margin < CLEAR or first.matching.strange)
    lost = replace(result, candidates=tuple(replace(one, energy=np.inf) for one in result.candidates))
    with np.errstate(invalid="ignore"):
        assert lost.ambiguous


def test_what_is_not_contested_is_not_tried(deer):
    assert deer[2].candidates == ()
    assert deer[2].margin == deer[2].matching.margin


def test_contradictory_pairs_give_a_map_without_folds_and_are_told(deer):
    _standing, _walking, result = deer
    crossed = result.pairs.target[[1, 0, 2, 3, 4, 5]]
    found = correspond_maps(result.source_map, result.target_map, VertexPairs(result.pairs.source[:6], crossed))
    assert found.figures()["folds_sphere"] == 0
    same = correspond_maps(
        result.source_map, result.target_map, VertexPairs(result.pairs.source[:6], result.pairs.target[[0, 0, 2, 3, 4, 5]])
    )
    assert same.figures()["folds_sphere"] == 0
    assert any("could not be brought together" in told for told in same.warnings)


def test_pairs_find_a_relabelled_copy():
    mesh = blob()
    copy, place = relabelled(mesh)
    result = correspond_maps(radial_map(mesh), radial_map(copy, TURN), VertexPairs(EVERY.source, place[EVERY.source]))
    assert np.abs(result.correspondence.positions - mesh.vertices).max() < 0.01 * np.sqrt(mesh.area)
    figures = result.figures()
    assert figures["pairs"] == len(EVERY)
    assert figures["pairs_rmse"] == pytest.approx(0, abs=1e-3)
    assert figures["margin"] is None


def test_real_maps_of_a_turned_copy_agree():
    mesh = blob(2)
    turned = mesh.with_vertices(3 * mesh.vertices @ TURN.T + 10)
    result = correspond(mesh, turned, VertexPairs([0, 50, 100, 161], [0, 50, 100, 161]))
    edge = np.sqrt(turned.area / turned.n_faces)
    assert np.linalg.norm(result.correspondence.positions - turned.vertices, axis=1).mean() < 0.1 * edge
    assert result.figures()["folds_sphere"] == 0


def test_reversed_faces_and_dropped_parts_do_not_count_as_folds():
    mesh = blob(2)
    reversed_faces = mesh.faces.copy()
    reversed_faces[:40] = reversed_faces[:40, ::-1]
    speck = mesh.n_vertices + np.array([[0, 1, 2]])
    vertices = np.vstack([mesh.vertices, 0.1 * np.eye(3)])
    messy = Mesh(vertices, np.vstack([reversed_faces, speck]))
    clean, dirty = radial_map(mesh), radial_map(messy)
    pairs = VertexPairs(EVERY.source[:5], EVERY.target[:5])
    for source, target in ((dirty, clean), (clean, dirty), (dirty, dirty)):
        result = correspond_maps(source, target, pairs)
        figures = result.figures()
        assert figures["folds_surface_percent"] == 0
        assert figures["energy"] == pytest.approx(1, abs=1e-3)
        assert result.correspondence.valid.sum() == mesh.n_vertices
        assert len(result.correspondence.points) == source.mesh.n_vertices


def test_morph_starts_at_the_source_and_ends_on_the_target():
    source, target = blob(2), blob(3, scale=2)
    result = morph_along(correspond_maps(radial_map(source), radial_map(target), EVERY_SMALL), frames=6)
    assert result.frames[0].vertices.tobytes() == source.vertices.tobytes()
    assert result.frames[5].vertices.tobytes() == result.matched.correspondence.positions.tobytes()
    np.testing.assert_array_equal(result.morph(0.4).vertices, result.frames[2].vertices)


@pytest.mark.parametrize("path", PATHS)
def test_every_path_has_the_same_ends_and_its_own_middle(path):
    source, target = blob(2), blob(3, scale=2)
    target = target.with_vertices(target.vertices @ Rotation.from_rotvec([0, 0, 2.0]).as_matrix())
    matched = correspond_maps(radial_map(source), radial_map(target), EVERY_SMALL)
    result = morph_along(matched, 5, path)
    straight = morph_along(matched, 5, "linear")
    assert result.morph.path == path
    np.testing.assert_array_equal(result.frames.positions[[0, -1]], straight.frames.positions[[0, -1]])
    gap = np.abs(result.frames.positions[1] - straight.frames.positions[1]).max()
    assert gap == 0 if path == "linear" else gap > 1e-3
    assert isinstance(result.figures()["self_intersections_max"], int)


def test_a_schedule_is_spread_over_the_bands():
    matched = correspond_maps(radial_map(blob(2)), radial_map(blob(2, scale=2)), EVERY_SMALL)
    together = morph_along(matched, 5, "wavelet", Schedule.together(1))
    np.testing.assert_allclose(together.frames.positions, morph_along(matched, 5, "linear").frames.positions, atol=1e-12)
    waiting = Schedule([0.6, 0.5], [0.4, 0.5], ("linear", "smoothstep"))
    late = morph_along(matched, 3, "wavelet", waiting)
    np.testing.assert_allclose(late.frames.positions[1], late.frames.positions[0], atol=1e-12)
    assert len(late.morph.schedule) == len(late.morph.bands) > 2
    assert (late.morph.schedule.start[0], late.morph.schedule.start[-1]) == (0.6, 0.5)


@pytest.mark.parametrize("path", ["gradient", "linear", "wavelet"])
def test_a_morph_sweeps_over_the_surface(path):
    matched = correspond_maps(radial_map(blob(2)), radial_map(blob(2, scale=2)), EVERY_SMALL)
    first = int(np.argmax(blob(2).vertices[:, 2]))
    result = morph_along(matched, 5, path, starts=np.array([first]))
    away = result.morph.delay
    last = int(np.argmax(away))
    assert (away[first], away[last]) == (0, 0.5)
    moved = np.linalg.norm(result.frames.positions - result.frames.positions[0], axis=2)
    assert moved[2, first] > (0.75 if path == "gradient" else 0.99) * moved[4, first]  # neighbours hold it back
    assert moved[2, last] < 0.1 * moved[4, last] or path == "gradient"  # or bring it along
    np.testing.assert_array_equal(result.frames.positions[4], matched.correspondence.positions)


def test_details_may_turn_with_the_faces_at_times_of_their_own():
    matched = correspond_maps(radial_map(blob(2)), radial_map(blob(2, scale=2)), EVERY_SMALL)
    early = Schedule([0.0, 0.0], [0.5, 0.5], ("linear", "linear"))
    result = morph_along(matched, 5, "gradient", early)
    np.testing.assert_allclose(result.frames.positions[2], result.frames.positions[4], atol=1e-9)
    assert np.abs(result.frames.positions[1] - result.frames.positions[4]).max() > 0.1


def torn(mesh):
    """A soup of the mesh after a vertex in no face, without its last two faces; and the clean vertex behind each of its vertices."""
    kept = mesh.faces[:-2].ravel()
    return Mesh(np.vstack([mesh.vertices[:1] + 0.3, mesh.vertices[kept]]), 1 + np.arange(len(kept)).reshape(-1, 3)), np.append(0, kept)


def test_no_seam_opens_on_the_way():
    """As the whole mesh travels, so does its soup: each triangle a part of its own, and a hole."""
    clean, target = blob(2), blob(2, scale=2)
    soup, origin = torn(clean)
    pairs = VertexPairs(np.array([np.flatnonzero(origin == v)[-1] for v in EVERY_SMALL.source]), EVERY_SMALL.target)
    result = morph(soup, target, pairs, frames=5)
    assert result.frames.topology is soup.topology
    swept = morph_along(result.matched, 3, "linear", starts=pairs.source[:1]).frames.positions[1, 1:]
    assert all(np.ptp(swept[origin[1:] == v], axis=0).max() < 1e-9 for v in EVERY_SMALL.source)
    first = np.unique(origin[1:], return_index=True)[1]
    for moved in result.frames.positions:
        np.testing.assert_array_equal(moved[1:], moved[1:][first][origin[1:]])
    assert result.frames.positions[0].tobytes() == soup.vertices.tobytes()
    assert result.frames.positions[-1].tobytes() == result.matched.correspondence.positions.tobytes()
    stray = result.frames.positions[:, 0]
    near = result.frames.positions[:, 1 + int(np.argmin(np.linalg.norm(soup.vertices[1:] - soup.vertices[0], axis=1)))]
    np.testing.assert_allclose(stray - near, (1 - result.frames.times)[:, None] * (stray - near)[0], atol=1e-12)


def test_pairs_on_vertices_that_were_not_mapped_are_refused():
    soup, _ = torn(blob(2))
    with pytest.raises(InputError, match="1 source vertices in no face"):
        correspond(soup, blob(2), VertexPairs([0, 7, 70], [0, 7, 70]))


EVERY_SMALL = VertexPairs([0, 30, 60, 90], [0, 30, 60, 90])


def test_figures_have_their_keys_and_go_into_json():
    result = morph_along(correspond_maps(radial_map(blob(1)), radial_map(blob(2)), VertexPairs([0, 5, 9], [0, 5, 9])), frames=3)
    assert list(result.figures()) == CORRESPOND_KEYS + MORPH_KEYS
    assert list(result.matched.figures()) == CORRESPOND_KEYS
    json.dumps(result.figures(), allow_nan=False)


def test_steps_are_reported_and_can_be_cancelled():
    seen = []
    correspond(blob(1), blob(1), VertexPairs([0, 5, 9], [0, 5, 9]), on_step=seen.append)
    assert len(seen) > 2

    def stop(step):
        raise Cancelled

    with pytest.raises(Cancelled, match="request to stop"):
        morph(blob(1), blob(1), on_step=stop)


def test_what_cannot_work_is_refused_before_the_work():
    mesh = blob(1)
    with pytest.raises(InputError, match="at least 2 frames"):
        morph(mesh, mesh, frames=1)
    with pytest.raises(InputError, match="a path out of linear, gradient, wavelet; found 'crooked'"):
        morph(mesh, mesh, path="crooked")
    matched = correspond_maps(radial_map(mesh), radial_map(mesh), VertexPairs([0, 5, 9], [0, 5, 9]))
    with pytest.raises(InputError, match='the path "wavelet" or "gradient" for a schedule'):
        morph_along(matched, path="linear", schedule=Schedule.together(2))
    with pytest.raises(InputError, match="starts"):
        morph_along(matched, starts=np.array([mesh.n_vertices]))
    with pytest.raises(InputError, match="target column"):
        correspond(mesh, mesh, VertexPairs([0, 1], [0, 999]))


def test_one_pair_of_a_mesh_without_features_is_not_enough_but_answered():
    mesh = blob(2)
    result = correspond(mesh, mesh, VertexPairs([0], [0]))
    assert result.figures()["folds_sphere"] == 0
    assert result.warnings


def test_pairs_of_one_place_do_not_settle_the_rotation_and_that_is_said():
    result = correspond_maps(radial_map(blob()), radial_map(blob()), VertexPairs([0, 0, 0], [0, 20, 300]))
    assert result.alignment.method == "search"
    assert result.figures()["folds_sphere"] == 0
    assert any("determine no rotation" in told for told in result.warnings)
    apart = correspond_maps(radial_map(blob()), radial_map(blob()), VertexPairs([0, 20, 300], [0, 20, 300]))
    assert apart.warnings == ()
