"""Faces, positions and orders of meshes: any triangles come back, and their price is that of their irregularity."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import CodecError, Mesh
from morphlet.codec import rest
from morphlet.codec.connectivity import twins
from support import beside, bipyramid, blob, data_mesh, icosphere, stacked, tetrahedron, torus

OPEN_DISC = Mesh(icosphere(2).vertices, icosphere(2).faces[40:])
MESHES = {
    "tetrahedron": tetrahedron(),
    "sphere": blob(3),
    "torus": torus(),
    "two parts": beside(blob(2), torus((5, 0, 0))),
    "boundary": OPEN_DISC,
    "hubs": bipyramid(60),
    "irregular": stacked(300),
    "one triangle": Mesh(np.eye(3), [[0, 1, 2]]),
    "both sides": Mesh(np.eye(3), [[0, 1, 2], [0, 2, 1]]),
    "twice the same": Mesh(np.eye(3), [[0, 1, 2], [0, 1, 2]]),
    "three at an edge": Mesh(np.vstack([np.eye(3), np.ones((2, 3))]), [[0, 1, 2], [1, 0, 3], [0, 1, 4]]),
    "bow tie": Mesh(np.random.default_rng(0).random((5, 3)), [[0, 1, 2], [0, 3, 4]]),
    "flipped": Mesh(np.random.default_rng(0).random((4, 3)), [[0, 1, 2], [1, 2, 3]]),
    "degenerate": Mesh(np.random.default_rng(0).random((4, 3)), [[0, 0, 1], [1, 2, 3], [2, 2, 2]]),
    "loose vertices": Mesh(np.random.default_rng(0).random((7, 3)), [[1, 3, 5]]),
    "no faces": Mesh(np.random.default_rng(0).random((4, 3)), np.zeros((0, 3), int)),
}


def rotated(faces: np.ndarray) -> list[tuple[int, ...]]:
    """Faces as a sorted list, each starting at its least vertex."""
    return sorted(min(tuple(np.roll(f, k)) for k in range(3)) for f in faces.tolist())


def told(mesh: Mesh):
    """(bytes, shape, order, starts) of a mesh."""
    return rest.write_faces(mesh.faces, mesh.n_vertices)


@pytest.mark.parametrize("name", MESHES)
def test_faces_come_back(name):
    mesh = MESHES[name]
    data, shape, order, starts = told(mesh)
    back = rest.read_faces(data, mesh.n_faces, mesh.n_vertices, mesh.n_vertices)
    assert np.array_equal(back.corner, shape.corner)
    assert np.array_equal(np.sort(order), np.arange(mesh.n_vertices))
    assert rotated(order[shape.faces]) == rotated(mesh.faces)
    assert np.array_equal(rest.as_they_came(shape.faces, order, starts), mesh.faces)


@given(st.integers(0, 2**32), st.integers(3, 12), st.integers(0, 30))
def test_any_soup_of_triangles_comes_back(seed, n, m):
    rng = np.random.default_rng(seed)
    mesh = Mesh(rng.random((n, 3)), rng.integers(0, n, (m, 3)))
    data, shape, order, starts = told(mesh)
    back = rest.read_faces(data, m, n, n)
    assert np.array_equal(back.corner, shape.corner)
    assert np.array_equal(rest.as_they_came(back.faces, order, starts), mesh.faces)


@given(st.integers(0, 2**32))
def test_a_mesh_with_faces_missing_or_flipped_comes_back(seed):
    rng = np.random.default_rng(seed)
    faces = icosphere(1).faces[rng.random(80) < 0.8]
    flips = rng.random(len(faces)) < 0.1
    faces = np.where(flips[:, None], faces[:, ::-1], faces)
    data, _, order, _ = told(Mesh(icosphere(1).vertices, faces))
    assert rotated(order[rest.read_faces(data, len(faces), 42, 42).faces]) == rotated(faces)


def test_twins_need_one_half_edge_in_each_direction():
    assert twins(MESHES["both sides"].faces.ravel(), 3).tolist() == [5, 4, 3, 2, 1, 0]
    assert twins(MESHES["twice the same"].faces.ravel(), 3).tolist() == [-1] * 6
    assert (twins(MESHES["three at an edge"].faces.ravel(), 5) < 0).all()
    assert np.array_equal(twins(np.array(torus().faces).ravel(), torus().n_vertices), torus().topology.twins)


def test_regular_meshes_cost_next_to_nothing_and_irregular_ones_about_two_bits_a_vertex():
    ball, wild = icosphere(4), stacked(2000)
    assert 8 * len(told(ball)[0]) < 0.15 * ball.n_vertices
    assert 8 * len(told(wild)[0]) < 5 * wild.n_vertices


def test_public_meshes_come_back_at_their_price():
    for name, bits in {"meshes/horse.obj": 2.1, "meshes/cat.obj": 2.1, "meshes/fertility.off": 2.3, "bad/truck.obj": 4.5}.items():
        mesh = data_mesh(name)
        data, shape, order, starts = told(mesh)
        assert 8 * len(data) < bits * mesh.n_vertices
        assert np.array_equal(rest.as_they_came(shape.faces, order, starts), mesh.faces)


@pytest.mark.parametrize("name", MESHES)
@pytest.mark.parametrize("bits", [1, 6, 20])
def test_positions_come_back(name, bits):
    mesh = MESHES[name]
    _, shape, order, _ = told(mesh)
    span = np.ptp(mesh.vertices, axis=0).max()
    lattice = np.ascontiguousarray(np.round((mesh.vertices - mesh.vertices.min(axis=0)) / span * (2**bits - 1)).astype(np.int64)[order])
    assert np.array_equal(rest.read_positions(rest.write_positions(shape, lattice), shape), lattice)


def test_smooth_positions_cost_less_than_rough_ones():
    smooth = blob(4)
    _, shape, order, _ = told(smooth)
    rng = np.random.default_rng(0)
    scaled = np.round(smooth.vertices[order] * 200).astype(np.int64)
    assert len(rest.write_positions(shape, scaled)) < 0.6 * len(rest.write_positions(shape, rng.permuted(scaled, axis=0)))


def test_orders_come_back_and_a_wrong_one_is_refused():
    mesh = blob(2)
    _, _, order, starts = told(mesh)
    data = rest.write_order(order, starts)
    found = rest.read_order(data, len(order), len(starts))
    assert np.array_equal(found[0], order)
    assert np.array_equal(found[1], starts)
    twice = order.copy()
    twice[0] = twice[1]
    with pytest.raises(CodecError, match="order of vertices and faces"):
        rest.read_order(rest.write_order(twice, starts), len(order), len(starts))


def test_more_vertices_than_the_faces_tell_are_refused():
    mesh = blob(2)
    data = told(mesh)[0]
    with pytest.raises(CodecError, match="faces that cannot be read"):
        rest.read_faces(data, mesh.n_faces, mesh.n_vertices + 9, 8)
    tracemalloc.start()
    with pytest.raises(CodecError, match="faces that cannot be read"):
        rest.read_faces(data, 10**7, 10**7, 0)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 30_000_000
