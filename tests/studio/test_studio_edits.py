"""Edits as values: regions, motions, mirrored handles; the same answer as the library's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import Arap, InputError, Mesh, Roi, RoiEditor
from morphlet.numerics.rotations import exponential
from morphlet.studio.edits import FREE, HANDLE, MIRRORED, PAINTED, Edit, Paint
from morphlet.studio.motion import Mirror, Motion
from studio.shapes import egg, top


def lifted(mesh: Mesh, motion: Motion) -> Edit:
    return replace(Edit.fresh(mesh.vertices).painted("handle", "set", np.array(top(mesh))), motion=motion)


def test_paint_is_exclusive_and_can_be_erased():
    edit = Edit.fresh(egg(1).vertices).painted("handle", "set", np.array([1, 2])).painted("anchor", "add", np.array([2, 3]))
    assert edit.own.tolist() == [1]
    assert np.flatnonzero(edit.paint == Paint.ANCHOR).tolist() == [2, 3]
    assert np.flatnonzero(edit.painted("anchor", "erase", np.array([1, 2])).paint).tolist() == [1, 3]
    assert edit.painted("handle", "set", np.array([7])).own.tolist() == [7]


def test_the_region_is_the_librarys():
    mesh = egg()
    roi = lifted(mesh, Motion()).region(mesh)
    expected = Roi.within(mesh, np.array(top(mesh)), 0.2 * mesh.bbox_diagonal)
    assert roi.free.tolist() == expected.free.tolist()


def test_painted_anchors_stop_the_region():
    mesh = egg()
    edit = replace(lifted(mesh, Motion()), radius=None)
    assert len(edit.region(mesh).anchors) == 0
    low = np.flatnonzero(mesh.vertices[:, 2] < 0)
    assert edit.painted("anchor", "set", low).region(mesh).anchors.tolist() == low.tolist()


def test_painted_free_vertices_join_the_region():
    mesh = egg()
    plain = lifted(mesh, Motion())
    further = np.setdiff1d(np.flatnonzero(mesh.vertices[:, 2] > 0.5), top(mesh))
    roi = plain.painted("free", "set", further).region(mesh)
    assert set(roi.free) == (set(plain.region(mesh).free) | set(further)) - set(roi.handle)


def test_without_a_handle_there_is_no_region():
    mesh = egg(1)
    with pytest.raises(InputError, match="needed a handle"):
        Edit.fresh(mesh.vertices).region(mesh)


def test_the_answer_is_the_librarys_bit_for_bit():
    mesh = egg()
    edit = lifted(mesh, Motion((0.1, 0.0, 0.4), (0.0, 0.0, 4.0), (1.2, 1.2, 1.2)))
    roi = edit.region(mesh)
    rest = mesh.vertices[roi.handle]
    targets = 1.2 * (rest - rest.mean(axis=0)) @ exponential(np.array([[0, 0, 4.0]]))[0].T + rest.mean(axis=0) + [0.1, 0, 0.4]
    expected = RoiEditor.prepare(roi, Arap()).solve(targets, np.array([[0.0, 0.0, 4.0]]))
    assert np.array_equal(edit.solved(mesh).shape, expected.vertices)


def test_a_still_edit_moves_nothing():
    mesh = egg(1)
    assert lifted(mesh, Motion()).solved(mesh).positions is None


def test_painting_the_handle_after_a_motion_begins_on_the_new_shape():
    mesh = egg()
    moved = lifted(mesh, Motion((0.0, 0.0, 0.3))).solved(mesh)
    again = moved.painted("handle", "add", np.array([0]))
    assert again.rest is moved.positions
    assert again.motion.still
    assert moved.painted("anchor", "add", np.array([0])).rest is moved.rest


@given(st.floats(-12, 12), st.floats(-12, 12), st.integers(0, 3))
def test_turns_add_up_beyond_full_circles(before, step, axis):
    direction = np.array([[1.0, 0, 0], [0, 1.0, 0], [0, 0, 1.0], [0.6, 0, -0.8]])[axis]
    step = np.clip(step, -3.1, 3.1)
    first = Motion(turn=tuple(before * direction))
    after = before + step
    rotate = (*(np.sin(after / 2) * direction), np.cos(after / 2))
    found = Motion.of({"translate": (0, 0, 0), "rotate": rotate, "scale": (1, 1, 1)}, first)
    assert np.allclose(found.turn, after * direction, atol=1e-7)


@given(st.lists(st.floats(-9, 9), min_size=3, max_size=3))
def test_a_page_is_told_the_same_rotation(turn):
    told = Motion(turn=tuple(turn)).told()
    assert np.linalg.norm(told["rotate"]) == pytest.approx(1)
    again = Motion.of(told, Motion(turn=tuple(turn)))
    assert np.allclose(again.turn, turn, atol=1e-6)


def test_a_mirrored_handle_moves_as_in_a_mirror():
    mesh = egg()
    side = np.flatnonzero((mesh.vertices[:, 1] > 0.9) & (mesh.vertices[:, 2] > 0.3))
    mirror = Mirror((0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    motion = Motion((0.1, 0.3, 0.0), (0.5, 0.0, 0.0), (1.0, 1.3, 1.0))
    edit = replace(Edit.fresh(mesh.vertices).painted("handle", "set", side), mirror=mirror, motion=motion)
    roi = edit.region(mesh)
    images = edit.images()
    assert len(images) == len(side)
    assert not set(images) & set(side)
    targets = edit.targets(roi)
    rows = np.searchsorted(roi.handle, side)
    assert np.allclose(targets[rows], motion(mesh.vertices[side], edit.center))
    there = np.searchsorted(roi.handle, images)
    mirrored = mirror(targets[there])
    back = mirror(mesh.vertices[images])
    assert np.allclose(mirrored, motion(back, edit.center))
    answer = edit.solved(mesh).shape
    order = np.argsort(np.linalg.norm(mirror(mesh.vertices)[:, None] - mesh.vertices[None], axis=2), axis=1)[:, 0]
    assert np.abs(mirror(answer) - answer[order]).max() < 0.02


def test_a_handle_on_the_plane_keeps_to_it():
    mesh = egg()
    edit = replace(lifted(mesh, Motion((0.0, 0.5, 0.2))), mirror=Mirror((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    roi = edit.region(mesh)
    middle = np.abs(mesh.vertices[roi.handle, 1]) < 1e-9
    both = np.isin(roi.handle, edit.own) & np.isin(roi.handle, edit.images())
    assert both[middle].all()
    assert np.allclose(edit.targets(roi)[middle, 1], 0)
    assert middle.any()


def test_roles_say_who_was_painted_and_who_is_mirrored():
    mesh = egg()
    side = np.flatnonzero((mesh.vertices[:, 1] > 0.9) & (mesh.vertices[:, 2] > 0.3))
    edit = replace(Edit.fresh(mesh.vertices).painted("handle", "set", side), mirror=Mirror((0.0, 0.0, 0.0), (0.0, 1.0, 0.0)))
    roles = edit.roles(edit.region(mesh))
    assert (roles[side] == HANDLE + PAINTED).all()
    assert (roles[edit.images()] == HANDLE + MIRRORED).all()
    assert set(roles) == {0, FREE, HANDLE + PAINTED, HANDLE + MIRRORED}
