"""Editing that does not let the surface run through itself.

First the shell answers as if nothing were in the way. If that crosses itself, the handle goes its way in steps instead,
from a state without crossings to the next: where two pieces of the surface that are far apart at rest come near each other, they
are held apart along their normals. A step after which triangles cross is taken back and halved.
"""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from jaxtyping import Float, Int
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from morphlet import _arrays
from morphlet.editing.estimated import checked
from morphlet.editing.linear import hold
from morphlet.editing.method import Pull
from morphlet.editing.roi import Roi
from morphlet.editing.shell import PreparedShell, Shell
from morphlet.errors import InputError, SolveError
from morphlet.metrics import edge_lengths
from morphlet.numerics.linalg import Factor
from morphlet.numerics.optimize import OnStep, Step
from morphlet.numerics.rotations import exponential
from morphlet.surface.intersections import self_intersections

CLEARANCE = 0.4
"""Distance that is kept, in mean edge lengths: above the height of a triangle's edge over the plane of its neighbour's corner."""
REACH = 2.0
"""Pairs are looked for within the clearance and so many times the handle's way in a step: both sides may move as far."""
APPROACH = 0.5
"""Vertices are in contact only if this much nearer than at rest: neighbours in the surface are not."""
REGULAR = 1e-6
"""Share by which a gap resists its own push more: two pairs of the same vertices would be the same equation."""
SWEEPS = 3
"""Pairs of a local and a global step after each step of the handle, before contacts are looked for anew."""
ROUNDS = 20
"""Most such rounds at the end of the way."""
HALVINGS = 5
"""Times a step is halved before the way counts as blocked."""


@dataclass(frozen=True)
class Guarded:
    """A shell that does not run through itself.

    Parameters
    ----------
    shell
        What deforms.
    stride
        How far a handle vertex may go in a step, in mean edge lengths, where the direct answer crosses itself.

    Notes
    -----
    Without crossings the cost is that of the shell and of one search for them. With crossings each step costs
    some iterations and a search: on a cactus with 5 124 free vertices, bent by 110 degrees, 104 steps take some 16 s of CPU, with a
    stride of 2 some 12 s for nearly the same shape; bent by 130 degrees, a thickness of 0.02 leaves a crease that no stride tried here
    (0.5, 1, 2) gets past, which is refused. Crossings that are there at rest do not count.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh
    >>> from morphlet.editing.guard import Guarded
    >>> from morphlet.editing.method import Pull
    >>> from morphlet.editing.roi import Roi
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.surface.intersections import self_intersections
    >>> ball = Mesh(*icosphere(2))
    >>> z = ball.vertices[:, 2]
    >>> roi = Roi(ball, np.nonzero(z > 0.9)[0], np.nonzero(abs(z) <= 0.9)[0])
    >>> positions = np.array(ball.vertices)
    >>> positions[roi.moving] = Guarded().prepare(roi)(Pull(ball.vertices[roi.handle] - [0, 0, 1.5]))
    >>> len(self_intersections(ball.with_vertices(positions)))
    0
    """

    shell: Shell = field(default_factory=Shell)
    stride: float = 1.0

    def __post_init__(self) -> None:
        if not 0 < self.stride < np.inf:
            raise InputError("a positive stride", repr(self.stride), "pass about one edge length")

    def prepare(self, roi: Roi) -> "PreparedGuard":
        """Prepare the shell.

        Raises
        ------
        MeshError, SolveError
            See `Shell.prepare`.
        """
        moves = np.zeros(roi.mesh.n_vertices, bool)
        moves[roi.moving] = True
        faces = np.nonzero(moves[roi.mesh.faces].any(axis=1))[0]
        return PreparedGuard(self.shell.prepare(roi), self.stride, faces, self_intersections(roi.mesh, faces))


@dataclass(frozen=True, eq=False)
class Contacts:
    """Pairs of vertices to hold apart.

    Parameters
    ----------
    ends
        Of each pair, in the whole mesh; the first moves.
    differences
        From the unknowns to first end minus second end, as far as these are unknown.
    normal
        From the second to the first, across the gap.
    clearance
        Distance along the normal that is kept.
    """

    ends: Int[np.ndarray, "c 2"]
    differences: sp.csr_matrix
    normal: Float[np.ndarray, "c 3"]
    clearance: float

    def missing(self, whole: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "c"]:
        """By how much each pair is closer than the clearance; negative where there is room."""
        apart = whole[self.ends[:, 0]] - whole[self.ends[:, 1]]
        return self.clearance - np.einsum("cd,cd->c", apart, self.normal)


