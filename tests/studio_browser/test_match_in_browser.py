"""The Match and Morph tabs in a real browser: markers with the mouse, the correspondence and its cancel, the morph scrubbed."""

import numpy as np
import pytest

from morphlet import VertexPairs, correspond, sample
from morphlet.pipeline.morph import morph_along

SINGLE = 2e-6
"""Positions travel in single precision: its rounding, for coordinates up to some units."""
SMALL = 1500
AIM_PX = 12
"""A few edges of meshes so coarse."""


@pytest.fixture(scope="module")
def meshes():
    return sample("grazer", n_vertices=SMALL), sample("grazer-walking", n_vertices=SMALL)


@pytest.fixture
def view(studio, window, meshes):
    opened = window(studio(*meshes).url)
    opened.tab("Match")
    opened.until(lambda: len(opened.positions("target")) == SMALL)
    return opened


def marked(view, source, target):
    """Set a marker by two clicks."""
    count = len(view.state["markers"])
    view.page.mouse.click(*view.pixel(source))
    assert view.page.get_by_role("status").filter(has_text="Now click the same place on mesh B").is_visible()
    view.page.mouse.click(*view.pixel(target, "target"))
    view.until(lambda: len(view.state["markers"]) == count + 1)


def seen(view, *directions, slot="source"):
    """A vertex in sight, far out in each direction."""
    shape = view.positions(slot)
    return [view.visible_near(*view.pixels(slot)[int(np.argmax(shape @ direction))], slot) for direction in directions]


def beside(view, vertex, aimed, slot="source"):
    """Whether a vertex is where one aimed, or the next one."""
    return np.hypot(*np.subtract(view.pixel(vertex, slot), view.pixel(aimed, slot))) < AIM_PX


PLACES = ([0.2, 0.3, 1.0], [0.6, -1.0, 0.6], [0.9, -0.9, -0.6], [0.3, 1.0, 0.2])


def test_markers_are_added_dragged_and_removed(view, meshes):
    (nose, foot, *_), (nose_there, foot_there, *_) = seen(view, *PLACES), seen(view, *PLACES, slot="target")
    marked(view, nose, nose_there)
    marked(view, foot, foot_there)
    first, second = view.state["markers"]
    assert beside(view, first["source"], nose)
    assert beside(view, first["target"], nose_there, "target")
    assert beside(view, second["source"], foot)
    assert beside(view, second["target"], foot_there, "target")
    elsewhere = seen(view, [0.9, -0.9, -0.6], slot="target")[0]
    view.drag(view.pixel(second["target"], "target"), view.pixel(elsewhere, "target"))
    view.until(lambda: view.state["markers"][1]["target"] != second["target"])
    assert beside(view, view.state["markers"][1]["target"], elsewhere, "target")
    assert view.state["markers"][1]["source"] == second["source"]
    view.button("Remove Pair 1").press("Enter")
    view.until(lambda: len(view.state["markers"]) == 1)
    view.page.keyboard.press("Control+z")
    view.until(lambda: len(view.state["markers"]) == 2)
    view.button("Clear").click()
    view.until(lambda: view.state["markers"] == [])


def test_a_marker_is_given_a_name_by_keys(view, meshes):
    marked(view, seen(view, PLACES[0])[0], seen(view, PLACES[0], slot="target")[0])
    label = view.page.get_by_label("Label of pair 1")
    label.fill("nose")
    label.press("Tab")
    view.until(lambda: view.state["markers"][0]["label"] == "nose")
    view.button("Remove nose").wait_for()
    assert view.page.evaluate("document.activeElement.title") == "Remove nose"
    view.page.keyboard.press("Control+z")
    view.until(lambda: view.state["markers"][0]["label"] == "")
    view.until(lambda: label.input_value() == "")


def test_a_first_click_can_be_dropped(view):
    view.page.mouse.click(*view.pixel(seen(view, PLACES[0])[0]))
    assert "mesh B" in view.page.locator(".place:not([hidden]) .guide").inner_text()
    view.page.keyboard.press("Escape")
    assert "mesh B" not in view.page.locator(".place:not([hidden]) .guide").inner_text()
    assert view.state["markers"] == []


