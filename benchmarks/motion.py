"""Morph paths and deformation transfer: how well they keep shapes, and what they cost.

    python benchmarks/motion.py [--data DIR] [--automatic] [--reference DIR] [--pictures DIR] [--json FILE] [--markdown]

Paths: volume against the straight line between the ends, rms of the log ratio of edge lengths to theirs, the ratio that 1 % of the
edges fall below, each the worst of t = 0.25, 0.5, 0.75; crossing pairs of triangles at both ends and the most in between. Three
pairs with bands that set out one after the other, coarse ones first: blended in space (wavelet), or turning with the faces (gradient).
Transfer: times; how far poses come from those of a reference (`--reference`: a folder of `lion-01.obj` and so on, made by somebody
else), in rms per bounding-box diagonal after translation; the same for a remeshed copy of the source, whose poses are known. Beside
it the published system with a fourth vertex per face, for the same pairs, factored by scipy's SuperLU. `--automatic` pairs cat and
lion through their spheres, without markers, which takes longest. Without a data folder (`--data`, or the variable MORPHLET_DATA)
generated animals stand in. Times are CPU times: medians where there are several.
"""

import argparse
import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from book import Sheet, Table, add_options
from morphlet import Mesh, VertexPairs, correspond, read, read_pairs, spherical_map, wavelet_bands
from morphlet.metrics import edge_lengths
from morphlet.motion.face_pairs import FacePairs, pair_faces
from morphlet.motion.mixture import Mixture
from morphlet.motion.morph import PATHS, Morph
from morphlet.motion.registration import register
from morphlet.motion.schedule import Schedule
from morphlet.motion.transfer import TransferSolver
from morphlet.report.look import Look
from morphlet.report.render import render
from morphlet.samples.copies import remeshed
from morphlet.samples.creatures import SPECIES, Creature
from morphlet.samples.poses import POSES
from morphlet.surface.intersections import self_intersections

TIMES = (0.25, 0.5, 0.75)
DURATIONS = (0.5, 0.9)
"""Of each band, coarse ones first."""
HORSES, CATS = range(1, 11), range(1, 6)
Poses = list[tuple[str, Mesh]]


def poses_of(data: Path, animal: str, numbers: range) -> Poses:
    """Poses of an animal by name."""
    return [(f"{animal}-{k:02d}", read(data / f"{animal}-poses" / f"{animal}-{k:02d}.obj")) for k in numbers]


def generated() -> tuple[Mesh, Mesh, Poses, Poses]:
    """Two animals of one connectivity, and poses of both."""
    animal = Creature.prepare("grazer")
    other = SPECIES["predator"]
    named = [(name, pose) for name, pose in POSES.items() if name != "standing"]
    return (
        animal.posed(), animal.posed(proportions=other),
        [(name, animal.posed(pose)) for name, pose in named], [(name, animal.posed(pose, other)) for name, pose in named],
    )  # fmt: skip


def cpu(work: Callable[[], Any]) -> tuple[Any, float]:
    """What a call returns, and its CPU time in seconds."""
    start = time.process_time()
    found = work()
    return found, time.process_time() - start


def off(found: np.ndarray, truth: np.ndarray) -> float:
    """Rms distance per bounding-box diagonal of the truth, after translation."""
    gaps = found - found.mean(axis=0) - truth + truth.mean(axis=0)
    return float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))) / np.linalg.norm(np.ptp(truth, axis=0)))


def quality(first: Mesh, last: Mesh, frames: list[Mesh]) -> list[str]:
    """Figures of the frames at `TIMES`."""
    (v, w), (p, q) = (first.volume, last.volume), (edge_lengths(first), edge_lengths(last))
    rows = []
    for t, frame in zip(TIMES, frames, strict=True):
        ratio = edge_lengths(frame) / ((1 - t) * p + t * q)
        rows.append((100 * abs(frame.volume / ((1 - t) * v + t * w) - 1), np.sqrt(np.mean(np.log(ratio) ** 2)), np.quantile(ratio, 0.01)))
    a, b, c = np.array(rows).T
    ends, middle = ([len(self_intersections(mesh)) for mesh in meshes] for meshes in ((first, last), frames))
    return [f"{a.max():.2f}", f"{b.max():.4f}", f"{c.min():.2f}", f"{ends[0]}, {ends[1]}", str(max(middle))]


def paths(source: Mesh, poses: Poses) -> Iterator[list[str]]:
    """A row per pose and path."""
    for name, pose in poses:
        for path in PATHS[:2]:
            morph = Morph(source, pose.vertices, path)
            _, setup = cpu(lambda morph=morph: morph(0.5))
            timed = [cpu(lambda morph=morph, t=t: morph(t)) for t in TIMES]
            figures = quality(source, source.with_vertices(pose.vertices), [frame for frame, _ in timed])
            end = end_gap(source, pose.vertices) if path == "gradient" else 0.0
            yield [name, path, *figures, f"{setup:.2f}", f"{1e3 * np.median([s for _, s in timed]):.1f}", f"{end:.0e}"]


