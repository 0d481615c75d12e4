"""Approximations of surfaces: positions and fields over the mesh's own sphere, exact with their residual, whole from a file."""

import pickle

import numpy as np
import pytest

from morphlet import Mesh, SphericalMap, _store, spherical_map
from morphlet.approximation.surface import ApproximationOptions, SurfaceApproximation, approximate
from morphlet.errors import FileError, InputError
from morphlet.metrics import psnr, rms
from morphlet.sphere.map import map_surface
from morphlet.surface.repair import RepairOptions, close
from morphlet.wavenet.mothers import MOTHERS, make_mother
from morphlet.wavenet.spherical import spherical_library
from morphlet.wavenet.spherical_fit import fit_sphere
from support import blob, data_mesh, icosphere, random_rotation

COARSE = ApproximationOptions(levels=2, voices=1)
KIND = "surface approximation"


@pytest.fixture(scope="module")
def mapped():
    """A lopsided body, and its map."""
    return spherical_map(blob(3))


@pytest.fixture(scope="module")
def found(mapped):
    """Its positions as 30 wavelets."""
    return approximate(mapped, mapped.mesh.vertices, 30, COARSE)


def moved(mapped, vertices):
    """The map of a mesh of the same connectivity, with the same points."""
    return SphericalMap(spherical_map(mapped.mesh.with_vertices(vertices)).surface, mapped.closed_points, mapped.trace)


def test_few_wavelets_follow_the_surface(mapped, found):
    mesh = mapped.mesh
    assert len(found.network) == 30
    assert psnr(rms(found.values(), mesh.vertices), mesh.bbox_diagonal) > 45
    assert np.array_equal(found.mesh().faces, mesh.faces)
    assert len(found.residual) == 0


def test_the_error_is_the_mean_over_the_area(mapped, found):
    areas = mapped.mesh.vertex_areas
    squares = ((found.values() - mapped.mesh.vertices) ** 2).sum(axis=1)
    assert found.fit.sse[-1] == pytest.approx(squares @ areas / areas.sum(), rel=1e-9)


def test_it_is_a_function_on_the_sphere(mapped, found):
    np.testing.assert_array_equal(found(mapped.points), found.values())
    np.testing.assert_allclose(found(7 * mapped.points[:5]), found.values()[:5], atol=1e-9)
    assert found(np.eye(3)).shape == (3, 3)


