"""Every table and figure is made, on small procedural objects; their numbers say what they must."""

import base64
import csv
import io
import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from morphlet.paper import page
from morphlet.paper.book import ENTRIES, Entry, Made, make
from morphlet.paper.exhibit import slug
from morphlet.paper.subjects import FEW, Stock
from morphlet.pipeline.correspond import correspond_maps
from morphlet.report.page import PNG
from morphlet.samples.creatures import landmarks
from morphlet.surface.pairs import VertexPairs
from morphlet.wavenet.mothers import PAPER_SIX

ROWS = 33
"""Of the geometry images: enough to see that tables hold together."""
VOID = {"meta", "img"}


@pytest.fixture(scope="module")
def stock(tmp_path_factory: pytest.TempPathFactory) -> Stock:
    """Small stand-ins for everything; animals are matched by their landmarks, which is quicker than by their regions."""
    small = Stock(tmp_path_factory.mktemp("no meshes"), 1500, rows=ROWS)
    grazer, predator = (np.array(list(landmarks(species, 1500).values())) for species in ("grazer", "predator"))
    ends = small.horse.sphere, small.camel.sphere
    vars(small)["horse_to_camel"] = correspond_maps(*ends, VertexPairs(grazer, predator))
    vars(small)["cat_to_lion"] = correspond_maps(small.cat.sphere, small.lion.sphere, VertexPairs(predator, grazer))
    return small


@pytest.fixture(scope="module")
def made(stock: Stock, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Made]]:
    """The folder of all files, and what became of each entry."""
    folder = tmp_path_factory.mktemp("paper")
    return folder, {entry.name: make(entry, stock, folder) for entry in ENTRIES}


def column(found: Made, name: str) -> list:
    """The values of a column of an exhibit's table."""
    assert found.exhibit is not None
    assert found.exhibit.table is not None
    return [record[name] for record in found.exhibit.table.records]


def test_the_book_holds_every_table_and_figure() -> None:
    expected = ["Equations", *(f"Table {k}" for k in range(1, 8)), *(f"Figure {k}" for k in range(1, 17))]
    assert [entry.name for entry in ENTRIES] == expected


def test_everything_is_made(made: tuple[Path, dict[str, Made]]) -> None:
    assert {name: one.failure or one.broken for name, one in made[1].items() if not one.ok} == {}
    assert all(one.exhibit and (one.exhibit.plates or one.exhibit.table) for one in made[1].values())


