"""A surface rebuilt from its differential coordinates and a few vertices whose places are known (step 11, section 6.1).

The differential coordinates of a vertex are L V: how it lies beside its neighbours. Kept as well as the known places allow,
they carry all other vertices along. On the sphere this is the warp of section 6.1, which moves paired vertices onto each
other but folds where they move far: it is here to be compared with, `embedding` is the map without folds.
"""

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.numerics.linalg import factorize
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.operators import laplacian, mass

PULL = 100.0
"""Weight of a known place against the mean of the other terms of its vertex: met to a hundredth of what resists."""


def reconstruct(
    mesh: Mesh, vertices: Int[np.ndarray, "p"], places: Float[np.ndarray, "p 3"], weight: Float[np.ndarray, "p"] | None = None
) -> Mesh:
    """The mesh whose differential coordinates are nearest to the given one's, with some vertices pulled to known places.

    Minimises ``|L X - L V|^2 + sum_f w_f |x_f - place_f|^2``, the first norm weighted with the inverse mass, so that fine and
    coarse parts of the mesh count by their area.

    Parameters
    ----------
    mesh
        Every part of it needs a known vertex.
    vertices
        Whose places are known, each once.
    places
        Where they are, in mesh units.
    weight
        How strongly each is pulled, against the rest of its vertex; 100 if left out.

    Returns
    -------
    Mesh
        With the same topology.

    Raises
    ------
    InputError
        If a vertex is not in the mesh or named twice, a part of the mesh has none, shapes differ, or weights are not positive.

    Notes
    -----
    One sparse factorization. Differential coordinates turn with the surface, here they do not: large rotations shear details.

    References
    ----------
    Sorkine, Cohen-Or, Lipman, Alexa, Roessl and Seidel, Laplacian surface editing, SGP 2004.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.mapping.differential import reconstruct
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> ball = Mesh(*icosphere(2))
    >>> drawn = reconstruct(ball, [0, 11], [[0, 0, 2], [0, 0, -1]])
    >>> drawn.vertices[[0, 11], 2].round(1).tolist()
    [2.0, -1.0]
    """
    vertices, weight = _known(mesh, vertices, weight)
    places = _arrays.real(places, "places", (len(vertices), 3))
    L = laplacian(mesh)
    system = (L @ sp.diags_array(1 / _masses(mesh)) @ L).tocsc()
    pull = np.where(mesh.topology.referenced, 0.0, 1.0)
    right = system @ mesh.vertices + pull[:, None] * mesh.vertices  # a vertex without faces stays
    pull[vertices] = weight * system.diagonal().mean()
    right[vertices] += pull[vertices, None] * places
    solver = factorize((system + sp.diags_array(pull)).tocsc(), mesh.vertices)
    return mesh.with_vertices(solver.solve(right))


def laplacian_warp(
    points: Float[np.ndarray, "n 3"], topology: Topology, vertices: Int[np.ndarray, "p"], goals: Float[np.ndarray, "p 3"]
) -> Float[np.ndarray, "n 3"]:
    """A triangulated sphere with some of its vertices moved to their goals and the others carried along (section 6.1).

    Parameters
    ----------
    points
        Unit vectors.
    topology
        Their faces.
    vertices, goals
        Which vertices move, and unit vectors where to.

    Returns
    -------
    Float[np.ndarray, "n 3"]
        Unit vectors. Faces may be folded: count them with `sphere.quality.certificate`.

    Raises
    ------
    InputError
        As `reconstruct`.

    Examples
    --------
    >>> from morphlet.mapping.differential import laplacian_warp
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.surface.mesh import Topology
    >>> points, faces = icosphere(2)
    >>> warped = laplacian_warp(points, Topology(faces, len(points)), [0, 11], points[[0, 11]])
    >>> bool(abs(warped - points).max() < 1e-9)
    True
    """
    moved = reconstruct(Mesh(_arrays.unit(points, "points"), topology), vertices, _arrays.unit(goals, "goals")).vertices
    return _arrays.unit(moved, "the warped points")


def _known(mesh: Mesh, vertices: Int[np.ndarray, "p"], weight: Float[np.ndarray, "p"] | None) -> tuple[np.ndarray, np.ndarray]:
    """Checked vertices and weights."""
    vertices = _arrays.index(vertices, "vertices", (None,), mesh.n_vertices)
    if not len(vertices) or len(np.unique(vertices)) < len(vertices):
        found = f"{len(vertices)}, {len(np.unique(vertices))} different"
        raise InputError("known vertices, each once", found, "give every part of the mesh one or more")
    lost = np.setdiff1d(mesh.topology.components, [-1, *mesh.topology.components[vertices]])
    if len(lost):
        raise InputError("a known vertex on each part of the mesh", f"{len(lost)} parts without", "add one there, or remove the part", lost)
    weight = _arrays.real(np.full(len(vertices), PULL) if weight is None else weight, "weight", (len(vertices),))
    if (weight <= 0).any():
        raise InputError("positive weights", f"{int((weight <= 0).sum())} that are not", "drop these vertices", np.nonzero(weight <= 0)[0])
    return vertices, weight


def _masses(mesh: Mesh) -> Float[np.ndarray, "n"]:
    """Vertex masses; the mean one where there is none."""
    masses = mass(mesh).diagonal()
    return np.where(masses > 0, masses, masses.mean() if masses.any() else 1.0)
