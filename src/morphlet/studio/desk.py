"""The desk: one mesh being edited, step by step or by a hand that drags.

Between `begin` and `end` the handle follows a page; all else waits. The answer at the end is computed afresh: it depends on where the hand
let go, not on its way, and a script makes it again.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet.editing.roi import Roi
from morphlet.errors import MorphletError
from morphlet.studio.document import Document, History, Pose
from morphlet.studio.edits import Edit, Paint
from morphlet.studio.events import Emit, Note, problem
from morphlet.studio.frames import WITH_COLORS, Frame, Kind, Slot
from morphlet.studio.grasp import Figures, Grasp, Part
from morphlet.studio.messages import Refusal
from morphlet.studio.methods import Choice
from morphlet.studio.model import Model
from morphlet.studio.motion import Mirror, Motion

NO_FIGURES: Figures = dict.fromkeys(("frame_ms", "iterations", "energy", "rate", "volume_change", "edge_strain"))


@dataclass(frozen=True, eq=False)
class Drag:
    """A drag under way: whose, and what was there before it."""

    client: int
    before: Document
    seq: int = 0


@dataclass(eq=False)
class Desk:
    """A mesh, the history of its edits, and the hand that drags.

    Parameters
    ----------
    emit
        Takes notes and frames.
    history
        Documents; the desk changes their edits and poses.
    """

    emit: Emit
    history: History
    model: Model | None = None
    drag: Drag | None = None
    distortion: bool = False
    figures: Figures = field(default_factory=lambda: dict(NO_FIGURES))
    shortfall: MorphletError | None = None
    """Why a drag cannot begin; None if it can."""
    _roi: Roi | None = None
    _grasp: Grasp | None = None
    _subset: int = 0
    _unmeasured: bool = False

    @property
    def edit(self) -> Edit:
        """The edit in hand.

        Raises
        ------
        Refusal
            If there is no mesh.
        """
        if self.history.now.edit is None:
            raise Refusal("order", "a mesh to edit", "none", "open one first")
        return self.history.now.edit

    @property
    def opened(self) -> Model:
        """The mesh.

        Raises
        ------
        Refusal
            If there is none.
        """
        if self.model is None:
            raise Refusal("order", "a mesh to edit", "none", "open one first")
        return self.model

    def open(self, model: Model | None) -> None:
        """Put a mesh on the desk, or clear it; all edits of the last one are gone."""
        self.model, self.drag = model, None
        self.history.clear(Document() if model is None else Document(Edit.fresh(model.mesh.vertices)))
        if model is not None:
            self.emit(mesh_frame(model, Slot.SOURCE, model.mesh.vertices))
        self._changed()

    def restore(self, history: History) -> None:
        """Take up what was made of this mesh."""
        self.history.resume(history)
        self._changed()

    def idle_hands(self) -> None:
        """Refuse while a page drags."""
        if self.drag is not None:
            raise Refusal("held", "no drag under way", f"page {self.drag.client} drags", "let go first")

    def paint(self, role: str, mode: str, vertices: Int[np.ndarray, "k"]) -> None:
        """Paint vertices of the file; on a new rest if the handle changes after a drag."""
        edit, now = self.edit, self.history.now
        painted = edit.painted(role, mode, self.opened.inside(vertices))
        finished = (*now.finished, edit) if painted.rest is not edit.rest else now.finished
        self._take(f"paint {role}", replace(now, finished=finished, edit=painted), live=False)

    def reach(self, radius: float | None, metric: Any, live: bool) -> None:
        """What follows."""
        self._edited("region", replace(self.edit, radius=radius, metric=metric), live)

    def choose(self, choice: Choice, live: bool) -> None:
        """How it follows."""
        self._edited("method", replace(self.edit, choice=choice), live)

    def mirror(self, plane: Mapping[str, Any] | None) -> None:
        """Whether the handle is mirrored."""
        mesh = self.opened.mesh
        middle = (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0)) / 2
        self._edited("symmetry", replace(self.edit, mirror=None if plane is None else Mirror.of(plane, middle)), live=False)

    def next(self) -> None:
        """A new edit on the present shape, with the same method."""
        edit, now = self.edit, self.history.now
        fresh = replace(edit.following(), paint=np.zeros_like(edit.paint))
        finished = now.finished if edit.positions is None else (*now.finished, edit)
        self._take("next edit", replace(now, finished=finished, edit=fresh), live=False)

    def reset(self, what: str) -> None:
        """Back to this edit's rest, or to the file."""
        if what == "transform":
            self._edited("reset", replace(self.edit, motion=Motion(), positions=None), live=False)
        else:
            fresh = replace(self.edit, rest=self.opened.mesh.vertices, motion=Motion(), positions=None)
            self._take("reset all", replace(self.history.now, finished=(), edit=fresh), live=False)

    def keep(self, name: str) -> None:
        """Keep the present shape as a pose."""
        now = self.history.now
        pose = Pose(name or f"pose {len(now.poses) + 1}", (*now.finished, self.edit))
        self.history.commit("keep pose", replace(now, poses=(*now.poses, pose)))

    def drop(self, index: int) -> None:
        """Forget a pose."""
        now = self.history.now
        if index >= len(now.poses):
            raise Refusal("field", f"a pose from 0 to {len(now.poses) - 1}", str(index), "keep a pose first")
        self.history.commit("remove pose", replace(now, poses=now.poses[:index] + now.poses[index + 1 :]))

    def undo(self) -> None:
        """Back a step."""
        self._gone(self.history.undo(), "undo")

    def redo(self) -> None:
        """Forth a step."""
        self._gone(self.history.redo(), "redo")

    def show(self, distortion: bool) -> None:
        """Whether frames carry distortion."""
        self.distortion = distortion
        if self.model is not None:
            self._show_all()

    def begin(self, client: int) -> None:
        """The handle follows a page from now on."""
        if self.drag is not None and self.drag.client != client:
            self.idle_hands()
        self._ready()
        self.history.settle("preview")
        self.drag = Drag(client, self.history.now)

    def move(self, client: int, seq: int, transform: Mapping[str, Any]) -> None:
        """One frame of a drag; what comes too late is left alone."""
        if self.drag is None or self.drag.client != client or seq <= self.drag.seq:
            return
        self.drag = replace(self.drag, seq=seq)
        self._follow(replace(self.edit, motion=Motion.of(transform, self.edit.motion)), seq)

    def end(self, client: int, seq: int, transform: Mapping[str, Any] | None) -> None:
        """Let go: the answer, and a step that can be undone."""
        drag = self._held_by(client)
        told = self.edit.motion if transform is None else Motion.of(transform, self.edit.motion)
        wanted = replace(self.edit, motion=told)
        self.drag, self.history.now = None, drag.before
        try:
            done = self._finished(wanted, seq)
        except MorphletError:
            self._changed()
            raise
        self.history.commit("drag", replace(drag.before, edit=done))

    def let_go(self, client: int) -> bool:
        """The same where the hand was last, for a page that went away; False if it was not dragging."""
        if self.drag is None or self.drag.client != client:
            return False
        if self.edit.motion == (self.drag.before.edit or self.edit).motion:
            self.cancel(client)
        else:
            self.end(client, self.drag.seq, None)
        return True

    def cancel(self, client: int) -> None:
        """Back to where the drag began."""
        self.history.now, self.drag = self._held_by(client).before, None
        self._changed()

    def refine(self) -> bool:
        """While nothing else is asked: go on with the last frame, then prepare or measure; False if there is nothing to do."""
        grasp = self._grasp
        if self.drag is not None and grasp is not None and not grasp.settled:
            self._follow(self.edit, self.drag.seq)
        elif self._unmeasured and grasp is not None and grasp.fits(self.edit):
            self._unmeasured = False
            self._measure(grasp)
        elif self._grasp is None and self._roi is not None and self.shortfall is None:
            self._prepare_ahead()
        else:
            return False
        return True

    def told(self) -> dict[str, Any] | None:
        """The part of the state that is about the edit."""
        if self.model is None:
            return None
        edit, roi = self.edit, self._roi
        handle = {"count": len(edit.own), "mirrored": len(np.setdiff1d(edit.images(), edit.own))}
        counts = np.bincount(self.model.spread(edit.paint), minlength=len(Paint)).tolist()
        return {
            "number": len(self.history.now.finished),
            "handle": handle | {"center": edit.center.tolist() if len(edit.own) else None},
            "free": 0 if roi is None else len(roi.free),
            "anchors": edit.rest.shape[0] if roi is None else len(roi.anchors),
            "painted": {"free": counts[Paint.FREE], "handle": counts[Paint.HANDLE], "anchor": counts[Paint.ANCHOR]},
            "radius": edit.radius,
            "metric": edit.metric,
            "method": edit.choice.told(),
            "weight": edit.choice.weight,
            "symmetry": None if edit.mirror is None else edit.mirror.told(),
            "transform": edit.motion.told(),
            "ready": self.shortfall is None,
            "problem": None if self.shortfall is None else problem(self.shortfall),
        }

    def _held_by(self, client: int) -> Drag:
        """The drag, if it is this page's."""
        if self.drag is None or self.drag.client != client:
            raise Refusal("order", "a drag of this page", "none", "begin one first")
        return self.drag

    def _gone(self, done: bool, what: str) -> None:
        if not done:
            raise Refusal("order", f"a step to {what}", "none", "go on")
        self._changed()

    def _edited(self, label: str, edit: Edit, live: bool) -> None:
        self._take(label, replace(self.history.now, edit=edit), live)

    def _take(self, label: str, document: Document, live: bool) -> None:
        """Take a document as a preview or as a step, once its answer is there."""
        edit, grasp = document.edit, None
        if edit is not None and not edit.motion.still:
            grasp = self._grasped(edit)
            document = replace(document, edit=grasp.finish(edit))
        if live:
            self.history.show(document)
        else:
            self.history.commit(label, document)
        self._changed(grasp)

    def _changed(self, grasp: Grasp | None = None) -> None:
        """Region, roles and shape anew; the edit may be ready already."""
        self._roi, self.shortfall, self._grasp = None, None, grasp
        self.figures = dict(NO_FIGURES)
        if self.model is None:
            return
        try:
            self._roi = self._region(self.edit) if grasp is None else grasp.roi
        except MorphletError as error:
            self.shortfall = error
        roles = self.model.spread(self.edit.roles(self._roi))
        self.emit(Frame(Kind.ROLES, Slot.SOURCE, self.model.number, (roles,), len(roles)))
        self._show_all()
        if grasp is not None:
            self._announce(grasp)

    def _region(self, edit: Edit) -> Roi:
        return edit.region(self.opened.mesh.with_vertices(edit.rest))

    def _grasped(self, edit: Edit, roi: Roi | None = None) -> Grasp:
        """An edit made ready."""
        self._subset += 1
        return Grasp.prepare(self.opened, edit, self._region(edit) if roi is None else roi, self._subset)

    def _announce(self, grasp: Grasp) -> None:
        """Say which vertices its frames show."""
        if grasp.part.subset:
            self.emit(grasp.part.announced())

    def _show_all(self) -> None:
        """A frame of the whole mesh."""
        frame = Part.whole(self.opened).frame(self.edit.shape, 0, self.distortion)[0]
        self.emit(frame)
        self._unmeasured = True

    def _measure(self, grasp: Grasp) -> None:
        """All figures of the present shape."""
        if self.edit.positions is not None:
            cone = grasp.part.frame(self.edit.shape, 0, with_distortion=False)[1]
            self.figures = self.figures | grasp.quick(self.edit.shape, cone) | grasp.slow(self.edit.shape)
            self._tell(self.drag.seq if self.drag else 0)

    def _ready(self) -> Grasp:
        """The edit made ready.

        Raises
        ------
        MorphletError
            If it cannot be.
        """
        edit = self.edit
        if self.shortfall is not None:
            raise self.shortfall
        if self._grasp is None or not self._grasp.fits(edit):
            self._grasp = self._grasped(edit, self._roi)
            self._announce(self._grasp)
        if edit.positions is not None and self._grasp.last is None:
            self._grasp.last = edit.positions[self._grasp.roi.moving]
        return self._grasp

    def _prepare_ahead(self) -> None:
        """Make the edit ready before a drag begins; what prevents it is told in the state."""
        try:
            self._ready()
        except MorphletError as error:
            self.shortfall = error

    def _follow(self, edit: Edit, seq: int) -> None:
        """A frame of a drag."""
        grasp, began = self._ready(), time.perf_counter()
        positions = grasp.follow(edit)
        self.history.now = replace(self.history.now, edit=replace(edit, positions=positions))
        self._frame(grasp, positions, seq, began)

    def _finished(self, edit: Edit, seq: int) -> Edit:
        """The answer of a drag, shown."""
        grasp, began = self._ready(), time.perf_counter()
        done = grasp.finish(edit)
        self._frame(grasp, done.shape, seq, began)
        return done

    def _frame(self, grasp: Grasp, positions: Float[np.ndarray, "n 3"], seq: int, began: float) -> None:
        """Show positions, and say what is known of them."""
        frame, cone = grasp.part.frame(positions, seq, self.distortion)
        self.emit(frame)
        spent = 1000 * (time.perf_counter() - began)
        self.figures = NO_FIGURES | {"frame_ms": spent, "iterations": grasp.iterations} | grasp.quick(positions, cone)
        self._unmeasured = True
        self._tell(seq)

    def _tell(self, seq: int) -> None:
        self.emit(Note({"type": "numbers", "slot": "source", "seq": seq, **self.figures}, newest=True))


def mesh_frame(model: Model, slot: Slot, positions: Float[np.ndarray, "n 3"]) -> Frame:
    """Positions, normals, faces and colours of a mesh."""
    shading = model.normals(positions)
    faces, placed = model.faces.astype(np.uint32), model.placed(positions).astype(np.float32)
    colors = [] if model.colors is None else [model.colors]
    return Frame(
        Kind.MESH, slot, model.number, [placed, shading, faces, *colors], len(placed), len(faces), flags=WITH_COLORS if colors else 0
    )
