"""A mesh down to a tetrahedron and back: every record undone gives the mesh again, every level is a sphere."""

from itertools import pairwise

import numpy as np
import pytest

from morphlet import Mesh, MeshError
from morphlet.surface.hierarchy import CollapseCost, Hierarchy, decimate, pull_up, push_down
from morphlet.surface.requirements import require_sphere
from support import beside, bipyramid, blob, icosphere, noisy, stacked, tetrahedron, torus

MESHES = {
    "blob": blob(2),
    "noise": icosphere(2).with_vertices(np.random.default_rng(0).normal(size=(162, 3))),
    "points": icosphere(2).with_vertices(np.zeros((162, 3))),
    "stacked": stacked(200),
    "bipyramid": bipyramid(60),
}
COSTS = ("shape", "valence")
EVERY = pytest.mark.parametrize(("mesh", "cost"), [pytest.param(m, c, id=f"{k}-{c}") for k, m in MESHES.items() for c in COSTS])


def alive_after(hierarchy: Hierarchy, remaining: int) -> np.ndarray:
    """Vertices that exist while `remaining` collapses are still done."""
    alive = np.ones(hierarchy.n_vertices, bool)
    alive[hierarchy.removed[:remaining]] = False
    return alive


def rotated(faces: np.ndarray) -> np.ndarray:
    """Each face from its smallest corner on: the same triangle may be written three ways."""
    return np.take_along_axis(faces, (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3, axis=1)


@EVERY
def test_undoing_all_records_gives_every_face_back_in_its_row(mesh: Mesh, cost: CollapseCost) -> None:
    hierarchy = decimate(mesh, cost)
    np.testing.assert_array_equal(rotated(hierarchy.faces_after(0)), rotated(mesh.faces))
    assert len(hierarchy.removed) == len(np.unique(hierarchy.removed)) == mesh.n_vertices - 4
    assert not np.isin(hierarchy.base_vertices, hierarchy.removed).any()


@EVERY
def test_every_level_is_a_sphere(mesh: Mesh, cost: CollapseCost) -> None:
    hierarchy = decimate(mesh, cost)
    for remaining in range(0, len(hierarchy.removed) + 1, 7):
        rows = hierarchy.faces_after(remaining)
        faces, alive = rows[rows[:, 0] >= 0], alive_after(hierarchy, remaining)
        np.testing.assert_array_equal(np.unique(faces), np.flatnonzero(alive))
        local = Mesh(mesh.vertices[alive], (np.cumsum(alive) - 1)[faces])
        require_sphere(local)
        assert local.topology.euler_characteristic == 2


@EVERY
def test_rings_start_where_the_vertex_went_and_run_round_it(mesh: Mesh, cost: CollapseCost) -> None:
    hierarchy = decimate(mesh, cost)
    rows = hierarchy.bottom()
    for i in reversed(range(len(hierarchy.removed))):
        part = slice(hierarchy.ring_offsets[i], hierarchy.ring_offsets[i + 1])
        ring, spans = hierarchy.ring_vertices[part], hierarchy.ring_faces[part]
        assert len(ring) >= 3
        assert len(set(ring.tolist())) == len(ring)
        for j in range(1, len(ring) - 1):  # before the vertex returns, the ring is the fan of its first member
            assert rotated(rows[spans[j]][None]).tolist() == rotated(np.array([[ring[0], ring[j], ring[j + 1]]])).tolist()
        assert (rows[spans[[0, -1]]] == -1).all()
        rows[spans] = np.stack([np.full(len(ring), hierarchy.removed[i]), ring, np.roll(ring, -1)], axis=1)


@EVERY
def test_masses_are_carried_and_their_sum_stays(mesh: Mesh, cost: CollapseCost) -> None:
    hierarchy = decimate(mesh, cost)
    start = np.random.default_rng(1).random(mesh.n_vertices)
    mass = start.copy()
    push_down(hierarchy.removed, hierarchy.ring_offsets, hierarchy.ring_vertices, mass)
    assert mass[hierarchy.base_vertices].sum() == pytest.approx(start.sum(), rel=1e-12)
    for high, low in hierarchy.batches(2.0, 0.75):
        pull_up(high, low, hierarchy.removed, hierarchy.ring_offsets, hierarchy.ring_vertices, mass)
        assert mass[alive_after(hierarchy, low)].sum() == pytest.approx(start.sum(), rel=1e-12)
        assert mass.min() > 0
    np.testing.assert_allclose(mass, start, rtol=0, atol=1e-12)


def test_batches_double_the_vertices_and_take_the_last_quarter_at_once() -> None:
    hierarchy = decimate(blob(3))
    ranges = list(hierarchy.batches(2.0, 0.75))
    assert ranges[0][0] == 638
    assert ranges[-1][1] == 0
    assert all(low == high for (_, low), (high, _) in pairwise(ranges))
    counts = [642 - low for _, low in ranges]
    assert counts == [8, 16, 32, 64, 128, 256, 642]


def test_a_tetrahedron_is_its_own_bottom() -> None:
    hierarchy = decimate(tetrahedron())
    assert len(hierarchy.removed) == 0
    assert list(hierarchy.batches(2.0, 0.75)) == []
    assert hierarchy.max_ring == 3
    np.testing.assert_array_equal(rotated(hierarchy.bottom()), rotated(tetrahedron().faces))


def test_hubs_wait_so_that_rings_stay_short() -> None:
    mesh = bipyramid(1000)
    hierarchy = decimate(mesh)
    lengths = np.diff(hierarchy.ring_offsets)
    assert lengths.sum() < 12 * mesh.n_vertices  # 1000 collapses of a hub would scan some 500 000 ring members
    assert decimate(mesh, "valence").ring_offsets[-1] < 12 * mesh.n_vertices


def test_valence_alone_keeps_rings_short_whatever_the_positions() -> None:
    noise = icosphere(4).with_vertices(np.random.default_rng(0).normal(size=(2562, 3)))
    one, other = decimate(noise, "valence"), decimate(icosphere(4), "valence")
    np.testing.assert_array_equal(one.removed, other.removed)
    np.testing.assert_array_equal(one.ring_vertices, other.ring_vertices)
    assert np.diff(one.ring_offsets).mean() < 6


def test_shape_keeps_the_vertices_that_carry_the_shape() -> None:
    ball = noisy(3, 0.001)
    spikes = np.array([5, 100, 333, 600])
    vertices = np.array(ball.vertices)
    vertices[spikes] *= 3
    hierarchy = decimate(ball.with_vertices(vertices))
    assert set(spikes) <= set(hierarchy.removed[-40:]) | set(hierarchy.base_vertices)


def test_the_same_mesh_twice_gives_the_same_records() -> None:
    one, other = decimate(blob(3)), decimate(blob(3))
    np.testing.assert_array_equal(one.ring_vertices, other.ring_vertices)
    np.testing.assert_array_equal(one.removed, other.removed)


@pytest.mark.parametrize("mesh", [torus(), beside(icosphere(0), icosphere(0))], ids=["torus", "two spheres"])
def test_what_is_no_sphere_does_not_reach_a_tetrahedron(mesh: Mesh) -> None:
    with pytest.raises(MeshError, match=r"collapses to a tetrahedron; found no edge to contract at \d+ vertices; check genus"):
        decimate(mesh)
