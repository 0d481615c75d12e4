"""Linear editing: the displacement that changes the differential coordinates of a region least.

Each method is a quadratic energy ``d^T K d / 2`` of the displacements d with K V = 0 or V left out of it, so that a handle that
stays moves nothing. It is factored once per region; a pull costs one back-substitution. Hard handle vertices are put on
their targets, soft ones pay ``weight K_hh |d - t|^2 / 2``, anchors do not move. A linear method does not know large
rotations: beyond some 60 degrees it shears; `EstimatedRotations` and `Arap` turn.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components

from morphlet import _arrays
from morphlet.editing.method import Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError, MeshError, SolveError
from morphlet.numerics.linalg import Factor, factorize
from morphlet.numerics.optimize import OnStep, Step
from morphlet.surface.mesh import Mesh
from morphlet.surface.operators import laplacian

Weights = Literal["cotangent", "clamped"]
"""Cotangent weights of the edges as they are, or at least `LEAST_WEIGHT`."""

MOST_ITERATIONS = 10_000
"""Some thousand times what helps."""
LEAST_WEIGHT = 1e-6
"""Positive, so that no edge pushes; far below the weight 0.58 of an equilateral triangle's edge."""
COLLINEAR = 1e-9
"""Share of the largest moment of inertia below which a vertex and its neighbours lie on one line: no rotation about it is seen."""
THIN = 1e-6
"""Double area of three neighbouring centres over their longest distance squared, below which they span no plane."""
SINGULAR = 1e14
"""Growth of a solution (relative to right-hand side and matrix) that leaves no digit right in double precision."""


@dataclass(frozen=True, eq=False)
class Laplacian:
    """Harmonic or biharmonic displacements: least change of shape to first or second order.

    Parameters
    ----------
    order
        1: harmonic, a membrane, with a kink at the handle; 2: biharmonic, a thin plate, smooth there.
    weights
        Of the edges. Unclamped cotangents are right for every triangulation, since both energies stay convex with them;
        clamped ones keep the harmonic displacement between those of handle and anchors. On a horse with 17.8 percent of negative
        weights, one leg pulled and turned by 60 degrees: biharmonic, unclamped, a Laplacian error of 2.1 percent and no crossing
        triangles; clamped, 16.4 percent and 155 pairs.

    Notes
    -----
    Translations of the handle keep all details in their direction; rotations do not turn them. Preparing costs a
    sparse factorization of the region, a pull one solve with three right-hand sides.

    References
    ----------
    Botsch and Kobbelt, An intuitive framework for real-time freeform modeling, ACM Transactions on Graphics 23, 2004.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.linear import Laplacian
    >>> from morphlet.editing.method import Pull
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> prepared = Laplacian(order=1).prepare(Roi(strip, [4, 5], [2, 3]))
    >>> prepared(Pull(np.array([[0, 2, 1.0], [1, 2, 1.0]]))).round(12)[:, 2]
    array([0.5, 0.5, 1. , 1. ])
    """

    order: Literal[1, 2] = 2
    weights: Weights = "cotangent"

    def __post_init__(self) -> None:
        if self.order not in (1, 2):
            raise InputError("order 1 (harmonic) or 2 (biharmonic)", repr(self.order), "choose one of these")
        if self.weights not in get_args(Weights):
            raise InputError(f"one of {', '.join(get_args(Weights))} as weights", repr(self.weights), "choose one of these")

    def prepare(self, roi: Roi) -> Prepared:
        """Factor the Laplacian, or its square, of the region.

        Raises
        ------
        MeshError
            If a piece of the region touches neither the handle nor an anchor.
        SolveError
            If the region does not determine its deformation.
        """
        patch = surroundings(roi)
        matrix = laplacian(patch.mesh) if self.weights == "cotangent" else _clamped(laplacian(patch.mesh))
        if self.order == 2:
            rows = sp.diags(inverse_root_areas(patch)) @ matrix
            matrix = (rows.T @ rows).tocsr()
        return _factored(roi, patch, matrix)


