"""Many meshes: what a verb costs per mesh in a batch, and what the batch itself adds to each item.

    python benchmarks/many_meshes.py [--data DIR] [--items 1000] [--json FILE] [--markdown]

Verbs: `morphlet batch VERB ... --jobs 1` on one thread; CPU seconds are the verb's own, megabytes the most its process held. Overheads:
items whose verb copies a kilobyte, on this machine and through a Dask scheduler with two workers (absent without the library), and the
manifest, written and read.
"""

import argparse
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from statistics import median
from typing import Any

from book import Cell, Sheet, Table, add_options
from morphlet import Creature, write
from morphlet.batch.items import Batch, Item
from morphlet.batch.limits import Limits
from morphlet.batch.manifest import NAME, Line, opened
from morphlet.batch.runner import claimed, cluster, machine, run
from morphlet.samples.poses import POSES

PUBLIC = ("cow.off", "cheburashka.obj", "horse.obj", "stanford-bunny.obj", "armadillo.obj", "horse-48k.ply")
FAR = ("cow.off", "cheburashka.obj", "horse-48k.ply")
"""Sources of maps."""
POSED = ("standing", "walking", "leaping")
LINES = 200_000
PARAMETERS = {"verb": "sphere", "p": 1.0, "weights": "uniform", "balance": None, "component": None, "cut_handles": 0, "seed": 0}
SERVED = "--serve"
"""What tells this script that it is a server."""


def batch(*words: object) -> dict[str, Any]:
    """What the command line answers."""
    call = [sys.executable, "-m", "morphlet", "batch", *map(str, words), "--jobs", "1", "--json", "--quiet"]
    found: dict[str, Any] = json.loads(subprocess.run(call, stdout=subprocess.PIPE, text=True, check=True).stdout)
    return found


def told(folder: Path) -> dict[str, tuple[dict[str, Any], float]]:
    """By stem, what the verb told and the megabytes of its process."""
    lines = [json.loads(line) for line in (folder / NAME).read_text().splitlines()]
    return {Path(one["outputs"][-1]).stem: (json.loads(Path(one["outputs"][-1]).read_text()), one["peak_memory_mb"]) for one in lines}


def costs(data: Path | None, scratch: Path) -> list[list[Cell]]:
    """Rows of verbs on meshes."""
    animals = scratch / "animals"
    animals.mkdir()
    for species in ("grazer", "predator"):
        animal = Creature.prepare(species, n_vertices=1500)
        for pose in POSED:
            write(animals / f"{species}-{pose}.ply", animal.posed(POSES[pose]))
    meshes = sorted(animals.iterdir()) if data is None else [data / "meshes" / name for name in PUBLIC]
    rows: list[list[Cell]] = []
    batch("sphere", *meshes, "-o", scratch / "maps")
    for stem, (found, peak) in told(scratch / "maps").items():
        rows.append(["sphere", stem, found["cpu_seconds"], peak])
    to = meshes[2]
    batch("correspond", *([data / "meshes" / name for name in FAR] if data else meshes[:2]), "--to", to, "-o", scratch / "to")
    rows += [
        [f"correspond to {to.stem}", s, f["cpu_seconds"], m] for s, (f, m) in told(scratch / "to").items() if f["verb"] == "correspond"
    ]
    batch("all-pairs", animals, "-o", scratch / "zoo")
    pairs = [(f["cpu_seconds"], m) for f, m in told(scratch / "zoo").values() if f["verb"] == "correspond"]
    middle = [median(values) for values in zip(*pairs, strict=True)]
    return [*rows, [f"a pair of all-pairs, median of {len(pairs)}", "creatures of 1,500 vertices", *middle]]


def serve() -> None:
    """Copy files on request, as a server of a batch does verbs."""
    print('{"ready": 1}', flush=True)
    for line in sys.stdin:
        words = json.loads(line)["words"]
        shutil.copy(words[1], words[words.index("--output") + 1])
        print('{"result": {}, "peak_memory_mb": 1.0}', flush=True)


