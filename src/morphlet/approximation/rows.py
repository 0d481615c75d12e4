"""A spherical geometry image as wavelet networks, one per block of rows: steps 5 to 9 of the paper.

A block is a few neighbouring rows of the image, one unless told otherwise. Its pixels, from left to right, are the samples of
a signal s(t) on [0, 1], whose outputs are x, y and z of each of its rows. The networks of all blocks are the matrix IC. With
the directions and the faces of a mesh beside it, the mesh comes back from the matrix alone: each of its vertices is looked up
in the image that the networks draw.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet import _arrays, _store, metrics
from morphlet.approximation.quality import Figures, closeness, diagonal, relative, with_zeros
from morphlet.errors import InputError
from morphlet.sphere.image import Layout, SphericalImage, directions, spherical_image
from morphlet.sphere.map import SphericalMap
from morphlet.surface.mesh import Mesh, Topology
from morphlet.wavenet.blocks import ARRAYS, NetworkTable
from morphlet.wavenet.fit import FitOptions, Refinement, fit_rows
from morphlet.wavenet.library import different, dyadic_library
from morphlet.wavenet.mothers import PAPER_SIX, Mother
from morphlet.wavenet.network import found, refused_as_file
from morphlet.wavenet.pursuit import Method

Coordinates = Literal["joint", "separate"]
KIND, VERSION = "mesh in rows", 1
OWN = ("layout", "block_rows", "mask", "points", "faces", "residual")
"""Arrays of a file beside those of the networks."""
SIZE = 129
"""Rows of an image unless told otherwise: with 15 wavelets per row, twice as many bring horse, cat and bunny 2 to 4 % closer."""
ENOUGH = 128
"""Most wavelets of a network that has to meet an error, unless told otherwise: horse, cat and bunny need 56 to 70 for 0.02 %."""
AXES = 3
"""Coordinates of a position."""


@dataclass(frozen=True, eq=False)
class RowOptions:
    """How each block is approximated.

    Parameters
    ----------
    n_wavelets
        Most wavelets of a network; 15 in the paper.
    error
        Distance in mesh units, root mean square over the pixels of a block, at which fewer are enough (step 9).
    method
        Rule of choice, see `fit`.
    mothers
        Mothers of the library.
    coordinates
        "joint": the coordinates of a block share their wavelets; "separate": each has a network of its own.
    block_rows
        Rows per block.
    refinement
        Whether wavelets move until they follow the block best, see `fit`.

    Raises
    ------
    InputError
        If an option is out of range.

    Notes
    -----
    A joint wavelet takes 5 numbers (t, d, and three weights), three separate ones take 9. With equally many numbers the joint
    ones are better: horse, cat and bunny in 129 rows of 15 joint wavelets are 0.45, 0.37 and 0.32 % of the diagonal off (rms),
    with 9 separate ones per coordinate and 7 % more numbers 0.47, 0.43 and 0.35 %.

    Neighbouring rows are much alike: blocks of 4 rows and 22 wavelets, with 5 % more numbers, are 0.37, 0.27 and 0.24 % off.

    Examples
    --------
    >>> from morphlet.approximation.rows import RowOptions
    >>> RowOptions(n_wavelets=20, block_rows=2).coordinates
    'joint'
    """

    n_wavelets: int = 15
    error: float = 0.0
    method: Method = "ols"
    mothers: tuple[Mother, ...] = PAPER_SIX
    coordinates: Coordinates = "joint"
    block_rows: int = 1
    refinement: Refinement = "none"

    def __post_init__(self) -> None:
        if self.coordinates not in get_args(Coordinates):
            raise InputError(f"coordinates to be one of {', '.join(get_args(Coordinates))}", repr(self.coordinates), "choose one of these")
        if self.block_rows < 1:
            raise InputError("1 or more rows per block", str(self.block_rows), "start from 1")
        if not 0 <= self.error < np.inf:
            raise InputError("a finite error of 0 or more", str(self.error), "give a distance in mesh units")
        if not self.mothers:
            raise InputError("at least one mother", "none", "take those of PAPER_SIX")
        object.__setattr__(self, "mothers", different(self.mothers))
        self.fit(1)

    def fit(self, outputs: int) -> FitOptions:
        """The same for a fit of so many outputs, which counts their squared errors together."""
        return FitOptions(self.n_wavelets, self.error**2 * outputs / AXES, self.method, refinement=self.refinement)


ROWS = RowOptions()
"""The paper's: one row per block, 15 wavelets."""


