"""Sessions on disk: a folder each, with copies of the mesh files and what was made of them, written after every step.

A folder is locked by the server that writes it. One without a lock was left by a crash, and can be taken up again.
"""

import os
import re
import shutil
import sys
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any

from morphlet import _store
from morphlet.errors import FileError
from morphlet.studio.sessionfile import read_back

LOCK, SESSION = "lock", "session.json"
NAME = re.compile(r"session-\d{1,9}")
MOST_LEFT = 10
"""Sessions that are kept beside the open ones; older ones are forgotten."""


def home() -> Path:
    """Where sessions are kept unless told otherwise."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")
    return Path(state) / "morphlet" / "studio"


@dataclass(eq=False)
class Folder:
    """The folder of this server's session.

    Parameters
    ----------
    path
        The folder.
    lock
        Its lock, held until `close`.
    """

    path: Path
    lock: IO[bytes]

    @staticmethod
    def create(root: Path) -> "Folder":
        """A new folder, locked.

        Raises
        ------
        FileError
            If it cannot be made.
        """
        try:
            root.mkdir(parents=True, exist_ok=True, mode=0o700)
            number = max((int(place.name.split("-")[1]) for place in _places(root)), default=0) + 1
            while True:
                path = root / f"session-{number}"
                try:
                    path.mkdir(mode=0o700)
                except FileExistsError:
                    number += 1
                    continue
                lock = open(path / LOCK, "wb")  # noqa: SIM115
                if _locked(lock):
                    return Folder(path, lock)
        except OSError as error:
            raise FileError(f"a writable folder at {root}", str(error), "choose another one") from error

    def write(self, text: str) -> None:
        """Exchange what is written of the session, all at once."""
        with _store.beside(self.path / SESSION) as temporary:
            temporary.write_text(text, "utf-8")

    def take(self, side: str, number: int, file: Path, name: str) -> Path:
        """A copy of a mesh file that is to be opened.

        Raises
        ------
        FileError
            If it cannot be read.
        """
        place = self.path / f"{side}-{number}{Path(name).suffix.lower()}"
        try:
            shutil.copyfile(file, place)
        except OSError as error:
            raise FileError(f"a mesh file at {file}", error.strerror or str(error), "check the path and its permissions") from error
        return place

    def keep(self, side: str, place: Path | None) -> None:
        """Of the copies for a side, keep this one."""
        for old in self.path.glob(f"{side}-*"):
            if old != place:
                old.unlink()

    def set_aside(self, coming: Path | None) -> None:
        """Leave a copy of what is written, to be taken up again; without the copy of a mesh that is only coming in."""
        other = Folder.create(self.path.parent)
        for file in [self.path / SESSION, *self.path.glob("source-*"), *self.path.glob("target-*")]:
            if file.exists() and file != coming:
                shutil.copy2(file, other.path)
        other.lock.close()

    def close(self, keep: bool) -> None:
        """Release the folder; forget it unless it holds what was not saved."""
        self.lock.close()
        if not keep:
            shutil.rmtree(self.path, ignore_errors=True)


@dataclass(frozen=True)
class Left:
    """A session that a crash left."""

    path: Path
    content: dict[str, Any]
    saved: datetime

    @property
    def name(self) -> str:
        """Of its folder."""
        return self.path.name

    def file(self, side: str) -> Path | None:
        """Its copy of a mesh file."""
        return max(self.path.glob(f"{side}-*"), key=lambda place: place.stat().st_mtime_ns, default=None)

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        meshes = [mesh["name"] for mesh in self.content["meshes"].values() if mesh is not None]
        return {"name": self.name, "meshes": meshes, "edits": _moves(self.content), "saved": self.saved.isoformat(timespec="seconds")}


def left(root: Path) -> list[Left]:
    """Sessions that no server holds, newest first; folders without one are forgotten."""
    found = []
    for path in _places(root):
        if not _free(path):
            continue
        try:
            content = read_back((path / SESSION).read_bytes())
            saved = datetime.fromtimestamp((path / SESSION).stat().st_mtime, UTC)
        except FileError:
            continue  # of a later version, or damaged: not for this one to throw away
        except OSError:
            shutil.rmtree(path, ignore_errors=True)
            continue
        found.append(Left(path, content, saved))
    ordered = sorted(found, key=lambda one: (one.saved, one.name), reverse=True)
    for old in ordered[MOST_LEFT:]:
        shutil.rmtree(old.path, ignore_errors=True)
    return ordered[:MOST_LEFT]


def discard(one: Left) -> None:
    """Forget a session."""
    shutil.rmtree(one.path, ignore_errors=True)


def _moves(content: dict[str, Any]) -> int:
    """Edits that moved something."""
    return sum(
        any(edit["motion"]["translate"]) or any(edit["motion"]["turn"]) or set(edit["motion"]["scale"]) != {1.0}
        for edit in content["edits"]
    )


def _places(root: Path) -> list[Path]:
    return sorted(path for path in root.glob("session-*") if NAME.fullmatch(path.name) and path.is_dir() and not path.is_symlink())


def _locked(stream: IO[bytes]) -> bool:
    """Take the lock of an open file; False if another process has it. The system releases it when the process ends."""
    try:
        if sys.platform == "win32":
            import msvcrt

            msvcrt.locking(stream.fileno(), msvcrt.LK_NBLCK, 1)
        else:
            import fcntl

            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _free(path: Path) -> bool:
    """Whether no server holds a folder."""
    try:
        with open(path / LOCK, "ab") as stream:
            return _locked(stream)
    except OSError:
        return False
