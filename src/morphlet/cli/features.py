"""Verbs of feature regions: those of one mesh, and which of two belong together."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, MENDING, MaybeOutput, Mending, Output, Pairs
from morphlet.cli.pictures import draw_matching, draw_regions
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError

if TYPE_CHECKING:
    from morphlet.cli.steps import Ends
    from morphlet.features.matching import Matching
    from morphlet.features.regions import RegionOptions, Regions
    from morphlet.pipeline.candidates import Candidate
    from morphlet.surface.pairs import VertexPairs
    from morphlet.surface.repair import Repaired


def regions(
    mesh: Path,
    /,
    *,
    output: MaybeOutput = None,
    never: float | None = None,
    always: float | None = None,
    most: int | None = None,
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Find the feature regions of a mesh: its limbs, each grown from its tip.

    Lengths are told over the square root of the area of the closed surface, areas as shares of it.

    Parameters
    ----------
    mesh
        One piece of genus 0; holes are filled for the search only.
    output
        .npz file: labels (the region of each vertex, -1 outside), nodes and edges of their graph.
    never
        Persistence below which no peak is a tip; 0.025 if left out.
    always
        Persistence above which each peak is a tip; 0.16 if left out. In between the widest gap decides.
    most
        How many tips are kept, the most persistent ones; 10 if left out.
    """

    def work(run: Run) -> dict[str, Any]:
        if output is not None:
            run.file(output, ".npz")
        options = _region_options(never, always, most)
        surface = steps.closed(run, mesh, mending)
        found = _regions(run, surface, mesh, options)
        if output is not None:
            _save_regions(run.place(output), found, surface)
        draw_regions(run, found)
        return _limbs(found, surface) | {"repairs": steps.repairs(surface)}

    return execute("regions", [mesh], common, work)


