"""What must not change a dense map: where the meshes are, how large, in what order; and what it must be where the truth is known.

Bars are in percent of sqrt(area), geodesic, as in the benchmark of correspondences.
"""

from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from morphlet import CorrespondResult, Mesh, SurfacePoints, VertexPairs, correspond, correspond_maps, spherical_map
from morphlet.samples.creatures import Creature
from morphlet.samples.deviation import Deviation
from morphlet.samples.truth import KnownPair, known_pair
from support import assert_one_to_one, blob, data_mesh, random_rotation, relabelled

MARKS = np.array([0, 100, 200, 300, 400])
PAIRS = VertexPairs(MARKS, MARKS)
ITSELF, COPY = 0.3, 0.7
"""Mean errors of a mesh on itself, and of a remeshed copy on the original, without any help."""
JUDGED = 150
"""Vertices at which they are measured."""


def bent() -> Mesh:
    """The blob, bent and stretched: the same faces."""
    x, y, z = blob(3).vertices.T
    return blob(3).with_vertices(np.stack([x + 0.3 * y**2, 1.2 * y + 0.2 * np.sin(2 * z), z], axis=1))


@cache
def original() -> CorrespondResult:
    return correspond(blob(3), bent(), PAIRS)


@pytest.mark.parametrize(("seed", "scale"), [(1, 37.0), (2, 0.004)])
def test_rigid_motion_and_scale_of_both_meshes_move_the_answer_along(seed: int, scale: float) -> None:
    turn, other = random_rotation(seed), random_rotation(seed + 1)
    source = blob(3).with_vertices(scale * (blob(3).vertices @ turn.T + seed))
    target = bent().with_vertices(bent().vertices @ other.T / scale - 7)
    found = correspond(source, target, PAIRS)
    back = scale * (found.correspondence.positions + 7) @ other
    # Nothing on the way is a tie, so rounding decides nothing: it is only amplified by the condition of the solves (seen: 1e-11)
    assert np.linalg.norm(back - original().correspondence.positions, axis=1).max() < 1e-7 * np.sqrt(bent().area)
    assert found.figures()["energy"] == pytest.approx(original().figures()["energy"], rel=1e-8)


@pytest.mark.parametrize("seed", [0, 31])
def test_the_order_of_vertices_hardly_changes_the_answer(seed: int) -> None:
    (source, own), (target, other) = relabelled(blob(3), seed), relabelled(bent(), seed + 1)
    found = correspond(source, target, VertexPairs(own[MARKS], other[MARKS]))
    assert_one_to_one(found.laid.closed_points, source.faces)
    gaps = np.linalg.norm(found.correspondence.positions[own] - original().correspondence.positions, axis=1)
    edge = np.sqrt(bent().area / bent().n_faces)
    assert gaps.mean() < 0.1 * edge  # sweeps visit vertices in another order and stop early: the same valley, not the same bits
    assert np.quantile(gaps, 0.99) < 0.5 * edge  # a vertex or two beside a pair may end up elsewhere
    assert found.figures()["energy"] == pytest.approx(original().figures()["energy"], rel=5e-3)


def test_there_and_back_is_where_it_began() -> None:
    """But for the flat triangles of both meshes: the places agree on the sphere, not in space."""
    matched = original()
    edge = np.sqrt(bent().area / bent().n_faces)
    forth = matched.inverse.pull(matched.correspondence.positions)
    assert np.linalg.norm(forth - bent().vertices, axis=1).mean() < 0.2 * edge
    back = matched.correspondence.pull(matched.inverse.positions)
    assert np.linalg.norm(back - blob(3).vertices, axis=1).mean() < 0.2 * np.sqrt(blob(3).area / blob(3).n_faces)


def test_the_inverse_of_the_inverse_is_the_map() -> None:
    """On the sphere, where both live, exactly: a place found for a vertex lies in that vertex' direction."""
    matched = original()
    for found, into, seen in (
        (matched.correspondence, matched.target_map, matched.laid.points),
        (matched.inverse, matched.laid, matched.target_map.points),
    ):
        directions = found.points.positions(found.target.with_vertices(into.closed_points))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        np.testing.assert_allclose(directions, seen, atol=1e-9)


@settings(max_examples=5)
@given(st.integers(0, 1000))
def test_constants_are_pulled_to_constants_and_positions_to_places(seed: int) -> None:
    found = original().correspondence
    np.testing.assert_allclose(found.pull(np.full(bent().n_vertices, 2.5)), 2.5, atol=1e-12)
    plane = np.random.default_rng(seed).normal(size=3)
    np.testing.assert_allclose(found.pull(bent().vertices @ plane), found.positions @ plane, atol=1e-12)


@cache
def animal() -> Mesh:
    return Creature.prepare("grazer", n_vertices=1500).mesh


def error(pair: KnownPair, found: CorrespondResult, left_out: VertexPairs) -> float:
    """Mean geodesic distance to the truth, in percent of sqrt(area)."""
    rows = pair.drawn(JUDGED, left_out)
    ruler = Deviation.prepare(pair.target, SurfacePoints(pair.truth.faces[rows], pair.truth.weights[rows]))
    points, own = found.correspondence.points, pair.vertices[rows]
    return 100 * float(ruler.of(SurfacePoints(points.faces[own], points.weights[own])).mean() / np.sqrt(pair.target.area))


def certified(found: CorrespondResult) -> CorrespondResult:
    assert_one_to_one(found.laid.closed_points, found.laid.surface.mesh.faces)
    return found


def test_an_animal_finds_itself() -> None:
    """Linear functions are kept where vertices fall on themselves."""
    standing = spherical_map(animal())
    found = certified(correspond_maps(standing, standing))
    apart = np.linalg.norm(found.correspondence.positions - animal().vertices, axis=1)
    assert 100 * np.average(apart, weights=animal().vertex_areas) / np.sqrt(animal().area) < ITSELF
    up = animal().vertices[:, 1]
    assert np.abs(found.correspondence.pull(up) - up).mean() < ITSELF / 100 * np.sqrt(animal().area)


@pytest.mark.parametrize("seed", [0, 1])
def test_an_animal_finds_its_remeshed_copy(seed: int) -> None:
    pair = known_pair(animal(), animal(), seed)
    assert error(pair, certified(correspond(pair.source, pair.target)), pair.first_landmarks(0)) < COPY


def test_a_wolf_finds_its_remeshed_copy() -> None:
    wolf = data_mesh("tosca/wolf0.off")
    pair = known_pair(wolf, wolf)
    assert error(pair, certified(correspond(pair.source, pair.target)), pair.first_landmarks(0)) < COPY


def test_a_wolf_finds_itself() -> None:
    wolf = spherical_map(data_mesh("tosca/wolf0.off"))
    found = certified(correspond_maps(wolf, wolf))
    apart = np.linalg.norm(found.correspondence.positions - wolf.mesh.vertices, axis=1)
    assert 100 * np.average(apart, weights=wolf.mesh.vertex_areas) / np.sqrt(wolf.mesh.area) < ITSELF
