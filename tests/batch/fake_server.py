"""A server that needs no libraries, so that it starts at once: items say what goes wrong with them."""

import json
import os
import signal
import sys
import time
from pathlib import Path

BEGUN: list[str] = []
"""What this process has been asked."""


def answered(words: list[str]) -> dict[str, object]:
    """What the words ask for: to write, to fail, to take long, to be killed."""
    deed, path, output = words[0], Path(words[1]), Path(words[words.index("--output") + 1])
    BEGUN.append(deed)
    if deed == "crash late" and len(BEGUN) > 1:
        os.kill(os.getpid(), signal.SIGKILL)
    if deed == "greedy" and len(BEGUN) > 1:
        return {"error": "needed enough memory", "memory_error": True}
    if deed == "fail":
        return {"error": "needed a better mesh", "memory_error": False, "peak_memory_mb": 1.0}
    if deed == "slow":
        time.sleep(0.5)
    if deed == "hang":
        time.sleep(600)
    if deed == "crash":
        os.kill(os.getpid(), signal.SIGKILL)
    if deed == "orphan":  # the worker that asked
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(600)
    with path.with_suffix(".log").open("a") as log:
        log.write(f"{os.getpid()}\n")
    output.write_bytes(path.read_bytes())
    return {"result": {"verb": deed, "words": words[2:]}, "peak_memory_mb": 1.0}


if __name__ == "__main__":
    print('{"ready": 1}', flush=True)
    for line in sys.stdin:
        print(json.dumps(answered(json.loads(line)["words"])), flush=True)
