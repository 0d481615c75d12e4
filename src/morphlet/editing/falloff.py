"""How far a vertex follows its handle by its distance from it alone (paper, Sect. 8.1, Eqs. 10-12).

Distances are straight ones, in mesh units. Eq. 10 leaves open which handle vertex is meant, Eq. 11 is neither a Gaussian nor 1
on the handle, and Eq. 12 holds no deformed position: the literal readings are here by that name, beside those that were meant.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from morphlet import _arrays
from morphlet.editing.method import Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.numerics.optimize import OnStep
from morphlet.surface.mesh import Mesh

Falloff = Literal["gaussian", "literal", "wendland"]
"""From the ratio to the factor: the Gaussian that is meant, Eq. 11 as printed, or one that is 0 from 1 on."""
Ratio = Literal["literal", "between"]
"""Distance to the handle over the smallest gap between handle and anchors (Eq. 10), or over the sum of the distances to both."""

WIDTH = 0.25
"""Of Eq. 11, in units of the ratio."""
LITERAL_PEAK = 0.5
"""The factor before the exponential in Eq. 11: half the handle's own, so that the surface breaks there."""


@dataclass(frozen=True)
class Direct:
    """Every free vertex goes part of the way that the nearest handle vertex goes (Eqs. 10-11).

    For translations: the paper says itself that this is limited beyond them. Handle weights are not used.

    Parameters
    ----------
    falloff
        The part, by the ratio r: ``gaussian`` exp(-r^2 / (2 0.25^2)), which is 1 on the handle and 0.0003 at r = 1;
        ``literal`` 0.5 exp(-r / 0.25), which jumps from the handle's 1 to 0.5 and still is 0.009 at r = 1; ``wendland``
        (1 - r)^4 (4 r + 1), 0 from r = 1 on.
    ratio
        ``literal`` (Eq. 10), which exceeds 1 wherever a vertex is farther away than the narrowest gap between handle and
        anchors; ``between``, d_h / (d_h + d_f), which is 0 on the handle and 1 at anchors.

    Raises
    ------
    InputError
        If one of them is unknown.

    Notes
    -----
    Preparing costs O(n log h), a frame O(k): a multiplication and an addition per coordinate.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.falloff import Direct
    >>> from morphlet.editing.method import Pull
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [0, 1, 0], [1, 1, 0]], [[0, 1, 3], [1, 2, 4], [1, 4, 3]])
    >>> follow = Direct("wendland").prepare(Roi(strip, [0], [1, 3]))
    >>> follow(Pull(np.array([[0.0, 0.0, 16.0]])))[:, 2].round(3).tolist()
    [16.0, 0.451, 0.451]
    """

    falloff: Falloff = "gaussian"
    ratio: Ratio = "literal"

    def __post_init__(self) -> None:
        for name, known in (("falloff", Falloff), ("ratio", Ratio)):
            if getattr(self, name) not in get_args(known):
                raise InputError(f"one of {', '.join(get_args(known))} as {name}", repr(getattr(self, name)), "choose one of these")

    def prepare(self, roi: Roi) -> Prepared:
        """The part of the way of each vertex.

        Raises
        ------
        InputError
            If the region has no anchors, or one of them lies on the handle: then there is no ratio.
        """
        part = transition(ratios(roi, self.ratio), self.falloff)
        return _Follow(roi, _nearest_handle(roi, roi.moving)[1], part)