class _Pushes:
    """The least pushes that open the gaps, each answered by the whole surface; working state of one step of the handle."""

    def __init__(self, contacts: Contacts, factor: Factor) -> None:
        self._contacts, self._factor = contacts, factor
        self._active = np.zeros(0, np.int64)
        self._answers = np.zeros((factor.n, 0))
        self._root = np.zeros((0, 0))

    def opening(self, whole: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "u 3"]:
        """How the unknowns answer forces along the normals, only apart, that open every gap by what is missing."""
        missing = self._contacts.missing(whole)
        fresh = np.setdiff1d(np.flatnonzero(missing > 0), self._active)
        if len(fresh):
            self._prepare(fresh)
        if not len(self._active):
            return np.zeros((self._factor.n, 3))
        right = np.linalg.solve(self._root, missing[self._active])
        try:
            push = nnls(self._root.T, right)[0]
        except RuntimeError as error:
            raise SolveError("pushes that open all gaps", str(error), "move the handle less, or with a shorter stride") from error
        return self._answers @ (push[:, None] * self._contacts.normal[self._active])

    def _prepare(self, fresh: Int[np.ndarray, "f"]) -> None:
        """Take in more gaps: how much each opens for a push at each, and the factor of that matrix."""
        more = self._factor.solve(self._contacts.differences[fresh].T.toarray())
        self._active, self._answers = np.concatenate([self._active, fresh]), np.concatenate([self._answers, more], axis=1)
        rows, normal = self._contacts.differences[self._active], self._contacts.normal[self._active]
        opening = (rows @ self._answers) * (normal @ normal.T)
        opening[np.diag_indices(len(opening))] *= 1 + REGULAR
        self._root = np.linalg.cholesky(opening)


@dataclass(frozen=True, eq=False)
class PreparedGuard:
    """`Guarded` for one region: its shell, its moving faces, and which of them cross at rest."""

    shell: PreparedShell
    stride: float
    faces: Int[np.ndarray, "f"]
    before: Int[np.ndarray, "x 2"]

    def __call__(self, pull: Pull, on_step: OnStep | None = None) -> Float[np.ndarray, "k 3"]:
        """Positions of `Roi.moving`.

        Raises
        ------
        SolveError
            If the handle finds no way without crossings; `elements` holds the first pairs of faces.
        """
        answer = self.shell(pull, on_step)
        crossings = self._crossings(answer)
        if len(crossings) and not len(self.shell.energy.patch.unknown):
            raise SolveError("a free vertex that can give way", f"{len(crossings)} pairs of triangles that cross", "free some", crossings)
        return self._walked(pull, on_step) if len(crossings) else answer

    def with_roi(self, roi: Roi) -> "PreparedGuard | None":
        """The same guard with another handle, where its shell has one; None elsewhere."""
        shell = self.shell.with_roi(roi)
        return None if shell is None else replace(self, shell=shell)

    @cached_property
    def _edge(self) -> float:
        """Mean edge length of the mesh."""
        return float(edge_lengths(self.shell.energy.roi.mesh).mean())

    def _walked(self, pull: Pull, on_step: OnStep | None) -> Float[np.ndarray, "k 3"]:
        """The answer at the end of the handle's way."""
        way = _way(self.shell.energy.roi, pull)
        longest = min(1.0, self.stride * self._edge / way.length) if way.length > 0 else 1.0
        state, done, step, count = way.start, 0.0, longest, 0
        while done < 1:
            share = min(1.0, done + step)
            tried = self._moved(state, way.at(share))
            crossings = self._crossings(tried)
            if not len(crossings):
                state, done, step = tried, share, min(2 * step, longest)
            elif step <= longest / 2**HALVINGS:
                found = f"{len(crossings)} pairs of triangles that cross after {done:.0%} of it"
                raise SolveError("a way of the handle without crossings", found, "move it less, or with a shorter stride", crossings)
            else:
                step /= 2
            if on_step is not None:
                on_step(Step("guard", count, float(len(crossings)), step, not len(crossings), done))
            count += 1
        return self._settled(state, way.at(1.0))

    def _settled(self, state: Float[np.ndarray, "k 3"], targets: Float[np.ndarray, "h 3"]) -> Float[np.ndarray, "k 3"]:
        """Go on at the targets, as long as nothing crosses."""
        for _ in range(ROUNDS):
            tried = self._moved(state, targets)
            if len(self._crossings(tried)):
                return state
            length, state = float(np.abs(tried - state).max(initial=0.0)), tried
            if length <= self.shell.options.tolerance * np.sqrt(self.shell.energy.roi.mesh.area):
                return state
        return state

    def _moved(self, state: Float[np.ndarray, "k 3"], targets: Float[np.ndarray, "h 3"]) -> Float[np.ndarray, "k 3"]:
        """The handle put to the targets, the rest following with the contacts of the state held apart."""
        energy, shell = self.shell.energy, self.shell
        roi, patch = energy.roi, energy.patch
        unknown, moving = patch.vertices[patch.unknown], np.searchsorted(patch.vertices, roi.moving)
        whole = np.array(roi.mesh.vertices)
        whole[roi.moving] = state
        way = float(np.linalg.norm(targets - whole[roi.handle], axis=1).max())
        contacts = self._contacts(whole, way)
        pushes = _Pushes(contacts, shell.factor)
        whole[roi.handle[np.isinf(hold(roi))]] = targets[np.isinf(hold(roi))]
        positions = energy.begin(targets)
        for _ in range(SWEEPS):
            positions[moving] = whole[roi.moving]
            force = energy.residual(positions, energy.fitted(positions, targets)[0], targets)
            before, room, step = whole[unknown], shell.room(positions), shell.factor.solve(force)
            whole[unknown] = before + room.kept(step)
            whole[unknown] = before + room.kept(step + pushes.opening(whole))
        return whole[roi.moving]

    def _contacts(self, whole: Float[np.ndarray, "n 3"], way: float) -> Contacts:
        """For each moving vertex the nearest one that was far away at rest and faces it."""
        mesh = self.shell.energy.roi.mesh
        unknown, clearance = self.shell.energy.patch.vertices[self.shell.energy.patch.unknown], CLEARANCE * self._edge
        near = cKDTree(whole[unknown]).sparse_distance_matrix(
            cKDTree(whole), clearance + max(REACH * way, self._edge), output_type="coo_matrix"
        )
        first, second = unknown[near.row], near.col.astype(np.int64)
        normals = mesh.with_vertices(whole).vertex_normals
        rest = np.linalg.norm(mesh.vertices[first] - mesh.vertices[second], axis=1)
        facing = np.einsum("cd,cd->c", normals[first], normals[second]) < 0
        kept = np.nonzero((near.data < APPROACH * rest) & facing)[0]
        kept = kept[np.lexsort((near.data[kept], first[kept]))]
        kept = kept[np.unique(first[kept], return_index=True)[1]]
        ends = np.stack([first[kept], second[kept]], axis=1)
        across = normals[ends[:, 1]] - normals[ends[:, 0]]
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        side = np.einsum("cd,cd->c", across, whole[ends[:, 0]] - whole[ends[:, 1]])
        return Contacts(ends, _differences(ends, unknown), np.where(side >= 0, 1.0, -1.0)[:, None] * across, clearance)

    def _crossings(self, state: Float[np.ndarray, "k 3"]) -> Int[np.ndarray, "x 2"]:
        """Pairs of faces that cross, and did not at rest."""
        roi = self.shell.energy.roi
        whole = np.array(roi.mesh.vertices)
        whole[roi.moving] = state
        pairs, m = self_intersections(roi.mesh.with_vertices(whole), self.faces), roi.mesh.n_faces
        return pairs[~np.isin(pairs @ [m, 1], self.before @ [m, 1])]


