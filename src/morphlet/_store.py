"""Named arrays to and from one `.npz` file, with kind and version: every `.save` and `.load`.

Files are written beside their target and renamed, so that a reader never sees half a file; nothing is ever unpickled.
"""

import os
import tempfile
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from morphlet.errors import FileError

UNREADABLE = (OSError, ValueError, EOFError, KeyError, AttributeError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""What numpy and zipfile raise on bytes that are no `.npz` file, or were one once."""


@contextmanager
def beside(path: str | os.PathLike[str]) -> Iterator[Path]:
    """A temporary path in the folder of `path`; renamed to `path` when the block ends well, removed when it does not."""
    target = Path(path)
    try:
        handle, name = tempfile.mkstemp(prefix=f".{target.stem}-", suffix=target.suffix, dir=target.parent)
    except OSError as error:
        raise FileError(f"a writable folder for {target}", str(error), "create the folder or choose another output") from error
    os.close(handle)
    temporary = Path(name)
    try:
        yield temporary
        os.chmod(temporary, 0o666 & ~_umask())
        os.replace(temporary, target)
    except OSError as error:
        raise FileError(f"to write {target}", str(error), "check space and permissions") from error
    finally:
        temporary.unlink(missing_ok=True)


def save(path: str | os.PathLike[str], kind: str, version: int, arrays: dict[str, np.ndarray]) -> None:
    """Write the arrays with their kind and version."""
    with beside(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, kind=np.array(kind), version=np.array(version), **arrays)


def load(path: str | os.PathLike[str], kind: str, version: int, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Read the arrays of a file of this kind; any other content is a `FileError`."""
    with _unreadable(f"a morphlet {kind} file at {path}"), np.load(path, allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    found = str(arrays.get("kind", "unknown"))
    if found != kind:
        raise FileError(f"a file of kind '{kind}' at {path}", f"kind '{found}'", "pass the matching file")
    if int(arrays.get("version", -1)) > version:
        raise FileError(f"version {version} or older of {kind}", f"version {int(arrays['version'])}", "update morphlet")
    missing = [name for name in names if name not in arrays]
    if missing:
        raise FileError(f"arrays {', '.join(names)} in {path}", f"{len(missing)} missing: {', '.join(missing)}", "write it again")
    return arrays


def kind_of(path: str | os.PathLike[str]) -> str:
    """What kind a file says it is; "unknown" if it does not say."""
    with _unreadable(f"a morphlet file at {path}"), np.load(path, allow_pickle=False) as file:
        return str(file["kind"]) if "kind" in file.files else "unknown"


@contextmanager
def _unreadable(needed: str) -> Iterator[None]:
    """Bytes that are no such file are a `FileError`."""
    try:
        yield
    except UNREADABLE as error:
        raise FileError(needed, str(error) or type(error).__name__, "write it again") from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
