"""Server: a process of its own that does one item after another, until it is told to end, overdue, or dead.

An item that crashes, hangs or takes too much memory ends its server, and nothing else. The process ends by itself when its parent is gone
(its input ends) and when nothing was asked of it for a while.
"""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from queue import Empty, Queue
from typing import Any

from morphlet.batch.limits import Limits

POLL = 0.25
"""Seconds between looks whether the batch still runs."""
START = 120.0
"""Seconds in which a process must be ready: far more than the seconds that its imports take on a busy machine."""
WORDS_OF_BLAS = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
"""What sets the threads of the libraries below numpy: one, unless a person says otherwise; more would change the last bits."""


class Ended(Exception):
    """The server did not answer: why."""


class Died(Ended):
    """It ended of itself."""


@dataclass(eq=False)
class Server:
    """A process that answers requests, a line of JSON each.

    Parameters
    ----------
    command
        Words after the interpreter's name that start it.
    """

    command: tuple[str, ...]
    asked: int = 0
    process: "subprocess.Popen[bytes] | None" = None
    answers: "Queue[bytes]" = field(default_factory=Queue)

    def ask(self, request: dict[str, Any], limits: Limits, running: Callable[[], bool]) -> dict[str, Any]:
        """The answer to a request.

        Raises
        ------
        Ended
            If the process died, took too long, or nobody waits for the answer any more; it is gone then.
        """
        process = self._alive(running)
        self.asked += 1
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")  # type: ignore[union-attr]
            process.stdin.flush()  # type: ignore[union-attr]
            answer = self._awaited(limits.seconds, running)
        except OSError:
            answer = b""
        if not answer:
            raise Died(self._epitaph())
        found: dict[str, Any] = json.loads(answer)
        if found.get("memory_error"):
            self.end()
        return found

    def end(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            for pipe in (self.process.stdin, self.process.stdout):
                _close(pipe)
        self.process, self.asked = None, 0

    def _alive(self, running: Callable[[], bool]) -> "subprocess.Popen[bytes]":
        """The process, started if it is not there, and ready: what that takes is no item's time."""
        if self.process is None or self.process.poll() is not None:
            self.end()
            words = [sys.executable, *self.command]
            own = dict.fromkeys(WORDS_OF_BLAS, "1") | os.environ
            self.answers = Queue()
            self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, env=own)
            threading.Thread(target=_forward, args=(self.process.stdout, self.answers), daemon=True).start()
            if not self._awaited(START, running):
                raise Died(f"{self._epitaph()} before it was ready")
        return self.process

    def _awaited(self, seconds: float | None, running: Callable[[], bool]) -> bytes:
        """The next line of the process; empty if it ended."""
        deadline = None if seconds is None else time.monotonic() + seconds
        while True:
            left = POLL if deadline is None else min(POLL, deadline - time.monotonic())
            try:
                return self.answers.get(timeout=max(left, 0))
            except Empty:
                if deadline is not None and time.monotonic() >= deadline:
                    self.end()
                    raise Ended(f"ended after its time limit of {seconds:g} s") from None
                if not running():
                    self.end()
                    raise Ended("the batch was ended") from None

    def _epitaph(self) -> str:
        """How the process ended."""
        code = None if self.process is None else self.process.wait()
        self.end()
        if code is not None and code < 0:
            return f"its process was ended by {_name(-code)}"
        return f"its process ended with code {code}"


def _name(number: int) -> str:
    """The name of a signal, and what it often means."""
    try:
        name = signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
    return f"{name} (out of memory, or killed)" if name in ("SIGKILL", "SIGABRT") else name


def _forward(pipe: Any, answers: "Queue[bytes]") -> None:
    """Lines of a pipe into a queue, and an empty one at its end."""
    try:
        for line in pipe:
            answers.put(line)
    except (OSError, ValueError):  # closed meanwhile
        pass
    answers.put(b"")


def _close(pipe: Any) -> None:
    """Close a pipe whose other end may be gone."""
    try:
        pipe.close()
    except OSError:
        return
