"""The build of a four-legged animal: its proportions, its skeleton at rest, and the solid around it.

The animal stands on y = 0 and looks along +z; +y is up and +x its left. Its hips are above z = 0. Lengths are in units
in which a grazer's trunk is about 1 long; angles are in radians.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from morphlet.samples.implicit import Solid, part

Vector = Float[np.ndarray, "3"]

SIDES = (("left", 1.0), ("right", -1.0))
"""Name of each side and the sign of x there."""

FRONT = ("upper", "lower", "cannon", "foot")
"""Bones of a front leg, downwards: shoulder to elbow, to wrist, to fetlock, to toe."""

HIND = ("thigh", "shin", "cannon", "foot")
"""Bones of a hind leg, downwards: hip to knee, to hock, to fetlock, to toe."""

PARENTS = {
    "pelvis": "", "loin": "pelvis", "chest": "loin", "neck 1": "chest", "neck 2": "neck 1", "head": "neck 2",
    "left ear": "head", "right ear": "head", "tail 1": "pelvis", "tail 2": "tail 1", "tail 3": "tail 2", "tail 4": "tail 3",
    **{f"{s} front {b}": f"{s} front {a}" if a else "chest" for s, _ in SIDES for a, b in zip(("", *FRONT), FRONT, strict=False)},
    **{f"{s} hind {b}": f"{s} hind {a}" if a else "pelvis" for s, _ in SIDES for a, b in zip(("", *HIND), HIND, strict=False)},
}  # fmt: skip
"""Parent of each bone; parents come before children."""

BONES = tuple(PARENTS)
"""Names of the bones, in the order of every array of bones."""

TAIL_CURVE = (0.1, -0.12, -0.12, 0.14)
"""How far each tail bone leans from the tail's own rise, in radians: a gentle S."""


ROUND, FLAT_THIGH, FLAT_FOOT = (0.0, 0.0, 0.0), (0.5, 0.0, 0.0), (0.0, 0.5, 0.0)
"""Flattening vectors of limbs: shoulders and thighs are thinner sideways, feet from above."""

EAR_FLATNESS = 0.8
"""Length of the flattening vector of the ears: 1 + 0.8^2 times thinner than wide."""


@dataclass(frozen=True)
class Proportions:
    """Measures of a four-legged animal at rest.

    Parameters
    ----------
    trunk, leg, neck, head, tail, ear, foot
        Lengths of the trunk (hip to shoulder), of the legs (ground to hip), and so on.
    girth, limb, brush
        Radii of the chest, of the thin part of the legs, of the thick part of the tail.
    skull, muzzle
        Radii of the skull and of the muzzle, as shares of the head's length.
    ear_width
        Half width of the ears.
    neck_rise, head_drop, tail_rise
        Angles of the neck above, of the head below and of the tail above the horizontal.
    """

    trunk: float = 1.0
    leg: float = 0.98
    neck: float = 0.66
    head: float = 0.4
    tail: float = 0.28
    ear: float = 0.17
    foot: float = 0.09
    girth: float = 0.225
    limb: float = 0.042
    brush: float = 0.055
    skull: float = 0.26
    muzzle: float = 0.17
    ear_width: float = 0.042
    neck_rise: float = 0.95
    head_drop: float = 0.62
    tail_rise: float = -1.0


SPECIES = {
    "grazer": Proportions(),
    "predator": Proportions(
        trunk=1.02, leg=0.6, neck=0.32, head=0.37, tail=0.9, ear=0.2, foot=0.11, girth=0.185, limb=0.046, brush=0.092, skull=0.37,
        muzzle=0.16, ear_width=0.075, neck_rise=0.6, head_drop=0.25, tail_rise=-0.12,
    ),
}  # fmt: skip
"""Two animals far apart: long legs and neck with a stub of a tail; low, long and big-headed with a brush."""


@dataclass(frozen=True, eq=False)
class Skeleton:
    """Where each bone starts, where it ends and how thick the flesh around it is, in the order of `BONES`."""

    starts: Float[np.ndarray, "b 3"]
    ends: Float[np.ndarray, "b 3"]
    radii: Float[np.ndarray, "b"]


def skeleton(p: Proportions) -> Skeleton:
    """The bones at rest."""
    bones = _trunk(p) | _head(p) | _tail(p) | _front_legs(p) | _hind_legs(p)
    rows = [bones[name] for name in BONES]
    return Skeleton(np.array([r[0] for r in rows]), np.array([r[1] for r in rows]), np.array([r[2] for r in rows]))


def solid(p: Proportions) -> tuple[Solid, tuple[str, ...]]:
    """The body around the bones, and the bone each part belongs to."""
    rows = [*_trunk_parts(p), *_head_parts(p), *_leg_parts(p), *_tail_parts(p)]
    return Solid(np.array([row for _, row in rows])), tuple(name for name, _ in rows)


Bone = tuple[Vector, Vector, float]
Row = tuple[str, Float[np.ndarray, "12"]]


