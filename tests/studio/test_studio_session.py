"""The session without a network: what messages do, what they tell, what is written and made again."""

import io
import json
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest

from morphlet import FileError, Mesh, Roi, RoiEditor, read, write
from morphlet.cli import main
from morphlet.studio import recovery, saving
from morphlet.studio.document import MOST_STEPS, Document, History
from morphlet.studio.events import Event, Note
from morphlet.studio.frames import Frame, Kind, Slot
from morphlet.studio.messages import parse
from morphlet.studio.methods import WAYS
from morphlet.studio.session import Session
from studio.shapes import egg, top

UP = {"translate": [0, 0, 0.4]}


def torus() -> Mesh:
    """A ring of 12 by 6 vertices."""
    u, v = (x.ravel() for x in np.meshgrid(*(np.linspace(0, 2 * np.pi, n, endpoint=False) for n in (12, 6)), indexing="ij"))
    i, j = (x.ravel() for x in np.meshgrid(np.arange(12), np.arange(6), indexing="ij"))
    at = lambda a, b: (a % 12) * 6 + b % 6  # noqa: E731
    faces = np.vstack([np.stack([at(i, j), at(i + 1, j), at(i + 1, j + 1)], 1), np.stack([at(i, j), at(i + 1, j + 1), at(i, j + 1)], 1)])
    return Mesh(np.stack([(2 + np.cos(v)) * np.cos(u), (2 + np.cos(v)) * np.sin(u), np.sin(v)], 1), faces)


class Told:
    """A session and what it tells."""

    def __init__(self, folder: Path, *meshes: Mesh) -> None:
        self.events: list[Event] = []
        self.session = Session(recovery.Folder.create(folder / "sessions"), self.events.append)
        for slot, mesh in zip(("source", "target"), meshes, strict=False):
            write(folder / f"{slot}.ply", mesh)
            self.session.open(slot, folder / f"{slot}.ply", f"{slot}.ply")

    def say(self, kind: str, *, client: int = 1, **fields: object) -> dict:
        """A message; its answer."""
        self.session.handle(parse(json.dumps({"type": kind, "id": 5, **fields})), client)
        return next(one.content for one in reversed(self.events) if isinstance(one, Note) and one.content["type"] in ("done", "error"))

    def done(self, kind: str, **fields: object) -> None:
        """A message that must succeed."""
        assert self.say(kind, **fields) == {"type": "done", "id": 5}

    @property
    def state(self) -> dict:
        return self.session.state()

    @property
    def shape(self) -> np.ndarray:
        return self.session.desk.edit.shape

    def frames(self, kind: Kind) -> list[Frame]:
        return [one for one in self.events if isinstance(one, Frame) and one.kind == kind]

    def lift(self, **fields: object) -> None:
        """Paint the top and lift it."""
        self.done("paint", role="handle", mode="set", vertices=top(egg()))
        self.done("transform", transform={**UP, **fields})


@pytest.fixture
def told(tmp_path):
    return Told(tmp_path, egg())


def test_a_drag_ends_at_the_librarys_answer(told):
    mesh, handle = egg(), np.array(top(egg()))
    told.done("paint", role="handle", mode="set", vertices=handle.tolist())
    told.done("drag.begin")
    for k in range(1, 9):
        told.done("drag.move", seq=k, transform={"translate": [0, 0, 0.05 * k]})
    told.done("drag.end", seq=9, transform=UP)
    roi = Roi.within(mesh, handle, told.state["edit"]["radius"])
    expected = RoiEditor.prepare(roi).solve(mesh.vertices[handle] + [0, 0, 0.4], np.zeros((1, 3)))
    assert np.abs(told.shape - expected.vertices).max() < 1e-12
    frame = told.frames(Kind.FRAME)[-1]
    rows = told.frames(Kind.SUBSET)[-1].arrays[0]
    assert np.array_equal(frame.arrays[0], told.shape[rows].astype(np.float32))
    assert np.allclose(frame.arrays[1], expected.vertex_normals[rows], atol=1e-6)


def test_frames_of_a_drag_come_near_the_answer_while_the_hand_rests(told):
    told.done("paint", role="handle", mode="set", vertices=top(egg()))
    told.done("drag.begin")
    told.done("drag.move", seq=1, transform=UP)
    while told.session.idle():
        pass
    resting = told.shape
    told.done("drag.end", seq=2, transform=UP)
    assert np.abs(resting - told.shape).max() < 0.01


