"""Runner: all items of a batch, each done once, on this machine or on a cluster; what is done is not done again.

Engines are executors of Python's own kind: threads here, each with a server (`server`), or the workers of a Dask scheduler. An item whose
worker is gone is given to another one by Dask; one that has cost several workers their lives comes back as failed.
"""

import shutil
import tempfile
from asyncio import CancelledError as AsyncCancelledError
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Empty, Queue
from time import monotonic
from typing import Any

from morphlet.batch.items import Batch, Item, do, end_servers, fingerprint
from morphlet.batch.manifest import NAME, Line, Manifest, key, opened
from morphlet.errors import FileError, InputError, MissingExtra, MorphletError

WORK = ".morphlet-batch-"
"""Prefix of the folder that is there as long as a run is."""
WAIT = 1.0
"""Seconds after which it is looked again how many workers there are."""
CONNECT = 10
"""Seconds in which a scheduler must answer."""


class Interrupted(MorphletError):
    """A batch was stopped, and can be taken up again."""

    exit_code = 130

    def __init__(self, told: int, of: int) -> None:
        super().__init__(
            "the batch to run on", f"a request to stop, {told} of {of} items told", "start the same again: what is done is kept"
        )
        self.told, self.of = told, of

    def __reduce__(self) -> tuple[type["Interrupted"], tuple[int, int]]:
        return type(self), (self.told, self.of)


@dataclass(frozen=True, eq=False)
class Engine:
    """What does items.

    Parameters
    ----------
    executor
        Where they are handed in.
    width
        How many are handed in at once, now.
    """

    executor: Executor
    width: Callable[[], int]


@contextmanager
def machine(jobs: int) -> Iterator[Engine]:
    """This machine, so many items at once."""
    with ThreadPoolExecutor(jobs, thread_name_prefix="morphlet-batch") as pool:
        try:
            yield Engine(pool, lambda: jobs)
        finally:
            pool.shutdown(wait=True, cancel_futures=True)
            end_servers()


