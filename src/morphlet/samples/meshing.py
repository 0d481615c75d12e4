"""Well-shaped triangle meshes of smooth solids.

Marching cubes on a grid that resolves the thinnest part, then collapses down to exactly the wanted number of vertices,
Delaunay flips, tangential smoothing and projection onto the surface, in turn. Thin parts get shorter edges.
"""

import numpy as np
from jaxtyping import Float, Int

from morphlet.samples import surgery
from morphlet.samples.implicit import Solid
from morphlet.surface.mesh import Mesh, Topology

CELL_SHARE = 1.5
"""Grid cell of marching cubes over half the thickness of the thinnest part: 0.75 cells per thickness hold it together."""

LEAST_CELL, MOST_CELL = 0.012, 0.05
"""Bounds of the cell: 4 million grid points for an animal below, angular starts above."""

SURPLUS = 1.6
"""The mesh before collapses has at least this many times the wanted vertices; else it is subdivided."""

FIRST_ROUNDS = 2
"""Rounds of flips and smoothing that mend the slivers of marching cubes before collapses."""

LAST_ROUNDS = 10
"""Rounds of flips and smoothing after collapses: the share of angles below 30 degrees settles after eight."""

SETTLING_ROUNDS = 12
"""Rounds of smoothing, without flips, that spread a mesh bent onto another solid."""

SMOOTHING = 0.7
"""Share of the way to the weighted centre of the neighbouring faces."""

THIN, THICK = 0.02, 0.16
"""Radii between which edge lengths follow the square root of the local thickness."""


def polygonise(solid: Solid, n_vertices: int) -> Mesh:
    """A closed mesh of the solid's surface with this many vertices.

    Notes
    -----
    The grid has some 10^6 points; cost grows linearly with vertices beyond that.
    """
    vertices, faces = _marched(solid)
    while len(vertices) < SURPLUS * n_vertices:
        vertices, faces = _subdivided(solid, vertices, faces)
    vertices, faces = _improved(solid, vertices, faces, FIRST_ROUNDS)
    faces, kept = surgery.thinned(vertices, faces, _edge_lengths(solid, vertices), n_vertices)
    vertices, faces = _improved(solid, vertices[kept], faces, LAST_ROUNDS)
    return _mesh(vertices, faces)


def settled(mesh: Mesh, solid: Solid) -> Mesh:
    """A mesh near the solid's surface laid onto it, in the same topology."""
    for _ in range(SETTLING_ROUNDS):
        mesh = mesh.with_vertices(solid.project(_smoothed(mesh, _edge_lengths(solid, mesh.vertices)), 1))
    return mesh.with_vertices(solid.project(mesh.vertices))


def midpoint_faces(faces: Int[np.ndarray, "m 3"], edge_of: Int[np.ndarray, "m 3"]) -> Int[np.ndarray, "m 4 3"]:
    """Four faces in place of each, given the vertex at the middle of each of its half-edges: three corners, centre."""
    (a, b, c), (ab, bc, ca) = faces.T, edge_of.T
    corners = [[a, ab, ca], [b, bc, ab], [c, ca, bc], [ab, bc, ca]]
    return np.array(corners).transpose(2, 0, 1)


def edge_middles(faces: Int[np.ndarray, "m 3"], n_vertices: int) -> tuple[Int[np.ndarray, "e 2"], Int[np.ndarray, "m 3"]]:
    """The edges, and for each half-edge the number of the vertex at its middle, counted on from `n_vertices`."""
    halfedges = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    edges, number = np.unique(halfedges, axis=0, return_inverse=True)
    return edges, n_vertices + number.reshape(-1, 3)


def _marched(solid: Solid) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Marching cubes over the solid's box."""
    import igl

    cell = np.clip(CELL_SHARE * solid.thinnest, LEAST_CELL, MOST_CELL)
    axes = [np.arange(low - cell, high + 2 * cell, cell) for low, high in solid.box.T]
    z, y, x = np.meshgrid(axes[2], axes[1], axes[0], indexing="ij")
    grid = np.stack([x.ravel(), y.ravel(), z.ravel()], axis=1)
    vertices, faces, _ = igl.marching_cubes(solid.field(grid)[:, 0].copy(), grid, *(len(a) for a in axes), 0.0)
    mesh = _mesh(vertices, faces)
    return vertices, np.ascontiguousarray(faces if mesh.volume > 0 else faces[:, ::-1], dtype=np.int64)


def _mesh(vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]) -> Mesh:
    return Mesh(vertices, Topology(faces, len(vertices)))


def _subdivided(
    solid: Solid, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"]
) -> tuple[Float[np.ndarray, "N 3"], Int[np.ndarray, "M 3"]]:
    """Four faces for each, the new vertices on the surface."""
    edges, middle = edge_middles(faces, len(vertices))
    centres = solid.project(vertices[edges].mean(axis=1))
    return np.concatenate([vertices, centres]), midpoint_faces(faces, middle).reshape(-1, 3)


def _improved(
    solid: Solid, vertices: Float[np.ndarray, "n 3"], faces: Int[np.ndarray, "m 3"], rounds: int
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, "m 3"]]:
    """Rounds of flips, tangential smoothing and projection."""
    for _ in range(rounds):
        faces = surgery.flipped(vertices, faces)
        vertices = solid.project(_smoothed(_mesh(vertices, faces), _edge_lengths(solid, vertices)), 1)
    return solid.project(vertices), surgery.flipped(vertices, faces)


def _smoothed(mesh: Mesh, lengths: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3"]:
    """Vertices moved in their tangent planes towards the centre of their faces, weighted by area over wanted area."""
    weight = np.repeat(mesh.face_areas / lengths[mesh.faces].mean(axis=1) ** 2, 3)
    centres = np.repeat(mesh.vertices[mesh.faces].mean(axis=1), 3, axis=0)
    corners, normals = mesh.faces.ravel(), mesh.vertex_normals
    total = np.stack([np.bincount(corners, weight * c) for c in centres.T], axis=1)
    move = SMOOTHING * (total / np.bincount(corners, weight)[:, None] - mesh.vertices)
    return mesh.vertices + move - np.sum(move * normals, axis=1, keepdims=True) * normals


def _edge_lengths(solid: Solid, vertices: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Wanted edge length up to a common factor."""
    return np.sqrt(np.clip(solid.field(vertices)[:, 1], THIN, THICK))
