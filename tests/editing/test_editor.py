"""The editor: what it prepares it keeps, frame after frame and handle after handle."""

import numpy as np
import pytest

from editing.capped import capped, moved
from morphlet import InputError
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor, edit
from morphlet.editing.estimated import EstimatedRotations, handle_turns
from morphlet.editing.guard import Guarded
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.editing.shell import Shell
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


CHANGING = [EstimatedRotations(), Arap(200, 0.0), Shell(iterations=12, tolerance=0.0), Guarded(Shell(0.03))]
each_change = pytest.mark.parametrize("method", CHANGING, ids=["estimated", "arap", "shell", "guarded"])
BODY = capped(blob(4))


def base(editor: RoiEditor):
    """The factorization that an editor's factor was made from."""
    prepared = editor.prepared.shell if isinstance(editor.method, Guarded) else editor.prepared
    return prepared.base.base if isinstance(editor.method, Shell | Guarded) else prepared.system.base


def pulled(roi: Roi) -> np.ndarray:
    return moved(roi.mesh.vertices[roi.handle], [0.3, 0.1, 0], [0.1, 0, 0.02])


@each_change
@pytest.mark.parametrize("count", [1, 12])
def test_a_few_more_cost_no_factorization(method, count):
    """And answer what a fresh editor answers."""
    editor = RoiEditor.prepare(BODY, method)
    grown = editor.with_handle(larger(BODY, count))
    assert base(grown) is base(editor)
    fresh, found = edit(grown.roi, pulled(grown.roi), method), grown.solve(pulled(grown.roi))
    np.testing.assert_allclose(found.vertices, fresh.vertices, rtol=0, atol=1e-10)
    np.testing.assert_array_equal(found.vertices[grown.roi.handle], pulled(grown.roi))
    np.testing.assert_array_equal(found.vertices[grown.roi.anchors], BODY.mesh.vertices[grown.roi.anchors])


@each_change
def test_changes_do_not_depend_on_those_before(method):
    """Joined one by one, let go, joined at once: the same bits."""
    editor = RoiEditor.prepare(BODY, method)
    step = editor
    for count in (1, 2, 5, 3):
        step = step.with_handle(larger(BODY, count))
    once = editor.with_handle(larger(BODY, 3))
    np.testing.assert_array_equal(step.solve(pulled(step.roi)).vertices, once.solve(pulled(once.roi)).vertices)
    back = step.with_handle(BODY.handle)
    np.testing.assert_array_equal(back.solve(pulled(BODY)).vertices, editor.solve(pulled(BODY)).vertices)


@each_change
def test_many_more_are_factored_anew(method):
    """Further changes start there, and who leaves the handle then is factored anew."""
    editor = RoiEditor.prepare(BODY, method)
    many = editor.with_handle(larger(BODY, 400))
    assert base(many) is not base(editor)
    further = many.with_handle(larger(BODY, 403))
    assert base(further) is base(many)
    fewer = further.with_handle(larger(BODY, 60))
    for one in (further, fewer):
        fresh = edit(one.roi, pulled(one.roi), method)
        np.testing.assert_allclose(one.solve(pulled(one.roi)).vertices, fresh.vertices, rtol=0, atol=1e-10)


@pytest.mark.parametrize("method", CHANGING[:3], ids=["estimated", "arap", "shell"])
def test_firmer_holds_cost_no_factorization(method):
    """Softly held vertices join, are held more firmly, then exactly; softer than at first is factored anew."""
    soft = np.r_[np.full(len(BODY.handle), np.inf), np.full(20, 0.5)]
    editor, handle = RoiEditor.prepare(BODY, method), larger(BODY, 20)
    joined = editor.with_handle(handle, soft)
    firmer = joined.with_handle(handle, 4 * soft)
    firmest = firmer.with_handle(handle)
    start = RoiEditor.prepare(Roi(BODY.mesh, handle, joined.roi.free, soft), method)
    softer = start.with_handle(handle, soft / 4)
    assert [base(one) is base(editor) for one in (joined, firmer, firmest)] == [True] * 3
    assert base(start.with_handle(handle, 4 * soft)) is base(start)
    assert base(softer) is not base(start)
    for one in (joined, firmer, firmest, softer):
        fresh = edit(one.roi, pulled(one.roi), method)
        np.testing.assert_allclose(one.solve(pulled(one.roi)).vertices, fresh.vertices, rtol=0, atol=1e-10)
