"""The runner: every item ends done, failed or skipped, once; whatever happens to servers, workers, files and people's patience."""

import json
import os
import shutil
import threading
import time
from concurrent.futures import Executor, Future
from pathlib import Path

import pytest

from batch.batches import FAKE, done, item, times_done, told
from morphlet import FileError, InputError
from morphlet.batch.items import Batch
from morphlet.batch.limits import Limits
from morphlet.batch.runner import Engine, Interrupted, claimed, machine, require_different, require_folder, require_own, run


@pytest.fixture
def folders(tmp_path):
    """Of inputs, and of outputs."""
    for name in ("in", "out"):
        (tmp_path / name).mkdir()
    return tmp_path / "in", tmp_path / "out"


def test_items_are_done_and_told(folders):
    inside, out = folders
    assert done(out, [item(inside, name) for name in "abc"]) == dict.fromkeys("abc", "done")
    assert sorted(path.name for path in out.iterdir()) == ["a.json", "a.out", "b.json", "b.out", "c.json", "c.out", "manifest.jsonl"]
    lines = {Path(line["input"]).stem: line for line in told(out)}
    assert lines["a"]["outputs"] == [str(out / "a.out"), str(out / "a.json")]
    assert (out / "b.out").read_text() == "b"
    assert (lines["c"]["peak_memory_mb"], lines["c"]["error"], len(lines["c"]["fingerprint"])) == (1.0, None, 64)


def test_verbs_are_told_where_and_with_how_many_threads(folders):
    inside, out = folders
    done(out, [item(inside, "a")], Limits(threads=3))
    result = json.loads((out / "a.json").read_text("utf-8"))
    assert result["outputs"] == [str(out / "a.out")]
    assert result["words"][2:] == ["--json", "--force", "--threads=3"]


def test_what_is_done_is_skipped(folders):
    inside, out = folders
    items = [item(inside, name) for name in "ab"]
    done(out, items[:1])
    assert done(out, items) == {"a": "skipped", "b": "done"}
    assert done(out, items) == dict.fromkeys("ab", "skipped")
    assert [times_done(inside, name) for name in "ab"] == [1, 1]
    assert len(told(out)) == 5


def test_other_content_lost_outputs_and_force_are_done_again(folders):
    inside, out = folders
    items = [item(inside, name) for name in "abc"]
    done(out, items)
    (inside / "a.txt").write_text("other")
    (out / "b.json").unlink()
    assert done(out, items) == {"a": "done", "b": "done", "c": "skipped"}
    assert (out / "a.out").read_text() == "other"
    assert done(out, items, force=True) == dict.fromkeys("abc", "done")


def test_results_of_other_parameters_are_refused(folders):
    inside, out = folders
    done(out, [item(inside, "a")])
    other = item(inside, "a")
    changed = type(other)(other.input, other.path, other.words, other.outputs, {"verb": "copy", "p": 0.5})
    with (
        claimed(out) as (manifest, _),
        pytest.raises(FileError, match=r"found a.out made with another p; choose another folder, or add --force"),
    ):
        require_own([changed], manifest)


def test_bad_items_fail_with_their_reason_and_others_are_done(folders):
    inside, out = folders
    deeds = {"a": "copy", "b": "fail", "c": "crash", "d": "copy", "e": "hang"}
    found = done(out, [item(inside, name, deed) for name, deed in deeds.items()], Limits(seconds=3.0))
    assert found == {"a": "done", "b": "failed", "c": "failed", "d": "done", "e": "failed"}
    errors = {Path(line["input"]).stem: line["error"] for line in told(out)}
    assert errors["b"] == "needed a better mesh"
    assert errors["c"].startswith("its process was ended by SIGKILL")
    assert errors["e"] == "ended after its time limit of 3 s"
    assert sorted(path.name for path in out.iterdir() if path.suffix == ".out") == ["a.out", "d.out"]


@pytest.mark.parametrize("deed", ["crash late", "greedy"])
def test_what_earlier_items_left_in_a_process_is_no_items_fault(folders, deed):
    inside, out = folders
    items = [item(inside, "a"), item(inside, "b", deed), item(inside, "c")]
    assert done(out, items, jobs=1) == dict.fromkeys("abc", "done")


def test_failed_items_are_tried_again(folders):
    inside, out = folders
    assert done(out, [item(inside, "a", "fail")]) == {"a": "failed"}
    assert done(out, [item(inside, "a")]) == {"a": "done"}


