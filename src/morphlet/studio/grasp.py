"""A handle in hand: an edit made ready, the frames of its drag, and the figures that go with them.

A frame shows what can change: the vertices that move and those that share a face with them, of the whole mesh if that is most of it.
"""

import time
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, Int32

from morphlet import metrics
from morphlet.editing.editor import RoiEditor
from morphlet.editing.falloff import smallest_gap
from morphlet.editing.method import Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.numerics.optimize import Step
from morphlet.studio.edits import Edit
from morphlet.studio.frames import ALL, WITH_DISTORTION, Frame, Kind, Slot
from morphlet.studio.kernels import apart, shaded, stretched
from morphlet.studio.methods import continues, shortened
from morphlet.studio.model import Model, in_order
from morphlet.surface.mesh import Mesh, Topology

MOST_OF_IT = 0.6
"""Share of the vertices from which on frames show all: it saves the page to put rows in their places."""
FRAME_SECONDS = 0.02
"""What the iterations of a frame may take: 30 frames a second leave as much again for all else."""
MOST_ITERATIONS = 8
"""Of a frame while the handle moves; what is missing follows when it rests."""

Figures = dict[str, float | int | None]


@dataclass(frozen=True, eq=False)
class Part:
    """What a frame shows of a mesh.

    Parameters
    ----------
    model
        The mesh.
    inside
        Vertices of the welded mesh that are needed, ascending: all of those faces that have a vertex in the frame.
    faces
        These faces, in places of `inside`, neighbours one after the other.
    rows
        Vertices of the file in the frame.
    places
        Place in `inside` of each of them.
    subset
        Number that frames carry; `ALL` if they show the whole mesh.
    """

    model: Model
    inside: Int[np.ndarray, "p"]
    faces: Int32[np.ndarray, "m 3"]
    rows: Int[np.ndarray, "r"]
    places: Int[np.ndarray, "r"]
    subset: int

    @staticmethod
    def whole(model: Model) -> "Part":
        """All of it."""
        every = np.arange(model.mesh.n_vertices)
        rows = np.arange(model.n_vertices)
        return Part(model, every, model.faces_in_order, rows, model.welded.vertex_map[rows], ALL)

    @staticmethod
    def around(model: Model, moving: Int[np.ndarray, "k"], number: int) -> "Part":
        """The vertices that move, and their neighbours."""
        faces, n = model.mesh.faces, model.mesh.n_vertices
        shown = _touching(faces, moving, n)
        if shown.sum() > MOST_OF_IT * n:
            return Part.whole(model)
        own = faces[shown[faces].any(axis=1)]
        inside = np.unique(own)
        place = np.full(n, -1)
        place[inside] = np.arange(len(inside))
        rows = np.flatnonzero(shown[model.welded.vertex_map])
        return Part(model, inside, in_order(place[own]), rows, place[model.welded.vertex_map[rows]], number)

    def announced(self) -> Frame:
        """Which vertices the frames of this part show."""
        rows = self.rows.astype(np.uint32)
        return Frame(Kind.SUBSET, Slot.SOURCE, self.model.number, (rows,), len(rows), subset=self.subset)

    @cached_property
    def _sums(self) -> Float[np.ndarray, "p 3"]:
        """Working space of the kernels."""
        return np.empty((len(self.inside), 3))

    @cached_property
    def _faces_before(self) -> Float[np.ndarray, "p 3"]:
        """Positions in the file."""
        return np.ascontiguousarray(self.model.mesh.vertices[self.inside])

    def frame(self, positions: Float[np.ndarray, "n 3"], seq: int, with_distortion: bool) -> tuple[Frame, float]:
        """The frame of some positions, and six times the cone's volume."""
        own = positions[self.inside] if self.subset else _writable(positions)
        shown, shading = np.empty((2, len(own), 3), np.float32)
        cone = shaded(own, self.faces, self._sums, shown, shading)
        arrays = [self._taken(shown) if self.model.alike else self._placed(own), self._taken(shading)]
        if with_distortion:
            stretch = np.empty(len(own), np.float32)
            stretched(own, self._faces_before, self.faces, self._sums, stretch)
            arrays.append(self._taken(stretch))
        flags = WITH_DISTORTION if with_distortion else 0
        number = self.model.number
        return Frame(Kind.FRAME, Slot.SOURCE, number, arrays, len(self.rows), subset=self.subset, flags=flags, seq=seq), cone

    def _taken(self, values: np.ndarray) -> np.ndarray:
        return values if self.model.alike and not self.subset else values[self.places]

    def _placed(self, own: Float[np.ndarray, "p 3"]) -> np.ndarray:
        """Positions of the frame's vertices, in single precision, as far from the welded ones as in the file."""
        before = self.model.welded.source.vertices[self.rows] - self._faces_before[self.places]
        return (own[self.places] + before).astype(np.float32)


