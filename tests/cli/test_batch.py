"""`batch`: verbs over many meshes give what they give over one, and can be stopped, killed and taken up again."""

import json
import os
import re
import signal
import sys
import time

import numpy as np
import pytest

from cli.calls import call, finished, start
from morphlet import read, write
from morphlet.batch.all_pairs import distance
from morphlet.cli import many
from morphlet.sphere.map import SphericalMap
from support import blob, noisy, tetrahedron, torus

KEYS = ["verb", "inputs", "outputs", "seconds", "cpu_seconds", "done", "failed", "skipped", "jobs", "failures"]
ONE = ("--jobs", 1, "--json")


@pytest.fixture
def meshes(tmp_path):
    """A folder of a body, another, and one that has no spherical map."""
    folder = tmp_path / "in"
    folder.mkdir()
    write(folder / "body.ply", blob(2))
    write(folder / "other.ply", noisy(2, 0.2))
    write(folder / "ring.ply", torus())
    return folder


def told(folder):
    lines = [json.loads(line) for line in (folder / "manifest.jsonl").read_text("utf-8").splitlines()]
    return {os.path.basename(line["input"]): line for line in lines}


def counts(answer):
    return tuple(answer.result[key] for key in ("done", "failed", "skipped"))


def test_a_batch_gives_what_the_verb_gives_and_goes_on(capsys, tmp_path, meshes):
    out = tmp_path / "out"
    answer = call(capsys, "batch", "sphere", meshes, "-o", out, *ONE)
    assert (answer.code, list(answer.result)) == (1, KEYS)
    assert counts(answer) == (2, 1, 0)
    assert answer.result["outputs"] == [str(out / "manifest.jsonl")]
    assert sorted(path.name for path in out.iterdir()) == ["body.json", "body.npz", "manifest.jsonl", "other.json", "other.npz"]
    assert call(capsys, "sphere", meshes / "body.ply", "-o", tmp_path / "one.npz").code == 0
    body = read(meshes / "body.ply")
    one, many = (SphericalMap.load(path, body).points for path in (tmp_path / "one.npz", out / "body.npz"))
    np.testing.assert_array_equal(one, many)
    result = json.loads((out / "body.json").read_text("utf-8"))
    assert (result["verb"], result["inverted"], result["outputs"]) == ("sphere", 0, [str(out / "body.npz")])
    lines = told(out)
    assert {name: line["status"] for name, line in lines.items()} == {"body.ply": "done", "other.ply": "done", "ring.ply": "failed"}
    assert "genus" in lines["ring.ply"]["error"]
    assert lines["body.ply"]["parameters"] == {
        **{"verb": "sphere", "p": 1.0, "weights": "uniform", "balance": None, "component": "all", "cut_handles": 0, "seed": 0}
    }  # fmt: skip
    assert lines["body.ply"]["peak_memory_mb"] is None or 50 < lines["body.ply"]["peak_memory_mb"] < 2000
    write(meshes / "ring.ply", tetrahedron())
    again = call(capsys, "batch", "sphere", meshes, "-o", out, *ONE)
    assert (again.code, *counts(again)) == (0, 1, 0, 2)
    refused = call(capsys, "batch", "sphere", meshes, "-o", out, "--p", 0.5, *ONE)
    assert refused.code == 4
    assert "body.npz made with another p; choose another folder, or add --force" in refused.result["error"]["message"]
    assert counts(call(capsys, "batch", "sphere", meshes / "body.ply", "-o", out, "--p", 0.5, "--force", *ONE)) == (1, 0, 0)
    assert told(out)["body.ply"]["parameters"]["p"] == 0.5


