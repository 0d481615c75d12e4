"""The region of interest: what it holds by each way of choosing it, rings more or less, weights, bad input."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import dijkstra

from morphlet import InputError, Mesh
from morphlet.editing.roi import Roi, vertex_path, vertices_within
from morphlet.surface.distance import distances
from support import beside, data_mesh, icosphere, noisy, random_rotation, tetrahedron


def grid(n):
    """A square of n x n cells of size 1, each cut in two; vertex i (n + 1) + j is at (i, j, 0)."""
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    a, b, c, d = ((i + x) * (n + 1) + j + y for x, y in ((0, 0), (1, 0), (1, 1), (0, 1)))
    faces = np.concatenate([np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)])
    x, y = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    return Mesh(np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1), faces)


def along_edges(mesh, sources):
    i, j = mesh.topology.edges.T
    lengths = np.linalg.norm(mesh.vertices[i] - mesh.vertices[j], axis=1)
    graph = csr_matrix((lengths, (i, j)), shape=(mesh.n_vertices, mesh.n_vertices))
    return dijkstra(graph, directed=False, indices=sources).min(axis=0)


def assert_partition(roi):
    """Each vertex is one of the three."""
    together = np.sort(np.concatenate([roi.handle, roi.free, roi.anchors]))
    np.testing.assert_array_equal(together, np.arange(roi.mesh.n_vertices))
    np.testing.assert_array_equal(roi.moving, np.sort(np.concatenate([roi.handle, roi.free])))


@pytest.mark.parametrize(("metric", "count"), [("geodesic", 9), ("euclidean", 9), ("edges", 7)])
def test_a_disc_of_a_plane(metric, count):
    """Radius 1.5: the eight neighbours in the plane; along edges two of them are 2 away, since diagonals run one way only."""
    mesh = grid(8)
    roi = Roi.within(mesh, [40], 1.5, metric)
    assert len(roi.moving) == count
    assert (np.linalg.norm(mesh.vertices[roi.moving] - mesh.vertices[40], axis=1) < 1.5).all()
    assert_partition(roi)


def test_the_surface_is_not_crossed_through_space():
    """A sheet folded onto itself at distance 0.1: the other leaf is near through space only."""
    mesh = grid(8)
    x, y, _ = mesh.vertices.T
    folded = mesh.with_vertices(np.stack([np.minimum(x, 8 - x), y, 0.1 * (x > 4)], axis=1))
    one_leaf = Roi.within(folded, [9 + 4], 1.5)
    assert (folded.vertices[one_leaf.moving, 2] == 0).all()
    both = Roi.within(folded, [9 + 4], 1.5, "euclidean")
    assert (folded.vertices[both.moving, 2] > 0).any()


@given(st.integers(0, 1000), st.floats(0.2, 1.2), st.sampled_from(["geodesic", "edges"]))
@settings(max_examples=25)
def test_running_the_front_on_what_is_near_changes_nothing(seed, radius, metric):
    mesh = noisy(3, 0.2, seed)
    start = [seed % mesh.n_vertices]
    roi = Roi.within(mesh, start, radius, metric)
    whole = distances(mesh, start)[0] if metric == "geodesic" else along_edges(mesh, start)
    np.testing.assert_array_equal(roi.moving, np.flatnonzero(whole <= radius))


def test_a_handle_of_many_vertices_reaches_as_far_as_its_nearest():
    """Never less than single vertices reach, and beyond by less than an edge: the edges between them are handle, too."""
    mesh = icosphere(4)
    handle = Roi.within(mesh, [0], 0.3).moving
    single = distances(mesh, handle).min(axis=0)
    edge = np.linalg.norm(mesh.vertices[mesh.faces[:, 0]] - mesh.vertices[mesh.faces[:, 1]], axis=1).max()
    moving = Roi.within(mesh, handle, 0.4).moving
    assert set(np.flatnonzero(single <= 0.4)) <= set(moving)
    assert (single[moving] <= 0.4 + 0.3 * edge).all()


@given(st.floats(0.3, 0.6), st.floats(0.05, 1.0))
@settings(max_examples=20)
def test_a_larger_radius_holds_the_smaller_region(radius, more):
    mesh = noisy(3, 0.2)
    small, large = (Roi.within(mesh, [5], r) for r in (radius, radius + more))
    assert set(small.free) <= set(large.free)


def test_motion_and_size_change_no_region():
    mesh = noisy(3, 0.2)
    moved = mesh.with_vertices(1e6 * mesh.vertices @ random_rotation(2).T + 7)
    for metric in ("geodesic", "euclidean", "edges"):
        np.testing.assert_array_equal(Roi.within(moved, [9], 0.71e6, metric).free, Roi.within(mesh, [9], 0.71, metric).free)


def test_edges_without_length_are_edges():
    mesh = Mesh([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [1, 0, 3], [0, 2, 3]])
    assert Roi.within(mesh, [0], 0.5, "edges").free.tolist() == [1]
    assert Roi.within(mesh, [0], 0.5).free.tolist() == [1]


def test_an_edge_between_large_faces_is_not_lost():
    """The edge 0-1 is short, the third corners of its faces are far away."""
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0.5, 50, 0], [0.5, -50, 0]], [[0, 1, 2], [1, 0, 3]])
    for metric in ("geodesic", "edges"):
        assert Roi.within(mesh, [0], 1.0, metric).free.tolist() == [1]


def test_other_parts_stay():
    both = beside(icosphere(2), icosphere(2))
    for metric in ("geodesic", "edges"):
        assert (Roi.within(both, [3], 100.0, metric).free < 162).all()
    assert len(Roi.within(both, [3], 100.0, "euclidean").free) == 323
    assert (Roi.between(both, [3], [0]).free < 162).all()


@pytest.mark.parametrize("radius", [0.0, -1.0, np.nan, np.inf])
def test_a_radius_is_positive(radius):
    with pytest.raises(InputError, match=r"needed (a radius above 0|finite numbers in radius)"):
        Roi.within(icosphere(1), [0], radius)


def test_a_radius_must_reach_something():
    with pytest.raises(InputError, match=r"a radius that reaches a vertex beside the handle; found 0\.01, which reaches none"):
        Roi.within(icosphere(1), [0], 0.01)


def test_an_unknown_metric():
    with pytest.raises(InputError, match="needed one of geodesic, euclidean, edges as metric; found 'taxi'"):
        Roi.within(icosphere(1), [0], 1.0, "taxi")


def test_a_ring_of_anchors_bounds_the_region():
    """Column 2 of the grid stays: the handle at the left does not reach what is right of it."""
    mesh = grid(6)
    column = np.flatnonzero(mesh.vertices[:, 0] == 2)
    roi = Roi.between(mesh, [0], column)
    assert (mesh.vertices[roi.moving, 0] < 2).all()
    assert len(roi.moving) == 14
    np.testing.assert_array_equal(roi.rim, column)
    assert_partition(roi)


def test_scattered_anchors_hold_only_themselves():
    mesh = grid(6)
    roi = Roi.between(mesh, [0], [30, 40])
    assert roi.anchors.tolist() == [30, 40]


def test_handle_and_anchors_are_different():
    with pytest.raises(InputError, match=r"handle or anchor; found 1 that are both \(first: 7\)"):
        Roi.between(grid(3), [7, 8], [6, 7])


def test_paint():
    mesh = grid(1)
    roi = Roi.painted(mesh, [1.0, 0.0, 0.3, 1.0])
    assert (roi.handle.tolist(), roi.free.tolist(), roi.anchors.tolist()) == ([0, 3], [2], [1])


@pytest.mark.parametrize(
    ("weights", "message"),
    [
        ([0, 0.5, 0.9, 0], "needed a handle; found no handle vertex"),
        ([0, 1, 1.1, -1], "painted weights from 0 to 1; found 2 outside that range .first: 2, 3."),
        ([0, 1, np.nan, 0], "finite numbers in weights"),
        ([0, 1], "weights of shape .4."),
    ],
)
def test_bad_paint(weights, message):
    with pytest.raises(InputError, match=message):
        Roi.painted(grid(1), weights)


def test_growing_goes_ring_by_ring():
    mesh = icosphere(3)
    roi, reach = Roi(mesh, [0], []), dijkstra(mesh.topology.adjacency, unweighted=True, indices=0)
    for rings in range(5):
        np.testing.assert_array_equal(roi.grown(rings).moving, np.flatnonzero(reach <= rings))
    assert roi.grown(2).handle.tolist() == [0]


@given(st.integers(0, 3), st.integers(0, 3))
@settings(max_examples=10)
def test_shrinking_takes_rings_off_but_keeps_the_handle(grow, shrink):
    mesh = icosphere(3)
    roi = Roi(mesh, [0], []).grown(4)
    np.testing.assert_array_equal(roi.grown(grow).shrunk(grow).free, roi.free)
    np.testing.assert_array_equal(roi.shrunk(shrink).free, Roi(mesh, [0], []).grown(4 - shrink).free)
    assert roi.shrunk(9).moving.tolist() == [0]


def test_rings_are_counted_from_zero():
    with pytest.raises(InputError, match="0 or more rings; found -1"):
        Roi(icosphere(1), [0], []).grown(-1)


def test_the_rim_is_next_to_the_region():
    mesh = icosphere(3)
    roi = Roi(mesh, [0], []).grown(2)
    reach = dijkstra(mesh.topology.adjacency, unweighted=True, indices=0)
    np.testing.assert_array_equal(roi.rim, np.flatnonzero(reach == 3))


def test_a_region_without_anchors_is_allowed():
    mesh = tetrahedron()
    roi = Roi(mesh, [2], [0, 1, 3])
    assert (len(roi.anchors), len(roi.rim)) == (0, 0)


def test_parts_of_a_handle_turn_by_themselves():
    mesh = grid(4)
    assert Roi(mesh, [24, 0, 1, 23], []).handle_parts.tolist() == [0, 1, 1, 0]


@pytest.mark.parametrize(
    ("handle", "free", "message"),
    [
        ([], [1], "needed a handle; found no handle vertex"),
        ([1, 1], [2], "each handle vertex once; found 1 repeated"),
        ([1, 2], [2, 3], "handle or free; found 1 that are both .first: 2."),
        ([4], [0], "indices from 0 to 3 in handle"),
        ([0], [-1], "indices from 0 to 3 in free"),
        ([0.5], [1], "integer indices in handle"),
    ],
)
def test_bad_regions(handle, free, message):
    with pytest.raises(InputError, match=message):
        Roi(tetrahedron(), handle, free)


def test_weights_soften():
    roi = Roi(tetrahedron(), [0, 2], [1])
    assert roi.weight is None
    assert roi.softened(3).weight.tolist() == [3, 3]
    assert Roi(tetrahedron(), [0, 2], [1], [np.inf, 0.1]).weight.tolist() == [np.inf, 0.1]


@pytest.mark.parametrize(
    ("weight", "message"), [([1.0], "one weight for each of 2 handle"), ([1, 0], "positive weights"), ([np.nan, 1], "positive weights")]
)
def test_bad_weights(weight, message):
    with pytest.raises(InputError, match=message):
        Roi(tetrahedron(), [0, 2], [1], weight)


def test_a_copy_is_the_same_and_still_frozen():
    roi = Roi.within(icosphere(2), [0, 1], 0.9).softened(2)
    copy = pickle.loads(pickle.dumps(roi))
    for name in ("handle", "free", "anchors", "moving", "weight", "handle_parts", "rim"):
        np.testing.assert_array_equal(getattr(copy, name), getattr(roi, name))
        assert not getattr(copy, name).flags.writeable


def test_vertices_in_a_ball():
    mesh = grid(4)
    assert vertices_within(mesh, [2, 2, 0], 1.0).tolist() == [7, 11, 12, 13, 17]
    with pytest.raises(InputError, match=r"a vertex within 0\.25 of .* found none; the nearest is vertex 24, 1\.41421 away"):
        vertices_within(mesh, [5, 5, 0], 0.25)
    with pytest.raises(InputError, match="a radius above 0; found -2"):
        vertices_within(mesh, [0, 0, 0], -2)


def test_a_path_is_the_shortest_one():
    """The grid's diagonals run one way only: along them the way is straight, against them it has a corner."""
    mesh = grid(4)
    assert vertex_path(mesh, [0, 12]).tolist() == [0, 6, 12]
    assert vertex_path(mesh, [12, 0, 4]).tolist() == [12, 6, 0, 1, 2, 3, 4]
    assert len(vertex_path(mesh, [4, 20])) == 9


