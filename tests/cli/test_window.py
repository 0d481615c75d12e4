"""`studio`: it tells its address, answers who knows the token, and ends when it is interrupted."""

import importlib.util
import json
import re
import signal
import urllib.error
import urllib.request

import pytest

from cli.calls import call, start
from morphlet import write
from support import blob

needs_studio = pytest.mark.skipif(importlib.util.find_spec("uvicorn") is None, reason="the extra 'studio' is not installed")


def status(url):
    """What a server answers to a request."""
    try:
        with urllib.request.urlopen(url, timeout=60) as answer:
            return answer.status
    except urllib.error.HTTPError as error:
        return error.code


@needs_studio
def test_it_serves_until_it_is_interrupted(tmp_path):
    write(tmp_path / "a.ply", blob(2))
    process = start("studio", tmp_path / "a.ply", "--no-browser", "--json")
    try:
        line = next(text for text in process.stderr if "http://" in text)
        url = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", line).group()
        assert status(url.split("?")[0]) == 403
        assert status(url) != 403  # but what, if the page has not been built?
    finally:
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=60)
    assert process.returncode == 0
    assert json.loads(out)["inputs"] == [str(tmp_path / "a.ply")]


@needs_studio
def test_what_cannot_be_is_refused(capsys, tmp_path):
    write(tmp_path / "a.ply", blob(1))
    for words, code, match in (
        (["missing.ply"], 4, "a mesh file at"),
        ([tmp_path / "a.ply"] * 3, 2, "at most two meshes"),
        ([tmp_path / "a.ply", "--picture", tmp_path / "p.png"], 2, "no --picture for studio"),
        ([tmp_path / "a.ply", "--port", 70000], 2, "port"),
        ([tmp_path / "a.ply", "--host", "no.such.host.invalid"], 4, "no.such.host.invalid"),
    ):
        answer = call(capsys, "studio", *words, "--no-browser")
        assert (answer.code, match in answer.err) == (code, True), answer.err
