"""Images one after the other as a file that plays: animated PNG, GIF, or MP4.

PNG keeps every pixel, GIF the 256 best colours of each image; both repeat without end, and an image that equals the one before only makes
that one last longer. MP4 is H.264 at a quality at which the loss is hard to see, with chroma at half the resolution, which every player
shows; ffmpeg encodes it, as a program of its own.
"""

import io
import math
import os
import subprocess
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from importlib import import_module
from itertools import chain
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from morphlet.errors import FileError, InputError, MissingExtra
from morphlet.io.formats import put

Pixels = UInt8[np.ndarray, "h w 3"]

FPS = 12.0
"""Images a second, unless said: as in drawn films, and as `write_animation` plays 24 frames."""
SLOWEST = 1 / 60
"""Fewest images a second: a PNG's longest image in milliseconds is 65 s."""
FASTEST = {".png": 1000, ".gif": 50, ".mp4": 1000}
"""Most images a second: PNG counts milliseconds; browsers slow a GIF down whose images last less than two hundredths."""
MOST_PIXELS = 16384
"""Longest side: more H.264 has not."""
PNG_TICK, GIF_TICK = 1, 10
"""What image durations are whole multiples of, in milliseconds."""
QUALITY = "18"
"""Constant rate factor of H.264: from here downwards the loss is hard to see."""
TO_VIDEO = "scale=out_color_matrix=bt709:out_range=tv,setparams=range=tv:colorspace=bt709:color_primaries=bt709:color_trc=iec61966-2-1"
TAGS = ("-colorspace", "bt709", "-color_primaries", "bt709", "-color_trc", "iec61966-2-1", "-color_range", "tv")
"""How colours become those of video, and the file's word for it, said for new and old versions: players guess otherwise, by size."""
SAME_BITS = ("-threads", "1", "-fflags", "+bitexact", "-flags:v", "+bitexact")
"""The same file on every machine: more threads would cut the film otherwise, and the program would leave its version."""


def write_video(path: str | os.PathLike[str], images: Iterable[Pixels], *, fps: float = FPS) -> None:
    """Write images as a file that plays.

    Parameters
    ----------
    path
        Ends in `.png` (animated), `.gif` or `.mp4`. An existing file is replaced once the new one is complete.
    images
        Red, green, blue, rows from the top, all of one size. MP4 wants even sizes: its last column or row is repeated where they are odd.
    fps
        Images a second, at most 50 in a GIF. PNG and GIF round each image's end to whole milliseconds and hundredths of a second.

    Raises
    ------
    FileError
        If the path ends otherwise, the file cannot be written, or ffmpeg fails.
    InputError
        If there are no images, they differ in size or are no bytes of red, green and blue, or the rate is out of range.
    MissingExtra
        If the path ends in `.mp4` and imageio-ffmpeg is not installed.

    Notes
    -----
    O(pixels). For PNG and GIF all images are held in memory; for MP4 one at a time, so that they may be drawn as they are needed.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import write_video
    >>> fading = [np.full((4, 6, 3), shade, np.uint8) for shade in (0, 100, 200)]
    >>> with TemporaryDirectory() as folder:
    ...     write_video(Path(folder, "fading.gif"), fading)
    ...     Path(folder, "fading.gif").read_bytes()[:6]
    b'GIF89a'
    """
    check_video(path, fps)
    put(path, ENCODERS[Path(path).suffix.lower()](_checked(images), fps))


def check_video(path: str | os.PathLike[str], fps: float) -> None:
    """Refuse an ending, a rate, or a missing encoder before the first image is drawn."""
    ending = Path(path).suffix.lower()
    if ending not in ENCODERS:
        raise FileError(f"a video ending in {', '.join(ENCODERS)}", str(path), "rename the output")
    if not (math.isfinite(fps) and SLOWEST <= fps <= FASTEST[ending]):
        needed = f"a rate from {SLOWEST:.3g} to {FASTEST[ending]} images a second in {ending}"
        raise InputError(needed, f"{fps:g}", f"leave it out, or try {FPS:g}")
    if ending == ".mp4":
        _ffmpeg()


