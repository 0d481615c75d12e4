"""The Edit tab in a real browser: painted, dragged with the mouse, and equal to the library's answer."""

import numpy as np
import pytest

from morphlet import Laplacian, Roi, edit, sample
from morphlet.editing.arap import Arap
from support import beside, icosphere

SINGLE = 2e-6
"""Positions travel in single precision: its rounding, for coordinates up to some units."""


@pytest.fixture(scope="module")
def grazer():
    return sample("grazer", n_vertices=1500)


@pytest.fixture
def view(studio, window, grazer):
    opened = window(studio(grazer).url)
    opened.until(lambda: len(opened.positions()) == grazer.n_vertices and opened.way is not None)
    return opened


def nose(mesh):
    """The vertex farthest forward, on the left side: in sight from where the page looks at first."""
    return int(np.argmax(mesh.vertices @ [0.3, 0.2, 1.0]))


def library(mesh, state, handle, method):
    """What the library makes of what the page says."""
    told = state["edit"]["transform"]
    roi = Roi.within(mesh, handle, state["edit"]["radius"])
    targets = mesh.vertices[roi.handle] + np.array(told["translate"])
    return edit(roi, targets, method).vertices


def pulled(view, axis="y", far=70):
    """Take the gizmo's arrow and pull it."""
    view.page.keyboard.press("g")
    view.until(lambda: view.state["edit"]["ready"])
    view.page.wait_for_timeout(300)
    start = view.tip(axis)
    view.drag(start, (start[0], start[1] - far))
    view.until(lambda: view.state["history"]["undo"] == "drag")
    return view.settled()


def test_a_handle_is_painted_and_dragged_to_the_librarys_answer(view, grazer):
    rest = view.positions()
    handle = view.brush(nose(grazer))
    assert 3 < len(handle) < 200
    moved = pulled(view)
    assert view.state["edit"]["transform"]["translate"][1] > 0.1
    np.testing.assert_allclose(moved[handle] - rest[handle], view.state["edit"]["transform"]["translate"] + 0 * rest[handle], atol=SINGLE)
    np.testing.assert_allclose(moved, library(grazer, view.state, handle, Arap()), atol=SINGLE)
    anchors = view.roles() == 0
    assert anchors.sum() > 500
    np.testing.assert_array_equal(moved[anchors], rest[anchors])


def test_another_method_is_chosen_and_equals_the_librarys_too(view, grazer):
    handle = view.brush(nose(grazer))
    view.page.get_by_label("How the rest follows").select_option("biharmonic")
    view.until(lambda: view.state["edit"]["method"]["name"] == "biharmonic")
    moved = pulled(view)
    np.testing.assert_allclose(moved, library(grazer, view.state, handle, Laplacian(2)), atol=SINGLE)


def test_vertices_follow_while_the_hand_still_drags(view, grazer):
    rest = view.positions()
    handle = view.brush(nose(grazer))
    view.page.keyboard.press("g")
    view.page.wait_for_timeout(300)
    start = view.tip("y")
    view.hold(start, (start[0], start[1] - 60))
    view.until(lambda: np.abs(view.positions() - rest)[handle].max() > 0.05)
    assert view.state["drag"] is not None
    assert view.page.get_by_text("Dragging. Escape puts it back.").is_visible()
    view.page.keyboard.press("Escape")
    view.until(lambda: view.state["drag"] is None)
    view.page.mouse.up()
    np.testing.assert_array_equal(view.settled(), rest)


def test_undo_and_redo_by_keys_and_by_buttons(view, grazer):
    rest = view.positions()
    view.brush(nose(grazer))
    moved = pulled(view)
    view.page.keyboard.press("Control+z")
    view.until(lambda: view.state["history"]["redo"] == "drag")
    np.testing.assert_array_equal(view.settled(), rest)
    view.button("Redo").click()
    view.until(lambda: view.state["history"]["redo"] is None)
    np.testing.assert_array_equal(view.settled(), moved)
    view.button("Undo").click()
    view.button("Undo").click()
    view.until(lambda: view.state["edit"]["handle"]["count"] == 0)
    assert view.page.get_by_text("Paint the handle").is_visible()


