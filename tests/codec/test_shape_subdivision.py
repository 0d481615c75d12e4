"""Loop subdivision of closed meshes, and the integers that its vertices are moved by."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet.codec.displacement import CONTEXTS, MIXERS, MOST, ONE, code_moves
from morphlet.codec.range_coder import consumed, reader, writer, written
from morphlet.codec.subdivision import edge_normals, refined_sizes, refinements, vertex_normals
from support import beside, blob, icosphere, tetrahedron, torus

MESHES = {"tetrahedron": tetrahedron(), "sphere": icosphere(1), "torus": torus(), "two parts": beside(blob(1), torus((5, 0, 0)))}
each_mesh = pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)


@each_mesh
def test_sizes_are_those_told(mesh):
    for count in (1, 2, 3):
        levels = refinements(mesh.faces, mesh.n_vertices, count)
        assert (levels[-1].masks.shape[0], len(levels[-1].finer)) == refined_sizes(mesh.n_vertices, mesh.n_faces, count)
        assert levels[-1].finer.max() + 1 == levels[-1].masks.shape[0]


@each_mesh
def test_masks_keep_affine_maps(mesh):
    level = refinements(mesh.faces, mesh.n_vertices, 1)[0]
    np.testing.assert_allclose(level.masks.sum(axis=1), 1, atol=1e-15)
    turn = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 3.0], [1.0, 0.0, 1.0]])
    np.testing.assert_allclose(level.masks @ (mesh.vertices @ turn), (level.masks @ mesh.vertices) @ turn, atol=1e-13)


@each_mesh
def test_new_faces_are_closed_and_turned_as_the_old(mesh):
    level = refinements(mesh.faces, mesh.n_vertices, 1)[0]
    a, b = np.sort(level.finer, axis=1), level.finer
    assert len(np.unique(a, axis=0)) == len(b)
    directed = np.stack([b, np.roll(b, -1, axis=1)], axis=2).reshape(-1, 2)
    assert len(np.unique(directed, axis=0)) == len(directed)
    assert set(map(tuple, directed)) == set(map(tuple, directed[:, ::-1]))
    middles = np.concatenate([mesh.vertices, mesh.vertices[level.ends[:, :2]].mean(axis=1)])
    np.testing.assert_allclose(
        vertex_normals(middles, level.finer)[: mesh.n_vertices], vertex_normals(mesh.vertices, mesh.faces) / 4, atol=1e-12
    )


def test_masks_of_the_tetrahedron():
    mesh = tetrahedron()
    level = refinements(mesh.faces, 4, 1)[0]
    even, odd = level.even.toarray(), level.odd.toarray()
    np.testing.assert_allclose(even, np.full((4, 4), 3 / 48) + np.eye(4) * (13 / 16 - 3 / 48), atol=1e-15)
    assert sorted(odd[0].tolist()) == [1 / 8, 1 / 8, 3 / 8, 3 / 8]


def test_mask_of_a_regular_vertex():
    mesh = icosphere(1)
    level = refinements(mesh.faces, mesh.n_vertices, 1)[0]
    row = level.even[-1].toarray()[0]
    np.testing.assert_allclose(np.sort(row)[-7:], [1 / 16] * 6 + [5 / 8], atol=1e-15)


def test_neighbours_of_an_edge_share_its_faces():
    mesh = icosphere(1)
    level = refinements(mesh.faces, mesh.n_vertices, 1)[0]
    a, b, c, d = level.ends.T
    for column, (p, q) in enumerate(((a, c), (b, c), (a, d), (b, d))):
        assert np.array_equal(level.ends[level.near[:, column], :2], np.sort(np.stack([p, q], axis=1), axis=1))


def test_normals_of_a_sphere_point_outwards():
    mesh = icosphere(2)
    level = refinements(mesh.faces, mesh.n_vertices, 1)[0]
    middle = mesh.vertices[level.ends[:, :2]].sum(axis=1)
    middle /= np.linalg.norm(middle, axis=1, keepdims=True)
    assert np.einsum("ij,ij->i", edge_normals(mesh.vertices, level), middle).min() > 0.99


def test_normals_that_cancel_are_zero():
    level = refinements(np.array([[0, 1, 2], [0, 2, 1]]), 3, 1)[0]
    assert not edge_normals(np.eye(3), level).any()


def told(levels, coder, moves):
    """The moves of all levels through a coder."""
    size = np.full(levels[0].even.shape[0], ONE, np.int64)
    for number, (level, told) in enumerate(zip(levels, moves, strict=True)):
        size = np.concatenate([size, np.zeros_like(told)])
        code_moves(coder, told, level.ends, level.near, size, np.int64(number))
    return moves


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31), st.sampled_from([0.3, 3.0, 300.0, 3e7]))
def test_moves_come_back(seed, size):
    mesh = icosphere(1)
    levels = refinements(mesh.faces, mesh.n_vertices, 2)
    rng = np.random.default_rng(seed)
    moves = [np.rint(rng.laplace(scale=size, size=len(level.ends))).astype(np.int64) for level in levels]
    coder = writer(1 << 16, CONTEXTS, MIXERS)
    told(levels, coder, [m.copy() for m in moves])
    back = reader(written(coder), CONTEXTS, MIXERS)
    found = told(levels, back, [np.zeros_like(m) for m in moves])
    assert consumed(back)
    assert all(np.array_equal(a, b) for a, b in zip(found, moves, strict=True))


def test_still_levels_cost_next_to_nothing():
    levels = refinements(icosphere(2).faces, 162, 2)
    coder = writer(1 << 16, CONTEXTS, MIXERS)
    told(levels, coder, [np.zeros(len(level.ends), np.int64) for level in levels])
    assert len(written(coder)) <= 12  # of 2,400 zeros


def test_moves_beyond_any_are_refused():
    levels = refinements(icosphere(0).faces, 12, 1)
    moves = np.zeros(len(levels[0].ends), np.int64)
    moves[7] = MOST + 1
    coder = writer(1 << 12, CONTEXTS, MIXERS)
    told(levels, coder, [moves])
    assert not consumed(coder)
