"""A lattice: space shifted by a smooth blend of the shifts of its control points (paper, Sect. 3, Fig. 1).

No surface is known: what is near through space goes along.
"""

import math
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np
from jaxtyping import Float, Int
from scipy.interpolate import BSpline

from morphlet import _arrays
from morphlet.editing.method import Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.numerics.compiled import kernel
from morphlet.numerics.optimize import OnStep
from morphlet.surface.mesh import Mesh

Basis = Literal["bspline", "bernstein"]

CUBIC = 3
"""Degree of B-splines: the lowest that is twice continuously differentiable."""
MOST_CONTROLS = 4096
"""Control points of a lattice: the matrix of their stiffness takes the square of these, 134 MB."""
FEWEST = 2
"""Control points of a lattice along each axis: one on either side."""
BENDING = 1e-7
"""Weight of the mean square of second derivatives of the control displacements (over the longest side of the box) against the mean
square miss of handle and rim. A horse's tail, pulled by 0.3 of the diagonal and turned by 60 degrees: handle and rim miss by at most
0.1 % of the diagonal with 8 x 8 x 8 control points, 0.3 % with 1e-6; with 1e-8 lattices of 6 x 6 x 6 and fewer buckle."""
STRETCHING = 1e-10
"""The same for first derivatives: they decide only where handle and rim leave an affine map open, for the one nearest a shift."""
SIZE = 1e-13
"""The same for the displacements themselves: they decide only where a shift is open."""


