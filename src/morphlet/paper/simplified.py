"""The other way of Figure 9: simplify the mesh, deform what is left, and bind the full surface back to it.

The surface is detached from a coarse mesh: each of its vertices remembers the place of the coarse mesh nearest to it, and how it
lies beside the corners there; once the coarse mesh is deformed, each corner carries it along with the rotation that its surroundings took.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor
from morphlet.editing.roi import Roi
from morphlet.numerics.rotations import best_rotations
from morphlet.paper.subjects import Subject, farthest, simplified
from morphlet.surface.mesh import Mesh
from morphlet.surface.nearest import nearest
from morphlet.surface.points import SurfacePoints


@dataclass(frozen=True, eq=False)
class Bound:
    """A surface bound to a coarse mesh.

    Parameters
    ----------
    coarse
        At rest.
    skin
        The surface at rest.
    places
        Nearest place of the coarse mesh to each vertex of the surface.
    """

    coarse: Mesh
    skin: Mesh
    places: SurfacePoints

    @staticmethod
    def prepare(coarse: Mesh, skin: Mesh) -> "Bound":
        """Find the places: O((n + m) log m)."""
        return Bound(coarse, skin, nearest(coarse, skin.vertices))

    def follow(self, deformed: Mesh) -> Mesh:
        """The surface where the deformed coarse mesh takes it.

        Examples
        --------
        >>> from morphlet.numerics.unit_sphere import icosphere
        >>> from morphlet.paper.simplified import Bound
        >>> coarse, fine = Mesh(*icosphere(1)), Mesh(*icosphere(2))
        >>> quarter = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
        >>> turned = Bound.prepare(coarse, fine).follow(coarse.with_vertices(coarse.vertices @ quarter.T))
        >>> bool(np.allclose(turned.vertices, fine.vertices @ quarter.T))
        True
        """
        corners = self.coarse.faces[self.places.faces]
        arms = self.skin.vertices[:, None] - self.coarse.vertices[corners]
        turned = np.einsum("ncab,ncb->nca", self._turns(deformed)[corners], arms)
        return self.skin.with_vertices(np.einsum("nc,nca->na", self.places.weights, deformed.vertices[corners] + turned))

    def _turns(self, deformed: Mesh) -> Float[np.ndarray, "m 3 3"]:
        """The rotation that the edges at each coarse vertex took, as well as one can."""
        i, j = self.coarse.topology.edges.T
        rest, now = (mesh.vertices[j] - mesh.vertices[i] for mesh in (self.coarse, deformed))
        products = np.einsum("ea,eb->eab", rest, now)
        sums = np.zeros((self.coarse.n_vertices, 3, 3))
        np.add.at(sums, i, products)
        np.add.at(sums, j, products)
        return best_rotations(sums)


@dataclass(frozen=True, eq=False)
class Detour:
    """The edit of a subject by way of a coarse mesh, prepared."""

    bound: Bound
    editor: RoiEditor
    goals: Float[np.ndarray, "h 3"]

    @staticmethod
    def prepare(subject: Subject, count: int) -> "Detour":
        """Simplify, choose the coarse vertices that lie in the handle, in the region and beyond it, factor, bind."""
        coarse = simplified(subject.sphere.surface.mesh, count)
        roi, goal = _region(subject, coarse)
        return Detour(Bound.prepare(coarse, subject.mesh), RoiEditor.prepare(roi, Arap()), goal)

    def solve(self) -> Mesh:
        """The full surface once the coarse handle is at its goals."""
        return self.bound.follow(self.editor.solve(self.goals))


def _region(subject: Subject, coarse: Mesh) -> tuple[Roi, Float[np.ndarray, "h 3"]]:
    """The region of a subject on a coarse mesh, whose vertices are some of its own, and where the handle goes."""
    fine = nearest(subject.mesh, coarse.vertices)
    vertex = subject.mesh.faces[fine.faces, np.argmax(fine.weights, axis=1)]
    row = np.full(subject.mesh.n_vertices, -1, np.int64)
    row[subject.roi.handle] = np.arange(len(subject.roi.handle))
    handle = np.flatnonzero(row[vertex] >= 0)
    if not len(handle):  # so few vertices that none of them is in it: the one at its tip
        handle = np.array([farthest(coarse, subject.model.recipe.toward)])
        row[vertex[handle]] = np.argmin(np.linalg.norm(subject.path[0] - coarse.vertices[handle], axis=1))
    free = np.setdiff1d(np.flatnonzero(np.isin(vertex, subject.roi.free)), handle)
    moved = subject.path[-1] - subject.path[0]
    return Roi(coarse, handle, free), coarse.vertices[handle] + moved[row[vertex[handle]]]
