"""The table of the paper is true: every function it names exists, every test it names is there."""

import re
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [line.split("|")[1:5] for line in (ROOT / "docs" / "paper.md").read_text(encoding="utf-8").splitlines() if line.startswith("| ")][1:]
NOT_YET = re.compile(r"\*not yet\* \([^)]*\)")
DONE = [(row[0].strip(), name) for row in ROWS for name in re.findall(r"`([a-z_]+\.[A-Za-z_.]+)`", NOT_YET.sub("", row[2]))]
TESTS = sorted({name for row in ROWS for name in re.findall(r"`(tests/[^`]+)`", row[3])})


@pytest.mark.parametrize(("row", "name"), DONE)
def test_functions_exist(row: str, name: str) -> None:
    module, _, attribute = name.rpartition(".")
    home = import_module(f"morphlet.{module}")
    assert hasattr(home, attribute) or import_module(f"morphlet.{name}"), row


@pytest.mark.parametrize("name", TESTS)
def test_tests_exist(name: str) -> None:
    assert (ROOT / name).exists()


def test_rows_not_done_say_so() -> None:
    assert all("not yet" in row[2] or row[3].strip() for row in ROWS)
