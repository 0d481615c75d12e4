"""Kernels on several threads: fixed pieces, so that the result has the same bits for any number of threads.

Kernels release the interpreter lock; the threads are Python's own, made for one call and gone after it.
"""

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TypeVar

from morphlet.errors import InputError

T = TypeVar("T")

_LIMIT: ContextVar[int | None] = ContextVar("threads", default=None)


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def available() -> int:
    """Threads that kernels may use: as many as this process has cores, or fewer inside `limited`."""
    limit = _LIMIT.get()
    return cores() if limit is None else min(limit, cores())


@contextmanager
def limited(count: int | None) -> Iterator[None]:
    """At most `count` threads for the calls inside; None leaves the number as it is.

    Raises
    ------
    InputError
        If the count is below 1.

    Examples
    --------
    >>> from morphlet.numerics.threads import available, limited
    >>> with limited(1):
    ...     available()
    1
    """
    if count is not None and count < 1:
        raise InputError("at least 1 thread", str(count), "ask for one or more")
    token = _LIMIT.set(_LIMIT.get() if count is None else count)
    try:
        yield
    finally:
        _LIMIT.reset(token)


def each(work: Callable[[int], T], pieces: int) -> list[T]:
    """work(0), work(1), ... in order, on all threads that may be used."""
    threads = min(available(), pieces)
    if threads < 2:
        return [work(piece) for piece in range(pieces)]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(work, range(pieces)))
