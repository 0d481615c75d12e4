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
from morphlet.motion.banded import BandedMixture
from morphlet.motion.bands import Bands
from morphlet.motion.delay import local_times
from morphlet.motion.measures import edge_log_ratios, volume_changes
from morphlet.motion.mixture import Mixture
from morphlet.motion.schedule import Schedule
from morphlet.surface.intersections import self_intersections
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

MorphPath = Literal["linear", "gradient", "wavelet"]
"""How vertices travel: "linear" moves each on a straight line at constant speed (paper, section 7.2); "gradient" turns and
stretches the faces and puts the vertices where these fit together best (see `mixture`); "wavelet" moves each resolution at
its own time (paper, section 7.2: "starting time and speed at various resolutions")."""
PATHS: tuple[MorphPath, ...] = ("linear", "gradient", "wavelet")
"""The paths there are."""
SUM_TOLERANCE = 1e-9
"""How far bands may be from the positions that they add up to, relative to the largest coordinate."""


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
        For the path "wavelet": source and target by resolution, as `wavelet_bands` makes them. For the path "gradient" too, if
        resolutions are to have times of their own: then finer parts turn with the faces instead of keeping their directions.
    schedule
        When each band moves; coarse ones first if left out.
    delay
        How much later than the first each vertex sets out, as a share of the whole time: from 0, less than 1, as `sweep` makes it.
        All at once if left out.

    Raises
    ------
    InputError
        If there is not one finite target position per vertex, no such path, bands and schedule do not go with the path or
        with each other, or a delay is out of range.

    Notes
    -----
    The first frame of a "gradient" path factors a sparse system, which the morph keeps: 0.3 CPU s for 8k vertices, later frames
    15 ms. Frames of the way back, from the target to the source, are close to these but not the same. Frames of the others are
    those of the way there, if bands and delays are mirrored.

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
    delay: Float[np.ndarray, "n"] | None = None

    def __post_init__(self) -> None:
        target = _arrays.real(self.target_positions, "target_positions", (self.source.n_vertices, 3))
        if self.path not in PATHS:
            raise InputError(f"a path out of {', '.join(PATHS)}", f"'{self.path}'", "choose one of these")
        object.__setattr__(self, "target_positions", target)
        if self.path == "linear" and (self.bands is not None or self.schedule is not None):
            raise InputError(
                'the path "wavelet" or "gradient" for bands and a schedule', "'linear'", "leave them out, or choose such a path"
            )
        if self.path == "wavelet" or self.bands is not None or self.schedule is not None:
            object.__setattr__(self, "schedule", _fitting(self.source, target, self.bands, self.schedule))
        if self.delay is not None:
            object.__setattr__(self, "delay", _delays(self.delay, self.source.n_vertices))

    def __reduce__(self) -> tuple[Any, ...]:
        delay = None if self.delay is None else np.array(self.delay)
        return Morph, (self.source, np.array(self.target_positions), self.path, self.bands, self.schedule, delay)

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
    def _mixture(self) -> Mixture:
        """The prepared "gradient" path."""
        return Mixture.prepare(self.source, np.stack([self.source.vertices, self.target_positions]))

    @cached_property
    def _banded_path(self) -> BandedMixture | None:
        """The prepared "gradient" path of bands."""
        return None if self.bands is None or self.path == "wavelet" else BandedMixture.prepare(self._mixture, self.bands)

    def _positions(self, t: float) -> Float[np.ndarray, "n 3"]:
        """Positions at time t; the ends themselves, not a sum that rounds."""
        if not 0 <= t <= 1:
            raise InputError("a time from 0 to 1", str(t), "scale your times")
        ends = {0.0: self.source.vertices, 1.0: self.target_positions}
        return ends[t] if t in ends else self._between(np.array([t]) if self.delay is None else local_times(t, self.delay))

    def _between(self, times: Float[np.ndarray, "q"]) -> Float[np.ndarray, "n 3"]:
        """Positions at a time of all vertices, or of each."""
        if self.path == "linear":
            return (1 - times)[:, None] * self.source.vertices + times[:, None] * self.target_positions
        if self.bands is None or self.schedule is None:
            return self._mixture(np.stack([1 - times, times]))
        shares = self.schedule(times)
        return self.bands.blend(shares) if self._banded_path is None else self._banded_path(shares)


def _fitting(source: Mesh, target: Float[np.ndarray, "n 3"], bands: Bands | None, schedule: Schedule | None) -> Schedule:
    """The schedule, if the bands are those of the two ends and there is one entry for each."""
    if bands is None:
        raise InputError('bands, for the path "wavelet" and for a schedule', "none", "make them with wavelet_bands")
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


def _delays(delay: Float[np.ndarray, "n"], n: int) -> Float[np.ndarray, "n"]:
    """The checked delays."""
    checked = _arrays.real(delay, "delay", (n,))
    wrong = np.flatnonzero((checked < 0) | (checked >= 1))
    if len(wrong):
        found = f"{len(wrong)} that are not, such as {checked[wrong[0]]:g}"
        raise InputError("delays of at least 0 and less than 1", found, "scale them, or make them with sweep", wrong)
    return checked


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
    return float(max(volume_changes(sequence), key=abs))


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
    logs = edge_log_ratios(sequence)
    return float(np.sqrt(np.mean(logs**2, axis=1)).max()) if logs.size else 0.0


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
