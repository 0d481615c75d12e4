"""Which wavelets tell a mesh in so many bytes, and with which weights: the writer's side of a network.

The mesh is laid on the sphere so that areas count, and looked at in points spread over its surface and, lightly, over the sphere.
Wavelets are picked as any network's are; those that gain less than their bytes are worth are left out. Then the weights are fitted
again so that the surface is met rather than each point: a step along the surface counts for little, and points may slide.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve
from scipy.spatial import cKDTree

from morphlet.codec import orthogonal
from morphlet.codec.atoms import AFFINE, ODD, TURNS, VOICES, Atoms, Level, compass, dilations, kinds_of
from morphlet.numerics.unit_sphere import fibonacci
from morphlet.sphere.map import SphericalMap
from morphlet.surface.points import SurfacePoints
from morphlet.wavenet.mothers import Mother
from morphlet.wavenet.spherical import SphericalNetwork, spherical_library
from morphlet.wavenet.spherical_fit import fit_sphere

ALONG = 0.1
"""What a squared distance along the surface counts, of one across it."""
EVENLY = 0.3
"""Weight of the points spread over the sphere, of that of those spread over the surface: where little area lies on much of the sphere
nothing else holds the wavelets."""
PER_PICK, FEWEST_POINTS = 8, 12_000
"""Points of the surface per wavelet, and at least."""
WORTH = 5.0
"""Squared steps that a wavelet must gain when it is picked: what its 20 bits are worth at the usual exchange."""
KEPT = 1.5
"""Squared steps that it must go on to gain beside the others."""
ROUNDS = 3
SLIDE = 0.05
"""Farthest that a point slides over the sphere, in radians."""
DAMPING = 1e-3
"""Of a slide, over the mean squared stretch of the network."""
RIDGE = 1e-9
"""Relative."""
CONJUGATE_STEPS, CONJUGATE_END = 25, 1e-6
"""Of the fit across the surface: its condition is 1 / ALONG at most."""


@dataclass(frozen=True, eq=False)
class Survey:
    """n points of a mesh: where on the sphere, where in space, which way is out, what each stands for (the sum is 1)."""

    points: Float[np.ndarray, "n 3"]
    places: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    weights: Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Choice:
    """a - 4 wavelets in the order of a file, what each gained when it was picked, and what there is to know of their terms.

    `gram` holds the means of their products on the reader's points, `values` their values at the survey's.
    """

    survey: Survey
    levels: list[Level]
    atoms: Atoms
    gains: Float[np.ndarray, "k"]
    gram: Float[np.ndarray, "a a"]
    values: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class Part:
    """Some wavelets of a choice (`terms` with the affine ones before them), their orthogonal factor and their weights."""

    terms: Int[np.ndarray, "b"]
    upper: Float[np.ndarray, "b b"]
    weights: Float[np.ndarray, "b 3"]

    @property
    def coefficients(self) -> Float[np.ndarray, "b 3"]:
        """R w."""
        return np.triu(self.upper) @ self.weights


def surveyed(mapped: SphericalMap, wavelets: int) -> Survey:
    """Points enough for so many wavelets; the same ones at each call."""
    mesh, count = mapped.mesh, max(FEWEST_POINTS, PER_PICK * wavelets)
    rng = np.random.default_rng(0)
    areas = np.cumsum(mesh.face_areas)
    faces = np.minimum(np.searchsorted(areas, (np.arange(count) + rng.random(count)) / count * areas[-1]), mesh.n_faces - 1)
    root, share = np.sqrt(rng.random(count)), rng.random(count)
    weights = np.stack([1 - root, root * (1 - share), root * share], axis=1)
    even = fibonacci(count // 2)
    located = mapped.locate(even)
    on_sphere = np.einsum("kc,kcd->kd", weights, mapped.points[mesh.faces[faces]])
    points = np.concatenate([on_sphere / np.linalg.norm(on_sphere, axis=1, keepdims=True), even])
    where = SurfacePoints(np.concatenate([faces, located.faces]), np.concatenate([weights, located.weights]))
    normals = np.einsum("kc,kcd->kd", where.weights, mesh.vertex_normals[mesh.faces[where.faces]])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.divide(normals, length, out=np.zeros_like(normals), where=length > 0)
    share_each = np.concatenate([np.full(count, 1 / count), np.full(len(even), EVENLY / len(even))])
    return Survey(points, where.positions(mesh), normals, share_each / share_each.sum())


def choose(survey: Survey, mothers: tuple[Mother, ...], most: int, levels: list[Level]) -> Choice:
    """At most so many wavelets, those first that gain most; centers up to the last of the levels but one, which the reader sums over."""
    library = spherical_library(mothers, survey.points, survey.weights, len(levels) - 2, VOICES)
    fit = fit_sphere(survey.points, survey.places, survey.weights, library, most)
    atoms, gains = named(fit.network, levels), -np.diff(fit.sse)
    keys = np.stack([atoms.bands, atoms.centers, atoms.kinds, atoms.turns], axis=1)
    first = np.unique(keys, axis=0, return_index=True)[1]  # sorted, each once
    atoms, gains = atoms[first], gains[first]
    gram = orthogonal.products(atoms, levels, levels[-1].points)
    return Choice(survey, levels, atoms, gains, gram, orthogonal.terms_at(atoms, levels, survey.points))


def named(network: SphericalNetwork, levels: list[Level]) -> Atoms:
    """The wavelets of a network from our candidates, their directions turned to the nearest that has a number."""
    bands = np.argmin(np.abs(network.dilations[:, None] - dilations(np.arange(VOICES * len(levels)))), axis=1)
    centers = np.zeros(len(bands), np.int64)
    for level in np.unique(bands // VOICES):
        here = bands // VOICES == level
        centers[here] = cKDTree(levels[level].points).query(network.centers[here])[1]
    kinds = kinds_of(network.mothers)[network.kinds]
    east, north = compass(network.centers)
    angle = np.arctan2((network.directions * north).sum(axis=1), (network.directions * east).sum(axis=1))
    turns = np.round(angle * TURNS / np.pi).astype(np.int64) % TURNS
    return Atoms(bands, centers, kinds, turns * ODD[kinds])


def selected(choice: Choice, step: float) -> Part:
    """The wavelets that are worth telling with steps so large, with the weights that meet the points best."""
    kept = np.flatnonzero(choice.gains > WORTH * step**2)
    part = _part(choice, kept)
    for _ in range(ROUNDS - 1):
        u = part.coefficients[AFFINE:] / step
        gained = (u**2 - (u - np.rint(u)) ** 2).sum(axis=1) > KEPT
        if gained.all():
            break
        part = _part(choice, part.terms[AFFINE:][gained] - AFFINE)
    return part


def _part(choice: Choice, kept: Int[np.ndarray, "k"]) -> Part:
    """These wavelets of a choice, less those that others make up."""
    while True:
        terms = np.append(np.arange(AFFINE), AFFINE + kept)
        upper, dependent = orthogonal.factor(choice.gram[np.ix_(terms, terms)], orthogonal.REMAINDER)
        if dependent < 0:
            break
        kept = np.delete(kept, dependent - AFFINE)
    columns = choice.values[:, terms]
    return Part(terms, upper, _met(columns, choice.survey, None))


def quantised(choice: Choice, part: Part, step: float) -> tuple[Atoms, Int[np.ndarray, "b 3"]]:
    """Coefficients in steps, and the wavelets that have some; the others' share goes to these."""
    while True:
        symbols = np.rint(part.coefficients / step).astype(np.int64)
        told = np.append(np.ones(AFFINE, bool), (symbols[AFFINE:] != 0).any(axis=1))
        if told.all():
            return choice.atoms[part.terms[AFFINE:] - AFFINE], symbols
        part = _projected(choice, part, part.terms[told])


