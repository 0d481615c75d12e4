"""A mesh with fewer faces that lies close to the same surface."""

import numpy as np

from morphlet.errors import MeshError
from morphlet.surface.mesh import Mesh
from morphlet.surface.requirements import degenerate, many


def decimated(mesh: Mesh, faces: int) -> Mesh:
    """The mesh with edges collapsed until so many faces are left, by squared distances to the planes of its faces.

    Raises
    ------
    MeshError
        If faces repeat a vertex or are turned against their neighbours, or edges of more than two faces leave nothing to collapse.

    Notes
    -----
    O(n log n).

    References
    ----------
    Garland & Heckbert, Surface simplification using quadric error metrics, SIGGRAPH 1997.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.codec.decimation import decimated
    >>> decimated(sample("blob"), 200).n_faces
    200
    """
    import igl

    _require_plain(mesh)
    found = igl.qslim(np.array(mesh.vertices), np.array(mesh.faces), faces)
    vertices, corners = (np.asarray(part) for part in found[-4:-2])
    if not len(corners) or len(corners) >= mesh.n_faces:
        raise MeshError("a manifold with edges to collapse", f"{len(corners)} of {mesh.n_faces} faces left", "try repair(mesh)")
    return Mesh(vertices, corners.astype(np.int64))


def _require_plain(mesh: Mesh) -> None:
    """Refuse what igl does not come back from."""
    flat = np.flatnonzero(degenerate(mesh.faces))
    if len(flat):
        raise MeshError("faces of three vertices", f"{many(len(flat), 'face')} with fewer", "try repair(mesh)", flat)
    _ = mesh.topology.twins  # an error if faces are turned against their neighbours