def test_late_and_foreign_moves_are_left_alone(told):
    told.done("paint", role="handle", mode="set", vertices=top(egg()))
    told.done("drag.begin")
    told.done("drag.move", seq=5, transform=UP)
    before = told.shape
    told.done("drag.move", seq=4, transform={"translate": [1, 0, 0]})
    told.done("drag.move", client=2, seq=9, transform={"translate": [1, 0, 0]})
    assert told.shape is before
    assert told.say("drag.begin", client=2)["code"] == "held"
    assert told.say("drag.end", client=2, seq=10, transform={})["code"] == "order"
    assert told.say("undo", client=2)["code"] == "held"
    told.done("drag.cancel")
    assert told.session.desk.edit.positions is None


def test_undo_and_redo_go_through_every_step(told):
    told.lift()
    told.done("method", name="biharmonic")
    shapes = [told.shape]
    for _ in range(3):
        told.done("undo")
        shapes.append(told.shape)
    assert told.state["edit"]["painted"]["handle"] == 0
    assert told.say("undo")["code"] == "order"
    for expected in reversed(shapes[:-1]):
        told.done("redo")
        assert told.shape is expected
    assert told.say("redo")["code"] == "order"
    assert told.state["edit"]["method"]["name"] == "biharmonic"


def test_a_preview_is_one_step(told):
    told.done("paint", role="handle", mode="set", vertices=top(egg()))
    before = told.state["edit"]["radius"]
    for radius in (0.5, 0.6, 0.7):
        told.done("roi", radius=radius, live=True)
    told.done("roi", radius=0.8)
    assert told.state["edit"]["radius"] == 0.8
    told.done("undo")
    assert told.state["edit"]["radius"] == before
    told.done("roi", radius=0.9, live=True)
    told.done("undo")
    assert told.state["edit"]["radius"] == before


def test_a_new_method_solves_the_same_pull_again(told):
    told.lift()
    first = told.shape
    told.done("method", name="laplacian", weight=2.0)
    assert not np.array_equal(told.shape, first)
    assert told.state["edit"]["weight"] == 2.0
    assert told.state["edit"]["transform"]["translate"] == (0.0, 0.0, 0.4)


def test_the_next_edit_goes_on_from_the_shape(told):
    told.lift()
    lifted = told.shape
    told.done("edit.next")
    state = told.state["edit"]
    assert (state["number"], state["painted"]["handle"], state["ready"]) == (1, 0, False)
    assert told.shape is lifted
    told.done("paint", role="handle", mode="set", vertices=[0])
    told.done("transform", transform=UP)
    told.done("reset", what="transform")
    assert told.shape is lifted
    told.done("reset", what="all")
    assert np.array_equal(told.shape, egg().vertices)
    told.done("undo")
    assert told.shape is lifted


def test_what_prevents_a_drag_is_told(told):
    assert told.state["edit"]["problem"]["needed"] == "a handle"
    assert told.say("drag.begin")["needed"] == "a handle"
    told.done("paint", role="handle", mode="set", vertices=[0])
    told.done("roi", radius=1e-6)
    assert told.state["edit"]["problem"]["found"] == "1e-06, which reaches none"
    told.done("roi", radius=0.5)
    assert told.state["edit"]["ready"]


def test_a_failed_command_leaves_the_session_as_it_was(told):
    told.lift()
    before = told.session.history.now
    assert told.say("paint", role="handle", mode="set", vertices=[10**6])["code"] == "input"
    assert told.say("pose.remove", index=0)["code"] == "field"
    assert told.say("marker.add", source=0, target=0)["code"] == "order"
    assert told.say("morph", path="linear")["code"] == "order"
    assert told.say("morph.schedule", bands=[])["code"] == "order"
    assert told.session.history.now is before


def test_a_fault_of_the_program_leaves_the_session_as_it_was(told, monkeypatch):
    told.lift()
    before = told.session.history.now
    monkeypatch.setattr(told.session.desk, "next", lambda: 1 / 0)
    answer = told.say("edit.next")
    assert (answer["code"], answer["found"]) == ("internal", "ZeroDivisionError: division by zero")
    assert told.session.history.now is before


