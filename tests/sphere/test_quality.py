"""The certificate against maps spoiled by hand, the distortion figures against triangles computed by hand."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.sphere.quality import certificate, isometric_distortion, measure, singular_values, solid_angles
from support import assert_one_to_one, blob, exact_degree, exact_signs, icosphere, noisy, positive_sphere, random_rotation, tetrahedron


def double_cover(meridians: int, rings: int) -> tuple[np.ndarray, np.ndarray]:
    """The sphere wound twice round its axis: every face is positive, every direction is covered twice."""
    turn = 4 * np.pi * np.arange(meridians) / meridians
    height = np.cos(np.pi * np.arange(1, rings + 1) / (rings + 1))
    radius = np.sqrt(1 - height**2)
    ring = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    points = np.concatenate([np.column_stack([r * ring, np.full(meridians, h)]) for r, h in zip(radius, height, strict=True)])
    north, south = len(points), len(points) + 1
    i, j = np.arange(meridians), (np.arange(meridians) + 1) % meridians
    faces = [np.stack([i, j, np.full(meridians, north)], 1)]
    for r in range(rings - 1):
        a, b, c, d = i + r * meridians, j + r * meridians, i + (r + 1) * meridians, j + (r + 1) * meridians
        faces += [np.stack([a, c, b], 1), np.stack([b, c, d], 1)]
    last = (rings - 1) * meridians
    faces.append(np.stack([j + last, i + last, np.full(meridians, south)], 1))
    return np.vstack([points, [[0, 0, 1], [0, 0, -1]]]), np.concatenate(faces)


def test_a_good_map_passes() -> None:
    points, faces = positive_sphere(3)
    found = certificate(points, faces)
    assert (found.negative, found.zero, found.holds) == (0, 0, True)
    assert found.degree == pytest.approx(1, abs=1e-12)
    assert_one_to_one(points, faces)


def test_one_face_flipped_by_hand_is_caught() -> None:
    points, faces = positive_sphere(3)
    bad = faces.copy()
    bad[17] = bad[17, [0, 2, 1]]
    found = certificate(points, bad)
    assert (found.negative, found.zero, found.holds) == (1, 0, False)


def test_a_vertex_pulled_over_an_edge_is_caught_though_the_degree_stays() -> None:
    points, faces = (np.array(a) for a in (icosphere(2).vertices, icosphere(2).faces))
    ring = np.unique(faces[(faces == 50).any(axis=1)])
    points[50] = points[ring].mean(axis=0) - 0.9 * (points[ring[0]] - points[50]) * 3
    points[50] /= np.linalg.norm(points[50])
    found = certificate(points, faces)
    assert found.negative == (exact_signs(points, faces) < 0).sum() > 0
    assert found.degree == pytest.approx(1, abs=1e-9)
    assert not found.holds


def test_a_face_without_area_is_caught() -> None:
    points, faces = (np.array(a) for a in (icosphere(1).vertices, icosphere(1).faces))
    points[faces[3, 0]] = points[faces[3, 1]]
    found = certificate(points, faces)
    assert found.zero == (exact_signs(points, faces) == 0).sum() == 2
    assert found.inverted == 2
    assert not found.holds


def test_corners_on_one_great_circle_are_caught() -> None:
    octahedron = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
    faces = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
    assert certificate(octahedron, faces).holds
    octahedron[4] = [0.6, 0.8, 0]  # the top comes down on the equator, on the edge 0-2
    found = certificate(octahedron, faces)
    assert found.zero == (exact_signs(octahedron, faces) == 0).sum() == 4
    assert not found.holds


@pytest.mark.parametrize(("meridians", "rings"), [(7, 1), (9, 3), (40, 11)])
def test_a_double_cover_is_caught_though_every_face_is_positive(meridians: int, rings: int) -> None:
    points, faces = double_cover(meridians, rings)
    found = certificate(points, faces)
    assert (exact_signs(points, faces) > 0).all()
    assert exact_degree(points, faces) == 2
    assert found.inverted == 0
    assert found.degree == pytest.approx(2, abs=1e-9)
    assert not found.holds


def test_a_mirrored_map_has_degree_minus_one() -> None:
    points, faces = positive_sphere(2)
    found = certificate(-points, faces)
    assert (found.negative, round(found.degree, 9), exact_degree(-points, faces)) == (320, -1, -1)


@given(st.integers(0, 10_000), st.floats(0, 0.5))
def test_signs_agree_with_integers_of_any_length(seed: int, amount: float) -> None:
    points, faces = (np.array(a) for a in (icosphere(1).vertices, icosphere(1).faces))
    points += amount * np.random.default_rng(seed).normal(size=points.shape)
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    found, signs = certificate(points, faces), exact_signs(points, faces)
    assert (found.negative, found.zero) == ((signs < 0).sum(), (signs == 0).sum())
    if not found.inverted:
        assert round(found.degree) == exact_degree(points, faces)


def test_solid_angles_by_hand() -> None:
    octant = np.eye(3)
    assert solid_angles(octant, np.array([[0, 1, 2]])) == pytest.approx(np.pi / 2, rel=1e-15)
    assert solid_angles(octant, np.array([[0, 2, 1]])) == pytest.approx(-np.pi / 2, rel=1e-15)
    angles = solid_angles(*(np.array(a) for a in (icosphere(0).vertices, icosphere(0).faces)))
    assert angles == pytest.approx(4 * np.pi / 20, rel=1e-14)


def one_triangle(shape: list[list[float]], image: list[list[float]]) -> tuple[float, float]:
    """Singular values of a lone triangle's map, without the scaling to area 4 pi."""
    mesh = Mesh(shape, [[0, 1, 2]])
    scale = np.sqrt(4 * np.pi / mesh.area)
    s1, s2, shaped = singular_values(mesh, np.array(image, float))
    assert shaped.all()
    return float(s1[0] * scale), float(s2[0] * scale)


