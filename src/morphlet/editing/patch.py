"""The part of a mesh that an edit has to look at: three layers around the unknown vertices.

The unknowns are the free vertices and the softly held handle vertices. A cell is a vertex whose rotation matters: an
unknown, or another corner of a face with an unknown (ring 1). The faces of all cells reach ring 2, whose positions matter.
The energy ``E = (1/3) sum_t sum_{v in t} sum_k c_tk |e'_k - R_v e_k|^2`` (spokes and rims) over these cells differs from that
of the whole mesh by a constant: the minimum is the whole mesh's. Vertices of the patch are numbered: unknowns, in
elimination order once there is one, then the other cells, then ring 2.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from morphlet.editing.kernels import Stars, renumbered, stars
from morphlet.editing.roi import Roi
from morphlet.surface.mesh import Mesh

NEEDLE = 1e-8
"""Least double area of a face over its longest edge squared: a thinner one weighs as if it were that thick. Weights stay
below 5e7, and a flat face is stiff, not infinite."""

SMALLEST = float(np.finfo(np.float64).tiny)
"""Divides the dot products, all zero, of a face that is one point."""


class Layers(NamedTuple):
    """The vertices and faces of a patch, by their numbers in the mesh."""

    unknowns: Int[np.ndarray, "u"]
    ring: Int[np.ndarray, "c"]  # the other cells
    rim: Int[np.ndarray, "b"]  # corners of the cells' faces that are no cells
    faces: Int[np.ndarray, "m"]


@dataclass(frozen=True, eq=False)
class Patch:
    """What of a mesh an edit looks at, ready for its kernels.

    Parameters
    ----------
    vertices
        Number in the mesh of each vertex of the patch: unknowns, other cells, ring 2.
    n_unknowns
        How many of them are unknown.
    rest
        Where they are at rest.
    faces
        Corners of the faces, as vertices of the patch.
    cotangents
        Half the cotangent of the angle at each corner, as the energy weighs the opposite edge.
    stars
        The star of each cell.
    """

    vertices: Int[np.ndarray, "p"]
    n_unknowns: int
    rest: Float[np.ndarray, "p 3"]
    faces: Int[np.ndarray, "m 3"]
    cotangents: Float[np.ndarray, "m 3"]
    stars: Stars

    @property
    def n_cells(self) -> int:
        """How many vertices have a rotation that matters."""
        return len(self.stars.starts) - 1

    @property
    def stiffness(self) -> Float[np.ndarray, "u"]:
        """Sum of the cotangent weights around each unknown."""
        starts = self.stars.starts[: self.n_unknowns + 1].astype(np.int64)
        row = np.repeat(np.arange(self.n_unknowns), np.diff(starts))
        return np.bincount(row, self.stars.weight[: starts[-1]], self.n_unknowns).astype(np.float64)

    @cached_property
    def scale(self) -> float:
        """Energy of the cells' edges at rest, ``(1/3) sum c |e|^2``: what energies are small against, part of the kernels' constant."""
        cells = (self.faces < self.n_cells).sum(axis=1) / 3
        return float(np.einsum("m,mc,mc->", cells, self.cotangents, edge_squares(self.rest, self.faces)))

    @cached_property
    def known_edges(self) -> tuple[Int[np.ndarray, "e 2"], Float[np.ndarray, "e"]]:
        """The cells' edges without unknown end, with their share in the energy."""
        known = self.faces >= self.n_unknowns
        t, k = np.nonzero(known[:, [1, 2, 0]] & known[:, [2, 0, 1]])
        cells = (self.faces[t] < self.n_cells).sum(axis=1) / 3
        return np.stack([self.faces[t, k - 2], self.faces[t, k - 1]], axis=1), cells * self.cotangents[t, k]

    def constant(self, positions: Float[np.ndarray, "p 3"]) -> float:
        """What the kernels' energy lacks: the edges at rest, and those without unknown end where they are now."""
        ends, share = self.known_edges
        edges = positions[ends[:, 0]] - positions[ends[:, 1]]
        return self.scale + float(np.einsum("e,ed,ed->", share, edges, edges))