def _checked(images: Iterable[Pixels]) -> Iterator[Pixels]:
    """The images; each must be one, and as large as the first; there must be one at least."""
    size: tuple[int, ...] | None = None
    for number, image in enumerate(images):
        pixels = np.ascontiguousarray(image)
        size = size or pixels.shape
        if pixels.dtype != np.uint8 or pixels.ndim != 3 or pixels.shape[2] != 3 or not 0 < min(pixels.shape) <= max(size) <= MOST_PIXELS:
            needed = f"bytes of red, green and blue (h, w, 3), at most {MOST_PIXELS} a side, as image {number}"
            raise InputError(needed, f"shape {pixels.shape} of {pixels.dtype}", "pass the pixels of a picture", [number])
        if pixels.shape != size:
            found = f"{_size(pixels.shape)} in image {number}"
            raise InputError(f"images of one size, {_size(size)} pixels", found, "draw them all with one look", [number])
        yield pixels
    if size is None:
        raise InputError("at least one image", "none", "pass the images of the video")


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} x {shape[0]}"


def _png(images: Iterator[Pixels], fps: float) -> bytes:
    return _pillow("PNG", images, fps, PNG_TICK)


def _gif(images: Iterator[Pixels], fps: float) -> bytes:
    return _pillow("GIF", images, fps, GIF_TICK)


def _pillow(name: str, images: Iterator[Pixels], fps: float, tick: int) -> bytes:
    """An animation by the library that knows its format by this name; durations are whole ticks."""
    from PIL import Image

    first, *others = (Image.fromarray(pixels) for pixels in images)
    ends = tick * np.rint(np.arange(len(others) + 2) * 1000 / fps / tick).astype(np.int64)
    stream = io.BytesIO()
    first.save(stream, name, save_all=True, append_images=others, duration=np.diff(ends).tolist(), loop=0)
    return stream.getvalue()


def _mp4(images: Iterator[Pixels], fps: float) -> bytes:
    """H.264 by ffmpeg, whose answer is read from a folder of its own: it goes back in the file to put the index first."""
    program = _ffmpeg()
    first = _even(next(images))
    with tempfile.TemporaryDirectory() as folder, open(Path(folder, "said"), "w+b") as said:
        film = Path(folder, "film.mp4")
        command = [program, *_words((first.shape[1], first.shape[0]), fps), str(film)]
        running = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=said, stderr=said)
        _feed(running, chain([first], map(_even, images)))
        said.seek(0)
        if running.returncode:
            words = said.read().decode("utf-8", "replace").strip() or f"exit status {running.returncode}"
            advice = "name another ffmpeg in IMAGEIO_FFMPEG_EXE, or write .png or .gif"
            raise FileError("ffmpeg to encode H.264", words.splitlines()[0], advice)
        return film.read_bytes()


def _feed(running: subprocess.Popen[bytes], images: Iterator[Pixels]) -> None:
    """Hand images to a program that may stop listening, and wait for its end."""
    with suppress(BrokenPipeError), running, running.stdin or io.BytesIO() as stream:
        for pixels in images:
            stream.write(pixels.tobytes())


def _even(pixels: Pixels) -> Pixels:
    """The image with its last row and column repeated where their number is odd."""
    height, width, _ = pixels.shape
    return np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")


def _words(size: tuple[int, int], fps: float) -> list[str]:
    """What ffmpeg is told: raw images come in on its standard input."""
    coming = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{size[0]}x{size[1]}", "-r", repr(float(fps)), "-i", "-"]
    going = ["-an", "-vf", TO_VIDEO, "-c:v", "libx264", "-crf", QUALITY, "-pix_fmt", "yuv420p", *TAGS, *SAME_BITS]
    return ["-v", "error", *coming, *going, "-movflags", "+faststart"]


def _ffmpeg() -> str:
    """Where the program is."""
    try:
        return import_module("imageio_ffmpeg").get_ffmpeg_exe()
    except (ImportError, RuntimeError) as error:
        advice = "pip install morphlet[video], or write .png or .gif"
        raise MissingExtra("imageio-ffmpeg for .mp4", str(error), advice) from error


ENCODERS: dict[str, Callable[[Iterator[Pixels], float], bytes]] = {".png": _png, ".gif": _gif, ".mp4": _mp4}
"""What encodes a video with this ending."""
