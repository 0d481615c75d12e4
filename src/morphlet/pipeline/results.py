"""A correspondence with everything it was made of, and what there is to say about it."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Int

from morphlet.features.matching import Matching
from morphlet.mapping import correspondence as quality
from morphlet.mapping.alignment import Alignment
from morphlet.mapping.correspondence import Correspondence, compose
from morphlet.mapping.overlay import Overlay, overlay
from morphlet.pipeline.candidates import Candidate, trust
from morphlet.sphere.map import SphericalMap
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints

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
        The rotation between them, and the wavelet network behind it.
    laid
        The source on the target's sphere.
    pairs
        The paired vertices that were used.
    matching
        The feature regions' matching that gave them; None if they were given, or none were found.
    warnings
        What a person should know before relying on the map, in sentences.
    candidates
        Matchings that were tried by coarse maps, the one that was taken first; empty if the first was not contested.
    """

    source_map: SphericalMap
    target_map: SphericalMap
    alignment: Alignment
    laid: SphericalMap
    pairs: VertexPairs
    matching: Matching | None = None
    warnings: tuple[str, ...] = ()
    candidates: tuple[Candidate, ...] = ()

    @cached_property
    def correspondence(self) -> Correspondence:
        """Where each vertex of the source lies on the target."""
        return compose(self.laid, self.target_map)

    @cached_property
    def inverse(self) -> Correspondence:
        """Where each vertex of the target lies on the source: the same map, read backwards."""
        return compose(self.target_map, self.laid)

    @cached_property
    def carried(self) -> Mesh:
        """The closed surface of the source with its vertices where they lie on the target."""
        places = self.target_map.locate(self.laid.closed_points)
        return self.source_map.surface.mesh.with_vertices(places.positions(self.target_map.mesh))

    def refinement(self) -> Overlay:
        """The common refinement of both closed surfaces: a connectivity that meets both exactly.

        Raises
        ------
        SolveError
            If the triangulations stay in special position under small turns.
        """
        source, target = self.source_map.surface.mesh, self.target_map.surface.mesh
        return overlay(source, self.laid.closed_points, target, self.target_map.closed_points)

    @property
    def ambiguous(self) -> bool:
        """Whether another correspondence is nearly as good, as far as the matching or the search can tell."""
        if self.alignment.ambiguous or self.matching is None:
            return self.alignment.ambiguous
        return trust(self.matching, self.candidates)[1]

    @property
    def margin(self) -> float | None:
        """How much better the matching is than the next: by the scores of the candidates if some were tried; of the search without one."""
        return self.alignment.margin if self.matching is None else trust(self.matching, self.candidates)[0]

    def figures(self) -> Figures:
        """What there is to say about the map.

        `folds_sphere`: triangles inverted on the sphere, by exact signs; `folds_surface_percent`, `energy` (mean over the area),
        `energy_mean` (mean over the triangles); `pairs`: how many were used, `pairs_rmse` in mesh units, None without pairs;
        `margin`, `ambiguous`: of the matching, or of a search. Faces count as they were mapped: without dropped parts, in the
        orientation that repair gave them.
        """
        found = _between_parts(self)
        return {
            "folds_sphere": self.laid.certificate().inverted,
            "folds_surface_percent": quality.folds_surface_percent(found),
            "energy": quality.energy(found),
            "energy_mean": quality.energy_mean(found),
            "pairs": len(self.pairs),
            "pairs_rmse": quality.pairs_rmse(self.correspondence, self.pairs) if len(self.pairs) else None,
            "margin": self.margin,
            "ambiguous": self.ambiguous,
        }


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
