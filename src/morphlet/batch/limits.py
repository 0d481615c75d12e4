"""What an item may take: its time, its memory, its threads; and how many items a machine holds at once."""

import os
import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from morphlet.errors import InputError
from morphlet.numerics.threads import cores

UNITS = {"": 1, "k": 10**3, "m": 10**6, "g": 10**9, "t": 10**12}
SIZE = re.compile(r"(\d+(?:\.\d+)?)\s*([kmgt]?)b?", flags=re.IGNORECASE)
MEGABYTE = 10**6
LEAST_MEMORY = 400 * MEGABYTE
"""Limit below which libraries and kernels cannot be loaded: they were seen to take 335 MB of data."""
BASE, PER_BYTE = 500 * MEGABYTE, 150
"""Memory of an item without a limit of its own: of libraries and kernels, and for each byte of the largest file. Spherical maps of binary
files were seen to take 130 a byte, of texts up to 100."""
GROUPS = (Path("/sys/fs/cgroup/memory.max"), Path("/sys/fs/cgroup/memory.current"))
"""What a container may have, and has."""


@dataclass(frozen=True)
class Limits:
    """What each item may take.

    Parameters
    ----------
    seconds
        Wall time after which it is ended; any if None.
    memory
        Bytes of data its process may have; any if None.
    threads
        Of its compiled kernels.
    """

    seconds: float | None = None
    memory: int | None = None
    threads: int = 1

    def __post_init__(self) -> None:
        if self.seconds is not None and not self.seconds > 0:
            raise InputError("a time limit above 0 seconds", str(self.seconds), "choose a larger one, or leave it out")
        if self.memory is not None and self.memory < LEAST_MEMORY:
            raise InputError(
                f"a memory limit of {LEAST_MEMORY // MEGABYTE} MB or more", f"{self.memory / MEGABYTE:g} MB", "choose a larger one"
            )
        if self.memory is not None and not limits_memory():
            raise InputError("a system that limits memory, as Linux does", "none", "leave the memory limit out")


def limits_memory() -> bool:
    """Whether this system can limit the data of a process."""
    try:
        import resource
    except ImportError:
        return False
    return hasattr(resource, "RLIMIT_DATA")


def parse_size(text: str) -> int:
    """Bytes of a text such as 800MB or 1.5 GB.

    Raises
    ------
    InputError
        If the text is none.

    Examples
    --------
    >>> parse_size("1.5GB"), parse_size("800 m")
    (1500000000, 800000000)
    """
    found = SIZE.fullmatch(text.strip())
    if found is None:
        raise InputError("a size such as 800MB or 1.5GB", repr(text), "give a number and MB or GB")
    return int(float(found[1]) * UNITS[found[2].lower()])


def available_memory() -> int | None:
    """Bytes that new processes could have on this machine or in this container; None where that cannot be told."""
    known = [bytes_ for bytes_ in (_of_machine(), _of_container()) if bytes_ is not None]
    return min(known) if known else None


def expected_memory(sizes: list[int]) -> int:
    """Bytes that an item may need whose inputs have these sizes: an estimate, for items without a limit.

    Examples
    --------
    >>> expected_memory([1_000_000, 10_000_000]) // 10**6
    2000
    """
    return BASE + PER_BYTE * max(sizes, default=0)


def fitting(need: int, asked: int | None = None) -> int:
    """How many items run at once: as many as were asked for, or cores if none were, but no more than memory holds, and one at least.

    Raises
    ------
    InputError
        If fewer than one were asked for.

    Examples
    --------
    >>> fitting(need=1, asked=3), fitting(need=10**18, asked=3)
    (3, 1)
    """
    if asked is not None and asked < 1:
        raise InputError("1 job or more", str(asked), "ask for one or more")
    wanted = cores() if asked is None else asked
    free = available_memory()
    return wanted if free is None else max(1, min(wanted, free // need))


def _of_machine() -> int | None:
    """Memory that is free, or could be freed without swapping."""
    with suppress(OSError, ValueError, IndexError):
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
        return 1024 * int(next(line for line in lines if line.startswith("MemAvailable")).split()[1])
    with suppress(AttributeError, ValueError, OSError):
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    return None


def _of_container() -> int | None:
    """What is left of a container's memory; None outside of one."""
    with suppress(OSError, ValueError):
        most, used = (int(file.read_text(encoding="ascii")) for file in GROUPS)
        return max(most - used, 0)
    return None