def test_numbers_are_those_of_the_metrics(told):
    from morphlet import metrics
    from morphlet.editing.falloff import rate

    told.lift()
    while told.session.idle():
        pass
    mesh, numbers = egg(), told.state["numbers"]
    now = mesh.with_vertices(told.shape)
    assert numbers["energy"] == pytest.approx(metrics.arap_energy(mesh, now), rel=1e-9)
    assert numbers["volume_change"] == pytest.approx(metrics.volume_change(mesh, now), rel=1e-9)
    assert numbers["rate"] == pytest.approx(rate(told.session.desk.edit.region(mesh), now).displacement, rel=1e-9)


def test_volume_change_counts_from_the_file(told):
    from morphlet import metrics

    told.lift()
    told.done("edit.next")
    told.done("paint", role="handle", mode="set", vertices=[0])
    told.done("transform", transform={"translate": [0.3, 0.3, 0]})
    assert told.state["numbers"]["volume_change"] == pytest.approx(metrics.volume_change(egg(), egg().with_vertices(told.shape)), rel=1e-9)


def test_distortion_is_the_stretch_of_the_edges(told):
    told.lift()
    told.done("display", distortion=True)
    frame = told.frames(Kind.FRAME)[-1]
    assert (frame.flags, frame.subset) == (1, 0)
    mesh = egg()
    ends = mesh.topology.edges
    before, after = (np.linalg.norm(x[ends[:, 0]] - x[ends[:, 1]], axis=1) for x in (mesh.vertices, told.shape))
    squares = np.log(after / before) ** 2
    around = [squares[(ends == v).any(axis=1)].mean() for v in range(mesh.n_vertices)]
    assert np.allclose(frame.arrays[2], np.sqrt(around), atol=1e-6)


def test_poses_are_kept_and_saved_as_an_animation(told, tmp_path):
    told.lift()
    told.done("pose.keep", name="up")
    told.done("transform", transform={"translate": [0.3, 0, 0.2]})
    told.done("pose.keep")
    assert [pose["name"] for pose in told.state["poses"]] == ["up", "pose 2"]
    data = saving.poses(told.session, {}).data
    tree = json.loads(data[20 : 20 + int.from_bytes(data[12:16], "little")])
    assert len(tree["animations"]) == 1
    assert len(tree["meshes"][0]["primitives"][0]["targets"]) == 2
    told.done("pose.remove", index=0)
    assert [pose["name"] for pose in told.state["poses"]] == ["pose 2"]


def test_a_marker_is_named_and_keeps_its_ends(tmp_path):
    told = Told(tmp_path, egg(1), egg(1))
    told.done("marker.add", source=3, target=7)
    told.done("marker.label", index=0, label="nose, left")
    assert told.state["markers"] == [{"source": 3, "target": 7, "label": "nose, left"}]
    assert b'"nose, left"' in saving.pairs(told.session, {}).data
    assert told.say("marker.label", index=1, label="x")["found"] == "1"
    told.done("undo")
    assert told.state["markers"][0]["label"] == ""


def test_markers_can_be_moved_removed_and_undone(tmp_path):
    told = Told(tmp_path, egg(), egg(2))
    told.done("marker.add", source=5, target=7, label="nose")
    told.done("marker.add", source=6, target=8)
    told.done("marker.move", index=0, slot="target", vertex=9)
    assert told.state["markers"] == [{"source": 5, "target": 9, "label": "nose"}, {"source": 6, "target": 8, "label": ""}]
    told.done("marker.remove", index=1)
    told.done("markers.clear")
    told.done("undo")
    assert len(told.state["markers"]) == 1
    assert told.say("marker.add", source=0, target=162)["needed"] == "indices from 0 to 161 in the target column of the pairs"
    told.done("sample", slot="target", name="blob")
    told.done("undo")
    assert told.state["markers"] == []


@pytest.fixture(scope="module")
def matched(tmp_path_factory):
    told = Told(tmp_path_factory.mktemp("matched"), egg(2), egg(2).with_vertices(egg(2).vertices * [1.2, 1.0, 0.9]))
    for vertex in (0, 40, 100, 133):
        told.done("marker.add", source=vertex, target=vertex)
    told.done("correspond")
    return told


