"""Gradient paths: both ends, rigid motions, the laws they obey, and how much less they shrink than straight lines."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from morphlet import Mesh, MeshSequence
from morphlet.motion.face_turns import face_rotations, unwrapped
from morphlet.motion.mixture import Mixture
from morphlet.motion.morph import Morph, edge_log_rms_max, self_intersections_max, volume_change_max
from morphlet.numerics.rigid import rigid
from morphlet.surface.mesh import Topology
from support import blob, data_mesh, icosphere, random_rotation

BODY = blob(2)
FAR = np.array([5, 0, 0])
seeds = st.integers(0, 10**6)
times = st.floats(0, 1)


def between(source: Mesh, target: np.ndarray):
    """Positions by time, without the exact ends of a morph."""
    mixture = Mixture.prepare(source, np.stack([source.vertices, target]))
    return lambda t: mixture(np.array([[1 - t], [t]]))


def rod(rings: int = 41, sides: int = 12) -> Mesh:
    """A rod along z with flat caps: length 8, radius 1."""
    turn = 2 * np.pi * np.arange(sides) / sides
    z = np.linspace(-4, 4, rings)
    side = np.stack([np.tile(np.cos(turn), rings), np.tile(np.sin(turn), rings), np.repeat(z, sides)], axis=1)
    i, j = np.arange(sides), (np.arange(sides) + 1) % sides
    faces = [np.concatenate([np.stack([r + i, r + j, r + sides + i], 1), np.stack([r + j, r + sides + j, r + sides + i], 1)])
             for r in range(0, (rings - 1) * sides, sides)]  # fmt: skip
    n, last = len(side), (rings - 1) * sides
    caps = [np.stack([j, i, np.full(sides, n)], 1), np.stack([last + i, last + j, np.full(sides, n + 1)], 1)]
    return Mesh(np.vstack([side, [[0, 0, -4], [0, 0, 4]]]), np.concatenate([*faces, *caps]))


def twisted(mesh: Mesh, degrees: float) -> np.ndarray:
    """Positions whose upper half is turned about z, more and more towards the end, by so many degrees there."""
    angles = np.radians(degrees) * np.maximum(mesh.vertices[:, 2], 0) / 4
    return Rotation.from_rotvec(angles[:, None] * [0, 0, 1]).apply(np.array(mesh.vertices))


def pulled(seed: int, size: float) -> np.ndarray:
    """Smoothly moved positions."""
    a, b = np.random.default_rng(seed).normal(size=(2, 3, 3))
    return BODY.vertices + size * np.sin(BODY.vertices @ a) @ b


@settings(max_examples=15)
@given(seeds)
def test_both_ends_are_met_even_by_noise(seed):
    target = np.random.default_rng(seed).normal(size=BODY.vertices.shape)
    path = between(BODY, target)
    np.testing.assert_allclose(path(0.0), BODY.vertices, atol=1e-11)
    np.testing.assert_allclose(path(1.0), target, atol=1e-11)


def test_the_ends_of_a_morph_are_the_shapes_themselves():
    target = pulled(0, 0.3)
    frames = Morph(BODY, target, "gradient").frames(3)
    assert frames[0].vertices.tobytes() == BODY.vertices.tobytes()
    assert frames[2].vertices.tobytes() == target.tobytes()


@settings(max_examples=15)
@given(seeds, st.floats(0, 3.1), times)
def test_a_rotation_stays_rigid(seed, angle, t):
    axis = np.random.default_rng(seed).normal(size=3)
    turn, offset = angle * axis / np.linalg.norm(axis), np.array([1, 2, 3])
    path = between(BODY, Rotation.from_rotvec(turn).apply(np.array(BODY.vertices)) + offset)
    centred = BODY.vertices - BODY.vertices.mean(axis=0)
    centre = Rotation.from_rotvec(turn).apply(BODY.vertices.mean(axis=0)) + offset
    expected = Rotation.from_rotvec(t * turn).apply(centred) + (1 - t) * BODY.vertices.mean(axis=0) + t * centre
    np.testing.assert_allclose(path(t), expected, atol=1e-10)


@settings(max_examples=15)
@given(seeds, times)
def test_turned_and_moved_shapes_have_turned_and_moved_paths(seed, t):
    rotation, offset = random_rotation(seed), np.random.default_rng(seed).normal(size=3)
    target = pulled(seed, 0.2)
    turned = between(BODY.with_vertices(BODY.vertices @ rotation.T + offset), target @ rotation.T + offset)
    np.testing.assert_allclose(turned(t), between(BODY, target)(t) @ rotation.T + offset, atol=1e-9)


@settings(max_examples=15)
@given(seeds, times, st.floats(1e-3, 1e3))
def test_scaled_shapes_have_scaled_paths(seed, t, scale):
    target = pulled(seed, 0.2)
    found = between(BODY.with_vertices(scale * BODY.vertices), scale * target)(t)
    np.testing.assert_allclose(found, scale * between(BODY, target)(t), atol=1e-9 * scale)


@settings(max_examples=15)
@given(times)
def test_equal_ends_stand_still(t):
    np.testing.assert_allclose(between(BODY, BODY.vertices)(t), BODY.vertices, atol=1e-12)


@settings(max_examples=15)
@given(times)
def test_growth_is_a_straight_line(t):
    target = 3 * BODY.vertices + 1
    np.testing.assert_allclose(between(BODY, target)(t), (1 - t) * BODY.vertices + t * target, atol=1e-10)


def test_the_volume_follows_a_straight_line():
    mesh = rod()
    target = twisted(mesh, 250)
    assert abs(volume_change_max(Morph(mesh, target, "gradient").frames(6))) < 0.1
    assert abs(volume_change_max(Morph(mesh, target).frames(6))) > 10


def test_growth_along_one_axis_keeps_edges_in_step():
    mesh = rod()  # its diagonals would grow on curves if all moved on straight lines
    frames = [Morph(mesh, mesh.vertices * [1, 1, 3], path).frames(6) for path in ("gradient", "linear")]
    turning, straight = (edge_log_rms_max(some) for some in frames)
    assert turning < 0.8 * straight
    assert abs(volume_change_max(frames[0])) < 0.5


def test_a_ball_that_turns_over_stays_round():
    ball = icosphere(2)
    frames = Morph(ball, ball.vertices * [-1, -1, 1], "gradient").frames(5)
    assert abs(volume_change_max(frames)) < 1e-9
    assert edge_log_rms_max(frames) < 1e-12


def test_a_mirrored_shape_has_a_path_too():
    frames = Morph(BODY, BODY.vertices * [-1, 1, 1], "gradient").frames(5)
    assert np.isfinite(frames.positions).all()


@pytest.mark.parametrize("degrees", [90, 250, 300])
def test_a_rod_twisted_by_more_than_half_a_turn_untwists_evenly(degrees):
    mesh = rod()
    found, expected = between(mesh, twisted(mesh, degrees))(0.5), twisted(mesh, degrees / 2)
    assert np.abs(rigid(found, expected)(found) - expected).max() < 0.5  # of radius 1; a wrong branch is 2 off


def test_a_bent_rod_keeps_its_thickness():
    mesh = rod()
    angle = mesh.vertices[:, 2] / 4 * 0.75 * np.pi / 2  # 135 degrees from end to end
    radius = 4 / (0.75 * np.pi / 2) + mesh.vertices[:, 0]
    bent = np.stack([radius * np.cos(angle), mesh.vertices[:, 1], radius * np.sin(angle)], axis=1)
    straight, turning = (edge_log_rms_max(Morph(mesh, bent, path).frames(5)) for path in ("linear", "gradient"))
    assert turning < straight / 5


@settings(max_examples=15)
@given(seeds)
def test_gradients_on_a_line_get_a_rotation_onto_it(seed):
    frames = random_rotation(seed)[None, :2]
    share, line = np.random.default_rng(seed).normal(size=2), random_rotation(seed + 1)[0]
    gradients = np.outer(share, line)[None]
    turn = face_rotations(frames, gradients)[0]
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1)
    np.testing.assert_allclose(abs(share @ frames[0] @ turn.T @ line), np.linalg.norm(share), atol=1e-12)


def test_gradients_without_direction_get_no_rotation():
    frames = np.array([np.eye(3)[:2], np.zeros((2, 3)), np.eye(3)[:2]])
    gradients = np.array([np.zeros((2, 3)), np.zeros((2, 3)), [[-1, 0, 0], [0, 0, 0]]])
    np.testing.assert_allclose(face_rotations(frames, gradients), [np.eye(3), np.eye(3), np.diag([-1, -1, 1])], atol=1e-15)


def test_faces_that_collapse_or_appear_do_no_harm():
    ends = (BODY.vertices, np.where(BODY.vertices[:, [0]] > 0.3, [0.3, 0.0, 0.0], BODY.vertices))
    for first, last in (ends, ends[::-1]):
        path = between(BODY.with_vertices(first), last)
        np.testing.assert_allclose(path(0.0), first, atol=1e-10)
        assert np.abs(path(0.5)).max() < 3
        np.testing.assert_allclose(path(1 - 1e-9)[last[:, 0] < 0.2], last[last[:, 0] < 0.2], atol=1e-6)


def test_parts_and_lone_vertices_go_with_the_body():
    mesh = rod()
    angle = np.radians(120) * (mesh.vertices[:, [2]] > 2)  # the upper quarter turns about x
    whole = np.vstack([mesh.vertices, 0.2 * icosphere(1).vertices + np.array([0, 1.2, 3]), [[0, 0, 4.5]]])
    both = Mesh(whole, np.vstack([mesh.faces, icosphere(1).faces + mesh.n_vertices]))
    angle = np.radians(120) * (whole[:, [2]] > 2)
    pivot = np.array([0, 0, 2])
    end = Rotation.from_rotvec(angle * [1, 0, 0]).apply(whole - pivot) + pivot
    path = between(both, end)
    np.testing.assert_allclose(path(0.0), whole, atol=1e-11)
    np.testing.assert_allclose(path(1.0), end, atol=1e-11)
    gaps = [
        np.linalg.norm(x[mesh.n_vertices :].mean(axis=0) - x[mesh.n_vertices - 24 : mesh.n_vertices - 2].mean(axis=0))
        for x in (whole, path(0.5))
    ]
    assert gaps[1] == pytest.approx(gaps[0], rel=0.02)


def test_meshes_without_faces_move_on_straight_lines():
    points = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.zeros((0, 3), int))
    np.testing.assert_allclose(between(points, 3 * points.vertices)(0.5), 2 * points.vertices, atol=1e-15)


def test_single_triangles_and_open_strips():
    strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 2], [2, 1, 3]])
    folded = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, 0.5, np.sqrt(0.5)]])
    frames = Morph(strip, folded, "gradient").frames(5)
    assert edge_log_rms_max(frames) < 1e-9  # a hinge opens without stretch


@settings(max_examples=15)
@given(seeds)
def test_whole_turns_are_added_where_neighbours_have_them(seed):
    m = 60
    strip = Topology(np.stack([np.arange(m), np.arange(m) + 1, np.arange(m) + 2], axis=1), m + 2)
    axis = np.random.default_rng(seed).normal(size=3)
    true = np.linspace(0, 15, m)[:, None] * axis / np.linalg.norm(axis)
    principal = Rotation.from_rotvec(true).as_rotvec()
    np.testing.assert_allclose(unwrapped(principal, strip), true, atol=1e-9)


def test_morphs_survive_pickling():
    morph = Morph(BODY, pulled(2, 0.2), "gradient")
    middle = morph(0.5).vertices
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(morph))(0.5).vertices, middle)


@pytest.mark.parametrize(("animal", "pose", "volume"), [("horse", "05", 1.0), ("cat", "04", 0.1)])
def test_public_poses(animal, pose, volume):
    source, target = data_mesh(f"meshes/{animal}.obj"), data_mesh(f"{animal}-poses/{animal}-{pose}.obj").vertices
    turning, straight = (Morph(source, target, path).frames(5) for path in ("gradient", "linear"))
    assert abs(volume_change_max(turning)) < volume
    assert edge_log_rms_max(turning) < edge_log_rms_max(straight) / 5
    middle = MeshSequence(turning.topology, turning.positions[1:-1], turning.times[1:-1])
    ends = MeshSequence(turning.topology, turning.positions[[0, -1]], turning.times[[0, -1]])
    assert self_intersections_max(middle) <= self_intersections_max(ends)
