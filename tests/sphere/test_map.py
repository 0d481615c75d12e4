"""SphericalMap: of the mesh as given, to a file and back, refused where there is no sphere."""

import zipfile
from pathlib import Path

import numpy as np
import pytest

from morphlet import FileError, InputError, Mesh, MeshError
from morphlet.errors import Cancelled
from morphlet.numerics.optimize import Trace
from morphlet.sphere.embed import SphereOptions
from morphlet.sphere.map import SphericalMap, map_surface, spherical_map
from morphlet.surface.repair import RepairOptions, close
from support import assert_one_to_one, beside, blob, icosphere, noisy, tetrahedron, torus


def cap_removed(level: int = 3) -> Mesh:
    """A body with a hole, a vertex in no face, and some faces reversed."""
    mesh = noisy(level, 0.15)
    keep = mesh.vertices[mesh.faces].mean(axis=1)[:, 2] < 0.75
    faces = np.where((np.arange(mesh.n_faces) % 7 == 0)[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces)[keep]
    return Mesh(mesh.vertices, faces)


@pytest.fixture(scope="module")
def opened() -> SphericalMap:
    return spherical_map(cap_removed())


def seamed() -> Mesh:
    """A tetrahedron of four loose faces, as texture seams leave it."""
    mesh = tetrahedron()
    return Mesh(mesh.vertices[mesh.faces].reshape(-1, 3), np.arange(12).reshape(4, 3))


def test_a_closed_mesh_is_mapped_as_it_is() -> None:
    mesh = blob(2)
    sphere = spherical_map(mesh)
    assert sphere.mesh is mesh
    assert sphere.surface.repairs == ()
    np.testing.assert_array_equal(sphere.points, sphere.closed_points)
    assert_one_to_one(sphere.points, mesh.faces)
    found = sphere.quality()
    assert (found.inverted, round(found.degree, 9)) == (0, 1)
    assert sphere.certificate().holds


def test_an_open_mesh_has_a_point_per_vertex_and_virtual_faces_are_certified(opened: SphericalMap) -> None:
    mesh = opened.mesh
    assert opened.points.shape == (mesh.n_vertices, 3)
    assert_one_to_one(opened.closed_points, opened.surface.mesh.faces)
    assert opened.surface.mesh.n_faces > mesh.n_faces
    np.testing.assert_array_equal(opened.valid, mesh.topology.referenced)
    real, points = opened.real_part()
    assert real.n_faces == mesh.n_faces
    np.testing.assert_array_equal(points, opened.closed_points)


def test_a_vertex_without_an_answer_takes_that_of_the_nearest(opened: SphericalMap) -> None:
    mesh = opened.mesh
    lost = np.flatnonzero(~opened.valid)
    assert len(lost) > 10
    near = np.linalg.norm(mesh.vertices[lost][:, None] - mesh.vertices[None, opened.valid], axis=2).argmin(axis=1)
    np.testing.assert_array_equal(opened.points[lost], opened.points[opened.valid][near])


def test_vertices_on_a_seam_share_a_point() -> None:
    sphere = spherical_map(seamed())
    _, group = np.unique(sphere.mesh.vertices, axis=0, return_inverse=True)
    for place in range(4):
        assert len(np.unique(sphere.points[group.ravel() == place], axis=0)) == 1
    assert len(np.unique(sphere.points, axis=0)) == 4


def test_a_single_triangle_and_an_open_disc() -> None:
    with pytest.raises(MeshError, match="at least 4 vertices"):
        spherical_map(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    square = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])
    sphere = spherical_map(square)
    assert sphere.certificate().holds
    assert len(sphere.closed_points) == 5


def test_the_map_of_a_part_chosen_by_repair() -> None:
    two = beside(icosphere(2), noisy(1, 0.1).with_vertices(noisy(1, 0.1).vertices * 0.2 + 3))
    sphere = map_surface(close(two, RepairOptions(fill="all", component="largest")))
    assert sphere.valid.tolist() == [True] * 162 + [False] * 42
    assert sphere.points.shape == (204, 3)


