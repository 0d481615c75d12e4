"""What each vertex sees around it: a few smooth numbers that a change of pose, of size or of triangles alters little.

A signature is (n, d), one row per vertex, finite for every mesh, whatever its holes, parts or bad triangles. Lengths are
divided by the square root of the total area.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from morphlet.surface.mesh import Mesh

SOURCES = 128
"""Farthest-point sources of the distances: 64 do for the mean, `local_area` needs them denser than its radius."""


NEAR = 0.15
"""Radius of the surroundings in `local_area`, over the square root of the area: a leg's thickness, somewhat more than the spacing of
the farthest points. Tails and heads, which the mean distance confuses, differ in it."""


def signature(mesh: Mesh) -> Float[np.ndarray, "n 3"]:
    """Mean geodesic distance to the surface, distance to its centroid, and log area of the surroundings, of each vertex.

    Parameters
    ----------
    mesh
        Any mesh with at least one vertex.

    Returns
    -------
    values
        Column 0: `mean_geodesic_distance`, high at the tips of limbs. Column 1: `centroid_distance`. Column 2: log of `local_area`,
        low on thin limbs.

    Notes
    -----
    Columns 0 and 2 do not change with the pose, column 1 does a little but tells limbs of one length apart. Costs `SOURCES`
    shortest-path trees, O(n log n) each.

    References
    ----------
    Hilaga, Shinagawa, Kohmura and Kunii, Topology matching for fully automatic similarity estimation of 3D shapes, SIGGRAPH 2001.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> values = signature(Mesh(*icosphere(2)))
    >>> values.shape, bool(abs(values[:, 1] * (4 * 3.1416) ** 0.5 - 1).max() < 0.02)
    ((162, 3), True)
    """
    distances, share = _sampled_distances(mesh)
    return np.stack([share @ distances, centroid_distance(mesh), np.log(_share_near(distances, share))], axis=1)


def mean_geodesic_distance(mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Mean distance along the surface from each vertex to the whole surface, over the square root of its area.

    Distances are shortest paths along edges and across pairs of neighbouring faces; parts are joined by straight bridges.

    Notes
    -----
    The mean over the surface is a sum over `SOURCES` farthest points, each weighted with the area nearest to it.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> mean = mean_geodesic_distance(Mesh(*icosphere(3)))  # pi / 2 over sqrt(4 pi), plus the error of the paths
    >>> bool(0.44 < mean.min() and mean.max() < 0.48)
    True
    """
    distances, share = _sampled_distances(mesh)
    return share @ distances


