"""What goes out to the pages: each gets every note, and of frames what it can take.

A page acknowledges frames; at most two are under way to it, and of those that wait only the newest of each kind is kept. What a
new page has to be told first is remembered. All of this runs on the server's event loop.
"""

import asyncio
import json
import math
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from typing import Any

from morphlet.studio.events import Event, Note
from morphlet.studio.frames import Frame

WINDOW = 2
"""Frames under way to a page: one that it draws, one that travels."""
MOST_NOTES = 1000
"""Notes that may wait for a page; one that takes none is cut off."""

Key = tuple[int, int, bool]


@dataclass(eq=False)
class Outbox:
    """What waits for one page.

    Parameters
    ----------
    client
        Number of the page.
    """

    client: int
    notes: dict[str | int, str] = field(default_factory=dict)
    frames: dict[Key, tuple[int, bytes]] = field(default_factory=dict)
    under_way: deque[int] = field(default_factory=deque)
    told: int = 0
    waiting: dict[tuple[str, int], int | None] = field(default_factory=dict)
    """Numbers of the messages that a newer one may overtake."""
    wake: asyncio.Event = field(default_factory=asyncio.Event)
    cut: asyncio.Event = field(default_factory=asyncio.Event)
    """Set once the page has left too much untaken."""

    def add_note(self, text: str, newest: str | None) -> None:
        """One more note; of some types the last one only."""
        self.told += 1
        key = self.told if newest is None else newest
        self.notes.pop(key, None)
        if len(self.notes) < MOST_NOTES:
            self.notes[key] = text
        else:
            self.cut.set()
        self.wake.set()

    def add_frame(self, frame: Frame, number: int, data: bytes) -> None:
        """One more frame, instead of those that it makes stale."""
        for key in [key for key in self.frames if frame.replaces(key)]:
            del self.frames[key]
        self.frames[frame.key] = number, data
        self.wake.set()

    def acknowledge(self, number: int) -> None:
        """The page has taken this frame and all before it."""
        while self.under_way and self.under_way[0] <= number:
            self.under_way.popleft()
        self.wake.set()

    def next(self) -> str | bytes | None:
        """What to send now; None if there is nothing, or the page is behind."""
        if self.notes:
            return self.notes.pop(next(iter(self.notes)))
        if self.frames and len(self.under_way) < WINDOW:
            number, data = self.frames.pop(next(iter(self.frames)))
            self.under_way.append(number)
            return data
        return None

    async def run(self, send: Callable[[str | bytes], Awaitable[None]]) -> None:
        """Send until cancelled."""
        while True:
            part = self.next()
            if part is None:
                self.wake.clear()
                await self.wake.wait()
            else:
                await send(part)


@dataclass(eq=False)
class Hub:
    """All pages, and what a new one has to be told."""

    boxes: dict[int, Outbox] = field(default_factory=dict)
    number: int = 0
    _state: dict[str, Any] | None = None
    _frames: dict[Key, Frame] = field(default_factory=dict)

    def take(self, event: Event) -> None:
        """Pass on what the session tells."""
        if isinstance(event, Note):
            self._take_note(event)
        else:
            self._take_frame(event)

    def join(self, client: int, greeting: dict[str, Any]) -> Outbox:
        """A new page: it is greeted, and told all there is."""
        box = Outbox(client)
        box.add_note(text_of(greeting), None)
        if self._state is not None:
            box.add_note(text_of(self._state), "state")
        for frame in self._frames.values():
            self.number += 1
            box.add_frame(frame, self.number, frame.data(self.number))
        self.boxes[client] = box
        return box

    def leave(self, client: int) -> None:
        """A page that went away."""
        self.boxes.pop(client, None)

    def _take_note(self, note: Note) -> None:
        if note.content["type"] == "state":
            self._state = note.content
            self._forget_closed(note.content["meshes"])
        text, newest = text_of(note.content), note.content["type"] if note.newest else None
        for client, box in self.boxes.items():
            if note.client in (None, client):
                box.add_note(text, newest)

    def _take_frame(self, frame: Frame) -> None:
        for key in [key for key in self._frames if frame.replaces(key)]:
            del self._frames[key]
        self._frames[frame.key] = frame
        self.number += 1
        data = frame.data(self.number) if self.boxes else b""
        for box in self.boxes.values():
            box.add_frame(frame, self.number, data)

    def _forget_closed(self, meshes: dict[str, Any]) -> None:
        """Frames of meshes that are not open any more."""
        numbers = [None if mesh is None else mesh["mesh"] for mesh in (meshes["source"], meshes["target"], meshes["morph"])]
        for key in [key for key, frame in self._frames.items() if numbers[key[0]] != frame.mesh]:
            del self._frames[key]


def text_of(content: dict[str, Any]) -> str:
    """A note as a text frame; numbers that JSON does not know are null."""
    return json.dumps(_plain(content), allow_nan=False, separators=(",", ":"))


def _plain(value: Any) -> Any:
    """Values that JSON knows."""
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    return None if isinstance(value, float) and not math.isfinite(value) else value
