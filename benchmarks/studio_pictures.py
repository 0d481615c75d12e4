"""The pictures of docs/studio: a real browser on the studio, with a real mouse.

    make studio && python benchmarks/studio_pictures.py --pictures docs/pictures

The grazer's head is lifted; the grazer is matched with the predator without help; the morph between them is stopped half way.
"""

import argparse
import io
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from morphlet.studio.server import Running

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))  # the window is the tests' own
from studio_browser.window import Window, chromium

SIZE = {"width": 1280, "height": 800}
PHONE = {"width": 390, "height": 780}
COLOURS, REFINEMENTS = 256, 3
SHARPNESS = 2
"""Pixels of a picture per point of the page, of the phone alone."""
WORK_SECONDS = 600.0
HEAD = (0.0, 1.58, 1.5)
HEAD_RADIUS = 0.33
LIFT = (0.0, 0.12, 0.3)


def main() -> int:
    """Take every picture."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pictures", type=Path, required=True, help="folder to write to")
    folder = parser.parse_args().pictures
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as kept, chromium() as browser, Running(folder=Path(kept)) as server:
        view = Window(browser, server.url, viewport=SIZE)
        lifted(view)
        take(view, folder / "studio-edit.png")
        phone = Window(
            browser, server.url, viewport=PHONE, has_touch=True, is_mobile=True, device_scale_factor=SHARPNESS, color_scheme="dark"
        )
        phone.until(lambda: len(phone.handle()) > 0)
        take(phone, folder / "studio-phone.png")
        phone.close()
        matched(view)
        take(view, folder / "studio-match.png")
        halfway(view)
        take(view, folder / "studio-morph.png")
    return 0


def lifted(view: Window) -> None:
    """Paint the head, pull it up and forward."""
    view.button("grazer").click()
    view.until(lambda: len(view.positions()) > 0)
    head = np.linalg.norm(view.positions() - HEAD, axis=1) < HEAD_RADIUS
    spots = view.pixels()[head]
    view.page.get_by_label("Rectangle and lasso go through").check()
    view.page.keyboard.press("x")
    view.drag(tuple(spots.min(axis=0)), tuple(spots.max(axis=0)))
    view.until(lambda: view.state["edit"]["handle"]["count"] > 0)
    view.page.keyboard.press("g")
    view.until(lambda: view.state["edit"]["ready"])
    view.page.get_by_text("Exact move").click()
    for axis, value in zip("xyz", LIFT, strict=True):
        view.page.get_by_label(f"Move {axis}").fill(str(value))
    view.page.get_by_label("Move z").press("Enter")
    view.until(lambda: view.state["edit"]["transform"]["translate"][2] > 0)
    view.settled()
    view.page.get_by_role("radio", name="Handle").focus()
    view.page.mouse.move(SIZE["width"] / 2, SIZE["height"] - 5)


def matched(view: Window) -> None:
    """Match the untouched grazer with the predator."""
    for slot, name in (("source", "grazer"), ("target", "predator")):
        opened(view, slot, name)
    view.tab("Match")
    view.button("Match A to B").click()
    patient(view, lambda: view.state["match"] is not None and view.state["job"] is None)
    view.page.get_by_role("group", name="Colours").get_by_text("Regions").click()
    view.page.mouse.move(SIZE["width"] / 2, SIZE["height"] - 5)


def opened(view: Window, slot: str, name: str) -> None:
    """Open a sample by the sheet."""
    view.page.keyboard.press("Control+o")
    number = {"source": 0, "target": 1}[slot]
    view.page.get_by_label("Sample").nth(number).select_option(name)
    before = view.state["revision"]
    view.button("Open sample").nth(number).click()
    view.until(lambda: view.state["revision"] > before and view.state["meshes"][slot] is not None)


def halfway(view: Window) -> None:
    """Stop the morph in the middle of its way."""
    view.tab("Morph")
    view.button("Prepare the morph").click()
    patient(view, lambda: view.state["morph"] is not None and view.state["job"] is None and len(view.positions("morph")) > 0)
    updates = view.ask("updates('morph')")
    view.page.get_by_label("Time", exact=True).fill("0.5")
    view.until(lambda: view.ask("updates('morph')") > updates)


def patient(view: Window, condition: Any) -> None:
    """Wait for long work."""
    view.until(condition, seconds=WORK_SECONDS)


def take(view: Window, path: Path) -> None:
    """A picture of the window, once it has drawn all it knows, in few colours."""
    pictures = -1
    while pictures != (pictures := view.ask("pictures()")):
        view.page.wait_for_timeout(700)
    shot = Image.open(io.BytesIO(view.page.screenshot())).convert("RGB")
    shot.quantize(COLOURS, kmeans=REFINEMENTS, dither=Image.Dither.FLOYDSTEINBERG).save(path, optimize=True)


if __name__ == "__main__":
    sys.exit(main())
