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
from jaxtyping import Bool, Float

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.mapping.alignment import Alignment
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints

if TYPE_CHECKING:
    from morphlet.sphere.map import SphericalMap

KIND, VERSION = "correspondence", 1
"""What the file calls itself."""
COLLAPSED = 1e-4
"""An image triangle below this share of the area it should have is collapsed: its normal means nothing, so it is no fold."""
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


def compose(source_map: "SphericalMap", target_map: "SphericalMap", alignment: Alignment) -> Correspondence:
    """From the source to its sphere, across to the target's sphere, down to the target.

    Parameters
    ----------
    source_map, target_map
        Spherical maps of both meshes.
    alignment
        Takes the source's sphere to the target's.

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
    >>> same = compose(one, one, Alignment(np.eye(3), "given", 0.0))
    >>> bool(np.abs(same.positions - one.mesh.vertices).max() < 1e-9)
    True
    """
    directions = alignment(source_map.points)
    return Correspondence(source_map.mesh, target_map.mesh, target_map.locate(directions), source_map.valid)


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
