"""Each equation has its check, the checks hold, and one that does not is told."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from morphlet.editing import moving_least_squares
from morphlet.paper import equations, page
from morphlet.paper.book import ENTRIES, Entry, make
from morphlet.paper.equations import EQUATIONS, Check
from morphlet.paper.subjects import Stock, Subject


@pytest.fixture(scope="module")
def horse(tmp_path_factory: pytest.TempPathFactory) -> Subject:
    return Stock(tmp_path_factory.mktemp("no meshes"), 1500, rows=33).horse


def test_there_is_one_for_each() -> None:
    assert [equation.__name__ for equation in EQUATIONS] == [f"equation_{k}" for k in range(1, 13)]


@pytest.mark.parametrize("equation", EQUATIONS)
def test_it_holds(equation, horse: Subject) -> None:
    check = equation(horse)
    assert equation.__name__ == f"equation_{check.equation}"
    assert check.holds, check


@pytest.mark.parametrize(("found", "holds"), [(2.0, True), (2.0 + 1e-9, True), (2.1, False), (np.nan, False), (np.inf, False)])
def test_a_check_is_as_strict_as_it_says(found: float, holds: bool) -> None:
    assert Check(9, "two", 2.0, found, "").holds is holds


def test_a_wrong_field_breaks_the_first_two(horse: Subject, monkeypatch: pytest.MonkeyPatch) -> None:
    true = moving_least_squares.MovingField.__call__
    monkeypatch.setattr(moving_least_squares.MovingField, "__call__", lambda self, targets: true(self, targets) + 1e-6)
    assert not equations.equation_1(horse).holds
    assert not equations.equation_2(horse).holds


def test_a_broken_equation_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    wrong = replace(Check(3, "three", 3.0, 4.0, ""))
    monkeypatch.setattr(equations, "EQUATIONS", (lambda subject: wrong,))
    made = make(Entry("Equations", "all", ENTRIES[0].make), Stock(tmp_path, 1500), tmp_path)
    assert made.exhibit is not None
    assert made.broken == ("(3)",)
    assert not made.ok
    assert "Does not hold: (3)" in page.text_of([made], [])
