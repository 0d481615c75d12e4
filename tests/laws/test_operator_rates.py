"""Rates, not values: the Laplacian of a finer sphere has a spectrum closer to l (l + 1)."""

import numpy as np
import scipy.linalg

from morphlet import Mesh
from morphlet.numerics.unit_sphere import icosphere
from morphlet.surface.operators import laplacian, mass

DEGREES = np.repeat(np.arange(4), 2 * np.arange(4) + 1)
"""Degree l of each of the first 16 spherical harmonics."""


def worst_error(subdivisions):
    mesh = Mesh(*icosphere(subdivisions))
    pencil = laplacian(mesh).toarray(), mass(mesh).toarray()
    values = scipy.linalg.eigh(*pencil, eigvals_only=True, subset_by_index=[0, len(DEGREES) - 1])
    return np.abs(values - DEGREES * (DEGREES + 1)).max()


def test_spectrum_of_the_sphere_converges_with_the_square_of_the_edge_length():
    errors = np.array([worst_error(s) for s in (1, 2, 3)])
    rates = np.log2(errors[:-1] / errors[1:])
    assert np.all(rates > 1.7)  # halving the edges: 2 in the limit
    assert np.all(rates < 2.3)
