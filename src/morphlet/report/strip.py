"""A strip of frames: a mesh on its way, side by side, as in the paper's Figures 13 to 16."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from morphlet.errors import InputError
from morphlet.report import canvas
from morphlet.report.camera import view
from morphlet.report.canvas import Tile
from morphlet.report.color import place_colors
from morphlet.report.look import Look
from morphlet.report.render import Picture, render
from morphlet.report.sheet import follow
from morphlet.surface.sequence import MeshSequence

FRAMES = 6
"""Of a strip, if there are as many."""
STRIP = Look(size=(300, 240))
"""A frame of the strip."""
PAD = 8
"""Space round the strip, in pixels."""


def frame_strip(frames: MeshSequence, count: int = FRAMES, look: Look = STRIP, colors: Float[np.ndarray, "n 3"] | None = None) -> Picture:
    """Some frames of a sequence side by side, from the first to the last, with their times.

    Parameters
    ----------
    frames
        The sequence.
    count
        How many to show, evenly spread; all if there are fewer.
    look
        Size of a frame, and engine.
    colors
        Colour of each vertex; that of its place in the first frame if left out.

    Returns
    -------
    Picture
        As wide as the frames together. One camera for all: its direction fits the first frame, and nothing is cut off.

    Raises
    ------
    InputError
        If the sequence is empty, or `count` is not positive.

    Notes
    -----
    One `render` per frame shown.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet import Mesh, MeshSequence
    >>> from morphlet.report.look import Look
    >>> from morphlet.report.strip import frame_strip
    >>> ball = Mesh([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    >>> grows = MeshSequence(ball.topology, np.stack([ball.vertices, 2 * ball.vertices]), [0.0, 1.0])
    >>> frame_strip(grows, look=Look((80, 60), "matplotlib")).pixels.shape
    (102, 176, 3)
    """
    if not len(frames) or count < 1:
        raise InputError("at least one frame to show", f"{count} of {len(frames)}", "pass morph.frames(n), and a positive count")
    chosen = np.unique(np.rint(np.linspace(0, len(frames) - 1, min(count, len(frames)))).astype(np.int64))
    worn = place_colors(frames.positions[0]) if colors is None else colors
    cameras = follow(frames, chosen, view(frames[0]))
    drawn = [render(frames[int(k)], colors=worn, camera=eye, look=look) for k, eye in zip(chosen, cameras, strict=True)]
    width, height = look.size
    figure = canvas.sheet(len(drawn) * width + 2 * PAD, height + canvas.CAPTION + 2 * PAD)
    for number, (k, picture) in enumerate(zip(chosen, drawn, strict=True)):
        canvas.place(figure, Tile(picture.pixels, f"t = {frames.times[k]:.3g}"), PAD + number * width, PAD)
    return replace(drawn[0], pixels=canvas.pixels(figure))
