"""Meshes as a few wavelets over their spheres: quality against the number of wavelets, beside spherical harmonics.

    python benchmarks/wavelet_mesh.py [--data DIR] [--most 2000] [--picture PATH] [--variants]
                                      [--json FILE] [--markdown]

PSNR is 20 log10(bounding-box diagonal / rms distance of the vertices). Harmonics are real and as many as the wavelets and the
four affine columns beside them, in order of degree, over the same spherical map with the same weights (vertex areas). One fit is
made per mesh; fewer wavelets are its first ones, with weights of their own. `--variants` tables other mothers and grids at 500
wavelets. Without a data folder (`--data`, or the variable MORPHLET_DATA) a generated body stands in for the meshes.
"""

import argparse
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.linalg import solve_triangular
from scipy.special import sph_harm_y

from book import Sheet, Table, add_options
from morphlet import Mesh, SphericalMap, spherical_map
from morphlet.approximation.surface import ApproximationOptions, SurfaceApproximation, approximate
from morphlet.io.formats import read
from morphlet.metrics import psnr, rms
from morphlet.numerics.unit_sphere import icosphere
from morphlet.report.curves import Axis, curve_picture
from morphlet.wavenet.mothers import MOTHERS
from morphlet.wavenet.spherical import SphericalLibrary

NAMES = ("bunny.off", "horse.obj", "armadillo.obj")
COUNTS = (15, 30, 60, 125, 250, 500, 1000, 2000)
AT = 500
"""Wavelets of the variants."""
VARIANTS = {
    "beta2 and beta1, 2 voices": ApproximationOptions(),
    "1 voice": ApproximationOptions(voices=1),
    "3 voices": ApproximationOptions(voices=3),
    "levels to 4": ApproximationOptions(levels=4),
    "levels to 5": ApproximationOptions(levels=5),
    "beta2 alone": ApproximationOptions((MOTHERS["beta2"],)),
    "beta1 alone": ApproximationOptions((MOTHERS["beta1"],)),
    "beta1, beta2, beta3": ApproximationOptions((MOTHERS["beta2"], MOTHERS["beta1"], MOTHERS["beta3"])),
    "mexican_hat and polywog1, 1 voice": ApproximationOptions((MOTHERS["mexican_hat"], MOTHERS["polywog1"]), voices=1),
}


def bodies(data: Path | None) -> Iterator[tuple[str, Mesh]]:
    """Names and meshes."""
    if data is not None:
        yield from ((name, read(data / "meshes" / name)) for name in NAMES if (data / "meshes" / name).exists())
        return
    points, faces = icosphere(5)
    x, y, z = points.T
    radius = 1 + 0.5 * np.sin(2 * x + 0.7) * np.cos(3 * y - 0.3) + 0.3 * np.sin(4 * z + x * y) ** 3
    yield "generated", Mesh(points * radius[:, None], faces)


def harmonics(points: np.ndarray, count: int) -> np.ndarray:
    """The first real spherical harmonics at the points, as columns."""
    theta, phi = np.arccos(np.clip(points[:, 2], -1, 1)), np.arctan2(points[:, 1], points[:, 0])
    columns = np.empty((len(points), count))
    for column in range(count):
        degree = int(np.sqrt(column))
        order = column - degree * (degree + 1)
        value = sph_harm_y(degree, abs(order), theta, phi)
        columns[:, column] = value.real if order >= 0 else value.imag
    return columns


def wavelets(found: SurfaceApproximation) -> np.ndarray:
    """The affine functions and the wavelets at the vertices, as columns, in the order of their choice."""
    net = found.network
    library = SphericalLibrary(net.mothers, net.kinds, net.centers, net.directions, net.dilations, np.zeros(len(net)))
    return np.column_stack([np.ones(len(found.points)), found.points, library.values(found.points).toarray()])


def qualities(mesh: Mesh, columns: np.ndarray, counts: list[int]) -> list[float]:
    """PSNR of the least squares fits with the first columns, weighted by area."""
    root = np.sqrt(mesh.vertex_areas)[:, None]
    R = np.linalg.qr(np.hstack([columns, mesh.vertices]) * root, mode="r")
    found = []
    for count in counts:
        near = columns[:, :count] @ solve_triangular(R[:count, :count], R[:count, columns.shape[1] :])
        found.append(psnr(rms(near, mesh.vertices), mesh.bbox_diagonal))
    return found


def timed(mapped: SphericalMap, most: int, options: ApproximationOptions) -> tuple[SurfaceApproximation, float]:
    """An approximation of the positions, and its CPU time."""
    cpu = time.process_time()
    found = approximate(mapped, mapped.mesh.vertices, most, options)
    return found, time.process_time() - cpu


def variants(name: str, mapped: SphericalMap) -> Iterator[list[str]]:
    """Quality and time of each variant."""
    mesh = mapped.mesh
    for label, options in VARIANTS.items():
        found, cpu = timed(mapped, AT, options)
        area = psnr(float(np.sqrt(found.fit.sse[-1])), mesh.bbox_diagonal)
        quality = psnr(rms(found.values(), mesh.vertices), mesh.bbox_diagonal)
        yield [name, label, f"{quality:.2f}", f"{area:.2f}", f"{cpu:.1f}"]


def main() -> None:
    """Parse the arguments, map, fit, write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=os.environ.get("MORPHLET_DATA") or None)
    parser.add_argument("--most", type=int, default=COUNTS[-1], help="wavelets of the largest fit")
    parser.add_argument("--picture", type=Path, help="the curves as a PNG")
    parser.add_argument("--variants", action="store_true")
    add_options(parser)
    chosen = parser.parse_args()
    sheet = Sheet.of(chosen)
    counts = [count for count in COUNTS if count <= chosen.most]
    small = spherical_map(Mesh(*icosphere(2)))
    timed(small, 5, replace(ApproximationOptions(), levels=1))  # compiles
    rows, others, curves = [], [], {}
    for name, mesh in bodies(None if chosen.data is None else Path(chosen.data)):
        sys.stderr.write(f"{name}\n")
        mapped = spherical_map(mesh)
        if chosen.variants:
            others += list(variants(name, mapped))
            continue
        found, cpu = timed(mapped, counts[-1], ApproximationOptions())
        ours = qualities(mesh, wavelets(found), [4 + count for count in counts])
        peers = qualities(mesh, harmonics(mapped.points, 4 + counts[-1]), [4 + count for count in counts])
        rows += [[name, kind, *(f"{v:.1f}" for v in values)] for kind, values in (("wavelets", ours), ("harmonics", peers))]
        curves[f"{name}, wavelets"] = np.column_stack([counts, ours])
        curves[f"{name}, harmonics"] = np.column_stack([counts, peers])
        others.append([name, str(mesh.n_vertices), str(len(found.network)), f"{cpu:.1f}"])
    if chosen.variants:
        sheet.add(Table("Variants", ["mesh", f"{AT} wavelets", "PSNR", "PSNR by area", "CPU s"], others, "PSNR in dB."))
        return
    sheet.add(Table("Quality by the number of wavelets", ["mesh", "", *(str(count) for count in counts)], rows, "PSNR in dB."))
    sheet.add(Table("Cost", ["mesh", "vertices", "wavelets", "CPU s of the fit"], others))
    if chosen.picture is not None:
        curve_picture(curves, Axis("wavelets", "log"), Axis("PSNR, dB")).save(chosen.picture)


if __name__ == "__main__":
    main()
