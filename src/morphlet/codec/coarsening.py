"""Coarse meshes of a closed surface, by edge collapses in the order of their quadric errors."""

from collections.abc import Callable

import numpy as np

from morphlet.codec.decimation import decimated
from morphlet.errors import MeshError
from morphlet.surface.mesh import Mesh
from morphlet.surface.requirements import MEND, degenerate, many, pinched

INTERMEDIATE = 20_000
"""Faces of a mesh that all coarse ones are made from: going down from all of a large mesh each time would cost more than the fits."""


def require_closed(mesh: Mesh) -> None:
    """Refuse a mesh that is not a closed, oriented manifold with an area; parts and handles may be many.

    Raises
    ------
    MeshError
        Unless each face has three vertices and each edge two faces that run along it in opposite directions, each vertex one fan of
        faces.
    """
    topology = mesh.topology
    if not mesh.n_faces or not mesh.area > 0:
        raise MeshError("a surface with an area", many(mesh.n_faces, "face"), "pass a triangle mesh that encloses a volume")
    bad = np.flatnonzero(degenerate(topology.faces))
    if len(bad):
        raise MeshError("faces of three different vertices", f"{many(len(bad), 'face')} with a repeated vertex", MEND, bad)
    open_ = np.flatnonzero(topology.twins < 0)
    if len(open_):
        advice = "fill the holes: RepairOptions(fill='all') / --fill all"
        raise MeshError("a closed surface", f"{many(len(open_), 'edge')} of one face", advice, topology.halfedges[open_])
    pinches = pinched(topology)
    if len(pinches):
        raise MeshError("one fan of faces round each vertex", many(len(pinches), "non-manifold vertex"), MEND, pinches)


def coarser(mesh: Mesh) -> Callable[[int], Mesh]:
    """What makes coarse meshes of about so many faces of a closed mesh, each without vertices that no face names.

    Notes
    -----
    O(m log m) at first, then O(log) of at most 20,000 faces.
    """
    middle = _collapsed(mesh, INTERMEDIATE) if mesh.n_faces > INTERMEDIATE else mesh
    return lambda faces: _collapsed(middle, faces)


def _collapsed(mesh: Mesh, faces: int) -> Mesh:
    """At most so many faces, or as few as can be."""
    coarse = decimated(mesh, faces) if faces < mesh.n_faces else mesh
    require_closed(coarse)
    return coarse
