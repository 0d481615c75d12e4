"""Marker files."""

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from morphlet import FileError, VertexPairs
from morphlet.io.pairs import read_pairs, write_pairs

labels = st.text(st.characters(exclude_categories=["Cs"]), max_size=8)
row = st.tuples(st.integers(0, 10**12), st.integers(0, 10**12), st.floats(1e-300, 1e300), labels)


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(rows=st.lists(row, max_size=6))
def test_round_trip(tmp_path, rows):
    source, target, weight, names = ([r[k] for r in rows] for k in range(4))
    pairs = VertexPairs(np.array(source, np.int64), np.array(target, np.int64), np.array(weight), tuple(names))
    write_pairs(tmp_path / "a.csv", pairs)
    back = read_pairs(tmp_path / "a.csv")
    assert back.source.tolist() == source
    assert back.target.tolist() == target
    assert back.weight.tolist() == weight
    assert back.labels == tuple(names)


@pytest.mark.parametrize(
    ("text", "weight", "label"),
    [
        ("source,target\n1,2\n", 1, ""),
        ("source,target,weight\n1,2,0.5\n", 0.5, ""),
        ("source,target,label\r\n1,2,nose\r\n", 1, "nose"),
        ('\ufeffsource, target ,weight,label\n 1 , 2 , 3 ,"left, front"\n\n', 3, "left, front"),
    ],
)
def test_headers(tmp_path, text, weight, label):
    (tmp_path / "a.csv").write_bytes(text.encode())
    pairs = read_pairs(tmp_path / "a.csv")
    assert (pairs.source.tolist(), pairs.target.tolist(), pairs.weight.tolist(), pairs.labels) == ([1], [2], [weight], (label,))


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"", "the header source,target"),
        (b"1,2\n3,4\n", "the header source,target.*found '1,2'"),
        (b"source,target,note\n1,2,3\n", "the header"),
        (b"source,target\n1,2\n3\n", "2 columns on line 3 .*found 1"),
        (b"source,target\n1,2,3\n", "2 columns on line 2 .*found 3"),
        (b"source,target\n1,-2\n", "a vertex index from 0 as target on line 2 .*found '-2'"),
        (b"source,target\n1.0,2\n", "as source on line 2"),
        (b"source,target\n1,99999999999999999999999\n", "as target on line 2"),
        ("source,target\n١,2\n".encode(), "as source on line 2"),
        (b"source,target,weight\n1,2,0\n", "a positive number as weight on line 2"),
        (b"source,target,weight\n1,2,nan\n", "a positive number"),
        (b"source,target,weight\n1,2,heavy\n", "found 'heavy'"),
        (b"source,target\n\xff\xfe,2\n", "a CSV file of vertex pairs"),
        (b'source,target,label\n1,2,"' + b"x" * 200_000 + b'"\n', "CSV on line"),
    ],
)
def test_bad_files(tmp_path, content, match):
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(FileError, match=match):
        read_pairs(tmp_path / "a.csv")


def test_missing_file(tmp_path):
    with pytest.raises(FileError, match="No such file"):
        read_pairs(tmp_path / "a.csv")
    with pytest.raises(FileError, match="a writable folder"):
        write_pairs(tmp_path / "b" / "a.csv", VertexPairs([1], [2]))
