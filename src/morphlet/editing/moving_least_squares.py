"""Moving least squares: space turned and shifted at every place as its control points demand from there (paper, Eqs. 1-2).

Each place moves by the rigid motion, or similarity, that fits the control points best, weighted by how near they are. No surface is
known: what is near through space goes along.
"""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist

from morphlet import _arrays
from morphlet.editing.method import Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.numerics.compiled import kernel
from morphlet.numerics.optimize import OnStep
from morphlet.numerics.rotations import best_rotations

Kind = Literal["rigid", "similarity"]


@dataclass(frozen=True)
class MovingLeastSquares:
    """Every place moves as the control points do, seen from there: the nearer, the more they count (Eqs. 1-2).

    The transformation at x minimises ``sum_i w_i |T(p_i) - q_i|^2`` with ``w_i = |p_i - x|^(-2 alpha)`` over the rigid motions or
    similarities. Controls of a region are its handle and the rim of its anchors, so that it goes over into what stays. The
    paper's weight 1 at a control point would not bring it to its target; the limit of Eq. 2 does. Handle weights are not used.

    Parameters
    ----------
    kind
        Rigid motions, or similarities: these scale, too.
    alpha
        Falloff: the larger, the less far controls count.

    Raises
    ------
    InputError
        If the kind is unknown or alpha is not positive.

    Notes
    -----
    Preparing k vertices for c controls costs O(k c) time and 8 k c bytes; a frame is one product of matrices (k, c) and (c, 12),
    and a rotation fit per vertex.

    References
    ----------
    Schaefer, McPhail and Warren, Image deformation using moving least squares, SIGGRAPH 2006.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.editing.moving_least_squares import MovingLeastSquares
    >>> corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    >>> field = MovingLeastSquares().field(corners, np.array([[0.2, 0.3, 5.0]]))
    >>> quarter_turn = corners @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> field(quarter_turn).round(9)
    array([[-0.3,  0.2,  5. ]])
    """

    kind: Kind = "rigid"
    alpha: float = 1.0

    def __post_init__(self) -> None:
        if self.kind not in get_args(Kind):
            raise InputError(f"one of {', '.join(get_args(Kind))} as kind", repr(self.kind), "choose one of these")
        if not (np.isfinite(self.alpha) and self.alpha > 0):
            raise InputError("a falloff alpha above 0", f"{self.alpha}", "1 and 2 are usual")

    def field(self, controls: Float[np.ndarray, "c 3"], points: Float[np.ndarray, "k 3"]) -> "MovingField":
        """Everything that does not depend on where the controls go.

        Parameters
        ----------
        controls
            Places p_i of the control points at rest; of several at one place the mean counts there.
        points
            Places x that are moved along.

        Returns
        -------
        field
            From targets q_i of the controls to the new places of the points.

        Raises
        ------
        InputError
            If there are no controls, or an array is not (any, 3) or not finite.
        """
        p, x = _arrays.real(controls, "controls", (None, 3)), _arrays.real(points, "points", (None, 3))
        if not len(p):
            raise InputError("at least one control point", "none", "choose a handle")
        weights = _shares(x, p, self.alpha)
        centres = weights @ p
        return MovingField(self.kind, p, x, weights, centres, _spreads(weights, np.array(p), centres))

    def prepare(self, roi: Roi) -> Prepared:
        """The field of the handle and the rim at the free vertices."""
        vertices = roi.mesh.vertices
        controls = np.concatenate([vertices[roi.handle], vertices[roi.rim]])
        return _Carried(roi, self.field(controls, vertices[roi.free]))


