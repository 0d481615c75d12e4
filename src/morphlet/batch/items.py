"""Item: one input of a batch, from its fingerprint to its outputs in place."""

import hashlib
import json
import os
import shutil
import socket
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from morphlet.batch.limits import Limits
from morphlet.batch.manifest import Line
from morphlet.batch.server import Died, Ended, Server

OWN = threading.local()
"""The server of each thread that does items: engines give their workers nothing to keep one in."""
SERVERS: list[Server] = []
"""All of them, to be ended."""


@dataclass(frozen=True)
class Item:
    """What is to be done with one input.

    Parameters
    ----------
    input
        The file, as it was named.
    path
        The file, from the root.
    words
        The verb and all its words but outputs.
    outputs
        Names within the batch's folder: what the verb makes, then what it tells.
    parameters
        All that decides about the result.
    """

    input: str
    path: str
    words: tuple[str, ...]
    outputs: tuple[str, ...]
    parameters: dict[str, Any] = field(hash=False)


@dataclass(frozen=True)
class Batch:
    """What the items of one run share.

    Parameters
    ----------
    folder
        Where outputs go.
    named
        The same as it was named.
    work
        A folder within that is there as long as the run is.
    command
        Words that start a server.
    limits
        What each item may take.
    """

    folder: str
    named: str
    work: str
    command: tuple[str, ...]
    limits: Limits

    @property
    def running(self) -> bool:
        """Whether the run goes on: on every machine of a cluster, it ends with its folder."""
        return os.path.isdir(self.work)

    def named_outputs(self, item: Item) -> tuple[str, ...]:
        """The outputs of an item, as people know them."""
        return tuple(str(Path(self.named, name)) for name in item.outputs)


def fingerprint(path: str | os.PathLike[str]) -> str | None:
    """SHA-256 of a file's bytes; None if it cannot be read."""
    try:
        with open(path, "rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError:
        return None


def do(item: Item, batch: Batch) -> Line:
    """Do an item; whatever happens, a line tells of it."""
    began = time.perf_counter()
    own = fingerprint(item.path)
    try:
        answer = _answer(item, batch)
    except (Ended, OSError) as problem:
        answer = {"error": _limited(str(problem), batch.limits)}
    found, peak, seconds = answer.get("error"), answer.get("peak_memory_mb"), round(time.perf_counter() - began, 4)
    if found is None:
        return Line(item.input, own, item.parameters, "done", None, batch.named_outputs(item), seconds, peak)
    return Line(item.input, own, item.parameters, "failed", found, (), seconds, peak)


def end_servers() -> None:
    """End all servers of this process."""
    while SERVERS:
        SERVERS.pop().end()
    OWN.__dict__.clear()


def _answer(item: Item, batch: Batch) -> dict[str, Any]:
    """What a server says of the item, its outputs moved to their places."""
    if not batch.running:
        raise Ended(f"the batch has ended, or {socket.gethostname()} does not see its folder {batch.folder}")
    folder = Path(tempfile.mkdtemp(dir=batch.work))
    try:
        places = [folder / Path(name).name for name in item.outputs]
        words = [
            *item.words,
            *(["--output", str(places[0])] if len(places) > 1 else []),
            "--json",
            "--force",
            f"--threads={batch.limits.threads}",
        ]
        answer = _asked({"words": words, "memory": batch.limits.memory}, batch)
        if answer.get("error") is None:
            told = answer["result"] | {"outputs": [batch.named_outputs(item)[0]] if len(places) > 1 else []}
            places[-1].write_text(json.dumps(told, indent=1), encoding="utf-8")
            for place, name in zip(places, item.outputs, strict=True):
                target = Path(batch.folder, name)
                target.parent.mkdir(exist_ok=True)
                os.replace(place, target)
        return answer
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _asked(request: dict[str, Any], batch: Batch) -> dict[str, Any]:
    """The answer of this thread's server; of a new one if what earlier items left behind may be in the way."""
    server = _server(batch)
    if server.asked:
        try:
            answer = server.ask(request, batch.limits, lambda: batch.running)
            if not answer.get("memory_error"):
                return answer
        except Died:
            pass
    return server.ask(request, batch.limits, lambda: batch.running)


def _server(batch: Batch) -> Server:
    """The server of this thread."""
    server: Server | None = getattr(OWN, "server", None)
    if server is None or server.command != batch.command:
        if server is not None:
            server.end()
        OWN.server = server = Server(batch.command)
        SERVERS.append(server)
    return server


def _limited(error: str, limits: Limits) -> str:
    """An error of a process that had a memory limit says so."""
    return error if limits.memory is None or "out of memory" not in error else f"{error}; its memory limit was {limits.memory / 1e6:g} MB"
