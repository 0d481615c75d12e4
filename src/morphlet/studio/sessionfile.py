"""The session as a JSON text: which meshes, which edits, poses and markers; positions are computed again from these.

Vertices are numbered as in the mesh files. Edits stand in a table; the present shape and each pose name theirs. What is written beside for
the case of a crash tells the last steps, too: these are made again only when a person goes back to them.
"""

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from morphlet.errors import FileError
from morphlet.studio.document import Document, History, Later, Marker, Pose, Step
from morphlet.studio.edits import ROLES, Edit
from morphlet.studio.messages import (
    BY_NORMAL,
    LARGEST_INDEX,
    LEAST_SCALE,
    MOST_SCALE,
    Field,
    Refusal,
    above,
    choice,
    fields,
    number,
    options,
    or_null,
    several,
    table,
    tables,
    text,
    vertices,
    whole,
)
from morphlet.studio.methods import chosen
from morphlet.studio.model import Model
from morphlet.studio.motion import Mirror, Motion

KIND, VERSION = "morphlet studio session", 1
MOST_EDITS, MOST_POSES, MOST_MARKERS = 10_000, 1_000, 10_000
LONGEST_FINGERPRINT = 64
KEPT_STEPS = 20
"""Steps to either side that are written beside."""

_COUNT = Field(whole(0, LARGEST_INDEX))
_NUMBERS = Field(several(number(), 3))
MESH = {"name": Field(text), "fingerprint": Field(text), "vertices": _COUNT}
MOTION = {"translate": _NUMBERS, "turn": _NUMBERS, "scale": Field(several(number(LEAST_SCALE, MOST_SCALE), 3))}
METHOD = {"name": Field(text), "options": Field(options), "weight": Field(or_null(above(0.0)))}
EDIT = {
    "handle": Field(vertices),
    "free": Field(vertices),
    "anchor": Field(vertices),
    "radius": Field(or_null(above(0.0))),
    "metric": Field(choice("geodesic", "euclidean", "edges")),
    "method": Field(table(METHOD)),
    "mirror": Field(or_null(table(BY_NORMAL))),
    "motion": Field(table(MOTION)),
}


def _indices(value: Any, name: str) -> tuple[int, ...]:
    """Numbers of edits, in the order in which they were made."""
    if not isinstance(value, list) or len(value) > MOST_EDITS:
        raise Refusal("field", f"a list of edits as {name}", "something else", "save the session again")
    return tuple(whole(0, MOST_EDITS)(one, name) for one in value)


POSE = {"name": Field(text), "edits": Field(_indices)}
MARKER = {"source": _COUNT, "target": _COUNT, "label": Field(text, "")}
MESHES = {"source": Field(or_null(table(MESH))), "target": Field(or_null(table(MESH)))}
STATE = {"now": Field(_indices), "poses": Field(tables(POSE, MOST_POSES)), "markers": Field(tables(MARKER, MOST_MARKERS))}
WHOLE = {
    "kind": Field(choice(KIND)),
    "version": Field(whole(1, VERSION)),
    "meshes": Field(table(MESHES)),
    "edits": Field(tables(EDIT, MOST_EDITS)),
    **STATE,
    "past": Field(tables({"label": Field(text), **STATE}, KEPT_STEPS), ()),
    "future": Field(tables({"label": Field(text), **STATE}, KEPT_STEPS), ()),
}


def written(document: Document, source: Model | None, target: Model | None, history: History | None = None) -> str:
    """The session as a text, with its last steps if a history is given.

    Examples
    --------
    >>> from morphlet.studio.document import Document
    >>> from morphlet.studio.sessionfile import read_back, written
    >>> read_back(written(Document(), None, None))["meshes"]
    {'source': None, 'target': None}
    """
    table = _Table(source)
    told = {"kind": KIND, "version": VERSION, "meshes": {"source": _mesh(source), "target": _mesh(target)}, **table.state(document)}
    if history is not None:
        for name, steps in (("past", history.past), ("future", history.future)):
            told[name] = [{"label": label, **table.state(one)} for label, one in steps[-KEPT_STEPS:]]
    return json.dumps(told | {"edits": table.rows})


def read_back(text: str | bytes) -> dict[str, Any]:
    """What a session's text tells, checked.

    Raises
    ------
    FileError
        If it is no session, or one of a later version.
    """
    try:
        told = json.loads(text)
        if not isinstance(told, dict):
            raise FileError("a session file", "JSON of another kind", "choose a file that the studio saved")
        return fields(told, WHOLE, "the session file")
    except Refusal as error:
        raise FileError(error.needed, error.found, "choose a file that this version of the studio can read") from error
    except (ValueError, RecursionError) as error:
        raise FileError("a session file", str(error)[:LONGEST_FINGERPRINT], "choose a file that the studio saved") from error


def restored(told: Mapping[str, Any], source: Model | None, target: Model | None) -> History:
    """What a session's text tells: the document made again, and how to make the steps before and after it.

    Raises
    ------
    FileError
        If it is for other meshes than those that are open.
    MorphletError
        If an edit cannot be made.
    """
    for side, model in (("source", source), ("target", target)):
        _require_same(told["meshes"][side], model, side)
    if source is None:
        return History()
    make = _Chain(source).document
    past, future = ([_later(step, told["edits"], make) for step in told[name]] for name in ("past", "future"))
    return History(make(_full(told, told["edits"])), past, future)


