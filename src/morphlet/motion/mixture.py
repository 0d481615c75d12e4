"""A mixture of shapes of one mesh: faces turn and stretch by shares of what each shape does to them.

Against a reference each shape turns every face, and gives its edges lengths. A mixture turns a face by the weighted mean of its
rotation vectors, gives edges the weighted mean of their lengths, and puts the vertices where this fits together best. The turn
of the whole shape is taken out before, by its best rotation, and given back by its share.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial.transform import Rotation

from morphlet.errors import InputError
from morphlet.motion.enclosed import Enclosed
from morphlet.motion.face_turns import face_rotations, unwrapped
from morphlet.motion.gradients import GradientSystem
from morphlet.numerics.compiled import kernel
from morphlet.numerics.rigid import kabsch
from morphlet.numerics.rotations import exponential
from morphlet.surface.mesh import Mesh

STEPS = (1.5, 5.0, 2.5, 1.0)
"""How far vertices go on their way to where faces, turned to what their neighbours made of them, would have them, round by round: about
the inverse Chebyshev nodes of four steps for modes that one round moves by 15 to 100 %. As many rounds of whole steps leave a fifth
to a quarter more change of edge lengths on public poses."""
SYMMETRIC = [[0, 1], [1, 2]]
"""Where the entries xx, xy, yy are in a matrix."""


@dataclass(frozen=True, eq=False)
class Change:
    """What a shape does to the reference, or what each of several does, in rows.

    Parameters
    ----------
    turns
        Rotation vector of each face, beside the turn of the whole.
    stretches
        Entries xx, xy, yy of the symmetric stretch of each face in its frame, before it turns.
    lengths
        Of the edges of each face, from corner 0 to 1, 0 to 2, 1 to 2.
    rest
        What gradients over the reference do not tell of the shape, the whole turned back.
    offsets
        Where the other parts lie beside the faces that they hang on, turned back.
    whole
        Rotation vector of the whole.
    volume
        Inside, if the reference encloses one.
    """

    turns: Float[np.ndarray, "*k m 3"]
    stretches: Float[np.ndarray, "*k m 3"]
    lengths: Float[np.ndarray, "*k m 3"]
    rest: Float[np.ndarray, "*k n 3"]
    offsets: Float[np.ndarray, "*k p 3"]
    whole: Float[np.ndarray, "*k 3"]
    volume: Float[np.ndarray, "*k"]


@dataclass(frozen=True, eq=False)
class Mixture:
    """Shapes made ready to be mixed with any weights, each alone is met to rounding.

    Parameters
    ----------
    system
        Gradients over the reference, faces weighted by their areas.
    shapes
        What is mixed.
    changes
        What each does to the reference.
    enclosed
        Of the reference, where the volumes of all shapes have one sign.
    """

    system: GradientSystem
    shapes: Float[np.ndarray, "k n 3"]
    changes: Change
    enclosed: Enclosed | None

    @staticmethod
    def prepare(reference: Mesh, shapes: Float[np.ndarray, "k n 3"]) -> "Mixture":
        """Factor the system of the reference, and take the change of each face apart.

        Parameters
        ----------
        reference
            Any mesh; parts beside the largest, and vertices without faces, turn with the face of that one nearest to their centre.
        shapes
            Where its vertices are in each; the reference itself need not be among them.

        Raises
        ------
        SolveError
            If the system cannot be factored.

        Notes
        -----
        Where no single rotation of the whole is best, none is taken out. Rotations of more than half a turn against the whole,
        and less than a whole one, are recognised by the faces in between. If the reference is closed but for small holes, and the
        volumes of all shapes have one sign, the volume follows its weighted mean, or that of its cube root, or what lies between.

        References
        ----------
        Alexa, Cohen-Or and Levin, As-rigid-as-possible shape interpolation, SIGGRAPH 2000. Xu, Zhang, Wang and Bao, Poisson
        shape interpolation, Graphical Models 68, 2006. Winkler, Drieseberg, Alexa and Hormann, Multi-scale geometry
        interpolation, Computer Graphics Forum 29, 2010.

        Examples
        --------
        >>> from morphlet import Mesh
        >>> from morphlet.motion.mixture import Mixture
        >>> from morphlet.numerics.unit_sphere import icosphere
        >>> points, faces = icosphere(2)
        >>> quarter = Mixture.prepare(Mesh(points, faces), np.stack([points, points[:, [1, 0, 2]] * [-1, 1, 1]]))
        >>> bool(abs(np.linalg.norm(quarter(np.array([[0.5], [0.5]])), axis=1) - 1).max() < 1e-12)
        True
        """
        system = GradientSystem.prepare(reference, reference.face_areas)
        enclosed = Enclosed.of(reference)
        found = [_change(system, shape, enclosed) for shape in shapes]
        changes = Change(**{name: np.stack([getattr(change, name) for change in found]) for name in Change.__dataclass_fields__})
        signed = enclosed if np.all(changes.volume > 0) or np.all(changes.volume < 0) else None
        return Mixture(system, shapes, changes, signed)

    def __call__(self, weights: Float[np.ndarray, "k q"]) -> Float[np.ndarray, "n 3"]:
        """Positions for weights that add up to one: one column for all vertices, or one for each.

        Notes
        -----
        15 CPU ms for 8k vertices and two shapes.
        """
        return self.settled(*self.mixed(weights), weights, weights)

    def mixed(self, weights: Float[np.ndarray, "k q"]) -> tuple[Float[np.ndarray, "m 2 2"], Float[np.ndarray, "m 2 3"]]:
        """The stretch of each face in its frame, and the gradients that it asks for: its stretched and turned frame."""
        own, change = self.of_faces(weights), self.changes
        plane, wanted = np.empty((own.shape[1], 2, 2)), np.empty((own.shape[1], 2, 3))
        _mix(own, change.stretches, change.lengths, change.turns, change.whole, self.system.frames, self.system.bases, plane, wanted)
        return plane, wanted

    def settled(
        self,
        plane: Float[np.ndarray, "m 2 2"],
        wanted: Float[np.ndarray, "m 2 3"],
        weights: Float[np.ndarray, "k q"],
        volumes: Float[np.ndarray, "k r"],
    ) -> Float[np.ndarray, "n 3"]:
        """The positions in which the faces, stretched so, fit together best.

        Parameters
        ----------
        plane, wanted
            Stretch of each face, and gradients to start from, which are overwritten.
        weights
            For what gradients do not tell: where the mean is, and where other parts are.
        volumes
            Between the volumes of these mixtures the volume stays.
        """
        change = self.changes
        start = self.system.swift(self.system.gather @ wanted.reshape(-1, 3))
        x = start + self.system.means(self.system.rest.vertices - start)
        for step in STEPS:
            x += step * self.system.swift(self.system.forces(x, plane, wanted))
        x += np.einsum("nde,ne->nd", exponential(weights.T @ change.whole), np.einsum("kn,knd->nd", weights, change.rest))
        x = self._with_volume(self._with_parts(x, weights), volumes)
        straight = np.einsum("kn,knd->d", weights, self.shapes) / max(len(x), 1)
        return x + (straight - _mean(x))

    def of_faces(self, values: Float[np.ndarray, "k q"]) -> Float[np.ndarray, "k m"]:
        """Means over the corners, or the one column for each face."""
        if values.shape[1] != self.system.rest.n_vertices:
            return np.repeat(values, self.system.rest.n_faces, axis=1)
        a, b, c = self.system.rest.faces.T
        return (values[:, a] + values[:, b] + values[:, c]) / 3

    def _with_parts(self, x: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "k q"]) -> Float[np.ndarray, "n 3"]:
        """Positions with the parts that follow others in their places."""
        parts = self.system.followers
        if not len(parts.parts):
            return x
        offsets = np.einsum("kp,kpd->pd", self.of_faces(weights)[:, parts.hosts], self.changes.offsets)
        turns = face_rotations(self.system.frames[parts.hosts], self.system.gradients(x)[parts.hosts])
        return parts.placed(x, np.einsum("pde,pe->pd", turns, offsets))

    def _with_volume(self, x: Float[np.ndarray, "n 3"], weights: Float[np.ndarray, "k r"]) -> Float[np.ndarray, "n 3"]:
        """Positions moved as little as the system can tell until they enclose a volume between those of these weights.

        Two steps of Newton's method along one direction, with one slope: on public poses a volume 5 % off is 0.003 % off after them.
        """
        if self.enclosed is None:
            return x
        slopes = self.enclosed.slopes(x)
        volume = float(np.sum(x * slopes)) / 3
        reached = np.append(self.changes.volume @ weights, (np.cbrt(self.changes.volume) @ weights) ** 3)
        goal = float(np.clip(volume, reached.min(), reached.max()))
        if goal == volume:
            return x
        way = self.system.swift(slopes)
        slope = float(np.sum(way * slopes))
        if not slope > 0:
            return x
        x = x + (goal - volume) / slope * way
        return x + (goal - self.enclosed.volume(x)) / slope * way


def _change(system: GradientSystem, shape: Float[np.ndarray, "n 3"], enclosed: Enclosed | None) -> Change:
    """What a shape does to the rest shape of the system."""
    reference, parts = system.rest, system.followers
    centre = _mean(reference.vertices)
    rotation = _best_rotation(reference, shape)
    aligned = (shape - _mean(shape)) @ rotation + centre
    gradients = system.gradients(aligned)
    rotations = face_rotations(system.frames, gradients)
    turns = unwrapped(Rotation.from_matrix(rotations).as_rotvec(), reference.topology) if len(rotations) else np.zeros((0, 3))
    stretches = stretches_of(gradients)
    whole = stretches[:, SYMMETRIC] @ system.frames @ rotations.transpose(0, 2, 1)
    following = np.isin(system.part, parts.parts)[:, None]
    rest = aligned - system.solve(whole) - following * (system.means(aligned) - system.means(reference.vertices))
    offsets = np.einsum("pd,pde->pe", parts.reach @ aligned, rotations[parts.hosts])
    volume = np.array(enclosed.volume(aligned) if enclosed is not None else 0.0)
    return Change(turns, stretches, _lengths(reference.faces, shape), rest, offsets, Rotation.from_matrix(rotation).as_rotvec(), volume)


def stretches_of(gradients: Float[np.ndarray, "m 2 3"]) -> Float[np.ndarray, "m 3"]:
    """Symmetric stretches of frames that become these gradients, up to a turn: entries xx, xy, yy.

    Examples
    --------
    >>> stretches_of(np.array([[[0.0, 2.0, 0.0], [0.0, 0.0, 3.0]]]))
    array([[2., 0., 3.]])
    """
    # roots of the products J J^T, (C + s I) / sqrt(tr C + 2 s), s the root of the determinant
    square = np.einsum("fkd,fld->fkl", gradients, gradients)
    area = np.linalg.norm(np.cross(gradients[:, 0], gradients[:, 1]), axis=1)
    size = np.sqrt(square[:, 0, 0] + square[:, 1, 1] + 2 * area)
    entries = np.stack([square[:, 0, 0] + area, square[:, 0, 1], square[:, 1, 1] + area], axis=1)
    return entries / np.where(size > 0, size, 1.0)[:, None]


def _lengths(faces: Int[np.ndarray, "m 3"], positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "m 3"]:
    """Of the edges from corner 0 to 1, 0 to 2, 1 to 2."""
    a, b, c = (positions[faces[:, k]] for k in range(3))
    return np.stack([np.linalg.norm(side, axis=1) for side in (b - a, c - a, c - b)], axis=1)


def _mean(positions: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Mean of the vertices, zero without any."""
    return positions.mean(axis=0) if len(positions) else np.zeros(3)