def test_singular_values_by_hand() -> None:
    right = [[0.0, 0, 0], [1, 0, 0], [0, 1, 0]]
    assert one_triangle(right, [[0, 0, 0], [3, 0, 0], [0, 2, 0]]) == pytest.approx((3, 2), rel=1e-12)
    assert one_triangle(right, [[5, 5, 5], [5, 5, 6], [5, 6, 5]]) == pytest.approx((1, 1), rel=1e-7)
    golden = (1 + np.sqrt(5)) / 2  # singular values of the shear [[1, 1], [0, 1]]
    assert one_triangle(right, [[0, 0, 0], [1, 0, 0], [1, 1, 0]]) == pytest.approx((golden, 1 / golden), rel=1e-12)


@given(st.integers(0, 10_000))
def test_singular_values_are_those_of_the_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    J = rng.normal(size=(2, 2))
    shape = rng.normal(size=(3, 2))
    if abs(np.linalg.det(J)) < 1e-3 or abs(np.linalg.det(shape[1:] - shape[0])) < 1e-3:
        return
    image = shape @ J.T
    turn, other = random_rotation(seed), random_rotation(seed + 1)
    flat = np.column_stack([shape, np.ones(3)]) @ turn.T
    assert one_triangle(flat, np.column_stack([image, np.zeros(3)]) @ other.T) == pytest.approx(np.linalg.svd(J)[1], rel=1e-6)


def test_a_sphere_on_itself_is_nearly_an_isometry() -> None:
    ball = icosphere(4)
    found = measure(ball, np.array(ball.vertices), certificate(ball.vertices, ball.faces))
    assert (found.inverted, found.degenerate) == (0, 0)
    for value in (found.iso_mean, found.iso_p99, found.iso_max, found.symmetric_dirichlet):
        assert value == pytest.approx(1, abs=2e-3)
    assert found.angle_mean_deg == pytest.approx(0, abs=1e-9)
    assert found.area_log_std < 1e-3


def test_figures_do_not_depend_on_scale_place_or_turn() -> None:
    mesh, (points, faces) = blob(2), positive_sphere(2)
    moved = mesh.with_vertices(1e-7 * mesh.vertices @ random_rotation(3).T + 2e-6)
    one, other = (measure(m, p, certificate(p, faces)) for m, p in ((mesh, points), (moved, points @ random_rotation(5).T)))
    for name in ("iso_mean", "iso_p99", "iso_max", "angle_mean_deg", "area_log_std", "symmetric_dirichlet"):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-7)


def test_the_figures_are_the_definitions() -> None:
    mesh, (points, faces) = blob(2), positive_sphere(2)
    found = measure(mesh, points, certificate(points, faces))
    s1, s2, _ = singular_values(mesh, points)
    share = mesh.face_areas / mesh.area
    np.testing.assert_array_equal(isometric_distortion(mesh, points), np.maximum(s1, 1 / s2))
    assert found.iso_mean == pytest.approx(np.maximum(s1, 1 / s2).mean(), rel=1e-12)
    assert found.symmetric_dirichlet == pytest.approx(share @ ((s1**2 + s2**2 + s1**-2 + s2**-2) / 4), rel=1e-12)
    ratio = np.log(solid_angles(points, faces) / share)
    spread = np.sqrt(np.average((ratio - np.average(ratio, weights=share)) ** 2, weights=share))
    assert found.area_log_std == pytest.approx(spread, rel=1e-9)
    assert (s1 >= s2).all()


def test_faces_without_shape_are_counted_and_left_out() -> None:
    mesh = noisy(1, 0.2)
    vertices = np.array(mesh.vertices)
    vertices[mesh.faces[0, 0]] = vertices[mesh.faces[0, 1]]
    flat = mesh.with_vertices(vertices)
    points = np.array(icosphere(1).vertices)
    found = measure(flat, points, certificate(points, flat.faces))
    assert found.degenerate == 2
    assert np.isfinite(found.iso_max)
    assert np.isnan(isometric_distortion(flat, points)).sum() == 2
    nothing = measure(mesh.with_vertices(np.zeros_like(vertices)), points, certificate(points, mesh.faces))
    assert nothing.degenerate == 80
    assert np.isnan(nothing.iso_mean)


def test_a_tetrahedron_has_four_equal_angles() -> None:
    mesh = tetrahedron()
    points = np.array([[-1.0, -1, -1], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    points /= np.linalg.norm(points, axis=1, keepdims=True)
    assert certificate(points, mesh.faces).holds
    assert solid_angles(points, mesh.faces).sum() == pytest.approx(4 * np.pi, rel=1e-14)