def match(
    a: Path,
    b: Path,
    /,
    *,
    output: Output,
    pairs: Pairs = None,
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Pair the feature regions of A with those of B, and say how far that can be trusted.

    Pairs that are given stay, and decide about the tips near them.

    Parameters
    ----------
    a
        Source mesh.
    b
        Target mesh.
    output
        CSV file for correspond and morph: the given pairs, tips and details of paired regions, and the core.
    """

    def work(run: Run) -> dict[str, Any]:
        run.file(output, ".csv")
        with run.uncounted():
            from morphlet.io.pairs import write_pairs
            from morphlet.pipeline.candidates import trust

        ends = steps.closed(run, a, mending), steps.closed(run, b, mending)
        given = _once(steps.given(pairs, ends), ends, pairs)
        own = _regions(run, ends[0], a), _regions(run, ends[1], b)
        found, tried, told = _settled(run, own, given, ends, (a.name, b.name))
        margin, ambiguous = trust(found, tried)
        steps.warn(run, told, ambiguous)
        write_pairs(run.place(output), _outside(found, given, ends))
        draw_matching(run, own, found)
        sure = {"margin": margin, "ambiguous": ambiguous, "warnings": told}
        return _trust(found) | sure | {"repairs": {"source": steps.repairs(ends[0]), "target": steps.repairs(ends[1])}}

    return execute("match", steps.present(a, b, pairs), common, work)


def _region_options(never: float | None, always: float | None, most: int | None) -> "RegionOptions":
    """What is left out stays at its default."""
    from morphlet.features.regions import RegionOptions

    plain_rule = RegionOptions()
    least, sure = plain_rule.never if never is None else never, plain_rule.always if always is None else always
    return RegionOptions(least, sure, plain_rule.most if most is None else most)


def _regions(run: Run, surface: "Repaired", path: Path, options: "RegionOptions | None" = None) -> "Regions":
    """The feature regions of a closed surface; errors name the file."""
    with run.uncounted():
        from morphlet.features.regions import find_regions

    steps.warm(run)
    run.stage(f"regions of {path.name}")
    with steps.naming(path):
        return find_regions(surface.mesh, options)


def _limbs(found: "Regions", surface: "Repaired") -> dict[str, Any]:
    """What `regions` tells, in vertices of the file."""
    import numpy as np

    back, k = surface.source_vertices, len(found)
    counts = np.bincount(found.nodes[surface.vertex_map][surface.valid], minlength=k)[:k]
    rows = zip(back[found.tips], found.persistence, found.areas, counts, strict=True)
    return {
        "regions": [{"tip": tip, "persistence": stands, "area": area, "vertices": count} for tip, stands, area, count in rows],
        "core": back[found.core],
        "gap": found.gap,
        "core_node": found.core_node,
        "edges": found.edges,
        "details": back[found.landmarks[k:]],
        "persistence": found.peaks.persistence[: len(found.landmarks)],
    }


def _save_regions(path: Path, found: "Regions", surface: "Repaired") -> None:
    """A label per vertex of the file, and the graph of the regions."""
    import numpy as np

    from morphlet import _store

    nodes, back = found.nodes[surface.vertex_map], surface.source_vertices
    arrays = {
        "labels": np.where(nodes < len(found), nodes, -1), "nodes": nodes, "edges": found.edges, "tips": back[found.tips],
        "persistence": found.persistence, "areas": found.areas, "core": back[found.core],
        "valid": surface.valid, "fingerprint": np.array(surface.source.fingerprint),
    }  # fmt: skip
    _store.save(path, "regions", 1, arrays)


def _once(given: "VertexPairs | None", ends: "Ends", path: Path | None) -> "VertexPairs | None":
    """The pairs of a file, once it is certain that they name each place once."""
    import numpy as np

    if given is None:
        return None
    for name, surface, vertices in zip(("source", "target"), ends, (given.source, given.target), strict=True):
        _, place, counts = np.unique(surface.vertex_map[vertices], return_inverse=True, return_counts=True)
        again = vertices[counts[place] > 1]
        if len(again):
            found = f"{len(again)} pairs at {name} vertices, or joined ones, of others"
            raise InputError(f"pairs in {path} that name each place once", found, "keep one pair of each", again)
    return given


def _outside(found: "Matching", given: "VertexPairs | None", ends: "Ends") -> "VertexPairs":
    """What was matched as pairs of the files' vertices, those that were given as they were."""
    import numpy as np

    from morphlet.surface.pairs import VertexPairs

    pairs, kept = found.pairs, 0 if given is None else len(given)
    source, target = ends[0].source_vertices[pairs.source], ends[1].source_vertices[pairs.target]
    if given is not None:
        source, target = np.concatenate([given.source, source[kept:]]), np.concatenate([given.target, target[kept:]])
    labels = (*pairs.labels[:kept], *(label.replace(" ", "-") for label in pairs.labels[kept:]))
    return VertexPairs(source, target, pairs.weight, labels)


def _settled(
    run: Run, regions: "tuple[Regions, Regions]", given: "VertexPairs | None", ends: "Ends", names: tuple[str, str]
) -> "tuple[Matching, tuple[Candidate, ...], tuple[str, ...]]":
    """Regions matched, what was tried, what is doubtful; spheres are made only where several matchings are nearly as good."""
    with run.uncounted():
        from morphlet.features.matching import candidates
        from morphlet.pipeline.candidates import settled

    run.stage("matching")
    found = candidates(*regions, None if given is None else steps.inside(given, ends))
    if len(found) == 1:
        return found[0], (), found[0].warnings
    maps = [steps.mapped(run, end, name) for end, name in zip(ends, names, strict=True)]
    run.stage("coarse maps")
    return settled(maps[0], maps[1], found, run.on_step)


def _trust(found: "Matching") -> dict[str, Any]:
    """What `match` tells of a matching as such."""
    figures = {"pairs": len(found.pairs)} | {name: getattr(found, name) for name in ("cost", "runner_up", "reflected")}
    return figures | {"tips": found.n_tips, "regions": found.regions}
