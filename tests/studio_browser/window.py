"""A window of a real browser on the studio: what a person does with pointer and keys, and what the page then shows."""

import os
import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from importlib import resources
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest

BROWSERS = ("chromium", "chromium-browser", "google-chrome")
AXE = Path(__file__).parents[2] / "studio" / "node_modules" / "axe-core" / "axe.min.js"
AXE_RULES = ("wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice")
PATIENCE_SECONDS = 120.0
"""Until a test gives up: the first compilation of kernels may come in between, on a slow machine."""
POLL_MS = 25
SIZE = {"width": 1280, "height": 800}
FLAGS = (
    "--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
)  # fmt: skip
"""WebGL without a graphics card, and no traffic of the browser's own."""


def bundle() -> Path:
    """The folder of the page's files."""
    return Path(str(resources.files("morphlet").joinpath("studio", "static")))


def program() -> str | None:
    """The browser to drive."""
    return os.environ.get("MORPHLET_CHROMIUM") or next(filter(None, map(shutil.which, BROWSERS)), None)


def missing() -> str | None:
    """What these tests need and have not."""
    if find_spec("playwright") is None:
        return "Playwright is not installed: pip install 'morphlet[browser]'"
    if any(find_spec(name) is None for name in ("starlette", "uvicorn", "websockets")):
        return "the studio's libraries are not installed: pip install 'morphlet[studio]'"
    if program() is None:
        return "no Chromium: install it, or name it in MORPHLET_CHROMIUM"
    return None if (bundle() / "index.html").exists() else "the page is not built: make studio"


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser without a screen; the test is skipped where it cannot be had."""
    lacking = missing()
    if lacking:
        pytest.skip(lacking)
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=program(), headless=True, args=list(FLAGS))
        yield browser
        browser.close()


class Window:
    """A page of a browser that shows the studio.

    Parameters
    ----------
    browser
        Playwright's.
    url
        With the token.
    before
        A script that runs before the page's own.
    options
        Of the browser's context: size, touch, dark or light.
    """

    def __init__(self, browser: Any, url: str, *, before: str = "", **options: Any) -> None:
        self.context = browser.new_context(**({"viewport": SIZE, "accept_downloads": True} | options))
        self.context.add_init_script(before)
        self.page = self.context.new_page()
        self.complaints: list[str] = []
        self.requests: list[str] = []
        self.page.on("console", lambda message: self.complaints.append(message.text) if message.type in ("error", "warning") else None)
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.on("websocket", lambda socket: self.requests.append(socket.url))
        self.go(url)

    def go(self, url: str) -> None:
        """Open an address, and wait until the server has told the session."""
        self.page.goto(url)
        self.until(lambda: self.told() is not None)

    def close(self) -> None:
        """Close the window."""
        self.context.close()

    def ask(self, call: str) -> Any:
        """What the page's read-only hook answers."""
        return self.page.evaluate(f"globalThis.morphlet?.{call} ?? null")

    def told(self) -> dict[str, Any] | None:
        """The session's state, as the page has it."""
        return self.ask("state()")

    @property
    def state(self) -> dict[str, Any]:
        """The same, once there is one."""
        told = self.told()
        assert told is not None
        return told

    @property
    def way(self) -> list[float] | None:
        """How far the handle is moved; None while there is no edit."""
        edit = self.state["edit"]
        return None if edit is None else edit["transform"]["translate"]

    def positions(self, slot: str = "source") -> np.ndarray:
        """Where the page draws each vertex."""
        return np.array(self.ask(f"positions('{slot}')"), float).reshape(-1, 3)

    def roles(self) -> np.ndarray:
        """0 anchor, 1 free, 2 handle."""
        return np.array(self.ask("roles('source')"), int) & 3

    def handle(self) -> np.ndarray:
        """The vertices that the page shows as handle."""
        return np.flatnonzero(self.roles() == 2)

    def pixels(self, slot: str = "source") -> np.ndarray:
        """Where on the page each vertex is."""
        return np.array(self.ask(f"pixels('{slot}')"), float).reshape(-1, 2)

    def pixel(self, vertex: int, slot: str = "source") -> tuple[float, float]:
        """Where on the page a vertex is."""
        x, y = self.pixels(slot)[vertex].tolist()
        return x, y

    def in_sight(self, vertex: int, slot: str = "source") -> bool:
        """Whether nothing hides a vertex."""
        return bool(self.ask(f"visible('{slot}', {vertex})"))

    def until(self, condition: Callable[[], Any], seconds: float = PATIENCE_SECONDS) -> None:
        """Wait for something to come true."""
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "it did not come true"
            self.page.wait_for_timeout(POLL_MS)

    def settled(self) -> np.ndarray:
        """Positions, once two looks at them agree and nothing is being drawn."""
        before = self.positions()
        while True:
            self.page.wait_for_timeout(4 * POLL_MS)
            now = self.positions()
            if np.array_equal(before, now):
                return now
            before = now

    def drag(self, start: tuple[float, float], *way: tuple[float, float], steps: int = 8) -> None:
        """Press, go along corners, let go: the real mouse."""
        self.hold(start, *way, steps=steps)
        self.page.mouse.up()

    def hold(self, start: tuple[float, float], *way: tuple[float, float], steps: int = 8) -> None:
        """The same without letting go."""
        mouse = self.page.mouse
        mouse.move(*start)
        mouse.down()
        for corner in way:
            mouse.move(*corner, steps=steps)

    def button(self, name: str) -> Any:
        """A button by its label."""
        return self.page.get_by_role("button", name=name, exact=True)

    def tab(self, name: str) -> None:
        """Go to a tab."""
        self.page.get_by_role("tab", name=name).click()

    def visible_near(self, x: float, y: float, slot: str = "source") -> int:
        """The vertex in sight whose pixel is nearest to a place on the page."""
        order = np.argsort(np.hypot(*(self.pixels(slot) - (x, y)).T))
        return next(int(vertex) for vertex in order if self.in_sight(int(vertex), slot))

    def brush(self, vertex: int, along: tuple[float, float] = (18.0, 0.0)) -> np.ndarray:
        """Paint a stroke that begins at a vertex; what is handle then."""
        self.until(lambda: len(self.positions()) > vertex)
        before, (x, y) = self.state["revision"], self.pixel(vertex)
        self.drag((x, y), (x + along[0], y + along[1]))
        self.until(lambda: self.state["revision"] > before and len(self.handle()) == self.state["edit"]["handle"]["count"])
        return self.handle()

    def violations(self) -> list[str]:
        """What axe-core finds wrong with the page as it is, in short; the test is skipped where axe-core is not."""
        if not AXE.exists():
            pytest.skip("axe-core is not installed: make studio")
        self.page.evaluate(AXE.read_text(encoding="utf-8"))
        found = self.page.evaluate("rules => axe.run({runOnly: rules})", list(AXE_RULES))
        return [f"{one['id']}: {one['help']}: {[node['html'][:120] for node in one['nodes']][:3]}" for one in found["violations"]]

    def tip(self, axis: str) -> tuple[float, float]:
        """Where the gizmo's arrow ends."""
        spot = self.ask(f"gizmoTip('{axis}')")
        return spot["x"], spot["y"]
