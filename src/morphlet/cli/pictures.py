"""What `--picture` and `--video` show: which picture belongs to which result, drawn only if one was asked for."""

from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, TypeVarTuple

from morphlet.cli.options import VIDEOS, Film
from morphlet.console import Run
from morphlet.errors import InputError

if TYPE_CHECKING:
    import numpy as np

    from morphlet.editing.script import Edit
    from morphlet.features.matching import Matching
    from morphlet.features.regions import Regions
    from morphlet.io.attributes import Attribute
    from morphlet.pipeline.results import CorrespondResult
    from morphlet.report.render import Picture
    from morphlet.sphere.map import SphericalMap
    from morphlet.surface.mesh import Mesh
    from morphlet.surface.sequence import MeshSequence

Shown = TypeVarTuple("Shown")


def _if_asked(drawn: "Callable[[Run, *Shown], Picture]") -> Callable[[Run, *Shown], None]:
    """Draw and save only if a picture was asked for."""

    @wraps(drawn)
    def draw(run: Run, *shown: *Shown) -> None:
        if run.common.picture is not None:
            drawn(run, *shown).save(run.place(run.common.picture))

    return draw


@_if_asked
def draw_mesh(run: Run, shape: "Mesh") -> "Picture":
    """A mesh."""
    with run.uncounted():
        from morphlet.report.render import render

    return render(shape)


@_if_asked
def draw_beside(run: Run, first: "Mesh", second: "Mesh") -> "Picture":
    """Two meshes from one side."""
    with run.uncounted():
        from morphlet.report.rows import beside

    return beside(first, second)


@_if_asked
def draw_sphere(run: Run, found: "SphericalMap") -> "Picture":
    """A spherical map."""
    with run.uncounted():
        from morphlet.report.sheet import sphere_picture
        from morphlet.report.story import end_of

    return sphere_picture(end_of(found))


@_if_asked
def draw_regions(run: Run, found: "Regions") -> "Picture":
    """The feature regions of a mesh."""
    with run.uncounted():
        from morphlet.report.features import regions_picture

    return regions_picture(found)


@_if_asked
def draw_matching(run: Run, ends: "tuple[Regions, Regions]", found: "Matching") -> "Picture":
    """The feature regions of two meshes, and what belongs together."""
    with run.uncounted():
        from morphlet.report.features import matching_picture

    return matching_picture(*ends, found)


@_if_asked
def draw_correspondence(run: Run, found: "CorrespondResult") -> "Picture":
    """Two meshes, their spheres, and the places of one on the other."""
    with run.uncounted():
        from morphlet.report.story import correspondence_picture

    return correspondence_picture(found)


@_if_asked
def draw_carried(run: Run, ends: "tuple[Mesh, Mesh]", attribute: "Attribute", carried: "np.ndarray") -> "Picture":
    """The mesh that gives an attribute, and the one that received it."""
    with run.uncounted():
        from morphlet.report.carried import carried_picture

    return carried_picture(ends, attribute, carried)


@_if_asked
def draw_edit(run: Run, edit: "Edit", frames: "MeshSequence") -> "Picture":
    """A mesh before and after an edit."""
    with run.uncounted():
        from morphlet.report.rows import edit_picture

    return edit_picture(edit, frames)


@_if_asked
def draw_poses(run: Run, rows: "list[list[Mesh]]") -> "Picture":
    """Poses above what they became."""
    with run.uncounted():
        from morphlet.report.rows import poses_picture

    return poses_picture(rows)


def promise_film(run: Run, film: Film) -> None:
    """Refuse, before the work begins, a film that could not be written."""
    with run.uncounted():
        from morphlet.io.video import check_video

    if film.video is None:
        if film != Film():
            raise InputError("--video for --fps", "no --video", "name the film, or leave --fps out")
        return
    run.file(film.video, *VIDEOS)
    check_video(film.video, film.fps)


def shoot(run: Run, film: Film, frames: "MeshSequence") -> None:
    """A film of the frames, coloured by place, if one was asked for."""
    if film.video is None:
        return
    with run.uncounted():
        from morphlet.io.video import write_video
        from morphlet.report.color import place_colors
        from morphlet.report.film import film as drawn

    run.stage("film")
    pictures = drawn(frames, colors=place_colors(frames.positions[0]))
    write_video(run.place(film.video), (picture.pixels for picture in pictures), fps=film.fps)
