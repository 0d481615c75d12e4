"""Pictures of a sequence: one per frame, none cut off, as the camera says."""

import numpy as np
import pytest

from morphlet import InputError, MeshSequence, film
from morphlet.report.camera import Camera, view
from morphlet.report.look import Look
from morphlet.report.render import render
from support import icosphere

LOOK = Look((96, 72), "matplotlib")
BALL = icosphere(1)


def rolling(frames):
    """A ball that rolls away and grows."""
    steps = np.arange(frames)[:, None, None]
    return MeshSequence(BALL.topology, (1 + steps) * BALL.vertices + steps * [4.0, 0, 0], np.arange(float(frames)))


def test_a_picture_per_frame_of_one_size_and_none_cut_off():
    pictures = [picture.pixels for picture in film(rolling(4), look=LOOK)]
    assert [pixels.shape for pixels in pictures] == [(72, 96, 3)] * 4
    for pixels in pictures:
        edge = np.concatenate([pixels[0], pixels[-1], pixels[:, 0], pixels[:, -1]])
        assert (edge == 255).all()
        assert (pixels < 255).any()


def test_one_frame_is_its_picture_in_its_colors():
    colors = (BALL.vertices + 1) / 2
    (picture,) = film(rolling(1), colors=colors, look=LOOK)
    expected = render(BALL, colors=colors, camera=view(BALL).framed(BALL), look=LOOK)
    np.testing.assert_array_equal(picture.pixels, expected.pixels)
    (other,) = film(rolling(1), colors=colors, camera=Camera(np.diag([-1.0, 1, -1]) @ view(BALL).axes, np.zeros(3), np.ones(2)), look=LOOK)
    assert (other.pixels != picture.pixels).any()


def test_frames_are_drawn_as_they_are_asked_for():
    pictures = film(rolling(2), colors=np.zeros((5, 3)), look=LOOK)
    with pytest.raises(InputError, match="one row per vertex"):
        next(pictures)
    with pytest.raises(InputError, match="a sequence of at least one frame"):
        film(MeshSequence(BALL.topology, np.zeros((0, BALL.n_vertices, 3)), []), look=LOOK)
