"""Mending a mesh: weld, orient, split, cut and fill, with a record of what was done and of where everything went.

The steps, in this order; each does nothing where nothing is wrong, so that a clean mesh comes back as it was:
1. drop faces that repeat a vertex, walls and small flaps of two faces back to back (see `doubles`), faces with the
   vertices of an earlier face in any order, and vertices in no face;
2. weld vertices on boundary edges at exactly equal positions (texture seams), never inner ones; drop as in 1;
3. orient: neighbours across two-face edges agree, the fewest faces turn;
4. split: faces round a vertex that two-face edges do not join part, which opens non-manifold edges and vertices;
5. keep the component with the largest area, of equal ones that with the most faces;
6. cut handles along short loops, whose two sides are always filled;
7. fill boundary loops;
8. turn closed parts that enclose a negative volume outwards.
"""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Literal, get_args

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from morphlet import _arrays
from morphlet.errors import InputError, MeshError
from morphlet.surface.doubles import back_to_back, repeated
from morphlet.surface.fans import components, edge_uses, opposed, separate
from morphlet.surface.handles import cut_handles
from morphlet.surface.holes import lids, perimeter
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.nearest import nearest
from morphlet.surface.orientation import disagreeing, inward, turned
from morphlet.surface.points import SurfacePoints
from morphlet.surface.requirements import degenerate, many, require_sphere

Fill = Literal["none", "small", "all"]
Component = Literal["all", "largest"]

SMALL_HOLE = 0.1
"""A hole is small if its perimeter is below this fraction of the bounding-box diagonal."""


@dataclass(frozen=True, eq=False)
class Repair:
    """One thing that was done, and how often.

    Parameters
    ----------
    what
        The repair in words, past tense.
    count
        How many elements it concerned.
    """

    what: str
    count: int


@dataclass(frozen=True, eq=False)
class RepairOptions:
    """Which repairs are made; each only where something is wrong.

    Parameters
    ----------
    weld
        Join vertices on boundary edges at exactly equal positions.
    orient
        Reverse faces so that neighbours agree and closed parts look outwards.
    split
        Part faces that meet only at a vertex or along a non-manifold edge. Cutting and filling need a mesh that is
        manifold after this step.
    fill
        Which boundary loops to close: none, those with a perimeter below 10 % of the bounding-box diagonal, all.
    component
        Keep all parts or the one with the largest area.
    cut_handles
        How many handles may be cut, at most.
    drop
        Drop faces that repeat a vertex, lie back to back, or occur twice. The other repairs count on it.

    Examples
    --------
    >>> from morphlet.surface.repair import RepairOptions
    >>> RepairOptions(fill="small").weld
    True
    """

    weld: bool = True
    orient: bool = True
    split: bool = True
    fill: Fill = "none"
    component: Component = "all"
    cut_handles: int = 0
    drop: bool = True

    def __post_init__(self) -> None:
        for name, allowed in (("fill", get_args(Fill)), ("component", get_args(Component))):
            if getattr(self, name) not in allowed:
                raise InputError(f"{name} to be one of {', '.join(allowed)}", repr(getattr(self, name)), "choose one of these")
        if self.cut_handles < 0:
            raise InputError("cut_handles of 0 or more", str(self.cut_handles), "say how many handles may be cut")


MENDED = RepairOptions()
"""What `repair` does unless told otherwise."""
CLOSED = RepairOptions(fill="all")
"""What `close` does unless told otherwise."""


