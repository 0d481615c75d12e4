"""One run of a verb: its clock, its progress bar, its outputs, its JSON object, its exit code.

Results go to stdout (one JSON object with `--json`, a few lines for people otherwise), everything else to stderr. Outputs are
made beside their places and moved there when the verb has ended well: after an error or an interruption nothing is left.
"""

import json
import math
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any

from cyclopts import Group, Parameter

from morphlet.errors import Cancelled, FileError, InputError, MorphletError
from morphlet.numerics.threads import limited

FRAME = re.compile(r"frame-\d{3,}\.(ply|obj|off|stl|glb)")
"""What an earlier sequence left in a folder that is being replaced."""
SHOWN = 4
"""How many elements of a list are shown to people."""
FLAG = Parameter(negative=(), show_default=False)


@Parameter(name="*", group=Group("Common options", sort_key=1))
@dataclass(frozen=True)
class Common:
    """Options of every verb."""

    json: Annotated[bool, FLAG] = False
    """Print exactly one JSON object on stdout."""
    quiet: Annotated[bool, FLAG] = False
    """No progress and no text on stderr but errors."""
    force: Annotated[bool, FLAG] = False
    """Replace existing outputs."""
    seed: int = 0
    """Seed of everything random."""
    picture: Path | None = None
    """Also write a rendered picture (PNG) here."""
    threads: int | None = None
    """Threads of the compiled kernels; all cores if left out."""


@dataclass(eq=False)
class Run:
    """What a verb's work may use: the options, the clock, the progress bar, the outputs."""

    verb: str
    inputs: list[Path | str]
    common: Common
    outputs: list[Path] = field(default_factory=list)
    places: dict[Path, Path] = field(default_factory=dict)
    stack: ExitStack = field(default_factory=ExitStack)
    bar: Any = None
    task: Any = None
    began: tuple[float, float] = (0.0, 0.0)

    def file(self, path: Path, *endings: str) -> None:
        """Promise a file: refused at once if it cannot be written, or exists and `--force` was not given."""
        if path.exists() and not path.is_file():
            raise FileError("a file name as output", f"{path}, which is a folder or a device", "name another file")
        if endings and path.suffix.lower() not in endings:
            raise FileError(f"an output ending in {' or '.join(endings)}", str(path), "rename the output")
        if os.path.lexists(path) and not self.common.force:
            raise FileError(f"{path} not to exist", "a file of that name", "choose another output or add --force")
        if not path.absolute().parent.is_dir():
            raise FileError(f"the folder of {path} to exist", "no such folder", "create it first")
        self._promise(path, Path(self._beside(path.absolute().parent), path.name))

    def folder(self, path: Path) -> None:
        """Promise a folder: refused at once if it cannot be one, or holds files and `--force` was not given."""
        if path.is_dir() and any(path.iterdir()) and not self.common.force:
            raise FileError(f"{path} to be empty or new", "files in it", "choose another folder or add --force")
        known = next(p for p in (path.absolute(), *path.absolute().parents) if os.path.lexists(p))
        if not known.is_dir():
            raise FileError(f"a folder as output {path}", f"the file {known}", "choose another output")
        self._promise(path, self._beside(known))

    def _beside(self, folder: Path) -> Path:
        """A hidden folder that vanishes when the run ends."""
        try:
            hidden = TemporaryDirectory(prefix=".morphlet-", dir=folder, ignore_cleanup_errors=True)
        except OSError as error:
            raise FileError(f"to write into {folder}", error.strerror or str(error), "choose another output") from error
        return Path(self.stack.enter_context(hidden))

    def _promise(self, target: Path, place: Path) -> None:
        if target.absolute() in (known.absolute() for known in self.places):
            raise FileError("different outputs", f"{target} twice", "name another file")
        self.places[target] = place

    def place(self, path: Path) -> Path:
        """Where to write what was promised as `path`, until the run has ended well."""
        return self.places[path]

    @contextmanager
    def staged(self) -> Iterator[None]:
        """Outputs move to their places if the block ends well, and vanish if it does not."""
        with self.stack:
            yield
            for target in sorted(self.places, key=lambda path: path == self.common.picture):  # what was asked for first, then its picture
                self.outputs += _settle(self.places[target], target)

    def start(self) -> None:
        """Start the clock."""
        self.began = time.perf_counter(), time.process_time()

    @contextmanager
    def uncounted(self) -> Iterator[None]:
        """Time that is not the verb's own: imports, and the compilation of kernels."""
        wall, cpu = time.perf_counter(), time.process_time()
        yield
        self.began = self.began[0] + time.perf_counter() - wall, self.began[1] + time.process_time() - cpu

    def head(self, outputs: list[Path]) -> dict[str, Any]:
        """The keys that every verb's result begins with."""
        wall, cpu = time.perf_counter() - self.began[0], time.process_time() - self.began[1]
        names = {"verb": self.verb, "inputs": [str(i) for i in self.inputs], "outputs": [str(o) for o in outputs]}
        return names | {"seconds": round(wall, 4), "cpu_seconds": round(cpu, 4)}

    def stage(self, name: str) -> None:
        """Start a new line of the progress bar."""
        if self.bar is not None:
            if self.task is not None:
                self.bar.update(self.task, completed=1.0)
            self.task = self.bar.add_task(name, total=1.0)

    def on_step(self, step: Any) -> None:
        """Move the progress bar; passed to long iterations."""
        if self.bar is not None and self.task is not None:
            self.bar.update(self.task, completed=step.progress)

    def say(self, text: str) -> None:
        """A line for people, on stderr."""
        if not self.common.quiet:
            print(text, file=sys.stderr, flush=True)


