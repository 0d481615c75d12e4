"""Which faces to turn round so that all look to one side, and outwards.

Pure functions that say which faces to reverse; reversing swaps corners 1 and 2.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.surface.fans import components, edge_uses, opposed

VOLUME_NOISE = 1e-12
"""A volume below this fraction of that of boxes on its faces' edges is rounding: it has no sign."""


def turned(faces: Int[np.ndarray, "m 3"], reverse: Bool[np.ndarray, "m"]) -> Int[np.ndarray, "m 3"]:
    """The faces, corners 1 and 2 swapped where asked."""
    return np.where(reverse[:, None], faces[:, [0, 2, 1]], faces)


def disagreeing(faces: Int[np.ndarray, "m 3"], n_vertices: int) -> tuple[Bool[np.ndarray, "m"], Bool[np.ndarray, "m"]]:
    """Faces to reverse so that neighbours across two-face edges agree, and faces of parts that no choice can orient.

    Every face has two sides; neighbouring sides are linked across edges, so that an orientable part falls into two
    sheets and a one-sided part (Moebius strip) into one. The sheet that reverses fewer faces is taken, of equal ones
    that of the first face. One-sided parts stay as they are.
    """
    m = len(faces)
    pairs = edge_uses(faces, n_vertices).used(2)
    f, g = pairs.T // 3
    cross = np.where(opposed(faces, pairs), 0, m)
    sheet = components(2 * m, np.r_[f, f + m], np.r_[g + cross, g + m - cross])
    front, back = sheet[:m], sheet[m:]
    reverse = front > back
    part = np.minimum(front, back)
    size, reversed_ = np.bincount(part), np.bincount(part, reverse)
    return reverse ^ (2 * reversed_ > size)[part] & (front != back), front == back


def inward(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Bool[np.ndarray, "m"]:
    """Faces of closed parts whose enclosed volume is negative. A volume that is only rounding has no sign."""
    uses = edge_uses(faces, len(vertices))
    pairs = uses.used(2)
    part = components(len(faces), *(pairs.T // 3))
    closed = np.ones(int(part.max(initial=-1)) + 1, bool)
    closed[part[uses.order[np.repeat(uses.count != 2, uses.count)] // 3]] = False
    _, first = np.unique(part, return_index=True)
    places = np.ldexp(vertices, -np.frexp(np.abs(vertices).max(initial=0.0))[1])  # the same but for a power of two: no product overflows
    a, b, c = (places[faces[:, k]] - places[faces[first, 0]][part] for k in range(3))
    across = np.cross(b, c)
    volume = np.bincount(part, np.einsum("ij,ij->i", a, across))
    size = np.bincount(part, np.linalg.norm(a, axis=1) * np.linalg.norm(across, axis=1))
    return (closed & (volume < -VOLUME_NOISE * size))[part]
