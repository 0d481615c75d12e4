"""What must not change the map of a mesh: where the mesh is, how large, in what order, on how many threads."""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh
from morphlet.numerics.threads import limited
from morphlet.sphere import energy
from morphlet.sphere.embed import SphereOptions
from morphlet.sphere.map import SphericalMap, spherical_map
from support import assert_one_to_one, blob, icosphere, noisy, random_rotation

FIGURES = ("iso_mean", "iso_p99", "angle_mean_deg", "area_log_std", "symmetric_dirichlet")


@cache
def original() -> SphericalMap:
    return spherical_map(blob(3))


def up_to_rotation(points: np.ndarray, others: np.ndarray) -> float:
    """Largest distance after the best rotation of the first onto the second."""
    u, _, v = np.linalg.svd(others.T @ points)
    rotation = u @ np.diag([1, 1, np.linalg.det(u @ v)]) @ v
    return float(np.linalg.norm(points @ rotation.T - others, axis=1).max())


@settings(max_examples=5)
@given(st.integers(0, 1000), st.floats(1e-3, 1e3))
def test_rigid_motion_and_scale_leave_the_map_alone_up_to_a_rotation(seed: int, scale: float) -> None:
    mesh = blob(3)
    shift = np.random.default_rng(seed).normal(size=3)
    moved = spherical_map(mesh.with_vertices(scale * (mesh.vertices @ random_rotation(seed).T + shift)))
    # No two collapses of this body cost the same, so that rounding changes none. Newton then stops where an iteration gains less
    # than 1e-4: rounding of 1e-16 in the input is amplified by the condition of some 20 solves, not by the early stop.
    assert up_to_rotation(moved.points, original().points) < 1e-6
    for name in FIGURES:
        assert getattr(moved.quality(), name) == pytest.approx(getattr(original().quality(), name), rel=1e-5)


@settings(max_examples=5)
@given(st.integers(0, 1000))
def test_the_order_of_vertices_and_faces_hardly_changes_the_quality(seed: int) -> None:
    mesh, rng = blob(3), np.random.default_rng(seed)
    order = rng.permutation(mesh.n_vertices)
    vertices = np.empty_like(mesh.vertices)
    vertices[order] = mesh.vertices
    faces = order[mesh.faces][rng.permutation(mesh.n_faces)]
    turns = rng.integers(3, size=len(faces))
    faces = np.take_along_axis(faces, (turns[:, None] + np.arange(3)) % 3, axis=1)
    shuffled = spherical_map(Mesh(vertices, faces))
    assert_one_to_one(shuffled.points, faces)
    for name in FIGURES:  # sweeps visit vertices in another order and stop early: the same valley, not the same bits
        assert getattr(shuffled.quality(), name) == pytest.approx(getattr(original().quality(), name), rel=0.02)


@settings(max_examples=8)
@given(st.integers(0, 1000), st.floats(0, 0.6), st.integers(1, 3))
def test_every_star_shaped_body_is_mapped_one_to_one(seed: int, amount: float, level: int) -> None:
    mesh = noisy(level, amount, seed)
    assert_one_to_one(spherical_map(mesh).points, mesh.faces)


@settings(max_examples=8)
@given(st.integers(0, 1000))
def test_places_found_are_places_on_the_ray(seed: int) -> None:
    sphere = original()
    weights = np.random.default_rng(seed).dirichlet(np.ones(3), sphere.mesh.n_faces)
    x = np.einsum("kc,kcd->kd", weights, sphere.points[sphere.mesh.faces])
    found = sphere.locate(x)
    there = np.einsum("kc,kcd->kd", weights, sphere.mesh.vertices[sphere.mesh.faces])
    assert np.linalg.norm(found.positions(sphere.mesh) - there, axis=1).max() < 1e-10 * sphere.mesh.bbox_diagonal


@pytest.mark.parametrize("options", [SphereOptions(), SphereOptions(p=0.5)])
@pytest.mark.parametrize("level", [3, 5])
def test_the_same_mesh_gives_the_same_bits_on_any_number_of_threads(level: int, options: SphereOptions) -> None:
    mesh = blob(level)
    maps = []
    for count in (1, 2, 1):
        with limited(count):
            sphere = spherical_map(mesh, options)
            weights = sphere.locate(icosphere(4).vertices).weights
        maps.append((sphere.points, [step.objective for step in sphere.trace.steps], weights))
    for points, objectives, weights in maps[1:]:
        np.testing.assert_array_equal(points, maps[0][0])
        assert objectives == maps[0][1]
        np.testing.assert_array_equal(weights, maps[0][2])


@pytest.mark.parametrize("p", [1.0, 0.6])
@pytest.mark.parametrize("level", [4, 5])
def test_energies_and_steps_have_the_same_bits_on_any_number_of_threads(level: int, p: float) -> None:
    V, F = (np.array(a) for a in (icosphere(level).vertices, icosphere(level).faces))
    rng = np.random.default_rng(0)
    moved = V + 0.1 / 2**level * rng.normal(size=V.shape)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    metric, found = energy.reference(V, F, 1e-6), []
    for count in (1, 2, 3, 8):
        with limited(count):
            value = energy.value(moved, F, metric, energy.ISOMETRIC, 0.0, p, np.empty(len(F)))
            found.append((value, energy.largest_step(V, moved - 1.5 * V[::-1], F, 1.25)))
    assert len(set(found)) == 1
    assert np.isfinite(found[0][0])
