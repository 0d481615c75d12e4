"""The studio's page in a real browser: how often the hand's way comes back as vertices in the page's buffers, how soon a mesh is seen.

    make studio && python benchmarks/studio_page.py [--peer-python /path/with/viser/bin/python] [--minutes 10]
                                                   [--json FILE] [--markdown]

The gizmo is taken with the mouse in Chromium; then the pointer moves on as soon as the page has put the vertices that answer its last
move into its buffers: round trips, one after the other. Drawing is left out (without a graphics card it would be measured alone).
"region" and "whole" are as in `studio.py`. The first picture is drawn in software; its time begins with the call of the address.
Chromium is driven by its own protocol, with nothing that listens in: a testing library would read every frame, too, and be measured.

viser, if an interpreter that has it is named, is sent positions that were made ready before, each once its page has handed the last ones to
WebGL, which draws nothing there either: no hand, no solve. `--minutes` drags so long without a stop and tells the page's memory.
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

import numpy as np
from websockets.sync.client import connect

from book import Sheet, Table, add_options
from machine import PEER_PYTHON
from morphlet import write
from morphlet.studio.server import Running
from studio import FIRST_PICTURE, SIZES, Hand, body, gripped

sys.path.append(str(Path(__file__).parents[1] / "tests"))  # which browser, and how it is started, is the tests' own
from studio_browser.window import FLAGS, SIZE, program

SECONDS, WARM_SECONDS, SETTLING_SECONDS, POLL_SECONDS = 6.0, 1.5, 0.8, 0.02
PATIENCE_SECONDS = 120.0
RADIUS_PX, STEPS = 60.0, 40
PEER_START_SECONDS, PEER_WARM = 3.0, 5
"""Until viser's page has its mesh; its updates that do not count."""
LONG, PARTS = 30_000, 20
"""Vertices of the mesh of a long drag; looks at the page's memory."""
PICTURES = 5
HEADS = ["vertices", "follows", "updates/s", "round trip ms (median, 95 %)", "load"]
PAGE = Path(__file__).parents[1] / "src/morphlet/studio/static/index.html"
BEFORE = """
for (const name of ["clear", "drawElements", "drawArrays"]) WebGL2RenderingContext.prototype[name] = () => {};
const listen = WebSocket.prototype.addEventListener;
WebSocket.prototype.addEventListener = function (type, listener) {
    listen.call(this, type, (event) => { listener(event); if (type === "message") globalThis.afterMessage?.(); });
};"""
"""Draws nothing; calls `afterMessage` after each message that the page has taken."""
TAKEN = """
globalThis.taken = -1;
for (const name of ["bufferData", "bufferSubData"]) {
    const plain = WebGL2RenderingContext.prototype[name];
    WebGL2RenderingContext.prototype[name] = function (...told) {
        for (const one of told) if (one instanceof Float32Array && one.length === LENGTH && Number.isInteger(one[0])) {
            if (one[0] > globalThis.taken) { globalThis.taken = one[0]; globalThis.arrived?.(String(one[0])); }
        }
        return plain.apply(this, told);
    };
}"""
"""Tells the driver which positions were handed to WebGL: their first coordinate is their number."""
CIRCLES = """(async ({ x, y, warm, seconds, radius, steps }) => {
    const view = document.querySelector("[role=application]");
    const answer = () => new Promise((done) => {
        globalThis.afterMessage = () => {
            const { told, answered } = globalThis.morphlet.moves();
            if (answered >= told) done();
        };
    });
    const mouse = { button: -1, buttons: 1, pointerId: 1, pointerType: "mouse", bubbles: true };
    const waits = [];
    const begin = performance.now();
    for (let step = 1; performance.now() < begin + 1000 * (warm + seconds); step++) {
        const angle = (2 * Math.PI * step) / steps;
        const seen = { clientX: x + radius * Math.sin(angle), clientY: y - radius * (1 - Math.cos(angle)) };
        const start = performance.now();
        view.dispatchEvent(new PointerEvent("pointermove", { ...seen, ...mouse }));
        await answer();
        if (start > begin + 1000 * warm) waits.push(performance.now() - start);
    }
    waits.sort((a, b) => a - b);
    const share = (part) => waits[Math.floor(part * waits.length)];
    return { per_second: (1000 * waits.length) / waits.reduce((a, b) => a + b, 0), median_ms: share(0.5), p95_ms: share(0.95) };
})"""
"""The pointer moves on as soon as the page has the vertices that answer its last move: round trips, one after the other."""


