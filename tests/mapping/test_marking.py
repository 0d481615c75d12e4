"""Spherical maps with places among their vertices: still one-to-one, and the same map."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.stars import blob, radial_map
from morphlet import InputError, Mesh, SurfacePoints
from morphlet.mapping.marking import marked, on_closed
from morphlet.surface.repair import RepairOptions, close
from support import assert_one_to_one


def places_on(mesh: Mesh, count: int, seed: int) -> SurfacePoints:
    rng = np.random.default_rng(seed)
    return SurfacePoints(rng.integers(mesh.n_faces, size=count), rng.dirichlet(np.ones(3), count))


def torn() -> Mesh:
    """A blob with a hole, some faces reversed, a speck beside it."""
    whole = blob(2)
    faces = np.array(whole.faces[5:])
    faces[:40] = faces[:40, ::-1]
    speck = whole.n_vertices + np.array([[0, 1, 2]])
    return Mesh(np.vstack([whole.vertices, 9 + np.eye(3)]), np.vstack([faces, speck]))


@settings(max_examples=10)
@given(st.integers(0, 10**6), st.integers(1, 30))
def test_a_marked_map_is_the_same_map(seed: int, count: int) -> None:
    plain = radial_map(blob(2))
    places = places_on(plain.mesh, count, seed)
    fine, vertices = marked(plain, places)
    assert_one_to_one(fine.closed_points, fine.surface.mesh.faces)
    np.testing.assert_array_equal(fine.closed_points[: plain.mesh.n_vertices], plain.closed_points)
    back = plain.locate(fine.points)
    np.testing.assert_allclose(back.positions(plain.mesh), fine.mesh.vertices, atol=1e-9)
    gap = np.linalg.norm(fine.mesh.vertices[vertices] - places.positions(plain.mesh), axis=1)
    assert gap.max() < 0.3 * np.linalg.norm(np.ptp(plain.mesh.vertices[plain.mesh.faces], axis=1), axis=1).max()


def test_holes_reversed_faces_and_specks_do_no_harm() -> None:
    plain = radial_map(torn())
    places = places_on(Mesh(plain.mesh.vertices, plain.mesh.faces[:-1]), 20, 3)
    fine, vertices = marked(plain, places)
    assert_one_to_one(fine.closed_points, fine.surface.mesh.faces)
    added = plain.surface.mesh.n_vertices - plain.surface.n_real_vertices
    assert added > 0
    assert (fine.surface.face_map < 0).sum() == (plain.surface.face_map < 0).sum()
    np.testing.assert_allclose(fine.mesh.vertices[vertices], places.positions(plain.mesh), atol=0.05)
    assert fine.valid[vertices].all()
    assert fine.locate(fine.points).faces.max() < fine.mesh.n_faces


def test_corners_of_reversed_faces_go_along() -> None:
    """Corner 1 is corner 2 of a face that was turned over."""
    mesh = torn()
    surface = close(mesh, RepairOptions(fill="all", component="largest"))
    turned = np.flatnonzero(surface.flipped)
    assert len(turned) == 40
    row = int(surface.face_map[turned[7]])
    found = on_closed(surface, SurfacePoints([row], [[0.2, 0.3, 0.5]]))
    np.testing.assert_allclose(found.positions(surface.mesh), SurfacePoints([row], [[0.2, 0.3, 0.5]]).positions(mesh), atol=1e-15)


def test_a_place_on_a_dropped_part_is_refused() -> None:
    mesh = torn()
    with pytest.raises(InputError, match=r"places on faces that are mapped; found 1 that are not \(first: 1\)"):
        marked(radial_map(mesh), SurfacePoints([0, mesh.n_faces - 1], [[1, 0, 0], [1, 0, 0]]))
    with pytest.raises(InputError, match="1 that are not"):
        marked(radial_map(mesh), SurfacePoints([mesh.n_faces], [[1, 0, 0]]))
