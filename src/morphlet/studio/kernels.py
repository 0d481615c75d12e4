"""Kernels of every frame: what is shown of the faces around a region, and how far they are from rest."""

import math

import numpy as np

from morphlet.numerics.compiled import kernel


@kernel
def shaded(positions, faces, sums, shown, normals):  # type: ignore[no-untyped-def]
    """Positions and unit normals of the vertices of some faces in single precision; six times the volume of the cone from the origin.

    positions: (n, 3) float64, faces: (m, 3) int32, fastest if neighbours follow each other; sums: (n, 3) float64, working space;
    shown, normals: (n, 3) float32.
    """
    volume = 0.0
    for v in range(len(sums)):
        sums[v, 0] = 0.0
        sums[v, 1] = 0.0
        sums[v, 2] = 0.0
    for f in range(len(faces)):
        a, b, c = np.uint32(faces[f, 0]), np.uint32(faces[f, 1]), np.uint32(faces[f, 2])
        x, y, z = positions[a, 0], positions[a, 1], positions[a, 2]
        ux, uy, uz = positions[b, 0] - x, positions[b, 1] - y, positions[b, 2] - z
        wx, wy, wz = positions[c, 0] - x, positions[c, 1] - y, positions[c, 2] - z
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        volume += nx * x + ny * y + nz * z
        for corner in (a, b, c):
            sums[corner, 0] += nx
            sums[corner, 1] += ny
            sums[corner, 2] += nz
    for v in range(len(sums)):
        x, y, z = sums[v, 0], sums[v, 1], sums[v, 2]
        size = math.sqrt(x * x + y * y + z * z)
        scale = 1.0 / size if size > 0 else 0.0
        normals[v, 0], normals[v, 1], normals[v, 2] = scale * x, scale * y, scale * z
        shown[v, 0], shown[v, 1], shown[v, 2] = positions[v, 0], positions[v, 1], positions[v, 2]
    return volume


@kernel
def apart(positions, rest, chosen):  # type: ignore[no-untyped-def]
    """Mean distance of some vertices from rest. positions, rest: (n, 3) float64, chosen: (k,) int64."""
    total = 0.0
    for v in chosen:
        x, y, z = positions[v, 0] - rest[v, 0], positions[v, 1] - rest[v, 1], positions[v, 2] - rest[v, 2]
        total += math.sqrt(x * x + y * y + z * z)
    return total / len(chosen)


@kernel
def stretched(positions, rest, faces, sums, stretch):  # type: ignore[no-untyped-def]
    """Root mean square of the logarithms of the edges' stretch around each vertex of some faces.

    positions, rest: (n, 3) float64, faces: (m, 3) int32, sums: (n, 3) float64, working space; stretch: (n,) float32. Edges of two faces
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
