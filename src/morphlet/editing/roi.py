"""The region of interest of an edit: what pulls, what follows, what stays (paper, Sects. 4 and 8.1).

Handle vertices get prescribed positions, free vertices (the paper's neighbours) follow, anchors (its fixed vertices)
stay where they are, bit for bit. The three sets partition the vertices of the mesh; everything outside the region is
an anchor. A region may have no anchors: then nothing holds it but its handle, and a method that needs anchors says so.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import scipy.sparse as sp
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import connected_components, dijkstra
from scipy.spatial import cKDTree

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.distance import Front
from morphlet.surface.mesh import Mesh
from morphlet.surface.region import Region
from morphlet.surface.requirements import many

Metric = Literal["geodesic", "euclidean", "edges"]
"""How far a vertex is from the handle: along the surface, through space, or along edges."""

MARGIN = 1.1
"""A front is run on what is within this many radii through space, and one edge of the handle: its distances may fall short of
straight ones by an edge between two handle vertices and by its own error, at most 6.6 % where it was measured."""
NO_PREDECESSOR = -9999
"""What scipy's Dijkstra says where no path leads."""


@dataclass(frozen=True, eq=False)
class Roi:
    """A mesh, and the part of it that an edit may move.

    Parameters
    ----------
    mesh
        At rest.
    handle
        Vertices that are pulled; the rows of an edit's targets are in this order.
    free
        Vertices that follow, in ascending order.
    weight
        How hard each handle vertex is held to its target, in units of the sum of its cotangent weights; infinite
        (the default) holds it exactly.

    Raises
    ------
    InputError
        If there is no handle vertex, one is named twice or is free too, an index is not one of the mesh, or a weight is not
        positive.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> Roi(strip, [4, 5], [2, 3]).anchors.tolist()
    [0, 1]
    """

    mesh: Mesh
    handle: Int[np.ndarray, "h"]
    free: Int[np.ndarray, "f"]
    weight: Float[np.ndarray, "h"] | None = None

    def __post_init__(self) -> None:
        handle = _arrays.index(self.handle, "handle", (None,), self.mesh.n_vertices)
        free = _arrays.index(self.free, "free", (None,), self.mesh.n_vertices)
        if len(handle) == 0:
            raise InputError("a handle", "no handle vertex", "choose at least one vertex to pull")
        times, follows = np.bincount(handle, minlength=self.mesh.n_vertices), np.zeros(self.mesh.n_vertices, bool)
        follows[free] = True
        if len(handle) > np.count_nonzero(times):
            repeated = np.flatnonzero(times > 1)
            raise InputError("each handle vertex once", f"{len(repeated)} repeated", "remove the repetitions", repeated)
        both = np.flatnonzero(follows & (times > 0))
        if len(both):
            raise InputError("vertices that are handle or free", f"{len(both)} that are both", "take them out of one list", both)
        object.__setattr__(self, "handle", handle)
        object.__setattr__(self, "free", _arrays.freeze(np.flatnonzero(follows)))
        if self.weight is not None:
            object.__setattr__(self, "weight", _weights(self.weight, len(handle)))

    def __reduce__(self) -> tuple[Any, ...]:
        return Roi, (self.mesh, np.array(self.handle), np.array(self.free), self.weight)

    @staticmethod
    def within(mesh: Mesh, handle: Int[np.ndarray, "h"], radius: float, metric: Metric = "geodesic") -> "Roi":
        """All that lies within a radius of the handle (paper, Fig. 3: the larger the radius, the more global the edit).

        Parameters
        ----------
        mesh
            At rest.
        handle
            Vertices that are pulled.
        radius
            Largest distance of a free vertex from the handle, in mesh units.
        metric
            Along the surface (an edge between two handle vertices counts as part of the handle), through space (whether or
            not the surface leads there: two halves of a seam, a foot beside a foot), or along edges.

        Returns
        -------
        roi
            Free are the vertices no farther than the radius.

        Raises
        ------
        InputError
            If the radius is not a positive number or reaches no vertex, the metric is unknown, or as for `Roi`.

        Notes
        -----
        O(n) to find what is near through space, then O(k log k) for the k vertices there: cost follows the region.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.roi import Roi
        >>> from morphlet.numerics.unit_sphere import icosphere
        >>> ball = Mesh(*icosphere(3))
        >>> cap = Roi.within(ball, [0], 0.5)
        >>> len(cap.free), len(Roi.within(ball, [0], 0.5, "edges").free)
        (45, 30)
        """
        if metric not in get_args(Metric):
            raise InputError(f"one of {', '.join(get_args(Metric))} as metric", repr(metric), "choose one of these")
        pulled = Roi(mesh, handle, np.zeros(0, np.int64)).handle
        reach = _positive(radius, "radius")
        vertices, distance = _DISTANCES[metric](mesh, pulled, reach)
        free = np.setdiff1d(vertices[distance <= reach], pulled)
        if not len(free):
            raise InputError("a radius that reaches a vertex beside the handle", f"{reach:g}, which reaches none", "enlarge the radius")
        return Roi(mesh, pulled, free)

    @staticmethod
    def between(mesh: Mesh, handle: Int[np.ndarray, "h"], anchors: Int[np.ndarray, "a"]) -> "Roi":
        """All that can be reached from the handle without stepping on an anchor.

        Anchors that ring the handle bound the region, and all beyond them stays; a few scattered ones only hold themselves.
        Parts of the mesh that the handle is not on stay.

        Parameters
        ----------
        mesh
            At rest.
        handle
            Vertices that are pulled.
        anchors
            Vertices that stay.

        Returns
        -------
        roi
            Its anchors are the given ones and all that is out of reach.

        Raises
        ------
        InputError
            If a vertex is handle and anchor, or as for `Roi`.

        Notes
        -----
        O(n).

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.roi import Roi
        >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
        >>> Roi.between(strip, [5], [2, 3]).anchors.tolist()
        [0, 1, 2, 3]
        """
        pulled = Roi(mesh, handle, np.zeros(0, np.int64)).handle
        stays = _arrays.index(anchors, "anchors", (None,), mesh.n_vertices)
        both = np.intersect1d(pulled, stays)
        if len(both):
            raise InputError("vertices that are handle or anchor", f"{len(both)} that are both", "take them out of one list", both)
        passable = np.setdiff1d(np.arange(mesh.n_vertices), stays)
        piece = _pieces(mesh, passable)
        reached = passable[np.isin(piece, piece[np.searchsorted(passable, pulled)])]
        return Roi(mesh, pulled, np.setdiff1d(reached, pulled))

    @staticmethod
    def painted(mesh: Mesh, weights: Float[np.ndarray, "n"]) -> "Roi":
        """The region that someone painted: 1 is handle, 0 is anchor, all between is free.

        How much between does not matter: free vertices go where the method takes them.

        Parameters
        ----------
        mesh
            At rest.
        weights
            One number from 0 to 1 per vertex.

        Returns
        -------
        roi
            Its handle is in ascending order.

        Raises
        ------
        InputError
            If a weight is below 0 or above 1, or none is 1.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.roi import Roi
        >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> Roi.painted(triangle, [0, 0.5, 1]).moving.tolist()
        [1, 2]
        """
        paint = _arrays.real(weights, "weights", (mesh.n_vertices,))
        outside = np.flatnonzero((paint < 0) | (paint > 1))
        if len(outside):
            raise InputError("painted weights from 0 to 1", f"{len(outside)} outside that range", "scale or clip them", outside)
        return Roi(mesh, np.flatnonzero(paint == 1), np.flatnonzero((paint > 0) & (paint < 1)))

    @cached_property
    def anchors(self) -> Int[np.ndarray, "a"]:
        """The vertices that stay."""
        return _arrays.freeze(np.flatnonzero(~self._moves))

    @cached_property
    def moving(self) -> Int[np.ndarray, "k"]:
        """Handle and free vertices, ascending: the rows of what an edit computes."""
        return _arrays.freeze(np.flatnonzero(self._moves))

    @cached_property
    def rim(self) -> Int[np.ndarray, "r"]:
        """The anchors next to the region: those that share a face with a vertex that moves."""
        faces = self.mesh.faces[self._moves[self.mesh.faces].any(axis=1)]
        near = np.unique(faces)
        return _arrays.freeze(near[~self._moves[near]])

    @cached_property
    def handle_parts(self) -> Int[np.ndarray, "h"]:
        """Number of the connected piece of the handle that each of its vertices belongs to: each piece turns by itself."""
        return _arrays.freeze(_pieces(self.mesh, self.handle))

    def softened(self, weight: float) -> "Roi":
        """The same region with every handle vertex held this hard.

        Raises
        ------
        InputError
            If the weight is not positive.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.roi import Roi
        >>> triangle = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
        >>> Roi(triangle, [0, 2], [1]).softened(10).weight.tolist()
        [10.0, 10.0]
        """
        return replace(self, weight=np.full(len(self.handle), weight, dtype=np.float64))

    def grown(self, rings: int) -> "Roi":
        """The region and its neighbours, ring by ring; the new ones are free.

        Raises
        ------
        InputError
            If the number of rings is negative.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.roi import Roi
        >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
        >>> Roi(strip, [5], [4]).grown(1).free.tolist()
        [2, 3, 4]
        """
        moves = _spread(self.mesh, self._moves, rings)
        return replace(self, free=np.setdiff1d(np.flatnonzero(moves), self.handle))

    def shrunk(self, rings: int) -> "Roi":
        """The region without its outermost rings of free vertices, which become anchors; the handle stays a handle.

        Raises
        ------
        InputError
            If the number of rings is negative.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.editing.roi import Roi
        >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
        >>> Roi(strip, [5], [2, 3, 4]).shrunk(1).free.tolist()
        [4]
        """
        stays = _spread(self.mesh, ~self._moves, rings)
        return replace(self, free=self.free[~stays[self.free]])

    @cached_property
    def _moves(self) -> Bool[np.ndarray, "n"]:
        """Whether a vertex is handle or free."""
        moves = np.zeros(self.mesh.n_vertices, bool)
        moves[self.handle] = True
        moves[self.free] = True
        return _arrays.freeze(moves)


