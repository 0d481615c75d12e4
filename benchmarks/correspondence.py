"""Correspondences against the truth: geodesic errors, folds and time, the package's methods and others' side by side.

    python benchmarks/correspondence.py [--data DIR] [--pairs 'horse-*,cat-lion'] [--modes auto,6] [--peers rotation,fmap]
                                        [--json FILE] [--markdown] [--resume] [--picture FILE.png] [--list]

Of two poses over one connectivity the first is remeshed (`samples.truth`): other vertices, otherwise joined and in another order, each
with its true place on the second. Errors are geodesic distances on the target between found and true place, times 100, over the
square root of the target's area, at 400 vertices drawn by area (no landmarks; the same ones in all modes); AUC is the mean share of
errors below a limit, over limits from 0 to 25. `flips`: percent of the triangles whose image lies face down on the target; the true
map's own percentage stands in brackets. `folds`, `degree`: on the sphere, by exact signs, where there is a sphere. Modes: automatic, or
so many true landmarks, the farthest points of the source. cat-lion is judged by those of its 55 markers that were not given. Seconds are
wall time, CPU counts all threads; both include what is made once per mesh, even where it was at hand. MB is the peak of the process.
"""

import argparse
import json
import os
import sys
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from fnmatch import fnmatchcase
from functools import cache, partial
from pathlib import Path

import numpy as np

from book import Sheet, Table, add_options
from correspondence_peers import METHODS, Absent, Answer, Stock
from correspondence_pictures import Shown, picture_of
from morphlet import Mesh, SurfacePoints, VertexPairs, read, read_pairs
from morphlet.errors import MorphletError
from morphlet.mapping.correspondence import COLLAPSED, Correspondence, folds_surface_percent
from morphlet.samples.anatomy import SPECIES
from morphlet.samples.creatures import Creature
from morphlet.samples.deviation import Deviation
from morphlet.samples.poses import POSES
from morphlet.samples.truth import KnownPair, known_pair, marked_pair
from sphere_map import timed

SAMPLES = 400
"""Vertices at which a map is judged."""
WITHIN, AUC_END, AUC_STEPS = 0.05, 0.25, 501
"""The share of errors below this; the area under the curve of shares up to there."""
CREATURE_VERTICES = 5000
"""Of a procedural creature."""
HEADS = [
    "pair",
    "mode",
    "method",
    "mean",
    "median",
    "<=5",
    "worst",
    "AUC",
    "flips % (truth)",
    "folds",
    "degree",
    "s",
    "CPU s",
    "MB",
    "remark",
]

ABSENT = "absent: "
"""How the failure of a method begins that is not installed."""

Loader = Callable[[], KnownPair]


@dataclass(frozen=True)
class Row:
    """One method on one pair in one mode; `failure` says why figures are missing."""

    pair: str
    mode: str
    method: str
    source_vertices: int
    target_vertices: int
    judged: int = 0
    mean: float | None = None
    median: float | None = None
    within_5: float | None = None
    worst: float | None = None
    auc: float | None = None
    flips_percent: float | None = None
    true_flips_percent: float | None = None
    collapsed_percent: float | None = None
    folds: int | None = None
    degree: float | None = None
    seconds: float | None = None
    cpu_seconds: float | None = None
    peak_memory_mb: float | None = None
    remark: str = ""
    failure: str = ""


@dataclass(frozen=True, eq=False)
class Judge:
    """A known pair made ready to judge maps that were given some landmarks."""

    pair: KnownPair
    rows: np.ndarray
    ruler: Deviation
    true_flips: float | None

    @staticmethod
    def prepare(pair: KnownPair, landmarks: VertexPairs) -> "Judge":
        """Draw the vertices, lay the ruler at their true places."""
        rows = pair.drawn(SAMPLES, landmarks)
        ruler = Deviation.prepare(pair.target, SurfacePoints(pair.truth.faces[rows], pair.truth.weights[rows]))
        return Judge(pair, rows, ruler, flips_of(pair, true_points(pair)) if known_faces(pair).any() else None)

    def figures(self, answer: Answer) -> dict[str, float | int | None]:
        """What there is to say about an answer."""
        own = self.pair.vertices[self.rows]
        errors = self.ruler.of(SurfacePoints(answer.points.faces[own], answer.points.weights[own])) / np.sqrt(self.pair.target.area)
        limits = np.linspace(0, AUC_END, AUC_STEPS)
        shares = [float(np.mean(errors <= limit)) for limit in limits]
        return {
            "judged": len(errors),
            "mean": 100 * float(errors.mean()),
            "median": 100 * float(np.median(errors)),
            "within_5": float(np.mean(errors <= WITHIN)),
            "worst": 100 * float(errors.max()),
            "auc": float(np.trapezoid(shares, limits) / AUC_END),
            "flips_percent": flips_of(self.pair, answer.points),
            "true_flips_percent": self.true_flips,
            "collapsed_percent": collapsed_of(self.pair, answer.points),
            "folds": answer.folds,
            "degree": answer.degree,
        }


