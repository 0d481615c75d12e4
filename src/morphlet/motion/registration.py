"""One mesh drawn onto another, given vertices that belong together: no map of the sphere is needed, holes and handles do no harm.

The source deforms so that neighbouring faces deform alike, first held by the pairs alone, then drawn more and more strongly to
the nearest vertices of the target that look the same way (Sumner and Popovic's correspondence). It need not end without folds:
what is meant to be used is which faces then lie side by side (`face_pairs`).
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from morphlet.errors import InputError, MeshError
from morphlet.motion.gradients import adjacent_faces
from morphlet.numerics.linalg import Analysis, analyse
from morphlet.numerics.rigid import rigid
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.operators import FLAT, gradient
from morphlet.surface.pairs import VertexPairs

IDENTITY = 1e-3
"""Weight of each face's deformation beside that of its differences to its neighbours' (Sumner and Popovic)."""
DRAWS = (1.0, 10.0, 100.0, 1000.0, 5000.0)
"""Weights of the nearest vertices, one after the other (Sumner and Popovic), for lengths in roots of the target's area."""
TETHER = 1e-6
"""Weight with which each vertex keeps its place: settles what no pair and no face does."""
NEAREST = 12
"""Vertices of the target among which the first is taken that looks the same way."""
FEWEST = 3
"""Pairs that determine how the source is turned first."""


def register(source: Mesh, target: Mesh, pairs: VertexPairs) -> Mesh:
    """The source drawn onto the target, paired vertices exactly onto each other.

    Parameters
    ----------
    source, target
        Any meshes with faces, in any units and positions.
    pairs
        At least three, not on one line. Of several with one source vertex the first counts; weights do not.

    Returns
    -------
    Mesh
        The source's faces, in the target's place.

    Raises
    ------
    InputError
        If the pairs do not fit the meshes, or are too few or on one line.
    MeshError
        If a mesh has no face with an area.
    SolveError
        If the system cannot be factored.

    Notes
    -----
    One sparse system in as many unknowns as there are vertices and faces, factored six times: 0.9 CPU s for 7k vertices.

    References
    ----------
    Sumner and Popovic, Deformation transfer for triangle meshes, SIGGRAPH 2004.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.motion.registration import register
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> points, faces = icosphere(2)
    >>> ball, egg = Mesh(points, faces), Mesh(points * [1, 1, 1.5], faces)
    >>> laid = register(ball, egg, VertexPairs([0, 1, 2, 3], [0, 1, 2, 3]))
    >>> bool(abs(laid.vertices - egg.vertices).max() < 0.1)
    True
    """
    held, places = _held(source, target, pairs)
    unit = float(np.sqrt(target.area))
    start, goal = source.with_vertices(_brought(source, held, places) / unit), target.with_vertices(target.vertices / unit)
    drawing = _prepare(start, held, places / unit)
    laid = drawing.solve(np.zeros(source.n_vertices), start.vertices)
    for weight in DRAWS:
        found, where = _nearest_alike(laid, goal)
        laid = drawing.solve(weight * found, where)
    return source.with_vertices(unit * laid.vertices)


@dataclass(frozen=True, eq=False)
class _Drawing:
    """The energy of the deformed vertices and of where the unit normals of the faces go, x^T A x / 2 - b^T x, on what is free.

    `lower` is the lower triangle of A, `right` is b, both without the rows of the `held` vertices, which are put at `places`.
    """

    start: Mesh
    lower: sp.csc_matrix
    right: Float[np.ndarray, "f 3"]
    analysis: Analysis
    free: Int[np.ndarray, "f"]
    held: Int[np.ndarray, "h"]
    places: Float[np.ndarray, "h 3"]

    def solve(self, weight: Float[np.ndarray, "n"], where: Float[np.ndarray, "n 3"]) -> Mesh:
        """The deformed mesh, each vertex drawn to a place with a weight of its own."""
        own = self.free[self.free < len(weight)]
        values, right = np.array(self.lower.data), np.array(self.right)
        values[self.lower.indptr[: len(own)]] += weight[own]
        right[: len(own)] += weight[own, None] * where[own]
        x = np.array(self.start.vertices)
        x[own] = self.analysis.factor(values).solve(right)[: len(own)]
        x[self.held] = self.places
        return self.start.with_vertices(x)


