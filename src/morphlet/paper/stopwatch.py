"""How long things take: what the paper calls a frame rate."""

import time
from collections.abc import Callable
from typing import TypeVar

import numpy as np

T = TypeVar("T")
REPEATS = 5
"""Times that a short thing is done for the median of its time."""
LONG = 1.0
"""Seconds of a call that is not repeated."""


def clocked(work: Callable[[], T]) -> tuple[T, float]:
    """What a call gives back, and the seconds it took."""
    began = time.perf_counter()
    found = work()
    return found, time.perf_counter() - began


def median_seconds(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """The median of the seconds that a call takes, after a first one that does not count; of a long call, those of the first."""
    first = clocked(work)[1]
    if first > LONG:
        return first
    return float(np.median([clocked(work)[1] for _ in range(repeats)]))
