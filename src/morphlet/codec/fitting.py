"""Least squares: a subdivision surface laid on a surface, in its control points or in moves along its normals.

Both ways count: the finest vertices should lie on the target, and points of the target on the finest faces. Each pair of places
gives one equation, the distance along a normal; where places slide, new pairs are found and the equations solved again.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from jaxtyping import Float, Int

from morphlet.codec.subdivision import Refinement, edge_normals, vertex_normals
from morphlet.codec.surface_error import spread
from morphlet.numerics.compiled import kernel
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest

SLIDING = 0.05
"""Weight of how far control points' surface slides along the target, against 1 for the distance from it."""
STIFFNESS = 1e-4
"""Weight of how unevenly control points move: where the target says nothing, neighbours go together."""
DAMPING = 1e-3
"""Of each unknown's own weight: keeps moves that no pair of places sees at 0."""
SWEEPS, TOLERANCE = 40, 1e-3
"""Of conjugate gradients: pairs of places are found anew after it, so a rough answer will do."""
PASSES = 4
"""Of rounding: later ones change next to nothing."""
FIRST_BITS = 2.0
"""What a number that is not 0 costs more than its size, in bits."""


@dataclass(frozen=True, eq=False)
class Target:
    """A surface prepared to be searched for nearest places."""

    mesh: Mesh
    samples: Float[np.ndarray, "k 3"]
    _tree: Any
    _arrays: tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]
    _normals: Float[np.ndarray, "m 3"]

    @staticmethod
    def prepare(mesh: Mesh, count: int) -> "Target":
        """Build the tree and spread about `count` points on the surface; O(m log m)."""
        import igl

        arrays = np.array(mesh.vertices), np.array(mesh.faces)
        tree = igl.AABB()
        tree.init(*arrays)
        points = spread(mesh)
        stride = max(1, len(points) // count)
        return Target(mesh, points[::stride], tree, arrays, mesh.face_normals)

    def places(self, points: Float[np.ndarray, "k 3"]) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3"]]:
        """Nearest places of the surface, and its normals there."""
        _, face, place = self._tree.squared_distance(*self._arrays, np.ascontiguousarray(points))
        return place, self._normals[face]


@dataclass(frozen=True, eq=False)
class Pairs:
    """Places of a surface (rows of `weights` over its vertices), and how far along which normal each is from the target."""

    weights: sp.csr_matrix
    normals: Float[np.ndarray, "r 3"]
    share: Float[np.ndarray, "r"]
    offsets: Float[np.ndarray, "r 3"]

    def equations(self, masks: sp.csr_matrix, directions: Float[np.ndarray, "u 3"]) -> tuple[sp.csr_matrix, Float[np.ndarray, "r"]]:
        """Change of weighted distances by moves of unknowns along directions; distances."""
        matrix = (self.weights @ masks).tocsr()
        rows = np.repeat(np.arange(matrix.shape[0]), np.diff(matrix.indptr))
        along = np.einsum("ij,ij->i", self.normals[rows], directions[matrix.indices]) * self.share[rows]
        moved = sp.csr_matrix((matrix.data * along, matrix.indices, matrix.indptr), matrix.shape)
        return moved, self.share * np.einsum("ij,ij->i", self.normals, self.offsets)


def pairs(target: Target, positions: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Pairs:
    """Places of the surface with the nearest ones of the target, all samples of the target with the nearest places of the faces."""
    mesh, count = Mesh(positions, faces), len(target.samples)
    weights, own = _spread_out(mesh) if mesh.n_faces < count else _corners(mesh)
    points = weights @ positions
    place, normals = target.places(points)
    agreement = np.einsum("ij,ij->i", own, normals) / max(np.linalg.norm(own, axis=1).sum(), np.finfo(float).tiny)
    back = nearest(mesh, target.samples)
    return Pairs(
        sp.vstack([weights, back.matrix(mesh)], format="csr"),
        np.concatenate([normals, mesh.face_normals[back.faces]]),
        np.concatenate([np.sqrt(np.maximum(agreement, 0)), np.full(count, count**-0.5)]),
        np.concatenate([place - points, target.samples - back.positions(mesh)]),
    )


def _corners(mesh: Mesh) -> tuple[sp.csr_matrix, Float[np.ndarray, "n 3"]]:
    """All vertices; normals as long as their areas. Enough where faces are small."""
    return sp.identity(mesh.n_vertices, format="csr"), vertex_normals(mesh.vertices, mesh.faces)


def _spread_out(mesh: Mesh) -> tuple[sp.csr_matrix, Float[np.ndarray, "k 3"]]:
    """Three places inside each face; normals as long as its area. The best vertices of large faces are not on the target."""
    m = mesh.n_faces
    columns, rows = np.repeat(mesh.faces, 3, axis=0).ravel(), np.repeat(np.arange(3 * m), 3)
    weights = np.tile((1 + 3 * np.eye(3)).ravel() / 6, m)
    normals = mesh.face_normals * mesh.face_areas[:, None]
    return sp.csr_matrix((weights, (rows, columns)), (3 * m, mesh.n_vertices)), np.repeat(normals, 3, axis=0)


@dataclass(frozen=True, eq=False)
class Quadratic:
    """What is to be made small: x^T A x / 2 - b^T x, and the x that makes it so, about."""

    matrix: sp.csr_matrix
    right: Float[np.ndarray, "u"]
    least: Float[np.ndarray, "u"]

    def around(self, shift: Float[np.ndarray, "u"]) -> "Quadratic":
        """The same in terms of y = x + shift."""
        return Quadratic(self.matrix, self.right + self.matrix @ shift, self.least + shift)


@dataclass(frozen=True, eq=False)
class Surface:
    """Finest faces of a subdivision, and where their vertices are: masks of control points."""

    masks: sp.csr_matrix
    faces: Int[np.ndarray, "k 3"]

    @staticmethod
    def of(levels: Sequence[Refinement], faces: Int[np.ndarray, "m 3"], n: int) -> "Surface":
        """The faces of n vertices after these levels."""
        chain = sp.identity(n, format="csr")
        for level in levels:
            chain = level.masks @ chain
        return Surface(chain.tocsr(), levels[-1].finer if levels else faces)


def fit_points(target: Target, surface: Surface, evenness: sp.csr_matrix, positions: Float[np.ndarray, "n 3"], rounds: int) -> Quadratic:
    """Control points whose surface lies on the target: axis by axis, relative to where they were at first."""
    chain, first, n = surface.masks, positions, len(positions)
    smooth = sp.block_diag([evenness * (STIFFNESS / n)] * 3)
    for _ in range(rounds):
        matrix, right = _point_equations(pairs(target, chain @ positions, surface.faces), chain, len(target.samples))
        matrix = (matrix + smooth).tocsr()
        move = _solved(matrix, right)
        right = right + matrix @ (positions - first).T.ravel()
        positions = positions + move.reshape(3, n).T
    return Quadratic(matrix, right, (positions - first).T.ravel())


def fit_moves(target: Target, levels: Sequence[Refinement], positions: Float[np.ndarray, "n 3"], rounds: int) -> Quadratic:
    """Moves of the vertices of the first level's edges, along their normals, that bring the surface after all levels to the target."""
    level, normals = levels[0], edge_normals(positions, levels[0])
    n, still, moves = len(positions), level.masks @ positions, np.zeros(len(normals))
    surface = Surface.of(levels[1:], level.finer, len(still))
    part = surface.masks[:, n:].tocsr()
    for _ in range(rounds):
        moved = np.concatenate([still[:n], still[n:] + moves[:, None] * normals])
        jacobian, distance = pairs(target, surface.masks @ moved, surface.faces).equations(part, normals)
        matrix = (jacobian.T @ jacobian).tocsr()
        right = jacobian.T @ distance + matrix @ moves
        matrix = (matrix + sp.diags(DAMPING * (matrix.diagonal() + matrix.diagonal().mean()))).tocsr()
        moves = _solved(matrix, right, moves)
    return Quadratic(matrix, right, moves)


def _point_equations(found: Pairs, chain: sp.csr_matrix, samples: int) -> tuple[sp.csr_matrix, Float[np.ndarray, "u"]]:
    """Normal equations of all three coordinates of the control points; the target's samples hold them a little along the surface too."""
    n = chain.shape[1]
    axes = [found.equations(chain, np.tile(axis, (n, 1))) for axis in np.eye(3)]
    across, distance = sp.hstack([matrix for matrix, _ in axes], format="csr"), axes[0][1]
    tail = sp.diags(SLIDING * found.share[-samples:]) @ (found.weights[-samples:] @ chain)
    tied, pull = (tail.T @ tail).tocsr(), tail.T @ (SLIDING * found.share[-samples:, None] * found.offsets[-samples:])
    return (across.T @ across + sp.block_diag([tied] * 3)).tocsr(), across.T @ distance + pull.T.ravel()


def evenness(faces: Int[np.ndarray, "m 3"], n: int) -> sp.csr_matrix:
    """Sum of squares of each vertex's move against its neighbours', as a quadratic form; of closed faces."""
    joined = sp.csr_matrix((np.ones(faces.size), (faces.ravel(), np.roll(faces, -1, axis=1).ravel())), (n, n))
    laplacian = sp.diags(np.asarray(joined.sum(axis=1)).ravel()) - joined
    return (laplacian.T @ laplacian).tocsr()


def _solved(matrix: sp.csr_matrix, right: Float[np.ndarray, "u"], start: Float[np.ndarray, "u"] | None = None) -> Float[np.ndarray, "u"]:
    """The solution to three digits or so, by conjugate gradients."""
    diagonal = matrix.diagonal()
    scale = sp.diags(1 / np.where(diagonal > 0, diagonal, 1.0))
    return spla.cg(matrix, right, x0=start, rtol=TOLERANCE, maxiter=SWEEPS, M=scale)[0]


def rounded(quadratic: Quadratic, step: float, price: float, start: Int[np.ndarray, "u"] | None = None) -> Int[np.ndarray, "u"]:
    """Whole numbers of steps that make it small, each bit of theirs as dear as `price` squared steps of error of a mean unknown."""
    found = np.rint(quadratic.least / step).astype(np.int64) if start is None else start.copy()
    matrix = quadratic.matrix
    worth = price * float(matrix.diagonal().mean())
    rest = quadratic.right / step - matrix @ found.astype(np.float64)
    descend(matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), matrix.data.copy(), rest, found, worth)
    return found


@kernel
def descend(starts, columns, values, rest, found, price):  # type: ignore[no-untyped-def]
    # starts, columns, values: rows of a symmetric matrix; found (u,); rest (u,) = right - matrix found
    for _ in range(PASSES):
        changed = 0
        for i in range(found.shape[0]):
            own = 0.0
            for j in range(starts[i], starts[i + 1]):
                if columns[j] == i:
                    own = values[j]
            if own <= 0.0:
                continue
            free = found[i] + rest[i] / own
            best, least = found[i], np.inf
            low = np.int64(np.floor(free))
            for k in range(3):
                trial = np.int64(0) if k == 2 else low + k
                size = abs(trial)
                cost = own * (free - trial) ** 2 + price * (FIRST_BITS + size if size > 0 else 0.0)
                if cost < least:
                    best, least = trial, cost
            if best != found[i]:
                for j in range(starts[i], starts[i + 1]):
                    rest[columns[j]] -= values[j] * (best - found[i])
                found[i] = best
                changed += 1
        if changed == 0:
            return
