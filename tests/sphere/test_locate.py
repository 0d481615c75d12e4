"""Which face a direction falls in: vertices, edges, centres, sides that agree, the slow way and the fast one."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import support
from morphlet import InputError, Mesh
from morphlet.errors import SolveError
from morphlet.numerics.compiled import kernel
from morphlet.sphere import locate
from morphlet.sphere.locate import PARALLEL_FROM, Locator
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Topology
from support import blob, icosphere, noisy, positive_sphere, tetrahedron

EXACT = 1e-12
"""Gnomonic weights are good to a few roundings."""


@cache
def mapped() -> SphericalMap:
    """A lopsided body on the sphere."""
    return spherical_map(blob(3))


@cache
def wild() -> tuple[np.ndarray, np.ndarray]:
    """Points and faces of a sphere pushed about."""
    return positive_sphere(3)


def locator(points: np.ndarray, faces: np.ndarray) -> Locator:
    return Locator.prepare(points, Topology(faces, len(points)))


def directions(count: int, seed: int = 0) -> np.ndarray:
    x = np.random.default_rng(seed).normal(size=(count, 3))
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def on_rays(points: np.ndarray, faces: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Directions of the weighted means of the faces' corners."""
    x = np.einsum("kc,kcd->kd", weights, points[faces])
    return x / np.linalg.norm(x, axis=1, keepdims=True)


def test_every_vertex_finds_itself() -> None:
    sphere = mapped()
    found = sphere.locate(sphere.points)
    corner = np.argmax(found.weights, axis=1)
    np.testing.assert_array_equal(sphere.mesh.faces[found.faces, corner], np.arange(sphere.mesh.n_vertices))
    np.testing.assert_allclose(found.weights.max(axis=1), 1, atol=1e-9)
    error = np.linalg.norm(found.positions(sphere.mesh) - sphere.mesh.vertices, axis=1)
    assert error.max() < EXACT * sphere.mesh.bbox_diagonal


@pytest.mark.parametrize("count", [PARALLEL_FROM - 1, 3 * PARALLEL_FROM])
def test_weights_lie_on_the_ray(count: int) -> None:
    sphere, x = mapped(), directions(count)
    found = sphere.locate(17.0 * x)
    assert found.weights.min() >= 0
    np.testing.assert_allclose(found.weights.sum(axis=1), 1, atol=1e-15)
    assert np.abs(on_rays(sphere.points, sphere.mesh.faces[found.faces], found.weights) - x).max() < EXACT


def test_one_by_one_or_all_at_once_is_the_same() -> None:
    sphere, x = mapped(), directions(2 * PARALLEL_FROM)
    together = sphere.locate(x)
    for some in (slice(0, 40), slice(3999, 4000)):
        alone = sphere.locate(x[some])
        np.testing.assert_array_equal(alone.positions(sphere.mesh).round(12), together.positions(sphere.mesh)[some].round(12))


def test_centres_of_faces_and_middles_of_edges() -> None:
    points, faces = wild()
    search = locator(points, faces)
    found, weights = search.locate(on_rays(points, faces, np.full((len(faces), 3), 1 / 3)))
    np.testing.assert_array_equal(found, np.arange(len(faces)))
    np.testing.assert_allclose(weights, 1 / 3, atol=1e-10)
    edges = Topology(faces, len(points)).edges
    found, weights = search.locate(on_rays(points, edges, np.full((len(edges), 2), 0.5)))
    for edge, face, w in zip(edges, faces[found], weights, strict=True):
        assert set(edge) <= set(face)
        assert w[np.isin(face, edge)] == pytest.approx(0.5, abs=1e-10)


@kernel
def both_sides(points, i, j, q):  # an inner kernel has no door for Python
    return locate._side(points, i, j, q[0], q[1], q[2]), locate._side(points, j, i, q[0], q[1], q[2])


def test_both_sides_of_an_edge_agree_to_the_bit() -> None:
    points, faces = positive_sphere(2)
    x = directions(50)
    for i, j in Topology(faces, len(points)).edges[:100]:
        for q in x:
            one, other = both_sides(points, i, j, q)
            assert one == -other


@given(st.integers(0, 3000), st.floats(0, 1), st.integers(0, 60))
def test_points_at_rounding_distance_of_an_edge_lie_where_they_should(place: int, t: float, closeness: int) -> None:
    points, faces = wild()
    a, b, c = points[faces[place % len(faces)]]
    x = (1 - t) * a + t * b + 2.0**-closeness * 0.1 * (c - a)
    x /= np.linalg.norm(x)
    found, weights = locator(points, faces).locate(x[None])
    assert np.abs(on_rays(points, faces[found], weights) - x).max() < EXACT


@pytest.mark.parametrize("level", [0, 2, 3])
def test_the_slow_search_agrees_with_the_walk(level: int) -> None:
    points, faces = positive_sphere(level) if level else (np.array(icosphere(0).vertices), np.array(icosphere(0).faces))
    search, x = locator(points, faces), directions(60)
    fast, weights = search.locate(x)
    for query, face, w in zip(x, fast, weights, strict=True):
        slow, other = search._exhaustive(query)
        assert slow == face
        assert other == pytest.approx(w, abs=1e-9)
    slow, other = search._exhaustive(points[5])
    assert faces[slow, np.argmax(other)] == 5


