"""The benchmark book: runs the benchmarks one after the other, each in a process of its own, and binds what they found.

    python -m benchmarks [NAME ...] [--out out/bench] [--data DIR] [--quick] [--list]

Names are those of the scripts ("editing", "motion"); all of them run if none is named. In the folder stand afterwards `bench.md` and
`bench.json` (the machine, every table, the time of each script), and for each script its text and all its figures. Both are written anew
after every script; one that fails is told in them and the next one runs. Where scripts are named, the chapters of the others stay in the
folder's book if it was made on such a machine: a book can be made in several runs. Public meshes are used where `--data`, or the variable
MORPHLET_DATA, names their folder. `--quick` takes a few minutes: little of each,
on generated bodies unless `--data` is given, and no figure to quote.
Ends with 1 if a script has failed.
"""

import argparse
import ast
import json
import os
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))  # the scripts find each other so, too
from book import Table
from machine import Machine, load, this_machine

HERE = Path(__file__).parent
DATA = "MORPHLET_DATA"
"""Environment variable: the folder of public meshes."""


@dataclass(frozen=True)
class Script:
    """A benchmark, its arguments in the book and in a quick run, which leaves it out if it has none."""

    name: str
    full: tuple[str, ...] = ()
    quick: tuple[str, ...] | None = ()


SCRIPTS = (
    Script("first_run", quick=None),
    Script("reading", quick=("--rounds", "1")),
    Script("factorization", quick=("--subdivisions", "4", "--repeats", "2")),
    Script("point_location"),
    Script("sphere_map", ("--all", "--lapy")),
    Script("sphere_torture"),
    Script("mothers"),
    Script("wavelet_rows", quick=("--rows", "2")),
    Script("wavelet_mesh", quick=("--most", "60")),
    Script(
        "correspondence",
        ("--peers", "correspond,rotation,nearest,fmap-orient,conformal"),
        ("--pairs", "grazer-walking", "--modes", "6", "--peers", "rotation,nearest"),
    ),
    Script("confidence", ("--back",), ("--pairs", "grazer-walking")),
    Script("editing", quick=("--only", "speed", "--rounds", "1", "--tools", "morphlet ARAP,libigl*")),
    Script("motion", ("--automatic",)),
    Script("codec"),
    Script("codec_fuzz", quick=("--seconds", "5")),
    Script("torture", quick=("--quick", "--only", "readers,faults")),
    Script("studio", quick=("--quick",)),
    Script("studio_page", quick=None),
    Script("many_meshes", quick=("--items", "100")),
    Script("growth", quick=("--most", "4000")),
)
"""In the order of the book."""
EXCUSED = {
    "__main__": "runs the others",
    "codec_pictures": "is run by codec",
    "docs_pictures": "draws pictures of the documentation",
    "editing_gallery": "draws pictures of the documentation",
    "editing_open3d": "is run by editing, in the peers' interpreter",
    "motion_pictures": "draws pictures of the documentation",
    "studio_pictures": "draws pictures of the documentation",
    "studio_viser": "is run by studio_page, in the peers' interpreter",
}
"""Scripts that measure nothing by themselves, and why they are here."""
HEAD = "# The benchmark book\n\nWhat `make bench` found: every script of `benchmarks/`, each in a process of its own.\n\n"
SAME = ("cpu", "cores", "python")
"""What two machines have in common whose figures stand in one book."""


@dataclass(frozen=True, eq=False)
class Chapter:
    """What became of a script."""

    name: str
    about: str
    command: str
    exit_code: int
    wall_s: float
    cpu_s: float
    """Of all its processes."""
    load: float
    """Of the machine before it ran."""
    version: str
    """Of the sources: the commit, with a plus if they were changed since."""
    tables: list[dict[str, Any]] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)

    def text(self) -> str:
        """As markdown."""
        ended = "" if self.exit_code == 0 else f" **It failed (exit code {self.exit_code})**: what follows was found before."
        head = f"## {self.name}\n\n{self.about}\n\n`{self.command}`: {self.wall_s:.0f} s, {self.cpu_s:.0f} CPU s.{ended}\n\n"
        missing = "".join(f"- absent: {name}: {why}\n" for name, why in self.absent.items())
        return head + (f"{missing}\n" if missing else "") + "\n".join(Table.of(record).text(markdown=True) for record in self.tables)


