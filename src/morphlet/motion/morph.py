"""Morph: the path of a mesh from its own shape to the shape of another.

Time runs from 0 (the source) to 1 (the target positions); both ends are met exactly, to the last bit.
"""

from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.metrics import edge_lengths, signed_percent
from morphlet.surface.mesh import Mesh
from morphlet.surface.sequence import MeshSequence

MorphPath = Literal["linear"]
"""How vertices travel: "linear" moves each on a straight line at constant speed (paper, section 7.2)."""
PATHS: tuple[MorphPath, ...] = ("linear",)
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

    def __post_init__(self) -> None:
        target = _arrays.real(self.target_positions, "target_positions", (self.source.n_vertices, 3))
        if self.path not in PATHS:
            raise InputError(f"a path out of {', '.join(PATHS)}", f"'{self.path}'", "choose one of these")
        object.__setattr__(self, "target_positions", target)

    def __reduce__(self) -> tuple[Any, ...]:
        return Morph, (self.source, np.array(self.target_positions), self.path)

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

    def _positions(self, t: float) -> Float[np.ndarray, "n 3"]:
        """Positions at time t; the ends themselves, not a sum that rounds."""
        if not 0 <= t <= 1:
            raise InputError("a time from 0 to 1", str(t), "scale your times")
        ends = {0.0: self.source.vertices, 1.0: self.target_positions}
        return ends[t] if t in ends else (1 - t) * self.source.vertices + t * self.target_positions


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


def _between(values: Float[np.ndarray, "t *d"], times: Float[np.ndarray, "t"]) -> Float[np.ndarray, "t *d"]:
    """The straight line from the first row to the last, at the given times."""
    share = ((times - times[0]) / (times[-1] - times[0])).reshape(-1, *([1] * (values.ndim - 1)))
    return (1 - share) * values[0] + share * values[-1]
