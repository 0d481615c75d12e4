"""An edit in the studio: what is painted, what follows, how, and where the handle went; its region, its pull, its answer.

Edits are values: undo goes back to an older one, a session file lists them, a script makes them again.
"""

from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8
from scipy.spatial import cKDTree

from morphlet.editing.editor import RoiEditor
from morphlet.editing.estimated import handle_turns
from morphlet.editing.method import Pull
from morphlet.editing.roi import Metric, Roi
from morphlet.errors import InputError
from morphlet.studio.methods import Choice
from morphlet.studio.motion import STEP, Mirror, Motion
from morphlet.surface.mesh import Mesh

SHARE = 0.2
"""Of the bounding-box diagonal: the radius of a new edit."""
MIRROR_REACH = 0.02
"""Share of the bounding-box diagonal: a vertex farther from a mirror image is not its partner."""


class Paint(IntEnum):
    """What a person painted on a vertex."""

    NONE = 0
    FREE = 1
    HANDLE = 2
    ANCHOR = 3


ROLES = {"free": Paint.FREE, "handle": Paint.HANDLE, "anchor": Paint.ANCHOR}
DEFAULT, STILL = Choice(), Motion()
FREE, HANDLE = 1, 2
"""Roles in a frame, beside 0 for anchors."""
PAINTED, MIRRORED = 4, 8
"""Added to a role."""