@dataclass(eq=False)
class Book:
    """The machine and the chapters so far."""

    machine: Machine
    load_at_start: float
    quick: bool = False
    public: bool = False
    """Whether the public meshes are there."""
    chapters: list[Chapter] = field(default_factory=list)

    def keep(self, folder: Path) -> None:
        """The chapters of the folder's book, if it was made on such a machine with the same meshes."""
        file = folder / "bench.json"
        found = json.loads(file.read_text()) if file.exists() else {}
        alike = {"quick": self.quick, "public_meshes": self.public}
        own = asdict(self.machine)
        if found and all(found[key] == value for key, value in alike.items()) and all(found["machine"][key] == own[key] for key in SAME):
            self.chapters = [Chapter(**one) for one in found["scripts"]]

    def add(self, chapter: Chapter) -> None:
        """In its place; instead of an older one of its name."""
        others = [one for one in self.chapters if one.name != chapter.name]
        names = [script.name for script in SCRIPTS]
        self.chapters = sorted([*others, chapter], key=lambda one: names.index(one.name) if one.name in names else len(names))

    def record(self) -> dict[str, Any]:
        """For programs."""
        loads = {"load_at_start": self.load_at_start, "load_at_end": load()}
        return {
            "machine": asdict(self.machine) | loads,
            "quick": self.quick,
            "public_meshes": self.public,
            "scripts": [asdict(one) for one in self.chapters],
        }

    def text(self) -> str:
        """For people."""
        meshes = "public ones, and generated" if self.public else "generated ones only"
        busy = f"{self.load_at_start:.1f} at the start, {load():.1f} at the end"
        lines = [*self.machine.lines(), ["load", busy], ["meshes", meshes]]
        runs = [[one.name, f"{one.wall_s:.0f}", f"{one.cpu_s:.0f}", f"{one.load:.1f}", one.version, _outcome(one)] for one in self.chapters]
        head = HEAD + ("A quick run: no figure of it is to be quoted.\n\n" if self.quick else "") + "## The run\n\n"
        tables = (
            Table("Machine", ["", ""], lines),
            Table("Scripts", ["script", "wall s", "CPU s", "load before", "sources", "outcome"], runs),
        )
        return head + "\n".join([*(one.text(markdown=True) for one in tables), *(one.text() for one in self.chapters)])

    def save(self, folder: Path) -> None:
        """Write both."""
        (folder / "bench.json").write_text(json.dumps(self.record(), indent=1))
        (folder / "bench.md").write_text(self.text())


def _outcome(chapter: Chapter) -> str:
    """In words."""
    done = "done" if chapter.exit_code == 0 else f"failed ({chapter.exit_code})"
    return f"{done}; absent: {', '.join(chapter.absent)}" if chapter.absent else done


def run(script: Path, words: Sequence[str], folder: Path) -> Chapter:
    """One script: its text to the screen and into the folder, its figures into the folder."""
    figures = folder / f"{script.stem}.json"
    figures.unlink(missing_ok=True)
    busy, before, began = load(), os.times(), time.perf_counter()
    call = [sys.executable, str(script), *words, "--json", str(figures)]
    with (folder / f"{script.stem}.txt").open("w") as kept, subprocess.Popen(call, stdout=subprocess.PIPE, text=True) as process:
        for line in process.stdout or ():
            sys.stdout.write(line)
            sys.stdout.flush()
            kept.write(line)
    wall, after = time.perf_counter() - began, os.times()
    cpu = after.children_user - before.children_user + after.children_system - before.children_system
    found = json.loads(figures.read_text()) if figures.exists() else {}
    told = found.get("command") or " ".join(["python", f"benchmarks/{script.name}", *words])
    outcome = (process.returncode, wall, cpu, busy, version())
    return Chapter(script.stem, about(script), told, *outcome, found.get("tables", []), found.get("absent", {}))


def version() -> str:
    """The commit of the sources, with a plus if they were changed since; "unknown" where they are not in a repository."""
    call = ["git", "-C", str(HERE), "describe", "--always", "--dirty=+", "--exclude=*"]
    try:
        return subprocess.run(call, capture_output=True, text=True, check=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "unknown"


def about(script: Path) -> str:
    """First line of a script's docstring."""
    return (ast.get_docstring(ast.parse(script.read_text())) or "").partition("\n")[0]


def wanted(names: Sequence[str], quick: bool) -> list[Script]:
    """Scripts by name, in the order of the book."""
    strange = set(names) - {script.name for script in SCRIPTS}
    if strange:
        sys.exit(f"no such benchmark: {', '.join(sorted(strange))}; there are {', '.join(script.name for script in SCRIPTS)}")
    return [script for script in SCRIPTS if (not names or script.name in names) and not (quick and script.quick is None)]


def parsed() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser("python -m benchmarks", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    parser.add_argument("--data", type=Path, help=f"the folder of public meshes; else the variable {DATA}")
    parser.add_argument("--quick", action="store_true")
    parser.add_argument("--list", action="store_true", help="name the benchmarks")
    return parser.parse_args()


def main() -> int:
    """Run each script, bind what they found; 1 if one has failed."""
    chosen = parsed()
    if chosen.list:
        sys.stdout.write("".join(f"{script.name:16s}{about(HERE / f'{script.name}.py')}\n" for script in SCRIPTS))
        return 0
    if chosen.data:
        os.environ[DATA] = str(chosen.data.absolute())
    elif chosen.quick:
        os.environ.pop(DATA, None)
    chosen.out.mkdir(parents=True, exist_ok=True)
    book = Book(this_machine(), load(), chosen.quick, bool(os.environ.get(DATA)))
    if chosen.names:
        book.keep(chosen.out)
    for script in wanted(chosen.names, chosen.quick):
        sys.stdout.write(f"\n# {script.name}\n\n")
        sys.stdout.flush()
        words = script.quick if chosen.quick else script.full
        book.add(run(HERE / f"{script.name}.py", words or (), chosen.out))
        book.save(chosen.out)
    sys.stdout.write(f"\n{chosen.out / 'bench.md'}\n")
    return max((int(one.exit_code != 0) for one in book.chapters), default=0)


if __name__ == "__main__":
    sys.exit(main())
