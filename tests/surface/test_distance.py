"""Distances along surfaces: exact on a plane, bounded by paths along edges, first order on a sphere; parts, motion, bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from morphlet import InputError, Mesh, MeshError
from morphlet.surface.distance import Front, distances, farthest_points
from support import beside, data_mesh, icosphere, noisy, random_rotation, tetrahedron


def sheet(n):
    """A unit square of n x n cells, each cut in two."""
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a, b, c, d = ((i + x) * (n + 1) + j + y for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    x, y = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n, indexing="ij")
    return Mesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces)


def along_edges(mesh, source):
    i, j = mesh.topology.edges.T
    lengths = np.linalg.norm(mesh.vertices[i] - mesh.vertices[j], axis=1)
    graph = csr_matrix((lengths, (i, j)), shape=(mesh.n_vertices, mesh.n_vertices))
    return dijkstra(graph, directed=False, indices=source)


@pytest.mark.parametrize("source", [0, 8, 40, 77])
def test_a_plane_without_obtuse_angles_is_exact(source):
    mesh = sheet(8)
    straight = np.linalg.norm(mesh.vertices - mesh.vertices[source], axis=1)
    np.testing.assert_allclose(distances(mesh, [source])[0], straight, atol=1e-12)


def test_folding_the_plane_changes_nothing():
    mesh = sheet(8)
    x, y, _ = mesh.vertices.T
    folded = mesh.with_vertices(np.stack([np.abs(x - 0.5), y, 0.3 * (x > 0.5)], axis=1) * [1, 1, 0])
    np.testing.assert_allclose(distances(folded, [0, 5]), distances(mesh, [0, 5]), atol=1e-12)


@given(st.integers(0, 1000), st.floats(0, 0.3))
@settings(max_examples=20)
def test_never_longer_than_along_edges(seed, amount):
    mesh = noisy(2, amount, seed)
    source = seed % mesh.n_vertices
    found = distances(mesh, [source])[0]
    assert found[source] == 0
    assert (found <= along_edges(mesh, source) + 1e-12).all()
    assert (np.delete(found, source) > 0).all()


def test_error_on_a_sphere_is_of_first_order():
    error = []
    for level in (2, 3, 4, 5):
        ball = icosphere(level)
        exact = np.arccos(np.clip(ball.vertices @ ball.vertices[0], -1, 1))
        error.append(np.abs(distances(ball, [0])[0] - exact).mean())
    assert error[-1] < 0.004
    assert (np.array(error[:-1]) / error[1:] > 1.8).all()


def test_motion_size_and_orientation_of_faces_change_nothing():
    mesh = noisy(2, 0.2)
    moved = Mesh(3 * mesh.vertices @ random_rotation(1).T + 5, mesh.faces[:, ::-1])
    np.testing.assert_allclose(distances(moved, [7]), 3 * distances(mesh, [7]), rtol=1e-9, atol=1e-12)


def test_other_parts_are_infinitely_far():
    both = beside(tetrahedron(), tetrahedron())
    found = distances(both, [0, 5])
    assert np.isinf(found[0, 4:]).all()
    assert np.isfinite(found[1, 4:]).all()
    assert np.isinf(found[1, :4]).all()


def test_edges_without_length_do_no_harm():
    mesh = Mesh([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [1, 0, 3], [0, 2, 3]])
    np.testing.assert_allclose(distances(mesh, [2])[0], [1, 1, 0, np.sqrt(2)])


@pytest.mark.parametrize("source", [-1, 4])
def test_a_source_must_be_a_vertex(source):
    with pytest.raises(InputError, match="indices from 0 to 3 in sources"):
        distances(tetrahedron(), [source])


def test_no_sources_no_rows():
    assert distances(tetrahedron(), []).shape == (0, 4)


def test_farthest_points_spread():
    mesh = noisy(3, 0.1)
    chosen, fields = farthest_points(mesh, 12)
    np.testing.assert_array_equal(fields, distances(mesh, chosen))
    for k in range(1, 12):
        assert fields[:k, chosen[k]].min() == fields[:k].min(axis=0).max()


def test_farthest_points_are_at_most_all_vertices():
    assert sorted(farthest_points(tetrahedron(), 9)[0].tolist()) == [0, 1, 2, 3]


def test_farthest_points_need_one_part():
    with pytest.raises(MeshError, match="one connected surface; found 4 vertices out of reach of the others"):
        farthest_points(beside(tetrahedron(), tetrahedron()), 3)


def test_the_same_kernel_serves_read_only_meshes():
    mesh = icosphere(1)
    front = Front.prepare(mesh)
    assert front.faces.flags.writeable
    np.testing.assert_array_equal(front.field(3), distances(mesh, [3])[0])


@pytest.mark.parametrize(("name", "mean", "largest"), [("meshes/horse.obj", 0.006, 0.04), ("tosca/wolf0.off", 0.012, 0.08)])
def test_public_meshes_against_exact_geodesics(name, mean, largest):
    import igl

    mesh = data_mesh(name)
    vertices, faces = np.array(mesh.vertices), np.array(mesh.faces)
    none, every = np.zeros(0, np.int64), np.arange(mesh.n_vertices)
    exact = igl.exact_geodesic(vertices, faces, np.array([0]), none, every, none)
    far = exact > 0.1 * np.sqrt(mesh.area)
    error = np.abs(distances(mesh, [0])[0] - exact)[far] / exact[far]
    assert error.mean() < mean
    assert error.max() < largest
