"""Faces with the same three vertices: which to drop.

Two faces back to back enclose nothing. Both are dropped where they are a wall between two solids or debris on a
surface, so that the faces around close up; a sheet modelled with both its sides keeps one of them.
"""

import numpy as np
from jaxtyping import Bool, Int

from morphlet.surface.fans import components, edge_uses

FLAP_FACES = 4
"""A doubled sheet with a free rim that hangs on a surface is debris up to this size; a larger one is meant (a fin)."""


def repeated(faces: Int[np.ndarray, "m 3"]) -> Bool[np.ndarray, "m"]:
    """Whether an earlier face has the same three vertices, in any order."""
    order, same = _alike(faces)
    again = np.zeros(len(faces), bool)
    again[order[1:][same]] = True
    return again


def back_to_back(faces: Int[np.ndarray, "m 3"], n_vertices: int) -> Bool[np.ndarray, "m"]:
    """Pairs of opposite faces without which the surface closes up better than without one of each pair.

    Judged per connected sheet of pairs that touches other faces: dropping both must leave fewer edges with another
    number of faces than 0 or 2, and the sheet must have no free rim or be debris.
    """
    pairs = _opposite(faces)
    drop = np.zeros(len(faces), bool)
    if len(pairs):
        drop[pairs[_needless(faces, n_vertices, pairs[:, 0])]] = True
    return drop


def _alike(faces: Int[np.ndarray, "m 3"]) -> tuple[Int[np.ndarray, "m"], Bool[np.ndarray, "k"]]:
    """An order in which faces of the same vertices are neighbours, earlier ones first; whether each equals its predecessor."""
    rows = np.sort(faces, axis=1)
    order = np.lexsort(rows.T[::-1])
    return order, (rows[order[1:]] == rows[order[:-1]]).all(axis=1)


def _opposite(faces: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "k 2"]:
    """Faces that have the same vertices as exactly one other, the other way round."""
    order, same = _alike(faces)
    first = np.flatnonzero(same & ~np.r_[False, same[:-1]] & ~np.r_[same[1:], False])
    pairs = order[first[:, None] + np.arange(2)]
    ascents = (faces < np.roll(faces, -1, axis=1)).sum(axis=1)  # of the three steps round: two if even, one if odd
    return pairs[ascents[pairs[:, 0]] != ascents[pairs[:, 1]]]


def _needless(faces: Int[np.ndarray, "m 3"], n_vertices: int, doubled: Int[np.ndarray, "k"]) -> Bool[np.ndarray, "k"]:
    """Which pairs, named by their first face, to drop."""
    uses = edge_uses(faces, n_vertices)
    edge = np.empty(faces.size, np.int64)
    edge[uses.order] = np.repeat(np.arange(len(uses.count)), uses.count)
    touched, side = np.unique(edge.reshape(-1, 3)[doubled], return_inverse=True)
    within = np.bincount(side.ravel())
    others = uses.count[touched] - 2 * within
    k = len(doubled)
    sheet = components(k + len(touched), np.repeat(np.arange(k), 3), k + side.ravel())
    rim, n = sheet[k:], int(sheet.max()) + 1
    gain = np.bincount(rim, 1.0 * _closed(others) - _closed(others + within), n)
    touching, free = np.bincount(rim, others > 0, n), np.bincount(rim, (others == 0) & (within == 1), n)
    debris = np.bincount(sheet[:k], minlength=n) <= FLAP_FACES
    return ((gain > 0) & (touching > 0) & ((free == 0) | debris))[sheet[:k]]


def _closed(count: Int[np.ndarray, "e"]) -> Bool[np.ndarray, "e"]:
    """Whether an edge with so many faces is no boundary and manifold."""
    return (count == 0) | (count == 2)
