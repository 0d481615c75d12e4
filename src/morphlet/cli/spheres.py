"""Verbs of the spherical map: the map, and the mesh as an image over it."""

from pathlib import Path
from typing import Any, Literal

from morphlet.cli import steps
from morphlet.cli.options import DEFAULTS, MENDING, Layout, Mending, Output
from morphlet.cli.pictures import draw_mesh, draw_sphere
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError


def sphere(
    mesh: Path,
    /,
    *,
    output: Output,
    p: float = 1.0,
    weights: Literal["uniform", "area"] = "uniform",
    balance: float | None = None,
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Map a mesh one-to-one to the unit sphere.

    Parameters
    ----------
    mesh
        One piece of genus 0; holes are filled for the map only.
    output
        .npz file: points, faces.
    p
        Exponent of the distortion, in (0, 1]: smaller gives a lower mean and a longer tail.
    weights
        Whether triangles count the same, or by area.
    balance
        Relax once more, from angles alone (0) to areas alone (1); isometric if left out.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from dataclasses import asdict

            from morphlet.sphere.embed import SphereOptions

        run.file(output, ".npz")
        options = SphereOptions(p, weights, balance)
        mapped = steps.mapped(run, steps.closed(run, mesh, mending), mesh.name, options)
        mapped.save(run.place(output))
        draw_sphere(run, mapped)
        virtual = mapped.surface.mesh.n_vertices - mapped.surface.n_real_vertices
        how = {
            "iterations": mapped.trace.iterations,
            "attempt": mapped.trace.attempt,
            "virtual_vertices": virtual,
            "repairs": steps.repairs(mapped.surface),
        }
        return asdict(mapped.quality()) | how

    return execute("sphere", [mesh], common, work)


def image(
    mesh: Path,
    /,
    *,
    output: Output,
    size: int = 128,
    layout: Layout = "octahedral",
    mending: Mending = MENDING,
    common: Common = DEFAULTS,
) -> int:
    """Sample a mesh into a spherical geometry image.

    Parameters
    ----------
    mesh
        A mesh that has a spherical map.
    output
        .png (a picture) or .npz (exact positions and mask).
    size
        Number of rows.
    layout
        How the sphere is unfolded: onto a square, or by latitude and longitude (twice as many columns as rows).
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.sphere.image import SMALLEST, spherical_image

        run.file(output, ".png", ".npz")
        if size < SMALLEST:
            raise InputError(f"a size of {SMALLEST} or more", str(size), "ask for more rows")
        mapped = steps.mapped(run, steps.closed(run, mesh, mending), mesh.name)
        sampled = spherical_image(mapped, size, layout)
        keep = sampled.write_png if output.suffix.lower() == ".png" else sampled.save
        keep(run.place(output))
        draw_mesh(run, sampled.to_mesh())
        return {"size": size, "rmse": sampled.rmse(mapped), "repairs": steps.repairs(mapped.surface)}

    return execute("image", [mesh], common, work)