@dataclass(frozen=True, eq=False)
class MovingField:
    """Moving least squares made ready: from targets of the controls to new places of the points.

    Parameters
    ----------
    kind
        Rigid motions or similarities.
    controls, points
        At rest.
    weights
        Share of each control at each point; rows sum to 1.
    centres
        Weighted mean p* of the controls, as seen from each point.
    spreads
        Their weighted covariance about it.
    """

    kind: Kind
    controls: Float[np.ndarray, "c 3"]
    points: Float[np.ndarray, "k 3"]
    weights: Float[np.ndarray, "k c"]
    centres: Float[np.ndarray, "k 3"]
    spreads: Float[np.ndarray, "k 3 3"]

    def __call__(self, targets: Float[np.ndarray, "c 3"]) -> Float[np.ndarray, "k 3"]:
        """The new places of the points.

        Parameters
        ----------
        targets
            Where each control goes.

        Returns
        -------
        places
            Of the points, in their order.

        Raises
        ------
        InputError
            If there is not one finite target per control.
        """
        shifts = _arrays.real(targets, "targets", self.controls.shape) - self.controls
        common = shifts[0]
        shift, covariance = self._moments(shifts - common)
        rotation = best_rotations(covariance)
        arm = self.points - self.centres
        turned = np.einsum("kab,kb->ka", rotation, arm)
        if self.kind == "similarity":
            turned *= self._scales(rotation, covariance)[:, None]
        return self.points + (common + shift) + (turned - arm)

    def _moments(self, shifts: Float[np.ndarray, "c 3"]) -> tuple[Float[np.ndarray, "k 3"], Float[np.ndarray, "k 3 3"]]:
        """Weighted mean of the shifts q - p, and covariance of p and q, as seen from each point: one product of matrices."""
        products = (self.controls[:, :, None] * shifts[:, None, :]).reshape(-1, 9)
        sums = self.weights @ np.concatenate([shifts, products], axis=1)
        mean = sums[:, :3]
        crossed = sums[:, 3:].reshape(-1, 3, 3) - self.centres[:, :, None] * mean[:, None, :]
        return mean, self.spreads + crossed

    def _scales(self, rotation: Float[np.ndarray, "k 3 3"], covariance: Float[np.ndarray, "k 3 3"]) -> Float[np.ndarray, "k"]:
        """Size of the best similarity; 1 where the controls are all at one place."""
        before = np.einsum("kaa->k", self.spreads)
        after = np.einsum("kab,kba->k", rotation, covariance)
        return np.divide(after, before, out=np.ones(len(before)), where=before > 0)


@dataclass(frozen=True, eq=False)
class _Carried:
    """The free vertices of a region in the field of its handle and rim."""

    roi: Roi
    field: MovingField

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of the moving vertices."""
        targets = _arrays.real(pull.targets, "targets", (len(self.roi.handle), 3))
        free = self.field(np.concatenate([targets, self.roi.mesh.vertices[self.roi.rim]]))
        return _placed(self.roi, targets, free)


def _placed(roi: Roi, handle: Float[np.ndarray, "h 3"], free: Float[np.ndarray, "f 3"]) -> Float[np.ndarray, "k 3"]:
    """Positions of handle and free vertices, in the order of `Roi.moving`."""
    places = np.empty((len(roi.moving), 3))
    places[np.searchsorted(roi.moving, roi.handle)] = handle
    places[np.searchsorted(roi.moving, roi.free)] = free
    return places


def _shares(points: Float[np.ndarray, "k 3"], controls: Float[np.ndarray, "c 3"], alpha: float) -> Float[np.ndarray, "k c"]:
    """Eq. 2 over its sum, scaled by the nearest control first so that nothing overflows; at a control, it alone counts."""
    table = cdist(points, controls, "sqeuclidean")
    nearest = table.min(axis=1, keepdims=True)
    np.divide(nearest, table, out=table, where=table > 0)
    at_control = nearest[:, 0] == 0
    table[at_control] = cdist(points[at_control], controls, "sqeuclidean") == 0
    np.power(table, alpha, out=table)
    table /= table.sum(axis=1, keepdims=True)
    return table


@kernel
def _spreads(weights, controls, centres):  # type: ignore[no-untyped-def]
    # weights (k,c), controls (c,3), centres (k,3) -> (k,3,3): sum over c of w (p - p*) (p - p*)^T, free of cancellation.
    out = np.zeros((len(weights), 3, 3))
    for k in range(len(weights)):
        for c in range(len(controls)):
            w = weights[k, c]
            x, y, z = controls[c, 0] - centres[k, 0], controls[c, 1] - centres[k, 1], controls[c, 2] - centres[k, 2]
            out[k, 0, 0] += w * x * x
            out[k, 0, 1] += w * x * y
            out[k, 0, 2] += w * x * z
            out[k, 1, 1] += w * y * y
            out[k, 1, 2] += w * y * z
            out[k, 2, 2] += w * z * z
        out[k, 1, 0], out[k, 2, 0], out[k, 2, 1] = out[k, 0, 1], out[k, 0, 2], out[k, 1, 2]
    return out
