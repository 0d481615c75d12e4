"""Deformation transfer: its laws, the same minimiser as the published system, anchors, loose parts, public meshes."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh, VertexPairs
from morphlet.errors import InputError, MeshError
from morphlet.io.pairs import read_pairs
from morphlet.motion.face_pairs import FacePairs, pair_faces
from morphlet.motion.registration import register
from morphlet.motion.transfer import Anchor, TransferSolver, transfer
from morphlet.samples.copies import remeshed
from morphlet.samples.creatures import SPECIES, Creature
from morphlet.samples.poses import POSES
from morphlet.surface.nearest import nearest
from support import beside, blob, data_file, data_mesh, icosphere, random_rotation

BODY = blob(2)
FINE = blob(3)
PAIRS = pair_faces(BODY, FINE)
SOLVER = TransferSolver.prepare(BODY, FINE, PAIRS)
ITSELF = FacePairs(np.arange(BODY.n_faces), np.arange(BODY.n_faces))
SAME = TransferSolver.prepare(BODY, BODY, ITSELF)
seeds = st.integers(0, 10**6)


def posed(mesh: Mesh, seed: int) -> Mesh:
    """The mesh, smoothly deformed: the same deformation of space for the same seed."""
    a, b = np.random.default_rng(seed).normal(size=(2, 3, 3))
    return mesh.with_vertices(mesh.vertices + 0.25 * np.sin(mesh.vertices @ a) @ b)


def centred(mesh: Mesh) -> np.ndarray:
    return mesh.vertices - mesh.vertices.mean(axis=0)


def fourth_vertex_system(reference: Mesh, pose: Mesh, target: Mesh, pairs: FacePairs) -> np.ndarray:
    """Sumner and Popovic's least squares, written down as published and solved densely; vertex 0 at the origin."""

    def sides(mesh: Mesh) -> np.ndarray:
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        n = np.cross(b - a, c - a)
        return np.stack([b - a, c - a, n / np.sqrt(np.linalg.norm(n, axis=1, keepdims=True))], axis=2)

    changes, inverse = sides(pose) @ np.linalg.inv(sides(reference)), np.linalg.inv(sides(target))
    n, rows = target.n_vertices, []
    for face in pairs.target:
        block = np.zeros((3, n + target.n_faces))
        for k, corner in enumerate([target.faces[face, 1], target.faces[face, 2], n + face]):
            block[:, corner] += inverse[face, k]
            block[:, target.faces[face, 0]] -= inverse[face, k]
        rows.append(block)
    found = np.linalg.lstsq(np.concatenate(rows)[:, 1:], changes[pairs.source].transpose(0, 2, 1).reshape(-1, 3), rcond=None)[0]
    return np.vstack([np.zeros(3), found[: n - 1]])


def test_the_minimiser_is_that_of_the_system_with_a_fourth_vertex():
    coarse, target = blob(1), icosphere(1)
    rng = np.random.default_rng(0)
    pairs = FacePairs(rng.integers(0, 80, 180), np.append(np.arange(80), rng.integers(0, 80, 100)))  # many to many
    pose = posed(coarse, 1)
    expected = fourth_vertex_system(coarse, pose, target, pairs)
    found = transfer(coarse, pose, target, pairs)
    np.testing.assert_allclose(centred(found), expected - expected.mean(axis=0), atol=1e-11)


@settings(max_examples=15)
@given(seeds)
def test_a_mesh_takes_its_own_poses(seed):
    pose = posed(BODY, seed)
    np.testing.assert_allclose(centred(SAME.solve(pose)), centred(pose), atol=1e-11)
    np.testing.assert_allclose(SAME.solve(pose).vertices.mean(axis=0), BODY.vertices.mean(axis=0), atol=1e-12)


def test_the_reference_itself_changes_nothing():
    np.testing.assert_allclose(SOLVER.solve(BODY).vertices, FINE.vertices, atol=1e-11)


