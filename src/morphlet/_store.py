"""Named arrays to and from one `.npz` file, with kind and version: every `.save` and `.load`.

Files are written beside their target and renamed, so that a reader never sees half a file. A file may come from anybody: nothing in it is
ever unpickled or written to a place that it names, an array holds the bytes that are there and no others, and an archive unpacks to
a bounded multiple of its size.
"""

import io
import math
import os
import re
import tempfile
import tomllib
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from tokenize import TokenError
from typing import Any

import numpy as np

from morphlet.errors import FileError

UNREADABLE = (
    *(OSError, ValueError, EOFError, LookupError, AttributeError, RuntimeError, TypeError, OverflowError, MemoryError),
    *(SyntaxError, TokenError, zipfile.BadZipFile, zlib.error),
)
"""What numpy and zipfile raise on bytes that are no `.npz` file, or were one once."""
ROOM, TIMES = 1 << 28, 100
"""What an archive may unpack to: so many bytes, and so many more for each byte of its own (zeros shrink to a thousandth)."""
HEADERS = {(1, 0): np.lib.format.read_array_header_1_0, (2, 0): np.lib.format.read_array_header_2_0}
"""What reads the header of an array, by its version; later ones are for types that are not read here."""
SHOWN, MESSAGE = 40, 200
"""Letters of a value, and of another library's message, that are shown."""
PARTS = 50
DOTTED = re.compile(rb"(?<![\w\"'-])(?:[\w\"'-]++[ \t]*+\.[ \t]*+){49}")
"""A TOML key of so many parts, each of which is a table: the time and memory that these take grow with the square of their number."""
AGAIN = "write it again"
KINDS = "biufU"
"""Truth values, whole and real numbers, texts: what morphlet's own files hold."""


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


def put(path: str | os.PathLike[str], data: bytes) -> None:
    """Write bytes, all of them or none."""
    with beside(path) as temporary:
        temporary.write_bytes(data)


def save(path: str | os.PathLike[str], kind: str, version: int, arrays: dict[str, np.ndarray]) -> None:
    """Write the arrays with their kind and version."""
    with beside(path) as temporary, open(temporary, "wb") as stream:
        np.savez_compressed(stream, allow_pickle=False, kind=np.array(kind), version=np.array(version), **arrays)


def load(path: str | os.PathLike[str], kind: str, version: int, names: tuple[str, ...]) -> dict[str, np.ndarray]:
    """Read the arrays of a file of this kind; any other content is a `FileError`."""
    arrays = arrays_of(path, f"a morphlet {kind} file at {path}")
    found = _kind(arrays)
    if found != kind:
        raise FileError(f"a file of kind '{kind}' at {path}", f"kind {found!r}", "pass the matching file")
    own = arrays.get("version", np.array(-1))
    if own.shape != () or own.dtype.kind not in "iu" or own > version:
        raise FileError(f"version {version} or older of {kind} at {path}", f"version {_shown(own)}", "update morphlet")
    missing = [name for name in names if name not in arrays]
    if missing:
        raise FileError(f"arrays {', '.join(names)} in {path}", f"{len(missing)} missing: {', '.join(missing)}", "write it again")
    strange = [name for name in names if arrays[name].dtype.kind not in KINDS]
    if strange:
        found = f"{strange[0]!r} of type {arrays[strange[0]].dtype}"
        raise FileError(f"numbers and texts in {path}", found, "write it again")
    return arrays


def kind_of(path: str | os.PathLike[str]) -> str:
    """What kind a file says it is; "unknown" if it does not say."""
    return _kind(arrays_of(path, f"a morphlet file at {path}"))


def contents(path: str | os.PathLike[str]) -> bytes:
    """The bytes of a file or pipe; an `OSError` if it is a device, which may have no end."""
    place = Path(path)
    if place.is_char_device() or place.is_block_device():
        raise OSError(f"{place} is a device")
    return place.read_bytes()


def arrays_of(path: str | os.PathLike[str], needed: str, advice: str = AGAIN) -> dict[str, np.ndarray]:
    """The arrays of an `.npz` file by name, or that of an `.npy` file by the file's; anything else is a `FileError`."""
    with _unreadable(needed, advice):
        data = contents(path)
        if data.startswith(np.lib.format.MAGIC_PREFIX):
            return {Path(path).stem: _array(data)}
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            members = [member for member in archive.infolist() if member.filename.endswith(".npy")]
            size, most = sum(member.file_size for member in members), ROOM + TIMES * len(data)
            if size > most:
                raise ValueError(f"{len(data)} bytes that unpack to {size}, more than {most}")
            return {member.filename.removesuffix(".npy"): _member(archive, member) for member in members}


def toml(path: str | os.PathLike[str], needed: str) -> dict[str, Any]:
    """The tables of a TOML file; a `FileError` for anything else, for what is nested without end, and for numbers beyond 64 bits."""
    try:
        data = contents(path)
        if DOTTED.search(data):
            raise ValueError(f"a key of {PARTS} parts or more")
        found = tomllib.loads(data.decode("utf-8-sig"))
        _require_short(found)
        return found
    except (OSError, ValueError, RecursionError, MemoryError) as error:
        reason = getattr(error, "strerror", None) or str(error)[:MESSAGE] or "tables within tables"
        raise FileError(needed, reason, "check the path and the syntax") from error


def _require_short(found: Any) -> None:
    """A `ValueError` for a whole number that does not fit 64 bits: TOML has none."""
    todo = [found]
    while todo:
        value = todo.pop()
        if isinstance(value, dict | list):
            todo += value.values() if isinstance(value, dict) else value
        elif isinstance(value, int) and not -(1 << 63) <= value < 1 << 63:
            raise ValueError(f"a whole number of {value.bit_length()} bits")


def _member(archive: zipfile.ZipFile, member: zipfile.ZipInfo) -> np.ndarray:
    if member.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise ValueError(f"{member.filename[:SHOWN]!r} packed in a way that numpy has not")
    return _array(archive.read(member))


def _array(data: bytes) -> np.ndarray:
    """The array of an `.npy` file; a `ValueError` if it holds objects, or not as many bytes as it says."""
    stream = io.BytesIO(data)
    version = np.lib.format.read_magic(stream)
    if version not in HEADERS:
        raise ValueError(f"an array in version {version}")
    shape, turned, dtype = HEADERS[version](stream)
    count, start = math.prod(shape), stream.tell()
    if dtype.hasobject:
        raise ValueError("Object arrays cannot be loaded: nothing is unpickled")
    if min(shape, default=0) < 0 or dtype.itemsize * count != len(data) - start:
        raise ValueError(f"{len(data) - start} bytes for an array of {count} times {dtype}"[:MESSAGE])
    return np.frombuffer(data, dtype, count, start).reshape(shape, order="F" if turned else "C").copy()


def _kind(arrays: dict[str, np.ndarray]) -> str:
    """What the arrays of a file say that they are."""
    return str(arrays["kind"])[:SHOWN] if "kind" in arrays else "unknown"


def _shown(value: np.ndarray) -> str:
    """A number; of anything else its type."""
    return str(value) if value.shape == () and value.dtype.kind in "iu" else f"of type {value.dtype} and shape {value.shape}"


@contextmanager
def _unreadable(needed: str, advice: str) -> Iterator[None]:
    """Bytes that are no such file are a `FileError`."""
    try:
        yield
    except UNREADABLE as error:
        raise FileError(needed, getattr(error, "strerror", None) or str(error)[:MESSAGE] or type(error).__name__, advice) from error


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
