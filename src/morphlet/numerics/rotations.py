"""Rotations by the thousand: the one that fits a covariance best, and their exponential and logarithm.

A covariance is ``S = sum_j w_j a_j b_j^T``, rest times deformed; its best rotation R maximises tr(R S), so that b is close to
R a. Horn's symmetric 4 x 4 matrix K of S has the rotation's unit quaternion as the eigenvector of its largest eigenvalue,
found by Newton's method on its quartic: always a rotation, never a reflection, and no singular values. Where that
eigenvalue is nearly double (a cell crushed to a line, or turned inside out) a high power of K projects on all quaternions
that fit equally well, and the one of least angle is taken.
"""

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.numerics.compiled import OPTIONS, inner_kernel, kernel, njit

BLOCK = 64
"""Covariances fitted side by side, in the lanes of vector registers: their work space stays in the first cache."""

S, R, LAMBDA, DOUBT = 0, 9 * BLOCK, 18 * BLOCK, 19 * BLOCK
"""Where a block's work space holds covariances, rotations, traces tr(R S) and doubts; each entry by entry."""

WORK = 20 * BLOCK
"""Length of a block's work space."""

TINY = 1e-290
"""Squared norm below which a covariance is zero: its inverse would overflow. Every rotation fits it; identity is taken."""

NEWTON = 10
"""Steps on the quartic from its upper bound sqrt(3): of random covariances, two in a thousand need more."""

SEPARATE = 1e-4
"""Least product of the distances from the largest root to the others (of a covariance of norm 1) for which rounding
(1e-16) leaves the eigenvector twelve digits."""

CONVERGED = 1e-15
"""Largest square of the last Newton step, over that product: what is left of its error."""

BOUND = float(np.sqrt(3.0))
"""Largest size of an eigenvalue of K, of a covariance of norm 1."""

SQUARINGS = 50
"""How often K is squared: of two eigenvalues 1e-14 apart the smaller vanishes."""

ALONG = 1e-8
"""Squared cosine to the equally good rotations, relative to the nearest axis, below which none is near identity: half turns."""

SMALL_ANGLE = 1e-4
"""Angle (radians) below which sine quotients are taken from their series: its next term is 1e-17."""

lane_kernel = njit(**OPTIONS, no_cpython_wrapper=True, fastmath={"contract", "nsz", "arcp"})
"""Kernels whose loop over a block becomes vector instructions."""


