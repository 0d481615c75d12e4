"""Edits of a region, the package's methods and others' side by side: time, energy, quality.

    python benchmarks/editing.py [--data DIR] [--only speed,energy,drag,quality,handles,region] [--tools 'CGAL*,morphlet*']
                                 [--rounds 3] [--markdown] [--json FILE] [--picture FILE.png] [--peer-python PYTHON] [--list]

speed: set-up per region, and a frame of one iteration (linear methods, and the shell, which stops by itself: one answer); medians
over rounds in which all tools take turns, the least in brackets. energy: iterations until the spokes-and-rims energy is within
1 percent of E*, the least that any tool reaches within 150 iterations on the same edit. drag: 30 frames to the target at 1, 2, 4
iterations a frame; energy at the end over E*. quality: the shapes of Botsch and Sorkine, by the figures of `editing_judge`.
handles: free vertices join the handle of a prepared region. region: a frame as the region grows on one mesh. CPU time counts all
threads; milliseconds. Public meshes are used where MORPHLET_DATA names their folder, else generated bodies. A tool that is not
there is named as absent.
"""

import argparse
import contextlib
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from fnmatch import fnmatchcase
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from book import Sheet, Table, add_options
from editing_judge import Figures, Judge
from editing_peers import OWN, PEERS, Absent, Job, Spent, Tool
from editing_pictures import Shown, picture_of
from editing_problems import SHAPES, Problem, plane, pulled, subdivided
from machine import PEER_PYTHON
from morphlet import read
from sphere_map import generated

SECTIONS = ("speed", "energy", "drag", "quality", "handles", "region")
FRAMES, FEW_FRAMES, MANY = 10, 3, 100_000
"""Frames timed per round; from so many free vertices on, few."""
UNITS = "Milliseconds, medians of rounds in which all tools take turns."
ENOUGH = 6.0
"""Seconds of CPU after which a tool is excused from further rounds on a problem."""
NEAR, MOST = 1.01, 150
"""What counts as reaching the least energy; iterations in which to do so."""
COARSE = (1, 2, 4, 7, 10, 15, 20, 30, 40, 60, 80, 100, 125, MOST)
"""Iterations at which energies are looked at before it is searched in between."""
DRAG, PER_FRAME = 30, (1, 2, 4)
"""Frames of a drag; iterations in each."""
SETTLED = 100
"""Iterations before the quality is judged."""
SMALL = 41
"""Vertices along a side of the plane that warms up."""
ABSENT = "absent: "
"""How the failure of a tool begins that is not installed."""
MORE = (1, 50, 200)
"""Vertices that join a handle."""
RADII = (0.1, 0.2, 0.3, 0.45, 0.6, 0.75, 0.9)
"""Of regions, in bounding-box diagonals."""
PUBLIC = {"horse": ("horse.obj", 0.5), "armadillo": ("armadillo.obj", 0.5), "horse-48k": ("horse-48k.ply", 0.9)}
"""Meshes and radii."""
FINE = "horse-170k"
"""horse-48k, each triangle in four."""
TIMED_FINE = ("CGAL spokes+rims", "libigl spokes+rims", "morphlet estimated rotations", "morphlet ARAP")
TIMED = (
    *(*TIMED_FINE, "Open3D spokes", "libigl harmonic", "libigl biharmonic"),
    *("morphlet direct", "morphlet moving least squares", "morphlet lattice", "morphlet harmonic", "morphlet biharmonic"),
    *("morphlet similarity", "morphlet dual", "morphlet ARAP smoothed", "morphlet shell", "morphlet guarded"),
)
RACED = ("CGAL spokes+rims", "libigl spokes+rims", "morphlet ARAP plain", "morphlet ARAP")
ENLARGED = ("CGAL spokes+rims", "libigl spokes+rims", "morphlet ARAP", "morphlet shell")
"""Tools of the sections, unless all that there are."""