@dataclass(frozen=True, eq=False)
class Repaired:
    """A mended mesh, and where the vertices and faces of the source went.

    Parameters
    ----------
    source
        The mesh as given.
    mesh
        The mended mesh. Vertices and faces added by filling come last.
    vertex_map
        Vertex of `mesh` that each source vertex became, the first copy where it was split. A source vertex without an
        answer (in no face, on a dropped part) takes that of the nearest answered one; -1 only if no face is left.
    valid
        Whether a source vertex has an answer of its own; then its position has not changed.
    face_map
        Source face of each face of `mesh`, -1 for added faces.
    flipped
        Whether corners 1 and 2 of a face are swapped against its source face.
    repairs
        What was done, in order.
    """

    source: Mesh
    mesh: Mesh
    vertex_map: Int[np.ndarray, "n"]
    valid: Bool[np.ndarray, "n"]
    face_map: Int[np.ndarray, "m"]
    flipped: Bool[np.ndarray, "m"]
    repairs: tuple[Repair, ...]

    def __post_init__(self) -> None:
        for name in ("vertex_map", "valid", "face_map", "flipped"):
            object.__setattr__(self, name, _arrays.freeze(np.array(getattr(self, name))))

    def __reduce__(self) -> tuple[type["Repaired"], tuple[object, ...]]:
        return Repaired, tuple(getattr(self, field.name) for field in fields(self))

    @property
    def n_real_vertices(self) -> int:
        """Number of vertices of `mesh` that stem from the source; the virtual ones of filled holes come after."""
        return int(self.mesh.faces[self.face_map >= 0].max(initial=-1)) + 1

    @cached_property
    def source_vertices(self) -> Int[np.ndarray, "N"]:
        """A vertex as given for each of the mended mesh: the first of those that were joined, the nearest for one that fills a hole."""
        own, back = np.flatnonzero(self.valid)[::-1], np.full(self.mesh.n_vertices, -1)
        back[self.vertex_map[own]] = own
        added = back < 0
        if added.any():
            back[added] = own[cKDTree(self.source.vertices[own]).query(self.mesh.vertices[added])[1]]
        return _arrays.freeze(back)

    def to_source(self, points: SurfacePoints) -> SurfacePoints:
        """Places on `mesh` as places on `source`, in its face and corner order.

        Parameters
        ----------
        points
            Places on `mesh`; one on an added face goes to the nearest place on a face of the source.

        Returns
        -------
        SurfacePoints
            Places on `source`, at the same positions where the face is not an added one.

        Raises
        ------
        InputError
            If a face index is not one of `mesh`.
        MeshError
            If a place must move and `mesh` has no face of the source.
        """
        _arrays.index(points.faces, "faces of the points", (None,), self.mesh.n_faces)
        added = self.face_map[points.faces] < 0
        faces, weights = np.array(points.faces), np.array(points.weights)
        if added.any():
            real = np.flatnonzero(self.face_map >= 0)
            moved = nearest(_mesh(self.mesh.vertices, self.mesh.faces[real]), points.positions(self.mesh)[added])
            faces[added], weights[added] = real[moved.faces], moved.weights
        return SurfacePoints(self.face_map[faces], np.where(self.flipped[faces, None], weights[:, [0, 2, 1]], weights))


@dataclass(frozen=True, eq=False)
class _Draft:
    """A mesh under repair: what `Repaired` holds, and which source vertices were welded into one."""

    vertices: Float[np.ndarray, "k 3"]
    faces: Int[np.ndarray, "m 3"]
    face_map: Int[np.ndarray, "m"]
    flipped: Bool[np.ndarray, "m"]
    weld: Int[np.ndarray, "n"]
    one_sided: Bool[np.ndarray, "m"]
    cut: Bool[np.ndarray, "k"]
    repairs: tuple[Repair, ...]

    def noted(self, what: str, count: int) -> "_Draft":
        """With one more repair, if there was something to do."""
        return replace(self, repairs=(*self.repairs, Repair(what, int(count)))) if count else self

    def with_faces(self, keep: Bool[np.ndarray, "m"]) -> "_Draft":
        """Only these faces; no vertex goes."""
        if keep.all():
            return self
        rows = {name: getattr(self, name)[keep] for name in ("faces", "face_map", "flipped", "one_sided")}
        return replace(self, **rows)

    def with_copies(self, faces: Int[np.ndarray, "m 3"], origin: Int[np.ndarray, "k2"]) -> "_Draft":
        """Other faces, over vertices that are copies of the present ones."""
        return replace(self, faces=faces, vertices=self.vertices[origin], cut=self.cut[origin])

    def compact(self) -> "_Draft":
        """Without the vertices in no face."""
        used = np.unique(self.faces)
        if len(used) == len(self.vertices):
            return self
        return self.with_copies(np.searchsorted(used, self.faces), used)


