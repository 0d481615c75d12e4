"""Numbers under stress: the same creature in other units, far away, rounded, squeezed, with doubled vertices, and a million vertices.

The answer must be that of the creature as it is, in the stressed one's units: told is how far it is from it, over the size of what is
answered. A creature that is squeezed or has a million vertices is another one: its answers must hold by themselves.
"""

import resource
import sys
import time
from collections.abc import Callable
from functools import cache

import numpy as np

from morphlet import (
    Mesh,
    MorphletError,
    RepairOptions,
    Roi,
    RoiEditor,
    VertexPairs,
    approximate_by_rows,
    correspond,
    decode,
    encode,
    landmarks,
    repair,
    sample,
    spherical_map,
)
from torture_pool import Task

VERTICES = 1500
MILLION = 317
"""Parts of an edge of the icosahedron: 10 n^2 + 2 vertices."""
CLOSE = {"sphere": 1e-2, "correspond": 1e-2, "deform": 1e-6, "encode": 1.0 + 1e-6, "approximate": 1e-2}
"""How far an answer may be from that of the creature as it is: iterations that stop at a tolerance part a little; of `encode` the error
over its bound."""
ERROR = 1e-3
"""Of `encode`, over the bounding-box diagonal."""
SCALES = (1e-12, 1e-6, 1e6, 1e12)
VERBS = ("sphere", "correspond", "deform", "encode", "approximate")
STRESSES = (
    "as it is",
    *(f"scale {scale:g}" for scale in SCALES),
    "offset 1e8",
    "single precision",
    "an axis times 1e-4",
    "doubled vertices",
)
OTHER = ("an axis times 1e-4",)
"""Stresses after which the shape is another one."""
MANY = "a million vertices"
MANY_VERBS = ("sphere", "deform", "encode")


def creature(name: str) -> Mesh:
    """As it is."""
    return sample(name, n_vertices=VERTICES)


def stressed(mesh: Mesh, stress: str) -> tuple[Mesh, Callable[[np.ndarray], np.ndarray]]:
    """The mesh under stress, and the way back for positions of it."""
    x, how = mesh.vertices, stress.split()
    if how[0] == "scale":
        return mesh.with_vertices(x * float(how[1])), lambda y: y / float(how[1])
    if how[0] == "offset":
        return mesh.with_vertices(x + float(how[1])), lambda y: y - float(how[1])
    if how[0] == "single":
        return mesh.with_vertices(x.astype(np.float32).astype(np.float64)), lambda y: y
    if how[0] == "an":
        return mesh.with_vertices(x * [1, 1, 1e-4]), lambda y: y * [1, 1, 1e4]
    if how[0] == "doubled":
        return doubled(mesh), lambda y: y
    return mesh, lambda y: y


def doubled(mesh: Mesh) -> Mesh:
    """Every tenth vertex twice: the first of its faces has one of its own, as at a seam."""
    twice = np.arange(0, mesh.n_vertices, 10)
    faces = np.array(mesh.faces)
    corner = np.array([np.flatnonzero(mesh.faces.ravel() == v)[0] for v in twice])
    faces.ravel()[corner] = mesh.n_vertices + np.arange(len(twice))
    return Mesh(np.vstack([mesh.vertices, mesh.vertices[twice]]), faces)


def sphere(stress: str) -> np.ndarray:
    """The points of the spherical map."""
    mesh, _ = stressed(creature("grazer-walking"), stress)
    found = spherical_map(mesh)
    quality = found.quality()
    require(quality.inverted == 0 and abs(quality.degree - 1) < 1e-9, f"{quality.inverted} inverted, degree {quality.degree}")
    return found.points[:VERTICES]


def corresponding(stress: str) -> np.ndarray:
    """Where the vertices of the source lie on the target."""
    source, _ = stressed(creature("grazer-walking"), stress)
    target, back = stressed(creature("grazer"), stress)
    chosen = np.array(sorted(landmarks("grazer", VERTICES).values()))
    found = correspond(source, target, VertexPairs(chosen, chosen))
    require(found.figures()["folds_sphere"] == 0, "folds on the sphere")
    return back(np.asarray(found.correspondence.positions))[:VERTICES]


def deformed(stress: str) -> np.ndarray:
    """The creature after its head was pulled."""
    mesh, back = stressed(creature("grazer"), stress)
    if stress == "doubled vertices":
        mesh = repair(mesh, RepairOptions(split=False)).mesh
    size = float(np.ptp(mesh.vertices, axis=0).max())
    handle = np.argsort(-creature("grazer").vertices[:, 2])[:10]
    roi = Roi.within(mesh, handle, 0.5 * size)
    x = mesh.vertices[roi.handle]
    found = RoiEditor.prepare(roi).solve(x + 0.1 * (x - mesh.vertices.mean(axis=0)))
    return back(found.vertices)[:VERTICES]


