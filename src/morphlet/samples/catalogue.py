"""Public meshes, fetched on demand and checked against their SHA-256.

The table is `catalogue.toml` beside this file. None of these meshes is ours: each entry says what its source states
about use. A mirror is a folder that already holds the files, by name, in any sub-folder; then no network is needed.
"""

import difflib
import fnmatch
import hashlib
import io
import os
import tarfile
import tomllib
import zipfile
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path

from morphlet._store import beside
from morphlet.errors import FileError, InputError


@dataclass(frozen=True)
class Entry:
    """Where a mesh lies.

    Parameters
    ----------
    url
        Address of the file, or of the archive that holds it.
    sha256
        Checksum of the mesh file itself, in hexadecimal.
    licence
        What the source states about use.
    member
        Pattern of the path inside the archive; empty if the address is the mesh itself.
    """

    url: str
    sha256: str
    licence: str
    member: str = ""


def _read() -> dict[str, Entry]:
    """The table as entries."""
    table = tomllib.loads((files("morphlet.samples") / "catalogue.toml").read_text("utf-8"))
    entries = {}
    for name, row in table["meshes"].items():
        source = table["sources"][row["source"]]
        entries[name] = Entry(source["base"] + row.get("file", name), row["sha256"], source["licence"], row.get("member", ""))
    return entries


CATALOGUE = _read()
"""Every mesh that `fetch` knows, by file name."""


def fetch(name: str, *, cache: str | os.PathLike[str] | None = None, mirror: str | os.PathLike[str] | None = None) -> Path:
    """The path of a public mesh, downloaded if it is not there yet, its checksum verified every time.

    Parameters
    ----------
    name
        File name of a mesh in `CATALOGUE`.
    cache
        Folder for downloads; the user's cache folder if left out.
    mirror
        Folder that holds the files by name, in any sub-folder; used instead of cache and network.

    Returns
    -------
    Path
        The mesh file: in the mirror, or in the cache.

    Raises
    ------
    InputError
        If the name is not in the catalogue; close names are listed.
    FileError
        If the file is missing, cannot be downloaded, or has another content than the catalogue says.

    Examples
    --------
    >>> from morphlet.samples.catalogue import CATALOGUE, fetch
    >>> CATALOGUE["cat.obj"].member
    '*cat-reference.obj'
    >>> fetch("cat.stl")
    Traceback (most recent call last):
    morphlet.errors.InputError: needed the name of a mesh in CATALOGUE; found 'cat.stl'; did you mean cat...
    """
    if name not in CATALOGUE:
        close = difflib.get_close_matches(name, CATALOGUE, cutoff=0.4) or list(CATALOGUE)
        raise InputError("the name of a mesh in CATALOGUE", f"'{name}'", f"did you mean {', '.join(close)}?")
    entry = CATALOGUE[name]
    if mirror is not None:
        return _mirrored(name, entry, Path(mirror))
    path = _cache(cache) / name
    if not path.exists():
        content = _download(entry)
        _verify(content, entry, entry.url)
        path.parent.mkdir(parents=True, exist_ok=True)
        with beside(path) as temporary:
            temporary.write_bytes(content)
    _verify(path.read_bytes(), entry, str(path))
    return path


def _cache(folder: str | os.PathLike[str] | None) -> Path:
    """The given folder, or the user's own."""
    import pooch

    return Path(folder) if folder is not None else Path(pooch.os_cache("morphlet"))


def _mirrored(name: str, entry: Entry, folder: Path) -> Path:
    """The file of this name in a folder or below; of several, the one with the right content."""
    found = sorted(p for p in folder.rglob(name) if p.is_file())
    if not found:
        raise FileError(f"{name} in or below {folder}", "no such file", f"copy it there from {entry.url}, or leave out the mirror")
    right = [p for p in found if hashlib.sha256(p.read_bytes()).hexdigest() == entry.sha256]
    if not right:
        _verify(found[0].read_bytes(), entry, str(found[0]))
    return right[0]


def _verify(content: bytes, entry: Entry, origin: str) -> None:
    """Raise unless the content has the entry's checksum."""
    digest = hashlib.sha256(content).hexdigest()
    if digest != entry.sha256:
        raise FileError(f"SHA-256 {entry.sha256} for {origin}", digest, "fetch it afresh; the source may have changed")


def _download(entry: Entry) -> bytes:
    """The mesh file's content from the network."""
    import pooch

    stream = io.BytesIO()
    try:
        pooch.HTTPDownloader(progressbar=False)(entry.url, stream, None)
    except OSError as error:
        raise FileError(f"to download {entry.url}", str(error), "check the network, or pass mirror=, a folder with the file") from error
    return _unpacked(stream.getvalue(), entry) if entry.member else stream.getvalue()


def _unpacked(archive: bytes, entry: Entry) -> bytes:
    """The one member of a zip or tar archive that fits the entry's pattern."""
    try:
        members = _zip_members(archive, entry.member) if entry.url.endswith(".zip") else _tar_members(archive, entry.member)
    except (zipfile.BadZipFile, tarfile.TarError, EOFError, OSError) as error:
        raise FileError(f"an archive at {entry.url}", str(error), "fetch it again later") from error
    if len(members) != 1:
        raise FileError(f"one file like {entry.member} in {entry.url}", f"{len(members)}", "report this: the source has changed")
    return members[0]


def _zip_members(archive: bytes, pattern: str) -> list[bytes]:
    with zipfile.ZipFile(io.BytesIO(archive)) as content:
        return [content.read(n) for n in content.namelist() if _fits(n, pattern)]


def _tar_members(archive: bytes, pattern: str) -> list[bytes]:
    with tarfile.open(fileobj=io.BytesIO(archive)) as content:
        streams = [content.extractfile(m) for m in content.getmembers() if m.isfile() and _fits(m.name, pattern)]
        return [s.read() for s in streams if s is not None]


def _fits(path: str, pattern: str) -> bool:
    """Whether a member is meant; archives made on a Mac hold shadow files that begin with '._'."""
    return fnmatch.fnmatch(path, pattern) and not Path(path).name.startswith("._") and not path.startswith("__MACOSX")
