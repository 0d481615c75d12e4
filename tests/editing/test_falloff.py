"""Eqs. 10-12: the ratio, the factor and the rate, literally and as they were meant; the edit that follows by distance alone."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import InputError, Mesh
from morphlet.editing.falloff import Direct, rate, ratios, smallest_gap, transition
from morphlet.editing.method import Method, Pull
from morphlet.editing.roi import Roi
from support import icosphere, noisy, random_rotation

FALLOFFS = ["gaussian", "literal", "wendland"]
LADDER = Mesh([[0, 0, 0], [1, 0, 0], [2, 0, 0], [4, 0, 0], [0, 1, 0], [8, 0, 0]], [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 5, 4]])
"""Handle 0, free 1, 2 and 4, anchors 3 (4 away) and 5 (8 away)."""
RUNGS = Roi(LADDER, [0], [1, 2, 4])


def cap(seed=0):
    """A region of a bumpy ball with a handle of several vertices."""
    mesh = noisy(3, 0.2, seed)
    handle = Roi.within(mesh, [0], 0.25, "edges").moving
    return Roi.within(mesh, handle, 0.8)


def test_eq_10_by_hand():
    assert smallest_gap(RUNGS) == 4
    assert ratios(RUNGS).tolist() == [0, 0.25, 0.5, 0.25]


def test_eq_10_takes_the_smallest_gap_of_all_pairs():
    """Free vertices far from that gap exceed 1, as the paper says."""
    roi = Roi(LADDER, [0, 5], [2, 3])
    assert smallest_gap(roi) == 1
    assert ratios(roi).tolist() == [0, 2, 4, 0]


def test_the_gap_is_the_smallest_of_all_pairs_wherever_it_is():
    """Against all pairs by hand; the nearest anchor need not be on the rim."""
    mesh = noisy(3, 0.2)
    x = np.array(mesh.vertices)
    roi = Roi.within(mesh, [0, 7], 0.7)
    far = roi.anchors[np.argmax(np.linalg.norm(x[roi.anchors] - x[0], axis=1))]
    x[far] = 1.02 * x[0]
    for vertices in (np.array(mesh.vertices), x):
        moved = Roi(mesh.with_vertices(vertices), roi.handle, roi.free)
        pairs = np.linalg.norm(vertices[moved.anchors, None] - vertices[None, moved.handle], axis=2)
        assert smallest_gap(moved) == pytest.approx(pairs.min(), rel=1e-12)
    assert far not in roi.rim


def test_the_other_ratio_runs_from_handle_to_anchors():
    assert ratios(RUNGS, "between")[:3].tolist() == [0, 0.25, 0.5]
    values = ratios(cap(), "between")
    assert ((values >= 0) & (values < 1)).all()


def test_eq_11_literal_is_literal():
    np.testing.assert_array_equal(transition(np.array([0.0, 0.25, 1.0]), "literal"), 0.5 * np.exp([-0.0, -1.0, -4.0]))


def test_the_gaussian_that_is_meant():
    np.testing.assert_allclose(transition(np.array([0.0, 0.25, 1.0]), "gaussian"), np.exp([0, -0.5, -8]), rtol=1e-15)


def test_wendland_ends_at_one():
    assert transition(np.array([0.0, 0.5, 1.0, 3.0]), "wendland").tolist() == [1, 0.1875, 0, 0]


@pytest.mark.parametrize("falloff", FALLOFFS)
def test_factors_fall_and_stay_within_0_and_1(falloff):
    values = transition(np.linspace(0, 3, 100), falloff)
    assert (np.diff(values) <= 0).all()
    assert values[0] <= 1
    assert values[-1] >= 0


@pytest.mark.parametrize("falloff", FALLOFFS)
@pytest.mark.parametrize("ratio", ["literal", "between"])
def test_a_translation_by_parts(falloff, ratio):
    """x' = x + g(r(x)) t for free vertices, x + t on the handle: half the way is missing at its border with the literal factor."""
    roi, shift = cap(), np.array([0.3, -0.2, 0.5])
    found = Direct(falloff, ratio).prepare(roi)(Pull(roi.mesh.vertices[roi.handle] + shift))
    part = np.where(np.isin(roi.moving, roi.handle), 1.0, transition(ratios(roi, ratio), falloff))
    np.testing.assert_allclose(found, roi.mesh.vertices[roi.moving] + part[:, None] * shift, atol=1e-15)


