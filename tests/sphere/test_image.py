"""Spherical geometry images: which pixel shows what, how they interpolate, what they give back."""

import os
import pickle
from pathlib import Path
from typing import get_args

import igl
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.image import imread

from morphlet import FileError, InputError, Mesh, _store
from morphlet.numerics.optimize import Trace
from morphlet.numerics.unit_sphere import fibonacci, icosphere
from morphlet.sphere.image import Layout, SphericalImage, directions, spherical_image
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.repair import close
from morphlet.surface.requirements import require_sphere

LAYOUTS = get_args(Layout)
CORNERS = np.array([[1.0, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]])
OCTAHEDRON = np.array([[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]])
NORTH = 4


def radial(mesh: Mesh) -> SphericalMap:
    """The map of a mesh that is star-shaped about the origin: each vertex goes to its own direction."""
    surface = close(mesh)
    outwards = surface.mesh.vertices / np.linalg.norm(surface.mesh.vertices, axis=1, keepdims=True)
    return SphericalMap(surface, outwards, Trace((), "given"))


def ball(layout: Layout, size: int) -> SphericalImage:
    """The unit sphere."""
    grid = directions(layout, size)
    return SphericalImage(layout, grid, np.ones(grid.shape[:2], bool))


def noise(layout: Layout, size: int, seed: int) -> SphericalImage:
    """Unrelated positions in the unit cube, one per direction."""
    grid = directions(layout, size)
    _, number = np.unique(grid.reshape(-1, 3), axis=0, return_inverse=True)
    values = np.random.default_rng(seed).random((number.max() + 1, 3))
    return SphericalImage(layout, values[number.reshape(grid.shape[:2])], np.ones(grid.shape[:2], bool))


def test_the_octahedron_unfolds_into_three_by_three_pixels() -> None:
    px, nx, py, ny, pz, nz = CORNERS.tolist()
    assert directions("octahedral", 3).tolist() == [[nz, ny, nz], [nx, pz, px], [nz, py, nz]]


def test_a_globe_of_three_rows_has_two_poles_and_a_hexagon() -> None:
    grid = directions("latlong", 3)
    assert grid.shape == (3, 6, 3)
    assert np.unique(grid[0], axis=0).tolist() == [[0, 0, 1]]
    assert np.unique(grid[2], axis=0).tolist() == [[0, 0, -1]]
    third = np.sqrt(3) / 2
    np.testing.assert_allclose(grid[1, :3], [[1, 0, 0], [0.5, third, 0], [-0.5, third, 0]], atol=1e-15)


@pytest.mark.parametrize("size", [3, 4, 8, 17])
def test_every_side_of_an_octahedral_image_repeats_itself_exactly(size: int) -> None:
    image = spherical_image(spherical_map(Mesh(CORNERS * [1, 2, 3], OCTAHEDRON)), size)
    for grid in (directions("octahedral", size), image.positions, image.mask):
        for side in (grid[0], grid[-1], grid[:, 0], grid[:, -1]):
            np.testing.assert_array_equal(side, side[::-1])
        corners = grid[[0, 0, -1, -1], [0, -1, 0, -1]]
        np.testing.assert_array_equal(corners, np.broadcast_to(corners[0], corners.shape))


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("size", [3, 4, 9, 16])
def test_pixels_are_unit_vectors_and_all_others_are_distinct(layout: Layout, size: int) -> None:
    grid = directions(layout, size)
    np.testing.assert_allclose(np.linalg.norm(grid, axis=2), 1, atol=1e-15)
    distinct = len(np.unique(grid.reshape(-1, 3), axis=0))
    assert distinct == len(np.unique(grid.round(9).reshape(-1, 3), axis=0))
    octahedron = (size - 1) ** 2 + 2 * (size % 2)
    assert distinct == (octahedron if layout == "octahedral" else (size - 2) * 2 * size + 2)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("size", [3, 4, 9, 16])
def test_a_sample_at_a_pixel_is_that_pixel(layout: Layout, size: int) -> None:
    image = noise(layout, size, seed=1)
    found = image.sample(3 * directions(layout, size).reshape(-1, 3))
    np.testing.assert_allclose(found, image.positions.reshape(-1, 3), atol=1e-13)  # weights are off by rounding


def test_an_octahedral_sample_is_bilinear_in_the_unfolded_plane() -> None:
    image = ball("octahedral", 3)
    between = image.sample(np.array([[0.25, 0, 0.75], [1, 1, 0], [0.5, -0.25, -0.25]]))
    # (1, 1, 0) is the middle of the cell +z, +x, -z, +y; (0.5, -0.25, -0.25) unfolds to (0.75, -0.5)
    cell = 0.5 * (0.25 * CORNERS[3] + 0.75 * CORNERS[5]) + 0.5 * (0.25 * CORNERS[4] + 0.75 * CORNERS[0])
    np.testing.assert_allclose(between, [[0.25, 0, 0.75], [0.25, 0.25, 0], cell], atol=1e-15)


