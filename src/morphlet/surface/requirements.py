"""Closed, oriented, one piece, genus 0: say what is missing, and where."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Int

from morphlet.errors import MeshError
from morphlet.surface.doubles import repeated
from morphlet.surface.fans import edge_uses, fans
from morphlet.surface.mesh import Mesh, Topology

FEWEST_VERTICES = 4
"""The tetrahedron is the smallest simplicial sphere."""
MEND = "try repair(mesh) / morphlet repair"


def require_sphere(mesh: Mesh) -> None:
    """Refuse a mesh that is not a simplicial sphere. Only topology counts: positions may coincide.

    Parameters
    ----------
    mesh
        Any mesh.

    Raises
    ------
    MeshError
        Unless the mesh has at least four vertices, all in faces, each face with three vertices and no face twice, is
        manifold, consistently oriented, connected, closed and without handles; checked in this order.

    Notes
    -----
    O(m log m). Parts are counted before holes and handles: a sphere beside a torus has Euler characteristic 2.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.requirements import require_sphere
    >>> require_sphere(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    Traceback (most recent call last):
    morphlet.errors.MeshError: needed a closed surface of at least 4 vertices; found 3 vertices and 1 face; ...
    """
    checks: tuple[Callable[[Topology], None], ...] = (_size, _faces, _directions, _vertices, _parts, _fans, _boundary, _handles)
    for check in checks:
        check(mesh.topology)


def require_area(mesh: Mesh) -> None:
    """Refuse a mesh of which no face has an area.

    Raises
    ------
    MeshError
        If all areas are zero, or too small for double precision.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.surface.requirements import require_area
    >>> require_area(Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))
    Traceback (most recent call last):
    morphlet.errors.MeshError: needed a surface with area; found 1 face without any; pass a triangle mesh, in units that fit its size
    """
    if not mesh.area > 0:
        found = f"{many(mesh.n_faces, 'face')} without any"
        raise MeshError("a surface with area", found, "pass a triangle mesh, in units that fit its size")


def degenerate(faces: Int[np.ndarray, "m 3"]) -> np.ndarray:
    """Whether a face repeats a vertex."""
    return (faces == np.roll(faces, -1, axis=1)).any(axis=1)


def pinched(topology: Topology) -> Int[np.ndarray, "k"]:
    """Vertices whose faces form more than one fan across two-face edges."""
    faces, n = topology.faces, topology.n_vertices
    label = fans(faces, edge_uses(faces, n).used(2))
    owner = faces.ravel()[np.unique(label, return_index=True)[1]]
    return np.flatnonzero(np.bincount(owner, minlength=n) > 1)


def many(count: int, noun: str) -> str:
    """The count with its noun: '1 face', '2 faces'."""
    plural = f"{noun.removesuffix('ex')}ices" if noun.endswith("vertex") else f"{noun}s"
    return f"{count} {noun if count == 1 else plural}"


def _size(topology: Topology) -> None:
    n, m = int(topology.referenced.sum()), len(topology.faces)
    if n < FEWEST_VERTICES:
        found = f"{many(n, 'vertex')} and {many(m, 'face')}" if m else "no faces"
        raise MeshError(f"a closed surface of at least {FEWEST_VERTICES} vertices", found, "pass a triangle mesh that encloses a volume")


def _faces(topology: Topology) -> None:
    bad = np.flatnonzero(degenerate(topology.faces))
    if len(bad):
        raise MeshError("faces of three different vertices", f"{many(len(bad), 'face')} with a repeated vertex", MEND, bad)
    again = np.flatnonzero(repeated(topology.faces))
    if len(again):
        raise MeshError("each face once", f"{many(len(again), 'face')} with the same vertices as an earlier one", MEND, again)


def _directions(topology: Topology) -> None:
    doubled = np.unique(topology.halfedges[topology.halfedge_counts[:, 0] > 1], axis=0)
    if len(doubled):
        found = f"{many(len(doubled), 'directed edge')} used twice (non-manifold or inconsistent orientation)"
        raise MeshError("a manifold, consistently oriented surface", found, MEND, doubled)


def _vertices(topology: Topology) -> None:
    alone = np.flatnonzero(~topology.referenced)
    if len(alone):
        raise MeshError("every vertex in a face", f"{many(len(alone), 'vertex')} in none", MEND, alone)


def _parts(topology: Topology) -> None:
    parts, first = np.unique(topology.components, return_index=True)
    if len(parts) > 1:
        advice = "keep the largest: RepairOptions(component='largest') / --component largest, or pass one part"
        raise MeshError("one connected surface", f"{len(parts)} connected components", advice, first)


def _fans(topology: Topology) -> None:
    pinches = pinched(topology)
    if len(pinches):
        rim = np.isin(pinches, topology.halfedges[topology.twins < 0])
        kind = "non-manifold boundary vertex" if rim.any() else "non-manifold vertex"
        raise MeshError("one fan of faces round each vertex", many(len(pinches), kind), MEND, pinches)


def _boundary(topology: Topology) -> None:
    loops = topology.boundary_loops
    if loops:
        found = f"{many(len(loops), 'boundary loop')} of {sum(map(len, loops))} edges in all"
        advice = "fill the holes: RepairOptions(fill='all') / --fill all"
        raise MeshError("a closed surface", found, advice, np.concatenate(loops))


def _handles(topology: Topology) -> None:
    chi = topology.euler_characteristic
    if chi != 2:
        genus = (2 - chi) // 2
        advice = f"if the handles are small, cut them: RepairOptions(fill='all', cut_handles={genus}) / --cut-handles {genus}"
        found = f"a genus {genus} surface (chi = {chi}, {many(len(topology.boundary_loops), 'boundary loop')})"
        raise MeshError("a surface of genus 0 for a spherical map", found, advice)