def overhead(engine: Any, folder: Path, count: int) -> tuple[float, float]:
    """Milliseconds of an item: wall, and CPU of this process."""
    folder.mkdir()
    (folder / "in").write_bytes(bytes(1000))
    items = [Item(f"{k}", str(folder / "in"), ("copy", str(folder / "in")), (f"{k}.npz", f"{k}.json"), PARAMETERS) for k in range(count)]
    wall, cpu = time.perf_counter(), time.process_time()
    with engine as ready, claimed(folder) as (manifest, work):
        shared = Batch(str(folder), str(folder), str(work), (str(Path(__file__).absolute()), SERVED), Limits())
        done = sum(line.status == "done" for line in run(items, shared, ready, manifest, False))
    if done < count:
        raise RuntimeError(f"{count - done} of {count} items failed")
    return 1e3 * (time.perf_counter() - wall) / count, 1e3 * (time.process_time() - cpu) / count


@contextmanager
def scheduler(folder: Path) -> Iterator[str]:
    """The address of a Dask scheduler with two workers."""
    dask, silent = [sys.executable, "-m", "dask"], {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    file, own = folder / "scheduler.json", os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    words = ["--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file)]
    started = [subprocess.Popen([*dask, "scheduler", *words], env=own, **silent)]
    try:
        while not (file.exists() and file.read_text().endswith("}")):
            time.sleep(0.1)
        address = str(json.loads(file.read_text())["address"])
        words = [address, "--nthreads", "1", "--no-nanny", "--no-dashboard", "--local-directory", str(folder)]
        started += [subprocess.Popen([*dask, "worker", *words], env=own, **silent) for _ in range(2)]
        time.sleep(6.0)  # both are there before the first item
        yield address
    finally:
        for process in started:
            process.terminate()


def manifest_costs(folder: Path) -> list[list[Cell]]:
    """Bytes of a line, and what it takes to read one."""
    folder.mkdir()
    lines = (
        Line(f"meshes/{k:07}.ply", f"{k:064}", PARAMETERS, "done", None, (f"{k:07}.npz", f"{k:07}.json"), 1.0, 200.0) for k in range(LINES)
    )
    (folder / NAME).write_bytes(b"".join(line.bytes for line in lines))
    size, before = (folder / NAME).stat().st_size, time.process_time()
    with opened(folder) as manifest:
        taken, known = time.process_time() - before, len(manifest.made)
    return [["a line of the manifest, bytes", size / LINES], [f"reading one of {known // 2}, CPU microseconds", 1e6 * taken / LINES]]


def main() -> None:
    if sys.argv[1:] == [SERVED]:
        serve()
        return
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA"))
    parser.add_argument("--items", type=int, default=1000)
    add_options(parser)
    chosen = parser.parse_args()
    sheet = Sheet.of(chosen)
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        rows = costs(None if chosen.data is None else Path(chosen.data), scratch)
        sheet.add(Table("Verbs over many meshes", ["verb", "mesh", "CPU s", "MB"], rows, "One job, one thread."))
        here = overhead(machine(1), scratch / "here", chosen.items)
        own: list[list[Cell]] = [["an item on this machine, wall ms", here[0]], ["of it CPU of the batch's process, ms", here[1]]]
        if importlib.util.find_spec("distributed") is None:
            sheet.miss("Dask", "distributed is not installed")
        else:
            with scheduler(scratch) as address:
                far = overhead(cluster(address), scratch / "far", chosen.items)
            own += [["an item by a Dask scheduler with two workers, wall ms", far[0]], ["of it CPU of the batch's process, ms", far[1]]]
        own += manifest_costs(scratch / "lines")
        sheet.add(Table("The batch itself", ["", ""], own, f"{chosen.items} items that copy a kilobyte."))


if __name__ == "__main__":
    main()