@pytest.mark.parametrize(
    ("mesh", "message"),
    [
        pytest.param(torus(), r"genus 0 for a spherical map; found a genus 1 surface \(chi = 0, 0 boundary loops\)", id="torus"),
        pytest.param(beside(icosphere(1), torus((5, 0, 0))), "2 connected components", id="sphere beside torus: chi is 2"),
        pytest.param(beside(icosphere(1), icosphere(1)), "2 connected components.*component", id="two spheres"),
        pytest.param(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), "no faces", id="nothing"),
    ],
)
def test_what_is_no_sphere_is_refused_with_the_reason(mesh: Mesh, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        spherical_map(mesh)


def test_points_off_the_sphere_are_refused() -> None:
    surface = close(tetrahedron())
    good = spherical_map(tetrahedron()).closed_points
    with pytest.raises(InputError, match="unit vectors in closed_points; found 1 that are not") as caught:
        SphericalMap(surface, good * np.array([[1], [1], [1.001], [1]]), Trace((), "made up"))
    assert caught.value.elements == [2]
    with pytest.raises(InputError, match=r"closed_points of shape \(4, 3\)"):
        SphericalMap(surface, good[:3], Trace((), "made up"))


def test_arrays_cannot_be_changed(opened: SphericalMap) -> None:
    for array in (opened.points, opened.closed_points):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


def test_cancelled_comes_out_of_the_map_as_it_went_in() -> None:
    def stop(step: object) -> None:
        raise Cancelled

    with pytest.raises(Cancelled, match="a request to stop"):
        spherical_map(blob(2), SphereOptions(), stop)


@pytest.mark.parametrize("mesh", [cap_removed(2), blob(2), seamed()], ids=["repaired", "clean", "welded"])
def test_a_file_gives_the_same_bits_back(mesh: Mesh, tmp_path: Path) -> None:
    sphere = spherical_map(mesh)
    sphere.save(tmp_path / "map.npz")
    again = SphericalMap.load(tmp_path / "map.npz", mesh)
    for name in ("points", "closed_points", "valid"):
        np.testing.assert_array_equal(getattr(again, name), getattr(sphere, name))
    for name in ("vertex_map", "face_map", "flipped"):
        np.testing.assert_array_equal(getattr(again.surface, name), getattr(sphere.surface, name))
    np.testing.assert_array_equal(again.surface.mesh.faces, sphere.surface.mesh.faces)
    assert [(r.what, r.count) for r in again.surface.repairs] == [(r.what, r.count) for r in sphere.surface.repairs]
    assert again.trace.reason == "read from a file"
    x = np.random.default_rng(0).normal(size=(50, 3))
    np.testing.assert_array_equal(again.locate(x).weights, sphere.locate(x).weights)
    assert again.quality() == sphere.quality()


def test_the_arrays_of_the_file_are_a_map_by_themselves(tmp_path: Path) -> None:
    mesh = noisy(2, 0.2)
    reverse = np.arange(mesh.n_faces) % 5 == 0
    mixed = Mesh(mesh.vertices, np.where(reverse[:, None], mesh.faces[:, [0, 2, 1]], mesh.faces))
    spherical_map(mixed).save(tmp_path / "map.npz")
    with np.load(tmp_path / "map.npz", allow_pickle=False) as file:
        points, faces, kind = file["points"], file["faces"], str(file["kind"])
        assert (points.dtype, faces.dtype, kind) == (np.float64, np.int64, "sphere")
        assert points.shape == (mesh.n_vertices, 3)
    assert_one_to_one(points, faces)
    np.testing.assert_array_equal(np.sort(faces, axis=1), np.sort(mesh.faces, axis=1))


def test_the_file_is_the_same_bytes_each_time_it_is_made(tmp_path: Path) -> None:
    contents = []
    for name in ("one.npz", "two.npz"):
        spherical_map(blob(2)).save(tmp_path / name)
        with zipfile.ZipFile(tmp_path / name) as archive:
            contents.append({entry: archive.read(entry) for entry in archive.namelist()})
    assert contents[0] == contents[1]


def test_the_map_of_another_mesh_is_refused(tmp_path: Path) -> None:
    spherical_map(tetrahedron()).save(tmp_path / "map.npz")
    other = tetrahedron().with_vertices(tetrahedron().vertices * 1.0000001)
    with pytest.raises(FileError, match=r"the map of this mesh in .*map\.npz; found the map of another mesh"):
        SphericalMap.load(tmp_path / "map.npz", other)


def test_files_of_another_kind_or_none_are_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="morphlet sphere file"):
        SphericalMap.load(tmp_path / "missing.npz", tetrahedron())
    (tmp_path / "text.npz").write_text("not an archive")
    with pytest.raises(FileError, match="morphlet sphere file"):
        SphericalMap.load(tmp_path / "text.npz", tetrahedron())
    np.savez(tmp_path / "other.npz", kind=np.array("network"), version=np.array(1))
    with pytest.raises(FileError, match="kind 'network'"):
        SphericalMap.load(tmp_path / "other.npz", tetrahedron())
    np.savez(tmp_path / "pickle.npz", kind=np.array("sphere"), version=np.array(1), points=np.array([{}], dtype=object))
    with pytest.raises(FileError, match="morphlet sphere file"):
        SphericalMap.load(tmp_path / "pickle.npz", tetrahedron())
    np.savez(tmp_path / "poor.npz", kind=np.array("sphere"), version=np.array(1))
    with pytest.raises(FileError, match="missing: fingerprint"):
        SphericalMap.load(tmp_path / "poor.npz", tetrahedron())
    np.savez(tmp_path / "later.npz", kind=np.array("sphere"), version=np.array(99))
    with pytest.raises(FileError, match="version 99; update morphlet"):
        SphericalMap.load(tmp_path / "later.npz", tetrahedron())


