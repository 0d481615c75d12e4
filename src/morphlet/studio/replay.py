"""The session as a script: one file per edit for `morphlet deform`, pairs for `morphlet correspond`, and the calls in order."""

import io
import json
import shlex
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from morphlet.io.pairs import write_pairs
from morphlet.motion.schedule import Schedule
from morphlet.studio.document import Document
from morphlet.studio.edits import Edit
from morphlet.studio.model import Model
from morphlet.surface.pairs import VertexPairs

KEPT = (".ply", ".obj", ".off")
"""Endings of files that an edit may be written to and read from again without a change of numbering or precision."""
EPOCH = (1980, 1, 1, 0, 0, 0)
"""Time of every file in the archive: the same session, the same bytes."""
HEAD = "#!/bin/sh\n# Makes again what was made in the studio; run it in a folder with the mesh files.\nset -e\n"


def specification(edit: Edit, model: Model) -> dict[str, Any]:
    """An edit as the table that a `deform` file holds."""
    roi = edit.region(model.mesh.with_vertices(edit.rest))
    told = edit.choice.script() | {"handle": model.outside(roi.handle).tolist()}
    if edit.plain:
        told["roi"] = {"radius": edit.radius, "metric": edit.metric}
    else:
        told["anchors"] = model.outside(roi.anchors).tolist()
    if edit.told_by_motion:
        return told | _motion(edit)
    ways = [edit.targets(roi, place / edit.places) for place in range(1, edit.places + 1)]
    frames = [{"targets": way.tolist()} for way in ways]
    return told | (frames[0] if len(frames) == 1 else {"path": frames})


def toml(table: Mapping[str, Any]) -> str:
    """A table of numbers, texts, lists and tables as TOML.

    Examples
    --------
    >>> from morphlet.studio.replay import toml
    >>> print(toml({"method": "arap", "roi": {"radius": 0.5}, "translate": [0.0, 1.0, 0.0], "volume": True}))
    method = "arap"
    roi = {radius = 0.5}
    translate = [0.0, 1.0, 0.0]
    volume = true
    <BLANKLINE>
    """
    return "".join(f"{key} = {_value(value)}\n" for key, value in table.items())


def archive(
    document: Document,
    meshes: tuple[Model, Model | None],
    pairs: VertexPairs | None = None,
    morph: tuple[str, Schedule | None] | None = None,
) -> bytes:
    """A zip archive of all that makes the session again.

    Parameters
    ----------
    document
        Edits and markers.
    meshes
        Source and target.
    pairs
        Those of the correspondence, where there are no markers.
    morph
        Path and schedule of the morph, if there is one.
    """
    source, target = meshes
    files, name = {}, source.name
    calls, ending = [], Path(source.name).suffix.lower()
    ending = ending if ending in KEPT else KEPT[0]
    for count, edit in enumerate(document.edits, 1):
        spec, made = f"edit-{count:02d}.toml", f"edited-{count:02d}{ending}"
        files[spec] = toml(specification(edit, source)).encode()
        calls.append(_deform(name, spec, made, edit))
        name = _result(made, edit)
    used = document.pairs if len(document.markers) else pairs
    if used is not None and len(used):
        files["pairs.csv"] = _csv(used)
    if target is not None:
        ends = [name, target.name, *(["--pairs", "pairs.csv"] if "pairs.csv" in files else [])]
        calls.append(["morphlet", "correspond", *ends, "-o", "map.npz"])
        calls += [] if morph is None else [_morph(ends, morph, files)]
    lines = [shlex.join(call) for call in calls]
    files["replay.sh"] = (HEAD + "".join(f"{line}\n" for line in lines)).encode()
    return _zipped(files)


def _motion(edit: Edit) -> dict[str, Any]:
    """Scale, turn and shift as `deform` tells them."""
    own = edit.motion
    told: dict[str, Any] = {} if own.scale[0] == 1 else {"scale": own.scale[0]}
    if own.angle:
        told["rotate"] = {"axis": list(own.turn), "degrees": float(np.degrees(own.angle))}
    return told | {"translate": list(own.translate)}


def _deform(mesh: str, spec: str, made: str, edit: Edit) -> list[str]:
    """The call for one edit; one that is told by a path makes a folder."""
    return ["morphlet", "deform", mesh, spec, "-o", made if _single(edit) else Path(made).stem]


def _result(made: str, edit: Edit) -> str:
    """The file that the next edit goes on from."""
    return made if _single(edit) else f"{Path(made).stem}/frame-{edit.places - 1:03d}{Path(made).suffix}"


def _single(edit: Edit) -> bool:
    return edit.told_by_motion or edit.places == 1


def _morph(ends: list[str], morph: tuple[str, Schedule | None], files: dict[str, bytes]) -> list[str]:
    """The call for the morph; its schedule goes into a file."""
    path, schedule = morph
    call = ["morphlet", "morph", *ends, "--path", path, "-o", "morph"]
    if schedule is None:
        return call
    with tempfile.TemporaryDirectory() as folder:
        schedule.write(Path(folder, "schedule.toml"))
        files["schedule.toml"] = Path(folder, "schedule.toml").read_bytes()
    return [*call, "--schedule", "schedule.toml"]


def _csv(pairs: VertexPairs) -> bytes:
    """Pairs as `morphlet correspond` reads them."""
    with tempfile.TemporaryDirectory() as folder:
        write_pairs(Path(folder, "pairs.csv"), pairs)
        return Path(folder, "pairs.csv").read_bytes()


def _zipped(files: Mapping[str, bytes]) -> bytes:
    """A zip archive."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in files.items():
            archive.writestr(zipfile.ZipInfo(name, EPOCH), data, zipfile.ZIP_DEFLATED)
    return stream.getvalue()


def _value(value: Any) -> str:
    """A value as TOML."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {_value(one)}" for key, one in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(_value(one) for one in value) + "]"
    return json.dumps(value)  # texts, numbers and truth values are told alike in JSON and TOML
