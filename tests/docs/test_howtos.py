"""The how-tos are true: their Python blocks run as they stand, one after another, and print what the page says they print."""

import re
from pathlib import Path

import pytest

HOWTOS = sorted((Path(__file__).parents[2] / "docs" / "howto").glob("*.md"))
BLOCK = re.compile(r"^```(python|text)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
each_page = pytest.mark.parametrize("page", HOWTOS, ids=lambda page: page.stem)


def test_there_are_how_tos() -> None:
    assert HOWTOS


@each_page
def test_python_blocks_run_in_order(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one namespace and one new folder per page; a text block that follows is what the block before it prints."""
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "howto"}
    blocks = BLOCK.findall(page.read_text(encoding="utf-8"))
    assert blocks, "a how-to shows how"
    assert blocks[0][0] == "python"
    for language, text in blocks:
        if language == "python":
            capsys.readouterr()
            exec(compile(text, page.name, "exec"), names)
        else:
            assert capsys.readouterr().out == text


@each_page
def test_links_lead_somewhere(page: Path) -> None:
    for target in re.findall(r"\]\((?!http)([^)#]+)[^)]*\)", page.read_text(encoding="utf-8")):
        assert (page.parent / target).exists(), target