def coded(stress: str) -> np.ndarray:
    """The largest error of a file over what was asked for; told by itself."""
    mesh, _ = stressed(creature("grazer"), stress)
    return np.array([coding_error(mesh)])


def coding_error(mesh: Mesh) -> float:
    """The largest distance of a vertex from where it was, over the bound."""
    bound = ERROR * mesh.bbox_diagonal
    found = encode(mesh, error=bound)
    back = decode(found.data)[0]
    require(back.n_vertices == mesh.n_vertices and back.n_faces == mesh.n_faces, "other counts")
    places = mesh.vertices[found.permutation]
    return float(np.linalg.norm(back.vertices - places, axis=1).max() / bound)


def approximated(stress: str) -> np.ndarray:
    """The creature in wavelets of rows."""
    mesh, back = stressed(creature("grazer"), stress)
    found = approximate_by_rows(spherical_map(mesh), 65).mesh()
    require(np.isfinite(found.vertices).all(), "not finite")
    return back(found.vertices)[:VERTICES]


ANSWERS: dict[str, Callable[[str], np.ndarray]] = {
    "sphere": sphere,
    "correspond": corresponding,
    "deform": deformed,
    "encode": coded,
    "approximate": approximated,
}


def require(fine: object, what: str) -> None:
    """Sound or not."""
    if not fine:
        raise ArithmeticError(what)


@cache
def usual(verb: str) -> np.ndarray:
    """The answer for the creature as it is."""
    return ANSWERS[verb]("as it is")


def attempt(task: Task) -> tuple[str, str]:
    """One verb under one stress; the note is what the table shows."""
    verb, stress = task["verb"], task["stress"]
    if stress == MANY:
        return a_million(verb)
    try:
        found = ANSWERS[verb](stress)
    except MorphletError as error:
        return "refused", f"refused: {error}"
    if verb == "encode":
        away = float(found[0])
    elif stress in OTHER:
        require(np.isfinite(found).all(), "not finite")
        return "done", "sound"
    else:
        ordinary = usual(verb)
        away = float(np.sqrt(np.mean(np.sum((found - ordinary) ** 2, axis=1)))) / float(np.ptp(ordinary, axis=0).max())
    require(away <= CLOSE[verb], f"{away:.3g} from the usual answer")
    return "repaired" if stress == "doubled vertices" and verb != "encode" else "done", f"{away:.1e}"


def geodesic(parts: int) -> Mesh:
    """A lopsided ball: an icosahedron whose edges have so many parts."""
    from morphlet.numerics.unit_sphere import icosphere

    corners, faces = icosphere(0)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(parts + 1), np.arange(parts + 1), indexing="ij"))
    keep = i + j <= parts
    i, j = i[keep], j[keep]
    number = -np.ones((parts + 2, parts + 2), np.int64)
    number[i, j] = np.arange(len(i))
    first, second = i + j < parts, i + j < parts - 1
    up = np.stack([number[i, j], number[i + 1, j], number[i, j + 1]], 1)[first]
    down = np.stack([number[i + 1, j], number[i + 1, j + 1], number[i, j + 1]], 1)[second]
    a, b, c = (corners[faces[:, k]][:, None, :] for k in range(3))
    points = (a * (parts - i - j)[:, None] + b * i[:, None] + c * j[:, None]) / parts
    grid = points.reshape(-1, 3)
    _, kept, place = np.unique(np.round(grid, 9), axis=0, return_index=True, return_inverse=True)
    local = np.vstack([up, down])
    triangles = place.ravel()[(len(i) * np.arange(len(faces)))[:, None, None] + local].reshape(-1, 3)
    unit = grid[kept] / np.linalg.norm(grid[kept], axis=1, keepdims=True)
    return Mesh(unit * [1.0, 1.3, 0.8] + 0.2 * unit[:, [0]] ** 2, triangles)


def a_million(verb: str) -> tuple[str, str]:
    """One verb on a million vertices: its time and memory."""
    mesh = geodesic(MILLION)
    began = time.process_time()
    if verb == "sphere":
        quality = spherical_map(mesh).quality()
        require(quality.inverted == 0, f"{quality.inverted} inverted")
    elif verb == "deform":
        handle = np.argsort(-mesh.vertices[:, 1])[:50]
        roi = Roi.within(mesh, handle, 0.6)
        moved = RoiEditor.prepare(roi).solve(mesh.vertices[roi.handle] + [0, 0.1, 0])
        require(np.isfinite(moved.vertices).all(), "not finite")
    else:
        require(coding_error(mesh) <= CLOSE["encode"], "an error beyond its bound")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / (1 << 20 if sys.platform != "darwin" else 1 << 30)
    return "done", f"{mesh.n_vertices} V: {time.process_time() - began:.0f} CPU s, {memory:.1f} GB"
