"""Methods of correspondence, the package's own and others', each a function from a known pair and landmarks to places on the target.

A method that is not installed raises `Absent`; whatever else it raises is its result. What is made once per mesh (spherical maps,
spectra) is kept in a `Stock` and its cost is added to every run that uses it.
"""

import contextlib
import io
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np

from morphlet import Mesh, SphericalMap, SurfacePoints, VertexPairs, correspond_maps, laplacian_warp, spherical_map
from morphlet.features.signature import signature
from morphlet.mapping.alignment import Alignment, SphereSamples, align_by_pairs, align_by_search
from morphlet.mapping.embedding import embed
from morphlet.numerics.rigid import rigid
from morphlet.pipeline.correspond import aligned
from morphlet.samples.truth import KnownPair, at_vertices
from morphlet.sphere.quality import certificate
from morphlet.surface.nearest import nearest
from morphlet.surface.repair import close

T = TypeVar("T")

BASIS, ZOOMED, STEP = 30, 150, 5
"""Functional maps: eigenfunctions of the fit, after ZoomOut, and added per step, as in the examples of pyfmaps."""
DESCRIPTORS, EVERY, EVERY_WITH_LANDMARKS = 100, 5, 10
"""Wave kernel signatures, and of how many one is used."""
TABLE_BYTES, LARGEST_TABLE = 31, 16e9
"""Bytes that pyfmaps takes per pair of vertices of two meshes, as measured, and how many in all it is given. Without its table
(it offers that) one map of 28,000 vertices did not end in ten minutes."""
ICP_STEPS = 30
"""Rounds of nearest places and rotation."""

WAVELETS = (0, 5, 15, 50, 150)
"""Numbers of wavelets of the network that warps the sphere."""


class Absent(Exception):
    """A method needs something that is not installed."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Places on the target, one per vertex of the source; what is known about folds on the sphere; remarks."""

    points: SurfacePoints
    folds: int | None = None
    degree: float | None = None
    remark: str = ""


@dataclass(eq=False)
class Stock:
    """Things made once per mesh, and what those taken from it since the last `settle` have cost."""

    kept: dict[tuple[str, str], tuple[Any, float, float]] = field(default_factory=dict)
    failed: dict[tuple[str, str], Exception] = field(default_factory=dict)
    owed: list[float] = field(default_factory=lambda: [0.0, 0.0])

    def take(self, what: str, mesh: Mesh, make: Callable[[Mesh], T]) -> T:
        """The thing; made now if it was not, else its cost is owed."""
        key = (what, mesh.fingerprint)
        if key in self.kept:
            value, wall, cpu = self.kept[key]
            self.owed[0] += wall
            self.owed[1] += cpu
            return value
        if key in self.failed:
            raise self.failed[key]
        wall, cpu = time.perf_counter(), time.process_time()
        try:
            made = make(mesh)
        except Exception as error:  # it would fail again, at the same cost
            self.failed[key] = error
            raise
        self.kept[key] = (made, time.perf_counter() - wall, time.process_time() - cpu)
        return made

    def settle(self) -> tuple[float, float]:
        """Wall and CPU seconds owed, forgotten now."""
        wall, cpu = self.owed
        self.owed = [0.0, 0.0]
        return wall, cpu

    def forget(self, mesh: Mesh) -> None:
        """Drop what belongs to a mesh that will not come again."""
        for key in [key for key in self.kept if key[1] == mesh.fingerprint]:
            del self.kept[key]


Method = Callable[[KnownPair, VertexPairs, Stock], Answer]
"""From a pair, true landmarks (none: automatic) and the stock to an answer."""