@dataclass(eq=False)
class Grasp:
    """An edit made ready to follow a handle; remembers the last frame, from which the next one goes on.

    Parameters
    ----------
    edit
        The edit at the beginning of the drag.
    editor
        Its region, prepared.
    part
        What its frames show.
    """

    edit: Edit
    editor: RoiEditor
    part: Part
    last: Float[np.ndarray, "k 3"] | None = None
    settled: bool = True
    """Whether more iterations would change nothing."""
    iterations: int = 0
    pace: float = field(default=0.0)
    """Seconds of an iteration, as far as known."""

    @staticmethod
    def prepare(model: Model, edit: Edit, roi: Roi, subset: int) -> "Grasp":
        """Factor: the slow part."""
        return Grasp(edit, RoiEditor.prepare(roi, edit.choice.method()), Part.around(model, roi.moving, subset))

    @property
    def roi(self) -> Roi:
        """The region."""
        return self.editor.roi

    def fits(self, edit: Edit) -> bool:
        """Whether it is ready for this edit, too: the same but for its motion."""
        own = self.edit
        same = edit.rest is own.rest and (edit.paint is own.paint or np.array_equal(edit.paint, own.paint))
        return same and (edit.radius, edit.metric, edit.mirror, edit.choice) == (own.radius, own.metric, own.mirror, own.choice)

    def follow(self, edit: Edit) -> Float[np.ndarray, "n 3"]:
        """Positions while the handle moves: as many iterations as a frame has time for, from the last frame on."""
        pull = edit.pull(self.roi)
        self.edit = edit
        start = self.last if continues(self.editor.prepared) else None
        steps: list[Step] = []
        allowed = MOST_ITERATIONS if not self.pace else int(np.clip(FRAME_SECONDS / self.pace, 1, MOST_ITERATIONS))
        began = time.perf_counter()
        self.last = shortened(self.editor.prepared, allowed)(Pull(pull.targets, pull.turns, start), steps.append)
        self.iterations = len(steps)
        if steps and start is not None:
            self.pace = (time.perf_counter() - began) / len(steps)
        self.settled = not (continues(self.editor.prepared) and len(steps) == allowed)
        return self._whole(self.last)

    def finish(self, edit: Edit) -> Edit:
        """The edit with its answer, which does not depend on the way of the hand."""
        done = edit.solved(self.roi.mesh, self.editor)
        self.edit, self.settled = done, True
        self.last = None if done.positions is None else done.positions[self.roi.moving]
        return done

    def _whole(self, moving: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "n 3"]:
        positions = np.array(self.edit.rest)
        positions[self.roi.moving] = moving
        return positions

    @cached_property
    def _gap(self) -> float | None:
        """The smallest distance between handle and anchors; None if there is none."""
        try:
            return smallest_gap(self.roi) if len(self.roi.anchors) else None
        except InputError:
            return None

    def quick(self, positions: Float[np.ndarray, "n 3"], cone: float) -> Figures:
        """What can be told of each frame: rate (Eq. 12's displacement) and change of volume since the file."""
        before, way = self._volumes[0], apart(_writable(positions), *self._rest)
        change = metrics.signed_percent(self._volumes[1] + (cone - self._volumes[2]) / 6, before)
        return {"rate": None if self._gap is None else 100 * way / self._gap, "volume_change": change if np.isfinite(change) else None}

    @cached_property
    def _rest(self) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "k"]]:
        """The mesh before, and which of its vertices move."""
        return np.array(self.roi.mesh.vertices), np.array(self.roi.moving)

    @cached_property
    def _volumes(self) -> tuple[float, float, float]:
        """Of the mesh in its file, of the mesh at this edit's rest; six times the cone's at rest."""
        rest = self.roi.mesh
        return self.part.model.mesh.volume, rest.volume, self.part.frame(rest.vertices, 0, False)[1]

    def slow(self, positions: Float[np.ndarray, "n 3"]) -> Figures:
        """What is told when the handle rests: energy and strain of this edit."""
        rest = self._patch(self.edit.rest)
        now = rest.with_vertices(positions[self.part.inside])
        energy = metrics.arap_energy(rest, now) * rest.area / self.roi.mesh.area if rest.area else None
        return {"energy": energy, "edge_strain": metrics.edge_strain_rms(rest, now)}

    @cached_property
    def _topology(self) -> Topology:
        return Topology(self.part.faces, len(self.part.inside))

    def _patch(self, positions: Float[np.ndarray, "n 3"]) -> Mesh:
        """The faces around the region."""
        return Mesh(positions[self.part.inside], self._topology)


def _writable(positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """As kernels want them: read-only arrays would be compiled for once more."""
    return positions if positions.flags.writeable else np.array(positions)


def _touching(faces: Int[np.ndarray, "m 3"], vertices: Int[np.ndarray, "k"], n: int) -> np.ndarray:
    """Whether a vertex is one of these, or shares a face with one."""
    chosen = np.zeros(n, bool)
    chosen[vertices] = True
    near = chosen.copy()
    near[faces[chosen[faces].any(axis=1)]] = True
    return near