def test_files_cut_short_are_refused(tmp_path: Path) -> None:
    sphere, path = spherical_map(tetrahedron()), tmp_path / "map.npz"
    sphere.save(path)
    whole = path.read_bytes()
    for length in range(0, len(whole), 97):
        path.write_bytes(whole[:length])
        with pytest.raises(FileError):
            SphericalMap.load(path, tetrahedron())


def test_files_with_one_byte_changed_are_refused_or_unharmed(tmp_path: Path) -> None:
    sphere, path = spherical_map(tetrahedron()), tmp_path / "map.npz"
    sphere.save(path)
    whole = path.read_bytes()
    for place in range(0, len(whole), 13):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0x55]) + whole[place + 1 :])
        try:
            np.testing.assert_array_equal(SphericalMap.load(path, tetrahedron()).points, sphere.points)
        except FileError:
            continue


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("closed_points", np.zeros((4, 3))),
        ("closed_points", np.eye(3)),
        ("closed_faces", np.array([[0, 1, 9]])),
        ("vertex_map", np.array([0, 1, 2, 99])),
        ("vertex_map", np.array([0, 1])),
        ("face_map", np.array([0, 1, 2, 77])),
        ("flipped", np.zeros(2, bool)),
        ("valid", np.ones(7, bool)),
        ("repairs", np.array(["many welded things"])),
        ("closed_vertices", np.array([["a"]])),
    ],
)
def test_a_file_whose_arrays_do_not_fit_together_is_refused(name: str, value: np.ndarray, tmp_path: Path) -> None:
    path = tmp_path / "map.npz"
    spherical_map(tetrahedron()).save(path)
    with np.load(path) as file:
        arrays = {key: file[key] for key in file.files}
    np.savez(path, **{**arrays, name: value})
    with pytest.raises(FileError, match=r"map\.npz"):
        SphericalMap.load(path, tetrahedron())