@dataclass(frozen=True)
class Lattice:
    """A box of control points; what is in the box shifts by a smooth blend of their shifts (paper, Sect. 3, Fig. 1).

    Control displacements may be given (`deform`), or found from where a handle goes (`prepare`): of those that bring the handle to
    its targets, and leave the rim of the anchors where it is, as closely as they can, the ones that bend least. (The smallest ones,
    which is the usual choice, rest between handle and rim, so that limbs buckle.) The handle is then not held exactly, unless it has
    few vertices. Handle weights are not used.

    Parameters
    ----------
    shape
        Control points along x, y and z.
    basis
        ``bspline``: cubic, each control point reaches four intervals wide (lower degree on an axis with fewer than four); ``bernstein``:
        one polynomial, each control point reaches everything.
    fixed_planes
        Outermost planes of control points, on every side, that never move: k + 1 of them join the box to its outside with k
        continuous derivatives.

    Raises
    ------
    InputError
        If there are fewer than two control points along an axis, the basis is unknown, or no control point may move.

    Notes
    -----
    With c control points, preparing costs O(c^3) time and 24 c^2 bytes; a frame 64 products per vertex, or c with ``bernstein``.

    References
    ----------
    Sederberg and Parry, Free-form deformation of solid geometric models, SIGGRAPH 1986. Hsu, Hughes and Kaufman, Direct manipulation
    of free-form deformations, SIGGRAPH 1992.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.lattice import Lattice
    >>> cage, triangle = Lattice((2, 2, 3), "bernstein"), Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 1], [0.5, 0.5, 0.5]], [[0, 1, 2]])
    >>> shifts = np.zeros((2, 2, 3, 3))
    >>> shifts[:, :, 1, 0] = 1  # the middle plane, along x
    >>> cage.deform(triangle, shifts).vertices[:, 0].tolist()
    [0.0, 1.0, 0.0, 1.0]
    """

    shape: tuple[int, int, int] = (8, 8, 8)
    basis: Basis = "bspline"
    fixed_planes: int = 0

    def __post_init__(self) -> None:
        shape = tuple(int(n) for n in _arrays.index(self.shape, "shape", (3,), MOST_CONTROLS + 1))
        if math.prod(shape) > MOST_CONTROLS:
            raise InputError(f"at most {MOST_CONTROLS} control points", f"shape {shape}", "ask for fewer")
        object.__setattr__(self, "shape", shape)
        if self.basis not in get_args(Basis):
            raise InputError(f"one of {', '.join(get_args(Basis))} as basis", repr(self.basis), "choose one of these")
        least = max(FEWEST, 2 * self.fixed_planes + 1)
        if min(shape) < least or self.fixed_planes < 0:
            found = f"shape {shape} with {self.fixed_planes} fixed planes on every side"
            raise InputError(f"at least {least} control points along each axis", found, "ask for more control points or fewer fixed planes")

    def points(self, box: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "l m n 3"]:
        """Where the control points of a box are: displaced by an affine map of these places, they deform by that map.

        Examples
        --------
        >>> from morphlet.editing.lattice import Lattice
        >>> Lattice((4, 2, 2), "bernstein").points([[0, 0, 0], [3, 1, 1]])[:, 0, 0, 0].round(12).tolist()
        [0.0, 1.0, 2.0, 3.0]
        """
        low, high = _arrays.real(box, "box", (2, 3))
        axes = [low[a] + (high[a] - low[a]) * _sites(n, self._degree(n)) for a, n in enumerate(self.shape)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)

    def deform(self, mesh: Mesh, displacements: Float[np.ndarray, "l m n 3"], box: Float[np.ndarray, "2 3"] | None = None) -> Mesh:
        """The mesh after these displacements of the control points.

        Parameters
        ----------
        mesh
            At rest.
        displacements
            Of every control point, in mesh units.
        box
            Two opposite corners of the lattice, lower coordinates first; the bounding box of the mesh if left out.

        Returns
        -------
        deformed
            Vertices outside the box stay, bit for bit.

        Raises
        ------
        InputError
            If the displacements do not fit the shape, a fixed plane moves, or the box is turned over.
        """
        shifts = _arrays.real(displacements, "displacements", (*self.shape, 3))
        if np.any(shifts[~self._movable()]):
            found = f"displacements on the outermost {self.fixed_planes} planes"
            raise InputError("fixed planes that stay", found, "set them to zero, or fix fewer planes")
        corners = _box(mesh.vertices) if box is None else _arrays.real(box, "box", (2, 3))
        if np.any(corners[0] > corners[1]):
            raise InputError("a box with its lower corner first", f"{corners.tolist()}", "exchange the corners")
        inside = np.flatnonzero(((mesh.vertices >= corners[0]) & (mesh.vertices <= corners[1])).all(axis=1))
        vertices = np.array(mesh.vertices)
        vertices[inside] += self._blend(vertices[inside], corners)(shifts)
        return mesh.with_vertices(vertices)

    def prepare(self, roi: Roi) -> Prepared:
        """The box of the region and its rim, its blend at the moving vertices, and the answer of its control points to a handle."""
        held = np.concatenate([roi.handle, roi.rim])
        box = _box(roi.mesh.vertices[np.concatenate([roi.moving, roi.rim])])
        wanted = self._blend(roi.mesh.vertices[held], box).matrix(self.shape)
        return _Caged(roi, self._answer(wanted, box)[:, : len(roi.handle)], self._blend(roi.mesh.vertices[roi.moving], box), self.shape)

    def _answer(self, wanted: Float[np.ndarray, "w c"], box: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "c w"]:
        """From where some places go to the control displacements: least squares with a little stiffness."""
        movable = self._movable().ravel()
        normal = wanted.T @ wanted / len(wanted) + self._stiffness(box) / wanted.shape[1]
        answer = np.zeros((len(movable), len(wanted)))
        answer[movable] = np.linalg.solve(normal[np.ix_(movable, movable)], wanted[:, movable].T / len(wanted))
        return answer

    def _stiffness(self, box: Float[np.ndarray, "2 3"]) -> Float[np.ndarray, "c c"]:
        """The quadratic form that makes the answer smooth: second and first differences of control points, and their size."""
        size = box[1] - box[0]
        sides = np.where(size > 0, size, size.max() or 1.0)
        sites = [_sites(n, self._degree(n)) * side / sides.max() for n, side in zip(self.shape, sides, strict=True)]
        eye = [np.eye(n) for n in self.shape]
        slope = [_squared(_divided(x)) for x in sites]
        bend = [_squared(_divided((x[1:] + x[:-1]) / 2) @ _divided(x)) for x in sites]
        total = np.zeros((np.prod(self.shape),) * 2)
        for a in range(3):
            others = (a + 1) % 3
            twist = [slope[b] if b in (a, others) else eye[b] for b in range(3)]
            total += BENDING * (_product([bend[b] if b == a else eye[b] for b in range(3)]) + 2 * _product(twist))
            total += STRETCHING * _product([slope[b] if b == a else eye[b] for b in range(3)])
        return total + SIZE * np.eye(len(total))

    def _degree(self, count: int) -> int:
        """Of the polynomials along an axis with so many control points."""
        return count - 1 if self.basis == "bernstein" else min(CUBIC, count - 1)

    def _movable(self) -> np.ndarray:
        """Which control points may move."""
        free = np.zeros(self.shape, bool)
        inner = tuple(slice(self.fixed_planes, n - self.fixed_planes) for n in self.shape)
        free[inner] = True
        return free

    def _blend(self, places: Float[np.ndarray, "k 3"], box: Float[np.ndarray, "2 3"]) -> "_Blend":
        """How the control points of a box mix at places in it; along a side without length all is at its lower end."""
        size = box[1] - box[0]
        share = np.clip((places - box[0]) / np.where(size > 0, size, 1.0), 0.0, 1.0)
        found = [_basis(np.ascontiguousarray(share[:, a]), n, self._degree(n)) for a, n in enumerate(self.shape)]
        first = np.stack([f for f, _ in found], axis=1)
        return _Blend(np.ascontiguousarray(first), *(weights for _, weights in found))


