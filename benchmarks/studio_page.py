"""The studio's page in a real browser: how often the hand's way comes back as vertices in the page's buffers, how soon a mesh is seen.

    make studio && python benchmarks/studio_page.py

The gizmo is taken with the mouse in Chromium; then the pointer moves on as soon as the page has put newer vertices into its buffers: round
trips, one after the other. Drawing is left out (without a graphics card it would be measured alone). "region" and "whole" are as in
`studio.py`. The first picture is drawn in software; its time begins with the call of the address. Chromium is driven by its own
protocol, with nothing that listens in: a testing library would read every frame, too, and be measured.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from websockets.sync.client import connect

from morphlet import write
from morphlet.studio.server import Running
from studio import FIRST_PICTURE, SIZES, Hand, body, gripped

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # which browser, and how it is started, is the tests' own
from studio_browser.window import FLAGS, SIZE, program

SECONDS, WARM_SECONDS, SETTLING_SECONDS, POLL_SECONDS = 6.0, 1.5, 0.8, 0.02
PATIENCE_SECONDS = 120.0
RADIUS_PX, STEPS = 60.0, 40
BEFORE = """
for (const name of ["clear", "drawElements", "drawArrays"]) WebGL2RenderingContext.prototype[name] = () => {};
const listen = WebSocket.prototype.addEventListener;
WebSocket.prototype.addEventListener = function (type, listener) {
    listen.call(this, type, (event) => { listener(event); if (type === "message") globalThis.afterMessage?.(); });
};"""
"""Draws nothing; calls `afterMessage` after each message that the page has taken."""
CIRCLES = """(async ({ x, y, warm, seconds, radius, steps }) => {
    const view = document.querySelector("[role=application]");
    const newer = (before) => new Promise((done) => {
        globalThis.afterMessage = () => globalThis.morphlet.updates("source") > before && done();
    });
    const mouse = { button: -1, buttons: 1, pointerId: 1, pointerType: "mouse", bubbles: true };
    const waits = [];
    const begin = performance.now();
    for (let step = 1; performance.now() < begin + 1000 * (warm + seconds); step++) {
        const angle = (2 * Math.PI * step) / steps;
        const seen = { clientX: x + radius * Math.sin(angle), clientY: y - radius * (1 - Math.cos(angle)) };
        const before = globalThis.morphlet.updates("source");
        const start = performance.now();
        const there = newer(before);
        view.dispatchEvent(new PointerEvent("pointermove", { ...seen, ...mouse }));
        await there;
        if (start > begin + 1000 * warm) waits.push(performance.now() - start);
    }
    waits.sort((a, b) => a - b);
    const share = (part) => waits[Math.floor(part * waits.length)];
    return { per_second: (1000 * waits.length) / waits.reduce((a, b) => a + b, 0), median_ms: share(0.5), p95_ms: share(0.95) };
})"""
"""The pointer moves on as soon as the page has vertices newer than its last move: round trips, one after the other."""


class Tab:
    """A tab of a browser."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.number = socket, 0

    def call(self, method: str, **told: Any) -> dict[str, Any]:
        """Ask, and wait for the answer."""
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": told}))
        while (answer := json.loads(self.socket.recv(timeout=PATIENCE_SECONDS))).get("id") != self.number:
            pass
        if "error" in answer:
            raise SystemExit(f"{method}: {answer['error']}")
        return answer["result"]

    def ask(self, expression: str) -> Any:
        """The value of an expression in the page."""
        found = self.call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        return found["result"].get("value")

    def until(self, expression: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE_SECONDS
        while not self.ask(expression):
            if time.monotonic() > end:
                raise SystemExit(f"never true: {expression}")
            time.sleep(POLL_SECONDS)

    def mouse(self, kind: str, x: float, y: float) -> None:
        """The mouse comes, is pressed or released."""
        button = "none" if kind == "mouseMoved" else "left"
        self.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button=button, clickCount=1)

    def key(self, letter: str) -> None:
        """A letter is typed."""
        self.call("Input.dispatchKeyEvent", type="keyDown", key=letter, text=letter)
        self.call("Input.dispatchKeyEvent", type="keyUp", key=letter)


