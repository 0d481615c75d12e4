"""A long computation: what runs, how far it is, and that it can be stopped."""

import threading
from dataclasses import dataclass, field
from typing import Any

from morphlet.errors import Cancelled
from morphlet.numerics.optimize import Step
from morphlet.studio.events import Emit, Note


@dataclass(eq=False)
class Job:
    """One long computation.

    Parameters
    ----------
    number, kind
        Which one, and the message that asked for it.
    emit
        Takes notes of its progress.
    stop
        Set from any thread to stop it.
    """

    number: int
    kind: str
    emit: Emit
    stop: threading.Event
    stage: str = ""
    share: float | None = None
    _seen: int = field(default=-1)

    def enter(self, stage: str) -> None:
        """Begin another part of the work.

        Raises
        ------
        Cancelled
            If it is to stop.
        """
        self.stage, self.share, self._seen = stage, None, -1
        self._tell()
        self._heed()

    def on_step(self, step: Step) -> None:
        """Progress of an iteration.

        Raises
        ------
        Cancelled
            If it is to stop.
        """
        self.share = step.progress
        percent = int(100 * step.progress)
        if percent != self._seen:
            self._seen = percent
            self._tell()
        self._heed()

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        return {"job": self.number, "kind": self.kind, "stage": self.stage, "share": self.share}

    def _tell(self) -> None:
        self.emit(Note({"type": "progress", **self.told()}, newest=True))

    def _heed(self) -> None:
        if self.stop.is_set():
            raise Cancelled