@dataclass(frozen=True, eq=False)
class _Blend:
    """Weights of control points at places: the first one that counts along each axis, and the weights from there on."""

    first: Int[np.ndarray, "k 3"]
    along_x: Float[np.ndarray, "k p"]
    along_y: Float[np.ndarray, "k q"]
    along_z: Float[np.ndarray, "k r"]

    def __call__(self, shifts: Float[np.ndarray, "l m n 3"]) -> Float[np.ndarray, "k 3"]:
        """The shift of each place."""
        out = np.empty((len(self.first), 3))
        _blended(self.first, self.along_x, self.along_y, self.along_z, np.array(shifts), out)
        return out

    def matrix(self, shape: tuple[int, int, int]) -> Float[np.ndarray, "k c"]:
        """The weight of every control point at each place."""
        weights = np.einsum("ka,kb,kc->kabc", self.along_x, self.along_y, self.along_z)
        steps = [np.arange(along.shape[1]) for along in (self.along_x, self.along_y, self.along_z)]
        i, j, k = (self.first[:, a, None] + steps[a] for a in range(3))
        flat = (i[:, :, None, None] * shape[1] + j[:, None, :, None]) * shape[2] + k[:, None, None, :]
        table = np.zeros((len(self.first), int(np.prod(shape))))
        np.put_along_axis(table, flat.reshape(len(table), -1), weights.reshape(len(table), -1), axis=1)
        return table


@dataclass(frozen=True, eq=False)
class _Caged:
    """A region in a lattice that answers its handle."""

    roi: Roi
    answer: Float[np.ndarray, "c h"]
    blend: _Blend
    shape: tuple[int, int, int]

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of the moving vertices."""
        roi = self.roi
        targets = _arrays.real(pull.targets, "targets", (len(roi.handle), 3))
        shifts = self.answer @ (targets - roi.mesh.vertices[roi.handle])
        return roi.mesh.vertices[roi.moving] + self.blend(shifts.reshape(*self.shape, 3))


def _box(places: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "2 3"]:
    """Two corners of the axis-parallel box round places."""
    return np.stack([places.min(axis=0), places.max(axis=0)])


def _knots(count: int, degree: int) -> Float[np.ndarray, "t"]:
    """Of clamped B-splines on [0, 1]; without inner knots they are the Bernstein polynomials."""
    inner = np.linspace(0, 1, count - degree + 1)
    return np.concatenate([np.zeros(degree), inner, np.ones(degree)])


def _sites(count: int, degree: int) -> Float[np.ndarray, "n"]:
    """Where the control points are, so that the blend of their places is the place itself (Greville)."""
    knots = _knots(count, degree)
    return np.array([knots[i + 1 : i + degree + 1].mean() for i in range(count)])


def _divided(sites: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n1 n"]:
    """Divided differences of values at these sites."""
    return np.diff(np.eye(len(sites)), axis=0) / np.diff(sites)[:, None]


def _squared(matrix: Float[np.ndarray, "r n"]) -> Float[np.ndarray, "n n"]:
    return matrix.T @ matrix


def _product(factors: list[np.ndarray]) -> Float[np.ndarray, "c c"]:
    """The matrix that has one factor along each axis."""
    return np.kron(np.kron(factors[0], factors[1]), factors[2])


def _basis(shares: Float[np.ndarray, "k"], count: int, degree: int) -> tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k p"]]:
    """First control point that counts at each place of an axis, and the weights of it and the next ones."""
    table: Any = BSpline.design_matrix(shares, _knots(count, degree), degree)
    return table.indices[:: degree + 1].astype(np.int64), np.ascontiguousarray(table.data.reshape(-1, degree + 1))


@kernel
def _blended(first, along_x, along_y, along_z, shifts, out):  # type: ignore[no-untyped-def]
    # first (k,3); weights along x (k,p), y (k,q), z (k,r); shifts (l,m,n,3); out (k,3): sum of products of weights times shifts.
    for v in range(len(first)):
        x = y = z = 0.0
        for a in range(along_x.shape[1]):
            for b in range(along_y.shape[1]):
                row = shifts[first[v, 0] + a, first[v, 1] + b]
                share = along_x[v, a] * along_y[v, b]
                for c in range(along_z.shape[1]):
                    w = share * along_z[v, c]
                    x += w * row[first[v, 2] + c, 0]
                    y += w * row[first[v, 2] + c, 1]
                    z += w * row[first[v, 2] + c, 2]
        out[v, 0], out[v, 1], out[v, 2] = x, y, z
