"""Delays: how much later than the first each vertex sets out, so that a morph sweeps over the surface."""

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.distance import distances
from morphlet.surface.mesh import Mesh

SWEEP = 0.5
"""Of the time, until the last vertex sets out: the front and what is moving behind it are seen equally long."""


def sweep(mesh: Mesh, starts: Int[np.ndarray, "s"], last: float = SWEEP) -> Float[np.ndarray, "n"]:
    """Delays in proportion to the distance along the surface from some vertices.

    Parameters
    ----------
    mesh
        The source of the morph.
    starts
        Vertices that set out at once.
    last
        Delay of the farthest vertex, as a share of the whole time; vertices that no face leads to have it too.

    Returns
    -------
    delays
        From 0 to `last`: for `Morph(..., delay=...)`.

    Raises
    ------
    InputError
        If no start is given, or one that the mesh does not have, or `last` is not in [0, 1).

    Notes
    -----
    O(n log n) per start.

    Examples
    --------
    >>> from morphlet import Mesh, sweep
    >>> strip = Mesh([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0], [2, 1, 0]], [[0, 2, 1], [1, 2, 3], [2, 4, 3], [3, 4, 5]])
    >>> sweep(strip, [0, 1], last=0.5)
    array([0.  , 0.  , 0.25, 0.25, 0.5 , 0.5 ])
    """
    if not 0 <= last < 1:
        raise InputError("a last delay of at least 0 and less than 1", str(last), "leave some of the time for the last vertex to move")
    chosen = _arrays.index(starts, "starts", (None,), mesh.n_vertices)
    if not len(chosen):
        raise InputError("at least one vertex to start from", "none", "name one")
    away = distances(mesh, chosen).min(axis=0)
    reached = np.isfinite(away)
    farthest = away[reached].max()
    return last * np.where(reached, away / farthest if farthest > 0 else 0.0, 1.0)


def local_times(t: float, delay: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """The time at each vertex when it is t for the first: those with the longest delay are through at 1, the others wait for them.

    Examples
    --------
    >>> local_times(0.5, np.array([0.0, 0.25, 0.5]))
    array([1. , 0.5, 0. ])
    """
    return np.clip((t - delay) / (1 - delay.max(initial=0.0)), 0.0, 1.0)
