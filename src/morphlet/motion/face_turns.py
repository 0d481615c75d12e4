"""How faces turn between two shapes: the rotation of each, continued beyond half a turn from neighbour to neighbour."""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial.transform import Rotation

from morphlet.motion.gradients import adjacent_faces, turned
from morphlet.numerics.rotations import exponential
from morphlet.surface.mesh import Topology

SMALLEST = 1e-9
"""Radians that every difference of rotations gets added, since a spanning tree takes a zero for no edge."""
FULL_TURN = 2 * np.pi


def face_rotations(frames: Float[np.ndarray, "m 2 3"], gradients: Float[np.ndarray, "m 2 3"]) -> Float[np.ndarray, "m 3 3"]:
    """The rotation of each face that brings its frame nearest to its gradients; the smallest of several.

    Parameters
    ----------
    frames
        Orthonormal rows, or zeros, which do not turn.
    gradients
        Rows to come near to. If they are parallel the frame is laid on their line, if they are zero it does not turn.

    Examples
    --------
    >>> frame = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]])
    >>> face_rotations(frame, np.array([[[0.0, 3.0, 0.0], [-2.0, 0.0, 0.0]]]))[0].round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    after = turned(gradients, np.broadcast_to(np.eye(2), (len(frames), 2, 2)), np.zeros(frames.shape))
    solid = after.any(axis=(1, 2))
    out = np.broadcast_to(np.eye(3), (len(frames), 3, 3)).copy()
    out[solid] = _with_normals(after[solid]).transpose(0, 2, 1) @ _with_normals(frames[solid])
    lined = ~solid & gradients.any(axis=(1, 2)) & frames.any(axis=(1, 2))
    out[lined] = _onto_lines(frames[lined], gradients[lined])
    return out


def _onto_lines(frames: Float[np.ndarray, "k 2 3"], gradients: Float[np.ndarray, "k 2 3"]) -> Float[np.ndarray, "k 3 3"]:
    """Smallest rotations that take the tangents in which the gradients are long to where they point."""
    squares = np.einsum("fkd,fld->fkl", gradients, gradients)
    angle = 0.5 * np.arctan2(2 * squares[:, 0, 1], squares[:, 0, 0] - squares[:, 1, 1])
    share = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    first, then = (np.einsum("fk,fkd->fd", share, rows) for rows in (frames, gradients))
    then /= np.linalg.norm(then, axis=1, keepdims=True)
    axes, cosine = np.cross(first, then), np.einsum("fd,fd->f", first, then)
    sine = np.linalg.norm(axes, axis=1)
    opposite = (sine == 0) & (cosine < 0)
    axes[opposite], sine[opposite] = np.cross(frames[opposite, 0], frames[opposite, 1]), 1.0
    angles = np.where(opposite, np.pi, np.arctan2(sine, cosine))
    return exponential(axes * (angles / np.where(sine > 0, sine, 1.0))[:, None])


def unwrapped(turns: Float[np.ndarray, "m 3"], topology: Topology) -> Float[np.ndarray, "m 3"]:
    """Rotation vectors of the faces, by whole turns longer or shorter where that brings them nearer to their neighbours'.

    Parameters
    ----------
    turns
        Rotation vectors of half a turn at most.
    topology
        Of the faces.

    Returns
    -------
    turns
        The same rotations.

    Notes
    -----
    Neighbours are followed along the tree of the smallest differences, from the least turned face of each part: faces whose
    rotation is noise come last and lead nobody astray. O(m log m).

    Examples
    --------
    >>> strip = Topology([[0, 1, 2], [2, 1, 3], [2, 3, 4]], 5)
    >>> unwrapped(np.array([[0.0, 0, 1.5], [0, 0, 3], [0, 0, 4.5 - 2 * np.pi]]), strip)[:, 2]
    array([1.5, 3. , 4.5])
    """
    m = len(turns)
    tree = minimum_spanning_tree(_differences(turns, adjacent_faces(topology)))
    angles = np.linalg.norm(turns, axis=1)
    by_angle = np.argsort(angles, kind="stable")
    roots = by_angle[np.unique(connected_components(tree, directed=False)[1][by_angle], return_index=True)[1]]
    order, parents = breadth_first_order(_with_top(sp.csr_matrix(tree), roots), m, directed=False)
    axes = np.divide(turns, angles[:, None], out=np.zeros_like(turns), where=angles[:, None] > 0)
    return _followed(np.vstack([turns, np.zeros(3)]), axes, order, parents)[:m]


def _with_top(forest: sp.csr_matrix, roots: Int[np.ndarray, "r"]) -> sp.csr_matrix:
    """One tree: the roots joined to a node behind the others."""
    edges = forest.tocoo()
    m = forest.shape[0]
    rows, columns = np.append(edges.row, np.full(len(roots), m)), np.append(edges.col, roots)
    return sp.csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(m + 1, m + 1))


def _followed(
    turns: Float[np.ndarray, "m1 3"], axes: Float[np.ndarray, "m 3"], order: Int[np.ndarray, "m1"], parents: Int[np.ndarray, "m1"]
) -> Float[np.ndarray, "m1 3"]:
    """Whole turns added from parents to children."""
    out = turns.tolist()
    for (x, y, z), face in zip(axes[order[1:]].tolist(), order[1:].tolist(), strict=True):
        (a, b, c), (p, q, r) = out[face], out[parents[face]]
        more = FULL_TURN * round((x * (p - a) + y * (q - b) + z * (r - c)) / FULL_TURN)
        if more:
            out[face] = [a + more * x, b + more * y, c + more * z]
    return np.array(out)


def _differences(turns: Float[np.ndarray, "m 3"], pairs: Int[np.ndarray, "k 2"]) -> sp.csr_matrix:
    """Angles between the rotations of neighbours."""
    quaternions = Rotation.from_rotvec(turns).as_quat()
    cosine = np.abs(np.einsum("kd,kd->k", quaternions[pairs[:, 0]], quaternions[pairs[:, 1]]))
    angles = 2 * np.arccos(np.minimum(cosine, 1.0)) + SMALLEST
    return sp.csr_matrix((angles, (pairs.min(axis=1), pairs.max(axis=1))), shape=(len(turns), len(turns)))


def _with_normals(frames: Float[np.ndarray, "m 2 3"]) -> Float[np.ndarray, "m 3 3"]:
    """Two rows and their cross product."""
    return np.concatenate([frames, np.cross(frames[:, 0], frames[:, 1])[:, None]], axis=1)
