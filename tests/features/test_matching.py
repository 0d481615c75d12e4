"""Matching: identity, motion and numbering, left and right, what the user fixes, what cannot be told, poses of public animals."""

import pickle
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import InputError, Mesh, MeshError, VertexPairs, read_pairs, repair
from morphlet.features.matching import ENOUGH, WORTH, candidates, match
from morphlet.features.pairing import MatchOptions, _displaced, contradicts, marks_of, plain_differences, problem_of
from morphlet.features.regions import Regions, find_regions
from morphlet.samples.anatomy import SPECIES
from morphlet.samples.creatures import Creature
from morphlet.samples.poses import POSES
from morphlet.surface.distance import distances
from support import DIRECTIONS, HEIGHTS, blob, bumpy, data_file, data_mesh, icosphere, random_rotation, relabelled

NONE = np.zeros(0, np.int64)
LIMB = 0.3
"""A tip this close to the true place, over sqrt(area), is on the right limb: other limbs are 0.5 and more away."""


def mirrored(mesh):
    """The mirror image in x, its faces looking outwards again."""
    return Mesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1])


def off(source: Regions, target: Regions, pairs: VertexPairs, truth: np.ndarray):
    """How far the pairs' targets are from the true places of their sources, over sqrt(area)."""
    fields = distances(target.mesh, truth[pairs.source]) / np.sqrt(target.mesh.area)
    return fields[np.arange(len(pairs)), pairs.target]


@cache
def star() -> Regions:
    return find_regions(bumpy())


@cache
def fox(pose="standing", mirror=False) -> Regions:
    mesh = Creature.prepare("predator", 2500).posed(POSES[pose])
    return find_regions(mirrored(mesh) if mirror else mesh)


def test_a_mesh_matches_itself():
    found = match(star(), star())
    assert found.regions.tolist() == [[k, k] for k in range(6)]
    assert found.cost == 0
    assert found.margin > 0.3
    assert found.warnings == ()
    np.testing.assert_array_equal(found.pairs.source, found.pairs.target)
    assert found.pairs.labels[-1] == "core"


@given(st.integers(0, 50), st.floats(0.01, 100))
@settings(max_examples=5)
def test_motion_size_and_numbering_change_nothing(seed, scale):
    moved, place = relabelled(star().mesh.with_vertices(scale * star().mesh.vertices @ random_rotation(seed).T + 3), seed)
    found = match(star(), find_regions(moved))
    np.testing.assert_array_equal(found.pairs.target, place[found.pairs.source])
    assert found.cost == pytest.approx(0, abs=1e-4)
    assert not found.ambiguous


def test_both_directions_agree():
    other = find_regions(bumpy(heights=[1.1, 1.1, 1.6, 1.7, 1.2, 1.6]))
    forth, back = match(star(), other), match(other, star())
    assert sorted(map(tuple, forth.regions.tolist())) == sorted((i, j) for j, i in back.regions.tolist())
    assert forth.cost == pytest.approx(back.cost)
    assert forth.margin == pytest.approx(back.margin)


def test_a_bump_that_is_missing_stays_alone():
    other = find_regions(bumpy(DIRECTIONS[1:], HEIGHTS[1:]))
    found = match(star(), other)
    assert len(found.regions) == 5
    tips = star().mesh.vertices[star().tips[found.regions[:, 0]]], other.mesh.vertices[other.tips[found.regions[:, 1]]]
    cosines = np.einsum("kd,kd->k", *(x / np.linalg.norm(x, axis=1, keepdims=True) for x in tips))
    assert cosines.min() > 0.99


def test_a_mirror_image_without_symmetry_is_not_trusted():
    image = find_regions(mirrored(star().mesh))
    found = match(star(), image)
    assert found.ambiguous
    assert found.warnings[0].startswith("the mirror image of the target is much more alike (cost 0.00, ")
    deceived = match(star(), image, options=MatchOptions(turn=0))
    assert deceived.cost == pytest.approx(0, abs=1e-9)
    assert not deceived.ambiguous


def test_inside_out_meshes_are_seen_from_outside():
    inside_out = find_regions(Mesh(star().mesh.vertices, star().mesh.faces[:, ::-1]))
    assert match(star(), inside_out).cost == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("pose", ["walking", "rearing", "leaping"])
