"""The range coder: what was written is read, at about the price that its chances say, and no loop outlives its bytes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet.codec import range_coder as rc
from morphlet.codec.shuffle import CONTEXTS, MIXERS, code_numbers
from morphlet.numerics.compiled import kernel

KIND = np.int64(0)


@kernel
def code_bits(coder, bits):  # bits (k,), int64, under one context
    for i in range(bits.shape[0]):
        bits[i] = rc.code_bit(coder, bits[i], 0, 0, 0, 0)


def written_numbers(values: np.ndarray, room: int = 1 << 16) -> bytes:
    coder = rc.writer(room, CONTEXTS, MIXERS)
    code_numbers(coder, values.copy(), KIND)
    assert not rc.full(coder)
    return rc.written(coder)


def test_chances_are_far_from_ties_of_their_rounding():
    exact = [65536 / (1 + math.exp(-x / 256)) for x in range(-2047, 2048)]
    assert min(abs(abs(v - math.floor(v)) - 0.5) for v in exact) > 1e-6
    assert rc.SQUASH[2047] == 32768
    assert np.array_equal(rc.SQUASH[::-1] + rc.SQUASH, np.full(4095, 65536))


def test_log_odds_undo_chances():
    middle = rc.SQUASH[rc.STRETCH + 2047]
    assert np.abs(middle[8:-8] - (np.arange(8, 4088) * 16 + 8)).max() <= 65


@given(st.lists(st.integers(-(2**39), 2**39), max_size=40))
def test_numbers_come_back(numbers):
    values = np.array(numbers, np.int64)
    data = written_numbers(values)
    coder, found = rc.reader(data, CONTEXTS, MIXERS), np.zeros(len(values), np.int64)
    code_numbers(coder, found, KIND)
    assert np.array_equal(found, values)
    assert rc.consumed(coder)


@pytest.mark.parametrize(("chance", "most"), [(0.5, 1.02), (0.1, 1.05), (0.01, 1.12)])
def test_decisions_cost_their_entropy(chance, most):
    """And what learning the chance takes, over and over: it is a mean over some 255 decisions."""
    bits = (np.random.default_rng(0).random(20000) < chance).astype(np.int64)
    coder = rc.writer(1 << 16, 1, 1)
    code_bits(coder, bits)
    entropy = -len(bits) * (chance * math.log2(chance) + (1 - chance) * math.log2(1 - chance))
    assert 8 * len(rc.written(coder)) < most * entropy + 100


def test_what_never_happens_costs_next_to_nothing():
    coder = rc.writer(1 << 16, 1, 1)
    code_bits(coder, np.zeros(100_000, np.int64))
    assert len(rc.written(coder)) < 25


@given(st.binary(max_size=60))
def test_any_bytes_end_in_numbers_or_a_fault(data):
    coder, found = rc.reader(data, CONTEXTS, MIXERS), np.zeros(300, np.int64)
    code_numbers(coder, found, KIND)
    assert coder.state[rc.FAULT] > 0 or coder.state[rc.PLACE] <= len(data)


def test_reading_past_the_end_is_a_fault():
    values = np.arange(100) ** 2
    data = written_numbers(values)
    for cut in range(len(data)):
        coder = rc.reader(data[:cut], CONTEXTS, MIXERS)
        code_numbers(coder, np.zeros(100, np.int64), KIND)
        assert not rc.consumed(coder)


def test_a_magnitude_without_end_is_a_fault():
    coder = rc.reader(b"\x00" * 200, CONTEXTS, MIXERS)
    code_numbers(coder, np.zeros(100, np.int64), KIND)
    assert coder.state[rc.FAULT] in (rc.TOO_LONG, rc.MALFORMED, rc.READ_PAST)


def test_a_full_buffer_is_noticed():
    coder = rc.writer(20, CONTEXTS, MIXERS)
    code_numbers(coder, np.random.default_rng(0).integers(0, 1 << 30, 200), KIND)
    assert rc.full(coder)


def test_what_was_learnt_goes_on_into_the_next_packet():
    values = np.cumsum(np.random.default_rng(0).integers(0, 3, 300))
    coder = rc.writer(1 << 12, CONTEXTS, MIXERS)
    code_numbers(coder, values, KIND)
    first = rc.written(coder)
    coder = rc.renewed(coder, 1 << 12)
    code_numbers(coder, values, KIND)
    second = rc.written(coder)
    assert len(second) < len(first)
    reading = rc.reader(first, CONTEXTS, MIXERS)
    code_numbers(reading, values.copy(), KIND)
    reading = rc.opened(reading, second)
    found = np.zeros(300, np.int64)
    code_numbers(reading, found, KIND)
    assert rc.consumed(reading)
    assert np.array_equal(found, values)