def test_a_correspondence_is_told_with_spheres_and_images(matched):
    state = matched.state["match"]
    assert (state["current"], state["figures"]["pairs"], state["figures"]["folds_sphere"]) == (True, 4, 0)
    spheres = {frame.slot: frame.arrays[0] for frame in matched.frames(Kind.SPHERE)}
    assert set(spheres) == {Slot.SOURCE, Slot.TARGET}
    assert np.allclose(np.linalg.norm(spheres[Slot.SOURCE], axis=1), 1, atol=1e-6)
    images = matched.frames(Kind.IMAGES)[-1].arrays[0]
    assert np.abs(images - egg(2).vertices * [1.2, 1.0, 0.9]).max() < 0.2
    kinds = [one.content["status"] for one in matched.events if isinstance(one, Note) and one.content["type"] == "job"]
    assert kinds[:2] == ["started", "done"]


def test_a_match_is_not_current_once_markers_or_shape_change(matched):
    matched.done("marker.remove", index=0)
    assert not matched.state["match"]["current"]
    matched.done("undo")
    assert matched.state["match"]["current"]
    matched.done("paint", role="handle", mode="set", vertices=top(egg(2)))
    matched.done("transform", transform=UP)
    assert not matched.state["match"]["current"]
    matched.done("reset", what="all")
    assert matched.state["match"]["current"]


@pytest.mark.parametrize("path", ["linear", "gradient", "wavelet"])
def test_a_morph_goes_from_one_end_to_the_other(matched, path):
    matched.done("morph", path=path)
    ends = egg(2).vertices, matched.session.pairing.match.result.correspondence.positions
    for seq, (time, end) in enumerate(zip((0.0, 1.0), ends, strict=True), 1):
        matched.done("morph.time", client=len(path), seq=seq, time=time)
        frame = matched.frames(Kind.FRAME)[-1]
        assert (frame.slot, frame.seq) == (Slot.MORPH, seq)
        assert np.array_equal(frame.arrays[0], end.astype(np.float32))


def test_bands_have_their_own_times(matched):
    matched.done("morph", path="wavelet")
    bands = matched.state["morph"]["bands"]
    rows = [{"start": 0.5, "duration": 0.5}] * bands
    matched.done("morph.schedule", bands=rows)
    assert matched.state["morph"]["schedule"] == [{"start": 0.5, "duration": 0.5, "easing": "smoothstep"}] * bands
    matched.done("morph.time", client=77, seq=1, time=0.4)
    assert np.allclose(matched.frames(Kind.FRAME)[-1].arrays[0], egg(2).vertices, atol=1e-6)
    assert matched.say("morph.schedule", bands=rows[1:])["needed"] == f"{bands} bands"
    assert matched.say("morph.schedule", bands=[{"start": 0.9, "duration": 0.5}] * bands)["code"] == "input"


def test_regions_of_both_meshes_are_labelled(tmp_path):
    from morphlet import sample

    spiky = sample("spiky", n_vertices=1500)
    told = Told(tmp_path, spiky, spiky)
    told.done("regions")
    state = told.state["regions"]
    assert state["source"]["tips"] == state["target"]["tips"]
    assert state["pairs"] == tuple((k, k) for k in range(len(state["source"]["tips"])))
    labels = told.frames(Kind.LABELS)
    assert np.array_equal(labels[0].arrays[0], labels[1].arrays[0])
    assert set(labels[0].arrays[0]) == {-1, *range(len(state["source"]["tips"]))}


def test_a_job_can_be_stopped(tmp_path):
    told = Told(tmp_path, egg(), egg(2))
    stop = told.session.stop
    emit = told.session.pairing.emit

    def stopping(event: Event) -> None:
        emit(event)
        if isinstance(event, Note) and event.content["type"] == "progress":
            stop.set()

    told.session.emit = stopping
    told.done("correspond")
    statuses = [one.content["status"] for one in told.events if isinstance(one, Note) and one.content["type"] == "job"]
    assert statuses == ["started", "cancelled"]
    assert told.state["match"] is None
    assert told.state["job"] is None