@dataclass(frozen=True, eq=False)
class _Follow:
    """Which handle vertex each moving one follows, and how far; the handle itself goes all the way."""

    roi: Roi
    leader: Int[np.ndarray, "k"]
    part: Float[np.ndarray, "k"]

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of the moving vertices."""
        roi = self.roi
        targets = _arrays.real(pull.targets, "targets", (len(roi.handle), 3))
        way = targets - roi.mesh.vertices[roi.handle]
        found = roi.mesh.vertices[roi.moving] + self.part[:, None] * way[self.leader]
        found[np.searchsorted(roi.moving, roi.handle)] = targets
        return found


def ratios(roi: Roi, rule: Ratio = "literal") -> Float[np.ndarray, "k"]:
    """How far each moving vertex is from the handle, on its way to the anchors (Eq. 10).

    Parameters
    ----------
    roi
        With anchors.
    rule
        What the distance is divided by: see `Direct`.

    Returns
    -------
    ratios
        In the order of `Roi.moving`; 0 on the handle.

    Raises
    ------
    InputError
        If the region has no anchors, or one of them lies on the handle.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.falloff import ratios
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [4, 0, 0], [0, 1, 0]], [[0, 1, 3], [1, 2, 3]])
    >>> roi = Roi(strip, [0], [1, 3])
    >>> ratios(roi), ratios(roi, "between").round(3)
    (array([0.  , 0.25, 0.25]), array([0.   , 0.25 , 0.195]))
    """
    gap = smallest_gap(roi)
    distance = _nearest_handle(roi, roi.moving)[0]
    if rule == "literal":
        return distance / gap
    vertices = roi.mesh.vertices
    return distance / (distance + cKDTree(vertices[roi.anchors]).query(vertices[roi.moving])[0])


def transition(ratio: Float[np.ndarray, "k"], falloff: Falloff) -> Float[np.ndarray, "k"]:
    """The part of the handle's way at each ratio (Eq. 11).

    Examples
    --------
    >>> from morphlet.editing.falloff import transition
    >>> transition(np.array([0.0, 1.0, 2.0]), "literal").round(6).tolist()
    [0.5, 0.009158, 0.000168]
    """
    if falloff == "literal":
        return LITERAL_PEAK * np.exp(-ratio / WIDTH)
    if falloff == "gaussian":
        return np.exp(-0.5 * (ratio / WIDTH) ** 2)
    return np.clip(1 - ratio, 0.0, None) ** 4 * (4 * ratio + 1)


def smallest_gap(roi: Roi) -> float:
    """The smallest distance of an anchor from a handle vertex: the denominator of Eqs. 10 and 12.

    Raises
    ------
    InputError
        If the region has no anchors, or one of them lies on the handle.

    Notes
    -----
    O(n log h), and less where the region is small: the rim tells what farther anchors have to beat.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.falloff import smallest_gap
    >>> from morphlet.editing.roi import Roi
    >>> smallest_gap(Roi(Mesh([[0, 0, 0], [3, 0, 0], [0, 4, 0]], [[0, 1, 2]]), [1], [0]))
    5.0
    """
    if not len(roi.anchors):
        raise InputError("anchors, which the ratio of Eq. 10 is told by", "a region without", "leave some vertices out of the region")
    if len(roi.rim):
        bound = float(_nearest_handle(roi, roi.rim)[0].min())
        low, high = (pick(roi.mesh.vertices[roi.handle], axis=0) for pick in (np.min, np.max))
        near = ((roi.mesh.vertices >= low - bound) & (roi.mesh.vertices <= high + bound)).all(axis=1)
        rivals = roi.anchors[near[roi.anchors]]
    else:
        rivals = roi.anchors
    distance = _nearest_handle(roi, rivals)[0]
    gap = float(distance.min())
    if gap == 0:
        on = rivals[distance == 0]
        raise InputError("anchors apart from the handle", f"{len(on)} at the place of a handle vertex", "weld them, or free them", on)
    return gap


@dataclass(frozen=True)
class Rate:
    """The deformation rate of an edit, in percent of the smallest distance between handle and anchors (Eq. 12).

    Parameters
    ----------
    literal
        Eq. 12 as printed: mean distance of the region's vertices at rest from the nearest handle vertex. It tells the region, not
        what was done to it.
    literal_max
        The largest of these.
    displacement
        Mean way of the region's vertices, from rest to where they are.
    residual
        Mean distance of the region's vertices from their approximation by a network; None without one.
    """

    literal: float
    literal_max: float
    displacement: float
    residual: float | None = None


def rate(roi: Roi, deformed: Mesh, approximation: Float[np.ndarray, "n 3"] | None = None) -> Rate:
    """The deformation rate (Eq. 12), as printed and in two readings that hold a deformation.

    Parameters
    ----------
    roi
        Region of the edit, with the mesh at rest.
    deformed
        The mesh after the edit.
    approximation
        Positions of the deformed mesh's vertices as a wavelet network gives them.

    Returns
    -------
    rate
        In percent; means are over handle and free vertices.

    Raises
    ------
    InputError
        If the meshes do not fit, the region has no anchors, or one of them lies on the handle.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.editing.falloff import rate
    >>> from morphlet.editing.roi import Roi
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [4, 0, 0], [0, 1, 0]], [[0, 1, 3], [1, 2, 3]])
    >>> found = rate(Roi(strip, [0], [3]), strip.with_vertices(strip.vertices + [[0, 0, 1], [0, 0, 0], [0, 0, 0], [0, 0, 0.5]]))
    >>> found.literal, found.displacement
    (50.0, 75.0)
    """
    gap, rest = smallest_gap(roi), roi.mesh.vertices
    now = _arrays.real(deformed.vertices, "vertices of the deformed mesh", rest.shape)
    apart = _nearest_handle(roi, roi.moving)[0]
    way = np.linalg.norm((now - rest)[roi.moving], axis=1)
    residual = None
    if approximation is not None:
        missed = _arrays.real(approximation, "approximation", rest.shape) - now
        residual = 100 * float(np.linalg.norm(missed[roi.moving], axis=1).mean()) / gap
    return Rate(100 * float(apart.mean()) / gap, 100 * float(apart.max()) / gap, 100 * float(way.mean()) / gap, residual)


def _nearest_handle(roi: Roi, vertices: Int[np.ndarray, "k"]) -> tuple[Float[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Distance of some vertices to the nearest handle vertex, and its place in the handle."""
    distance, place = cKDTree(roi.mesh.vertices[roi.handle]).query(roi.mesh.vertices[vertices])
    return np.asarray(distance), np.asarray(place)