def layers(mesh: Mesh, unknown: Bool[np.ndarray, "n"]) -> Layers:
    """The patch of these unknowns."""
    faces = mesh.faces
    cell = unknown.copy()
    cell[np.take(faces, np.flatnonzero(_touching(faces, unknown)), axis=0)] = True
    around = np.flatnonzero(_touching(faces, cell))
    reached = cell.copy()
    reached[np.take(faces, around, axis=0)] = True
    return Layers(np.nonzero(unknown)[0], np.nonzero(cell & ~unknown)[0], np.nonzero(reached & ~cell)[0], around)


def patch(mesh: Mesh, among: Layers, least: float = -np.inf) -> Patch:
    """The patch with its vertices in the order of the layers; cotangents (halved) below `least` are raised to it."""
    vertices = np.concatenate(among[:3])
    number = np.empty(mesh.n_vertices, np.int64)
    number[vertices] = np.arange(len(vertices))
    faces, rest = number[np.take(mesh.faces, among.faces, axis=0)], np.take(mesh.vertices, vertices, axis=0)
    cotangents = np.maximum(half_cotangents(rest, faces), least)
    n_unknowns = len(among.unknowns)
    return Patch(vertices, n_unknowns, rest, faces, cotangents, stars(faces, rest, cotangents, n_unknowns + len(among.ring), n_unknowns))


def reordered(before: Patch, order: Int[np.ndarray, "u"]) -> Patch:
    """The same patch with its unknowns in this order."""
    chosen = np.concatenate([order, np.arange(len(order), len(before.vertices))])
    place = np.empty_like(chosen)
    place[chosen] = np.arange(len(chosen))
    around, rest = renumbered(before.stars, chosen, place), np.take(before.rest, chosen, axis=0)
    return Patch(before.vertices[chosen], len(order), rest, place[before.faces], before.cotangents, around)


def unknown_vertices(roi: Roi) -> Bool[np.ndarray, "n"]:
    """Free vertices, and handle vertices held softly."""
    unknown = np.zeros(roi.mesh.n_vertices, bool)
    unknown[roi.free] = True
    if roi.weight is not None:
        unknown[roi.handle[np.isfinite(roi.weight)]] = True
    return unknown


def half_cotangents(positions: Float[np.ndarray, "p 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Half the cotangent of the angle at each corner; faces thinner than `NEEDLE` count as that thick."""
    edges = _edges(positions, faces)
    squares = [_dots(e, e) for e in edges]
    normal = [edges[0][k - 2] * edges[1][k - 1] - edges[0][k - 1] * edges[1][k - 2] for k in range(3)]
    double, least = np.sqrt(sum(part * part for part in normal)), NEEDLE * np.maximum(np.maximum(*squares[:2]), squares[2])
    dots = np.stack([_dots(edges[k - 2], edges[k - 1]) for k in range(3)], axis=1)
    return dots * (-0.5 / np.maximum(np.maximum(double, least), SMALLEST))[:, None]


def edge_squares(positions: Float[np.ndarray, "p 3"], faces: Int[np.ndarray, "m 3"]) -> Float[np.ndarray, "m 3"]:
    """Squared length of the edge opposite each corner."""
    return np.stack([_dots(edge, edge) for edge in _edges(positions, faces)], axis=1)


def _touching(faces: Int[np.ndarray, "m 3"], mask: Bool[np.ndarray, "n"]) -> Bool[np.ndarray, "m"]:
    """Whether a corner of the face is in the mask."""
    return mask[faces[:, 0]] | mask[faces[:, 1]] | mask[faces[:, 2]]


def _edges(positions: Float[np.ndarray, "p 3"], faces: Int[np.ndarray, "m 3"]) -> tuple[Float[np.ndarray, "3 m"], ...]:
    """The edge opposite each corner, coordinates in rows: they are added up several times faster than across."""
    a, b, c = np.ascontiguousarray(np.take(positions, faces.T, axis=0).transpose(0, 2, 1))
    return c - b, a - c, b - a


def _dots(a: Float[np.ndarray, "3 m"], b: Float[np.ndarray, "3 m"]) -> Float[np.ndarray, "m"]:
    """Inner products, coordinates in rows."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
