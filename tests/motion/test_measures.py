"""Measures by hand, between key frames, and what they refuse."""

import pickle

import numpy as np
import pytest

from morphlet import Measures, Mesh, MeshSequence, Morph, measure
from morphlet.errors import InputError
from morphlet.motion.morph import edge_log_rms_max, self_intersections_max, volume_change_max
from support import blob, tetrahedron

BODY = blob(2)
TARGET = BODY.vertices * [-1, -1, 1] + 0.1 * np.sin(4 * BODY.vertices)


def test_measures_by_hand():
    corner = tetrahedron()
    double = MeshSequence(corner.topology, np.stack([k * corner.vertices for k in (1, 3, 4)]), [0.0, 1.0, 2.0])
    found = measure(double)
    np.testing.assert_allclose(found.volume_change, [0, 100 * (27 / 32.5 - 1), 0], atol=1e-12)
    for values in (found.edge_log_rms, found.edge_log_p95, found.edge_log_p99):
        np.testing.assert_allclose(values, [0, np.log(3 / 2.5), 0], atol=1e-12)
    np.testing.assert_allclose(found.mse_source, [0, 3, 27 / 4], atol=1e-12)
    np.testing.assert_allclose(found.mse_target, [27 / 4, 3 / 4, 0], atol=1e-12)
    assert found.self_intersections.tolist() == [0, 0, 0]
    assert len(found) == 3
    assert found.rows()[1]["times"] == 1.0


def test_the_worst_frames_are_those_of_the_figures():
    frames = Morph(BODY, TARGET).frames(7)
    found = measure(frames)
    assert np.abs(found.volume_change).max() == pytest.approx(abs(volume_change_max(frames)))
    assert found.edge_log_rms.max() == pytest.approx(edge_log_rms_max(frames))
    assert found.self_intersections.max() == self_intersections_max(frames)
    assert (found.edge_log_rms <= found.edge_log_p99).all()
    assert (found.edge_log_p95 <= found.edge_log_p99).all()
    assert (np.diff(found.mse_source) > 0).all()
    assert (np.diff(found.mse_target) < 0).all()


def test_every_frame_may_be_a_key():
    found = measure(Morph(BODY, TARGET).frames(4), [0, 1, 2, 3])
    np.testing.assert_allclose(found.volume_change, 0, atol=1e-9)
    np.testing.assert_allclose(found.edge_log_p99, 0, atol=1e-12)


def test_frames_without_measurable_edges():
    points = Mesh(BODY.vertices, np.zeros((0, 3), int))
    found = measure(Morph(points, 2 * points.vertices).frames(3))
    assert found.edge_log_rms.tolist() == found.edge_log_p95.tolist() == [0.0, 0.0, 0.0]
    flat = Mesh([[0, 0, 0], [0, 0, 0], [1, 0, 0]], [[0, 1, 2]])
    assert np.isfinite(measure(Morph(flat, 2 * flat.vertices).frames(3)).edge_log_rms).all()


def test_too_few_frames_and_bad_keys_are_refused():
    frames = Morph(BODY, TARGET).frames(4)
    with pytest.raises(InputError, match="at least 2 frames; found 1"):
        measure(MeshSequence(frames.topology, frames.positions[:1], [0.0]))
    for keys in ([0, 2], [1, 3], [0, 2, 2, 3], [3, 0]):
        with pytest.raises(InputError, match="ascending keys from 0 to 3"):
            measure(frames, keys)
    with pytest.raises(InputError, match="keys"):
        measure(frames, [0, 4])


def test_measures_survive_pickling():
    found = measure(Morph(BODY, TARGET).frames(3))
    copy = pickle.loads(pickle.dumps(found))
    assert isinstance(copy, Measures)
    assert copy.rows() == found.rows()
