"""Outputs: whole or not there, replaced only when asked, nothing left behind."""

import json
import os
import re
import signal
import time

import numpy as np
import pytest

from cli.calls import call, finished, start
from mapping.stars import blob
from morphlet import read, warm, write
from support import noisy


@pytest.fixture
def ball(tmp_path):
    path = tmp_path / "ball.ply"
    write(path, blob(2))
    return path


def listing(folder):
    return sorted(path.relative_to(folder).as_posix() for path in folder.rglob("*"))


def test_an_existing_output_is_kept_without_force(capsys, tmp_path, ball):
    (tmp_path / "s.npz").write_text("mine")
    answer = call(capsys, "sphere", ball, "-o", tmp_path / "s.npz", "--json")
    assert answer.code == answer.result["exit_code"] == 4
    assert set(answer.result["error"]) == {"message", "needed", "found", "advice", "elements"}
    assert "s.npz not to exist; found a file of that name; choose another output or add --force" in answer.err
    assert (tmp_path / "s.npz").read_text() == "mine"
    assert call(capsys, "sphere", ball, "-o", tmp_path / "s.npz", "--force", "--quiet").code == 0
    assert np.load(tmp_path / "s.npz", allow_pickle=False)["points"].shape == (162, 3)


def test_a_mesh_may_replace_itself_when_forced(capsys, ball):
    before = read(ball)
    assert call(capsys, "repair", ball, "-o", ball, "--force").code == 0
    assert read(ball).fingerprint == before.fingerprint


REFUSED = [
    (("sphere", "-o", "{}/none/s.npz"), "the folder of .*none/s.npz to exist; found no such folder; create it first"),
    (("sphere", "-o", "{}"), "a file name as output"),
    (("sphere", "-o", "{}/s.obj"), "an output ending in .npz; found .*s.obj"),
    (("sphere", "-o", "{}/s.npz", "--picture", "{}/s.npz"), "an output ending in .png"),
    (("image", "-o", "{}/s.png", "--picture", "{}/s.png"), "different outputs"),
    (("image", "-o", "{}/s.jpg"), "an output ending in .png or .npz"),
    (("sphere", "-o", "{}/s.npz", "--picture", "{}/taken.png"), "taken.png not to exist"),
    (("repair", "-o", "{}/s.xyz"), "an output ending in .ply or .obj or .off or .stl or .glb"),
    (("repair", "-o", "{}/taken.png/s.ply"), "the folder of .* to exist"),
    (("correspond", "{}/ball.ply", "-o", "{}/c.csv"), "an output ending in .npz"),
    (("morph", "{}/ball.ply", "-o", "{}/taken.png"), "a folder as output"),
    (("morph", "{}/ball.ply", "-o", "{}/taken.png/sub"), "a folder as output .*; found the file .*taken.png"),
    (("morph", "{}/ball.ply", "-o", "{}"), "to be empty or new; found files in it; choose another folder or add --force"),
]


@pytest.mark.parametrize(("words", "match"), REFUSED)
def test_outputs_that_cannot_be_are_refused_before_the_work(capsys, tmp_path, ball, monkeypatch, words, match):
    monkeypatch.setattr("morphlet.sphere.map.map_surface", lambda *_: pytest.fail("the work began"))
    (tmp_path / "taken.png").write_text("mine")
    verb, *rest = (word.format(tmp_path) for word in words)
    answer = call(capsys, verb, ball, *rest, "--json")
    assert answer.code == answer.result["exit_code"] == 4
    assert re.search(match, answer.result["error"]["message"])
    assert listing(tmp_path) == ["ball.ply", "taken.png"]
    assert (tmp_path / "taken.png").read_text() == "mine"


def test_a_device_is_no_output(capsys, ball):
    if not os.path.exists("/dev/null"):
        pytest.skip("no such device here")
    assert call(capsys, "repair", ball, "-o", "/dev/null", "--force").code == 4
    assert not os.path.isfile("/dev/null")


