"""A batch under way: how many at once, where, and what people are told of it."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from cyclopts import Group, Parameter

from morphlet.cli import steps
from morphlet.console import Common, Run, execute
from morphlet.errors import FileError, InputError

if TYPE_CHECKING:
    from morphlet.batch.items import Batch, Item
    from morphlet.batch.limits import Limits
    from morphlet.batch.manifest import Line, Manifest
    from morphlet.batch.runner import Engine

SERVER = ("-m", "morphlet.cli.serve")
"""What starts a process that runs verbs."""
SHOWN = 20
"""How many failures the result tells; the manifest tells all."""


@Parameter(name="*", group=Group("Many meshes", sort_key=0))
@dataclass(frozen=True)
class Many:
    """How many meshes are done."""

    jobs: int | None = None
    """Items at once on this machine: as many as cores if left out; never more than memory holds."""
    scheduler: str | None = None
    """Instead, address of a Dask scheduler whose workers do the items, such as tcp://host:8786; they see files under the same paths."""
    time_limit: float | None = None
    """Seconds after which an item is ended, and failed."""
    memory_limit: str | None = None
    """Memory above which an item fails, such as 4GB; it also decides how many items run at once."""


MANY = Many()


@dataclass(frozen=True, eq=False)
class Session:
    """A batch under way."""

    run: Run
    batch: "Batch"
    engine: "Engine"
    manifest: "Manifest"
    jobs: int | None

    def warm(self, *kernels: str) -> None:
        """Compile kernels once, not in each server; the machines of a cluster do it themselves."""
        for one in kernels if self.jobs is not None else ():
            steps.warm(self.run, one)

    def written(self, lines: "Iterable[Line]") -> "list[Line]":
        """Lines of items that cannot be done."""
        found = list(lines)
        for line in found:
            self.manifest.append(line)
            self.run.say(f"{line.input}: {line.error}")
        return found

    def lines(self, items: "list[Item]", stage: str) -> "list[Line]":
        """Do items, and tell people how far it is, and what fails."""
        from morphlet.batch.runner import require_different, run

        require_different(items)
        self.run.stage(stage)
        found, began, worked = list["Line"](), monotonic(), 0
        for line in run(items, self.batch, self.engine, self.manifest, self.run.common.force):
            found.append(line)
            worked += line.status != "skipped"
            if line.status == "failed":
                self.run.say(f"{line.input}: {line.error}")
            _tell(self.run, f"{stage} {len(found)}/{len(items)}", len(found) / len(items), _left(began, worked, len(items) - len(found)))
        return found


def executed(inputs: "tuple[Path, ...] | list[Path | str]", common: Common, work: Callable[[Run], dict[str, Any]]) -> int:
    """Run a batch: 1 if it ended well, and items failed."""
    failed = list[int]()

    def counted(run: Run) -> dict[str, Any]:
        found = work(run)
        failed.append(found["failed"])
        return found

    code = execute("batch", [*inputs], common, counted)
    return int(bool(sum(failed))) if code == 0 else code


@contextmanager
def started(run: Run, output: Path, many: Many, items: "list[Item]") -> Iterator[Session]:
    """A batch, once it is certain that it can be written."""
    from morphlet.batch.items import Batch
    from morphlet.batch.runner import claimed, require_different, require_folder, require_own

    require_different(items)
    engine, jobs, limits = _engine(run, many, items)
    require_folder(output, run.common.force)
    with engine as running, claimed(output) as (manifest, work):
        if manifest.unreadable:
            run.say(f"note: {manifest.unreadable} lines of {manifest.path} cannot be read: their items are done again")
        if not run.common.force:
            require_own(items, manifest)
        batch = Batch(str(output.absolute()), str(output), str(work.absolute()), SERVER, limits)
        yield Session(run, batch, running, manifest, jobs)
        run.outputs.insert(0, manifest.path)


def _engine(run: Run, many: Many, items: "list[Item]") -> "tuple[AbstractContextManager[Engine], int | None, Limits]":
    """What does the items, how many at once if that is known, and what each may take."""
    from morphlet.batch.limits import Limits, expected_memory, fitting, parse_size
    from morphlet.batch.runner import cluster, machine
    from morphlet.numerics.threads import cores

    memory = None if many.memory_limit is None else parse_size(many.memory_limit)
    if many.scheduler is not None:
        if many.jobs is not None:
            raise InputError("--jobs or --scheduler", "both", "leave one out: a scheduler knows how many workers it has")
        return cluster(many.scheduler), None, Limits(many.time_limit, memory, run.common.threads or 1)
    need = expected_memory([_size(item.path) for item in items]) if memory is None else memory
    jobs = fitting(need, many.jobs)
    if many.jobs is not None and jobs < many.jobs:
        run.say(f"note: memory holds {jobs} at once, not {many.jobs} ({need / 1e6:.0f} MB for each; --memory-limit sets it)")
    return machine(jobs), jobs, Limits(many.time_limit, memory, run.common.threads or max(1, cores() // jobs))


def require_no_picture(run: Run) -> None:
    """Refuse a picture of many results."""
    if run.common.picture is not None:
        raise InputError("no --picture for many meshes", "one", "leave it out, or draw one of them with its verb")


def told(batch: Session, lines: "list[Line]") -> dict[str, Any]:
    """What is told of a batch."""
    from morphlet.batch.manifest import count

    failures = [{"input": line.input, "error": line.error} for line in lines if line.status == "failed"]
    return count(lines) | {"jobs": batch.jobs, "failures": failures[:SHOWN]}


def meshes_of(inputs: tuple[Path, ...]) -> list[Path]:
    """The files, and those that are mesh files in the folders, by their names."""
    from morphlet.io.formats import FORMATS

    endings = {ending for known in FORMATS for ending in known.endings}
    found = list[Path]()
    for path in inputs:
        if path.is_dir():
            within = sorted(file for file in path.iterdir() if file.suffix.lower() in endings)
            if not within:
                raise FileError(f"meshes in {path}", "none", "name another folder")
            found += within
        else:
            found.append(path)
    if not found:
        raise InputError("at least one mesh", "none", "name files, or folders of them")
    return found


def _size(path: str) -> int:
    """Bytes of a file; none if it is not there."""
    found = Path(path)
    return found.stat().st_size if found.is_file() else 0


def _tell(run: Run, text: str, share: float, left: float | None) -> None:
    """Move the progress bar."""
    if run.bar is not None:
        told = "" if left is None else f", {int(left // 3600)}:{int(left // 60 % 60):02}:{int(left % 60):02} left"
        run.bar.update(run.task, completed=share, description=text + told)


def _left(began: float, worked: int, waiting: int) -> float | None:
    """Seconds that the rest will take, at the pace of those that were done."""
    return None if worked == 0 else (monotonic() - began) / worked * waiting
