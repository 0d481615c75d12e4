"""Fans, orientation and doubled faces on small surfaces drawn by hand."""

import itertools

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.numerics import unit_sphere
from morphlet.surface.doubles import back_to_back, repeated
from morphlet.surface.fans import edge_uses, fans, separate
from morphlet.surface.orientation import disagreeing, inward, turned
from morphlet.surface.repair import repair

SPHERE = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=2))
TETRAHEDRON = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def moebius(n: int) -> np.ndarray:
    """2 n faces round a band of n quads that closes with a half turn."""
    ring = [(2 * i, 2 * i + 1) for i in range(n)] + [(1, 0)]
    quads = [(a, b, d, c) for (a, b), (c, d) in itertools.pairwise(ring)]
    return np.array([f for a, b, d, c in quads for f in ((a, b, d), (a, d, c))])


def test_two_triangles_on_an_edge_have_one_fan_at_its_ends() -> None:
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    assert len(np.unique(fans(faces, edge_uses(faces, 4).used(2)))) == 4


def test_same_direction_half_edges_join_corners_by_vertex() -> None:
    faces = np.array([[0, 1, 2], [2, 0, 3]])  # the second is upside down
    label = fans(faces, edge_uses(faces, 4).used(2))
    assert label[0] == label[4]
    assert label[2] == label[3]


def test_tetrahedra_at_a_vertex_come_apart() -> None:
    second = np.where(TETRAHEDRON == 0, 0, TETRAHEDRON + 3)
    faces = np.concatenate([TETRAHEDRON, second])
    apart, origin = separate(faces, 7, edge_uses(faces, 7).used(2))
    np.testing.assert_array_equal(apart[:4], TETRAHEDRON)
    np.testing.assert_array_equal(origin, [*range(7), 0])
    assert set(apart[4:].ravel()) == {4, 5, 6, 7}


def test_tetrahedra_on_an_edge_come_apart() -> None:
    second = np.where(TETRAHEDRON < 2, TETRAHEDRON, TETRAHEDRON + 2)
    mended = repair(Mesh(np.random.default_rng(0).normal(size=(6, 3)), np.concatenate([TETRAHEDRON, second])))
    topology = mended.mesh.topology
    assert (topology.n_components, mended.mesh.n_vertices, len(topology.boundary_loops)) == (2, 8, 0)


def test_tetrahedra_on_a_face_become_one_solid() -> None:
    top = np.array([[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]])
    bottom = np.array([[0, 2, 1], [0, 1, 4], [1, 2, 4], [2, 0, 4]])
    faces = np.concatenate([top, bottom])
    np.testing.assert_array_equal(np.flatnonzero(back_to_back(faces, 5)), [0, 4])
    mesh = repair(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, -1], [0, 0, 1]], faces)).mesh
    assert (mesh.n_faces, mesh.topology.euler_characteristic, mesh.topology.n_components) == (6, 2, 1)


def test_a_reversed_copy_of_a_face_goes_and_the_face_stays() -> None:
    faces = np.concatenate([TETRAHEDRON, TETRAHEDRON[:1, ::-1]])
    assert not back_to_back(faces, 4).any()
    np.testing.assert_array_equal(repeated(faces), [False] * 4 + [True])


def test_a_sheet_with_both_its_sides_keeps_one() -> None:
    sheet = np.array([[0, 1, 2], [0, 2, 3]])
    both = np.concatenate([sheet, sheet[:, ::-1]])
    mended = repair(Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], both))
    np.testing.assert_array_equal(mended.mesh.faces, sheet)


@pytest.mark.parametrize("size", [2, 6])
def test_a_doubled_sheet_on_a_solid_is_debris_only_if_small(size: int) -> None:
    strip = np.array([[i, i + 1, i + 2] for i in range(4, 2 + size)]).reshape(-1, 3)
    sheet = np.concatenate([[[0, 1, 4], [1, 4, 5]], strip])
    dropped = back_to_back(np.concatenate([TETRAHEDRON, sheet, sheet[:, ::-1]]), 6 + size)
    assert dropped.sum() == (2 * size if size <= 4 else 0)


def test_a_moebius_strip_has_one_side() -> None:
    reverse, one_sided = disagreeing(moebius(5), 10)
    assert one_sided.all()
    assert not reverse.any()


def test_the_smaller_half_turns_and_a_tie_keeps_the_first_face() -> None:
    reverse, _ = disagreeing(np.array([[0, 1, 2], [0, 2, 3], [3, 0, 4]]), 5)
    np.testing.assert_array_equal(reverse, [False, False, True])
    reverse, _ = disagreeing(np.array([[0, 1, 2], [2, 0, 3]]), 4)
    np.testing.assert_array_equal(reverse, [False, True])


def test_a_part_inside_out_is_turned_and_no_volume_has_no_sign() -> None:
    inside_out = SPHERE.faces[:, ::-1]
    both = np.concatenate([SPHERE.faces, inside_out + SPHERE.n_vertices])
    far = np.concatenate([SPHERE.vertices, SPHERE.vertices + 1e6])
    np.testing.assert_array_equal(inward(far, both), np.arange(len(both)) >= SPHERE.n_faces)
    normal = np.array([0.36, 0.48, 0.8])
    flat = SPHERE.vertices - np.outer(SPHERE.vertices @ normal, normal)  # its volume is rounding, of one sign or the other
    assert not inward(flat, inside_out).any()
    assert not inward(flat, SPHERE.faces).any()


@settings(max_examples=30, deadline=None)
@given(st.sets(st.integers(0, SPHERE.n_faces - 1), max_size=SPHERE.n_faces), st.integers(0, 2**16))
def test_repair_undoes_any_reversal(wrong: set[int], seed: int) -> None:
    shift = np.random.default_rng(seed).permutation(SPHERE.n_vertices)  # also: whatever the numbering
    vertices = np.empty_like(SPHERE.vertices)
    vertices[shift] = SPHERE.vertices
    faces, reverse = shift[SPHERE.faces], np.isin(np.arange(SPHERE.n_faces), list(wrong))
    mended = repair(Mesh(vertices, turned(faces, reverse)))
    np.testing.assert_array_equal(mended.mesh.faces, faces)
    np.testing.assert_array_equal(mended.flipped, reverse)


@pytest.mark.parametrize("scale", [1e-150, 1.0, 1e120, 1e150])
def test_a_ball_of_any_size_is_turned_outwards(scale):
    points, faces = unit_sphere.icosphere(1)
    with np.errstate(all="raise", under="ignore"):
        assert inward(scale * points, faces[:, ::-1]).all()
        assert not inward(scale * points, faces).any()
