"""Schedule: when each resolution of a morph moves.

Bands are counted from coarse to fine. At time t a band is at the share ``S((t - start) / duration)`` of its way, S its easing:
0 before its start, 1 after its end. Every easing is the same backwards, ``S(1 - u) = 1 - S(u)``.
"""

import math
import os
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError

Easing = Literal["linear", "smoothstep", "smootherstep"]
"""How a band gathers and loses speed: not at all, with a continuous speed (3 u^2 - 2 u^3), with a continuous acceleration
(6 u^5 - 15 u^4 + 10 u^3)."""
KEYS = {"start", "duration", "easing"}
DEFAULT_DURATION, DEFAULT_EASING = 0.5, "smoothstep"
"""Of presets in which bands follow one another, and of files that do not say."""
ROUNDING = 1e-9
"""How far start + duration may exceed 1."""


def _linear(u: Any) -> Any:
    """Constant speed."""
    return u


def _smoothstep(u: Any) -> Any:
    """Continuous speed."""
    return u * u * (3 - 2 * u)


def _smootherstep(u: Any) -> Any:
    """Continuous acceleration."""
    return u**3 * (u * (6 * u - 15) + 10)


_CURVES: dict[Easing, Callable[[Any], Any]] = {"linear": _linear, "smoothstep": _smoothstep, "smootherstep": _smootherstep}


def eased(easing: Easing, u: float | np.ndarray) -> Any:
    """Shares of the way for shares of the time.

    Examples
    --------
    >>> eased("smoothstep", np.array([0.0, 0.25, 1.0]))
    array([0.     , 0.15625, 1.     ])
    """
    return _CURVES[easing](u)