def _at(x: float, y: float, z: float) -> Vector:
    return np.array([x, y, z], dtype=np.float64)


def _along(angle: float) -> Vector:
    """Unit vector in the plane of symmetry, this angle above straight ahead."""
    return _at(0, np.sin(angle), np.cos(angle))


def _trunk(p: Proportions) -> dict[str, Bone]:
    h, g, t = p.leg, p.girth, p.trunk
    croup, loin, back, chest = _at(0, h + 0.2 * g, -0.05 * t), _at(0, h + 0.22 * g, 0.3 * t), _at(0, h + 0.1 * g, 0.62 * t), _at(0, h, t)
    return {"pelvis": (croup, loin, g), "loin": (loin, back, g), "chest": (back, chest, g)}


def _head(p: Proportions) -> dict[str, Bone]:
    base = _at(0, p.leg + 0.35 * p.girth, 0.98 * p.trunk)
    middle = base + 0.5 * p.neck * _along(p.neck_rise - 0.12)
    poll = middle + 0.5 * p.neck * _along(p.neck_rise + 0.12)
    nose = poll + p.head * _along(-p.head_drop)
    bones: dict[str, Bone] = {
        "neck 1": (base, middle, 0.5 * p.girth), "neck 2": (middle, poll, 0.4 * p.girth), "head": (poll, nose, p.skull * p.head),
    }  # fmt: skip
    for side, sign in SIDES:
        start = poll + p.skull * p.head * (0.6 * _along(np.pi / 2 - p.head_drop) + _at(0.6 * sign, 0, 0))
        lean = _at(0.55 * sign, 0, 0) + _along(np.pi / 2 + 0.25 - 0.4 * p.head_drop)
        bones[f"{side} ear"] = (start, start + p.ear * lean / np.linalg.norm(lean), p.ear_width)
    return bones


def _tail(p: Proportions) -> dict[str, Bone]:
    start = _at(0, p.leg + 0.62 * p.girth, -0.05 * p.trunk - 0.62 * p.girth)
    bones: dict[str, Bone] = {}
    for number, bend in enumerate(TAIL_CURVE, 1):
        end = start + 0.25 * p.tail * _along(np.pi - p.tail_rise - bend)
        bones[f"tail {number}"] = (start, end, p.brush)
        start = end
    return bones


def _front_legs(p: Proportions) -> dict[str, Bone]:
    h, g, z = p.leg, p.girth, 0.9 * p.trunk
    heights = (0.98 * h, 0.64 * h, 0.36 * h, 0.1 * h + 0.3 * p.limb, 0.9 * p.limb)
    forward = (z + 0.1 * g, z - 0.06 * h, z + 0.0 * h, z - 0.01 * h, z - 0.01 * h + p.foot)
    wide = (0.5 * g, 0.56 * g, 0.52 * g, 0.52 * g, 0.54 * g)
    return _legs("front", FRONT, np.array([wide, heights, forward]).T, (0.35 * g, 1.6 * p.limb, 1.1 * p.limb, 1.3 * p.limb))


def _hind_legs(p: Proportions) -> dict[str, Bone]:
    h, g = p.leg, p.girth
    heights = (0.98 * h, 0.63 * h, 0.37 * h, 0.1 * h + 0.3 * p.limb, 0.9 * p.limb)
    forward = (0.0, 0.13 * h, -0.13 * h, -0.06 * h, -0.06 * h + p.foot)
    wide = (0.46 * g, 0.58 * g, 0.5 * g, 0.5 * g, 0.52 * g)
    return _legs("hind", HIND, np.array([wide, heights, forward]).T, (0.4 * g, 1.7 * p.limb, 1.1 * p.limb, 1.3 * p.limb))


def _legs(pair: str, names: tuple[str, ...], joints: Float[np.ndarray, "5 3"], radii: tuple[float, ...]) -> dict[str, Bone]:
    """Both legs of a pair from the joints of the left one."""
    return {
        f"{side} {pair} {name}": (joints[k] * (sign, 1, 1), joints[k + 1] * (sign, 1, 1), radii[k])
        for side, sign in SIDES
        for k, name in enumerate(names)
    }


def _trunk_parts(p: Proportions) -> list[Row]:
    """Croup, belly and rib cage, higher than wide; the withers; a neck that starts deep in the chest."""
    h, g, t = p.leg, p.girth, p.trunk
    croup, belly = _at(0, h + 0.12 * g, 0.02 * t), _at(0, h + 0.17 * g, 0.36 * t)
    ribs, breast = _at(0, h - 0.06 * g, 0.74 * t), _at(0, h, 0.95 * t)
    bones = _head(p)
    base, middle, poll = bones["neck 1"][0], bones["neck 1"][1], bones["neck 2"][1]
    narrow, end = (0.45, 0.0, 0.0), max(0.4 * g, 0.8 * p.skull * p.head)
    throat, blend = base - _at(0, 0.45 * g, 0.12 * t), 0.12 * g
    return [
        ("pelvis", part(croup, belly, (0.84 * g, 0.8 * g), blend, narrow)),
        ("loin", part(belly, ribs, (0.8 * g, 1.02 * g), blend, narrow)),
        ("chest", part(ribs, breast, (1.02 * g, 0.82 * g), blend, narrow)),
        ("chest", part(_at(0, h + 0.55 * g, 0.62 * t), _at(0, h + 0.62 * g, 0.92 * t), (0.25 * g, 0.36 * g), 0.5 * g)),
        ("neck 1", part(throat, middle, (0.62 * g, 0.5 * g), 0.45 * g, narrow)),
        ("neck 2", part(middle, poll, (0.5 * g, end), 0.15 * g, narrow)),
    ]