@dataclass(frozen=True, eq=False)
class Edit:
    """One edit of a welded mesh.

    Parameters
    ----------
    rest
        Positions before it.
    paint
        `Paint` of each vertex.
    radius
        Of what follows, in mesh units; None for no limit.
    metric
        How the radius is measured.
    choice
        How it follows.
    mirror
        The plane that the handle is mirrored at, if any.
    motion
        Where the handle went.
    positions
        Positions after it.
    """

    rest: Float[np.ndarray, "n 3"]
    paint: UInt8[np.ndarray, "n"]
    radius: float | None
    metric: Metric = "geodesic"
    choice: Choice = DEFAULT
    mirror: Mirror | None = None
    motion: Motion = STILL
    positions: Float[np.ndarray, "n 3"] | None = None

    @staticmethod
    def fresh(rest: Float[np.ndarray, "n 3"]) -> "Edit":
        """Nothing painted yet."""
        diagonal = float(np.linalg.norm(np.ptp(rest, axis=0))) if len(rest) else 0.0
        return Edit(rest, np.zeros(len(rest), np.uint8), SHARE * diagonal or None)

    @property
    def shape(self) -> Float[np.ndarray, "n 3"]:
        """Positions now."""
        return self.rest if self.positions is None else self.positions

    def painted(self, role: str, mode: str, vertices: Int[np.ndarray, "k"]) -> "Edit":
        """With other paint; after a motion, on a new rest."""
        own, paint = ROLES[role], np.array(self.paint)
        if mode == "set":
            paint[paint == own] = Paint.NONE
        chosen = vertices[paint[vertices] == own] if mode == "erase" else vertices
        paint[chosen] = Paint.NONE if mode == "erase" else own
        return replace(self.following() if own == Paint.HANDLE else self, paint=paint)

    def following(self) -> "Edit":
        """The next edit: the same paint and method on the present shape; itself if nothing moved."""
        return self if self.positions is None else replace(self, rest=self.positions, motion=Motion(), positions=None)

    @property
    def own(self) -> Int[np.ndarray, "h"]:
        """Vertices painted as handle."""
        return np.flatnonzero(self.paint == Paint.HANDLE)

    @property
    def center(self) -> Float[np.ndarray, "3"]:
        """Middle of the painted handle at rest: what it is turned and scaled about."""
        return self.rest[self.own].mean(axis=0)

    def images(self) -> Int[np.ndarray, "i"]:
        """Vertices at the mirror images of the painted handle, without those that are painted as anchors."""
        if self.mirror is None or not len(self.own):
            return np.zeros(0, np.int64)
        reach = MIRROR_REACH * float(np.linalg.norm(np.ptp(self.rest, axis=0)))
        apart, place = cKDTree(self.rest).query(self.mirror(self.rest[self.own]), distance_upper_bound=reach)
        found = np.unique(np.asarray(place)[np.isfinite(apart)])
        return found[self.paint[found] != Paint.ANCHOR]

    def region(self, mesh: Mesh) -> Roi:
        """What pulls, what follows, what stays, on the mesh at this edit's rest.

        Raises
        ------
        InputError
            If there is no handle, or nothing follows it.
        """
        handle = np.union1d(self.own, self.images())
        if not len(handle):
            raise InputError("a handle", "none", "paint the vertices to pull")
        roi = self._reached(mesh, handle)
        return roi if self.choice.weight is None else roi.softened(self.choice.weight)

    @property
    def plain(self) -> bool:
        """Whether the radius alone says what follows."""
        return self.radius is not None and not np.isin(self.paint, (Paint.FREE, Paint.ANCHOR)).any()

    def _reached(self, mesh: Mesh, handle: Int[np.ndarray, "h"]) -> Roi:
        """Within the radius, or what is painted in addition and not painted to stay, as far as the handle reaches."""
        if self.plain and self.radius is not None:
            return Roi.within(mesh, handle, self.radius, self.metric)
        free = np.ones(len(self.paint), bool)
        if self.radius is not None:
            free = self._within(mesh, handle, self.radius)
        free[self.paint == Paint.FREE] = True
        free[self.paint == Paint.ANCHOR] = False
        free[handle] = True
        roi = Roi.between(mesh, handle, np.flatnonzero(~free))
        if not len(roi.free):
            raise InputError("vertices that follow the handle", "none", "enlarge the radius, or paint free vertices next to the handle")
        return roi

    def _within(self, mesh: Mesh, handle: Int[np.ndarray, "h"], radius: float) -> Bool[np.ndarray, "n"]:
        """What the radius reaches; nothing if it reaches nothing, since free vertices are painted, too."""
        inside = np.zeros(len(self.paint), bool)
        try:
            inside[Roi.within(mesh, handle, radius, self.metric).free] = True
        except InputError:
            return inside
        return inside

    def targets(self, roi: Roi, share: float = 1.0) -> Float[np.ndarray, "h 3"]:
        """Where the handle is on this share of its way; what is handle on both sides goes half with each."""
        rest, center = self.rest[roi.handle], self.center
        moved = self.motion(rest, center, share)
        if self.mirror is None:
            return moved
        there = self.mirror(self.motion(self.mirror(rest), center, share))
        by_hand = np.isin(roi.handle, self.own)[:, None]
        by_mirror = np.isin(roi.handle, self.images())[:, None]
        return np.where(by_hand & by_mirror, (moved + there) / 2, np.where(by_hand, moved, there))

    @property
    def told_by_motion(self) -> bool:
        """Whether the motion itself tells where the handle goes: one side, and no stretch."""
        return self.mirror is None and self.motion.even

    @property
    def places(self) -> int:
        """Of how many places of the handle a way consists that tells its turns."""
        return max(int(np.ceil(self.motion.angle / STEP - 1e-9)), 1)

    def pull(self, roi: Roi) -> Pull:
        """Where the handle goes, and how it turned on its way."""
        targets = self.targets(roi)
        if self.told_by_motion:
            return Pull(targets, np.tile(self.motion.turn, (int(roi.handle_parts.max()) + 1, 1)))
        turns = None
        for place in range(1, self.places + 1):
            turns = handle_turns(roi, self.targets(roi, place / self.places), turns)
        return Pull(targets, turns)

    def solved(self, mesh: Mesh, editor: RoiEditor | None = None) -> "Edit":
        """With the positions that it leads to; `mesh` is any mesh of this topology."""
        if self.motion.still:
            return replace(self, positions=None)
        at_rest = mesh.with_vertices(self.rest) if editor is None else editor.roi.mesh
        ready = RoiEditor.prepare(self.region(at_rest), self.choice.method()) if editor is None else editor
        positions = np.array(self.rest)
        positions[ready.roi.moving] = ready.positions(self.pull(ready.roi))
        return replace(self, positions=positions)

    def roles(self, roi: Roi | None) -> UInt8[np.ndarray, "n"]:
        """Role, paint and mirror of each vertex for a frame."""
        out = np.zeros(len(self.paint), np.uint8)
        if roi is not None:
            out[roi.free], out[roi.handle] = FREE, HANDLE
        else:
            out[self.paint == Paint.FREE], out[self.own] = FREE, HANDLE
        out[self.paint != Paint.NONE] += PAINTED
        images = self.images()
        out[images[self.paint[images] != Paint.HANDLE]] += MIRRORED
        return out
