"""Verbs of wavelet networks: a mesh as networks, and the mesh that comes back."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, MENDING, MESHES, Layout, Mending, Output, length
from morphlet.cli.pictures import draw_beside, draw_mesh
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError, SolveError

if TYPE_CHECKING:
    from morphlet.sphere.map import SphericalMap
    from morphlet.wavenet.mothers import Mother

    Approximator = Callable[[SphericalMap, bool], tuple[Any, dict[str, Any]]]


@Parameter(name="*")
@dataclass(frozen=True)
class Choices:
    """How a mesh is approximated."""

    wavelets: int | None = None
    """Most of each block: 15 if left out, or with an error as many as it takes (up to 128). Over the sphere, of the whole: 500."""
    error: str | None = None
    """What every block has to meet, rms: a distance in mesh units, or like 0.1% of the bounding-box diagonal."""
    size: int | None = None
    """Number of rows of the geometry image; 129 if left out."""
    layout: Layout = "octahedral"
    """How the sphere is unfolded: onto a square, or by latitude and longitude (twice as many columns as rows)."""
    mothers: str | None = None
    """Mother wavelets, comma between (an unknown name lists them): the paper's six if left out, or beta2,beta1 over the sphere."""
    method: Literal["ols", "omp", "mp"] = "ols"
    """Rule by which wavelets are chosen: orthogonal least squares, or a matching pursuit."""
    coordinates: Literal["joint", "separate"] = "joint"
    """Whether x, y and z share their wavelets."""
    block_rows: int = 1
    """Rows of the image in a block."""
    refinement: Literal["none", "final", "interleaved"] = "none"
    """Whether wavelets move to where they fit best: not at all, once all are chosen, or after each choice (10 to 100 times slower)."""


CHOICES = Choices()
NEXT_MOTHER = re.compile(r",(?![^(]*\))")
"""The comma between two mothers, not that within beta2(4,8)."""


def approximate(
    mesh: Path,
    /,
    *,
    output: Output,
    choices: Choices = CHOICES,
    residual: Annotated[bool, Parameter(negative=())] = False,
    over: Literal["rows", "sphere"] = "rows",
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Approximate a mesh by wavelet networks, block by block; reconstruct brings it back.

    Parameters
    ----------
    mesh
        A mesh that has a spherical map.
    output
        .npz file: the matrix IC of all networks, and the directions and faces of the mesh.
    residual
        Store what the networks miss too: the mesh comes back exactly.
    over
        Networks over the rows of the geometry image, as in the paper, or one network over the whole sphere.
    """

    def work(run: Run) -> dict[str, Any]:
        run.file(output, ".npz")
        how = _over_sphere(choices) if over == "sphere" else _over_rows(choices)
        mapped = steps.mapped(run, steps.closed(run, mesh, mending), mesh.name)
        run.stage("networks")
        found, figures = how(mapped, residual)
        found.save(run.place(output))
        draw_beside(run, mapped.mesh, found.mesh())
        return figures | {"over": over, "bytes": run.place(output).stat().st_size, "repairs": steps.repairs(mapped.surface)}

    return execute("approximate", [mesh], common, work)


def reconstruct(ic: Path, /, *, output: Output, common: Common = DEFAULTS) -> int:
    """Bring a mesh back from the file that approximate wrote, and from nothing else.

    Parameters
    ----------
    ic
        .npz file that approximate wrote.
    output
        Mesh file, with the vertices in the order and the faces of the mesh that was approximated.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.approximation.stored import load
            from morphlet.io.formats import write

        run.file(output, *MESHES)
        found = load(ic)
        shape = found.mesh()
        write(run.place(output), shape)
        draw_mesh(run, shape)
        counts = found.counts()
        return {
            "vertices": shape.n_vertices,
            "faces": shape.n_faces,
            "wavelets": sum(counts.values()),
            "blocks": found.blocks,
            "counts": counts,
        }

    return execute("reconstruct", [ic], common, work)


def _over_rows(choices: Choices) -> "Approximator":
    """Networks over the rows of the geometry image; what cannot be is refused before the work."""
    from morphlet.approximation.quality import diagonal
    from morphlet.approximation.rows import ENOUGH, SIZE, RowOptions, approximate_by_rows, rows_of_blocks
    from morphlet.sphere.image import directions

    height, rule = SIZE if choices.size is None else choices.size, RowOptions()
    most = choices.wavelets if choices.wavelets is not None else rule.n_wavelets if choices.error is None else ENOUGH
    mothers, kept = _mothers(choices.mothers) or rule.mothers, (choices.coordinates, choices.block_rows, choices.refinement)
    options = RowOptions(most, length(choices.error, 1.0), choices.method, mothers, *kept)
    directions(choices.layout, height)
    rows_of_blocks(height, choices.block_rows)

    def made(mapped: "SphericalMap", residual: bool) -> tuple[Any, dict[str, Any]]:
        meant = replace(options, error=length(choices.error, diagonal(mapped)))
        found = approximate_by_rows(mapped, height, choices.layout, meant)
        found = found.with_residual(mapped.mesh) if residual else found
        figures = found.figures(mapped) | {"size": height, "layout": choices.layout}
        _require_met(figures["block_error_max"], meant.error, meant.n_wavelets)
        return found, figures

    return made


def _over_sphere(choices: Choices) -> "Approximator":
    """One network over the whole sphere."""
    import numpy as np

    from morphlet.approximation.quality import diagonal
    from morphlet.approximation.surface import DEFAULT, WAVELETS, ApproximationOptions, approximate

    if choices != Choices(choices.wavelets, choices.error, mothers=choices.mothers):
        needed = "no --size, --layout, --method, --coordinates, --block-rows or --refinement with --over sphere"
        raise InputError(needed, "one of them", "leave it out: there are no rows, and orthogonal least squares is the rule")
    most, chosen = WAVELETS if choices.wavelets is None else choices.wavelets, _mothers(choices.mothers) or DEFAULT.mothers
    length(choices.error, 1.0)

    def made(mapped: "SphericalMap", residual: bool) -> tuple[Any, dict[str, Any]]:
        reach = length(choices.error, diagonal(mapped))
        found = approximate(mapped, mapped.mesh.vertices, most, ApproximationOptions(chosen, tolerance=reach**2))
        _require_met(float(np.sqrt(found.fit.sse[-1])), reach, most)
        found = found.with_residual(mapped.mesh.vertices) if residual else found
        return found, found.figures(mapped)

    return made


def _mothers(names: str | None) -> "tuple[Mother, ...]":
    """Mothers by their names."""
    from morphlet.wavenet.mothers import mother

    return tuple(mother(name.strip()) for name in ([] if names is None else NEXT_MOTHER.split(names)))


def _require_met(worst: float, error: float, wavelets: int) -> None:
    """Refuse networks that miss the error that was demanded."""
    if 0 < error < worst:
        most = f"{worst:.4g} in the worst, with at most {wavelets} wavelets"
        raise SolveError(f"an rms error of {error:.4g} in each block", most, "allow more --wavelets, or a larger --error")