def known_faces(pair: KnownPair) -> np.ndarray:
    """Faces of the source all of whose corners have a true place."""
    known = np.zeros(pair.source.n_vertices, bool)
    known[pair.vertices] = True
    return known[pair.source.faces].all(axis=1)


def true_points(pair: KnownPair) -> SurfacePoints:
    """The truth as a map of all vertices; where it is unknown, anything."""
    faces, weights = np.zeros(pair.source.n_vertices, np.int64), np.tile([1.0, 0.0, 0.0], (pair.source.n_vertices, 1))
    faces[pair.vertices], weights[pair.vertices] = pair.truth.faces, pair.truth.weights
    return SurfacePoints(faces, weights)


def judged_part(pair: KnownPair, points: SurfacePoints) -> Correspondence:
    """The map on the faces whose truth is known; on all faces where only markers are."""
    known = known_faces(pair)
    return Correspondence(Mesh(pair.source.vertices, pair.source.faces[known if known.any() else ~known]), pair.target, points)


def flips_of(pair: KnownPair, points: SurfacePoints) -> float:
    """Percent of the triangles that arrive face down."""
    return folds_surface_percent(judged_part(pair, points))


def collapsed_of(pair: KnownPair, points: SurfacePoints) -> float:
    """Percent of the triangles that arrive with next to no area."""
    part = judged_part(pair, points)
    area = part.source.with_vertices(part.positions).face_areas
    return 100 * float(np.mean(area < COLLAPSED * part.source.face_areas * part.target.area / part.source.area))


def posed(data: Path, first: str, second: str) -> KnownPair:
    """Two poses from files."""
    return known_pair(read(data / first), read(data / second))


def marked(data: Path, first: str, second: str, markers: str) -> KnownPair:
    """Two meshes with markers, from files."""
    return marked_pair(read(data / first), read(data / second), read_pairs(data / markers))


def bred(species: str, other: str, pose: str) -> KnownPair:
    """A creature at rest, and the same in a pose with another species' proportions."""
    animal = prepared(species)
    return known_pair(animal.mesh, animal.posed(POSES[pose], None if other == species else SPECIES[other]))


@cache
def prepared(species: str) -> Creature:
    """An animal ready to be posed."""
    return Creature.prepare(species, n_vertices=CREATURE_VERTICES)


def catalogue(data: Path | None) -> dict[str, Loader]:
    """All pairs that there are, by name."""
    found: dict[str, Loader] = {}
    for species in SPECIES:
        for pose in ("walking", "leaping"):
            found[f"{species}-{pose}"] = partial(bred, species, species, pose)
        for other in (name for name in SPECIES if name != species):
            found[f"{species}-{other}"] = partial(bred, species, other, "standing")
    if data is None:
        return found
    for first, poses, count in (("horse", "horse-poses/horse", 10), ("cat", "cat-poses/cat", 5)):
        for k in range(1, count + 1):
            found[f"{first}-{k:02d}"] = partial(posed, data, f"meshes/{first}.obj", f"{poses}-{k:02d}.obj")
    for name, others in (("wolf", (1, 2)), ("horse", (5, 6, 7)), ("cat", (1, 2, 3))):
        for k in others:
            found[f"tosca-{name}{k}"] = partial(posed, data, f"tosca/{name}0.off", f"tosca/{name}{k}.off")
    found["cat-lion"] = partial(marked, data, "meshes/cat.obj", "meshes/lion.obj", "markers/cat-lion.csv")
    return found


def given_in(pair: KnownPair, mode: str) -> VertexPairs:
    """The landmarks that a method is given."""
    return pair.first_landmarks(0 if mode == "auto" else int(mode))


def left_out_of(pair: KnownPair, mode: str) -> VertexPairs:
    """What is not judged: all landmarks, so that all modes are judged at the same vertices; of markers, those that were given."""
    return given_in(pair, mode) if len(pair.vertices) == len(pair.landmarks) else pair.landmarks


def one_row(name: str, mode: str, method: str, judge: Judge, stock: Stock) -> tuple[Row, Answer | None]:
    """Run a method and judge it; whatever it raises is its result."""
    pair = judge.pair
    landmarks = given_in(pair, mode)
    blank = partial(Row, name, mode, method, pair.source.n_vertices, pair.target.n_vertices)
    stock.settle()
    try:
        answer, wall, cpu, megabytes = timed(lambda: METHODS[method](pair, landmarks, stock))
    except Absent as error:
        return blank(failure=f"{ABSENT}{error}"), None
    except Exception as error:  # whatever a method raises is its result
        return blank(failure=f"{type(error).__name__}: {str(error)[:120]}"), None
    owed = stock.settle()
    cost = {"seconds": wall + owed[0], "cpu_seconds": cpu + owed[1], "peak_memory_mb": megabytes}
    return blank(**judge.figures(answer), **cost, remark=answer.remark), answer


