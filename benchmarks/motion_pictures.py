"""The pictures of the how-tos on motion: a morph in three orders of time, and poses above what they became.

python benchmarks/motion_pictures.py [--out docs/pictures]
"""

import argparse
from pathlib import Path

from morphlet import (
    Anchor,
    CorrespondResult,
    Creature,
    Picture,
    Schedule,
    TransferSolver,
    VertexPairs,
    correspond,
    morph_along,
    pair_faces,
    register,
)
from morphlet.report.look import Look
from morphlet.report.rows import poses_picture, tiled
from morphlet.report.strip import frame_strip
from morphlet.samples.poses import POSES

FRAMES = 5
"""Of a strip."""
TILE = Look(size=(220, 180))
"""A frame."""
SHOWN = ("walking", "rearing", "leaping", "turning")
"""Poses that are given to another animal."""


def paired(source: Creature, target: Creature) -> VertexPairs:
    """Their landmarks."""
    labels = tuple(source.landmarks)
    return VertexPairs([source.landmarks[label] for label in labels], [target.landmarks[label] for label in labels], labels=labels)


def orders(matched: CorrespondResult, nose: int) -> Picture:
    """All at once, coarse first, swept over from the nose: one below the other."""
    morphs = (
        morph_along(matched, FRAMES),
        morph_along(matched, FRAMES, schedule=Schedule.coarse_first(6)),
        morph_along(matched, FRAMES, starts=[nose]),
    )
    return tiled([frame_strip(result.frames, FRAMES, TILE) for result in morphs], 1)


def poses(source: Creature, target: Creature, pairs: VertexPairs) -> Picture:
    """The source in some poses, the target in the same."""
    rest, other = source.posed(), target.posed()
    solver = TransferSolver.prepare(rest, other, pair_faces(register(rest, other, pairs), other), Anchor(up=[0, 1, 0]))
    given = [source.posed(POSES[name]) for name in SHOWN]
    return poses_picture([[rest, *given], [other, *(solver.solve(pose) for pose in given)]])


def main() -> None:
    """Draw both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parents[1] / "docs" / "pictures")
    out = parser.parse_args().out
    grazer, predator = Creature.prepare("grazer"), Creature.prepare("predator")
    pairs = paired(grazer, predator)
    poses(grazer, predator, pairs).save(out / "transfer-poses.png")
    orders(correspond(grazer.posed(), predator.posed(), pairs), grazer.landmarks["nose"]).save(out / "morph-orders.png")


if __name__ == "__main__":
    main()
