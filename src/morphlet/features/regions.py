"""Feature regions: the limbs of a surface, grown from their tips (step 2 of the paper).

The height of a vertex is its mean distance along the surface to all of it: high at the ends of limbs, low in the middle. A peak that
stands out from the pass over which one leaves it for a higher one is a tip; what rises around it above the first pass to another tip is its
region. Lengths are divided by the square root of the area, areas by the area: neither motion nor size nor numbering changes anything.
"""

from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.csgraph import connected_components

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.surface.distance import distances, farthest_points
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.requirements import require_area

SOURCES = 96
"""Farthest points whose distances stand for those to the whole surface."""
NEVER, ALWAYS = 0.025, 0.16
"""Persistence below which no peak is a tip, and above which each is, over sqrt(area): legs, tails and heads of animals were seen from 0.16
up, ears and muzzles up to 0.06."""
MOST = 10
"""Tips kept at most: matching tries their permutations."""
DETAIL = 0.01
"""Least persistence of a detail, over sqrt(area): below, peaks come and go with the triangles."""
MOST_DETAILS = 24
"""Tips and details kept at most: each costs one distance field."""


@dataclass(frozen=True)
class RegionOptions:
    """Which peaks are tips: those above `always`, none below `never`, and in between those above the widest gap (as a ratio).

    Parameters
    ----------
    never, always
        Persistence over sqrt(area); equal values make a plain threshold.
    most
        Tips kept at most, the most persistent ones.

    Examples
    --------
    >>> from morphlet.features.regions import RegionOptions
    >>> RegionOptions(never=0.035, always=0.035).most
    10
    """

    never: float = NEVER
    always: float = ALWAYS
    most: int = MOST

    def __post_init__(self) -> None:
        if not (0 < self.never <= self.always and self.most >= 1):
            found = f"never = {self.never}, always = {self.always}, most = {self.most}"
            raise InputError("0 < never <= always and most >= 1", found, "leave them at their defaults")


@dataclass(frozen=True, eq=False)
class Peaks:
    """The maxima of a height, most persistent first.

    Parameters
    ----------
    vertices
        Where they are.
    persistence
        Height above the pass over which a higher peak is reached; of the highest, above the lowest vertex.
    passes
        Height of that pass.
    elders
        The peak reached there, as a row of these arrays; the highest peak has itself.
    """

    vertices: Int[np.ndarray, "q"]
    persistence: Float[np.ndarray, "q"]
    passes: Float[np.ndarray, "q"]
    elders: Int[np.ndarray, "q"]

    def __post_init__(self) -> None:
        for field in fields(self):
            object.__setattr__(self, field.name, _arrays.freeze(np.array(getattr(self, field.name), order="C")))

    def __reduce__(self) -> tuple[Any, ...]:
        return Peaks, tuple(np.array(getattr(self, field.name)) for field in fields(self))