@pytest.mark.parametrize(
    ("verb", "options", "ending", "keys"),
    [
        ("encode", ("--bits", 10, "--keep-order"), ".mlw", {"mode", "bytes", "rms"}),
        ("approximate", ("--wavelets", 3, "--size", 17, "--mothers", "beta2,mexican_hat"), ".npz", {"mse", "wavelets"}),
        ("regions", ("--most", 2), ".npz", {"regions", "core"}),
    ],
)
def test_other_verbs(capsys, tmp_path, meshes, verb, options, ending, keys):
    answer = call(capsys, "batch", verb, meshes / "body.ply", "-o", tmp_path / "out", *options, *ONE)
    assert (answer.code, *counts(answer)) == (0, 1, 0, 0)
    assert call(capsys, verb, meshes / "body.ply", "-o", tmp_path / f"one{ending}", *options).code == 0
    assert (tmp_path / "out" / f"body{ending}").stat().st_size == (tmp_path / f"one{ending}").stat().st_size
    assert keys <= json.loads((tmp_path / "out" / "body.json").read_text("utf-8")).keys()


def test_correspond_brings_all_to_one_target(capsys, tmp_path, meshes):
    (tmp_path / "pairs").mkdir()
    (tmp_path / "pairs" / "other.csv").write_text("source,target\n0,0\n1,1\n2,2\n40,40\n")
    words = ("batch", "correspond", meshes / "other.ply", meshes / "ring.ply", "--to", meshes / "body.ply", "--pairs", tmp_path / "pairs")
    answer = call(capsys, *words, "-o", tmp_path / "out", *ONE)
    assert (answer.code, *counts(answer)) == (1, 1, 1, 0)
    pairs = ("--pairs", tmp_path / "pairs" / "other.csv")
    assert call(capsys, "correspond", meshes / "other.ply", meshes / "body.ply", *pairs, "-o", tmp_path / "one.npz").code == 0
    with np.load(tmp_path / "one.npz") as one, np.load(tmp_path / "out" / "other.npz") as many:
        for name in ("faces", "weights"):
            np.testing.assert_array_equal(one[name], many[name])
    line = told(tmp_path / "out")["other.ply"]
    assert (line["parameters"]["to"], len(line["parameters"]["to_fingerprint"]), len(line["parameters"]["pairs"])) == ("body.ply", 64, 64)
    assert counts(call(capsys, *words, "-o", tmp_path / "out", *ONE)) == (0, 1, 1)


def test_stored_spheres_are_taken(capsys, tmp_path, meshes, monkeypatch):
    a, b = meshes / "other.ply", meshes / "body.ply"
    spheres = tmp_path / "a.npz", tmp_path / "b.npz"
    for mesh, sphere in zip((a, b), spheres, strict=True):
        assert call(capsys, "sphere", mesh, "-o", sphere).code == 0
    assert call(capsys, "correspond", a, b, "-o", tmp_path / "made.npz").code == 0
    monkeypatch.setattr("morphlet.sphere.map.map_surface", lambda *_: pytest.fail("made again"))
    answer = call(capsys, "correspond", a, b, "--a-sphere", spheres[0], "--b-sphere", spheres[1], "-o", tmp_path / "taken.npz", "--json")
    assert answer.result["inputs"] == [str(path) for path in (a, b, *spheres)]
    with np.load(tmp_path / "made.npz") as made, np.load(tmp_path / "taken.npz") as taken:
        np.testing.assert_array_equal(made["weights"], taken["weights"])
    swapped = call(capsys, "correspond", a, b, "--a-sphere", spheres[1], "-o", tmp_path / "never.npz")
    assert swapped.code == 4
    assert "found the map of another mesh" in swapped.err


def test_people_are_told_how_far_it_is(capsys, tmp_path, meshes, monkeypatch):
    seen = []
    monkeypatch.setattr(many, "_tell", lambda run, text, share, left: seen.append((text, share, left is None)))
    call(capsys, "batch", "regions", meshes / "body.ply", meshes / "other.ply", "-o", tmp_path / "out", "--jobs", 1, "--quiet")
    assert seen == [("regions 1/2", 0.5, False), ("regions 2/2", 1.0, False)]
    seen.clear()
    call(capsys, "batch", "regions", meshes / "body.ply", "-o", tmp_path / "out", "--jobs", 1, "--quiet")
    assert seen == [("regions 1/1", 1.0, True)]