@dataclass(frozen=True, eq=False)
class Bench:
    """What to run on, and what has been found."""

    data: Path | None
    tools: tuple[Tool, ...]
    rounds: int
    found: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    shown: dict[str, list[Shown]] = field(default_factory=dict)

    def those(self, patterns: tuple[str, ...]) -> list[Tool]:
        """Tools by name."""
        return [tool for tool in self.tools if any(fnmatchcase(tool.name, pattern) for pattern in patterns)]

    @cached_property
    def edits(self) -> list[Problem]:
        """On meshes, small ones first."""
        if self.data is None:
            return [pulled(f"generated-{level}", generated(level, 0.1), 0.5) for level in (4, 5, 6)]
        made = [pulled(name, read(self.data / "meshes" / file), radius) for name, (file, radius) in PUBLIC.items()]
        return [*made, pulled(FINE, subdivided(made[-1].mesh), PUBLIC["horse-48k"][1])]

    @cached_property
    def races(self) -> list["Race"]:
        """Two of those, and the shapes."""
        return [Race(problem, Judge.prepare(problem.mesh)) for problem in (*self.edits[:2], *(make() for make in SHAPES.values()))]

    def note(self, section: str, **row: Any) -> None:
        """Keep a row, say it."""
        self.found.setdefault(section, []).append(row)
        sys.stderr.write(f"{section}: " + "  ".join(f"{key} {_brief(value)}" for key, value in row.items()) + "\n")


def warm_up(bench: Bench) -> None:
    """Compile the package's kernels; load the others' libraries."""
    small = plane(SMALL)
    for tool in bench.tools:
        with contextlib.suppress(Exception):  # it will come again
            tool.run(Job.drag(small, 2))


