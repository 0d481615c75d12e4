"""Wavelet networks beside their peers, on rows of real geometry images.

    python benchmarks/wavelet_rows.py [--data DIR] [--rows 32] [--picture PNG] [--json FILE] [--markdown]

The signals are rows of 128 x 256 lat-long images of meshes in the data folder (`--data`, or the variable MORPHLET_DATA), or of
generated bodies without one: each coordinate is a signal of its own, over the longest side of the mesh. All runs use one
thread; milliseconds are CPU time per signal, with whatever is prepared once for all of them. Needs PyWavelets and scikit-learn.

Every method is judged by the signals it gives back, by the same function. What a method stores is counted three ways: linear
weights; nonlinear real numbers, such as centers and widths; and choices from a finite list, as "15 of 1693".
"""

import argparse
import os
import statistics
import sys
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pywt
from jaxtyping import Float
from matplotlib.patches import Patch
from scipy import fft
from scipy.interpolate import generate_knots, make_lsq_spline
from sklearn.cluster import KMeans
from sklearn.exceptions import ConvergenceWarning
from sklearn.linear_model import orthogonal_mp
from sklearn.neural_network import MLPRegressor
from threadpoolctl import threadpool_limits

from book import Sheet, Table, add_options
from morphlet import Mesh
from morphlet.io.formats import read
from morphlet.numerics.threads import limited
from morphlet.report import canvas
from morphlet.report.render import Picture
from morphlet.sphere.image import spherical_image
from morphlet.sphere.map import spherical_map
from morphlet.wavenet.fit import FitOptions, fit_rows
from morphlet.wavenet.library import Library, affine_basis, dyadic_library
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX, Mother
from sphere_map import generated

MESHES = ("meshes/horse.obj", "meshes/bunny.off", "meshes/face.obj")
SIZE = 128
"""Rows of an image; a row has twice as many samples."""
WAVELETS, LINEAR = 15, 17
"""Wavelets of a network, and its linear weights with the affine part."""
FREE = 47
"""Real numbers of a network whose centers and dilations are free: weight, center and dilation of each, and the affine part."""
TEN = tuple(psi for name, psi in MOTHERS.items() if name != "polywog4")
"""All mothers in the table but the one that is there twice."""
VOICES = 3
"""Bands per octave of the dense libraries."""
THINNING = 2
"""Refinement of many libraries is measured on every second signal."""
DAUBECHIES = "db4"
NEAREST, WIDENING = 2, 1.0
"""Width of a radial unit: the mean distance to its two nearest, times this; of 0.75, 1, 1.5, 2 and 3 the best here."""
STRETCH, RESTARTS, ITERATIONS = 3.0, 2, 2000
"""Of the perceptron: its input runs from -3 to 3, which suits it better than 1, 10 or 30; the better of 2 starts is kept."""
COHERENT = 1e-4
"""What must be left of a candidate's squared norm, as in the package."""
COHERENT_KNOTS = 1e-8
"""The same for truncated powers, which are nearly dependent."""
BATCH, REPEATS, FEW, SLOW_REPEATS = 256, 9, 16, 3
"""Signals and runs of the timings; of slow ones."""
LITTLE = 0.02
"""Ratios this close to 1 are no difference."""