@contextmanager
def chromium() -> Iterator[Tab]:
    """A browser of its own, with one tab."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        own = (f"--user-data-dir={profile}", f"--window-size={SIZE['width']},{SIZE['height']}", "--remote-debugging-port=0")
        call = [program() or "chromium", "--headless", *own, *FLAGS, "about:blank"]
        with subprocess.Popen(call, stderr=subprocess.DEVNULL) as process:
            try:
                with connect(_tab_address(Path(profile, "DevToolsActivePort")), max_size=None) as socket:
                    yield Tab(socket)
            finally:
                process.terminate()


def _tab_address(file: Path) -> str:
    """Where the browser's tab listens, once it does."""
    from urllib.request import urlopen

    end = time.monotonic() + PATIENCE_SECONDS
    while not (file.exists() and file.read_text().strip()) and time.monotonic() < end:
        time.sleep(POLL_SECONDS)
    port = file.read_text().splitlines()[0]
    tabs = json.loads(urlopen(f"http://127.0.0.1:{port}/json/list").read())
    return next(tab["webSocketDebuggerUrl"] for tab in tabs if tab["type"] == "page")


def dragged(url: str) -> dict[str, float]:
    """Take the gizmo with the mouse, move the pointer in circles; round trips per second."""
    with chromium() as tab:
        tab.call("Page.enable")
        tab.call("Page.addScriptToEvaluateOnNewDocument", source=BEFORE)
        tab.call("Page.navigate", url=url)
        tab.until("globalThis.morphlet?.state()?.edit?.ready && globalThis.morphlet.roles('source').length > 0")
        before = tab.ask("globalThis.morphlet.pictures()")
        tab.key("g")
        tab.until(f"globalThis.morphlet.pictures() > {before}")
        time.sleep(SETTLING_SECONDS)
        tip = tab.ask("globalThis.morphlet.gizmoTip('y')")
        tab.mouse("mouseMoved", **tip)
        tab.mouse("mousePressed", **tip)
        tab.until("globalThis.morphlet.state().drag !== null")
        told = tip | {"warm": WARM_SECONDS, "seconds": SECONDS, "radius": RADIUS_PX, "steps": STEPS}
        found = tab.ask(f"{CIRCLES}({json.dumps(told)})")
        tab.mouse("mouseReleased", **tip)
    return found


def first_picture(url: str) -> float:
    """Seconds from the call of the address to a picture with the mesh."""
    with chromium() as tab:
        began = time.perf_counter()
        tab.call("Page.navigate", url=url)
        tab.until("globalThis.morphlet?.drawn('source')")
        return time.perf_counter() - began


def measured(n: int, region: str) -> dict[str, float]:
    """One line of the table."""
    with tempfile.TemporaryDirectory() as folder:
        mesh = body(n)
        write(Path(folder, "mesh.ply"), mesh)
        with Running([Path(folder, "mesh.ply")], folder=Path(folder, "sessions")) as server:
            server.studio.worker.ask(lambda: None).result()
            hand = Hand(server.url)
            gripped(hand, mesh, region)
            hand.ask("drag.cancel")
            hand.close()
            return dragged(server.url)


def main() -> None:
    """All figures."""
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    print(f"load {os.getloadavg()[0]:.1f}, {os.cpu_count()} cores")
    print("| vertices | follows | updates/s | round trip ms (median, 95 %) |\n| --- | --- | --- | --- |")
    for n in SIZES:
        for region in ("region", "whole"):
            found = measured(n, region)
            print(f"| {n} | {region} | {found['per_second']:.1f} | {found['median_ms']:.1f}, {found['p95_ms']:.1f} |", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        write(Path(folder, "mesh.ply"), body(FIRST_PICTURE))
        with Running([Path(folder, "mesh.ply")], folder=Path(folder, "sessions")) as server:
            server.studio.worker.ask(lambda: None).result()
            print(f"first picture of {FIRST_PICTURE} vertices: {first_picture(server.url):.2f} s")


if __name__ == "__main__":
    main()
