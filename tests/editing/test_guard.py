"""The guard: contact where the shell alone runs through itself, crossings at rest, ways that are blocked."""

import numpy as np
import pytest

from morphlet import Mesh, metrics
from morphlet.editing.estimated import EstimatedRotations
from morphlet.editing.guard import Guarded
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.editing.shell import Shell
from morphlet.errors import InputError, SolveError
from morphlet.numerics.rotations import exponential
from morphlet.surface.intersections import self_intersections
from support import beside, blob, icosphere

PLAIN = Shell(0.03)


def hose():
    """A bent hose whose end is pulled into its own middle, with the turn that brings it there."""
    rings, sides = 41, 10
    z, turn = np.repeat(np.linspace(0, 6, rings), sides), np.tile(2 * np.pi * np.arange(sides) / sides, rings)
    a = (np.arange(rings - 1)[:, None] * sides + np.arange(sides)).ravel()
    b = (np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides).ravel()
    faces = np.vstack([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])
    mesh = Mesh(np.stack([0.4 * np.cos(turn), 0.4 * np.sin(turn), z], 1), faces)
    roi = Roi(mesh, np.nonzero(z > 5.6)[0], np.nonzero((z >= 0.35) & (z <= 5.6))[0])
    vector = np.array([[0, np.radians(200), 0]])
    arm = mesh.vertices[roi.handle] - mesh.vertices[roi.handle].mean(axis=0)
    return roi, Pull(arm @ exponential(vector)[0].T + [0.6, 0, 2.5], vector)


def deformed(roi, positions):
    whole = np.array(roi.mesh.vertices)
    whole[roi.moving] = positions
    return roi.mesh.with_vertices(whole)


def test_it_is_a_method():
    roi = Roi(icosphere(1), np.arange(6), np.arange(6, 40))
    assert isinstance(Guarded(), Method)
    assert isinstance(Guarded().prepare(roi), Prepared)


def test_without_crossings_it_is_the_shell():
    mesh = blob(2)
    z = mesh.vertices[:, 2]
    roi = Roi(mesh, np.nonzero(z > 0.6)[0], np.nonzero(abs(z) <= 0.6)[0])
    pull = Pull(mesh.vertices[roi.handle] + [0.2, 0, 0.3])
    np.testing.assert_array_equal(Guarded(PLAIN).prepare(roi)(pull), PLAIN.prepare(roi)(pull))


def test_contact_keeps_a_hose_from_running_through_itself():
    roi, pull = hose()
    alone = deformed(roi, PLAIN.prepare(roi)(pull))
    assert len(self_intersections(alone)) > 50
    seen = []
    out = deformed(roi, Guarded(PLAIN).prepare(roi)(pull, seen.append))
    assert len(self_intersections(out)) == 0
    np.testing.assert_array_equal(out.vertices[roi.handle], pull.targets)
    np.testing.assert_array_equal(out.vertices[roi.anchors], roi.mesh.vertices[roi.anchors])
    assert metrics.edge_strain_rms(roi.mesh, out) < 15
    walk = [step for step in seen if step.stage == "guard"]
    assert len(walk) > 10
    assert walk[-1].accepted
    assert walk[-1].progress == 1


def test_from_a_start_the_way_is_straight():
    roi, pull = hose()
    guarded = Guarded(PLAIN).prepare(roi)
    first = guarded(pull)
    onwards = guarded(Pull(pull.targets + np.array([0.1, 0.2, 0]), pull.turns, first))
    assert len(self_intersections(deformed(roi, onwards))) == 0


def test_a_blocked_way_is_told():
    """The handle itself is to lie across what cannot move."""
    roi, pull = hose()
    with pytest.raises(SolveError, match="without crossings") as caught:
        Guarded(PLAIN, stride=2.0).prepare(roi)(Pull(pull.targets - pull.targets.mean(axis=0) + np.array([0.2, 0, 0.2]), pull.turns))
    assert len(caught.value.elements)


def test_crossings_at_rest_do_not_count():
    ball = icosphere(2)
    mesh = beside(ball, ball.with_vertices(ball.vertices + np.array([0.5, 0.13, 0.07])))
    roi = Roi(mesh, np.arange(12), np.arange(12, 160))
    before = self_intersections(mesh)
    assert len(before) > 20
    out = Guarded().prepare(roi)(Pull(mesh.vertices[:12]))
    np.testing.assert_allclose(out, mesh.vertices[:160], atol=1e-12)


def test_a_handle_alone_cannot_give_way():
    ball = icosphere(2)
    targets = np.array(ball.vertices)
    targets[0] *= -1.5
    with pytest.raises(SolveError, match="free vertex that can give way"):
        Guarded().prepare(Roi(ball, np.arange(162), []))(Pull(targets))


def test_estimated_rotations_pass_through():
    """What the guard is for: the linear start crosses too."""
    roi, pull = hose()
    assert len(self_intersections(deformed(roi, EstimatedRotations().prepare(roi)(pull)))) > 10


def test_bad_options_are_refused():
    with pytest.raises(InputError, match="positive stride"):
        Guarded(stride=0)