def end_gap(source: Mesh, target: np.ndarray) -> float:
    """How far the end of a gradient path is from the target before it is put there."""
    mixture = Mixture.prepare(source, np.stack([source.vertices, target]))
    return float(np.abs(mixture(np.array([[0.0], [1.0]])) - target).max())


def resolutions(source: Mesh, poses: Poses) -> Iterator[list[str]]:
    """A row per pose, schedule and path for bands with times of their own."""
    mapped = spherical_map(source)
    for name, pose in poses:
        bands, fitted = cpu(lambda pose=pose: wavelet_bands(mapped, pose.vertices))
        for duration in DURATIONS:
            for path in PATHS[:0:-1]:
                morph = Morph(source, pose.vertices, path, bands, Schedule.coarse_first(len(bands), duration))
                _, setup = cpu(lambda morph=morph: morph(0.5))
                timed = [cpu(lambda morph=morph, t=t: morph(t)) for t in TIMES]
                figures = quality(source, source.with_vertices(pose.vertices), [frame for frame, _ in timed])
                pace = f"{1e3 * np.median([s for _, s in timed]):.1f}"
                yield [name, f"{path}, bands of {duration:g}", *figures, f"{fitted + setup:.2f}", pace, ""]


def sides(mesh: Mesh) -> np.ndarray:
    """Two edges of each face and a normal as long as the root of its area doubled, as columns."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    n = np.cross(b - a, c - a)
    return np.stack([b - a, c - a, n / np.sqrt(np.linalg.norm(n, axis=1, keepdims=True))], axis=2)


def fourth_vertices(target: Mesh, chosen: np.ndarray) -> sp.csr_matrix:
    """Rows of the published system for these faces of the target: from vertices, and a fourth one per face, to deformations."""
    inverse, m = np.linalg.inv(sides(target)), target.n_faces
    rows = np.arange(3 * m).reshape(m, 3)
    values = np.concatenate([inverse[:, 0], inverse[:, 1], inverse[:, 2], -inverse.sum(axis=1)])
    ends = np.concatenate([target.faces[:, 1], target.faces[:, 2], target.n_vertices + np.arange(m), target.faces[:, 0]])
    whole = sp.csr_matrix((values.ravel(), (np.tile(rows, (4, 1)).ravel(), np.repeat(ends, 3))), shape=(3 * m, target.n_vertices + m))
    return whole[(3 * chosen[:, None] + np.arange(3)).ravel()]


def published(reference: Mesh, target: Mesh, pairs: FacePairs, poses: Poses) -> tuple[list[np.ndarray], float, float]:
    """Poses by the published system, faces in no pair kept as they are, and its times."""
    unpaired = np.setdiff1d(np.arange(target.n_faces), pairs.target)
    system, build = cpu(lambda: fourth_vertices(target, np.append(pairs.target, unpaired)))
    normal, multiply = cpu(lambda: (system.T @ system).tocsc()[1:][:, 1:])
    options = {"SymmetricMode": True}
    solver, factor = cpu(lambda: splu(normal, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=options))
    inverse = np.linalg.inv(sides(reference))

    def solve(pose: Mesh) -> np.ndarray:
        changes = (sides(pose) @ inverse)[pairs.source].transpose(0, 2, 1).reshape(-1, 3)
        right = np.vstack([changes, np.tile(np.eye(3), (len(unpaired), 1))])
        return np.vstack([np.zeros(3), solver.solve((system.T @ right)[1:])])[: target.n_vertices]

    found = [cpu(lambda pose=pose: solve(pose)) for _, pose in poses]
    return [x for x, _ in found], build + multiply + factor, float(np.median([s for _, s in found]))


def transferred(name: str, solver: TransferSolver, poses: Poses, truth: dict[str, np.ndarray]) -> tuple[list[str], list[Mesh]]:
    """A row of figures, and the meshes."""
    _, prepare = cpu(lambda: TransferSolver.prepare(solver.reference, solver.system.rest, solver.pairs))
    found = [cpu(lambda pose=pose: solver.solve(pose)) for _, pose in poses]
    errors = [off(mesh.vertices, truth[key]) for (key, _), (mesh, _) in zip(poses, found, strict=True) if key in truth]
    figures = [f"{np.mean(errors):.4f}", f"{max(errors):.4f}"] if errors else ["", ""]
    pose = f"{1e3 * np.median([s for _, s in found]):.0f}"
    return [name, str(len(solver.pairs)), f"{prepare:.2f}", pose, *figures], [mesh for mesh, _ in found]


def copies(name: str, source: Mesh, poses: Poses) -> Iterator[list[str]]:
    """The source itself, and a remeshed copy of it, as targets."""
    truth = {key: pose.vertices for key, pose in poses}
    own = TransferSolver.prepare(source, source, FacePairs(np.arange(source.n_faces), np.arange(source.n_faces)))
    yield transferred(f"{name}, itself", own, poses, truth)[0]
    if not source.topology.boundary_loops:
        copy, places = remeshed(source)
        solver = TransferSolver.prepare(source, copy, pair_faces(source, copy))
        yield transferred(f"{name}, remeshed", solver, poses, {key: places.positions(pose) for key, pose in poses})[0]


def marked(name: str, source: Mesh, target: Mesh, markers: VertexPairs) -> tuple[TransferSolver, str]:
    """A solver by markers, and its times."""
    laid, drawn = cpu(lambda: register(source, target, markers))
    pairs, paired = cpu(lambda: pair_faces(laid, target))
    return TransferSolver.prepare(source, target, pairs), f"{name}: registration {drawn:.2f} CPU s, pairs of faces {paired:.2f}"


def beside_published(solver: TransferSolver, poses: Poses, meshes: list[Mesh]) -> str:
    """One line on the published system."""
    found, factor, pose = published(solver.reference, solver.system.rest, solver.pairs, poses)
    apart = max(off(mesh.vertices, x) for mesh, x in zip(meshes, found, strict=True))
    times = f"factor {factor:.2f} CPU s, pose {1e3 * pose:.0f} ms"
    return f"published system, same pairs: {times}, results at most {apart:.4f} of the diagonal apart"


def draw(folder: Path, name: str, poses: Poses, meshes: list[Mesh]) -> None:
    """Pose and result side by side, one picture per pose."""
    from matplotlib.image import imsave

    folder.mkdir(parents=True, exist_ok=True)
    for (key, pose), mesh in zip(poses, meshes, strict=True):
        pixels = [render(shape, look=Look((640, 480))).pixels for shape in (pose, mesh)]
        imsave(folder / f"{name}-{key}.png", np.concatenate(pixels, axis=1))


HEADS = ["transfer", "pairs", "prepare s", "pose ms", "mean rms/diagonal", "worst"]
UNITS = "CPU times."


def public(data: Path, chosen: argparse.Namespace, sheet: Sheet) -> None:
    """Everything on public meshes."""
    horse, cat, lion, camel = (read(data / "meshes" / f"{name}.obj") for name in ("horse", "cat", "lion", "camel"))
    horses, cats = poses_of(data, "horse", HORSES), poses_of(data, "cat", CATS)
    banded = [*resolutions(horse, horses[4:5]), *resolutions(cat, [cats[0], cats[2]])]
    show_paths(sheet, [*paths(horse, horses), *paths(cat, cats), *banded])
    known = {}
    if chosen.reference is not None:
        files = {key: chosen.reference / f"{key.replace('cat', 'lion')}.obj" for key, _ in cats}
        known = {key: read(file).vertices for key, file in files.items() if file.exists()}
    rows, notes = [*copies("horse", horse, horses), *copies("cat", cat, cats)], []
    for name, source, target, poses in (("cat-lion", cat, lion, cats), ("horse-camel", horse, camel, horses)):
        solver, times = marked(name, source, target, read_pairs(data / "markers" / f"{name}.csv"))
        row, meshes = transferred(f"{name}, markers", solver, poses, known if name == "cat-lion" else {})
        rows.append(row)
        notes += [times, f"{name}, {beside_published(solver, poses, meshes)}"]
        if chosen.pictures is not None:
            draw(chosen.pictures, name, poses, meshes)
        if name == "cat-lion" and chosen.automatic:
            positions = correspond(source, target).correspondence.positions
            solver = TransferSolver.prepare(source, target, pair_faces(source.with_vertices(positions), target))
            by_markers = {key: mesh.vertices for (key, _), mesh in zip(poses, meshes, strict=True)}
            rows.append(transferred("cat-lion, automatic" + ("" if known else ", against markers"), solver, poses, known or by_markers)[0])
    sheet.add(Table("Transfer", HEADS, rows, UNITS, notes))


def show_paths(sheet: Sheet, rows: list[list[str]]) -> None:
    """The table of paths."""
    heads = ["pose", "path", "volume %", "rms ln r", "1 % of r", "crossings at ends", "between", "first frame s", "frame ms", "end gap"]
    sheet.add(Table("Paths", heads, rows, UNITS))


def main() -> None:
    """Parse the arguments, measure, print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    parser.add_argument("--automatic", action="store_true")
    parser.add_argument("--reference", type=Path)
    parser.add_argument("--pictures", type=Path)
    add_options(parser)
    chosen = parser.parse_args()
    sheet = Sheet.of(chosen)
    grazer, predator, poses, others = generated()
    Morph(grazer, poses[0][1].vertices, "gradient").frames(3)  # compiles
    if chosen.data is not None:
        public(Path(chosen.data), chosen, sheet)
        return
    show_paths(sheet, list(paths(grazer, poses)))
    copy, places = remeshed(predator)
    solver = TransferSolver.prepare(grazer, copy, pair_faces(grazer.with_vertices(predator.vertices), copy))
    row = transferred("grazer to predator", solver, poses, {key: places.positions(mesh) for key, mesh in others})[0]
    sheet.add(Table("Transfer", HEADS, [*copies("grazer", grazer, poses), row], UNITS))


if __name__ == "__main__":
    main()
