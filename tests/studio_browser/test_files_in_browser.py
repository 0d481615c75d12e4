"""Files in a real browser: open, drop, save, the session; and what is there after the server died."""

import base64
import json

import numpy as np
import pytest

from morphlet import read, sample, write
from morphlet.studio.server import Running

SINGLE = 2e-6
"""Positions travel in single precision: its rounding, for coordinates up to some units."""


@pytest.fixture(scope="module")
def blob():
    return sample("blob", n_vertices=1500)


def front(mesh):
    """A vertex in sight from where the page looks at first."""
    return int(np.argmax(mesh.vertices @ [0.45, 0.25, 0.85]))


def edited(view, mesh):
    """Paint and move by numbers."""
    view.brush(front(mesh))
    view.page.get_by_text("Exact move").click()
    view.page.get_by_label("Move x").fill("0.2")
    view.page.get_by_label("Move x").press("Enter")
    view.until(lambda: view.way == [0.2, 0, 0])
    return view.settled()


def saved(view, title, folder):
    """Save one thing of the sheet."""
    view.page.keyboard.press("Control+s")
    with view.page.expect_download() as download:
        view.button(f"Save: {title}").click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    view.button("Close").click()
    return path


def test_a_file_is_opened_by_its_button(studio, window, blob, tmp_path):
    write(tmp_path / "lump.obj", blob)
    view = window(studio().url)
    assert view.page.get_by_role("heading", name="Open a mesh").is_visible()
    view.button("Choose a mesh…").click()
    with view.page.expect_file_chooser() as asked:
        view.button("Choose a file…").first.click()
    asked.value.set_files(tmp_path / "lump.obj")
    view.until(lambda: len(view.positions()) == blob.n_vertices)
    assert view.state["meshes"]["source"]["name"] == "lump.obj"
    np.testing.assert_allclose(view.positions(), blob.vertices, atol=SINGLE)
    assert view.page.get_by_role("heading", name="Open a mesh").is_hidden()


def test_a_file_is_dropped_on_the_page(studio, window, blob, tmp_path):
    write(tmp_path / "lump.ply", blob)
    view = window(studio().url)
    content = base64.b64encode((tmp_path / "lump.ply").read_bytes()).decode()
    view.page.evaluate(
        """content => {
            const bytes = Uint8Array.from(atob(content), (letter) => letter.charCodeAt(0));
            const carried = new DataTransfer();
            carried.items.add(new File([bytes], "lump.ply"));
            const event = (type) => new DragEvent(type, { dataTransfer: carried, bubbles: true, cancelable: true });
            for (const type of ["dragover", "drop"]) document.body.dispatchEvent(event(type));
        }""",
        content,
    )
    view.until(lambda: len(view.positions()) == blob.n_vertices)


def test_a_file_that_is_no_mesh_is_refused_with_advice(studio, window, browser, tmp_path):
    view = window(studio().url)
    view.page.keyboard.press("Control+o")
    with view.page.expect_file_chooser() as asked:
        view.button("Choose a file…").first.click()
    asked.value.set_files({"name": "poem.obj", "mimeType": "text/plain", "buffer": b"no mesh at all\n"})
    alert = view.page.get_by_role("alert").filter(has_text="Needed")
    view.until(alert.is_visible)
    assert alert.locator(".advice").inner_text()
    assert view.violations() == []
    alert.get_by_role("button", name="Dismiss").click()
    assert alert.is_hidden()
    assert view.state["meshes"]["source"] is None
    view.complaints.clear()  # the browser tells of every answer above 399


def test_the_edited_mesh_is_saved_as_it_is_shown(studio, window, blob, tmp_path):
    view = window(studio(blob).url)
    shape = edited(view, blob)
    path = saved(view, "Mesh A as it is now", tmp_path)
    np.testing.assert_allclose(read(path).vertices, shape, atol=SINGLE)
    assert not np.allclose(shape, blob.vertices, atol=0.01)


def test_poses_are_kept_and_saved_as_an_animation(studio, window, blob, tmp_path):
    view = window(studio(blob).url)
    edited(view, blob)
    view.button("Keep this pose").click()
    view.until(lambda: [pose["name"] for pose in view.state["poses"]] == ["pose 1"])
    assert saved(view, "Poses as an animation", tmp_path).read_bytes()[:4] == b"glTF"


def test_a_session_is_saved_and_opened_again(studio, window, blob, tmp_path):
    view = window(studio(blob).url)
    shape = edited(view, blob)
    path = saved(view, "Session", tmp_path)
    assert json.loads(path.read_text())
    view.button("Undo").click()
    view.button("Undo").click()
    view.until(lambda: view.state["edit"]["handle"]["count"] == 0)
    view.page.keyboard.press("Control+o")
    with view.page.expect_file_chooser() as asked:
        view.button("Session…").click()
    asked.value.set_files(path)
    view.until(lambda: view.way == [0.2, 0, 0])
    np.testing.assert_allclose(view.settled(), shape, atol=SINGLE)


def test_edits_are_kept_when_another_mesh_is_opened_over_them(studio, window, blob, tmp_path):
    view = window(studio(blob).url)
    shape = edited(view, blob)
    write(tmp_path / "other.ply", blob.with_vertices(2 * blob.vertices))
    view.page.keyboard.press("Control+o")
    with view.page.expect_file_chooser() as asked:
        view.button("Choose a file…").first.click()
    asked.value.set_files(tmp_path / "other.ply")
    view.until(lambda: np.abs(view.positions()).max() > 1.5 * np.abs(shape).max())
    view.until(view.page.get_by_text("The edits before are kept").is_visible)
    view.page.keyboard.press("Control+o")
    view.button("Recover mesh-0.ply").click()
    view.until(lambda: view.way == [0.2, 0, 0])
    np.testing.assert_allclose(view.settled(), shape, atol=SINGLE)


def test_after_the_server_died_the_next_one_has_it_all(browser, window, blob, tmp_path):
    write(tmp_path / "lump.ply", blob)
    with Running([tmp_path / "lump.ply"], folder=tmp_path / "sessions") as first:
        view = window(first.url)
        shape = edited(view, blob)
    view.until(view.page.get_by_text("The studio keeps your edits").or_(view.page.get_by_text("The studio does not answer")).is_visible)
    assert view.violations() == []
    with Running([], folder=tmp_path / "sessions") as second:
        view.go(second.url)
        view.until(view.button("Recover lump.ply").is_visible)
        assert view.violations() == []
        assert view.page.locator(".welcome").get_by_text("lump.ply").is_visible()
        view.button("Recover lump.ply").click()
        view.until(lambda: len(view.positions()) == blob.n_vertices and view.way == [0.2, 0, 0])
        np.testing.assert_allclose(view.settled(), shape, atol=SINGLE)
        view.complaints.clear()  # the browser tells of every socket that does not open
