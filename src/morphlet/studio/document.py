"""What a person makes in the studio, as a value, and the values before and after it.

Everything that undo can bring back is in the `Document`; what can be computed from it is not.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet.studio.edits import Edit
from morphlet.surface.pairs import VertexPairs

MOST_STEPS = 200
"""Steps that can be undone."""
MOST_BYTES = 256 * 2**20
"""Bytes of positions and paint that they may keep."""


@dataclass(frozen=True)
class Marker:
    """A vertex of the source's file that goes with one of the target's."""

    source: int
    target: int
    label: str = ""

    @property
    def ends(self) -> tuple[int, int]:
        """Its vertices."""
        return self.source, self.target


@dataclass(frozen=True, eq=False)
class Pose:
    """A shape that was kept: the edits that lead to it."""

    name: str
    edits: tuple[Edit, ...]

    @property
    def shape(self) -> Float[np.ndarray, "n 3"]:
        """Its positions."""
        return self.edits[-1].shape


@dataclass(frozen=True, eq=False)
class Document:
    """Edits, kept poses and markers.

    Parameters
    ----------
    edit
        The one in hand; None without a mesh.
    finished
        Those before it, each on the result of the last.
    poses, markers
        In the order in which they were made.
    """

    edit: Edit | None = None
    finished: tuple[Edit, ...] = ()
    poses: tuple[Pose, ...] = ()
    markers: tuple[Marker, ...] = ()

    @property
    def edits(self) -> tuple[Edit, ...]:
        """All edits that moved something."""
        return self.finished if self.edit is None or self.edit.positions is None else (*self.finished, self.edit)

    @property
    def pairs(self) -> VertexPairs:
        """The markers as pairs."""
        source, target = (np.array([getattr(one, side) for one in self.markers], np.int64) for side in ("source", "target"))
        return VertexPairs(source, target, labels=tuple(one.label for one in self.markers))

    def document(self) -> "Document":
        """Itself."""
        return self

    def unmarked(self) -> "Document":
        """The same without markers."""
        return replace(self, markers=())

    def arrays(self) -> dict[int, np.ndarray]:
        """Its arrays by identity: documents share most of theirs."""
        edits = [*self.finished, *([] if self.edit is None else [self.edit]), *(edit for pose in self.poses for edit in pose.edits)]
        found = [array for edit in edits for array in (edit.rest, edit.paint, edit.positions) if array is not None]
        return {id(array): array for array in found}


@dataclass(frozen=True, eq=False)
class Later:
    """A document of a session that was taken up again: made once a person goes back to it.

    Parameters
    ----------
    told
        What its file tells of it, its edits at full length.
    make
        Makes it.
    """

    told: Mapping[str, Any]
    make: Callable[[Mapping[str, Any]], Document]

    def document(self) -> Document:
        """It, made."""
        return self.make(self.told)

    def unmarked(self) -> "Later":
        """The same without markers."""
        return Later({**self.told, "markers": ()}, self.make)


Step = tuple[str, Document | Later]
"""A name, and the document on its other side."""


@dataclass(eq=False)
class History:
    """The document now, and the ones that undo and redo go to, each with the name of the step between."""

    now: Document = field(default_factory=Document)
    past: list[Step] = field(default_factory=list)
    future: list[Step] = field(default_factory=list)
    _before: Document | None = None

    def clear(self, document: Document) -> None:
        """Begin anew."""
        self.now, self.past, self.future, self._before = document, [], [], None

    def resume(self, other: "History") -> None:
        """Go on with another one."""
        self.now, self.past, self.future, self._before = other.now, other.past, other.future, None

    def show(self, document: Document) -> None:
        """A preview: what was there before it is what undo goes back to."""
        self._before = self.now if self._before is None else self._before
        self.now = document

    def commit(self, label: str, document: Document) -> None:
        """A step that can be undone."""
        self.past.append((label, self.now if self._before is None else self._before))
        self.now, self.future, self._before = document, [], None
        del self.past[: max(len(self.past) - MOST_STEPS, 0)]
        while len(self.past) > 1 and self._size() > MOST_BYTES:
            del self.past[0]

    def settle(self, label: str) -> None:
        """Make a step of a preview that nothing followed."""
        if self._before is not None:
            self.commit(label, self.now)

    def unmark(self) -> None:
        """Forget markers, those of all steps, too: one of their meshes was exchanged."""
        self.settle("preview")
        self.now = self.now.unmarked()
        for steps in (self.past, self.future):
            steps[:] = [(label, one.unmarked()) for label, one in steps]

    def undo(self) -> bool:
        """Go back a step, or from a preview; False if there is none."""
        self.settle("preview")
        return self._go(self.past, self.future)

    def redo(self) -> bool:
        """Go forth a step; False if there is none."""
        return self._go(self.future, self.past)

    def _go(self, source: list[Step], other: list[Step]) -> bool:
        if not source:
            return False
        label, there = source[-1]
        document = there.document()
        source.pop()
        other.append((label, self.now))
        self.now = document
        return True

    def _size(self) -> int:
        """Bytes of all documents' arrays, each counted once."""
        every: dict[int, np.ndarray] = {}
        for _, one in self.past:
            every |= one.arrays() if isinstance(one, Document) else {}
        return sum(array.nbytes for array in every.values())
