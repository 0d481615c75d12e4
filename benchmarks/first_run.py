"""What a person waits for at the very first run, at the second, and for --help.

python benchmarks/first_run.py [--json FILE] [--markdown]
"""

import argparse
import os
import statistics
import subprocess
import sys
import tempfile
import time

from book import Sheet, Table, add_options

RUNS = 5
MORPHLET = (sys.executable, "-m", "morphlet")
IMPORT = "import morphlet.pipeline.morph, morphlet.report.story"
START = "from morphlet import Mesh, spherical_map; from morphlet.numerics.unit_sphere import icosphere; spherical_map(Mesh(*icosphere(1)))"
LEFT = """
from numba.core import event
from morphlet import Mesh, morph
from morphlet.numerics.unit_sphere import icosphere

with event.install_recorder("numba:compile") as compiled:
    points, faces = icosphere(4)
    bean = Mesh(points * [1.0, 1.2, 2.0] + 0.3 * points[:, [1]] ** 2, faces)
    morph(Mesh(points, faces), bean, frames=2).figures()
print(sum(change.is_start for _, change in compiled.buffer))
"""
"""Counts what a larger job compiles."""


def seconds(*command: str, **environment: str) -> tuple[float, float]:
    """Wall and CPU time of a command and its children."""
    before, began = os.times(), time.perf_counter()
    subprocess.run(command, env=os.environ | environment, check=True, capture_output=True)
    after = os.times()
    cpu = after.children_user - before.children_user + after.children_system - before.children_system
    return time.perf_counter() - began, cpu


def median(*command: str, **environment: str) -> tuple[float, float]:
    """Medians over some runs."""
    runs = [seconds(*command, **environment) for _ in range(RUNS)]
    return statistics.median(r[0] for r in runs), statistics.median(r[1] for r in runs)


def main() -> None:
    """Measure, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_options(parser)
    sheet, lines = Sheet.of(parser.parse_args()), []
    with tempfile.TemporaryDirectory() as cache:
        places = {"NUMBA_CACHE_DIR": cache, "XDG_CACHE_HOME": cache}
        rows = {
            "first run: compile everything morph needs": lambda: seconds(*MORPHLET, "warmup", "--quiet", **places),
            "second run: the same work, kernels cached": lambda: median(*MORPHLET, "warmup", "--quiet", **places),
            "second run: until a first map is computed": lambda: median(sys.executable, "-c", START, **places),
            "imports of the main job": lambda: median(sys.executable, "-c", IMPORT, **places),
            "morphlet --help": lambda: median(*MORPHLET, "--help", **places),
        }
        for name, measure in rows.items():
            wall, cpu = measure()
            lines.append([name, f"{wall:.2f}", f"{cpu:.2f}"])
            sys.stderr.write("  ".join(lines[-1]) + "\n")
        left = subprocess.run((sys.executable, "-c", LEFT), env=os.environ | places, check=True, capture_output=True, text=True)
    note = f"kernels that a larger job compiles after that: {left.stdout.strip()}"
    sheet.add(Table("First run, second run, help", ["", "wall s", "CPU s"], lines, f"All but the first: medians of {RUNS} runs.", [note]))


if __name__ == "__main__":
    main()
