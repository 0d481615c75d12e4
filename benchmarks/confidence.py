"""Does the confidence of a map tell where it is wrong? Rank correlations with the true error, and errors by fifths of the confidence.

    python benchmarks/confidence.py [--data DIR] [--pairs 'horse-05,tosca-*'] [--landmarks 6] [--back]
                                    [--json FILE] [--markdown]

Pairs, truth and errors (percent of sqrt(area)) are those of `correspondence.py`, at twice as many vertices. Beside the strain, of which
the confidence is made: the distance from a vertex to where the map and its inverse bring it, its distance to the nearest landmark, and
with `--back` the distance on the target between the map and one that was made from target to source.
"""

import argparse
import os
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.stats import spearmanr

from book import Sheet, Table, add_options
from correspondence import SAMPLES, catalogue, chosen_names
from morphlet import SurfacePoints, VertexPairs, correspond_maps, spherical_map
from morphlet.mapping.correspondence import strain
from morphlet.samples.deviation import Deviation
from morphlet.samples.truth import KnownPair
from morphlet.surface.distance import distances

PAIRS = "grazer-walking,grazer-leaping,predator-walking,predator-leaping,grazer-predator,tosca-wolf1,horse-05,cat-01"
FIFTHS = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)


def judged(pair: KnownPair, count: int, back: bool) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Errors at some vertices, and what might tell them."""
    marks, (source, target) = pair.first_landmarks(count), (spherical_map(mesh) for mesh in (pair.source, pair.target))
    found = correspond_maps(source, target, marks)
    rows = pair.drawn(2 * SAMPLES, pair.landmarks)
    own = pair.vertices[rows]
    ruler = Deviation.prepare(pair.target, SurfacePoints(pair.truth.faces[rows], pair.truth.weights[rows]))
    points, map_ = found.correspondence.points, found.correspondence
    told = {
        "strain": strain(map_),
        "round trip": np.linalg.norm(map_.pull(found.inverse.positions) - pair.source.vertices, axis=1) / np.sqrt(pair.source.area),
        "landmark": distances(pair.source, marks.source).min(axis=0) / np.sqrt(pair.source.area),
    }
    if back:
        other = correspond_maps(target, source, VertexPairs(marks.target, marks.source)).inverse
        told["other map"] = np.linalg.norm(other.positions - map_.positions, axis=1) / np.sqrt(pair.target.area)
    errors = ruler.of(SurfacePoints(points.faces[own], points.weights[own]))
    return 100 * errors / np.sqrt(pair.target.area), {name: values[own] for name, values in told.items()}


def fifths(values: np.ndarray, errors: np.ndarray) -> list[float]:
    """Mean error in each fifth of the values."""
    limits = np.quantile(values, FIFTHS)
    return [float(errors[(low <= values) & (values <= high)].mean()) for low, high in pairwise(limits)]


def line(name: str, errors: np.ndarray, told: dict[str, np.ndarray]) -> list[str]:
    """A line of the table."""
    ranks = [f"{spearmanr(values, errors)[0]:.2f}" for values in told.values()]
    return [name, f"{errors.mean():.2f}", *ranks, " ".join(f"{mean:.2f}" for mean in fifths(told["strain"], errors))]


def main() -> None:
    """Run what is wanted."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    parser.add_argument("--pairs", default=PAIRS)
    parser.add_argument("--landmarks", type=int, default=6)
    parser.add_argument("--back", action="store_true")
    add_options(parser)
    chosen = parser.parse_args()
    pairs = catalogue(None if chosen.data is None else Path(chosen.data))
    lines, all_errors, all_told = [], [], []
    for name in chosen_names(chosen.pairs, list(pairs)):
        errors, told = judged(pairs[name](), chosen.landmarks, chosen.back)
        lines.append(line(name, errors, told))
        sys.stderr.write("  ".join(lines[-1]) + "\n")
        all_errors.append(errors)
        all_told.append(told)
    within = [f"{np.mean([spearmanr(told[key], e)[0] for told, e in zip(all_told, all_errors, strict=True)]):.2f}" for key in all_told[0]]
    together = {key: np.concatenate([told[key] for told in all_told]) for key in all_told[0]}
    lines.append(["mean of the pairs", "", *within, ""])
    lines.append(line("all vertices", np.concatenate(all_errors), together))
    heads = ["pair", "error", *(f"rank corr. {key}" for key in all_told[0]), "error by fifths of the strain"]
    Sheet.of(chosen).add(Table("Confidence against error", heads, lines, "Errors in percent of sqrt(area)."))


if __name__ == "__main__":
    main()