def test_a_latlong_sample_joins_the_last_column_to_the_first() -> None:
    image = noise("latlong", 3, seed=0)
    before = np.radians(-15)  # a quarter of a column before the first
    found = image.sample(np.array([[np.cos(before), np.sin(before), 0]]))
    np.testing.assert_allclose(found, [0.75 * image.positions[1, 0] + 0.25 * image.positions[1, 5]], atol=1e-14)


@settings(max_examples=60, deadline=None)
@given(st.integers(3, 12), st.floats(-1, 1), st.integers(0, 1000))
def test_samples_agree_on_both_sides_of_every_seam(size: int, along: float, seed: int) -> None:
    step, octahedral, latlong = 1e-9, noise("octahedral", size, seed), noise("latlong", size, seed)
    lines, across = np.array([[0, along, -1], [along, 0, -1]]), step * np.eye(3)[:2]
    np.testing.assert_allclose(octahedral.sample(lines + across), octahedral.sample(lines - across), atol=1e-6)
    sides = latlong.sample(np.array([[1, step, along], [1, -step, along]]))
    np.testing.assert_allclose(sides[0], sides[1], atol=1e-6)


def test_the_poles_of_a_globe_are_continuous() -> None:
    image, turn = noise("latlong", 7, seed=3), np.linspace(0, 6, 50)
    near = np.stack([1e-9 * np.cos(turn), 1e-9 * np.sin(turn), np.ones(50)], axis=1)
    np.testing.assert_allclose(image.sample(near) - image.positions[0, 0], 0, atol=1e-8)
    np.testing.assert_allclose(image.sample(-near) - image.positions[-1, 0], 0, atol=1e-8)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("first", [16, 17])
def test_the_sphere_comes_back_with_an_error_of_second_order(layout: Layout, first: int) -> None:
    queries = fibonacci(2000)
    sizes = [first, 2 * first - first % 2, 4 * first - 3 * (first % 2)]
    off = [np.abs(np.linalg.norm(ball(layout, size).sample(queries), axis=1) - 1).max() for size in sizes]
    slopes = np.diff(np.log(off)) / -np.diff(np.log(np.array(sizes) - 1))
    assert (slopes > 1.85).all()  # 2 in the limit


@pytest.mark.parametrize(("layout", "order"), [("latlong", 1.9), ("octahedral", 1.45)])  # the equator costs half an order
def test_shifts_along_the_sphere_vanish_too(layout: Layout, order: float) -> None:
    queries = fibonacci(4000)
    missed = [np.sqrt(np.mean((ball(layout, size).sample(queries) - queries) ** 2)) for size in (17, 33, 65, 129)]
    assert (-np.diff(np.log2(missed)) > order).all()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_icosphere_and_its_image_refined_together_near_the_sphere_with_second_order(layout: Layout) -> None:
    off = []
    for level in (1, 2, 3):
        mapped = radial(Mesh(*icosphere(level)))
        mesh = spherical_image(mapped, 8 * 2**level + 1, layout).to_mesh()
        off.append(4 * np.pi / 3 - mesh.volume)
    assert (np.abs(-np.diff(np.log2(off)) - 2) < 0.2).all()


@pytest.mark.parametrize("layout", LAYOUTS)
def test_each_pixel_shows_the_point_of_the_surface_in_its_direction(layout: Layout) -> None:
    image = spherical_image(radial(Mesh(*icosphere(2))), 20, layout)
    reach = np.linalg.norm(image.positions, axis=2, keepdims=True)
    np.testing.assert_allclose(image.positions / reach, directions(layout, 20), atol=1e-14)
    assert 0.97 < reach.min() < reach.max() <= 1 + 1e-15
    assert image.mask.all()


@settings(max_examples=80, deadline=None)
@given(st.sampled_from(LAYOUTS), st.integers(3, 10), st.integers(0, 10**6))
def test_the_mesh_is_a_sphere_whatever_the_positions(layout: Layout, size: int, seed: int) -> None:
    mesh = noise(layout, size, seed).to_mesh()
    require_sphere(mesh)
    assert mesh.topology.euler_characteristic == 2


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("size", [3, 4, 16, 17])
def test_the_mesh_of_the_sphere_looks_outwards_everywhere(layout: Layout, size: int) -> None:
    mesh = ball(layout, size).to_mesh()
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    assert np.einsum("kd,kd->k", a, np.cross(b, c)).min() > 0
    assert 0 < mesh.volume < 4 * np.pi / 3