@dataclass(frozen=True, eq=False)
class SimilarityLaplacian:
    """Laplacian coordinates that may turn by a small angle and grow with their surroundings.

    Around each vertex the similarity that fits the displaced neighbours best is itself linear in their positions, as long
    as rotations are small; the Laplacian coordinate is compared after that similarity. So all similarities of small angle are
    free, and details turn up to about a right angle.

    Notes
    -----
    A rotation by the angle a comes out with the exact one's effect only to first order: it grows by sqrt(1 + tan^2 a).
    Three coupled unknowns per vertex: some nine times the memory of `Laplacian`.

    References
    ----------
    Sorkine, Cohen-Or, Lipman, Alexa, Rossl and Seidel, Laplacian surface editing, Symposium on Geometry Processing 2004.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.linear import SimilarityLaplacian
    >>> from morphlet.editing.method import Pull
    >>> from morphlet.editing.roi import Roi
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(1))
    >>> roi = Roi(ball, np.arange(10), np.arange(10, 42))
    >>> twice = SimilarityLaplacian().prepare(roi)(Pull(2 * ball.vertices[:10]))
    >>> bool(np.allclose(twice, 2 * ball.vertices))
    True
    """

    def prepare(self, roi: Roi) -> Prepared:
        """Factor the normal equations of the region.

        Raises
        ------
        MeshError
            If a piece of the region touches neither the handle nor an anchor.
        SolveError
            If the region does not determine its deformation, such as held in fewer than three places that are not on a line.
        """
        patch = surroundings(roi)
        rows = _similarity_rows(patch)
        return _factored(roi, patch, (rows.T @ rows).tocsr())


@dataclass(frozen=True, eq=False)
class DualLaplacian:
    """Laplacian coordinates on the dual mesh: the heights of face centres over their three neighbours.

    Each face centre has three neighbours, so its coordinate is a height along the normal of these: it has no tangential
    part that would depend on how the surface is cut into triangles.

    Parameters
    ----------
    iterations
        How often the heights are put on the normals of the deformed surface and solved for again; 0 is the linear method.

    Notes
    -----
    Each iteration is one more back-substitution. Faces at a border of the mesh, or with neighbours on one line, keep the
    vector to the mean of their neighbours.

    References
    ----------
    Au, Tai, Liu and Fu, Dual Laplacian editing for meshes, IEEE Transactions on Visualization and Computer Graphics 12, 2006.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.linear import DualLaplacian
    >>> from morphlet.editing.method import Pull
    >>> from morphlet.editing.roi import Roi
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(1))
    >>> roi = Roi(ball, np.arange(10), np.arange(10, 42))
    >>> moved = DualLaplacian().prepare(roi)(Pull(ball.vertices[:10] + 1))
    >>> bool(np.allclose(moved, ball.vertices + 1))
    True
    """

    iterations: int = 0

    def __post_init__(self) -> None:
        if not 0 <= self.iterations <= MOST_ITERATIONS:
            raise InputError(f"a number of iterations from 0 to {MOST_ITERATIONS}", repr(self.iterations), "pass 0 for the linear method")

    def prepare(self, roi: Roi) -> Prepared:
        """Factor the normal equations of the dual mesh of the region.

        Raises
        ------
        MeshError
            If a piece of the region touches neither the handle nor an anchor, or the region is not manifold and oriented.
        SolveError
            If the region does not determine its deformation.
        """
        patch = surroundings(roi)
        dual = _dual(patch)
        linear = _factored(roi, patch, (dual.rows.T @ dual.rows).tocsr())
        return _Turning(linear, patch, dual, self.iterations) if self.iterations else linear


@dataclass(frozen=True, eq=False)
class Surroundings:
    """The unknown vertices of an edit with two rings around them: what their energies need.

    `vertices` are the numbers in the whole mesh, `unknown`, `handle` and `cells` those in the patch; cells have all their faces here.
    """

    mesh: Mesh
    vertices: Int[np.ndarray, "p"]
    unknown: Int[np.ndarray, "u"]
    handle: Int[np.ndarray, "h"]
    cells: Bool[np.ndarray, "p"]


