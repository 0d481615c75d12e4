"""What repair says about where vertices, faces and places went."""

import pickle

import igl
import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import InputError, Mesh, SurfacePoints
from morphlet.surface.nearest import nearest
from morphlet.surface.repair import Repaired, RepairOptions, close, repair

SPHERE = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=2))
SQUARE = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def check_maps(repaired: Repaired) -> None:
    """The promises of `Repaired` that hold for every mesh."""
    source, mesh, real = repaired.source, repaired.mesh, repaired.face_map >= 0
    corners = mesh.faces[real]
    corners = np.where(repaired.flipped[real, None], corners[:, [0, 2, 1]], corners)
    np.testing.assert_array_equal(mesh.vertices[corners], source.vertices[source.faces[repaired.face_map[real]]])
    moved = repaired.vertex_map[repaired.valid]
    np.testing.assert_array_equal(mesh.vertices[moved], source.vertices[repaired.valid])
    assert np.all(np.diff(np.flatnonzero(real)) == 1)
    assert mesh.faces[real].max(initial=-1) < repaired.n_real_vertices
    assert not repaired.flipped[~real].any()


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["none", "small", "all"]), st.sampled_from(["all", "largest"]))
def test_maps_hold_on_damaged_spheres(seed: int, fill: str, component: str) -> None:
    rng = np.random.default_rng(seed)
    faces = SPHERE.faces[rng.random(SPHERE.n_faces) < rng.uniform(0.3, 1)]
    faces = np.concatenate([faces, rng.integers(0, SPHERE.n_vertices, (rng.integers(0, 20), 3))])  # any junk, also repeated corners
    faces = np.where(rng.random(len(faces))[:, None] < 0.1, faces[:, ::-1], faces)
    repaired = repair(Mesh(SPHERE.vertices, faces), RepairOptions(fill=fill, component=component))
    check_maps(repaired)
    topology = repaired.mesh.topology
    assert topology.halfedge_counts.max(initial=0) <= 1  # manifold edges, one direction each
    assert topology.referenced.all()
    again = repair(repaired.mesh, RepairOptions(weld=False))
    assert again.mesh is repaired.mesh, "repairing twice changes nothing"


def test_a_clean_mesh_comes_back_as_it_was() -> None:
    repaired = close(SPHERE)
    assert repaired.mesh is SPHERE
    assert repaired.repairs == ()
    assert repaired.valid.all()
    np.testing.assert_array_equal(repaired.vertex_map, np.arange(SPHERE.n_vertices))


def test_coincident_vertices_of_a_closed_mesh_stay_apart() -> None:
    collapsed = SPHERE.with_vertices(np.zeros_like(SPHERE.vertices))
    assert close(collapsed).mesh is collapsed


def test_a_seam_is_welded_and_both_copies_know_their_vertex() -> None:
    vertices = np.concatenate([SQUARE.vertices, SQUARE.vertices[[0, 2]] * -0.0 + SQUARE.vertices[[0, 2]]])
    repaired = repair(Mesh(vertices, [[0, 1, 2], [4, 5, 3]]))
    check_maps(repaired)
    assert repaired.mesh.n_vertices == 4
    np.testing.assert_array_equal(repaired.vertex_map, [0, 1, 2, 3, 0, 2])
    assert [(r.what, r.count) for r in repaired.repairs] == [("welded coincident boundary vertices", 2)]
    assert repair(repaired.source, RepairOptions(weld=False)).mesh.n_vertices == 6


def test_a_vertex_whose_only_face_went_has_the_answer_of_its_weld() -> None:
    doubled = Mesh(np.concatenate([SQUARE.vertices, SQUARE.vertices[:3]]), [[0, 1, 2], [0, 2, 3], [4, 5, 6]])
    repaired = repair(doubled)
    check_maps(repaired)
    np.testing.assert_array_equal(repaired.vertex_map, [0, 1, 2, 3, 0, 1, 2])
    assert repaired.valid.all()


def test_vertices_without_an_answer_take_the_nearest() -> None:
    vertices = np.concatenate([[[9.0, 9.0, 0.0]], SQUARE.vertices])
    repaired = repair(Mesh(vertices, SQUARE.faces + 1))
    np.testing.assert_array_equal(repaired.vertex_map, [2, 0, 1, 2, 3])
    np.testing.assert_array_equal(repaired.valid, [False, True, True, True, True])


