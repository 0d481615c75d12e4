"""How far one shape is from another.

Distances are in mesh units, their squares in squared ones; percentages are signed where a sign has meaning (the second shape
is larger: positive). Functions of `positions` and `reference` compare vertex by vertex, functions of meshes compare surfaces.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError, MeshError
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest
from morphlet.surface.operators import FLAT, laplacian


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
    _require_same_topology(first, second)
    a, b = edge_lengths(first), edge_lengths(second)
    measurable = (a > 0) & (b > 0)
    return float(np.sqrt(np.mean(np.log(b[measurable] / a[measurable]) ** 2))) if measurable.any() else 0.0


def edge_strain_rms(rest: Mesh, deformed: Mesh) -> float:
    """Root mean square of the relative change of edge lengths, in percent of the length at rest.

    Edges without length at rest have no strain and are left out.

    Raises
    ------
    InputError
        If the faces differ.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> round(edge_strain_rms(triangle, triangle.with_vertices(1.5 * triangle.vertices)), 9)
    50.0
    """
    _require_same_topology(rest, deformed)
    before, after = edge_lengths(rest), edge_lengths(deformed)
    strain = after[before > 0] / before[before > 0] - 1
    return 100 * float(np.sqrt(np.mean(strain**2))) if len(strain) else 0.0


def laplacian_error(rest: Mesh, deformed: Mesh) -> float:
    """How much the size of the Laplacian coordinates changed, in percent of what they are at rest.

    The coordinates are those of the cotangent Laplacian at rest, divided by the vertex areas: twice the mean curvature
    normal. What is compared is their length, which a rotation does not change; both norms are weighted with the vertex areas.
    A rest shape that has no curvature at all has no error unless the other has some: then it is infinite.

    Raises
    ------
    InputError
        If the faces differ.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> corner = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> round(laplacian_error(corner, corner.with_vertices(1.25 * corner.vertices)), 9)
    25.0
    """
    _require_same_topology(rest, deformed)
    area, matrix = rest.vertex_areas, laplacian(rest)
    weight = np.divide(1.0, area, out=np.zeros_like(area), where=area > 0)
    before, after = (np.linalg.norm(matrix @ mesh.vertices, axis=1) for mesh in (rest, deformed))
    error, size = np.sum(weight * (after - before) ** 2), np.sum(weight * before**2)
    return 100 * float(np.sqrt(error / size)) if size > 0 else float("inf") if error > 0 else 0.0


def arap_energy(rest: Mesh, deformed: Mesh) -> float:
    """How far the deformation is from rigid round each vertex: the spokes-and-rims energy over the area at rest.

    Each vertex takes the rotation that fits its triangles best; each triangle is compared with the rotations of its corners.
    Free of the unit of length, and comparable between all ways of deforming.

    Raises
    ------
    InputError
        If the faces differ.
    MeshError
        If the rest shape has no area.

    Notes
    -----
    ``E = 1/3 sum_t sum_{v in t} sum_k c_tk |e'_k - R_v e_k|^2 / area`` over triangles t, their corners v and edges k, c_tk half the
    cotangent of the angle opposite the edge. Taken as the difference of ``sum c (|e|^2 + |e'|^2)`` and twice the best ``tr(R S)``,
    so it is exact to about 1e-16 of the former. O(n).

    References
    ----------
    Chao, Pinkall, Sanan and Schroeder, A simple geometric model for elastic deformations, ACM Transactions on Graphics 29, 2010.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> round(arap_energy(triangle, triangle.with_vertices(2 * triangle.vertices)), 9)
    2.0
    """
    _require_same_topology(rest, deformed)
    if not rest.area > 0:
        raise MeshError("a rest shape with area", "none", "pass the mesh before it was deformed first")
    edges, moved, half = (*(_edge_vectors(mesh) for mesh in (rest, deformed)), _half_cotangents(rest))
    covariance = np.einsum("fk,fki,fkj->fij", half, edges, moved).reshape(-1, 9)
    size = np.einsum("fk,fk->f", half, np.sum(edges**2 + moved**2, axis=2))
    corners, face = rest.faces.ravel(), np.repeat(np.arange(rest.n_faces), 3)
    touches = sp.csr_matrix((np.ones(len(face)), (corners, face)), (rest.n_vertices, rest.n_faces))
    around = (touches @ covariance).reshape(-1, 3, 3)
    stretch = np.linalg.svd(around, compute_uv=False)
    stretch[:, 2] *= np.sign(np.linalg.det(around))
    return max(float(size.sum() - 2 * stretch.sum() / 3) / rest.area, 0.0)


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


def _require_same_topology(first: Mesh, second: Mesh) -> None:
    """Refuse meshes that cannot be compared edge by edge."""
    if not _same_topology(first, second):
        raise InputError("two meshes with the same faces", f"{first!r} and {second!r}", "resample one on the other first")


def _edge_vectors(mesh: Mesh) -> Float[np.ndarray, "m 3 3"]:
    """Edge opposite each corner of each face."""
    corners = mesh.vertices[mesh.faces]
    return np.roll(corners, -1, axis=1) - np.roll(corners, -2, axis=1)


def _half_cotangents(mesh: Mesh) -> Float[np.ndarray, "m 3"]:
    """Half the cotangent of the angle at each corner; zero in a face without area."""
    opposite = np.sum(_edge_vectors(mesh) ** 2, axis=2)
    dots = 0.5 * (opposite.sum(axis=1, keepdims=True) - 2 * opposite)
    area = mesh.face_areas[:, None]
    return np.divide(0.25 * dots, area, out=np.zeros_like(dots), where=area > FLAT * opposite.max(axis=1, keepdims=True))


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
