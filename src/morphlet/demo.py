"""The main job on meshes the package makes itself: a grazer, a predator, and the markers between them."""

from pathlib import Path

import numpy as np

from morphlet.io.formats import write
from morphlet.io.pairs import write_pairs
from morphlet.pipeline.results import CorrespondResult
from morphlet.samples.anatomy import SPECIES
from morphlet.samples.creatures import Creature, landmarks, sample
from morphlet.surface.pairs import VertexPairs

SOURCE, TARGET = "grazer", "predator"


def write_inputs(folder: Path, n_vertices: int) -> tuple[Path, Path, Path]:
    """Both creatures as OBJ files and their common landmarks as a pairs file."""
    meshes, markers = [folder / f"{name}.obj" for name in (SOURCE, TARGET)], folder / f"{SOURCE}-{TARGET}.csv"
    for name, path in zip((SOURCE, TARGET), meshes, strict=True):
        write(path, sample(name, n_vertices=n_vertices))
    source, target = landmarks(SOURCE, n_vertices), landmarks(TARGET, n_vertices)
    labels = tuple(label for label in source if label in target)
    ends = [np.array([place[label] for label in labels]) for place in (source, target)]
    write_pairs(markers, VertexPairs(ends[0], ends[1], labels=labels))
    return meshes[0], meshes[1], markers


def true_error(matched: CorrespondResult) -> float:
    """How far the images of the source's vertices are from their true places, on average: 100 x distance / sqrt(area of the target).

    The truth is known: the source's own mesh, grown into the target's proportions by its skeleton.
    """
    found = matched.correspondence
    truth = Creature.prepare(SOURCE, found.source.n_vertices).posed(proportions=SPECIES[TARGET])
    distance = np.linalg.norm(found.positions - truth.vertices, axis=1)
    return float(100 * distance.mean() / np.sqrt(found.target.area))
