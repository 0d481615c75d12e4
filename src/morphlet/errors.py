"""What can go wrong: the argument, the mesh, the file, the solve.

Every error says three things: what was needed, what was found (with counts), what to do. The first offending
indices are in `elements`. The command line turns the class into an exit code.
"""

from collections.abc import Iterable
from typing import Any

ELEMENTS_KEPT = 20
"""How many offending indices an error carries."""


class MorphletError(Exception):
    """Base of all errors raised on purpose: `needed`, `found`, `advice`, and the first offending `elements`."""

    exit_code = 1

    def __init__(self, needed: str, found: str, advice: str, elements: Iterable[Any] = ()) -> None:
        self.needed, self.found, self.advice = needed, found, advice
        self.elements = [_plain(e) for _, e in zip(range(ELEMENTS_KEPT), elements, strict=False)]
        shown = f" (first: {', '.join(str(e) for e in self.elements[:5])})" if self.elements else ""
        super().__init__(f"needed {needed}; found {found}{shown}; {advice}")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.needed, self.found, self.advice, self.elements)


class InputError(MorphletError, ValueError):
    """An argument of a call has the wrong shape, type, range or content."""

    exit_code = 2


class MeshError(MorphletError, ValueError):
    """A mesh lacks what an operation needs: closed, oriented, one piece, genus 0."""

    exit_code = 3


class FileError(MorphletError, OSError):
    """A file cannot be read or written, or does not hold what its name says."""

    exit_code = 4


class SolveError(MorphletError, ArithmeticError):
    """An iteration or a factorization did not reach what was asked of it."""

    exit_code = 1


class MissingExtra(MorphletError, ImportError):
    """An optional library is needed for this call and is not installed."""

    exit_code = 2


class Cancelled(MorphletError):
    """Raised by a caller's `on_step` to stop a long iteration."""

    exit_code = 130

    def __init__(self) -> None:
        super().__init__("the iteration to run on", "a request to stop", "call again to start afresh")

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), ()


def _plain(element: Any) -> Any:
    """An index as a plain int, a row of indices as a list: errors travel between processes and into JSON."""
    return element.tolist() if hasattr(element, "tolist") else element
