"""Blend: a mesh between any number of its shapes, by weights."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.motion.mixture import Mixture
from morphlet.surface.mesh import Mesh

SUM_TOLERANCE = 1e-9
"""How far the sum of weights may be from one."""


@dataclass(frozen=True, eq=False)
class Blend:
    """Shapes of one mesh, to be mixed by weights: faces turn and stretch by their means, as on the "gradient" path of a `Morph`.

    Parameters
    ----------
    reference
        What turns and stretches are measured against; it need not be one of the shapes. What lies near all of them serves best.
    shapes
        Positions of its vertices in each shape.

    Raises
    ------
    InputError
        If there is no shape, or it has not one finite position per vertex.

    Notes
    -----
    The first mixture factors a sparse system and takes the shapes apart, which the blend keeps: 0.3 CPU s for 8k vertices and two
    shapes, 0.1 s more for each further one; later mixtures 16 ms.

    Examples
    --------
    >>> from morphlet import Blend, Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(2)
    >>> ball = Mesh(points, faces)
    >>> blend = Blend(ball, [points * [2, 1, 1], points * [1, 2, 1], points * [1, 1, 2]])
    >>> np.ptp(blend([0.5, 0.5, 0]).vertices, axis=0).round(1).tolist()
    [3.0, 3.0, 1.9]
    """

    reference: Mesh
    shapes: Float[np.ndarray, "k n 3"]

    def __post_init__(self) -> None:
        shapes = _arrays.real(self.shapes, "shapes", (None, self.reference.n_vertices, 3))
        if not len(shapes):
            raise InputError("at least one shape", "none", "pass the positions of the vertices in each shape")
        object.__setattr__(self, "shapes", shapes)

    def __reduce__(self) -> tuple[Any, ...]:
        return Blend, (self.reference, np.array(self.shapes))

    def __len__(self) -> int:
        return len(self.shapes)

    def __call__(self, weights: Float[np.ndarray, "k"]) -> Mesh:
        """The mesh with these weights; a shape itself, to the last bit, where it has all the weight.

        Raises
        ------
        InputError
            If there is not one weight per shape, one is negative, or they do not add up to one.
        """
        checked = _arrays.real(weights, "weights", (len(self),))
        wrong, total = np.flatnonzero(checked < 0), float(checked.sum())
        if len(wrong) or abs(total - 1) > SUM_TOLERANCE:
            found = f"{len(wrong)} negative ones, and a sum of {total:g}"
            raise InputError("weights of at least 0 that add up to 1", found, "set negative ones to 0 and divide by the sum", wrong)
        alone = np.flatnonzero(checked == total)
        return self.reference.with_vertices(self.shapes[alone[0]] if len(alone) else self._mixture((checked / total)[:, None]))

    @cached_property
    def _mixture(self) -> Mixture:
        """The prepared shapes."""
        return Mixture.prepare(self.reference, self.shapes)
