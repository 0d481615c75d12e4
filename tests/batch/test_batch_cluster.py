"""A cluster: a scheduler and workers of Dask on this machine, some of which die."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from batch.batches import FAKE, item, times_done, told
from cli.calls import call
from morphlet import InputError, write
from morphlet.batch.items import Batch
from morphlet.batch.limits import Limits
from morphlet.batch.runner import claimed, cluster, run
from support import icosphere

distributed = pytest.importorskip("distributed", reason="a cluster needs the extra 'cluster'")
PATIENCE = 120
"""Seconds for processes to come up on a busy machine."""
EASY = {"DASK_DISTRIBUTED__SCHEDULER__ALLOWED_FAILURES": "1", "DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}


def dask(*words):
    """A part of a cluster, quiet."""
    command = [sys.executable, "-m", "dask", *words]
    here = os.environ | EASY | {"PYTHONPATH": os.pathsep.join([str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")])}
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env=here)


def worker(address, folder, *words):
    return dask("worker", address, "--nthreads", "1", "--no-dashboard", "--local-directory", str(folder), *words)


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory):
    """Its address."""
    file = tmp_path_factory.mktemp("scheduler") / "told.json"
    process = dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard", "--scheduler-file", str(file))
    wait(lambda: file.exists() and file.read_text().endswith("}"))
    yield json.loads(file.read_text())["address"]
    process.terminate()
    process.wait(PATIENCE)


def wait(there):
    deadline = time.monotonic() + PATIENCE
    while not there():
        assert time.monotonic() < deadline
        time.sleep(0.05)


@pytest.fixture
def workers(scheduler, tmp_path):
    """Two of them."""
    made = [worker(scheduler, tmp_path / f"w{k}", "--no-nanny") for k in range(2)]
    with distributed.Client(scheduler, set_as_default=False) as client:
        wait(lambda: len(client.ncores()) == 2)
    yield made
    for process in made:
        process.kill()
        process.wait()
    with distributed.Client(scheduler, set_as_default=False) as client:
        wait(lambda: not client.ncores())


@pytest.fixture
def folders(tmp_path):
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    return tmp_path / "in", tmp_path / "out"


def statuses(scheduler, out, items, kill=None):
    """Do them there; `kill` is called after the first line."""
    found = []
    with cluster(scheduler) as engine, claimed(out) as (manifest, work):
        for line in run(items, Batch(str(out), str(out), str(work), FAKE, Limits()), engine, manifest, False):
            found.append((Path(line.input).stem, line.status))
            if len(found) == 1 and kill is not None:
                kill()
    return found


def test_a_worker_killed_in_mid_run_loses_nothing(scheduler, workers, folders):
    inside, out = folders
    names = [f"i{k}" for k in range(8)]
    found = statuses(scheduler, out, [item(inside, name, "slow") for name in names], workers[0].kill)
    assert sorted(found) == [(name, "done") for name in names]
    assert len(told(out)) == 8
    assert {times_done(inside, name) for name in names} <= {1, 2}  # a worker may be killed before it could tell what it has done
    assert all((out / f"{name}.out").read_text() == name for name in names)
    assert statuses(scheduler, out, [item(inside, name, "slow") for name in names]) == [(name, "skipped") for name in names]


def test_an_item_that_kills_workers_fails_alone(scheduler, workers, folders, tmp_path):
    inside, out = folders
    deeds = {"a": "slow", "b": "orphan", "c": "slow", "d": "slow"}
    later = [worker(scheduler, tmp_path / "later", "--no-nanny")]
    try:
        with distributed.Client(scheduler, set_as_default=False) as client:
            wait(lambda: len(client.ncores()) == 3)
        found = dict(statuses(scheduler, out, [item(inside, name, deed) for name, deed in deeds.items()]))
    finally:
        later[0].kill()
        later[0].wait()
    assert found == {"a": "done", "b": "failed", "c": "done", "d": "done"}
    assert "its worker was lost: KilledWorker" in next(line["error"] for line in told(out) if line["status"] == "failed")
    assert {process.poll() for process in workers + later} >= {-signal.SIGKILL}


def test_the_command_line(scheduler, workers, tmp_path, capsys):
    (tmp_path / "in").mkdir()
    for level in (1, 2):
        write(tmp_path / "in" / f"ball{level}.ply", icosphere(level))
    (tmp_path / "in" / "none.ply").write_text("no mesh")
    words = ("batch", "sphere", tmp_path / "in", "-o", tmp_path / "out", "--scheduler", scheduler, "--time-limit", 300, "--json")
    answer = call(capsys, *words)
    assert (answer.code, *(answer.result[key] for key in ("done", "failed", "skipped", "jobs"))) == (1, 2, 1, 0, None)
    assert np.load(tmp_path / "out" / "ball2.npz", allow_pickle=False)["points"].shape == (162, 3)
    again = call(capsys, *words)
    assert [again.result[key] for key in ("done", "failed", "skipped")] == [0, 1, 2]


def test_addresses_without_a_scheduler_or_workers(scheduler, monkeypatch):
    monkeypatch.setattr("morphlet.batch.runner.CONNECT", 1)
    with pytest.raises(InputError, match=r"a Dask scheduler at tcp://127.0.0.1:9"), cluster("tcp://127.0.0.1:9"):
        pass
    with pytest.raises(InputError, match=r"workers of the scheduler .*; found none"), cluster(scheduler):
        pass
