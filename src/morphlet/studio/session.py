"""The session: what is open, what was made of it, and what each message does to it. Pure Python, no network, one thread.

Messages go in by `handle` (commands, in order), `follow` (the newest place of a hand or a slider) and `idle`; notes and frames come out
through `emit`. A command that fails leaves the session as it was.
"""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from morphlet import warm
from morphlet.errors import Cancelled, MorphletError
from morphlet.io.formats import write
from morphlet.io.pairs import read_pairs
from morphlet.samples.creatures import sample
from morphlet.studio import recovery, sessionfile
from morphlet.studio.desk import Desk
from morphlet.studio.document import History, Marker
from morphlet.studio.events import Emit, Note, broken, problem, refused
from morphlet.studio.jobs import Job
from morphlet.studio.messages import Message, Refusal
from morphlet.studio.methods import chosen
from morphlet.studio.model import Model
from morphlet.studio.pairing import Pairing

AUTOSAVE_SECONDS = 1.0
"""Between two writings of a drag under way."""
JOBS = ("regions", "correspond", "morph")
"""Messages that start a long computation."""
NEWEST = ("drag.move", "morph.time")
"""Messages of which only the last one counts."""


class Session:
    """What all pages see.

    Parameters
    ----------
    folder
        Where it is written after each step.
    emit
        Takes what it tells; called on the thread that calls its methods.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet.studio.messages import parse
    >>> from morphlet.studio.recovery import Folder
    >>> from morphlet.studio.session import Session
    >>> told = []
    >>> with TemporaryDirectory() as place:
    ...     session = Session(Folder.create(Path(place)), told.append)
    ...     session.handle(parse('{"type": "undo", "id": 1}'), client=1)
    >>> next(note.content["found"] for note in told if note.content["type"] == "error")
    'none'
    """

    def __init__(self, folder: recovery.Folder, emit: Emit) -> None:
        self.folder, self.emit = folder, emit
        self.history = History()
        self.desk = Desk(emit, self.history)
        self.pairing = Pairing(emit, self.desk)
        self.stop = threading.Event()
        self.revision = 0
        self.ending = False
        self.job: Job | None = None
        self.saved = True
        self._opened, self._jobs, self._written = 0, 0, 0.0
        self._shown: dict[str, Any] | None = None
        self._stored: tuple[object, ...] = ()
        self._recoverable = self._found()

    def handle(self, message: Message, client: int) -> None:
        """Do what a message asks, and answer it; every change is told to all, and written."""
        answer = self._answered(message, client)
        self.tell()
        self._write_or_say()
        self._answer(answer)

    def follow(self, message: Message, client: int) -> None:
        """The newest place of a hand or a slider: written once in a while."""
        answer = self._answered(message, client)
        if message.type not in NEWEST:
            self.tell()
        if time.monotonic() - self._written > AUTOSAVE_SECONDS:
            self._write_or_say()
        self._answer(answer)

    def idle(self) -> bool:
        """Nothing else to do: refine, prepare or measure; False if there is nothing of that either."""
        before = self.desk.shortfall, self.desk.figures
        try:
            more = self.desk.refine()
        except MorphletError as error:
            self.desk.shortfall, more = error, False
        if self.desk.drag is None and before != (self.desk.shortfall, self.desk.figures):
            self.tell()
        return more

    def left(self, client: int) -> None:
        """A page went away: what it dragged stays where it was last."""
        self.pairing.gone(client)
        try:
            dragged = self.desk.let_go(client)
        except MorphletError as error:
            dragged = True
            self.emit(refused(error, None, None))
        if dragged:
            self._told_and_written()

    def warm_up(self) -> None:
        """Compile the kernels of editing, if that was not done before."""
        if not warm.compiled("edits"):
            self._work("kernels", lambda job: _compiled(job, "editing", warm.compile_edits))
            self.tell()

    def open(self, slot: str, file: Path, name: str) -> None:
        """Open a mesh file; the session keeps a copy.

        Raises
        ------
        MorphletError
            If it is no mesh.
        """
        self.desk.idle_hands()
        self._opened += 1
        place = self.folder.take(slot, self._opened, file, name)
        try:
            model = Model.open(place, name, self._opened)
        except MorphletError:
            place.unlink()
            raise
        self._put(slot, model, place)
        self._told_and_written()

    def sample(self, slot: str, name: str) -> None:
        """Open a procedural mesh."""
        self.desk.idle_hands()
        mesh = sample(name)
        place = self.folder.path / f"sample-{slot}.ply"
        write(place, mesh)
        try:
            self.open(slot, place, f"{name}.ply")
        finally:
            place.unlink(missing_ok=True)

    def close_mesh(self, slot: str) -> None:
        """Take a mesh away."""
        self.desk.idle_hands()
        self._put(slot, None, None)

    def read_pairs(self, file: Path) -> None:
        """Take the pairs of a file as markers."""
        pairs = read_pairs(file)
        rows = zip(pairs.source, pairs.target, pairs.labels, strict=True)
        self.pairing.take(tuple(Marker(int(s), int(t), label) for s, t, label in rows), "read markers")
        self._told_and_written()

    def read_session(self, text: bytes) -> None:
        """Take up a saved session of the meshes that are open."""
        self.desk.idle_hands()
        self.desk.restore(sessionfile.restored(sessionfile.read_back(text), self.desk.model, self.pairing.target))
        self._told_and_written()

    def recover(self, name: str) -> None:
        """Take up a session that a crash left, with its meshes."""
        found = self._left(name)
        for side, mesh in found.content["meshes"].items():
            file = found.file(side)
            if mesh is not None and file is not None:
                self.open(side, file, mesh["name"])
        self.desk.restore(sessionfile.restored(found.content, self.desk.model, self.pairing.target))
        self.write()
        self._forget(found)

    def state(self) -> dict[str, Any]:
        """All there is to tell but for arrays."""
        history, drag = self.history, self.desk.drag
        return {
            "type": "state",
            "meshes": {"source": self._told(self.desk.model), "target": self._told(self.pairing.target), "morph": self._told_morph()},
            "edit": self.desk.told(),
            "drag": None if drag is None else drag.client,
            "history": {"undo": history.past[-1][0] if history.past else None, "redo": history.future[-1][0] if history.future else None},
            "display": {"distortion": self.desk.distortion},
            "numbers": dict(self.desk.figures),
            "poses": [{"name": pose.name} for pose in history.now.poses],
            **self.pairing.told(),
            "job": None if self.job is None else self.job.told(),
            "recoverable": self._recoverable,
        }

    def tell(self) -> None:
        """Tell all pages the state, if it changed."""
        state = self.state()
        if state != self._shown:
            self._shown = state
            self.revision += 1
            self.emit(Note(state | {"revision": self.revision}, newest=True))

    def write(self) -> None:
        """Write the session beside."""
        content = self.history.now, self.desk.model, self.pairing.target
        if content[1:] != (None, None) and content != self._stored:
            self.folder.write(sessionfile.written(*content, self.history))
            self._stored = content
        self._written = time.monotonic()

    def halt(self) -> None:
        """Stop the job that runs, and every later one: the server is about to stop. From any thread."""
        self.ending = True
        self.stop.set()

    def end(self) -> None:
        """The server stops: what was moved or marked and not saved stays on disk."""
        self.folder.close(keep=self._unsaved)

    def _answered(self, message: Message, client: int) -> Note:
        """Do what a message asks; its answer."""
        try:
            self._permit(message)
            COMMANDS[message.type](self, message, client)
        except MorphletError as error:
            return refused(error, message.id, client)
        except Exception as error:  # a fault of the program must not take the session with it: its documents are values
            return broken(error, message.id, client)
        return Note({"type": "done", "id": message.id}, client)

    def _answer(self, answer: Note) -> None:
        """Answer a message that has a number; errors are told in any case."""
        if answer.content["id"] is not None or answer.content["type"] == "error":
            self.emit(answer)

    def _write_or_say(self) -> None:
        """Write the session beside; that this is not possible is told, and no reason to stop."""
        try:
            self.write()
        except MorphletError as error:
            self.emit(refused(error, None, None))

    @property
    def _unsaved(self) -> bool:
        """Whether there is anything that was made and not saved."""
        now = self.history.now
        return bool(now.edits or now.markers or now.poses) and not self.saved

    def _told_and_written(self) -> None:
        self.tell()
        self._write_or_say()

    def _permit(self, message: Message) -> None:
        """Refuse while a page drags what would change the edit under its hand."""
        if self.desk.drag is not None and message.type not in (
            "drag.begin",
            "drag.move",
            "drag.end",
            "drag.cancel",
            "display",
            "cancel",
            *NEWEST,
        ):
            self.desk.idle_hands()
        self.saved = self.saved and message.type in ("display", "cancel", *NEWEST)

    def _transform(self, message: Message, client: int) -> None:
        """A drag that begins and ends at once."""
        self.desk.begin(client)
        self.desk.end(client, 0, message["transform"])

    def _put(self, slot: str, model: Model | None, place: Path | None) -> None:
        """A mesh into its place; markers and all that goes between the two meshes are gone, but kept aside if they were not saved."""
        if self._unsaved and (slot == "source" or self.history.now.markers):
            self.folder.set_aside(place)
            self._recoverable = self._found()
        self.folder.keep(slot, place)
        if slot == "source":
            self.desk.open(model)
            self.pairing.forget()
        else:
            self.history.unmark()
            self.pairing.open(model)

    def _work(self, kind: str, work: Callable[[Job], None], needs: Callable[[], object] = lambda: None) -> None:
        """A long computation, told from its beginning to its end; `needs` raises if it cannot begin."""
        needs()
        self._jobs += 1
        self.job = job = Job(self._jobs, kind, self.emit, self.stop)
        if not self.ending:
            self.stop.clear()
        self._tell_job(job, "started", None)
        self.tell()
        try:
            if kind in JOBS and not warm.compiled():
                _compiled(job, "maps", warm.compile_kernels)
            work(job)
        except Cancelled:
            self._tell_job(job, "cancelled", None)
        except Exception as error:
            self._tell_job(job, "failed", problem(error))
            raise
        else:
            self._tell_job(job, "done", None)
        finally:
            self.job = None

    def _tell_job(self, job: Job, status: str, error: dict[str, Any] | None) -> None:
        self.emit(Note({"type": "job", "job": job.number, "kind": job.kind, "status": status, "error": error}))

    def _found(self) -> list[dict[str, Any]]:
        """What a page is told of sessions that a crash left."""
        return [one.told() for one in recovery.left(self.folder.path.parent)]

    def _forget(self, one: recovery.Left) -> None:
        recovery.discard(one)
        self._recoverable = self._found()

    def _left(self, name: str) -> recovery.Left:
        """A session that can be taken up, by its name."""
        found = {one.name: one for one in recovery.left(self.folder.path.parent)}
        if name not in found:
            raise Refusal("field", f"one of {', '.join(found) or 'no sessions'} as name", name, "choose one of these")
        return found[name]

    def _told(self, model: Model | None) -> dict[str, Any] | None:
        """What a page is told of a mesh."""
        if model is None:
            return None
        return model.told | {"edited": model is self.desk.model and bool(self.history.now.edits)}

    def _told_morph(self) -> dict[str, Any] | None:
        return None if self.pairing.travel is None else {"mesh": self.pairing.number}


