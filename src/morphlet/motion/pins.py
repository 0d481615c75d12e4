"""Pins: vertices put exactly where they belong, the rest of the mesh following smoothly: feet on the ground after a transfer."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.motion.gradients import GradientSystem
from morphlet.surface.mesh import Mesh


@dataclass(frozen=True, eq=False)
class Pins:
    """Vertices of a mesh made ready to be held in place.

    What is added to a shape is the smoothest displacement that brings the pinned vertices to their places: of all, that with
    the smallest integral of the squared Laplacian over the mesh at rest. It has no peaks at the pins, however few they are.

    Parameters
    ----------
    rest
        The mesh at rest.
    vertices
        Which are pinned.
    system
        Its gradients.
    answers
        Displacement of every vertex for a unit force on each pin.
    solver
        From displacements of the pins, and zeros, to forces on them and a translation of each part that has pins.

    Examples
    --------
    >>> from morphlet import Mesh, Pins
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(2))
    >>> pins = Pins.prepare(ball, [0, 1, 2])
    >>> lifted = ball.with_vertices(ball.vertices + [0, 0, 3])
    >>> bool(abs(pins.hold(lifted, ball.vertices[:3]).vertices - ball.vertices).max() < 1e-9)
    True
    """

    rest: Mesh
    vertices: Int[np.ndarray, "k"]
    system: GradientSystem
    answers: Float[np.ndarray, "n k"]
    solver: Float[np.ndarray, "kp kp"]

    def __reduce__(self) -> tuple[Any, ...]:
        return Pins.prepare, (self.rest, np.array(self.vertices))

    def __len__(self) -> int:
        return len(self.vertices)

    @staticmethod
    def prepare(rest: Mesh, vertices: Int[np.ndarray, "k"]) -> "Pins":
        """Factor the mesh's Laplacian, and solve twice for each pin.

        Parameters
        ----------
        rest
            Any mesh. Parts without pins keep their place beside the largest part.
        vertices
            Each once.

        Raises
        ------
        InputError
            If no vertex is given, one twice, or one that the mesh does not have.
        SolveError
            If the system cannot be factored.

        Notes
        -----
        Memory for one number per vertex and pin. 0.1 CPU s for 10 pins on 8k vertices, 0.6 s for 200; a shape then takes 3 and 6 ms.
        """
        chosen = _arrays.index(vertices, "vertices", (None,), rest.n_vertices)
        if not len(chosen) or len(np.unique(chosen)) < len(chosen):
            found = f"{len(chosen)}, {len(np.unique(chosen))} of them different"
            raise InputError("at least one vertex to pin, each once", found, "name each vertex once")
        system = GradientSystem.prepare(rest, rest.face_areas)
        answers, part = _answers(system, chosen), system.part[chosen]
        sums = (part[:, None] == np.unique(part)).astype(float)
        whole = np.block([[answers[chosen], sums], [sums.T, np.zeros((sums.shape[1], sums.shape[1]))]])
        return Pins(rest, chosen, system, answers, np.linalg.pinv(whole, hermitian=True))

    def hold(self, mesh: Mesh, places: Float[np.ndarray, "k 3"]) -> Mesh:
        """A shape of the mesh, deformed so that the pinned vertices are in these places.

        Parameters
        ----------
        mesh
            In any pose.
        places
            One for each pinned vertex.

        Raises
        ------
        InputError
            If the mesh has another number of vertices than the mesh at rest, or there is not one finite place per pin.
        """
        if mesh.n_vertices != self.rest.n_vertices:
            raise InputError(f"a mesh of {self.rest.n_vertices} vertices", str(mesh.n_vertices), "pass a shape of the mesh at rest")
        goal = _arrays.real(places, "places", (len(self), 3))
        own, parts = self.system.part[self.vertices], self.system.followers
        gaps = goal - mesh.vertices[self.vertices]
        forces = self.solver @ np.vstack([gaps, np.zeros((self.solver.shape[0] - len(gaps), 3))])
        shift = np.zeros((self.system.mean.shape[0], 3))
        shift[np.unique(own)] = forces[len(gaps) :]
        moved = mesh.vertices + self.answers @ forces[: len(gaps)] + shift[self.system.part]
        loose = np.isin(self.system.part, np.setdiff1d(parts.parts, own))[:, None]
        moved = np.where(loose, parts.placed(moved, parts.reach @ mesh.vertices), moved)
        moved[self.vertices] = goal
        return mesh.with_vertices(moved)


def _answers(system: GradientSystem, pins: Int[np.ndarray, "k"]) -> Float[np.ndarray, "n k"]:
    """Displacements u with L A^-1 L u = a unit force on a pin, balanced over its part; L the Laplacian, A the vertex areas."""
    n, area = system.rest.n_vertices, system.rest.vertex_areas
    weight = sp.csr_matrix((area, (system.part, np.arange(n))), shape=system.mean.shape)
    total = np.asarray(weight.sum(axis=1))[system.part, 0]
    share = np.where(total > 0, area / np.where(total > 0, total, 1.0), 1.0)
    unit = (np.arange(n)[:, None] == pins).astype(float)
    balance = unit - share[:, None] * (system.part[:, None] == system.part[pins])
    first = system.spread(balance)
    centred = first - ((weight @ first)[system.part] / np.where(total > 0, total, 1.0)[:, None])
    return system.spread(area[:, None] * centred)