def test_a_mesh_without_a_sphere_is_a_failed_job(tmp_path):
    told = Told(tmp_path, egg(1), torus())
    answer = told.say("correspond")
    statuses = [one.content["status"] for one in told.events if isinstance(one, Note) and one.content["type"] == "job"]
    assert (answer["code"], statuses) == ("mesh", ["started", "failed"])
    assert "genus" in answer["needed"] + answer["found"]


def test_the_session_file_makes_everything_again(tmp_path):
    told = Told(tmp_path, egg(), egg(2))
    told.lift(rotate=[0, 0, np.sin(2.0), np.cos(2.0)])
    told.done("pose.keep", name="up")
    told.done("symmetry", plane={"axis": "y"})
    told.done("paint", role="anchor", mode="set", vertices=[0, 1])
    told.done("edit.next")
    told.done("method", name="mls", options={"alpha": 2})
    told.done("paint", role="handle", mode="set", vertices=[3, 4, 5])
    told.done("transform", transform={"translate": [0.1, 0, 0], "scale": [1, 1.5, 1]})
    told.done("marker.add", source=5, target=7, label="nose")
    saved = saving.session_file(told.session, {}).data
    other = Told(tmp_path, egg(), egg(2))
    other.session.read_session(saved)
    assert np.array_equal(other.shape, told.shape)
    assert other.state["poses"] == told.state["poses"]
    assert np.array_equal(other.session.history.now.poses[0].shape, told.session.history.now.poses[0].shape)
    assert {**other.state, "recoverable": 0, "history": 0, "numbers": 0} == {**told.state, "recoverable": 0, "history": 0, "numbers": 0}


def test_a_session_of_another_mesh_is_refused(told, tmp_path):
    told.lift()
    saved = saving.session_file(told.session, {}).data
    (tmp_path / "other").mkdir()
    other = Told(tmp_path / "other", egg(2))
    before = other.session.history.now
    with pytest.raises(FileError, match=r"source\.ply \(642 vertices\)"):
        other.session.read_session(saved)
    assert other.session.history.now is before


@pytest.mark.parametrize(
    ("change", "match"),
    [
        (lambda told: told.update(version=2), "integer from 1 to 1"),
        (lambda told: told.update(kind="other"), "morphlet studio session"),
        (lambda told: told.update(now=[5]), "edits below"),
        (lambda told: told["edits"][0].update(handle=[10**6]), "indices from 0"),
        (lambda told: told["edits"][0]["motion"].update(scale=[0, 1, 1]), "0.001"),
        (lambda told: told.update(more=1), "known fields"),
    ],
)
def test_a_damaged_session_file_is_refused(told, change, match):
    told.lift()
    content = json.loads(saving.session_file(told.session, {}).data)
    change(content)
    with pytest.raises((FileError, ValueError), match=match):
        told.session.read_session(json.dumps(content).encode())


def replayed(folder: Path, told: Told) -> np.ndarray:
    """What the calls of a session's script make."""
    with zipfile.ZipFile(io.BytesIO(saving.script(told.session, {}).data)) as archive:
        archive.extractall(folder)
    calls = [line.split() for line in (folder / "replay.sh").read_text().splitlines() if line.startswith("morphlet")]
    for call in calls:
        words = [str(folder / word) if "." in word or word.startswith("edited") else word for word in call[1:]]
        assert main([*words, "--quiet"]) == 0
    result = folder / calls[-1][-1]
    return read(result if result.is_file() else sorted(result.glob("frame-*"))[-1]).vertices


def test_the_script_makes_the_same_mesh(tmp_path):
    told = Told(tmp_path, egg())
    told.lift(rotate=[np.sin(0.3), 0, 0, np.cos(0.3)])
    told.done("edit.next")
    told.done("method", name="biharmonic", weight=5.0)
    told.done("symmetry", plane={"axis": "y"})
    told.done("paint", role="handle", mode="set", vertices=np.flatnonzero(egg().vertices[:, 1] > 1.0).tolist())
    told.done("paint", role="anchor", mode="set", vertices=np.flatnonzero(egg().vertices[:, 2] < -1).tolist())
    told.done("transform", transform={"translate": [0, 0.3, 0.1], "rotate": [0, 0, np.sin(1.6), np.cos(1.6)]})
    assert np.abs(replayed(tmp_path, told) - told.shape).max() < 1e-4
    assert {path.name for path in tmp_path.glob("edit-*")} == {"edit-01.toml", "edit-02.toml"}