@dataclass(frozen=True, eq=False)
class _Linear:
    """A factored energy: displacements from those of the handle. `pull` holds the right-hand side of each of them."""

    roi: Roi
    unknown: Int[np.ndarray, "u"]
    factor: Factor
    pull: sp.csr_matrix

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`."""
        return self.moved(pull, np.zeros((len(self.unknown), 3)))

    def moved(self, pull: Pull, force: Float[np.ndarray, "u 3"]) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving` with a force on the unknowns."""
        targets = _arrays.real(pull.targets, "targets", (len(self.roi.handle), 3))
        columns = (-1, 3) if self.factor.n == len(self.unknown) else (-1,)
        shift = (targets - self.roi.mesh.vertices[self.roi.handle]).reshape(columns)
        positions = np.array(self.roi.mesh.vertices[self.roi.moving])
        positions[np.searchsorted(self.roi.moving, self.roi.handle)] = targets
        if len(self.unknown):
            here = np.searchsorted(self.roi.moving, self.unknown)
            step = self.factor.solve(self.pull @ shift + force.reshape(columns))
            positions[here] = self.roi.mesh.vertices[self.unknown] + step.reshape(-1, 3)
        return positions


@dataclass(frozen=True, eq=False)
class _Dual:
    """Dual Laplacian of a patch: `rows` @ V are the dual coordinates, those in `tall` are heights over the `around` faces."""

    rows: sp.csr_matrix
    tall: Int[np.ndarray, "t"]
    around: Int[np.ndarray, "t 3"]
    height: Float[np.ndarray, "t"]


@dataclass(frozen=True, eq=False)
class _Turning:
    """The dual Laplacian with heights that follow the normals."""

    linear: _Linear
    patch: Surroundings
    dual: _Dual
    iterations: int

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`."""
        roi = self.linear.roi
        whole = np.array(roi.mesh.vertices)
        rest = _dual_normals(self.patch.mesh, self.patch.mesh.vertices, self.dual.around)
        positions = self.linear(pull)
        for iteration in range(self.iterations):
            whole[roi.moving] = positions
            turned = _dual_normals(self.patch.mesh, whole[self.patch.vertices], self.dual.around) - rest
            change = np.zeros((self.dual.rows.shape[0], 3))
            change[self.dual.tall] = self.dual.height[:, None] * turned
            before, positions = positions, self.linear.moved(pull, (self.dual.rows.T @ change)[self.patch.unknown])
            if on_step is not None:
                length = float(np.abs(positions - before).max(initial=0.0))
                on_step(Step("dual Laplacian", iteration, length, length, True, (iteration + 1) / self.iterations))
        return positions


def surroundings(roi: Roi) -> Surroundings:
    """Cut out the unknowns, the ring around them, and the faces of both."""
    mesh = roi.mesh
    local = np.zeros(mesh.n_vertices, bool)
    local[roi.free] = True
    local[roi.handle[np.isfinite(hold(roi))]] = True
    unknown, cells = np.nonzero(local)[0], local
    cells[mesh.faces[local[mesh.faces].any(axis=1)]] = True
    faces = mesh.faces[cells[mesh.faces].any(axis=1)]
    vertices = np.union1d(np.union1d(faces, unknown), roi.handle)
    number = np.full(mesh.n_vertices, -1, np.int64)
    number[vertices] = np.arange(len(vertices))
    return Surroundings(Mesh(mesh.vertices[vertices], number[faces]), vertices, number[unknown], number[roi.handle], cells[vertices])


def hold(roi: Roi) -> Float[np.ndarray, "h"]:
    """Weight of each handle vertex, infinite where it is hard."""
    return np.full(len(roi.handle), np.inf) if roi.weight is None else np.asarray(roi.weight, np.float64)


def _factored(roi: Roi, patch: Surroundings, matrix: sp.csr_matrix) -> _Linear:
    """Factor the energy with this matrix (p, p), or (3p, 3p) if it couples the coordinates."""
    size = matrix.shape[0] // patch.mesh.n_vertices
    unknown, handle = entries(patch.unknown, size), entries(patch.handle, size)
    rows = matrix[unknown]
    spring = springs(roi, patch, matrix, size)
    stiffness = (rows[:, unknown] + sp.diags(np.asarray(spring.sum(axis=1)).ravel())).tocsc()
    require_held(patch, rows, spring, size)
    hard = np.repeat(np.isinf(hold(roi)), size)
    pull = (spring - rows[:, handle] @ sp.diags(hard.astype(float))).tocsr()
    return _Linear(roi, patch.vertices[patch.unknown], determined(patch, stiffness), pull)


def springs(roi: Roi, patch: Surroundings, matrix: sp.csr_matrix, size: int) -> sp.csr_matrix:
    """Stiffness with which each unknown (row) is drawn by each handle vertex (column): its weight times its diagonal entry."""
    unknown, handle = entries(patch.unknown, size), entries(patch.handle, size)
    weight = np.repeat(hold(roi), size)
    soft = np.nonzero(np.isfinite(weight))[0]
    stiffness = weight[soft] * matrix.diagonal()[handle[soft]]
    return sp.csr_matrix((stiffness, (np.searchsorted(unknown, handle[soft]), soft)), (len(unknown), len(handle)))


