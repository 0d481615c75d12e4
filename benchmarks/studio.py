"""The studio: how often a drag comes back as vertices, how long a mesh takes to its first picture, what ten minutes of dragging cost.

A client in a process of its own stands for the page: it sends where the hand is, takes the binary frames, puts the rows in their places,
and sends the next place once the frame is there (drawing is left out). "region" drags with a geodesic radius of a fifth of the bounding-box
diagonal, "whole" lets all of the mesh follow but a few vertices that stay. `studio_page.py` measures the same in a real browser.

    python benchmarks/studio.py [--quick] [--json FILE] [--markdown]
"""

import argparse
import json
import os
import resource
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull
from websockets.sync.client import connect

from book import Sheet, Table, add_options
from morphlet import Mesh, write
from morphlet.studio.server import Running

HEADER = struct.Struct("<IHHHHIIIIIII")
SIZES = (8_000, 30_000, 100_000)
FIRST_PICTURE = 50_000
UPDATES, WARM = 150, 10
MINUTES = 10.0
GOLDEN = np.pi * (3 - np.sqrt(5))
EVERY = 1000
"""Updates between two looks at the memory."""


class Hand:
    """The stand-in for a page."""

    def __init__(self, url: str) -> None:
        self.opened = connect(url.replace("http://", "ws://").replace("/?", "/socket?"), max_size=None, compression=None)
        self.socket = self.opened.__enter__()
        self.positions: dict[int, np.ndarray] = {}
        self.normals: dict[int, np.ndarray] = {}
        self.rows: dict[int, np.ndarray] = {}
        self.number, self.frame_ms, self.frames = 0, [], 0
        self.send("hello", protocol=1)

    def close(self) -> None:
        """Go away."""
        self.opened.__exit__(None, None, None)

    def send(self, kind: str, **fields: object) -> int:
        """Send a message."""
        self.number += 1
        self.socket.send(json.dumps({"type": kind, "id": self.number, **fields}))
        return self.number

    def ask(self, kind: str, **fields: object) -> None:
        """Send a message and wait until it is done."""
        number = self.send(kind, **fields)
        while True:
            note = self.take()
            if isinstance(note, dict) and note.get("id") == number:
                if note["type"] == "error":
                    raise SystemExit(f"{kind}: {note}")
                return

    def take(self) -> dict | tuple[int, ...]:
        """A note, or the header of a frame that was put in its place."""
        part = self.socket.recv()
        if isinstance(part, str):
            note = json.loads(part)
            if note["type"] == "numbers" and note.get("frame_ms"):
                self.frame_ms.append(note["frame_ms"])
            return note
        head = HEADER.unpack_from(part)
        kind, slot, subset, count = head[2], head[3], head[7], head[8]
        if kind == 2:
            self.rows[subset] = np.frombuffer(part, np.uint32, count, HEADER.size)
        elif kind in (1, 3):
            values = np.frombuffer(part, np.float32, 6 * count, HEADER.size).reshape(2, -1, 3)
            if subset:
                self.positions[slot][self.rows[subset]], self.normals[slot][self.rows[subset]] = values
            else:
                self.positions[slot], self.normals[slot] = values.copy()
            self.frames += 1
        self.socket.send(f'{{"type":"ack","frame":{head[5]}}}')
        return head

    def follow(self, seq: int, transform: dict[str, object]) -> None:
        """Say where the hand is, and wait for the vertices."""
        self.send("drag.move", seq=seq, transform=transform)
        while True:
            part = self.take()
            if not isinstance(part, dict) and part[2] == 3 and part[10] == seq:
                return


def place(k: int, diagonal: float) -> dict[str, object]:
    """Where the hand is at step k: on its way round a small circle."""
    a = 0.1 * k
    return {"translate": [0.05 * diagonal * np.sin(a), 0.05 * diagonal * (1 - np.cos(a)), 0.02 * diagonal * np.sin(2 * a)]}


def body(n: int) -> Mesh:
    """A lumpy body with so many vertices, evenly spread over a sphere before it was given its shape."""
    k = np.arange(n) + 0.5
    height, turn = 1 - 2 * k / n, GOLDEN * k
    flat = np.sqrt(1 - height**2)
    points = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    faces = ConvexHull(points).simplices.astype(np.int64)
    inward = np.linalg.det(points[faces]) < 0
    faces[inward] = faces[inward][:, ::-1]
    lumps = 1 + 0.25 * np.sin(5 * points[:, [0]]) * np.cos(4 * points[:, [1]])
    return Mesh(points * lumps * [1.0, 1.2, 2.5], faces)


