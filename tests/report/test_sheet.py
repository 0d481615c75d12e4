"""Sheets: their size, what stands where, and that no frame is cut off."""

import numpy as np
import pytest

from morphlet import InputError, Mesh, MeshSequence
from morphlet.report.camera import view
from morphlet.report.color import ColorScale, place_colors
from morphlet.report.look import Look
from morphlet.report.sheet import Mapped, contact_sheet, follow, image_picture, sphere_picture

LOOK = Look((96, 72), "matplotlib")
OCTAHEDRON = Mesh(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]],
    [[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]],
)
LONG = OCTAHEDRON.with_vertices(OCTAHEDRON.vertices * [1, 1, 3])
END = Mapped(LONG, OCTAHEDRON, np.linspace(0, 1, 8))


def sequence(count, growth=1.0):
    times = np.linspace(0, 1, count)
    return MeshSequence(LONG.topology, LONG.vertices * (1 + growth * times[:, None, None]), times)


def ink(pixels):
    return (pixels < 250).any(axis=2)


@pytest.mark.parametrize(("count", "rows"), [(1, 2), (4, 2), (8, 3), (12, 4), (40, 4)])
def test_the_sheet_holds_at_most_twelve_frames(count, rows):
    pixels = contact_sheet(END, END, sequence(count), look=LOOK).pixels
    assert pixels.shape == (rows * (72 + 26) + 56 + 32, 4 * 96 + 32, 3)


def test_every_tile_of_the_sheet_shows_something():
    sheet = contact_sheet(END, END, sequence(12), target_colors=place_colors(LONG.vertices), look=LOOK)
    assert sheet.engine == "matplotlib"
    for row in range(5):
        top = 16 + row * 98 + (56 if row else 0)
        for column in range(4):
            tile = sheet.pixels[top : top + 72, 16 + 96 * column : 16 + 96 * (column + 1)]
            assert 0.05 < ink(tile).mean() < 0.9
            caption = sheet.pixels[top + 73 : top + 97, 16 + 96 * column : 16 + 96 * (column + 1)]
            assert ink(caption).any()


def test_the_sheet_has_a_color_bar_and_is_the_same_each_time():
    first = contact_sheet(END, END, sequence(2), look=LOOK).pixels
    bar = first[16 + 98 : 16 + 98 + 12, 16 + 130 : 16 + 254]
    assert ink(bar).mean() > 0.9
    assert bar[6, -1].sum() < bar[6, 0].sum() - 200
    np.testing.assert_array_equal(first, contact_sheet(END, END, sequence(2), look=LOOK).pixels)


def test_carried_colors_show_on_the_target():
    red = np.tile([1.0, 0.0, 0.0], (6, 1))
    pixels = contact_sheet(END, END, sequence(1), target_colors=red, look=LOOK).pixels.astype(int)
    tile = pixels[16 + 98 + 56 :, 16 + 96 :][:72, :96]
    inside = ink(tile)
    assert np.all(tile[inside][:, 0] >= tile[inside][:, 1])
    assert np.median(tile[inside][:, 0] - tile[inside][:, 1]) > 80


def test_the_camera_follows_evenly_and_cuts_nothing_off():
    frames = sequence(5, growth=4.0)
    chosen = np.arange(5)
    cameras = list(follow(frames, chosen, view(LONG)))
    for k, camera in zip(chosen, cameras, strict=True):
        seen = np.abs(camera.project(frames.positions[k])[:, :2]).max(axis=0)
        assert np.all(seen <= camera.extent * (1 + 1e-12))
        np.testing.assert_array_equal(camera.axes, cameras[0].axes)
    steps = np.diff([camera.extent for camera in cameras], axis=0)
    np.testing.assert_allclose(steps, np.broadcast_to(steps[0], steps.shape), rtol=1e-9)


def test_the_camera_follows_a_frame_that_leaves_the_straight_way():
    positions = np.stack([LONG.vertices, LONG.vertices * 3 + [9, 0, 0], LONG.vertices])
    frames = MeshSequence(LONG.topology, positions, [0.0, 0.5, 1.0])
    middle = list(follow(frames, np.arange(3), view(LONG)))[1]
    assert np.all(np.abs(middle.project(positions[1])[:, :2]).max(axis=0) <= middle.extent * (1 + 1e-12))


def test_an_empty_morph_is_refused():
    with pytest.raises(InputError, match="at least one frame"):
        contact_sheet(END, END, MeshSequence(LONG.topology, np.zeros((0, 6, 3)), np.zeros(0)), look=LOOK)


def test_colors_of_another_mesh_are_refused():
    with pytest.raises(InputError, match=r"one row per vertex \(6\) or face \(8\)"):
        contact_sheet(END, END, sequence(1), target_colors=np.ones((5, 3)), look=LOOK)


def test_a_sphere_of_another_mesh_is_refused():
    with pytest.raises(InputError, match="sphere over the faces of its mesh"):
        Mapped(LONG, Mesh(OCTAHEDRON.vertices, OCTAHEDRON.faces[:7]), np.ones(8))
    with pytest.raises(InputError, match="distortion of shape"):
        Mapped(LONG, OCTAHEDRON, np.ones(6))


def test_the_sphere_picture_shows_mesh_sphere_and_histogram():
    picture = sphere_picture(END, Look((200, 160), "matplotlib", scale=ColorScale(0, 1, label="stretch")))
    assert picture.pixels.shape == (160 + 26 + 56 + 32, 600 + 32, 3)
    for left in (16, 216, 416):
        assert ink(picture.pixels[16:176, left : left + 200]).mean() > 0.05


def test_an_image_is_shown_from_lowest_to_highest_within_its_mask():
    image = np.zeros((2, 3, 3))
    image[0, 1], image[1, 0], image[1, 2] = (4, 0, 0), (0, -2, 0), (np.nan, np.inf, 9)
    mask = np.ones((2, 3), bool)
    mask[1, 2] = False
    pixels = image_picture(image, mask).pixels
    assert pixels[0, 1].tolist() == [255, 255, 0]
    assert pixels[1, 0].tolist() == [0, 0, 0]
    assert pixels[1, 2].tolist() == [255, 255, 255]


def test_a_broken_image_is_refused():
    with pytest.raises(InputError, match="image within its mask"):
        image_picture(np.full((2, 2, 3), np.nan))
    with pytest.raises(InputError, match=r"an image \(h, w, 3\)"):
        image_picture(np.zeros((2, 2)))
    with pytest.raises(InputError, match=r"mask \(h, w\)"):
        image_picture(np.zeros((2, 2, 3)), np.ones((3, 2), bool))