def _head_parts(p: Proportions) -> list[Row]:
    """Skull, forehead, muzzle and nose, then cheek, eye and ear of each side."""
    size, ball, snout = p.head, p.skull * p.head, p.muzzle * p.head
    poll, ahead, up = _head(p)["head"][0], _along(-p.head_drop), _along(np.pi / 2 - p.head_drop)
    skull, stop = poll + 0.3 * ball * ahead, poll + 1.5 * ball * ahead - 0.1 * ball * up
    nose = poll + (size - snout) * ahead - 0.55 * ball * up
    tip = nose + 0.45 * snout * (ahead + up)
    rows: list[Row] = [
        ("head", part(skull, stop, (ball, 0.72 * ball), 0.3 * ball)),
        ("head", part(stop - 0.25 * ball * up, nose, (0.72 * ball, snout), 0.3 * ball)),
        ("head", part(tip, tip + 0.15 * snout * ahead, (0.55 * snout, 0.55 * snout), 0.2 * snout)),
    ]
    for side, sign in SIDES:
        cheek, eye = skull + ball * (0.55 * ahead - 0.4 * up), stop + 0.3 * ball * up + _at(0.6 * ball * sign, 0, 0)
        cheek += _at(0.35 * ball * sign, 0, 0)
        rows.append(("head", part(cheek, cheek + 0.3 * ball * ahead, (0.68 * ball, 0.55 * ball), 0.3 * ball)))
        rows.append(("head", part(eye, eye + 0.1 * ball * ahead, (0.23 * ball,) * 2, 0.12 * ball)))
        rows.extend(_ear_parts(p, side, sign))
    return rows


def _ear_parts(p: Proportions, side: str, sign: float) -> list[Row]:
    """A leaf, flat from front to back, turned a little outwards."""
    start, end, width = _head(p)[f"{side} ear"]
    axis, middle = end - start, start + 0.35 * (end - start)
    across = np.cross(axis, np.cross(_at(0.45 * sign, 0, 1), axis))
    flat = tuple(EAR_FLATNESS * across / np.linalg.norm(across))
    return [
        (f"{side} ear", part(start, middle, (0.75 * width, width), 0.3 * p.skull * p.head, flat)),
        (f"{side} ear", part(middle, end, (width, 0.45 * width), 0.2 * width, flat)),
    ]


def _leg_parts(p: Proportions) -> list[Row]:
    """Muscle above, sinew below, knobs at the joints, and feet that are flat from above."""
    g, r = p.girth, p.limb
    front = ((0.42 * g, 0.22 * g + 0.4 * r), (0.22 * g + 0.5 * r, 1.2 * r), (1.15 * r, 1.0 * r), (1.12 * r, 1.05 * r))
    hind = ((0.55 * g, 0.3 * g + 0.4 * r), (0.28 * g + 0.5 * r, 1.2 * r), (1.2 * r, 1.0 * r), (1.12 * r, 1.05 * r))
    rows: list[Row] = []
    for bones, names, radii in ((_front_legs(p), FRONT, front), (_hind_legs(p), HIND, hind)):
        for bone, (start, end, _) in bones.items():
            k = names.index(bone.split()[-1])
            rows.append((bone, part(start, end, radii[k], (0.35 * g, 0.5 * r, 0.4 * r, 0.3 * r)[k], FLAT_THIGH if k == 0 else ROUND)))
            if k == len(names) - 1:
                rows.append((bone, part(end, end - _at(0, 0, 0.6 * p.foot), (1.2 * r, 1.2 * r), 0.4 * r, FLAT_FOOT)))
    return rows


def _tail_parts(p: Proportions) -> list[Row]:
    """Thin at the root, thick in the middle, pointed."""
    bones, b = _tail(p), p.brush
    radii = ((0.6 * b, 0.75 * b), (0.75 * b, 1.0 * b), (1.0 * b, 0.92 * b), (0.92 * b, 0.35 * b))
    first = bones["tail 1"]
    root = first[0] + _at(0, -0.15 * p.girth, 0.35 * p.girth)
    rows: list[Row] = [("tail 1", part(root, first[0], (0.9 * b, 0.6 * b), 0.25 * p.girth))]
    return rows + [(name, part(start, end, r, 0.25 * b)) for (name, (start, end, _)), r in zip(bones.items(), radii, strict=True)]