def _compiled(job: Job, what: str, compile_all: Callable[[], object]) -> None:
    """Compile kernels, and say so."""
    job.enter(f"compiling the kernels of {what}: this once")
    compile_all()


COMMANDS: dict[str, Callable[[Session, Message, int], None]] = {
    "sample": lambda s, m, client: s.sample(m["slot"], m["name"]),
    "close": lambda s, m, client: s.close_mesh(m["slot"]),
    "paint": lambda s, m, client: s.desk.paint(m["role"], m["mode"], m["vertices"]),
    "roi": lambda s, m, client: s.desk.reach(m["radius"], m["metric"], m["live"]),
    "method": lambda s, m, client: s.desk.choose(chosen(m["name"], m["options"], m["weight"]), m["live"]),
    "symmetry": lambda s, m, client: s.desk.mirror(m["plane"]),
    "drag.begin": lambda s, m, client: s.desk.begin(client),
    "drag.move": lambda s, m, client: s.desk.move(client, m["seq"], m["transform"]),
    "drag.end": lambda s, m, client: s.desk.end(client, m["seq"], m["transform"]),
    "drag.cancel": lambda s, m, client: s.desk.cancel(client),
    "transform": lambda s, m, client: s._transform(m, client),
    "edit.next": lambda s, m, client: s.desk.next(),
    "reset": lambda s, m, client: s.desk.reset(m["what"]),
    "undo": lambda s, m, client: s.desk.undo(),
    "redo": lambda s, m, client: s.desk.redo(),
    "display": lambda s, m, client: s.desk.show(m["distortion"]),
    "pose.keep": lambda s, m, client: s.desk.keep(m["name"]),
    "pose.remove": lambda s, m, client: s.desk.drop(m["index"]),
    "marker.add": lambda s, m, client: s.pairing.add(Marker(m["source"], m["target"], m["label"])),
    "marker.move": lambda s, m, client: s.pairing.move(m["index"], m["slot"], m["vertex"]),
    "marker.label": lambda s, m, client: s.pairing.name(m["index"], m["label"]),
    "marker.remove": lambda s, m, client: s.pairing.remove(m["index"]),
    "markers.clear": lambda s, m, client: s.pairing.take((), "clear markers"),
    "markers.take": lambda s, m, client: s.pairing.take_matched(),
    "regions": lambda s, m, client: s._work(m.type, s.pairing.find, needs=s.pairing.both),
    "correspond": lambda s, m, client: s._work(m.type, s.pairing.correspond, needs=s.pairing.both),
    "morph": lambda s, m, client: s._work(m.type, lambda job: s.pairing.prepare(m["path"], job), needs=s.pairing.matched),
    "morph.time": lambda s, m, client: s.pairing.at(client, m["seq"], m["time"]),
    "morph.schedule": lambda s, m, client: s.pairing.schedule(m["bands"]),
    "cancel": lambda s, m, client: None,
    "recover": lambda s, m, client: s.recover(m["name"]),
    "discard": lambda s, m, client: s._forget(s._left(m["name"])),
}
"""What each message does."""