def test_quads_are_cut_along_their_shorter_diagonal() -> None:
    positions = np.array(directions("latlong", 4))
    positions[1, 0] *= 0.1  # dented: the short diagonals all end here
    mesh = SphericalImage("latlong", positions, np.ones((4, 8), bool)).to_mesh()
    dent = np.flatnonzero((mesh.vertices == positions[1, 0]).all(axis=1))
    assert (mesh.topology.edges == dent).sum() == 6  # a pole, two beside it, three below


def test_a_hole_is_masked_and_shows_its_lid() -> None:
    points, faces = icosphere(2)
    gone = (faces == 0).any(axis=1)
    image = spherical_image(radial(Mesh(points, faces[~gone])), 65)
    ring = points[np.setdiff1d(faces[gone], 0)]
    turn = np.argsort(np.arctan2(ring[:, 1], ring[:, 0]))
    inside = (directions("octahedral", 65) @ np.cross(ring[turn], np.roll(ring[turn], -1, axis=0)).T).min(axis=2)
    clear = np.abs(inside) > 1e-12
    np.testing.assert_array_equal(image.mask[clear], inside[clear] < 0)
    assert 10 < (~image.mask).sum() < 200
    np.testing.assert_allclose(image.positions[~image.mask][:, 2], ring[0, 2], atol=1e-14)
    require_sphere(image.to_mesh())


def test_the_error_is_nothing_where_every_vertex_has_a_pixel() -> None:
    mapped = radial(Mesh(CORNERS, OCTAHEDRON))
    assert spherical_image(mapped, 3).rmse(mapped) < 1e-15
    assert spherical_image(mapped, 4).rmse(mapped) > 0.1  # no pixel on any axis but -z


def test_the_error_is_a_root_mean_square_weighted_by_area() -> None:
    mesh = Mesh(CORNERS + 2 * (CORNERS == 1) * [0, 0, 1], OCTAHEDRON)  # the upper faces are larger
    mapped = radial(mesh)
    positions = np.array(spherical_image(mapped, 3).positions)
    positions[1, 1] += [0.6, 0, 0.8]
    moved = SphericalImage("octahedral", positions, np.ones((3, 3), bool))
    assert moved.rmse(mapped) == pytest.approx(np.sqrt(mesh.vertex_areas[NORTH] / mesh.area), rel=1e-12)
    shifted = SphericalImage("octahedral", spherical_image(mapped, 3).positions + np.array([0, 0.5, 0]), np.ones((3, 3), bool))
    assert shifted.rmse(mapped) == pytest.approx(0.5, rel=1e-12)


def test_vertices_without_a_point_of_their_own_do_not_count() -> None:
    mapped = radial(Mesh(np.r_[CORNERS, [[9, 9, 9]]], OCTAHEDRON))
    assert mapped.valid.tolist() == [True] * 6 + [False]
    assert spherical_image(mapped, 3).rmse(mapped) < 1e-15


def test_a_mesh_without_area_has_an_error_too() -> None:
    mapped = SphericalMap(close(Mesh(np.zeros((6, 3)), OCTAHEDRON)), CORNERS, Trace((), "given"))
    shifted = SphericalImage("octahedral", np.full((3, 3, 3), [3.0, 0, 4]), np.ones((3, 3), bool))
    assert shifted.rmse(mapped) == pytest.approx(5)


@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("size", [2, 0, -5])
def test_too_small_a_size_is_refused(layout: Layout, size: int) -> None:
    with pytest.raises(InputError, match=f"size of 3 or more; found {size}"):
        spherical_image(radial(Mesh(CORNERS, OCTAHEDRON)), size, layout)


def test_what_does_not_fit_the_layout_is_refused() -> None:
    grid, mask = directions("octahedral", 4), np.ones((4, 4), bool)
    with pytest.raises(InputError, match="octahedral, latlong; found 'cube'"):
        directions("cube", 4)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="4 columns for 4 rows in the octahedral layout; found 3"):
        SphericalImage("octahedral", grid[:, :3], mask)
    with pytest.raises(InputError, match=r"mask of shape \(4, 4\)"):
        SphericalImage("octahedral", grid, mask[:2])
    with pytest.raises(InputError, match="finite numbers in positions"):
        SphericalImage("octahedral", np.full((4, 4, 3), np.nan), mask)
    with pytest.raises(InputError, match="non-zero directions"):
        ball("octahedral", 4).sample(np.zeros((1, 3)))


