"""The pages on editing are true: their Python runs, their lines for the file ask for the same as their Python, their pictures are there."""

import re
from pathlib import Path

import numpy as np
import pytest

from morphlet import Mesh, read_edit
from morphlet.editing.editor import RoiEditor

DOCS = Path(__file__).parents[2] / "docs"
INDEX = DOCS / "editing" / "index.md"
PAGES = sorted(set(INDEX.parent.glob("*.md")) - {INDEX})
each_page = pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)

Names = dict[str, object]


def blocks(page: Path, language: str) -> list[str]:
    """What stands between fences of a language."""
    return re.findall(rf"^```{language}\n(.*?)^```", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.MULTILINE)


def run(page: Path, names: Names) -> Names:
    """The page's Python, in these names."""
    for text in blocks(page, "python"):
        exec(compile(text, page.name, "exec"), names)
    return names


def edited_by(lines: str, mesh: Mesh) -> Mesh:
    """What a file makes of the mesh."""
    Path("edit.toml").write_text(lines, encoding="utf-8")
    wanted = read_edit("edit.toml", mesh)
    return RoiEditor.prepare(wanted.roi, wanted.method).solve(wanted.pulls[0].targets, wanted.pulls[0].turns)


@pytest.fixture(scope="module")
def begun(tmp_path_factory: pytest.TempPathFactory) -> Names:
    """What is there after the lines of the index, with which all pages go on."""
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(tmp_path_factory.mktemp("index"))
        names = run(INDEX, {"__name__": "page"})
        (region,) = blocks(INDEX, "toml")
        found = edited_by(region, names["grazer"])
    np.testing.assert_allclose(found.vertices, names["edited"].vertices, atol=1e-6)
    return names | {"region": region}


@each_page
def test_python_and_file_ask_for_the_same(page: Path, begun: Names, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    names = run(page, dict(begun))
    assert names["edited"] is not begun["edited"]
    (lines,) = blocks(page, "toml")
    found = edited_by(names["region"] + lines, names["grazer"])
    np.testing.assert_allclose(found.vertices, names["edited"].vertices, atol=1e-6)


@each_page
def test_pages_say_what_for_and_at_what_cost(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    places = [text.find(part) for part in ("# ", "![", "**For** ", "**Not for** ", "```python", "**Cost.** ")]
    assert places == sorted(places)
    assert places[0] == 0


def test_the_table_leads_to_every_page() -> None:
    rows = re.findall(r"^\| \[[^]]+\]\((.*?)\.md\)", INDEX.read_text(encoding="utf-8"), flags=re.MULTILINE)
    assert sorted(rows) == [page.stem for page in PAGES]


def test_every_picture_is_shown_once() -> None:
    text = "".join(page.read_text(encoding="utf-8") for page in (INDEX, *PAGES))
    shown = re.findall(r"\]\(\.\./pictures/(editing-[\w-]+\.png)\)", text)
    assert sorted(shown) == sorted(path.name for path in (DOCS / "pictures").glob("editing-*.png"))