def test_with_its_residual_it_is_exact(mapped, found):
    mesh = mapped.mesh
    whole = found.with_residual(mesh.vertices)
    np.testing.assert_allclose(whole.values(), mesh.vertices, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(whole.mesh().vertices, mesh.vertices, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(whole(mapped.points), found.values())


def test_fields_of_any_width(mapped):
    field = np.sin(3 * mapped.mesh.vertices[:, :1])
    found = approximate(mapped, field, 40, COARSE)
    assert found.values().shape == field.shape
    assert found.fit.sse[-1] < 0.01 * found.fit.sse[0]
    with pytest.raises(InputError, match="vertices of shape"):
        found.mesh()


def test_constant_fields_need_no_wavelets(mapped):
    found = approximate(mapped, np.full((mapped.mesh.n_vertices, 2), 4.0), 10, COARSE)
    assert (len(found.network), found.fit.reason) == (0, "exhausted")
    np.testing.assert_allclose(found.values(), 4, atol=1e-12)


def test_the_tolerance_stops_it(mapped, found):
    enough = ApproximationOptions(levels=2, voices=1, tolerance=found.fit.sse[10] * 1.0001)
    assert len(approximate(mapped, mapped.mesh.vertices, 30, enough).network) == 10


@pytest.mark.parametrize("factor", [1e-9, 1e6])
def test_scale_and_place_do_not_matter(mapped, found, factor):
    vertices = factor * (mapped.mesh.vertices @ random_rotation(1).T + [5.0, -3, 2])
    other = approximate(moved(mapped, vertices), vertices, 30, COARSE)
    expected = factor * (found.values() @ random_rotation(1).T + [5.0, -3, 2])
    np.testing.assert_allclose(other.values(), expected, atol=1e-6 * factor)


def test_vertices_count_by_their_area_on_the_mesh(mapped, found):
    mesh = mapped.mesh
    library = spherical_library(COARSE.mothers, mapped.points, mesh.vertex_areas, COARSE.levels, COARSE.voices)
    by_area, evenly = (fit_sphere(mapped.points, mesh.vertices, w, library, 30) for w in (mesh.vertex_areas, np.ones(mesh.n_vertices)))
    np.testing.assert_array_equal(by_area.network(mapped.points), found.values())
    assert np.abs(evenly.network(mapped.points) - found.values()).max() > 1e-4


def test_vertices_without_an_answer_take_their_neighbours_value():
    ball = blob(2)
    vertices = np.vstack([ball.vertices, [[9.0, 9, 9]], ball.vertices[:3] + 20])
    n = ball.n_vertices
    mesh = Mesh(vertices, np.vstack([ball.faces, [[n + 1, n + 2, n + 3]]]))
    mapped = map_surface(close(mesh, RepairOptions(fill="all", component="largest")))
    assert not mapped.valid[n:].any()
    found = approximate(mapped, vertices, 20, ApproximationOptions(levels=1, voices=1))
    alone = approximate(spherical_map(ball), ball.vertices, 20, ApproximationOptions(levels=1, voices=1))
    np.testing.assert_allclose(found.values()[:n], alone.values(), atol=1e-9)
    distance = np.linalg.norm(found.values()[n:, None] - found.values()[:n], axis=2)
    assert (distance.min(axis=1) < 1e-12).all()
    assert found.mesh().n_vertices == n + 4
    np.testing.assert_allclose(found.with_residual(vertices).values(), vertices, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("kept", [False, True])
def test_the_file_alone_gives_the_mesh(tmp_path, mapped, found, kept):
    whole = found.with_residual(mapped.mesh.vertices) if kept else found
    whole.save(tmp_path / "net.npz")
    for copy in (SurfaceApproximation.load(tmp_path / "net.npz"), pickle.loads(pickle.dumps(whole))):
        np.testing.assert_array_equal(copy.mesh().vertices, whole.mesh().vertices)
        np.testing.assert_array_equal(copy.mesh().faces, mapped.mesh.faces)
        np.testing.assert_array_equal(copy.fit.sse, found.fit.sse)
        assert copy.fit.reason == "count"
        assert repr(copy) == "SurfaceApproximation(30 wavelets for 642 vertices)"


def test_own_mothers_have_to_be_passed_again(tmp_path, mapped):
    own = make_mother("ripple", lambda t: t**3 * np.exp(-(t**2)), lambda t: (3 * t**2 - 2 * t**4) * np.exp(-(t**2)))
    options = ApproximationOptions((own, MOTHERS["beta2"]), 1, 1)
    found = approximate(mapped, mapped.mesh.vertices, 10, options)
    found.save(tmp_path / "own.npz")
    np.testing.assert_array_equal(SurfaceApproximation.load(tmp_path / "own.npz", [own]).values(), found.values())
    with pytest.raises(FileError, match="ripple"):
        SurfaceApproximation.load(tmp_path / "own.npz")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("points", np.zeros((642, 3)), "unit vectors in points; found 642"),
        ("points", np.eye(3), "faces"),
        ("faces", np.full((2, 3), 700), "faces"),
        ("residual", np.zeros((5, 3)), "642 rows of residual or none"),
        ("sse", np.full(31, np.nan), "finite numbers in sse"),
        ("reason", np.array("weather"), "a reason of"),
        ("weights", np.zeros((30, 2)), "weights"),
        ("mothers", np.array(["nobody", "beta1"]), "nobody"),
    ],
)
def test_damaged_files_are_refused(tmp_path, found, name, value, message):
    found.save(tmp_path / "net.npz")
    with np.load(tmp_path / "net.npz") as file:
        arrays = {key: file[key] for key in file.files if key not in ("kind", "version")}
    _store.save(tmp_path / "net.npz", KIND, 1, arrays | {name: value})
    with pytest.raises(FileError, match=f"(?s){KIND}.*{message}"):
        SurfaceApproximation.load(tmp_path / "net.npz")


def test_other_files_are_refused(tmp_path, mapped):
    mapped.save(tmp_path / "map.npz")
    with pytest.raises(FileError, match="kind 'sphere'"):
        SurfaceApproximation.load(tmp_path / "map.npz")
    with pytest.raises(FileError, match=KIND):
        SurfaceApproximation.load(tmp_path / "missing.npz")


def test_what_does_not_fit_is_refused(mapped, found):
    with pytest.raises(InputError, match="values of shape"):
        approximate(mapped, np.zeros((3, 3)), 5, COARSE)
    with pytest.raises(InputError, match="finite numbers in values"):
        approximate(mapped, mapped.mesh.vertices * np.nan, 5, COARSE)
    with pytest.raises(InputError, match="n_wavelets -3"):
        approximate(mapped, mapped.mesh.vertices, -3, COARSE)
    with pytest.raises(InputError, match="values of shape"):
        found.with_residual(np.zeros((642, 2)))
    with pytest.raises(InputError, match=r"points of shape \(642, 3\)"):
        SurfaceApproximation(found.fit, np.eye(3), icosphere(3).topology, np.zeros((0, 3)))


def test_a_public_mesh_is_followed_better_than_by_as_many_harmonics():
    """125 wavelets of bunny.off; 129 harmonics leave 39 dB (benchmarks/wavelet_mesh.py)."""
    mesh = data_mesh("meshes/bunny.off")
    found = approximate(spherical_map(mesh), mesh.vertices, 125, ApproximationOptions(levels=4, voices=1))
    assert psnr(rms(found.values(), mesh.vertices), mesh.bbox_diagonal) > 42