def test_limbs_of_a_symmetric_animal_are_told_apart_in_any_pose(pose):
    source, target = fox(), fox(pose)
    found = match(source, target)
    assert len(found.regions) in (6, 8)  # the ears hardly stand out enough to count
    assert not found.ambiguous
    assert off(source, target, found.pairs, np.arange(source.mesh.n_vertices))[:-1].max() < LIMB


def test_left_and_right_need_the_volumes():
    assert match(fox(), fox("walking"), options=MatchOptions(turn=0)).ambiguous


def test_the_mirror_image_of_a_symmetric_animal_has_left_and_right_exchanged():
    source, image = fox(), fox(mirror=True)
    found = match(source, image)
    assert not found.ambiguous
    feet = [k for k in range(6) if source.mesh.vertices[source.tips[k], 1] < 0.3 * np.ptp(source.mesh.vertices[:, 1])]
    tips = {i: (source.mesh.vertices[source.tips[i]], image.mesh.vertices[image.tips[j]]) for i, j in found.regions if i in feet}
    assert len(tips) >= 3
    assert all(a[0] * b[0] > 0 for a, b in tips.values())  # on the same side in space: the other leg of the animal


def test_the_volume_of_coordinates_is_that_of_the_mesh():
    mesh = blob(3)
    regions = Regions(mesh, np.zeros(mesh.n_vertices), star().peaks, [], [], [0, 1, 2], mesh.vertices.T)
    volumes = marks_of(regions, NONE).volumes
    assert 0.02 * volumes[0, 1, 2] == pytest.approx(mesh.volume)
    for order, sign in (((1, 2, 0), 1), ((2, 0, 1), 1), ((1, 0, 2), -1), ((0, 2, 1), -1), ((2, 1, 0), -1)):
        assert volumes[order] == pytest.approx(sign * volumes[0, 1, 2])
    assert volumes[0, 0, 1] == pytest.approx(0, abs=1e-9)


def test_no_tip_is_paired_twice():
    marks = marks_of(star(), NONE)
    added = problem_of(marks, marks, MatchOptions()).added(((0, 3), (1, 4)), 2)
    assert np.isinf(added[[3, 4]]).all()
    assert np.isfinite(added[[0, 1, 2, 5]]).all()


def test_a_pairing_contradicts_no_part_of_itself():
    assert not contradicts(((0, 1), (1, 0)), ((0, 1),))
    assert contradicts(((0, 1),), ((0, 2),))
    assert contradicts(((0, 1),), ((2, 1),))
    assert not contradicts(((0, 1),), ((2, 3),))


def test_balls_have_too_little_to_match():
    ball = find_regions(icosphere(3))
    with pytest.raises(MeshError, match="at least 3 pairs of feature regions; found 0, of 0 and 0 tips; give landmarks"):
        match(ball, ball)


def test_three_pairs_are_said_to_be_few():
    few = find_regions(bumpy(DIRECTIONS[1:4], HEIGHTS[1:4]))
    found = match(few, few)
    assert len(found.regions) == 3 < ENOUGH
    assert any(text.startswith("only 3 pairs of regions or landmarks, of 3 and 3 tips") for text in found.warnings)


def test_landmarks_stand_in_for_features():
    ball = find_regions(icosphere(3))
    given_pairs = VertexPairs([0, 1, 2, 3], [1, 0, 2, 3], [1, 2, 1, 1], labels=("a", "", "", "b"))
    found = match(ball, ball, fixed=given_pairs)
    assert len(found.regions) == 0
    assert found.pairs.source[:-1].tolist() == [0, 1, 2, 3]
    assert found.pairs.target[:-1].tolist() == [1, 0, 2, 3]
    assert found.pairs.weight[1] == 2
    assert found.pairs.labels == ("a", "given", "given", "b", "core")


def test_fixed_pairs_are_kept_even_if_wrong():
    tips = star().tips
    found = match(star(), star(), fixed=VertexPairs([tips[0]], [tips[1]]))
    assert [0, 1] in found.regions.tolist()
    assert (found.pairs.source[0], found.pairs.target[0]) == (tips[0], tips[1])
    assert len(set(found.pairs.source.tolist())) == len(found.pairs)
    assert found.cost > 0.5