def test_reset_puts_this_edit_back(view, grazer):
    rest = view.positions()
    view.brush(nose(grazer))
    pulled(view)
    view.button("Reset this edit").click()
    view.until(lambda: view.state["edit"]["transform"]["translate"] == [0, 0, 0])
    np.testing.assert_array_equal(view.settled(), rest)


def test_a_reload_loses_nothing(view, grazer):
    handle = view.brush(nose(grazer))
    moved = pulled(view)
    view.page.reload()
    view.until(lambda: view.told() is not None and len(view.positions()) == len(moved) and len(view.ask("roles('source')")) > 0)
    np.testing.assert_allclose(view.settled(), moved, atol=SINGLE)
    np.testing.assert_array_equal(view.handle(), handle)


def test_the_gizmo_turns_and_scales(view, grazer):
    view.brush(nose(grazer))
    for key, name in (("r", "rotate"), ("s", "scale")):
        view.page.keyboard.press(key)
        view.page.wait_for_timeout(300)
        x, y = view.tip("x")
        before = view.state["edit"]["transform"][name]
        view.drag((x, y), (x + 60, y + 5))
        view.until(lambda before=before, name=name: view.state["edit"]["transform"][name] != before)


def test_exact_numbers_move_the_handle_by_keys_alone(view, grazer):
    handle, rest = view.brush(nose(grazer)), view.positions()
    view.page.get_by_text("Exact move").click()
    view.page.get_by_label("Move y").fill("0.25")
    view.page.get_by_label("Move y").press("Enter")
    view.until(lambda: view.state["edit"]["transform"]["translate"] == [0, 0.25, 0])
    np.testing.assert_allclose(view.settled()[handle] - rest[handle], np.tile([0, 0.25, 0], (len(handle), 1)), atol=SINGLE)


def test_the_radius_is_seen_while_its_slider_moves(view, grazer):
    view.brush(nose(grazer))
    slider = view.page.get_by_label("Radius", exact=True)
    free = [int((view.roles() == 1).sum())]
    for _ in range(3):
        before = view.state["edit"]["free"]
        slider.evaluate("e => { e.value = e.valueAsNumber + 0.1; e.dispatchEvent(new Event('input', {bubbles: true})); }")
        view.until(lambda before=before: view.state["edit"]["free"] != before)
        view.until(lambda: (view.roles() == 1).sum() == view.state["edit"]["free"])
        free.append(view.state["edit"]["free"])
    assert free == sorted(set(free))
    assert view.state["history"]["undo"] == "paint handle"


def test_click_rectangle_and_lasso_choose_what_they_enclose(view, grazer):
    press = view.page.keyboard.press
    vertex = nose(grazer)
    press("c")
    before, (x, y) = view.state["revision"], view.pixel(vertex)
    view.page.mouse.click(x, y)
    view.until(lambda: view.state["revision"] > before and len(view.handle()) == 1)
    assert view.handle().tolist() == [vertex]
    inside = np.flatnonzero((np.abs(view.pixels() - (x, y)) <= 40).all(axis=1))
    seen = [k for k in inside if view.in_sight(int(k))]
    press("x")
    view.drag((x - 40, y - 40), (x + 40, y + 40))
    view.until(lambda: len(view.handle()) > 1)
    assert view.handle().tolist() == seen
    view.page.get_by_label("Rectangle and lasso go through").check()
    press("l")
    view.drag((x - 40, y - 40), (x + 40, y - 40), (x + 40, y + 40), (x - 40, y + 40))
    view.until(lambda: len(view.handle()) != len(seen))
    assert view.handle().tolist() == inside.tolist()
    assert len(inside) > len(seen)