Rows = Float[np.ndarray, "s n"]
Method = Callable[[Rows], Rows]


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of some meshes, as many of each: names of the meshes, and the values."""

    names: tuple[str, ...]
    values: Rows

    def means(self, errors: Float[np.ndarray, "s"]) -> list[float]:
        """Geometric means of one number per signal: over all of them, and over those of each mesh."""
        logs = np.log(np.reshape(errors, (len(self.names), -1)))
        return [float(np.exp(part.mean())) for part in (logs, *logs)]

    def every(self, step: int) -> "Signals":
        """Each so many-th signal of each mesh."""
        n = self.values.shape[1]
        return Signals(self.names, self.values.reshape(len(self.names), -1, n)[:, ::step].reshape(-1, n))


@dataclass(frozen=True, eq=False)
class Peer:
    """A method: its kind, the linear weights, nonlinear numbers and choices it stores, and how it gives the signals back."""

    kind: str
    stored: tuple[str, str, str]
    rebuild: Method


@dataclass(frozen=True, eq=False)
class Result:
    """Mean squared error of each signal, and CPU milliseconds per signal."""

    errors: Float[np.ndarray, "s"]
    milliseconds: float


def signals(data: Path | None, rows: int) -> Signals:
    """Coordinates along rows that are spread evenly between the poles, which are left out."""
    bodies = {f"generated-{level}": generated(level, 0.1) for level in (4, 5)}
    if data is not None:
        bodies = {Path(name).name: read(data / name) for name in MESHES}
    at = (1 + (np.arange(rows) + 0.5) * (SIZE - 2) / rows).astype(int)
    return Signals(tuple(bodies), np.concatenate([coordinates(mesh)[at].reshape(-1, 2 * SIZE) for mesh in bodies.values()]))


def coordinates(mesh: Mesh) -> Float[np.ndarray, "h 3 w"]:
    """The coordinates along each row of the image, over the longest side of the mesh."""
    image = spherical_image(spherical_map(mesh), SIZE, "latlong")
    return (image.positions - mesh.vertices.min(axis=0)).transpose(0, 2, 1) / np.ptp(mesh.vertices, axis=0).max()


def places(n: int) -> Float[np.ndarray, "n"]:
    """Where the samples are."""
    return np.linspace(0, 1, n)


def measured(rebuild: Method, y: Rows) -> Result:
    """The method on all signals, judged by what it gives back."""
    start = time.process_time()
    found = rebuild(y)
    milliseconds = 1e3 * (time.process_time() - start) / len(y)
    return Result(((found - y) ** 2).mean(axis=1), milliseconds)


# networks


def network(library: Library, options: FitOptions) -> Method:
    """Networks of the package."""

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        return fit_rows(x, y[:, :, None], library, options).table(x)[:, :, 0]

    return rebuild


def together(mothers: Sequence[Mother], x: Float[np.ndarray, "n"]) -> Library:
    """The mothers on one and the same grid, without the shifts that `dyadic_library` gives to several."""
    single = [dyadic_library([psi], x) for psi in mothers]
    kinds = np.repeat(np.arange(len(mothers)), [len(library) for library in single])
    parts = (np.concatenate([getattr(library, name) for library in single]) for name in ("centers", "dilations", "bands"))
    return Library(tuple(mothers), kinds, *parts)


def dense(psi: Mother, x: Float[np.ndarray, "n"], size: int) -> Library:
    """About so many candidates of one mother: more voices, smaller steps."""
    low, high = 0.05, 2.0
    while high - low > 1e-3:
        middle = (low + high) / 2
        low, high = (middle, high) if len(dyadic_library([psi], x, voices=VOICES, spacing=middle)) > size else (low, middle)
    return dyadic_library([psi], x, voices=VOICES, spacing=high)


# peers


def largest(c: Rows, count: int) -> Rows:
    """The coefficients of largest absolute value, the others 0."""
    order = np.argsort(-np.abs(c), axis=1)[:, :count]
    kept = np.zeros_like(c)
    np.put_along_axis(kept, order, np.take_along_axis(c, order, axis=1), axis=1)
    return kept


def cosines_first(count: int) -> Method:
    """The lowest cosines."""

    def rebuild(y: Rows) -> Rows:
        c = fft.dct(y, norm="ortho", axis=1)
        c[:, count:] = 0
        return fft.idct(c, norm="ortho", axis=1)

    return rebuild


def cosines_best(count: int) -> Method:
    """The largest cosines."""
    return lambda y: fft.idct(largest(fft.dct(y, norm="ortho", axis=1), count), norm="ortho", axis=1)


def harmonics(n: int) -> Float[np.ndarray, "n n"]:
    """Orthonormal sines and cosines over the period, from slow to fast."""
    angle = 2 * np.pi * np.multiply.outer(np.arange(n), np.arange(1, n // 2)) / n
    waves = np.stack([np.cos(angle), np.sin(angle)], axis=2).reshape(n, -1) * np.sqrt(2 / n)
    return np.column_stack([np.full(n, n**-0.5), waves, (-1.0) ** np.arange(n) * n**-0.5])


def harmonics_first(count: int) -> Method:
    """The lowest harmonics: the rows are closed, and this method knows it."""
    return lambda y: y @ harmonics(y.shape[1])[:, :count] @ harmonics(y.shape[1])[:, :count].T


def harmonics_best(count: int) -> Method:
    """The largest harmonics."""
    return lambda y: largest(y @ harmonics(y.shape[1]), count) @ harmonics(y.shape[1]).T


def wavelets_best(count: int) -> Method:
    """The largest coefficients of the periodic wavelet transform."""

    def rebuild(y: Rows) -> Rows:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # levels beyond which the filter is longer than the signal: they help
            parts = pywt.wavedec(y, DAUBECHIES, "periodization", level=int(np.log2(y.shape[1])))
        kept = largest(np.concatenate(parts, axis=1), count)
        ends = np.cumsum([part.shape[1] for part in parts])[:-1]
        return pywt.waverec(np.split(kept, ends, axis=1), DAUBECHIES, "periodization")

    return rebuild


def spline(count: int) -> Method:
    """Cubic splines of so many coefficients on uniform knots."""

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        knots = np.concatenate([[0] * 3, np.linspace(0, 1, count - 2), [1] * 3])
        return make_lsq_spline(x, y.T, knots, 3)(x).T

    return rebuild


def spline_fitpack(count: int) -> Method:
    """Cubic splines whose knots FITPACK adds where the error is, up to so many coefficients."""

    def one(y: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        x, most = places(len(y)), count + 4
        # a smoothing target that no signal meets: knots are added until there are enough
        knots = [t for t in generate_knots(x, y, k=3, s=1e-14, nest=most) if len(t) <= most][-1]
        return make_lsq_spline(x, y, knots, 3)(x)

    return lambda y: np.array([one(row) for row in y])


def spline_knots(count: int) -> Method:
    """Cubic splines whose knots orthogonal least squares chooses among the samples."""

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        powers = np.maximum(np.subtract.outer(x, x[1:-1]), 0) ** 3
        return chosen(powers, y, np.vander(x, 4), count - 4, COHERENT_KNOTS)

    return rebuild


def of_bumps(shape: Callable[[np.ndarray], np.ndarray], size: int) -> Method:
    """About so many bumps of a shape on a dyadic grid, 15 of them chosen by orthogonal least squares."""

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        return chosen(bump_columns(shape, x, size), y, affine_basis(x), WAVELETS, COHERENT)

    return rebuild


def bump_columns(shape: Callable[[np.ndarray], np.ndarray], x: Float[np.ndarray, "n"], size: int) -> Float[np.ndarray, "n l"]:
    """Bumps of widths from 1/2 down to two samples, 3 per octave, each width on a grid in proportion to it."""
    widths = 0.5 * 2.0 ** -(np.arange(6 * VOICES + 1) / VOICES)
    spacing = (1 / widths + 4).sum() / size
    grids = [(0.5 + spacing * d * np.arange(-np.ceil((0.5 / d + 2) / spacing), np.ceil((0.5 / d + 2) / spacing) + 1), d) for d in widths]
    columns = np.concatenate([shape(np.subtract.outer(x, centers) / d) for centers, d in grids], axis=1)
    return columns[:, (columns**2).sum(axis=0) > COHERENT]


def gaussian(z: np.ndarray) -> np.ndarray:
    """A bump of unit width."""
    return np.exp(-0.5 * z**2)


def cubic(z: np.ndarray) -> np.ndarray:
    """The cubic B-spline of unit width."""
    t = np.abs(z) / np.sqrt(3)
    return np.where(t < 1, 4 - 6 * t**2 + 3 * t**3, np.maximum(2 - t, 0) ** 3) / 4


def chosen(columns: Float[np.ndarray, "n l"], y: Rows, fixed: Float[np.ndarray, "n f"], picks: int, least: float) -> Rows:
    """Orthogonal least squares in numpy, with inner products that all signals share; fixed columns are always in."""
    basis, _ = np.linalg.qr(fixed)
    rest = columns - basis @ (basis.T @ columns)
    rest -= basis @ (basis.T @ rest)
    rest /= np.maximum(np.linalg.norm(rest, axis=0), 1e-300)
    gram, correlations = rest.T @ rest, y @ rest
    found = np.empty_like(y)
    for i, row in enumerate(correlations):
        design = np.column_stack([fixed, columns[:, pivots(gram, row.copy(), picks, least)]])
        found[i] = design @ np.linalg.lstsq(design, y[i], rcond=None)[0]
    return found


def pivots(gram: Float[np.ndarray, "l l"], correlations: Float[np.ndarray, "l"], picks: int, least: float) -> list[int]:
    """Which columns a pivoted partial Cholesky factorization picks."""
    before = np.diag(gram)
    norms, factor, found = before.copy(), np.zeros((0, len(gram))), []
    for _ in range(picks):
        best = int(np.argmax(np.where(norms > least * before, correlations**2 / np.maximum(norms, 1e-300), -1)))
        row = (gram[best] - factor[:, best] @ factor) / np.sqrt(norms[best])
        correlations -= row * (correlations[best] / np.sqrt(norms[best]))
        norms = norms - row**2
        norms[best] = 0
        factor = np.vstack([factor, row])
        found.append(best)
    return found


def textbook(library: Library) -> Method:
    """Orthogonal least squares as it is usually written: all candidates made orthogonal to each pick."""

    def one(y: Float[np.ndarray, "n"], columns: Float[np.ndarray, "n l"], basis: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        rest, columns = y - basis @ (basis.T @ y), columns.copy()
        found = y - rest
        for _ in range(WAVELETS):
            norms = np.einsum("nl,nl->l", columns, columns)
            scores = np.where(norms > COHERENT, (rest @ columns) ** 2 / np.maximum(norms, 1e-300), 0)
            best = int(np.argmax(scores))
            q = columns[:, best] / np.sqrt(norms[best])
            share = q @ rest
            found, rest = found + share * q, rest - share * q
            columns -= np.multiply.outer(q, q @ columns)
        return found

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        columns, basis = library.design(x), affine_basis(x)
        return np.array([one(row, columns, basis) for row in y])

    return rebuild


def shared_gram(library: Library) -> Method:
    """Orthogonal least squares in numpy, on the same candidates."""

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        return chosen(library.design(x), y, affine_basis(x), WAVELETS, COHERENT)

    return rebuild


def scikit(library: Library) -> Method:
    """Orthogonal matching pursuit of scikit-learn, on the same candidates."""

    def rebuild(y: Rows) -> Rows:
        x = places(y.shape[1])
        columns, basis = library.design(x), affine_basis(x)
        flat = y @ basis @ basis.T
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # it says when it stops early
            weights = orthogonal_mp(columns, (y - flat).T, n_nonzero_coefs=WAVELETS, precompute=True)
        return flat + (columns @ weights).T

    return rebuild


def radial(weigh: Callable[[Float[np.ndarray, "n"]], Float[np.ndarray, "n"]]) -> Method:
    """15 Gaussian units and an affine part: centers by k-means, widths from the nearest centers, weights by least squares."""

    def one(y: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        x = places(len(y))
        means = KMeans(WAVELETS, n_init=1, random_state=0).fit(x[:, None], sample_weight=weigh(y))
        centers = np.sort(means.cluster_centers_[:, 0])
        apart = np.sort(np.abs(np.subtract.outer(centers, centers)), axis=1)[:, 1 : NEAREST + 1].mean(axis=1)
        design = np.column_stack([affine_basis(x), gaussian(np.subtract.outer(x, centers) / (WIDENING * apart))])
        return design @ np.linalg.lstsq(design, y, rcond=None)[0]

    return lambda y: np.array([one(row) for row in y])


def bending(y: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """Root of the absolute second difference: where a signal bends, centers belong."""
    bends = np.sqrt(np.abs(np.gradient(np.gradient(y))))
    return bends + 0.1 * bends.mean() + 1e-12


def perceptron(y: Rows) -> Rows:
    """A hidden layer of 15 tanh units, the best of some starts."""
    x = STRETCH * (2 * places(y.shape[1])[:, None] - 1)
    mean, spread = y.mean(axis=1, keepdims=True), y.std(axis=1, keepdims=True)
    return mean + spread * np.array([_trained(x, row) for row in (y - mean) / spread])


def _trained(x: Float[np.ndarray, "n 1"], y: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    options = {"hidden_layer_sizes": (WAVELETS,), "activation": "tanh", "solver": "lbfgs", "alpha": 0.0, "tol": 1e-9}
    tries = []
    for seed in range(RESTARTS):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", ConvergenceWarning)
            tries.append(MLPRegressor(**options, max_iter=ITERATIONS, max_fun=10 * ITERATIONS, random_state=seed).fit(x, y).predict(x))
    return min(tries, key=lambda found: float(((found - y) ** 2).sum()))


# tables

LEFT, LINE = 370, 22
"""Room for the names in the picture, and height of a bar, in pixels."""
OURS, CHOOSING, FIXED, FREELY = "wavelet networks", "terms chosen for each signal", "the same terms for all signals", "all parameters free"
COLORS = {OURS: "#0072B2", CHOOSING: "#E69F00", FIXED: "#999999", FREELY: "#009E73"}
SIX, FINAL, INTERLEAVED = "six mothers, OLS", "six mothers, OLS, then refined", "six mothers, refined after each pick"
HAT, HAT_INTERLEAVED = "mexican_hat, OLS", "mexican_hat, refined after each pick"


def networks(x: Float[np.ndarray, "n"]) -> dict[str, Peer]:
    """The package's own methods."""
    six, ten = dyadic_library(PAPER_SIX, x), dyadic_library(TEN, x)
    hat = dense(MOTHERS["mexican_hat"], x, len(six))
    free = (str(LINEAR), str(FREE - LINEAR), f"{WAVELETS} of {len(PAPER_SIX)}")
    found = {
        SIX: picked(six),
        "ten mothers, OLS": picked(ten),
        FINAL: Peer(OURS, free, network(six, FitOptions(refinement="final"))),
        INTERLEAVED: Peer(OURS, free, network(six, FitOptions(refinement="interleaved"))),
        HAT_INTERLEAVED: Peer(OURS, (*free[:2], ""), network(hat, FitOptions(refinement="interleaved"))),
    }
    return found | {f"{psi.name}, OLS": picked(dyadic_library([psi], x)) for psi in TEN}