def test_the_face_found_holds_its_direction_by_exact_signs() -> None:
    points, faces = wild()
    x = directions(400, seed=4)
    found, _ = locator(points, faces).locate(x)
    a, b, c = (points[faces[found, k]] for k in range(3))
    for p, q in ((a, b), (b, c), (c, a)):
        assert (support.determinant_signs(x, p, q) > 0).all()


def test_a_face_nearly_as_large_as_a_hemisphere_is_found_near_its_far_corner() -> None:
    angle = np.radians([0.0, 170.0, 190.0])
    rim = np.stack([np.cos(angle), np.sin(angle), np.full(3, 0.01)], axis=1)
    points = np.vstack([rim / np.linalg.norm(rim, axis=1, keepdims=True), [[0.0, 0.0, -1.0]]])
    faces = np.array([[0, 1, 2], [1, 0, 3], [2, 1, 3], [0, 2, 3]])
    assert (support.exact_signs(points, faces) > 0).all()
    x = on_rays(points, faces[:1], np.array([[0.98, 0.01, 0.01]]))
    assert x[0] @ points[faces[0]].sum(axis=0) < 0  # the middle of the face is more than a right angle away
    search = locator(points, faces)
    assert search.locate(x)[0].tolist() == [0]
    assert search._exhaustive(x[0])[0] == 0
    found, weights = search.locate(directions(500))
    assert np.abs(on_rays(points, faces[found], weights) - directions(500)).max() < EXACT


def test_a_search_among_folded_faces_says_so_rather_than_answering() -> None:
    points, faces = (np.array(a) for a in (icosphere(0).vertices, icosphere(0).faces))
    half = locator(points, faces)
    with pytest.raises(SolveError, match="covers the sphere; found no face around"):
        Locator(points, faces[:4].ravel(), half.twin, half.grid)._exhaustive(-points[faces[0]].mean(axis=0))


@pytest.mark.parametrize("n", [4, 12, 42, 162, 642, 2562])
def test_every_cell_of_the_grid_knows_a_face(n: int) -> None:
    ball = tetrahedron() if n == 4 else icosphere(round(np.log((n - 2) / 10) / np.log(4)))
    points = np.array(ball.vertices) - 0.25 if n == 4 else np.array(ball.vertices)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    search = locator(points, ball.faces)
    assert search.grid.min() >= 0
    assert search.grid.max() < len(ball.faces)


def test_a_crowded_map_with_most_cells_empty() -> None:
    points, faces = (np.array(a) for a in (icosphere(4).vertices, icosphere(4).faces))
    points[:, 2] += 0.999  # nearly all vertices end up around the north pole
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert (support.exact_signs(points, faces) > 0).all()
    x = directions(3000)
    found, weights = locator(points, faces).locate(x)
    assert np.abs(on_rays(points, faces[found], weights) - x).max() < EXACT


def test_filled_holes_answer_with_a_real_face() -> None:
    ball = noisy(3, 0.1)
    gone = np.flatnonzero(ball.vertices[ball.faces].mean(axis=1)[:, 2] > 0.8)
    disc = Mesh(ball.vertices, np.delete(ball.faces, gone, axis=0))
    sphere = spherical_map(disc)
    assert (sphere.surface.face_map < 0).any()
    virtual = np.flatnonzero(sphere.surface.face_map < 0)
    x = on_rays(sphere.closed_points, sphere.surface.mesh.faces[virtual], np.full((len(virtual), 3), 1 / 3))
    found = sphere.locate(np.vstack([x, directions(3000)]))
    assert found.faces.min() >= 0
    assert found.faces.max() < disc.n_faces
    closed = sphere.surface.mesh
    on_lid = closed.vertices[closed.faces[virtual]].mean(axis=1)
    gap = np.linalg.norm(found.positions(disc)[: len(x)] - on_lid, axis=1)
    rest = np.vstack([disc.vertices[disc.topology.referenced], disc.vertices[disc.faces].mean(axis=1)])
    assert (gap <= np.linalg.norm(on_lid[:, None] - rest, axis=2).min(axis=1) * (1 + 1e-6)).all()


def test_weights_follow_the_corners_of_the_file_where_faces_were_reversed() -> None:
    ball = blob(3)
    reverse = np.random.default_rng(2).random(ball.n_faces) < 0.3
    mixed = Mesh(ball.vertices, np.where(reverse[:, None], ball.faces[:, [0, 2, 1]], ball.faces))
    plain, mended = mapped(), spherical_map(mixed)
    assert mended.surface.flipped.sum() == reverse.sum()
    x = directions(500)
    one, other = plain.locate(x), mended.locate(x)
    np.testing.assert_allclose(one.positions(ball), other.positions(mixed), atol=1e-9)
    np.testing.assert_array_equal(one.faces, other.faces)
    np.testing.assert_allclose(np.where(reverse[one.faces][:, None], one.weights[:, [0, 2, 1]], one.weights), other.weights, atol=1e-9)
    found = mended.locate(mended.points)
    assert np.linalg.norm(found.positions(mixed) - mixed.vertices, axis=1).max() < EXACT * ball.bbox_diagonal


@pytest.mark.parametrize("bad", [[[0.0, 0.0, 0.0]], [[np.nan, 0.0, 1.0]], [[1.0, 2.0]]])
def test_directions_without_direction_are_refused(bad: list[list[float]]) -> None:
    with pytest.raises(InputError, match="directions"):
        mapped().locate(bad)


def test_no_directions_give_no_places() -> None:
    assert len(mapped().locate(np.empty((0, 3)))) == 0