def _prepare(start: Mesh, held: Int[np.ndarray, "h"], places: Float[np.ndarray, "h 3"]) -> _Drawing:
    """Assemble the energy and analyse its pattern."""
    rows, identity = _deformations(start)
    differences = _differences(start) @ rows
    tether = np.zeros(rows.shape[1])
    tether[: start.n_vertices] = TETHER
    matrix = (differences.T @ differences + IDENTITY * (rows.T @ rows) + sp.diags_array(tether)).tocsc()
    right = IDENTITY * (rows.T @ identity)
    right[: start.n_vertices] += TETHER * start.vertices
    free = np.setdiff1d(np.arange(len(right)), held)
    lower = sp.tril(matrix[free][:, free], format="csc")
    lower.sort_indices()
    solid = _solid(start)
    where = np.vstack([start.vertices, start.vertices[start.faces[solid]].mean(axis=1)])
    analysis = analyse(lower.indptr, lower.indices, where[free])
    return _Drawing(start, lower, right[free] - matrix[free][:, held] @ places, analysis, free, held, places)


def _deformations(start: Mesh) -> tuple[sp.csr_matrix, Float[np.ndarray, "r 3"]]:
    """From vertices and normals to the transposed deformation gradients of the solid faces, three rows each; those of no change."""
    solid = _solid(start)
    k = len(solid)
    normals = start.face_normals[solid].ravel()
    upright = sp.csr_matrix((normals, (np.arange(3 * k), np.repeat(np.arange(k), 3))), shape=(3 * k, k))
    along = gradient(start)[(3 * solid[:, None] + np.arange(3)).ravel()]
    return sp.hstack([along, upright], format="csr"), np.tile(np.eye(3), (k, 1))


def _differences(start: Mesh) -> sp.csr_matrix:
    """From three rows per solid face to their differences between neighbours."""
    solid = _solid(start)
    pairs = adjacent_faces(Topology(start.faces[solid], start.n_vertices))
    ends = np.arange(len(pairs))
    ones = np.ones(len(pairs))
    signs = sp.csr_matrix((np.append(ones, -ones), (np.append(ends, ends), pairs.T.ravel())), shape=(len(pairs), len(solid)))
    return sp.kron(signs, sp.identity(3), format="csr")


def _solid(mesh: Mesh) -> Int[np.ndarray, "k"]:
    """Faces with an area."""
    longest = np.max(np.sum((mesh.vertices[mesh.faces] - np.roll(mesh.vertices[mesh.faces], 1, axis=1)) ** 2, axis=2), axis=1, initial=0.0)
    return np.flatnonzero(mesh.face_areas > FLAT * longest)


def _held(source: Mesh, target: Mesh, pairs: VertexPairs) -> tuple[Int[np.ndarray, "h"], Float[np.ndarray, "h 3"]]:
    """Vertices of the source that are held, in ascending order, and where."""
    pairs.checked(source, target)
    for mesh, name in ((source, "source"), (target, "target")):
        if not len(_solid(mesh)):
            raise MeshError(f"a {name} with faces that have an area", f"none among {mesh.n_faces}", "pass a mesh that has a surface")
    held, first = np.unique(pairs.source, return_index=True)
    if len(held) < FEWEST:
        raise InputError(f"at least {FEWEST} pairs with different source vertices", str(len(held)), "pair more vertices")
    return held, target.vertices[pairs.target[first]]


def _brought(source: Mesh, held: Int[np.ndarray, "h"], places: Float[np.ndarray, "h 3"]) -> Float[np.ndarray, "n 3"]:
    """The source scaled, turned and moved so that its held vertices come near their places."""
    own = source.vertices[held]
    spread, goal = (float(np.linalg.norm(x - x.mean(axis=0))) for x in (own, places))
    scale = goal / spread if spread > 0 else 1.0
    return rigid(scale * own, places)(scale * source.vertices)


def _nearest_alike(laid: Mesh, target: Mesh) -> tuple[Bool[np.ndarray, "n"], Float[np.ndarray, "n 3"]]:
    """Whether one of the nearest vertices of the target looks to the same side as a vertex, and where the first such one is."""
    there = np.flatnonzero(target.topology.referenced)
    count = min(NEAREST, len(there))
    near = there[cKDTree(target.vertices[there]).query(laid.vertices, k=np.arange(1, count + 1))[1]]
    alike = np.einsum("nkd,nd->nk", target.vertex_normals[near], laid.vertex_normals) > 0
    first = np.argmax(alike, axis=1)
    return alike.any(axis=1), target.vertices[near[np.arange(len(near)), first]]
