"""The same input gives the same arrays, bit for bit: once more, and on one thread or two."""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cli.calls import call
from morphlet import Mesh, read, sample, write
from morphlet.cli import main
from morphlet.numerics import threads
from support import blob, bumpy

EDIT = """
method = "{method}"
handle = {{center = {top}, radius = "4%"}}
roi = {{radius = "60%"}}
translate = [0.0, 0.1, 0.2]
"""
METHODS = ("arap", "rotations", "laplacian", "biharmonic", "direct", "mls", "ffd")
TIMES = {"seconds", "cpu_seconds", "prepare_seconds", "frame_seconds", "pose_seconds", "outputs", "jobs"}
"""Keys of results that may differ."""
SIZE = 3600
"""Vertices: more than where kernels begin to use several threads."""
WHOLE = "MORPHLET_DETERMINISM_VERTICES" in os.environ
"""Whether the verbs that take longest are tried on meshes of this size, too: that takes minutes."""
LONG = ("match", "correspond", "morph", "transfer", "shape", "mlwnn", "reconstruct", "carry", "decode", "batch")
MADE = (
    ("approximate", "pose-1.ply", "--wavelets", "8", "-o", "rows.npz"),
    ("correspond", "a.ply", "pose-1.ply", "-o", "map.npz"),
    ("encode", "a.ply", "pose-1.ply", "--error", "0.1%", "-o", "moves.mlw"),
)
"""What makes the files that some verbs read."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Two folders of meshes, large and small; in both an edit by each method."""
    made = tmp_path_factory.mktemp("same")
    star = bumpy(level=3)
    fill(made / "large", sample("grazer", n_vertices=SIZE), sample("predator", n_vertices=SIZE))
    if WHOLE:
        size = int(os.environ["MORPHLET_DETERMINISM_VERTICES"])
        fill(made / "small", sample("grazer", n_vertices=size), sample("predator", n_vertices=size))
    else:
        fill(made / "small", star, star.with_vertices(star.vertices * [1, 1.2, 0.9]))
    with contextlib.chdir(made / "small"):
        np.save("heights.npy", read("pose-1.ply").vertices[:, 2])
        assert [main([*words, "--quiet"]) for words in MADE] == [0] * len(MADE)
    return made


def fill(made: Path, first: Mesh, second: Mesh) -> None:
    """These meshes, poses of the first, and edits of it."""
    made.mkdir()
    write(made / "a.ply", first)
    write(made / "b.ply", second)
    write(made / "ball.ply", blob(4 if WHOLE else 3))
    for k in (1, 2):
        write(made / f"pose-{k}.ply", first.with_vertices(first.vertices * [1, 1 + 0.1 * k, 1]))
    top = first.vertices[np.argmax(first.vertices[:, 2])].tolist()
    for method in METHODS:
        (made / f"{method}.toml").write_text(EDIT.format(method=method, top=top))


CALLS = {
    "info": ("info", "a.ply"),
    "repair": ("repair", "a.ply", "-o", "OUT.ply"),
    "compare": ("compare", "a.ply", "pose-1.ply"),
    "sample": ("sample", "grazer", "-o", "OUT.ply"),
    "sphere": ("sphere", "a.ply", "-o", "OUT.npz"),
    "image": ("image", "a.ply", "--size", "65", "-o", "OUT.npz"),
    "approximate": ("approximate", "pose-1.ply", "--wavelets", "8", "-o", "OUT.npz"),
    "regions": ("regions", "a.ply", "-o", "OUT.npz"),
    "match": ("match", "a.ply", "b.ply", "-o", "OUT.csv"),
    "correspond": ("correspond", "a.ply", "b.ply", "-o", "OUT.npz"),
    "morph": ("morph", "a.ply", "pose-2.ply", "--frames", "3", "-o", "OUT"),
    "transfer": ("transfer", "a.ply", "pose-1.ply", "pose-2.ply", "--to", "pose-2.ply", "-o", "OUT"),
    "reconstruct": ("reconstruct", "rows.npz", "-o", "OUT.ply"),
    "carry": ("carry", "a.ply", "pose-1.ply", "map.npz", "--attribute", "heights.npy", "-o", "OUT.npz"),
    "decode": ("decode", "moves.mlw", "-o", "OUT"),
    "batch": ("batch", "sphere", "a.ply", "pose-1.ply", "-o", "OUT"),
    "encode": ("encode", "a.ply", "pose-1.ply", "pose-2.ply", "--error", "0.1%", "-o", "OUT.mlw"),
    "shape": ("encode", "ball.ply", "--rms", "1%", "--mode", "shape", "-o", "OUT.mlw"),
    "mlwnn": ("encode", "ball.ply", "--mode", "mlwnn", "--size", "200", "-o", "OUT.mlw"),
    **{method: ("deform", "a.ply", f"{method}.toml", "-o", "OUT.ply") for method in METHODS},
}


def content(out: Path) -> dict[str, object]:
    """Arrays of an output, or its bytes; of folders, of each file but reports and pictures, which tell times."""
    if out.is_dir():
        kept = [path for path in sorted(out.rglob("*")) if path.suffix in (".ply", ".npz", ".glb", ".csv")]
        return {f"{path.name}:{key}": value for path in kept for key, value in content(path).items()}
    if out.suffix == ".npz":
        with np.load(out, allow_pickle=False) as found:
            return {key: found[key].tobytes() for key in found.files}
    return {"": out.read_bytes()}


def told(result: dict[str, object]) -> str:
    """All of a result but times."""
    return json.dumps({key: value for key, value in result.items() if key not in TIMES}, sort_keys=True)


@pytest.mark.parametrize("verb", CALLS)
def test_the_same_arrays_once_more_and_on_other_threads(verb, folder, capsys, monkeypatch, no_drawing):
    place = folder / ("small" if verb in LONG else "large")
    monkeypatch.chdir(place)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    found = []
    for k, count in enumerate((1, 2)):
        name = f"{verb}-{k}"
        words = [word.replace("OUT", name) for word in CALLS[verb]]
        answer = call(capsys, *words, "--json", "--quiet", "--threads", count)
        assert answer.code in (0, 1), answer.err
        outputs = [place / word for word in words if word.startswith(name)]
        found.append((told(answer.result).replace(name, ""), [content(path) for path in outputs]))
    assert found[0] == found[1]


def test_two_threads_are_two(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    with threads.limited(2):
        assert threads.available() == 2


SHOWN = """
import hashlib, sys
from morphlet.cli import main
code = main(sys.argv[1:])
import numpy as np
a = np.random.default_rng(0).normal(size=(1500, 700))
print(hashlib.sha256((a.T @ a).tobytes()).hexdigest())
"""


def test_the_command_line_does_not_depend_on_the_number_of_cores(folder):
    environment = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", SHOWN, "deform", str(folder / "large" / "a.ply"), str(folder / "large" / "mls.toml"), "--quiet", "-o"]
    shown = []
    for k in (1, 2):
        out = folder / f"cores-{k}.ply"
        limited = environment if k == 2 else environment | {"OPENBLAS_NUM_THREADS": "1"}
        shown.append(
            (subprocess.run([*words, str(out)], env=limited, check=True, capture_output=True).stdout, read(out).vertices.tobytes())
        )
    assert shown[0] == shown[1]
