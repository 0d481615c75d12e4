"""Correspondence: where each vertex of a source mesh lies on a target mesh.

It points from source to target: one row per vertex of the source, each a face of the target with weights. Whatever lives on the
target (colours, positions, fields) can be pulled back along it to the source. Its quality is measured by functions, not stored.
"""

import os
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.numerics.linalg import factorize
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest
from morphlet.surface.operators import laplacian
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints

if TYPE_CHECKING:
    from morphlet.sphere.map import SphericalMap

KIND, VERSION = "correspondence", 1
"""What the file calls itself."""
COLLAPSED = 1e-4
"""An image triangle below this share of the area it should have is collapsed: its normal means nothing, so it is no fold."""
AROUND = 0.1
"""How far around a vertex its confidence looks, in sqrt(area): the best guide to the error of 0, 0.02, 0.05 and 0.1 (see `confidence`)."""
AT_PAIRS = 0.05
"""The same for pairs: nearer, since a wrong one strains its own surroundings most."""
DOUBTFUL, STANDS_OUT = 0.1, 4.5
"""A pair with more strain around it than this, and than so many times the median, is doubtful. Right pairs were seen up to 3.0 times, and
up to 4.2 where a stub of a tail goes on a brush; single ones wrong by 0.1 sqrt(area) from 14 times between poses of one animal, 3.7 to 6
between animals (the nearest of them go unnoticed); those wrong by 0.3 from 10 times."""
STRAINED = 0.3
"""A map with a larger median strain is strained all over: seen with right pairs up to 0.17, with limbs exchanged from 0.37."""
STRETCHED = (
    "{count} of {all} pairs are doubtful, most of all {first}: around it the map's energy is {own:.2f}, elsewhere {middle:.2f}; "
    "look at them, or leave them out"
)
EXCHANGED = (
    "the map is strained all over (median {strain:.2f}, right pairs stay below {most}): left and right, or two limbs, may be exchanged"
)
"""What is said of pairs that are not to be trusted blindly."""
LEAST_AREA_RATIO = 1e-3
"""Squared area ratio at which the energy of a collapsing triangle stops growing: at 16 for a point, near 250 for a line of unit stretch."""