def repair(mesh: Mesh, options: RepairOptions = MENDED) -> Repaired:
    """Mend a mesh.

    Parameters
    ----------
    mesh
        Anything a file holds.
    options
        Which repairs to make; the default welds, orients and splits, and neither fills nor drops parts.

    Returns
    -------
    Repaired
        The mended mesh, the maps from and to the source, and what was done.

    Raises
    ------
    MeshError
        If holes are to be filled or handles cut on a mesh that is not manifold because `split` is off.

    Notes
    -----
    O(m log m), and some ten shortest-path trees per handle cut. A one-sided part (Moebius strip) is cut open where its
    faces disagree. Every closed part is turned outwards, also the wall of a cavity. A handle's cut that touches a hole
    closes that hole too.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.repair import repair
    >>> mended = repair(Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 3, 2], [2, 0, 1]]))
    >>> [(r.what, r.count) for r in mended.repairs]
    [('dropped faces with the vertices of an earlier face', 1), ('reversed faces that disagreed with their neighbours', 1)]
    >>> mended.mesh.faces.tolist(), mended.face_map.tolist()
    ([[0, 1, 2], [0, 2, 3]], [0, 1])
    """
    return _finished(mesh, _mended(mesh, options))


def close(mesh: Mesh, options: RepairOptions = CLOSED) -> Repaired:
    """Mend a mesh into a simplicial sphere, or say why it is none: what spherical maps call.

    Parameters
    ----------
    mesh
        Anything a file holds.
    options
        Which repairs to make; the default also fills every hole, open discs too.

    Returns
    -------
    Repaired
        Its mesh satisfies `require_sphere`.

    Raises
    ------
    MeshError
        If the mended mesh is not closed, connected, oriented and of genus 0. The error's `elements` are those of the
        source.

    Notes
    -----
    O(m log m), as `repair`.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.repair import close
    >>> square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    >>> closed = close(square)
    >>> closed.mesh, closed.n_real_vertices
    (Mesh(5 vertices, 6 faces), 4)
    """
    draft = _mended(mesh, options)
    if draft.one_sided.any():
        twisted = draft.face_map[draft.one_sided]
        advice = "cut the surface open, or drop these faces"
        raise MeshError("an orientable surface", f"a one-sided part of {many(len(twisted), 'face')}", advice, twisted)
    repaired = _finished(mesh, draft)
    try:
        require_sphere(repaired.mesh)
    except MeshError as error:
        back = _origins(repaired)
        elements = back[np.array(error.elements, np.int64)] if error.elements else ()
        raise MeshError(error.needed, error.found, error.advice, elements) from error
    return repaired


def _mended(mesh: Mesh, options: RepairOptions) -> _Draft:
    """All steps, in order."""
    steps: list[tuple[bool, Callable[[_Draft, RepairOptions], _Draft]]] = [
        (True, _dropped),
        (options.weld, _welded),
        (True, _oriented),
        (options.split, _split),
        (options.component == "largest", _largest),
        (options.cut_handles > 0, _handles_cut),
        (options.fill != "none" or options.cut_handles > 0, _filled),
        (options.orient, _outward),
    ]
    draft = _drafted(mesh)
    for wanted, step in steps:
        draft = step(draft, options) if wanted and len(draft.faces) else draft
    return draft.compact()


