"""A mesh sequence as numbered files in a folder, or as one file that plays."""

import math
import os
from pathlib import Path

from morphlet.errors import FileError, InputError
from morphlet.io import gltf
from morphlet.io.content import Attributes
from morphlet.io.formats import format_by_ending, prepare_rewrite, put, read_attributes
from morphlet.surface.sequence import MeshSequence

DIGITS = 3
"""Fewest digits of a frame number."""
DURATION = 2.0
"""Seconds that an animation lasts: 24 frames then come at 12 a second, as in drawn films."""


def write_sequence(
    folder: str | os.PathLike[str],
    sequence: MeshSequence,
    *,
    template: str | os.PathLike[str] | None = None,
    ending: str = ".ply",
) -> list[Path]:
    """Write each frame of a sequence as `frame-000.ply`, `frame-001.ply`, ...

    Parameters
    ----------
    folder
        Where the files go; made if missing.
    sequence
        The frames. Their times are not written.
    template
        A file with as many vertices whose faces and attributes every frame keeps, as with `rewrite`.
    ending
        Format of the files.

    Returns
    -------
    list of Path
        The files, in frame order. Numbers have three digits, or as many as the last frame needs.

    Raises
    ------
    FileError
        If the ending is unknown, the template cannot be read, or a file cannot be written.
    InputError
        If the template has another number of vertices.

    Notes
    -----
    O(frames n). The template is read once.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh, MeshSequence
    >>> from morphlet.io.sequences import write_sequence
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> sequence = MeshSequence(mesh.topology, np.stack([mesh.vertices, 2 * mesh.vertices]), [0.0, 1.0])
    >>> with TemporaryDirectory() as folder:
    ...     [file.name for file in write_sequence(folder, sequence, ending=".obj")]
    ['frame-000.obj', 'frame-001.obj']
    """
    place = Path(folder)
    target = format_by_ending(f"frame{ending}")
    render = prepare_rewrite(template, ending) if template is not None else lambda mesh: target.render(mesh, Attributes())
    digits = max(DIGITS, len(str(len(sequence) - 1)))
    files = [place / f"frame-{frame:0{digits}d}{ending}" for frame in range(len(sequence))]
    _make(place)
    for frame, file in enumerate(files):
        put(file, render(sequence[frame]))
    return files


def write_animation(
    path: str | os.PathLike[str],
    sequence: MeshSequence,
    *,
    template: str | os.PathLike[str] | None = None,
    duration: float = DURATION,
) -> None:
    """Write a sequence as one binary glTF file that plays in viewers and browsers.

    Parameters
    ----------
    path
        Ends in `.glb`.
    sequence
        At least two frames. The first is what a reader without animations shows; each other one is a morph target with normals.
    template
        A mesh file with as many vertices, whose colours and texture coordinates are kept, where each vertex has one pair of these.
    duration
        Seconds from the first frame to the last.

    Raises
    ------
    FileError
        If the path ends otherwise, the template cannot be read, or the file cannot be written.
    InputError
        If there are fewer than two frames, the duration is not positive, or the template has another number of vertices.

    Notes
    -----
    O(frames n): 24 bytes per frame and vertex, in single precision.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh, MeshSequence
    >>> from morphlet.io.sequences import write_animation
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> sequence = MeshSequence(mesh.topology, np.stack([mesh.vertices, 2 * mesh.vertices]), [0.0, 1.0])
    >>> with TemporaryDirectory() as folder:
    ...     write_animation(Path(folder, "growing.glb"), sequence)
    ...     Path(folder, "growing.glb").read_bytes()[:4]
    b'glTF'
    """
    if Path(path).suffix.lower() != ".glb":
        raise FileError("an animation ending in .glb", str(path), "rename the output")
    if len(sequence) < 2:
        raise InputError("at least 2 frames", str(len(sequence)), "pass a longer sequence")
    if not (math.isfinite(duration) and duration > 0):
        raise InputError("a positive number of seconds", str(duration), f"leave it out, or try {DURATION:g}")
    kept = Attributes() if template is None else read_attributes(template)
    n = sequence.topology.n_vertices
    for own in (kept.colors, kept.uv):
        if own is not None and len(own) != n:
            raise InputError(f"a template of {n} vertices", f"{len(own)} in {template}", "pass the file of this mesh")
    put(path, gltf.animated(sequence, kept, duration))


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"a folder at {folder}", error.strerror or str(error), "choose another one") from error
