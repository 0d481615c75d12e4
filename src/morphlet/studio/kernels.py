"""Kernels of every frame: normals and stretch of the faces around a region."""

import math

from morphlet.numerics.compiled import kernel


@kernel
def shaded(positions, faces, sums, normals):  # type: ignore[no-untyped-def]
    """Unit normal of each vertex of some faces into normals; returns six times the volume of the cone from the origin to the faces.

    positions: (n, 3) float64, faces: (m, 3) int64, sums: (n, 3) float64, working space; normals: (n, 3) float32.
    """
    volume = 0.0
    for v in range(len(sums)):
        sums[v, 0] = 0.0
        sums[v, 1] = 0.0
        sums[v, 2] = 0.0
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ux, uy, uz = positions[b, 0] - positions[a, 0], positions[b, 1] - positions[a, 1], positions[b, 2] - positions[a, 2]
        wx, wy, wz = positions[c, 0] - positions[a, 0], positions[c, 1] - positions[a, 1], positions[c, 2] - positions[a, 2]
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        volume += nx * positions[a, 0] + ny * positions[a, 1] + nz * positions[a, 2]
        for k in range(3):
            v = faces[f, k]
            sums[v, 0] += nx
            sums[v, 1] += ny
            sums[v, 2] += nz
    for v in range(len(sums)):
        size = math.sqrt(sums[v, 0] ** 2 + sums[v, 1] ** 2 + sums[v, 2] ** 2)
        scale = 1.0 / size if size > 0 else 0.0
        normals[v, 0] = scale * sums[v, 0]
        normals[v, 1] = scale * sums[v, 1]
        normals[v, 2] = scale * sums[v, 2]
    return volume


@kernel
def stretched(positions, rest, faces, sums, stretch):  # type: ignore[no-untyped-def]
    """Root mean square of the logarithms of the edges' stretch around each vertex of some faces.

    positions, rest: (n, 3) float64, faces: (m, 3) int64, sums: (n, 3) float64, working space; stretch: (n,) float32. Edges of two faces
    count twice, edges without length not at all.
    """
    for v in range(len(sums)):
        sums[v, 0] = 0.0
        sums[v, 1] = 0.0
    for f in range(len(faces)):
        for k in range(3):
            a, b = faces[f, k], faces[f, (k + 1) % 3]
            before = (rest[b, 0] - rest[a, 0]) ** 2 + (rest[b, 1] - rest[a, 1]) ** 2 + (rest[b, 2] - rest[a, 2]) ** 2
            now = (
                (positions[b, 0] - positions[a, 0]) ** 2
                + (positions[b, 1] - positions[a, 1]) ** 2
                + (positions[b, 2] - positions[a, 2]) ** 2
            )
            if before > 0 and now > 0:
                square = (0.5 * math.log(now / before)) ** 2
                sums[a, 0] += square
                sums[b, 0] += square
                sums[a, 1] += 1.0
                sums[b, 1] += 1.0
    for v in range(len(sums)):
        stretch[v] = math.sqrt(sums[v, 0] / sums[v, 1]) if sums[v, 1] > 0 else 0.0
