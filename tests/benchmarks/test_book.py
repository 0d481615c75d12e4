"""The benchmark book: tables, the machine, the run of scripts one after the other, and that no script is forgotten."""

import argparse
import ast
import importlib.util
import json
import sys
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
GOOD = '''
"""A script that finds two figures.

More about it."""
import argparse
from book import Sheet, Table, add_options
parser = argparse.ArgumentParser()
parser.add_argument("--data")
parser.add_argument("--scale", type=float, default=1.0)
add_options(parser)
chosen = parser.parse_args()
sheet = Sheet.of(chosen)
sheet.miss("rival", "not installed")
sheet.add(Table("Speed", ["tool", "ms"], [["ours", f"{1.5 * chosen.scale:.2f}"], ["theirs", 3]], "Medians.", ["a remark"]))
'''
BAD = GOOD + "raise SystemExit(3)\n"
MUTE = '"""It breaks at once."""\n1 / 0\n'

if not FOLDER.exists():
    pytest.skip("benchmarks are not here", allow_module_level=True)


def loaded(name: str) -> ModuleType:
    """A file of the benchmarks."""
    spec = importlib.util.spec_from_file_location(f"benchmarks_{name}", FOLDER / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def bench() -> ModuleType:
    """The harness; what it puts on the path is taken off."""
    before = list(sys.path)
    yield loaded("__main__")
    sys.path[:] = before


@pytest.fixture(scope="module")
def book() -> ModuleType:
    return loaded("book")


@pytest.fixture(scope="module")
def machine() -> ModuleType:
    return loaded("machine")


@pytest.fixture
def script(tmp_path, monkeypatch):
    """Writes a script that finds `book`."""
    monkeypatch.setenv("PYTHONPATH", str(FOLDER))

    def write(name: str, text: str) -> Path:
        path = tmp_path / f"{name}.py"
        path.write_text(text)
        return path

    return write


# Tables


def test_columns_and_markdown(book):
    rows = [["a", 1, 0.123456], ["long name", None]]
    assert book.table(["x", "y", "z"], rows, False) == "x          y  z\na          1  0.1235\nlong name\n"
    assert book.table(["x", "y", "z"], rows, True) == "| x | y | z |\n| --- | --- | --- |\n| a | 1 | 0.1235 |\n| long name |  |\n"


def test_text_of_a_table(book):
    found = book.Table("Speed", ["tool", "ms"], [["ours", "1.50"]], "Medians.", ["a remark"])
    assert found.text() == "Speed\n\nMedians.\n\ntool  ms\nours  1.50\n\n- a remark\n"
    assert found.text(markdown=True) == "### Speed\n\nMedians.\n\n| tool | ms |\n| --- | --- |\n| ours | 1.50 |\n\n- a remark\n"
    assert book.Table("Nothing", [], [], notes=["failed"]).text() == "Nothing\n\n\n- failed\n"


NUMBERS = {"12": 12, "-0.50": -0.5, "2e-07": 2e-7, 3: 3, 0.25: 0.25, float("nan"): None, None: None}
WORDS = ("1.5 (0.9)", "nan", "inf", "1_000", "", "bunny.off")


@pytest.mark.parametrize(("cell", "value"), [*NUMBERS.items(), *zip(WORDS, WORDS, strict=True)])
def test_numbers_in_cells_are_numbers_for_programs(book, cell, value):
    found = book.plain(cell)
    assert found == value
    assert type(found) is type(value)


def test_a_record_goes_through_json_and_back(book):
    found = book.Table("Speed", ["tool", "ms"], [["ours", "1.50"], ["theirs", 3]], "Medians.", ["a remark"])
    record = json.loads(json.dumps(found.record()))
    assert record["rows"] == [["ours", 1.5], ["theirs", 3]]
    assert book.Table.of(record).text() == found.text()


def test_rows_by_name(book):
    found = book.keyed("Bytes", [{"mesh": "cat", "ours": 5}, {"mesh": "dog", "theirs": 0.5}])
    assert found.heads == ["mesh", "ours", "theirs"]
    assert found.rows == [["cat", 5, "-"], ["dog", "-", 0.5]]


def test_a_sheet_prints_and_writes_as_it_goes(book, tmp_path, capsys):
    parser = argparse.ArgumentParser()
    book.add_options(parser)
    file = tmp_path / "found.json"
    sheet = book.Sheet.of(parser.parse_args(["--json", str(file), "--markdown"]))
    sheet.add(book.Table("One", ["x"], [[1]]))
    assert [table["title"] for table in json.loads(file.read_text())["tables"]] == ["One"]
    sheet.figures["more"] = [1, 2]
    sheet.add(book.Table("Two", ["x"], [[2]]))
    sheet.miss("rival", "not installed")
    sheet.miss("rival", "not installed")
    found = json.loads(file.read_text())
    assert [table["title"] for table in found["tables"]] == ["One", "Two"]
    assert (found["figures"], found["absent"]) == ({"more": [1, 2]}, {"rival": "not installed"})
    assert capsys.readouterr().out.count("rival") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["found.json"]


def test_commands_hide_this_machine(book):
    words = [
        "/some/where/benchmarks/editing.py",
        "--data",
        "/some/where/data",
        "--json",
        "/x/y.json",
        "--markdown",
        "--tools",
        "a b*",
        "--rounds",
        "3",
    ]
    assert book.command(words) == "python benchmarks/editing.py --data DIR --tools 'a b*' --rounds 3"


# The machine


def test_this_machine(machine, monkeypatch):
    monkeypatch.setenv("OPENBLAS_NUM_THREADS", "1")
    found = machine.this_machine()
    assert found.cpu
    assert found.cores >= 1
    assert found.python == ".".join(map(str, sys.version_info[:3]))
    assert found.libraries["morphlet"] != machine.ABSENT
    assert set(found.peers) == {*machine.PEERS, "CGAL"}
    assert all(found.peers.values())
    assert found.threads["OPENBLAS_NUM_THREADS"] == "1"
    assert {len(line) for line in found.lines()} == {2}


def test_a_peer_that_is_not_there_is_named_as_absent(machine, monkeypatch, tmp_path):
    monkeypatch.setattr(machine, "PEERS", ("numpy", "no-such-package-anywhere"))
    monkeypatch.setattr(machine, "CGAL", tmp_path / "version.h")
    monkeypatch.delenv(machine.PEER_PYTHON, raising=False)
    found = machine.peers()
    assert found["numpy"] != "absent"
    assert (found["no-such-package-anywhere"], found["CGAL"]) == ("absent", "absent")
    (tmp_path / "version.h").write_text("#define CGAL_VERSION 5.5.1\n#define CGAL_VERSION_NR 1050511000\n")
    assert machine.cgal() == "5.5.1"


def test_peers_of_another_interpreter(machine, monkeypatch, tmp_path):
    twin = tmp_path / "python"
    twin.write_text("""#!/bin/sh\necho '{"open3d": "0.19.0", "viser": null}'\n""")
    twin.chmod(0o755)
    monkeypatch.setattr(machine, "PEERS", ("open3d", "viser", "numpy"))
    monkeypatch.setattr(machine, "versions", lambda names: dict.fromkeys(names))
    monkeypatch.setenv(machine.PEER_PYTHON, str(twin))
    assert {name: machine.peers()[name] for name in machine.PEERS} == {"open3d": "0.19.0", "viser": "absent", "numpy": "absent"}
    assert machine.elsewhere(str(tmp_path / "nobody")) == {}


def test_another_interpreter_is_really_asked(machine, monkeypatch):
    monkeypatch.setattr(machine, "PEERS", ("numpy", "no-such-package-anywhere"))
    monkeypatch.setattr(sys, "executable", "elsewhere")
    found = machine.elsewhere(str(Path(sys.prefix, "bin", "python")))
    assert found["numpy"] == machine.versions(("numpy",))["numpy"]
    assert found["no-such-package-anywhere"] is None


# The run


def test_a_script_is_run_and_bound(bench, script, tmp_path, capsys):
    found = bench.run(script("fast", GOOD), ["--scale", "2"], tmp_path)
    assert (found.name, found.about, found.exit_code) == ("fast", "A script that finds two figures.", 0)
    assert found.command == "python benchmarks/fast.py --scale 2"
    assert found.tables[0]["rows"] == [["ours", 3], ["theirs", 3]]
    assert found.absent == {"rival": "not installed"}
    assert "ours    3.00" in capsys.readouterr().out
    assert "ours    3.00" in (tmp_path / "fast.txt").read_text()


def test_a_script_that_fails_keeps_what_it_had(bench, script, tmp_path):
    found = bench.run(script("bad", BAD), [], tmp_path)
    assert found.exit_code == 3
    assert len(found.tables) == 1
    assert "It failed (exit code 3)" in found.text()


def test_figures_of_an_earlier_run_are_not_bound(bench, script, tmp_path):
    bench.run(script("fast", GOOD), [], tmp_path)
    found = bench.run(script("fast", MUTE), [], tmp_path)
    assert (found.exit_code, found.tables) == (1, [])
    assert found.command == "python benchmarks/fast.py"


def test_the_whole_book(bench, script, tmp_path, monkeypatch):
    names = [script(name, text).stem for name, text in (("bad", MUTE), ("fast", GOOD), ("left_out", GOOD))]
    monkeypatch.setattr(bench, "HERE", tmp_path)
    monkeypatch.setenv(bench.DATA, "somewhere")
    quick = {"bad": (), "fast": ("--scale", "2"), "left_out": None}
    monkeypatch.setattr(bench, "SCRIPTS", tuple(bench.Script(name, quick=quick[name]) for name in names))
    monkeypatch.setattr(sys, "argv", ["benchmarks", "--quick", "--out", str(tmp_path / "out")])
    assert bench.main() == 1
    record = json.loads((tmp_path / "out" / "bench.json").read_text())
    assert [(one["name"], one["exit_code"]) for one in record["scripts"]] == [("bad", 1), ("fast", 0)]
    assert {"cpu", "cores", "load_at_start", "load_at_end", "peers"} <= set(record["machine"])
    assert (record["quick"], record["public_meshes"]) == (True, False)
    text = (tmp_path / "out" / "bench.md").read_text()
    assert text.startswith("# The benchmark book\n\n")
    assert "\n\nA quick run" in text
    assert "| ours | 3.00 |" in text
    assert "| fast |" in text
    assert "done; absent: rival" in text
    assert "failed (1)" in text
    assert str(tmp_path) not in text


def test_a_book_is_made_in_several_runs(bench, script, tmp_path, monkeypatch):
    names = [script(name, GOOD).stem for name in ("one", "two")]
    out = tmp_path / "out"
    monkeypatch.setattr(bench, "HERE", tmp_path)
    monkeypatch.setenv(bench.DATA, "somewhere")
    monkeypatch.setattr(bench, "SCRIPTS", tuple(bench.Script(name) for name in names))

    def chapters(*words: str) -> list[str]:
        monkeypatch.setattr(sys, "argv", ["benchmarks", *words, "--out", str(out)])
        assert bench.main() == 0
        return [one["name"] for one in json.loads((out / "bench.json").read_text())["scripts"]]

    assert chapters("two") == ["two"]
    assert chapters("one") == ["one", "two"]
    assert chapters("one") == ["one", "two"]
    assert chapters("two", "--quick") == ["two"]
    other = json.loads((out / "bench.json").read_text())
    other["machine"]["cores"] += 1
    (out / "bench.json").write_text(json.dumps(other))
    assert chapters("one", "--quick") == ["one"]
    assert chapters() == ["one", "two"]


def test_names_are_checked_and_keep_their_order(bench):
    assert [one.name for one in bench.wanted(["motion", "editing"], False)] == ["editing", "motion"]
    assert "first_run" not in [one.name for one in bench.wanted([], True)]
    with pytest.raises(SystemExit, match="no such benchmark: edting"):
        bench.wanted(["edting"], False)


# The scripts


def mains() -> set[str]:
    """Files that do something when they are run."""
    return {path.stem for path in FOLDER.glob("*.py") if '__name__ == "__main__"' in path.read_text()}


def test_every_script_is_in_the_book_or_excused(bench):
    listed = [script.name for script in bench.SCRIPTS]
    assert len(listed) == len(set(listed))
    assert set(listed) | set(bench.EXCUSED) == mains()
    assert not set(listed) & set(bench.EXCUSED)


def test_every_script_of_the_book_says_what_it_is_and_writes_json(bench):
    for script in bench.SCRIPTS:
        text = (FOLDER / f"{script.name}.py").read_text()
        assert bench.about(FOLDER / f"{script.name}.py"), script.name
        called = {node.func.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)}
        assert "add_options" in called, script.name
        assert f"python benchmarks/{script.name}.py" in text, script.name


@pytest.mark.parametrize("what", ["full", "quick"])
def test_arguments_in_the_book_exist(bench, what):
    for script in bench.SCRIPTS:
        text = (FOLDER / f"{script.name}.py").read_text()
        for word in getattr(script, what) or ():
            name = word.removeprefix("--")
            assert not word.startswith("--") or f'"{word}"' in text or f'"{name}"' in text, (script.name, word)
