"""The pages are true: their Python blocks run as they stand, one after another, and print what the page says they print."""

import os
import re
from functools import partial
from pathlib import Path

import pytest

import morphlet
from morphlet.samples import catalogue

DOCS = Path(__file__).parents[2] / "docs"
HOWTOS, CONCEPTS = sorted((DOCS / "howto").glob("*.md")), sorted((DOCS / "concepts").glob("*.md"))
PAGES = [DOCS / "index.md", DOCS / "tutorial.md", *HOWTOS, *CONCEPTS]
WITHOUT_PYTHON = {DOCS / "index.md", DOCS / "concepts" / "index.md"}
NOUNS = [page for page in CONCEPTS if page.name != "index.md"]
BLOCK = re.compile(r"^```(python|text)\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
SHELL = re.compile(r"^```sh\n(.*?)^```", flags=re.DOTALL | re.MULTILINE)
LARGEST = 60_000
"""Bytes of a picture of a concept."""
LONGEST = 60
"""Lines of a concept's page."""
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.relative_to(DOCS).as_posix())
each_noun = pytest.mark.parametrize("page", NOUNS, ids=lambda page: page.stem)


def test_there_are_how_tos_and_concepts() -> None:
    assert HOWTOS
    assert NOUNS


def public_meshes(page: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """What a page fetches comes from the folder of public meshes, with its checksum; without one the page is not run."""
    if "fetch(" in page:
        folder = os.environ.get("MORPHLET_DATA")
        if not folder:
            pytest.skip("set MORPHLET_DATA to the folder of public test meshes")
        monkeypatch.setattr(catalogue, "fetch", partial(catalogue.fetch, mirror=folder))


@each_page
def test_python_blocks_run_in_order(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In one namespace and one new folder per page; a text block after a Python block is what that prints, and no print goes untold."""
    text = page.read_text(encoding="utf-8")
    public_meshes(text, monkeypatch)
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "page"}
    told = ""
    for language, block in BLOCK.findall(text):
        if language == "python":
            assert not told, f"printed, but not on the page: {told}"
            exec(compile(block, page.name, "exec"), names)
            told = capsys.readouterr().out
        elif told:
            assert told == block
            told = ""
    assert not told, f"printed, but not on the page: {told}"


@each_page
def test_how_tos_and_concepts_show_python(page: Path) -> None:
    assert page in WITHOUT_PYTHON or "```python" in page.read_text(encoding="utf-8")


@each_page
def test_shell_lines_name_verbs_and_options_that_there_are(page: Path) -> None:
    from morphlet.cli import main

    for line in re.findall(
        r"^morphlet (batch [a-z-]+|\w+)(.*)$", "\n".join(SHELL.findall(page.read_text(encoding="utf-8"))), flags=re.MULTILINE
    ):
        verb, rest = line[0], line[1].partition("#")[0]
        told = helped(main, verb)
        for option in re.findall(r"(?<= )--[a-z-]+", rest):
            assert option in told, f"morphlet {verb} {option}"


def helped(main, verb: str) -> str:
    """What `morphlet VERB --help` says."""
    from contextlib import redirect_stdout
    from io import StringIO

    out = StringIO()
    with redirect_stdout(out):
        assert main([*verb.split(), "--help"]) == 0
    return out.getvalue()


@each_noun
def test_concepts_are_short_and_say_what_when_and_where(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= LONGEST
    places = [text.find(part) for part in ("# ", "![", "**When.** ", "```python", "**Reference.** ")]
    assert places == sorted(places)
    assert places[0] == 0


@each_noun
def test_each_concept_has_a_small_picture_of_its_own(page: Path) -> None:
    (shown,) = re.findall(r"!\[[^]]+\]\(\.\./pictures/(concept-[\w-]+\.png)\)", page.read_text(encoding="utf-8"))
    assert shown == f"concept-{page.stem}.png"
    assert (DOCS / "pictures" / shown).stat().st_size <= LARGEST


def test_every_picture_of_a_concept_is_shown() -> None:
    assert {path.stem for path in (DOCS / "pictures").glob("concept-*.png")} == {f"concept-{page.stem}" for page in NOUNS}


def test_the_table_of_concepts_leads_to_every_page() -> None:
    rows = re.findall(r"^\| .*\]\(([\w-]+)\.md\) \|$", (DOCS / "concepts" / "index.md").read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(rows) == sorted(page.stem for page in NOUNS)


def test_concepts_name_only_what_there_is() -> None:
    for page in NOUNS:
        for name in re.findall(r"\[(\w+)\]\(#morphlet\.(\w+)\)", page.read_text(encoding="utf-8")):
            assert name[0] == name[1]
            assert name[0] in morphlet.__all__
