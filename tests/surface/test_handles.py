"""Handles: counted, found by short loops, cut."""

import numpy as np
import pytest
import trimesh

from morphlet import Mesh
from morphlet.surface import handles
from morphlet.surface.handles import cut_handles, genera, shortest_loop
from morphlet.surface.holes import perimeter
from morphlet.surface.repair import RepairOptions, close, repair

N_MAJOR, N_MINOR = 24, 9


def torus(centre: tuple[float, float, float] = (0, 0, 0), tube: float = 0.3) -> Mesh:
    """A torus of major radius 1 about the z axis."""
    return Mesh.from_trimesh(trimesh.creation.torus(1.0, tube, N_MAJOR, N_MINOR).apply_translation(centre))


def double_torus() -> Mesh:
    """Two tori joined by welding where a face of each was removed."""
    left, right = torus(), torus((4, 0, 0), tube=0.2)
    a = int(np.argmax(left.vertices[left.faces].mean(axis=1)[:, 0]))
    b = int(np.argmin(right.vertices[right.faces].mean(axis=1)[:, 0]))
    ring, other = left.faces[a], right.faces[b][[0, 2, 1]] + left.n_vertices
    faces = np.concatenate([np.delete(left.faces, a, 0), np.delete(right.faces, b, 0) + left.n_vertices])
    faces = np.where(np.isin(faces, other), ring[np.argmax(faces[:, :, None] == other, axis=2)], faces)
    return repair(Mesh(np.concatenate([left.vertices, right.vertices]), faces)).mesh


def test_genus_counts_per_part_with_and_without_holes() -> None:
    assert genera(torus().topology).tolist() == [1]
    assert genera(double_torus().topology).tolist() == [2]
    assert genera(Mesh(torus().vertices, torus().faces[1:]).topology).tolist() == [1]


def test_the_shortest_loop_of_a_torus_goes_round_its_tube_on_the_inside() -> None:
    mesh = torus()
    loop = shortest_loop(mesh.vertices, mesh.topology, 0)
    assert len(loop) == N_MINOR
    assert len(np.unique(loop)) == N_MINOR


def test_the_loop_of_a_fat_torus_goes_through_the_hole_not_round_the_tube() -> None:
    mesh = torus(tube=0.9)
    loop = mesh.vertices[shortest_loop(mesh.vertices, mesh.topology, 0)]
    assert np.linalg.norm(loop[:, :2], axis=1).max() < 0.2  # the hole has radius 0.1


def test_a_loop_is_shortened_until_it_is_the_shortest_through_its_middle(monkeypatch: pytest.MonkeyPatch) -> None:
    ring = Mesh.from_trimesh(trimesh.creation.torus(1.0, 0.3, 90, 20))
    middle = ring.vertices * [1, 1, 0] / np.linalg.norm(ring.vertices[:, :2], axis=1, keepdims=True)
    waists = 1 + 2 / 3 * np.cos(6 * np.arctan2(middle[:, 1], middle[:, 0]))[:, None]
    rough = ring.with_vertices(middle + (ring.vertices - middle) * waists)
    monkeypatch.setattr(handles, "BASES", 1)
    shortened = perimeter(rough.vertices, shortest_loop(rough.vertices, rough.topology, 0))
    monkeypatch.setattr(handles, "ROUNDS", 0)
    assert shortened < perimeter(rough.vertices, shortest_loop(rough.vertices, rough.topology, 0))


def test_cutting_opens_two_loops_over_the_same_positions() -> None:
    mesh = torus()
    faces, origin, lengths = cut_handles(mesh.vertices, mesh.faces, 5)
    opened = Mesh(mesh.vertices[origin], faces)
    assert [len(loop) for loop in opened.topology.boundary_loops] == [N_MINOR, N_MINOR]
    assert len(lengths) == 1
    np.testing.assert_array_equal(opened.vertices[faces], mesh.vertices[mesh.faces])


@pytest.mark.parametrize("hole", [0, 3])
def test_a_double_torus_with_and_without_holes_becomes_a_sphere(hole: int) -> None:
    mesh = double_torus()
    closed = close(Mesh(mesh.vertices, mesh.faces[hole:]), RepairOptions(fill="all", cut_handles=2))
    assert closed.mesh.topology.euler_characteristic == 2
    real = closed.mesh.faces[closed.face_map >= 0]
    np.testing.assert_array_equal(closed.mesh.vertices[real], mesh.vertices[mesh.faces[hole:]])


def test_the_budget_is_kept_and_cuts_are_capped_without_filling_holes() -> None:
    mesh = Mesh(double_torus().vertices, double_torus().faces[1:])
    mended = repair(mesh, RepairOptions(cut_handles=1))
    assert genera(mended.mesh.topology).tolist() == [1]
    assert [len(loop) for loop in mended.mesh.topology.boundary_loops] == [3]
    assert any("cut handles along loops of length" in done.what and done.count == 1 for done in mended.repairs)


def test_handles_of_a_mesh_without_extent_are_cut_too() -> None:
    mesh = torus()
    assert close(mesh.with_vertices(np.zeros_like(mesh.vertices)), RepairOptions(fill="all", cut_handles=1)).mesh.n_faces > mesh.n_faces
