"""Relief and its likeness: known on a ball, the same for every pose in space, derivatives that lead downhill."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.stars import blob, radial_map
from morphlet import Mesh
from morphlet.mapping.relief import DIFFUSIONS, EASE, SCALES, SHARE, SPREAD, Likeness, relief
from morphlet.sphere import energy
from morphlet.sphere.energy import reference
from morphlet.sphere.level import Level
from support import icosphere, random_rotation

N = 642


def level_of(mesh: Mesh, S: np.ndarray) -> Level:
    faces = np.array(mesh.faces)
    return Level(np.array(mesh.vertices), faces, S, reference(np.array(mesh.vertices), faces, 1e-6))


def likeness(source: Mesh, target: Mesh) -> Likeness:
    return Likeness.prepare(source, 4 * np.pi * source.vertex_areas / source.area, radial_map(target))


def moved(S: np.ndarray, step: np.ndarray) -> np.ndarray:
    out = S + step
    return out / np.linalg.norm(out, axis=1, keepdims=True)


def under(target: Mesh, S: np.ndarray) -> np.ndarray:
    return radial_map(target).locate(S).faces


def test_a_ball_stands_out_evenly_by_what_smoothing_takes_from_it() -> None:
    """Coordinates are eigenfunctions: of eigenvalue 2 / R^2, with 4 pi R^2 = 1."""
    scale = np.array(SCALES)
    left = (1 + 8 * np.pi * scale**2 / (2 * DIFFUSIONS)) ** -DIFFUSIONS
    expected = (1 - left) / np.sqrt(4 * np.pi) / (scale * SPREAD)
    np.testing.assert_allclose(relief(icosphere(4)), np.tile(expected, (2562, 1)), rtol=0.1)  # the mesh is as coarse as the least scale


def test_bumps_stand_out_and_dents_do_not() -> None:
    ball = icosphere(4)
    top, side = (np.exp(-((1 - ball.vertices[:, axis]) / 0.01)) for axis in (2, 0))
    found = relief(ball.with_vertices(ball.vertices * (1 + 0.05 * top - 0.05 * side)[:, None]))
    far = found[ball.vertices @ [-1, 0, -1] > 1].mean(axis=0)
    assert (found[ball.vertices[:, 2].argmax()] > far + 0.5).all()
    assert (found[ball.vertices[:, 0].argmax()] < far - 0.5).all()


@settings(max_examples=5)
@given(st.integers(0, 1000), st.floats(0.01, 100))
def test_place_and_size_change_nothing(seed: int, size: float) -> None:
    mesh = blob(2)
    other = mesh.with_vertices(size * (mesh.vertices @ random_rotation(seed).T + 3))
    np.testing.assert_allclose(relief(other), relief(mesh), atol=1e-7)


def test_a_surface_without_area_is_flat() -> None:
    assert not relief(blob(1).with_vertices(blob(1).vertices * [1, 0, 0])).any()


def test_a_vertex_among_faces_without_area_has_a_relief() -> None:
    """Three faces at one place: all their weights are zero."""
    mesh = blob()
    corner = mesh.vertices[mesh.faces[0, 0]]
    spike = Mesh(
        np.vstack([mesh.vertices, corner[None]]),
        [*mesh.faces[1:], *([*edge, mesh.n_vertices] for edge in zip(mesh.faces[0], np.roll(mesh.faces[0], -1), strict=True))],
    )
    flat = spike.with_vertices(np.where(np.isin(np.arange(spike.n_vertices), mesh.faces[0])[:, None], corner, spike.vertices))
    assert np.isfinite(relief(flat)).all()


def test_what_falls_on_itself_costs_nothing_and_what_is_far_from_alike_not_much() -> None:
    S = np.array(radial_map(blob()).closed_points)
    assert likeness(blob(), blob()).value(S, under(blob(), S)) == pytest.approx(0, abs=1e-9)
    turned = S @ random_rotation(3).T
    alike = likeness(blob(), blob())
    near = alike.value(turned, under(blob(), turned))
    far = replace(alike, own=alike.own + 1000.0).value(turned, under(blob(), turned))
    assert 0.5 < near < far < 4 * np.pi * SHARE * EASE * np.log1p(3 * 1010.0**2 / EASE**2)  # three scales, and a little


def test_the_gradient_agrees_with_differences_and_the_hessian_stays_in_its_blocks() -> None:
    """On the average: the slope is smoothed, the value is not."""
    source, target = blob().with_vertices(blob().vertices * [1.1, 1, 0.9]), blob(4)
    S = np.array(radial_map(source).closed_points)
    alike, level = likeness(source, target), level_of(source, S)
    T = np.empty((N, 2, 3))
    energy.frames(S, T)
    gradient, hessian = np.zeros(2 * N), np.zeros(len(level._rows))
    alike.add((S, T), under(target, S), gradient, hessian, level.diagonal)
    blocks = level.matrix(hessian).toarray()
    assert np.count_nonzero(blocks) <= 4 * N
    assert np.linalg.eigvalsh(blocks).min() > -1e-12
    h, differences = 1e-3, np.empty(2 * N)
    for k in range(0, 2 * N, 7):
        step = np.zeros_like(S)
        step[k // 2] = h * T[k // 2, k % 2]
        up, down = (alike.value(moved(S, sign * step), under(target, moved(S, sign * step))) for sign in (1, -1))
        differences[k] = (up - down) / (2 * h)
    assert np.linalg.norm(differences[::7] - gradient[::7]) < 0.1 * np.linalg.norm(gradient[::7])


def test_a_step_leads_relief_towards_its_like() -> None:
    S = np.array(radial_map(blob()).closed_points)
    alike, level = likeness(blob(), blob()), level_of(blob(), S)
    off = moved(S, 0.02 * np.cross(S, [0.0, 0.6, 0.8]))
    T = np.empty((N, 2, 3))
    energy.frames(off, T)
    gradient, hessian = np.zeros(2 * N), np.zeros(len(level._rows))
    alike.add((off, T), under(blob(), off), gradient, hessian, level.diagonal)
    matrix = level.matrix(hessian).toarray() + 1e-3 * np.abs(hessian).max() * np.eye(2 * N)
    step = np.einsum("ne,ned->nd", -np.linalg.solve(matrix, gradient).reshape(-1, 2), T)
    after = moved(off, step)
    assert alike.value(after, under(blob(), after)) < 0.3 * alike.value(off, under(blob(), off))
    assert np.einsum("nd,nd->", step, S - off) > 0
