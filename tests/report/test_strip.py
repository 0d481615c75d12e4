"""Strips of frames and curves of coordinates: sizes, what is shown, what is refused."""

import numpy as np
import pytest

from morphlet import MeshSequence, Morph
from morphlet.errors import InputError
from morphlet.report.curves import coordinate_picture
from morphlet.report.look import Look
from morphlet.report.strip import PAD, frame_strip
from support import icosphere

BALL = icosphere(1)
FRAMES = Morph(BALL, BALL.vertices * [1, 1, 3] + [2, 0, 0]).frames(9)
SMALL = Look((60, 48), "matplotlib")


@pytest.mark.parametrize(("count", "shown"), [(1, 1), (4, 4), (20, 9)])
def test_as_many_frames_as_asked_for(count, shown):
    assert frame_strip(FRAMES, count, SMALL).pixels.shape[1] == shown * 60 + 2 * PAD


def test_first_and_last_frame_are_at_the_ends_in_one_camera():
    strip = frame_strip(FRAMES, 3, SMALL).pixels[PAD : PAD + 48].astype(float)
    tiles = [strip[:, PAD + 60 * k : PAD + 60 * (k + 1)] for k in range(3)]
    seen = [np.any(tile < 250, axis=2) for tile in tiles]
    assert all(area.any() for area in seen)
    assert not any(area[[0, -1]].any() or area[:, [0, -1]].any() for area in seen)  # nothing is cut off
    extent = [np.ptp(np.flatnonzero(area.any(axis=1))) / np.ptp(np.flatnonzero(area.any(axis=0))) for area in seen]
    assert max(extent[2], 1 / extent[2]) > 1.3 * max(extent[0], 1 / extent[0])


def test_given_colours_are_worn():
    red = np.tile([1.0, 0.0, 0.0], (BALL.n_vertices, 1))
    pixels = frame_strip(FRAMES, 2, SMALL, red).pixels[PAD : PAD + 48].reshape(-1, 3).astype(int)
    drawn = pixels[(pixels < 250).any(axis=1)]
    assert (drawn[:, 0] >= drawn[:, 1:].max(axis=1)).all()


def test_nothing_to_show_is_refused():
    with pytest.raises(InputError, match="at least one frame to show; found 0 of 9"):
        frame_strip(FRAMES, 0)
    with pytest.raises(InputError, match="at least one frame to show"):
        frame_strip(MeshSequence(BALL.topology, np.zeros((0, BALL.n_vertices, 3)), []))


def test_curves_of_coordinates_show_what_moved():
    before = np.random.default_rng(0).random((50, 3))
    still, moved = coordinate_picture(before, before).pixels, coordinate_picture(before, before + np.array([0, 3, 0])).pixels
    assert still.shape == moved.shape == (720, 720, 3)
    thirds = [np.abs(still[a:b].astype(int) - moved[a:b]).max() for a, b in ((0, 215), (240, 430), (455, 660))]
    assert thirds[0] == thirds[2] == 0 < thirds[1]


def test_coordinates_of_different_shapes_are_refused():
    with pytest.raises(InputError, match="deformed of shape"):
        coordinate_picture(np.zeros((4, 3)), np.zeros((5, 3)))
    with pytest.raises(InputError, match="at least one vertex"):
        coordinate_picture(np.zeros((0, 3)), np.zeros((0, 3)))