def gripped(hand: Hand, mesh: Mesh, region: str) -> None:
    """One end of the body as handle, and what follows."""
    along = np.argsort(mesh.vertices[:, 2])
    hand.ask("paint", role="handle", mode="set", vertices=along[-len(along) // 40 :].tolist())
    if region == "whole":
        hand.ask("paint", role="anchor", mode="set", vertices=along[: len(along) // 50].tolist())
        hand.ask("roi", radius=None)
    hand.ask("drag.begin")


def served_cpu() -> float:
    """CPU seconds of the process that serves, which started this one."""
    words = Path(f"/proc/{os.getppid()}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def play(url: str, n: int, region: str, updates: int) -> dict[str, float]:
    """Drag; updates per second and times."""
    mesh, hand = body(n), Hand(url)
    gripped(hand, mesh, region)
    diagonal = mesh.bbox_diagonal
    for k in range(1, WARM + 1):
        hand.follow(k, place(k, diagonal))
    hand.frame_ms.clear()
    spent, began, cpu = [], time.perf_counter(), (served_cpu(), time.process_time())
    for k in range(WARM + 1, WARM + 1 + updates):
        start = time.perf_counter()
        hand.follow(k, place(k, diagonal))
        spent.append(time.perf_counter() - start)
    whole, cpu = time.perf_counter() - began, (served_cpu() - cpu[0], time.process_time() - cpu[1])
    hand.ask("drag.end", seq=10**6, transform={})
    ms = statistics.median(hand.frame_ms) if hand.frame_ms else float("nan")
    hand.close()
    return {
        "per_second": updates / whole,
        "median_ms": 1e3 * statistics.median(spent),
        "p95_ms": 1e3 * float(np.quantile(spent, 0.95)),
        "server_ms": ms,
        "server_cpu": 1e3 * cpu[0] / updates,
        "page_cpu": 1e3 * cpu[1] / updates,
    }


def first_picture(url: str) -> dict[str, float]:
    """From the click on open to all that a picture needs: the upload, the mesh frame."""
    import urllib.parse
    import urllib.request

    base, token = url.split("/?token=")
    hand = Hand(url)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "mesh.obj")
        write(file, body(FIRST_PICTURE))
        data = file.read_bytes()
    began = time.perf_counter()
    query = urllib.parse.urlencode({"token": token, "slot": "source", "name": "mesh.obj"})
    urllib.request.urlopen(urllib.request.Request(f"{base}/upload?{query}", data, method="POST")).read()
    while True:
        part = hand.take()
        if not isinstance(part, dict) and part[2] == 1:
            break
    seconds = time.perf_counter() - began
    hand.close()
    return {"seconds": seconds, "megabytes": len(data) / 1e6}


def stand_in(words: list[str], url: str) -> dict[str, float]:
    """The client in a process of its own."""
    made = subprocess.run([sys.executable, str(Path(__file__)), "--client", url, *words], capture_output=True, text=True, check=True)
    return json.loads(made.stdout)


def resident() -> float:
    """Megabytes of this process."""
    with open("/proc/self/statm") as stream:
        return int(stream.read().split()[1]) * resource.getpagesize() / 1e6


def long_drag(url: str, minutes: float) -> list[float]:
    """Megabytes of the server every thousand updates of a drag through so many minutes at 30 updates a second."""
    mesh, hand = body(SIZES[0]), Hand(url)
    gripped(hand, mesh, "region")
    held, diagonal = [], mesh.bbox_diagonal
    for k in range(1, int(minutes * 60 * 30) + 1):
        hand.follow(k, place(k, diagonal))
        if k % EVERY == 0:
            held.append(resident())
    hand.ask("drag.end", seq=10**9, transform={})
    hand.close()
    return held


def main() -> None:
    """All figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--client", nargs="+")
    add_options(parser)
    told = parser.parse_args()
    if told.client:
        url, kind, *rest = told.client
        print(json.dumps(first_picture(url) if kind == "open" else play(url, int(rest[0]), rest[1], int(rest[2]))))
        return
    updates, sheet, rows = 40 if told.quick else UPDATES, Sheet.of(told), []
    for n in SIZES:
        for region in ("region", "whole"):
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder, "mesh.ply")
                write(file, body(n))
                with Running([file], folder=Path(folder, "sessions")) as server:
                    server.studio.worker.ask(lambda: None).result()
                    found = stand_in(["play", str(n), region, str(updates)], server.url)
            ways = f"{found['median_ms']:.1f}, {found['p95_ms']:.1f}"
            cpu = f"{found['server_cpu']:.1f}, {found['page_cpu']:.1f}"
            rows.append([n, region, f"{found['per_second']:.1f}", ways, f"{found['server_ms']:.1f}", cpu])
            sys.stderr.write("  ".join(map(str, rows[-1])) + "\n")
    heads = ["vertices", "follows", "updates/s", "round trip ms (median, 95 %)", "server ms", "CPU ms (server, stand-in)"]
    sheet.add(Table("Drags", heads, rows, f"{updates} updates each."))
    with tempfile.TemporaryDirectory() as folder, Running(folder=Path(folder)) as server:
        server.studio.worker.ask(lambda: None).result()
        found = stand_in(["open"], server.url)
        sheet.add(
            Table(
                "First picture", ["vertices", "MB of OBJ", "s"], [[FIRST_PICTURE, f"{found['megabytes']:.1f}", f"{found['seconds']:.2f}"]]
            )
        )
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "mesh.ply")
        write(file, body(SIZES[0]))
        with Running([file], folder=Path(folder, "sessions")) as server:
            server.studio.worker.ask(lambda: None).result()
            held = long_drag(server.url, MINUTES / 10 if told.quick else MINUTES)
    heads = ["thousand updates", "MB at first", "at most", "at last"]
    sheet.add(Table("Memory of the server during a drag", heads, [[len(held), *(f"{one:.0f}" for one in (held[0], max(held), held[-1]))]]))


if __name__ == "__main__":
    main()
