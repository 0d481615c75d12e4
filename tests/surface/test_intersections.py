"""Triangles that cross: known answers, the same answer in rational arithmetic, and what only touches."""

from fractions import Fraction
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.errors import InputError
from morphlet.surface.intersections import folds, self_intersections
from support import beside, icosphere, tetrahedron

FLOOR = [[0, 0, 0], [4, 0, 0], [0, 4, 0]]


def two(first, second):
    """A mesh of two triangles without a common vertex."""
    return Mesh(np.vstack([first, second]).astype(float), [[0, 1, 2], [3, 4, 5]])


def minus(p, q):
    return [x - y for x, y in zip(p, q, strict=True)]


def dot(p, q):
    return sum(x * y for x, y in zip(p, q, strict=True))


def cross(p, q):
    return [p[i - 2] * q[i - 1] - p[i - 1] * q[i - 2] for i in range(3)]


def pierced(p, q, triangle):
    """Where the segment p q passes through the inside or the border of the triangle, from one side of its plane to the other or on it."""
    a, b, c = triangle
    normal = cross(minus(b, a), minus(c, a))
    s, t = dot(normal, minus(p, a)), dot(normal, minus(q, a))
    if s == t or s * t > 0:
        return []
    share = s / (s - t)
    hit = [x + share * (y - x) for x, y in zip(p, q, strict=True)]
    sides = [dot(normal, cross(minus(v, u), minus(hit, u))) for u, v in ((a, b), (b, c), (c, a))]
    return [hit] if all(side >= 0 for side in sides) else []


def crosses(first, second):
    """By another way: two different points in which borders pierce the other triangle, and corners on both sides, in fractions."""
    for s, t in ((first, second), (second, first)):
        normal = cross(minus(t[1], t[0]), minus(t[2], t[0]))
        side = [dot(normal, minus(p, t[0])) for p in s]
        if not min(side) < 0 < max(side):
            return False
    hits = []
    for s, t in ((first, second), (second, first)):
        for i in range(3):
            hits += pierced(s[i], s[i - 2], t)
    return any(hit != hits[0] for hit in hits)


@pytest.mark.parametrize(
    ("other", "found"),
    [
        ([[1, 1, -1], [1, 1, 1], [1, 5, 0]], True),  # through the inside
        ([[1, 1, -1], [1, 1, 1], [9, 9, 0]], True),  # out through an edge
        ([[-1, -1, -1], [-1, -1, 1], [9, 9, 0]], True),  # from corner to edge, right through
        ([[1, 1, 0], [1, 1, 1], [1, 2, 1]], False),  # a corner on the face
        ([[1, 1, 0], [2, 1, 0], [1, 2, 1]], False),  # an edge on the face
        ([[0, 0, 0], [4, 0, 0], [0, 0, 4]], False),  # along an edge, at the same places
        ([[-1, -1, -1], [-1, -1, 1], [0, 0, 0]], False),  # a corner at a corner
        ([[1, 1, 0], [9, 9, -1], [9, 9, 1]], True),  # a corner on the face, and through it
        ([[5, 5, -1], [5, 5, 1], [9, 9, 0]], False),  # beside it
        ([[1, 1, 1], [2, 1, 1], [1, 2, 1]], False),  # parallel
        ([[1, 1, 0], [2, 1, 0], [1, 2, 0]], True),  # in the plane, inside
        ([[0, 0, 0], [4, 0, 0], [0, 4, 0]], True),  # the same triangle
        ([[4, 4, 0], [4, 0, 0], [0, 4, 0]], False),  # in the plane, on the other side of an edge
        ([[2, 2, 0], [4, 4, 0], [2, 5, 0]], False),  # in the plane, a corner on an edge
        ([[3, 3, 0], [3, -1, 0], [-1, 3, 0]], True),  # in the plane, a star of two
        ([[1, 1, 0], [2, 2, 0], [3, 3, 0]], False),  # no triangle at all
    ],
)
def test_two_triangles_by_hand(other, found):
    for first, second in ((FLOOR, other), (other, FLOOR), (FLOOR[::-1], other), (other, np.roll(FLOOR, 1, axis=0)[::-1])):
        assert len(self_intersections(two(first, second))) == found


@settings(deadline=None, max_examples=150)
@given(st.integers(0, 10**6), st.sampled_from([2, 3, 5, 1000]))
def test_triangles_of_whole_numbers_agree_with_fractions(seed, size):
    """Small sizes make every kind of touching; triangles in one plane are told by hand above."""
    corners = np.random.default_rng(seed).integers(-size, size + 1, (2, 3, 3))
    first, second = [[[Fraction(int(x)) for x in p] for p in t] for t in corners]
    normal = cross(minus(second[1], second[0]), minus(second[2], second[0]))
    if any(dot(normal, minus(p, second[0])) for p in first):
        assert len(self_intersections(two(*corners))) == crosses(first, second)