def test_the_largest_part_is_the_one_of_most_area_and_of_equals_that_of_most_faces() -> None:
    speck = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=3, radius=0.1))
    faces = np.concatenate([speck.faces, SPHERE.faces + speck.n_vertices])
    repaired = close(Mesh(np.concatenate([speck.vertices, SPHERE.vertices + 3]), faces), RepairOptions(component="largest"))
    np.testing.assert_array_equal(repaired.mesh.faces, SPHERE.faces)
    assert repaired.valid.sum() == SPHERE.n_vertices
    pyramid = [[4, 5, 8], [5, 6, 8], [6, 7, 8], [7, 4, 8]]
    two = Mesh(np.concatenate([SQUARE.vertices, 5 + SQUARE.vertices, [[5.5, 5.5, 5]]]), [*SQUARE.faces, *pyramid])
    assert repair(two, RepairOptions(component="largest")).mesh.n_faces == 4


@pytest.mark.parametrize(("fill", "left"), [("none", 2), ("small", 1), ("all", 0)])
def test_which_holes_are_filled(fill: str, left: int) -> None:
    fine = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=4))
    height = fine.vertices[fine.faces, 2]
    cap, smallest = height.max(axis=1) > 0.9, int(np.argmin(height.max(axis=1)))
    mesh = Mesh(fine.vertices, np.delete(fine.faces, [*np.flatnonzero(cap), smallest], axis=0))
    before, after = (m.topology.boundary_loops for m in (mesh, repair(mesh, RepairOptions(fill=fill)).mesh))
    assert [len(loop) for loop in after] == [len(loop) for loop in before][:left]
    assert len(before) == 2


def test_three_edges_are_filled_by_one_face_and_more_by_a_fan() -> None:
    triangle_gone = close(Mesh(SPHERE.vertices, SPHERE.faces[1:]))
    assert (triangle_gone.mesh.n_vertices, triangle_gone.mesh.n_faces) == (SPHERE.n_vertices, SPHERE.n_faces)
    assert set(triangle_gone.mesh.faces[-1]) == set(SPHERE.faces[0])
    disc = close(SQUARE)
    assert (disc.mesh.n_vertices, disc.n_real_vertices, disc.face_map.tolist()) == (5, 4, [0, 1, -1, -1, -1, -1])
    np.testing.assert_allclose(disc.mesh.vertices[4], [0.5, 0.5, 0])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_places_keep_their_position_and_added_faces_give_the_nearest(seed: int) -> None:
    rng = np.random.default_rng(seed)
    keep = rng.random(SPHERE.n_faces) < 0.9
    faces = np.where(rng.random(SPHERE.n_faces)[:, None] < 0.2, SPHERE.faces[:, ::-1], SPHERE.faces)[keep]
    repaired = repair(Mesh(SPHERE.vertices, faces), RepairOptions(fill="all"))
    points = SurfacePoints(rng.integers(0, repaired.mesh.n_faces, 50), rng.dirichlet(np.ones(3), 50))
    there, here = points.positions(repaired.mesh), repaired.to_source(points).positions(repaired.source)
    real = repaired.face_map[points.faces] >= 0
    np.testing.assert_allclose(here[real], there[real], atol=1e-14)
    shortest = igl.point_mesh_squared_distance(there, np.array(SPHERE.vertices), np.array(faces))[0]
    np.testing.assert_allclose(np.linalg.norm(here - there, axis=1)[~real], np.sqrt(shortest[~real]), atol=1e-9)


def test_a_place_on_no_face_is_refused() -> None:
    with pytest.raises(InputError, match="faces of the points"):
        close(SQUARE).to_source(SurfacePoints([6], [[1, 0, 0]]))


@pytest.mark.parametrize("corners", [[[0, 0, 0], [1, 0, 0], [3, 0, 0]], [[2, 0, 0]] * 3, [[1, 0, 0], [1, 0, 0], [3, 0, 0]]])
def test_nearest_on_a_face_without_area(corners: list[list[float]]) -> None:
    mesh = Mesh(corners, [[0, 1, 2]])
    np.testing.assert_allclose(nearest(mesh, [[2, 5, 0]]).positions(mesh), [[2, 0, 0]], atol=1e-12)


def test_a_repaired_mesh_travels_and_is_read_only() -> None:
    repaired = pickle.loads(pickle.dumps(close(SQUARE)))
    check_maps(repaired)
    with pytest.raises(ValueError, match="read-only"):
        repaired.vertex_map[0] = 1


WRONG_OPTIONS = [
    ({"fill": "some"}, "fill to be one of none, small, all"),
    ({"component": "first"}, "component to be one of all, largest"),
    ({"cut_handles": -1}, "cut_handles of 0 or more"),
]


@pytest.mark.parametrize(("wrong", "message"), WRONG_OPTIONS)
def test_options_are_checked(wrong: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        RepairOptions(**wrong)


def test_dropping_can_be_turned_off():
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3], [2, 3, 0]])
    kept = repair(square, RepairOptions(weld=False, orient=False, split=False, drop=False))
    assert kept.mesh.n_faces == 3
    assert kept.repairs == ()
    assert repair(square).mesh.n_faces == 2
