"""Images as animated PNG, GIF and MP4, read back by Pillow and ffmpeg."""

import os
import sys

import numpy as np
import pytest
from PIL import Image, ImageSequence

from morphlet import FileError, InputError, MissingExtra, write_video

LOSS = 5
"""Steps of 255 by which colours may differ after H.264: video has fewer of them."""


def gradients(count, height=24, width=32):
    """Smooth images, each another: red along, green across, blue in time."""
    along, across = np.linspace(0, 255, width), np.linspace(0, 255, height)
    images = np.empty((count, height, width, 3), np.uint8)
    images[..., 0], images[..., 1] = along, across[:, None]
    images[..., 2] = np.linspace(20, 220, count)[:, None, None]
    return images


def played(path):
    """Images and durations of an animation, in milliseconds."""
    with Image.open(path) as film:
        frames = [(np.array(frame.convert("RGB")), frame.info["duration"]) for frame in ImageSequence.Iterator(film)]
        return np.stack([pixels for pixels, _ in frames]), [duration for _, duration in frames], film.info.get("loop")


def test_png_keeps_every_pixel_and_ends_on_time(tmp_path):
    images = gradients(7)
    write_video(tmp_path / "a.png", iter(images), fps=24)
    pixels, durations, loop = played(tmp_path / "a.png")
    np.testing.assert_array_equal(pixels, images)
    assert durations == pytest.approx([42, 41, 42, 42, 41, 42, 42])
    assert loop == 0


def test_gif_keeps_colors_nearly_and_ends_on_time(tmp_path):
    images = gradients(4)
    write_video(tmp_path / "a.gif", images, fps=30)
    pixels, durations, loop = played(tmp_path / "a.gif")
    assert np.abs(pixels.astype(int) - images).max() <= 24
    assert durations == [30, 40, 30, 30]
    assert loop == 0


def test_equal_images_last_longer_and_one_image_is_a_picture(tmp_path):
    first, second = gradients(2)
    write_video(tmp_path / "a.png", [first, first, first, second], fps=10)
    assert played(tmp_path / "a.png")[1] == [300, 100]
    write_video(tmp_path / "b.png", [first], fps=10)
    with Image.open(tmp_path / "b.png") as still:
        np.testing.assert_array_equal(np.array(still), first)


@pytest.mark.parametrize("ending", [".png", ".gif"])
def test_the_same_images_give_the_same_bytes(tmp_path, ending):
    for name in "ab":
        write_video(tmp_path / f"{name}{ending}", gradients(3))
    assert (tmp_path / f"a{ending}").read_bytes() == (tmp_path / f"b{ending}").read_bytes()


def bytes_of(count, height=4, width=4):
    return [np.zeros((height, width, 3), np.uint8)] * count


@pytest.mark.parametrize(
    ("images", "match"),
    [
        ([], "at least one image; found none"),
        (iter(()), "at least one image"),
        ([*bytes_of(2), *bytes_of(1, 5, 4)], r"images of one size, 4 x 4 pixels; found 4 x 5 in image 2"),
        ([np.zeros((4, 4, 3))], r"bytes of red, green and blue .* shape \(4, 4, 3\) of float64"),
        ([np.zeros((4, 4, 4), np.uint8)], r"shape \(4, 4, 4\)"),
        ([np.zeros((4, 4), np.uint8)], r"shape \(4, 4\)"),
        ([np.zeros((0, 4, 3), np.uint8)], r"shape \(0, 4, 3\)"),
        ([np.zeros((1, 16385, 3), np.uint8)], "at most 16384 a side"),
    ],
)
@pytest.mark.parametrize("ending", [".png", ".gif"])
def test_what_no_video_can_be(tmp_path, images, match, ending):
    with pytest.raises(InputError, match=match):
        write_video(tmp_path / f"a{ending}", images)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(("ending", "fps"), [(".png", 0), (".png", np.nan), (".png", -1), (".png", 1001), (".gif", 51), (".mp4", np.inf)])