@settings(max_examples=15)
@given(seeds)
def test_where_a_pose_stands_does_not_matter(seed):
    pose = posed(BODY, seed)
    moved = pose.with_vertices(pose.vertices + 100 * np.random.default_rng(seed).normal(size=3))
    np.testing.assert_allclose(SOLVER.solve(moved).vertices, SOLVER.solve(pose).vertices, atol=1e-9)


@settings(max_examples=15)
@given(seeds)
def test_a_turned_pose_gives_the_turned_result(seed):
    rotation, pose = random_rotation(seed), posed(BODY, seed)
    turned = SOLVER.solve(pose.with_vertices(pose.vertices @ rotation.T))
    np.testing.assert_allclose(centred(turned), centred(SOLVER.solve(pose)) @ rotation.T, atol=1e-10)


@settings(max_examples=15)
@given(seeds, st.floats(0.01, 100))
def test_units_of_the_target_do_not_matter(seed, scale):
    pose = posed(BODY, seed)
    found = transfer(BODY, pose, FINE.with_vertices(scale * FINE.vertices), PAIRS)
    np.testing.assert_allclose(found.vertices, scale * SOLVER.solve(pose).vertices, atol=1e-10 * scale)


def test_another_triangulation_of_the_same_body_takes_its_poses():
    for seed in range(3):
        pose, there = posed(BODY, seed), posed(FINE, seed)
        found = SOLVER.solve(pose)
        error = centred(found) - centred(there)
        assert np.sqrt(np.mean(np.sum(error**2, axis=1))) < 0.02 * there.bbox_diagonal


def test_pinned_vertices_and_the_ground_stay():
    pose = posed(BODY, 3)
    pinned = TransferSolver.prepare(BODY, FINE, PAIRS, Anchor(vertices=[5])).solve(pose)
    np.testing.assert_allclose(pinned.vertices[5], FINE.vertices[5], atol=1e-12)
    three = TransferSolver.prepare(BODY, FINE, PAIRS, Anchor(vertices=[5, 6, 7])).solve(pose)
    np.testing.assert_allclose(three.vertices[5:8].mean(axis=0), FINE.vertices[5:8].mean(axis=0), atol=1e-12)
    standing = TransferSolver.prepare(BODY, FINE, PAIRS, Anchor(up=[0, 0, 5])).solve(pose)
    assert standing.vertices[:, 2].min() == pytest.approx(FINE.vertices[:, 2].min())
    np.testing.assert_allclose(standing.vertices[:, :2].mean(axis=0), FINE.vertices[:, :2].mean(axis=0), atol=1e-12)
    shapes = [centred(mesh) for mesh in (pinned, three, standing, SOLVER.solve(pose))]
    np.testing.assert_allclose(shapes, np.broadcast_to(shapes[0], np.shape(shapes)), atol=1e-11)


def test_anchors_do_not_care_where_positions_were():
    rest, moved = FINE.vertices, FINE.vertices @ random_rotation(1).T + np.array([3, 4, 5])
    on_ground = Anchor(vertices=[2], up=[0, 0, 5]).placed(moved, rest)
    assert on_ground[:, 2].min() == pytest.approx(rest[:, 2].min())
    np.testing.assert_allclose(on_ground[2, :2], rest[2, :2], atol=1e-12)
    np.testing.assert_allclose(Anchor().placed(moved, rest).mean(axis=0), rest.mean(axis=0), atol=1e-12)


