"""How far one shape is from another.

Distances are in mesh units, their squares in squared ones; percentages are signed where a sign has meaning (the second shape
is larger: positive). Functions of `positions` and `reference` compare vertex by vertex, functions of meshes compare surfaces.
"""

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest


def mse(positions: Float[np.ndarray, "n 3"], reference: Float[np.ndarray, "n 3"]) -> float:
    """Mean squared distance per vertex (Eq. 9 of the paper), in squared mesh units.

    Raises
    ------
    InputError
        If the shapes differ or are empty.

    Examples
    --------
    >>> mse([[0, 0, 0], [1, 0, 0]], [[0, 0, 2], [1, 0, 0]])
    2.0
    """
    return float(np.mean(_distances(positions, reference) ** 2))


def rms(positions: Float[np.ndarray, "n 3"], reference: Float[np.ndarray, "n 3"]) -> float:
    """Root of `mse`, in mesh units.

    Examples
    --------
    >>> rms([[0, 0, 0], [1, 0, 0]], [[2, 0, 0], [1, 2, 0]])
    2.0
    """
    return float(np.sqrt(mse(positions, reference)))


def psnr(error: float, diagonal: float) -> float:
    """Peak signal-to-noise ratio in dB: 20 log10(diagonal / error), for an rms error and a bounding-box diagonal.

    Infinite for no error; minus infinite for an error against a shape without size.

    Examples
    --------
    >>> round(psnr(0.01, 1.0), 9)
    40.0
    """
    with np.errstate(divide="ignore"):
        return float(20 * (np.log10(diagonal) - np.log10(error))) if error > 0 else float("inf")


def deformation_rate(positions: Float[np.ndarray, "n 3"], reference: Float[np.ndarray, "n 3"]) -> float:
    """Mean distance per vertex in percent of the reference's bounding-box diagonal.

    This is the rate of a whole mesh, without a region of interest. A reference without size has no rate: NaN, unless nothing moved.

    Examples
    --------
    >>> round(deformation_rate([[0, 0, 0.05], [3, 4, 0.05]], [[0, 0, 0], [3, 4, 0]]), 9)
    1.0
    """
    mean = float(np.mean(_distances(positions, reference)))
    diagonal = float(np.linalg.norm(np.ptp(np.asarray(reference, float), axis=0)))
    return 0.0 if mean == 0 else 100 * mean / diagonal if diagonal > 0 else float("nan")


def hausdorff(first: Mesh, second: Mesh) -> float:
    """The farthest that a vertex or face centre of either mesh lies from the surface of the other, in mesh units.

    Raises
    ------
    MeshError
        If a mesh has no faces.

    Notes
    -----
    A lower bound of the distance between the continuous surfaces, short of it by at most the size of a triangle. O(n log n).

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> hausdorff(triangle, triangle.with_vertices(triangle.vertices + [0, 0, 3]))
    3.0
    """
    return float(max(_to_surface(_samples(a), b).max() for a, b in ((first, second), (second, first))))


def volume_change(first: Mesh, second: Mesh) -> float:
    """How much more volume the second mesh encloses, in percent of the first's, signed; NaN if the first encloses none.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> import numpy as np
    >>> tetrahedron = Mesh(np.vstack([np.zeros(3), np.eye(3)]), [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> round(volume_change(tetrahedron, tetrahedron.with_vertices(2 * tetrahedron.vertices)), 9)
    700.0
    """
    return signed_percent(second.volume, first.volume)


def signed_percent(value: float, reference: float) -> float:
    """Difference to the reference in percent of its size; NaN if that is zero and the value is not.

    Examples
    --------
    >>> signed_percent(1.5, 2.0)
    -25.0
    """
    if value == reference:
        return 0.0
    return 100 * float(value - reference) / abs(float(reference)) if reference else float("nan")


def edge_lengths(mesh: Mesh) -> Float[np.ndarray, "e"]:
    """Length of each edge, in the order of `mesh.topology.edges`.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> edge_lengths(Mesh([[0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 1, 2]]))
    array([3., 4., 5.])
    """
    i, j = mesh.topology.edges.T
    return np.linalg.norm(mesh.vertices[i] - mesh.vertices[j], axis=1)


