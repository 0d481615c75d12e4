"""What a page may say: every message with its fields, checked one by one before anything is done.

A message is a JSON object with a `type`; it becomes a `Message` whose values have the types that the session works with, or a `Refusal`.
"""

import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from morphlet.errors import MorphletError

VERSION = 1
"""Of the protocol."""
MOST_TEXT = 8 * 2**20
"""Bytes of a message: a list of a million vertices."""
LONGEST_NAME = 80
"""Letters of a name or a label."""
LARGEST_INDEX = 2**31 - 1
LARGEST_COORDINATE = 1e9
"""In mesh units: beyond it, single precision shows nothing any more."""
UNIT_TOLERANCE = 1e-3
"""How far a quaternion's length may be from 1: pages hold them in single precision and multiply many."""
SHOWN = 40
"""Letters of a value in a refusal."""

Checked = Callable[[Any, str], Any]
"""Turns a value into what the session takes, or raises `Refusal`; the text is what it is called."""


class Refusal(MorphletError):
    """A message that cannot be followed; `code` is one of the protocol's."""

    exit_code = 2

    def __init__(self, code: str, needed: str, found: str, advice: str) -> None:
        super().__init__(needed, found, advice)
        self.code = code

    def __reduce__(self) -> tuple[Any, ...]:
        return Refusal, (self.code, self.needed, self.found, self.advice)


@dataclass(frozen=True)
class Message:
    """One message: its type, the number to answer to, its checked values."""

    type: str
    id: int | None
    values: Mapping[str, Any]

    def __getitem__(self, key: str) -> Any:
        return self.values[key]


@dataclass(frozen=True)
class Field:
    """A field of a message; one with a default may be left out."""

    check: Checked
    default: Any = ...

    @property
    def required(self) -> bool:
        """Whether it must be there."""
        return self.default is ...


def parse(text: str | bytes) -> Message:
    """The message that a text is.

    Raises
    ------
    Refusal
        If it is no JSON object, of no known type, or a field is unknown, missing or wrong.

    Examples
    --------
    >>> from morphlet.studio.messages import parse
    >>> parse('{"type": "roi", "id": 7, "radius": 0.5, "metric": "edges"}').values
    {'radius': 0.5, 'metric': 'edges', 'live': False}
    """
    told = _object(text)
    kind, number = told.pop("type", None), told.pop("id", None)
    if not isinstance(kind, str) or kind not in MESSAGES:
        raise Refusal("type", f"one of {', '.join(MESSAGES)} as type", shown(kind), "see the protocol")
    identity = None if number is None else whole(0, LARGEST_INDEX)(number, "id")
    return Message(kind, identity, fields(told, MESSAGES[kind], kind))


def fields(told: Mapping[str, Any], known: Mapping[str, Field], place: str) -> dict[str, Any]:
    """Checked values of an object's fields, those left out at their defaults."""
    strange = [key for key in told if key not in known]
    if strange:
        raise Refusal("field", f"known fields in {place}: {', '.join(known) or 'none'}", shown(strange[0]), "leave it out")
    missing = [key for key, field in known.items() if field.required and key not in told]
    if missing:
        raise Refusal("field", f"{missing[0]} in {place}", "nothing", "add it")
    return {key: field.check(told[key], f"{key} in {place}") if key in told else field.default for key, field in known.items()}


def number_of(text: str | bytes) -> int | None:
    """The number that an answer to a refused message goes to, if it has one."""
    try:
        number = _object(text).get("id")
    except Refusal:
        return None
    return number if isinstance(number, int) and not isinstance(number, bool) else None


def shown(value: Any) -> str:
    """A value in a message, not too long."""
    text = value if isinstance(value, str) else repr(value)
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."


def _object(text: str | bytes) -> dict[str, Any]:
    try:
        told = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise Refusal("json", "a JSON object", shown(str(error)), "send text frames of JSON") from error
    if not isinstance(told, dict):
        raise Refusal("json", "a JSON object", type(told).__name__, "send an object with a type")
    return told