def picked(library: Library) -> Peer:
    """A network whose wavelets stay where the library has them."""
    return Peer(OURS, (str(LINEAR), "", f"{WAVELETS} of {len(library)}"), network(library, FitOptions()))


def peers(n: int, size: int) -> dict[str, Peer]:
    """Everybody else."""
    bumps = bump_columns(gaussian, places(n), size).shape[1]
    found = {
        "cubic B-splines, OLS": Peer(CHOOSING, (str(LINEAR), "", f"{WAVELETS} of {bumps}"), of_bumps(cubic, size)),
        "RBF, Gaussians, OLS": Peer(CHOOSING, (str(LINEAR), "", f"{WAVELETS} of {bumps}"), of_bumps(gaussian, size)),
        "RBF, k-means": Peer(FIXED, (str(LINEAR), "", ""), radial(np.ones_like)),
        "RBF, k-means where it bends": Peer(CHOOSING, (str(LINEAR), str(WAVELETS), ""), radial(bending)),
        "MLP, 15 tanh units": Peer(FREELY, (str(WAVELETS + 1), str(2 * WAVELETS), ""), perceptron),
    }
    for count in (LINEAR, LINEAR + WAVELETS, FREE):
        found |= {f"{name} {count}": Peer(FIXED, (str(count), "", ""), make(count)) for name, make in FIRST.items()}
    for count in (LINEAR, (FREE + 1) // 2):
        found |= {f"{name} {count}": Peer(CHOOSING, (str(count), "", f"{count} of {n}"), make(count)) for name, make in BEST.items()}
    for name, make in KNOTS.items():
        found[f"{name} {LINEAR}"] = Peer(CHOOSING, (str(LINEAR), "", f"{LINEAR - 4} of {n - 2}"), make(LINEAR))
    return found


FIRST: dict[str, Callable[[int], Method]] = {
    "cubic spline, uniform knots,": spline,
    "DCT, first": cosines_first,
    "Fourier, first": harmonics_first,
}
BEST: dict[str, Callable[[int], Method]] = {"DCT, best": cosines_best, "Fourier, best": harmonics_best, "periodic db4, best": wavelets_best}
KNOTS: dict[str, Callable[[int], Method]] = {
    "cubic spline, knots by FITPACK,": spline_fitpack,
    "cubic spline, knots by OLS,": spline_knots,
}


def accuracy(given: Signals) -> tuple[Table, dict[str, tuple[Peer, Result]]]:
    """Table A, and what is in it."""
    x = places(given.values.shape[1])
    methods = networks(x) | peers(len(x), len(dyadic_library(PAPER_SIX, x)))
    found = {}
    for name, peer in methods.items():
        sys.stderr.write(f"{name}\n")
        found[name] = peer, measured(peer.rebuild, given.values)
    ours = given.means(found[SIX][1].errors)[0]
    heads = ["method", "weights", "reals", "choices", "MSE", *given.names, "ratio", "CPU ms"]
    lines = []
    for name, (peer, result) in found.items():
        means = given.means(result.errors)
        lines.append([name, *peer.stored, *(f"{mean:.3g}" for mean in means), f"{means[0] / ours:.2f}", f"{result.milliseconds:.2f}"])
    return Table(f"A. {WAVELETS} wavelets beside their peers", heads, lines, notes=verdicts(given, found)), found


def verdict(given: Signals, ours: tuple[str, Result], theirs: tuple[str, Result]) -> str:
    """Which of two is more exact, and how surely."""
    ratios = theirs[1].errors / ours[1].errors
    if abs(given.means(ratios)[0] - 1) < LITTLE:
        return f"{ours[0]} and {theirs[0]} differ by less than {LITTLE:.0%} in MSE."
    if given.means(ratios)[0] < 1:
        ours, theirs, ratios = theirs, ours, 1 / ratios
    mean, *each = given.means(ratios)
    where = f"higher on {(ratios > 1).mean():.0%} of the signals, in the mean on {sum(one > 1 for one in each)} of {len(each)} meshes"
    return f"{theirs[0]} has {mean:.2f} times the MSE of {ours[0]} ({where})."


def verdicts(given: Signals, found: dict[str, tuple[Peer, Result]]) -> list[str]:
    """What table A says: peers that store about as much as networks from a library, and those that store more."""
    others = {name: total(peer) for name, (peer, _) in found.items() if peer.kind != OURS}
    pairs = [(SIX, name) for name, stored in others.items() if stored < FREE - 1]
    pairs += [(FINAL, SIX), (INTERLEAVED, FINAL), (INTERLEAVED, HAT_INTERLEAVED)]
    pairs += [(HAT_INTERLEAVED, name) for name, stored in others.items() if stored >= FREE - 1]
    return [verdict(given, (a, found[a][1]), (b, found[b][1])) for a, b in pairs]


def total(peer: Peer) -> int:
    """How many numbers a method stores, a choice counted as one."""
    return sum(int(part.split()[0]) for part in peer.stored if part)


REFINEMENTS = ("none", "final", "interleaved")
RULES = ("mp", "omp", "ols")


def libraries(given: Signals) -> Table:
    """Table B: many mothers against one, on the same grid, at equal size, before and after refinement."""
    x = places(given.values.shape[1])
    six = dyadic_library(PAPER_SIX, x)
    same = {"six mothers": six, "six mothers, no shifts": together(PAPER_SIX, x)}
    same |= {"ten mothers": dyadic_library(TEN, x), "ten mothers, no shifts": together(TEN, x)}
    single = {psi.name: dyadic_library([psi], x) for psi in TEN}
    equal = {f"{psi.name}, dense": dense(psi, x, len(six)) for psi in TEN}
    found, lines = {}, []
    for name, library in (same | single | equal).items():
        sys.stderr.write(f"{name}\n")
        results = [measured(network(library, FitOptions(refinement=refinement)), given.values) for refinement in REFINEMENTS]
        found[name] = results
        lines.append([name, str(len(library)), *(f"{given.means(result.errors)[0]:.3g}" for result in results)])
    heads, notes = ["library", "candidates", "OLS", "then refined", "refined after each pick"], []
    for stage, title in enumerate(("OLS", "OLS, then refined", "refined after each pick")):
        for names, label in ((single, "the best single one on the same grid"), (equal, "the best single one at equal size")):
            best = min(names, key=lambda name: given.means(found[name][stage].errors)[0])
            one = f"{best} ({label})", found[best][stage]
            rivals = ("six mothers", "six mothers, no shifts") if names is single else ("six mothers",)
            notes += [f"{title}: {verdict(given, (many, found[many][stage]), one)}" for many in rivals]
    return Table(f"B. Many mothers against one ({len(given.values)} of the signals)", heads, lines, notes=notes)


def rules(given: Signals) -> Table:
    """Table of the rules of choice, with both normalisations of Eq. 5."""
    six = dyadic_library(PAPER_SIX, places(given.values.shape[1]))
    found = {
        (method, exponent): measured(network(replace(six, normalisation=normalisation), FitOptions(method=method)), given.values)
        for method in RULES
        for exponent, normalisation in (("-1/2", "unit"), ("+1/2", "literal"))
    }
    lines = [[rule.upper(), *(f"{given.means(found[rule, e].errors)[0]:.3g}" for e in ("-1/2", "+1/2"))] for rule in RULES]
    heads, notes = ["rule", "Eq. 5 with exponent -1/2", "as printed, +1/2"], []
    pairs = [(("ols", "-1/2"), ("omp", "-1/2")), (("omp", "-1/2"), ("mp", "-1/2"))]
    for pair in [*pairs, *(((rule, "-1/2"), (rule, "+1/2")) for rule in RULES)]:
        ours, theirs = ((f"{rule.upper()} with {exponent}", found[rule, exponent]) for rule, exponent in pair)
        notes.append(verdict(given, ours, theirs))
    return Table("Rules of choice and Eq. 5, six mothers", heads, lines, notes=notes)


def speed(given: Signals) -> Table:
    """Table C: CPU time of one batch on one thread; every call starts from the library and the signals."""
    y = given.values[np.linspace(0, len(given.values) - 1, BATCH).round().astype(int)]
    six = dyadic_library(PAPER_SIX, places(y.shape[1]))
    jobs = {
        "OLS": (network(six, FitOptions()), BATCH, REPEATS),
        "OLS, then refined": (network(six, FitOptions(refinement="final")), BATCH, SLOW_REPEATS),
        "refined after each pick": (network(six, FitOptions(refinement="interleaved")), BATCH, SLOW_REPEATS),
        "OLS, numpy, shared inner products": (shared_gram(six), BATCH, REPEATS),
        "OLS, numpy, as in textbooks": (textbook(six), FEW, SLOW_REPEATS),
        "OMP": (network(six, FitOptions(method="omp")), BATCH, REPEATS),
        "OMP, scikit-learn": (scikit(six), BATCH, REPEATS),
    }
    found = repeated({name: (rebuild, y[:: BATCH // count], repeats) for name, (rebuild, count, repeats) in jobs.items()})
    heads = ["method", "signals", "ms per signal", "times OLS", f"MSE (the same {FEW})", "largest relative difference of an MSE from ours"]
    lines = []
    for name, result in found.items():
        few = result.errors[:: len(result.errors) // FEW]
        base = found["OMP" if name.startswith("OMP") else "OLS"]
        apart = np.abs(result.errors / base.errors[:: BATCH // len(result.errors)] - 1).max()
        mean, ratio = np.exp(np.log(few).mean()), result.milliseconds / found["OLS"].milliseconds
        shown = f"{apart:.1e}" if "," in name and "refined" not in name else ""
        lines.append([name, str(len(result.errors)), f"{result.milliseconds:.3g}", f"{ratio:.1f}", f"{mean:.3g}", shown])
    note = f"The fit alone, without the values of its networks: {fit_alone(six, y):.3g} ms per signal."
    return Table(f"C. Speed, one thread, {BATCH} signals at once", heads, lines, "CPU times, medians.", [note])


def fit_alone(library: Library, y: Rows) -> float:
    """Median milliseconds per signal of `fit_rows`."""
    x, times = places(y.shape[1]), []
    for _ in range(REPEATS):
        start = time.process_time()
        fit_rows(x, y[:, :, None], library, FitOptions())
        times.append(time.process_time() - start)
    return 1e3 * statistics.median(times) / len(y)


def repeated(jobs: dict[str, tuple[Method, Rows, int]]) -> dict[str, Result]:
    """Each method with its median time. All take turns, so that they see the same machine."""
    found: dict[str, list[Result]] = {name: [] for name in jobs}
    for turn in range(REPEATS):
        for name, (rebuild, y, repeats) in jobs.items():
            if turn < repeats:
                found[name].append(measured(rebuild, y))
    return {name: Result(own[0].errors, statistics.median(result.milliseconds for result in own)) for name, own in found.items()}


def picture(given: Signals, found: dict[str, tuple[Peer, Result]]) -> Picture:
    """Bars of the errors, the lowest first; of the single mothers only one."""
    drawn_too = (SIX, "ten mothers, OLS", FINAL, INTERLEAVED, HAT, HAT_INTERLEAVED)
    means = {name: given.means(result.errors)[0] for name, (peer, result) in found.items() if peer.kind != OURS or name in drawn_too}
    order = sorted(means, key=lambda name: means[name])
    figure = canvas.sheet(LEFT + 580, LINE * len(order) + 80)
    drawn = canvas.axes(figure, canvas.Box(LEFT, 16, 540, LINE * len(order)))
    for row, name in enumerate(order):
        drawn.barh(row, means[name], color=COLORS[found[name][0].kind], height=0.72)
        drawn.text(means[name] * 1.06, row, f"{means[name]:.2g}", va="center", fontsize=canvas.SMALL, color=canvas.INK)
    span = (min(means.values()) / 2, 2 * max(means.values()))
    drawn.set(xscale="log", xlim=span, ylim=(len(order) - 0.4, -0.6), yticks=range(len(order)))
    drawn.set_xlabel("mean squared error (geometric mean over the signals)")
    drawn.set_yticklabels([f"{name} [{numbers(found[name][0])}]" for name in order])
    patches = [Patch(color=color, label=kind) for kind, color in COLORS.items()]
    drawn.legend(handles=patches, loc="upper right", frameon=False, fontsize=canvas.SMALL, labelcolor=canvas.INK)
    return Picture(canvas.pixels(figure), "matplotlib", "bars need no other")


def numbers(peer: Peer) -> str:
    """How many numbers a method stores: real ones, and choices."""
    weights, reals, choices = peer.stored
    return str(int(weights) + int(reals or 0)) + (f" + {choices.split()[0]} choices" if choices else "")


def warm(given: Signals) -> None:
    """Compile the kernels."""
    x = places(given.values.shape[1])
    for refinement in REFINEMENTS:
        for size in (1, len(given.values)):
            network(dyadic_library([MOTHERS["slog2"]], x), FitOptions(2, refinement=refinement))(given.values[:size])


def report(given: Signals, drawn: Path | None) -> Iterator[Table]:
    """The tables, one after another."""
    size = f"{len(given.values)} signals of {given.values.shape[1]} samples: {', '.join(given.names)}."
    first, found = accuracy(given)
    yield replace(first, units=size)
    if drawn is not None:
        picture(given, found).save(drawn)
    few = given.every(THINNING)
    yield libraries(few)
    yield rules(given)
    yield speed(given)


def main() -> None:
    """Make the signals, measure, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    parser.add_argument("--rows", type=int, default=32, help="rows of each image, an even number")
    parser.add_argument("--picture", type=Path, help="bars of table A as a PNG")
    add_options(parser)
    options = parser.parse_args()
    sheet = Sheet.of(options)
    given = signals(None if options.data is None else Path(options.data), options.rows)
    with threadpool_limits(1), limited(1):
        warm(given)
        for found in report(given, options.picture):
            sheet.add(found)
    sys.stdout.write(f"\n{time.process_time():.0f} CPU s in all\n")


if __name__ == "__main__":
    main()