def _best_rotation(source: Mesh, target: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3 3"]:
    """The rotation that brings the source nearest to the target, vertices weighted by areas; none where several do."""
    try:
        return kabsch(source.vertices - _mean(source.vertices), target - _mean(target), source.vertex_areas)
    except InputError:
        return np.eye(3)


@kernel
def _mix(weights, stretches, lengths, turns, wholes, frames, bases, plane, wanted):  # type: ignore[no-untyped-def]
    # weights (k, m), stretches, lengths, turns (k, m, 3), wholes (k, 3), frames (m, 2, 3), bases (m, 3); out: plane (m, 2, 2), the stretch
    # of mean lengths, and wanted (m, 2, 3), that times the turned frame. With L = sum w S, the square of the stretch is
    # sum_ij w_i w_j N_ij, where N_ij gives each edge the product of its lengths in shapes i and j and N_ii = S_i^2. It is taken as L^2 + B,
    # B = sum_{i != j} w_i w_j (N_ij - S_i S_j): exactly zero for one shape alone, so that nothing is lost to rounding there.
    g3, g4, g5, gs, gc = 0.0, 0.0, 0.0, 1.0, 0.5  # the last turn of the whole, most often the same for all faces
    for f in range(len(frames)):
        a = b = c = aa = bb = cc = p1 = p2 = p3 = q1 = q2 = q3 = 0.0
        t0 = t1 = t2 = g0 = g1 = g2 = 0.0
        for i in range(len(weights)):
            w = weights[i, f]
            x, y, z = w * stretches[i, f, 0], w * stretches[i, f, 1], w * stretches[i, f, 2]
            a, b, c = a + x, b + y, c + z
            aa, bb, cc = aa + x * x + y * y, bb + y * (x + z), cc + y * y + z * z
            x, y, z = w * lengths[i, f, 0], w * lengths[i, f, 1], w * lengths[i, f, 2]
            p1, p2, p3 = p1 + x, p2 + y, p3 + z
            q1, q2, q3 = q1 + x * x, q2 + y * y, q3 + z * z
            t0, t1, t2 = t0 + w * turns[i, f, 0], t1 + w * turns[i, f, 1], t2 + w * turns[i, f, 2]
            g0, g1, g2 = g0 + w * wholes[i, 0], g1 + w * wholes[i, 1], g2 + w * wholes[i, 2]
        u, v = p1 * p1 - q1, p2 * p2 - q2
        h = 0.5 * (u + v - (p3 * p3 - q3))
        d, e, k = bases[f, 0], bases[f, 1], bases[f, 2]
        la, lb, lc = a * a + b * b, b * (a + c), b * b + c * c
        x, y, z = u * d * d - la + aa, d * (u * e + h * k) - lb + bb, u * e * e + 2 * h * e * k + v * k * k - lc + cc
        s = (a * c - b * b) ** 2 + lc * x + la * z - 2 * lb * y + x * z - y * y
        s = np.sqrt(max(s, 0.0))
        size = la + x + lc + z + 2 * s
        size = 1 / np.sqrt(size) if size > 0 else 0.0
        plane[f, 0, 0], plane[f, 1, 1] = (la + x + s) * size, (lc + z + s) * size
        plane[f, 0, 1] = plane[f, 1, 0] = (lb + y) * size
        turn, whole = t0 * t0 + t1 * t1 + t2 * t2, g0 * g0 + g1 * g1 + g2 * g2
        ts, tc = 1.0, 0.5
        if turn > 0:
            angle = np.sqrt(turn)
            ts, tc = np.sin(angle) / angle, 2 * np.sin(0.5 * angle) ** 2 / turn
        if whole > 0 and not (g0 == g3 and g1 == g4 and g2 == g5):
            angle = np.sqrt(whole)
            g3, g4, g5 = g0, g1, g2
            gs, gc = np.sin(angle) / angle, 2 * np.sin(0.5 * angle) ** 2 / whole
        for r in range(2):
            x = y = z = 0.0
            for l in range(2):
                w = plane[f, r, l]
                x, y, z = x + w * frames[f, l, 0], y + w * frames[f, l, 1], z + w * frames[f, l, 2]
            u, v, w = t1 * z - t2 * y, t2 * x - t0 * z, t0 * y - t1 * x
            x, y, z = x + ts * u + tc * (t1 * w - t2 * v), y + ts * v + tc * (t2 * u - t0 * w), z + ts * w + tc * (t0 * v - t1 * u)
            u, v, w = g1 * z - g2 * y, g2 * x - g0 * z, g0 * y - g1 * x
            x, y, z = x + gs * u + gc * (g1 * w - g2 * v), y + gs * v + gc * (g2 * u - g0 * w), z + gs * w + gc * (g0 * v - g1 * u)
            wanted[f, r, 0], wanted[f, r, 1], wanted[f, r, 2] = x, y, z
