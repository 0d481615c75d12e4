"""From the source to the shape of the target, frame by frame, along a correspondence (section 7.2)."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays, metrics
from morphlet.errors import InputError
from morphlet.motion.bands import wavelet_bands
from morphlet.motion.delay import sweep
from morphlet.motion.morph import PATHS, Morph, MorphPath, edge_log_rms_max, self_intersections_max, volume_change_max
from morphlet.motion.schedule import Schedule
from morphlet.numerics.optimize import OnStep
from morphlet.pipeline.correspond import correspond
from morphlet.pipeline.results import CorrespondResult, Figures
from morphlet.sphere.map import SphericalMap
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.repair import close
from morphlet.surface.sequence import MeshSequence


@dataclass(frozen=True, eq=False)
class MorphResult:
    """A morph, its frames, and the correspondence it follows.

    Parameters
    ----------
    matched
        The correspondence.
    morph
        Mesh by time: of the source as given, but of its closed surface for a "gradient" path of a mesh that was mended, so that no
        seam opens on the way.
    frames
        The source as given, at equal steps of time.
    """

    matched: CorrespondResult
    morph: Morph
    frames: MeshSequence

    def figures(self) -> Figures:
        """The figures of the correspondence, and of the frames.

        `volume_change_max` (percent, signed) and `edge_log_rms_max` compare each frame with the straight line between the ends;
        `self_intersections_max` is the largest number of pairs of triangles that cross in a frame, both ends included; `mse` (Eq. 9)
        and `deformation_rate` (percent of the bounding-box diagonal) compare the last frame with the first.
        """
        first, last = self.frames.positions[0], self.frames.positions[-1]
        return self.matched.figures() | {
            "frames": len(self.frames),
            "volume_change_max": volume_change_max(self.frames),
            "edge_log_rms_max": edge_log_rms_max(self.frames),
            "self_intersections_max": self_intersections_max(self.frames),
            "mse": metrics.mse(last, first),
            "deformation_rate": metrics.deformation_rate(last, first),
        }


def morph(
    source: Mesh,
    target: Mesh,
    pairs: VertexPairs | None = None,
    frames: int = 24,
    on_step: OnStep | None = None,
    path: MorphPath = "gradient",
) -> MorphResult:
    """A sequence of meshes from the source to the shape of the target.

    Parameters
    ----------
    source, target, pairs, on_step
        As for `correspond`.
    frames
        How many meshes, both ends included.
    path
        How vertices travel: "gradient" turns and stretches the faces, "linear" moves on straight lines, "wavelet" moves the coarse shape
        first and details later.

    Returns
    -------
    result
        The morph as a function of time, its frames, and the correspondence; `.figures()` measures them.

    Raises
    ------
    MeshError
        If a mesh has no spherical map.
    InputError
        If the pairs do not fit the meshes, there are fewer than 2 frames, or there is no such path.

    Notes
    -----
    All frames have the source's faces; the last one lies on the target's surface. A schedule of one's own for the path "wavelet" goes
    through `morph_along`.

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
    _require_travel(frames, path, None)
    return morph_along(correspond(source, target, pairs, on_step), frames, path)


def morph_along(
    matched: CorrespondResult,
    frames: int = 24,
    path: MorphPath = "gradient",
    schedule: Schedule | None = None,
    starts: Int[np.ndarray, "s"] | None = None,
) -> MorphResult:
    """The morph along a correspondence that is at hand.

    Parameters
    ----------
    matched
        The correspondence.
    frames, path
        As for `morph`.
    schedule
        For the paths "wavelet" and "gradient": when each resolution moves, from coarse to fine, spread over as many as there are. On
        the path "gradient" details turn with the faces that carry them.
    starts
        Vertices of the source from which the morph sweeps over the surface, as with `sweep`; all set out at once if left out.

    Raises
    ------
    InputError
        If there are fewer than 2 frames, there is no such path or vertex, or the path takes no schedule.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs, correspond_maps
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> one = spherical_map(Mesh(*icosphere(1)))
    >>> result = morph_along(correspond_maps(one, one, VertexPairs([0, 1, 2], [0, 1, 2])), frames=3)
    >>> round(result.figures()["mse"], 3)
    0.0
    """
    _require_travel(frames, path, schedule)
    mapped, positions = _ends(matched, path)
    bands = wavelet_bands(mapped, positions) if path == "wavelet" or schedule is not None else None
    spread = schedule.over(len(bands)) if schedule is not None and bands is not None else None
    travel = Morph(mapped.mesh, positions, path, bands, spread, None if starts is None else _delay(matched, mapped, starts))
    return MorphResult(matched, travel, _as_in_source(matched, travel.frames(frames)))


def _require_travel(frames: int, path: MorphPath, schedule: Schedule | None) -> None:
    """Refuse what no morph can do, before the work."""
    if frames < 2:
        raise InputError("at least 2 frames, the source and the target", str(frames), "ask for more frames")
    if path not in PATHS:
        raise InputError(f"a path out of {', '.join(PATHS)}", f"'{path}'", "choose one of these")
    if schedule is not None and path == "linear":
        raise InputError('the path "wavelet" or "gradient" for a schedule', "'linear'", "leave the schedule out, or choose such a path")


def _ends(matched: CorrespondResult, path: MorphPath) -> tuple[SphericalMap, Float[np.ndarray, "n 3"]]:
    """The source and where its vertices go; closed where faces turn and stretch, or seams would open on the way."""
    found = matched.source_map
    if path != "gradient" or not found.surface.repairs:
        return found, matched.correspondence.positions
    return SphericalMap(close(found.surface.mesh), found.closed_points, found.trace), matched.carried.vertices


def _delay(matched: CorrespondResult, mapped: SphericalMap, starts: Int[np.ndarray, "s"]) -> Float[np.ndarray, "n"]:
    """How much later each vertex sets out; twins on a seam together."""
    surface = matched.source_map.surface
    chosen = _arrays.index(starts, "starts", (None,), surface.source.n_vertices)
    delay = sweep(surface.mesh, surface.vertex_map[chosen])
    return delay if mapped is not matched.source_map else delay[surface.vertex_map]


def _as_in_source(matched: CorrespondResult, frames: MeshSequence) -> MeshSequence:
    """Frames with the vertices of the source as given; those without an answer travel with the nearest one, towards it."""
    surface, source = matched.source_map.surface, matched.source_map.mesh
    if frames.topology is source.topology:
        return frames
    apart = source.vertices - surface.mesh.vertices[surface.vertex_map]
    positions = frames.positions[:, surface.vertex_map] + (1 - frames.times)[:, None, None] * apart
    positions[0], positions[-1] = source.vertices, matched.correspondence.positions
    return MeshSequence(source.topology, positions, frames.times)