def rotation(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """Both spherical maps and nothing but a rotation between them: by landmarks, else searched for."""
    meshes = (pair.source, pair.target)
    maps: list[SphericalMap] = [stock.take("sphere", mesh, spherical_map) for mesh in meshes]
    turn = _turn([one.points for one in maps], meshes, landmarks, stock)
    proof = maps[0].certificate()
    return Answer(maps[1].locate(turn(maps[0].points)), proof.inverted, proof.degree, "ambiguous" if turn.ambiguous else "")


def laplacian(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """The rotation, then `morphlet.laplacian_warp` of the source's sphere: the paper's warp by differential coordinates, which may fold."""
    maps: list[SphericalMap] = [stock.take("sphere", mesh, spherical_map) for mesh in (pair.source, pair.target)]
    pairs, said = (landmarks, ()) if len(landmarks) else _matched_tips(pair, stock)
    goals = maps[1].points[pairs.target]
    turned = align_by_pairs(maps[0].points[pairs.source], goals)(maps[0].points)
    warped = laplacian_warp(turned, pair.source.topology, pairs.source, goals)
    proof = certificate(warped, pair.source.faces)
    return Answer(maps[1].locate(warped), proof.inverted, proof.degree, "; ".join(said))


def pipeline(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """`morphlet.correspond_maps` as the package offers it."""
    maps = [stock.take("sphere", mesh, spherical_map) for mesh in (pair.source, pair.target)]
    found = correspond_maps(maps[0], maps[1], landmarks if len(landmarks) else None)
    proof = found.laid.certificate()
    said = (*(() if len(landmarks) else (f"{len(found.pairs)} pairs",)), *(("ambiguous",) * found.ambiguous))
    return Answer(found.correspondence.points, proof.inverted, proof.degree, "; ".join(said))


def dense(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """`morphlet.mapping.embedding`: the source laid into the target's sphere by landmarks; automatic ones are matched tips."""
    target: SphericalMap = stock.take("sphere", pair.target, spherical_map)
    pairs, said = (landmarks, ()) if len(landmarks) else _matched_tips(pair, stock)
    found = embed(stock.take("closed", pair.source, close), target, pairs)
    proof = found.certificate()
    unmet = (f"{len(found.unmet)} of {len(pairs)} landmarks unmet",) if len(found.unmet) else ()
    return Answer(found.correspondence().points, proof.inverted, proof.degree, "; ".join((*said, *unmet)))


def warped(pair: KnownPair, landmarks: VertexPairs, stock: Stock, n_wavelets: int) -> Answer:
    """The rotation and the wavelet network's warp of the source's sphere, and no more."""
    maps: list[SphericalMap] = [stock.take("sphere", mesh, spherical_map) for mesh in (pair.source, pair.target)]
    pairs, said = (landmarks, ()) if len(landmarks) else _matched_tips(pair, stock)
    points = aligned(maps[0], maps[1], pairs, n_wavelets)(maps[0].points)
    proof = certificate(points, pair.source.faces)
    apart = np.arccos(np.clip(np.einsum("kd,kd->k", points[pairs.source], maps[1].points[pairs.target]), -1, 1))
    return Answer(maps[1].locate(points), proof.inverted, proof.degree, "; ".join((*said, f"{np.degrees(apart.mean()):.1f} degrees left")))


def started(pair: KnownPair, landmarks: VertexPairs, stock: Stock, n_wavelets: int) -> Answer:
    """The dense map from where that warp leaves the source."""
    maps: list[SphericalMap] = [stock.take("sphere", mesh, spherical_map) for mesh in (pair.source, pair.target)]
    pairs, said = (landmarks, ()) if len(landmarks) else _matched_tips(pair, stock)
    start = aligned(maps[0], maps[1], pairs, n_wavelets)(maps[0].closed_points)
    found = embed(maps[0].surface, maps[1], pairs, start=start)
    proof = found.certificate()
    return Answer(found.correspondence().points, proof.inverted, proof.degree, "; ".join(said))


def nearest_rigid(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """The nearest place after scaling to equal area and a rigid motion: by landmarks, or from the files' own axes by ICP."""
    scale = np.sqrt(pair.target.area / pair.source.area)
    points = scale * pair.source.vertices
    if len(landmarks):
        moved = rigid(points[landmarks.source], pair.target.vertices[landmarks.target])(points)
        return Answer(nearest(pair.target, moved))
    centre = [np.average(m.vertices, axis=0, weights=m.vertex_areas) for m in (pair.source, pair.target)]
    moved, weight = points - scale * centre[0] + centre[1], pair.source.vertex_areas
    for _ in range(ICP_STEPS):
        moved = rigid(moved, nearest(pair.target, moved).positions(pair.target), weight)(moved)
    return Answer(nearest(pair.target, moved), remark="starts from the files' axes")


def conformal(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """lapy's spherical conformal maps, and the package's rotation between them."""
    spheres = [stock.take("conformal", mesh, _conformal_sphere) for mesh in (pair.source, pair.target)]
    turn = _turn(spheres, (pair.source, pair.target), landmarks, stock)
    found = nearest(pair.target.with_vertices(spheres[1]), turn(spheres[0]))
    proofs = [certificate(sphere, mesh.faces) for sphere, mesh in zip(spheres, (pair.source, pair.target), strict=True)]
    remark = f"{proofs[1].inverted} folds in the target's sphere" if proofs[1].inverted else ""
    return Answer(found, proofs[0].inverted, proofs[0].degree, remark)


def functional(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """pyfmaps: wave kernel signatures, ZoomOut, precise map."""
    return _functional(pair, landmarks, stock, 0.0)


def functional_oriented(pair: KnownPair, landmarks: VertexPairs, stock: Stock) -> Answer:
    """The same with its orientation term."""
    return _functional(pair, landmarks, stock, 1.0)


METHODS: dict[str, Method] = {
    "rotation": rotation,
    "laplacian": laplacian,
    "correspond": pipeline,
    "dense": dense,
    "nearest": nearest_rigid,
    "conformal": conformal,
    "fmap": functional,
    "fmap-orient": functional_oriented,
    **{f"warp-{count}": partial(warped, n_wavelets=count) for count in WAVELETS},
    **{f"from-warp-{count}": partial(started, n_wavelets=count) for count in WAVELETS},
}
"""By the names of `--peers`."""


def _turn(spheres: list[np.ndarray], meshes: tuple[Mesh, Mesh], landmarks: VertexPairs, stock: Stock) -> Alignment:
    """The rotation of one sphere onto the other."""
    if len(landmarks):
        return align_by_pairs(spheres[0][landmarks.source], spheres[1][landmarks.target])
    seen = [stock.take("signature", mesh, signature) for mesh in meshes]
    return align_by_search(*(SphereSamples(p, s, m.vertex_areas) for p, s, m in zip(spheres, seen, meshes, strict=True)))


def _matched_tips(pair: KnownPair, stock: Stock) -> tuple[VertexPairs, tuple[str, ...]]:
    """Tips of feature regions that go together, without the cores, and what is to be said about them."""
    try:
        from morphlet.features.matching import match
        from morphlet.features.regions import find_regions
    except ImportError as error:
        raise Absent(str(error)) from error
    found = match(*(stock.take("regions", mesh, find_regions) for mesh in (pair.source, pair.target)))
    tips = [k for k, label in enumerate(found.pairs.labels) if "core" not in label]
    return VertexPairs(found.pairs.source[tips], found.pairs.target[tips]), (f"{len(tips)} tips", *(("ambiguous",) * found.ambiguous))


def _conformal_sphere(mesh: Mesh) -> np.ndarray:
    """Unit vectors of lapy's map, turned outwards."""
    try:
        from lapy import TriaMesh
        from lapy.conformal import spherical_conformal_map
    except ImportError as error:
        raise Absent(str(error)) from error
    points = np.asarray(spherical_conformal_map(TriaMesh(np.array(mesh.vertices), np.array(mesh.faces))))
    points = points / np.linalg.norm(points, axis=1, keepdims=True)
    return points if certificate(points, mesh.faces).degree > 0 else -points


def _functional(pair: KnownPair, landmarks: VertexPairs, stock: Stock, orientation: float) -> Answer:
    """Fit, ZoomOut, precise map; from the source to the target means pyfmaps' meshes 2 and 1."""
    try:
        from pyFM.functional import FunctionalMapping
    except ImportError as error:
        raise Absent(str(error)) from error
    table = TABLE_BYTES * pair.source.n_vertices * pair.target.n_vertices
    if table > LARGEST_TABLE:
        raise MemoryError(f"its table of all pairs of vertices takes {table / 1e9:.0f} GB")
    np.random.seed(0)  # noqa: NPY002 (the peer draws from it)
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model = FunctionalMapping(*(stock.take("spectrum", mesh, _spectrum) for mesh in (pair.target, pair.source)))
        given = np.column_stack([landmarks.target, landmarks.source]) if len(landmarks) else None
        every = EVERY_WITH_LANDMARKS if len(landmarks) else EVERY
        model.preprocess(n_descr=DESCRIPTORS, descr_type="WKS", k_process=ZOOMED, subsample_step=every, landmarks=given)
        model.fit(K=(BASIS, BASIS), w_descr=1e-1, w_lap=1e-3, w_dcomm=1, w_orient=orientation)
        zoomed = model.zoomout_refine(nit=(ZOOMED - BASIS) // STEP, step=STEP)
        return Answer(_places(model.get_precise_map(FM=zoomed), pair.target))


def _spectrum(mesh: Mesh) -> Any:
    """A mesh of pyfmaps with its eigenfunctions."""
    from pyFM.mesh import TriMesh

    made = TriMesh(np.array(mesh.vertices), np.array(mesh.faces, np.int32))
    made.process(ZOOMED)
    return made


def _places(found: Any, target: Mesh) -> SurfacePoints:
    """Faces and weights of a precise map, which comes as both, or as a matrix that holds one vertex per row."""
    if isinstance(found, tuple):
        weights = np.clip(np.asarray(found[1], float), 0, None)
        return SurfacePoints(np.asarray(found[0], np.int64), weights / weights.sum(axis=1, keepdims=True))
    return at_vertices(target, np.asarray(found.argmax(axis=1)).ravel())
