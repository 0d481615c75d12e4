"""One topology, many positions: what morph, transfer, codec and report exchange."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh, Topology


@dataclass(frozen=True, eq=False)
class MeshSequence:
    """A mesh that moves.

    Parameters
    ----------
    topology
        The faces of every frame.
    positions
        Vertex positions per frame, in mesh units.
    times
        Strictly increasing time of each frame.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh, MeshSequence
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> sequence = MeshSequence(mesh.topology, np.stack([mesh.vertices, 2 * mesh.vertices]), [0.0, 1.0])
    >>> len(sequence), sequence[1].area
    (2, 2.0)
    """

    topology: Topology
    positions: Float[np.ndarray, "t n 3"]
    times: Float[np.ndarray, "t"]

    def __post_init__(self) -> None:
        positions = _arrays.real(self.positions, "positions", (None, self.topology.n_vertices, 3))
        times = _arrays.real(self.times, "times", (len(positions),))
        backwards = np.nonzero(np.diff(times) <= 0)[0] + 1
        if len(backwards):
            raise InputError("strictly increasing times", f"{len(backwards)} frames not after their predecessor", "sort them", backwards)
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "times", times)

    def __reduce__(self) -> tuple[Any, ...]:
        return MeshSequence, (self.topology, np.array(self.positions), np.array(self.times))

    def __len__(self) -> int:
        return len(self.times)

    def __getitem__(self, frame: int) -> Mesh:
        return Mesh(self.positions[frame], self.topology)