@contextmanager
def cluster(address: str) -> Iterator[Engine]:
    """The workers of a Dask scheduler, those that come later too.

    Raises
    ------
    MissingExtra
        Without the library.
    InputError
        If no scheduler answers at the address, or it has no workers.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise MissingExtra("the library distributed for --scheduler", "none", "pip install 'morphlet[cluster]'") from error
    try:
        client = Client(address, timeout=CONNECT, set_as_default=False)
    except (OSError, ValueError) as error:
        raise InputError(f"a Dask scheduler at {address}", str(error), "start one, or check the address") from error
    with client:
        if not client.ncores():
            raise InputError(f"workers of the scheduler at {address}", "none", "start `dask worker` with this address") from None
        yield Engine(client.get_executor(pure=False), lambda: _places(client))


@contextmanager
def claimed(folder: Path) -> Iterator[tuple[Manifest, Path]]:
    """A folder for one batch alone: its manifest, and a hidden folder that vanishes when the run ends.

    Raises
    ------
    FileError
        If another batch is at work in it, or it cannot be written.
    """
    with opened(folder) as manifest:
        for left in folder.glob(WORK + "*"):  # by a run that was killed
            shutil.rmtree(left, ignore_errors=True)
        try:
            work = tempfile.mkdtemp(prefix=WORK, dir=folder)
        except OSError as error:
            raise FileError(f"to write into {folder}", error.strerror or str(error), "choose another output") from error
        try:
            yield manifest, Path(work)
        finally:
            shutil.rmtree(work, ignore_errors=True)


def require_folder(folder: Path, force: bool) -> None:
    """Make the folder of a batch, or refuse one that holds other things.

    Raises
    ------
    FileError
        If it cannot be made, or holds files and no manifest.
    """
    try:
        if folder.is_dir() and any(folder.iterdir()) and not (folder / NAME).exists() and not force:
            raise FileError(f"{folder} to be empty, new, or of an earlier batch", "files in it", "choose another folder or add --force")
        folder.mkdir(parents=True, exist_ok=True)
    except FileError:
        raise
    except OSError as error:
        raise FileError(f"a folder as output {folder}", error.strerror or str(error), "choose another output") from error


def require_own(items: Iterable[Item], manifest: Manifest) -> None:
    """Refuse items whose outputs are there, made with other parameters.

    Raises
    ------
    FileError
        If there is one.
    """
    for item, name in ((one, name) for one in items for name in one.outputs):
        line = manifest.made.get(key(name))
        if line is not None and line.parameters != item.parameters:
            differ = ", ".join(sorted(k for k in item.parameters | line.parameters if item.parameters.get(k) != line.parameters.get(k)))
            advice = "choose another folder, or add --force to replace them"
            raise FileError(f"outputs of the same parameters in {manifest.path.parent}", f"{name} made with another {differ}", advice)


def require_different(items: Iterable[Item]) -> None:
    """Refuse two items that would write the same file.

    Raises
    ------
    InputError
        If there are such.
    """
    seen: dict[str, str] = {}
    for item in items:
        name = item.outputs[0].casefold()  # Cat and cat are one file on some systems
        if name in seen:
            raise InputError("inputs of different stems", f"{seen[name]} and {item.input}, both for {item.outputs[0]}", "rename one")
        seen[name] = item.input


def run(items: list[Item], batch: Batch, engine: Engine, manifest: Manifest, force: bool) -> Iterator[Line]:
    """Do the items that are not done, and write down what became of each; lines come as items end.

    Parameters
    ----------
    items
        With different outputs.
    batch
        What they share.
    engine
        What does them.
    manifest
        Where it is written down.
    force
        Do those again that are done.

    Raises
    ------
    FileError
        If the manifest cannot be written.
    Interrupted
        If a person stops it.
    """
    told = 0
    try:
        for line in _lines(items, batch, engine, {} if force else manifest.made):
            manifest.append(line)
            told += 1
            yield line
    except KeyboardInterrupt:
        raise Interrupted(told, len(items)) from None


def _lines(items: list[Item], batch: Batch, engine: Engine, made: dict[str, Line]) -> Iterator[Line]:
    """What became of each item; no more are handed in than there is a place for."""
    waiting, running, ended = deque(items), dict[Future[Line], Item](), Queue[Future[Line]]()
    width, looked = engine.width(), monotonic()
    while waiting or running:
        if monotonic() - looked > WAIT:
            width, looked = engine.width(), monotonic()
        while waiting and len(running) < width:
            item = waiting.popleft()
            known = _known(item, batch, made)
            if known is None:
                future = _handed_in(engine, item, batch)
                running[future] = item
                future.add_done_callback(ended.put)
            else:
                yield known
        with suppress(Empty):
            if not running:
                continue
            future = ended.get(timeout=WAIT)
            yield _line(future, running.pop(future))


def _known(item: Item, batch: Batch, made: dict[str, Line]) -> Line | None:
    """What is told of an item that an earlier run has done: the same file with the same parameters, its outputs in place."""
    line = made.get(key(item.outputs[0]))
    if line is None or line.parameters != item.parameters or not all(Path(batch.folder, name).is_file() for name in item.outputs):
        return None
    own = fingerprint(item.path)
    if own is None or own != line.fingerprint:
        return None
    return replace(line, input=item.input, status="skipped", outputs=batch.named_outputs(item), seconds=0.0, peak_memory_mb=None)


def _handed_in(engine: Engine, item: Item, batch: Batch) -> "Future[Line]":
    """The promise of a line; one that is broken already where no engine takes it."""
    try:
        return engine.executor.submit(do, item, batch)
    except Exception as error:  # what it is depends on the engine
        broken = Future[Line]()
        broken.set_exception(error)
        return broken


def _line(future: "Future[Line]", item: Item) -> Line:
    """What became of an item; of one whose worker is gone, too."""
    try:
        return future.result()
    except (Exception, AsyncCancelledError) as error:  # what it is depends on the engine
        return Line(item.input, None, item.parameters, "failed", f"its worker was lost: {type(error).__name__}: {error}".rstrip(": "))


def _places(client: Any) -> int:
    """How many threads the workers of a cluster have now: an item that waits at a worker would be suspected, too, if that died."""
    try:
        return max(sum(client.ncores().values()), 1)
    except Exception:  # what it is depends on what is wrong: what is handed in now fails, and says so
        return 1