@dataclass(frozen=True, eq=False)
class Regions:
    """The feature regions of a mesh and the graph they form.

    Parameters
    ----------
    mesh
        The mesh.
    height
        Mean distance of each vertex to the surface, over sqrt(area).
    peaks
        All maxima of the height; the first k are the tips.
    levels
        Height above which each region lies.
    nodes
        Node of the graph that each vertex belongs to: its region, 0 to k - 1, or a connected piece of the rest, from k on.
    landmarks
        Vertices of the tips, then of the details: lesser peaks, such as ears, that tell where on a limb one is.
    distance
        Distance of each vertex from each landmark, over sqrt(area).

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.features.regions import find_regions
    >>> found = find_regions(sample("spiky"))
    >>> len(found), found.core_node
    (7, 7)
    """

    mesh: Mesh
    height: Float[np.ndarray, "n"]
    peaks: Peaks
    levels: Float[np.ndarray, "k"]
    nodes: Int[np.ndarray, "n"]
    landmarks: Int[np.ndarray, "l"]
    distance: Float[np.ndarray, "l n"]

    def __post_init__(self) -> None:
        for name in ("height", "levels", "nodes", "landmarks", "distance"):
            object.__setattr__(self, name, _arrays.freeze(np.array(getattr(self, name), order="C")))

    def __reduce__(self) -> tuple[Any, ...]:
        return Regions, tuple(getattr(self, field.name) for field in fields(self))

    def __len__(self) -> int:
        return len(self.levels)

    @property
    def tips(self) -> Int[np.ndarray, "k"]:
        """Vertex of each tip, the most persistent first."""
        return self.landmarks[: len(self)]

    @property
    def persistence(self) -> Float[np.ndarray, "k"]:
        """How far each tip stands out, over sqrt(area)."""
        return self.peaks.persistence[: len(self)]

    @property
    def gap(self) -> float:
        """By how much the last tip is more persistent than the first peak that is none, over sqrt(area). Small: the choice of the tips is
        open."""
        last = self.persistence[-1] if len(self) else ALWAYS
        dropped = self.peaks.persistence[len(self) :]
        return float(last - dropped[0]) if len(dropped) else float(last)

    @property
    def core(self) -> int:
        """The lowest vertex: the middle of the body."""
        return int(np.argmin(self.height))

    @cached_property
    def areas(self) -> Float[np.ndarray, "k"]:
        """Share of the surface in each region."""
        every = np.bincount(self.nodes, self.mesh.vertex_areas, int(self.nodes.max()) + 1)
        return _arrays.freeze(every[: len(self)] / self.mesh.area)

    @cached_property
    def edges(self) -> Int[np.ndarray, "e 2"]:
        """Nodes of the graph that touch along an edge of the mesh, smaller first."""
        pairs = np.sort(self.nodes[self.mesh.topology.edges], axis=1)
        return _arrays.freeze(np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0))

    @property
    def core_node(self) -> int:
        """The node with the highest degree, where step 10 of the paper starts; of equals, the lowest on the mean."""
        count = int(self.nodes.max()) + 1
        degree = np.bincount(self.edges.ravel(), minlength=count)
        size = np.bincount(self.nodes, self.mesh.vertex_areas, count)
        mean = np.bincount(self.nodes, self.mesh.vertex_areas * self.height, count) / np.maximum(size, np.finfo(float).tiny)
        return int(np.lexsort((mean, -degree))[0])


def find_regions(mesh: Mesh, options: RegionOptions | None = None) -> Regions:
    """The feature regions of a mesh.

    Parameters
    ----------
    mesh
        One connected surface, closed or not; all vertices in faces.
    options
        Which peaks are tips.

    Returns
    -------
    regions
        As many as stand out: none on a ball.

    Raises
    ------
    MeshError
        If the mesh has no area or more than one part.

    Notes
    -----
    Step 2 of the paper. O(n log n), nearly all of it in `SOURCES` distance fields: 0.6 s of one core for a horse of 8431 vertices, 4.5 s
    for one of 48485.

    References
    ----------
    Hilaga et al., Topology matching for fully automatic similarity estimation of 3D shapes, SIGGRAPH 2001 (the height).
    Edelsbrunner, Letscher and Zomorodian, Topological persistence and simplification, DCG 28, 2002.

    Examples
    --------
    >>> from morphlet import creature
    >>> from morphlet.features.regions import find_regions
    >>> deer = find_regions(creature("grazer", n_vertices=2000))  # four feet, nose or ear, tail
    >>> len(deer), bool(deer.areas.sum() < 1)
    (6, True)
    """
    require_area(mesh)
    wanted = options or RegionOptions()
    height = mean_distance(mesh)
    peaks = find_peaks(mesh.topology, height)
    count = count_tips(peaks.persistence, wanted)
    levels = _levels(peaks, count, float(np.average(height, weights=mesh.vertex_areas)))
    nodes = _nodes(mesh.topology, height, peaks.vertices[:count], levels)
    kept = max(count, min(int(np.sum(peaks.persistence >= DETAIL)), MOST_DETAILS))
    landmarks = peaks.vertices[:kept]
    return Regions(mesh, height, peaks, levels, nodes, landmarks, distances(mesh, landmarks) / np.sqrt(mesh.area))


