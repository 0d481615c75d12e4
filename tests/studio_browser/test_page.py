"""The page itself: for everybody, on every screen, with no network but the studio's own."""

import gzip
from urllib.parse import urlsplit

import numpy as np
import pytest

from morphlet import sample
from studio_browser.window import bundle

MOST_BYTES = 1_000_000
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True, "device_scale_factor": 2}
SMALL = 1500
NAME_OF_FOCUS = "(e => e.getAttribute('aria-label') || e.labels?.[0]?.innerText || e.innerText)(document.activeElement)"


@pytest.fixture(scope="module")
def pair():
    return sample("grazer", n_vertices=SMALL), sample("grazer-walking", n_vertices=SMALL)


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_wrong_in_any_state(studio, window, pair, scheme):
    server = studio()
    view = window(server.url, color_scheme=scheme)
    assert view.violations() == []
    for sheet in ("Control+o", "Control+s", "?"):
        view.page.keyboard.press(sheet)
        assert view.violations() == []
        view.page.keyboard.press("Escape")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_axe_finds_nothing_wrong_with_meshes_open(studio, window, pair, scheme):
    view = window(studio(*pair).url, color_scheme=scheme)
    view.until(lambda: len(view.positions()) == SMALL)
    view.page.get_by_text("Exact move").click()
    for tab in ("Edit", "Match", "Morph"):
        view.tab(tab)
        view.page.wait_for_timeout(200)
        assert view.violations() == []


def test_tabs_go_by_arrow_keys(studio, window):
    view = window(studio().url)
    view.page.get_by_role("tab", name="Edit").focus()
    for name in ("Match", "Morph", "Edit"):
        view.page.keyboard.press("ArrowRight")
        assert view.page.get_by_role("tab", name=name).get_attribute("aria-selected") == "true"
        assert view.page.get_by_role("tabpanel", name=name).is_visible()


def test_every_control_is_reached_by_the_tab_key(studio, window, pair):
    view = window(studio(*pair).url)
    view.until(lambda: len(view.positions()) == SMALL)
    reached = set()
    for _ in range(80):
        view.page.keyboard.press("Tab")
        reached.add(view.page.evaluate(NAME_OF_FOCUS))
    for name in ("Brush", "Radius", "How the rest follows", "Open", "Save", "Keys and pointer", "Keep this pose"):
        assert name in reached


def test_letters_can_be_switched_off(studio, window, pair):
    view = window(studio(*pair).url)
    lasso = view.button("Lasso")
    view.page.keyboard.press("l")
    assert lasso.get_attribute("aria-pressed") == "true"
    view.page.keyboard.press("?")
    view.page.get_by_label("Single letters are shortcuts").uncheck()
    view.page.keyboard.press("Escape")
    view.page.keyboard.press("b")
    assert lasso.get_attribute("aria-pressed") == "true"


def test_on_a_phone_the_sidebar_is_a_sheet_and_a_finger_paints(studio, window, pair):
    view = window(studio(*pair).url, **PHONE)
    view.until(lambda: len(view.positions()) == SMALL)
    place = view.page.get_by_role("application", name="Mesh to edit")
    sheet = view.page.get_by_role("complementary", name="Controls")
    assert place.bounding_box()["width"] == 390
    high = sheet.bounding_box()["height"]
    view.button("Controls").tap()
    assert sheet.bounding_box()["height"] < high / 2
    assert view.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    view.button("Pick single vertices").tap()
    view.page.wait_for_timeout(200)
    vertex = view.visible_near(195, 300)
    view.page.touchscreen.tap(*view.pixel(vertex))
    view.until(lambda: view.state["edit"]["handle"]["count"] == 1)


def test_two_fingers_zoom(studio, window, pair):
    view = window(studio(*pair).url, **PHONE)
    view.until(lambda: len(view.positions()) == SMALL)
    before = np.ptp(view.pixels(), axis=0)
    touch = view.context.new_cdp_session(view.page)
    for kind, half in (("touchStart", 20), *(("touchMove", 20 + 10 * step) for step in range(1, 5)), ("touchEnd", None)):
        points = [] if half is None else [{"x": 195 + side * half, "y": 250, "id": side + 1} for side in (-1, 1)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    view.until(lambda: (np.ptp(view.pixels(), axis=0) > 2 * before).all())
    assert view.state["edit"]["handle"]["count"] == 0


def test_nothing_is_asked_of_anyone_else(studio, window, pair):
    server = studio(*pair)
    view = window(server.url)
    view.until(lambda: len(view.positions()) == SMALL)
    assert {urlsplit(url).netloc for url in view.requests if not url.startswith("blob:")} == {urlsplit(server.url).netloc}


def test_the_page_is_refused_without_the_token(studio, browser):
    server = studio()
    page = browser.new_page()
    assert page.goto(server.url.split("?")[0]).status == 403
    page.close()


def test_the_bundle_is_small_and_its_licences_are_told(browser):
    files = [file for file in bundle().rglob("*") if file.is_file()]
    assert sum(len(gzip.compress(file.read_bytes())) for file in files) <= MOST_BYTES
    assert {file.suffix for file in files} <= {".html", ".js", ".css", ".svg", ".txt"}
    text = (bundle() / "licences.txt").read_text()
    assert "three-mesh-bvh" in text
    assert text.count("MIT") >= 2
