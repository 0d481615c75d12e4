"""A mesh sequence as numbered files in a folder."""

import os
from pathlib import Path

from morphlet.errors import FileError
from morphlet.io.content import Attributes
from morphlet.io.formats import format_by_ending, prepare_rewrite, put
from morphlet.surface.sequence import MeshSequence

DIGITS = 3
"""Fewest digits of a frame number."""


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


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"a folder at {folder}", error.strerror or str(error), "choose another one") from error