def test_a_torn_border_is_refused_and_named() -> None:
    positions = np.array(directions("octahedral", 4))
    positions[0, 2] += 1e-15
    with pytest.raises(InputError, match="pixels of the same direction to be equal; found 1") as caught:
        SphericalImage("octahedral", positions, np.ones((4, 4), bool))
    assert caught.value.elements == [[0, 2]]
    mask = np.ones((3, 6), bool)
    mask[0, 5] = False
    with pytest.raises(InputError, match="pixels of the same direction to be equal"):
        SphericalImage("latlong", directions("latlong", 3), mask)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_sixteen_bits_and_the_box_give_the_positions_back(layout: Layout) -> None:
    image = noise(layout, 9, seed=2)
    pixels, box = image.pixels()
    assert pixels.dtype == np.uint16
    assert (pixels.min(axis=(0, 1)) == 0).all()
    assert (pixels.max(axis=(0, 1)) == 65535).all()
    step = (box[1] - box[0]) / 65535
    assert (np.abs(box[0] + pixels * step - image.positions) <= 0.5 * step * (1 + 1e-9)).all()


def test_a_flat_surface_has_flat_pixels() -> None:
    flat = SphericalImage("octahedral", directions("octahedral", 4) * [1, 1, 0] + [0, 0, 7], np.ones((4, 4), bool))
    pixels, box = flat.pixels()
    assert not pixels[:, :, 2].any()
    assert box[:, 2].tolist() == [7, 7]


def test_the_picture_holds_the_positions_in_eight_bits(tmp_path: Path) -> None:
    image = ball("latlong", 8)
    image.write_png(tmp_path / "ball.png")
    colours = imread(tmp_path / "ball.png")[:, :, :3]
    pixels, _ = image.pixels()
    assert colours.shape == (8, 16, 3)
    np.testing.assert_allclose(colours, pixels / 65535, atol=0.501 / 255)
    assert [p.name for p in tmp_path.iterdir()] == ["ball.png"]
    with pytest.raises(FileError, match="writable folder"):
        image.write_png(tmp_path / "nowhere" / "ball.png")


@pytest.mark.parametrize("layout", LAYOUTS)
def test_an_image_survives_file_and_pickle(layout: Layout, tmp_path: Path) -> None:
    points, faces = icosphere(1)
    image = spherical_image(radial(Mesh(points, faces[5:])), 12, layout)
    assert not image.mask.all()
    image.save(tmp_path / "image.npz")
    for again in (SphericalImage.load(tmp_path / "image.npz"), pickle.loads(pickle.dumps(image))):
        assert again.layout == layout
        np.testing.assert_array_equal(again.positions, image.positions)
        np.testing.assert_array_equal(again.mask, image.mask)
        assert not again.positions.flags.writeable
        assert not again.mask.flags.writeable


def test_a_file_that_is_no_image_is_refused(tmp_path: Path) -> None:
    path, grid = tmp_path / "image.npz", directions("latlong", 3)
    _store.save(path, "sphere", 1, {"points": CORNERS})
    with pytest.raises(FileError, match="kind 'image'"):
        SphericalImage.load(path)
    _store.save(path, "image", 1, {"positions": grid, "layout": np.array("latlong")})
    with pytest.raises(FileError, match="1 missing: mask"):
        SphericalImage.load(path)
    _store.save(path, "image", 1, {"positions": grid, "mask": np.ones((3, 6), bool), "layout": np.array("octahedral")})
    with pytest.raises(FileError, match="3 columns for 3 rows"):
        SphericalImage.load(path)
    path.write_bytes(b"no archive")
    with pytest.raises(FileError, match="a morphlet image file"):
        SphericalImage.load(path)


@pytest.mark.skipif("MORPHLET_DATA" not in os.environ, reason="set MORPHLET_DATA to the folder of public test meshes")
def test_the_bunny_is_reproduced_to_a_fraction_of_a_percent() -> None:
    vertices, faces = igl.read_triangle_mesh(str(Path(os.environ["MORPHLET_DATA"]) / "meshes" / "bunny.off"))[:2]
    mapped = spherical_map(Mesh(vertices, faces))
    for layout in LAYOUTS:
        images = [spherical_image(mapped, size, layout) for size in (64, 128, 256)]
        error = np.array([image.rmse(mapped) for image in images]) / mapped.mesh.bbox_diagonal
        assert error[1] < 0.01
        assert (error[1:] < 0.6 * error[:-1]).all()  # first order: halved with each doubling
        mesh = images[1].to_mesh()
        require_sphere(mesh)
        assert mesh.volume == pytest.approx(mapped.mesh.volume, rel=0.01)
