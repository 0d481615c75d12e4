"""`--video`: the frames of a morph, an edit and a transfer as a film; what is refused before the work begins."""

import importlib.util
import re

import numpy as np
import pytest
from PIL import Image

from cli.calls import call
from cli.test_verbs import told
from morphlet import MeshSequence, VertexPairs, read, write, write_animation, write_pairs, write_sequence
from morphlet.report.look import Look
from support import blob

BODY = blob(2)
SOME = np.arange(0, BODY.n_vertices, 7)
SMALL = Look((40, 30), "matplotlib")
FFMPEG = pytest.mark.skipif(importlib.util.find_spec("imageio_ffmpeg") is None, reason="imageio-ffmpeg is not installed")


@pytest.fixture
def small(monkeypatch):
    """Films of few pixels."""
    from morphlet.report import film

    drawn = film.film
    monkeypatch.setattr(film, "film", lambda frames, colors: drawn(frames, colors=colors, look=SMALL))


@pytest.fixture
def bodies(tmp_path):
    """A body, the same grown in two steps, and pairs."""
    write(tmp_path / "a.ply", BODY)
    grown = MeshSequence(BODY.topology, np.stack([BODY.vertices, 1.2 * BODY.vertices, 1.5 * BODY.vertices]), [0.0, 1.0, 2.0])
    write(tmp_path / "b.ply", grown[2])
    write_pairs(tmp_path / "p.csv", VertexPairs(SOME, SOME))
    write_sequence(tmp_path / "poses", grown)
    write_animation(tmp_path / "poses.glb", grown, names=("rest", "grown/little", "grown/much"))
    return tmp_path


def frames_of(path):
    with Image.open(path) as film:
        return film.n_frames, film.size


@pytest.mark.parametrize("ending", ["gif", "png"])
def test_a_morph_as_a_film(capsys, bodies, no_drawing, small, ending):
    film = bodies / f"film.{ending}"
    words = ("morph", bodies / "a.ply", bodies / "b.ply", "--pairs", bodies / "p.csv", "--frames", 3, "-o", bodies / "out", "--json")
    result = told(call(capsys, *words, "--video", film), "morph")
    assert str(film) in result["outputs"]
    assert frames_of(film) == (3, (40, 30))


@FFMPEG
def test_an_edit_as_a_film(capsys, bodies, small):
    (bodies / "edit.toml").write_text(
        'method = "laplacian"\nhandle = [0]\nroi = {radius = "40%"}\npath = [{translate = [0, 0, 0.1]}, {translate = [0, 0, 0.2]}]\n'
    )
    film = bodies / "film.mp4"
    told(call(capsys, "deform", bodies / "a.ply", bodies / "edit.toml", "-o", bodies / "out", "--video", film, "--json"), "deform")
    assert film.read_bytes()[4:8] == b"ftyp"


@pytest.mark.parametrize(
    ("poses", "names"), [("poses", ("frame-000", "frame-001", "frame-002")), ("poses.glb", ("rest", "grown_little", "grown_much"))]
)
def test_poses_from_a_folder_or_from_morph_targets(capsys, bodies, small, poses, names):
    words = ("transfer", bodies / "a.ply", bodies / poses, "--to", bodies / "a.ply", "--pairs", bodies / "p.csv", "-o", bodies / "out")
    result = told(call(capsys, *words, "--video", bodies / "film.gif", "--json"), "transfer")
    made = [str(bodies / "out" / f"{name}.ply") for name in names]
    assert result["poses"] == 3
    assert set(result["outputs"]) == {*made, str(bodies / "film.gif")}
    assert frames_of(bodies / "film.gif")[0] == 3
    np.testing.assert_allclose(np.ptp(read(made[2]).vertices, axis=0), 1.5 * np.ptp(BODY.vertices, axis=0), rtol=1e-5)


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        (("--fps", 5), 2, "needed --video for --fps"),
        (("--video", "film.avi"), 4, r"an output ending in \.mp4 or \.gif or \.png"),
        (("--video", "film.gif", "--fps", 0), 2, "a rate from"),
        (("--video", "film.gif", "--fps", 90), 2, "to 50 images a second"),
    ],
)
def test_films_that_cannot_be_are_refused_before_the_work(capsys, bodies, options, code, words):
    answer = call(capsys, "morph", bodies / "a.ply", bodies / "b.ply", "-o", bodies / "out", *options)
    assert answer.code == code
    assert re.search(words, answer.err), answer.err