def local_area(mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Share of the surface around each vertex, fading with the distance along the surface as a Gaussian of radius `NEAR` sqrt(area).

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> share = local_area(Mesh(*icosphere(3)))  # pi NEAR^2 on a plane
    >>> bool(0.05 < share.min() and share.max() < 0.09)
    True
    """
    return _share_near(*_sampled_distances(mesh))


def _share_near(distances: Float[np.ndarray, "s n"], share: Float[np.ndarray, "s"]) -> Float[np.ndarray, "n"]:
    return share @ np.exp(-((distances / NEAR) ** 2)) + np.finfo(float).tiny


def _sampled_distances(mesh: Mesh) -> tuple[Float[np.ndarray, "s n"], Float[np.ndarray, "s"]]:
    """Distances from farthest points, over the square root of the area, and the share of the area nearest to each."""
    distances = _distances_from_farthest_points(_graph(mesh), mesh.vertices, min(SOURCES, mesh.n_vertices))
    areas = _areas(mesh)
    share = np.bincount(np.argmin(distances, axis=0), areas, len(distances)) / areas.sum()
    return distances / _size(mesh), share


def centroid_distance(mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Straight distance from the centroid of the surface to each vertex, over the square root of its area.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(1)
    >>> bool(abs(centroid_distance(Mesh(points, faces)) - centroid_distance(Mesh(7 * points + 1, faces))).max() < 1e-12)
    True
    """
    centroid = np.average(mesh.vertices, axis=0, weights=_areas(mesh))
    return np.linalg.norm(mesh.vertices - centroid, axis=1) / _size(mesh)


def _areas(mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Vertex areas; equal ones for a mesh without area."""
    return mesh.vertex_areas if mesh.area > 0 else np.ones(mesh.n_vertices)


def _size(mesh: Mesh) -> float:
    """Square root of the area; the bounding-box diagonal, or 1, where there is none."""
    return float(np.sqrt(mesh.area)) or mesh.bbox_diagonal or 1.0


def _distances_from_farthest_points(graph: sp.csr_matrix, vertices: np.ndarray, count: int) -> Float[np.ndarray, "s n"]:
    """Distances from `count` vertices, each farthest from those before; the first is farthest from the mean position."""
    rows = np.empty((count, graph.shape[0]))
    nearest = np.linalg.norm(vertices - vertices.mean(axis=0), axis=1)
    for k in range(count):
        rows[k] = dijkstra(graph, directed=True, indices=np.array([np.argmax(nearest)]))[0]
        nearest = rows[k].copy() if k == 0 else np.minimum(nearest, rows[k])
    return rows


def _graph(mesh: Mesh) -> sp.csr_matrix:
    """Edges, shortcuts across pairs of faces and bridges between parts, with their lengths."""
    pairs, lengths = _shortcuts(mesh)
    edges = np.concatenate([mesh.topology.edges, _bridges(mesh)])
    straight = np.linalg.norm(mesh.vertices[edges[:, 0]] - mesh.vertices[edges[:, 1]], axis=1)
    pairs, lengths = np.concatenate([edges, pairs]), np.concatenate([straight, lengths])
    order = np.lexsort((lengths, *pairs.T))  # the shortest of doubled pairs comes first
    pairs, lengths = pairs[order], lengths[order]
    first = np.ones(len(pairs), bool)
    first[1:] = np.any(pairs[1:] != pairs[:-1], axis=1)
    (i, j), kept = pairs[first].T, np.maximum(lengths[first], np.finfo(float).tiny)  # a stored zero would be no edge
    values, rows, columns = np.concatenate([kept, kept]), np.concatenate([i, j]), np.concatenate([j, i])
    return sp.csr_matrix((values, (rows, columns)), shape=(mesh.n_vertices, mesh.n_vertices))


def _shortcuts(mesh: Mesh) -> tuple[Int[np.ndarray, "s 2"], Float[np.ndarray, "s"]]:
    """Corners opposite a common edge, and their distance once both faces lie in one plane, where the line crosses the edge."""
    keys = np.sort(mesh.topology.halfedges, axis=1)
    order = np.lexsort(keys.T[::-1])
    same = np.all(keys[order][1:] == keys[order][:-1], axis=1)
    alone = ~np.r_[False, same[:-1]] & ~np.r_[same[1:], False] if len(same) else same
    first, second = order[:-1][same & alone], order[1:][same & alone]
    apex = np.roll(mesh.faces, -2, axis=1).ravel()  # the corner opposite half-edge 3 f + c
    i, j = apex[first], apex[second]
    along_i, away_i, _ = _unfold(mesh.vertices, keys[first], i)
    along_j, away_j, length = _unfold(mesh.vertices, keys[first], j)
    crossing = (along_i * away_j + along_j * away_i) / np.maximum(away_i + away_j, np.finfo(float).tiny)
    inside = (crossing > 0) & (crossing < length) & (i != j)
    pairs = np.sort(np.stack([i, j], axis=1)[inside], axis=1)
    return pairs, np.hypot(along_i - along_j, away_i + away_j)[inside]


def _unfold(vertices: np.ndarray, edges: np.ndarray, apex: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coordinate of the apex along the edge, its distance from the edge's line, and the edge's length."""
    edge, side = vertices[edges[:, 1]] - vertices[edges[:, 0]], vertices[apex] - vertices[edges[:, 0]]
    length = np.linalg.norm(edge, axis=1)
    along = np.einsum("kd,kd->k", edge, side) / np.maximum(length, np.finfo(float).tiny)
    away = np.sqrt(np.maximum(np.einsum("kd,kd->k", side, side) - along**2, 0))
    return along, away, length


def _bridges(mesh: Mesh) -> Int[np.ndarray, "b 2"]:
    """For each part but the one with most vertices, the shortest pair of vertices that joins it to that one."""
    label = np.asarray(connected_components(mesh.topology.adjacency, directed=False)[1])
    outside = np.nonzero(label != np.argmax(np.bincount(label)))[0]
    inside = np.setdiff1d(np.arange(mesh.n_vertices), outside)
    gap, place = map(np.asarray, cKDTree(mesh.vertices[inside]).query(mesh.vertices[outside]))
    order = np.lexsort((gap, label[outside]))
    _, first = np.unique(label[outside][order], return_index=True)
    chosen = order[first]
    return np.sort(np.stack([outside[chosen], inside[place[chosen]]], axis=1), axis=1).reshape(-1, 2)
