"""Deformation transfer: give one mesh the deformation of another.

The poses of a reference tell how each of its faces deforms; the target deforms so that its faces do the same as those they are
paired with, as nearly as they fit together. Both meshes may have any connectivity. Where the result lies is not told by
deformations: an anchor says it.
"""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import dijkstra

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.motion.face_pairs import FacePairs
from morphlet.motion.gradients import GradientSystem, adjacent_faces
from morphlet.surface.mesh import Mesh
from morphlet.surface.operators import gradient

SMALLEST = 1e-12
"""Share of the longest way between faces that each is longer, since a graph takes a zero for no way."""


@dataclass(frozen=True, eq=False)
class Anchor:
    """What of the target stays where it is, whatever the pose.

    Parameters
    ----------
    vertices
        Whose mean stays: one vertex that is pinned, or several; all if left out.
    up
        If it is not zero, the lowest vertex against this direction keeps its height, as on the ground; across it, the mean of
        the vertices stays.

    Raises
    ------
    InputError
        If an index is negative, or the direction is no vector of three numbers.

    Examples
    --------
    >>> from morphlet.motion.transfer import Anchor
    >>> on_ground = Anchor(up=[0, 1, 0])
    >>> rest, pose = np.array([[0.0, 0, 0], [2, 2, 0]]), np.array([[5.0, 5, 5], [7, 5, 5]])
    >>> on_ground.placed(pose, rest)
    array([[0., 0., 0.],
           [2., 0., 0.]])
    """

    vertices: Int[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(0, np.int64))
    up: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", _arrays.index(self.vertices, "vertices", (None,), np.iinfo(np.int64).max))
        object.__setattr__(self, "up", _arrays.real(self.up, "up", (3,)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Anchor, (np.array(self.vertices), np.array(self.up))

    def placed(self, positions: Float[np.ndarray, "n 3"], rest: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """The positions, moved as a whole so that what is anchored is where it is at rest."""
        kept = self.vertices if len(self.vertices) else slice(None)
        shift = rest[kept].mean(axis=0) - positions[kept].mean(axis=0)
        if self.up.any():
            up = self.up / np.linalg.norm(self.up)
            shift += (np.min(rest @ up) - np.min(positions @ up) - shift @ up) * up
        return positions + shift


CENTRED = Anchor()
"""The mean of the vertices stays."""


@dataclass(frozen=True, eq=False)
class TransferSolver:
    """A target made ready to take any pose of a reference.

    Parameters
    ----------
    reference
        The shape whose poses come.
    pairs
        Which of its faces go with which of the target's.
    system
        The target's gradients, each face weighted by how many it is paired with.
    mean
        (m_target, m_reference) matrix to the mean over the faces that each face of the target, or the nearest such, is paired with.
    slopes
        The reference's gradient.
    anchor
        What stays.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.motion.face_pairs import pair_faces
    >>> from morphlet.motion.transfer import TransferSolver
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> coarse, fine = Mesh(*icosphere(1)), Mesh(*icosphere(2))
    >>> solver = TransferSolver.prepare(coarse, fine, pair_faces(coarse, fine))
    >>> longer = [solver.solve(coarse.with_vertices(coarse.vertices * [1, 1, z])) for z in (1.5, 2.0)]
    >>> [round(float(np.ptp(mesh.vertices[:, 2])), 1) for mesh in longer]
    [3.0, 4.0]
    """

    reference: Mesh
    pairs: FacePairs
    system: GradientSystem
    mean: sp.csr_matrix
    slopes: sp.csr_matrix
    anchor: Anchor

    @staticmethod
    def prepare(reference: Mesh, target: Mesh, pairs: FacePairs, anchor: Anchor = CENTRED) -> "TransferSolver":
        """Factor the target's system for these pairs.

        Parameters
        ----------
        reference
            The shape that the poses deform.
        target
            The mesh that is to deform likewise, standing as the reference does.
        pairs
            From faces of the reference to faces of the target; those without an area are left aside. A face of the target in
            no pair does what the nearest one along the surface does that is in one.
        anchor
            What of the target stays where it is.

        Raises
        ------
        InputError
            If pairs or anchor name what the meshes do not have, or no pair is left.
        SolveError
            If the system cannot be factored.

        Notes
        -----
        The same minimiser as Sumner and Popovic's system with a fourth vertex per face, in a third of its unknowns: the
        fourth vertex of a face occurs in no other, and takes the deformation along the normal to itself. They let faces in no
        pair keep their shape and direction, which squeezes these where the others turn. 0.1 CPU s for a target of 5k vertices.

        References
        ----------
        Sumner and Popovic, Deformation transfer for triangle meshes, SIGGRAPH 2004. Botsch, Sumner, Pauly and Gross,
        Deformation transfer for detail-preserving surface editing, VMV 2006.
        """
        pairs.checked(reference, target)
        _arrays.index(anchor.vertices, "the anchor's vertices", (None,), target.n_vertices)
        solid = (reference.face_areas[pairs.source] > 0) & (target.face_areas[pairs.target] > 0)
        if not solid.any():
            found = f"{len(pairs)}, {int(solid.sum())} of them between faces that have an area"
            raise InputError("at least one pair of faces", found, "pair faces of the reference with faces of the target")
        kept = FacePairs(pairs.source[solid], pairs.target[solid])
        count = np.bincount(kept.target, minlength=target.n_faces)
        mean = sp.csr_matrix((1 / count[kept.target], (kept.target, kept.source)), shape=(target.n_faces, reference.n_faces))
        system = GradientSystem.prepare(target, np.maximum(count, 1).astype(float))
        return TransferSolver(reference, kept, system, _nearest_paired(system, count > 0) @ mean, gradient(reference), anchor)

    def solve(self, pose: Mesh) -> Mesh:
        """The target in a pose of the reference.

        Parameters
        ----------
        pose
            With the reference's faces; where it stands does not matter.

        Raises
        ------
        InputError
            If the pose has other faces than the reference.

        Notes
        -----
        A part of the target beside the largest moves with the face of that one nearest to its centre, and besides as the faces
        that it is paired with move, in proportion to the sizes of the meshes. 5 CPU ms for 7k vertices of the reference and 5k
        of the target.
        """
        _require_same_faces(self.reference, pose)
        changes = (self.mean @ self._changes(pose).reshape(-1, 9)).reshape(-1, 3, 3)
        rest, parts = self.system.rest, self.system.followers
        found = self.system.solve(self.system.frames @ changes)
        placed = parts.placed(found, self._offsets(pose, changes[parts.hosts]))
        return rest.with_vertices(self.anchor.placed(placed, rest.vertices))

    def _offsets(self, pose: Mesh, hosts: Float[np.ndarray, "p 3 3"]) -> Float[np.ndarray, "p 3"]:
        """Where parts lie beside their hosts: as at rest, changed as these are, and moved as what they are paired with has."""
        if not len(hosts):
            return np.zeros((0, 3))
        links = self.system.followers.over @ self.mean
        before, after = (links @ mesh.vertices[mesh.faces].mean(axis=1) for mesh in (self.reference, pose))
        scale = np.sqrt(self.system.rest.area / self.reference.area)
        rest = self.system.followers.reach @ self.system.rest.vertices - scale * before
        return np.einsum("pc,pcd->pd", rest, hosts) + scale * after

    def _changes(self, pose: Mesh) -> Float[np.ndarray, "m 3 3"]:
        """Transposed deformation gradients; normals grow as the root of the area, faces without an area do not change."""
        growth = np.sqrt(pose.face_areas / np.where(self.reference.face_areas > 0, self.reference.face_areas, 1.0))
        along = (self.slopes @ pose.vertices).reshape(-1, 3, 3)
        return along + self.reference.face_normals[:, :, None] * (growth[:, None] * pose.face_normals)[:, None, :]


def transfer(reference: Mesh, pose: Mesh, target: Mesh, pairs: FacePairs, anchor: Anchor = CENTRED) -> Mesh:
    """The target in a pose of the reference: the one-off twin of `TransferSolver`.

    Parameters
    ----------
    reference, target, pairs, anchor
        As for `TransferSolver.prepare`.
    pose
        The reference, deformed.

    Returns
    -------
    Mesh
        With the target's faces.

    Raises
    ------
    InputError
        If faces, pairs and anchor do not fit together.
    SolveError
        If the system cannot be factored.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.motion.face_pairs import pair_faces
    >>> from morphlet.motion.transfer import transfer
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(1))
    >>> egg = ball.with_vertices(ball.vertices * [1, 1, 2] + 7)
    >>> found = transfer(ball, egg, ball, pair_faces(ball, ball))
    >>> bool(abs(found.vertices - egg.vertices + 7).max() < 1e-12)
    True
    """
    return TransferSolver.prepare(reference, target, pairs, anchor).solve(pose)


def _require_same_faces(reference: Mesh, pose: Mesh) -> None:
    """Refuse a pose of another mesh."""
    same = pose.topology is reference.topology or (pose.n_vertices == reference.n_vertices and np.array_equal(pose.faces, reference.faces))
    if not same:
        needed = f"a pose of the reference's {reference.n_vertices} vertices and {reference.n_faces} faces"
        found = f"{pose.n_vertices} vertices, {pose.n_faces} faces" + ("" if pose.faces.shape != reference.faces.shape else " of others")
        raise InputError(needed, found, "pass a pose with the faces of the reference, in its order")


def _nearest_paired(system: GradientSystem, paired: Bool[np.ndarray, "m"]) -> sp.csr_matrix:
    """(m, m) matrix that takes each face's value from the nearest face in a pair along the surface, parts bridged where they hang."""
    rest, parts = system.rest, system.followers
    faces, first = np.unique(system.part[rest.faces[:, 0]], return_index=True)
    bridged = np.isin(parts.parts, faces)
    bridges = np.stack([first[np.searchsorted(faces, parts.parts[bridged])], parts.hosts[bridged]], axis=1)
    ends = np.concatenate([adjacent_faces(rest.topology), bridges])
    centroids = rest.vertices[rest.faces].mean(axis=1)
    lengths = np.linalg.norm(centroids[ends[:, 0]] - centroids[ends[:, 1]], axis=1)
    graph = sp.csr_matrix((lengths + SMALLEST * lengths.max(initial=1.0), ends.T), shape=(len(paired), len(paired)))
    _, _, nearest = dijkstra(graph, directed=False, indices=np.flatnonzero(paired), min_only=True, return_predecessors=True)
    reached = np.flatnonzero(nearest >= 0)
    return sp.csr_matrix((np.ones(len(reached)), (reached, nearest[reached])), shape=graph.shape)
