"""Workers for the torture: processes with bounded memory that try one thing after another, and are replaced when they hang or die.

A worker imports one module and calls its `attempt(task)` for each line of JSON that comes in; what that returns, an outcome and a note,
goes back as a line. An exception that `attempt` lets through is a failure, and so is silence for longer than a task may take.
"""

import json
import os
import select
import subprocess
import sys
import tempfile
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
LONGEST = 60.0
"""Seconds after which a task counts as hanging."""
ROOM = 4 << 30
"""Bytes of address space beyond what a worker has when it is ready."""
STARTING = 120.0
"""Seconds that a worker may take to import its module."""
OUTCOMES = ("read", "done", "repaired", "refused", "failed")
START = "import sys; sys.path.insert(0, sys.argv[1]); from torture_pool import serve; serve(sys.argv[2], int(sys.argv[3]))"
Task = dict[str, Any]


@dataclass(frozen=True)
class Verdict:
    """What became of a task: one of `OUTCOMES`, why, how long it took, and the worker's largest memory so far beyond its start."""

    outcome: str
    note: str = ""
    seconds: float = 0.0
    megabytes: float = 0.0


@dataclass(eq=False)
class Tally:
    """How many tasks came to which outcome, the longest one, the most memory, and all failures."""

    counts: Counter[str] = field(default_factory=Counter)
    slowest: float = 0.0
    megabytes: float = 0.0
    failures: list[str] = field(default_factory=list)

    def add(self, name: str, found: Verdict) -> None:
        """Count one."""
        self.counts[found.outcome] += 1
        self.slowest, self.megabytes = max(self.slowest, found.seconds), max(self.megabytes, found.megabytes)
        if found.outcome == "failed":
            self.failures.append(f"{name}: {found.note}")

    def row(self, *shown: str) -> list[str | int]:
        """Tried, then the counts of these outcomes."""
        return [sum(self.counts.values()), *(self.counts[name] for name in shown)]


class Worker:
    """A process that tries tasks of one module."""

    def __init__(self, module: str, room: int = ROOM) -> None:
        self.module, self.room = module, room
        self.process: subprocess.Popen[bytes] | None = None
        self.said = tempfile.TemporaryFile()  # noqa: SIM115  closed with the worker

    def __enter__(self) -> "Worker":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()
        self.said.close()

    def ask(self, task: Task, longest: float = LONGEST) -> Verdict:
        """Try a task."""
        process = self._running()
        began = time.perf_counter()
        process.stdin.write(json.dumps(task).encode() + b"\n")
        process.stdin.flush()
        line = self._line(longest)
        seconds = time.perf_counter() - began
        if line is None:
            self.stop()
            return Verdict("failed", f"no answer within {longest:g} s", seconds)
        if not line:
            process.wait()
            ended, self.process = process.returncode, None
            return Verdict("failed", f"the process ended with {ended}", seconds)
        return Verdict(**json.loads(line))

    def stop(self) -> None:
        """End the process."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()
            self.process.stdin.close()
            self.process.stdout.close()
            self.process = None

    def _running(self) -> subprocess.Popen[bytes]:
        """The process, once it is ready."""
        if self.process is None:
            words = [sys.executable, "-c", START, str(HERE), self.module, str(self.room)]
            self.process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=self.said)
            if self._line(STARTING) != b"ready\n":
                self.said.seek(0)
                raise RuntimeError(f"no worker for {self.module}: {self.said.read().decode(errors='replace')[-2000:]}")
        return self.process

    def _line(self, longest: float) -> bytes | None:
        """The next line that the process writes; empty at its end, None if it takes too long."""
        ready, _, _ = select.select([self.process.stdout], [], [], longest)
        return self.process.stdout.readline() if ready else None


def tried(
    module: str, tasks: Iterable[tuple[str, Task]], longest: float = LONGEST, room: int = ROOM
) -> Iterator[tuple[str, Task, Verdict]]:
    """Each task in a worker that is replaced where it ends."""
    with Worker(module, room) as worker:
        for name, task in tasks:
            yield name, task, worker.ask(task, longest)


def serve(module: str, room: int) -> None:
    """Answer tasks from standard input until it ends; what libraries print goes to standard error."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    attempt: Callable[[Task], tuple[str, str]] = import_module(module).attempt
    limit_memory(room)
    before = megabytes()
    answers.write("ready\n")
    answers.flush()
    for line in sys.stdin:
        began = time.perf_counter()
        outcome, note = judged(attempt, json.loads(line))
        found = {"outcome": outcome, "note": note, "seconds": time.perf_counter() - began, "megabytes": max(megabytes() - before, 0.0)}
        answers.write(json.dumps(found) + "\n")
        answers.flush()


def judged(attempt: Callable[[Task], tuple[str, str]], task: Task) -> tuple[str, str]:
    """The outcome and note of a task; any exception is a failure."""
    try:
        return attempt(task)
    except (Exception, SystemExit) as error:  # whatever it is, it should not be
        places = [f"{Path(frame.filename).name}:{frame.lineno}" for frame in traceback.extract_tb(error.__traceback__)]
        return "failed", f"{type(error).__name__}: {str(error)[:160]} ({' '.join(places[-4:])})"


def limit_memory(room: int) -> None:
    """No more address space than this beyond what there is, where the system can hold a process to it."""
    status = Path("/proc/self/status")
    if room <= 0 or not status.exists():
        return
    import resource

    now = next(int(line.split()[1]) << 10 for line in status.read_text().splitlines() if line.startswith("VmSize"))
    resource.setrlimit(resource.RLIMIT_AS, (now + room, now + room))


def megabytes() -> float:
    """The largest memory of this process so far, where the system tells it."""
    status = Path("/proc/self/status")
    lines = status.read_text().splitlines() if status.exists() else []
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmHWM")), 0.0)
