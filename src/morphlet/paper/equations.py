"""Equations (1) to (12) of the paper, each with a numeric check against something that does not share its code.

Each check compares a number that the package finds with one from a direct evaluation, from another library or from a property
that the equation must have. They are made on the horse, its edit and its networks, wherever the equation speaks of a mesh.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from morphlet import metrics
from morphlet.approximation.rows import approximate_rows
from morphlet.editing.falloff import rate, ratios, transition
from morphlet.editing.moving_least_squares import MovingLeastSquares
from morphlet.mapping.alignment import align_by_pairs
from morphlet.numerics.unit_sphere import fibonacci
from morphlet.paper.exhibit import Exhibit, table_of
from morphlet.paper.subjects import Stock, Subject
from morphlet.wavenet.fit import FitOptions, fit
from morphlet.wavenet.library import dyadic_library
from morphlet.wavenet.mothers import PAPER_SIX
from morphlet.wavenet.network import WaveletNetwork

ROUNDING = 1e-9
"""Difference, relative to the expected number or to 1, that is rounding."""
NOISE, NOISE_SHARE = 0.02, 0.15
"""Standard deviation of the noise in the check of Eq. 4, and how far the one that is left over may be from it."""
SAMPLES = 512
"""Of the noisy signal."""
PLACES = 40
"""Control points and places of the check of Eq. 1."""
TURNS = 200
"""Rotations that those of Eqs. 1 and 7 are compared with."""
NEAR = 0.05
"""Angle between the best rotation and some of those, in radians."""
LITERAL_HANDLE, LITERAL_END = 0.5, 0.5 * np.exp(-4)
"""Eq. 11 as printed, at r = 0 and at r = 1."""


@dataclass(frozen=True)
class Check:
    """A number that is expected, the one that was found, and how far they may be apart.

    Parameters
    ----------
    equation
        Its number in the paper.
    about
        What is compared.
    expected, found
        Both numbers.
    remark
        What the paper leaves out or gets wrong; empty if nothing.
    tolerance
        Relative to the expected number, or to 1 where that is smaller.
    """

    equation: int
    about: str
    expected: float
    found: float
    remark: str
    tolerance: float = ROUNDING

    @property
    def holds(self) -> bool:
        """Whether both agree."""
        return bool(abs(self.found - self.expected) <= self.tolerance * max(abs(self.expected), 1.0))


def equation_1(subject: Subject) -> Check:
    """The best rigid transformation at a place, against scipy's fit of weighted vectors."""
    rng = np.random.default_rng(0)
    p, q, x = rng.normal(size=(PLACES, 3)), rng.normal(size=(PLACES, 3)), rng.normal(size=(PLACES, 3))
    found = MovingLeastSquares("rigid", 1.0).field(p, x)(q)
    there = [_moved(p, q, place, 1 / np.sum((p - place) ** 2, axis=1)) for place in x]
    gap = float(np.abs(found - np.array(there)).max())
    remark = 'A best similarity instead of a rigid motion is `MovingLeastSquares("similarity")`; orientation is kept (det = +1).'
    return Check(1, "T_x(x) against scipy's weighted best rotation, largest difference", 0.0, gap, remark)


