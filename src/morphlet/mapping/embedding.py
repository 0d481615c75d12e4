"""One mesh laid into another's sphere, coarse to fine, without folds.

The source is collapsed to a tetrahedron, paired vertices last, and comes back on the bare sphere up to some hundred vertices. There it
is turned towards the paired points of the target and dragged onto them, while the round metric gives way to the target's (smoothed).
Then the vertices come back in batches, each put into the kernel of its ring and relaxed in the target's metric, ever less smoothed;
at last the whole mesh is polished against the target's surface itself, where in the end only uneven stretch counts. No step folds a
triangle, pairs pull to the end, and exact signs certify the result: a one-to-one map between the two surfaces.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.errors import InputError, SolveError
from morphlet.mapping.correspondence import Correspondence
from morphlet.mapping.laying import EmbeddingOptions, Laying, Target
from morphlet.numerics.optimize import OnStep, Trace
from morphlet.sphere.embed import LADDER, Recorder
from morphlet.sphere.map import SphericalMap
from morphlet.sphere.quality import Certificate, certificate
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.points import SurfacePoints
from morphlet.surface.repair import Repaired
from morphlet.surface.requirements import require_area

MET = 1e-3
"""Radians within which a pair counts as met."""
DOUBTFUL, LEAST_PAIRS = -0.045, 3
"""A pair whose absence lowers the energy by more than 4.5 % is doubtful (seen: wrong pairs -5 % to -12 %, right ones -4.4 % to +39 %)."""


DEFAULT = EmbeddingOptions()
"""What `embed` does unless told otherwise."""
SHORT = EmbeddingOptions(rounds=1, iterations=8)
"""Enough to compare energies."""


@dataclass(frozen=True, eq=False)
class Embedding:
    """A source mesh laid one-to-one into a target's sphere.

    Parameters
    ----------
    source
        The closed surface that was laid in, and how it came from the mesh as given.
    target
        The spherical map it was laid into.
    pairs
        Vertices that were pulled together.
    closed_points
        A unit vector on the target's sphere for each vertex of the closed source.
    energy
        Distortion of the source's own shape, divided by 4 pi: lower is better, for one pair of meshes and one set of options.
    trace
        How the optimisation went; `attempt` is the rung of the ladder that held.
    """

    source: Repaired
    target: SphericalMap
    pairs: VertexPairs
    closed_points: Float[np.ndarray, "N 3"]
    energy: float
    trace: Trace

    def __post_init__(self) -> None:
        points = _arrays.real(self.closed_points, "closed_points", (self.source.mesh.n_vertices, 3))
        object.__setattr__(self, "closed_points", points)

    @property
    def points(self) -> Float[np.ndarray, "n 3"]:
        """One unit vector per vertex of the source as given."""
        return _arrays.freeze(self.closed_points[self.source.vertex_map])

    @property
    def residuals(self) -> Float[np.ndarray, "p"]:
        """Distance on the unit sphere that is left between each pair."""
        gaps = self.points[self.pairs.source] - self.target.points[self.pairs.target]
        return 2 * np.arcsin(np.minimum(np.linalg.norm(gaps, axis=1) / 2, 1.0))

    @property
    def unmet(self) -> Int[np.ndarray, "k"]:
        """Which pairs were not brought together: they contradict each other, or the orientation of the surfaces."""
        return np.nonzero(self.residuals > MET)[0]

    def certificate(self) -> Certificate:
        """Exact signs and degree of the source on the target's sphere."""
        return certificate(self.closed_points, self.source.mesh.faces)

    def correspondence(self) -> Correspondence:
        """Where each vertex of the source as given lies on the target as given."""
        return Correspondence(self.source.source, self.target.mesh, self.target.locate(self.points), self.source.valid)


