"""Places made vertices: the same surface, the old vertices first, each face a part of the one it says."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import InputError, Mesh, SurfacePoints
from morphlet.surface.insertion import SNAP, inserted
from morphlet.surface.requirements import require_sphere
from support import blob, tetrahedron


def drawn(mesh: Mesh, count: int, seed: int) -> SurfacePoints:
    """Places anywhere, several in one face, some on sides and at corners."""
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.ones(3), count)
    weights[: count // 4, 0] = 0
    weights[: count // 8, 1] = 0
    return SurfacePoints(rng.integers(mesh.n_faces, size=count), weights / weights.sum(axis=1, keepdims=True))


@given(st.integers(0, 10**6), st.integers(1, 40))
def test_the_surface_stays_what_it_was(seed: int, count: int) -> None:
    solid = blob(1)
    found = inserted(solid, drawn(solid, count, seed))
    require_sphere(found.mesh)
    np.testing.assert_array_equal(found.mesh.vertices[: solid.n_vertices], solid.vertices)
    assert found.mesh.volume == pytest.approx(solid.volume, rel=1e-12)
    np.testing.assert_allclose(np.bincount(found.origins, found.mesh.face_areas, solid.n_faces), solid.face_areas, rtol=1e-9)
    np.testing.assert_allclose(found.mesh.face_normals, solid.face_normals[found.origins], atol=1e-6)
    assert found.mesh.n_vertices - solid.n_vertices == len(found.places)


@given(st.integers(0, 10**6))
def test_a_place_alone_in_its_face_moves_by_a_few_hundredths_of_a_side(seed: int) -> None:
    solid = tetrahedron()
    place = drawn(solid, 1, seed)
    found = inserted(solid, place)
    gap = np.linalg.norm(found.mesh.vertices[found.vertices] - place.positions(solid), axis=1)
    assert gap.max() <= 4 * SNAP * np.sqrt(2)


def test_a_place_well_inside_does_not_move() -> None:
    solid = tetrahedron()
    place = SurfacePoints([2], [[0.2, 0.3, 0.5]])
    found = inserted(solid, place)
    np.testing.assert_allclose(found.mesh.vertices[found.vertices], place.positions(solid), atol=1e-15)
    assert sorted(found.origins.tolist()) == [0, 1, 2, 2, 2, 3]
    assert found.mesh.face_areas.min() > 0


def test_corners_are_the_corners_and_one_spot_is_one_vertex() -> None:
    solid = tetrahedron()
    found = inserted(solid, SurfacePoints([0, 3, 1, 1], [[1, 0, 0], [0, 0, 1], [0.3, 0.3, 0.4], [0.3, 0.3, 0.4]]))
    assert found.vertices.tolist() == [solid.faces[0, 0], solid.faces[3, 2], 4, 4]
    assert found.mesh.n_vertices == 5


def test_nothing_to_insert_changes_nothing() -> None:
    found = inserted(tetrahedron(), SurfacePoints([], np.zeros((0, 3))))
    np.testing.assert_array_equal(found.mesh.faces, tetrahedron().faces)
    assert len(found.vertices) == 0


def test_a_place_on_no_face_is_refused() -> None:
    with pytest.raises(InputError, match="faces of the places"):
        inserted(tetrahedron(), SurfacePoints([4], [[1, 0, 0]]))


def test_pickling_keeps_it() -> None:
    found = inserted(tetrahedron(), SurfacePoints([2], [[0.2, 0.3, 0.5]]))
    copy = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(copy.origins, found.origins)
    assert not copy.vertices.flags.writeable