def execute(verb: str, inputs: list[Path | str], common: Common, work: Callable[[Run], dict[str, Any]]) -> int:
    """Run a verb's work, print its result, and turn errors into messages and exit codes.

    Warnings of numpy mean nothing to a person: what they warn of comes out as null, or as an error.
    """
    run = Run(verb, inputs, common)
    run.start()
    try:
        if common.seed < 0:
            raise InputError("a seed of 0 or more", str(common.seed), "choose another number")
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning), limited(common.threads), _bar(run), run.staged():
            if common.picture is not None:
                run.file(common.picture, ".png")
            run.start()
            found = work(run)
    except KeyboardInterrupt:
        return _failed(run, Cancelled(), "interrupted; nothing was written")
    except MorphletError as error:
        return _failed(run, error, str(error))
    except MemoryError:
        short = InputError("enough memory", "too little for this input", "use a smaller mesh, or ask for less")
        return _failed(run, short, str(short))
    except OSError as error:
        closed = FileError("files that can be read and written", str(error), "check paths and permissions")
        return _failed(run, closed, str(closed))
    return _show(run.head(run.outputs) | found, common)


def refuse(text: str, as_json: bool) -> int:
    """A usage error: what was wrong, and exit code 2."""
    print(f"morphlet: {text}", file=sys.stderr, flush=True)
    if as_json:
        _put(json.dumps({"error": {"message": text}, "exit_code": InputError.exit_code}))
    return InputError.exit_code


def plain(value: Any) -> Any:
    """A value as JSON has it: numpy numbers unwrapped, NaN and infinity as null."""
    if hasattr(value, "tolist"):
        value = value.tolist()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    return str(value) if isinstance(value, Path) else value


def _show(result: dict[str, Any], common: Common) -> int:
    """The result on stdout, as an object or as lines; the exit code."""
    if common.json:
        return _put(json.dumps(plain(result), allow_nan=False))
    if common.quiet:
        return 0
    rows = list(_rows(plain({key: value for key, value in result.items() if key not in ("verb", "inputs")})))
    width = max(len(key) for key, _ in rows)
    return _put("\n".join(f"{key:{width}}  {line}".rstrip() for key, line in rows))


def _rows(result: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    """A line per key; the keys of an object within follow one another."""
    for key, value in result.items():
        if isinstance(value, dict):
            yield from _rows(value, f"{prefix}{key} ")
        else:
            yield f"{prefix}{key}", _line(value)


def _line(value: Any) -> str:
    """A value on one line; long lists by their ends."""
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list) and len(value) > SHOWN and not isinstance(value[0], dict):
        return f"{value[0]}, ... {value[-1]} ({len(value)})"
    if isinstance(value, list):
        return ", ".join(_line(v) for v in value) or "-"
    if isinstance(value, dict):
        named = " ".join(f"{key} {_line(v)}" for key, v in value.items())
        return f"{value['what']} ({value['count']})" if value.keys() == {"what", "count"} else named
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "-" if value is None else str(value)


def _put(text: str) -> int:
    """Print on stdout. A reader that has left does not matter; a disk that is full does."""
    try:
        print(text, flush=True)
    except OSError as error:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # or Python would try, and fail, again at exit
        if isinstance(error, BrokenPipeError):
            return 0
        print(f"morphlet: needed to write to standard output; found {error.strerror}; redirect it elsewhere", file=sys.stderr)
        return FileError.exit_code
    return 0


def _failed(run: Run, error: MorphletError, message: str) -> int:
    """The message on stderr, the object on stdout if one was asked for; the exit code."""
    print(f"morphlet {run.verb}: {message}", file=sys.stderr, flush=True)
    if run.common.json:
        what = {"message": message, "needed": error.needed, "found": error.found, "advice": error.advice, "elements": error.elements}
        _put(json.dumps(plain(run.head([]) | {"error": what, "exit_code": error.exit_code}), allow_nan=False))
    return error.exit_code


def _settle(place: Path, target: Path) -> list[Path]:
    """Move what was made to its place; in a folder that held an earlier sequence, its frames go first."""
    try:
        if not place.is_dir():
            os.replace(place, target)
            return [target]
        made = sorted(file.relative_to(place) for file in place.rglob("*") if file.is_file())
        for folder in dict.fromkeys(name.parent for name in made):
            (target / folder).mkdir(parents=True, exist_ok=True)
        for folder in {name.parent for name in made if FRAME.fullmatch(name.name)}:
            for old in (target / folder).iterdir():
                if FRAME.fullmatch(old.name):
                    old.unlink()
        for name in made:
            os.replace(place / name, target / name)
    except OSError as error:
        raise FileError(f"to write {target}", error.strerror or str(error), "check space and permissions") from error
    return [target / name for name in made]


@contextmanager
def _bar(run: Run) -> Iterator[None]:
    """A progress bar on stderr while the work runs, if a person looks on."""
    if run.common.quiet or not sys.stderr.isatty():
        yield
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (TextColumn("{task.description}", markup=False), BarColumn(), TimeElapsedColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as run.bar:
        try:
            yield
        finally:
            run.bar = run.task = None
