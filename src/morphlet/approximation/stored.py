"""Approximations from a file, whichever kind it holds."""

import os
from collections.abc import Sequence

from morphlet import _store
from morphlet.approximation import surface
from morphlet.approximation.rows import RowApproximation
from morphlet.approximation.surface import SurfaceApproximation
from morphlet.wavenet.mothers import Mother


def load(path: str | os.PathLike[str], mothers: Sequence[Mother] = ()) -> RowApproximation | SurfaceApproximation:
    """Read what the `save` of either approximation wrote; own mothers have to be passed.

    Raises
    ------
    FileError
        If the file is no approximation, or has a mother that is not known.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh, spherical_map
    >>> from morphlet.approximation.rows import approximate_by_rows
    >>> from morphlet.approximation.stored import load
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> with TemporaryDirectory() as folder:
    ...     approximate_by_rows(spherical_map(Mesh(*icosphere(1))), 17).save(f"{folder}/ic.npz")
    ...     load(f"{folder}/ic.npz").mesh()
    Mesh(42 vertices, 80 faces)
    """
    if _store.kind_of(path) == surface.KIND:
        return SurfaceApproximation.load(path, mothers)
    return RowApproximation.load(path, mothers)
