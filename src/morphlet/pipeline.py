"""The paper on one page: two meshes in, a correspondence out, and the morph along it.

1. Map both meshes to the sphere, one to one (step 1; the maps may be made beforehand and passed in).
2. Turn the source's sphere onto the target's: by paired vertices (section 6.2, Eq. 7), or, without any, by a search.
3. Compose: up from the source, across, down to the target.
4. Move the source's vertices to their images (section 7.2).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Int

from morphlet import metrics
from morphlet.errors import InputError
from morphlet.features.signature import signature
from morphlet.mapping import correspondence as quality
from morphlet.mapping.alignment import Alignment, SphereSamples, align_by_pairs, align_by_search
from morphlet.mapping.correspondence import Correspondence, compose
from morphlet.motion.morph import Morph, edge_log_rms_max, volume_change_max
from morphlet.numerics.optimize import OnStep
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints
from morphlet.surface.sequence import MeshSequence

Figures = dict[str, float | int | bool | None]
"""Named numbers for a report; None where a figure does not apply."""


@dataclass(frozen=True, eq=False)
class CorrespondResult:
    """A correspondence and everything that it was made of.

    Parameters
    ----------
    source_map, target_map
        The spherical maps of both meshes.
    alignment
        The rotation between them.
    correspondence
        The map from mesh to mesh.
    pairs
        The paired vertices that were used; None if the rotation was searched for.
    """

    source_map: SphericalMap
    target_map: SphericalMap
    alignment: Alignment
    correspondence: Correspondence
    pairs: VertexPairs | None = None

    def figures(self) -> Figures:
        """What there is to say about the map.

        `folds_sphere`: triangles inverted on the sphere, by exact signs (a rotation changes none); `folds_surface_percent`,
        `energy` (mean over the area), `energy_mean` (mean over the triangles); `pairs`: how many were used, `pairs_rmse` in mesh
        units, None without pairs; `margin`, `ambiguous`: of a search. Faces count as they were mapped: without dropped parts,
        in the orientation that repair gave them.
        """
        found = _between_parts(self)
        return {
            "folds_sphere": self.source_map.certificate().inverted,
            "folds_surface_percent": quality.folds_surface_percent(found),
            "energy": quality.energy(found),
            "energy_mean": quality.energy_mean(found),
            "pairs": len(self.pairs) if self.pairs else 0,
            "pairs_rmse": quality.pairs_rmse(self.correspondence, self.pairs) if self.pairs else None,
            "margin": self.alignment.margin,
            "ambiguous": self.alignment.ambiguous,
        }


@dataclass(frozen=True, eq=False)
class MorphResult:
    """A morph, its frames, and the correspondence it follows."""

    matched: CorrespondResult
    morph: Morph
    frames: MeshSequence

    def figures(self) -> Figures:
        """The figures of the correspondence, and of the frames.

        `volume_change_max` (percent, signed) and `edge_log_rms_max` compare each frame with the straight line between the ends;
        `mse` (Eq. 9) and `deformation_rate` (percent of the bounding-box diagonal) compare the last frame with the first.
        """
        first, last = self.morph.source.vertices, self.morph.target_positions
        return self.matched.figures() | {
            "frames": len(self.frames),
            "volume_change_max": volume_change_max(self.frames),
            "edge_log_rms_max": edge_log_rms_max(self.frames),
            "self_intersections_max": None,
            "mse": metrics.mse(last, first),
            "deformation_rate": metrics.deformation_rate(last, first),
        }


def correspond(source: Mesh, target: Mesh, pairs: VertexPairs | None = None, on_step: OnStep | None = None) -> CorrespondResult:
    """Where each vertex of the source lies on the target.

    Parameters
    ----------
    source, target
        Meshes that `spherical_map` accepts.
    pairs
        Vertices that belong together, at least two in different directions; without any, the rotation is searched for.
    on_step
        Called with each step of the two spherical maps; may raise `Cancelled`.

    Returns
    -------
    result
        The maps, the alignment, the correspondence; `.figures()` measures them.

    Raises
    ------
    MeshError
        If a mesh has no spherical map.
    InputError
        If the pairs do not fit the meshes or do not determine a rotation.

    Notes
    -----
    A rotation brings pairs close, not together: how close, `pairs_rmse` says. Time goes into the two maps.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(2)
    >>> egg = Mesh(points * [1, 1.2, 1.6] * (1 + 0.3 * points[:, [0]] + 0.2 * points[:, [1]]), faces)
    >>> result = correspond(egg, egg)
    >>> result.figures()["folds_sphere"], bool(abs(result.correspondence.positions - egg.vertices).max() < 0.1)
    (0, True)
    """
    if pairs is not None:
        pairs.checked(source, target)
    return correspond_maps(spherical_map(source, on_step=on_step), spherical_map(target, on_step=on_step), pairs)


def correspond_maps(source_map: SphericalMap, target_map: SphericalMap, pairs: VertexPairs | None = None) -> CorrespondResult:
    """The same for meshes whose spherical maps are at hand (step 1 of the paper: they may be precomputed and stored).

    Parameters
    ----------
    source_map, target_map
        Spherical maps of both meshes.
    pairs
        Vertices that belong together; without any, the rotation is searched for.

    Raises
    ------
    InputError
        If the pairs do not fit the meshes or do not determine a rotation.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> one = spherical_map(Mesh(*icosphere(1)))
    >>> result = correspond_maps(one, one, VertexPairs([0, 1, 2], [0, 1, 2]))
    >>> result.figures()["pairs"], round(result.figures()["pairs_rmse"], 9)
    (3, 0.0)
    """
    alignment = _by_pairs(source_map, target_map, pairs) if pairs else align_by_search(_samples(source_map), _samples(target_map))
    return CorrespondResult(source_map, target_map, alignment, compose(source_map, target_map, alignment), pairs or None)


def morph(source: Mesh, target: Mesh, pairs: VertexPairs | None = None, frames: int = 24, on_step: OnStep | None = None) -> MorphResult:
    """A sequence of meshes from the source to the shape of the target.

    Parameters
    ----------
    source, target, pairs, on_step
        As for `correspond`.
    frames
        How many meshes, both ends included.

    Returns
    -------
    result
        The morph as a function of time, its frames, and the correspondence; `.figures()` measures them.

    Raises
    ------
    MeshError
        If a mesh has no spherical map.
    InputError
        If the pairs do not fit the meshes, or there are fewer than 2 frames.

    Notes
    -----
    All frames have the source's faces; the last one lies on the target's surface.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(1)
    >>> ball, egg = Mesh(points, faces), Mesh(points * [1, 1, 2], faces)
    >>> result = morph(ball, egg, VertexPairs([0, 1, 2], [0, 1, 2]), frames=5)
    >>> len(result.frames), bool((result.frames[0].vertices == ball.vertices).all())
    (5, True)
    """
    if frames < 2:
        raise InputError("at least 2 frames, the source and the target", str(frames), "ask for more frames")
    return morph_along(correspond(source, target, pairs, on_step), frames)


def morph_along(matched: CorrespondResult, frames: int = 24) -> MorphResult:
    """The morph along a correspondence that is at hand.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> one = spherical_map(Mesh(*icosphere(1)))
    >>> result = morph_along(correspond_maps(one, one, VertexPairs([0, 1, 2], [0, 1, 2])), frames=3)
    >>> round(result.figures()["mse"], 9)
    0.0
    """
    path = Morph(matched.correspondence.source, matched.correspondence.positions)
    return MorphResult(matched, path, path.frames(frames))


def _by_pairs(source_map: SphericalMap, target_map: SphericalMap, pairs: VertexPairs) -> Alignment:
    """Paired vertices, looked up on both spheres."""
    pairs.checked(source_map.mesh, target_map.mesh)
    return align_by_pairs(source_map.points[pairs.source], target_map.points[pairs.target], pairs.weight)


def _samples(spherical: SphericalMap) -> SphereSamples:
    """What each vertex sees around it, placed on the sphere."""
    return SphereSamples(spherical.points, signature(spherical.mesh), spherical.mesh.vertex_areas)


def _between_parts(matched: CorrespondResult) -> Correspondence:
    """The correspondence between the faces that were mapped, all turned outwards; vertices as given."""
    (own, own_turned), (other, other_turned) = _mapped_faces(matched.source_map), _mapped_faces(matched.target_map)
    source, target, points = matched.source_map.mesh, matched.target_map.mesh, matched.correspondence.points
    row = np.zeros(target.n_faces, np.int64)
    row[other] = np.arange(len(other))
    rows = row[points.faces]
    weights = np.where(other_turned[rows, None], points.weights[:, [0, 2, 1]], points.weights)
    return Correspondence(
        Mesh(source.vertices, _turned(source, own, own_turned)),
        Mesh(target.vertices, _turned(target, other, other_turned)),
        SurfacePoints(rows, weights),
        matched.correspondence.valid,
    )


def _mapped_faces(spherical: SphericalMap) -> tuple[Int[np.ndarray, "k"], Bool[np.ndarray, "k"]]:
    """Which faces as given were mapped, and which of them were turned over."""
    real = spherical.surface.face_map >= 0
    return spherical.surface.face_map[real], spherical.surface.flipped[real]


def _turned(mesh: Mesh, faces: Int[np.ndarray, "k"], turned: Bool[np.ndarray, "k"]) -> Topology:
    """Some faces of a mesh, turned over where it is asked."""
    return Topology(np.where(turned[:, None], mesh.faces[faces][:, [0, 2, 1]], mesh.faces[faces]), mesh.n_vertices)
