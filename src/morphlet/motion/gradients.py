"""The gradients of positions over the faces of a rest shape, and the positions whose gradients are nearest to given ones.

On each face of the rest shape there is a frame of two orthonormal tangents. How positions change over the face is told by two
rows, their derivatives along these tangents: the frame itself for the rest shape, a turned frame for a turned face, longer rows
for a stretched one. Faces of the rest shape without area tell nothing, and ask for nothing.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from morphlet.numerics.compiled import inlined_kernel, kernel
from morphlet.numerics.linalg import Factor, Solver, analyse
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.operators import gradient

STEEPEST = 1e8
"""How much more than the median face a sliver may weigh in the system, by the square of its steepest gradient: doubles leave
half of their digits to the others."""
SINGULAR = 1e-6
"""Share of the trace of a 2 x 2 matrix of squares at which the root of its determinant counts as zero: rounding alone makes 1e-8."""


@dataclass(frozen=True, eq=False)
class Followers:
    """The p parts of a mesh beside the largest, each hung on the face of that one at the vertex nearest to the part's centre.

    Parameters
    ----------
    parts
        Their numbers.
    hosts
        The face that each hangs on.
    over
        (p, m) matrix from values on the faces to their mean over each part less that on its host; zero for lone vertices.
    reach
        (p, n) matrix from positions to how far each part lies from its host, by centroids of faces, or by vertices if it has none.
    part
        Number of the part of each vertex.
    """

    parts: Int[np.ndarray, "p"]
    hosts: Int[np.ndarray, "p"]
    over: sp.csr_matrix
    reach: sp.csr_matrix
    part: Int[np.ndarray, "n"]

    def placed(self, positions: Float[np.ndarray, "n 3"], offsets: Float[np.ndarray, "p 3"]) -> Float[np.ndarray, "n 3"]:
        """The positions with these parts moved so far from their hosts."""
        shift = np.zeros((self.part.max(initial=0) + 1, 3))
        shift[self.parts] = offsets - self.reach @ positions
        return positions + shift[self.part]


@dataclass(frozen=True, eq=False)
class GradientSystem:
    """Positions from their gradients, in the least squares sense: factored once, for any number of gradients.

    Minimises the weighted sum over the faces of the squared differences between the gradients of the positions and those
    wanted. Gradients do not tell where a part lies: each part keeps the mean of its vertices at rest. Vertices without a face
    that has an area are parts of their own.

    Parameters
    ----------
    rest
        The rest shape.
    weight
        Of each face.
    frames
        Two orthonormal tangents of each face, as rows.
    operator
        (2m, n) matrix from values at the vertices to their derivatives along the tangents.
    gather
        (n, 2m) matrix from wanted derivatives to the right-hand side: the weighted transpose.
    factor
        Of the system without one vertex per part.
    free
        The other vertices.
    early
        The same, as the factor eliminates them.
    part
        Number of the part of each vertex.
    mean
        (parts, n) matrix to the means over the parts.
    """

    rest: Mesh
    weight: Float[np.ndarray, "m"]
    frames: Float[np.ndarray, "m 2 3"]
    operator: sp.csr_matrix
    gather: sp.csr_matrix
    factor: Factor
    free: Int[np.ndarray, "f"]
    early: Int[np.ndarray, "f"]
    part: Int[np.ndarray, "n"]
    mean: sp.csr_matrix

    @staticmethod
    def prepare(rest: Mesh, weight: Float[np.ndarray, "m"]) -> "GradientSystem":
        """Factor the system of a rest shape.

        Parameters
        ----------
        rest
            Any mesh.
        weight
            Positive weight of each face; those of extreme slivers are lowered until the system can be solved.

        Raises
        ------
        SolveError
            If the system cannot be factored.

        Notes
        -----
        0.1 CPU s for 8k vertices.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.motion.gradients import GradientSystem
        >>> from morphlet.numerics.unit_sphere import icosphere
        >>> ball = Mesh(*icosphere(2))
        >>> system = GradientSystem.prepare(ball, ball.face_areas)
        >>> bool(abs(system.solve(2 * system.frames) - 2 * ball.vertices).max() < 1e-12)
        True
        """
        frames = tangent_frames(rest)
        operator = tangential(rest, frames)
        weight = _bounded(operator, weight)
        gather = (operator.T @ sp.diags_array(np.repeat(weight, 2))).tocsr()
        part, free, mean = _parts(rest, operator)
        lower = sp.tril((gather @ operator).tocsr()[free][:, free], format="csc")
        lower.sort_indices()
        analysis = analyse(lower.indptr, lower.indices, rest.vertices[free] if len(free) else None)
        return GradientSystem(rest, weight, frames, operator, gather, analysis.factor(lower.data), free, free[analysis.order], part, mean)

    @cached_property
    def followers(self) -> Followers:
        """The parts beside that of the largest area."""
        told, owner = _told(self.operator), self.part[self.rest.faces[:, 0]]
        n_parts, m = self.mean.shape[0], self.rest.n_faces
        main = int(np.argmax(np.bincount(owner[told], self.rest.face_areas[told], minlength=n_parts)))
        parts = np.delete(np.arange(n_parts), main) if told.any() else np.zeros(0, np.int64)
        hosts = self._hosts(parts, np.flatnonzero(told & (owner == main)))
        counts, corners = np.bincount(owner[told], minlength=n_parts), self.rest.faces.ravel()
        inside = sp.csr_matrix((told / np.maximum(counts, 1)[owner], (owner, np.arange(m))), shape=(n_parts, m))[parts]
        over = inside - sp.csr_matrix((np.ones(len(parts)), (np.arange(len(parts)), hosts)), shape=inside.shape)
        centroids = sp.csr_matrix((np.full(3 * m, 1 / 3), (np.repeat(np.arange(m), 3), corners)), shape=(m, self.rest.n_vertices))
        lone = sp.diags_array((counts[parts] == 0).astype(float))
        reach = over @ centroids + lone @ self.mean[parts]
        return Followers(parts, hosts, sp.csr_matrix(over - lone @ over), sp.csr_matrix(reach), self.part)

    def _hosts(self, parts: Int[np.ndarray, "p"], faces: Int[np.ndarray, "f"]) -> Int[np.ndarray, "p"]:
        """Of these faces the one at the vertex nearest to each part."""
        if not len(parts):
            return np.zeros(0, np.int64)
        corners, first = np.unique(self.rest.faces[faces], return_index=True)
        near = cKDTree(self.rest.vertices[corners]).query((self.mean @ self.rest.vertices)[parts])[1]
        return faces[first[near] // 3]

    def gradients(self, positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 2 3"]:
        """Derivatives of the positions along the two tangents of each face."""
        return (self.operator @ positions).reshape(-1, 2, 3)

    def solve(self, wanted: Float[np.ndarray, "m 2 3"]) -> Float[np.ndarray, "n 3"]:
        """The positions whose gradients are nearest to those wanted; the mean of each part is that at rest.

        Notes
        -----
        2 CPU ms for 8k vertices.
        """
        return self.spread(self.gather @ wanted.reshape(-1, 3)) + self.means(self.rest.vertices)

    @cached_property
    def _rough(self) -> tuple[Solver, sp.csr_matrix]:
        """A solver of single precision for unknowns as they are eliminated, and their system."""
        system = (self.gather[self.early] @ self.operator)[:, self.early]
        return self.factor.rough() if len(self.early) else np.array, sp.csr_matrix(system)

    @cached_property
    def bases(self) -> Float[np.ndarray, "m 3"]:
        """Entries 00, 01, 11 of the inverse of the matrix whose columns are the first two edges of each face, along its tangents.

        Zero where gradients tell nothing.
        """
        a, b, c = (self.rest.vertices[self.rest.faces[:, k]] for k in range(3))
        first, second = self.frames[:, 0], self.frames[:, 1]
        x1, x2, y2 = (np.einsum("fd,fd->f", side, axis) for side, axis in ((b - a, first), (c - a, first), (c - a, second)))
        solid = _told(self.operator) & (x1 > 0) & (y2 > 0)
        x1, y2 = np.where(solid, x1, 1.0), np.where(solid, y2, 1.0)
        return np.stack([1 / x1, -x2 / (x1 * y2), 1 / y2], axis=1) * solid[:, None]

    @cached_property
    def _corners(self) -> tuple[Int[np.ndarray, "m 3"], Float[np.ndarray, "m"]]:
        """Faces and weights that may be written: read-only arrays would compile a kernel a second time."""
        return np.array(self.rest.faces), np.array(self.weight)

    def swift(self, forces: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """`spread` to ten digits, and up to a translation of each part.

        Notes
        -----
        Two solves of single precision, the second for what the first left: half the time of one of double precision.
        """
        solver, system = self._rough
        right, moved = forces[self.early], np.zeros(forces.shape)
        way = solver(right)
        moved[self.early] = way + solver(right - system @ way)
        return moved

    def forces(
        self, x: Float[np.ndarray, "n 3"], shapes: Float[np.ndarray, "m 2 2"], wanted: Float[np.ndarray, "m 2 3"]
    ) -> Float[np.ndarray, "n 3"]:
        """What pulls the vertices to where each face has its shape, turned as near as it gets to its gradients.

        Parameters
        ----------
        x
            Positions.
        shapes
            Rows in the plane.
        wanted
            Takes the turned shapes; kept where no turn is nearest.
        """
        out = np.zeros(x.shape)
        _pull(x, self._corners[0], self.bases, self._corners[1], shapes, wanted, out)
        return out

    def spread(self, forces: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """The displacements that forces at the vertices cause: smooth ones, whose means over the parts are zero."""
        moved = np.zeros(forces.shape)
        moved[self.free] = self.factor.solve(forces[self.free])
        return moved - self.means(moved)

    def means(self, values: Float[np.ndarray, "n k"]) -> Float[np.ndarray, "n k"]:
        """For each vertex the mean of the values over its part."""
        return (self.mean @ values)[self.part]


def tangent_frames(mesh: Mesh) -> Float[np.ndarray, "m 2 3"]:
    """Two orthonormal tangents of each face as rows, the first along its first edge; zero where a face has no area.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> tangent_frames(Mesh([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    array([[[1., 0., 0.],
            [0., 1., 0.]]])
    """
    edge = mesh.vertices[mesh.faces[:, 1]] - mesh.vertices[mesh.faces[:, 0]]
    length = np.linalg.norm(edge, axis=1, keepdims=True)
    solid = (mesh.face_areas > 0)[:, None]
    first = np.divide(edge, length, out=np.zeros_like(edge), where=solid & (length > 0))
    return np.stack([first, np.cross(mesh.face_normals, first)], axis=1)


def tangential(mesh: Mesh, frames: Float[np.ndarray, "m 2 3"]) -> sp.csr_matrix:
    """(2m, n) matrix from values at the vertices to their derivatives along two tangents of each face.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> triangle = Mesh([[0, 0, 0], [2, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> tangential(triangle, tangent_frames(triangle)) @ np.array([0.0, 2.0, 3.0])
    array([1., 3.])
    """
    operator = sp.csr_matrix(_along(frames) @ gradient(mesh))
    operator.eliminate_zeros()
    return operator


def turned(gradients: Float[np.ndarray, "m 2 3"], shapes: Float[np.ndarray, "m 2 2"], before: Float[np.ndarray, "m 2 3"]) -> np.ndarray:
    """Each plane shape turned in space as near as it gets to the gradients; those before, where no turn is nearest.

    Parameters
    ----------
    gradients
        Rows to come near to.
    shapes
        Rows in the plane.
    before
        What to keep where the gradients or the shape are flat.

    Examples
    --------
    >>> turned(np.array([[[0.0, 5.0, 0.0], [0.0, 0.0, 7.0]]]), np.eye(2)[None], np.zeros((1, 2, 3)))
    array([[[0., 1., 0.],
            [0., 0., 1.]]])
    """
    out = np.array(before)
    _turn(np.ascontiguousarray(gradients), np.ascontiguousarray(shapes), out)
    return out


def adjacent_faces(topology: Topology) -> Int[np.ndarray, "k 2"]:
    """Faces with a common edge, pair by pair; those around an edge of more than two faces in a row.

    Examples
    --------
    >>> adjacent_faces(Topology([[0, 1, 2], [2, 1, 3]], 4))
    array([[0, 1]])
    """
    ends = np.sort(topology.halfedges, axis=1)
    order = np.lexsort((ends[:, 1], ends[:, 0]))
    same = (ends[order][1:] == ends[order][:-1]).all(axis=1)
    return np.stack([order[:-1][same] // 3, order[1:][same] // 3], axis=1)


def _along(frames: Float[np.ndarray, "m 2 3"]) -> sp.csr_matrix:
    """(2m, 3m) matrix from vectors on the faces to their products with the tangents."""
    m = len(frames)
    columns = np.repeat(np.arange(3 * m).reshape(m, 3), 2, axis=0).ravel()
    return sp.csr_matrix((frames.ravel(), columns, np.arange(0, 6 * m + 1, 3)), shape=(2 * m, 3 * m))


def _bounded(operator: sp.csr_matrix, weight: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    """The weights, lowered where a sliver would drown the others."""
    steepest = np.asarray((operator.multiply(operator)).max(axis=1).todense()).reshape(-1, 2).max(axis=1, initial=0.0)
    demand = weight * steepest
    if not (demand > 0).any():
        return np.asarray(weight)
    most = STEEPEST * np.median(demand[demand > 0])
    return np.where(demand > most, most / np.where(steepest > 0, steepest, 1.0), weight)


def _told(operator: sp.csr_matrix) -> Bool[np.ndarray, "m"]:
    """Which faces have a row that is not zero."""
    return np.diff(operator.indptr).reshape(-1, 2).sum(axis=1) > 0


def _parts(rest: Mesh, operator: sp.csr_matrix) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "f"], sp.csr_matrix]:
    """Part of each vertex, all vertices but the first of each part, and the matrix to the means over the parts."""
    graph = Topology(rest.faces[_told(operator)], rest.n_vertices).adjacency
    count, part = connected_components(graph, directed=False)
    pinned = np.unique(part, return_index=True)[1]
    free = np.setdiff1d(np.arange(rest.n_vertices), pinned)
    share = 1 / np.bincount(part, minlength=count)[part]
    mean = sp.csr_matrix((share, (part, np.arange(rest.n_vertices))), shape=(count, rest.n_vertices))
    return part.astype(np.int64), free, mean


@inlined_kernel
def _turn_face(gradients, shapes, out, f):  # type: ignore[no-untyped-def]
    # gradients (m, 2, 3), shapes (m, 2, 2), out (m, 2, 3). With M = S^T J the nearest pair of orthonormal rows is Q = C^(-1/2) M,
    # C = M M^T, and out = S Q. For 2 x 2 matrices, s = sqrt(det C): C^(-1/2) = adj(C + s I) / (s sqrt(tr C + 2 s)).
    a, b, c, d = shapes[f, 0, 0], shapes[f, 0, 1], shapes[f, 1, 0], shapes[f, 1, 1]
    p = q = r = 0.0
    for k in range(3):
        m, n = a * gradients[f, 0, k] + c * gradients[f, 1, k], b * gradients[f, 0, k] + d * gradients[f, 1, k]
        p += m * m
        q += m * n
        r += n * n
    s = np.sqrt(max(p * r - q * q, 0.0))
    if s > SINGULAR * (p + r):
        scale = 1 / (s * np.sqrt(p + r + 2 * s))
        for k in range(3):
            m, n = a * gradients[f, 0, k] + c * gradients[f, 1, k], b * gradients[f, 0, k] + d * gradients[f, 1, k]
            x, y = scale * ((r + s) * m - q * n), scale * ((p + s) * n - q * m)
            out[f, 0, k], out[f, 1, k] = a * x + b * y, c * x + d * y


@kernel
def _turn(gradients, shapes, out):  # type: ignore[no-untyped-def]
    # gradients (m, 2, 3), shapes (m, 2, 2), out (m, 2, 3).
    for f in range(len(gradients)):
        _turn_face(gradients, shapes, out, f)


@kernel
def _pull(x, faces, bases, weight, shapes, wanted, out):  # type: ignore[no-untyped-def]
    # x (n, 3), faces (m, 3), bases (m, 3), weight (m,), shapes (m, 2, 2), wanted (m, 2, 3), out (n, 3) of zeros.
    own = np.empty(wanted.shape)
    for f in range(len(faces)):
        i, j, l = faces[f, 0], faces[f, 1], faces[f, 2]
        d, e, h = bases[f, 0], bases[f, 1], bases[f, 2]
        for k in range(3):
            first = x[j, k] - x[i, k]
            own[f, 0, k], own[f, 1, k] = d * first, e * first + h * (x[l, k] - x[i, k])
        _turn_face(own, shapes, wanted, f)
        d, e, h = d * weight[f], e * weight[f], h * weight[f]
        for k in range(3):
            first, second = wanted[f, 0, k] - own[f, 0, k], wanted[f, 1, k] - own[f, 1, k]
            toward, beside = d * first + e * second, h * second
            out[i, k] -= toward + beside
            out[j, k] += toward
            out[l, k] += beside
