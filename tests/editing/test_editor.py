"""The editor: what it prepares it keeps, frame after frame and handle after handle."""

import numpy as np
import pytest

from editing.capped import capped, moved
from morphlet import InputError
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor, edit
from morphlet.editing.estimated import EstimatedRotations, handle_turns
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from support import blob

METHODS = [Arap(60, 0.0), EstimatedRotations(), Arap(30, 0.0, smoothing=0.001)]
each_method = pytest.mark.parametrize("method", METHODS, ids=["arap", "estimated", "smoothed"])


def path(roi: Roi, frames: int = 8) -> np.ndarray:
    rest = roi.mesh.vertices[roi.handle]
    return np.stack([moved(rest, [0.15 * k, 0, 0.05 * k], [0.05 * k, 0, 0.02 * k]) for k in range(1, frames + 1)])


@each_method
def test_methods_keep_the_contract(method):
    assert isinstance(method, Method)
    assert isinstance(method.prepare(capped(blob(1))), Prepared)


@each_method
def test_the_twin_agrees(method):
    roi = capped(blob(2))
    targets = path(roi)[-1]
    np.testing.assert_array_equal(edit(roi, targets, method).vertices, RoiEditor.prepare(roi, method).solve(targets).vertices)


@each_method
def test_an_editor_forgets_its_past(method):
    roi = capped(blob(2))
    editor = RoiEditor.prepare(roi, method)
    first = editor.solve(path(roi)[-1]).vertices
    editor.solve(path(roi)[0])
    np.testing.assert_array_equal(editor.solve(path(roi)[-1]).vertices, first)


@each_method
def test_positions_are_rows_of_the_mesh(method):
    roi = capped(blob(2))
    editor, targets = RoiEditor.prepare(roi, method), path(roi)[-1]
    np.testing.assert_array_equal(editor.positions(Pull(targets)), editor.solve(targets).vertices[roi.moving])
    np.testing.assert_array_equal(editor.solve(targets).vertices[roi.handle], targets)


def test_the_order_of_the_handle_is_the_callers():
    roi = capped(blob(2))
    turned = Roi(roi.mesh, roi.handle[::-1], roi.free)
    targets = path(roi)[-1]
    np.testing.assert_allclose(edit(turned, targets[::-1]).vertices, edit(roi, targets).vertices, atol=1e-9)


def test_a_sequence_is_one_pull_after_the_other():
    """Each frame starts from the last, moved on in the proportion of the handle's steps."""
    roi = capped(blob(2))
    editor, targets = RoiEditor.prepare(roi, Arap(3, 0.0)), path(roi)
    targets[5:] = targets[4] + 0.5 * (targets[4] - targets[3])
    sequence = editor.sequence(targets)
    assert (len(sequence), sequence.times.tolist()) == (8, list(range(8)))
    before, now, turns = roi.mesh.vertices, sequence.positions[0], handle_turns(roi, targets[0])
    np.testing.assert_array_equal(now, editor.solve(targets[0]).vertices)
    for number in range(1, 8):
        last, following = (now - before)[roi.handle], targets[number] - now[roi.handle]
        share = np.clip((last * following).sum() / max((last * last).sum(), 1e-300), -1, 1)
        turns = handle_turns(roi, targets[number], turns)
        expected = editor.solve(targets[number], turns, (now + share * (now - before))[roi.moving])
        np.testing.assert_allclose(sequence.positions[number], expected.vertices, atol=1e-12)
        before, now = now, sequence.positions[number]


def test_a_sequence_that_stands_still_settles():
    roi = capped(blob(2))
    targets = np.repeat(path(roi)[-1:], 12, axis=0)
    sequence = RoiEditor.prepare(roi, Arap(8, 0.0)).sequence(targets)
    exact = edit(roi, targets[0], Arap(300, 0.0))
    np.testing.assert_allclose(sequence.positions[-1], exact.vertices, atol=2e-3)


def test_an_empty_path():
    roi = capped(blob(1))
    assert len(RoiEditor.prepare(roi).sequence(np.zeros((0, len(roi.handle), 3)))) == 0


def test_a_path_that_does_not_fit():
    roi = capped(blob(1))
    with pytest.raises(InputError, match="path of shape"):
        RoiEditor.prepare(roi).sequence(np.zeros((3, 2, 3)))


def larger(roi: Roi, count: int) -> np.ndarray:
    """The handle, with the next lower free vertices."""
    order = roi.free[np.argsort(-roi.mesh.vertices[roi.free, 2], kind="stable")]
    return np.concatenate([roi.handle, order[:count]])


@each_method
@pytest.mark.parametrize("count", [1, 25])
def test_a_larger_handle_is_as_if_prepared_anew(method, count):
    """And costs no new patch, unless rotations are smoothed."""
    roi = capped(blob(2))
    editor = RoiEditor.prepare(roi, method)
    more = larger(roi, count)
    grown = editor.with_handle(more)
    assert (grown.prepared.system.patch is editor.prepared.system.patch) == (method is not METHODS[2])
    assert grown.roi.handle.tolist() == more.tolist()
    targets = moved(roi.mesh.vertices[more], [0.5, 0.2, 0], [0.2, 0, 0])
    fresh = edit(grown.roi, targets, method)
    np.testing.assert_allclose(grown.solve(targets).vertices, fresh.vertices, atol=1e-6)
    np.testing.assert_array_equal(grown.solve(targets).vertices[more], targets)


@pytest.mark.parametrize("method", METHODS[:2], ids=["arap", "estimated"])
def test_what_was_taken_may_be_let_go(method):
    roi = capped(blob(2))
    editor = RoiEditor.prepare(roi, method)
    back = editor.with_handle(larger(roi, 25)).with_handle(roi.handle)
    assert back.prepared.system.patch is editor.prepared.system.patch
    targets = path(roi)[-1]
    np.testing.assert_allclose(back.solve(targets).vertices, editor.solve(targets).vertices, atol=1e-9)


@each_method
def test_a_smaller_handle_is_prepared_anew(method):
    roi = capped(blob(2))
    editor = RoiEditor.prepare(roi, method).with_handle(roi.handle[:10])
    assert set(editor.roi.free) == set(roi.free) | set(roi.handle[10:])
    targets = path(roi)[-1][:10]
    np.testing.assert_array_equal(
        editor.solve(targets).vertices, edit(Roi(roi.mesh, roi.handle[:10], editor.roi.free), targets, method).vertices
    )


def test_handles_may_become_soft():
    roi = capped(blob(2), weight=1.0)
    editor = RoiEditor.prepare(roi)
    targets = path(roi)[-1]
    harder = editor.with_handle(roi.handle, np.full(len(roi.handle), 3.0))
    assert harder.prepared.system.patch is editor.prepared.system.patch
    expected = edit(Roi(roi.mesh, roi.handle, roi.free, np.full(len(roi.handle), 3.0)), targets)
    np.testing.assert_allclose(harder.solve(targets).vertices, expected.vertices, atol=1e-9)


def test_pinned_vertices_do_not_cut_pieces_loose():
    """A handle that fills the way between free vertices and anchors holds them itself."""
    roi = capped(blob(2))
    low = roi.free[np.argsort(roi.mesh.vertices[roi.free, 2], kind="stable")[:60]]
    editor = RoiEditor.prepare(roi).with_handle(np.concatenate([roi.handle, low]))
    assert np.isfinite(editor.solve(roi.mesh.vertices[editor.roi.handle]).vertices).all()