def test_one_fixed_pair_settles_left_and_right_without_volumes():
    source, target = fox(), fox("walking")
    foot = int(source.tips[np.argmin(source.mesh.vertices[source.tips, 1])])
    chosen = MatchOptions(turn=0)
    loose, settled = match(source, target, options=chosen), match(source, target, fixed=VertexPairs([foot], [foot]), options=chosen)
    assert settled.margin >= loose.margin - 1e-12  # equal where the rival exchanges the ears only
    tips = np.array([k for k, label in enumerate(settled.pairs.labels) if label.startswith(("tip", "given"))])
    assert off(source, target, settled.pairs, np.arange(source.mesh.n_vertices))[tips].max() < LIMB


def test_forbidden_pairs_are_not_made():
    tips = star().tips
    found = match(star(), star(), forbidden=VertexPairs([tips[0], tips[2]], [tips[0], tips[2]]))
    assert len(found.regions) >= 4
    assert all(len(set(column)) == len(column) for column in found.regions.T.tolist())  # no tip twice
    assert not {(0, 0), (2, 2)} & set(map(tuple, found.regions.tolist()))
    assert found.cost > match(star(), star(), forbidden=VertexPairs([tips[0]], [tips[1]])).cost == 0


@pytest.mark.parametrize(("source", "target", "side"), [([3, 3], [5, 6], "source"), ([3, 4], [6, 6], "target"), ([3, 3], [5, 5], "source")])
def test_contradictory_pairs_are_refused(source, target, side):
    with pytest.raises(InputError, match=f"each vertex once; found 1 {side} vertex in several pairs"):
        match(star(), star(), fixed=VertexPairs(source, target))


def test_fixed_and_forbidden_must_differ():
    pair = VertexPairs([star().tips[0]], [star().tips[0]])
    with pytest.raises(InputError, match="forbidden pairs that are not fixed"):
        match(star(), star(), fixed=pair, forbidden=pair)


def test_what_is_forbidden_must_be_a_tip():
    with pytest.raises(InputError, match="forbidden pairs on tips"):
        match(star(), star(), forbidden=VertexPairs([star().core], [star().tips[0]]))


def test_pairs_must_fit_the_meshes():
    with pytest.raises(InputError, match="target column"):
        match(star(), star(), fixed=VertexPairs([0], [10**6]))


@pytest.mark.parametrize("weights", [{"miss": 0}, {"turn": -1}, {"shape": np.nan}])
def test_weights_are_checked(weights):
    with pytest.raises(InputError, match="weights >= 0"):
        MatchOptions(**weights)


def test_matchings_survive_pickling():
    found = match(star(), star())
    again = pickle.loads(pickle.dumps(found))
    assert again.regions.tolist() == found.regions.tolist()
    assert (again.cost, again.margin, again.warnings) == (found.cost, found.margin, found.warnings)


HORSES = [("meshes/horse.obj", f"horse-poses/horse-{k:02d}.obj") for k in range(1, 11)]
CATS = [("meshes/cat.obj", f"cat-poses/cat-{k:02d}.obj") for k in range(1, 6)]
TOSCA = [
    (f"tosca/{kind}{a}.off", f"tosca/{kind}{b}.off")
    for kind, poses in (("wolf", (0, 1, 2)), ("cat", (0, 1, 2, 3)), ("horse", (0, 5, 6, 7)))
    for a in poses
    for b in poses
    if a < b
]


@cache
def public(name: str) -> tuple[Regions, np.ndarray]:
    """Regions of a public mesh in a numbering of its own, and where its vertices went."""
    mesh = data_mesh(name)
    if name in ("tosca/horse5.off", "tosca/horse6.off"):
        mesh = repair(mesh).mesh
    shuffled, place = relabelled(mesh, sum(name.encode()))
    return find_regions(shuffled), place


