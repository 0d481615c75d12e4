"""Batches of small files, done by a server that says what goes wrong."""

import json
from pathlib import Path

from morphlet.batch.items import Batch, Item
from morphlet.batch.limits import Limits
from morphlet.batch.runner import claimed, machine, run

FAKE = (str(Path(__file__).with_name("fake_server.py")),)
PARAMETERS = {"verb": "copy"}
FREE = Limits()


def item(folder: Path, name: str, deed: str = "copy") -> Item:
    """An item, its input written."""
    path = folder / f"{name}.txt"
    if not path.exists():
        path.write_text(name)
    return Item(str(path), str(path), (deed, str(path)), (f"{name}.out", f"{name}.json"), PARAMETERS)


def done(out: Path, items: list[Item], limits: Limits = FREE, *, jobs: int = 2, force: bool = False) -> dict[str, str]:
    """Do them on this machine: the status of each."""
    with machine(jobs) as engine, claimed(out) as (manifest, work):
        batch = Batch(str(out), str(out), str(work), FAKE, limits)
        return {Path(line.input).stem: line.status for line in run(items, batch, engine, manifest, force)}


def told(out: Path) -> list[dict[str, object]]:
    """The lines of the manifest, each a JSON object."""
    return [json.loads(line) for line in (out / "manifest.jsonl").read_text("utf-8").splitlines()]


def times_done(folder: Path, name: str) -> int:
    """How often an item was begun and not stopped."""
    log = folder / f"{name}.log"
    return len(log.read_text().splitlines()) if log.exists() else 0
