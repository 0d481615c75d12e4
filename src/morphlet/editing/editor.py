"""The editor: handle positions to mesh, prepared once for a region."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.editing.arap import Arap
from morphlet.editing.estimated import handle_turns
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.numerics.optimize import OnStep
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

DEFAULT = Arap()
"""The method of an edit that names none."""


@runtime_checkable
class Regrippable(Prepared, Protocol):
    """A prepared method that can change its handle cheaply."""

    def with_roi(self, roi: Roi) -> Prepared | None:
        """Itself for another handle, None where it must be prepared anew."""


@dataclass(frozen=True, eq=False)
class RoiEditor:
    """A region of a mesh that follows its handle.

    Parameters
    ----------
    roi
        What pulls, what follows, what stays.
    method
        How it follows.
    prepared
        The method, ready for the region.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.editor import RoiEditor
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> editor = RoiEditor.prepare(Roi(strip, [4, 5], [2, 3]))
    >>> editor.solve([[0, 2, 0], [1, 2, 0]]).vertices[2:4].round(12).tolist()
    [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]
    """

    roi: Roi
    method: Method
    prepared: Prepared

    @staticmethod
    def prepare(roi: Roi, method: Method = DEFAULT) -> "RoiEditor":
        """Do everything that does not depend on where the handle goes: the only slow line.

        Parameters
        ----------
        roi
            What pulls, what follows, what stays.
        method
            How it follows; `Arap()` by default.

        Raises
        ------
        MeshError
            If a piece of the free vertices is joined neither to the handle nor to anchors.
        """
        return RoiEditor(roi, method, method.prepare(roi))

    def positions(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving` for a pull on the handle, without work on the rest of the mesh.

        Parameters
        ----------
        pull
            Where the handle goes, and whence iterations start.
        on_step
            Told about every iteration; may raise `Cancelled`.

        Returns
        -------
        positions
            In the order of `Roi.moving`; handle vertices that are held exactly are at their targets, bit for bit.

        Raises
        ------
        InputError
            If targets, turns or start have another shape, or hold NaN or infinite values.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.editor import RoiEditor
        >>> from morphlet.editing.method import Pull
        >>> from morphlet.editing.roi import Roi
        >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
        >>> editor = RoiEditor.prepare(Roi(strip, [4, 5], [2, 3]))
        >>> editor.positions(Pull(strip.vertices[[4, 5]])).shape
        (4, 3)
        """
        return self.prepared(pull, on_step)

    def solve(
        self,
        targets: Float[np.ndarray, "h 3"],
        turns: Float[np.ndarray, "g 3"] | None = None,
        start: Float[np.ndarray, "k 3"] | None = None,
        on_step: OnStep | None = None,
    ) -> Mesh:
        """The mesh with its handle at the targets; vertices outside the region keep their place, bit for bit.

        Parameters
        ----------
        targets
            Position of each handle vertex, in the order of `Roi.handle`.
        turns, start
            See `Pull`.
        on_step
            Told about every iteration; may raise `Cancelled`.

        Raises
        ------
        InputError
            If targets, turns or start have another shape, or hold NaN or infinite values.
        """
        vertices = np.array(self.roi.mesh.vertices)
        vertices[self.roi.moving] = self.positions(Pull(targets, turns, start), on_step)
        return self.roi.mesh.with_vertices(vertices)

    def sequence(self, path: Float[np.ndarray, "t h 3"], on_step: OnStep | None = None) -> MeshSequence:
        """One frame per row of the path; turns of the handle add up from frame to frame.

        A frame starts from the last one, moved on as the last moved from the one before, in the proportion of the handle's
        steps: on a steady path that saves most of the iterations.

        Parameters
        ----------
        path
            Targets of every frame.
        on_step
            Told about every iteration of every frame.

        Returns
        -------
        sequence
            At times 0, 1, 2, ...

        Raises
        ------
        InputError
            If the path has another shape, or holds NaN or infinite values.
        """
        checked = _arrays.real(path, "path", (None, len(self.roi.handle), 3))
        frames = np.repeat(self.roi.mesh.vertices[None], len(checked), axis=0)
        start, turns = None, None
        for number, targets in enumerate(checked):
            turns = handle_turns(self.roi, targets, turns)
            frames[number, self.roi.moving] = self.positions(Pull(targets, turns, start), on_step)
            if number + 1 < len(checked):
                start = self._ahead(frames[number - 1] if number else self.roi.mesh.vertices, frames[number], checked[number + 1])
        return MeshSequence(self.roi.mesh.topology, frames, np.arange(len(frames), dtype=np.float64))

    def _ahead(self, before: Float[np.ndarray, "n 3"], now: Float[np.ndarray, "n 3"], targets: Float[np.ndarray, "h 3"]) -> np.ndarray:
        """Where `Roi.moving` would go if it went on as from the frame before to this one, as far as the handle does."""
        last, following = now[self.roi.handle] - before[self.roi.handle], targets - now[self.roi.handle]
        square = float(np.einsum("kd,kd->", last, last))
        share = float(np.clip(np.einsum("kd,kd->", last, following) / square, -1.0, 1.0)) if square > 0 else 0.0
        moving = self.roi.moving
        return now[moving] + share * (now[moving] - before[moving])

    def with_handle(self, handle: Int[np.ndarray, "h"], weight: Float[np.ndarray, "h"] | None = None) -> "RoiEditor":
        """The editor of the same region with another handle; what was handle and is no longer becomes free.

        Parameters
        ----------
        handle
            Vertices that are pulled from now on.
        weight
            How hard each is held, see `Roi`.

        Notes
        -----
        A few free vertices that join the handle, and their leaving, cost no factorization: solves are corrected on the ways from
        these vertices to the root of the elimination tree. With 42 622 free vertices and `Arap`, 1, 50 and 200 vertices cost 1.6, 3.5 and
        12 ms of CPU, the solve in each frame after it 0, 0 and 8 percent more. Too many of them (from some 450 on there) cost one numeric
        factorization (some 40 ms), from which later changes start; so does holding a vertex more softly than it was when last
        factored. Letting go of vertices that were handle from the beginning prepares anew; so does any change for methods other
        than `EstimatedRotations`, `Arap` without smoothing, `Shell` and `Guarded`.
        """
        chosen = _arrays.index(handle, "handle", (None,), self.roi.mesh.n_vertices)
        free = np.zeros(self.roi.mesh.n_vertices, bool)
        free[self.roi.moving] = True
        free[chosen] = False
        roi = Roi(self.roi.mesh, chosen, np.nonzero(free)[0], weight)
        fresh = self.prepared.with_roi(roi) if isinstance(self.prepared, Regrippable) else None
        return RoiEditor.prepare(roi, self.method) if fresh is None else RoiEditor(roi, self.method, fresh)


def edit(roi: Roi, targets: Float[np.ndarray, "h 3"], method: Method = DEFAULT) -> Mesh:
    """The mesh with its handle at the targets: the one-off twin of `RoiEditor`.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.editor import edit
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> edit(Roi(strip, [4, 5], [2, 3]), [[0, 2, 0], [1, 2, 0]]).vertices[:2].tolist()
    [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    """
    return RoiEditor.prepare(roi, method).solve(targets)
