"""The common refinement of two triangulations of one sphere: every edge of both, cut where they cross.

Each face of the refinement lies in one face of either mesh. So both shapes are met exactly by one connectivity, and a morph
between its two sets of positions loses the detail of neither.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.errors import SolveError
from morphlet.numerics.compiled import kernel
from morphlet.numerics.unit_sphere import rotations_about
from morphlet.sphere.locate import Locator
from morphlet.surface.hierarchy import following
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.points import SurfacePoints

GENERIC = 1e-13
"""Weights and sides below this are rounding: a vertex on the other mesh's edge, or two edges that run into each other."""
NUDGE = 1e-7
"""Radians by which the source's sphere is turned, once more each time, while the two triangulations are not in general position."""
NUDGES = 8
"""How often: the last turn is a degree of 5e-5."""
AXIS = np.array([0.5773, -0.2113, 0.7886])
"""Of the turn; no mesh has it as its own."""
MOST_CORNERS = 6
"""Of a face of the refinement: two triangles meet in a hexagon at most."""


@dataclass(frozen=True, eq=False)
class Overlay:
    """One connectivity for two meshes.

    Parameters
    ----------
    topology
        Of the refinement. Its first vertices are those of the source, then come those of the target, then the crossings.
    source_places, target_places
        Where each of its vertices lies on the source, and on the target.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball, egg = Mesh(*icosphere(2)), Mesh(*icosphere(1))
    >>> both = overlay(ball, ball.vertices, egg, egg.vertices)
    >>> both.topology.euler_characteristic, bool(abs(both.source_places.positions(ball)[:162] - ball.vertices).max() < 1e-12)
    (2, True)
    """

    topology: Topology
    source_places: SurfacePoints
    target_places: SurfacePoints


@dataclass(frozen=True, eq=False)
class _Side:
    """One of the two triangulations: its points, and its undirected edges by their half-edge of lower number."""

    points: Float[np.ndarray, "n 3"]
    topology: Topology
    canonical: Int[np.ndarray, "e"]
    edge: Int[np.ndarray, "h"]

    @staticmethod
    def prepare(points: Float[np.ndarray, "n 3"], topology: Topology) -> "_Side":
        """Number the edges."""
        h = np.arange(3 * len(topology.faces))
        canonical = h[h < topology.twins]
        edge = np.empty(len(h), np.int64)
        edge[canonical] = edge[topology.twins[canonical]] = np.arange(len(canonical))
        return _Side(np.ascontiguousarray(points), topology, canonical, edge)


@dataclass(frozen=True, eq=False)
class _Crossings:
    """Where edges of the source (a) cross edges of the target (b): ranks along both, and weights of their ends.

    `halfedge` of the target has its start on the right of the source's edge, which goes from its canonical start to its end.
    """

    edge: Int[np.ndarray, "x"]
    rank: Int[np.ndarray, "x"]
    halfedge: Int[np.ndarray, "x"]
    source_weight: Float[np.ndarray, "x"]
    target_weight: Float[np.ndarray, "x"]


def overlay(source: Mesh, source_points: Float[np.ndarray, "n 3"], target: Mesh, target_points: Float[np.ndarray, "k 3"]) -> Overlay:
    """The common refinement of two closed meshes that are laid over one sphere without folds.

    Parameters
    ----------
    source, target
        Closed meshes of genus 0.
    source_points, target_points
        Unit vectors of their vertices on the common sphere; all faces of both counter-clockwise, degree 1.

    Returns
    -------
    Overlay
        With as many vertices as both meshes and their crossings together, about 4 to 8 times as many as one mesh.

    Raises
    ------
    SolveError
        If the triangulations fold, or stay in special position under small turns.

    Notes
    -----
    Each edge walks through the faces of the other mesh: O(n + crossings). If a vertex of one lies on an edge of the other, as in
    equal meshes, the source is turned by multiples of 1e-7 rad for the combinatorics and the places on the target.

    References
    ----------
    M. Alexa: Merging polyhedral shapes with scattered features. The Visual Computer 16 (2000).

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(1))
    >>> same = overlay(ball, ball.vertices, ball, ball.vertices)
    >>> shift = same.source_places.positions(ball) - same.target_places.positions(ball)
    >>> bool(abs(shift).max() < 1e-6)
    True
    """
    b = _Side.prepare(target_points, target.topology)
    for attempt in range(NUDGES):
        turn = rotations_about(AXIS[None] / np.linalg.norm(AXIS) * NUDGE * attempt)[0]
        a = _Side.prepare(source_points @ turn.T, source.topology)
        found = _refined(a, b)
        if found is not None:
            return found
    raise SolveError(
        "two triangulations without folds in general position", f"neither after {NUDGES} small turns", "check both maps' certificates"
    )