@pytest.mark.parametrize(("one", "other"), HORSES + CATS + TOSCA)
def test_poses_of_public_animals(one, other):
    (source, before), (target, after) = public(one), public(other)
    found = match(source, target)
    assert len(found.regions) == 6
    assert not found.ambiguous
    error = off(source, target, found.pairs, after[np.argsort(before)])
    assert error[:-1].max() < 0.12
    assert error[-1] < 0.2  # the core


def test_cat_and_lion_against_markers():
    markers = read_pairs(data_file("markers/cat-lion.csv"))
    source, target = find_regions(data_mesh("meshes/cat.obj")), find_regions(data_mesh("meshes/lion.obj"))
    found = match(source, target)
    assert len(found.regions) == 6
    assert not found.ambiguous
    near = distances(source.mesh, markers.source)[:, found.pairs.source[:-1]].argmin(axis=0)
    assert off(source, target, VertexPairs(markers.source[near], found.pairs.target[:-1]), _lookup(markers)).max() < LIMB


def _lookup(markers: VertexPairs) -> np.ndarray:
    """Target of each marked source vertex."""
    table = np.zeros(markers.source.max() + 1, np.int64)
    table[markers.source] = markers.target
    return table


def test_limbs_that_are_longer_as_a_whole_sit_where_they_sat():
    """Distances of a tree: limbs of any length on trunk places; other lengths explain all of the difference, another place does not."""
    rng = np.random.default_rng(0)
    places, limbs, others = rng.random((6, 3)), rng.random(6), rng.random(6)
    trunk = np.linalg.norm(places[:, None] - places, axis=2)

    def tree(lengths, order):
        between = trunk[np.ix_(order, order)] + lengths[:, None] + lengths
        return between * (1 - np.eye(6))

    same, turned = np.arange(6), np.roll(np.arange(6), 1)
    assert _displaced(tree(limbs, same), tree(others, same)) == pytest.approx(0, abs=1e-9)
    assert _displaced(tree(limbs, same), tree(others, turned)) > 1
    three = np.ix_(range(3), range(3))
    assert _displaced(tree(limbs, same)[three], tree(others, same)[three]) == plain_differences(
        tree(limbs, same)[three], tree(others, same)[three]
    )
    assert plain_differences(tree(limbs, same), tree(others, same)) > 1


@cache
def deer() -> Regions:
    return find_regions(Creature.prepare("grazer", 2500).mesh)


def test_candidates_contradict_each_other_and_begin_with_the_best():
    found = candidates(deer(), fox())
    assert found[0].regions.tolist() == match(deer(), fox()).regions.tolist()
    assert found[0].contested
    assert found[0].ambiguous
    assert "nearly as good" in found[0].warnings[0]
    assert len(found) > 2
    costs = [one.cost for one in found]
    assert costs == sorted(costs)
    assert costs[-1] <= costs[0] + WORTH
    for k, one in enumerate(found):
        assert all(other.contradictions(one) > 0 for other in found[:k])
        assert one.contradictions(one) == 0
    assert all(one.margin < 0 for one in found[1:])


def test_what_is_not_contested_has_no_other_candidates():
    assert len(candidates(star(), star())) == 1
    foot = int(deer().tips[0])
    assert all(one.regions[-1].tolist() == [0, 2] for one in candidates(deer(), fox(), VertexPairs([foot], [int(fox().tips[2])])))


def test_among_the_candidates_of_two_animals_is_the_right_one():
    """Tips of a deer and of the same deer with a fox's proportions, told apart by the truth."""
    other = find_regions(Creature.prepare("grazer", 2500).posed(proportions=SPECIES["predator"]))
    truth = np.arange(deer().mesh.n_vertices)
    right = [np.max(off(deer(), other, one.pairs, truth)[:-1]) < LIMB for one in candidates(deer(), other)]
    assert any(right)


def test_contradictions_are_counted_in_pairs():
    one, two = match(star(), star()), match(star(), find_regions(bumpy()))
    swapped = replace(one, regions=one.regions[[1, 0, 2, 3, 4, 5]])
    assert one.contradictions(swapped) == 0  # the order is of no account
    crossed = replace(one, regions=np.column_stack([one.regions[:, 0], one.regions[[1, 0, 2, 3, 4, 5], 1]]))
    assert one.contradictions(crossed) == 2
    assert one.contradictions(two) == 0