def test_a_target_without_a_spherical_map_ends_the_batch(capsys, tmp_path, meshes):
    answer = call(capsys, "batch", "correspond", meshes / "other.ply", "--to", meshes / "ring.ply", "-o", tmp_path / "out", *ONE)
    assert answer.code == 3
    assert re.search(r"a spherical map of .*ring.ply; found .*genus", answer.result["error"]["message"])


def test_all_pairs(capsys, tmp_path, meshes):
    write(meshes / "twin.ply", blob(2).with_vertices(blob(2).vertices * 2.0))
    out = tmp_path / "out"
    answer = call(capsys, "batch", "all-pairs", meshes, "-o", out, *ONE)
    assert (answer.code, *counts(answer)) == (1, 3 + 3, 1 + 3, 0)
    assert (answer.result["meshes"], answer.result["pairs"]) == (4, 3)
    assert sorted(path.name for path in (out / "spheres").glob("*.npz")) == ["body.npz", "other.npz", "twin.npz"]
    assert sorted(path.stem for path in (out / "pairs").glob("*.npz")) == ["body--other", "body--twin", "other--twin"]
    with np.load(out / "distances.npz", allow_pickle=False) as file:
        names, found = file["names"].tolist(), file["distances"]
    assert names == ["body", "other", "ring", "twin"]
    assert np.isnan(found[2, [0, 1, 3]]).all()
    energy = json.loads((out / "pairs" / "body--other.json").read_text("utf-8"))["energy"]
    assert found[0, 1] == found[1, 0] == distance(energy) > 0.2
    assert found[0, 3] < 0.1
    assert found[0, 1] == pytest.approx(found[3, 1], abs=0.1)
    assert (out / "embedding.png").stat().st_size > 1000
    failures = [line for line in map(json.loads, (out / "manifest.jsonl").open(encoding="utf-8")) if line["status"] == "failed"]
    assert sum(line["error"].startswith("no spherical map of") for line in failures) == 3
    (meshes / "ring.ply").unlink()
    (out / "pairs" / "other--twin.npz").unlink()
    again = call(capsys, "batch", "all-pairs", meshes, "-o", out, "--picture", tmp_path / "p.png", *ONE)
    assert (again.code, *counts(again)) == (0, 1, 0, 5)
    assert (tmp_path / "p.png").exists()


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="memory is limited on Linux")
def test_memory_limits(capsys, tmp_path, meshes):
    write(meshes / "large.ply", noisy(6, 0.1))
    answer = call(
        capsys, "batch", "sphere", meshes / "large.ply", meshes / "body.ply", "-o", tmp_path / "out", "--memory-limit", "420MB", *ONE
    )
    lines = told(tmp_path / "out")
    assert counts(answer) == (1, 1, 0)
    assert lines["body.ply"]["status"] == "done"
    assert re.search("enough memory|its memory limit was 420 MB", lines["large.ply"]["error"])


WRONG = [
    (("sphere", "-o", "{}/out"), 2, "at least one mesh; found none"),
    (("sphere", "{}/in/body.ply", "{}/in", "-o", "{}/out"), 2, "inputs of different stems; found .*body.ply and .*body.ply"),
    (("sphere", "{}/in", "-o", "{}/in"), 4, "to be empty, new, or of an earlier batch; found files in it"),
    (("sphere", "{}/in", "-o", "{}/out", "--jobs", "0"), 2, "1 job or more"),
    (("sphere", "{}/in", "-o", "{}/out", "--jobs", "1", "--scheduler", "tcp://127.0.0.1:9"), 2, "--jobs or --scheduler; found both"),
    (("sphere", "{}/in", "-o", "{}/out", "--memory-limit", "much"), 2, "a size such as"),
    (("sphere", "{}/in", "-o", "{}/out", "--time-limit", "0"), 2, "a time limit above 0"),
    (("sphere", "{}/in", "-o", "{}/out", "--picture", "{}/p.png"), 2, "no --picture for many meshes"),
    (("sphere", "{}/in", "-o", "{}/out", "--permutation", "x"), 2, "Unknown option: --permutation"),
    (("sphere", "{}/in", "-o", "{}/out", "--component", "some"), 2, "Invalid value|choose from"),
    (("correspond", "{}/in", "-o", "{}/out"), 2, "--to requires an argument"),
    (("correspond", "{}/in", "--to", "{}/in/body.ply", "--pairs", "{}/in/body.ply", "-o", "{}/out"), 4, "a folder of pairs"),
    (("all-pairs", "{}/in/body.ply", "-o", "{}/out"), 2, "2 meshes or more; found 1"),
    (("morph", "{}/in", "-o", "{}/out"), 2, 'Unknown command "morph"'),
]