def _differences(ends: Int[np.ndarray, "c 2"], unknown: Int[np.ndarray, "u"]) -> sp.csr_matrix:
    """The matrix (c, u) of first end minus second end, for those that are unknown."""
    place = np.minimum(np.searchsorted(unknown, ends), len(unknown) - 1)
    sign = np.where(unknown[place] == ends, np.array([1.0, -1.0]), 0.0)
    return sp.csr_matrix((sign.ravel(), (np.repeat(np.arange(len(ends)), 2), place.ravel())), (len(ends), len(unknown)))


@dataclass(frozen=True, eq=False)
class _Way:
    """How the handle goes to its targets: each part turns and moves evenly, and takes on its new shape meanwhile."""

    start: Float[np.ndarray, "k 3"]
    centre: Float[np.ndarray, "h 3"]
    arm: Float[np.ndarray, "h 3"]
    shift: Float[np.ndarray, "h 3"]
    change: Float[np.ndarray, "h 3"]
    turn: Float[np.ndarray, "h 3"]
    targets: Float[np.ndarray, "h 3"]

    @property
    def length(self) -> float:
        """At least as long as the way of the farthest handle vertex."""
        turning = np.linalg.norm(self.turn, axis=1) * np.linalg.norm(self.arm, axis=1)
        return float((np.linalg.norm(self.shift, axis=1) + turning + np.linalg.norm(self.change, axis=1)).max())

    def at(self, share: float) -> Float[np.ndarray, "h 3"]:
        """Positions of the handle at a share of the way."""
        if share == 1:
            return self.targets
        turned = np.einsum("hij,hj->hi", exponential(share * self.turn), self.arm + share * self.change)
        return self.centre + share * self.shift + turned


def _way(roi: Roi, pull: Pull) -> _Way:
    """From rest with the turns of the pull, or straight from the start of the pull."""
    targets, turns = checked(roi, pull)
    if pull.start is None:
        start, turn = np.array(roi.mesh.vertices[roi.moving]), turns[roi.handle_parts]
    else:
        start, turn = _arrays.real(pull.start, "start", (len(roi.moving), 3)), np.zeros_like(targets)
    before = start[np.searchsorted(roi.moving, roi.handle)]
    parts = roi.handle_parts
    total = sp.csr_matrix((np.ones(len(parts)), (parts, np.arange(len(parts)))))
    mean = sp.diags(1 / np.bincount(parts)) @ total
    centre, goal = (mean @ before)[parts], (mean @ targets)[parts]
    back = np.einsum("hij,hj->hi", exponential(-turn), targets - goal)
    return _Way(start, centre, before - centre, goal - centre, back - (before - centre), turn, targets)