def test_an_input_that_is_gone_fails(folders):
    inside, out = folders
    gone = item(inside, "a", "fail")
    (inside / "a.txt").unlink()
    assert done(out, [gone, item(inside, "b")]) == {"a": "failed", "b": "done"}
    assert told(out)[0]["fingerprint"] is None or told(out)[1]["fingerprint"] is None


def test_an_interrupt_leaves_what_is_done(folders):
    """Ctrl-C comes when it is looked for the second time how many workers there are: then b hangs."""
    inside, out = folders
    looks = iter([1])
    items = [item(inside, "a"), item(inside, "b", "hang"), item(inside, "c")]
    with machine(1) as engine, claimed(out) as (manifest, work):
        lines = run(
            items,
            Batch(str(out), str(out), str(work), FAKE, Limits()),
            Engine(engine.executor, lambda: next(looks, None) or stop()),
            manifest,
            False,
        )
        with pytest.raises(Interrupted, match="a request to stop, 1 of 3 items told; start the same again"):
            list(lines)
    assert sorted(path.name for path in out.iterdir()) == ["a.json", "a.out", "manifest.jsonl"]
    assert done(out, [item(inside, name) for name in "abc"]) == {"a": "skipped", "b": "done", "c": "done"}


def stop():
    raise KeyboardInterrupt


def test_what_a_killed_run_left_is_swept_away(folders):
    inside, out = folders
    (out / ".morphlet-batch-old" / "tmp").mkdir(parents=True)
    assert done(out, [item(inside, "a")]) == {"a": "done"}
    assert not list(out.glob(".morphlet-batch-*"))


def test_an_item_ends_when_the_folder_of_its_run_is_gone(folders):
    """As on the machines of a cluster, when the batch was ended elsewhere."""
    inside, out = folders
    with machine(1) as engine, claimed(out) as (manifest, work):
        batch = Batch(str(out), str(out), str(work), FAKE, Limits())
        threading.Timer(1.0, shutil.rmtree, (work,)).start()
        (line,) = run([item(inside, "a", "hang")], batch, engine, manifest, False)
    assert (line.status, line.error) == ("failed", "the batch was ended")


class Losing(Executor):
    """Workers that are gone before they answer, or take nothing at all."""

    def __init__(self, taken: int) -> None:
        self.taken = taken

    def submit(self, work, *arguments):
        if not self.taken:
            raise RuntimeError("no connection")
        self.taken -= 1
        promise = Future()
        promise.set_exception(OSError("the worker died"))
        return promise


def test_items_of_lost_workers_fail(folders):
    inside, out = folders
    with claimed(out) as (manifest, work):
        batch = Batch(str(out), str(out), str(work), FAKE, Limits())
        lines = list(run([item(inside, name) for name in "abc"], batch, Engine(Losing(2), lambda: 2), manifest, False))
    assert [line.error for line in lines] == [
        *2 * ["its worker was lost: OSError: the worker died"],
        "its worker was lost: RuntimeError: no connection",
    ]


def test_a_worker_that_does_not_see_the_folder_says_so(folders):
    inside, out = folders
    with machine(1) as engine, claimed(out) as (manifest, _):
        batch = Batch(str(out), str(out), str(out / "elsewhere"), FAKE, Limits())
        (line,) = run([item(inside, "a")], batch, engine, manifest, False)
    assert "does not see its folder" in line.error


def test_a_manifest_that_cannot_be_written_ends_the_batch(folders, monkeypatch):
    inside, out = folders
    monkeypatch.setattr(os, "fsync", lambda _: (_ for _ in ()).throw(OSError(28, "No space left on device")))
    began = time.monotonic()
    with pytest.raises(FileError, match="found No space left on device; make space and start the same batch again"):
        done(out, [item(inside, "a"), item(inside, "b", "hang")])
    assert time.monotonic() - began < 60
    monkeypatch.undo()
    assert done(out, [item(inside, name) for name in "ab"]) == dict.fromkeys("ab", "done")


def test_inputs_of_one_stem_are_refused(folders):
    inside, _ = folders
    with pytest.raises(InputError, match=r"inputs of different stems; found .*a.txt and .*A.txt"):
        require_different([item(inside, "a"), item(inside, "A")])


def test_folders_that_hold_other_things_are_refused(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    with pytest.raises(FileError, match="to be empty, new, or of an earlier batch; found files in it"):
        require_folder(tmp_path, force=False)
    require_folder(tmp_path, force=True)
    require_folder(tmp_path / "new" / "one", force=False)
    with pytest.raises(FileError, match="a folder as output"):
        require_folder(tmp_path / "mine.txt", force=False)