def _drafted(mesh: Mesh) -> _Draft:
    n, m = mesh.n_vertices, mesh.n_faces
    no_face, no_vertex = np.zeros(m, bool), np.zeros(n, bool)
    draft = _Draft(mesh.vertices, mesh.faces, np.arange(m), no_face, np.arange(n), no_face, no_vertex, ())
    return draft.noted("dropped vertices in no face", int(n - mesh.topology.referenced.sum()))


def _dropped(draft: _Draft, options: RepairOptions) -> _Draft:
    if not options.drop:
        return draft
    bad = degenerate(draft.faces)
    draft = draft.with_faces(~bad).noted("dropped faces that repeat a vertex", int(bad.sum()))
    back = back_to_back(draft.faces, len(draft.vertices))
    draft = draft.with_faces(~back).noted("dropped faces lying back to back", int(back.sum()))
    again = repeated(draft.faces)
    return draft.with_faces(~again).noted("dropped faces with the vertices of an earlier face", int(again.sum()))


def _welded(draft: _Draft, options: RepairOptions) -> _Draft:
    """Vertices on one-face edges at the same position become the first of them."""
    open_ends = edge_uses(draft.faces, len(draft.vertices)).used(1)[:, 0]
    rim = np.unique(Topology(draft.faces, len(draft.vertices)).halfedges[open_ends])
    _, first, place = np.unique(draft.vertices[rim] + 0.0, axis=0, return_index=True, return_inverse=True)  # + 0.0: -0.0 is 0.0
    if len(first) == len(rim):
        return draft
    image = np.arange(len(draft.vertices))
    image[rim] = rim[first[place.ravel()]]
    draft = replace(draft, faces=image[draft.faces], weld=image)
    return _dropped(draft.noted("welded coincident boundary vertices", len(rim) - len(first)), options)


def _oriented(draft: _Draft, options: RepairOptions) -> _Draft:
    """Also without turning faces it is marked which of them no choice can orient."""
    reverse, one_sided = disagreeing(draft.faces, len(draft.vertices))
    reverse &= options.orient
    draft = _reversed(replace(draft, one_sided=one_sided), reverse)
    draft = draft.noted("reversed faces that disagreed with their neighbours", int(reverse.sum()))
    return draft.noted("left faces of one-sided parts as they were", int(one_sided.sum()))


def _reversed(draft: _Draft, reverse: Bool[np.ndarray, "m"]) -> _Draft:
    return replace(draft, faces=turned(draft.faces, reverse), flipped=draft.flipped ^ reverse) if reverse.any() else draft


def _split(draft: _Draft, _: RepairOptions) -> _Draft:
    pairs = edge_uses(draft.faces, len(draft.vertices)).used(2)
    faces, origin = separate(draft.faces, len(draft.vertices), pairs[opposed(draft.faces, pairs)])
    added = len(origin) - len(draft.vertices)
    return draft.with_copies(faces, origin).noted("added vertices to part what met at a non-manifold edge or vertex", added)


def _largest(draft: _Draft, _: RepairOptions) -> _Draft:
    mesh = _mesh(draft.vertices, draft.faces)
    part = mesh.topology.components[draft.faces[:, 0]]
    area, size = np.bincount(part, mesh.face_areas), np.bincount(part)
    best = max(range(len(area)), key=lambda c: (area[c], size[c]))
    draft = draft.with_faces(part == best).compact()
    return draft.noted("dropped components other than the largest", len(area) - 1)


def _handles_cut(draft: _Draft, options: RepairOptions) -> _Draft:
    draft = draft.compact()
    faces, origin, lengths = cut_handles(draft.vertices, draft.faces, options.cut_handles)
    copied = np.bincount(origin, minlength=len(draft.vertices)) > 1
    draft = replace(draft, cut=copied).with_copies(faces, origin)
    return draft.noted(f"cut handles along loops of length {', '.join(f'{length:.4g}' for length in lengths)}", len(lengths))


