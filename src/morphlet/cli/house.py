"""Verbs of the house: the main job shown, and the kernels compiled."""

from pathlib import Path
from typing import Any

from morphlet.cli import steps
from morphlet.cli.motion import write_frames
from morphlet.cli.options import DEFAULTS, FILM, Film, Output
from morphlet.cli.pictures import promise_film
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError

FRAMES = 24


def demo(*, output: Output = Path("morphlet-demo"), vertices: int | None = None, film: Film = FILM, common: Common = DEFAULTS) -> int:
    """The main job on procedural creatures: a grazer becomes a predator.

    Parameters
    ----------
    output
        Folder for meshes, markers, frames, contact sheet and report.
    vertices
        Of each creature.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.demo import true_error, write_inputs
            from morphlet.samples import creatures

        run.folder(output)
        promise_film(run, film)
        steps.warm(run)
        meshes, morphed = run.place(output) / "meshes", run.place(output) / "morph"
        meshes.mkdir()
        morphed.mkdir()
        run.stage("creatures")
        a, b, pairs = write_inputs(meshes, creatures.DEFAULT_VERTICES if vertices is None else vertices)
        matched = steps.matched(run, (a, b), pairs)
        run.say(f"mean distance to the known true places: {true_error(matched):.1f} % of sqrt(area)")
        found = write_frames(run, matched, (FRAMES, "gradient", None, None), (output / "morph", morphed), (a, "ply"), film)
        run.say(f"\nLook at  {output / 'morph' / 'contact-sheet.png'}\nand open {output / 'morph' / 'report.html'}")
        return found

    return execute("demo", [], common, work)


def warmup(*, common: Common = DEFAULTS) -> int:
    """Compile the kernels, so that the next run starts at once."""

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            from morphlet.warm import COMPILERS, compiled

        if common.picture is not None:
            raise InputError("no --picture for warmup", "one", "leave it out: there is nothing to draw")
        before = all(compiled(of) for of in COMPILERS)
        run.stage("compiling kernels")
        for compile_set in COMPILERS.values():
            compile_set()
        return {"compiled_before": before}

    return execute("warmup", [], common, work)