@pytest.mark.parametrize("failure", [KeyboardInterrupt, MemoryError, OSError(28, "No space left on device")])
def test_a_late_failure_leaves_nothing(capsys, tmp_path, ball, monkeypatch, failure):
    """The picture comes after the map was written: neither may stay."""

    def fail(_):
        raise failure

    monkeypatch.setattr("morphlet.report.sheet.sphere_picture", fail)
    answer = call(capsys, "sphere", ball, "-o", tmp_path / "s.npz", "--picture", tmp_path / "p.png", "--json")
    assert answer.code == answer.result["exit_code"] == {KeyboardInterrupt: 130, MemoryError: 2}.get(failure, 4)
    assert len(answer.err.splitlines()) == 1
    assert listing(tmp_path) == ["ball.ply"]


def test_frames_of_an_earlier_morph_go_and_other_files_stay(capsys, tmp_path, ball, no_drawing):
    out = tmp_path / "out"
    assert call(capsys, "morph", ball, ball, "-o", out, "--frames", 3, "--format", "obj", "--quiet").code == 0
    for mine in ("notes.txt", "frame-1-notes.txt", "frame-007.ply"):
        (out / mine).write_text("mine")
    answer = call(capsys, "morph", ball, ball, "-o", out, "--frames", 2, "--force", "--json")
    assert answer.code == 0
    made = {"frame-000.ply", "frame-001.ply", "morph.glb", "contact-sheet.png", "report.html", "result.json"}
    assert set(listing(out)) == made | {"notes.txt", "frame-1-notes.txt"}
    assert answer.result["outputs"] == [str(out / name) for name in sorted(made)]
    assert json.loads((out / "result.json").read_text("utf-8"))["outputs"] == answer.result["outputs"]


def test_quiet_says_nothing_and_json_only_the_object(capsys, tmp_path, ball):
    answer = call(capsys, "correspond", ball, ball, "-o", tmp_path / "c.npz", "--quiet")
    assert (answer.code, answer.out, answer.err) == (0, "", "")
    answer = call(capsys, "correspond", ball, ball, "-o", tmp_path / "c.npz", "--quiet", "--json", "--force")
    assert (answer.result["verb"], answer.err) == ("correspond", "")


def test_relative_outputs_stay_where_the_caller_is(capsys, tmp_path, ball, monkeypatch, no_drawing):
    monkeypatch.chdir(tmp_path)
    assert call(capsys, "repair", "ball.ply", "-o", "b.off", "--json").result["outputs"] == ["b.off"]
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    assert call(capsys, "morph", "../ball.ply", "../b.off", "-o", ".", "--frames", 2, "--quiet").code == 0
    assert "frame-001.ply" in listing(tmp_path / "here")
    assert not [name for name in listing(tmp_path) if "morphlet" in name]


def test_threads_do_not_change_a_bit(capsys, tmp_path):
    write(tmp_path / "a.ply", noisy(4, 0.2))
    for count in (1, 2):
        assert call(capsys, "sphere", tmp_path / "a.ply", "-o", tmp_path / f"{count}.npz", "--threads", count, "--quiet").code == 0
    points = [np.load(tmp_path / f"{count}.npz", allow_pickle=False)["points"] for count in (1, 2)]
    np.testing.assert_array_equal(*points)


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent as a POSIX signal")
def test_ctrl_c_in_the_middle_leaves_nothing(tmp_path):
    if not warm.compiled():
        warm.compile_kernels()
    write(tmp_path / "big.ply", noisy(6, 0.3))
    listening = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler); "
    process = start(
        "sphere", "big.ply", "-o", "s.npz", "--json", cwd=tmp_path,
        prefix=("-c", f"{listening}from morphlet.cli import main; raise SystemExit(main())"),
    )  # fmt: skip
    while process.poll() is None and not list(tmp_path.glob(".morphlet-*")):
        time.sleep(0.02)
    time.sleep(1.0)
    assert process.poll() is None, "the map was made before it could be interrupted"
    process.send_signal(signal.SIGINT)
    answer = finished(process)
    assert answer.code == answer.result["exit_code"] == 130
    assert answer.err == "morphlet sphere: interrupted; nothing was written\n"
    assert listing(tmp_path) == ["big.ply"]


@pytest.mark.parametrize("words", [("info", "ball.ply"), ("info", "ball.ply", "--json"), ("info", "gone.ply", "--json"), ("--help",)])
def test_a_reader_that_leaves_early_is_no_error(tmp_path, ball, words):
    process = start(*words, cwd=tmp_path)
    process.stdout.close()
    process.wait(timeout=60)
    error = process.stderr.read()
    process.stderr.close()
    assert "Traceback" not in error
    assert "BrokenPipe" not in error
