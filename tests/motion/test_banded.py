"""Gradient paths with bands: all alike is the path without, ends, finer parts that turn with the shape, the volume."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Bands, Mesh, Morph, Schedule
from morphlet.motion.morph import edge_log_rms_max
from support import blob, icosphere, random_rotation

BODY = blob(3)
x, y, z = BODY.vertices.T
WAVES = 0.03 * np.stack([np.sin(17 * y), np.cos(19 * z), np.sin(23 * x)], axis=1)
BENT = BODY.vertices * [1.2, 0.9, 1.1] + 0.2 * np.sin(BODY.vertices @ np.random.default_rng(1).normal(size=(3, 3)))
ROUGH = BODY.with_vertices(BODY.vertices + WAVES)
BANDS = Bands([BODY.vertices, WAVES], [BENT, 0 * WAVES])


def path(t, schedule):
    return Morph(ROUGH, BENT, "gradient", BANDS, schedule)(t).vertices


@settings(max_examples=10)
@given(st.floats(0.001, 0.999))
def test_bands_that_move_alike_are_the_path_without(t):
    np.testing.assert_allclose(path(t, Schedule.together(2)), Morph(ROUGH, BENT, "gradient")(t).vertices, atol=1e-6)


@pytest.mark.parametrize("schedule", [Schedule.together(2), Schedule.coarse_first(2), Schedule.fine_first(2)])
def test_both_ends_are_met(schedule):
    assert path(0.0, schedule).tobytes() == ROUGH.vertices.tobytes()
    assert path(1.0, schedule).tobytes() == BENT.tobytes()
    np.testing.assert_allclose(path(1e-9, schedule), ROUGH.vertices, atol=1e-7)
    np.testing.assert_allclose(path(1 - 1e-9, schedule), BENT, atol=1e-7)


def test_fine_parts_turn_with_the_shape():
    quarter = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    bands = Bands([BODY.vertices, WAVES], [BODY.vertices @ quarter.T, 0 * WAVES])
    goal, still = BODY.vertices @ quarter.T, Schedule([0.0, 0.5], [0.5, 0.5], ("linear", "linear"))
    turning = Morph(ROUGH, goal, "gradient", bands, still)(0.5)  # the waves have not changed yet
    neighbours = BODY.topology.adjacency / np.asarray(BODY.topology.adjacency.sum(axis=1)).reshape(-1, 1)
    roughness = [np.linalg.norm(neighbours @ mesh.vertices - mesh.vertices) for mesh in (ROUGH, turning, BODY)]
    assert abs(roughness[1] / roughness[0] - 1) < 0.01 < 0.5 < abs(roughness[2] / roughness[0] - 1)


@pytest.mark.parametrize("seed", range(3))
def test_turned_shapes_have_turned_paths(seed):
    rotation, schedule = random_rotation(seed), Schedule.coarse_first(2)
    turned = Morph(
        ROUGH.with_vertices(ROUGH.vertices @ rotation.T), BENT @ rotation.T, "gradient",
        Bands(BANDS.source @ rotation.T, BANDS.target @ rotation.T), schedule,
    )  # fmt: skip
    np.testing.assert_allclose(turned(0.4).vertices, path(0.4, schedule) @ rotation.T, atol=1e-9)


def test_faces_without_area_and_lone_vertices_do_no_harm():
    more = Mesh(np.vstack([ROUGH.vertices, [[2, 0, 0]]]), np.vstack([ROUGH.faces, [[0, 0, 1], [5, 5, 5]]]))
    goal, schedule = np.vstack([BENT, [[2, 1, 0]]]), Schedule.coarse_first(2)
    bands = Bands([more.vertices, 0 * more.vertices], [goal, 0 * goal])
    assert np.isfinite(Morph(more, goal, "gradient", bands, schedule)(0.4).vertices).all()


def test_limbs_that_turn_do_not_shrink():
    ball = icosphere(3)
    longer = ball.with_vertices(ball.vertices * [1, 1, 4])
    angle = np.radians(60) * longer.vertices[:, 2] / 4
    bent = np.stack([longer.vertices[:, 0], *(
        np.cos(angle) * longer.vertices[:, 1] - np.sin(angle) * longer.vertices[:, 2],
        np.sin(angle) * longer.vertices[:, 1] + np.cos(angle) * longer.vertices[:, 2],
    )], axis=1)  # fmt: skip
    fine = 0.02 * np.sin(9 * ball.vertices)
    bands, ends = Bands([longer.vertices, fine], [bent, fine]), (longer.with_vertices(longer.vertices + fine), bent + fine)
    schedule = Schedule.coarse_first(2, 0.9)
    turning, straight = (edge_log_rms_max(Morph(*ends, name, bands, schedule).frames(5)) for name in ("gradient", "wavelet"))
    assert turning < straight / 3