@dataclass(frozen=True, eq=False)
class Schedule:
    """Start, duration and easing of each band.

    Parameters
    ----------
    start
        Time at which the band begins to move, from 0.
    duration
        How long it moves; positive, and over at 1.
    easing
        How its speed changes on the way.

    Raises
    ------
    InputError
        If there is no band, a band starts before 0, ends after 1 or takes no time, or there is no such easing.

    Examples
    --------
    >>> from morphlet.motion.schedule import Schedule
    >>> schedule = Schedule([0.0, 0.5], [0.5, 0.5], ("linear", "smoothstep"))
    >>> [schedule(t).tolist() for t in (0.25, 0.5, 0.75)]
    [[0.5, 0.0], [1.0, 0.0], [1.0, 0.5]]
    """

    start: Float[np.ndarray, "b"]
    duration: Float[np.ndarray, "b"]
    easing: tuple[Easing, ...]

    def __post_init__(self) -> None:
        start = _arrays.real(self.start, "start", (None,))
        duration = _arrays.real(self.duration, "duration", (len(start),))
        easing = tuple(self.easing)
        if not len(start) or len(easing) != len(start):
            raise InputError("one easing per band, for one band or more", f"{len(easing)} for {len(start)} bands", "give each band its own")
        wrong = np.flatnonzero((start < 0) | (duration <= 0) | (start + duration > 1 + ROUNDING))
        if len(wrong):
            found = f"{len(wrong)} bands that are not, such as start {start[wrong[0]]:g} with duration {duration[wrong[0]]:g}"
            raise InputError("bands with 0 <= start, 0 < duration and start + duration <= 1", found, "change these bands", wrong)
        unknown = [name for name in easing if name not in get_args(Easing)]
        if unknown:
            raise InputError(f"easings out of {', '.join(get_args(Easing))}", f"{unknown[0]!r}", "choose one of these")
        for name, value in (("start", start), ("duration", duration), ("easing", easing)):
            object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        return Schedule, (np.array(self.start), np.array(self.duration), self.easing)

    def __len__(self) -> int:
        return len(self.start)

    def __repr__(self) -> str:
        spans = (f"{s:g}-{s + d:g} {e}" for s, d, e in zip(self.start, self.duration, self.easing, strict=True))
        return f"Schedule({', '.join(spans)})"

    def __call__(self, t: float | Float[np.ndarray, "n"]) -> Float[np.ndarray, "b *n"]:
        """The share of its way that each band has gone at time t, or at each of several times."""
        late = np.subtract.outer(np.asarray(t, np.float64), self.start) / self.duration
        u = np.moveaxis(np.clip(late, 0.0, 1.0), -1, 0)
        return np.stack([eased(name, x) for name, x in zip(self.easing, u, strict=True)])

    @staticmethod
    def together(bands: int, easing: Easing = "linear") -> "Schedule":
        """All bands from 0 to 1: with the linear easing, straight lines.

        Examples
        --------
        >>> from morphlet.motion.schedule import Schedule
        >>> Schedule.together(2)
        Schedule(0-1 linear, 0-1 linear)
        """
        return Schedule(np.zeros(bands), np.ones(bands), (easing,) * bands)

    @staticmethod
    def coarse_first(bands: int, duration: float = DEFAULT_DURATION, easing: Easing = "smoothstep") -> "Schedule":
        """The coarse shape goes ahead, details follow, each band as long as the others.

        Examples
        --------
        >>> from morphlet.motion.schedule import Schedule
        >>> Schedule.coarse_first(3)
        Schedule(0-0.5 smoothstep, 0.25-0.75 smoothstep, 0.5-1 smoothstep)
        """
        if bands < 2:
            return Schedule.together(bands, easing)
        return Schedule(np.linspace(0.0, 1.0 - duration, bands), np.full(bands, duration), (easing,) * bands)

    @staticmethod
    def fine_first(bands: int, duration: float = DEFAULT_DURATION, easing: Easing = "smoothstep") -> "Schedule":
        """Details go ahead, the coarse shape follows.

        Examples
        --------
        >>> from morphlet.motion.schedule import Schedule
        >>> Schedule.fine_first(3)
        Schedule(0.5-1 smoothstep, 0.25-0.75 smoothstep, 0-0.5 smoothstep)
        """
        first = Schedule.coarse_first(bands, duration, easing)
        return Schedule(first.start[::-1], first.duration, first.easing)

    def mirrored(self) -> "Schedule":
        """The same bands backwards in time: what the way back needs to be this way reversed.

        Examples
        --------
        >>> from morphlet.motion.schedule import Schedule
        >>> Schedule([0.0, 0.25], [0.5, 0.25], ("linear", "linear")).mirrored()
        Schedule(0.5-1 linear, 0.5-0.75 linear)
        """
        return Schedule(np.maximum(1 - self.start - self.duration, 0.0), self.duration, self.easing)

    def over(self, bands: int) -> "Schedule":
        """This schedule for another number of bands: its first for the coarsest, its last for the finest, what lies between for the others.

        Examples
        --------
        >>> from morphlet.motion.schedule import Schedule
        >>> Schedule([0.0, 0.5], [0.5, 0.5], ("linear", "smoothstep")).over(3)
        Schedule(0-0.5 linear, 0.25-0.75 linear, 0.5-1 smoothstep)
        """
        if bands < 1:
            raise InputError("at least one band", str(bands), "ask for one or more")
        place = np.linspace(0, len(self) - 1, bands) if bands > 1 else np.zeros(1)
        own = np.arange(len(self))
        nearest = np.ceil(place - 0.5).astype(np.int64)
        easing = tuple(self.easing[k] for k in nearest)
        return Schedule(np.interp(place, own, self.start), np.interp(place, own, self.duration), easing)

    def write(self, path: str | os.PathLike[str]) -> None:
        """Write a TOML file with a table `[[band]]` of `start`, `duration` and `easing` for each, from coarse to fine.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        lines = [
            f'[[band]]\nstart = {float(s)!r}\nduration = {float(d)!r}\neasing = "{e}"\n'
            for s, d, e in zip(self.start, self.duration, self.easing, strict=True)
        ]
        with _store.beside(path) as temporary:
            temporary.write_text("\n".join(lines), "utf-8")

    @staticmethod
    def read(path: str | os.PathLike[str]) -> "Schedule":
        """Read what `write` wrote; a band without an easing has "smoothstep".

        Raises
        ------
        FileError
            If the file cannot be read, or a band has other keys, or values that no schedule has.

        Examples
        --------
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from morphlet.motion.schedule import Schedule
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "schedule.toml")
        ...     _ = file.write_text("[[band]]\\nstart = 0.25\\nduration = 0.5\\n")
        ...     Schedule.read(file)
        Schedule(0.25-0.75 smoothstep)
        """
        bands = _bands(path)
        try:
            start, duration = ([_number(path, k, band, key) for k, band in enumerate(bands)] for key in ("start", "duration"))
            return Schedule(np.array(start), np.array(duration), tuple(band.get("easing", DEFAULT_EASING) for band in bands))
        except InputError as error:
            raise FileError(f"{error.needed} in {path}", error.found, error.advice, error.elements) from error


def _bands(path: str | os.PathLike[str]) -> list[dict[str, Any]]:
    """The tables of a file."""
    content = _store.toml(path, f"a TOML file of a schedule at {path}")
    bands = content.get("band")
    if set(content) != {"band"} or not isinstance(bands, list) or not all(isinstance(band, dict) for band in bands):
        found = ", ".join(content) or "nothing"
        raise FileError(f"tables [[band]] and nothing else in {path}", found, "write one table [[band]] for each band")
    for k, band in enumerate(bands):
        if set(band) - KEYS or not isinstance(band.get("easing", DEFAULT_EASING), str):
            wanted = f"start and duration, and easing if need be, in band {k} of {path}"
            raise FileError(wanted, ", ".join(f"{key} = {value!r}" for key, value in band.items()), "correct this table", [k])
    return bands


def _number(path: str | os.PathLike[str], k: int, band: dict[str, Any], key: str) -> float:
    """A number of a table."""
    value = band.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise FileError(f"a number as {key} of band {k} in {path}", repr(value), "write a number such as 0.5", [k])
    return float(value)
