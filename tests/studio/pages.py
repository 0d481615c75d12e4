"""A page without a browser: it speaks the protocol, keeps what it is told, and puts frames where they belong."""

import json
import struct
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from morphlet import Mesh, write
from morphlet.studio.server import Running

pytest.importorskip("starlette", reason="install morphlet[studio]")
client = pytest.importorskip("websockets.sync.client", reason="install morphlet[studio]")

HEADER = struct.Struct("<IHHHHIIIIIII")
PATIENCE = 60.0
"""Seconds until a test gives up: compiling may come in between."""


@contextmanager
def running(folder: Path, *meshes: Mesh) -> Iterator[Running]:
    """A server with these meshes, its sessions in the folder, once it has compiled what it wants to."""
    files = [folder / f"mesh-{k}.ply" for k in range(len(meshes))]
    for file, mesh in zip(files, meshes, strict=True):
        write(file, mesh)
    with Running(files, folder=folder / "sessions") as server:
        server.studio.worker.ask(lambda: None).result(PATIENCE)
        yield server


def wait_for(wanted: Callable[[], bool]) -> None:
    """Until this holds: the server takes note of a page's end in its own time."""
    end = time.monotonic() + PATIENCE
    while not wanted():
        if time.monotonic() > end:
            raise AssertionError("still waiting")
        time.sleep(0.02)


class Page:
    """One page; acknowledges frames at once unless told not to."""

    def __init__(self, url: str, *, greet: bool = True, acknowledge: bool = True, **more: Any) -> None:
        self.ends = ExitStack()
        opened = client.connect(url.replace("http://", "ws://").replace("/?", "/socket?"), max_size=None, **more)
        self.socket = self.ends.enter_context(opened)
        self.acknowledge = acknowledge
        self.number, self.state, self.notes, self.frames = 0, None, [], []
        self.positions: dict[int, np.ndarray] = {}
        self.subset: dict[int, tuple[int, np.ndarray]] = {}
        self.hello: dict[str, Any] = {}
        if greet:
            self.send("hello", protocol=1)
            self.until(lambda note: note["type"] == "hello")

    def __enter__(self) -> "Page":
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def close(self) -> None:
        """Go away."""
        self.ends.close()

    def send(self, kind: str, **fields: Any) -> int:
        """Send a message; its number."""
        self.number += 1
        self.socket.send(json.dumps({"type": kind, "id": self.number, **fields}))
        return self.number

    def ask(self, kind: str, **fields: Any) -> dict[str, Any]:
        """Send a message and wait for its answer."""
        number = self.send(kind, **fields)
        return self.until(lambda note: note.get("id") == number and note["type"] in ("done", "error"))

    def until(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Take what comes until a note is the wanted one."""
        while True:
            part = self.take()
            if isinstance(part, dict) and wanted(part):
                return part

    def until_closed(self) -> None:
        """Take what comes until the server closes the socket, which raises."""
        while True:
            self.take()

    def until_state(self, wanted: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The state, once it is the wanted one."""
        while self.state is None or not wanted(self.state):
            self.take()
        return self.state

    def until_frame(self, kind: int, slot: int = 0, seq: int = 0) -> None:
        """Take what comes until a frame of this kind has been there."""
        while not any(head[2:4] == (kind, slot) and head[10] == seq for head in self.frames):
            self.take()

    def take(self) -> dict[str, Any] | tuple[int, ...]:
        """One note, or the header of one frame."""
        part = self.socket.recv(PATIENCE)
        if isinstance(part, str):
            note = json.loads(part)
            self.notes.append(note)
            if note["type"] in ("state", "hello"):
                setattr(self, note["type"], note)
            return note
        head = HEADER.unpack_from(part)
        self.frames.append(head)
        self._place(head, part[HEADER.size :])
        if self.acknowledge:
            self.socket.send(json.dumps({"type": "ack", "frame": head[5]}))
        return head

    def _place(self, head: tuple[int, ...], body: bytes) -> None:
        """Put positions in their places."""
        kind, slot, subset, count = head[2], head[3], head[7], head[8]
        if kind == 1:
            self.positions[slot] = np.frombuffer(body, np.float32, 3 * count).reshape(-1, 3).copy()
        elif kind == 2:
            self.subset[slot] = subset, np.frombuffer(body, np.uint32, count)
        elif kind == 3 and subset == 0:
            self.positions[slot] = np.frombuffer(body, np.float32, 3 * count).reshape(-1, 3).copy()
        elif kind == 3 and self.subset[slot][0] == subset:
            self.positions[slot][self.subset[slot][1]] = np.frombuffer(body, np.float32, 3 * count).reshape(-1, 3)
