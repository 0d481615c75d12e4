"""Collapses, flips and the field, on cases small enough to do by hand."""

import numpy as np
import pytest

from morphlet import InputError, Mesh
from morphlet.samples.implicit import Solid, part
from morphlet.samples.meshing import edge_middles, midpoint_faces
from morphlet.samples.surgery import flipped, thinned

OCTAHEDRON = np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], float)
OCTANTS = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])


def icosphere(levels):
    vertices, faces = OCTAHEDRON, OCTANTS
    for _ in range(levels):
        edges, middle = edge_middles(faces, len(vertices))
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        faces = midpoint_faces(faces, middle).reshape(-1, 3)
    return vertices / np.linalg.norm(vertices, axis=1, keepdims=True), faces


def test_midpoints_of_an_octahedron():
    vertices, faces = icosphere(1)
    assert (len(vertices), len(faces)) == (18, 32)
    mesh = Mesh(vertices, faces)
    assert mesh.topology.euler_characteristic == 2
    assert mesh.volume > 0


@pytest.mark.parametrize("wanted", [30, 50, 66])
def test_thinned_meets_the_number_and_stays_a_sphere(wanted):
    vertices, faces = icosphere(2)
    left, kept = thinned(vertices, faces, np.ones(len(vertices)), wanted)
    mesh = Mesh(vertices[kept], left)
    assert mesh.n_vertices == wanted
    assert mesh.topology.euler_characteristic == 2
    assert np.all(mesh.topology.twins >= 0)
    assert mesh.volume > 0.5 * Mesh(vertices, faces).volume


def test_a_tetrahedron_cannot_be_thinned():
    tetrahedron = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    left, kept = thinned(vertices, tetrahedron, np.ones(4), 3)
    assert len(kept) == 4
    assert len(left) == 4


def test_held_vertices_are_never_removed():
    vertices, faces = icosphere(2)
    held = np.array([3, 40, 41, 65])
    assert np.isin(held, thinned(vertices, faces, np.ones(len(vertices)), 30, held)[1]).all()
    assert not np.isin(held, thinned(vertices, faces, np.ones(len(vertices)), 30)[1]).all()


def test_short_edges_go_first():
    vertices, faces = icosphere(3)
    lengths = np.where(vertices[:, 2] > 0, 1.0, 0.2)  # the northern half wants long edges
    kept = thinned(vertices, faces, lengths, 180)[1]
    north = np.mean(vertices[kept, 2] > 0)
    assert north < 0.3


def test_the_long_diagonal_flips():
    """A flat rhombus over an apex below: its long diagonal is not Delaunay, the short one is."""
    vertices = np.array([[-2, 0, 0], [2, 0, 0], [0, -0.5, 0], [0, 0.5, 0], [0, 0, -6]], float)
    faces = np.array([[0, 1, 3], [1, 0, 2], [0, 4, 2], [2, 4, 1], [1, 4, 3], [3, 4, 0]])
    after = flipped(vertices, faces)
    pairs = {tuple(sorted((f[i], f[(i + 1) % 3]))) for f in after.tolist() for i in range(3)}
    assert (0, 1) not in pairs
    assert (2, 3) in pairs
    before, now = Mesh(vertices, faces), Mesh(vertices, after)
    assert now.topology.euler_characteristic == 2
    assert np.all(now.topology.twins >= 0)
    assert now.volume == pytest.approx(before.volume)


def test_delaunay_faces_stay():
    vertices, faces = icosphere(2)
    np.testing.assert_array_equal(flipped(vertices, faces), faces)


def test_field_of_a_ball_is_the_distance():
    ball = Solid([part(np.zeros(3), np.zeros(3), (0.5, 0.5), 0.1)])
    points = np.array([[1.0, 0, 0], [0, 0.25, 0], [0, 0.3, 0.4]])
    np.testing.assert_allclose(ball.field(points), [[0.5, 0.5], [-0.25, 0.5], [0, 0.5]], atol=1e-15)
    value, slope = ball.gradient(points)
    np.testing.assert_allclose(value, [0.5, -0.25, 0], atol=1e-9)
    # four differences of step 1e-5 have an error of first order
    np.testing.assert_allclose(slope, [[1, 0, 0], [0, 1, 0], [0, 0.6, 0.8]], atol=2e-5)
    near = np.array([[0, 0.45, 0], [0.4, 0.4, 0]])
    np.testing.assert_allclose(np.linalg.norm(ball.project(near), axis=1), 0.5, atol=1e-9)


def test_tapered_and_flat_parts():
    cone = Solid([part(np.zeros(3), np.array([2.0, 0, 0]), (0.4, 0.2), 0.1)])
    np.testing.assert_allclose(cone.field(np.array([[1.0, 1.0, 0]])), [[0.7, 0.3]])
    flat = Solid([part(np.zeros(3), np.zeros(3), (1.0, 1.0), 0.1, (0, 0, 1.0))])
    np.testing.assert_allclose(flat.field(np.array([[0, 0, 0.5], [0, 1.0, 0]]))[:, 0], 0, atol=1e-15)


def test_union_is_at_most_the_minimum_and_blends_by_a_quarter():
    left, right = (part(np.array([x, 0, 0]), np.array([x, 0, 0]), (0.5, 0.5), 0.2) for x in (-1.0, 1.0))
    value = Solid([left, right]).field(np.zeros((1, 3)))[0, 0]
    assert value == pytest.approx(0.5 - 0.2 / 4)
    far = np.array([[3.0, 0, 0]])
    assert Solid([left, right]).field(far)[0, 0] == pytest.approx(1.5)


def test_broken_parts_are_refused():
    with pytest.raises(InputError, match="finite numbers in parts"):
        Solid([part(np.zeros(3), np.zeros(3), (np.nan, 1.0), 0.1)])