def rows_of(name: str, load: Loader, jobs: list[tuple[str, str]], stock: Stock) -> Iterator[tuple[Row, Shown | None]]:
    """All wanted methods in all wanted modes on one pair."""
    try:
        pair = load()
    except (MorphletError, OSError) as error:
        yield from ((Row(name, mode, method, 0, 0, failure=str(error)[:120]), None) for mode, method in jobs)
        return
    judges: dict[int, Judge] = {}
    for mode, method in jobs:
        left_out = left_out_of(pair, mode)
        if len(left_out) not in judges:
            judges[len(left_out)] = Judge.prepare(pair, left_out)
        row, answer = one_row(name, mode, method, judges[len(left_out)], stock)
        yield row, None if answer is None else Shown(pair, answer.points, f"{method}, {mode}", row.mean)
    stock.forget(pair.target)


def line(row: Row) -> list[str]:
    """A line of the table."""
    head = [row.pair, row.mode, row.method]
    if row.failure:
        return [*head, *("-",) * (len(HEADS) - 4), row.failure]

    def shown(value: float | None, digits: int) -> str:
        return "-" if value is None else f"{value:.{digits}f}"

    flips = f"{shown(row.flips_percent, 2)} ({shown(row.true_flips_percent, 2)})"
    errors = [shown(row.mean, 2), shown(row.median, 2), shown(row.within_5, 3), shown(row.worst, 1), shown(row.auc, 3)]
    cost = [shown(row.seconds, 1), shown(row.cpu_seconds, 1), shown(row.peak_memory_mb, 0)]
    return [*head, *errors, flips, shown(row.folds, 0), shown(row.degree, 3), *cost, row.remark]


def summary(rows: list[Row]) -> Table:
    """Mean / median / worst, pairs down, methods across."""
    columns = list(dict.fromkeys((row.method, row.mode) for row in rows if not row.failure))
    cells = {
        (row.pair, row.method, row.mode): f"{row.mean:.2f} / {row.median:.2f} / {row.worst:.1f}" for row in rows if row.mean is not None
    }
    lines = [[pair, *(cells.get((pair, *column), "-") for column in columns)] for pair in dict.fromkeys(row.pair for row in rows)]
    return Table("Errors", ["pair", *(", ".join(column) for column in columns)], lines, "Mean / median / worst.")


def chosen_names(wanted: str, names: list[str]) -> list[str]:
    """Names that match one of the patterns, in the order of the catalogue."""
    patterns = wanted.split(",")
    idle = [pattern for pattern in patterns if not any(fnmatchcase(name, pattern) for name in names)]
    if idle:
        sys.exit(f"no such name: {', '.join(idle)}; there are {', '.join(names)}")
    return [name for name in names if any(fnmatchcase(name, pattern) for pattern in patterns)]


def keep(sheet: Sheet, rows: list[Row]) -> None:
    """All rows so far."""
    sheet.figures = {"samples": SAMPLES, "rows": [asdict(row) for row in rows]}
    sheet.save()
    for row in rows:
        if row.failure.startswith(ABSENT):
            sheet.miss(row.method, row.failure.removeprefix(ABSENT))


def parsed() -> argparse.Namespace:
    """The arguments."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    parser.add_argument("--pairs", default="*", help="names or patterns, separated by commas")
    parser.add_argument("--modes", default="auto,6", help="auto, or numbers of landmarks")
    parser.add_argument("--peers", default="rotation,correspond,nearest,conformal", help="names or patterns of methods")
    add_options(parser)
    parser.add_argument("--resume", action="store_true", help="with --json: keep the rows that are there, run the others")
    parser.add_argument("--picture", type=Path, help="colours of the target, carried to the source by each method, one line per pair")
    parser.add_argument("--list", action="store_true", help="name the pairs and methods")
    return parser.parse_args()


def main() -> None:
    """Run what is wanted, write as it comes."""
    chosen = parsed()
    pairs = catalogue(None if chosen.data is None else Path(chosen.data))
    if chosen.list:
        sys.stdout.write(f"pairs: {', '.join(pairs)}\nmethods: {', '.join(METHODS)}\n")
        return
    jobs = [(mode, method) for mode in chosen.modes.split(",") for method in chosen_names(chosen.peers, list(METHODS))]
    old = json.loads(chosen.json.read_text())["figures"]["rows"] if chosen.resume and chosen.json and chosen.json.exists() else []
    sheet, rows, shown, stock = Sheet.of(chosen), [Row(**row) for row in old], [], Stock()
    done = {(row.pair, row.mode, row.method) for row in rows}
    for name in chosen_names(chosen.pairs, list(pairs)):
        left = [job for job in jobs if (name, *job) not in done]
        found = []
        for row, picture in rows_of(name, pairs[name], left, stock) if left else ():
            rows.append(row)
            found += [picture] if picture is not None else []
            sys.stderr.write("  ".join(line(row)) + "\n")
            keep(sheet, rows)
        shown.append((name, found))
    sheet.add(Table("Correspondences", HEADS, [line(row) for row in rows]))
    sheet.add(summary(rows))
    if chosen.picture:
        picture_of(shown).save(chosen.picture)


if __name__ == "__main__":
    main()
