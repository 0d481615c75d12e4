"""Procedural creatures: closed, genus 0, well shaped, the same every time, and in true correspondence."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import InputError
from morphlet.samples import anatomy
from morphlet.samples.anatomy import BONES, SPECIES
from morphlet.samples.creatures import SAMPLES, Creature, blob, creature, landmarks, sample, spiky
from morphlet.samples.poses import POSES, Pose, posed

FEW = 2500
"""Vertices of most creatures here: quick, and coarse enough to stress the thin parts."""


@pytest.fixture(scope="module")
def herd():
    return {species: Creature.prepare(species, FEW) for species in SPECIES}


def smallest_angles(mesh):
    """Smallest angle of each face, in degrees."""
    corners = mesh.vertices[mesh.faces]
    edges = np.roll(corners, -1, axis=1) - corners
    edges = edges / np.linalg.norm(edges, axis=2, keepdims=True)
    return np.degrees(np.arccos(np.clip(-np.sum(edges * np.roll(edges, 1, axis=1), axis=2), -1, 1))).min(axis=1)


def assert_sphere_like(mesh):
    assert np.all(mesh.topology.twins >= 0)
    assert mesh.topology.n_components == 1
    assert mesh.topology.euler_characteristic == 2
    assert mesh.topology.referenced.all()
    assert mesh.volume > 0


def folds(mesh):
    """Number of faces that look away from the mean of their corners' normals: inverted ones."""
    normals = mesh.vertex_normals[mesh.faces].sum(axis=1)
    return int(np.sum(np.sum(normals * mesh.face_normals, axis=1) <= 0))


@pytest.mark.parametrize(("species", "n"), [("grazer", 1500), ("predator", 1500), ("grazer", 7000)])
def test_creature_is_closed_and_well_shaped(species, n):
    mesh = creature(species, n_vertices=n)
    assert_sphere_like(mesh)
    assert mesh.n_vertices == n
    angles = smallest_angles(mesh)
    assert np.percentile(angles, 1) > 25
    assert angles.min() > 12
    assert folds(mesh) == 0


def test_blob_and_spiky():
    for mesh in (blob(n_vertices=FEW), spiky(n_vertices=FEW), spiky(3, length=1.5, n_vertices=FEW)):
        assert_sphere_like(mesh)
        assert mesh.n_vertices == FEW
        assert np.percentile(smallest_angles(mesh), 1) > 25
    assert np.linalg.norm(mesh.vertices, axis=1).max() == pytest.approx(2.03, abs=0.02)


def test_same_bits_every_time_and_other_seeds_differ():
    first, second = (blob(1, n_vertices=1500).fingerprint for _ in range(2))
    assert first == second
    assert blob(2, n_vertices=1500).fingerprint != first


def test_surface_lies_on_the_solid(herd):
    for species, animal in herd.items():
        value = anatomy.solid(SPECIES[species])[0].field(animal.mesh.vertices)[:, 0]
        assert np.abs(value).max() < 1e-6


def test_vertex_numbers_are_met_exactly_and_named():
    with pytest.raises(InputError, match="1500 to 100000 vertices"):
        creature("grazer", n_vertices=100)
    with pytest.raises(InputError, match=r"species grazer, predator; found 'grazr'; did you mean 'grazer'"):
        creature("grazr")
    with pytest.raises(InputError, match="1 to 40 spikes"):
        spiky(0)


def test_sample_by_name(herd):
    for name in ("predator-leaping", "grazer"):
        species, _, pose = name.partition("-")
        mesh = sample(name, n_vertices=FEW)
        assert mesh.fingerprint == herd[species].posed(POSES[pose or "standing"]).fingerprint
    assert sample("blob", n_vertices=1500).fingerprint == blob(n_vertices=1500).fingerprint
    assert {name.partition("-")[0] for name in SAMPLES} == {*SPECIES, "blob", "spiky"}
    assert all(name.partition("-")[2] in {"", *POSES} for name in SAMPLES)


def test_unknown_sample_lists_all():
    with pytest.raises(InputError, match=r"grazer-walking.*blob, spiky; found 'unicorn'"):
        sample("unicorn")


@pytest.mark.parametrize("species", SPECIES)
@pytest.mark.parametrize("pose", POSES)
def test_poses_share_the_topology_and_do_not_fold(herd, species, pose):
    mesh = herd[species].posed(POSES[pose])
    assert mesh.topology is herd[species].mesh.topology
    assert mesh.vertices[:, 1].min() == pytest.approx(0, abs=1e-12)
    assert mesh.face_areas.min() > 1e-7
    assert mesh.volume == pytest.approx(herd[species].mesh.volume, rel=0.08)
    if f"{species}-{pose}" in SAMPLES:
        assert folds(mesh) == 0
        assert np.percentile(smallest_angles(mesh), 1) > 20


def test_rest_pose_moves_nothing(herd):
    animal = herd["grazer"]
    moved = animal.posed().vertices - animal.mesh.vertices
    assert np.ptp(moved, axis=0) == pytest.approx(0, abs=1e-12)


