"""The README is true: its Python example runs as it stands."""

import re
from pathlib import Path

import pytest

from morphlet import read

README = Path(__file__).parents[1] / "README.md"


def test_python_examples_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    said = []
    for example in re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), flags=re.DOTALL):
        exec(compile(example, "README.md", "exec"), {})
        said.append(capsys.readouterr().out)
    assert re.match(r"True 2\.\d+\n0 \(\)\n", said[0])
    assert read("halfway.ply").n_vertices == 7000
    assert said[1].startswith("{'mexican_hat': ")


def test_its_pictures_and_pages_exist() -> None:
    for target in re.findall(r"\]\((?!http)([^)]+)\)|`(docs/[^`]+)`", README.read_text(encoding="utf-8")):
        assert (README.parent / (target[0] or target[1])).exists(), target
