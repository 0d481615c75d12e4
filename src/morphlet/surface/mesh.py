"""A triangle mesh: positions over a topology.

Faces are counter-clockwise seen from outside. Half-edge h = 3 f + c runs from corner c of face f to the next corner.
A `Mesh` may be anything a file holds (open, non-manifold, several parts); `requirements` says what an operation needs.
Everything here costs O(n) to O(n log n), is computed at first use and kept.
"""

import hashlib
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.sparse.csgraph import connected_components

from morphlet import _arrays
from morphlet.errors import InputError, MeshError

if TYPE_CHECKING:
    import trimesh


@dataclass(frozen=True, eq=False)
class Topology:
    """Which vertices each face joins. Shared by all meshes that differ only in position.

    Parameters
    ----------
    faces
        Vertex indices, one row per triangle.
    n_vertices
        Number of vertices, referenced or not.
    """

    faces: Int[np.ndarray, "m 3"]
    n_vertices: int

    def __post_init__(self) -> None:
        object.__setattr__(self, "faces", _arrays.index(self.faces, "faces", (None, 3), self.n_vertices))

    def __reduce__(self) -> tuple[Any, ...]:
        return Topology, (np.array(self.faces), self.n_vertices)

    @cached_property
    def halfedges(self) -> Int[np.ndarray, "h 2"]:
        """Start and end vertex of half-edge 3 f + c."""
        pairs = np.stack([self.faces, np.roll(self.faces, -1, axis=1)], axis=2)
        return _arrays.freeze(np.ascontiguousarray(pairs.reshape(-1, 2)))

    @cached_property
    def halfedge_counts(self) -> Int[np.ndarray, "h 2"]:
        """How many half-edges run along each half-edge in its own direction, and in the opposite one."""
        start, end = self.halfedges.T
        own, opposite = start * self.n_vertices + end, end * self.n_vertices + start
        keys, counts = np.unique(own, return_counts=True)
        counts = np.append(counts, 0)
        place = np.searchsorted(keys, opposite)
        found = np.append(keys, -1)[place] == opposite
        return _arrays.freeze(np.stack([counts[np.searchsorted(keys, own)], np.where(found, counts[place], 0)], axis=1))

    @cached_property
    def twins(self) -> Int[np.ndarray, "h"]:
        """The opposite half-edge of each half-edge, -1 on the boundary.

        Raises
        ------
        MeshError
            If a directed edge is used twice: such a surface has no twins.
        """
        doubled = np.nonzero(self.halfedge_counts[:, 0] > 1)[0]
        if len(doubled):
            raise MeshError(
                "a manifold, consistently oriented surface",
                f"{len(np.unique(self.halfedges[doubled], axis=0))} directed edges used twice",
                "try repair(mesh)",
                np.unique(self.halfedges[doubled], axis=0),
            )
        start, end = self.halfedges.T
        own, opposite = start * self.n_vertices + end, end * self.n_vertices + start
        order = np.argsort(own)
        place = np.minimum(np.searchsorted(own[order], opposite), max(len(order) - 1, 0))
        twins = np.where(own[order][place] == opposite, order[place], -1) if len(order) else order
        return _arrays.freeze(np.ascontiguousarray(twins, dtype=np.int64))

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Undirected edges, smaller index first, in lexicographic order."""
        return _arrays.freeze(np.unique(np.sort(self.halfedges, axis=1), axis=0))

    @cached_property
    def adjacency(self) -> sp.csr_matrix:
        """(n, n) symmetric matrix with a one per edge."""
        i, j = self.edges.T
        ones = np.ones(2 * len(i))
        return sp.csr_matrix((ones, (np.r_[i, j], np.r_[j, i])), shape=(self.n_vertices, self.n_vertices))

    @cached_property
    def referenced(self) -> Bool[np.ndarray, "n"]:
        """Whether a vertex belongs to a face."""
        used = np.zeros(self.n_vertices, bool)
        used[self.faces] = True
        return _arrays.freeze(used)

    @cached_property
    def components(self) -> Int[np.ndarray, "n"]:
        """Connected part of each vertex, parts numbered from 0 by first vertex; -1 for unreferenced vertices."""
        _, label = connected_components(self.adjacency, directed=False)
        label = np.where(self.referenced, label, -1)
        _, first, number = np.unique(label, return_index=True, return_inverse=True)
        rank = np.argsort(np.argsort(np.where(label[first] < 0, -1, first)))
        return _arrays.freeze(rank[number] - int(np.any(label < 0)))

    @property
    def n_components(self) -> int:
        """Number of connected parts that have a face."""
        return int(self.components.max(initial=-1)) + 1

    @property
    def euler_characteristic(self) -> int:
        """Referenced vertices - edges + faces."""
        return int(self.referenced.sum()) - len(self.edges) + len(self.faces)

    @cached_property
    def boundary_loops(self) -> tuple[Int[np.ndarray, "k"], ...]:
        """Vertices of each boundary loop, in the direction of its faces' half-edges, longest loop first.

        Raises
        ------
        MeshError
            If a directed edge is used twice, or two loops touch at a vertex.
        """
        start, end = self.halfedges[self.twins < 0].T
        touched = np.nonzero(np.bincount(start, minlength=1) > 1)[0]
        if len(touched):
            raise MeshError("boundary loops that do not touch", f"{len(touched)} vertices on two loops", "try repair(mesh)", touched)
        following = dict(zip(start.tolist(), end.tolist(), strict=True))
        loops = []
        for vertex in start.tolist():
            loop = []
            while vertex in following:
                loop.append(vertex)
                vertex = following.pop(vertex)
            if loop:
                loops.append(_arrays.freeze(np.array(loop, np.int64)))
        return tuple(sorted(loops, key=len, reverse=True))


@dataclass(frozen=True, eq=False, init=False)
class Mesh:
    """A triangle mesh, immutable.

    Parameters
    ----------
    vertices
        Positions, in mesh units.
    topology
        Vertex indices of the faces (m, 3), or the `Topology` of another mesh, then shared.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> round(6 * tetrahedron.volume, 12), tetrahedron.topology.euler_characteristic
    (1.0, 2)
    """

    vertices: Float[np.ndarray, "n 3"]
    topology: Topology

    def __init__(self, vertices: ArrayLike, topology: Topology | ArrayLike) -> None:
        positions = _arrays.real(vertices, "vertices", (None, 3))
        shared = topology if isinstance(topology, Topology) else Topology(cast(np.ndarray, topology), len(positions))
        if shared.n_vertices != len(positions):
            raise InputError(f"{shared.n_vertices} vertices for this topology", str(len(positions)), "pass one position per vertex")
        object.__setattr__(self, "vertices", positions)
        object.__setattr__(self, "topology", shared)

    def __reduce__(self) -> tuple[Any, ...]:
        return Mesh, (np.array(self.vertices), self.topology)

    def __repr__(self) -> str:
        return f"Mesh({self.n_vertices} vertices, {self.n_faces} faces)"

    def _repr_html_(self) -> str:
        """A turnable view in a notebook."""
        from trimesh.viewer.notebook import scene_to_html

        page = scene_to_html(self.to_trimesh().scene()).replace('"', "&quot;")
        return f'{self!r}<iframe srcdoc="{page}" width="100%" height="400" style="border:none"></iframe>'

    def with_vertices(self, vertices: Float[np.ndarray, "n 3"]) -> "Mesh":
        """The same topology at other positions."""
        return Mesh(vertices, self.topology)

    @staticmethod
    def from_trimesh(mesh: "trimesh.Trimesh") -> "Mesh":
        """The vertices and faces of a trimesh, in its order."""
        return Mesh(mesh.vertices, mesh.faces)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """A trimesh with these vertices and faces, unprocessed."""
        import trimesh

        return trimesh.Trimesh(np.array(self.vertices), np.array(self.faces), process=False)

    @property
    def faces(self) -> Int[np.ndarray, "m 3"]:
        """Vertex indices of the faces."""
        return self.topology.faces

    @property
    def n_vertices(self) -> int:
        """Number of vertices."""
        return len(self.vertices)

    @property
    def n_faces(self) -> int:
        """Number of faces."""
        return len(self.faces)

    @cached_property
    def _area_vectors(self) -> Float[np.ndarray, "m 3"]:
        a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
        return _arrays.freeze(0.5 * np.cross(b - a, c - a))

    @cached_property
    def face_areas(self) -> Float[np.ndarray, "m"]:
        """Area of each face."""
        return _arrays.freeze(np.linalg.norm(self._area_vectors, axis=1))

    @cached_property
    def face_normals(self) -> Float[np.ndarray, "m 3"]:
        """Unit normal of each face; zero for a face without area."""
        return _arrays.freeze(_normalised(self._area_vectors))

    @cached_property
    def vertex_normals(self) -> Float[np.ndarray, "n 3"]:
        """Unit normal of each vertex, the area-weighted mean of its faces'; zero where undefined."""
        return _arrays.freeze(_normalised(self._sum_of_faces(self._area_vectors)))

    @cached_property
    def vertex_areas(self) -> Float[np.ndarray, "n"]:
        """A third of the area of the faces at each vertex."""
        return _arrays.freeze(self._sum_of_faces(self.face_areas[:, None])[:, 0] / 3)

    @property
    def area(self) -> float:
        """Total area."""
        return float(self.face_areas.sum())

    @property
    def volume(self) -> float:
        """Signed enclosed volume (divergence theorem about the centroid); positive if the faces look outwards."""
        centred = self.vertices[self.faces[:, 0]] - self.vertices.mean(axis=0, keepdims=True) if self.n_vertices else self.vertices
        return float(np.sum(centred * self._area_vectors) / 3)

    @property
    def bbox_diagonal(self) -> float:
        """Diagonal of the axis-parallel bounding box."""
        return float(np.linalg.norm(np.ptp(self.vertices, axis=0))) if self.n_vertices else 0.0

    @cached_property
    def fingerprint(self) -> str:
        """SHA-256 of positions and faces: the same mesh, the same text."""
        content = self.vertices.tobytes() + self.faces.tobytes()
        return hashlib.sha256(content).hexdigest()

    def _sum_of_faces(self, values: Float[np.ndarray, "m d"]) -> Float[np.ndarray, "n d"]:
        corners = self.faces.ravel()
        columns = [np.bincount(corners, np.repeat(v, 3), self.n_vertices) for v in values.T]
        return np.stack(columns, axis=1).astype(np.float64)  # bincount of nothing counts in integers


def _normalised(vectors: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k 3"]:
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.divide(vectors, length, out=np.zeros_like(vectors), where=length > 0)