def _brief(value: Any) -> str:
    """For people who wait."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def attempt(bench: Bench, section: str, problem: Problem, tool: Tool, call: Callable[[], Any]) -> Any:
    """What the call returns; whatever a tool raises is its result."""
    try:
        return call()
    except Absent as error:
        bench.note(section, problem=problem.name, tool=tool.name, failure=f"{ABSENT}{error}")
    except Exception as error:  # whatever a tool raises is its result
        bench.note(section, problem=problem.name, tool=tool.name, failure=f"{type(error).__name__}: {str(error)[:100]}")
    return None


@dataclass(eq=False)
class Cost:
    """Times of a tool on one problem, over the rounds."""

    setup: list[Spent] = field(default_factory=list)
    frames: list[Spent] = field(default_factory=list)
    more: list[Spent] = field(default_factory=list)
    later: list[Spent] = field(default_factory=list)
    failed: bool = False

    @property
    def enough(self) -> bool:
        """Whether it has cost enough."""
        return self.failed or sum(one.cpu for one in (*self.setup, *self.frames, *self.more)) > ENOUGH

    def row(self, what: str) -> dict[str, float]:
        """Medians and the least, in milliseconds."""
        times = np.array([[one.cpu, one.wall] for one in getattr(self, what)]).reshape(-1, 2)
        middle, least = 1e3 * np.median(times, axis=0), 1e3 * times.min(axis=0)
        names = (f"{what}_cpu", f"{what}_wall", f"{what}_cpu_min", f"{what}_wall_min")
        return dict(zip(names, np.concatenate([middle, least]).tolist(), strict=True))


def costs(bench: Bench, section: str, tools: list[Tool], job: Job) -> Iterator[tuple[Tool, Cost]]:
    """All tools in turns, round by round."""
    kept = {tool.name: Cost() for tool in tools}
    for _ in range(bench.rounds):
        for tool in tools:
            cost = kept[tool.name]
            if cost.enough:
                continue
            answer = attempt(bench, section, job.problem, tool, partial(tool.run, job))
            if answer is None:
                cost.failed = True
                continue
            cost.setup.append(answer.setup)
            cost.frames += answer.frames
            cost.more += [answer.more] if answer.more else []
            cost.later += answer.later
    yield from ((tool, kept[tool.name]) for tool in tools if not kept[tool.name].failed)


def speed(bench: Bench) -> None:
    """Set-up and frame."""
    for problem in bench.edits:
        count, names = (FEW_FRAMES, TIMED_FINE) if len(problem.roi.free) > MANY else (FRAMES, TIMED)
        way = tuple(np.linspace(0.1, 1, count).tolist())
        for tool, cost in costs(bench, "speed", bench.those(names), Job(problem, way)):
            figures = cost.row("setup") | cost.row("frames")
            bench.note("speed", problem=problem.name, free=len(problem.roi.free), tool=tool.name, rounds=len(cost.setup), **figures)


@dataclass(frozen=True, eq=False)
class Race:
    """An edit on which energies are compared."""

    problem: Problem
    judge: Judge
    energies: dict[str, dict[int, float]] = field(default_factory=dict)

    def look(self, tool: Tool, counts: tuple[int, ...]) -> None:
        """Energies of a tool after so many iterations."""
        known = self.energies.setdefault(tool.name, {})
        left = tuple(count for count in counts if count not in known)
        if left:
            known.update(zip(left, map(self.judge.energy, tool.after(self.problem, left)), strict=True))

    @property
    def least(self) -> float:
        """The least that any tool has reached."""
        return min(min(known.values()) for known in self.energies.values() if known)

    def reached(self, tool: Tool) -> int | None:
        """Iterations until the energy is near the least; energies fall, so it is looked for between two of those known."""
        goal, known = NEAR * self.least, self.energies[tool.name]
        below = [count for count in COARSE if known[count] <= goal]
        if not below:
            return None
        before = max((count for count in COARSE if count < below[0]), default=0)
        self.look(tool, tuple(range(before + 1, below[0])))
        return min(count for count, energy in known.items() if energy <= goal)


def run_races(bench: Bench, section: str) -> None:
    """Energies of all tools at the coarse counts, once."""
    for race in bench.races:
        for tool in bench.those(RACED):
            if tool.name not in race.energies:
                attempt(bench, section, race.problem, tool, partial(race.look, tool, COARSE))


def energy(bench: Bench) -> None:
    """Iterations to the least energy."""
    run_races(bench, "energy")
    for race in bench.races:
        for tool in (tool for tool in bench.those(RACED) if race.energies.get(tool.name)):
            known = race.energies[tool.name]
            figures = {f"after_{count}": known[count] / race.least for count in (4, 10, MOST)}
            reached = race.reached(tool)
            cpu = None if reached is None else whole_cost(bench, tool, race.problem, reached)
            bench.note("energy", problem=race.problem.name, tool=tool.name, least=race.least, reached=reached, cpu=cpu, **figures)


def whole_cost(bench: Bench, tool: Tool, problem: Problem, iterations: int) -> float:
    """Median CPU time of set-up and so many iterations in one frame, in milliseconds."""
    answers = [tool.run(Job(problem, (1.0,), iterations)) for _ in range(bench.rounds)]
    return 1e3 * float(np.median([answer.setup.cpu + answer.frames[0].cpu for answer in answers]))


def drag(bench: Bench) -> None:
    """Energy after a drag."""
    run_races(bench, "drag")
    for race in bench.races:
        for tool in bench.those(RACED):
            for per_frame in PER_FRAME:
                job = Job.drag(race.problem, DRAG, per_frame)
                answer = attempt(bench, "drag", race.problem, tool, partial(tool.run, job))
                if answer is None:
                    break
                ratio = race.judge.energy(answer.positions[0]) / race.least
                cpu = 1e3 * float(np.median([frame.cpu for frame in answer.frames]))
                bench.note("drag", problem=race.problem.name, tool=tool.name, per_frame=per_frame, over_least=ratio, frame_cpu=cpu)


def quality(bench: Bench) -> None:
    """All tools on all shapes."""
    for name, make in SHAPES.items():
        problem = make()
        judge = Judge.prepare(problem.mesh)
        bench.shown[name] = [Shown(problem, problem.mesh.vertices, "rest")]
        for tool in bench.tools:
            found = attempt(bench, "quality", problem, tool, partial(tool.after, problem, (SETTLED,)))
            if found is not None:
                figures: Figures = judge.figures(found[0])
                bench.note("quality", problem=name, tool=tool.name, **asdict(figures))
                bench.shown[name].append(Shown(problem, found[0], tool.name, figures))


def handles(bench: Bench) -> None:
    """Free vertices join the handle."""
    problem, way = bench.edits[2], tuple(np.linspace(0.1, 1, FRAMES).tolist())
    for count in MORE:
        _, more = problem.with_more_handle(count)
        for tool, cost in costs(bench, "handles", bench.those(ENLARGED), Job(problem, way, 1, (), more)):
            later = cost.row("frames") | cost.row("later") if cost.later else {}
            bench.note("handles", problem=problem.name, added=count, tool=tool.name, **cost.row("more"), **later)


def region(bench: Bench) -> None:
    """The region grows, the mesh stays."""
    mesh = bench.edits[2].mesh
    for radius in RADII:
        problem = pulled(f"radius {radius}", mesh, radius)
        way = tuple(np.linspace(0.1, 1, FRAMES).tolist())
        for tool, cost in costs(bench, "region", bench.those(ENLARGED[:3]), Job(problem, way)):
            figures = cost.row("setup") | cost.row("frames")
            bench.note("region", problem=problem.name, free=len(problem.roi.free), tool=tool.name, **figures)


# Tables ---------------------------------------------------------------------------------------------------------------------------------


def written(value: float | None, digits: int = 3) -> str:
    """A number, or a dash."""
    if value is None or not np.isfinite(value):
        return "-"
    return f"{value:.0f}" if abs(value) >= 10**digits else f"{value:.{digits}g}"


def with_least(row: dict[str, Any], what: str) -> str:
    """Median and least CPU, and the median wall time."""
    return f"{written(row[f'{what}_cpu'])} ({written(row[f'{what}_cpu_min'])}) / {written(row[f'{what}_wall'])}"


def against(rows: list[dict[str, Any]], row: dict[str, Any], what: str, own: str = "morphlet ARAP") -> str:
    """How many times the package's own cost."""
    mine = [other[what] for other in rows if other["tool"] == own and other["problem"] == row["problem"] and "failure" not in other]
    return f"{row[what] / mine[0]:.2f}" if mine else "-"