def vertices_within(mesh: Mesh, center: Float[np.ndarray, "3"], radius: float) -> Int[np.ndarray, "k"]:
    """The vertices in a ball: a handle that is told as a place.

    Parameters
    ----------
    mesh
        Any mesh.
    center
        Middle of the ball.
    radius
        In mesh units.

    Returns
    -------
    vertices
        Ascending.

    Raises
    ------
    InputError
        If the radius is not a positive number, or there is no vertex in the ball; the message tells the nearest.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.roi import vertices_within
    >>> vertices_within(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), [0, 0, 0], 1.0).tolist()
    [0, 1, 2]
    """
    middle, reach = _arrays.real(center, "center", (3,)), _positive(radius, "radius")
    distance = np.linalg.norm(mesh.vertices - middle, axis=1)
    chosen = np.flatnonzero(distance <= reach)
    if not len(chosen):
        nearest = f"; the nearest is vertex {np.argmin(distance)}, {distance.min():g} away" if len(distance) else ""
        raise InputError(f"a vertex within {reach:g} of {middle.tolist()}", f"none{nearest}", "move the center or enlarge the radius")
    return chosen


def vertex_path(mesh: Mesh, picks: Int[np.ndarray, "p"]) -> Int[np.ndarray, "k"]:
    """The vertices of the shortest way along edges through some vertices: a handle that is a curve (paper, Fig. 2).

    Parameters
    ----------
    mesh
        Any mesh.
    picks
        Vertices to pass, in this order; end with the first one to close the curve.

    Returns
    -------
    vertices
        Each once, in the order in which the way first meets them.

    Raises
    ------
    InputError
        If there are fewer than two picks, or no way leads from one to the next.

    Notes
    -----
    O(n log n) per pick.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.roi import vertex_path
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> vertex_path(strip, [0, 4, 5]).tolist()
    [0, 2, 4, 5]
    """
    chosen = _arrays.index(picks, "picks", (None,), mesh.n_vertices)
    if len(chosen) < 2:
        raise InputError("at least two vertices to lay a path through", many(len(chosen), "vertex"), "pick more")
    graph = _edge_graph(mesh)
    before = dijkstra(graph, directed=False, indices=chosen[:-1], return_predecessors=True)[1]
    way = [int(chosen[0])]
    for row, goal in zip(before, chosen[1:], strict=True):
        leg = [int(goal)]
        while leg[-1] != way[-1]:
            leg.append(int(row[leg[-1]]))
            if leg[-1] == NO_PREDECESSOR:
                raise InputError("picks on one part of the mesh", f"no path from {way[-1]} to {goal}", "pick on one part", [way[-1], goal])
        way += leg[-2::-1]
    return np.array(list(dict.fromkeys(way)), np.int64)


