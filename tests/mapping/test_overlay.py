"""The common refinement of two triangulations: both surfaces are met exactly by one connectivity."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.errors import SolveError
from morphlet.mapping.overlay import NUDGE, overlay
from morphlet.numerics.unit_sphere import icosphere, rotations_about
from morphlet.samples.creatures import blob
from morphlet.sphere.map import spherical_map

BALL, EGG = Mesh(*icosphere(2)), Mesh(*icosphere(1))
BALL_POINTS, EGG_POINTS = icosphere(2)[0], icosphere(1)[0]
turns = st.tuples(*[st.floats(-2, 2)] * 3)


def turned(points, turn):
    return points @ rotations_about(np.array([turn]))[0].T


@settings(max_examples=30)
@given(turns)
def test_both_surfaces_are_kept(turn):
    """Flat triangles cut into flat pieces: area and volume stay to rounding, which any wrong piece would spoil."""
    both = overlay(BALL, turned(BALL_POINTS, turn), EGG, EGG_POINTS)
    assert both.topology.euler_characteristic == 2
    assert both.topology.n_components == 1
    assert (both.topology.twins >= 0).all()
    for mesh, places in ((BALL, both.source_places), (EGG, both.target_places)):
        refined = Mesh(places.positions(mesh), both.topology)
        assert refined.area == pytest.approx(mesh.area, rel=1e-12)
        assert refined.volume == pytest.approx(mesh.volume, rel=1e-12)


@settings(max_examples=20)
@given(turns)
def test_places_on_both_meshes_lie_in_one_direction(turn):
    """Weights are gnomonic: both places are on one ray of the sphere."""
    both = overlay(BALL, turned(BALL_POINTS, turn), EGG, EGG_POINTS)
    rays = turned(both.source_places.positions(BALL), turn), both.target_places.positions(EGG)
    first, second = (ray / np.linalg.norm(ray, axis=1, keepdims=True) for ray in rays)
    assert np.abs(first - second).max() < 2 * NUDGE * 8  # 1e-14 unless the example needed small turns


def test_the_first_vertices_are_those_of_the_source_then_those_of_the_target():
    both = overlay(BALL, turned(BALL_POINTS, (0.3, 0.2, 0.1)), EGG, EGG_POINTS)
    n, k = BALL.n_vertices, EGG.n_vertices
    np.testing.assert_allclose(both.source_places.positions(BALL)[:n], BALL.vertices, atol=1e-15)
    np.testing.assert_allclose(both.target_places.positions(EGG)[n : n + k], EGG.vertices, atol=1e-15)


def test_each_face_lies_in_one_face_of_either_mesh():
    points = turned(BALL_POINTS, (0.3, 0.2, 0.1))
    both = overlay(BALL, points, EGG, EGG_POINTS)
    for places, mesh in ((both.source_places, Mesh(points, BALL.topology)), (both.target_places, EGG)):
        corners = places.positions(mesh)[both.topology.faces]
        middle = corners.mean(axis=1)
        walls = np.stack([np.cross(mesh.vertices[mesh.faces[:, c]], mesh.vertices[mesh.faces[:, (c + 1) % 3]]) for c in range(3)])
        around = np.argmax((np.einsum("cfk,xk->cfx", walls, middle) > 0).all(axis=0), axis=0)
        assert np.einsum("cxk,xvk->cxv", walls[:, around], corners).min() > -1e-12


@pytest.mark.parametrize("level", [0, 1, 2])
def test_a_mesh_over_itself_is_turned_a_little(level):
    points, faces = icosphere(level)
    mesh = Mesh(points, faces)
    both = overlay(mesh, points, mesh, points)
    shift = both.source_places.positions(mesh) - both.target_places.positions(mesh)
    assert 0 < np.abs(shift).max() < 10 * NUDGE
    assert both.topology.euler_characteristic == 2


def test_spherical_maps_of_blobs_have_a_common_refinement():
    maps = [spherical_map(blob(seed, n_vertices=1500)) for seed in (0, 1)]
    both = overlay(maps[0].mesh, maps[0].points, maps[1].mesh, maps[1].points)
    for mapped, places in zip(maps, (both.source_places, both.target_places), strict=True):
        refined = Mesh(places.positions(mapped.mesh), both.topology)
        assert refined.volume == pytest.approx(mapped.mesh.volume, rel=1e-10)


def test_folded_triangulations_are_refused():
    folded = BALL_POINTS.copy()
    folded[[0, 50]] = folded[[50, 0]]
    with pytest.raises(SolveError, match="needed two triangulations without folds"):
        overlay(BALL, folded, EGG, EGG_POINTS)
