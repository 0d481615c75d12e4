"""Shapes whose spherical map is known: star-shaped ones, each vertex above its direction from the origin."""

import numpy as np

from morphlet import Mesh
from morphlet.numerics.optimize import Trace
from morphlet.numerics.unit_sphere import icosphere
from morphlet.sphere.map import SphericalMap
from morphlet.surface.repair import RepairOptions, close


def blob(subdivisions=3, scale=1.0):
    """A ball with three different bumps: no symmetry left."""
    points, faces = icosphere(subdivisions)
    bumps = 0.8 * bump(points, [1, 0, 0], 3) + 0.5 * bump(points, [0, 0.8, 0.6], 5) + 1.1 * bump(points, [-0.6, 0, -0.8], 8)
    return Mesh(scale * points * (1 + bumps)[:, None], faces)


def bump(points, direction, sharpness):
    return np.exp(sharpness * (points @ direction - 1))


def radial_map(mesh, rotation=None):
    """The map along rays from the origin, then turned."""
    surface = close(mesh, RepairOptions(fill="all", component="largest"))
    points = surface.mesh.vertices / np.linalg.norm(surface.mesh.vertices, axis=1, keepdims=True)
    points = points if rotation is None else points @ rotation.T
    return SphericalMap(surface, points / np.linalg.norm(points, axis=1, keepdims=True), Trace((), "given"))
