"""Markers anywhere on the faces: met where they are, never folded, refused where they are on nothing."""

import pickle

import numpy as np
import pytest

from mapping.stars import blob, radial_map
from morphlet import InputError, SolveError, SurfacePoints, VertexPairs
from morphlet.pipeline import placed as module
from morphlet.pipeline.correspond import correspond_maps
from morphlet.pipeline.placed import PlacedResult, correspond_places, correspond_places_maps
from morphlet.samples.truth import at_vertices
from morphlet.sphere.quality import Certificate
from morphlet.surface.pairs import PointPairs
from support import assert_one_to_one, relabelled

COUNT = 12


def middles(seed: int = 0) -> SurfacePoints:
    """Places well inside faces that are far apart."""
    faces = np.random.default_rng(seed).choice(blob(2).n_faces, COUNT, replace=False)
    return SurfacePoints(faces, np.tile([0.4, 0.35, 0.25], (COUNT, 1)))


@pytest.fixture(scope="module")
def found() -> PlacedResult:
    """A blob on a copy of itself in another order; markers inside faces on both sides."""
    mesh = blob(2)
    copy, place = relabelled(mesh)
    rows = {tuple(sorted(face)): k for k, face in enumerate(copy.faces.tolist())}
    own = middles()
    corners = place[mesh.faces[own.faces]]
    faces = np.array([rows[tuple(sorted(c))] for c in corners.tolist()])
    same = copy.faces[faces][:, :, None] == corners[:, None, :]
    pairs = PointPairs(own, SurfacePoints(faces, np.einsum("kab,kb->ka", same.astype(float), own.weights)))
    return correspond_places_maps(radial_map(mesh), radial_map(copy), pairs)


def test_markers_inside_faces_lead_a_mesh_to_itself(found: PlacedResult) -> None:
    gap = np.linalg.norm(found.correspondence.positions - found.correspondence.source.vertices, axis=1)
    assert gap.mean() < 0.005 * np.sqrt(found.correspondence.target.area)
    edge = np.sqrt(found.correspondence.target.area / found.correspondence.target.n_faces)
    assert found.residuals.max() < 0.05 * edge
    assert found.figures()["pairs"] == COUNT
    assert found.figures()["pairs_rmse"] == pytest.approx(np.sqrt(np.mean(found.residuals**2)))


def test_the_map_without_the_markers_is_one_to_one(found: PlacedResult) -> None:
    laid = found.result.laid
    assert laid.mesh is found.correspondence.source
    assert_one_to_one(laid.closed_points, laid.surface.mesh.faces)
    assert found.figures()["folds_sphere"] == 0
    assert len(found.correspondence.points) == blob(2).n_vertices


def test_with_the_markers_among_the_vertices_they_are_met_exactly(found: PlacedResult) -> None:
    assert found.refined.figures()["pairs_rmse"] < 1e-3
    assert_one_to_one(found.refined.laid.closed_points, found.refined.laid.surface.mesh.faces)


def test_markers_at_vertices_are_pairs_of_vertices() -> None:
    mesh = blob(2)
    maps, chosen = (radial_map(mesh), radial_map(mesh)), np.array([3, 40, 90, 140])
    corners = at_vertices(mesh, chosen)
    one = correspond_places_maps(*maps, PointPairs(corners, corners, [1, 2, 1, 1], ("a", "b", "c", "d")))
    other = correspond_maps(*maps, VertexPairs(chosen, chosen, [1, 2, 1, 1]))
    np.testing.assert_allclose(one.correspondence.positions, other.correspondence.positions, atol=1e-9)
    assert one.refined.pairs.labels == ("a", "b", "c", "d")


def test_markers_beat_the_nearest_vertices() -> None:
    """Half a side off at each end is what snapping costs."""
    mesh = blob(2)
    own = middles(1)
    shifted = SurfacePoints(own.faces, np.tile([0.25, 0.4, 0.35], (COUNT, 1)))
    maps = (radial_map(mesh), radial_map(mesh))
    placed = correspond_places_maps(*maps, PointPairs(own, shifted))
    nearest = VertexPairs(*(mesh.faces[p.faces, p.weights.argmax(axis=1)] for p in (own, shifted)))
    snapped = correspond_maps(*maps, nearest).correspondence
    images = own.positions(mesh.with_vertices(snapped.positions))
    gaps = np.linalg.norm(images - shifted.positions(mesh), axis=1)
    assert placed.residuals.mean() < 0.2 * gaps.mean()


def test_contradictory_markers_are_told_not_folded() -> None:
    mesh, own = blob(2), middles()
    spot = SurfacePoints(np.array(own.faces)[[0, 0, 2, 3, 4, 5]], own.weights[:6])
    result = correspond_places(mesh, mesh, PointPairs(SurfacePoints(own.faces[:6], own.weights[:6]), spot))
    assert result.figures()["folds_sphere"] == 0
    assert np.isfinite(result.correspondence.positions).all()
    assert any("could not be brought together" in told for told in result.result.warnings)


def test_markers_on_no_face_are_refused() -> None:
    mesh, own = blob(1), SurfacePoints([0, 1, 2], np.eye(3))
    with pytest.raises(InputError, match="the target's faces in the pairs"):
        correspond_places(mesh, mesh, PointPairs(own, SurfacePoints([0, 1, 80], np.eye(3))))
    with pytest.raises(InputError, match="the source's faces in the pairs"):
        correspond_places(mesh, mesh, PointPairs(SurfacePoints([0, 1, 80], np.eye(3)), own))


@pytest.mark.parametrize(
    ("count", "weight", "labels", "message"),
    [
        (2, None, (), "3 places on the target"),
        (3, [1, 0, 1], (), "positive weights"),
        (3, [1, 1], (), "weight of shape"),
        (3, None, ("a",), "3 labels"),
    ],
)
def test_pairs_of_places_fit_together(count: int, weight: list[float] | None, labels: tuple[str, ...], message: str) -> None:
    with pytest.raises(InputError, match=message):
        PointPairs(SurfacePoints([0, 1, 2], np.eye(3)), SurfacePoints(range(count), np.eye(3)[:count]), weight, labels)


def test_pairs_of_places_survive_pickling() -> None:
    pairs = PointPairs(middles(), middles(1), labels=("",) * COUNT)
    copy = pickle.loads(pickle.dumps(pairs))
    np.testing.assert_array_equal(copy.target.weights, pairs.target.weights)
    assert len(copy) == COUNT


def test_what_folds_without_its_markers_is_not_returned() -> None:
    mesh, corners = blob(1), SurfacePoints([0, 30, 60], np.tile([0.4, 0.3, 0.3], (3, 1)))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module.SphericalMap, "certificate", lambda _: Certificate(1, 0, 0, 1.0))
        with pytest.raises(SolveError, match="1 without the markers"):
            correspond_places_maps(radial_map(mesh), radial_map(mesh), PointPairs(corners, corners))
