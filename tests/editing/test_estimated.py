"""Linear editing with estimated rotations: how the handle turned, and where that leads."""

import numpy as np
import pytest
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from editing.capped import capped, moved
from morphlet import InputError
from morphlet.editing.editor import RoiEditor, edit
from morphlet.editing.estimated import EstimatedRotations, handle_turns, spread
from morphlet.editing.roi import Roi
from morphlet.editing.system import system
from morphlet.surface.operators import laplacian
from support import blob


def two_handles() -> Roi:
    """One at the top, one at the bottom of a body whose waist follows but for a ring that stays."""
    mesh = blob(2)
    order = np.argsort(mesh.vertices[:, 2], kind="stable")
    return Roi(mesh, np.concatenate([order[:20], order[-20:]]), np.concatenate([order[20:70], order[90:-20]]))


def test_turns_of_a_turned_handle():
    roi = capped(blob(2))
    turn = [0.5, -1.0, 0.7]
    np.testing.assert_allclose(handle_turns(roi, moved(roi.mesh.vertices[roi.handle], turn, [3, 4, 5])), [turn], atol=1e-12)


def test_each_piece_has_its_own_turn():
    roi = two_handles()
    rest = roi.mesh.vertices[roi.handle]
    targets = np.vstack([moved(rest[:20], [0, 0, 0.8], [0, 0, 0]), moved(rest[20:], [0.3, 0, 0], [1, 0, 0])])
    parts = roi.handle_parts[[0, -1]]
    np.testing.assert_allclose(handle_turns(roi, targets)[parts], [[0, 0, 0.8], [0.3, 0, 0]], atol=1e-12)


def test_one_vertex_does_not_turn():
    roi = Roi(blob(1), [3], np.delete(np.arange(30), 3))
    assert handle_turns(roi, np.array([[9.0, 9, 9]])).tolist() == [[0, 0, 0]]


def test_a_line_turns_no_more_than_it_must():
    mesh = blob(1)
    i, j = mesh.topology.edges[0]
    roi = Roi(mesh, [i, j], [])
    a = mesh.vertices[j] - mesh.vertices[i]
    axis = np.cross(a, [0, 0, 1])
    b = Rotation.from_rotvec(0.6 * axis / np.linalg.norm(axis)).apply(a)
    found = handle_turns(roi, np.array([[0, 0, 0], b]))
    np.testing.assert_allclose(found, [0.6 * axis / np.linalg.norm(axis)], atol=1e-7)


def test_turns_add_up_beyond_half_a_circle():
    roi = capped(blob(2))
    rest, turns = roi.mesh.vertices[roi.handle], None
    for angle in np.linspace(0, 4 * np.pi, 25)[1:]:
        turns = handle_turns(roi, moved(rest, [0, angle * 0.6, angle * 0.8], [0, 0, 0]), turns)
        np.testing.assert_allclose(turns, [[0, angle * 0.6, angle * 0.8]], atol=1e-7)
    for angle in np.linspace(4 * np.pi, 0, 25)[1:]:
        turns = handle_turns(roi, moved(rest, [0, angle * 0.6, angle * 0.8], [0, 0, 0]), turns)
    np.testing.assert_allclose(turns, [[0, 0, 0]], atol=1e-7)


def test_rotations_are_spread_harmonically():
    """Two pieces turn; between them and the anchors the rotation vectors solve Laplace's equation, told by another solver."""
    roi = two_handles()
    turns = np.zeros((2, 3))
    turns[roi.handle_parts[[0, -1]]] = [[0, 0, 0.8], [0.5, 0, 0]]
    known = system(roi)
    L, free = laplacian(roi.mesh).tocsc(), roi.free
    vectors = np.zeros((roi.mesh.n_vertices, 3))
    vectors[roi.handle] = turns[roi.handle_parts]
    vectors[free] = spsolve(L[free][:, free], -(L @ vectors)[free])
    found = spread(known, known.solve, turns).reshape(-1, 3, 3)
    expected = Rotation.from_rotvec(vectors[known.patch.vertices[: known.patch.n_cells]]).as_matrix()
    np.testing.assert_allclose(found, expected, atol=1e-10)


def test_a_translation_is_spread_harmonically():
    roi = capped(blob(2))
    shift = np.array([0.3, 0.1, 0.7])
    L, free = laplacian(roi.mesh).tocsc(), roi.free
    displacement = np.zeros((roi.mesh.n_vertices, 3))
    displacement[roi.handle] = shift
    displacement[free] = spsolve(L[free][:, free], -(L @ displacement)[free])
    found = edit(roi, roi.mesh.vertices[roi.handle] + shift, EstimatedRotations())
    np.testing.assert_allclose(found.vertices, roi.mesh.vertices + displacement, atol=1e-11)


def test_linear_in_the_translation():
    roi = capped(blob(2))
    editor, rest = RoiEditor.prepare(roi, EstimatedRotations()), roi.mesh.vertices
    one, three = (editor.solve(rest[roi.handle] + k * np.array([0.1, 0.2, 0.3])).vertices - rest for k in (1, 3))
    np.testing.assert_allclose(three, 3 * one, atol=1e-11)


def test_told_turns_matter():
    """A full turn leaves the handle where it is, and the mesh twisted."""
    roi = capped(blob(2))
    editor, rest = RoiEditor.prepare(roi, EstimatedRotations()), roi.mesh.vertices
    twisted = editor.solve(rest[roi.handle], turns=[[0, 0, 2 * np.pi]]).vertices
    assert np.abs(twisted - rest).max() > 0.1
    np.testing.assert_array_equal(twisted[roi.handle], rest[roi.handle])


def test_turns_must_fit():
    roi = capped(blob(1))
    with pytest.raises(InputError, match=r"turns of shape \(1, 3\)"):
        RoiEditor.prepare(roi, EstimatedRotations()).solve(roi.mesh.vertices[roi.handle], turns=np.zeros((3, 3)))
