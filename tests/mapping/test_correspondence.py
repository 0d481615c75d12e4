"""Correspondence: identity and relabelling, pulling, files, and its measures on cases known by hand."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from mapping.stars import blob, radial_map
from morphlet import Mesh, SurfacePoints, VertexPairs
from morphlet.errors import FileError, InputError
from morphlet.mapping import correspondence as co
from morphlet.mapping.correspondence import Correspondence, compose
from morphlet.numerics.unit_sphere import icosphere
from support import relabelled

LOCATED = 1e-9
"""Rounding of a place found through its direction."""
SQUARE = Mesh([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]])


def corners(mesh):
    """Each vertex of a mesh as a place in one of its faces."""
    face = np.empty(mesh.n_vertices, np.int64)
    face[mesh.faces] = np.arange(mesh.n_faces)[:, None]
    weights = (mesh.faces[face] == np.arange(mesh.n_vertices)[:, None]).astype(float)
    return SurfacePoints(face, weights)


def identity(mesh, target=None):
    return Correspondence(mesh, target or mesh, corners(mesh))


def test_a_mesh_corresponds_to_itself():
    mesh = blob()
    found = compose(radial_map(mesh), radial_map(mesh))
    np.testing.assert_allclose(found.positions, mesh.vertices, atol=LOCATED)
    assert found.valid.all()


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 10**6))
def test_a_turned_and_relabelled_copy_corresponds_by_its_labels(seed):
    mesh = blob(2)
    copy, place = relabelled(mesh, seed)
    rotation = Rotation.random(random_state=seed).as_matrix()
    found = compose(radial_map(mesh, rotation), radial_map(copy, rotation))
    np.testing.assert_allclose(found.positions, mesh.vertices, atol=LOCATED)
    np.testing.assert_array_equal(np.asarray(found.matrix.argmax(axis=1)).ravel(), place)


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 10**6))
def test_pull_keeps_constants_and_linear_functions(seed):
    rotation = Rotation.random(random_state=seed).as_matrix()
    found = compose(radial_map(blob(2)), radial_map(blob(3), rotation))
    np.testing.assert_allclose(found.pull(np.full(found.target.n_vertices, 4.5)), 4.5, atol=1e-12)
    direction = np.random.default_rng(seed).normal(size=3)
    np.testing.assert_allclose(found.pull(found.target.vertices @ direction), found.positions @ direction, atol=1e-12)
    np.testing.assert_array_equal(found.pull(found.target.vertices), found.matrix @ found.target.vertices)


def test_images_lie_above_their_directions():
    source, target = blob(2), Mesh(*icosphere(3))
    found = compose(radial_map(source), radial_map(target))
    np.testing.assert_allclose(np.cross(found.positions, source.vertices), 0, atol=1e-9)


def test_a_hole_in_the_target_is_bridged_by_its_rim():
    whole = blob(2)
    holed = Mesh(whole.vertices, whole.faces[1:])
    found = compose(radial_map(whole), radial_map(holed))
    assert found.points.faces.max() < holed.n_faces
    np.testing.assert_allclose(found.positions, whole.vertices, atol=LOCATED)


def test_pulling_too_few_values_is_refused():
    with pytest.raises(InputError, match="one per vertex of the target"):
        identity(SQUARE).pull([1.0, 2.0])


def test_wrong_sizes_are_refused():
    with pytest.raises(InputError, match="one per vertex of the source"):
        Correspondence(SQUARE, SQUARE, SurfacePoints([0], [[1, 0, 0]]))
    with pytest.raises(InputError, match="target's faces"):
        Correspondence(SQUARE, SQUARE, SurfacePoints([0, 0, 0, 2], np.tile([1.0, 0, 0], (4, 1))))
    with pytest.raises(InputError, match="valid of shape"):
        Correspondence(SQUARE, SQUARE, corners(SQUARE), [True])


def test_files_bring_back_the_same_bits(tmp_path):
    found = Correspondence(SQUARE, SQUARE, corners(SQUARE), [True, False, True, True])
    found.save(tmp_path / "map.npz")
    loaded = Correspondence.load(tmp_path / "map.npz", SQUARE, SQUARE)
    for name in ("faces", "weights"):
        np.testing.assert_array_equal(getattr(loaded.points, name), getattr(found.points, name))
    np.testing.assert_array_equal(loaded.valid, found.valid)
    with np.load(tmp_path / "map.npz", allow_pickle=False) as file:
        assert {"faces", "weights", "valid"} <= set(file.files)
        assert file["faces"].dtype == np.int64


def test_a_file_of_other_meshes_is_refused(tmp_path):
    identity(SQUARE).save(tmp_path / "map.npz")
    with pytest.raises(FileError, match="for this source"):
        Correspondence.load(tmp_path / "map.npz", blob(0), SQUARE)
    with pytest.raises(FileError, match="for this target"):
        Correspondence.load(tmp_path / "map.npz", SQUARE, blob(0))
    (tmp_path / "map.npz").write_bytes(b"no archive")
    with pytest.raises(FileError, match="morphlet correspondence file"):
        Correspondence.load(tmp_path / "map.npz", SQUARE, SQUARE)


def test_pickling_keeps_arrays_read_only():
    copy = pickle.loads(pickle.dumps(identity(SQUARE)))
    np.testing.assert_array_equal(copy.positions, SQUARE.vertices)
    assert not copy.valid.flags.writeable


@settings(deadline=None, max_examples=10)
@given(st.integers(0, 1000), st.floats(0.01, 100))
def test_energy_is_one_for_motions_and_sizes(seed, scale):
    mesh = blob(2)
    moved = mesh.with_vertices(scale * mesh.vertices @ Rotation.random(random_state=seed).as_matrix().T + 5)
    found = identity(mesh, moved)
    assert co.energy(found) == pytest.approx(1, abs=1e-9)
    assert co.energy_mean(found) == pytest.approx(1, abs=1e-9)


def test_energy_of_a_stretch_by_hand():
    stretched = SQUARE.with_vertices(SQUARE.vertices * [4, 1, 1])  # over sqrt(4): stretches 2 and 1/2, area kept
    assert co.energy(identity(SQUARE, stretched)) == pytest.approx((4 + 0.25) * 2 / 4)


def test_the_two_means_weigh_triangles_by_area_or_alike():
    source = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-3, 0, 0]], [[0, 1, 2], [0, 2, 3]])  # areas 1/2 and 3/2
    target = source.with_vertices(np.array([[0, 0, 0], [3, 0, 0], [0, 1, 0], [-1, 0, 0]]))  # stretches 3 and 1/3
    found = identity(source, target)
    big, small = (9 + 1) * (1 + 1 / 9) / 4, (1 / 9 + 1) * (1 + 9) / 4
    assert co.energy(found) == pytest.approx((big + 3 * small) / 4)
    assert co.energy_mean(found) == pytest.approx((big + small) / 2)


def test_collapse_has_a_large_finite_energy():
    points = SurfacePoints(np.zeros(4, np.int64), np.tile([1.0, 0, 0], (4, 1)))
    assert co.energy(Correspondence(SQUARE, SQUARE, points)) == pytest.approx(0.5 / np.sqrt(co.LEAST_AREA_RATIO))
    line = SurfacePoints([0, 0, 0, 0], [[1, 0, 0], [0, 1, 0], [0, 1, 0], [1, 0, 0]])
    assert 10 < co.energy(Correspondence(SQUARE, SQUARE, line)) < 1000


def test_source_faces_without_area_are_left_out():
    mesh = Mesh([*SQUARE.vertices.tolist(), [2, 0, 0]], [*SQUARE.faces.tolist(), [0, 1, 4]])
    assert co.energy_mean(identity(mesh)) == pytest.approx(1)


def test_folds_are_counted_in_percent_of_the_faces():
    mesh = blob(2)
    assert co.folds_surface_percent(identity(mesh)) == 0
    points = corners(mesh)
    a, b, _ = mesh.faces[0]
    order = np.arange(mesh.n_vertices)
    order[[a, b]] = b, a
    swapped = Correspondence(mesh, mesh, SurfacePoints(points.faces[order], points.weights[order]))
    assert co.folds_surface_percent(swapped) >= 100 / mesh.n_faces
    inside_out = Mesh(mesh.vertices, mesh.faces[:, ::-1])
    assert co.folds_surface_percent(Correspondence(mesh, inside_out, corners(inside_out))) == 100


def test_collapsed_images_are_no_folds():
    points = SurfacePoints(np.zeros(4, np.int64), np.tile([1.0, 0, 0], (4, 1)))
    assert co.folds_surface_percent(Correspondence(SQUARE, SQUARE, points)) == 0


def test_rmse_of_pairs_by_hand():
    found = identity(SQUARE)
    assert co.pairs_rmse(found, VertexPairs([0, 1], [0, 1])) == 0
    assert co.pairs_rmse(found, VertexPairs([0, 1], [2, 1])) == pytest.approx(1)
    with pytest.raises(InputError, match="at least one pair"):
        co.pairs_rmse(found, VertexPairs([], []))
    with pytest.raises(InputError, match="source column"):
        co.pairs_rmse(found, VertexPairs([9], [0]))


def bent_at(vertex, amount=0.5):
    """A blob on itself, but for one vertex and its ring, which lie nearer to each other than they should."""
    mesh = blob(3)
    points = radial_map(mesh).points.copy()
    ring = np.unique(mesh.faces[(mesh.faces == vertex).any(axis=1)])
    points[ring] = points[vertex] + amount * (points[ring] - points[vertex])
    return Correspondence(mesh, mesh, radial_map(mesh).locate(points))


def test_an_isometry_has_no_strain_and_all_confidence():
    mesh = blob(2)
    moved = mesh.with_vertices(3 * mesh.vertices @ Rotation.from_rotvec([1, 2, 3]).as_matrix().T - 5)
    np.testing.assert_allclose(co.strain(identity(mesh, moved)), 0, atol=1e-9)
    np.testing.assert_allclose(co.confidence(identity(mesh, moved)), 1, atol=1e-9)


@settings(deadline=None, max_examples=5)
@given(st.integers(0, 641))
def test_strain_is_where_the_map_is_strained_and_fades_with_the_distance(vertex):
    found = bent_at(vertex)
    x = found.source.vertices
    away = np.linalg.norm(x - x[vertex], axis=1) / np.sqrt(found.source.area)
    strain = co.strain(found, 0.05)
    assert away[np.argmax(strain)] < 0.1
    assert strain[away < 0.05].mean() > 10 * strain[away > 0.4].mean()
    np.testing.assert_array_equal(co.confidence(found), np.exp(-co.strain(found)))


def test_strain_spreads_but_is_kept_in_the_whole():
    """Diffusion moves it only: the mean over the area is the mean log energy."""
    found = bent_at(100)
    energies, areas = co.stretch_energies(found)
    share = found.source.vertex_areas / found.source.area
    for around in (0.02, 0.1, 0.3):
        assert co.strain(found, around) @ share == pytest.approx(np.log(energies) @ areas, rel=1e-6)
    assert co.strain(found, 0.3).max() < co.strain(found, 0.05).max() < co.strain(found, 0.01).max()


def test_sizes_and_numbers_of_the_mesh_do_not_change_the_strain():
    found = bent_at(100)
    large = found.source.with_vertices(1e4 * found.source.vertices)
    np.testing.assert_allclose(co.strain(Correspondence(large, large, found.points)), co.strain(found), rtol=1e-6, atol=1e-9)


def test_what_has_no_answer_has_no_confidence():
    speck = SQUARE.n_vertices + np.array([[0, 1, 2]])
    mesh = Mesh(np.vstack([SQUARE.vertices, 5 + np.eye(3), [[9, 9, 9]]]), np.vstack([SQUARE.faces, speck]))
    places = SurfacePoints([0, 0, 0, 1, 0, 0, 0, 0], [[1, 0, 0], [0, 1, 0], [0, 0, 1], [0, 0, 1], *([[1, 0, 0]] * 4)])
    found = Correspondence(mesh, SQUARE, places, [True] * 4 + [False] * 4)
    assert co.confidence(found)[4:].tolist() == [0, 0, 0, 0]
    assert (co.confidence(found)[:4] > 0.2).all()
    assert np.isfinite(co.strain(found)).all()


def test_faces_at_a_vertex_without_an_answer_do_not_count():
    mesh = blob(2)
    points, valid = corners(mesh), np.arange(mesh.n_vertices) != 100
    faces = np.array(points.faces)
    faces[100] = points.faces[3]
    found = Correspondence(mesh, mesh, SurfacePoints(faces, points.weights), valid)
    np.testing.assert_allclose(co.strain(found)[valid], 0, atol=1e-9)


def test_a_pair_that_strains_its_surroundings_is_doubtful():
    found = bent_at(100, 0.15)
    pairs = VertexPairs([0, 100, 300], [0, 100, 300], labels=("a", "left ear", "b"))
    np.testing.assert_array_equal(co.doubtful_pairs(found, pairs), [1])
    (told,) = co.doubts(found, pairs)
    assert told.startswith("1 of 3 pairs are doubtful, most of all 100,100 left ear: ")
    assert co.doubts(identity(blob(2)), pairs_at(5)) == ()
    assert co.doubts(found, VertexPairs([], [])) == ()


def test_a_map_that_is_strained_all_over_is_told():
    mesh = blob(2)
    thin = mesh.with_vertices(mesh.vertices * [1, 1, 8])
    (told,) = co.doubts(identity(mesh, thin), pairs_at(5))
    assert "strained all over" in told


def pairs_at(count):
    return VertexPairs(range(count), range(count))


def test_unfit_questions_are_refused():
    with pytest.raises(InputError, match="a positive length; found 0"):
        co.strain(identity(SQUARE), 0)
    with pytest.raises(InputError, match="source column"):
        co.doubtful_pairs(identity(SQUARE), VertexPairs([9], [0]))