class Tab:
    """A tab of a browser."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.number = socket, 0

    def call(self, method: str, **told: Any) -> dict[str, Any]:
        """Ask, and wait for the answer."""
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": told}))
        while (answer := self.heard()).get("id") != self.number:
            pass
        if "error" in answer:
            raise SystemExit(f"{method}: {answer['error']}")
        return answer["result"]

    def heard(self) -> dict[str, Any]:
        """The next message of the browser."""
        return json.loads(self.socket.recv(timeout=PATIENCE_SECONDS))

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


@contextmanager
def _gripped_tab(url: str) -> Iterator[tuple[Tab, dict[str, float]]]:
    """A tab whose gizmo is held by the mouse, and where."""
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
        yield tab, tip
        tab.mouse("mouseReleased", **tip)


def dragged(url: str) -> dict[str, float]:
    """Take the gizmo with the mouse, move the pointer in circles; round trips per second."""
    with _gripped_tab(url) as (tab, tip):
        told = tip | {"warm": WARM_SECONDS, "seconds": SECONDS, "radius": RADIUS_PX, "steps": STEPS}
        return tab.ask(f"{CIRCLES}({json.dumps(told)})")


def first_picture(url: str) -> float:
    """Seconds from the call of the address to a picture with the mesh."""
    with chromium() as tab:
        began = time.perf_counter()
        tab.call("Page.navigate", url=url)
        tab.until("globalThis.morphlet?.drawn('source')")
        return time.perf_counter() - began


def peer(python: str, n: int) -> dict[str, float]:
    """viser: positions sent, each once the page has handed the last ones to WebGL."""
    mesh = body(n)
    with tempfile.TemporaryDirectory() as folder, chromium() as tab:
        np.savez(Path(folder, "mesh.npz"), vertices=mesh.vertices, faces=mesh.faces)
        call = [python, str(Path(__file__).with_name("studio_viser.py")), str(Path(folder, "mesh.npz"))]
        with subprocess.Popen(call, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
            try:
                port, version = next(text.split()[1:] for text in process.stdout if text.startswith("peer "))
                return _sent(tab, process, f"http://127.0.0.1:{port}/", n) | {"version": version}
            finally:
                process.kill()


def _sent(tab: Tab, process: Any, url: str, n: int) -> dict[str, float]:
    """Updates per second and their times."""
    tab.call("Page.enable")
    tab.call("Runtime.enable")
    tab.call("Runtime.addBinding", name="arrived")
    tab.call("Page.addScriptToEvaluateOnNewDocument", source=BEFORE + TAKEN.replace("LENGTH", str(3 * n)))
    tab.call("Page.navigate", url=url)
    waits, begin, number = [], 0.0, 0
    tab.until("document.querySelector('canvas') !== null")
    time.sleep(PEER_START_SECONDS)
    while not begin or time.perf_counter() < begin + SECONDS:
        number += 1
        start = time.perf_counter()
        process.stdin.write(f"{number}\n")
        process.stdin.flush()
        while (told := tab.heard()).get("method") != "Runtime.bindingCalled" or int(told["params"]["payload"]) < number:
            pass
        if number == PEER_WARM:
            begin = time.perf_counter()
        elif begin:
            waits.append(time.perf_counter() - start)
    waits.sort()
    share = [1e3 * waits[int(part * len(waits))] for part in (0.5, 0.95)]
    return {"per_second": len(waits) / sum(waits), "median_ms": share[0], "p95_ms": share[1]}


def held(url: str, minutes: float) -> list[float]:
    """Megabytes of the page's heap at every twentieth of a drag of so many minutes, after the garbage was collected."""
    with _gripped_tab(url) as (tab, tip):
        tab.call("HeapProfiler.enable")
        found = []
        for _ in range(PARTS + 1):
            tab.call("HeapProfiler.collectGarbage")
            usage = tab.call("Runtime.getHeapUsage")
            found.append((usage["usedSize"] + usage.get("backingStorageSize", 0)) / 1e6)
            if len(found) <= PARTS:
                told = tip | {"warm": 0, "seconds": 60 * minutes / PARTS, "radius": RADIUS_PX, "steps": STEPS}
                tab.ask(f"{CIRCLES}({json.dumps(told)})")
    return found


