"""A mesh sequence as pictures, one per frame, from one side: what a video is made of."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float

from morphlet.errors import InputError
from morphlet.report.camera import Camera, view
from morphlet.report.look import PLAIN, Look
from morphlet.report.render import Picture, render
from morphlet.report.sheet import follow
from morphlet.surface.sequence import MeshSequence


def film(
    frames: MeshSequence, *, colors: Float[np.ndarray, "k 3"] | None = None, camera: Camera | None = None, look: Look = PLAIN
) -> Iterator[Picture]:
    """Pictures of all frames of a sequence, drawn one by one as they are asked for.

    Parameters
    ----------
    frames
        The mesh that moves.
    colors
        RGB in [0, 1] per vertex or per face, the same in every frame.
    camera
        From which side to look; the best view of the first frame if left out. It moves evenly from the first frame to the last, at such
        a distance that none is cut off.
    look
        Size, engine, edges.

    Returns
    -------
    iterator of Picture
        One per frame, all of one size.

    Raises
    ------
    InputError
        If there are no frames, or (once drawing) the colours do not fit them.
    MissingExtra
        Once drawing, if pyvista is asked for by name and does not work here.

    Notes
    -----
    As `render`, per frame.

    Examples
    --------
    >>> import numpy as np
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh, MeshSequence, film, write_video
    >>> from morphlet.report.look import Look
    >>> ball = Mesh([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], [[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
    >>> growing = MeshSequence(ball.topology, np.stack([ball.vertices, 2 * ball.vertices]), [0.0, 1.0])
    >>> pictures = list(film(growing, look=Look((64, 48), "matplotlib")))
    >>> with TemporaryDirectory() as folder:
    ...     write_video(Path(folder, "growing.png"), [picture.pixels for picture in pictures])
    >>> [picture.pixels.shape for picture in pictures]
    [(48, 64, 3), (48, 64, 3)]
    """
    if not len(frames):
        raise InputError("a sequence of at least one frame", "none", "pass morph.frames(n)")
    eyes = follow(frames, np.arange(len(frames)), view(frames[0]) if camera is None else camera)
    return (render(frames[k], colors=colors, camera=eye, look=look) for k, eye in enumerate(eyes))
