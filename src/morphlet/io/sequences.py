"""A mesh sequence as numbered files in a folder, or as one file that plays: both ways.

All frames have the faces of the first, corner by corner. A frame is called what its file or its morph target is called.
"""

import math
import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from morphlet import _arrays
from morphlet.errors import FileError, InputError
from morphlet.io import gltf_shapes
from morphlet.io.content import COLOR_MAX, Attributes, Shapes
from morphlet.io.formats import FORMATS, format_by_ending, prepare_rewrite, put, read_attributes, read_shapes
from morphlet.surface.requirements import many
from morphlet.surface.sequence import MeshSequence

DIGITS = 3
"""Fewest digits of a frame number."""
DURATION = 2.0
"""Seconds that an animation lasts: 24 frames then come at 12 a second, as in drawn films."""

NUMBERED = re.compile(r"(?P<head>.*?)(?P<number>[0-9]+)(?P<tail>[^0-9]*)", re.DOTALL)
"""The stem of a file with a number in it: the last one counts."""


@dataclass(frozen=True, eq=False)
class Poses:
    """Frames that were read, and what each is called.

    Parameters
    ----------
    sequence
        The frames.
    names
        One per frame, each once: the stem of its file, or the name of its morph target as the file has it.
    """

    sequence: MeshSequence
    names: tuple[str, ...]

    def __post_init__(self) -> None:
        if not (len(self.names) == len(set(self.names)) == len(self.sequence)):
            found = f"{len(self.names)} names, {len(set(self.names))} of them different"
            raise InputError(f"{many(len(self.sequence), 'name')}, each another", found, "name each frame once")


def read_poses(*paths: str | os.PathLike[str]) -> Poses:
    """Read frames of one mesh from files, with their names.

    Parameters
    ----------
    *paths
        Folders and mesh files, whose frames follow one another in this order. A folder gives its one numbered series
        (`frame-000.ply`, `frame-001.ply`, ...), whatever lies beside it; without one, all its mesh files, in natural order
        (`pose9` before `pose10`), if they have one ending. A glTF file gives the keyframes of the first animation that blends its morph
        targets; without one, its rest shape and each target in full. Any other file gives one frame.

    Returns
    -------
    Poses
        The frames over the faces of the first. Their times are those of the animation, in seconds, if a glTF file with one is
        all that is read, else 0, 1, 2, ...

    Raises
    ------
    FileError
        If a file cannot be read, has other faces than the first, or holds a coordinate that is not finite; if numbers are missing in a
        series; if a folder has no mesh files, or several kinds and no series; if bones or nodes of a glTF file are animated.
    InputError
        If no path is given, or something else than paths.

    Notes
    -----
    O(size of the files). Files named one by one are taken as they come: whether numbers are missing among them is not asked. Vertices keep
    the indexing of their files, as with `read`. Targets of one name in several nodes of a glTF file move together.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh, MeshSequence, read_poses, write_sequence
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> sequence = MeshSequence(mesh.topology, np.stack([mesh.vertices, 2 * mesh.vertices]), [0.0, 1.0])
    >>> with TemporaryDirectory() as folder:
    ...     _ = write_sequence(folder, sequence)
    ...     poses = read_poses(folder)
    >>> poses.names, poses.sequence[1].area
    (('frame-000', 'frame-001'), 2.0)
    """
    wrong = [type(path).__name__ for path in paths if not isinstance(path, str | os.PathLike)]
    if wrong:
        raise InputError("paths, each an argument of its own", f"a {wrong[0]}", "pass a list of files as *files")
    files = [file for path in paths for file in _files(Path(path))]
    if not files:
        raise InputError("at least one path", "none", "name a folder of poses, or the files")
    found = [read_shapes(file) for file in files]
    for shapes, file in zip(found[1:], files[1:], strict=True):
        _require_same_faces(shapes, file, found[0], files[0])
    positions = np.concatenate([shapes.positions for shapes in found])
    times = found[0].times if len(found) == 1 else None
    sequence = MeshSequence(found[0].mesh.topology, positions, np.arange(float(len(positions))) if times is None else times)
    return Poses(sequence, gltf_shapes.unique(name for shapes in found for name in shapes.names))


def read_sequence(*paths: str | os.PathLike[str]) -> MeshSequence:
    """Read frames of one mesh from files.

    Parameters
    ----------
    *paths
        A folder of poses, a glTF file with morph targets, or the files of the frames; see `read_poses`, which tells their names too.

    Returns
    -------
    MeshSequence
        The frames over the faces of the first.

    Raises
    ------
    FileError
        As `read_poses`.
    InputError
        If no path is given, or something else than paths.

    Examples
    --------
    >>> import numpy as np
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh, MeshSequence, read_sequence, write_animation
    >>> mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    >>> sequence = MeshSequence(mesh.topology, np.stack([mesh.vertices, 2 * mesh.vertices]), [0.0, 1.0])
    >>> with TemporaryDirectory() as folder:
    ...     write_animation(Path(folder, "growing.glb"), sequence, duration=3.0)
    ...     read_sequence(Path(folder, "growing.glb")).times
    array([0., 3.])
    """
    return read_poses(*paths).sequence


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
    files = [place / f"{name}{ending}" for name in _numbered(len(sequence))]
    _make(place)
    for frame, file in enumerate(files):
        put(file, render(sequence[frame]))
    return files


