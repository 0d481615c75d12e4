"""What can be downloaded from a session, as bytes with a name."""

import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from morphlet.io.formats import WRITTEN, prepare_rewrite
from morphlet.io.pairs import write_pairs
from morphlet.io.sequences import write_animation
from morphlet.studio import replay, sessionfile
from morphlet.studio.messages import Refusal, choice, number
from morphlet.studio.session import Session
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.sequence import MeshSequence

FRAMES, MOST_FRAMES = 24, 240
"""Of an animation of the morph: two seconds unless told otherwise."""
SECONDS_PER_POSE = 1.0
PLAIN, BINARY, ZIP, JSON, GLB = "text/csv", "application/octet-stream", "application/zip", "application/json", "model/gltf-binary"


@dataclass(frozen=True)
class Download:
    """A file for the page to keep."""

    name: str
    media_type: str
    data: bytes


def mesh(session: Session, query: Mapping[str, str]) -> Download:
    """A mesh as it is now, with what its file carried."""
    slot = choice("source", "target")(query.get("slot", "source"), "slot")
    model = session.desk.model if slot == "source" else session.pairing.target
    if model is None:
        raise Refusal("order", f"a {slot} mesh", "none", "open one first")
    ending = choice(*WRITTEN)(query.get("ending", Path(model.name).suffix.lower()), "ending")
    positions = session.desk.edit.shape if slot == "source" else model.mesh.vertices
    data = prepare_rewrite(model.file, ending)(model.shape(positions))
    session.saved = session.saved or slot == "source"
    return Download(f"{Path(model.name).stem}{'-edited' if slot == 'source' else ''}{ending}", BINARY, data)


def poses(session: Session, query: Mapping[str, str]) -> Download:
    """Rest, the kept poses and the present shape as an animation."""
    model, now = session.desk.opened, session.history.now
    shapes = [model.mesh.vertices, *(pose.shape for pose in now.poses), session.desk.edit.shape]
    different = [shapes[0], *(one for before, one in pairwise(shapes) if not np.array_equal(before, one))]
    if len(different) < 2:
        raise Refusal("order", "a pose beside rest", "none", "move something first")
    positions = np.stack([model.placed(shape) for shape in different])
    sequence = MeshSequence(model.welded.source.topology, positions, np.arange(len(positions), dtype=np.float64))
    data = _written(
        ".glb", lambda path: write_animation(path, sequence, template=model.file, duration=SECONDS_PER_POSE * (len(positions) - 1))
    )
    return Download(f"{Path(model.name).stem}-poses.glb", GLB, data)


def morph(session: Session, query: Mapping[str, str]) -> Download:
    """The morph as an animation."""
    travel, model = session.pairing.travel, session.desk.opened
    if travel is None:
        raise Refusal("order", "a morph", "none", "prepare one first")
    try:
        wanted = int(query.get("frames", FRAMES))
    except ValueError as error:
        raise Refusal("field", "a number of frames", query["frames"], "correct it") from error
    frames = travel.frames(int(number(2, MOST_FRAMES)(wanted, "frames")))
    return Download("morph.glb", GLB, _written(".glb", lambda path: write_animation(path, frames, template=model.file)))


def pairs(session: Session, query: Mapping[str, str]) -> Download:
    """The markers, or the pairs of the correspondence where there are none."""
    found = _pairs(session)
    if found is None or not len(found):
        raise Refusal("order", "markers, or a correspondence", "none", "set markers first")
    return Download("pairs.csv", PLAIN, _written(".csv", lambda path: write_pairs(path, found)))


def correspondence(session: Session, query: Mapping[str, str]) -> Download:
    """The correspondence, as `morphlet correspond` writes it."""
    match = session.pairing.match
    if match is None:
        raise Refusal("order", "a correspondence", "none", "run it first")
    return Download("map.npz", BINARY, _written(".npz", match.result.correspondence.save))


def session_file(session: Session, query: Mapping[str, str]) -> Download:
    """The session itself."""
    text = sessionfile.written(session.history.now, session.desk.model, session.pairing.target)
    session.saved = True
    return Download("session.json", JSON, text.encode())


def script(session: Session, query: Mapping[str, str]) -> Download:
    """The session as a script."""
    travel = session.pairing.travel
    told = None if travel is None else (travel.morph.path, travel.morph.schedule)
    data = replay.archive(session.history.now, (session.desk.opened, session.pairing.target), _pairs(session), told)
    return Download("script.zip", ZIP, data)


WHAT: dict[str, Callable[[Session, Mapping[str, str]], Download]] = {
    "mesh": mesh,
    "poses.glb": poses,
    "morph.glb": morph,
    "pairs.csv": pairs,
    "map.npz": correspondence,
    "session.json": session_file,
    "script.zip": script,
}
"""Every download by its name."""


def _pairs(session: Session) -> VertexPairs | None:
    """The markers; without any, the pairs that were used."""
    if session.history.now.markers:
        return session.history.now.pairs
    return None if session.pairing.match is None else session.pairing.match.result.pairs


def _written(ending: str, write: Callable[[Path], object]) -> bytes:
    """The bytes of a file that something writes."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"file{ending}")
        write(path)
        return path.read_bytes()