def wrong(needed: str, name: str, value: Any) -> Refusal:
    """A field that holds something else."""
    return Refusal("field", f"{needed} as {name}", shown(value), "correct it")


def choice(*words: str) -> Checked:
    """One of some words."""

    def check(value: Any, name: str) -> str:
        if not isinstance(value, str) or value not in words:
            raise wrong(f"one of {', '.join(words)}", name, value)
        return value

    return check


def text(value: Any, name: str) -> str:
    """A short text in printable letters."""
    if not isinstance(value, str) or len(value) > LONGEST_NAME or not value.isprintable():
        raise wrong(f"a text of at most {LONGEST_NAME} printable letters", name, value)
    return value


def flag(value: Any, name: str) -> bool:
    """True or false."""
    if not isinstance(value, bool):
        raise wrong("true or false", name, value)
    return value


def whole(low: int, high: int) -> Checked:
    """An integer within bounds."""

    def check(value: Any, name: str) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high:
            raise wrong(f"an integer from {low} to {high}", name, value)
        return value

    return check


def number(low: float = -LARGEST_COORDINATE, high: float = LARGEST_COORDINATE) -> Checked:
    """A finite number within bounds."""

    def check(value: Any, name: str) -> float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not (math.isfinite(value) and low <= value <= high):
            raise wrong(f"a number from {low:g} to {high:g}", name, value)
        return float(value)

    return check


def above(low: float) -> Checked:
    """A finite number above a bound."""
    inside = number(low)

    def check(value: Any, name: str) -> float:
        if inside(value, name) <= low:
            raise wrong(f"a number above {low:g}", name, value)
        return float(value)

    return check


def or_null(check: Checked) -> Checked:
    """None, or what another check takes."""
    return lambda value, name: None if value is None else check(value, name)


def several(check: Checked, count: int) -> Checked:
    """So many values that another check takes."""

    def checked(value: Any, name: str) -> tuple[Any, ...]:
        if not isinstance(value, list) or len(value) != count:
            raise wrong(f"a list of {count}", name, value)
        return tuple(check(one, name) for one in value)

    return checked


def vertices(value: Any, name: str) -> np.ndarray:
    """Vertex numbers from 0, each once, ascending; whether the mesh has them is for the session to say."""
    if not isinstance(value, list) or not all(type(one) is int for one in value):
        raise wrong("a list of vertex numbers", name, value)
    if value and not (min(value) >= 0 and max(value) <= LARGEST_INDEX):
        raise wrong(f"vertex numbers from 0 to {LARGEST_INDEX}", name, min(value) if min(value) < 0 else max(value))
    return np.unique(np.array(value, np.int64))


def table(known: Mapping[str, Field]) -> Checked:
    """An object with such fields."""

    def check(value: Any, name: str) -> dict[str, Any]:
        if not isinstance(value, dict):
            raise wrong("an object", name, value)
        return fields(value, known, name)

    return check


def tables(known: Mapping[str, Field], most: int) -> Checked:
    """A list of such objects."""
    inside = table(known)

    def check(value: Any, name: str) -> tuple[dict[str, Any], ...]:
        if not isinstance(value, list) or len(value) > most:
            raise wrong(f"a list of at most {most} objects", name, value)
        return tuple(inside(one, name) for one in value)

    return check


def options(value: Any, name: str) -> dict[str, Any]:
    """Options of a method; which ones it has is for `methods` to say."""
    if not isinstance(value, dict) or len(value) > MOST_OPTIONS:
        raise wrong(f"an object of at most {MOST_OPTIONS} options", name, value)
    return value


def quaternion(value: Any, name: str) -> tuple[float, ...]:
    """Four numbers of length 1."""
    four: tuple[float, ...] = several(number(-2.0, 2.0), 4)(value, name)
    length = math.sqrt(sum(x * x for x in four))
    if abs(length - 1) > UNIT_TOLERANCE:
        raise wrong("a quaternion of length 1", name, value)
    return tuple(x / length for x in four)


