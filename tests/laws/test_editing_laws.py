"""What must hold for any edit: rest stays rest, the region's rim stays, rigid motions go through, the frame does not matter."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from editing.capped import capped, moved
from morphlet import Mesh
from morphlet.editing.arap import Arap
from morphlet.editing.editor import edit
from morphlet.editing.estimated import EstimatedRotations
from morphlet.editing.roi import Roi
from support import blob, random_rotation

SETTLED = 100
"""Iterations after which smoothed rotations, visited in an order that depends on the frame, agree to three digits."""
METHODS = [Arap(), EstimatedRotations(), Arap(smoothing=0.01), Arap(least_cotangent=0.05)]
each_method = pytest.mark.parametrize("method", METHODS, ids=["arap", "estimated", "smoothed", "clamped"])
numbers = st.floats(-1.5, 1.5)
vectors = st.lists(numbers, min_size=3, max_size=3)


def settled(method: Arap | EstimatedRotations) -> tuple[Arap | EstimatedRotations, float]:
    """The method with a fixed number of iterations, and how well answers then agree."""
    if isinstance(method, EstimatedRotations):
        return method, 1e-10
    iterations, exactly = (SETTLED, 3e-3) if method.smoothing else (12, 1e-4)
    return Arap(iterations, 0.0, method.anderson, method.smoothing, method.least_cotangent), exactly


@each_method
@pytest.mark.parametrize("weight", [None, 1.0])
def test_rest_stays_rest(method, weight):
    roi = capped(blob(2), weight=weight)
    found = edit(roi, roi.mesh.vertices[roi.handle], method)
    np.testing.assert_allclose(found.vertices, roi.mesh.vertices, atol=1e-12)


@each_method
@settings(max_examples=8)
@given(turn=vectors, shift=vectors)
def test_outside_the_region_nothing_moves(method, turn, shift):
    roi = capped(blob(2))
    found = edit(roi, moved(roi.mesh.vertices[roi.handle], turn, shift), method)
    np.testing.assert_array_equal(found.vertices[roi.anchors], roi.mesh.vertices[roi.anchors])
    assert np.isfinite(found.vertices).all()


@each_method
@settings(max_examples=8)
@given(turn=vectors, shift=vectors)
def test_rigid_motions_go_through(method, turn, shift):
    """All that is not free is handle, and moves like one body: so does the rest. Angles stay below a half turn."""
    held = capped(blob(2))
    roi = Roi(held.mesh, np.concatenate([held.handle, held.anchors]), held.free)
    turn = np.array(turn)
    whole = moved(held.mesh.vertices, turn * min(1.0, 3.0 / max(np.linalg.norm(turn), 1e-9)), shift)
    if isinstance(method, Arap):
        found = edit(roi, whole[roi.handle], Arap(300, 0.0, method.anderson, method.smoothing, method.least_cotangent))
    else:
        found = edit(roi, whole[roi.handle], method)
    # without Anderson's overshoot the iteration stops where the energy rounds: places are then known to the root of that
    np.testing.assert_allclose(found.vertices, whole, rtol=0, atol=3e-8 if getattr(method, "smoothing", 0) else 1e-9)


@each_method
@settings(max_examples=6)
@given(seed=st.integers(0, 1000), turn=vectors, shift=vectors)
def test_the_frame_does_not_matter(method, seed, turn, shift):
    """A turned and shifted mesh with turned and shifted targets gives the turned and shifted answer."""
    rotation, away = random_rotation(seed), np.array([3.0, -2.0, 5.0])
    mesh = blob(2)
    roi = capped(mesh)
    short = np.array(turn) * min(1.0, 2.5 / max(float(np.linalg.norm(turn)), 1e-9))
    targets = moved(mesh.vertices[roi.handle], short, shift)
    fixed, exactly = settled(method)
    there = Roi(mesh.with_vertices(mesh.vertices @ rotation.T + away), roi.handle, roi.free)
    expected = edit(roi, targets, fixed).vertices @ rotation.T + away
    np.testing.assert_allclose(edit(there, targets @ rotation.T + away, fixed).vertices, expected, atol=exactly)


@each_method
@settings(max_examples=6)
@given(seed=st.integers(0, 1000))
def test_numbers_of_vertices_do_not_matter(method, seed):
    mesh = blob(2)
    roi, new = capped(mesh), np.random.default_rng(seed).permutation(mesh.n_vertices)
    vertices = np.empty_like(mesh.vertices)
    vertices[new] = mesh.vertices
    other = Roi(Mesh(vertices, new[mesh.faces]), new[roi.handle], new[roi.free])
    targets = moved(mesh.vertices[roi.handle], [0.7, 0.3, 0.1], [0.2, 0.1, 0.0])
    fixed, exactly = settled(method)
    np.testing.assert_allclose(edit(other, targets, fixed).vertices[new], edit(roi, targets, fixed).vertices, atol=exactly)