def embed(
    source: Repaired,
    target: SphericalMap,
    pairs: VertexPairs,
    options: EmbeddingOptions = DEFAULT,
    start: Float[np.ndarray, "N 3"] | None = None,
    on_step: OnStep | None = None,
) -> Embedding:
    """Lay a closed surface one-to-one into another's sphere, paired vertices onto each other.

    Parameters
    ----------
    source
        From `close(mesh)`, or the `surface` of its own spherical map (which is not needed here).
    target
        Spherical map of the other mesh.
    pairs
        Vertices of the meshes as given that belong together. Their weights share the pull.
    options
        How much work goes into it.
    start
        A first guess: a direction on the target's sphere for each vertex of the closed source, for instance of a wavelet
        network's warp after the source's own spherical map. It may fold. It leads the coarse level to its place, and is
        then forgotten.
    on_step
        Called after every step; may raise `Cancelled`.

    Raises
    ------
    InputError
        If the pairs do not fit the meshes, or, without a start, do not determine a rotation.
    MeshError
        If one of the surfaces has no area.
    SolveError
        If no attempt passes the certificate.

    Notes
    -----
    Pairs that contradict each other, or the orientation, are met as far as the triangles allow; `unmet` names them. About 1.4 CPU s
    per 1000 vertices of the source up to 7000 of them, 2.5 at 41 000, where all together took 0.5 GB.

    References
    ----------
    .. [1] J. Schreiner et al., "Inter-surface mapping", SIGGRAPH 2004 (coarse to fine, both ways at once).
    .. [2] B. Schmidt et al., "Surface maps via adaptive triangulations", Eurographics 2023 (symmetric Dirichlet energy of a map).

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs, spherical_map
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.surface.repair import close
    >>> ball, egg = Mesh(*icosphere(2)), Mesh(icosphere(2)[0] * [1.0, 1.2, 1.6], icosphere(2)[1])
    >>> found = embed(close(ball), spherical_map(egg), VertexPairs([0, 1, 2], [0, 1, 2]))
    >>> found.certificate().holds, len(found.unmet)
    (True, 0)
    """
    pairs.checked(source.source, target.mesh)
    for mesh in (source.mesh, target.surface.mesh):
        require_area(mesh)
    if start is not None:
        start = _arrays.unit(_arrays.real(start, "start", (source.mesh.n_vertices, 3)), "start")
    elif len(pairs) < 2:
        raise InputError("at least two pairs, or a start", f"{len(pairs)} pairs and no start", "add pairs that are spread out")
    return _laid(source, Target.prepare(target), pairs, (options, start), on_step)


@dataclass(frozen=True, eq=False)
class LeaveOneOut:
    """What a map's energy is without each of its pairs.

    Parameters
    ----------
    energy
        With all pairs.
    without
        Without each of them.
    """

    energy: float
    without: Float[np.ndarray, "p"]

    @property
    def changes(self) -> Float[np.ndarray, "p"]:
        """Relative change of the energy when a pair is left out: a right one hardly lowers it."""
        return self.without / self.energy - 1

    @property
    def doubtful(self) -> Int[np.ndarray, "k"]:
        """Pairs without which the energy is clearly lower: look at them before trusting the map."""
        return np.nonzero(self.changes < DOUBTFUL)[0]


def leave_one_out(source: Repaired, target: SphericalMap, pairs: VertexPairs, on_step: OnStep | None = None) -> LeaveOneOut:
    """Lay the source in once with all pairs and once without each, to find wrong ones.

    Parameters
    ----------
    source, target, pairs, on_step
        As for `embed`; at least three pairs.

    Raises
    ------
    InputError
        If there are fewer than three pairs, or those left do not determine a rotation.

    Notes
    -----
    As many independent maps as there are pairs, and one more, with a short polish. A pair that is not known to be wrong may lower
    the energy a little when it is left out, so do not drop pairs by this alone.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs, spherical_map
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.surface.repair import close
    >>> points, faces = icosphere(2)
    >>> egg = Mesh(points * [1.0, 1.2, 1.6], faces)
    >>> found = leave_one_out(close(egg), spherical_map(egg), VertexPairs([0, 1, 2, 11], [0, 1, 2, 40]))
    >>> found.doubtful
    array([3])
    """
    pairs.checked(source.source, target.mesh)
    if len(pairs) < LEAST_PAIRS:
        raise InputError(f"at least {LEAST_PAIRS} pairs", f"{len(pairs)}", "add pairs that are spread out")
    prepared, energies = Target.prepare(target), []
    for left_out in range(-1, len(pairs)):
        some = pairs.chosen(np.flatnonzero(np.arange(len(pairs)) != left_out))
        energies.append(_laid(source, prepared, some, (SHORT, None), on_step).energy)
    return LeaveOneOut(energies[0], np.array(energies[1:]))