@dataclass(frozen=True, eq=False)
class ImageApproximation:
    """The networks of all blocks of a spherical geometry image.

    Parameters
    ----------
    layout
        Of the image.
    table
        The matrix IC: a network per block, or three in a row (x, y, z) with separate coordinates.
    mask
        Of the image; it says how large the image is.
    block_rows
        Rows per block. The last block ends with the last row, even if it has to begin within the block before it; the rows
        that both hold are then its own.

    Raises
    ------
    InputError
        If the networks do not fit the image.
    """

    layout: Layout
    table: NetworkTable
    mask: Bool[np.ndarray, "h w"]
    block_rows: int = 1

    def __post_init__(self) -> None:
        mask = _arrays.freeze(np.array(self.mask, bool))
        shape = directions(self.layout, len(mask)).shape[:2]
        if mask.shape != shape:
            raise InputError(f"a mask of shape {shape}", f"shape {mask.shape}", "pass one value per pixel of the image")
        object.__setattr__(self, "mask", mask)
        rows, outputs = rows_of_blocks(self.size, self.block_rows), self.table.affine.shape[2]
        allowed = [(len(rows) * parts, AXES // parts * self.block_rows) for parts in (1, AXES)]
        if (len(self.table), outputs) not in allowed:
            needed = " or ".join(f"{networks} networks of {k} outputs" for networks, k in allowed)
            raise InputError(needed, repr(self.table), "pass the table that was fitted to this image")

    def __reduce__(self) -> tuple[Any, ...]:
        return ImageApproximation, (self.layout, self.table, np.array(self.mask), self.block_rows)

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.mask)

    def positions(self) -> Float[np.ndarray, "h w 3"]:
        """What the networks say at each pixel, block by block: pixels of the same direction may differ."""
        height, width = self.mask.shape
        rows = rows_of_blocks(height, self.block_rows)
        values = self.table(np.linspace(0, 1, width))
        parts = len(self.table) // len(rows)
        values = values.reshape(len(rows), parts, width, self.block_rows, AXES // parts)
        positions = np.empty((height, width, AXES))
        for block, row in zip(values.transpose(0, 3, 2, 1, 4), rows, strict=True):
            positions[row] = block.reshape(self.block_rows, width, AXES)
        return positions

    def image(self) -> SphericalImage:
        """The image that the networks draw; pixels of the same direction hold the mean of what their blocks say.

        Notes
        -----
        O(pixels x wavelets of a block).

        Examples
        --------
        >>> from morphlet.approximation.rows import approximate_rows
        >>> from morphlet.sphere.image import SphericalImage, directions
        >>> ball = SphericalImage("latlong", directions("latlong", 17), np.ones((17, 34), bool))
        >>> back = approximate_rows(ball).image()
        >>> bool(np.abs(back.positions - ball.positions).max() < 0.05), len(np.unique(back.positions[0], axis=0))
        (True, 1)
        """
        pixels = directions(self.layout, self.size).reshape(-1, AXES)
        number = np.unique(pixels, axis=0, return_inverse=True)[1].ravel()
        said = self.positions().reshape(-1, AXES).T
        means = np.stack([np.bincount(number, weights=axis) for axis in said], axis=1) / np.bincount(number)[:, None]
        return SphericalImage(self.layout, means[number].reshape(*self.mask.shape, AXES), self.mask)

    def block_errors(self, image: SphericalImage) -> Float[np.ndarray, "b"]:
        """How far each network is from an image: distance in mesh units, root mean square over the pixels of its block.

        A network of one coordinate counts as if the others were as far off as its own.

        Raises
        ------
        InputError
            If the image has another layout or size.
        """
        if (image.layout, image.size) != (self.layout, self.size):
            raise InputError(f"a {self.layout} image of size {self.size}", f"a {image.layout} one of {image.size}", "sample the map alike")
        rows = rows_of_blocks(self.size, self.block_rows)
        signals = _signals(image.positions[rows], len(self.table) // len(rows))
        missed = self.table(np.linspace(0, 1, signals.shape[1])) - signals
        return np.sqrt(AXES * np.mean(missed**2, axis=(1, 2)))


@dataclass(frozen=True, eq=False)
class RowApproximation:
    """A mesh in rows: the networks of its geometry image, the directions of its vertices, its faces.

    Parameters
    ----------
    image
        The networks.
    points
        The direction of each vertex, kept in single precision: 6e-8 of the radius.
    topology
        The faces of the mesh.
    residual
        What to add to the place of each vertex in the image; nothing if left out.

    Raises
    ------
    InputError
        If the counts differ, or a direction is zero.
    """

    image: ImageApproximation
    points: Float[np.ndarray, "n 3"]
    topology: Topology
    residual: Float[np.ndarray, "n 3"] | None = None

    def __post_init__(self) -> None:
        n = self.topology.n_vertices
        points = _arrays.real(_arrays.real(self.points, "points", (n, AXES)).astype(np.float32), "points", (n, AXES))
        _arrays.unit(points, "points")
        object.__setattr__(self, "points", points)
        if self.residual is not None:
            object.__setattr__(self, "residual", _arrays.real(self.residual, "residual", (n, AXES)))

    def __reduce__(self) -> tuple[Any, ...]:
        residual = None if self.residual is None else np.array(self.residual)
        return RowApproximation, (self.image, np.array(self.points), self.topology, residual)

    @property
    def table(self) -> NetworkTable:
        """The matrix IC."""
        return self.image.table

    @property
    def blocks(self) -> int:
        """Number of networks."""
        return len(self.table)

    def mesh(self) -> Mesh:
        """The mesh with each vertex where the image has it, and its residual added."""
        placed = self.image.image().sample(self.points)
        return Mesh(placed if self.residual is None else placed + self.residual, self.topology)

    def with_residual(self, mesh: Mesh) -> "RowApproximation":
        """The same networks with what they miss of a mesh kept beside them: `mesh()` is then exact to rounding.

        Raises
        ------
        InputError
            If the mesh has other faces or another number of vertices.
        """
        if mesh.n_vertices != self.topology.n_vertices or not np.array_equal(mesh.faces, self.topology.faces):
            raise InputError("the mesh that was approximated", repr(mesh), "approximate this mesh anew")
        return replace(self, residual=mesh.vertices - replace(self, residual=None).mesh().vertices)

    def counts(self) -> dict[str, int]:
        """How many wavelets there are of each mother: the paper's six, and whatever else there is."""
        return with_zeros(self.table.counts())

    def figures(self, map: SphericalMap) -> Figures:
        """How far the mesh that comes back is from the one of this map, and what it takes.

        The figures of `closeness`; `counts`, `wavelets`, `blocks`; `block_error_max`: the worst block, in mesh units;
        `grid_mse_relative`: what an image without any error, sampled at the vertices, would miss.
        """
        exact, own = spherical_image(map, self.image.size, self.image.layout), map.valid
        missed = metrics.mse(exact.sample(self.points[own]), map.mesh.vertices[own])
        return closeness(map, self.mesh().vertices) | {
            "counts": self.counts(),
            "wavelets": len(self.table.centers),
            "blocks": self.blocks,
            "block_error_max": float(self.image.block_errors(exact).max()),
            "grid_mse_relative": relative(missed, diagonal(map)),
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write everything to one `.npz` file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        faces, none = self.topology.faces, np.zeros((0, AXES))
        own = (
            np.array(self.image.layout),
            np.array(self.image.block_rows),
            self.image.mask.astype(np.uint8),
            self.points.astype(np.float32),
            faces.astype(np.min_scalar_type(int(faces.max(initial=0)))),
            none if self.residual is None else self.residual,
        )
        _store.save(path, KIND, VERSION, self.table.arrays() | dict(zip(OWN, own, strict=True)))

    @classmethod
    def load(cls, path: str | os.PathLike[str], mothers: Sequence[Mother] = ()) -> "RowApproximation":
        """Read what `save` wrote; own mothers have to be passed.

        Raises
        ------
        FileError
            If the file is no mesh in rows, or has a mother that is not known.
        """
        arrays = _store.load(path, KIND, VERSION, ARRAYS + OWN)
        with refused_as_file(KIND, path):
            table = NetworkTable(found(arrays["mothers"], mothers), *(arrays[name] for name in ARRAYS[1:]))
            points = _arrays.real(arrays["points"], "points", (None, AXES))
            mask = _arrays.index(arrays["mask"], "mask", (None, None), 2) > 0
            height = int(_arrays.index(arrays["block_rows"], "block_rows", (), len(mask) + 1))
            image = ImageApproximation(str(arrays["layout"]), table, mask, height)  # type: ignore[arg-type]
            residual = _arrays.real(arrays["residual"], "residual", (None, AXES))
            return cls(image, points, Topology(arrays["faces"], len(points)), residual if len(residual) else None)


def approximate_rows(image: SphericalImage, options: RowOptions = ROWS) -> ImageApproximation:
    """Train a network on each block of rows of a geometry image (steps 5 to 8).

    Parameters
    ----------
    image
        What to approximate.
    options
        15 wavelets of the paper's six mothers per row if left out.

    Returns
    -------
    ImageApproximation
        Blocks that are affine along their rows, such as the poles of a latlong image, have no wavelets.

    Raises
    ------
    InputError
        If a block has more rows than the image, or positions are beyond 1e150.

    Notes
    -----
    As `fit_rows`: with the sampling of the image, 0.13 CPU s for 129 rows of 15 wavelets, 0.24 s for 257.

    Examples
    --------
    >>> from morphlet.approximation.rows import RowOptions, approximate_rows
    >>> from morphlet.sphere.image import SphericalImage, directions
    >>> ball = SphericalImage("octahedral", directions("octahedral", 33), np.ones((33, 33), bool))
    >>> approximate_rows(ball).table
    NetworkTable(33 blocks, 495 wavelets, 3 outputs)
    >>> found = approximate_rows(ball, RowOptions(n_wavelets=30, error=0.01))
    >>> len(found.table.centers), bool(found.block_errors(ball).max() <= 0.01)
    (207, True)
    """
    rows = rows_of_blocks(image.size, options.block_rows)
    signals = _signals(image.positions[rows], 1 if options.coordinates == "joint" else AXES)
    x = np.linspace(0, 1, signals.shape[1])
    fitted = fit_rows(x, signals, dyadic_library(options.mothers, x), options.fit(signals.shape[2]))
    return ImageApproximation(image.layout, fitted.table, image.mask, options.block_rows)


def approximate_by_rows(map: SphericalMap, size: int = SIZE, layout: Layout = "octahedral", options: RowOptions = ROWS) -> RowApproximation:
    """Approximate a mesh by the networks of the rows of its geometry image.

    Parameters
    ----------
    map
        The spherical map of the mesh.
    size
        Rows of the image.
    layout
        Of the image. With about as many numbers (129 and 128 rows), "octahedral" is 0.45, 0.37 and 0.32 % of the diagonal off
        horse, cat and bunny (rms), and "latlong" 0.46, 0.55 and 0.30 %.
    options
        15 wavelets of the paper's six mothers per row if left out.

    Returns
    -------
    RowApproximation
        Gives back a mesh with the vertices and faces of the one of the map; measure it by `figures`.

    Raises
    ------
    InputError
        As `spherical_image` and `approximate_rows`.

    References
    ----------
    Sections 7.2 and 7.3 of the paper.

    Examples
    --------
    >>> from morphlet import Mesh, spherical_map
    >>> from morphlet.approximation.rows import approximate_by_rows
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(2)
    >>> egg = Mesh(points * [1, 1.2, 1.6], faces)
    >>> mapped = spherical_map(egg)
    >>> found = approximate_by_rows(mapped, size=65)
    >>> found.mesh(), found.figures(mapped)["mse_relative"] < 1e-5
    (Mesh(162 vertices, 320 faces), True)
    >>> bool(abs(found.with_residual(egg).mesh().vertices - egg.vertices).max() < 1e-15)
    True
    """
    return RowApproximation(approximate_rows(spherical_image(map, size, layout), options), map.points, map.mesh.topology)


def rows_of_blocks(size: int, block_rows: int) -> Int[np.ndarray, "b r"]:
    """Which rows each block holds; the last block ends with the last row.

    Raises
    ------
    InputError
        If a block has more rows than there are.

    Examples
    --------
    >>> from morphlet.approximation.rows import rows_of_blocks
    >>> rows_of_blocks(5, 2).tolist()
    [[0, 1], [2, 3], [3, 4]]
    """
    if not 1 <= block_rows <= size:
        raise InputError(f"1 to {size} rows per block", str(block_rows), "ask for fewer rows per block, or more rows")
    first = np.minimum(np.arange(0, size, block_rows), size - block_rows)
    return first[:, None] + np.arange(block_rows)


def _signals(blocks: Float[np.ndarray, "b r n 3"], parts: int) -> Float[np.ndarray, "s n k"]:
    """The blocks as signals along their rows: in 1 part of three coordinates, or in 3 of one each."""
    b, r, n, _ = blocks.shape
    cut = blocks.reshape(b, r, n, parts, AXES // parts).transpose(0, 3, 2, 1, 4)
    return np.ascontiguousarray(cut.reshape(b * parts, n, r * (AXES // parts)))