def _refined(a: _Side, b: _Side) -> Overlay | None:
    """The refinement; None if a sign is open or the pieces do not fit."""
    (a_face, a_weights), (b_face, b_weights) = (
        Locator.prepare(b.points, b.topology).locate(a.points),
        Locator.prepare(a.points, a.topology).locate(b.points),
    )
    if min(a_weights.min(), b_weights.min()) < GENERIC:
        return None
    crossings = _crossed(a, b, a_face)
    if crossings is None:
        return None
    faces = _faces(a, b, crossings)
    size = len(a.points) + len(b.points) + len(crossings.edge)
    if faces is None:
        return None
    topology = Topology(faces, size)
    if topology.euler_characteristic != 2:
        return None
    on_source = _places(a, (b_face, b_weights), a.canonical[crossings.edge], crossings.source_weight)
    target_first = SurfacePoints(a_face, a_weights)
    on_target = _places(b, (target_first.faces, target_first.weights), crossings.halfedge, crossings.target_weight)
    moved = np.r_[
        np.arange(len(b.points), len(b.points) + len(a.points)), np.arange(len(b.points)), np.arange(len(a.points) + len(b.points), size)
    ]
    return Overlay(topology, on_source, SurfacePoints(on_target.faces[moved], on_target.weights[moved]))


