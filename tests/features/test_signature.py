"""Signatures: finite on every mesh, blind to motion, size and numbering; distances against known ones."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import dijkstra
from scipy.spatial.transform import Rotation

from morphlet import Mesh
from morphlet.features.signature import _graph, centroid_distance, mean_geodesic_distance, signature
from morphlet.numerics.unit_sphere import icosphere


def blob(s=2):
    points, faces = icosphere(s)
    radius = 1 + 0.5 * np.exp(3 * (points @ [1, 0, 0] - 1)) + 0.9 * np.exp(4 * (points @ [0, 0.8, 0.6] - 1))
    return Mesh(points * radius[:, None], faces)


@given(st.integers(0, 100), st.floats(0.01, 100))
@settings(max_examples=10, deadline=None)
def test_motion_and_size_change_nothing(seed, scale):
    mesh = blob()
    moved = mesh.with_vertices(scale * mesh.vertices @ Rotation.random(random_state=seed).as_matrix().T + 3)
    np.testing.assert_allclose(signature(moved), signature(mesh), atol=2e-3)  # ties in the choice of sources may fall otherwise
    np.testing.assert_allclose(centroid_distance(moved), centroid_distance(mesh), atol=1e-9)


def test_numbering_changes_nothing():
    mesh = blob()
    order = np.random.default_rng(0).permutation(mesh.n_vertices)
    place = np.argsort(order)
    shuffled = Mesh(mesh.vertices[order], place[mesh.faces][::-1])
    np.testing.assert_allclose(signature(shuffled), signature(mesh)[order], atol=2e-3)


def test_tips_are_far_from_everything():
    mesh = blob(3)
    mean = mean_geodesic_distance(mesh)
    assert mean[np.argmax(mesh.vertices @ [0, 0.8, 0.6])] > np.percentile(mean, 97)


def test_paths_across_two_faces_are_straight():
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    assert dijkstra(_graph(square), indices=1)[3] == pytest.approx(np.sqrt(2))


def test_a_path_that_leaves_the_two_faces_is_no_shortcut():
    dart = Mesh([[0, 0, 0], [1, 0, 0], [-1, 2, 0], [-1, -2, 0]], [[0, 1, 2], [1, 0, 3]])
    assert dijkstra(_graph(dart), indices=2)[3] == pytest.approx(2 * np.sqrt(5))  # round the corner at the origin


def test_folding_does_not_change_distances_along_the_surface():
    flat = [[0, 0, 0], [0, 1, 0], [1, 0.5, 0], [-1, 0.5, 0]]
    folded = [[0, 0, 0], [0, 1, 0], [0, 0.5, 1], [-1, 0.5, 0]]
    one, other = (dijkstra(_graph(Mesh(v, [[0, 1, 2], [1, 0, 3]])), indices=2)[3] for v in (flat, folded))
    assert one == pytest.approx(2)
    assert other == pytest.approx(2)


def test_parts_are_joined_by_their_shortest_bridge():
    pair = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [3, 0, 0], [4, 0, 0], [3, 1, 0]], [[0, 1, 2], [3, 4, 5]])
    assert dijkstra(_graph(pair), indices=0)[4] == pytest.approx(4)


@pytest.mark.parametrize(
    "mesh",
    [
        Mesh([[0, 0, 0]], np.zeros((0, 3), int)),
        Mesh(np.zeros((3, 3)), [[0, 1, 2]]),
        Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]),
        Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [9, 9, 9]], [[0, 1, 2], [0, 1, 3], [0, 1, 4], [0, 1, 2]]),
        Mesh([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [1, 2, 3], [0, 0, 2]]),
    ],
    ids=["one vertex", "a point", "a line", "non-manifold, doubled, unreferenced", "zero edges"],
)
def test_broken_meshes_have_finite_signatures(mesh):
    values = signature(mesh)
    assert values.shape == (mesh.n_vertices, 3)
    assert np.isfinite(values).all()
