"""A slice of `benchmarks/torture.py`: hostile files, unfit input and faults of the machine, each judged as there."""

import importlib
import os
import sys
from pathlib import Path

import pytest

from morphlet.errors import FileError

FOLDER = Path(__file__).parents[2] / "benchmarks"
EVERY = 6
"""Of the files of a reader one in so many is tried, and a few that were changed at random."""
SLOW = ("1 GB", "of 1 GB", "million", "20000 members", "200000", "300000", "30000", "50000", "20000 frames", "10^12", "3000 buffers")
INPUTS = ("empty file", "folder", "a device", "no faces", "one triangle")

if not FOLDER.exists() or os.name == "nt":
    pytest.skip("benchmarks are not here, or cannot run", allow_module_level=True)


def loaded(name: str):
    """A module of the benchmarks; what it needs to find the others is taken off the path."""
    before = list(sys.path)
    sys.path.insert(0, str(FOLDER))
    try:
        return importlib.import_module(name)
    finally:
        sys.path[:] = before


pool, readers, verbs, faults = (loaded(f"torture_{name}") for name in ("pool", "readers", "verbs", "faults"))


@pytest.fixture(scope="module")
def worker():
    with pool.Worker("torture_readers") as one:
        yield one


@pytest.fixture(scope="module")
def caller():
    with pool.Worker("torture_verbs") as one:
        yield one


@pytest.mark.parametrize("name", [name for name in readers.READERS if name != "mlw"])  # which has a test of its own
def test_hostile_files(worker, tmp_path, name):
    counts: dict[str, int] = {}
    for number, (case, task) in enumerate(readers.laid(readers.READERS[name], tmp_path / "a", 12, 1, SLOW)):
        if number % EVERY and not case[0].isdigit():
            continue
        found = worker.ask(task, 60.0)
        assert found.outcome in ("read", "refused"), f"{case}: {found.note}"
        counts[found.outcome] = counts.get(found.outcome, 0) + 1
    assert min(counts.get("read", 0), counts.get("refused", 0)) > 0
    assert not {"unpickled", "escaped.npy"} & {*os.listdir(), *os.listdir("/")}


@pytest.mark.parametrize("verb", ["info", "repair", "deform", "encode", "decode", "carry map", "sample"])
def test_verbs_on_unfit_input(caller, tmp_path, verb):
    for name, task in verbs.laid(tmp_path / "a", verb, False):
        if name in INPUTS:
            found = caller.ask(task, 60.0)
            assert found.outcome in ("refused", "repaired", "done"), f"{name}: {found.note}"


@pytest.mark.parametrize("name", faults.FAULTS)
def test_faults_of_the_machine(tmp_path, name):
    try:
        found = [(what, verdict) for what, verdict in faults.FAULTS[name](tmp_path / "a", True)]
    except faults.CannotBe as error:
        pytest.skip(str(error))
    assert found
    assert [(what, verdict.note) for what, verdict in found if verdict.outcome == "failed"] == []


def test_a_worker_that_hangs_or_dies_is_replaced(tmp_path, monkeypatch):
    (tmp_path / "stub.py").write_text(
        "import os, time\n"
        "def attempt(task):\n"
        "    if task['do'] == 'die': os._exit(9)\n"
        "    if task['do'] == 'hang': time.sleep(60)\n"
        "    if task['do'] == 'raise': raise MemoryError('all of it')\n"
        "    print('noise')\n"
        "    return 'read', str(os.getpid())\n"
    )
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pool.Worker("stub", 0) as one:
        first = one.ask({"do": "well"})
        assert one.ask({"do": "raise"}).note.startswith("MemoryError: all of it")
        assert one.ask({"do": "well"}).note == first.note
        assert one.ask({"do": "die"}).note == "the process ended with 9"
        assert one.ask({"do": "hang"}, 0.5).note == "no answer within 0.5 s"
        again = one.ask({"do": "well"})
        assert (again.outcome, again.note != first.note) == ("read", True)


def test_the_judge_tells_what_is_wrong(tmp_path):
    """Refusals in other words, files read as something else, and files read that must not be."""
    assert readers.refusal(FileError("a", "b\x1b[2J", "c"), readers.ANY)[0] == "failed"
    assert readers.refusal(FileError("a", "b" * 5000, "c"), readers.ANY)[0] == "failed"
    assert readers.refusal(FileError("a", "b", ""), readers.ANY)[0] == "failed"
    assert readers.refusal(FileError("a", "b", "c"), readers.SAME)[0] == "failed"
    assert readers.refusal(FileError("a", "b", "c"), readers.ANY)[0] == "refused"
    sound, other = tmp_path / "sound", tmp_path / "x"
    sound.mkdir()
    other.mkdir()
    (sound / "a-sound.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (other / "x.obj").write_text("v 0 0 0\nv 2 0 0\nv 0 1 0\nf 1 2 3\n")
    task = {"reader": "obj", "file": str(other / "x.obj"), "seed": str(sound / "a-sound.obj"), "sound": str(sound)}
    for expect, outcome in (("any", "read"), ("same", "failed"), ("sound", "failed"), ("refused", "failed")):
        assert readers.attempt(task | {"expect": expect})[0] == outcome


def test_mixtures_are_no_whole_files(tmp_path):
    mesh = readers.body(4)
    readers.write(tmp_path / "m.ply", mesh)
    assert faults.whole(tmp_path / "m.ply").outcome == "failed"
    assert faults.whole(tmp_path / "gone.ply").note == "absent"