@settings(deadline=None, max_examples=50)
@given(st.integers(0, 10**6))
def test_what_rounding_cannot_tell_is_told(seed):
    """The corner of one triangle is moved through the other's plane by single bits."""
    rng = np.random.default_rng(seed)
    first = rng.normal(size=(3, 3))
    weights = rng.dirichlet(np.ones(3), 2)
    low = rng.normal(size=3)
    for step in range(-2, 3):
        near = weights[0] @ first
        near[2] += step * np.spacing(near[2])
        second = np.stack([near, weights[1] @ first + [0, 0, 1e-17], low])
        exact = [[[Fraction(x) for x in p] for p in t] for t in (first, second)]
        assert len(self_intersections(two(first, second))) == crosses(*exact)


def test_two_balls_cross_along_a_circle():
    ball = icosphere(3)
    mesh = beside(ball, ball.with_vertices(ball.vertices + np.array([0.9, 0.11, 0.07])))
    pairs = self_intersections(mesh)
    assert len(pairs) > 100
    assert (pairs[:, 0] < ball.n_faces).all()
    assert (pairs[:, 1] >= ball.n_faces).all()
    middle = mesh.vertices[mesh.faces[pairs]].mean(axis=(1, 2))
    np.testing.assert_allclose(middle @ [0.9, 0.11, 0.07], 0.5 * (0.9**2 + 0.11**2 + 0.07**2), atol=0.1)
    np.testing.assert_array_equal(pairs, np.unique(pairs, axis=0))


def test_every_pair_is_found():
    rng = np.random.default_rng(2)
    soup = Mesh(rng.normal(size=(90, 3)), np.arange(90).reshape(30, 3))
    corners = [[[Fraction(x) for x in p] for p in t] for t in soup.vertices[soup.faces].tolist()]
    expected = [[i, j] for i, j in combinations(range(30), 2) if crosses(corners[i], corners[j])]
    assert len(expected) > 20
    assert self_intersections(soup).tolist() == expected


def test_some_faces_against_all():
    rng = np.random.default_rng(3)
    soup = Mesh(rng.normal(size=(300, 3)), np.arange(300).reshape(100, 3))
    chosen = np.array([7, 3, 50, 3])
    pairs = self_intersections(soup)
    np.testing.assert_array_equal(self_intersections(soup, chosen), pairs[np.isin(pairs, chosen).any(axis=1)])
    assert self_intersections(soup, []).shape == (0, 2)


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 10**6))
def test_order_of_faces_and_corners_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    points, faces = rng.normal(size=(60, 3)), np.arange(60).reshape(20, 3)
    order, turn = rng.permutation(20), rng.integers(0, 3, 20)
    other = Mesh(points, np.stack([np.roll(faces[f], t)[:: rng.choice([-1, 1])] for f, t in zip(order, turn, strict=True)]))
    there = np.sort(order[self_intersections(other)], axis=1)
    np.testing.assert_array_equal(np.unique(there, axis=0), self_intersections(Mesh(points, faces)))


def test_a_closed_convex_body_has_none():
    for mesh in (tetrahedron(), icosphere(2)):
        assert len(self_intersections(mesh)) == 0
        assert len(folds(mesh)) == 0


@pytest.mark.parametrize("tilt", [0, 0.37])
def test_a_flat_grid_has_none(tilt):
    x, y = np.meshgrid(np.arange(12.0), np.arange(12.0))
    corner = (np.arange(11)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.vstack([np.stack([corner, corner + 1, corner + 13], 1), np.stack([corner, corner + 13, corner + 12], 1)])
    grid = Mesh(np.stack([x.ravel(), y.ravel(), tilt * x.ravel()], 1), faces)
    assert len(self_intersections(grid)) == len(folds(grid)) == 0


def test_a_vertex_pushed_through_the_other_side():
    ball = icosphere(2)
    points = np.array(ball.vertices)
    points[0] *= -1.5
    pushed = ball.with_vertices(points)
    assert len(self_intersections(pushed)) > 0
    assert len(folds(pushed)) == 0
    assert (pushed.faces[self_intersections(pushed)] == 0).any(axis=(1, 2)).all()


def test_neighbours_that_cross_are_folds():
    leaf = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [1, 1, -1], [1, 1, 3], [2, 2, 0]], [[0, 1, 2], [0, 3, 4], [1, 5, 2]])
    assert folds(leaf).tolist() == [[0, 1]]
    assert len(self_intersections(leaf)) == 0
    flat = leaf.with_vertices([[0, 0, 0], [2, 0, 0], [0, 2, 0], [9, 9, 9], [9, 9, 8], [0.5, 0.5, 0]])
    assert folds(flat).tolist() == [[0, 2]]


def test_faces_that_are_not_there_are_refused():
    with pytest.raises(InputError, match="indices from 0 to 3 in faces"):
        self_intersections(tetrahedron(), [4])
    assert folds(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int))).shape == (0, 2)
