"""A process that runs verbs on request: what a batch asks of it, a line of JSON each, and a line of JSON each back.

Libraries are imported and kernels loaded once, for many verbs. It ends when its input ends, in the middle of a verb too: then whoever asked
is gone.
"""

import io
import json
import os
import signal
import sys
import threading
import time
from contextlib import redirect_stderr, redirect_stdout, suppress
from pathlib import Path
from queue import Empty, Queue
from typing import Any

from morphlet.cli import main

IDLE = 60.0
"""Seconds without a request after which it ends: workers of a cluster live on when a batch has ended."""
NO_MEMORY = "enough memory"
"""What the command line says was needed when memory was short."""
RESET_PEAK = "5"
"""What Linux is told to forget the highest memory of a process."""


def serve() -> None:
    """Answer requests until none come."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the batch, which ends its servers
    answers = os.fdopen(os.dup(sys.stdout.fileno()), "w", encoding="utf-8")
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # libraries that print
    requests: Queue[bytes] = Queue()
    threading.Thread(target=_read, args=(requests,), daemon=True).start()
    with suppress(Empty, BrokenPipeError):
        import morphlet.pipeline.correspond  # noqa: F401  its libraries take a second or more, which is no item's own

        answers.write(json.dumps({"ready": os.getpid()}) + "\n")
        answers.flush()
        while True:
            answers.write(json.dumps(_answer(json.loads(requests.get(timeout=IDLE)))) + "\n")
            answers.flush()
    os._exit(0)  # the other thread still reads


def _read(requests: "Queue[bytes]") -> None:
    """Requests into a queue; with their end the process ends, whatever it does."""
    for line in sys.stdin.buffer:
        requests.put(line)
    os._exit(0)


def _answer(request: dict[str, Any]) -> dict[str, Any]:
    """Run a verb: its result, or its error, and what it took."""
    _limit(request["memory"])
    _forget_peak()
    began, out, said = time.perf_counter(), io.StringIO(), io.StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(said):
            code = main(request["words"])
        result = json.loads(out.getvalue())
    except MemoryError:
        code, result = 1, {"error": {"needed": NO_MEMORY, "message": f"needed {NO_MEMORY}; found too little for this input"}}
    except Exception as error:  # a batch goes on, whatever is wrong with one item
        code, result = 1, {"error": {"message": f"{type(error).__name__}: {error}"}}
    finally:
        _limit(None)
    wrong = result.get("error") if code else None
    took = {"seconds": round(time.perf_counter() - began, 4), "peak_memory_mb": _peak()}
    if wrong is None:
        return {"result": result} | took
    return {"error": wrong["message"], "memory_error": wrong.get("needed") == NO_MEMORY} | took


def _limit(memory: int | None) -> None:
    """Limit the data of this process."""
    if sys.platform != "win32":
        import resource

        if hasattr(resource, "RLIMIT_DATA"):
            most = resource.getrlimit(resource.RLIMIT_DATA)[1]
            resource.setrlimit(resource.RLIMIT_DATA, (most if memory is None else memory, most))


def _forget_peak() -> None:
    """Count the highest memory from here on, where the system can."""
    with suppress(OSError):
        Path("/proc/self/clear_refs").write_text(RESET_PEAK, encoding="ascii")


def _peak() -> float | None:
    """The highest memory since, in megabytes; since the process began where the system cannot tell the verb's own."""
    with suppress(OSError, StopIteration):
        lines = Path("/proc/self/status").read_text(encoding="ascii").splitlines()
        return round(int(next(line for line in lines if line.startswith("VmHWM")).split()[1]) * 1024 / 1e6, 1)
    if sys.platform == "win32":
        return None
    import resource

    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1e6 if sys.platform == "darwin" else 1e3), 1)


if __name__ == "__main__":
    serve()