@dataclass(frozen=True, eq=False)
class Correspondence:
    """A map from the vertices of `source` to places on `target`.

    Parameters
    ----------
    source, target
        Where the map starts and where it ends.
    points
        One place on the target per vertex of the source.
    valid
        False for vertices without an answer of their own (unreferenced, on a dropped part); all true if left out.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> swapped = Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], [[1, 0, 0], [0, 0, 1], [0, 1, 0]]))
    >>> swapped.pull([10.0, 20.0, 30.0])
    array([10., 30., 20.])
    """

    source: Mesh
    target: Mesh
    points: SurfacePoints
    valid: Bool[np.ndarray, "n"] | None = None

    def __post_init__(self) -> None:
        n = self.source.n_vertices
        if len(self.points) != n:
            raise InputError(f"{n} places, one per vertex of the source", str(len(self.points)), "pass the mesh that was mapped")
        _arrays.index(self.points.faces, "the target's faces in the points", (n,), self.target.n_faces)
        valid = np.ones(n, bool) if self.valid is None else np.array(self.valid, bool)
        if valid.shape != (n,):
            raise InputError(f"valid of shape ({n},)", f"shape {valid.shape}", "pass one flag per vertex of the source")
        object.__setattr__(self, "valid", _arrays.freeze(valid))

    def __reduce__(self) -> tuple[Any, ...]:
        return Correspondence, (self.source, self.target, self.points, np.array(self.valid))

    @cached_property
    def matrix(self) -> sp.csr_matrix:
        """(n, n_target) matrix that takes values at the target's vertices to the source's; rows sum to 1."""
        return self.points.matrix(self.target)

    @cached_property
    def positions(self) -> Float[np.ndarray, "n 3"]:
        """Where the source's vertices lie on the target."""
        return _arrays.freeze(self.points.positions(self.target))

    def pull(self, values_on_target: Float[np.ndarray, "k *d"]) -> Float[np.ndarray, "n *d"]:
        """Values given at the target's vertices, seen from the source's vertices.

        Raises
        ------
        InputError
            If there is not one row per vertex of the target.
        """
        values = np.asarray(values_on_target, float)
        if values.shape[:1] != (self.target.n_vertices,):
            raise InputError(f"{self.target.n_vertices} rows, one per vertex of the target", f"shape {values.shape}", "pull its values")
        return self.matrix @ values

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write `faces`, `weights` and `valid` to an .npz file; the meshes are named by their fingerprints, not stored."""
        arrays = {"faces": self.points.faces, "weights": self.points.weights, "valid": np.asarray(self.valid)}
        marks = {"source_fingerprint": np.array(self.source.fingerprint), "target_fingerprint": np.array(self.target.fingerprint)}
        _store.save(path, KIND, VERSION, arrays | marks)

    @staticmethod
    def load(path: str | os.PathLike[str], source: Mesh, target: Mesh) -> "Correspondence":
        """Read a file that was saved for these two meshes.

        Raises
        ------
        FileError
            If the file holds something else, or belongs to other meshes.
        """
        arrays = _store.load(path, KIND, VERSION, ("faces", "weights", "valid"))
        for name, mesh in (("source", source), ("target", target)):
            stored = arrays.get(f"{name}_fingerprint")
            if stored is not None and str(stored) != mesh.fingerprint:
                advice = f"pass the {name} mesh that the map was made for, or make the map again"
                raise FileError(f"a map made for this {name}", f"one for another mesh ({str(stored)[:8]}...)", advice)
        try:
            return Correspondence(source, target, SurfacePoints(arrays["faces"], arrays["weights"]), arrays["valid"])
        except InputError as error:
            raise FileError(f"a correspondence of these meshes at {path}", error.found, "pass the meshes it was made for") from error


def compose(source_map: "SphericalMap", target_map: "SphericalMap") -> Correspondence:
    """Up from the source to a sphere, and down from the same sphere to the target.

    Parameters
    ----------
    source_map, target_map
        Both meshes laid on one sphere: one laid into the other's, both laid into that of a third, or turned onto each other.

    Notes
    -----
    Each vertex of the source asks the target's map for the face its direction pierces; O(n) plus the lookup.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> one = spherical_map(Mesh(*icosphere(1)))
    >>> same = compose(one, one)
    >>> bool(np.abs(same.positions - one.mesh.vertices).max() < 1e-9)
    True
    """
    return Correspondence(source_map.mesh, target_map.mesh, target_map.locate(source_map.points), source_map.valid)


def folds_surface_percent(correspondence: Correspondence) -> float:
    """Share of the source's triangles that arrive on the target face down, in percent.

    A triangle is folded if its image's normal has a negative product with the target's normal at the place nearest to the
    image's centroid. Collapsed images (`COLLAPSED`) have no normal and are not counted. A map without folds on the sphere may
    still have some here, where the target's triangles are large against the source's.

    Notes
    -----
    O((n + m) log m).

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> folds_surface_percent(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], [[1, 0, 0], [0, 0, 1], [0, 1, 0]])))
    100.0
    """
    source, target = correspondence.source, correspondence.target
    image = source.with_vertices(correspondence.positions)
    if not source.n_faces:
        return 0.0
    expected = source.face_areas * (target.area / source.area if source.area > 0 else 1.0)
    kept = np.nonzero((image.face_areas > COLLAPSED * expected) & (image.face_areas > 0))[0]
    centroids = image.vertices[image.faces[kept]].mean(axis=1)
    beneath = target.face_normals[nearest(target, centroids).faces]
    folded = np.einsum("fd,fd->f", image.face_normals[kept], beneath) < 0
    return 100.0 * float(folded.sum()) / source.n_faces


def stretch_energies(correspondence: Correspondence) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Symmetric Dirichlet energy of each triangle's image, 1 for an isometry, and the triangle's area.

    Both surfaces are scaled to unit area first. With the singular values s and r of the linear map of a triangle onto the
    triangle of its images the energy is ``(s^2 + r^2) (1 + 1 / (s r)^2) / 4``. Triangles of the source without area are left out.

    Returns
    -------
    energy, area
        For the k triangles of the source that have an area; areas sum to 1.

    Notes
    -----
    In the second summand ``(s r)^2`` is bounded from below by `LEAST_AREA_RATIO`, so that one collapsed triangle does not
    outweigh the rest, and with it ``s^2 + r^2 >= 2 s r``. O(m).

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> stretch_energies(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3))))[0].round(12)
    array([1.])
    """
    source, target = correspondence.source, correspondence.target
    solid = source.face_areas > 0
    p, q = source.vertices[source.faces[solid]], correspondence.positions[source.faces[solid]]
    before, after = _edges(p) / np.sqrt(source.area), _edges(q) / np.sqrt(target.area)
    stretch, ratio = _stretch(before, after)
    inverse = np.maximum(stretch, 2 * np.sqrt(LEAST_AREA_RATIO)) / np.maximum(ratio, LEAST_AREA_RATIO)
    return 0.25 * (stretch + inverse), source.face_areas[solid] / source.area


