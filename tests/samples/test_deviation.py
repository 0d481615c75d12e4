"""Distances along a surface between places: exact near, right to a percent far away."""

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import InputError, Mesh, SurfacePoints
from morphlet.numerics.unit_sphere import icosphere
from morphlet.samples.creatures import spiky
from morphlet.samples.deviation import SNAP, Deviation
from morphlet.surface.insertion import inserted
from morphlet.surface.nearest import nearest

ROOF = Mesh([[0, 0, 0], [0, 2, 0], [1, 1, 1], [-1, 1, 1]], [[0, 2, 1], [0, 1, 3]])
LEFT, RIGHT = SurfacePoints([0], [[0.25, 0.5, 0.25]]), SurfacePoints([1], [[0.25, 0.25, 0.5]])


def plane(n=24):
    """A square of unit sides in triangles."""
    i, j = np.meshgrid(np.arange(n), np.arange(n), indexing="ij")
    points = np.stack([i.ravel(), j.ravel(), 0 * i.ravel()], axis=1) / (n - 1)
    a = (i * n + j)[:-1, :-1].ravel()
    return Mesh(points, np.concatenate([np.stack([a, a + n, a + n + 1], 1), np.stack([a, a + n + 1, a + 1], 1)]))


def random_places(mesh, count, seed):
    rng = np.random.default_rng(seed)
    return SurfacePoints(rng.integers(mesh.n_faces, size=count), rng.dirichlet([1, 1, 1], count))


def test_over_the_ridge():
    assert Deviation.prepare(ROOF, LEFT).of(RIGHT)[0] == pytest.approx(np.sqrt(2))


def test_same_place_and_same_face():
    mesh = plane(6)
    places = SurfacePoints([3, 3, 3], [[1, 0, 0], [0.2, 0.3, 0.5], [0.5, 0.5, 0]])
    ruler = Deviation.prepare(mesh, places)
    assert ruler.of(places).max() < 2 * SNAP
    shifted = SurfacePoints([3, 3, 3], [[0, 1, 0], [0.3, 0.3, 0.4], [0, 0.5, 0.5]])
    straight = np.linalg.norm(places.positions(mesh) - shifted.positions(mesh), axis=1)
    np.testing.assert_allclose(ruler.of(shifted), straight, atol=SNAP)


@given(seed=st.integers(0, 999))
@settings(max_examples=10, deadline=None)
def test_on_a_plane_it_is_the_straight_line(seed):
    mesh = plane()
    here, there = random_places(mesh, 6, seed), random_places(mesh, 6, seed + 1000)
    straight = np.linalg.norm(here.positions(mesh) - there.positions(mesh), axis=1)
    found = Deviation.prepare(mesh, here).of(there)
    np.testing.assert_allclose(found, straight, rtol=0.02, atol=SNAP)
    near = straight < 0.05
    np.testing.assert_allclose(found[near], straight[near], atol=SNAP / 10)


def test_exact_near_and_close_far():
    """Against the exact distance over the whole mesh; the answers lie beside the places, across spikes too."""
    mesh = spiky(5, n_vertices=2000)
    places = random_places(mesh, 40, 0)
    steps = 0.05 * np.sqrt(mesh.area) * np.random.default_rng(1).standard_normal((40, 3))
    answers = nearest(mesh, places.positions(mesh) + steps)
    found, size = Deviation.prepare(mesh, places).of(answers), np.sqrt(mesh.area)
    none = np.zeros(0, np.int64)
    for k in range(40):
        two = SurfacePoints([places.faces[k], answers.faces[k]], [places.weights[k], answers.weights[k]])
        added = inserted(mesh, two, SNAP)
        whole, ends = added.mesh, added.vertices
        exact = igl.exact_geodesic(np.array(whole.vertices), np.array(whole.faces), ends[:1].copy(), none, ends[1:].copy(), none)[0]
        assert found[k] == pytest.approx(exact, abs=(1e-6 if exact < 0.1 * size else 0.08 * exact))
    assert 10 < np.sum(found < 0.1 * size) < 40


def test_great_circles():
    points, faces = icosphere(4)
    ball = Mesh(points, faces)
    places, answers = random_places(ball, 30, 2), random_places(ball, 30, 3)
    a, b = (p.positions(ball) / np.linalg.norm(p.positions(ball), axis=1, keepdims=True) for p in (places, answers))
    arcs = np.arccos(np.clip(np.sum(a * b, axis=1), -1, 1))
    np.testing.assert_allclose(Deviation.prepare(ball, places).of(answers), arcs, atol=0.03)


def test_inserted_places_become_vertices_of_the_same_surface():
    mesh = spiky(5, n_vertices=1500)
    places = random_places(mesh, 300, 4)
    crowded = SurfacePoints(np.r_[places.faces, places.faces[:50]], np.r_[places.weights, np.roll(places.weights[:50], 1, axis=1)])
    added = inserted(mesh, crowded, SNAP)
    refined, seats = added.mesh, added.vertices
    np.testing.assert_allclose(refined.vertices[seats], crowded.positions(mesh), atol=2 * SNAP * mesh.bbox_diagonal)
    assert np.array_equal(refined.vertices[: mesh.n_vertices], mesh.vertices)
    assert refined.area == pytest.approx(mesh.area, rel=1e-12)
    assert refined.volume == pytest.approx(mesh.volume, rel=1e-12)
    assert refined.topology.euler_characteristic == 2
    assert np.all(refined.topology.twins >= 0)
    assert refined.face_areas.min() > 0


def test_answers_that_do_not_fit_are_refused():
    ruler = Deviation.prepare(ROOF, LEFT)
    with pytest.raises(InputError, match="1 answers; found 2"):
        ruler.of(SurfacePoints([0, 1], [[1, 0, 0], [1, 0, 0]]))
    with pytest.raises(InputError, match="faces of the answers"):
        ruler.of(SurfacePoints([2], [[1, 0, 0]]))
    with pytest.raises(InputError, match="faces of the places"):
        Deviation.prepare(ROOF, SurfacePoints([2], [[1, 0, 0]]))
    apart = Mesh(np.concatenate([ROOF.vertices, ROOF.vertices + 9]), np.concatenate([ROOF.faces, ROOF.faces + 4]))
    with pytest.raises(InputError, match="finite numbers in fields"):
        Deviation.prepare(apart, LEFT)