def test_loose_parts_go_with_the_body():
    ear = icosphere(1).with_vertices(0.1 * icosphere(1).vertices + np.array([1.2, 0, 0]))
    target = Mesh(np.vstack([beside(icosphere(2), ear).vertices, [[0, 0, 1.1]]]), beside(icosphere(2), ear).faces)
    ball, rotation = icosphere(2), random_rotation(2)
    solver = TransferSolver.prepare(ball, target, FacePairs(np.arange(ball.n_faces), np.arange(ball.n_faces)), Anchor(vertices=[0]))
    turned = solver.solve(ball.with_vertices(ball.vertices @ rotation.T))
    body, part = slice(0, ball.n_vertices), slice(ball.n_vertices, -1)
    shift = turned.vertices[0] - rotation @ target.vertices[0]
    np.testing.assert_allclose(turned.vertices[body], target.vertices[body] @ rotation.T + shift, atol=1e-10)
    np.testing.assert_allclose(turned.vertices[part], target.vertices[part] @ rotation.T + shift, atol=1e-10)
    np.testing.assert_allclose(turned.vertices[-1], rotation @ [0, 0, 1.1] + shift, atol=1e-10)


@settings(max_examples=15)
@given(seeds)
def test_faces_in_no_pair_follow_their_neighbours(seed):
    rotation = random_rotation(seed)
    few = np.random.default_rng(seed).choice(BODY.n_faces, 30, replace=False)
    found = transfer(BODY, BODY.with_vertices(BODY.vertices @ rotation.T), BODY, FacePairs(few, few))
    np.testing.assert_allclose(centred(found), centred(BODY) @ rotation.T, atol=1e-10)


def test_a_face_in_no_pair_does_what_the_nearest_in_a_pair_does():
    halves = np.flatnonzero(BODY.vertices[BODY.faces].mean(axis=1)[:, 0] > 0)
    solver = TransferSolver.prepare(BODY, BODY, FacePairs(halves, halves))
    nearest_to = np.asarray(solver.mean.argmax(axis=1)).ravel()
    np.testing.assert_array_equal(nearest_to[halves], halves)
    border = np.isin(BODY.faces, BODY.faces[np.setdiff1d(np.arange(BODY.n_faces), halves)]).sum(axis=1) >= 2
    assert set(np.delete(nearest_to, halves)) <= set(np.flatnonzero(border))


def test_a_mesh_of_several_parts_takes_its_own_poses():
    ear = icosphere(1).with_vertices(0.1 * icosphere(1).vertices + np.array([1.2, 0, 0]))
    both = beside(icosphere(2), ear)
    some = np.arange(both.n_faces)
    pose = posed(both, 6)
    apart = pose.with_vertices(pose.vertices + np.where(np.arange(both.n_vertices)[:, None] < 162, 0.0, [0.3, 0, 0]))
    for shape in (pose, apart):
        np.testing.assert_allclose(centred(transfer(both, shape, both, FacePairs(some, some))), centred(shape), atol=1e-10)
    twice = both.with_vertices(2 * both.vertices)
    np.testing.assert_allclose(centred(transfer(both, apart, twice, FacePairs(some, some))), 2 * centred(apart), atol=1e-10)


def test_loose_parts_in_no_pair_turn_with_the_body():
    ear = icosphere(1).with_vertices(0.1 * icosphere(1).vertices + np.array([1.2, 0, 0]))
    target, ball, rotation = beside(icosphere(2), ear), icosphere(2), random_rotation(3)
    some = np.arange(ball.n_faces)
    found = transfer(ball, ball.with_vertices(ball.vertices @ rotation.T), target, FacePairs(some, some))
    np.testing.assert_allclose(centred(found), centred(target) @ rotation.T, atol=1e-10)


def test_faces_without_area_are_left_aside():
    faces = np.vstack([BODY.faces, [[0, 0, 1], [2, 2, 2]]])
    reference, target = Mesh(BODY.vertices, faces), Mesh(BODY.vertices, faces)
    everything = np.arange(len(faces))
    pose = posed(BODY, 4)
    found = transfer(reference, Mesh(pose.vertices, faces), target, FacePairs(everything, everything))
    np.testing.assert_allclose(centred(found), centred(pose), atol=1e-10)
    flat = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]])
    with pytest.raises(InputError, match="at least one pair of faces; found 1, 0 of them"):
        transfer(flat, flat, flat, FacePairs([0], [0]))


