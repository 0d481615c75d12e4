"""Multiresolution: the base is smooth, details come back turned, nothing changes where nothing moves."""

import numpy as np
import pytest

from morphlet import Mesh, metrics
from morphlet.editing.detail import Multiresolution
from morphlet.editing.estimated import EstimatedRotations
from morphlet.editing.linear import Laplacian
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.surface.operators import laplacian
from support import icosphere, random_rotation

ROUGH = icosphere(3).with_vertices(icosphere(3).vertices * (1 + 0.02 * np.random.default_rng(0).normal(size=(642, 1))))


def region(mesh):
    z = mesh.vertices[:, 2]
    return Roi(mesh, np.nonzero(z > 0.8)[0], np.nonzero(abs(z) <= 0.8)[0])


ROI = region(ROUGH)


def bumpiness(mesh, roi):
    return np.linalg.norm((laplacian(mesh) @ mesh.vertices)[roi.free], axis=1).mean()


def test_it_is_a_method():
    assert isinstance(Multiresolution(Laplacian()), Method)
    assert isinstance(Multiresolution(Laplacian()).prepare(ROI), Prepared)


@pytest.mark.parametrize("smoothing", [0.5, 3.0, 20.0])
@pytest.mark.parametrize("method", [Laplacian(1), Laplacian(2), EstimatedRotations()], ids=str)
def test_a_handle_that_stays_moves_nothing(method, smoothing):
    out = Multiresolution(method, smoothing).prepare(ROI)(Pull(ROUGH.vertices[ROI.handle]))
    np.testing.assert_allclose(out, ROUGH.vertices[ROI.moving], atol=1e-11)


def test_the_base_gets_smoother():
    rough = [bumpiness(Multiresolution(Laplacian(), width).prepare(ROI).base.mesh, ROI) for width in (0.1, 1.0, 5.0)]
    assert bumpiness(ROUGH, ROI) > rough[0] > 1.5 * rough[1] > 1.5 * rough[2]


def test_anchors_and_handle_are_no_base():
    base = Multiresolution(Laplacian(), 5.0).prepare(ROI).base
    for part in (ROI.handle, ROI.anchors):
        np.testing.assert_array_equal(base.mesh.vertices[part], ROUGH.vertices[part])


def test_details_turn_with_the_handle():
    """Without anchors the base turns as a whole, and so do its details."""
    roi = Roi(ROUGH, ROI.handle, np.setdiff1d(np.arange(642), ROI.handle))
    turn = random_rotation(5)
    out = Multiresolution(EstimatedRotations(), 2.0).prepare(roi)(Pull(ROUGH.vertices[roi.handle] @ turn.T + 3))
    np.testing.assert_allclose(out, ROUGH.vertices @ turn.T + 3, atol=1e-9)


def bent_pipe():
    """A pipe with bumps, and its end on an arc of 90 degrees."""
    rings, sides = 61, 24
    z, turn = np.repeat(np.linspace(0, 6, rings), sides), np.tile(2 * np.pi * np.arange(sides) / sides, rings)
    a = (np.arange(rings - 1)[:, None] * sides + np.arange(sides)).ravel()
    b = (np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides).ravel()
    faces = np.vstack([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])
    radius = 0.8 * (1 + 0.06 * np.sin(6 * turn) * np.sin(2 * np.pi * z / 0.8))
    mesh = Mesh(np.stack([radius * np.cos(turn), radius * np.sin(turn), z], 1), faces)
    roi = Roi(mesh, np.nonzero(z > 5.6)[0], np.nonzero((z >= 0.35) & (z <= 5.6))[0])
    quarter, arc = np.array([[0, 0, 1.0], [0, 1, 0], [-1, 0, 0]]), 4.8 / (np.pi / 2)
    return roi, (mesh.vertices[roi.handle] - [0, 0, 5.6]) @ quarter.T + [arc, 0, 0.4 + arc]


@pytest.mark.parametrize(
    ("smoothed", "strained", "changed"), [(Multiresolution(Laplacian(2)), 0.97, 0.92), (Multiresolution(Laplacian(2), 2.0), 0.95, 0.9)]
)
def test_a_rough_pipe_bends_better_than_without(smoothed, strained, changed):
    roi, targets = bent_pipe()
    strain, error = [], []
    for method in (Laplacian(2), smoothed):
        whole = np.array(roi.mesh.vertices)
        whole[roi.moving] = method.prepare(roi)(Pull(targets))
        strain.append(metrics.edge_strain_rms(roi.mesh, roi.mesh.with_vertices(whole)))
        error.append(metrics.laplacian_error(roi.mesh, roi.mesh.with_vertices(whole)))
    assert strain[1] < strained * strain[0]
    assert error[1] < changed * error[0]


def test_nothing_free_is_no_base():
    roi = Roi(ROUGH, np.arange(642), [])
    np.testing.assert_array_equal(Multiresolution(Laplacian()).prepare(roi)(Pull(2 * ROUGH.vertices)), 2 * ROUGH.vertices)


def test_bad_options_are_refused():
    with pytest.raises(InputError, match="positive smoothing"):
        Multiresolution(Laplacian(), 0)