def test_a_closed_curve_meets_each_vertex_once():
    ball = icosphere(3)
    curve = vertex_path(ball, [0, 1, 2, 0])
    assert len(np.unique(curve)) == len(curve)
    edges = {tuple(sorted(edge)) for edge in zip(curve.tolist(), np.roll(curve, -1).tolist(), strict=True)}
    assert edges <= {tuple(edge) for edge in ball.topology.edges.tolist()}


def test_a_path_needs_picks_on_one_part():
    both = beside(tetrahedron(), tetrahedron())
    with pytest.raises(InputError, match="picks on one part of the mesh; found no path from 0 to 5"):
        vertex_path(both, [0, 5])
    with pytest.raises(InputError, match="at least two vertices to lay a path through; found 1 vertex"):
        vertex_path(both, [0])


@pytest.mark.parametrize("name", ["meshes/horse.obj", "meshes/fandisk.obj", "tosca/wolf0.off"])
def test_public_meshes_near_is_enough(name):
    """What is near through space holds every way that is short enough, on real triangulations too."""
    mesh = data_mesh(name)
    whole = distances(mesh, [100])[0]
    for share in (0.05, 0.2, 0.5):
        roi = Roi.within(mesh, [100], share * mesh.bbox_diagonal)
        np.testing.assert_array_equal(roi.moving, np.flatnonzero(whole <= share * mesh.bbox_diagonal))
