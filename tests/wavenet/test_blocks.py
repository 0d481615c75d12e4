"""Tables of networks: the blocks in them, their values, counts, files, and tables that are refused."""

import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from morphlet import _store
from morphlet.errors import FileError, InputError
from morphlet.wavenet.blocks import KIND, VERSION, NetworkTable
from morphlet.wavenet.mothers import MOTHERS, beta
from morphlet.wavenet.network import WaveletNetwork

SLOG1 = MOTHERS["slog1"]
ALL = (*MOTHERS.values(), beta(2, 4, 8))
X = np.linspace(-0.2, 1.2, 30)
sizes = st.lists(st.integers(0, 5), min_size=1, max_size=6)


def table(counts, k=2, seed=0):
    """Blocks of so many wavelets."""
    rng, p, b = np.random.default_rng(seed), sum(counts), len(counts)
    parts = (rng.integers(0, len(ALL), p), rng.uniform(0, 1, p), rng.uniform(0.05, 0.5, p), rng.normal(size=(p, k)))
    return NetworkTable(ALL, np.append(0, np.cumsum(counts)), *parts, rng.normal(size=(b, 2, k)))


@given(sizes)
def test_a_block_holds_the_wavelets_between_its_offsets(counts):
    whole = table(counts)
    nets = list(whole)
    assert [len(net) for net in nets] == counts
    assert len(whole) == len(counts)
    for name in ("kinds", "centers", "dilations", "weights"):
        np.testing.assert_array_equal(np.concatenate([getattr(net, name) for net in nets]), getattr(whole, name))
    np.testing.assert_array_equal(np.stack([net.affine for net in nets]), whole.affine)
    assert all(isinstance(net, WaveletNetwork) and net.mothers == ALL for net in nets)


def test_blocks_are_counted_from_both_ends():
    whole = table([2, 0, 3])
    for i in range(3):
        for j in (i - 3, np.int64(i), np.int64(i - 3)):
            np.testing.assert_array_equal(whole[j].centers, whole[i].centers)
            np.testing.assert_array_equal(whole[j].affine, whole[i].affine)


@pytest.mark.parametrize("i", [3, -4, 10**6])
def test_blocks_that_are_not_there_are_an_index_error(i):
    with pytest.raises(IndexError, match="out of range"):
        table([2, 0, 3])[i]


def test_an_empty_table_has_no_blocks():
    empty = table([])
    assert (len(empty), list(empty), empty(X).shape) == (0, [], (0, 30, 2))
    with pytest.raises(IndexError, match="out of range"):
        empty[0]


@given(sizes)
def test_values_are_those_of_the_single_networks(counts):
    whole = table(counts)
    np.testing.assert_allclose(whole(X), [net(X) for net in whole], rtol=1e-12, atol=1e-12)


def test_the_value_is_the_sum_of_the_paper():
    two = NetworkTable((SLOG1,), [0, 0, 1], [0], [0.5], [0.1], [[2.0]], [[[1.0], [0.0]], [[3.0], [4.0]]])
    np.testing.assert_allclose(two(X)[0, :, 0], 1)
    np.testing.assert_allclose(two(X)[1, :, 0], 3 + 4 * X + 2 * SLOG1((X - 0.5) / 0.1), atol=1e-12)


def test_counts_add_up_those_of_the_blocks_and_list_unused_mothers():
    whole = table([3, 0, 5])
    assert list(whole.counts()) == [psi.name for psi in ALL]
    assert whole.counts() == {psi.name: sum(net.counts()[psi.name] for net in whole) for psi in ALL}
    assert 0 in whole.counts().values()


@pytest.mark.parametrize("counts", [[], [0, 0], [3, 0, 5]])
def test_files_and_pickles_give_the_same_table(tmp_path, counts):
    whole = table(counts)
    whole.save(tmp_path / "blocks.npz")
    for copy in (NetworkTable.load(tmp_path / "blocks.npz"), pickle.loads(pickle.dumps(whole))):
        assert [psi.name for psi in copy.mothers] == [psi.name for psi in ALL]
        for name in ("offsets", "kinds", "centers", "dilations", "weights", "affine"):
            np.testing.assert_array_equal(getattr(copy, name), getattr(whole, name))
        np.testing.assert_array_equal(copy(X), whole(X))


def test_it_says_what_it_is():
    assert repr(table([3, 0, 5])) == "NetworkTable(3 blocks, 8 wavelets, 2 outputs)"


def test_arrays_are_copied_and_read_only():
    offsets = np.array([0, 1])
    one = NetworkTable((SLOG1,), offsets, [0], [0.5], [0.1], [[2.0]], np.zeros((1, 2, 1)))
    offsets[1] = 0
    assert one.offsets.tolist() == [0, 1]
    for name in ("offsets", "kinds", "centers", "dilations", "weights", "affine"):
        with pytest.raises(ValueError, match="read-only"):
            getattr(one, name)[0] = 7