def energy(correspondence: Correspondence) -> float:
    """Mean of `stretch_energies` over the source's area: 1 for an isometry, more for anything else.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> round(energy(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3)))), 12)
    1.0
    """
    energies, areas = stretch_energies(correspondence)
    return float(energies @ areas)


def energy_mean(correspondence: Correspondence) -> float:
    """Mean of `stretch_energies` over the source's triangles, each counting the same.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> round(energy_mean(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3)))), 12)
    1.0
    """
    return float(np.mean(stretch_energies(correspondence)[0]))


def strain(correspondence: Correspondence, around: float = AROUND) -> Float[np.ndarray, "n"]:
    """Log of `stretch_energies` around each vertex of the source: 0 where the map is an isometry.

    Parameters
    ----------
    correspondence
        A map. Vertices without an answer of their own get the largest strain.
    around
        How far its surroundings reach, in sqrt(area): the values diffuse for the time of that length squared.

    Raises
    ------
    InputError
        If the length is not positive.

    Notes
    -----
    One sparse solve.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> strain(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3)))).round(9) + 0.0
    array([0., 0., 0.])
    """
    if not around > 0:
        raise InputError("a positive length", str(around), f"leave it out, or try {AROUND}")
    source, valid = correspondence.source, np.asarray(correspondence.valid)
    energies, areas = stretch_energies(correspondence)
    faces = source.faces[source.face_areas > 0]
    areas = areas * valid[faces].all(axis=1)
    weight, total = (np.bincount(faces.ravel(), np.repeat(x, 3), source.n_vertices) / 3 for x in (areas, areas * np.log(energies)))
    held = np.where(weight > 0, weight, weight.mean())  # a vertex without area of its own takes its neighbours' strain
    system = sp.diags_array(held) + around**2 * laplacian(source)
    found = np.maximum(factorize(system.tocsc(), source.vertices).solve(total), 0.0)
    return np.where(valid, found, found.max(initial=0.0))


def confidence(correspondence: Correspondence) -> Float[np.ndarray, "n"]:
    """How far the answer of each vertex can be trusted: 1 where the map around it is an isometry, towards 0 where it is strained.

    Returns
    -------
    Float[np.ndarray, "n"]
        exp(-`strain`), from 0 to 1; 0 for vertices without an answer of their own.

    Notes
    -----
    It tells strained surroundings from easy ones, not a slide along the surface that strains nothing. On eight remeshed pairs (a grazer,
    a predator, a wolf, a horse and a cat in other poses, and a grazer on a predator; 6 landmarks, 800 vertices each; run
    `benchmarks/confidence.py --back`) the strain has a rank correlation of 0.60 with the true error over all vertices, and of 0.40
    within a pair in the mean (0.23 to 0.71); the mean error, in percent of sqrt(area), is 0.43 in the fifth with the highest confidence
    and 2.13 in that with the lowest. What else was tried tells less: the round trip through the inverse 0.29 and 0.28, the distance to
    the nearest landmark 0.10 and 0.07, the distance to another map, made from target to source at the same cost again, 0.44 and 0.31.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> confidence(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3)), [True, True, False])).round(9)
    array([1., 1., 0.])
    """
    return np.where(np.asarray(correspondence.valid), np.exp(-strain(correspondence)), 0.0)