def test_cameras_are_linked_until_they_are_not(view):
    before = [view.pixels(slot) for slot in ("source", "target")]
    view.page.keyboard.press("v")
    box = view.page.get_by_role("application", name="Mesh A").first.bounding_box()
    corner = (box["x"] + 120, box["y"] + 30)
    view.drag(corner, (corner[0] + 60, corner[1]))
    after = [view.pixels(slot) for slot in ("source", "target")]
    assert all(np.abs(now - then).max() > 10 for now, then in zip(after, before, strict=True))
    view.page.get_by_label("Both turn together").uncheck()
    view.drag(corner, (corner[0] + 60, corner[1]))
    last = [view.pixels(slot) for slot in ("source", "target")]
    assert np.abs(last[0] - after[0]).max() > 10
    np.testing.assert_array_equal(last[1], after[1])


def test_a_match_is_cancelled_and_nothing_is_left_of_it(view):
    view.button("Match A to B").click()
    view.until(lambda: view.button("Cancel").is_visible())
    assert view.violations() == []
    view.button("Cancel").click()
    view.until(lambda: view.state["job"] is None)
    assert view.state["match"] is None
    assert view.button("Match A to B").is_enabled()


def test_meshes_are_matched_and_the_morph_is_scrubbed(view, meshes):
    source, target = meshes
    corners = [
        int(np.argmax(source.vertices @ direction))
        for direction in ([0, 0.3, 1], [0, 0, -1], [1, -1, 1], [-1, -1, 1], [1, -1, -1], [-1, -1, -1])
    ]
    pairs = "\n".join(f"{k},{k}" for k in corners)  # both are poses of one creature: every vertex is its own partner
    with view.page.expect_file_chooser() as asked:
        view.button("Load…").click()
    asked.value.set_files({"name": "pairs.csv", "mimeType": "text/csv", "buffer": f"source,target\n{pairs}\n".encode()})
    view.until(lambda: len(view.state["markers"]) == len(corners))
    view.button("Match A to B").click()
    view.until(lambda: view.state["match"] is not None and view.state["job"] is None)
    assert view.state["match"]["figures"]["folds_sphere"] == 0
    assert view.page.get_by_text("The spheres come with the match.").is_hidden()
    view.tab("Morph")
    view.page.get_by_label("Path from A to B").select_option("linear")
    view.button("Prepare the morph").click()
    view.until(lambda: view.state["morph"] is not None and view.state["job"] is None and len(view.positions("morph")) > 0)
    time = view.page.get_by_label("Time", exact=True)
    time.fill("0")
    view.page.wait_for_timeout(300)
    start = view.positions("morph")
    time.fill("0.5")
    view.until(lambda: np.abs(view.positions("morph") - start).max() > 0.01)
    assert view.violations() == []
    view.page.wait_for_timeout(300)
    middle = view.positions("morph")
    made = correspond(source, target, VertexPairs(np.array(corners), np.array(corners)))
    wanted = morph_along(made, 2, "linear").morph(0.5).vertices
    np.testing.assert_allclose(middle, wanted, atol=SINGLE)
    bands_move_when_told(view)


def bands_move_when_told(view):
    """The path of bands: what a preset and a slider say is what the session has, and what the picture shows."""
    view.page.get_by_label("Path from A to B").select_option("wavelet")
    view.button("Prepare again").click()
    view.until(lambda: view.state["morph"]["path"] == "wavelet" and view.state["job"] is None)
    bands = view.state["morph"]["bands"]
    view.button("Fine first").click()
    view.until(lambda: view.state["morph"]["schedule"][0]["start"] > 0)
    starts = [band["start"] for band in view.state["morph"]["schedule"]]
    assert len(starts) == bands > 2
    assert starts == sorted(starts, reverse=True)
    coarse = view.page.get_by_role("group", name="Coarse", exact=True)
    coarse.get_by_label("Start").fill("0.3")
    view.until(lambda: abs(view.state["morph"]["schedule"][0]["start"] - 0.3) < 1e-9)
    coarse.get_by_label("Speed").fill("4")
    view.until(lambda: abs(view.state["morph"]["schedule"][0]["duration"] - 0.25) < 1e-9)
    assert "Coarse from 0.30 to 0.55" in view.page.locator("svg.schedule").get_attribute("aria-label")
    view.button("Play").click()
    before = view.ask("updates('morph')")
    view.until(lambda: view.ask("updates('morph')") > before + 2)
    view.button("Pause").click()
