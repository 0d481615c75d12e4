"""The engine with a depth buffer: VTK through pyvista, off-screen."""

from typing import Any

import numpy as np
from jaxtyping import UInt8

from morphlet.report.scene import LINE, OVERSAMPLE, Scene, averaged, shaded


def paint(scene: Scene) -> UInt8[np.ndarray, "h w 3"]:
    """The scene as pixels; what is hidden is decided at each pixel."""
    import pyvista as pv

    with pv.vtk_verbosity("off"):
        plotter = pv.Plotter(off_screen=True, window_size=[OVERSAMPLE * side for side in scene.size], lighting="none")
        try:
            pixels = _drawn(plotter, scene)
        finally:
            plotter.close()
    return averaged(pixels[..., :3])


def trial() -> None:
    """Draw one small triangle, as a test of the graphics driver."""
    corners = np.array([[[-8.0, -8.0, 0.0], [8.0, -8.0, 0.0], [0.0, 8.0, 0.0]]])
    normals = np.broadcast_to([0.0, 0.0, 1.0], (1, 3, 3))
    pixels = paint(Scene(corners, normals, np.zeros((1, 3, 3)), 1.0, 0.0, (32, 32)))
    if not (pixels[0, 0].min() > 250 and pixels[16, 16].max() < 128):
        raise SystemExit(1)


def _drawn(plotter: Any, scene: Scene) -> UInt8[np.ndarray, "H W c"]:
    """The pixels of an empty plotter once it holds the scene."""
    plotter.set_background("white")
    if len(scene.corners):
        plotter.add_mesh(
            _poly(scene),
            scalars="colors",
            rgb=True,
            lighting=False,
            show_edges=scene.edges > 0,
            line_width=max(OVERSAMPLE * scene.edges, 1.0),
            edge_color=LINE,
        )
    _aim(plotter, scene)
    return plotter.screenshot(return_img=True)


def _poly(scene: Scene) -> Any:
    """The triangles as a pyvista mesh in which no two share a corner: each keeps its own shaded colours."""
    import pyvista as pv

    faces = np.arange(scene.corners.shape[0] * 3).reshape(-1, 3)
    poly = pv.PolyData.from_regular_faces(scene.corners.reshape(-1, 3), faces)
    poly.point_data["colors"] = np.rint(255 * shaded(scene).reshape(-1, 3)).astype(np.uint8)
    return poly


def _aim(plotter: Any, scene: Scene) -> None:
    """A parallel camera that shows one unit as one pixel."""
    depth = float(np.abs(scene.corners[..., 2]).max(initial=1.0)) + scene.size[1]
    plotter.camera.enable_parallel_projection()
    plotter.camera.position, plotter.camera.focal_point, plotter.camera.up = (0, 0, 2 * depth), (0, 0, 0), (0, 1, 0)
    plotter.camera.parallel_scale = scene.size[1] / 2
    plotter.camera.clipping_range = (depth / 2, 4 * depth)
