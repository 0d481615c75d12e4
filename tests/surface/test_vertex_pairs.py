"""Pairs of vertices: some of them, and each of them once."""

from morphlet import VertexPairs

PAIRS = VertexPairs([7, 3, 7, 7], [1, 2, 1, 4], [0.5, 1.0, 2.0, 3.0], ("nose", "tail", "again", "ear"))


def told(pairs):
    return list(zip(pairs.source, pairs.target, pairs.weight, pairs.labels, strict=True))


def test_some_pairs_keep_their_weights_and_labels():
    assert told(PAIRS.chosen([3, 0])) == [(7, 4, 3.0, "ear"), (7, 1, 0.5, "nose")]


def test_the_first_of_equal_pairs_stays_in_its_place():
    assert told(PAIRS.distinct()) == [(7, 1, 0.5, "nose"), (3, 2, 1.0, "tail"), (7, 4, 3.0, "ear")]
