"""Several meshes on one sphere: every map between them, agreeing all round."""

import numpy as np
import pytest

from mapping.stars import blob
from morphlet import InputError, VertexPairs
from morphlet.pipeline.correspond import correspond
from morphlet.pipeline.several import CommonSphere, correspond_all
from morphlet.samples.creatures import Creature
from morphlet.samples.poses import POSES
from support import assert_one_to_one, relabelled

SIX = ("nose", "tail tip", "left front foot", "right front foot", "left hind foot", "right hind foot")


@pytest.fixture(scope="module")
def poses() -> tuple[CommonSphere, np.ndarray]:
    """Three poses of one animal, the last in another order, and where its vertices went."""
    animal = Creature.prepare("grazer", n_vertices=1500)
    walking, (leaping, place) = animal.posed(POSES["walking"]), relabelled(animal.posed(POSES["leaping"]))
    marks = np.array([animal.landmarks[name] for name in SIX])
    return correspond_all([animal.mesh, walking, leaping], [VertexPairs(marks, marks), VertexPairs(place[marks], marks)]), place


def error(found, truth: np.ndarray) -> float:
    """Mean distance from the true positions, in percent of sqrt(area)."""
    apart = np.linalg.norm(found.positions - truth, axis=1)
    return 100 * float(np.average(apart, weights=found.source.vertex_areas) / np.sqrt(found.target.area))


def test_all_poses_find_each_other_through_the_first(poses: tuple[CommonSphere, np.ndarray]) -> None:
    common, place = poses
    standing, walking, leaping = (one.mesh for one in common.laid)
    assert error(common.between(1, 0), standing.vertices) < 2
    assert error(common.between(0, 2), leaping.vertices[place]) < 2
    assert error(common.between(1, 2), leaping.vertices[place]) < 3  # two maps, one after the other
    back = np.argsort(place)
    assert error(common.between(2, 1), walking.vertices[back]) < 3


def test_each_is_laid_one_to_one_once(poses: tuple[CommonSphere, np.ndarray]) -> None:
    common, _ = poses
    assert len(common) == 3
    assert common.warnings == ()
    for one in common.laid:
        assert_one_to_one(one.closed_points, one.surface.mesh.faces)


def test_maps_agree_all_round(poses: tuple[CommonSphere, np.ndarray]) -> None:
    """Walking to leaping by way of standing is walking to leaping, but for the flat triangles between: 0.27 of an edge."""
    common, _ = poses
    through = common.between(1, 0).pull(common.between(0, 2).positions)
    direct = common.between(1, 2)
    gap = np.linalg.norm(through - direct.positions, axis=1).mean()
    assert gap < 0.4 * np.sqrt(direct.target.area / direct.target.n_faces)


def test_to_itself_a_mesh_is_itself(poses: tuple[CommonSphere, np.ndarray]) -> None:
    common, _ = poses
    for k, one in enumerate(common.laid):
        np.testing.assert_allclose(common.between(k, k).positions, one.mesh.vertices, atol=1e-9)


def test_two_are_what_correspond_gives() -> None:
    source, target = blob(2), blob(2, scale=2)
    pairs = VertexPairs([0, 40, 80, 120], [0, 40, 80, 120])
    common = correspond_all([target, source], [pairs])
    np.testing.assert_array_equal(common.between(1, 0).positions, correspond(source, target, pairs).correspondence.positions)


def test_warnings_name_their_mesh() -> None:
    common = correspond_all([blob(1), blob(1)])
    assert all(told.startswith("mesh 1: ") for told in common.warnings)
    assert any("give pairs" in told for told in common.warnings)


@pytest.mark.parametrize(
    ("count", "pairs", "message"),
    [
        (1, None, "2 meshes or more"),
        (3, [None], "pairs for each mesh but the first"),
        (2, [VertexPairs([99], [0])], "the source column"),
        (2, [VertexPairs([0], [99])], "the target column"),
    ],
)
def test_what_does_not_fit_is_refused_before_the_work(count: int, pairs: list[VertexPairs | None] | None, message: str) -> None:
    with pytest.raises(InputError, match=message):
        correspond_all([blob(1)] * count, pairs)


@pytest.mark.parametrize("number", [-1, 3])
def test_there_is_no_such_mesh(poses: tuple[CommonSphere, np.ndarray], number: int) -> None:
    common, _ = poses
    for ends in ((0, number), (number, 0)):
        with pytest.raises(InputError, match="the number of a mesh, 0 to 2"):
            common.between(*ends)
