"""The patch against the whole mesh: its layers by hand, its energy up to a constant, its residual as a gradient."""

import numpy as np
import pytest

from editing.capped import capped, patch_of_grid, whole_energy
from morphlet import Mesh
from morphlet.editing.kernels import reached, stars, sweep, turned
from morphlet.editing.patch import half_cotangents, layers, patch, reordered
from morphlet.editing.roi import Roi
from morphlet.editing.system import system
from morphlet.surface.operators import laplacian
from support import blob


def only(mesh: Mesh, *vertices: int) -> np.ndarray:
    mask = np.zeros(mesh.n_vertices, bool)
    mask[list(vertices)] = True
    return mask


def test_layers_of_one_unknown():
    """On the grid an inner vertex has six neighbours, and their faces reach two steps: 5 x 5 less the two corners off the diagonal."""
    mesh = patch_of_grid(7)
    among = layers(mesh, only(mesh, 3 * 7 + 3))
    assert among.unknowns.tolist() == [24]
    assert among.ring.tolist() == [16, 17, 23, 25, 31, 32]
    assert len(among.rim) == 12
    assert len(among.faces) == 24


def test_layers_at_the_boundary():
    mesh = patch_of_grid(4)
    among = layers(mesh, only(mesh, 0))
    assert (among.ring.tolist(), len(among.unknowns)) == ([1, 4, 5], 1)
    assert set(among.rim) == {2, 6, 8, 9, 10}


def test_half_cotangents_by_hand():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0.5, np.sqrt(0.75), 0]])
    np.testing.assert_allclose(half_cotangents(corners, np.array([[0, 1, 2]])), [[0, 0.5, 0.5]], atol=1e-15)
    np.testing.assert_allclose(half_cotangents(corners, np.array([[0, 1, 3]])), 0.5 / np.sqrt(3) * np.ones((1, 3)))


def test_thin_faces_have_large_finite_weights():
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [0.5, 0, 0], [0.5, 1e-12, 0]])
    found = half_cotangents(corners, np.array([[0, 1, 2], [0, 1, 3], [1, 1, 1]]))
    assert np.isfinite(found).all()
    assert 1e7 < np.abs(found[:2]).max() < 5.1e7
    assert (found[2] == 0).all()
    # still a Dirichlet energy: the products of pairs sum up to at least zero
    assert np.all(found[:, 0] * found[:, 1] + found[:, 1] * found[:, 2] + found[:, 2] * found[:, 0] >= -1e-6 * found.max() ** 2)


def disturbed(known, amount: float, seed: int = 0) -> np.ndarray:
    positions, rng = known.patch.rest.copy(), np.random.default_rng(seed)
    positions[: known.patch.n_unknowns] += amount * rng.normal(size=(known.patch.n_unknowns, 3))
    return positions


def placed(known, mesh: Mesh, positions: np.ndarray) -> np.ndarray:
    out = np.array(mesh.vertices)
    out[known.patch.vertices] = positions
    return out


@pytest.mark.parametrize("mesh", [blob(2), patch_of_grid(6)], ids=["closed", "boundary"])
@pytest.mark.parametrize("least", [-np.inf, 0.1])
def test_energy_differs_from_the_whole_by_nothing(mesh, least):
    """Cells outside the patch keep their shape, so that they add nothing."""
    known = system(capped(mesh), least)
    for amount in (0.0, 0.1, 1.0):
        positions = disturbed(known, amount)
        found = sweep(known.patch.stars, positions, np.empty_like(positions)) + known.patch.constant(positions)
        expected = whole_energy(mesh, placed(known, mesh, positions), least)
        np.testing.assert_allclose(found, expected, rtol=1e-10, atol=1e-10)


def test_residual_is_minus_half_the_gradient():
    mesh = blob(1)
    known = system(capped(mesh))
    positions, step = disturbed(known, 0.2), 1e-5
    residual = np.empty_like(positions)
    sweep(known.patch.stars, positions, residual)
    for unknown, axis in [(0, 0), (3, 1), (known.patch.n_unknowns - 1, 2)]:
        sides = []
        for sign in (1, -1):
            other = positions.copy()
            other[unknown, axis] += sign * step
            sides.append(whole_energy(mesh, placed(known, mesh, other)))
        np.testing.assert_allclose(-2 * residual[unknown, axis], (sides[0] - sides[1]) / (2 * step), rtol=1e-6, atol=1e-8)


def test_three_faces_at_an_edge():
    """Cells gather whatever faces they have."""
    fins = Mesh(
        [[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.2], [0.5, 0.1, 1], [0.5, 2, 0.3]],
        [[0, 1, 2], [1, 0, 3], [0, 1, 4], [2, 1, 5]],
    )
    known = system(Roi(fins, [4], [0, 1, 2]))
    positions = disturbed(known, 0.3)
    found = sweep(known.patch.stars, positions, np.empty_like(positions)) + known.patch.constant(positions)
    np.testing.assert_allclose(found, whole_energy(fins, placed(known, fins, positions)), rtol=1e-12)


def test_given_rotations_leave_the_same_residual():
    """With all rotations the identity the residual is -L times the displacement."""
    mesh = blob(2)
    known = system(capped(mesh))
    positions = disturbed(known, 0.1)
    residual = np.empty_like(positions)
    turned(known.patch.stars, positions, np.tile(np.eye(3).ravel(), (known.patch.n_cells, 1)), residual)
    expected = -laplacian(mesh) @ (placed(known, mesh, positions) - mesh.vertices)
    u = known.patch.n_unknowns
    np.testing.assert_allclose(residual[:u], expected[known.patch.vertices[:u]], atol=1e-12)


def test_stiffness_is_the_laplacian_diagonal():
    mesh = blob(2)
    known = system(capped(mesh))
    u = known.patch.n_unknowns
    np.testing.assert_allclose(known.patch.stiffness, laplacian(mesh).diagonal()[known.patch.vertices[:u]], rtol=1e-12)


def test_reordering_keeps_everything():
    mesh = blob(2)
    among = layers(mesh, only(mesh, *range(40)))
    first = patch(mesh, among)
    order = np.random.default_rng(0).permutation(40)
    again = reordered(first, order)
    np.testing.assert_array_equal(again.vertices[:40], first.vertices[:40][order])
    np.testing.assert_array_equal(again.rest, mesh.vertices[again.vertices])
    np.testing.assert_allclose(again.stiffness, first.stiffness[order], rtol=1e-13)
    np.testing.assert_allclose(again.scale, first.scale, rtol=1e-13)
    afresh = stars(again.faces, again.rest, again.cotangents, again.n_cells, 40)
    for cell in range(again.n_cells):
        entries = [
            np.argsort(found.nodes[found.starts[cell] : found.starts[cell + 1]]) + found.starts[cell] for found in (again.stars, afresh)
        ]
        for kept, made in zip(again.stars[1:], afresh[1:], strict=True):
            np.testing.assert_allclose(kept[entries[0]], made[entries[1]], atol=1e-13)


def test_what_is_joined_to_the_held():
    """Two strips; of one nothing is held. Vertices beyond the unknowns are joined to nothing by their own stars."""
    strip = np.array([[0, 1, 2], [1, 3, 2]])
    rest = np.random.default_rng(0).normal(size=(8, 3))
    around = stars(np.vstack([strip, strip + 4]), rest, np.ones((4, 3)), 8, 8)
    assert reached(around, np.arange(8) == 7, 8).tolist() == 4 * [False] + 4 * [True]
    assert reached(around, np.arange(8) == 0, 8).tolist() == 4 * [True] + 4 * [False]
    assert not reached(around, np.zeros(8, bool), 8).any()