@pytest.mark.parametrize("method", [name for name in WAYS if name not in ("arap", "biharmonic")])
def test_a_script_has_a_name_for_every_method(tmp_path, method):
    told = Told(tmp_path, egg(2))
    options = {"dual": {"iterations": 2}}.get(method, {})
    told.done("method", name=method, options=options, weight=3.0 if WAYS[method].soft else None)
    told.done("paint", role="handle", mode="set", vertices=top(egg(2)))
    told.done("transform", transform={"translate": [0.1, 0, 0.2]})
    assert np.abs(told.shape - egg(2).vertices).max() > 0.01
    assert np.abs(replayed(tmp_path, told) - told.shape).max() < 1e-4


def test_seams_move_together_and_indices_are_the_files(tmp_path):
    whole = egg()
    cut = whole.faces.copy()
    vertices = np.vstack([whole.vertices, whole.vertices[cut[0]], [[9.0, 9.0, 9.0]]])
    cut[0] = [642, 643, 644]
    told = Told(tmp_path, Mesh(vertices, cut))
    handle = np.union1d(top(whole), cut[0][:1])
    told.done("paint", role="handle", mode="set", vertices=handle.tolist())
    told.done("transform", transform=UP)
    mesh = saving.mesh(told.session, {})
    (tmp_path / "out.ply").write_bytes(mesh.data)
    saved = read(tmp_path / "out.ply")
    assert (saved.n_vertices, mesh.name) == (646, "source-edited.ply")
    assert np.array_equal(saved.vertices[642:645], saved.vertices[whole.faces[0]])
    assert np.array_equal(saved.faces, cut)
    assert np.allclose(saved.vertices[handle], vertices[handle] + [0, 0, 0.4])


def test_every_step_is_written_beside_and_taken_up_again(tmp_path):
    told = Told(tmp_path, egg(), egg(2))
    told.lift()
    told.done("marker.add", source=1, target=2)
    told.session.folder.lock.close()  # as if the process had ended
    other = Told(tmp_path)
    left = other.state["recoverable"]
    assert [(one["meshes"], one["edits"]) for one in left] == [(["source.ply", "target.ply"], 1)]
    other.done("recover", name=left[0]["name"])
    assert np.array_equal(other.shape, told.shape)
    assert other.state["markers"] == told.state["markers"]
    assert other.state["recoverable"] == []
    assert other.say("recover", name="../../etc")["code"] == "field"


def test_steps_can_be_undone_and_redone_after_two_crashes(tmp_path):
    told = Told(tmp_path, egg(2), egg(1))
    told.done("paint", role="handle", mode="set", vertices=top(egg(2)))
    told.done("transform", transform=UP)
    told.done("marker.add", source=1, target=2)
    shapes = [told.shape]
    for name in ("laplacian", "biharmonic"):
        told.done("method", name=name)
        shapes.append(told.shape)
    told.done("undo")
    for _ in range(2):
        told.session.folder.lock.close()  # as if the process had ended
        told = Told(tmp_path)
        told.done("recover", name=told.state["recoverable"][0]["name"])
        assert told.state["history"] == {"undo": "method", "redo": "method"}
        assert np.array_equal(told.shape, shapes[1])
    told.done("redo")
    assert np.array_equal(told.shape, shapes[2])
    told.done("undo")
    told.done("undo")
    assert np.array_equal(told.shape, shapes[0])
    assert [marker["label"] for marker in told.state["markers"]] == [""]
    told.done("undo")
    assert told.state["markers"] == []
    told.done("undo")
    assert np.array_equal(told.shape, egg(2).vertices)
    told.done("undo")
    assert told.state["edit"]["handle"]["count"] == 0
    assert told.say("undo")["code"] == "order"


def test_edits_of_a_mesh_that_was_exchanged_are_kept_aside(tmp_path):
    told = Told(tmp_path, egg())
    told.lift()
    lifted = told.shape
    told.done("sample", slot="source", name="blob")
    (aside,) = told.state["recoverable"]
    assert (aside["meshes"], aside["edits"]) == (["source.ply"], 1)
    told.done("close", slot="source")
    assert len(told.state["recoverable"]) == 1
    told.done("recover", name=aside["name"])
    assert np.array_equal(told.shape, lifted)
    assert told.state["recoverable"] == []