def write_animation(
    path: str | os.PathLike[str],
    sequence: MeshSequence,
    *,
    template: str | os.PathLike[str] | None = None,
    colors: UInt8[np.ndarray, "n 3"] | None = None,
    names: Sequence[str] = (),
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
    colors
        Red, green and blue of each vertex, 0 to 255, in all frames; instead of those of the template.
    names
        What the frames are called, each once: the first name is the mesh's, the others are those of the morph targets ("shape keys").
        `frame-000`, `frame-001`, ... if left out.
    duration
        Seconds from the first frame to the last.

    Raises
    ------
    FileError
        If the path ends otherwise, the template cannot be read, or the file cannot be written.
    InputError
        If there are fewer than two frames, the duration is not positive, names or colours do not fit the frames, or the template has
        another number of vertices.

    Notes
    -----
    O(frames n): 24 bytes per frame and vertex, in single precision, and 4 bytes for each pair of frames.

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
    if colors is not None:
        kept = Attributes(_arrays.index(colors, "colors", (n, 3), COLOR_MAX + 1).astype(np.uint8), kept.uv)
    called = Poses(sequence, tuple(names) or tuple(_numbered(len(sequence))))
    put(path, gltf_shapes.animated(sequence, kept, called.names, duration))


def _numbered(count: int) -> list[str]:
    """frame-000, frame-001, ...: as many digits as the last one needs."""
    digits = max(DIGITS, len(str(count - 1)))
    return [f"frame-{k:0{digits}d}" for k in range(count)]


def _files(path: Path) -> list[Path]:
    """The path itself, or the frames in the folder it names."""
    if not path.is_dir():
        return [path]
    endings = [ending for known in FORMATS for ending in known.endings]
    try:
        found = sorted((file for file in path.iterdir() if _is_mesh(file, endings)), key=lambda file: _natural(file.name))
    except OSError as error:
        raise FileError(f"a readable folder {path}", error.strerror or str(error), "check its permissions") from error
    if not found:
        raise FileError(f"files ending in {', '.join(endings)} in {path}", "none", "name the folder of the poses")
    groups = _series(found)
    longer = [members for members in groups if len(members) > 1]
    chosen = longer[0] if len(longer) == 1 else found
    kinds = sorted({file.suffix.lower() for file in chosen})
    if len(kinds) > 1:
        raise FileError(f"one numbered series or mesh files of one kind in {path}", " and ".join(kinds), "pass the files one by one")
    for members in longer:
        _require_all(members)
    return chosen


def _is_mesh(file: Path, endings: list[str]) -> bool:
    return file.suffix.lower() in endings and not file.name.startswith(".") and file.is_file()


def _natural(name: str) -> list[tuple[int, str]]:
    """A key that sorts numbers by value, and text without regard to case before case decides."""
    parts = re.split("([0-9]+)", name)
    return [(int(part), part) if k % 2 else (0, part.lower()) for k, part in enumerate(parts)] + [(0, name)]


def _series(files: Iterable[Path]) -> list[list[Path]]:
    """Files whose names differ in their last number only; one without a number is alone."""
    groups: dict[tuple[str, ...], list[Path]] = {}
    for file in files:
        match = NUMBERED.fullmatch(file.stem)
        groups.setdefault((match["head"], match["tail"], file.suffix) if match else (file.name,), []).append(file)
    return list(groups.values())


def _require_all(series: list[Path]) -> None:
    """Each number from the first to the last, once."""
    matches = [match for file in series if (match := NUMBERED.fullmatch(file.stem))]
    numbers = [int(match["number"]) for match in matches]
    steps = np.diff(np.array(numbers, dtype=object))
    for file, match, number, step in zip(series[1:], matches, numbers, steps, strict=False):
        if step == 1:
            continue
        needed = f"one file for each number from {numbers[0]} to {numbers[-1]} in {file.parent}"
        lacking = f"{match['head']}{number + 1:0{len(match['number'])}d}{match['tail']}{file.suffix}"
        found = f"no {lacking}" if step > 1 else f"number {number} twice, the second time in {file.name}"
        raise FileError(needed, found, "restore the series, or pass its files one by one", [number + 1 if step > 1 else number])


def _require_same_faces(shapes: Shapes, file: Path, first: Shapes, reference: Path) -> None:
    """A frame must have the vertices and faces of the first."""
    n, faces = first.mesh.n_vertices, first.mesh.faces
    own, advice = shapes.mesh, "export it with the vertices and faces of the first frame, in their order"
    needed = f"the {many(n, 'vertex')} and {many(len(faces), 'face')} of {reference} in {file}"
    if (own.n_vertices, own.n_faces) != (n, len(faces)):
        raise FileError(needed, f"{many(own.n_vertices, 'vertex')} and {many(own.n_faces, 'face')}", advice)
    others = np.flatnonzero((own.faces != faces).any(axis=1))
    if len(others):
        k = int(others[0])
        found = f"{many(len(others), 'face')} with other corners, face {k} with {own.faces[k].tolist()} instead of {faces[k].tolist()}"
        raise FileError(needed, found, advice, others)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"a folder at {folder}", error.strerror or str(error), "choose another one") from error