def test_poses_of_another_mesh_are_refused():
    with pytest.raises(InputError, match="a pose of the reference's 162 vertices and 320 faces; found 642 vertices, 1280 faces"):
        SOLVER.solve(FINE)
    with pytest.raises(InputError, match="of others"):
        SOLVER.solve(Mesh(BODY.vertices, BODY.faces[::-1]))


def test_pairs_and_anchors_of_another_mesh_are_refused():
    with pytest.raises(InputError, match="target column"):
        TransferSolver.prepare(BODY, FINE, FacePairs([0], [5000]))
    with pytest.raises(InputError, match="source column"):
        TransferSolver.prepare(BODY, FINE, FacePairs([400], [0]))
    with pytest.raises(InputError, match="the anchor's vertices"):
        TransferSolver.prepare(BODY, FINE, PAIRS, Anchor(vertices=[700]))
    with pytest.raises(InputError, match="target of shape"):
        FacePairs([0, 1], [0])
    with pytest.raises(InputError, match="finite numbers in up"):
        Anchor(up=[0, np.nan, 0])
    with pytest.raises(MeshError, match="faces that have an area"):
        pair_faces(BODY, Mesh([[0, 0, 0]], np.zeros((0, 3), int)))


def test_faces_that_lie_side_by_side_are_paired_if_they_look_the_same_way():
    assert pair_faces(BODY, BODY).source.tolist() == list(range(BODY.n_faces))
    assert np.unique(PAIRS.source).tolist() == list(range(BODY.n_faces))
    assert np.unique(PAIRS.target).tolist() == list(range(FINE.n_faces))
    inner = icosphere(1).with_vertices(0.9 * icosphere(1).vertices)
    inside_out = Mesh(inner.vertices, inner.faces[:, ::-1])
    shell = beside(icosphere(1), inside_out)
    pairs = pair_faces(icosphere(1), shell)
    assert pairs.source[pairs.target < 80].tolist() == list(range(80))
    assert (np.einsum("kd,kd->k", icosphere(1).face_normals[pairs.source], shell.face_normals[pairs.target]) > 0).all()


def test_pairs_and_anchors_survive_pickling():
    pairs, anchor = pickle.loads(pickle.dumps((PAIRS, Anchor([3], [0, 1, 0]))))
    np.testing.assert_array_equal(pairs.target, PAIRS.target)
    assert anchor.vertices.tolist() == [3]
    assert anchor.up.tolist() == [0, 1, 0]


def markers(count: int = 12) -> VertexPairs:
    """The corners of the icosahedron, on both triangulations of the body."""
    return VertexPairs(np.arange(count), np.arange(count))


def test_registration_holds_the_pairs_and_reaches_the_target():
    target = posed(FINE, 5)
    laid = register(BODY, target, markers())
    np.testing.assert_allclose(laid.vertices[:12], target.vertices[:12], atol=1e-12)
    gaps = np.linalg.norm(nearest(target, laid.vertices).positions(target) - laid.vertices, axis=1)
    assert gaps.mean() < 0.01 * target.bbox_diagonal


@pytest.mark.parametrize("seed", range(3))
def test_registration_does_not_depend_on_units_and_places(seed):
    rng, first, second = np.random.default_rng(seed), random_rotation(seed), random_rotation(seed + 10)
    target = posed(FINE, 5)
    source = BODY.with_vertices(rng.uniform(0.01, 100) * BODY.vertices @ first.T + rng.normal(size=3))
    scale, offset = rng.uniform(0.01, 100), rng.normal(size=3)
    laid = register(source, target.with_vertices(scale * target.vertices @ second.T + offset), markers())
    np.testing.assert_allclose(laid.vertices, scale * register(BODY, target, markers()).vertices @ second.T + offset, atol=1e-8 * scale)