def test_no_job_begins_once_the_server_stops(tmp_path):
    told = Told(tmp_path, egg(1), egg(1))
    told.session.halt()
    told.done("correspond")
    assert told.state["match"] is None


def test_a_held_session_is_not_offered_and_a_saved_one_not_kept(tmp_path):
    told = Told(tmp_path, egg())
    told.lift()
    other = Told(tmp_path)
    assert other.state["recoverable"] == []
    saving.mesh(told.session, {"ending": ".obj"})
    told.session.end()
    assert recovery.left(tmp_path / "sessions") == []
    other.done("sample", slot="source", name="blob")
    other.done("paint", role="handle", mode="set", vertices=[1])
    other.done("transform", transform=UP)
    other.session.end()
    (left,) = recovery.left(tmp_path / "sessions")
    recovery.discard(left)
    assert recovery.left(tmp_path / "sessions") == []


def test_a_later_versions_session_is_left_alone(tmp_path):
    told = Told(tmp_path, egg())
    told.lift()
    file = told.session.folder.path / "session.json"
    file.write_text(file.read_text().replace('"version": 1', '"version": 2'))
    told.session.folder.lock.close()
    assert recovery.left(tmp_path / "sessions") == []
    assert file.exists()


def test_a_disk_that_takes_nothing_is_told_and_editing_goes_on(told, monkeypatch):
    def full(text: str) -> None:
        raise FileError("to write", "no space", "make some")

    monkeypatch.setattr(told.session.folder, "write", full)
    told.lift()
    said = [one.content for one in told.events if isinstance(one, Note) and one.content["type"] == "error"]
    assert [(one["code"], one["found"], one["id"]) for one in said] == [("file", "no space", None)] * 2


def test_history_is_bounded():
    history = History()
    for _ in range(MOST_STEPS + 20):
        history.commit("step", Document())
    assert len(history.past) == MOST_STEPS


def test_the_newest_task_of_a_key_replaces_the_older_one():
    from morphlet.studio.worker import Worker

    begun, go, seen = threading.Event(), threading.Event(), []
    worker = Worker(lambda: False, print)
    worker.put(lambda: (begun.set(), go.wait(10)))
    begun.wait(10)
    for k in range(5):
        worker.put_newest("drag", lambda k=k: seen.append(k))
    worker.put_newest("time", lambda: seen.append("t"))
    worker.put(lambda: seen.append("first"))
    worker.put_newest("gone", lambda: seen.append("never"))
    worker.forget("gone")
    go.set()
    worker.ask(lambda: None).result(10)
    while len(seen) < 3:
        pass
    worker.close()
    assert seen == ["first", 4, "t"]


def test_a_hand_that_moves_is_not_held_up_by_refinement(monkeypatch):
    from morphlet.studio import worker as module

    monkeypatch.setattr(module, "PAUSE_SECONDS", 10.0)
    seen, moved = [], threading.Event()
    worker = module.Worker(lambda: seen.append("refined"), print)
    worker.ask(lambda: None).result(10)
    while not seen:
        pass
    seen.clear()
    for _ in range(3):
        moved.clear()
        worker.put_newest("drag", lambda: (seen.append("moved"), moved.set()))
        assert moved.wait(10)
    worker.ask(lambda: None).result(10)
    worker.close()
    assert seen[:3] == ["moved"] * 3


def test_a_fault_in_a_task_is_told_and_the_worker_goes_on():
    from morphlet.studio.worker import Worker

    faults = []
    worker = Worker(lambda: 1 / 0, faults.append)
    worker.put(lambda: [][0])
    assert worker.ask(lambda: 3).result(10) == 3
    worker.close()
    assert {type(fault) for fault in faults} >= {IndexError}


def test_a_failed_task_tells_who_asked_and_the_worker_goes_on():
    from morphlet.studio.worker import Worker

    worker = Worker(lambda: False, print)
    with pytest.raises(ZeroDivisionError, match="division"):
        worker.ask(lambda: 1 / 0).result(10)
    assert worker.ask(lambda: 3).result(10) == 3
    worker.close()
