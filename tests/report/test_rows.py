"""Meshes side by side: which are shown, in what order, and that none is cut off."""

import numpy as np
import pytest

from morphlet import Arap, MeshSequence, Picture, Roi
from morphlet.editing.script import Edit
from morphlet.report import rows
from morphlet.report.camera import Camera
from morphlet.report.rows import edit_picture, poses_picture, tiled
from support import icosphere

BALL = icosphere(1)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[tuple[np.ndarray, Camera]]:
    """Vertices and camera of everything that is drawn, a pixel each."""
    seen = []

    def draw(mesh, *, colors=None, camera, look=None):
        seen.append((mesh.vertices, camera))
        return Picture(np.full((1, 1, 3), len(seen), np.uint8), "none", "a test")

    monkeypatch.setattr(rows, "render", draw)
    return seen


def inside(vertices: np.ndarray, camera: Camera) -> bool:
    return bool((np.abs(camera.project(vertices))[:, :2] <= camera.extent * (1 + 1e-12)).all())


def test_tiles_fill_rows_and_the_rest_is_white() -> None:
    dots = [Picture(np.full((1, 2, 3), shade, np.uint8), "none", "a test") for shade in range(5)]
    assert tiled(dots, 3).pixels[..., 0].tolist() == [[0, 0, 1, 1, 2, 2], [3, 3, 4, 4, 255, 255]]
    assert tiled(dots[:2], 3).pixels[..., 0].tolist() == [[0, 0, 1, 1]]


@pytest.mark.parametrize(("count", "shape"), [(1, (1, 2)), (2, (1, 3)), (11, (3, 4)), (40, (3, 4))])
def test_an_edit_begins_with_the_rest_and_ends_with_the_last_frame(drawn, count: int, shape: tuple[int, int]) -> None:
    positions = BALL.vertices + np.arange(1, count + 1)[:, None, None] * [3.0, 0, 0]
    edit = Edit("arap", Arap(), Roi(BALL, [0], [1, 2]), (), count > 1)
    picture = edit_picture(edit, MeshSequence(BALL.topology, positions, np.arange(float(count))))
    assert picture.pixels.shape[:2] == shape
    np.testing.assert_array_equal(drawn[0][0], BALL.vertices)
    np.testing.assert_array_equal(drawn[-1][0], positions[-1])
    assert all(inside(vertices, camera) for vertices, camera in drawn)


def test_poses_stand_above_what_they_became_each_row_in_its_own_scale(drawn) -> None:
    pose, large = BALL.with_vertices(BALL.vertices * [1.0, 2.0, 1.0]), BALL.with_vertices(9 * BALL.vertices)
    picture = poses_picture([[BALL, pose, pose], [large, large, large]])
    assert picture.pixels[..., 0].tolist() == [[1, 2, 3], [4, 5, 6]]
    assert all(inside(vertices, camera) for vertices, camera in drawn)
    assert drawn[3][1].extent[1] > 4 * drawn[0][1].extent[1]