def test_registration_survives_flat_faces_lone_vertices_and_parts_without_pairs():
    vertices = np.vstack([BODY.vertices, icosphere(1).vertices * 0.05 + np.array([1.5, 0, 0]), [[0, 0, 0]]])
    faces = np.vstack([BODY.faces, icosphere(1).faces + BODY.n_vertices, [[0, 0, 1]]])
    laid = register(Mesh(vertices, faces), posed(FINE, 5), markers())
    assert np.abs(laid.vertices).max() < 5


def test_registration_is_drawn_to_the_side_that_looks_the_same_way():
    ball = icosphere(3)
    inside_out = Mesh(0.97 * ball.vertices, ball.faces[:, ::-1])
    coarse = icosphere(2)
    inner = coarse.with_vertices(coarse.vertices * np.where(np.arange(coarse.n_vertices) < 12, 1.0, 0.975)[:, None])
    laid = register(inner, beside(ball, inside_out), markers())
    assert np.linalg.norm(laid.vertices, axis=1).mean() > 0.99


def test_bad_pairs_are_refused_by_registration():
    with pytest.raises(InputError, match="at least 3 pairs with different source vertices; found 2"):
        register(BODY, FINE, VertexPairs([0, 1, 1], [0, 1, 2]))
    with pytest.raises(InputError, match="source column"):
        register(BODY, FINE, VertexPairs([0, 1, 999], [0, 1, 2]))
    with pytest.raises(MeshError, match="a target with faces that have an area; found none among 1"):
        register(BODY, Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), VertexPairs([0, 1, 2], [0, 1, 2]))


def off(found: Mesh, truth: np.ndarray) -> float:
    """Rms distance per bounding-box diagonal, after translation."""
    gaps = centred(found) - truth + truth.mean(axis=0)
    return float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))) / np.linalg.norm(np.ptp(truth, axis=0)))


@pytest.fixture(scope="module")
def grazer() -> Creature:
    return Creature.prepare("grazer", n_vertices=2000)


@pytest.mark.parametrize("pose", ["rearing", "grazing"])
def test_a_remeshed_animal_takes_the_poses_of_the_original(grazer, pose):
    copy, places = remeshed(grazer.mesh)
    found = transfer(grazer.mesh, grazer.posed(POSES[pose]), copy, pair_faces(grazer.mesh, copy))
    assert off(found, places.positions(grazer.posed(POSES[pose]))) < 0.005


@pytest.mark.parametrize("pose", ["rearing", "grazing"])
def test_an_animal_takes_the_poses_of_another_species(grazer, pose):
    other = SPECIES["predator"]
    rest = grazer.posed(proportions=other)
    solver = TransferSolver.prepare(grazer.posed(), rest, FacePairs(np.arange(rest.n_faces), np.arange(rest.n_faces)))
    truth = grazer.posed(POSES[pose], other).vertices
    assert off(solver.solve(grazer.posed(POSES[pose])), truth) < 0.02 < 0.05 < off(rest, truth)


def test_cat_to_lion_by_markers():
    cat, lion = data_mesh("meshes/cat.obj"), data_mesh("meshes/lion.obj")
    solver = TransferSolver.prepare(cat, lion, pair_faces(register(cat, lion, read_pairs(data_file("markers/cat-lion.csv"))), lion))
    np.testing.assert_allclose(solver.solve(cat).vertices, lion.vertices, atol=1e-9)
    pose = data_mesh("cat-poses/cat-05.obj")  # upright: forelegs above hind legs
    found, kept = solver.solve(pose), cat.with_vertices(pose.vertices)
    pairs = read_pairs(data_file("markers/cat-lion.csv"))
    order = [np.argsort(mesh.vertices[index] @ [0, 1, 0]) for mesh, index in ((kept, pairs.source), (found, pairs.target))]
    ranks = np.argsort(order, axis=1)
    assert np.corrcoef(ranks)[0, 1] > 0.9