def failures(rows: list[dict[str, Any]]) -> list[str]:
    """What went wrong, once each."""
    said = dict.fromkeys((row["tool"], row["failure"]) for row in rows if "failure" in row)
    return [f"{tool}: {failure}" for tool, failure in said if not failure.startswith(ABSENT)]


def speed_table(rows: list[dict[str, Any]]) -> Table:
    """Set-up and frame, with ratios."""
    heads = ["problem", "free", "tool", "set-up: CPU ms (least) / wall", "/ ARAP", "frame: CPU ms (least) / wall", "/ ARAP", "rounds"]
    lines = [
        [
            *(row["problem"], str(row["free"]), row["tool"], with_least(row, "setup"), against(rows, row, "setup_cpu")),
            *(with_least(row, "frames"), against(rows, row, "frames_cpu"), str(row["rounds"])),
        ]
        for row in rows
    ]
    return Table("Speed", heads, lines, UNITS)


def energy_table(rows: list[dict[str, Any]]) -> Table:
    """Iterations, and energies over the least."""
    heads = ["problem", "E*", "tool", "iterations to 1.01 E*", "CPU ms with set-up", "E / E* after 4", "after 10", f"after {MOST}"]
    lines = [
        [
            *(row["problem"], f"{row['least']:.5g}", row["tool"], f"> {MOST}" if row["reached"] is None else str(row["reached"])),
            written(row["cpu"]),
            *(f"{row[f'after_{count}']:.4f}" for count in (4, 10, MOST)),
        ]
        for row in rows
    ]
    return Table("Iterations to the least energy", heads, lines, UNITS)


def drag_table(rows: list[dict[str, Any]]) -> Table:
    """One line per tool and problem."""
    cells = {(row["problem"], row["tool"], row["per_frame"]): f"{row['over_least']:.3f} ({written(row['frame_cpu'])})" for row in rows}
    pairs = dict.fromkeys((row["problem"], row["tool"]) for row in rows)
    lines = [[*pair, *(cells.get((*pair, count), "-") for count in PER_FRAME)] for pair in pairs]
    return Table("Drags", ["problem", "tool", *(f"{count} a frame: E / E* (CPU ms)" for count in PER_FRAME)], lines)


def quality_table(rows: list[dict[str, Any]]) -> Table:
    """Tools down, problems across: five figures each."""
    problems, tools = (list(dict.fromkeys(row[key] for row in rows)) for key in ("problem", "tool"))
    cells = {
        (row["tool"], row["problem"]): " / ".join(
            (
                *(f"{row['energy']:.4f}", f"{row['strain']:.1f}", f"{row['laplacian']:.3f}"),
                *("-" if row["volume"] is None else f"{round(row['volume'], 1) + 0.0:+.1f}", str(row["pairs"])),
            )
        )
        for row in rows
    }
    lines = [[tool, *(cells.get((tool, problem), "-") for problem in problems)] for tool in tools]
    return Table("Quality", ["E / er / lap / dV / SI", *problems], lines)


