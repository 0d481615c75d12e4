"""The session as a JSON text: which meshes, which edits, poses and markers; positions are computed again from these.

Vertices are numbered as in the mesh files. Edits stand in a table; the present shape and each pose name theirs.
"""

import json
from collections.abc import Mapping
from typing import Any

import numpy as np

from morphlet.errors import FileError
from morphlet.studio.document import Document, Marker, Pose
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
WHOLE = {
    "kind": Field(choice(KIND)),
    "version": Field(whole(1, VERSION)),
    "meshes": Field(table(MESHES)),
    "edits": Field(tables(EDIT, MOST_EDITS)),
    "now": Field(_indices),
    "poses": Field(tables(POSE, MOST_POSES)),
    "markers": Field(tables(MARKER, MOST_MARKERS)),
}


def written(document: Document, source: Model | None, target: Model | None) -> str:
    """The session as a text.

    Examples
    --------
    >>> from morphlet.studio.document import Document
    >>> from morphlet.studio.sessionfile import read_back, written
    >>> read_back(written(Document(), None, None))["meshes"]
    {'source': None, 'target': None}
    """
    chains = [document.finished if document.edit is None else (*document.finished, document.edit), *(pose.edits for pose in document.poses)]
    every = list({id(edit): edit for chain in chains for edit in chain}.values())
    place = {id(edit): k for k, edit in enumerate(every)}
    rows = [[place[id(edit)] for edit in chain] for chain in chains]
    told = {
        "kind": KIND,
        "version": VERSION,
        "meshes": {"source": _mesh(source), "target": _mesh(target)},
        "edits": [] if source is None else [_edit(edit, source) for edit in every],
        "now": rows[0],
        "poses": [{"name": pose.name, "edits": row} for pose, row in zip(document.poses, rows[1:], strict=True)],
        "markers": [{"source": one.source, "target": one.target, "label": one.label} for one in document.markers],
    }
    return json.dumps(told)


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


def restored(told: Mapping[str, Any], source: Model | None, target: Model | None) -> Document:
    """The document that a session's text tells, all edits made again.

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
        return Document()
    chain = _Chain(told["edits"], source)
    now = chain(told["now"])
    finished, edit = (now[:-1], now[-1]) if now else ((), Edit.fresh(source.mesh.vertices))
    poses = tuple(Pose(pose["name"], chain(pose["edits"])) for pose in told["poses"] if pose["edits"])
    return Document(edit, finished, poses, tuple(Marker(**one) for one in told["markers"]))


class _Chain:
    """Makes edits one after the other; what chains have in common is made once."""

    def __init__(self, rows: tuple[dict[str, Any], ...], model: Model) -> None:
        self.rows, self.model = rows, model
        self.made: dict[tuple[int, ...], Edit] = {}

    def __call__(self, numbers: tuple[int, ...]) -> tuple[Edit, ...]:
        """The edits with these numbers, each on the shape after the last."""
        edits: list[Edit] = []
        rest = self.model.mesh.vertices
        for count, row in enumerate(numbers, 1):
            key = tuple(numbers[:count])
            if key not in self.made:
                if row >= len(self.rows):
                    raise FileError(f"edits below {len(self.rows)} in the session file", str(row), "choose another file")
                self.made[key] = _made(self.rows[row], self.model, rest)
            edits.append(self.made[key])
            rest = edits[-1].shape
        return tuple(edits)


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


def _edit(edit: Edit, model: Model) -> dict[str, Any]:
    """An edit as a table."""
    painted = {name: model.outside(np.flatnonzero(edit.paint == own)).tolist() for name, own in ROLES.items()}
    motion = {"translate": edit.motion.translate, "turn": edit.motion.turn, "scale": edit.motion.scale}
    return painted | {
        "radius": edit.radius,
        "metric": edit.metric,
        "method": edit.choice.told() | {"weight": edit.choice.weight},
        "mirror": None if edit.mirror is None else edit.mirror.told(),
        "motion": motion,
    }


def _require_same(told: Mapping[str, Any] | None, model: Model | None, side: str) -> None:
    """Refuse a session of another mesh."""
    if told is None:
        return
    if model is None:
        raise FileError(f"the {side} {told['name']} ({told['vertices']} vertices) of this session", "no mesh", f"open it as {side} first")
    if model.welded.source.fingerprint != told["fingerprint"]:
        needed = f"the {side} {told['name']} ({told['vertices']} vertices) of this session"
        raise FileError(needed, f"{model.name} ({model.n_vertices} vertices), another mesh", f"open that file as {side} first")
