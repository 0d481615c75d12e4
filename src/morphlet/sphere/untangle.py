"""The paper's own reading of its trust-region map: reduce the ratio of inverted triangles (IT) of a given, folded start.

IT = 100 #{D <= 0} / #faces is piecewise constant, so no trust region can follow it; stage 1 minimises
sum max(0, eps - D)^2 over the faces instead, which is zero exactly when every D >= eps. Stage 2 then lowers angle and area
distortion among maps without inverted triangles. Stage 1 has no guarantee, and positive faces alone may still cover the
sphere twice: where it fails the certificate, the answer is the map of `embed`, and says so.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.numerics.optimize import OnStep, RegionOptions, Trace, trust_region
from morphlet.sphere import energy
from morphlet.sphere.embed import FINE_FLOOR, VIRTUAL_WEIGHT, Recorder
from morphlet.sphere.level import Level
from morphlet.sphere.map import SphericalMap, map_surface
from morphlet.sphere.quality import certificate
from morphlet.surface.mesh import Mesh
from morphlet.surface.orientation import turned
from morphlet.surface.repair import Repaired, RepairOptions, close

STAGE_1 = RegionOptions(radius=1.0, largest=100.0, iterations=20, tolerance=0.0)
ROUNDS = 25
"""Stage 1 is asked after every 20 iterations whether all faces are positive, at most 25 times."""
STAGE_2 = RegionOptions(radius=1.0, largest=100.0, iterations=30, tolerance=1e-4)
"""Radii are lengths of the whole step: sqrt(n) times the mean move of a vertex, in radians."""


@dataclass(frozen=True)
class UntangleOptions:
    """How far faces are pulled open, and what is minimised afterwards.

    Parameters
    ----------
    margin
        eps of stage 1, in (0, 1): every face should reach this share of its fair orientation D.
    balance
        Stage 2: 0 weighs angles alone, 1 areas alone.
    """

    margin: float = 0.2
    balance: float = 0.5

    def __post_init__(self) -> None:
        if not (0 < self.margin < 1 and 0 <= self.balance <= 1):
            found = f"margin {self.margin}, balance {self.balance}"
            raise InputError("margin in (0, 1) and balance in [0, 1]", found, "keep the defaults 0.2 and 0.5")


@dataclass(frozen=True, eq=False)
class Untangled:
    """A map, the ratio of inverted triangles before and after the trust region (percent), and whether `embed` had to step in."""

    map: SphericalMap
    inverted_before: float
    inverted_after: float
    fell_back: bool


def untangle(
    mesh: Mesh, start: Float[np.ndarray, "n 3"] | None = None, options: UntangleOptions | None = None, on_step: OnStep | None = None
) -> Untangled:
    """Remove the inverted triangles of a spherical start by trust-region steps.

    Parameters
    ----------
    mesh
        One connected piece of genus 0.
    start
        A direction per vertex; the directions from the centroid if left out.

    Raises
    ------
    InputError
        If a start direction is zero, or there is not one per vertex.

    Notes
    -----
    Section 8 of the paper. Stage 1 may stall: from the centroid it succeeds on roundish meshes and not on limbs.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.sphere.untangle import untangle
    >>> tetrahedron = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    >>> untangle(tetrahedron).inverted_after
    0.0
    """
    options = options or UntangleOptions()
    surface = close(mesh, RepairOptions(fill="all"))
    level = _level(surface, _start(surface, start))
    before = 100 * certificate(level.S, level.F).inverted / len(level.F)
    recorder = Recorder(on_step)
    level.form, level.shape = energy.HINGE, options.margin
    opened = certificate(level.S, level.F)
    for _ in range(ROUNDS):
        if opened.inverted == 0:
            break
        level.S, reason = trust_region(level, level.S, STAGE_1, lambda *step: recorder.note("untangle", *step))
        opened = certificate(level.S, level.F)
    after = 100 * opened.inverted / len(level.F)
    if not opened.holds:
        return Untangled(map_surface(surface, None, on_step), before, after, fell_back=True)
    level.form, level.shape = energy.ANGLE_AREA, options.balance
    level.S, reason = trust_region(level, level.S, STAGE_2, lambda *step: recorder.note("distortion", *step))
    points = level.S / np.linalg.norm(level.S, axis=1, keepdims=True)
    if not certificate(points, level.F).holds:
        return Untangled(map_surface(surface, None, on_step), before, after, fell_back=True)
    return Untangled(SphericalMap(surface, points, Trace(tuple(recorder.steps), reason)), before, after, fell_back=False)


def _start(surface: Repaired, start: Float[np.ndarray, "n 3"] | None) -> Float[np.ndarray, "N 3"]:
    """Unit start of every vertex of the closed surface; virtual ones take the mean of their ring."""
    closed = surface.mesh
    from_centroid = closed.vertices - closed.vertices.mean(axis=0)
    if start is not None:
        given = _arrays.unit(_arrays.real(start, "start", (surface.source.n_vertices, 3)), "start")
        real = surface.face_map >= 0
        corners = turned(closed.faces[real], surface.flipped[real])
        from_centroid[corners] = given[surface.source.faces[surface.face_map[real]]]
        for vertex in range(surface.n_real_vertices, closed.n_vertices):
            from_centroid[vertex] = from_centroid[closed.topology.adjacency[vertex].indices].mean(axis=0)
    return np.array(_arrays.unit(from_centroid, "start"))


def _level(surface: Repaired, points: Float[np.ndarray, "N 3"]) -> Level:
    """The closed surface as an optimisation problem on the sphere."""
    V, F = np.array(surface.mesh.vertices), np.array(surface.mesh.faces)
    metric = energy.reference(V - V.mean(axis=0), F, FINE_FLOOR)
    weight = np.where(surface.face_map < 0, VIRTUAL_WEIGHT, 1.0)
    return Level(V, F, points, metric._replace(weight=weight * (4 * np.pi / weight.sum())))