def test_files_hold_what_the_tables_hold(made: tuple[Path, dict[str, Made]]) -> None:
    folder, found = made
    for name, one in found.items():
        table = one.exhibit.table if one.exhibit else None
        if table is None:
            assert not (folder / "tables" / f"{slug(name)}.csv").exists()
            continue
        text = (folder / "tables" / f"{slug(name)}.csv").read_text(encoding="utf-8")
        lines = list(csv.reader(io.StringIO(text)))
        assert tuple(lines[0]) == table.heads
        assert [line[0] for line in lines[1:]] == [str(row[0]) for row in table.rows]
        told = json.loads((folder / "tables" / f"{slug(name)}.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
        assert told["rows"] == json.loads(json.dumps(table.records))
    pictures = sorted((folder / "figures").iterdir())
    assert len(pictures) == sum(len(one.exhibit.plates) for one in found.values() if one.exhibit)
    assert all(file.read_bytes().startswith(PNG) for file in pictures)


def test_table_1_tells_the_stand_ins(made: tuple[Path, dict[str, Made]]) -> None:
    found = made[1]["Table 1"]
    assert column(found, "here") == [f"{name}, procedural" for name in ("grazer", "predator", "spiky", "blob")] + [
        "predator, procedural, decimated"
    ]
    assert column(found, "vertices") == [1500] * 4 + [FEW]
    assert column(found, "faces")[-1] == 2 * FEW - 4


def test_more_wavelets_come_nearer(made: tuple[Path, dict[str, Made]]) -> None:
    assert column(made[1]["Table 2"], "wavelets") == list(range(5, 55, 5))
    for name in ("Horse", "Cat", "Bunny", "Face"):
        totals, errors = (column(made[1]["Table 2"], f"{name} 1500: {what}") for what in ("sum of distances", "MSE"))
        assert totals[0] > 1.7 * totals[-1] > 0  # the grid of so few rows leaves the rest
        assert errors[0] > 2 * errors[-1]
        assert (np.diff(totals[:4]) < 0).all()


def test_table_3_has_each_mother_the_six_and_ours(made: tuple[Path, dict[str, Made]]) -> None:
    names = column(made[1]["Table 3"], "library")
    assert names[:6] == [f"{psi.name} alone" for psi in PAPER_SIX]
    assert sum("ours" in name for name in names) == 3
    errors = dict(zip(names, column(made[1]["Table 3"], "Horse: MSE"), strict=True))
    chosen, moved, growing = errors["the six together (the paper's)"], *(errors[name] for name in names if "moved" in name)
    assert growing < moved < chosen
    assert errors["the six together (the paper's)"] < min(errors[name] for name in names[:6])
    assert all(rate > 0 for rate in column(made[1]["Table 3"], "Horse: frames/s, networks trained in each")[:-1])


@pytest.mark.parametrize("name", ["Table 4", "Table 5", "Table 6", "Table 7"])
def test_counts_add_up(name: str, made: tuple[Path, dict[str, Made]]) -> None:
    assert column(made[1][name], "mother") == [psi.name for psi in PAPER_SIX]
    assert sum(column(made[1][name], "one network of 15")) == 15
    assert sum(column(made[1][name], "mean per row")) == pytest.approx(sum(column(made[1][name], "all rows")) / ROWS)
    assert 14 < sum(column(made[1][name], "mean per row")) < 15 + 1e-9


def test_the_papers_own_counts_stand_beside_the_horse_only(made: tuple[Path, dict[str, Made]]) -> None:
    assert sum(column(made[1]["Table 4"], "the paper")) == 15
    assert "the paper" not in made[1]["Table 5"].exhibit.table.heads  # type: ignore[union-attr]


def test_the_larger_region_is_more_global(made: tuple[Path, dict[str, Made]]) -> None:
    free = column(made[1]["Figure 3"], "free vertices")
    assert free[0] < free[1]


def test_ways_around_come_near_the_direct_edit(made: tuple[Path, dict[str, Made]]) -> None:
    ways, apart = (column(made[1]["Figure 9"], name) for name in ("way", "mean distance from the edit frame by frame, %"))
    assert len(ways) == 8
    for way, distance in zip(ways, apart, strict=True):
        if way == "original":
            assert distance > 0.1
        elif "directly" in way:
            assert distance < 0.2
        else:
            assert 1e-4 < distance < 8


def test_every_sphere_is_one_to_one(made: tuple[Path, dict[str, Made]]) -> None:
    assert column(made[1]["Figure 11"], "inverted") == [0] * 7
    assert column(made[1]["Figure 11"], "degree") == pytest.approx([1.0] * 7)


def test_the_object_at_rest_is_not_strained(made: tuple[Path, dict[str, Made]]) -> None:
    for name in ("Figure 13", "Figure 14", "Figure 15", "Figure 16"):
        assert column(made[1][name], "edge strain %")[0] == 0
        assert all(value > 0 for value in column(made[1][name], "edge strain %")[1:])


class Reader(HTMLParser):
    """Checks that what opens closes, and gathers text, tags and attributes."""

    def __init__(self) -> None:
        super().__init__()
        self.open, self.text, self.attributes, self.tags = [], [], [], []  # type: ignore[var-annotated]

    def handle_starttag(self, tag: str, attrs: list) -> None:
        self.tags.append(tag)
        self.attributes += attrs
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


def test_the_report_holds_everything_and_needs_nothing(made: tuple[Path, dict[str, Made]], tmp_path: Path) -> None:
    page.write(tmp_path / "report.html", list(made[1].values()), [("Horse", "horse.obj")])
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    reader = Reader()
    reader.feed(text)
    assert not reader.open
    assert not {"script", "link", "iframe"} & set(reader.tags)
    assert not re.search(r"https?:|url\(", text)
    sources = [value for name, value in reader.attributes if name == "src"]
    pictures = [base64.b64decode(source.removeprefix("data:image/png;base64,")) for source in sources]
    assert pictures == [plate.png for one in made[1].values() if one.exhibit for plate in one.exhibit.plates]
    told = "".join(reader.text)
    for one in made[1].values():
        assert one.entry.title in told
        assert one.exhibit is not None
        assert one.exhibit.caption in told
        assert all(remark in told for remark in one.exhibit.remarks)
    names = {value for name, value in reader.attributes if name == "id"}
    assert {value[1:] for name, value in reader.attributes if name == "href"} == names == {slug(name) for name in made[1]}


def test_a_failure_is_told_and_the_rest_stays(tmp_path: Path) -> None:
    def broken(stock: Stock) -> None:
        raise ZeroDivisionError("no <data>")

    lost = make(Entry("Table 0", "nothing", broken), Stock(tmp_path), tmp_path)  # type: ignore[arg-type]
    assert not lost.ok
    assert "ZeroDivisionError: no &lt;data&gt;" in page.text_of([lost], [])
    assert "0 of 1 exhibits; failed: Table 0" in page.text_of([lost], [])
    assert list(tmp_path.iterdir()) == []