def test_the_paper_s_jump_is_there():
    """Vertices next to the handle get less than half its way by Eq. 11 as printed, nearly all of it by the Gaussian."""
    mesh = icosphere(4)
    roi = Roi.within(mesh, [0], 1.5)
    next_to = np.isin(roi.moving, Roi(mesh, [0], []).grown(1).free)
    way = {}
    for falloff in ("literal", "gaussian"):
        found = Direct(falloff).prepare(roi)(Pull(mesh.vertices[[0]] + [0, 0, 1]))
        way[falloff] = (found - mesh.vertices[roi.moving])[next_to, 2]
    assert (way["literal"] < 0.5).all()
    assert (way["gaussian"] > 0.9).all()


@given(st.integers(0, 100))
@settings(max_examples=10)
def test_no_pull_no_move_and_the_handle_is_exact(seed):
    roi = cap(seed)
    rest, prepared = roi.mesh.vertices, Direct().prepare(roi)
    np.testing.assert_array_equal(prepared(Pull(rest[roi.handle])), rest[roi.moving])
    targets = np.random.default_rng(seed).normal(size=(len(roi.handle), 3))
    np.testing.assert_array_equal(prepared(Pull(targets))[np.searchsorted(roi.moving, roi.handle)], targets)


def test_rows_follow_the_handle_s_order():
    mesh = icosphere(2)
    roi, turned = Roi(mesh, [5, 3, 9], [0, 1, 2]), Roi(mesh, [9, 5, 3], [0, 1, 2])
    targets = mesh.vertices[[5, 3, 9]] * [[1.5], [2.0], [0.5]]
    one, other = Direct().prepare(roi)(Pull(targets)), Direct().prepare(turned)(Pull(targets[[2, 0, 1]]))
    np.testing.assert_array_equal(one, other)


def test_motion_and_size_of_all_change_nothing():
    roi, turn = cap(), random_rotation(3)
    moved = Roi(roi.mesh.with_vertices(1e6 * roi.mesh.vertices @ turn.T + 5), roi.handle, roi.free)
    targets = roi.mesh.vertices[roi.handle] + [0.1, 0.2, 0.3]
    for method in (Direct(), Direct("wendland", "between")):
        expected = 1e6 * method.prepare(roi)(Pull(targets)) @ turn.T + 5
        np.testing.assert_allclose(method.prepare(moved)(Pull(1e6 * targets @ turn.T + 5)), expected, atol=1e-8 * 1e6)


def test_it_is_a_method():
    assert isinstance(Direct(), Method)


@pytest.mark.parametrize(("falloff", "ratio", "name"), [("box", "literal", "falloff"), ("gaussian", "max", "ratio")])
def test_unknown_options(falloff, ratio, name):
    with pytest.raises(InputError, match=f"as {name}; found '"):
        Direct(falloff, ratio)


def test_without_anchors_there_is_no_ratio():
    with pytest.raises(InputError, match=r"needed anchors, which the ratio of Eq\. 10 is told by"):
        Direct().prepare(Roi(LADDER, [0], [1, 2, 3, 4, 5]))


def test_an_anchor_on_the_handle():
    doubled = Mesh([[0, 0, 0], [0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 2, 3], [1, 3, 2]])
    with pytest.raises(InputError, match=r"anchors apart from the handle; found 1 at the place of a handle vertex \(first: 1\)"):
        ratios(Roi(doubled, [0], [2]))


@pytest.mark.parametrize("targets", [np.zeros((2, 3)), np.full((1, 3), np.nan)])
def test_bad_targets(targets):
    with pytest.raises(InputError, match="targets"):
        Direct().prepare(RUNGS)(Pull(targets))


def test_eq_12_three_ways():
    deformed = LADDER.with_vertices(LADDER.vertices + np.array([[0, 0, 2], [0, 0, 1], [0, 1, 0], [0, 0, 0], [0, 0, 1], [0, 0, 0]]))
    found = rate(RUNGS, deformed)
    assert (found.literal, found.literal_max) == (100 * (0 + 1 + 2 + 1) / 4 / 4, 50)
    assert found.displacement == 100 * (2 + 1 + 1 + 1) / 4 / 4
    assert found.residual is None
    assert rate(RUNGS, deformed, deformed.vertices + np.array([0, 3, 4])).residual == 125


def test_eq_12_as_printed_does_not_see_the_deformation():
    still = rate(RUNGS, LADDER)
    assert (still.literal, still.displacement) == (25, 0)


def test_a_rate_needs_the_same_vertices():
    with pytest.raises(InputError, match="vertices of the deformed mesh of shape"):
        rate(RUNGS, icosphere(1))
    with pytest.raises(InputError, match="approximation of shape"):
        rate(RUNGS, LADDER, np.zeros((3, 3)))
