"""What a session tells: notes in JSON, and frames."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from morphlet.errors import MorphletError
from morphlet.studio.frames import Frame
from morphlet.studio.messages import Refusal


@dataclass(frozen=True)
class Note:
    """A message to one page, or to all.

    Parameters
    ----------
    content
        Its fields.
    client
        Number of the page; None for all.
    newest
        Whether a page needs only the last note of this type.
    """

    content: dict[str, Any]
    client: int | None = None
    newest: bool = False


Event = Note | Frame
Emit = Callable[[Event], None]
"""Takes what a session tells; called on the session's thread."""

CODES = {2: "input", 3: "mesh", 4: "file", 1: "solve"}
"""Codes of the library's own errors, by the exit code of their class."""


def problem(error: Exception) -> dict[str, Any]:
    """An error as a page is told it; one that nobody thought of as a fault of the server."""
    if not isinstance(error, MorphletError):
        advice = "undo, or try another way; if it comes again, save the session and report it"
        return {"needed": "an answer", "found": f"{type(error).__name__}: {error}", "advice": advice}
    return {"needed": error.needed, "found": error.found, "advice": error.advice}


def refused(error: MorphletError, number: int | None, client: int | None) -> Note:
    """The answer to a message that could not be followed."""
    code = error.code if isinstance(error, Refusal) else CODES.get(error.exit_code, "input")
    return Note({"type": "error", "id": number, "code": code, **problem(error), "elements": error.elements}, client)


def broken(error: Exception, number: int | None, client: int | None) -> Note:
    """The answer to a message at which the server itself failed; the session is as it was."""
    return Note({"type": "error", "id": number, "code": "internal", **problem(error), "elements": []}, client)