def _weights(weight: Any, count: int) -> Float[np.ndarray, "h"]:
    """Positive weights, infinite ones allowed."""
    values = np.array(weight, dtype=np.float64)
    if values.shape != (count,):
        raise InputError(
            f"one weight for each of {count} handle vertices", f"shape {values.shape}", "pass as many weights as handle vertices"
        )
    bad = np.flatnonzero(~(values > 0))
    if len(bad):
        raise InputError("positive weights of handle vertices", f"{len(bad)} that are not", "make such vertices free instead", bad)
    return _arrays.freeze(values)


def _positive(value: float, name: str) -> float:
    """A positive, finite number."""
    number = float(_arrays.real(value, name, ()))
    if number <= 0:
        raise InputError(f"a {name} above 0", f"{number:g}", f"enlarge the {name}")
    return number


def _pieces(mesh: Mesh, vertices: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
    """Number of the piece that each of some vertices belongs to, if only edges between them join them; three passes over the faces."""
    place = np.full(mesh.n_vertices, -1)
    place[vertices] = np.arange(len(vertices))
    a, b, c = (place[mesh.faces[:, k]] >= 0 for k in range(3))
    corners = place[mesh.faces[np.flatnonzero((a & b) | (c & (a | b)))]]  # of faces with an edge between them
    ends = np.concatenate([corners[:, :2], corners[:, 1:], corners[:, ::2]])
    i, j = ends[(ends >= 0).all(axis=1)].T
    edges = sp.csr_matrix((np.ones(len(i)), (i, j)), shape=(len(vertices),) * 2)
    return connected_components(edges, directed=False)[1].astype(np.int64)


def _spread(mesh: Mesh, mask: Bool[np.ndarray, "n"], rings: int) -> Bool[np.ndarray, "n"]:
    """A set of vertices with so many rings of neighbours."""
    if rings < 0:
        raise InputError("0 or more rings", str(rings), "use grown or shrunk for the other way")
    for _ in range(rings):
        wider = mask.copy()
        wider[mesh.faces[mask[mesh.faces].any(axis=1)]] = True
        mask = wider
    return mask


def _edge_graph(mesh: Mesh) -> sp.csr_matrix:
    """Length of each edge, once."""
    i, j = mesh.topology.edges.T
    lengths = np.linalg.norm(mesh.vertices[i] - mesh.vertices[j], axis=1)
    return sp.csr_matrix((lengths, (i, j)), shape=(mesh.n_vertices, mesh.n_vertices))


Near = tuple[Int[np.ndarray, "k"], Float[np.ndarray, "k"]]


def _straight(mesh: Mesh, handle: Int[np.ndarray, "h"], radius: float) -> Near:
    """Vertices within a radius through space, and their distances."""
    origin = mesh.vertices[handle]
    low, high = origin.min(axis=0) - radius, origin.max(axis=0) + radius
    inside = np.flatnonzero(((mesh.vertices >= low) & (mesh.vertices <= high)).all(axis=1))
    distance = np.asarray(cKDTree(origin).query(mesh.vertices[inside], distance_upper_bound=np.nextafter(radius, np.inf))[0])
    near = distance <= radius
    return inside[near], distance[near]


def _along_edges(mesh: Mesh, handle: Int[np.ndarray, "h"], radius: float) -> Near:
    """Vertices near through space, and how far they are along edges: no shorter way leaves that neighbourhood."""
    patch, local = _patch(mesh, handle, radius)
    distance = dijkstra(_edge_graph(patch.patch), directed=False, indices=local, min_only=True, limit=radius)
    return patch.vertices, distance


def _along_surface(mesh: Mesh, handle: Int[np.ndarray, "h"], radius: float) -> Near:
    """Vertices near through space, and how far they are along the surface."""
    patch, local = _patch(mesh, handle, MARGIN * radius + _longest_edge(mesh, handle))
    return patch.vertices, _hub(Front.prepare(patch.patch), local).field(len(patch))[:-1]


def _patch(mesh: Mesh, handle: Int[np.ndarray, "h"], radius: float) -> tuple[Region, Int[np.ndarray, "h"]]:
    """The part of a mesh that holds every edge within a radius of the handle through space, and the handle's places in it."""
    near = np.zeros(mesh.n_vertices, bool)
    near[_straight(mesh, handle, radius)[0]] = True
    edged = mesh.faces[near[mesh.faces].sum(axis=1) > 1]  # an edge may lie in faces whose other corners are far away
    near[edged] = True
    region = Region(mesh, np.flatnonzero(near))
    return region, np.searchsorted(region.vertices, handle)


def _longest_edge(mesh: Mesh, handle: Int[np.ndarray, "h"]) -> float:
    """Of the faces at the handle."""
    held = np.zeros(mesh.n_vertices, bool)
    held[handle] = True
    corners = mesh.vertices[mesh.faces[held[mesh.faces].any(axis=1)]]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(initial=0.0))


def _hub(front: Front, vertices: Int[np.ndarray, "h"]) -> Front:
    """The same front with one more vertex, the last, joined to these by faces without size: from there it starts at all of them."""
    hub = np.full_like(vertices, len(front.starts) - 1)
    faces = np.concatenate([front.faces, np.stack([hub, vertices, vertices], axis=1)])
    lengths = np.concatenate([front.lengths, np.zeros((len(vertices), 3))])
    starts = np.concatenate([[0], np.cumsum(np.bincount(faces.ravel(), minlength=len(front.starts)))])
    return Front(faces, lengths, starts, np.argsort(faces.ravel(), kind="stable"))


_DISTANCES = {"geodesic": _along_surface, "euclidean": _straight, "edges": _along_edges}