def test_own_proportions_move_little(herd):
    """Settling slides vertices in the surface, by less than an edge."""
    animal = herd["predator"]
    moved = animal.posed(proportions=SPECIES["predator"]).vertices - animal.posed().vertices
    assert np.linalg.norm(moved, axis=1).max() < 0.03


def test_ears_turn_alone(herd):
    animal = herd["grazer"]
    bent = animal.posed(Pose(ears=0.4))
    moved = np.linalg.norm(np.diff([animal.posed().vertices, bent.vertices], axis=0)[0], axis=1)
    ears = animal.weights[:, BONES.index("left ear")] + animal.weights[:, BONES.index("right ear")]
    assert moved[ears == 0].max() < 1e-12
    assert moved[ears > 0.9].min() > 1e-3


@given(angle=st.floats(-3, 3))
@settings(max_examples=10, deadline=None)
def test_pitch_alone_is_a_rigid_motion(herd, angle):
    animal = herd["predator"]
    edges = animal.mesh.topology.edges
    pair = animal.mesh, animal.posed(Pose(pitch=angle))
    rest, turned = (np.linalg.norm(np.diff(m.vertices[edges], axis=1)[:, 0], axis=1) for m in pair)
    np.testing.assert_allclose(turned, rest, atol=1e-12)


@given(angles=st.lists(st.floats(-1, 1), min_size=9, max_size=9))
@settings(max_examples=20, deadline=None)
def test_bones_stay_joined_and_rotations_proper(angles):
    pose = Pose(angles[0], tuple(angles[1:3]), tuple(angles[3:6]), tuple(angles[6:9]), front_left=tuple(angles[:4]))
    bones = anatomy.skeleton(SPECIES["grazer"])
    turns, shifts = posed(bones, pose)
    assert np.linalg.det(turns.as_matrix()) == pytest.approx(1)
    starts, ends = turns.apply(bones.starts) + shifts, turns.apply(bones.ends) + shifts
    for child, parent in (("neck 2", "neck 1"), ("head", "neck 2"), ("left front lower", "left front upper")):
        np.testing.assert_allclose(starts[BONES.index(child)], ends[BONES.index(parent)], atol=1e-12)


def test_weights_are_a_partition_of_unity(herd):
    for animal in herd.values():
        np.testing.assert_allclose(animal.weights.sum(axis=1), 1, atol=1e-12)
        assert animal.weights.min() >= 0


def test_grazer_becomes_predator_vertex_by_vertex(herd):
    """With the other species' proportions every vertex lies on the other species' body, each landmark near its own."""
    body = anatomy.solid(SPECIES["predator"])[0]
    mesh = herd["grazer"].posed(proportions=SPECIES["predator"])
    assert mesh.topology is herd["grazer"].mesh.topology
    lowest = herd["grazer"]._reproportioned(SPECIES["predator"]).vertices[:, 1].min()
    assert np.abs(body.field(mesh.vertices + np.array([0, lowest, 0]))[:, 0]).max() < 1e-5
    assert folds(mesh) == 0
    own = herd["predator"].posed()
    places = own.vertices[list(herd["predator"].landmarks.values())]
    carried = mesh.vertices[list(herd["grazer"].landmarks.values())]
    assert np.linalg.norm(places - carried, axis=1).max() < 0.1


def test_proportions_do_what_they_say(herd):
    grazer, tall = SPECIES["grazer"], replace(SPECIES["grazer"], leg=1.2)
    heights = [np.ptp(herd["grazer"].posed(proportions=p).vertices[:, 1]) for p in (grazer, tall)]
    assert heights[1] - heights[0] == pytest.approx(1.2 - grazer.leg, abs=0.03)


def test_landmarks_are_where_they_should_be(herd):
    for animal in herd.values():
        at = {label: animal.mesh.vertices[v] for label, v in animal.landmarks.items()}
        assert len(set(animal.landmarks.values())) == len(at)
        assert at["nose"][2] == pytest.approx(animal.mesh.vertices[:, 2].max(), abs=0.05)
        assert at["tail tip"][2] == pytest.approx(animal.mesh.vertices[:, 2].min(), abs=0.2)
        assert at["left ear"][1] == pytest.approx(animal.mesh.vertices[:, 1].max(), abs=0.05)
        assert at["left front foot"][0] > 0.05 > -0.05 > at["right front foot"][0]
        assert at["left hock"][2] < at["left knee"][2]
    assert landmarks("predator", FEW) == herd["predator"].landmarks
    assert herd["grazer"].landmarks.keys() == herd["predator"].landmarks.keys()


def test_creatures_travel_between_processes(herd):
    twin = pickle.loads(pickle.dumps(herd["predator"]))
    assert twin.posed(POSES["walking"]).fingerprint == herd["predator"].posed(POSES["walking"]).fingerprint
    assert not twin.weights.flags.writeable