def direction(value: Any, name: str) -> tuple[float, ...]:
    """Three numbers that are not all zero."""
    three: tuple[float, ...] = several(number(), 3)(value, name)
    if not math.hypot(*three) > 0:
        raise wrong("a direction", name, value)
    return three


def plane(value: Any, name: str) -> dict[str, Any]:
    """A plane by axis, or by point and normal."""
    return table(BY_AXIS if isinstance(value, dict) and "axis" in value else BY_NORMAL)(value, name)


MOST_OPTIONS, MOST_BANDS = 16, 64
LEAST_SCALE, MOST_SCALE = 1e-3, 1e3
"""Factors of a handle: beyond these a hand has slipped."""
BY_AXIS = {"axis": Field(choice("x", "y", "z"))}
BY_NORMAL = {"point": Field(several(number(), 3)), "normal": Field(direction)}
TRANSFORM = {
    "translate": Field(several(number(), 3), (0.0, 0.0, 0.0)),
    "rotate": Field(quaternion, (0.0, 0.0, 0.0, 1.0)),
    "scale": Field(several(number(LEAST_SCALE, MOST_SCALE), 3), (1.0, 1.0, 1.0)),
}
BAND = {
    "start": Field(number(0.0, 1.0)),
    "duration": Field(above(0.0)),
    "easing": Field(choice("linear", "smoothstep", "smootherstep"), "smoothstep"),
}
SLOT = Field(choice("source", "target"))
VERTEX = Field(whole(0, LARGEST_INDEX))
SEQ = Field(whole(0, LARGEST_INDEX))
MOVED = {"seq": SEQ, "transform": Field(table(TRANSFORM))}
LIVE = Field(flag, False)

MESSAGES: dict[str, dict[str, Field]] = {
    "hello": {"protocol": Field(whole(0, LARGEST_INDEX))},
    "ack": {"frame": Field(whole(0, 2**32 - 1))},
    "sample": {"slot": SLOT, "name": Field(text)},
    "close": {"slot": SLOT},
    "paint": {
        "role": Field(choice("handle", "free", "anchor")),
        "mode": Field(choice("set", "add", "erase")),
        "vertices": Field(vertices),
    },
    "roi": {"radius": Field(or_null(above(0.0))), "metric": Field(choice("geodesic", "euclidean", "edges"), "geodesic"), "live": LIVE},
    "method": {"name": Field(text), "options": Field(options, {}), "weight": Field(or_null(above(0.0)), None), "live": LIVE},
    "symmetry": {"plane": Field(or_null(plane))},
    "drag.begin": {},
    "drag.move": MOVED,
    "drag.end": MOVED,
    "drag.cancel": {},
    "transform": {"transform": Field(table(TRANSFORM))},
    "edit.next": {},
    "reset": {"what": Field(choice("transform", "all"))},
    "undo": {},
    "redo": {},
    "display": {"distortion": Field(flag)},
    "pose.keep": {"name": Field(text, "")},
    "pose.remove": {"index": VERTEX},
    "marker.add": {"source": VERTEX, "target": VERTEX, "label": Field(text, "")},
    "marker.move": {"index": VERTEX, "slot": SLOT, "vertex": VERTEX},
    "marker.label": {"index": VERTEX, "label": Field(text)},
    "marker.remove": {"index": VERTEX},
    "markers.clear": {},
    "markers.take": {},
    "regions": {},
    "correspond": {},
    "morph": {"path": Field(choice("gradient", "linear", "wavelet"))},
    "morph.time": {"seq": SEQ, "time": Field(number(0.0, 1.0))},
    "morph.schedule": {"bands": Field(tables(BAND, MOST_BANDS))},
    "cancel": {},
    "recover": {"name": Field(text)},
    "discard": {"name": Field(text)},
}
"""Every type of message, and its fields."""
