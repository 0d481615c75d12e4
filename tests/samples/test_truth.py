"""Pairs with a known correspondence: true on both sides, not to be guessed from numbers, refused where nothing is known."""

import numpy as np
import pytest

from morphlet import InputError, Mesh, MeshError, SurfacePoints, VertexPairs
from morphlet.mapping.correspondence import Correspondence, energy, folds_surface_percent
from morphlet.samples.creatures import Creature, blob
from morphlet.samples.poses import POSES
from morphlet.samples.truth import LANDMARKS, at_vertices, carried, known_pair, marked_pair
from morphlet.surface.repair import close

TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
TETRAHEDRON = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


@pytest.fixture(scope="module")
def lump():
    return blob(n_vertices=1500)


@pytest.fixture(scope="module")
def turned(lump):
    """The lump and the same lump, turned and twice as large."""
    return known_pair(lump, lump.with_vertices(2 * lump.vertices @ TURN.T))


def without(mesh, faces):
    return Mesh(mesh.vertices, np.delete(mesh.faces, faces, axis=0))


def test_truth_of_a_similarity_is_that_similarity(turned):
    np.testing.assert_allclose(turned.truth.positions(turned.target), 2 * turned.source.vertices @ TURN.T, atol=1e-12)
    assert len(turned.vertices) == turned.source.n_vertices


def test_source_is_closed_and_has_another_number_of_vertices(turned):
    assert turned.source.n_vertices == int(0.85 * turned.target.n_vertices)
    assert np.all(turned.source.topology.twins >= 0)
    assert turned.source.topology.euler_characteristic == 2


def test_landmarks_are_exact_vertices_far_apart(turned):
    marks = turned.landmarks
    assert len(marks) == LANDMARKS
    image = 2 * turned.source.vertices[marks.source] @ TURN.T
    assert np.array_equal(image, turned.target.vertices[marks.target])
    apart = np.linalg.norm(image[:, None] - image, axis=2) + np.diag(np.full(len(marks), np.inf))
    assert apart.min() > 0.3 * np.sqrt(turned.target.area / LANDMARKS)


def test_true_map_of_a_pose_is_nearly_isometric_and_does_not_fold():
    deer = Creature.prepare("grazer", n_vertices=1500)
    pair = known_pair(deer.mesh, deer.posed(POSES["walking"]))
    found = Correspondence(pair.source, pair.target, pair.truth)
    assert energy(found) < 1.1
    assert folds_surface_percent(found) < 1.0


def test_reversed_faces_of_the_target_change_nothing(lump):
    faces = np.array(lump.faces)
    faces[::7] = faces[::7, ::-1]
    plain, mixed = known_pair(lump, lump), known_pair(lump, Mesh(lump.vertices, faces))
    np.testing.assert_allclose(mixed.truth.positions(mixed.target), plain.truth.positions(plain.target), atol=1e-12)
    np.testing.assert_allclose(mixed.truth.positions(mixed.target), mixed.source.vertices, atol=1e-12)


def test_places_on_filled_holes_are_unknown_and_the_others_true(lump):
    hole = np.flatnonzero(np.isin(lump.faces, lump.faces[0]).any(axis=1))
    assert len(hole) > 6
    pair = known_pair(without(lump, hole), without(lump.with_vertices(3 * lump.vertices), hole))
    assert 0 < pair.source.n_vertices - len(pair.vertices) < 60
    np.testing.assert_allclose(pair.truth.positions(pair.target), 3 * pair.source.vertices[pair.vertices], atol=1e-12)
    assert np.isin(pair.landmarks.source, pair.vertices).all()


def test_a_hole_of_the_target_alone_is_unknown_too(lump):
    pair = known_pair(lump, Mesh(lump.vertices, lump.faces))
    assert len(pair.vertices) == pair.source.n_vertices
    with pytest.raises(InputError, match="two meshes of the same connectivity; found 2996 and 2995 faces"):
        known_pair(lump, without(lump, [0]))