def test_a_rectangle_leaves_what_stands_behind(studio, window):
    ball = icosphere(2)
    toward = np.array([np.sin(0.5) * np.cos(0.25), np.sin(0.25), np.cos(0.5) * np.cos(0.25)])  # where the page looks from at first
    behind = ball.with_vertices(0.7 * ball.vertices - 3 * toward)
    view = window(studio(beside(ball, behind)).url)
    view.until(lambda: len(view.positions()) == 2 * ball.n_vertices)
    view.page.keyboard.press("x")
    box = view.page.get_by_role("application", name="Mesh to edit").bounding_box()
    corners = (box["x"] + 90, box["y"] + 70), (box["x"] + box["width"] - 20, box["y"] + box["height"] - 90)
    view.drag(*corners)
    view.until(lambda: len(view.handle()) > 0)
    assert view.handle().max() < ball.n_vertices
    view.page.get_by_label("Rectangle and lasso go through").check()
    view.drag(*corners)
    view.until(lambda: len(view.handle()) > ball.n_vertices)


def test_shift_adds_alt_erases(view, grazer):
    first = view.brush(nose(grazer))
    chest = view.visible_near(*view.pixel(int(np.argmax(grazer.vertices @ [0.3, -0.6, 0.7]))))
    view.page.keyboard.down("Shift")
    both = view.brush(chest, along=(0, 0))
    view.page.keyboard.up("Shift")
    assert set(first) < set(both)
    view.page.keyboard.down("Alt")
    left = view.brush(chest, along=(0, 0))
    view.page.keyboard.up("Alt")
    assert set(left) <= set(first)


def test_enter_paints_in_the_middle_of_the_view(view):
    place = view.page.get_by_role("application", name="Mesh to edit")
    place.focus()
    for _ in range(4):
        place.press("ArrowRight")
    place.press("c")
    place.press("Enter")
    view.until(lambda: view.state["edit"]["handle"]["count"] == 1)


def test_symmetry_mirrors_the_handle(view, grazer):
    handle = view.brush(nose(grazer))
    left = view.visible_near(*view.pixel(int(np.argmax(grazer.vertices @ [1.0, 0.9, 0.4]))))
    handle = view.brush(left, along=(0, 0))
    view.page.get_by_role("group", name="Mirror the handle across").get_by_text("x", exact=True).click()
    view.until(lambda: view.state["edit"]["symmetry"] is not None and len(view.handle()) > len(handle))
    both = view.handle()
    assert len(both) == len(handle) + view.state["edit"]["handle"]["mirrored"]
    assert view.page.get_by_role("radio", name="x", exact=True).is_checked()
    assert set(handle) < set(both)
    assert grazer.vertices[handle, 0].mean() * grazer.vertices[np.setdiff1d(both, handle), 0].mean() < 0


def test_distortion_is_asked_for_and_told(view, grazer):
    view.brush(nose(grazer))
    pulled(view)
    view.page.get_by_label("Shading").select_option("distortion")
    view.until(lambda: view.state["display"]["distortion"])
    assert view.page.get_by_text("Stretch", exact=True).is_visible()


def test_what_prevents_a_drag_is_said(view):
    view.page.get_by_label("Rectangle and lasso go through").check()
    view.page.keyboard.press("x")
    box = view.page.get_by_role("application", name="Mesh to edit").bounding_box()
    view.drag((box["x"] + 90, box["y"] + 70), (box["x"] + box["width"] - 5, box["y"] + box["height"] - 80))
    view.until(lambda: view.state["edit"]["problem"] is not None and view.state["edit"]["handle"]["count"] > 0)
    assert view.page.get_by_role("status").filter(has_text=view.state["edit"]["problem"]["needed"]).is_visible()


def test_two_windows_see_one_session(view, window, grazer):
    twin = window(view.page.url)
    handle = view.brush(nose(grazer))
    twin.until(lambda: twin.handle().tolist() == handle.tolist())
    view.page.keyboard.press("g")
    view.page.wait_for_timeout(300)
    start = view.tip("y")
    view.hold(start, (start[0], start[1] - 50))
    twin.until(lambda: twin.state["drag"] is not None)
    assert twin.page.get_by_text("Another page is dragging the handle.").is_visible()
    view.page.mouse.up()
    view.until(lambda: view.state["history"]["undo"] == "drag")
    np.testing.assert_array_equal(twin.settled(), view.settled())