def edge_log_rms(first: Mesh, second: Mesh) -> float:
    """Root mean square of the log ratio of edge lengths: 0 if no edge changed, about 0.1 for changes of ten percent.

    Edges without length in either mesh have no ratio and are left out.

    Raises
    ------
    InputError
        If the faces differ.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> round(edge_log_rms(triangle, triangle.with_vertices(2 * triangle.vertices)), 6)
    0.693147
    """
    if not _same_topology(first, second):
        raise InputError("two meshes with the same faces", f"{first!r} and {second!r}", "resample one on the other first")
    a, b = edge_lengths(first), edge_lengths(second)
    measurable = (a > 0) & (b > 0)
    return float(np.sqrt(np.mean(np.log(b[measurable] / a[measurable]) ** 2))) if measurable.any() else 0.0


def compare(first: Mesh, second: Mesh) -> dict[str, float | None]:
    """The distances between two meshes, by name.

    Meshes with the same faces are compared vertex by vertex. Otherwise `mse`, `rms` and `psnr` take each vertex's distance to
    the nearest place of the other surface, both ways, weighted with the vertex areas, and `edge_log_rms` is None.

    Returns
    -------
    figures
        `mse, rms, hausdorff, psnr, volume_change, edge_log_rms`. `psnr` is relative to the bounding-box diagonal of `first`
        and None for equal shapes; `volume_change` is in percent of the volume of `first`, None if that is zero.

    Raises
    ------
    MeshError
        If a mesh has no faces.

    Notes
    -----
    O(n log n).

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> figures = compare(triangle, triangle.with_vertices(triangle.vertices + [0, 0, 2]))
    >>> figures["mse"], figures["rms"], figures["hausdorff"], figures["edge_log_rms"]
    (4.0, 2.0, 2.0, 0.0)
    """
    same = _same_topology(first, second)
    square = mse(second.vertices, first.vertices) if same else _surface_mse(first, second)
    figures = {
        "mse": square,
        "rms": float(np.sqrt(square)),
        "hausdorff": hausdorff(first, second),
        "psnr": psnr(float(np.sqrt(square)), first.bbox_diagonal),
        "volume_change": volume_change(first, second),
    }
    finite: dict[str, float | None] = {name: value if np.isfinite(value) else None for name, value in figures.items()}
    return finite | {"edge_log_rms": edge_log_rms(first, second) if same else None}


def _distances(positions: np.ndarray, reference: np.ndarray) -> Float[np.ndarray, "n"]:
    """Distance of each vertex to its own in the reference."""
    x = _arrays.real(positions, "positions", (None, 3))
    y = _arrays.real(reference, "reference", (len(x), 3))
    if not len(x):
        raise InputError("at least one vertex", "none", "pass the positions of a mesh")
    return np.linalg.norm(x - y, axis=1)


def _same_topology(first: Mesh, second: Mesh) -> bool:
    """Whether both meshes have the same vertices in the same faces."""
    return first.n_vertices == second.n_vertices and np.array_equal(first.faces, second.faces)


def _to_surface(positions: Float[np.ndarray, "k 3"], mesh: Mesh) -> Float[np.ndarray, "k"]:
    """Distance of each position to the surface."""
    return np.linalg.norm(nearest(mesh, positions).positions(mesh) - positions, axis=1)


def _samples(mesh: Mesh) -> Float[np.ndarray, "k 3"]:
    """The vertices that faces use, and the centres of the faces."""
    return np.concatenate([mesh.vertices[mesh.topology.referenced], mesh.vertices[mesh.faces].mean(axis=1)])


def _surface_mse(first: Mesh, second: Mesh) -> float:
    """Mean over both directions of the area-weighted mean squared distance to the other surface."""
    sums = []
    for a, b in ((first, second), (second, first)):
        weight = a.vertex_areas if a.area > 0 else a.topology.referenced.astype(float)
        sums.append(np.average(_to_surface(a.vertices, b) ** 2, weights=weight))
    return float(np.mean(sums))
