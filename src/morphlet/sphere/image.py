"""Spherical geometry images: the map sampled on a grid.

Two layouts. "octahedral", size x size: the octahedron |x| + |y| + |z| = 1 is seen along z and its lower half is folded
outwards, so that the middle is +z, all four corners are -z, and the border repeats itself: pixel k of a side shows what
pixel size - 1 - k of the same side shows. Columns follow x, rows follow y, both from -1 to 1. "latlong", size x 2 size:
rows go from +z to -z, columns round the z axis from +x towards +y; the last column lies one step before the first, and
the first and last rows show one pole each. Pixels that show the same direction hold exactly the same numbers.
"""

import os
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int, UInt16

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.sphere.map import SphericalMap
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.points import SurfacePoints
from morphlet.surface.requirements import degenerate

Layout = Literal["octahedral", "latlong"]

KIND, VERSION = "image", 1
SMALLEST = 3
"""Rows of the octahedron itself, and of two poles with an equator: with fewer no volume is enclosed."""
FULL_SCALE = 65535
"""Largest value of a 16-bit pixel."""
BYTE = 257
"""16-bit steps per 8-bit step: 65535 / 255."""


@dataclass(frozen=True, eq=False)
class SphericalImage:
    """A closed surface as an image: each pixel is a direction on the sphere and holds a position.

    Parameters
    ----------
    layout
        How pixels stand for directions, see `directions`.
    positions
        Where the surface is, in mesh units. Pixels of the same direction must hold the same position.
    mask
        Whether a pixel shows the mesh; False where it shows the lid of a filled hole.

    Raises
    ------
    InputError
        If the shape does not belong to the layout, or pixels of the same direction differ.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.sphere.image import SphericalImage, directions
    >>> ball = SphericalImage("octahedral", directions("octahedral", 33), np.ones((33, 33), bool))
    >>> ball.to_mesh()
    Mesh(1026 vertices, 2048 faces)
    """

    layout: Layout
    positions: Float[np.ndarray, "h w 3"]
    mask: Bool[np.ndarray, "h w"]

    def __post_init__(self) -> None:
        positions = _arrays.real(self.positions, "positions", (None, None, 3))
        height, width = _shape(self.layout, len(positions))
        if positions.shape[1] != width:
            raise InputError(f"{width} columns for {height} rows in the {self.layout} layout", str(positions.shape[1]), "resample the map")
        mask = _arrays.freeze(np.array(self.mask, bool))
        if mask.shape != (height, width):
            raise InputError(f"a mask of shape ({height}, {width})", f"shape {mask.shape}", "pass one value per pixel")
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "mask", mask)
        self._require_joined()

    def __reduce__(self) -> tuple[Any, ...]:
        return SphericalImage, (self.layout, np.array(self.positions), np.array(self.mask))

    def _require_joined(self) -> None:
        """Refuse pixels of one direction that hold different numbers."""
        first, number = _identified(self.layout, self.size)
        content = np.dstack([self.positions, self.mask])
        torn = np.argwhere((content != content.reshape(-1, 4)[first][number]).any(axis=2))
        if len(torn):
            advice = "copy the border, the seam or the pole from one of them"
            raise InputError("pixels of the same direction to be equal", f"{len(torn)} that are not", advice, torn)

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.positions)

    def sample(self, directions: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
        """The position in each direction, bilinear between four pixels; continuous over the whole sphere.

        Parameters
        ----------
        directions
            Non-zero vectors; their length is ignored.

        Raises
        ------
        InputError
            If a direction is zero or not finite.

        Notes
        -----
        About 0.5 CPU s per million directions. On a smooth map the error falls with the square of the size, except in
        the octahedral layout where an edge of the octahedron runs through a cell: there it falls with the size itself.
        With odd sizes only the four edges of the equator do so, with even sizes all twelve.

        Examples
        --------
        >>> from morphlet.sphere.image import SphericalImage, directions
        >>> ball = SphericalImage("latlong", directions("latlong", 65), np.ones((65, 130), bool))
        >>> ball.sample(np.array([[0.0, 0.0, 2.0], [1.0, 1.0, 1.0]])).round(3)
        array([[0.   , 0.   , 1.   ],
               [0.577, 0.577, 0.577]])
        """
        row, column = _place(self.layout, self.size, _arrays.unit(directions, "directions"))
        grid = _joined(self.layout, self.positions)
        i, j = np.minimum(row.astype(np.int64), len(grid) - 2), np.minimum(column.astype(np.int64), grid.shape[1] - 2)
        s, t = (row - i)[:, None], (column - j)[:, None]
        upper, lower = (1 - t) * grid[i, j] + t * grid[i, j + 1], (1 - t) * grid[i + 1, j] + t * grid[i + 1, j + 1]
        return (1 - s) * upper + s * lower

    def to_mesh(self) -> Mesh:
        """The pixels as a closed mesh of genus 0, lids of holes included.

        Pixels of the same direction are one vertex; vertices are in the order of their first pixels. Each quad is cut
        along its shorter diagonal [1]_; only the quads at the middle of an octahedral image's sides, where the border
        is folded, always keep to the octahedron's edge.

        Returns
        -------
        Mesh
            With faces counter-clockwise from outside.

        Notes
        -----
        O(size^2).

        References
        ----------
        .. [1] Gu, Gortler, Hoppe: Geometry images. SIGGRAPH 2002.

        Examples
        --------
        >>> from morphlet.sphere.image import SphericalImage, directions
        >>> ball = SphericalImage("octahedral", directions("octahedral", 3), np.ones((3, 3), bool))
        >>> ball.to_mesh().topology.euler_characteristic, round(ball.to_mesh().volume, 6)
        (2, 1.333333)
        """
        first, number = _identified(self.layout, self.size)
        vertices = self.positions.reshape(-1, 3)[first]
        quads = _quads(self.layout, number)
        ends = vertices[quads]
        first_shorter = np.sum((ends[:, 0] - ends[:, 2]) ** 2, axis=1) <= np.sum((ends[:, 1] - ends[:, 3]) ** 2, axis=1)
        faces = _cut(quads, _kept(self.layout, self.size, first_shorter))
        return Mesh(vertices, Topology(faces, len(vertices)))

    def rmse(self, map: SphericalMap) -> float:
        """Root mean square distance between the vertices of a mesh and their places in the image, in mesh units.

        Parameters
        ----------
        map
            The map the image was made of, or a map of another mesh to the same sphere.

        Returns
        -------
        float
            Over the vertices with a point of their own, each weighted by its share of the area.

        Notes
        -----
        One call of `sample`. Shifts along the surface count too. The vertices are where a triangle mesh is least smooth:
        the error falls with the size itself, not with its square.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.sphere.image import spherical_image
        >>> from morphlet.sphere.map import spherical_map
        >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
        >>> mapped = spherical_map(tetrahedron)
        >>> spherical_image(mapped, 257).rmse(mapped) < 0.05
        True
        """
        missed = self.sample(map.points[map.valid]) - map.mesh.vertices[map.valid]
        area = map.mesh.vertex_areas[map.valid]
        weight = area if area.sum() > 0 else np.ones(len(area))
        return float(np.sqrt(np.average(np.sum(missed**2, axis=1), weights=weight)))

    def pixels(self) -> tuple[UInt16[np.ndarray, "h w 3"], Float[np.ndarray, "2 3"]]:
        """The positions as 16-bit colours, and the box they span: its lowest and highest corner.

        Returns
        -------
        pixels, box
            `box[0] + pixels / 65535 * (box[1] - box[0])` is within half a step of the positions, on each axis.

        Examples
        --------
        >>> from morphlet.sphere.image import SphericalImage, directions
        >>> ball = SphericalImage("octahedral", directions("octahedral", 5), np.ones((5, 5), bool))
        >>> pixels, box = ball.pixels()
        >>> pixels[2, 2], box.tolist()
        (array([32768, 32768, 65535], dtype=uint16), [[-1.0, -1.0, -1.0], [1.0, 1.0, 1.0]])
        """
        box = np.stack([self.positions.min(axis=(0, 1)), self.positions.max(axis=(0, 1))])
        extent = box[1] - box[0]
        share = (self.positions - box[0]) / np.where(extent > 0, extent, 1.0)
        return np.round(FULL_SCALE * share).astype(np.uint16), box

    def write_png(self, path: str | os.PathLike[str]) -> None:
        """Write an RGB picture of the positions, 8 bits per channel; for the eye, since it keeps neither box nor mask.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        from matplotlib.image import imsave

        pixels, _ = self.pixels()
        colours = np.round(pixels / BYTE).astype(np.uint8)
        with _store.beside(path) as temporary:
            imsave(temporary, colours, format="png")

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the image to an `.npz` file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        _store.save(path, KIND, VERSION, {"positions": self.positions, "mask": self.mask, "layout": np.array(self.layout)})

    @staticmethod
    def load(path: str | os.PathLike[str]) -> "SphericalImage":
        """Read an image.

        Raises
        ------
        FileError
            If the file is no spherical image.
        """
        arrays = _store.load(path, KIND, VERSION, ("positions", "mask", "layout"))
        try:
            return SphericalImage(str(arrays["layout"]), arrays["positions"], arrays["mask"])  # type: ignore[arg-type]
        except InputError as error:
            raise FileError(f"a spherical image in {path}: {error.needed}", error.found, "write it again", error.elements) from error


def spherical_image(map: SphericalMap, size: int, layout: Layout = "octahedral") -> SphericalImage:
    """Sample a spherical map on a grid.

    Parameters
    ----------
    map
        Which surface point lies in which direction.
    size
        Number of rows, 3 or more; odd sizes suit the octahedral layout best, see `SphericalImage.sample`.
    layout
        "octahedral": size x size; "latlong": size x 2 size.

    Returns
    -------
    SphericalImage
        Exact at its pixels. Under a filled hole it shows the lid.

    Raises
    ------
    InputError
        If the size is below 3 or the layout unknown.

    Notes
    -----
    One point location per pixel: about 1 CPU s per million pixels.

    References
    ----------
    Praun, Hoppe: Spherical parametrization and remeshing. SIGGRAPH 2003.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.sphere.image import spherical_image
    >>> from morphlet.sphere.map import spherical_map
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> image = spherical_image(spherical_map(tetrahedron), 64, "latlong")
    >>> image.positions.shape, bool(image.mask.all())
    ((64, 128, 3), True)
    """
    first, number = _identified(layout, size)
    faces, weights = map._locator.locate(directions(layout, size).reshape(-1, 3)[first])
    positions = SurfacePoints(faces, weights).positions(map.surface.mesh)
    return SphericalImage(layout, positions[number], (map.surface.face_map[faces] >= 0)[number])


def directions(layout: Layout, size: int) -> Float[np.ndarray, "h w 3"]:
    """The unit vector each pixel stands for.

    Parameters
    ----------
    layout
        "octahedral" or "latlong".
    size
        Number of rows, 3 or more.

    Raises
    ------
    InputError
        If the size is below 3 or the layout unknown.

    Examples
    --------
    >>> from morphlet.sphere.image import directions
    >>> directions("octahedral", 3)[1].tolist()
    [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]
    """
    vectors = _octahedron if layout == "octahedral" else _globe
    points = vectors(*_shape(layout, size))
    first, number = _identified(layout, size)
    points = points.reshape(-1, 3)[first]
    return (points / np.linalg.norm(points, axis=1, keepdims=True))[number]


def _shape(layout: str, size: int) -> tuple[int, int]:
    """Rows and columns, after a check of both arguments."""
    if layout not in get_args(Layout):
        raise InputError(f"layout to be one of {', '.join(get_args(Layout))}", repr(layout), "choose one of these")
    if size < SMALLEST:
        raise InputError(f"a size of {SMALLEST} or more", str(size), "ask for more rows")
    return size, size if layout == "octahedral" else 2 * size


def _octahedron(height: int, width: int) -> Float[np.ndarray, "h w 3"]:
    """Points of a large octahedron, in whole numbers: what is symmetric stays so to the last bit."""
    span = width - 1
    y, x = 2 * np.indices((height, width)) - span
    z = span - abs(x) - abs(y)
    folded_x, folded_y = (span - abs(y)) * _sign(x), (span - abs(x)) * _sign(y)
    return np.stack([np.where(z < 0, folded_x, x), np.where(z < 0, folded_y, y), z], axis=2).astype(np.float64)


def _globe(height: int, width: int) -> Float[np.ndarray, "h w 3"]:
    """Points of the sphere by polar angle and longitude."""
    polar, turn = np.pi * np.arange(height)[:, None] / (height - 1), 2 * np.pi * np.arange(width) / width
    ring = np.sin(polar)
    ring[[0, -1]] = 0  # sin(pi) is not
    return np.stack([ring * np.cos(turn), ring * np.sin(turn), np.broadcast_to(np.cos(polar), (height, width))], axis=2)


def _place(layout: str, size: int, x: Float[np.ndarray, "k 3"]) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
    """Row and column of each unit vector, as real numbers; the inverse of `directions`."""
    height, width = _shape(layout, size)
    if layout == "latlong":
        polar = np.arctan2(np.hypot(x[:, 0], x[:, 1]), x[:, 2])
        return polar * (height - 1) / np.pi, np.mod(np.arctan2(x[:, 1], x[:, 0]) * width / (2 * np.pi), width)
    flat = x[:, :2] / np.abs(x).sum(axis=1, keepdims=True)
    folded = (1 - np.abs(flat[:, ::-1])) * _sign(flat)
    u, v = np.where(x[:, 2:] < 0, folded, flat).T
    return (v + 1) * (height - 1) / 2, (u + 1) * (width - 1) / 2


def _sign(x: np.ndarray) -> Int[np.ndarray, "..."]:
    """-1 or 1, never 0: the fold has two sides."""
    return np.where(x < 0, -1, 1)


def _identified(layout: str, size: int) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "h w"]]:
    """The first pixel of each distinct direction, in row order; for each pixel, the number of its direction."""
    height, width = _shape(layout, size)
    i, j = np.indices((height, width))
    side = (i == 0) | (i == height - 1)
    if layout == "latlong":
        j = np.where(side, 0, j)
    else:
        j = np.where(side, np.minimum(j, width - 1 - j), j)
        i = np.where((j == 0) | (j == width - 1), np.minimum(i, height - 1 - i), i)
    first, number = np.unique(i * width + j, return_inverse=True)
    return first, number.reshape(height, width)


def _joined(layout: str, grid: np.ndarray) -> np.ndarray:
    """The grid without a seam: the first column again after the last of a latlong image."""
    return np.concatenate([grid, grid[:, :1]], axis=1) if layout == "latlong" else grid


def _quads(layout: str, number: Int[np.ndarray, "h w"]) -> Int[np.ndarray, "q 4"]:
    """Directions at the corners of each cell, counter-clockwise from outside."""
    grid = _joined(layout, number)
    if layout == "latlong":
        grid = grid[::-1]  # rows go south
    corners = [grid[:-1, :-1], grid[:-1, 1:], grid[1:, 1:], grid[1:, :-1]]
    return np.stack(corners, axis=2).reshape(-1, 4)


def _kept(layout: str, size: int, first_diagonal: Bool[np.ndarray, "q"]) -> Bool[np.ndarray, "q"]:
    """Which quads to cut along corners 0 and 2: as proposed, but not across the fold at the middle of a side.

    There the two cells of a side share three corners; cut alike from the fold, they would lie on each other.
    """
    if layout == "latlong" or size % 2 == 0:
        return first_diagonal
    cell = np.arange(size - 1)
    end, middle, low = (cell == 0) | (cell == size - 2), np.abs(2 * cell + 2 - size) == 1, 2 * cell < size - 1
    fold = (end[:, None] & middle) | (middle[:, None] & end)
    return np.where(fold, low[:, None] != low, first_diagonal.reshape(fold.shape)).ravel()


def _cut(quads: Int[np.ndarray, "q 4"], first_diagonal: Bool[np.ndarray, "q"]) -> Int[np.ndarray, "m 3"]:
    """Each quad as two triangles, or one where two of its corners are the same vertex."""
    across = np.where(first_diagonal[:, None], quads, np.roll(quads, -1, axis=1))
    faces = across[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)
    return faces[~degenerate(faces)]