def _places(
    side: _Side, others: tuple[np.ndarray, np.ndarray], halfedges: Int[np.ndarray, "x"], end: Float[np.ndarray, "x"]
) -> SurfacePoints:
    """Own vertices, the other mesh's vertices, and points of half-edges by the weights of their ends, as places on a mesh."""
    n = len(side.points)
    corner = np.empty(n, np.int64)
    corner[side.topology.faces.ravel()] = np.arange(3 * len(side.topology.faces))
    own, cut = np.zeros((n, 3)), np.zeros((len(end), 3))
    own[np.arange(n), corner % 3] = 1
    rows, c = np.arange(len(end)), halfedges % 3
    cut[rows, c], cut[rows, (c + 1) % 3] = 1 - end, end
    return SurfacePoints(np.concatenate([corner // 3, others[0], halfedges // 3]), np.vstack([own, others[1], cut]))


def _crossed(a: _Side, b: _Side, face: Int[np.ndarray, "n"]) -> _Crossings | None:
    """Walk each edge of a through b; None where a sign is open."""
    ends = np.ascontiguousarray(a.topology.halfedges[a.canonical])
    mesh = (b.points, np.array(b.topology.faces).ravel(), np.array(b.topology.twins))
    offsets, nothing = np.zeros(len(ends) + 1, np.int64), (np.zeros(0, np.int64), np.zeros((0, 2)))
    if not _walk_edges(a.points, ends, face, mesh, offsets, nothing):
        return None
    offsets = np.append(0, np.cumsum(offsets[:-1]))
    halfedge, weights = np.empty(offsets[-1], np.int64), np.empty((offsets[-1], 2))
    _walk_edges(a.points, ends, face, mesh, offsets, (halfedge, weights))
    edge = np.repeat(np.arange(len(ends)), np.diff(offsets))
    return _Crossings(edge, np.arange(len(edge)) - offsets[edge], halfedge, weights[:, 0], weights[:, 1])


@kernel
def _walk_edges(points, ends, face, mesh, offsets, out):  # type: ignore[no-untyped-def]
    # First with empty out (halfedges (x,), weights (x, 2)): counts the crossings of each edge into offsets (e + 1,). Then with
    # room for them, offsets saying where each edge's begin. False where a sign is open.
    (q, corner, twin), (halfedges, weights) = mesh, out
    for e in range(len(ends)):
        p0, p1 = points[ends[e, 0]], points[ends[e, 1]]
        nx, ny, nz = p0[1] * p1[2] - p0[2] * p1[1], p0[2] * p1[0] - p0[0] * p1[2], p0[0] * p1[1] - p0[1] * p1[0]
        least = GENERIC * np.sqrt(nx * nx + ny * ny + nz * nz)
        f, last, count = face[ends[e, 0]], face[ends[e, 1]], 0
        while f != last:
            onward = -1
            for c in range(3):
                h = 3 * f + c
                i, j = corner[h], corner[following(h)]
                right = nx * q[i, 0] + ny * q[i, 1] + nz * q[i, 2]
                left = nx * q[j, 0] + ny * q[j, 1] + nz * q[j, 2]
                if abs(right) < least or abs(left) < least:
                    return False
                if right < 0 and left > 0:
                    onward = h
                    break
            if onward < 0 or count > len(corner):
                return False
            if len(halfedges):
                mx, my, mz = (
                    q[i, 1] * q[j, 2] - q[i, 2] * q[j, 1],
                    q[i, 2] * q[j, 0] - q[i, 0] * q[j, 2],
                    q[i, 0] * q[j, 1] - q[i, 1] * q[j, 0],
                )
                before, after = mx * p0[0] + my * p0[1] + mz * p0[2], -(mx * p1[0] + my * p1[1] + mz * p1[2])
                halfedges[offsets[e] + count] = onward
                weights[offsets[e] + count, 0] = min(max(before / (before + after), 0.0), 1.0)
                weights[offsets[e] + count, 1] = -right / (left - right)
            count += 1
            f = twin[onward] // 3
        if not len(halfedges):
            offsets[e] = count
    return True


@dataclass(frozen=True, eq=False)
class _Chains:
    """Edges of one triangulation, cut at their crossings: half-edges of the pieces.

    Piece k of an edge is number first[edge] + k; its half-edge in the canonical direction is twice that, the other one more.
    """

    side: _Side
    first: Int[np.ndarray, "e1"]

    def leaving(self, halfedges: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
        """The first piece of a half-edge, seen from its start."""
        edge = self.side.edge[halfedges]
        forward = halfedges == self.side.canonical[edge]
        return np.where(forward, 2 * self.first[edge], 2 * (self.first[edge + 1] - 1) + 1)

    def arriving(self, halfedges: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
        """The last piece of a half-edge, before its end."""
        return self.leaving(self.side.topology.twins[halfedges]) ^ 1


def _faces(a: _Side, b: _Side, crossings: _Crossings) -> Int[np.ndarray, "m 3"] | None:
    """Triangles of the refinement."""
    n_crossings, n = len(crossings.edge), len(a.points) + len(b.points)
    a_chains = _Chains(a, np.append(0, np.cumsum(1 + np.bincount(crossings.edge, minlength=len(a.canonical)))))
    b_edge = b.edge[crossings.halfedge]
    first = a_chains.first[-1] + np.append(0, np.cumsum(1 + np.bincount(b_edge, minlength=len(b.canonical))))
    b_chains = _Chains(b, first)
    onward = np.full(2 * first[-1], -1, np.int64)
    origin = np.full(2 * first[-1], -1, np.int64)
    for chains, shift in ((a_chains, 0), (b_chains, len(a.points))):
        h = np.arange(len(chains.side.edge))
        onward[chains.arriving(h)] = chains.leaving(h - h % 3 + (h + 1) % 3)
        origin[chains.leaving(h)] = chains.side.topology.halfedges[:, 0] + shift
    upwards = crossings.halfedge == b.canonical[b_edge]  # whether left of the source's edge is forward along the target's
    before_a = a_chains.first[crossings.edge] + crossings.rank
    before_b = first[b_edge] + _ranks(b_edge, np.where(upwards, crossings.target_weight, 1 - crossings.target_weight))
    b_left, b_right = np.where(upwards, 2 * before_b + 2, 2 * before_b + 1), np.where(upwards, 2 * before_b + 1, 2 * before_b + 2)
    onward[2 * before_a], onward[2 * before_a + 3] = b_left, b_right
    onward[b_right ^ 1], onward[b_left ^ 1] = 2 * before_a + 1, 2 * before_a + 2
    for leaving in (2 * before_a + 1, 2 * before_a + 2, b_left, b_right):
        origin[leaving] = n + np.arange(n_crossings)
    return _triangles(onward, origin)


def _ranks(edge: Int[np.ndarray, "x"], place: Float[np.ndarray, "x"]) -> Int[np.ndarray, "x"]:
    """The rank of each crossing among those of its edge."""
    order = np.lexsort((place, edge))
    sorted_edges = edge[order]
    starts = np.searchsorted(sorted_edges, sorted_edges)
    ranks = np.empty(len(edge), np.int64)
    ranks[order] = np.arange(len(edge)) - starts
    return ranks


def _triangles(onward: Int[np.ndarray, "h"], origin: Int[np.ndarray, "h"]) -> Int[np.ndarray, "m 3"] | None:
    """The cycles of half-edges, cut into fans from their lowest one; None if one is no polygon of 3 to 6 corners."""
    start = np.arange(len(onward))
    orbit = [start]
    length, lowest = np.zeros(len(start), np.int64), np.ones(len(start), bool)
    for k in range(1, MOST_CORNERS + 1):
        orbit.append(onward[orbit[-1]])
        length[(orbit[-1] == start) & (length == 0)] = k
        lowest &= orbit[-1] >= start
    if (onward < 0).any() or (origin < 0).any() or length.min() < 3:
        return None
    fans = [_fan(orbit, origin, lowest & (length > k + 1), k) for k in range(1, MOST_CORNERS - 1)]
    return np.concatenate(fans)


def _fan(orbit: list[np.ndarray], origin: Int[np.ndarray, "h"], of: Bool[np.ndarray, "h"], k: int) -> Int[np.ndarray, "m 3"]:
    """The k-th triangles of the fans that start at the chosen half-edges."""
    return np.stack([origin[orbit[c][of]] for c in (0, k, k + 1)], axis=1)