GOOD = {
    "mothers": (SLOG1,),
    "offsets": [0, 1, 2],
    "kinds": [0, 0],
    "centers": [0.2, 0.5],
    "dilations": [0.1, 0.1],
    "weights": np.ones((2, 3)),
    "affine": np.zeros((2, 2, 3)),
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"offsets": [0, 1, 1]}, r"needed offsets that rise from 0 to 2; found \[0 1 1\]; give where the wavelets of each block start"),
        ({"offsets": [1, 1, 2]}, "needed offsets that rise from 0 to 2"),
        ({"offsets": [0, 2, 1, 2]}, r"needed offsets that rise from 0 to 2; found \[0 2 1 2\]"),
        ({"offsets": []}, "needed offsets that rise from 0 to 2"),
        ({"offsets": [0, 1, 3]}, "needed indices from 0 to 2 in offsets; found 1 outside"),
        ({"offsets": [0, -1, 2]}, "needed indices from 0 to 2 in offsets"),
        ({"offsets": [0, 0.5, 2]}, "needed integer indices in offsets"),
        ({"offsets": [0, 2]}, r"needed affine of shape \(1, 2, any\); found shape \(2, 2, 3\)"),
        ({"affine": np.zeros((2, 3))}, r"needed affine of shape \(2, 2, any\)"),
        ({"affine": np.full((2, 2, 3), np.nan)}, "needed finite numbers in affine"),
        ({"weights": np.ones((2, 2))}, r"needed weights of shape \(2, 3\); found shape \(2, 2\)"),
        ({"weights": np.ones((3, 3))}, r"needed weights of shape \(2, 3\)"),
        ({"kinds": [0, 1]}, r"needed indices from 0 to 0 in kinds; found 1 outside that range in 1 rows \(first: 1\)"),
        ({"dilations": [0.1, 0.0]}, r"needed dilations > 0; found 1 that are not \(first: 1\)"),
        ({"centers": [0.2]}, r"needed centers of shape \(2\)"),
        ({"mothers": ("slog1",)}, "needed mothers; found str"),
        ({"mothers": (SLOG1, SLOG1)}, "needed each mother once; found slog1, slog1"),
    ],
)
def test_unfit_parts_are_refused(change, message):
    assert len(NetworkTable(**GOOD)) == 2
    with pytest.raises(InputError, match=message):
        NetworkTable(**(GOOD | change))


def test_places_that_are_no_numbers_are_refused():
    with pytest.raises(InputError, match="needed finite numbers in x; found 1 NaN"):
        table([1])([0.0, np.nan])


STORED = {name: np.array(value) for name, value in GOOD.items() if name != "mothers"} | {"mothers": np.array(["slog1"])}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"offsets": np.array([0, 2, 1])}, r"needed a wavelet network table in .*: offsets that rise from 0 to 2; .*; write it again"),
        ({"offsets": np.array([0, 1, 9])}, r"needed a wavelet network table in .*: indices from 0 to 2 in offsets"),
        ({"mothers": np.array(["sine"])}, r"needed a wavelet network table in .*: one of mexican_hat, .*; found 'sine'"),
        ({"mothers": np.array(["beta3(2,2)"])}, "n < p, q <= 100; found n = 3"),
        ({"mothers": np.array(["slog1", "slog1"])}, "each mother once"),
        ({"dilations": np.array([0.1, -1])}, r"dilations > 0; found 1 that are not \(first: 1\)"),
        ({"weights": np.full((2, 3), np.inf)}, "finite numbers in weights"),
    ],
)
def test_damaged_files_are_refused(tmp_path, change, message):
    _store.save(tmp_path / "blocks.npz", KIND, VERSION, STORED)
    assert len(NetworkTable.load(tmp_path / "blocks.npz")) == 2
    _store.save(tmp_path / "blocks.npz", KIND, VERSION, STORED | change)
    with pytest.raises(FileError, match=message):
        NetworkTable.load(tmp_path / "blocks.npz")


def test_other_files_are_refused(tmp_path):
    path = tmp_path / "blocks.npz"
    table([2])[0].save(path)
    with pytest.raises(FileError, match=r"needed a file of kind 'wavelet network table' .*found kind 'wavelet network'"):
        NetworkTable.load(path)
    _store.save(path, KIND, VERSION + 1, STORED)
    with pytest.raises(FileError, match=f"found version {VERSION + 1}; update morphlet"):
        NetworkTable.load(path)
    _store.save(path, KIND, VERSION, {name: value for name, value in STORED.items() if name != "offsets"})
    with pytest.raises(FileError, match="1 missing: offsets"):
        NetworkTable.load(path)
    table([2, 1]).save(path)
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(FileError, match="needed a morphlet wavelet network table file"):
        NetworkTable.load(path)
    with pytest.raises(FileError, match="needed a morphlet wavelet network table file"):
        NetworkTable.load(tmp_path / "missing.npz")


def test_files_are_read_with_mothers_only(tmp_path):
    table([2]).save(tmp_path / "blocks.npz")
    with pytest.raises(InputError, match="needed mothers; found str"):
        NetworkTable.load(tmp_path / "blocks.npz", ["slog1"])
