"""The paper on one page, end to end: known answers on procedural shapes, and on public ones where they are at hand."""

import json
import os
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mapping.stars import blob, radial_map, relabelled
from morphlet import Mesh, VertexPairs
from morphlet.errors import Cancelled, InputError, MeshError
from morphlet.pipeline import correspond, correspond_maps, morph, morph_along
from morphlet.sphere.map import spherical_map

CORRESPOND_KEYS = ["folds_sphere", "folds_surface_percent", "energy", "energy_mean", "pairs", "pairs_rmse", "margin", "ambiguous"]
MORPH_KEYS = ["frames", "volume_change_max", "edge_log_rms_max", "self_intersections_max", "mse", "deformation_rate"]
EVERY = VertexPairs(np.arange(0, 642, 40), np.arange(0, 642, 40))
TURN = Rotation.from_rotvec([0.4, -1.9, 0.8]).as_matrix()


def test_a_mesh_meets_itself_without_pairs():
    mesh = blob()
    result = correspond_maps(radial_map(mesh), radial_map(mesh, TURN))
    error = np.linalg.norm(result.correspondence.positions - mesh.vertices, axis=1) / np.sqrt(mesh.area)
    assert error.max() < 0.002  # a thirtieth of an edge: the search ends within a tenth of a degree
    figures = result.figures()
    assert figures["folds_sphere"] == 0
    assert figures["energy"] == pytest.approx(1, abs=0.01)
    assert (figures["pairs"], figures["pairs_rmse"], figures["ambiguous"]) == (0, None, False)


def test_pairs_find_a_relabelled_copy():
    mesh = blob()
    copy, place = relabelled(mesh)
    result = correspond_maps(radial_map(mesh), radial_map(copy, TURN), VertexPairs(EVERY.source, place[EVERY.source]))
    np.testing.assert_allclose(result.correspondence.positions, mesh.vertices, atol=1e-9)
    figures = result.figures()
    assert figures["pairs"] == len(EVERY)
    assert figures["pairs_rmse"] == pytest.approx(0, abs=1e-9)
    assert figures["margin"] is None


def test_real_maps_of_a_turned_copy_agree():
    mesh = blob(2)
    turned = mesh.with_vertices(3 * mesh.vertices @ TURN.T + 10)
    result = correspond(mesh, turned, VertexPairs([0, 50, 100, 161], [0, 50, 100, 161]))
    edge = np.sqrt(turned.area / turned.n_faces)
    assert np.linalg.norm(result.correspondence.positions - turned.vertices, axis=1).mean() < 0.1 * edge
    assert result.figures()["folds_sphere"] == 0


def test_reversed_faces_and_dropped_parts_do_not_count_as_folds():
    mesh = blob(2)
    reversed_faces = mesh.faces.copy()
    reversed_faces[:40] = reversed_faces[:40, ::-1]
    speck = mesh.n_vertices + np.array([[0, 1, 2]])
    vertices = np.vstack([mesh.vertices, 0.1 * np.eye(3)])
    messy = Mesh(vertices, np.vstack([reversed_faces, speck]))
    clean, dirty = radial_map(mesh), radial_map(messy)
    pairs = VertexPairs(EVERY.source[:5], EVERY.target[:5])
    for source, target in ((dirty, clean), (clean, dirty), (dirty, dirty)):
        result = correspond_maps(source, target, pairs)
        figures = result.figures()
        assert figures["folds_surface_percent"] == 0
        assert figures["energy"] == pytest.approx(1, abs=1e-9)
        assert result.correspondence.valid.sum() == mesh.n_vertices
        assert len(result.correspondence.points) == source.mesh.n_vertices


def test_morph_starts_at_the_source_and_ends_on_the_target():
    source, target = blob(2), blob(3, scale=2)
    result = morph_along(correspond_maps(radial_map(source), radial_map(target), EVERY_SMALL), frames=6)
    assert result.frames[0].vertices.tobytes() == source.vertices.tobytes()
    assert result.frames[5].vertices.tobytes() == result.matched.correspondence.positions.tobytes()
    np.testing.assert_array_equal(result.morph(0.4).vertices, result.frames[2].vertices)


EVERY_SMALL = VertexPairs([0, 30, 60, 90], [0, 30, 60, 90])


def test_figures_have_their_keys_and_go_into_json():
    result = morph_along(correspond_maps(radial_map(blob(1)), radial_map(blob(2)), VertexPairs([0, 5, 9], [0, 5, 9])), frames=3)
    assert list(result.figures()) == CORRESPOND_KEYS + MORPH_KEYS
    assert list(result.matched.figures()) == CORRESPOND_KEYS
    json.dumps(result.figures(), allow_nan=False)


def test_steps_are_reported_and_can_be_cancelled():
    seen = []
    correspond(blob(1), blob(1), VertexPairs([0, 5, 9], [0, 5, 9]), on_step=seen.append)
    assert len(seen) > 2

    def stop(step):
        raise Cancelled

    with pytest.raises(Cancelled, match="request to stop"):
        morph(blob(1), blob(1), on_step=stop)


def test_what_cannot_work_is_refused_before_the_work():
    mesh = blob(1)
    with pytest.raises(InputError, match="at least 2 frames"):
        morph(mesh, mesh, frames=1)
    with pytest.raises(InputError, match="target column"):
        correspond(mesh, mesh, VertexPairs([0, 1], [0, 999]))
    with pytest.raises(InputError, match="non-parallel"):
        correspond(mesh, mesh, VertexPairs([0], [0]))


def test_a_torus_is_refused():
    u, v = np.meshgrid(np.arange(8), np.arange(8), indexing="ij")
    a, b = u.ravel() * np.pi / 4, v.ravel() * np.pi / 4
    vertices = np.stack([(3 + np.cos(b)) * np.cos(a), (3 + np.cos(b)) * np.sin(a), np.sin(b)], axis=1)
    here, right, up, both = (((u + i) % 8 * 8 + (v + j) % 8).ravel() for i, j in ((0, 0), (1, 0), (0, 1), (1, 1)))
    torus = Mesh(vertices, np.concatenate([np.stack([here, right, both], 1), np.stack([here, both, up], 1)]))
    with pytest.raises(MeshError, match="genus"):
        correspond(torus, torus)


def public(name):
    folder = os.environ.get("MORPHLET_DATA")
    if not folder:
        pytest.skip("MORPHLET_DATA names no folder with the public test meshes")
    import igl

    vertices, faces = igl.read_triangle_mesh(str(Path(folder) / name))
    return Mesh(vertices, faces)


def test_two_poses_of_one_animal_are_matched_without_pairs():
    source, target = public("tosca/wolf0.off"), public("tosca/wolf1.off")
    result = correspond_maps(spherical_map(source), spherical_map(target))
    error = np.linalg.norm(result.correspondence.positions - target.vertices, axis=1) / np.sqrt(target.area)
    figures = result.figures()
    assert figures["folds_sphere"] == 0
    assert not figures["ambiguous"]
    assert error.mean() < 0.03  # 0.017 measured
