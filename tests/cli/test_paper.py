"""The verb of the paper: its keys, its files, what it does when something cannot be made."""

import pytest

from cli.calls import call
from morphlet.paper import book
from morphlet.paper.book import ENTRIES, Entry

HEAD = ["verb", "inputs", "outputs", "seconds", "cpu_seconds"]


def some(*names: str) -> list[Entry]:
    return [entry for entry in ENTRIES if entry.name in names]


def broken(stock):
    raise ArithmeticError("nothing to divide")


@pytest.fixture
def empty(tmp_path):
    """A folder without meshes."""
    folder = tmp_path / "no meshes"
    folder.mkdir()
    return folder


def test_keys_and_files(capsys, tmp_path, empty, monkeypatch):
    monkeypatch.setattr(book, "ENTRIES", some("Equations", "Table 1", "Figure 6"))
    answer = call(capsys, "paper", "-o", tmp_path / "out", "--data", empty, "--vertices", 1500, "--json")
    assert answer.code == 0, answer.err
    result = answer.result
    assert list(result)[:5] == HEAD
    assert (result["verb"], result["tables"], result["figures"]) == ("paper", ["Table 1"], ["Figure 6"])
    assert (result["equations"], result["failed"]) == (True, [])
    made = {str(file.relative_to(tmp_path / "out")) for file in (tmp_path / "out").rglob("*") if file.is_file()}
    assert made == {"report.html", "figures/figure-6.png", *(f"tables/{n}.{e}" for n in ("equations", "table-1") for e in ("csv", "json"))}
    assert sorted(result["outputs"]) == sorted(str(tmp_path / "out" / name) for name in made)


def test_a_failure_is_told_and_the_rest_goes_on(capsys, tmp_path, empty, monkeypatch):
    monkeypatch.setattr(book, "ENTRIES", [Entry("Table 2", "broken", broken), *some("Figure 6")])
    answer = call(capsys, "paper", "-o", tmp_path / "out", "--data", empty, "--vertices", 1500, "--json")
    assert answer.code == 1
    assert "Table 2: ArithmeticError: nothing to divide" in answer.err
    assert answer.result["failed"] == [{"name": "Table 2", "error": "ArithmeticError: nothing to divide"}]
    assert (answer.result["tables"], answer.result["figures"]) == ([], ["Figure 6"])
    assert "nothing to divide" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_the_folder_is_named_by_the_environment(capsys, tmp_path, empty, monkeypatch):
    monkeypatch.setattr(book, "ENTRIES", some("Figure 6"))
    monkeypatch.setenv("MORPHLET_DATA", str(tmp_path / "nowhere"))
    answer = call(capsys, "paper", "-o", tmp_path / "out")
    assert answer.code == 2
    assert "needed a folder of public meshes; found" in answer.err
    monkeypatch.setenv("MORPHLET_DATA", str(empty))
    assert call(capsys, "paper", "-o", tmp_path / "out", "--vertices", 1500).code == 0
    assert "grazer, procedural" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")


def test_usage(capsys, tmp_path, empty):
    answer = call(capsys, "paper", "-o", tmp_path / "out", "--data", empty, "--picture", tmp_path / "p.png")
    assert (answer.code, "no --picture for paper" in answer.err) == (2, True)
    answer = call(capsys, "paper", "-o", tmp_path / "out", "--data", empty, "--vertices", 5)
    assert answer.code == 2
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "file").touch()
    assert call(capsys, "paper", "-o", tmp_path / "full", "--data", empty).code == 4