@contextmanager
def prepared(n: int, region: str | None) -> Iterator[str]:
    """The address of a server with a mesh, and a handle on it unless no region is named."""
    with tempfile.TemporaryDirectory() as folder:
        mesh = body(n)
        write(Path(folder, "mesh.ply"), mesh)
        with Running([Path(folder, "mesh.ply")], folder=Path(folder, "sessions")) as server:
            server.studio.worker.ask(lambda: None).result()
            if region is not None:
                hand = Hand(server.url)
                gripped(hand, mesh, region)
                hand.ask("drag.cancel")
                hand.close()
            yield server.url


def measured(n: int, region: str) -> dict[str, float]:
    """One line of the table."""
    with prepared(n, region) as url:
        return dragged(url)


def main() -> None:
    """All figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--peer-python", default=os.environ.get(PEER_PYTHON), help="an interpreter that has viser")
    parser.add_argument("--minutes", type=float, default=0.0, help="of a drag without a stop, for the page's memory; nothing else then")
    add_options(parser)
    told = parser.parse_args()
    sheet = Sheet.of(told)
    if program() is None or not PAGE.exists():
        sheet.miss("page in a browser", "Chromium is needed, and the page that `make studio` builds")
        return
    if told.minutes:
        with prepared(LONG, "region") as url:
            found = held(url, told.minutes)
        sizes = [[f"{told.minutes * part / PARTS:g}", f"{size:.1f}"] for part, size in enumerate(found)]
        sheet.add(Table("The page's memory", ["minutes", "MB"], sizes))
        return
    sheet.add(Table("Drags", HEADS, drags(told.peer_python, sheet)))
    with prepared(FIRST_PICTURE, None) as url:
        times = sorted(first_picture(url) for _ in range(PICTURES))
    sheet.add(Table("First picture", ["vertices", "s, sorted"], [[FIRST_PICTURE, ", ".join(f"{seconds:.2f}" for seconds in times)]]))


def drags(peer_python: str | None, sheet: Sheet) -> list[list[Any]]:
    """Lines of the table."""
    rows = []
    for n in SIZES:
        rows += [line(n, region, measured(n, region)) for region in ("region", "whole")]
        if peer_python:
            try:
                found = peer(peer_python, n)
                rows.append(line(n, f"viser {found['version']}", found))
            except (FileNotFoundError, StopIteration):  # nobody is there, or it ended without a word
                sheet.miss("viser", f"{peer_python} has none")
    if not peer_python:
        sheet.miss("viser", f"{PEER_PYTHON} or --peer-python names an interpreter that has it")
    return rows


def line(n: int, what: str, found: dict[str, float]) -> list[Any]:
    """A line of the table."""
    ways = f"{found['median_ms']:.1f}, {found['p95_ms']:.1f}"
    told = [n, what, f"{found['per_second']:.1f}", ways, f"{os.getloadavg()[0]:.1f}"]
    sys.stderr.write("  ".join(map(str, told)) + "\n")
    return told


if __name__ == "__main__":
    main()
