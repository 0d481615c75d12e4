"""The manifest: whole lines, one process at a time, and what is left when the disk or the process ends first."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from morphlet import FileError
from morphlet.batch.manifest import KEYS, Line, key, opened, read_lines

LINE = Line("a.obj", "f", {"verb": "sphere"}, "done", None, ("out/a.npz", "out/a.json"), 1.5, 20.0)
HOLD = "import sys, time; from pathlib import Path; from morphlet.batch.manifest import opened\n"
HOLD += "with opened(Path(sys.argv[1])): print('held', flush=True); time.sleep(60)"


def test_lines_come_back(tmp_path):
    with opened(tmp_path) as manifest:
        manifest.append(LINE)
    (line,) = read_lines(tmp_path / "manifest.jsonl")
    assert line == LINE
    text = (tmp_path / "manifest.jsonl").read_text("utf-8")
    assert text.endswith("\n")
    assert set(json.loads(text)) == KEYS == {
        *("input", "fingerprint", "parameters", "status", "error", "outputs", "seconds", "peak_memory_mb")
    }  # fmt: skip


def test_the_last_line_of_an_output_counts_and_failures_do_not(tmp_path):
    with opened(tmp_path) as manifest:
        manifest.append(LINE)
        manifest.append(Line("a.obj", "g", {}, "failed", "why"))
        assert manifest.made == {"a.npz": LINE, "a.json": LINE}
    with opened(tmp_path) as manifest:
        assert manifest.made == {"a.npz": LINE, "a.json": LINE}


@pytest.mark.parametrize("length", [1, 40, 200_000])
def test_half_a_line_is_cut_off(tmp_path, length):
    path = tmp_path / "manifest.jsonl"
    path.write_bytes(LINE.bytes + b"{" + length * b"x")
    with opened(tmp_path) as manifest:
        assert manifest.unreadable == 0
        assert path.read_bytes() == LINE.bytes
        manifest.append(LINE)
    assert path.read_bytes() == 2 * LINE.bytes


def test_half_of_the_only_line_is_cut_off(tmp_path):
    (tmp_path / "manifest.jsonl").write_bytes(LINE.bytes[:30])
    with opened(tmp_path) as manifest:
        assert (manifest.made, manifest.unreadable) == ({}, 0)
    assert (tmp_path / "manifest.jsonl").read_bytes() == b""


def test_spoilt_lines_within_are_counted(tmp_path):
    (tmp_path / "manifest.jsonl").write_bytes(b"\0\0\0\n[1]\n{}\n" + LINE.bytes)
    with opened(tmp_path) as manifest:
        assert manifest.unreadable == 3
        assert len(manifest.made) == 2


def test_a_second_process_is_refused_until_the_first_is_gone(tmp_path):
    process = subprocess.Popen([sys.executable, "-c", HOLD, tmp_path], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout.readline() == "held\n"
        with pytest.raises(FileError, match="for this batch alone; found another batch at work in it"), opened(tmp_path):
            pass
    finally:
        process.kill()
        process.communicate()
    with opened(tmp_path) as manifest:
        manifest.append(LINE)


@pytest.mark.skipif(sys.platform == "win32", reason="no limit on the size of files")
def test_a_full_disk_leaves_whole_lines(tmp_path):
    import resource

    with opened(tmp_path) as manifest:
        manifest.append(LINE)
        before = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (len(LINE.bytes) + 20, before[1]))
        try:
            with pytest.raises(FileError, match=r"to write .*manifest.jsonl; .*start the same batch again"):
                manifest.append(LINE)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, before)
        assert (tmp_path / "manifest.jsonl").read_bytes() == LINE.bytes
        manifest.append(LINE)
    assert len(list(read_lines(tmp_path / "manifest.jsonl"))) == 2


def test_a_manifest_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "manifest.jsonl").mkdir()
    with pytest.raises(FileError, match="a manifest to write at"), opened(tmp_path):
        pass


def test_a_folder_that_is_read_only_is_refused(tmp_path):
    folder = tmp_path
    if os.access(tmp_path, os.W_OK) and not hasattr(os, "geteuid"):
        pytest.skip("no folder is read-only here")
    if os.geteuid() == 0:  # to whom only what is no real folder is read-only
        folder = Path("/proc")
    else:
        folder.chmod(0o555)
    if not folder.exists():
        pytest.skip("no folder is read-only to this user")
    with pytest.raises(FileError, match=r"a manifest to write at .*; choose another output"), opened(folder):
        pass


def test_lines_of_other_folders_are_known_again(tmp_path):
    assert key(tmp_path / "spheres" / "a.npz") == key("elsewhere/spheres/a.npz") != key("elsewhere/a.npz")