def mean_distance(mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Mean distance along the surface from each vertex to all of it, over sqrt(area): a sum over `SOURCES` farthest points, each weighted
    with the area nearest to it."""
    sources, fields = farthest_points(mesh, SOURCES)
    share = np.bincount(np.argmin(fields, axis=0), mesh.vertex_areas, len(sources)) / mesh.area
    return share @ fields / np.sqrt(mesh.area)


def find_peaks(topology: Topology, height: Float[np.ndarray, "n"]) -> Peaks:
    """The maxima of a height and their persistence: where two rising sides meet, the lower peak ends (the elder rule).

    Parameters
    ----------
    topology
        One connected part.
    height
        A number per vertex; of equal ones the smaller index counts as higher.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.surface.mesh import Topology
    >>> strip = Topology([[0, 1, 2], [1, 3, 2], [2, 3, 4]], 5)
    >>> peaks = find_peaks(strip, np.array([5.0, 2.0, 3.0, 1.0, 4.0]))
    >>> peaks.vertices.tolist(), peaks.persistence.tolist(), peaks.passes.tolist(), peaks.elders.tolist()
    ([0, 4], [4.0, 1.0], [1.0, 3.0], [0, 0])
    """
    adjacency = topology.adjacency
    starts, neighbours = adjacency.indptr.tolist(), adjacency.indices.tolist()
    order = np.argsort(-height, kind="stable")
    rank = np.argsort(order, kind="stable").tolist()
    parent = [-1] * topology.n_vertices  # -1: not yet reached; the root of a component is its peak
    ends: list[tuple[int, int, int]] = []
    for v in order.tolist():
        roots = {_root(parent, u) for u in neighbours[starts[v] : starts[v + 1]] if parent[u] >= 0}
        parent[v] = elder = min(roots, key=rank.__getitem__, default=v)
        for root in roots - {elder}:
            parent[root] = elder
            ends.append((root, v, elder))
    died, where, into = np.array([(order[0], np.argmin(height), order[0]), *ends]).T
    passes = height[where]
    best = np.lexsort((np.array(rank)[died], passes - height[died]))
    row = np.zeros(topology.n_vertices, np.int64)
    row[died[best]] = np.arange(len(best))
    return Peaks(died[best], (height[died] - passes)[best], passes[best], row[into[best]])


def _root(parent: list[int], v: int) -> int:
    """The root of v's component, halving the way to it."""
    while parent[v] != v:
        parent[v] = v = parent[parent[v]]
    return v


def count_tips(persistence: Float[np.ndarray, "q"], options: RegionOptions) -> int:
    """How many peaks are tips: the widest gap between never and always decides.

    Examples
    --------
    >>> from morphlet.features.regions import RegionOptions, count_tips
    >>> count_tips(np.array([0.5, 0.3, 0.2, 0.03, 0.01]), RegionOptions())
    3
    """
    steps = np.clip(np.concatenate([[np.inf], persistence, [0.0]]), options.never, options.always)
    fewest, largest = int(np.sum(persistence > options.always)), int(np.sum(persistence >= options.never))
    widest = np.argmax((steps[:-1] / steps[1:])[fewest : max(largest, fewest) + 1])
    return min(fewest + int(widest), options.most)


def _levels(peaks: Peaks, count: int, mean: float) -> Float[np.ndarray, "k"]:
    """The first pass from each tip to another one; the mean height round a lonely tip.

    An elder is at least as persistent as those that end in it, so that it is a tip if one of them is.
    """
    if count < 2:
        return np.full(count, mean)
    levels, ended = peaks.passes[:count].copy(), np.flatnonzero(peaks.elders[:count] != np.arange(count))
    np.maximum.at(levels, peaks.elders[ended], peaks.passes[ended])
    return levels


def _nodes(topology: Topology, height: np.ndarray, tips: np.ndarray, levels: np.ndarray) -> Int[np.ndarray, "n"]:
    """Region of each vertex, then the connected pieces of the rest."""
    nodes = np.full(topology.n_vertices, -1, np.int64)
    for k, tip in enumerate(tips):
        piece = _pieces(topology, height > levels[k])
        nodes[piece == piece[tip]] = k
    rest = nodes < 0
    if rest.any():
        pieces = np.unique(_pieces(topology, rest)[rest], return_inverse=True)[1]
        nodes[rest] = len(tips) + pieces
    return nodes


def _pieces(topology: Topology, inside: np.ndarray) -> Int[np.ndarray, "n"]:
    """Connected piece of each vertex inside; negative outside, where no two are alike."""
    edges = topology.edges[inside[topology.edges].all(axis=1)]
    n = topology.n_vertices
    graph = sp.csr_matrix((np.ones(len(edges)), tuple(edges.T)), shape=(n, n))
    label = connected_components(graph, directed=False)[1]
    return np.where(inside, label, -1 - np.arange(n))
