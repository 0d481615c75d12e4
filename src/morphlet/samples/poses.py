"""How a four-legged animal holds itself: the angles of its joints, and where they take its bones.

All angles are in radians, relative to the pose at rest; positive angles lift (neck, head, tail), swing forwards (legs)
or turn to the animal's left.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from morphlet.samples.anatomy import BONES, FRONT, HIND, PARENTS, Skeleton

Leg = tuple[float, float, float, float]
STRAIGHT: Leg = (0.0, 0.0, 0.0, 0.0)
"""Angles of a leg at rest, from shoulder or hip down to the foot."""


@dataclass(frozen=True)
class Pose:
    """Joint angles of a four-legged animal.

    Parameters
    ----------
    pitch
        Of the whole animal about its hips.
    spine
        Lift of the loin and of the chest.
    neck
        Lift of the lower neck, the upper neck and the head.
    turn
        Turn of the chest, the neck (both halves) and the head to the left.
    tail, sway
        Lift and turn of every tail bone.
    ears
        How far the ears lean forwards.
    front_left, front_right, hind_left, hind_right
        Forward swing of each bone of a leg, from above to below.

    Examples
    --------
    >>> from morphlet.samples.poses import POSES
    >>> sorted(POSES)
    ['grazing', 'leaping', 'rearing', 'standing', 'turning', 'walking']
    """

    pitch: float = 0.0
    spine: tuple[float, float] = (0.0, 0.0)
    neck: tuple[float, float, float] = (0.0, 0.0, 0.0)
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    tail: float = 0.0
    sway: float = 0.0
    ears: float = 0.0
    front_left: Leg = STRAIGHT
    front_right: Leg = STRAIGHT
    hind_left: Leg = STRAIGHT
    hind_right: Leg = STRAIGHT


STANDING = Pose()
"""The pose at rest."""

POSES = {
    "standing": STANDING,
    "walking": Pose(
        neck=(-0.12, -0.05, 0.05), tail=0.1, sway=0.12, front_left=(0.45, -0.1, -0.15, 0.1), front_right=(-0.25, -0.2, -0.4, -0.2),
        hind_left=(-0.35, 0.05, 0.0, -0.35), hind_right=(0.45, -0.3, 0.1, 0.0),
    ),
    "grazing": Pose(
        pitch=-0.06, spine=(-0.05, -0.12), neck=(-0.85, -0.7, 0.6), tail=-0.1, front_left=(0.5, -0.05, 0.0, 0.0),
        front_right=(-0.05, -0.05, 0.0, 0.0), hind_left=(-0.1, 0.15, 0.0, 0.0), hind_right=(0.1, 0.0, 0.0, 0.0),
    ),
    "rearing": Pose(
        pitch=0.75, spine=(0.1, 0.1), neck=(0.05, -0.2, -0.35), tail=0.1, ears=-0.2, front_left=(0.35, -1.0, -0.6, -0.3),
        front_right=(0.0, -0.85, -0.75, -0.3), hind_left=(-0.55, -0.35, 0.1, 0.1), hind_right=(-0.75, -0.25, 0.2, 0.05),
    ),
    "leaping": Pose(
        pitch=0.28, spine=(0.08, 0.06), neck=(-0.3, -0.15, 0.1), tail=0.1, ears=-0.35, front_left=(0.9, 0.15, -0.15, 0.1),
        front_right=(0.65, 0.1, -0.45, -0.1), hind_left=(-0.6, -0.3, -0.3, -0.7), hind_right=(-0.75, -0.3, -0.35, -0.8),
    ),
    "turning": Pose(
        spine=(0.0, 0.05), neck=(0.05, 0.0, 0.0), turn=(0.15, 0.35, 0.35), tail=0.12, sway=-0.25, ears=0.15,
        front_left=(0.15, -0.05, 0.0, 0.0), hind_right=(-0.2, 0.0, 0.0, 0.0),
    ),
}  # fmt: skip
"""Poses by name."""


def posed(bones: Skeleton, pose: Pose) -> tuple[Rotation, Float[np.ndarray, "b 3"]]:
    """Rotation of each bone, and the shift that goes with it: bone b takes x to R_b x + t_b."""
    own = _rotations(pose)
    turned: list[Rotation] = []
    starts = np.array(bones.starts)
    for b, name in enumerate(BONES):
        if not PARENTS[name]:
            turned.append(own[b])
            continue
        a = BONES.index(PARENTS[name])
        turned.append(turned[a] * own[b])
        starts[b] = starts[a] + turned[a].apply(bones.starts[b] - bones.starts[a])
    together = Rotation.concatenate(turned)
    return together, starts - together.apply(bones.starts)


def _rotations(pose: Pose) -> Rotation:
    """Each bone's turn against its parent."""
    lift = dict.fromkeys(BONES, 0.0) | {"pelvis": pose.pitch}
    lift |= dict(zip(("loin", "chest", "neck 1", "neck 2", "head"), (*pose.spine, *pose.neck), strict=True))
    lift |= {name: -pose.tail for name in BONES if name.startswith("tail")}
    lift |= {name: -pose.ears for name in BONES if name.endswith("ear")}
    for pair, names in (("front", FRONT), ("hind", HIND)):
        for side in ("left", "right"):
            lift |= {f"{side} {pair} {n}": a for n, a in zip(names, getattr(pose, f"{pair}_{side}"), strict=True)}
    turn = dict.fromkeys(BONES, 0.0) | dict(zip(("chest", "neck 1", "head"), pose.turn, strict=True)) | {"neck 2": pose.turn[1]}
    turn |= {name: pose.sway for name in BONES if name.startswith("tail")}
    return Rotation.from_euler("YX", [[turn[name], -lift[name]] for name in BONES])
