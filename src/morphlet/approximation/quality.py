"""How near an approximated mesh is to the one of a spherical map."""

from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet import metrics
from morphlet.sphere.map import SphericalMap
from morphlet.wavenet.mothers import PAPER_SIX

Figures = dict[str, Any]
"""Named numbers, and counts by name."""


def closeness(map: SphericalMap, vertices: Float[np.ndarray, "n 3"]) -> Figures:
    """How far vertices are from those of the mesh, over the vertices that have a place of their own.

    Returns
    -------
    Figures
        `mse` (Eq. 9) in squared mesh units, `mse_relative` over the squared diagonal of the bounding box, `psnr` in dB,
        `deformation_rate` in percent of the diagonal.

    Examples
    --------
    >>> from morphlet import Mesh, spherical_map
    >>> from morphlet.approximation.quality import closeness
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = spherical_map(Mesh(*icosphere(1)))
    >>> round(closeness(ball, ball.mesh.vertices * 1.01)["mse"], 8)
    0.0001
    """
    truth, back = map.mesh.vertices[map.valid], vertices[map.valid]
    size, square = diagonal(map), metrics.mse(back, truth)
    return {
        "mse": square,
        "mse_relative": relative(square, size),
        "psnr": metrics.psnr(float(np.sqrt(square)), size),
        "deformation_rate": metrics.deformation_rate(back, truth),
    }


def with_zeros(counts: dict[str, int]) -> dict[str, int]:
    """Counts by mother: the paper's six, whether there are any or not, and whatever else there is."""
    return dict.fromkeys((psi.name for psi in PAPER_SIX), 0) | counts


def diagonal(map: SphericalMap) -> float:
    """Diagonal of the bounding box of the vertices that have a place of their own: what relative errors are relative to."""
    return float(np.linalg.norm(np.ptp(map.mesh.vertices[map.valid], axis=0)))


def relative(square: float, size: float) -> float:
    """A mean square over a squared length; NaN if that is zero."""
    return square / size**2 if size > 0 else float("nan")
