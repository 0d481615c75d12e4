"""Smoothed rotations at fixed positions: the energy told, and that no cell could lower it by turning."""

import numpy as np

from editing.capped import capped, covariances, whole_energy
from morphlet.editing.smoothing import PASSES, SmoothedSweep, coloured
from morphlet.editing.system import System, system
from morphlet.numerics.rotations import best_rotations, exponential
from support import blob

STIFFNESS = 0.05


def settled() -> tuple[System, np.ndarray, SmoothedSweep, float]:
    """A disturbed body, its rotations after many passes, and the energy of the last."""
    known = system(capped(blob(2)))
    positions = known.patch.rest.copy()
    positions[: known.patch.n_unknowns] += 0.15 * np.random.default_rng(0).normal(size=(known.patch.n_unknowns, 3))
    identity = np.tile(np.eye(3).ravel(), (len(positions), 1))
    passing = SmoothedSweep(known.patch.stars, coloured(known.patch.stars, len(positions)), STIFFNESS, identity)
    for _ in range(60):
        energy = passing(positions, np.empty_like(positions)) + known.patch.constant(positions)
        passing.accept()
    return known, positions, passing, energy


def told(known: System, positions: np.ndarray, rotations: np.ndarray) -> float:
    """The energy of the whole mesh for these rotations of the patch; cells elsewhere are at rest."""
    mesh, R, moved = known.roi.mesh, np.tile(np.eye(3), (known.roi.mesh.n_vertices, 1, 1)), np.array(known.roi.mesh.vertices)
    R[known.patch.vertices], moved[known.patch.vertices] = rotations.reshape(-1, 3, 3), positions
    S = covariances(mesh, moved)
    best = np.einsum("nij,nji->", best_rotations(S), S)
    i, j = mesh.topology.edges.T
    apart = 2 * np.sum((R[i] - R[j]) ** 2)
    return whole_energy(mesh, moved) + 2 / 3 * (best - np.einsum("nij,nji->", R, S)) + STIFFNESS * apart


def test_the_energy_is_the_one_described():
    known, positions, passing, energy = settled()
    np.testing.assert_allclose(energy, told(known, positions, passing.rotations), rtol=1e-10)


def test_no_cell_gains_by_turning():
    known, positions, passing, energy = settled()
    for cell in (0, 7, known.patch.n_unknowns, known.patch.n_cells - 1):
        for vector in 1e-3 * np.vstack([np.eye(3), -np.eye(3)]):
            other = passing.rotations.copy()
            other[cell] = (exponential(vector[None])[0] @ other[cell].reshape(3, 3)).ravel()
            assert told(known, positions, other) > energy


def test_the_gain_is_what_the_last_pass_lowers():
    """Gains fall from pass to pass: the last is less than all passes of a call lower the energy by, more than a pass of the next."""
    known, positions, _, _ = settled()
    identity, residual = np.tile(np.eye(3).ravel(), (len(positions), 1)), np.empty_like(positions)
    passing = SmoothedSweep(known.patch.stars, coloured(known.patch.stars, len(positions)), STIFFNESS, identity)
    energies, gains = [], []
    for _ in range(6):
        energies.append(passing(positions, residual))
        gains.append(passing.gain)
        passing.accept()
    fall = -np.diff(energies)
    assert np.all(PASSES * np.array(gains[1:]) <= fall * (1 + 1e-9))
    assert np.all(fall <= PASSES * np.array(gains[:-1]) * (1 + 1e-9))


def test_neighbours_differ_in_colour():
    known = settled()[0]
    order, starts = coloured(known.patch.stars, len(known.patch.vertices))
    colour = np.empty(len(order), np.int64)
    colour[order] = np.repeat(np.arange(len(starts) - 1), np.diff(starts))
    around = known.patch.stars
    owner = np.repeat(np.arange(known.patch.n_cells), np.diff(around.starts.astype(np.int64)))
    inside = around.nodes < known.patch.n_cells
    assert np.all(colour[owner[inside]] != colour[around.nodes[inside]])
    assert sorted(order) == list(range(known.patch.n_cells))


def test_what_is_not_accepted_is_forgotten():
    _, positions, passing, _ = settled()
    before = passing.rotations.copy()
    passing(2 * positions, np.empty_like(positions))
    np.testing.assert_array_equal(passing.rotations, before)
