"""Manifest: what became of each item, a line of JSON each, appended one by one.

The file is locked while a batch runs, so that a second one in the same folder is refused; the lock goes with the process, however that
ends. A line is one write, flushed to the disk. Half a line that a killed run or a full disk left at the end is cut off by the next run.
"""

import json
import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path, PurePath
from typing import Any, Literal

from morphlet.errors import FileError

NAME = "manifest.jsonl"
FOLDERS = ("spheres", "pairs")
"""Folders within that of a batch."""
PIECE = 1 << 16
"""Bytes that are looked at together for the end of a line."""
Status = Literal["done", "failed", "skipped"]


@dataclass(frozen=True, slots=True)
class Line:
    """What became of an item.

    Parameters
    ----------
    input
        Its file, as it was named.
    fingerprint
        SHA-256 of the file's bytes; None if it could not be read.
    parameters
        The verb and its options, all that decides about the result.
    status
        Done, failed, or skipped since an earlier run had done it.
    error
        Why it failed.
    outputs
        Files that were made.
    seconds
        Wall time.
    peak_memory_mb
        Most memory its process had, in megabytes; None where that cannot be told.
    """

    input: str
    fingerprint: str | None
    parameters: dict[str, Any]
    status: Status
    error: str | None = None
    outputs: tuple[str, ...] = ()
    seconds: float = 0.0
    peak_memory_mb: float | None = None

    @property
    def bytes(self) -> bytes:
        """The line as it is written."""
        return (json.dumps(asdict(self), allow_nan=False) + "\n").encode()


KEYS = {field.name for field in fields(Line)}


@dataclass(frozen=True, eq=False)
class Manifest:
    """An open manifest, locked for this process.

    Parameters
    ----------
    path
        The file.
    handle
        Its descriptor, which appends.
    made
        By `key`, the last line that tells of each output.
    unreadable
        How many lines within the file are none.
    """

    path: Path
    handle: int
    made: dict[str, Line]
    unreadable: int

    def append(self, line: Line) -> None:
        """Write a line, whole or not at all.

        Raises
        ------
        FileError
            If it cannot be written: the disk is full, or gone.
        """
        end = os.fstat(self.handle).st_size
        try:
            if os.write(self.handle, line.bytes) < len(line.bytes):
                raise OSError("no space for a line")
            os.fsync(self.handle)
        except OSError as error:
            _cut(self.handle, end)
            found = error.strerror or str(error)
            raise FileError(f"to write {self.path}", found, "make space and start the same batch again: what is done is kept") from error
        if line.status != "failed":
            self.made.update(dict.fromkeys(map(key, line.outputs), line))


def key(path: str | PurePath) -> str:
    """What tells an output from the others of its batch, wherever the batch's folder lies now.

    Examples
    --------
    >>> key("out/cat.npz"), key("out/spheres/cat.npz")
    ('cat.npz', 'spheres/cat.npz')
    """
    found = PurePath(path)
    return f"{found.parent.name}/{found.name}" if found.parent.name in FOLDERS else found.name


@contextmanager
def opened(folder: Path) -> Iterator[Manifest]:
    """The manifest of a folder, made if there is none, mended if it ends in half a line, and locked until the block ends.

    Raises
    ------
    FileError
        If it cannot be written, or another batch holds it.
    """
    path = folder / NAME
    try:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND | getattr(os, "O_BINARY", 0), 0o666)
    except OSError as error:
        raise FileError(f"a manifest to write at {path}", error.strerror or str(error), "choose another output") from error
    try:
        _lock(handle, folder)
        _mend(handle)
        yield Manifest(path, handle, *_made(read_lines(path)))
    finally:
        os.close(handle)


def read_lines(path: Path) -> Iterator[Line | None]:
    """The lines of a manifest, in the order they were written; None for one that is none.

    Raises
    ------
    FileError
        If the file cannot be read.
    """
    try:
        with path.open("rb") as file:
            yield from map(_parsed, file)
    except OSError as error:
        raise FileError(f"a manifest at {path}", error.strerror or str(error), "check the path and its permissions") from error


def _made(lines: Iterable[Line | None]) -> tuple[dict[str, Line], int]:
    """The last line that tells of each output, equal parameters held once; and how many are none."""
    made, shared, unreadable = dict[str, Line](), dict[str, dict[str, Any]](), 0
    for line in lines:
        if line is None:
            unreadable += 1
        elif line.status != "failed":
            kept = shared.setdefault(json.dumps(line.parameters, sort_keys=True), line.parameters)
            made.update(dict.fromkeys(map(key, line.outputs), replace(line, parameters=kept)))
    return made, unreadable


def _parsed(text: bytes) -> Line | None:
    """A line of the file; keys of later versions are left out."""
    try:
        found = json.loads(text)
        known = {name: found[name] for name in KEYS}
        return Line(**known | {"outputs": tuple(known["outputs"])})
    except (ValueError, KeyError, TypeError):
        return None


def _lock(handle: int, folder: Path) -> None:
    """Hold the file for this process alone."""
    try:
        _hold(handle)
    except OSError as error:
        found = "another batch at work in it" if isinstance(error, BlockingIOError | PermissionError) else str(error)
        raise FileError(f"{folder} for this batch alone", found, "wait for its end, or choose another folder") from error


if sys.platform == "win32":

    def _hold(handle: int) -> None:
        """Lock a byte far behind the end, so that the file can still be read."""
        import msvcrt

        os.lseek(handle, 1 << 40, os.SEEK_SET)
        msvcrt.locking(handle, msvcrt.LK_NBLCK, 1)
else:

    def _hold(handle: int) -> None:
        """Lock the file."""
        import fcntl

        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)


def _mend(handle: int) -> None:
    """Cut off half a line at the end."""
    end = os.fstat(handle).st_size
    whole = end
    while whole > 0:
        start = max(whole - PIECE, 0)
        os.lseek(handle, start, os.SEEK_SET)
        newline = os.read(handle, whole - start).rfind(b"\n")
        whole = start + newline + 1
        if newline >= 0:
            break
    if whole < end:
        _cut(handle, whole)


def _cut(handle: int, end: int) -> None:
    """Cut the file; one that cannot be cut now is mended by the next run."""
    try:
        os.ftruncate(handle, end)
    except OSError:
        return


def count(lines: Iterable[Line]) -> dict[str, int]:
    """How many lines tell of each status.

    Examples
    --------
    >>> count([Line("a.obj", None, {}, "failed", "no such file")])
    {'done': 0, 'failed': 1, 'skipped': 0}
    """
    told = [line.status for line in lines]
    return {status: told.count(status) for status in ("done", "failed", "skipped")}
