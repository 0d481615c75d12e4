"""docs/format.md: its test vectors are what the codec writes and reads, its numbers those of the code."""

import re
from pathlib import Path

import numpy as np
import pytest

from morphlet import Mesh, MeshSequence, decode, encode
from morphlet.codec import connectivity, container, frames, geometry, shuffle
from morphlet.codec import range_coder as rc

PAGE = Path(__file__).parents[2] / "docs" / "format.md"
NUMBERS = np.array([0, 1, 2, 3, 3, 3, -70, 100_000, 100_001])
TETRAHEDRON = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
STRETCHED = MeshSequence(TETRAHEDRON.topology, np.stack([TETRAHEDRON.vertices, TETRAHEDRON.vertices * [1, 1, 2]]), [0.0, 1.0])


@pytest.fixture(scope="module")
def page() -> str:
    if not PAGE.exists():
        pytest.skip("docs/format.md is not here")
    return PAGE.read_text("utf-8")


def vectors(page: str) -> list[bytes]:
    """The first two files of the page."""
    return [bytes.fromhex(block.replace("\n", "")) for block in re.findall(r"```\n([0-9a-f\n]+)```", page)][:2]


def test_the_files_are_what_is_written_and_read(page):
    one, two = vectors(page)
    single, pair = encode(TETRAHEDRON, error=0.1), encode(STRETCHED, error=0.1)
    assert single.data == one
    assert pair.data == two
    assert f"{pair.permutation.tolist()}[k]" in page
    back = decode(two)
    assert np.abs(back.positions - STRETCHED.positions[:, pair.permutation]).max() <= 0.1
    assert len(back) == 2
    assert np.abs(decode(one).positions[0] - TETRAHEDRON.vertices[single.permutation]).max() <= 0.1


def test_the_integers_are_what_is_written(page):
    coder = rc.writer(1000, shuffle.CONTEXTS, shuffle.MIXERS)
    shuffle.code_numbers(coder, NUMBERS.copy(), np.int64(0))
    assert f"`{rc.written(coder).hex()}`" in page


def test_the_pages_numbers_are_the_codes(page):
    assert (connectivity.PLAN, connectivity.NEAR_CONTEXT, connectivity.SEED_CONTEXT) == (28800, 144_000, 144_066)
    assert (geometry.SIGNS, geometry.SIGN_MIXER, geometry.BETWEEN, geometry.ENDS) == (591_840, 96, 96, 684)
    assert (geometry.LEANS - geometry.SIGNS, geometry.TURNS - geometry.SIGNS, geometry.PRIOR) == (12, 48, 10)
    assert (frames.ROOTS, frames.SIGNS, frames.ROOT_MIXER) == (3328, 106_528, 416)
    assert {container.SHAPE, container.NETWORK, container.DECIMATED, container.SURFACE} == {3, 4, 5, 7}
    text = page.replace("\n", " ")
    for number in ("28800 q", "N = 144000", "X = 591840", "X = 106528", "26214", "13107", "32 x 3328"):
        assert number in text
    usual = " ".join(f"({a},{b})" for a, b in geometry.USUAL.tolist())
    assert usual in text
    assert (rc.WEIGHT_START, rc.MANY_START) == (26214, 13107)
    assert (rc.WEIGHT_RATE, rc.MANY_RATE) == (15, 14)
    assert (rc.CHANCE_LEAST, rc.SLOWEST, rc.UNARY, rc.PREFIX_MOST, rc.SIZES, rc.SIZE_SLOTS) == (32, 255, 14, 40, 60, 24)
    assert ", ".join(str(c) for c in frames.CUTS) in text
    assert ", ".join(str(c) for c in geometry.STEPS) in text