def _projected(choice: Choice, part: Part, terms: Int[np.ndarray, "b"]) -> Part:
    """The nearest, on the reader's points, of what some of the terms can make."""
    gram = choice.gram[np.ix_(terms, terms)]
    upper, _ = orthogonal.factor(gram, 0.0)
    return Part(terms, upper, cho_solve((np.triu(upper), False), choice.gram[np.ix_(terms, part.terms)] @ part.weights))


def settled(choice: Choice, part: Part) -> Part:
    """The part with weights that meet the surface: across it first, then with the points slid to where they are nearest."""
    columns, survey, atoms = choice.values[:, part.terms], choice.survey, choice.atoms[part.terms[AFFINE:] - AFFINE]
    weights = _met(columns, survey, part.weights)
    survey = replace(survey, points=_slid(atoms.network(choice.levels, weights), survey))
    return replace(part, weights=_met(orthogonal.terms_at(atoms, choice.levels, survey.points), survey, weights))


def _met(A: sp.csr_matrix, survey: Survey, start: Float[np.ndarray, "b 3"] | None) -> Float[np.ndarray, "b 3"]:
    """Least squares of all distances without a start, else of those across the surface, with those along it lightly."""
    weighted = A.multiply(survey.weights[:, None]).tocsr()
    square = (A.T @ weighted).toarray()
    square[np.diag_indices_from(square)] *= 1 + RIDGE
    half, center = cho_factor(square), survey.weights @ survey.places
    places, middle = survey.places - center, np.zeros((A.shape[1], 3))
    middle[0] = center
    if start is None:
        return middle + cho_solve(half, weighted.T @ places)

    return middle + _met_across(A, weighted, half, (places, survey.normals), start - middle)


def _met_across(
    A: sp.csr_matrix, weighted: sp.csr_matrix, half: Any, surface: tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]], x: np.ndarray
) -> Float[np.ndarray, "b 3"]:
    """Least squares of distances across the surface of places and normals, by conjugate gradients preconditioned by all distances."""
    places, normals = surface

    def across(d: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        return ALONG * d + (1 - ALONG) * np.einsum("nc,nc->n", normals, d)[:, None] * normals

    r = weighted.T @ across(places - A @ x)
    z = cho_solve(half, r)
    p, rz = z, float((r * z).sum())
    end = CONJUGATE_END**2 * rz
    for _ in range(CONJUGATE_STEPS):
        if rz <= end:
            break
        q = weighted.T @ across(A @ p)
        share = rz / float((p * q).sum())
        x, r = x + share * p, r - share * q
        z = cho_solve(half, r)
        rz, before = float((r * z).sum()), rz
        p = z + rz / before * p
    return x


def _slid(network: SphericalNetwork, survey: Survey) -> Float[np.ndarray, "n 3"]:
    """Points of the sphere whose places on the network's surface are nearer to those meant; where one step finds none, the old ones."""
    points, J = survey.points, network.jacobian(survey.points)
    rest = survey.places - network(points)
    square = np.einsum("nki,nkj->nij", J, J)
    size = np.trace(square, axis1=1, axis2=2)
    square += DAMPING * size.mean() * np.eye(3) + size[:, None, None] * points[:, :, None] * points[:, None, :]
    slide = np.linalg.solve(square, np.einsum("nki,nk->ni", J, rest)[:, :, None])[:, :, 0]
    slide *= np.minimum(1, SLIDE / np.maximum(np.linalg.norm(slide, axis=1, keepdims=True), SLIDE))
    moved = points + slide
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    better = ((survey.places - network(moved)) ** 2).sum(axis=1) < (rest**2).sum(axis=1)
    return np.where(better[:, None], moved, points)
