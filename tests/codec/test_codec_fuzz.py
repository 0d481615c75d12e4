"""A short run of the fuzzer that `benchmarks/codec_fuzz.py` is: nothing is read in silence, nothing breaks."""

import importlib.util
import sys
from pathlib import Path

import pytest

PROGRAM = Path(__file__).parents[2] / "benchmarks" / "codec_fuzz.py"
TRIED = 60


def test_no_damaged_or_forged_file_is_read_in_silence():
    if not PROGRAM.exists():
        pytest.skip("benchmarks/codec_fuzz.py is not here")
    spec = importlib.util.spec_from_file_location("codec_fuzz", PROGRAM)
    program = importlib.util.module_from_spec(spec)
    sys.modules["codec_fuzz"] = program
    spec.loader.exec_module(program)
    counts = program.fuzz(600.0, 1, TRIED)
    assert (counts["tried"], counts["wrong"]) == (TRIED, 0)
    assert counts["refused"] > TRIED / 2
