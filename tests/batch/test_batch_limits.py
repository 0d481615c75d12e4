"""What items may take, and how many fit."""

import os

import pytest

from morphlet import InputError
from morphlet.batch import limits
from morphlet.batch.limits import Limits, available_memory, expected_memory, fitting, parse_size


@pytest.mark.parametrize(("text", "size"), [("800MB", 800e6), ("1.5 gb", 1.5e9), ("300000000", 3e8), ("2T", 2e12), ("7kB", 7000)])
def test_sizes(text, size):
    assert parse_size(text) == size


@pytest.mark.parametrize("text", ["", "GB", "-1GB", "1.5XB", "much"])
def test_texts_that_are_no_size(text):
    with pytest.raises(InputError, match=r"a size such as 800MB or 1.5GB"):
        parse_size(text)


def test_no_more_at_once_than_memory_holds(monkeypatch):
    monkeypatch.setattr(limits, "available_memory", lambda: 10 * 10**9)
    assert [fitting(3 * 10**9, jobs) for jobs in (1, 3, 8)] == [1, 3, 3]
    assert fitting(20 * 10**9, 4) == 1
    monkeypatch.setattr(limits, "cores", lambda: 2)
    assert fitting(3 * 10**9) == 2
    monkeypatch.setattr(limits, "available_memory", lambda: None)
    assert fitting(3 * 10**9, 8) == 8
    with pytest.raises(InputError, match="1 job or more; found 0"):
        fitting(1, 0)


def test_a_container_has_less_than_its_machine(monkeypatch, tmp_path):
    most, used = tmp_path / "max", tmp_path / "current"
    most.write_text("5000000\n")
    used.write_text("2000000\n")
    monkeypatch.setattr(limits, "GROUPS", (most, used))
    assert available_memory() == 3_000_000
    most.write_text("max\n")
    free = available_memory()
    assert free is None or free > 3_000_000


def test_larger_files_need_more():
    assert expected_memory([]) == expected_memory([0]) < expected_memory([10**6]) < expected_memory([10, 10**7])


@pytest.mark.parametrize(
    ("seconds", "memory", "match"),
    [
        (0.0, None, "above 0 seconds"),
        (float("nan"), None, "above 0 seconds"),
        (None, 10**6, "a memory limit of 400 MB or more; found 1 MB"),
    ],
)
def test_limits_that_nothing_meets(seconds, memory, match):
    with pytest.raises(InputError, match=match):
        Limits(seconds, memory)


@pytest.mark.skipif(os.name == "nt", reason="there are limits elsewhere")
def test_where_there_are_no_limits_they_are_refused(monkeypatch):
    monkeypatch.setattr(limits, "limits_memory", lambda: False)
    with pytest.raises(InputError, match="a system that limits memory"):
        Limits(None, 10**9)