def test_other_connectivity_is_refused(lump):
    with pytest.raises(InputError, match="faces that join the same vertices in both meshes"):
        known_pair(lump, Mesh(lump.vertices, np.roll(lump.faces, 1, axis=0)))
    with pytest.raises(MeshError):
        known_pair(Mesh(lump.vertices, lump.faces[:0]), Mesh(lump.vertices, lump.faces[:0]))


def test_rows_are_drawn_by_area_without_the_landmarks_given(turned):
    used = turned.first_landmarks(6)
    rows = turned.drawn(400, used)
    assert len(rows) == len(np.unique(rows)) == 400
    assert not np.isin(turned.vertices[rows], used.source).any()
    assert np.array_equal(rows, turned.drawn(400, used))
    assert not np.array_equal(rows, turned.drawn(400, used, seed=1))
    assert len(turned.drawn(10**6, used)) == turned.source.n_vertices - 6
    areas = turned.source.vertex_areas
    assert areas[turned.vertices[turned.drawn(300, used)]].mean() > 1.05 * areas.mean()
    with pytest.raises(InputError, match="0 to 16 landmarks; found 17"):
        turned.first_landmarks(17)


def test_seeds_give_other_copies(lump):
    assert known_pair(lump, lump, seed=0).source.fingerprint == known_pair(lump, lump, seed=0).source.fingerprint
    assert known_pair(lump, lump, seed=0).source.fingerprint != known_pair(lump, lump, seed=1).source.fingerprint


def test_carried_goes_by_the_vertices_of_the_faces():
    other = TETRAHEDRON.with_vertices(2 * TETRAHEDRON.vertices + 1)
    points = SurfacePoints([0, 3], [[0.5, 0.3, 0.2], [0.1, 0.2, 0.7]])
    moved = carried(points, close(TETRAHEDRON), close(other))
    np.testing.assert_allclose(moved.positions(other), 2 * points.positions(TETRAHEDRON) + 1, atol=1e-15)


def test_markers_are_judged_where_they_are_and_given_spread(lump):
    one = int(np.argmax(lump.vertices[:, 1]))
    two = int(lump.topology.adjacency[one].indices[0])  # neighbours: not both among the first three
    left, right = int(np.argmin(lump.vertices[:, 0])), int(np.argmax(lump.vertices[:, 0]))
    ends = VertexPairs([one, two, left, right], [60, 61, 7, 800], labels=("a", "b", "c", "d"))
    pair = marked_pair(lump, lump, ends)
    assert np.array_equal(pair.truth.positions(pair.target), lump.vertices[ends.target])
    assert np.array_equal(pair.vertices, ends.source)
    assert dict(zip(pair.landmarks.source.tolist(), pair.landmarks.labels, strict=True)) == {one: "a", two: "b", left: "c", right: "d"}
    assert not {one, two} <= set(pair.first_landmarks(3).source.tolist())
    assert set(pair.vertices[pair.drawn(10, pair.first_landmarks(2))].tolist()) == set(pair.landmarks.source[2:].tolist())


def test_a_vertex_marked_twice_counts_twice(lump):
    pair = marked_pair(lump, lump, VertexPairs([5, 5, 5, 40], [7, 8, 9, 60]))
    assert sorted(pair.landmarks.target.tolist()) == [7, 8, 9, 60]


def test_markers_off_the_surface_are_refused(lump):
    loose = Mesh(np.concatenate([lump.vertices, [[9, 9, 9]]]), lump.faces)
    with pytest.raises(InputError, match="markers on the surface; found 1 in no face of it"):
        marked_pair(loose, lump, VertexPairs([1500, 3], [0, 1]))
    with pytest.raises(InputError, match="indices from 0 to 1499"):
        marked_pair(lump, lump, VertexPairs([1500], [0]))
    with pytest.raises(InputError, match="vertices in faces; found 1 in none"):
        at_vertices(loose, [0, 1500])
