"""Rows of a geometry image as networks: what a block is, how many wavelets it takes, and the mesh that comes back."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mapping.stars import blob, radial_map
from morphlet import Mesh, metrics
from morphlet.approximation.rows import (
    ENOUGH,
    ImageApproximation,
    RowApproximation,
    RowOptions,
    approximate_by_rows,
    approximate_rows,
    rows_of_blocks,
)
from morphlet.errors import FileError, InputError
from morphlet.numerics.threads import limited
from morphlet.sphere.image import SphericalImage, directions, spherical_image
from morphlet.sphere.map import spherical_map
from morphlet.wavenet.blocks import NetworkTable
from morphlet.wavenet.fit import FitOptions, fit
from morphlet.wavenet.library import dyadic_library
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX, make_mother, mother
from support import data_mesh, icosphere, random_rotation

SIZE = 33
LAYOUTS = ("octahedral", "latlong")
WAYS = [(coordinates, rows) for coordinates in ("joint", "separate") for rows in (1, 2, 4, SIZE)]
each_layout = pytest.mark.parametrize("layout", LAYOUTS)
each_way = pytest.mark.parametrize(("coordinates", "block_rows"), WAYS)
ROUNDING = 1e-12
"""Relative; far above what a few thousand additions lose."""


def bumpy(layout, size=SIZE):
    """A blob as an image; 33 rows in blocks of 2 or 4 leave a last block that overlaps the one before."""
    return spherical_image(MAP, size, layout)


MAP = radial_map(blob(3))
IMAGES = {layout: bumpy(layout) for layout in LAYOUTS}


def rms(image, found, rows):
    """Distance of what the networks say from some rows of an image."""
    return np.sqrt(np.mean(np.sum((found.positions()[rows] - image.positions[rows]) ** 2, axis=-1)))


@each_layout
@each_way
def test_without_wavelets_each_row_is_its_regression_line(layout, coordinates, block_rows):
    """However the rows are cut into blocks: each output has an affine part of its own."""
    image = IMAGES[layout]
    found = approximate_rows(image, RowOptions(0, coordinates=coordinates, block_rows=block_rows))
    x = np.linspace(0, 1, image.positions.shape[1])
    lines = [np.column_stack([np.polyval(np.polyfit(x, row[:, c], 1), x) for c in range(3)]) for row in image.positions]
    np.testing.assert_allclose(found.positions(), lines, atol=ROUNDING)


@each_layout
def test_a_network_says_what_its_block_shows(layout):
    """Joint: outputs x, y, z of the first row, then of the next; separate: a network for x, then y, then z."""
    image = IMAGES[layout]
    x, first = np.linspace(0, 1, image.positions.shape[1]), SIZE - 2
    joint = approximate_rows(image, RowOptions(6, block_rows=2))
    apart = approximate_rows(image, RowOptions(6, coordinates="separate"))
    for block, row in ((3, 6), (len(joint.table) - 1, first)):
        said = joint.table[block](x)
        np.testing.assert_allclose(joint.positions()[row : row + 2], np.stack([said[:, :3], said[:, 3:]]), atol=ROUNDING)
    for c in range(3):
        np.testing.assert_allclose(apart.positions()[5, :, c], apart.table[3 * 5 + c](x)[:, 0], atol=ROUNDING)
        alone = fit(x, image.positions[5, :, [c]].T, dyadic_library(PAPER_SIX, x), FitOptions(6)).network
        np.testing.assert_allclose(apart.positions()[5, :, c], alone(x)[:, 0], atol=1e-9)


def test_blocks_cover_every_row_and_the_last_ends_with_the_last_row():
    assert rows_of_blocks(7, 3).tolist() == [[0, 1, 2], [3, 4, 5], [4, 5, 6]]
    assert rows_of_blocks(6, 3).tolist() == [[0, 1, 2], [3, 4, 5]]
    assert rows_of_blocks(4, 4).tolist() == [[0, 1, 2, 3]]


@each_layout
@each_way
def test_blocks_have_as_many_wavelets_as_asked(layout, coordinates, block_rows):
    found = approximate_rows(IMAGES[layout], RowOptions(5, coordinates=coordinates, block_rows=block_rows))
    blocks = -(-SIZE // block_rows) * (1 if coordinates == "joint" else 3)
    used = np.diff(found.table.offsets)
    assert len(found.table) == blocks
    inner = slice(3, -3) if block_rows == 1 else slice(None)  # the poles of a latlong image need none
    assert (used <= 5).all()
    assert (used[inner] == 5).all()
    assert sum(found.table.counts().values()) == used.sum()


def test_poles_need_no_wavelets():
    used = np.diff(approximate_rows(IMAGES["latlong"]).table.offsets)
    assert used[[0, -1]].tolist() == [0, 0]
    assert used[1:-1].tolist() == [15] * (SIZE - 2)


@each_layout
@each_way
@given(error=st.floats(0.005, 0.5))
@settings(max_examples=5)
def test_every_block_meets_the_error(layout, coordinates, block_rows, error):
    image = IMAGES[layout]
    found = approximate_rows(image, RowOptions(ENOUGH, error, coordinates=coordinates, block_rows=block_rows))
    worst = found.block_errors(image)
    assert worst.max() <= error * (1 + ROUNDING)
    assert worst.max() > 0.3 * error  # no more wavelets than it takes
    rows = rows_of_blocks(SIZE, block_rows)
    parts = worst.reshape(len(rows), -1)
    whole = np.sqrt(np.mean(parts**2, axis=1))  # of three networks, each counted as a whole
    shown = np.array([rms(image, found, block) for block in rows])
    owned = np.delete(np.arange(len(rows)), [-2] if len(rows) > 1 and rows[-1, 0] <= rows[-2, -1] else [])  # it lends rows to the last
    np.testing.assert_allclose(shown[owned], whole[owned], rtol=1e-9)


def test_one_wavelet_fewer_misses_the_error():
    image, error = IMAGES["octahedral"], 0.03
    used = np.diff(approximate_rows(image, RowOptions(ENOUGH, error)).table.offsets)
    assert used.min() < used.max()  # step 9: a number of its own for each block
    for row in (0, 10, 25):
        fewer = approximate_rows(image, RowOptions(int(used[row]) - 1))
        assert fewer.block_errors(image)[row] > error


@each_layout
def test_more_wavelets_are_closer(layout):
    image = IMAGES[layout]
    errors = [approximate_rows(image, RowOptions(m)).block_errors(image) for m in (0, 3, 15)]
    assert (np.diff(errors, axis=0) <= ROUNDING).all()


@given(st.integers(0, 1000), st.floats(-100, 100), st.floats(0.01, 100))
@settings(max_examples=15)
def test_joint_networks_turn_move_and_grow_with_the_shape(seed, shift, factor):
    """Which wavelets are chosen depends on distances alone."""
    rotation, image = random_rotation(seed), IMAGES["octahedral"]
    options = RowOptions(4)  # few: between near-equals rounding may decide
    moved = SphericalImage("octahedral", factor * (image.positions @ rotation.T + shift), image.mask)
    expected = factor * (approximate_rows(image, options).positions() @ rotation.T + shift)
    np.testing.assert_allclose(approximate_rows(moved, options).positions(), expected, atol=1e-8 * factor)


@each_layout
def test_pixels_of_one_direction_hold_the_mean_of_what_their_blocks_say(layout):
    found = approximate_rows(IMAGES[layout], RowOptions(3))
    said, shown = found.positions(), found.image().positions
    if layout == "latlong":
        for pole in (0, -1):
            np.testing.assert_allclose(shown[pole], np.broadcast_to(said[pole].mean(axis=0), shown[pole].shape), atol=ROUNDING)
    else:
        np.testing.assert_allclose(shown[0, 0], said[[0, 0, -1, -1], [0, -1, 0, -1]].mean(axis=0), atol=ROUNDING)
        np.testing.assert_allclose(shown[0, 1:-1], (said[0, 1:-1] + said[0, -2:0:-1]) / 2, atol=ROUNDING)
        np.testing.assert_allclose(shown[1:-1, -1], (said[1:-1, -1] + said[-2:0:-1, -1]) / 2, atol=ROUNDING)
        assert np.abs(said[:, 0] - said[::-1, 0]).max() > 1e-3  # there is something to join
    np.testing.assert_array_equal(shown[1:-1, 1:-1], said[1:-1, 1:-1])
    again = SphericalImage(layout, shown, found.mask)  # refused unless equal to the last bit
    assert again.to_mesh().topology.euler_characteristic == 2


def torn():
    """A blob with two holes and a seam, its vertices one per corner, after three that no face uses; and the vertex behind each."""
    whole = blob(3)
    wide = np.isin(whole.faces, whole.faces[(whole.faces == 0).any(axis=1)]).any(axis=1)
    kept = np.delete(whole.faces, np.append(np.flatnonzero(wide), [700, 900]), axis=0)
    origin = kept.ravel()
    far = np.array([[9.0, 0, 0], [0, 9, 0], [0, 0, 9]])
    return Mesh(np.vstack([far, whole.vertices[origin]]), 3 + np.arange(len(origin)).reshape(-1, 3)), origin


def test_a_torn_mesh_keeps_its_vertices_and_faces():
    mesh, origin = torn()
    mapped = spherical_map(mesh)
    found = approximate_by_rows(mapped, 65)
    back = found.mesh()
    np.testing.assert_array_equal(back.faces, mesh.faces)
    assert back.n_vertices == mesh.n_vertices
    inside = back.vertices[3:]
    _, first, twin = np.unique(origin, return_index=True, return_inverse=True)
    np.testing.assert_array_equal(inside, inside[first][twin])  # twins of a seam stay together
    figures = found.figures(mapped)
    assert figures["mse"] == pytest.approx(metrics.mse(inside, mesh.vertices[3:]), rel=1e-9)  # without those in no face
    assert figures["deformation_rate"] < 2
    assert figures["mse_relative"] < 2e-4
    exact = found.with_residual(mesh).mesh()
    np.testing.assert_allclose(exact.vertices, mesh.vertices, atol=ROUNDING * mesh.bbox_diagonal)


@each_layout
@each_way
def test_a_residual_makes_it_exact(layout, coordinates, block_rows):
    options = RowOptions(2, coordinates=coordinates, block_rows=block_rows)
    found = approximate_by_rows(MAP, SIZE, layout, options).with_residual(MAP.mesh)
    again = found.with_residual(MAP.mesh)
    np.testing.assert_array_equal(found.residual, again.residual)
    np.testing.assert_allclose(found.mesh().vertices, MAP.mesh.vertices, atol=ROUNDING)


def test_figures_are_what_they_say():
    found = approximate_by_rows(MAP, SIZE, options=RowOptions(8))
    figures, mesh, back = found.figures(MAP), MAP.mesh, found.mesh()
    distance = np.linalg.norm(back.vertices - mesh.vertices, axis=1)
    diagonal = np.linalg.norm(mesh.vertices.max(axis=0) - mesh.vertices.min(axis=0))
    assert figures["mse"] == pytest.approx(np.mean(distance**2))
    assert figures["mse_relative"] == pytest.approx(figures["mse"] / diagonal**2)
    assert figures["psnr"] == pytest.approx(-10 * np.log10(figures["mse_relative"]))
    assert figures["deformation_rate"] == pytest.approx(100 * distance.mean() / diagonal)
    assert figures["wavelets"] == 8 * SIZE == sum(figures["counts"].values())
    assert figures["blocks"] == SIZE
    grid = IMAGES["octahedral"].sample(MAP.points) - mesh.vertices
    assert figures["grid_mse_relative"] == pytest.approx(np.mean(np.sum(grid**2, axis=1)) / diagonal**2, rel=1e-4)
    assert figures["block_error_max"] == found.image.block_errors(IMAGES["octahedral"]).max()


def test_counts_name_the_six_and_the_others():
    found = approximate_by_rows(MAP, 9, options=RowOptions(2, mothers=(MOTHERS["polywog2"], MOTHERS["beta1"])))
    counts = found.counts()
    assert list(counts) == [psi.name for psi in PAPER_SIX] + ["polywog2"]
    assert {name for name, count in counts.items() if count} <= {"beta1", "polywog2"}
    assert sum(counts.values()) == len(found.table.centers) == 18


def test_a_mesh_without_size_has_no_relative_error():
    """All vertices at one place, on a given sphere."""
    mapped = radial_map(icosphere(2))
    closed = replace(
        mapped.surface, source=mapped.mesh.with_vertices(0 * mapped.mesh.vertices), mesh=mapped.mesh.with_vertices(0 * mapped.mesh.vertices)
    )
    figures = approximate_by_rows(replace(mapped, surface=closed), 9).figures(replace(mapped, surface=closed))
    assert (figures["mse"], figures["wavelets"]) == (0, 0)
    assert np.isnan(figures["mse_relative"])


@pytest.mark.parametrize("residual", [False, True])
@each_layout
def test_the_file_alone_gives_the_mesh_back_to_the_bit(tmp_path, layout, residual):
    found = approximate_by_rows(MAP, SIZE, layout, RowOptions(7, block_rows=2, mothers=(mother("beta2(4,8)"), MOTHERS["slog1"])))
    found = found.with_residual(MAP.mesh) if residual else found
    found.save(tmp_path / "ic.npz")
    for again in (RowApproximation.load(tmp_path / "ic.npz"), pickle.loads(pickle.dumps(found))):
        np.testing.assert_array_equal(again.mesh().vertices, found.mesh().vertices)
        np.testing.assert_array_equal(again.mesh().faces, MAP.mesh.faces)
        assert (again.counts(), again.image.block_rows, again.residual is None) == (found.counts(), 2, not residual)
        np.testing.assert_array_equal(again.image.image().mask, IMAGES[layout].mask)


def test_the_mask_comes_back(tmp_path):
    mapped = spherical_map(torn()[0])
    found = approximate_by_rows(mapped, SIZE)
    found.save(tmp_path / "ic.npz")
    assert not found.image.mask.all()
    np.testing.assert_array_equal(RowApproximation.load(tmp_path / "ic.npz").image.image().mask, spherical_image(mapped, SIZE).mask)


def test_own_mothers_come_back_with_their_functions(tmp_path):
    mine = make_mother("ripple", lambda t: t**3 * np.exp(-(t**2)), lambda t: (3 * t**2 - 2 * t**4) * np.exp(-(t**2)))
    found = approximate_by_rows(MAP, 9, options=RowOptions(3, mothers=(mine,)))
    found.save(tmp_path / "ic.npz")
    np.testing.assert_array_equal(RowApproximation.load(tmp_path / "ic.npz", [mine]).mesh().vertices, found.mesh().vertices)
    with pytest.raises(FileError, match="'ripple'"):
        RowApproximation.load(tmp_path / "ic.npz")


def test_the_number_of_threads_changes_no_bit():
    found = []
    for threads in (1, 3):
        with limited(threads):
            found.append(approximate_by_rows(MAP, 65).mesh().vertices)
    np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"n_wavelets": -1}, "n_wavelets >= 0"),
        ({"error": -0.1}, "a finite error of 0 or more; found -0.1"),
        ({"error": np.inf}, "a finite error"),
        ({"error": np.nan}, "a finite error"),
        ({"method": "best"}, "a method of ols, omp, mp"),
        ({"coordinates": "xyz"}, "coordinates to be one of joint, separate; found 'xyz'"),
        ({"mothers": ()}, "at least one mother; found none"),
        ({"mothers": (PAPER_SIX[0],) * 2}, "each mother once"),
        ({"mothers": ("slog1",)}, "mothers; found str"),
        ({"block_rows": 0}, "1 or more rows per block"),
    ],
)
def test_options_out_of_range(options, match):
    with pytest.raises(InputError, match=match):
        RowOptions(**options)


def test_parts_that_do_not_fit():
    image, found = IMAGES["octahedral"], approximate_by_rows(MAP, SIZE)
    with pytest.raises(InputError, match="1 to 33 rows per block; found 34"):
        approximate_rows(image, RowOptions(block_rows=34))
    with pytest.raises(InputError, match="33 networks of 3 outputs or 99 networks of 1 outputs; found NetworkTable"):
        ImageApproximation("octahedral", NetworkTable((), [0, 0], [], [], [], np.zeros((0, 3)), np.zeros((1, 2, 3))), image.mask)
    with pytest.raises(InputError, match=r"a mask of shape \(33, 66\); found shape \(33, 33\)"):
        replace(found.image, layout="latlong")
    with pytest.raises(InputError, match="a octahedral image of size 33; found a latlong one of 33"):
        found.image.block_errors(IMAGES["latlong"])
    with pytest.raises(InputError, match="the mesh that was approximated"):
        found.with_residual(Mesh(MAP.mesh.vertices, MAP.mesh.faces[::-1]))
    with pytest.raises(InputError, match="non-zero directions in points"):
        replace(found, points=0 * found.points)
    with pytest.raises(InputError, match="residual of shape"):
        replace(found, residual=np.zeros((3, 3)))
    with pytest.raises(InputError, match="a size of 3 or more"):
        approximate_by_rows(MAP, 2)


DAMAGE = {
    "mothers": (np.array(["unicorn"] * 6), "one of mexican_hat"),
    "faces": (np.array([[0, 1, 10**6]]), "indices from 0"),
    "layout": (np.array("cube"), "layout to be one of"),
    "block_rows": (np.array([1, 2]), "block_rows of shape"),
    "mask": (np.zeros((9, 8), np.uint8), "a mask of shape"),
    "points": (np.zeros((642, 3), np.float32), "non-zero directions"),
    "residual": (np.array(3.0), "residual of shape"),
    "offsets": (np.array([0]), "offsets that rise"),
}


@pytest.mark.parametrize("name", DAMAGE)
def test_damaged_files_are_refused_by_what_is_wrong(tmp_path, name):
    path, (value, match) = tmp_path / "ic.npz", DAMAGE[name]
    approximate_by_rows(MAP, 9, options=RowOptions(1)).save(path)
    with np.load(path, allow_pickle=False) as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(path, **(arrays | {name: value}))
    with pytest.raises(FileError, match=match):
        RowApproximation.load(path)
    np.savez(path, **{key: array for key, array in arrays.items() if key != name})
    with pytest.raises(FileError, match=f"1 missing: {name}"):
        RowApproximation.load(path)


def test_other_files_are_refused(tmp_path):
    MAP.save(tmp_path / "sphere.npz")
    Path(tmp_path, "text.npz").write_text("no archive", encoding="utf-8")
    with pytest.raises(FileError, match=r"a file of kind 'mesh in rows'.*found kind 'sphere'"):
        RowApproximation.load(tmp_path / "sphere.npz")
    for name in ("text.npz", "none.npz"):
        with pytest.raises(FileError, match="a morphlet mesh in rows file"):
            RowApproximation.load(tmp_path / name)


@pytest.mark.parametrize(("name", "bar"), [("meshes/bunny.off", 1.1e-5), ("meshes/cat.obj", 1.6e-5), ("meshes/horse.obj", 2.3e-5)])
def test_public_meshes_with_fifteen_wavelets(name, bar):
    """The bars are 10 to 15 % above what was measured."""
    mesh = data_mesh(name)
    mapped = spherical_map(mesh)
    found = approximate_by_rows(mapped)
    figures = found.figures(mapped)
    assert figures["grid_mse_relative"] < figures["mse_relative"] < bar
    assert figures["deformation_rate"] < 0.42
    assert (figures["wavelets"], figures["blocks"]) == (129 * 15, 129)
    assert min(figures["counts"].values()) > 100
    np.testing.assert_array_equal(found.mesh().faces, mesh.faces)
    assert directions("octahedral", 129).shape == found.image.positions().shape