def _moved(p: np.ndarray, q: np.ndarray, x: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Where the rigid motion of least weighted squares takes a place."""
    centres = [np.average(points, axis=0, weights=weight) for points in (p, q)]
    turn = Rotation.align_vectors(q - centres[1], p - centres[0], weights=weight)[0]
    return np.asarray(turn.apply(x - centres[0]) + centres[1])


def equation_2(subject: Subject) -> Check:
    """At a control point itself its target is met."""
    rng = np.random.default_rng(1)
    p, q = rng.normal(size=(PLACES, 3)), rng.normal(size=(PLACES, 3))
    missed = float(np.abs(MovingLeastSquares("rigid", 1.0).field(p, p)(q) - q).max())
    distance = np.where(np.eye(PLACES) > 0, 1.0, np.linalg.norm(p[:, None] - p[None], axis=2))
    printed = np.array([_moved(p, q, place, weight) for place, weight in zip(p, distance**-2.0, strict=True)])
    off = float(np.linalg.norm(printed - q, axis=1).mean())
    remark = (
        f"With the printed weight 1 at a control point, the targets here are missed by {off:.2f} on average: the limit of Eq. 2 is meant."
    )
    return Check(2, "T_x(p_i) - q_i at x = p_i, largest", 0.0, missed, remark)


def equation_3(subject: Subject) -> Check:
    """A network is the weighted sum of its wavelets, and an affine part."""
    network, x = _network(subject), np.linspace(0, 1, SAMPLES)
    total = network.affine[0] + x[:, None] * network.affine[1]
    for kind, t, d, w in zip(network.kinds, network.centers, network.dilations, network.weights, strict=True):
        total = total + network.mothers[kind]((x - t) / d)[:, None] * w
    gap = float(np.abs(network(x) - total).max() / np.abs(total).max())
    remark = "a_i multiplies where steps 7 and 8 keep the d_i that divides; wavelets have zero mean, so the affine part is needed."
    return Check(3, "network against the sum written out, largest difference", 0.0, gap, remark)


def _network(subject: Subject) -> WaveletNetwork:
    """The network of the middle row of an object's image."""
    return approximate_rows(subject.image).table[subject.rows // 2]


def equation_4(subject: Subject) -> Check:
    """What a fit that stops by cross-validation leaves over is the noise that was added."""
    x, rng = np.linspace(0, 1, SAMPLES), np.random.default_rng(2)
    clean = _network(subject)(x)[:, :1]
    noisy = clean / np.ptp(clean) + NOISE * rng.normal(size=(SAMPLES, 1))
    found = fit(x, noisy, dyadic_library(PAPER_SIX, x), FitOptions(60, stop="gcv"))
    left = float(np.sqrt(found.sse[-1] / SAMPLES))
    remark = f"When to stop is open. Generalised cross-validation stopped at {len(found.network)} wavelets of at most 60."
    return Check(4, "standard deviation of what is left of a noisy row", NOISE, left, remark, NOISE_SHARE * NOISE)


def equation_5(subject: Subject) -> Check:
    """Candidates of the library have unit norm on the samples."""
    x = np.linspace(0, 1, subject.rows)
    library = dyadic_library(PAPER_SIX, x)
    norms = np.linalg.norm(library.design(x), axis=0)
    literal = np.linalg.norm(replace(library, normalisation="literal").design(x), axis=0)
    remark = (
        "The exponent is printed +1/2 and must be -1/2: as printed, norms range over a factor of "
        f"{literal.max() / literal[literal > 0].min():.0f}, "
        "so that wide wavelets are chosen for being wide."
    )
    return Check(5, "norms of the candidates, the one farthest from 1", 1.0, float(norms[np.argmax(np.abs(norms - 1))]), remark)


def equation_6(subject: Subject) -> Check:
    """A network is the sum of the networks of its mothers."""
    network, x = _network(subject), np.linspace(0, 1, SAMPLES)
    total = network.affine[0] + x[:, None] * network.affine[1]
    for kind in range(len(network.mothers)):
        own = network.kinds == kind
        arrays = (network.kinds[own], network.centers[own], network.dilations[own], network.weights[own])
        total = total + WaveletNetwork(network.mothers, *arrays, np.zeros_like(network.affine))(x)
    gap = float(np.abs(network(x) - total).max() / np.abs(total).max())
    return Check(
        6,
        "network against the sum over its mothers, largest difference",
        0.0,
        gap,
        "The same I and W_i for every mother would tie them: each has its own.",
    )


def equation_7(subject: Subject) -> Check:
    """The rotation of the features keeps their distances, and no other brings them nearer."""
    source, target = _features()
    found = align_by_pairs(source, target)
    moved = found(source)
    kept = float(np.abs(_distances(moved) - _distances(source)).max())
    others = Rotation.random(TURNS, rng=np.random.default_rng(4)).as_matrix() @ found.rotation
    near = Rotation.from_rotvec(NEAR * np.random.default_rng(5).normal(size=(TURNS, 3))).as_matrix() @ found.rotation
    best = min(float(np.sum((source @ turn.T - target) ** 2)) for turn in (*others, *near))
    own = float(np.sum((moved - target) ** 2))
    remark = (
        "The objective lacks the prime of P'. Only a rotation keeps all distances, so features cannot all meet: squared distances "
        f"sum to {own:.4g} "
        f"here, in the best of {2 * TURNS} other rotations to {best:.4g}. A reflection would keep distances too, and turn every "
        "triangle over."
    )
    return Check(
        7, "change of distances inside a map; infinite if another rotation were better", 0.0, kept if own <= best else np.inf, remark
    )


def _features() -> tuple[np.ndarray, np.ndarray]:
    """Features of two maps that no rotation makes equal."""
    source = fibonacci(PLACES)
    turn = Rotation.from_rotvec([0.7, -0.4, 1.1]).as_matrix()
    target = source @ turn.T + 0.2 * np.random.default_rng(3).normal(size=source.shape)
    return source, target / np.linalg.norm(target, axis=1, keepdims=True)


def _distances(points: np.ndarray) -> np.ndarray:
    """All distances between points."""
    return np.asarray(np.linalg.norm(points[:, None] - points[None], axis=2))


def equation_8(subject: Subject) -> Check:
    """The matrix of the features holds x, y and z of each, one row per feature."""
    tips = subject.regions.tips
    matrix = subject.regions.mesh.vertices[tips]
    wrong = float(matrix.shape != (len(tips), 3)) + float(
        sum(np.any(row != subject.regions.mesh.vertices[v]) for row, v in zip(matrix, tips, strict=True))
    )
    return Check(8, f"rows of the ({len(tips)}, 3) matrix of the {subject.name}'s tips that are not their places", 0.0, wrong, "")


def equation_9(subject: Subject) -> Check:
    """The mean squared distance, written out."""
    after, before = subject.deformed.vertices, subject.mesh.vertices
    total = sum(float((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2) for a, b in zip(after, before, strict=True))
    remark = (
        "K is called the number of observations, and N_i counts them; the value depends on the unit of length, so that the tables here "
        "divide it by the squared diagonal."
    )
    return Check(
        9, "MSE of original and deformed object, over the written-out one", 1.0, metrics.mse(after, before) / (total / len(before)), remark
    )


def equation_10(subject: Subject) -> Check:
    """The ratio of each vertex, from all distances."""
    rest, roi = subject.mesh.vertices, subject.roi
    to_handle = np.min([np.linalg.norm(rest - rest[h], axis=1) for h in roi.handle], axis=0)
    expected = to_handle[roi.moving] / to_handle[roi.anchors].min()
    found = ratios(roi)
    remark = f"Which handle vertex x_h is meant is open: here the nearest. The ratio exceeds 1, up to {found.max():.2f} in this region."
    return Check(10, "ratios against all distances, largest difference", 0.0, float(np.abs(found - expected).max()), remark)


def equation_11(subject: Subject) -> Check:
    """The transition as printed, and as meant."""
    printed, meant = (transition(np.array([0.0, 1.0]), name) for name in ("literal", "gaussian"))
    gap = float(np.abs(printed - [LITERAL_HANDLE, LITERAL_END]).max())
    remark = (
        f"Called a Gaussian, printed as an exponential that is {printed[0]:.1f} next to the handle, whose own factor is 1, and "
        f"{printed[1]:.4f} at r = 1: "
        f"the surface breaks at the handle. The Gaussian of that width is {meant[0]:.0f} and {meant[1]:.4f}, and is the default."
    )
    return Check(11, "g(0) and g(1) as printed, largest difference", 0.0, gap, remark)


def equation_12(subject: Subject) -> Check:
    """The deformation rate as printed is the mean ratio, whatever the deformation."""
    moved = rate(subject.roi, subject.deformed)
    still = rate(subject.roi, subject.mesh)
    remark = (
        f"It holds no deformed position: {moved.literal:.1f} % after the edit and {still.literal:.1f} % before. Read as the mean way "
        "of the region's "
        f"vertices it is {moved.displacement:.1f} % and {still.displacement:.1f} %."
    )
    return Check(12, "rate as printed, against the mean ratio in %", 100 * float(ratios(subject.roi).mean()), moved.literal, remark)


EQUATIONS: tuple[Callable[[Subject], Check], ...] = (
    *(equation_1, equation_2, equation_3, equation_4, equation_5, equation_6),
    *(equation_7, equation_8, equation_9, equation_10, equation_11, equation_12),
)
"""All checks, in the paper's order."""


def checks(stock: Stock) -> Exhibit:
    """Every equation with its check."""
    found = [equation(stock.horse) for equation in EQUATIONS]
    rows = [(f"({c.equation})", c.about, c.expected, c.found, c.holds) for c in found]
    remarks = tuple(f"({c.equation}) {c.remark}" for c in found if c.remark)
    caption = f"Each equation evaluated by the package and by other means; on the {stock.horse.name} where it speaks of a mesh."
    return Exhibit(caption, table_of(("equation", "what is compared", "expected", "found", "holds"), rows), remarks=remarks)
