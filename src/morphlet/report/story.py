"""What a person looks at after a run: contact sheet and report of a morph, the picture of a correspondence."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet.io.sequences import write_animation, write_sequence
from morphlet.motion.morph import Morph
from morphlet.pipeline.morph import MorphResult
from morphlet.pipeline.results import CorrespondResult
from morphlet.report.color import place_colors
from morphlet.report.page import Plate, Section, write_page
from morphlet.report.render import Picture
from morphlet.report.sheet import Mapped, contact_sheet, sphere_picture
from morphlet.sphere.map import SphericalMap
from morphlet.sphere.quality import isometric_distortion
from morphlet.surface.mesh import Mesh

FIGURES = {
    "folds_sphere": "triangles of the source inverted on the sphere (exact signs)",
    "folds_surface_percent": "% of its triangles whose image looks inwards on the target",
    "energy": "symmetric Dirichlet energy of the map, area-weighted mean; 1 for an isometry",
    "energy_mean": "the same, mean over triangles",
    "pairs": "paired vertices given",
    "pairs_rmse": "how far the source vertices of the pairs land from their partners, mesh units",
    "margin": "how much better the matching, or the rotation of a search, fits than the runner-up",
    "ambiguous": "whether that is too little to trust",
    "alignment": "how the spheres were turned onto each other",
    "path": "how vertices travel: faces turn and stretch (gradient), straight lines (linear), coarse before fine (wavelet)",
    "frames": "meshes of the sequence, both ends included",
    "volume_change_max": "%, largest deviation of a frame's volume from the straight line between the ends",
    "edge_log_rms_max": "largest rms log ratio of edge lengths to the straight line between the ends",
    "self_intersections_max": "pairs of triangles that cross, in the frame that has most; both ends count",
    "mse": "mean squared distance of source and last frame per vertex (Eq. 9), squared mesh units",
    "deformation_rate": "% of the bounding-box diagonal, mean move of a vertex",
}
"""What the figures of a morph mean."""
SPHERE_FIGURES = {
    "inverted": "inverted triangles, filled holes included (exact signs)",
    "degree": "how often the sphere is covered",
    "iso_mean": "isometric distortion max(s1, 1/s2), mean over triangles; 1 for an isometry",
    "iso_p99": "the same, 99 % of triangles are below",
    "iso_max": "the same, largest",
    "angle_mean_deg": "mean change of a corner's angle, degrees",
    "area_log_std": "spread of the log area ratio",
}
"""What the figures of a spherical map mean."""


def end_of(mapped: SphericalMap) -> Mapped:
    """A mesh as given, its sphere, and the isometric distortion of each face (1 where a face has no shape)."""
    distortion = isometric_distortion(mapped.mesh, mapped.points)
    sphere = Mesh(mapped.points, mapped.mesh.topology)
    return Mapped(mapped.mesh, sphere, np.nan_to_num(distortion, nan=1.0, posinf=1.0))


def carried_colors(matched: CorrespondResult) -> Float[np.ndarray, "k 3"]:
    """The colours of the source's places at each vertex of the target, back through the map."""
    return matched.inverse.pull(place_colors(matched.source_map.mesh.vertices))


def correspondence_picture(matched: CorrespondResult) -> Picture:
    """Source and target, their spheres, and the source's colours carried to the target."""
    ends = end_of(matched.source_map), end_of(matched.target_map)
    frames = Morph(matched.correspondence.source, matched.correspondence.positions).frames(2)
    return contact_sheet(*ends, frames, target_colors=carried_colors(matched))


def write_morph(folder: Path, result: MorphResult, figures: Mapping[str, Any], template: tuple[Path, str]) -> Picture:
    """Frames, `morph.glb` (which plays them), `contact-sheet.png`, `report.html`.

    Parameters
    ----------
    folder
        An existing folder.
    figures
        The figures to show, by the names of `FIGURES`.
    template
        The source's file, whose attributes the frames keep, and the ending of the frames without a dot.

    Returns
    -------
    Picture
        The contact sheet.
    """
    write_sequence(folder, result.frames, template=template[0], ending=f".{template[1]}")
    write_animation(folder / "morph.glb", result.frames, template=template[0])
    source, target = end_of(result.matched.source_map), end_of(result.matched.target_map)
    sheet = contact_sheet(source, target, result.frames, target_colors=carried_colors(result.matched))
    sheet.save(folder / "contact-sheet.png")
    write_page(folder / "report.html", "A morph, through the sphere", _sections(result, figures, (sheet, source, target)))
    return sheet


def _sections(result: MorphResult, figures: Mapping[str, Any], seen: tuple[Picture, Mapped, Mapped]) -> list[Section]:
    sheet, source, target = seen
    table = tuple((name, figures[name], FIGURES[name]) for name in FIGURES if name in figures)
    intro = (
        "Each mesh was mapped one-to-one to the unit sphere; the source was laid into the target's sphere without folds; every vertex "
        "of the source moves to the place of the target that shares its point on the sphere.",
        f"Alignment: {figures.get('alignment', '-')}. Pictures drawn by {sheet.engine} ({sheet.reason}).",
    )
    morph = Section("The morph", intro, table, (Plate(sheet.png, "Source, spheres, target, and frames of the morph"),))
    ends = ("Source", result.matched.source_map, source), ("Target", result.matched.target_map, target)
    return [morph, *(_sphere_section(*end) for end in ends)]


def _sphere_section(title: str, mapped: SphericalMap, end: Mapped) -> Section:
    quality = mapped.quality()
    table = tuple((name, getattr(quality, name), meaning) for name, meaning in SPHERE_FIGURES.items())
    mended = tuple(f"Repair: {done.what} ({done.count})." for done in mapped.surface.repairs)
    facts = (f"{mapped.mesh.n_vertices} vertices, {mapped.mesh.n_faces} faces.", *mended)
    picture = sphere_picture(end)
    return Section(f"{title} on the sphere", facts, table, (Plate(picture.png, f"{title} and its sphere, coloured by distortion"),))