@dataclass(frozen=True, eq=False)
class Sketch:
    """A coarse map: some vertices of the closed source on the closed target.

    Parameters
    ----------
    energy
        Distortion, divided by 4 pi, lower is better; infinite if no map was found at the first attempt.
    vertices
        Vertices of the source.
    shares
        Share of the source's area around each.
    places
        Where they lie on the target.
    """

    energy: float
    vertices: Int[np.ndarray, "k"]
    shares: Float[np.ndarray, "k"]
    places: SurfacePoints


def sketch(source: Repaired, target: SphericalMap, candidates: Sequence[VertexPairs], on_step: OnStep | None = None) -> tuple[Sketch, ...]:
    """Coarse maps to which several sets of pairs lead: how well does each fit the surfaces between the pairs?

    Parameters
    ----------
    source, target, on_step
        As for `embed`.
    candidates
        Sets of pairs.

    Raises
    ------
    InputError
        If pairs do not fit the meshes.

    Notes
    -----
    The maps have some 800 vertices of the source: 0.8 CPU s each. Pairs on one line, which determine no rotation, have infinite energy.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs, spherical_map
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.surface.repair import close
    >>> points, faces = icosphere(2)
    >>> egg = Mesh(points * [1.0, 1.2, 1.6], faces)
    >>> right, wrong = VertexPairs([0, 1, 2, 11], [0, 1, 2, 11]), VertexPairs([0, 1, 2, 11], [1, 2, 0, 40])
    >>> found = sketch(close(egg), spherical_map(egg), [right, wrong])
    >>> found[0].energy < found[1].energy
    True
    """
    prepared = Target.prepare(target)
    return tuple(_sketched(source, prepared, pairs.checked(source.source, target.mesh), on_step) for pairs in candidates)


def _sketched(source: Repaired, target: Target, pairs: VertexPairs, on_step: OnStep | None) -> Sketch:
    """One of them."""
    try:
        energy, level, vertices = Laying(source, target, pairs, LADDER[0], Recorder(on_step)).sketch()
    except (SolveError, InputError, ZeroDivisionError):
        return Sketch(np.inf, np.zeros(0, np.int64), np.zeros(0), SurfacePoints(np.zeros(0, np.int64), np.zeros((0, 3))))
    places = SurfacePoints(*target.locator.locate(level.S))
    return Sketch(energy / (4 * np.pi), vertices, Laying.shares(level) / (4 * np.pi), places)


def _laid(
    source: Repaired, target: Target, pairs: VertexPairs, how: tuple[EmbeddingOptions, np.ndarray | None], on_step: OnStep | None
) -> Embedding:
    """The first attempt that passes the certificate."""
    failures = []
    for number, attempt in enumerate(LADDER):
        recorder = Recorder(on_step)
        try:
            points, reached = Laying(source, target, pairs, attempt, recorder).run(*how)
        except (SolveError, ZeroDivisionError) as error:
            failures.append(f"attempt {number}: {error}")
            continue
        proof = certificate(points, source.mesh.faces)
        if proof.holds:
            trace = Trace(tuple(recorder.steps), "polished" if how[0].rounds else "relaxed", number)
            return Embedding(source, target.map, pairs, points, reached / (4 * np.pi), trace)
        failures.append(f"attempt {number}: {proof.inverted} inverted faces, degree {proof.degree:.6f}")
    raise SolveError("a map without inverted faces", "; ".join(failures), "check the pairs, or remesh the thinnest parts")
