"""Options of several verbs, and the endings of the files they write."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from morphlet.console import Common
from morphlet.errors import InputError

OUTPUT = Parameter(name=["--output", "-o"])
Output = Annotated[Path, OUTPUT]
MaybeOutput = Annotated[Path | None, OUTPUT]
Pairs = Annotated[Path | None, Parameter(help="CSV of vertices that belong together: source,target[,weight][,label].")]
Layout = Literal["octahedral", "latlong"]
Kept = Annotated[
    Literal["all", "largest"], Parameter(help="Keep all parts (and refuse a mesh with several), or the one with the largest area.")
]
Cuts = Annotated[int, Parameter(help="Cut and cap at most so many handles.")]
MESHES = (".ply", ".obj", ".off", ".stl", ".glb")
"""Endings of mesh files that can be written."""
COLORED = (".ply", ".obj", ".glb")
"""Endings of mesh files that hold colours and texture coordinates."""
VIDEOS = (".mp4", ".gif", ".png")
"""Endings of films."""


@Parameter(name="*")
@dataclass(frozen=True)
class Mending:
    """What may be done to a mesh, beyond filling its holes, so that it has a spherical map."""

    component: Kept = "all"
    cut_handles: Cuts = 0


@Parameter(name="*")
@dataclass(frozen=True)
class Film:
    """A film of frames."""

    video: Path | None = None
    """Also write the frames as a film here: .mp4 (with the extra "video"), .gif or .png, which every browser plays."""
    fps: float = 12.0
    """Frames a second of the film."""


DEFAULTS, MENDING, FILM = Common(), Mending(), Film()


def length(text: str | None, diagonal: float) -> float:
    """A length in mesh units, or in percent of the bounding-box diagonal; 0 if there is none."""
    if text is None:
        return 0.0
    try:
        return float(text.removesuffix("%")) * (diagonal / 100 if text.endswith("%") else 1)
    except ValueError as error:
        raise InputError("a length like 0.01, or 0.1% of the bounding-box diagonal", repr(text), "give a number") from error
