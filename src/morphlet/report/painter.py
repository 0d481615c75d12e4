"""The engine that always works: far triangles first, with colours blended between corners, on matplotlib's Agg canvas."""

import numpy as np
from jaxtyping import Float, UInt8

from morphlet.report.scene import LINE, OVERSAMPLE, Scene, averaged, shaded

SPREAD = 1 / OVERSAMPLE
"""The canvas widens every triangle by half a fine pixel on each side, so that no gaps open between them; lines are drawn thinner."""

THINNEST = 0.05
"""Width of a strip the canvas still draws, in pixels."""


def paint(scene: Scene) -> UInt8[np.ndarray, "h w 3"]:
    """The scene as pixels.

    Cost: O(m log m) to sort the faces, then a few microseconds a face. Faces that interpenetrate, or are long and thin, may hide
    one another wrongly, since each is drawn whole.
    """
    from matplotlib.backends.backend_agg import RendererAgg
    from matplotlib.transforms import IdentityTransform

    width, height = (OVERSAMPLE * side for side in scene.size)
    agg = RendererAgg(width, height, 72)
    triangles, colors = _triangles(scene)
    if len(triangles):
        opaque = np.concatenate([colors, np.ones((*colors.shape[:2], 1))], axis=2)
        agg.draw_gouraud_triangles(agg.new_gc(), triangles * OVERSAMPLE + [width / 2, height / 2], opaque, IdentityTransform())
    return averaged(_on_white(np.asarray(agg.buffer_rgba())))


def _triangles(scene: Scene) -> tuple[Float[np.ndarray, "k 3 2"], Float[np.ndarray, "k 3 3"]]:
    """Triangles of the plane from far to near with corner colours; the edges of a face follow it directly."""
    order = np.argsort(scene.corners[:, :, 2].sum(axis=1), kind="stable")
    flat, colors = scene.corners[order, :, :2], shaded(scene)[order]
    if not scene.edges:
        return flat, colors
    strips = _strips(flat, max(scene.edges - SPREAD, THINNEST))
    dark = np.broadcast_to(np.array(LINE), (*strips.shape[:3], 3))
    together = np.concatenate([flat[:, None], strips], axis=1), np.concatenate([colors[:, None], dark], axis=1)
    return together[0].reshape(-1, 3, 2), together[1].reshape(-1, 3, 3)


def _strips(flat: Float[np.ndarray, "m 3 2"], width: float) -> Float[np.ndarray, "m 6 3 2"]:
    """Each edge of each triangle as a strip of two triangles, of this width."""
    start, end = flat, np.roll(flat, -1, axis=1)
    along = end - start
    length = np.maximum(np.linalg.norm(along, axis=2, keepdims=True), np.finfo(float).tiny)
    aside = np.stack([-along[..., 1], along[..., 0]], axis=2) / length * width / 2
    first = np.stack([start - aside, end - aside, end + aside], axis=2)
    second = np.stack([start - aside, end + aside, start + aside], axis=2)
    return np.concatenate([first, second], axis=1)


def _on_white(pixels: UInt8[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "h w 3"]:
    """What a transparent canvas looks like on white paper."""
    cover = pixels[..., 3:] / 255.0
    return np.rint(pixels[..., :3] * cover + 255.0 * (1 - cover)).astype(np.uint8)