class _Table:
    """The rows of edits, each once, and the states that name them."""

    def __init__(self, model: Model | None) -> None:
        self.model = model
        self.rows: list[dict[str, Any]] = []
        self._place: dict[int, int] = {}
        self._painted: dict[int, dict[str, list[int]]] = {}

    def state(self, one: Document | Later) -> dict[str, Any]:
        """A document, its edits by their rows."""
        if isinstance(one, Later):
            poses = [{"name": pose["name"], "edits": self._numbers(pose["edits"])} for pose in one.told["poses"]]
            return {"now": self._numbers(one.told["now"]), "poses": poses, "markers": list(one.told["markers"])}
        chain = one.finished if one.edit is None else (*one.finished, one.edit)
        markers = [{"source": marker.source, "target": marker.target, "label": marker.label} for marker in one.markers]
        poses = [{"name": pose.name, "edits": self._numbers(pose.edits)} for pose in one.poses]
        return {"now": self._numbers(chain), "poses": poses, "markers": markers}

    def _numbers(self, edits: Sequence[Any]) -> list[int]:
        """Rows of edits, or of what a file told of them."""
        return [] if self.model is None else [self._number(edit, self.model) for edit in edits]

    def _number(self, edit: Any, model: Model) -> int:
        if id(edit) not in self._place:
            self._place[id(edit)] = len(self.rows)
            self.rows.append(self._edit(edit, model) if isinstance(edit, Edit) else edit | {name: edit[name].tolist() for name in ROLES})
        return self._place[id(edit)]

    def _edit(self, edit: Edit, model: Model) -> dict[str, Any]:
        """An edit as a table; edits share their paint."""
        if id(edit.paint) not in self._painted:
            painted = {name: model.outside(np.flatnonzero(edit.paint == own)).tolist() for name, own in ROLES.items()}
            self._painted[id(edit.paint)] = painted
        return self._painted[id(edit.paint)] | {
            "radius": edit.radius,
            "metric": edit.metric,
            "method": edit.choice.told() | {"weight": edit.choice.weight},
            "mirror": None if edit.mirror is None else edit.mirror.told(),
            "motion": {"translate": edit.motion.translate, "turn": edit.motion.turn, "scale": edit.motion.scale},
        }


class _Chain:
    """Makes edits one after the other; what chains have in common is made once."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.made: dict[tuple[int, ...], tuple[Edit, Any]] = {}

    def document(self, told: Mapping[str, Any]) -> Document:
        """The document that a state tells."""
        now = self._edits(told["now"])
        finished, edit = (now[:-1], now[-1]) if now else ((), Edit.fresh(self.model.mesh.vertices))
        poses = tuple(Pose(pose["name"], self._edits(pose["edits"])) for pose in told["poses"] if pose["edits"])
        return Document(edit, finished, poses, tuple(Marker(**one) for one in told["markers"]))

    def _edits(self, rows: Sequence[Mapping[str, Any]]) -> tuple[Edit, ...]:
        """The edits of these rows, each on the shape after the last."""
        edits: list[Edit] = []
        rest = self.model.mesh.vertices
        for count, row in enumerate(rows, 1):
            key = tuple(id(one) for one in rows[:count])
            if key not in self.made:
                self.made[key] = _made(row, self.model, rest), rows
            edits.append(self.made[key][0])
            rest = edits[-1].shape
        return tuple(edits)


def _full(state: Mapping[str, Any], rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """A state with its edits at full length."""
    poses = [{"name": pose["name"], "edits": _chosen(pose["edits"], rows)} for pose in state["poses"]]
    return {"now": _chosen(state["now"], rows), "poses": poses, "markers": state["markers"]}


def _chosen(numbers: Sequence[int], rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    if max(numbers, default=-1) >= len(rows):
        raise FileError(f"edits below {len(rows)} in the session file", str(max(numbers)), "choose another file")
    return [rows[number] for number in numbers]


def _later(step: Mapping[str, Any], rows: Sequence[Mapping[str, Any]], make: Callable[[Mapping[str, Any]], Document]) -> Step:
    """A step that is made when a person goes back to it."""
    return step["label"], Later(_full(step, rows), make)


def _made(row: Mapping[str, Any], model: Model, rest: np.ndarray) -> Edit:
    """An edit on some rest, with its answer."""
    paint = np.zeros(len(rest), np.uint8)
    for name in ROLES:
        paint[model.inside(row[name])] = ROLES[name]
    method, mirror, motion = row["method"], row["mirror"], Motion(**row["motion"])
    way = chosen(method["name"], method["options"], method["weight"])
    plane = None if mirror is None else Mirror(mirror["point"], mirror["normal"])
    return Edit(rest, paint, row["radius"], row["metric"], way, plane, motion).solved(model.mesh)


def _mesh(model: Model | None) -> dict[str, Any] | None:
    if model is None:
        return None
    return {"name": model.name, "fingerprint": model.welded.source.fingerprint, "vertices": model.n_vertices}


def _require_same(told: Mapping[str, Any] | None, model: Model | None, side: str) -> None:
    """Refuse a session of another mesh."""
    if told is None:
        return
    if model is None:
        raise FileError(f"the {side} {told['name']} ({told['vertices']} vertices) of this session", "no mesh", f"open it as {side} first")
    if model.welded.source.fingerprint != told["fingerprint"]:
        needed = f"the {side} {told['name']} ({told['vertices']} vertices) of this session"
        raise FileError(needed, f"{model.name} ({model.n_vertices} vertices), another mesh", f"open that file as {side} first")
