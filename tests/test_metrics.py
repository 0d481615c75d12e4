"""Distances between shapes: by hand, their invariances, and comparison across different triangles."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from morphlet import Mesh, metrics
from morphlet.errors import InputError, MeshError
from morphlet.numerics.unit_sphere import icosphere

BALL = Mesh(*icosphere(2))
TRIANGLE = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])


def test_equation_9_by_hand():
    a, b = [[0, 0, 0], [0, 0, 0]], [[1, 2, 2], [0, 0, 0]]
    assert metrics.mse(a, b) == 4.5  # (9 + 0) / 2: per vertex, not per coordinate
    assert metrics.rms(a, b) == pytest.approx(np.sqrt(4.5))


def test_psnr_by_hand():
    assert metrics.psnr(0.1, 10) == pytest.approx(40)
    assert metrics.psnr(0.0, 1.0) == float("inf")
    assert metrics.psnr(1.0, 0.0) == -float("inf")


def test_deformation_rate_by_hand():
    assert metrics.deformation_rate([[0, 0, 1], [0, 5, 0]], [[0, 0, 0], [0, 5, 0]]) == pytest.approx(10)
    assert metrics.deformation_rate([[1, 1, 1]], [[1, 1, 1]]) == 0
    assert np.isnan(metrics.deformation_rate([[1, 1, 1]], [[0, 1, 1]]))


@pytest.mark.parametrize("measure", [metrics.mse, metrics.rms, metrics.deformation_rate])
def test_different_or_empty_positions_are_refused(measure):
    with pytest.raises(InputError, match="reference of shape"):
        measure(np.zeros((3, 3)), np.zeros((4, 3)))
    with pytest.raises(InputError, match="at least one vertex"):
        measure(np.zeros((0, 3)), np.zeros((0, 3)))


def test_hausdorff_looks_both_ways():
    spike = Mesh([*TRIANGLE.vertices.tolist(), [0, 0, 5]], [[0, 1, 2], [0, 1, 3]])
    assert metrics.hausdorff(TRIANGLE, spike) == pytest.approx(5)
    assert metrics.hausdorff(spike, TRIANGLE) == pytest.approx(5)


def test_hausdorff_sees_face_centres():
    tent = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.7, 0.7, 0]], [[0, 1, 3], [1, 2, 3], [2, 0, 3]])
    outline = Mesh([[0, 0, 0], [2, 0, 0], [0, 2, 0], [0.7, 0.7, 0]], [[0, 0, 1], [1, 1, 2], [2, 2, 0]])
    assert metrics.hausdorff(tent, outline) > 0.4


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 1000), st.floats(0.01, 100))
def test_distances_move_and_scale_with_the_shapes(seed, scale):
    other = BALL.with_vertices(BALL.vertices * [1, 1.2, 0.9])
    turn = Rotation.random(random_state=seed).as_matrix()
    moved = [m.with_vertices(scale * m.vertices @ turn.T + 1) for m in (BALL, other)]
    for name, power in (("mse", 2), ("rms", 1), ("hausdorff", 1), ("volume_change", 0), ("edge_log_rms", 0)):
        assert metrics.compare(*moved)[name] == pytest.approx(scale**power * metrics.compare(BALL, other)[name], rel=1e-6, abs=1e-9)


@settings(deadline=None, max_examples=15)
@given(st.floats(0.5, 2))
def test_volume_and_edges_of_a_scaled_ball(scale):
    scaled = BALL.with_vertices(scale * BALL.vertices)
    assert metrics.volume_change(BALL, scaled) == pytest.approx(100 * (scale**3 - 1), abs=1e-9)
    assert metrics.edge_log_rms(BALL, scaled) == pytest.approx(abs(np.log(scale)), abs=1e-9)


def test_percentages_carry_their_sign():
    assert metrics.signed_percent(3, -2) == 250
    assert metrics.signed_percent(0, 0) == 0
    assert np.isnan(metrics.signed_percent(1, 0))


def test_edges_of_different_faces_are_refused():
    with pytest.raises(InputError, match="same faces"):
        metrics.edge_log_rms(TRIANGLE, BALL)


def test_equal_meshes_have_no_distance():
    figures = metrics.compare(BALL, BALL)
    assert {figures[k] for k in ("mse", "rms", "volume_change", "edge_log_rms")} == {0.0}
    assert figures["hausdorff"] == pytest.approx(0, abs=1e-12)
    assert figures["psnr"] is None


def test_other_triangles_are_compared_by_surface():
    finer = Mesh(*icosphere(4))
    figures = metrics.compare(finer, BALL)
    assert figures["edge_log_rms"] is None
    depth = 1 - np.linalg.norm(BALL.vertices[BALL.faces].mean(axis=1), axis=1).min()
    assert depth - 0.0012 < figures["hausdorff"] < depth  # the finer ball lies 0.0011 within the sphere itself
    assert 0 < figures["rms"] < depth
    assert figures["volume_change"] < 0


def test_moving_vertices_within_a_plane_is_no_distance_between_surfaces():
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    other = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0], [0.3, 0.6, 0]], [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]])
    assert metrics.compare(square, other)["hausdorff"] == pytest.approx(0, abs=1e-12)
    assert metrics.compare(square, other)["mse"] == pytest.approx(0, abs=1e-12)


def test_figures_are_plain_numbers():
    flat = metrics.compare(TRIANGLE, TRIANGLE.with_vertices(2 * TRIANGLE.vertices))
    json.dumps(flat, allow_nan=False)


def test_a_mesh_without_faces_is_refused():
    with pytest.raises(MeshError, match="mesh with faces"):
        metrics.compare(BALL, Mesh([[0, 0, 0]], np.zeros((0, 3), int)))


def test_strain_of_edges_by_hand():
    stretched = TRIANGLE.with_vertices([[0, 0, 0], [2, 0, 0], [0, 1, 0]])  # edges 1, 1, sqrt 2 become 2, 1, sqrt 5
    expected = 100 * np.sqrt((1 + (np.sqrt(2.5) - 1) ** 2) / 3)
    assert metrics.edge_strain_rms(TRIANGLE, stretched) == pytest.approx(expected)
    assert metrics.edge_strain_rms(Mesh(np.zeros((3, 3)), [[0, 1, 2]]), TRIANGLE) == 0


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 1000), st.floats(0.1, 10))
def test_editing_errors_do_not_see_motions_and_scale_with_size(seed, scale):
    turn = Rotation.random(random_state=seed).as_matrix()
    rest = BALL.with_vertices(BALL.vertices * np.random.default_rng(seed).uniform(0.8, 1.2, (BALL.n_vertices, 1)))
    moved = rest.with_vertices(rest.vertices @ turn.T + 3)
    scaled = rest.with_vertices(scale * moved.vertices)
    assert metrics.edge_strain_rms(rest, moved) == pytest.approx(0, abs=1e-9)
    assert metrics.laplacian_error(rest, moved) == pytest.approx(0, abs=1e-9)
    assert metrics.arap_energy(rest, moved) == pytest.approx(0, abs=1e-12)
    assert metrics.edge_strain_rms(rest, scaled) == pytest.approx(100 * abs(scale - 1), abs=1e-9)
    assert metrics.laplacian_error(rest, scaled) == pytest.approx(100 * abs(scale - 1), abs=1e-9)
    assert metrics.arap_energy(rest, scaled) == pytest.approx(2 * (scale - 1) ** 2, abs=1e-12)  # 2 A (s - 1)^2 per corner


def test_energy_counts_a_reflection():
    """The best rotation of a mirrored flat fan is a half turn; that of a body is none."""
    flat = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    assert metrics.arap_energy(flat, flat.with_vertices(flat.vertices * [1, -1, 1])) == pytest.approx(0, abs=1e-14)
    assert metrics.arap_energy(BALL, BALL.with_vertices(-BALL.vertices)) > 0.1


def test_energy_against_rotations_found_by_search():
    rng = np.random.default_rng(5)
    rest, deformed = Mesh(rng.normal(size=(4, 3)), [[0, 1, 2], [0, 2, 3]]), rng.normal(size=(4, 3))
    found = metrics.arap_energy(rest, rest.with_vertices(deformed))
    best = 0.0
    for v in range(4):
        faces = [f for f in rest.faces.tolist() if v in f]

        def energy(rotation, faces=faces):
            total = 0.0
            for f in faces:
                for k in range(3):
                    p, i, j = (rest.vertices[f[(k + m) % 3]] for m in range(3))
                    cotangent = (i - p) @ (j - p) / np.linalg.norm(np.cross(i - p, j - p))
                    e, g = i - j, deformed[f[(k + 1) % 3]] - deformed[f[(k + 2) % 3]]
                    total += 0.5 * cotangent * np.sum((g - rotation.apply(e)) ** 2) / 3
            return total

        starts = Rotation.random(6, random_state=0)
        best += min(minimize(lambda w, s=s: energy(Rotation.from_rotvec(w) * s), np.zeros(3)).fun for s in starts)
    assert found == pytest.approx(best / rest.area, rel=1e-6)


def test_laplacian_error_of_flat_shapes():
    fan = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], [[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 1]])
    nothing = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    assert metrics.laplacian_error(nothing, nothing) == 0
    bent = fan.with_vertices(fan.vertices + np.array([[0, 0, 1.0]] + 4 * [[0, 0, 0]]))
    assert metrics.laplacian_error(fan, bent) > 10


@pytest.mark.parametrize("measure", [metrics.edge_strain_rms, metrics.laplacian_error, metrics.arap_energy])
def test_editing_errors_need_the_same_faces(measure):
    with pytest.raises(InputError, match="same faces"):
        measure(TRIANGLE, BALL)


def test_energy_without_area_is_refused():
    point = Mesh(np.zeros((3, 3)), [[0, 1, 2]])
    with pytest.raises(MeshError, match="rest shape with area"):
        metrics.arap_energy(point, TRIANGLE)