def _filled(draft: _Draft, options: RepairOptions) -> _Draft:
    draft = draft.compact()
    loops = _wanted(draft, options)
    centres, lids_ = lids(draft.vertices, loops)
    more = len(lids_)
    filled = replace(
        draft,
        vertices=np.concatenate([draft.vertices, centres]),
        faces=np.concatenate([draft.faces, lids_]),
        face_map=np.r_[draft.face_map, np.full(more, -1)],
        flipped=np.r_[draft.flipped, np.zeros(more, bool)],
        one_sided=np.r_[draft.one_sided, np.zeros(more, bool)],
        cut=np.r_[draft.cut, np.zeros(len(centres), bool)],
    )
    lengths = ", ".join(str(len(loop)) for loop in loops[:5]) + (", ..." if len(loops) > 5 else "")
    return filled.noted(f"filled boundary loops of {lengths} edges", len(loops))


def _fillable(draft: _Draft) -> list[Int[np.ndarray, "_"]]:
    """Boundary loops but those of a lone triangle: a second face on its vertices would enclose nothing."""
    topology = Topology(draft.faces, len(draft.vertices))
    part_size = np.bincount(topology.components[draft.faces[:, 0]])
    return [loop for loop in topology.boundary_loops if part_size[topology.components[loop[0]]] > 1]


def _wanted(draft: _Draft, options: RepairOptions) -> list[Int[np.ndarray, "_"]]:
    """The loops that the options ask to fill, and those that cutting handles has opened."""
    diagonal = float(np.linalg.norm(np.ptp(draft.vertices, axis=0)))
    limit = {"none": -np.inf, "small": SMALL_HOLE * diagonal, "all": np.inf}[options.fill]
    return [loop for loop in _fillable(draft) if perimeter(draft.vertices, loop) <= limit or draft.cut[loop].any()]


def _outward(draft: _Draft, _: RepairOptions) -> _Draft:
    reverse = inward(draft.vertices, draft.faces)
    part = components(len(draft.faces), *(edge_uses(draft.faces, len(draft.vertices)).used(2).T // 3))
    return _reversed(draft, reverse).noted("turned closed components outwards", len(np.unique(part[reverse])))


def _finished(source: Mesh, draft: _Draft) -> Repaired:
    """The maps of the source's vertices: by the first corner kept, else by what it was welded to, else the nearest."""
    unchanged = np.array_equal(draft.faces, source.faces) and len(draft.vertices) == source.n_vertices
    mesh = source if unchanged else _mesh(draft.vertices, draft.faces)
    real = draft.face_map >= 0
    corners = source.faces[draft.face_map[real]].ravel()
    images = turned(draft.faces[real], draft.flipped[real]).ravel()
    vertex_map = np.full(source.n_vertices, -1)
    vertex, first = np.unique(corners, return_index=True)
    vertex_map[vertex] = images[first]
    welded_to, first = np.unique(draft.weld[vertex], return_index=True)
    answer = np.full(source.n_vertices, -1)
    answer[welded_to] = vertex_map[vertex[first]]
    vertex_map = np.where(vertex_map < 0, answer[draft.weld], vertex_map)
    valid = vertex_map >= 0
    if valid.any() and not valid.all():
        _, near = cKDTree(source.vertices[valid]).query(source.vertices[~valid])
        vertex_map[~valid] = vertex_map[valid][near]
    return Repaired(source, mesh, vertex_map, valid, draft.face_map, draft.flipped & real, draft.repairs)


def _mesh(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Mesh:
    return Mesh(vertices, Topology(faces, len(vertices)))


def _origins(repaired: Repaired) -> Int[np.ndarray, "k"]:
    """A source vertex of each vertex of the mended mesh, -1 for virtual ones."""
    back = np.full(repaired.mesh.n_vertices, -1)
    real = repaired.face_map >= 0
    corners = turned(repaired.mesh.faces[real], repaired.flipped[real])
    back[corners] = repaired.source.faces[repaired.face_map[real]]
    return back