@pytest.mark.parametrize(("words", "code", "match"), WRONG)
def test_what_cannot_be_is_refused_before_the_work(capsys, tmp_path, meshes, words, code, match):
    answer = call(capsys, "batch", *(word.format(tmp_path) for word in words), "--json")
    assert answer.code == answer.result["exit_code"] == code
    assert re.search(match, answer.err)
    assert not (tmp_path / "out").exists()
    assert len(list(meshes.iterdir())) == 3


def test_options_that_no_json_holds(capsys, tmp_path, meshes):
    answer = call(capsys, "batch", "sphere", meshes / "body.ply", "-o", tmp_path / "out", "--p", "nan", *ONE)
    assert (answer.code, *counts(answer)) == (1, 0, 1, 0)
    assert told(tmp_path / "out")["body.ply"]["parameters"]["p"] is None


@pytest.mark.parametrize("verb", ["sphere", "correspond", "encode", "approximate", "regions", "all-pairs"])
def test_help_explains_every_option(capsys, verb):
    answer = call(capsys, "batch", verb, "--help")
    assert answer.code == 0
    rows = [line.strip("│ ") for line in answer.out.splitlines() if line.startswith("│")]
    assert not [row for row in rows if row.lstrip("* ").startswith("--") and len(row.split()) < 3]
    assert all(option in answer.out for option in ("--jobs", "--scheduler", "--time-limit", "--memory-limit", "--output -o", "--json"))


@pytest.fixture
def slow(tmp_path):
    """A folder of meshes that take about a second each."""
    folder = tmp_path / "slow"
    folder.mkdir()
    for k in range(3):
        write(folder / f"m{k}.ply", noisy(4, 0.1, seed=k))
    return folder


LISTENING = (
    "import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); "
    "from morphlet.cli import main; sys.exit(main(sys.argv[1:]))"
)
"""The command line, for which Ctrl-C counts even where these tests run in the background of a shell that ignores it."""


def one_done(out):
    deadline = time.monotonic() + 120
    while not (out / "manifest.jsonl").exists() or not (out / "manifest.jsonl").stat().st_size:
        assert time.monotonic() < deadline
        time.sleep(0.02)


@pytest.mark.skipif(sys.platform == "win32", reason="signals are otherwise there")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGKILL])
def test_a_batch_that_is_stopped_goes_on_where_it_was(capsys, tmp_path, slow, ending):
    out = tmp_path / "out"
    process = start("batch", "sphere", slow, "-o", out, *ONE, prefix=("-c", LISTENING))
    one_done(out)
    process.send_signal(signal.SIGSTOP)  # the others wait, however long the next lines take
    second = call(capsys, "batch", "sphere", slow, "-o", out, *ONE)
    assert second.code == 4
    assert "found another batch at work in it" in second.err
    process.send_signal(ending)
    process.send_signal(signal.SIGCONT)
    answer = finished(process)
    before = (out / "manifest.jsonl").read_bytes().count(b"\n")
    assert 1 <= before < 3
    if ending == signal.SIGINT:
        assert answer.code == answer.result["exit_code"] == 130
        assert f"a request to stop, {before} of 3 items told; start the same again: what is done is kept" in answer.err
        assert not list(out.glob(".morphlet-*"))
    again = call(capsys, "batch", "sphere", slow, "-o", out, *ONE)
    assert (again.code, *counts(again)) == (0, 3 - before, 0, before)
    assert sorted(path.name for path in out.iterdir()) == [
        *(f"m{k}.{e}" for k in range(3) for e in ("json", "npz")),
        "manifest.jsonl",
    ]
