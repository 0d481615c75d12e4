"""A deformed object as wavelet networks, with one library after another: what Tables 2 to 7 measure.

The signal is the geometry image of the deformed object on the sphere of the object at rest (steps 1 and 5); the networks of
its rows give its vertices back. A library is the paper's word for a choice of mother wavelets.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet.approximation.rows import ImageApproximation, RowApproximation, RowOptions, approximate_rows
from morphlet.approximation.surface import WAVELETS as MANY
from morphlet.approximation.surface import approximate
from morphlet.editing.falloff import Rate, rate
from morphlet.editing.method import Pull
from morphlet.paper.stopwatch import median_seconds
from morphlet.paper.subjects import ROWS, Subject
from morphlet.sphere.image import Layout, SphericalImage, directions
from morphlet.wavenet.fit import FitOptions, fit_rows
from morphlet.wavenet.library import Library as Candidates
from morphlet.wavenet.library import dyadic_library
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX

WAVELETS = 15
"""Of a network, as the paper fixes it."""
LAYOUT: Layout = "octahedral"
"""Of the geometry images: the package's own choice."""
VOICES, SPACING = 3, 0.42
"""Dilations per halving, and distance of the centers over the dilation, with which one mother has as many candidates as the six."""

Image = Callable[[SphericalImage], ImageApproximation]
"""How an image becomes networks."""


@dataclass(frozen=True)
class Library:
    """A choice of mothers, and of how they are used.

    Parameters
    ----------
    name
        For the table.
    networks
        From an image to the networks of its rows.
    """

    name: str
    networks: Image

    def vertices(self, subject: Subject) -> Float[np.ndarray, "n 3"]:
        """Where the networks put the vertices of the deformed object."""
        return placed(subject, self.networks(subject.image))


def rows_of(options: RowOptions) -> Image:
    """Networks with these options."""
    return lambda image: approximate_rows(image, options)


def dense(image: SphericalImage) -> ImageApproximation:
    """Networks of one mother on a finer grid: about as many candidates as the six have together."""
    x = np.linspace(0, 1, image.positions.shape[1])
    return ImageApproximation(image.layout, fit_rows(x, image.positions, lone_library(x), FitOptions(WAVELETS)).table, image.mask)


def lone_library(x: Float[np.ndarray, "n"]) -> Candidates:
    """The candidates of one mother on that grid."""
    return dyadic_library([MOTHERS["mexican_hat"]], x, voices=VOICES, spacing=SPACING)


SINGLE = tuple(Library(f"{psi.name} alone", rows_of(RowOptions(WAVELETS, mothers=(psi,)))) for psi in PAPER_SIX)
"""Each mother by itself."""
SIX = Library("the six together (the paper's)", rows_of(RowOptions(WAVELETS)))
LONE = Library("mexican_hat alone, as many candidates as the six", dense)
LIBRARIES = (
    *SINGLE,
    SIX,
    LONE,
    Library("ours: the six, wavelets moved once chosen", rows_of(RowOptions(WAVELETS, refinement="final"))),
    Library("ours: the six, wavelets moved after each choice", rows_of(RowOptions(WAVELETS, refinement="interleaved"))),
)
"""The lines of Table 3 that are networks of rows."""
SHARE = 4
"""Vertices per wavelet, at least, of a network over the sphere: with fewer it would store the vertices themselves."""
NUMBERS, NUMBERS_OVER_SPHERE = 5, 7
"""Numbers that a wavelet of a row needs (center, dilation, three weights), and one on the sphere, which has a direction for a center and,
if it is odd, a turn beside."""
LESS = round(100 * MANY * NUMBERS_OVER_SPHERE / (ROWS * WAVELETS * NUMBERS))
OVER_SPHERE = f"ours: one network of {MANY} wavelets over the sphere, with {LESS} % of the numbers"


def placed(subject: Subject, networks: ImageApproximation) -> Float[np.ndarray, "n 3"]:
    """Where networks of the image put the vertices of an object."""
    return RowApproximation(networks, subject.sphere.points, subject.mesh.topology).mesh().vertices


def over_sphere(subject: Subject) -> Float[np.ndarray, "n 3"]:
    """The deformed object as one network over the whole sphere."""
    count = min(MANY, subject.mesh.n_vertices // SHARE)
    return approximate(subject.deformed_map, subject.deformed.vertices, count).values()


@dataclass(frozen=True)
class Closeness:
    """How far a network's object is from the deformed one, over the vertices that have a place on the sphere.

    Parameters
    ----------
    total
        Sum of the distances between corresponding vertices, over the bounding-box diagonal.
    mean_percent
        Their mean, in percent of the diagonal.
    mse_relative
        Mean squared distance (Eq. 9), over the squared diagonal.
    """

    total: float
    mean_percent: float
    mse_relative: float


def grid_percent(subject: Subject) -> float:
    """How far the image itself, without networks, is from the vertices on average, in percent of the diagonal."""
    return closeness(subject, subject.image.sample(subject.sphere.points)).mean_percent


def closeness(subject: Subject, vertices: Float[np.ndarray, "n 3"]) -> Closeness:
    """The same for one approximation."""
    own, size = subject.sphere.valid, subject.mesh.bbox_diagonal
    apart = np.linalg.norm(vertices[own] - subject.deformed.vertices[own], axis=1) / size
    return Closeness(float(apart.sum()), 100 * float(apart.mean()), float(np.mean(apart**2)))


def rates(subject: Subject, vertices: Float[np.ndarray, "n 3"]) -> Rate:
    """The deformation rate in its readings (Eq. 12)."""
    return rate(subject.roi, subject.deformed, vertices)


def frame_seconds(subject: Subject) -> float:
    """Seconds of one answer of the prepared editor to a new place of the handle, without a network."""
    pull = _dragged(subject)
    return median_seconds(lambda: subject.editor.positions(pull))


def frame_seconds_with(subject: Subject, library: Library) -> float:
    """The same, and the networks of the rows trained on the answer; where the rows' samples lie is known beforehand."""
    pull = _dragged(subject)
    places = subject.sphere.locate(directions(LAYOUT, subject.rows).reshape(-1, 3))

    def frame() -> None:
        positions = np.array(subject.mesh.vertices)
        positions[subject.roi.moving] = subject.editor.positions(pull)
        seen = places.positions(subject.mesh.with_vertices(positions)).reshape(*subject.image.mask.shape, 3)
        library.networks(SphericalImage(LAYOUT, seen, subject.image.mask))

    return median_seconds(frame)


def _dragged(subject: Subject) -> Pull:
    """The handle a frame farther than the mesh, as when it is dragged."""
    start = subject.frames.positions[-2][subject.roi.moving]
    return Pull(subject.path[-1], start=start)
