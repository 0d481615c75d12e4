"""Feature regions: persistence against counts of components, bumps found, the graph, invariances, refusals."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from morphlet import InputError, Mesh, MeshError
from morphlet.features.regions import RegionOptions, count_tips, find_peaks, find_regions
from morphlet.numerics.unit_sphere import fibonacci
from morphlet.surface.mesh import Topology
from support import beside, bumpy, data_mesh, icosphere, random_rotation, relabelled

STRIP = Topology([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4], [4, 5, 6]], 7)


@pytest.mark.parametrize("count", [3, 4, 6, 8])
def test_a_ball_with_bumps_has_that_many_tips(count):
    directions = fibonacci(count)
    mesh = bumpy(directions, np.linspace(1.0, 1.3, count))
    found = find_regions(mesh)
    assert len(found) == count
    unit = mesh.vertices[found.tips] / np.linalg.norm(mesh.vertices[found.tips], axis=1, keepdims=True)
    assert sorted(np.argmax(directions @ unit.T, axis=0).tolist()) == list(range(count))
    assert np.max(directions @ unit.T, axis=0).min() > 0.99


def test_the_graph_of_bumps_is_a_star_about_the_core():
    found = find_regions(bumpy(fibonacci(5), [1.0, 1.1, 1.2, 1.3, 1.4]))
    assert found.core_node == found.nodes[found.core] == 5
    assert sorted(map(tuple, found.edges.tolist())) == [(k, 5) for k in range(5)]


def test_regions_are_connected_disjoint_and_hold_their_tips():
    found = find_regions(bumpy(fibonacci(6), np.linspace(0.8, 1.4, 6)))
    np.testing.assert_array_equal(found.nodes[found.tips], np.arange(6))
    for node in range(found.nodes.max() + 1):
        inside = found.nodes == node
        assert connected_components(found.mesh.topology.adjacency[inside][:, inside], directed=False)[0] == 1
    for k in range(6):
        assert found.height[found.nodes == k].min() > found.levels[k]
    assert found.areas.min() > 0
    assert found.areas.sum() < 1


def test_a_ball_has_no_features():
    found = find_regions(icosphere(3))
    assert len(found) == 0
    assert found.core_node == 0
    assert found.nodes.max() == 0
    assert found.areas.shape == (0,)


def test_a_lonely_tip_rises_above_the_mean():
    found = find_regions(bumpy([[0, 0, 1]], [2.0]), RegionOptions(most=1))
    assert len(found) == 1
    assert found.levels[0] == pytest.approx(np.average(found.height, weights=found.mesh.vertex_areas))


def test_persistence_by_hand():
    peaks = find_peaks(STRIP, np.array([5.0, 2.0, 3.0, 1.0, 4.0, 0.5, 4.5]))
    assert peaks.vertices.tolist() == [0, 6]
    assert peaks.passes.tolist() == [0.5, 3.0]
    assert peaks.persistence.tolist() == [4.5, 1.5]
    assert peaks.elders.tolist() == [0, 0]


def test_the_lower_peak_ends_where_two_meet():
    path = Topology([[0, 1, 1], [1, 2, 2], [2, 3, 3], [3, 4, 4]], 5)
    peaks = find_peaks(path, np.array([3.0, 1.0, 5.0, 2.0, 4.0]))
    assert dict(zip(peaks.vertices.tolist(), peaks.passes.tolist(), strict=True)) == {2: 1.0, 4: 2.0, 0: 1.0}
    assert peaks.vertices.tolist() == [2, 4, 0]  # both ends stand out by 2: the higher one first
    assert peaks.elders.tolist() == [0, 0, 0]


def test_of_equal_heights_the_first_vertex_counts_as_higher():
    peaks = find_peaks(STRIP, np.ones(7))
    assert peaks.vertices.tolist() == [0]
    assert peaks.persistence.tolist() == [0.0]


@given(st.integers(0, 10_000))
@settings(max_examples=30)
def test_peaks_count_the_components_above_every_level(seed):
    topology = icosphere(2).topology
    height = np.random.default_rng(seed).integers(0, 20, topology.n_vertices).astype(float)
    peaks = find_peaks(topology, height)
    assert np.all(np.diff(peaks.persistence) <= 0)
    for level in np.arange(0, 20) + 0.5:
        above = height > level
        components = connected_components(topology.adjacency[above][:, above], directed=False)[0] if above.any() else 0
        alive = (height[peaks.vertices] > level) & (np.where(peaks.elders == np.arange(len(peaks.elders)), -1, peaks.passes) < level)
        assert components == alive.sum()


@pytest.mark.parametrize(
    ("persistence", "count"),
    [
        ([0.5, 0.3, 0.2], 3),
        ([0.5, 0.3, 0.06, 0.02], 2),
        ([0.5, 0.05, 0.045, 0.02], 1),
        ([0.5, 0.1, 0.09, 0.02], 3),
        ([0.02, 0.01], 0),
        ([], 0),
    ],
)
def test_the_widest_gap_decides(persistence, count):
    assert count_tips(np.array(persistence), RegionOptions()) == count


def test_equal_bounds_are_a_threshold_and_most_is_kept():
    persistence = np.array([0.5, 0.3, 0.06, 0.04, 0.02])
    assert count_tips(persistence, RegionOptions(0.05, 0.05)) == 3
    assert count_tips(persistence, RegionOptions(0.05, 0.05, most=2)) == 2


def test_the_gap_is_between_the_last_tip_and_the_next_peak():
    found = find_regions(bumpy(fibonacci(4), [0.35, 1.0, 1.2, 1.4]), RegionOptions(0.1, 0.1))
    assert len(found) == 3
    assert found.gap == found.peaks.persistence[2] - found.peaks.persistence[3]


@given(st.integers(0, 50), st.floats(0.01, 100))
@settings(max_examples=5)
def test_motion_size_and_numbering_change_nothing(seed, scale):
    mesh = bumpy(fibonacci(5), [0.9, 1.0, 1.1, 1.25, 1.4], 3)
    shuffled, place = relabelled(mesh.with_vertices(scale * mesh.vertices @ random_rotation(seed).T + 3), seed)
    one, other = find_regions(mesh), find_regions(shuffled)
    np.testing.assert_array_equal(other.tips, place[one.tips])
    np.testing.assert_allclose(other.height[place], one.height, rtol=1e-6)
    np.testing.assert_allclose(other.persistence, one.persistence, rtol=1e-6)
    np.testing.assert_allclose(other.areas, one.areas, rtol=1e-6)
    np.testing.assert_array_equal(other.nodes[place] < 5, one.nodes < 5)
    assert other.core == place[one.core]


def test_an_open_surface_has_regions_too():
    mesh = bumpy(fibonacci(5), [1.0, 1.1, 1.2, 1.3, 1.4])
    low = np.linalg.norm(mesh.vertices[mesh.faces].mean(axis=1), axis=1)
    pierced = Mesh(mesh.vertices, np.delete(mesh.faces, np.argmin(low), axis=0))
    np.testing.assert_array_equal(find_regions(pierced).tips, find_regions(mesh).tips)


@pytest.mark.parametrize(
    ("mesh", "found"),
    [
        (beside(icosphere(1), icosphere(1)), "42 vertices out of reach"),
        (Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 5, 5]], [[0, 1, 2]]), "3 vertices out of reach"),
        (Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]), "1 face without any"),
        (Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), "0 faces without any"),
    ],
    ids=["two parts", "a vertex alone", "a line", "nothing"],
)
def test_unfit_meshes_are_refused(mesh, found):
    with pytest.raises(MeshError, match=found):
        find_regions(mesh)


@pytest.mark.parametrize("options", [{"never": 0.0}, {"never": 0.2, "always": 0.1}, {"most": 0}])
def test_options_are_checked(options):
    with pytest.raises(InputError, match="0 < never <= always"):
        RegionOptions(**options)


def test_regions_survive_pickling():
    found = find_regions(bumpy(fibonacci(4), [1.0, 1.1, 1.2, 1.3], 3))
    again = pickle.loads(pickle.dumps(found))
    np.testing.assert_array_equal(again.nodes, found.nodes)
    np.testing.assert_array_equal(again.peaks.passes, found.peaks.passes)
    assert not again.height.flags.writeable


@pytest.mark.parametrize(
    ("name", "count"),
    [
        ("meshes/horse.obj", 6),
        ("meshes/cat.obj", 6),
        ("meshes/lion.obj", 6),
        ("meshes/homer.obj", 5),
        ("tosca/wolf0.off", 6),
        ("meshes/bunny.off", 3),
    ],
)
def test_limbs_of_public_meshes(name, count):
    found = find_regions(data_mesh(name))
    assert len(found) == count
    assert found.core_node == found.nodes[found.core]
