"""The page on the architecture is true: its floors are those that the import linter keeps, and what it names is there."""

import re
import tomllib
from importlib import import_module
from pathlib import Path

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
FLOORS, CHAIN = re.findall(r"^```text\n(.*?)^```", PAGE, flags=re.DOTALL | re.MULTILINE)


def test_floors_are_those_of_the_import_linter() -> None:
    contract = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]["importlinter"]["contracts"][0]
    kept = [[name.strip() for name in layer.split("|")] for layer in contract["layers"] if layer != "__main__"]
    drawn = re.findall(r"^ (\w+(?: \| \w+)*)  ", FLOORS.partition("\n cli ")[2], flags=re.MULTILINE)
    assert [["cli"], *(line.split(" | ") for line in drawn)] == kept


def test_functions_on_the_way_are_there() -> None:
    named = re.findall(r"\b(io|surface|sphere|mapping|motion|report)\.(\w+)\.(\w+)", CHAIN)
    assert len(named) >= 8
    for package, module, name in named:
        assert hasattr(import_module(f"morphlet.{package}.{module}"), name), name
