"""What an engine draws: triangles in front of a camera, with a normal and a colour at each corner."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8

from morphlet.report.camera import Camera
from morphlet.report.look import Look
from morphlet.surface.mesh import Mesh

OVERSAMPLE = 2
"""Engines draw this many times finer in each direction, then average: smooth outlines."""
LINE = (0.16, 0.17, 0.20)
"""Colour of edges."""
EYE = np.array([0.0, 0.0, 1.0])
"""The direction towards the eye."""
MARGIN = 0.04
"""Empty border around what the camera frames, as a share of the picture."""
CREASE = np.cos(np.radians(50.0))
"""Faces that meet the mean direction of a vertex at a steeper angle keep their own normal there: edges of machine parts stay sharp."""


@dataclass(frozen=True, eq=False)
class Light:
    """A light at infinity: the direction towards it, and its strength."""

    towards: tuple[float, float, float]
    strength: float


LIGHTS = (Light((-0.50, 0.62, 0.60), 0.50), Light((0.80, 0.05, 0.60), 0.16), Light((0.35, 0.70, -0.60), 0.20))
"""Key from the upper left, fill from the right, rim from behind: right, up, toward the eye."""
SKY, GROUND = 0.50, 0.30
"""Light from everywhere: this much on what looks up, this much on what looks down."""
GLOSS, SHARPNESS = 0.10, 14.0
"""Strength and exponent of the highlight: clay, not metal."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Triangles in picture coordinates, ready to draw.

    Parameters
    ----------
    corners
        Right, up, toward the eye, in pixels from the middle of the picture.
    normals
        Unit normal at each corner, never away from the eye.
    colors
        RGB at each corner, in [0, 1].
    contrast
        How much light and shade change the colours: 0 not at all, 1 as on clay.
    edges
        Width of the lines along the edges, in pixels; 0 for none.
    size
        Width and height of the picture, in pixels.
    """

    corners: Float[np.ndarray, "m 3 3"]
    normals: Float[np.ndarray, "m 3 3"]
    colors: Float[np.ndarray, "m 3 3"]
    contrast: float
    edges: float
    size: tuple[int, int]


def scene(mesh: Mesh, corner_colors: Float[np.ndarray, "m 3 3"], camera: Camera, look: Look, contrast: float) -> Scene:
    """The mesh as this camera sees it in a picture of this look."""
    scale = pixels_per_unit(camera, look.size)
    corners = scale * camera.project(mesh.vertices)[mesh.faces]
    outward = -1.0 if mesh.volume < 0 else 1.0
    normals = outward * corner_normals(mesh) @ camera.axes.T
    # Both sides show: a normal that looks away is mirrored at the picture's plane, so that light does not jump along outlines.
    normals[..., 2] = np.abs(normals[..., 2])
    return Scene(corners, normals, corner_colors, contrast, look.edges, look.size)


def pixels_per_unit(camera: Camera, size: tuple[int, int]) -> float:
    """Pixels per mesh unit such that the camera's extent fits, margin included."""
    half = (1 - 2 * MARGIN) / 2 * np.array(size)
    wide = camera.extent > 0
    return float(np.min(half[wide] / camera.extent[wide])) if wide.any() else 1.0


def corner_normals(mesh: Mesh) -> Float[np.ndarray, "m 3 3"]:
    """The vertex normal at each corner, or the mean over the faces on its side of the crease where the vertex lies on one."""
    if not mesh.n_faces:
        return np.zeros((0, 3, 3))
    faces = np.broadcast_to(mesh.face_normals[:, None], (mesh.n_faces, 3, 3))
    smooth = mesh.vertex_normals[mesh.faces]
    sharp = np.einsum("fcd,fcd->fc", faces, smooth) < CREASE
    return np.where(sharp[..., None], faces, smooth)


def shaded(part: Scene) -> Float[np.ndarray, "m 3 3"]:
    """RGB at each corner under the three lights and the sky (Lambert's law, and a weak highlight after Blinn)."""
    light = GROUND + (SKY - GROUND) * (1 + part.normals[..., 1]) / 2
    shine = np.zeros_like(light)
    for lamp in LIGHTS:
        towards = np.array(lamp.towards) / np.linalg.norm(lamp.towards)
        half = (towards + EYE) / np.linalg.norm(towards + EYE)
        light += lamp.strength * np.maximum(part.normals @ towards, 0)
        shine += lamp.strength * np.maximum(part.normals @ half, 0) ** SHARPNESS
    light = 1 + part.contrast * (light - 1)
    return np.clip(part.colors * light[..., None] + GLOSS * shine[..., None], 0, 1)


def averaged(fine: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "h w 3"]:
    """The mean of each block of fine pixels."""
    height, width = fine.shape[0] // OVERSAMPLE, fine.shape[1] // OVERSAMPLE
    blocks = fine.reshape(height, OVERSAMPLE, width, OVERSAMPLE, 3)
    return np.rint(blocks.mean(axis=(1, 3))).astype(np.uint8)
