"""Fine detail that survives heavy bends: deform a smooth base, then put the details back where its surface has turned to.

The base is the region without its bumps; a detail is the vector from a base vertex to the vertex itself. A method deforms the
base, which has nothing to shear; each detail is turned by the rotation that the base took around its vertex.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float

from morphlet.editing.linear import Surroundings, determined, inverse_root_areas, surroundings
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.metrics import edge_lengths
from morphlet.numerics.optimize import OnStep
from morphlet.numerics.rotations import best_rotations
from morphlet.surface.operators import laplacian, mass


@dataclass(frozen=True, eq=False)
class Multiresolution:
    """A method applied to the smooth base of a region.

    Parameters
    ----------
    method
        What deforms the base.
    smoothing
        Bumps narrower than about six times this many mean edge lengths are details; wider ones stay in the base. Limbs that are
        thin at that width melt: on a horse, pulled at a hoof with `Arap()`, 0.3, 0.5, 1, 2 and 3 leave 0, 0, 11, 605 and 734
        pairs of crossing triangles.

    Notes
    -----
    The base b minimises ``|b - v|^2 + s^4 |laplacian of b|^2`` with handle and anchors at their places. Costs a second
    factorization when prepared, and a pass over the region per pull. Details at soft handle vertices are zero. A pipe with
    bumps, bent by 90 degrees with `Laplacian(2)`, is strained by 14.3 percent without details apart, by 13.8 with the default and
    by 13.0 with smoothing 2; its Laplacian error is 9.0, 8.1 and 7.4 percent.

    References
    ----------
    Kobbelt, Campagna, Vorsatz, Seidel, Interactive multi-resolution modeling on arbitrary meshes, SIGGRAPH 1998.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.detail import Multiresolution
    >>> from morphlet.editing.linear import Laplacian
    >>> from morphlet.editing.method import Pull
    >>> from morphlet.editing.roi import Roi
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(2))
    >>> roi = Roi(ball, np.arange(8), np.arange(8, 120))
    >>> same = Multiresolution(Laplacian(), smoothing=2.0).prepare(roi)(Pull(ball.vertices[:8]))
    >>> bool(np.allclose(same, ball.vertices[roi.moving]))
    True
    """

    method: Method
    smoothing: float = 0.5

    def __post_init__(self) -> None:
        if not 0 < self.smoothing < np.inf:
            raise InputError("a positive smoothing", repr(self.smoothing), "pass a few edge lengths")

    def prepare(self, roi: Roi) -> Prepared:
        """Smooth the region, and prepare the method for the base.

        Raises
        ------
        MeshError, SolveError
            As the method; SolveError also if the base is not determined.
        """
        patch = surroundings(Roi(roi.mesh, roi.handle, roi.free))
        base = np.array(roi.mesh.vertices)
        if len(roi.free):
            base[roi.free] = _smoothed(patch, self.smoothing * float(edge_lengths(roi.mesh).mean()))
        on_base = Roi(roi.mesh.with_vertices(base), roi.handle, roi.free, roi.weight)
        return _Detailed(roi, on_base, self.method.prepare(on_base), patch, _fans(patch, base))


@dataclass(frozen=True, eq=False)
class _Detailed:
    """A prepared method on a base, and what turns the details: `fans` @ positions of the patch are the covariances of free vertices."""

    roi: Roi
    base: Roi
    method: Prepared
    patch: Surroundings
    fans: sp.csr_matrix

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`."""
        moved = self.method(pull, on_step)
        whole = np.array(self.base.mesh.vertices)
        whole[self.roi.moving] = moved
        rotations = best_rotations((self.fans @ whole[self.patch.vertices]).reshape(-1, 3, 3))
        detail = (self.roi.mesh.vertices - self.base.mesh.vertices)[self.roi.free]
        turned = np.einsum("fij,fj->fi", rotations, detail)
        moved[np.searchsorted(self.roi.moving, self.roi.free)] += turned
        return moved


def _smoothed(patch: Surroundings, width: float) -> Float[np.ndarray, "f 3"]:
    """The free vertices of the base."""
    rows = sp.diags(width**2 * inverse_root_areas(patch)) @ laplacian(patch.mesh)
    weight = mass(patch.mesh)
    here, V = patch.unknown, patch.mesh.vertices
    matrix = (weight + rows.T @ rows).tocsr()[here]
    known = V.copy()
    known[here] = 0
    right = (weight @ V)[here] - matrix @ known
    return determined(patch, matrix[:, here].tocsc()).solve(right)


def _fans(patch: Surroundings, base: Float[np.ndarray, "n 3"]) -> sp.csr_matrix:
    """(3f, p): sum over the neighbours j of a free vertex i of (base_j - base_i), times (position_j - position_i)."""
    here, places = patch.unknown, base[patch.vertices]
    near = sp.coo_matrix(patch.mesh.topology.adjacency[here])
    arms = places[near.col] - places[here[near.row]]
    rows = (3 * near.row[:, None] + np.arange(3)).ravel()
    there = sp.csr_matrix((arms.ravel(), (rows, np.repeat(near.col, 3))), (3 * len(here), len(places)))
    own = sp.csr_matrix((arms.ravel(), (rows, np.repeat(here[near.row], 3))), (3 * len(here), len(places)))
    return (there - own).tocsr()