def best_rotations(covariances: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The rotation of each covariance that maximises tr(R S).

    Parameters
    ----------
    covariances
        ``S = sum_j w_j a_j b_j^T`` of paired vectors a (at rest) and b (deformed); weights may be negative.

    Returns
    -------
    rotations
        Matrices R with det R = +1. Where several fit equally well, the one of least angle.

    Raises
    ------
    InputError
        If an entry is NaN or infinite.

    Notes
    -----
    O(n), vectorised. The trace is the best one to 1e-14 of the covariance's norm.

    References
    ----------
    Horn, Closed-form solution of absolute orientation using unit quaternions, J. Opt. Soc. Am. A 4, 1987.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.rotations import best_rotations
    >>> turned = np.outer([1.0, 0, 0], [0, 1.0, 0]) + np.outer([0, 1.0, 0], [-1.0, 0, 0])
    >>> best_rotations(turned[None])[0].round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    checked = _arrays.real(covariances, "covariances", (None, 3, 3))
    out = np.empty((len(checked), 9))
    _fit_all(np.array(checked.reshape(-1, 9)), out)
    return out.reshape(-1, 3, 3)


def exponential(vectors: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The rotation about each vector by its length in radians.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.rotations import exponential
    >>> exponential(np.array([[0, 0, np.pi / 2]]))[0].round(12) + 0.0
    array([[ 0., -1.,  0.],
           [ 1.,  0.,  0.],
           [ 0.,  0.,  1.]])
    """
    out = np.empty((len(vectors), 9))
    _exponentials(np.array(vectors, np.float64), out)
    return out.reshape(-1, 3, 3)


def logarithm(rotation: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """The rotation vector of one rotation, of length at most pi.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.numerics.rotations import exponential, logarithm
    >>> logarithm(exponential(np.array([[0.1, 0.2, 0.3]]))[0]).round(12)
    array([0.1, 0.2, 0.3])
    """
    q = _quaternion(np.asarray(rotation, np.float64))
    sine = float(np.linalg.norm(q[1:]))
    angle = 2 * np.arctan2(sine, q[0])
    return np.asarray(q[1:] * (angle / sine if sine > SMALL_ANGLE**2 else 2.0))


def _quaternion(r: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Unit quaternion with w >= 0: the longest row of 4 q q^T, which a rotation's entries tell."""
    t = np.trace(r)
    diagonal = np.array([1 + t, *(1 + 2 * np.diag(r) - t)])
    skew, mixed = np.array([r[2, 1] - r[1, 2], r[0, 2] - r[2, 0], r[1, 0] - r[0, 1]]), r + r.T
    outer = np.diag(diagonal)
    outer[0, 1:] = outer[1:, 0] = skew
    outer[1:, 1:] += mixed - np.diag(np.diag(mixed))
    q = outer[int(np.argmax(diagonal))]
    q = q / np.linalg.norm(q)
    return np.asarray(q if q[0] >= 0 else -q)


@kernel
def _fit_all(covariances, out):  # type: ignore[no-untyped-def]
    """Covariances (n, 9) to rotations (n, 9), block by block."""
    work = np.zeros(WORK)
    for start in range(0, len(covariances), BLOCK):
        count = min(BLOCK, len(covariances) - start)
        for i in range(count):
            for k in range(9):
                work[S + k * BLOCK + i] = covariances[start + i, k]
        fit_block(work, count)
        for i in range(count):
            for k in range(9):
                out[start + i, k] = work[R + k * BLOCK + i]


@inner_kernel
def fit_block(work, count):  # type: ignore[no-untyped-def]
    """Rotations and traces of the first `count` covariances of a block's work space (WORK,); the others count as zero."""
    for k in range(9):
        for i in range(count, BLOCK):
            work[S + k * BLOCK + i] = 0.0
    _fit_lanes(work)
    for i in range(count):
        if work[DOUBT + i] > 0.0:
            _fit_carefully(work, i)


@lane_kernel
def _fit_lanes(work):  # type: ignore[no-untyped-def]
    """Newton's root and the adjugate's longest column, BLOCK covariances side by side; doubtful ones are marked."""
    for i in range(BLOCK):
        s00, s01, s02 = work[S + i], work[S + BLOCK + i], work[S + 2 * BLOCK + i]
        s10, s11, s12 = work[S + 3 * BLOCK + i], work[S + 4 * BLOCK + i], work[S + 5 * BLOCK + i]
        s20, s21, s22 = work[S + 6 * BLOCK + i], work[S + 7 * BLOCK + i], work[S + 8 * BLOCK + i]
        square = s00 * s00 + s01 * s01 + s02 * s02 + s10 * s10 + s11 * s11 + s12 * s12 + s20 * s20 + s21 * s21 + s22 * s22
        norm = np.sqrt(max(square, TINY))
        f = 1.0 / norm
        s00, s01, s02, s10, s11 = f * s00, f * s01, f * s02, f * s10, f * s11
        s12, s20, s21, s22 = f * s12, f * s20, f * s21, f * s22
        a00, a11, a22, a33 = s00 + s11 + s22, s00 - s11 - s22, s11 - s00 - s22, s22 - s00 - s11
        a01, a02, a03, a12, a13, a23 = s12 - s21, s20 - s02, s01 - s10, s01 + s10, s20 + s02, s12 + s21
        det_s = s00 * (s11 * s22 - s12 * s21) - s01 * (s10 * s22 - s12 * s20) + s02 * (s10 * s21 - s11 * s20)
        det_k = (a00 * a11 - a01 * a01) * (a22 * a33 - a23 * a23) - (a00 * a12 - a02 * a01) * (a12 * a33 - a23 * a13)
        det_k += (a00 * a13 - a03 * a01) * (a12 * a23 - a22 * a13) + (a01 * a12 - a02 * a11) * (a02 * a33 - a23 * a03)
        det_k += (a02 * a13 - a03 * a12) ** 2 - (a01 * a13 - a03 * a11) * (a02 * a23 - a22 * a03)
        root, step, slope = BOUND, 0.0, 1.0
        for _ in range(NEWTON):
            slope = max(4.0 * (root * root - 1.0) * root - 8.0 * det_s, SEPARATE * SEPARATE)
            step = (((root * root - 2.0) * root - 8.0 * det_s) * root + det_k) / slope
            root -= step
        a00, a11, a22, a33 = a00 - root, a11 - root, a22 - root, a33 - root
        g23, g13, g12 = a22 * a33 - a23 * a23, a12 * a33 - a23 * a13, a12 * a23 - a22 * a13
        g03, g02, g01 = a02 * a33 - a23 * a03, a02 * a23 - a22 * a03, a02 * a13 - a12 * a03
        h13, h12 = a01 * a13 - a03 * a11, a01 * a12 - a02 * a11
        h03, h02, h01 = a00 * a13 - a03 * a01, a00 * a12 - a02 * a01, a00 * a11 - a01 * a01
        w0, x1 = a11 * g23 - a12 * g13 + a13 * g12, a00 * g23 - a02 * g03 + a03 * g02
        y2, z3 = a03 * h13 - a13 * h03 + a33 * h01, a02 * h12 - a12 * h02 + a22 * h01
        x0, y0, z0 = a12 * g03 - a01 * g23 - a13 * g02, a01 * g13 - a11 * g03 + a13 * g01, a11 * g02 - a01 * g12 - a12 * g01
        y1, z1, z2 = a01 * g03 - a00 * g13 - a03 * g01, a00 * g12 - a01 * g02 + a02 * g01, a13 * h02 - a03 * h12 - a23 * h01
        # the diagonal of the adjugate is q_k^2 times one factor: its largest entry has the longest column
        d0, d1, d2, d3 = abs(w0), abs(x1), abs(y2), abs(z3)
        first, second = d0 >= d1, d2 >= d3
        w, x, y, z = (w0 if first else x0), (x0 if first else x1), (y0 if first else y1), (z0 if first else z1)
        u, v, s, t = (y0 if second else z0), (y1 if second else z1), (y2 if second else z2), (z2 if second else z3)
        upper = max(d0, d1) >= max(d2, d3)
        w, x, y, z = (w if upper else u), (x if upper else v), (y if upper else s), (z if upper else t)
        f = 2.0 / max(w * w + x * x + y * y + z * z, TINY)
        xx, yy, zz, xy, xz, yz = f * x * x, f * y * y, f * z * z, f * x * y, f * x * z, f * y * z
        wx, wy, wz, work[LAMBDA + i] = f * w * x, f * w * y, f * w * z, root * norm
        work[R + i], work[R + BLOCK + i], work[R + 2 * BLOCK + i] = 1.0 - yy - zz, xy - wz, xz + wy
        work[R + 3 * BLOCK + i], work[R + 4 * BLOCK + i], work[R + 5 * BLOCK + i] = xy + wz, 1.0 - xx - zz, yz - wx
        work[R + 6 * BLOCK + i], work[R + 7 * BLOCK + i], work[R + 8 * BLOCK + i] = xz - wy, yz + wx, 1.0 - xx - yy
        work[DOUBT + i] = 1.0 if slope < SEPARATE or step * step > CONVERGED * slope else 0.0


@inner_kernel
def _fit_carefully(work, i):  # type: ignore[no-untyped-def]
    """One covariance: (K + sqrt(3)) squared again and again becomes the projection on the best quaternions; that of identity is taken."""
    power, square = np.empty((4, 4)), np.empty((4, 4))
    total = norm = 0.0
    for a in range(3):
        b, c = (a + 1) % 3, (a + 2) % 3
        own, bc, cb = work[S + 4 * a * BLOCK + i], work[S + (3 * b + c) * BLOCK + i], work[S + (3 * c + b) * BLOCK + i]
        total += own
        norm += own * own + bc * bc + cb * cb
        power[a + 1, a + 1] = 2.0 * own
        power[0, a + 1] = power[a + 1, 0] = bc - cb
        power[b + 1, c + 1] = power[c + 1, b + 1] = bc + cb
    norm = np.sqrt(max(norm, TINY))
    power[0, 0] = 2.0 * total
    for a in range(4):
        power[a, a] += BOUND * norm - total
    for _ in range(SQUARINGS):
        scale = 1.0 / (power[0, 0] + power[1, 1] + power[2, 2] + power[3, 3])
        for a in range(4):
            for b in range(4):
                square[a, b] = 0.0
                for c in range(4):
                    square[a, b] += scale * power[a, c] * scale * power[c, b]
        power, square = square, power
    best = 0
    for a in range(1, 4):
        best = a if power[a, a] > power[best, best] else best
    best = 0 if power[0, 0] > ALONG * power[best, best] else best
    w, x, y, z = power[0, best], power[1, best], power[2, best], power[3, best]
    f = 2.0 / (w * w + x * x + y * y + z * z)
    turn = (
        (1.0 - f * (y * y + z * z), f * (x * y - w * z), f * (x * z + w * y)),
        (f * (x * y + w * z), 1.0 - f * (x * x + z * z), f * (y * z - w * x)),
        (f * (x * z - w * y), f * (y * z + w * x), 1.0 - f * (x * x + y * y)),
    )
    work[LAMBDA + i] = 0.0
    for a in range(3):
        for b in range(3):
            work[R + (3 * a + b) * BLOCK + i] = turn[a][b]
            work[LAMBDA + i] += turn[a][b] * work[S + (3 * b + a) * BLOCK + i]


@kernel
def _exponentials(vectors, out):  # type: ignore[no-untyped-def]
    """Rotation vectors (n, 3) to rotations (n, 9): Rodrigues."""
    for i in range(len(vectors)):
        x, y, z = vectors[i, 0], vectors[i, 1], vectors[i, 2]
        square = x * x + y * y + z * z
        angle = np.sqrt(square)
        small = angle < SMALL_ANGLE
        a = 1.0 - square / 6.0 if small else np.sin(angle) / angle
        b = 0.5 - square / 24.0 if small else (1.0 - np.cos(angle)) / square
        c = 1.0 - b * square
        out[i, 0], out[i, 1], out[i, 2] = c + b * x * x, b * x * y - a * z, b * x * z + a * y
        out[i, 3], out[i, 4], out[i, 5] = b * x * y + a * z, c + b * y * y, b * y * z - a * x
        out[i, 6], out[i, 7], out[i, 8] = b * x * z - a * y, b * y * z + a * x, c + b * z * z
