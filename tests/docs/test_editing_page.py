"""The page on editing is true: its Python runs, its lines for the file ask for the same as its Python, its links and pictures are there."""

import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from morphlet import read_edit
from morphlet.editing.editor import RoiEditor

PAGE = Path(__file__).parents[2] / "docs" / "editing.md"
TEXT = PAGE.read_text(encoding="utf-8")
BLOCK = re.compile(r"^```(python|toml)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
TITLES = re.findall(r"^#+ (.*)$", TEXT, flags=re.MULTILINE)


def sections() -> Iterator[tuple[str, list[str], list[str]]]:
    """Title, Python blocks and blocks for the file of every section."""
    for part in re.split(r"^#+ ", TEXT, flags=re.MULTILINE)[1:]:
        blocks = BLOCK.findall(part)
        yield part.splitlines()[0], [text for kind, text in blocks if kind == "python"], [text for kind, text in blocks if kind == "toml"]


def test_python_and_file_ask_for_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    compared, region = [], ""
    for title, python, told in sections():
        for text in python:
            exec(compile(text, title, "exec"), names)
        region = region or told[0]
        for lines in told:
            Path("edit.toml").write_text(region if lines == region else region + lines, encoding="utf-8")
            wanted = read_edit("edit.toml", names["grazer"])
            found = RoiEditor.prepare(wanted.roi, wanted.method).solve(wanted.pulls[0].targets, wanted.pulls[0].turns)
            np.testing.assert_allclose(found.vertices, names["edited"].vertices, atol=1e-6, err_msg=title)
            compared.append(title)
    assert len(compared) == 13


def test_every_method_has_a_picture_of_its_own() -> None:
    pictures = re.findall(r"\]\(pictures/(editing-\w+\.png)\)", TEXT)
    assert sorted(set(pictures)) == sorted(pictures) == sorted(path.name for path in (PAGE.parent / "pictures").glob("editing-*.png"))


def test_links_lead_somewhere() -> None:
    anchors = {re.sub(r"[^\w -]", "", title.lower()).replace(" ", "-") for title in TITLES}
    for file, anchor in re.findall(r"\]\((?!http)([^)#]*)(?:#([^)]*))?\)", TEXT):
        assert (PAGE.parent / file).exists(), file
        assert file or anchor in anchors, anchor