def entries(vertices: Int[np.ndarray, "k"], size: int) -> Int[np.ndarray, "s"]:
    """Rows of a matrix with `size` unknowns per vertex."""
    return (size * vertices[:, None] + np.arange(size)).ravel()


def require_held(patch: Surroundings, rows: sp.csr_matrix, spring: sp.csr_matrix, size: int) -> None:
    """Refuse unknowns from which no chain of entries leads to a fixed vertex or a spring."""
    unknown = entries(patch.unknown, size)
    piece = connected_components(rows[:, unknown], directed=False)[1]
    fixed = np.ones(rows.shape[1], bool)
    fixed[unknown] = False
    held = (abs(rows) @ fixed.astype(float) > 0) | (np.asarray(spring.sum(axis=1)).ravel() > 0)
    loose = ~np.isin(piece, piece[held])
    if loose.any():
        vertices = np.unique(patch.vertices[unknown[loose] // size])
        found = f"{len(np.unique(piece[loose]))} pieces of {len(vertices)} vertices in all that touch neither"
        advice = "take them out of the region, or anchor one vertex of each"
        raise MeshError("free pieces that touch the handle or an anchor", found, advice, vertices)


def determined(patch: Surroundings, matrix: sp.csc_matrix) -> Factor:
    """The factor of a matrix, refused where its solutions have no digit right."""
    if not matrix.shape[0]:
        return Factor(0, 0, np.array)
    needed, advice = "a region that determines its deformation", "hold more vertices, or repair faces without area"
    try:
        factor = factorize(matrix, patch.mesh.vertices[patch.unknown])
    except SolveError as error:
        places = patch.vertices[patch.unknown[np.array(error.elements, np.int64) * len(patch.unknown) // matrix.shape[0]]]
        raise SolveError(needed, f"a singular one ({error.found})", advice, places) from error
    growth = float(np.abs(factor.solve(_anything(matrix.shape[0]))).max() * matrix.diagonal().max())
    if not growth < SINGULAR:
        raise SolveError(needed, f"one in which a unit force moves {growth:.1g} times too far", advice)
    return factor


def _anything(n: int) -> Float[np.ndarray, "n"]:
    """Numbers of size one that are orthogonal to nothing in particular."""
    return np.random.default_rng(0).uniform(0.5, 1.0, n) * np.random.default_rng(1).choice([-1.0, 1.0], n)


def _clamped(matrix: sp.csr_matrix) -> sp.csr_matrix:
    """The Laplacian with edge weights of at least `LEAST_WEIGHT`."""
    edges = sp.coo_matrix(matrix)
    off = edges.row != edges.col
    weight = np.maximum(-edges.data[off], LEAST_WEIGHT)
    graph = sp.csr_matrix((weight, (edges.row[off], edges.col[off])), shape=matrix.shape)
    return (sp.diags(np.asarray(graph.sum(axis=1)).ravel()) - graph).tocsr()


def inverse_root_areas(patch: Surroundings) -> Float[np.ndarray, "p"]:
    """Area^(-1/2) of the cells; zero elsewhere, where rows of the Laplacian are incomplete, and without area."""
    area = patch.mesh.vertex_areas
    return np.divide(1.0, np.sqrt(area), out=np.zeros_like(area), where=patch.cells & (area > 0))


def _similarity_rows(patch: Surroundings) -> sp.csr_matrix:
    """(3c, 3p) matrix of Laplacian coordinates minus what the best small similarity makes of those at rest."""
    V, cells = patch.mesh.vertices, np.nonzero(patch.cells & (patch.mesh.vertex_areas > 0))[0]
    if not len(cells):
        return sp.csr_matrix((0, 3 * len(V)))
    full = laplacian(patch.mesh)
    near = sp.coo_matrix((patch.mesh.topology.adjacency + sp.identity(len(V), format="csr"))[cells])
    i, j = near.row, near.col
    count = np.bincount(i, minlength=len(cells))
    arms = V[j] - (_sums(V[j], i, len(cells)) / count[:, None])[i]
    square = _sums(np.sum(arms**2, axis=1)[:, None], i, len(cells))[:, :, None]
    inertia = square * np.eye(3) - _sums((arms[:, :, None] * arms[:, None, :]).reshape(-1, 9), i, len(cells)).reshape(-1, 3, 3)
    delta = (full @ V)[cells]
    turn = _crossing(delta) @ np.linalg.pinv(inertia, rcond=COLLINEAR, hermitian=True)
    grow = delta / square[:, :, 0]
    blocks = np.asarray(full[cells[i], j]).reshape(-1, 1, 1) * np.eye(3)
    blocks = blocks - grow[i][:, :, None] * arms[:, None, :] + turn[i] @ _crossing(arms)
    blocks *= inverse_root_areas(patch)[cells[i], None, None]
    row, column = 3 * i[:, None, None] + np.arange(3)[:, None], 3 * j[:, None, None] + np.arange(3)
    entries = (blocks.ravel(), (np.broadcast_to(row, blocks.shape).ravel(), np.broadcast_to(column, blocks.shape).ravel()))
    return sp.csr_matrix(entries, shape=(3 * len(cells), 3 * len(V)))


def _sums(values: Float[np.ndarray, "e d"], group: Int[np.ndarray, "e"], n: int) -> Float[np.ndarray, "n d"]:
    """Sum of the rows of each group."""
    return sp.csr_matrix((np.ones(len(group)), (group, np.arange(len(group)))), (n, len(group))) @ values


def _crossing(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The matrices with ``M x = v x x`` (cross product)."""
    x, y, z = vectors.T
    zero = np.zeros_like(x)
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=1).reshape(-1, 3, 3)


def _dual(patch: Surroundings) -> _Dual:
    """The dual Laplacian of the faces with an unknown, and of their neighbours."""
    faces, m = patch.mesh.faces, patch.mesh.n_faces
    free = np.zeros(patch.mesh.n_vertices, bool)
    free[patch.unknown] = True
    across = np.where(patch.mesh.topology.twins < 0, -1, patch.mesh.topology.twins // 3).reshape(m, 3)
    own = free[faces].any(axis=1)
    chosen = np.nonzero(own | (own[across] & (across >= 0)).any(axis=1))[0]
    around = across[chosen]
    mean = np.divide(around >= 0, np.maximum((around >= 0).sum(axis=1, keepdims=True), 1))
    weight, solid = _feet(patch.mesh, chosen, around)
    weight = np.where(solid[:, None], weight, mean)
    row = np.repeat(np.arange(len(chosen)), 3)
    beside = sp.csr_matrix((weight.ravel(), (row, np.maximum(around, 0).ravel())), (len(chosen), m))
    lonely = ~(around >= 0).any(axis=1)
    own_centre = sp.csr_matrix(((~lonely).astype(float), (np.arange(len(chosen)), chosen)), (len(chosen), m))
    centres = sp.csr_matrix((np.full(3 * m, 1 / 3), (np.repeat(np.arange(m), 3), faces.ravel())), (m, len(free)))
    rows, tall = ((own_centre - beside) @ centres).tocsr(), np.nonzero(solid)[0]
    normal = _dual_normals(patch.mesh, patch.mesh.vertices, around[tall])
    height = np.einsum("td,td->t", (rows @ patch.mesh.vertices)[tall], normal)
    return _Dual(rows, tall, around[tall], height)


def _feet(
    mesh: Mesh, chosen: Int[np.ndarray, "r"], around: Int[np.ndarray, "r 3"]
) -> tuple[Float[np.ndarray, "r 3"], Bool[np.ndarray, "r"]]:
    """Barycentric weights of the foot of each centre on the triangle of its neighbours' centres, and whether there is one."""
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    corner = centres[around]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    square = np.sum(normal**2, axis=1)
    longest = np.max(np.sum((corner - np.roll(corner, 1, axis=1)) ** 2, axis=2), axis=1)
    solid = (around >= 0).all(axis=1) & (square > (THIN * longest) ** 2)
    arm = corner - centres[chosen][:, None, :]
    part = np.einsum("rkd,rd->rk", np.cross(np.roll(arm, -1, axis=1), np.roll(arm, -2, axis=1)), normal)
    return np.divide(part, square[:, None], out=np.zeros_like(part), where=solid[:, None]), solid


def _dual_normals(mesh: Mesh, positions: Float[np.ndarray, "p 3"], around: Int[np.ndarray, "t 3"]) -> Float[np.ndarray, "t 3"]:
    """Unit normals of the triangles of face centres; zero where a triangle is crushed."""
    corner = positions[mesh.faces].mean(axis=1)[around]
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