def handles_table(rows: list[dict[str, Any]]) -> Table:
    """Tools down, counts across; then a frame before and after, of tools that ran it."""
    cells = {(row["tool"], row["added"]): with_least(row, "more") for row in rows}
    for row in rows:
        if "later_cpu" in row:
            cells[f"{row['tool']}, a frame before; after", row["added"]] = f"{with_least(row, 'frames')}; {with_least(row, 'later')}"
    lines = [[tool, *(cells.get((tool, count), "-") for count in MORE)] for tool in dict.fromkeys(tool for tool, _ in cells)]
    return Table("Vertices join the handle", ["vertices added: CPU ms (least) / wall", *map(str, MORE)], lines, UNITS)


def region_table(rows: list[dict[str, Any]]) -> Table:
    """Regions down, tools across; and the exponents."""
    tools = list(dict.fromkeys(row["tool"] for row in rows))
    free = dict.fromkeys(row["free"] for row in rows)
    cells = {(row["free"], row["tool"]): row for row in rows}
    lines = [
        [
            str(count),
            *(
                f"{written(cells[count, tool]['setup_cpu'])} / {written(cells[count, tool]['frames_cpu'])}"
                if (count, tool) in cells
                else "-"
                for tool in tools
            ),
        ]
        for count in free
    ]
    slopes = [f"{tool} {_exponent([row for row in rows if row['tool'] == tool]):.2f}" for tool in tools]
    note = f"exponent of a frame's CPU time over free vertices: {', '.join(slopes)}"
    return Table("The region grows", ["free vertices", *(f"{tool}: set-up / frame, CPU ms" for tool in tools)], lines, UNITS, [note])


def _exponent(rows: list[dict[str, Any]]) -> float:
    """Slope of the logarithms."""
    return float(np.polyfit(np.log([row["free"] for row in rows]), np.log([row["frames_cpu"] for row in rows]), 1)[0])


def told(sheet: Sheet, section: str, rows: list[dict[str, Any]]) -> None:
    """A section's table; tools that are not there are named."""
    sound = [row for row in rows if "failure" not in row]
    if sound or failures(rows):
        found = TABLES[section](sound) if sound else Table(section, [], [])
        sheet.add(replace(found, notes=[*found.notes, *failures(rows)]))
    for row in rows:
        if row.get("failure", "").startswith(ABSENT):
            sheet.miss(row["tool"], row["failure"].removeprefix(ABSENT))


RUN = dict(zip(SECTIONS, (speed, energy, drag, quality, handles, region), strict=True))
TABLES = dict(zip(SECTIONS, (speed_table, energy_table, drag_table, quality_table, handles_table, region_table), strict=True))
"""By the names of `--only`."""


def parsed() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    parser.add_argument("--only", default=",".join(SECTIONS), help="sections, separated by commas")
    parser.add_argument("--tools", default="*", help="names or patterns, separated by commas")
    parser.add_argument("--rounds", type=int, default=3, help="in which all tools take turns")
    add_options(parser)
    parser.add_argument("--picture", type=Path, help="the shapes under all tools, as a PNG")
    parser.add_argument("--peer-python", help="an interpreter that has Open3D, if this one does not")
    parser.add_argument("--list", action="store_true", help="name the tools")
    return parser.parse_args()


def main() -> None:
    """Run what is wanted, write as it comes."""
    chosen, tools = parsed(), (*PEERS, *OWN)
    if chosen.list:
        sys.stdout.write("".join(f"{tool.name}\n" for tool in tools))
        return
    if chosen.peer_python:
        os.environ[PEER_PYTHON] = chosen.peer_python
    patterns = tuple(chosen.tools.split(","))
    data = None if chosen.data is None else Path(chosen.data)
    bench = Bench(data, tuple(tool for tool in tools if any(fnmatchcase(tool.name, p) for p in patterns)), chosen.rounds)
    sheet = Sheet.of(chosen)
    sheet.figures = bench.found
    warm_up(bench)
    for section in chosen.only.split(","):
        RUN[section](bench)
        rows = bench.found.get(section, [])
        told(sheet, section, rows)
    if chosen.picture and bench.shown:
        picture_of(bench.shown).save(chosen.picture)


if __name__ == "__main__":
    main()