def doubtful_pairs(correspondence: Correspondence, pairs: VertexPairs) -> Int[np.ndarray, "k"]:
    """Which pairs strain the map around them far more than it is strained elsewhere: look at them before trusting it.

    Parameters
    ----------
    correspondence
        A map that was made with the pairs.
    pairs
        Vertices that were pulled together.

    Raises
    ------
    InputError
        If a pair names a vertex that a mesh does not have.

    Notes
    -----
    One sparse solve, where `leave_one_out` takes a map per pair: a grazer of 1,700 vertices on the leaping one by 7 landmarks, one of
    them 0.15 sqrt(area) off, took 0.02 CPU s against 8.5; both gave that one. Between animals of other proportions a pair that is wrong by
    0.1 sqrt(area) may go unnoticed, and exchanged limbs strain the whole map instead.

    Examples
    --------
    >>> from morphlet import VertexPairs, correspond, Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(3)
    >>> egg = Mesh(points * [1.0, 1.2, 1.6], faces)
    >>> wrong = VertexPairs(range(12), [*range(11), 367])
    >>> doubtful_pairs(correspond(egg, egg, wrong).correspondence, wrong)
    array([11])
    """
    pairs.checked(correspondence.source, correspondence.target)
    found = strain(correspondence, AT_PAIRS)
    return np.flatnonzero(found[pairs.source] > max(DOUBTFUL, STANDS_OUT * float(np.median(found))))


def doubts(correspondence: Correspondence, pairs: VertexPairs) -> tuple[str, ...]:
    """What a person should know about the pairs that a map was made with, in sentences; none if nothing stands out.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints, VertexPairs
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> doubts(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3))), VertexPairs([0, 1], [0, 1]))
    ()
    """
    if not len(pairs):
        return ()
    found, wrong = strain(correspondence, AT_PAIRS), doubtful_pairs(correspondence, pairs)
    middle, told = float(np.median(found)), []
    if len(wrong):
        first = max(wrong.tolist(), key=lambda k: found[pairs.source[k]])
        name = f"{pairs.source[first]},{pairs.target[first]} {pairs.labels[first]}".strip()
        own = np.exp(found[pairs.source[first]])
        told.append(STRETCHED.format(count=len(wrong), all=len(pairs), first=name, own=own, middle=np.exp(middle)))
    if middle > STRAINED:
        told.append(EXCHANGED.format(strain=middle, most=STRAINED))
    return tuple(told)


def pairs_rmse(correspondence: Correspondence, pairs: VertexPairs) -> float:
    """Root mean square distance, in mesh units, from the images of paired source vertices to their target vertices.

    Raises
    ------
    InputError
        If a pair names a vertex that a mesh does not have, or there are no pairs.

    Examples
    --------
    >>> from morphlet import Mesh, SurfacePoints, VertexPairs
    >>> import numpy as np
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> pairs_rmse(Correspondence(mesh, mesh, SurfacePoints([0, 0, 0], np.eye(3))), VertexPairs([0, 1], [0, 0])).__round__(6)
    0.707107
    """
    if not len(pairs):
        raise InputError("at least one pair", "none", "pass pairs, or leave this figure out")
    pairs.checked(correspondence.source, correspondence.target)
    gaps = correspondence.positions[pairs.source] - correspondence.target.vertices[pairs.target]
    return float(np.sqrt(np.mean(np.sum(gaps**2, axis=1))))


def _edges(corners: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k 3 2"]:
    """The two edge vectors from corner 0, as columns."""
    return np.stack([corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=2)


def _stretch(before: Float[np.ndarray, "k 3 2"], after: Float[np.ndarray, "k 3 2"]) -> tuple[np.ndarray, np.ndarray]:
    """s^2 + r^2 and (s r)^2 of the linear maps between triangles: trace and determinant of G_before^-1 G_after."""
    g, h = (np.einsum("kdi,kdj->kij", e, e) for e in (before, after))
    det_g, det_h = (np.sum(np.cross(e[:, :, 0], e[:, :, 1]) ** 2, axis=1) for e in (before, after))
    trace = g[:, 1, 1] * h[:, 0, 0] + g[:, 0, 0] * h[:, 1, 1] - 2 * g[:, 0, 1] * h[:, 0, 1]
    return trace / det_g, det_h / det_g
