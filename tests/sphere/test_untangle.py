"""The trust region of the paper: ratios of inverted triangles before and after, and no silent failure."""

import numpy as np
import pytest

from morphlet import InputError, Mesh, MeshError
from morphlet.errors import Cancelled
from morphlet.numerics.optimize import Step
from morphlet.sphere import untangle as module
from morphlet.sphere.quality import Certificate
from morphlet.sphere.untangle import UntangleOptions, untangle
from support import assert_one_to_one, blob, exact_signs, icosphere, noisy, tetrahedron, torus


def mildly_folded(level: int, seed: int = 0) -> tuple[Mesh, np.ndarray]:
    """A round body, and its directions with one vertex in ten pushed over its neighbours."""
    mesh = icosphere(level)
    start, rng = np.array(mesh.vertices), np.random.default_rng(seed)
    some = rng.choice(len(start), len(start) // 10, replace=False)
    start[some] += 1.6 / 2**level * rng.normal(size=(len(some), 3))
    return mesh, start


def tangled() -> tuple[Mesh, np.ndarray]:
    """Random directions: nothing that stage 1 can open."""
    return icosphere(2), np.random.default_rng(1).normal(size=(162, 3))


@pytest.mark.parametrize("seed", range(3))
def test_a_mildly_folded_start_is_opened_without_help(seed: int) -> None:
    mesh, start = mildly_folded(3, seed)
    found = untangle(mesh, start)
    unit = start / np.linalg.norm(start, axis=1, keepdims=True)
    assert found.inverted_before == pytest.approx(100 * (exact_signs(unit, mesh.faces) <= 0).mean())
    assert found.inverted_before > 1
    assert (found.inverted_after, found.fell_back) == (0, False)
    assert_one_to_one(found.map.points, mesh.faces)
    stages = [step.stage for step in found.map.trace.steps]
    assert stages == sorted(stages, reverse=True)  # untangle, then distortion
    assert set(stages) == {"untangle", "distortion"}


def test_a_fold_free_start_goes_straight_to_distortion() -> None:
    mesh = noisy(3, 0.2)
    found = untangle(mesh)
    assert (found.inverted_before, found.inverted_after, found.fell_back) == (0, 0, False)
    assert {step.stage for step in found.map.trace.steps} == {"distortion"}
    values = [step.objective for step in found.map.trace.steps if step.accepted]
    assert (np.diff(values) <= 0).all()
    assert values[-1] < 1.3
    assert_one_to_one(found.map.points, mesh.faces)


def test_a_hopeless_start_falls_back_and_says_so() -> None:
    mesh, start = tangled()
    found = untangle(mesh, start)
    assert found.fell_back
    assert found.inverted_before > 30
    assert found.inverted_after <= found.inverted_before
    assert_one_to_one(found.map.points, mesh.faces)


def test_a_double_cover_falls_back_though_no_face_is_inverted() -> None:
    meridians = 12
    turn = 2 * np.pi * np.arange(meridians) / meridians
    vertices = np.vstack([np.column_stack([np.cos(turn), np.sin(turn), 0 * turn]), [[0, 0, 1], [0, 0, -1]]])
    i, j = np.arange(meridians), (np.arange(meridians) + 1) % meridians
    faces = np.vstack([np.column_stack([i, j, np.full(meridians, meridians)]), np.column_stack([j, i, np.full(meridians, meridians + 1)])])
    twice = vertices.copy()
    twice[:meridians, 0], twice[:meridians, 1] = np.cos(2 * turn), np.sin(2 * turn)
    assert (exact_signs(twice, faces) > 0).all()
    found = untangle(Mesh(vertices, faces), twice)
    assert (found.inverted_before, found.inverted_after, found.fell_back) == (0, 0, True)
    assert_one_to_one(found.map.points, faces)


def test_rounding_that_spoils_stage_two_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    verdicts = iter([Certificate(0, 0, 0, 1.0), Certificate(0, 0, 0, 1.0), Certificate(1, 0, 1, 1.0)])
    monkeypatch.setattr(module, "certificate", lambda points, faces: next(verdicts))
    mesh = noisy(2, 0.1)
    found = untangle(mesh)
    assert found.fell_back
    assert_one_to_one(found.map.points, mesh.faces)


def test_balance_weighs_angles_against_areas() -> None:
    mesh = blob(3)
    angles, areas = (untangle(mesh, options=UntangleOptions(balance=b)).map.quality() for b in (0.02, 0.98))
    assert angles.angle_mean_deg < areas.angle_mean_deg
    assert angles.area_log_std > areas.area_log_std


def test_holes_and_stray_vertices_keep_the_start_of_their_own_vertices() -> None:
    ball = icosphere(3)
    keep = ball.vertices[ball.faces].mean(axis=1)[:, 2] < 0.7
    mesh = Mesh(ball.vertices, ball.faces[keep])
    start = np.array(ball.vertices)
    start[~mesh.topology.referenced] = [0, 0, -1]  # stray vertices have directions of their own, which must not count
    found = untangle(mesh, start)
    assert (found.inverted_before, found.fell_back) == (0, False)
    assert_one_to_one(found.map.closed_points, found.map.surface.mesh.faces)


def test_two_bodies_that_share_a_vertex_are_two() -> None:
    half = tetrahedron()
    other = np.where(half.faces == 0, 0, half.faces + 3)
    pinched = Mesh(np.vstack([half.vertices, half.vertices[1:] * -1]), np.vstack([half.faces, other]))
    with pytest.raises(MeshError, match="2 connected components"):
        untangle(pinched, pinched.vertices + 0.1)


@pytest.mark.parametrize("start", [np.ones((5, 3)), np.ones((1, 3)), np.zeros((4, 3)), np.full((4, 3), np.nan)])
def test_starts_that_do_not_fit_are_refused(start: np.ndarray) -> None:
    with pytest.raises(InputError, match="start"):
        untangle(tetrahedron(), start)


@pytest.mark.parametrize(("margin", "balance"), [(0.0, 0.5), (1.0, 0.5), (0.2, -0.1), (0.2, 1.1), (np.nan, 0.5)])
def test_options_outside_their_range_are_refused(margin: float, balance: float) -> None:
    with pytest.raises(InputError, match=r"margin in \(0, 1\) and balance in \[0, 1\]"):
        UntangleOptions(margin, balance)


def test_a_torus_is_refused() -> None:
    with pytest.raises(MeshError, match="genus 1"):
        untangle(torus())


def test_whoever_listens_may_stop_it() -> None:
    def stop(step: Step) -> None:
        raise Cancelled

    with pytest.raises(Cancelled):
        untangle(noisy(2, 0.1), on_step=stop)


def test_a_tetrahedron_from_its_centroid() -> None:
    assert untangle(tetrahedron()).inverted_before == 0
