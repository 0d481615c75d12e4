"""How far the surface of a mesh is from another's: what modes that change vertices and faces are held to.

Points are spread evenly over each surface, and their distances to the other taken; the larger of both directions counts.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest
from morphlet.surface.points import SurfacePoints

SAMPLES = 20_000
"""Points on each surface: two draws of the root mean square differ by a percent or two."""


@dataclass(frozen=True)
class SurfaceError:
    """Distances between two surfaces, in mesh units.

    Parameters
    ----------
    rms
        Root mean square over points spread evenly, the larger of both directions.
    hausdorff
        Largest of these points and of all vertices, in both directions.
    """

    rms: float
    hausdorff: float


def surface_error(first: Mesh, second: Mesh) -> SurfaceError:
    """Distances between the surfaces of two meshes, the same at each call.

    Raises
    ------
    MeshError
        If a mesh has no faces.

    Notes
    -----
    O((m + k) log m), k = 20,000 points and the vertices of each.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.codec.surface_error import surface_error
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> raised = surface_error(triangle, triangle.with_vertices(triangle.vertices + [0, 0, 3]))
    >>> round(raised.rms, 9), round(raised.hausdorff, 9)
    (3.0, 3.0)
    """
    squares, largest = [], []
    for a, b in ((first, second), (second, first)):
        points = spread(a)
        everywhere = np.concatenate([points, a.vertices[a.topology.referenced]])
        distance = np.linalg.norm(nearest(b, everywhere).positions(b) - everywhere, axis=1)
        squares.append(float(np.mean(distance[: len(points)] ** 2)))
        largest.append(float(distance.max()))
    return SurfaceError(float(np.sqrt(max(squares))), max(largest))


def farthest(first: Mesh, second: Mesh) -> float:
    """The farthest that a vertex of either mesh lies from the other's surface; from its vertices, in pairs, where it has no faces.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.codec.surface_error import farthest
    >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> farthest(triangle, triangle.with_vertices(triangle.vertices + [0, 0, 3]))
    3.0
    """
    if not first.n_faces or not second.n_faces:
        return float(np.linalg.norm(first.vertices - second.vertices, axis=1).max())
    largest = 0.0
    for a, b in ((first, second), (second, first)):
        points = a.vertices[a.topology.referenced]
        largest = max(largest, float(np.linalg.norm(nearest(b, points).positions(b) - points, axis=1).max()))
    return largest


def spread(mesh: Mesh) -> Float[np.ndarray, "k 3"]:
    """Points of a surface, one in each of equal shares of its area; at the vertices of one that has none."""
    total = mesh.face_areas.sum()
    if not total > 0:
        return mesh.vertices[mesh.topology.referenced]
    rng = np.random.default_rng(0)
    place = (np.arange(SAMPLES) + rng.random(SAMPLES)) / SAMPLES * total
    faces = np.minimum(np.searchsorted(np.cumsum(mesh.face_areas), place), mesh.n_faces - 1)
    root, share = np.sqrt(rng.random(SAMPLES)), rng.random(SAMPLES)
    weights = np.stack([1 - root, root * (1 - share), root * share], axis=1)
    return SurfacePoints(faces, weights).positions(mesh)