def test_rates_out_of_range(tmp_path, ending, fps):
    with pytest.raises(InputError, match="a rate from"):
        write_video(tmp_path / f"a{ending}", bytes_of(2), fps=fps)


def test_unknown_ending_and_no_folder(tmp_path):
    with pytest.raises(FileError, match=r"a video ending in \.png, \.gif, \.mp4"):
        write_video(tmp_path / "a.avi", bytes_of(2))
    with pytest.raises(FileError, match="a writable folder"):
        write_video(tmp_path / "none" / "a.png", bytes_of(2))


def decoded(path):
    """Size and images of a film, as ffmpeg plays it."""
    reader = pytest.importorskip("imageio_ffmpeg").read_frames(str(path))
    told = next(reader)
    width, height = told["size"]
    return told, np.stack([np.frombuffer(frame, np.uint8).reshape(height, width, 3) for frame in reader])


@pytest.mark.parametrize("height", [24, 25])
def test_mp4_shows_every_image_at_its_time_with_even_sizes(tmp_path, height):
    pytest.importorskip("imageio_ffmpeg")
    images = gradients(12, height, 33)
    write_video(tmp_path / "a.mp4", iter(images), fps=6)
    told, pixels = decoded(tmp_path / "a.mp4")
    assert told["size"] == (34, height + height % 2)
    assert (told["fps"], told["duration"], told["codec"]) == (6, 2, "h264")
    assert "yuv420p" in told["pix_fmt"]
    wanted = np.pad(images, ((0, 0), (0, height % 2), (0, 1), (0, 0)), mode="edge").astype(int)
    assert pixels.shape == wanted.shape
    assert np.abs(pixels - wanted).mean() < LOSS
    assert np.argmin(
        np.abs(pixels[None, :, :20, :30, 2].astype(int) - wanted[:, None, :20, :30, 2]).mean(axis=(2, 3)), axis=0
    ).tolist() == list(range(12))


def test_mp4_keeps_colors_and_says_how_to_read_them(tmp_path):
    colors = [(220, 30, 30), (30, 220, 30), (30, 30, 220), (255, 255, 255), (0, 0, 0)]
    pytest.importorskip("imageio_ffmpeg")
    write_video(tmp_path / "a.mp4", [np.full((32, 32, 3), color, np.uint8) for color in colors])
    told, pixels = decoded(tmp_path / "a.mp4")
    assert np.abs(pixels.astype(int) - np.array(colors)[:, None, None]).max() <= LOSS
    assert "bt709" in told["pix_fmt"]


def test_mp4_is_the_same_twice_and_refuses_odd_ones_out(tmp_path):
    pytest.importorskip("imageio_ffmpeg")
    for name in "ab":
        write_video(tmp_path / f"{name}.mp4", gradients(5))
    assert (tmp_path / "a.mp4").read_bytes() == (tmp_path / "b.mp4").read_bytes()
    with pytest.raises(InputError, match="images of one size"):
        write_video(tmp_path / "c.mp4", [*bytes_of(30, 40, 40), *bytes_of(1, 5, 4)])
    assert not (tmp_path / "c.mp4").exists()


@pytest.mark.skipif(os.name != "posix", reason="this system runs no shell scripts")
def test_mp4_says_what_ffmpeg_said(tmp_path, monkeypatch):
    """A program in its place that stops listening, with a word on why."""
    fake = tmp_path / "ffmpeg"
    fake.write_text("#!/bin/sh\necho Unknown encoder >&2\nexit 1\n")
    fake.chmod(0o755)
    monkeypatch.setattr("morphlet.io.video._ffmpeg", lambda: str(fake))
    with pytest.raises(FileError, match=r"ffmpeg to encode H\.264; found Unknown encoder; name another"):
        write_video(tmp_path / "a.mp4", bytes_of(200, 200, 200))


def test_mp4_without_the_extra_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtra, match=r"pip install morphlet\[video\]"):
        write_video(tmp_path / "a.mp4", bytes_of(2))
