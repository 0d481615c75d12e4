"""The shell: what it leaves free, its energy and its volume; two hard bends that end without crossings."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import Mesh, metrics
from morphlet.editing.enclosure import Enclosure
from morphlet.editing.method import Method, Prepared, Pull
from morphlet.editing.roi import Roi
from morphlet.editing.shell import Shell
from morphlet.errors import InputError, MeshError
from morphlet.surface.intersections import self_intersections
from support import beside, blob, icosphere, random_rotation


def tube(rings, sides, length, radius=0.5):
    """An open tube along z."""
    z, turn = np.repeat(np.linspace(0, length, rings), sides), np.tile(2 * np.pi * np.arange(sides) / sides, rings)
    a = (np.arange(rings - 1)[:, None] * sides + np.arange(sides)).ravel()
    b = (np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides).ravel()
    faces = np.vstack([np.stack([a, b, b + sides], 1), np.stack([a, b + sides, a + sides], 1)])
    return Mesh(np.stack([radius * np.cos(turn), radius * np.sin(turn), z], 1), faces)


def held(mesh, low, high):
    """Pull what lies above, keep what lies below."""
    z = mesh.vertices[:, 2]
    return Roi(mesh, np.nonzero(z > high)[0], np.nonzero((z >= low) & (z <= high))[0])


def turned(axis, degrees):
    x, y, z = np.asarray(axis, float)
    k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.eye(3) + np.sin(np.radians(degrees)) * k + (1 - np.cos(np.radians(degrees))) * k @ k


def deformed(roi, positions):
    whole = np.array(roi.mesh.vertices)
    whole[roi.moving] = positions
    return roi.mesh.with_vertices(whole)


BALL = held(blob(2), -0.5, 0.6)


def test_it_is_a_method():
    assert isinstance(Shell(), Method)
    assert isinstance(Shell().prepare(BALL), Prepared)


@pytest.mark.parametrize("thickness", [0, 0.008, 0.1])
def test_a_handle_that_stays_moves_nothing(thickness):
    out = Shell(thickness).prepare(BALL)(Pull(BALL.mesh.vertices[BALL.handle]))
    np.testing.assert_allclose(out, BALL.mesh.vertices[BALL.moving], atol=1e-12)


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 1000))
def test_rigid_motions_of_the_handle_are_free_without_anchors(seed):
    mesh, turn = BALL.mesh, random_rotation(seed)
    roi = Roi(mesh, BALL.handle, np.setdiff1d(np.arange(mesh.n_vertices), BALL.handle))
    out = Shell(iterations=100, tolerance=1e-12).prepare(roi)(Pull(mesh.vertices[roi.handle] @ turn.T + 3))
    np.testing.assert_allclose(out, mesh.vertices @ turn.T + 3, atol=1e-8)


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 1000), st.floats(0.1, 10))
def test_the_answer_turns_and_scales_with_the_mesh(seed, scale):
    turn, shift = scale * random_rotation(seed), np.array([[0.3, 0.2, 0.1]])
    other = Roi(BALL.mesh.with_vertices(BALL.mesh.vertices @ turn.T + 1), BALL.handle, BALL.free)
    here = Shell(iterations=5).prepare(BALL)(Pull(BALL.mesh.vertices[BALL.handle] + shift))
    there = Shell(iterations=5).prepare(other)(Pull((BALL.mesh.vertices[BALL.handle] + shift) @ turn.T + 1))
    np.testing.assert_allclose(there, here @ turn.T + 1, atol=1e-7 * max(scale, 1))


def test_without_thickness_and_volume_the_energy_is_spokes_and_rims():
    """Two vertices pulled, all others free, so that all cells count; the energy is told before the last step."""
    mesh, seen = blob(2), []
    roi = Roi(mesh, [0, 17], np.setdiff1d(np.arange(mesh.n_vertices), [0, 17]))
    shell = Shell(0, "free", iterations=300, tolerance=1e-10).prepare(roi)
    out = deformed(roi, shell(Pull(mesh.vertices[roi.handle] * 1.5), seen.append))
    assert seen[-1].objective == pytest.approx(mesh.area * metrics.arap_energy(mesh, out), rel=1e-6)


def test_the_energy_falls_and_its_residual_vanishes():
    seen, prepared = [], Shell(0.05, "free", iterations=300, tolerance=1e-9).prepare(BALL)
    targets = BALL.mesh.vertices[BALL.handle] @ turned([1, 0, 0], 50).T
    out = prepared(Pull(targets), seen.append)
    energies = [step.objective for step in seen if step.accepted]
    assert (np.diff(energies) <= 1e-9 * energies[0]).all()
    positions = deformed(BALL, out).vertices[prepared.energy.patch.vertices]
    rotations, value = prepared.energy.fitted(positions, targets)
    assert np.abs(prepared.energy.residual(positions, rotations, targets)).max() < 1e-5
    for seed in range(5):
        nudged, rng = np.array(positions), np.random.default_rng(seed)
        nudged[prepared.energy.patch.unknown] += 1e-3 * rng.normal(size=(len(BALL.free), 3))
        assert prepared.energy.fitted(nudged, targets)[1] > value


@pytest.mark.parametrize("mesh", [blob(2), tube(13, 12, 3.0)], ids=["ball", "tube"])
@pytest.mark.parametrize("degrees", [0, 70])
def test_volume_is_kept(mesh, degrees):
    low, high = np.quantile(mesh.vertices[:, 2], [0.2, 0.8])
    roi = held(mesh, low, high)
    targets = (mesh.vertices[roi.handle] * [1, 1, 1.5]) @ turned([0, 1, 0], degrees).T
    for volume in ("kept", "free"):
        out = Shell(volume=volume).prepare(roi)(Pull(targets))
        change = Enclosure.of(roi).change(out - mesh.vertices[roi.moving]) / abs(closed_volume(mesh))
        assert (abs(change) < 1e-6) == (volume == "kept")


def closed_volume(mesh):
    """With fans over the rims of a tube along z."""
    return mesh.volume if not mesh.topology.boundary_loops else Enclosure.of(Roi(mesh, np.arange(mesh.n_vertices), [])).volume


def test_volume_of_the_whole_is_the_change_of_the_parts():
    mesh = blob(2)
    shift = np.random.default_rng(0).normal(scale=0.1, size=(len(BALL.moving), 3))
    found = Enclosure.of(BALL).change(shift)
    moved = deformed(BALL, BALL.mesh.vertices[BALL.moving] + shift)
    assert found == pytest.approx(moved.volume - mesh.volume, abs=1e-12)


def test_gradient_of_the_volume():
    for mesh in (blob(2), tube(5, 6, 3.0)):
        roi = Roi(mesh, np.arange(6), np.arange(6, 20))
        enclosure, rng = Enclosure.of(roi), np.random.default_rng(1)
        shift, way = rng.normal(scale=0.1, size=(2, 20, 3))
        slope = (enclosure.change(shift + 1e-5 * way) - enclosure.change(shift - 1e-5 * way)) / 2e-5
        assert np.vdot(enclosure.gradient(shift), way) == pytest.approx(slope, rel=1e-7)


def test_a_sheet_encloses_nothing():
    strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    roi = Roi(strip, [4, 5], [2, 3])
    assert Enclosure.of(roi) is None
    assert Shell().prepare(roi)(Pull([[0, 2, 1], [1, 2, 1]]))[:2, 2] == pytest.approx([0.5, 0.5], abs=0.2)


@pytest.mark.parametrize(("axis", "degrees"), [([0, 0, 1], 135), ([0, 1, 0], 90)], ids=["twist", "bend"])
def test_a_tube_stays_a_tube(axis, degrees):
    mesh = tube(37, 24, 3.0)
    roi = held(mesh, 0.3, 2.7)
    targets = (mesh.vertices[roi.handle] - [0, 0, 1.5]) @ turned(axis, degrees).T + [0.6 * (degrees == 90), 0, 1.5 - 0.4 * (degrees == 90)]
    out = deformed(roi, Shell(0.02).prepare(roi)(Pull(targets)))
    assert len(self_intersections(out)) == 0
    assert metrics.edge_strain_rms(mesh, out) < 20
    free = deformed(roi, Shell(0, "free", iterations=200, tolerance=1e-5).prepare(roi)(Pull(targets)))
    assert abs(Enclosure.of(roi).change(free.vertices[roi.moving] - mesh.vertices[roi.moving])) > 0.1 * closed_volume(mesh)


def test_a_start_is_taken_up():
    targets = BALL.mesh.vertices[BALL.handle] + [0, 0.3, 0.2]
    exact = Shell(iterations=500, tolerance=1e-12).prepare(BALL)(Pull(targets))
    seen = []
    out = Shell().prepare(BALL)(Pull(targets, start=exact), seen.append)
    assert len(seen) == 1
    np.testing.assert_allclose(out, exact, atol=1e-7)


def test_soft_handles():
    targets = BALL.mesh.vertices[BALL.handle] + [0, 0, 0.4]
    hard = Shell().prepare(BALL)(Pull(targets))
    place, away = np.searchsorted(BALL.moving, BALL.handle), []
    for weight in (0.1, 10.0, 1e4):
        out = Shell(iterations=300, tolerance=1e-6).prepare(Roi(BALL.mesh, BALL.handle, BALL.free, np.full(len(BALL.handle), weight)))(
            Pull(targets)
        )
        away.append(np.linalg.norm(out[place] - targets, axis=1).max())
    assert away[0] > away[1] > away[2] > 0
    np.testing.assert_allclose(out, hard, atol=0.02)


def test_everything_a_handle():
    roi = Roi(BALL.mesh, np.arange(BALL.mesh.n_vertices), [])
    np.testing.assert_array_equal(Shell().prepare(roi)(Pull(2 * BALL.mesh.vertices)), 2 * BALL.mesh.vertices)


def test_bad_input_is_refused():
    with pytest.raises(InputError, match="nothing negative"):
        Shell(-1)
    with pytest.raises(InputError, match="kept, free"):
        Shell(volume="half")
    with pytest.raises(InputError, match="targets"):
        Shell().prepare(BALL)(Pull(np.zeros((1, 3))))
    ball = icosphere(1)
    with pytest.raises(MeshError, match="touch the handle or an anchor"):
        Shell().prepare(Roi(beside(ball, ball), [0, 1], np.arange(10, 84)))
