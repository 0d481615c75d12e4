"""Morph: the path of a mesh from its own shape to the shape of another.

Time runs from 0 (the source) to 1 (the target positions); both ends are met exactly, to the last bit.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.metrics import edge_lengths, signed_percent
from morphlet.motion.bands import Bands
from morphlet.motion.schedule import Schedule
from morphlet.motion.trajectory import Trajectory
from morphlet.surface.intersections import self_intersections
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

MorphPath = Literal["linear", "gradient", "wavelet"]
"""How vertices travel: "linear" moves each on a straight line at constant speed (paper, section 7.2); "gradient" turns and
stretches the faces and puts the vertices where these fit together best (see `trajectory`); "wavelet" moves each resolution at
its own time (paper, section 7.2: "starting time and speed at various resolutions")."""
PATHS: tuple[MorphPath, ...] = ("linear", "gradient", "wavelet")
SUM_TOLERANCE = 1e-9
"""How far bands may be from the positions that they add up to, relative to the largest coordinate."""
"""The paths there are."""


@dataclass(frozen=True, eq=False)
class Morph:
    """A mesh whose vertices travel from the source's positions to the target positions.

    Parameters
    ----------
    source
        The mesh at time 0; its faces stay.
    target_positions
        Where its vertices are at time 1.
    path
        How they get there.
    bands
        For the path "wavelet": source and target by resolution, as `wavelet_bands` makes them.
    schedule
        For the path "wavelet": when each band moves; coarse ones first if left out.

    Raises
    ------
    InputError
        If there is not one finite target position per vertex, no such path, or bands and schedule do not go with the path or
        with each other.

    Notes
    -----
    The first frame of a "gradient" path factors a sparse system, which the morph keeps: 0.2 CPU s for 8k vertices, later frames
    12 ms. Frames of the way back, from the target to the source, are close to these but not the same.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> morph = Morph(triangle, triangle.vertices * 3)
    >>> morph(0.5).area, len(morph.frames(24))
    (2.0, 24)
    """

    source: Mesh
    target_positions: Float[np.ndarray, "n 3"]
    path: MorphPath = "linear"
    bands: Bands | None = None
    schedule: Schedule | None = None

    def __post_init__(self) -> None:
        target = _arrays.real(self.target_positions, "target_positions", (self.source.n_vertices, 3))
        if self.path not in PATHS:
            raise InputError(f"a path out of {', '.join(PATHS)}", f"'{self.path}'", "choose one of these")
        object.__setattr__(self, "target_positions", target)
        if self.path == "wavelet":
            object.__setattr__(self, "schedule", _fitting(self.source, target, self.bands, self.schedule))
        elif self.bands is not None or self.schedule is not None:
            raise InputError('the path "wavelet" for bands and a schedule', f"'{self.path}'", "leave them out, or choose this path")

    def __reduce__(self) -> tuple[Any, ...]:
        return Morph, (self.source, np.array(self.target_positions), self.path, self.bands, self.schedule)

    def __call__(self, t: float) -> Mesh:
        """The mesh at time t.

        Raises
        ------
        InputError
            If t is not in [0, 1].
        """
        return self.source.with_vertices(self._positions(t))

    def frames(self, count: int) -> MeshSequence:
        """`count` meshes at equal steps of time, both ends included.

        Raises
        ------
        InputError
            If `count` is below 2.
        """
        if count < 2:
            raise InputError("at least 2 frames, the source and the target", str(count), "ask for more frames")
        times = np.linspace(0.0, 1.0, count)
        return MeshSequence(self.source.topology, np.stack([self._positions(t) for t in times]), times)

    @cached_property
    def _trajectory(self) -> Trajectory:
        """The prepared "gradient" path."""
        return Trajectory.prepare(self.source, self.target_positions)

    def _positions(self, t: float) -> Float[np.ndarray, "n 3"]:
        """Positions at time t; the ends themselves, not a sum that rounds."""
        if not 0 <= t <= 1:
            raise InputError("a time from 0 to 1", str(t), "scale your times")
        ends = {0.0: self.source.vertices, 1.0: self.target_positions}
        if t in ends:
            return ends[t]
        if self.bands is not None and self.schedule is not None:
            return self.bands.blend(self.schedule(t))
        return self._trajectory(t) if self.path == "gradient" else (1 - t) * self.source.vertices + t * self.target_positions


def _fitting(source: Mesh, target: Float[np.ndarray, "n 3"], bands: Bands | None, schedule: Schedule | None) -> Schedule:
    """The schedule, if the bands are those of the two ends and there is one entry for each."""
    if bands is None:
        raise InputError('bands for the path "wavelet"', "none", "make them with wavelet_bands")
    for name, parts, whole in (("source", bands.source, source.vertices), ("target", bands.target, target)):
        if parts.shape[1:] != whole.shape:
            raise InputError(f"bands of {len(whole)} vertices", f"bands of {parts.shape[1]}", "make them for this mesh")
        gap = float(np.abs(parts.sum(axis=0) - whole).max(initial=0.0))
        if gap > SUM_TOLERANCE * float(np.abs(whole).max(initial=0.0)):
            raise InputError(f"bands that add up to the {name} positions", f"a gap of {gap:.3g}", "make them for these positions")
    chosen = Schedule.coarse_first(len(bands)) if schedule is None else schedule
    if len(chosen) != len(bands):
        raise InputError(f"a schedule for {len(bands)} bands", f"one for {len(chosen)}", f"pass schedule.over({len(bands)})")
    return chosen


def volume_change_max(sequence: MeshSequence) -> float:
    """The largest deviation of a frame's volume from the straight line between the volumes of the ends, in percent, signed.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> import numpy as np
    >>> tetrahedron = Mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> round(volume_change_max(Morph(tetrahedron, 3 * tetrahedron.vertices).frames(3)), 6)  # 8 against (1 + 27) / 2
    -42.857143
    """
    volumes = np.array([sequence[k].volume for k in range(len(sequence))])
    changes = [signed_percent(v, r) for v, r in zip(volumes, _between(volumes, sequence.times), strict=True)]
    return max(changes, key=abs)


def edge_log_rms_max(sequence: MeshSequence) -> float:
    """The worst frame's rms log ratio of edge lengths to the straight line between their lengths at the ends; 0 is best.

    Edges without length at an end or in the frame have no ratio and are left out.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> round(edge_log_rms_max(Morph(triangle, triangle.vertices * 3).frames(5)), 12)
    0.0
    """
    lengths = np.stack([edge_lengths(sequence[k]) for k in range(len(sequence))])
    reference = _between(lengths, sequence.times)
    measurable = np.all(lengths > 0, axis=0)
    if not measurable.any():
        return 0.0
    logs = np.log(lengths[:, measurable] / reference[:, measurable])
    return float(np.sqrt(np.mean(logs**2, axis=1)).max())


def self_intersections_max(sequence: MeshSequence) -> int:
    """The largest number of pairs of triangles that cross in a frame and share no vertex.

    Notes
    -----
    0.05 CPU s per frame of 16k triangles.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> upright = [[0.2, 0.2, -1], [0.2, 0.2, 1], [0.2, 2, 0]]
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], *upright], [[0, 1, 2], [3, 4, 5]])
    >>> self_intersections_max(Morph(mesh, 2 * mesh.vertices).frames(3))
    1
    """
    return max(len(self_intersections(sequence[k])) for k in range(len(sequence)))


def _between(values: Float[np.ndarray, "t *d"], times: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t *d"]:
    """The straight line from the first row to the last, at the given times."""
    share = ((times - times[0]) / (times[-1] - times[0])).reshape(-1, *([1] * (values.ndim - 1)))
    return (1 - share) * values[0] + share * values[-1]
