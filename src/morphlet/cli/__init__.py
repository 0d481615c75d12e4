"""The command line: one verb, one call of the library.

`options` and `steps` hold what verbs share, `pictures` what `--picture` shows; every other module is a group of verbs. These import what
they need when they run, so that `morphlet --help` is instant.
"""

import os
import sys
from collections.abc import Sequence
from functools import reduce

from cyclopts import App, CycloptsError, UnknownOptionError

from morphlet import __version__
from morphlet.cli import batch, compression, editing, features, house, maps, meshes, motion, networks, paper, spheres, window
from morphlet.console import refuse

VERBS = (
    *(meshes.info, meshes.repair, meshes.compare, meshes.sample, meshes.fetch),
    *(spheres.sphere, spheres.image),
    *(networks.approximate, networks.reconstruct),
    *(features.regions, features.match),
    *(maps.correspond, maps.carry),
    *(motion.morph, motion.transfer),
    *(editing.deform, window.studio),
    *(compression.encode, compression.decode),
    *(paper.paper, house.demo, house.warmup),
)

BLAS_THREADS = ("OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS", "OMP_NUM_THREADS")
"""Variables that tell the libraries below numpy how many threads to start."""

app = App(
    name="morphlet",
    version=__version__,
    help="Deform, morph, match, transfer and compress triangle meshes through a common sphere.",
    help_format="plaintext",
)
for verb in VERBS:
    app.command(verb)
app.command(batch.app)


def main(arguments: Sequence[str] | None = None) -> int:
    """Parse, run, and return the exit code."""
    for name in BLAS_THREADS:  # more of them would change the last bits with the machine, and gain nothing on matrices of this size
        os.environ.setdefault(name, "1")
    given = sys.argv[1:] if arguments is None else list(arguments)
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # names of files need not be text
            stream.reconfigure(errors="backslashreplace")
    try:
        command, bound, _ = app.parse_args(given, exit_on_error=False, print_error=False)
    except CycloptsError as error:
        return refuse(_usage(error), "--json" in given)
    result = command(*bound.args, **bound.kwargs)
    return result if isinstance(result, int) else 0


def _usage(error: CycloptsError) -> str:
    """What was wrong with the arguments, and what there is instead."""
    verb = " ".join(error.command_chain or ())
    hint = f"try morphlet {verb} --help" if verb else "try morphlet --help"
    if verb and isinstance(error, UnknownOptionError):
        options = [argument.names[0] for argument in reduce(App.__getitem__, verb.split(), app).assemble_argument_collection()]
        hint = f"{verb} of this version has {', '.join(name for name in options if name.startswith('--'))}; {hint}"
    text = str(error)
    return f"{text if text.endswith('...') else text.rstrip('.')}; {hint}"
