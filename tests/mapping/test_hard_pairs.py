"""Pairs of meshes that are the same, mirrored, featureless or no spheres at all: found, or told in words, or refused with a reason."""

from functools import cache

import numpy as np
import pytest

from morphlet import InputError, Mesh, MeshError, VertexPairs, correspond, correspond_maps, spherical_map
from morphlet.features.matching import Matching
from morphlet.io.pairs import read_pairs
from morphlet.mapping.correspondence import doubts
from morphlet.mapping.embedding import EmbeddingOptions, embed
from morphlet.pipeline.candidates import settled
from morphlet.samples.copies import remeshed
from morphlet.samples.creatures import Creature
from morphlet.sphere.map import SphericalMap, map_surface
from morphlet.surface.repair import RepairOptions, close
from support import assert_one_to_one, blob, data_file, data_mesh, icosphere, torus

FIVE = np.array([0, 100, 200, 300, 400])
QUICK = EmbeddingOptions(rounds=1, iterations=5)
EVERY_NINTH = slice(None, None, 9)


def mirrored(mesh: Mesh) -> Mesh:
    """Left and right exchanged, faces outwards again."""
    return Mesh(mesh.vertices * [-1, 1, 1], mesh.faces[:, ::-1])


@cache
def lump() -> SphericalMap:
    """A lopsided body of 642 vertices."""
    return spherical_map(blob(3))


def in_sizes(distances: np.ndarray, mesh: Mesh) -> np.ndarray:
    return distances / np.sqrt(mesh.area)


@pytest.mark.parametrize("count", [0, 1, 2])
def test_of_two_balls_fewer_than_three_pairs_are_not_enough_and_that_is_said(count: int) -> None:
    ball = icosphere(2)
    other = remeshed(ball)[0]
    marks = np.arange(0, 160, 70)[:count]
    near = [int(np.argmin(np.linalg.norm(other.vertices - ball.vertices[v], axis=1))) for v in marks]
    found = correspond(ball, other, VertexPairs(marks, near))
    assert_one_to_one(found.laid.closed_points, found.laid.surface.mesh.faces)
    assert any("give pairs" in told for told in found.warnings)


def test_a_matching_of_few_tips_says_so() -> None:
    three = Matching(np.repeat(np.arange(3)[:, None], 2, axis=1), VertexPairs([0, 1, 2, 3], [0, 1, 2, 3]), 0.1, 0.5, 0.6, (3, 3))
    told = settled(lump(), lump(), (three,))[2]
    assert any(one.startswith("only 3 pairs of regions or landmarks, of 3 and 3 tips: give more landmarks") for one in told)


def test_the_mirror_image_of_an_animal_is_met_as_it_stands_in_space() -> None:
    """Its left side is the other's right side: vertices of one number lie far apart, the surfaces nearly fall on each other."""
    animal = Creature.prepare("grazer", n_vertices=1500).mesh
    found = correspond(animal, mirrored(animal))
    assert found.figures()["folds_sphere"] == 0
    assert found.warnings == ()
    assert not found.ambiguous
    apart = np.linalg.norm(found.correspondence.positions - animal.vertices, axis=1)
    assert in_sizes(apart, animal).mean() < 0.01  # 0.0044; 0.11 to the vertices of the same numbers


def test_pairs_by_number_with_a_mirror_image_are_told() -> None:
    """Thirty-three pairs that only a reflection meets."""
    every = np.arange(0, 642, 20)
    other = spherical_map(mirrored(blob(3)))
    for marks in (FIVE, every):
        found = correspond_maps(lump(), other, VertexPairs(marks, marks))
        assert_one_to_one(found.laid.closed_points, found.laid.surface.mesh.faces)
        assert any("left and right are exchanged" in told for told in found.warnings)
        assert any("strained all over" in told for told in found.warnings)


def test_the_same_mesh_twice_is_found_without_pairs_and_without_strain() -> None:
    found = correspond_maps(lump(), lump())
    assert found.figures()["energy"] == pytest.approx(1, abs=1e-3)
    assert np.abs(found.correspondence.positions - blob(3).vertices).max() < 1e-2
    assert doubts(found.correspondence, VertexPairs(FIVE, FIVE)) == ()


def test_contradictory_markers_leave_the_others_met() -> None:
    """Two sources for one target: the rest is met all the same, and the two share what is left."""
    found = embed(close(blob(3)), lump(), VertexPairs([*FIVE, 50, 350], [*FIVE, 50, 50]), QUICK)
    assert_one_to_one(found.closed_points, found.source.mesh.faces)
    assert set(found.unmet) >= {5} or set(found.unmet) >= {6}
    assert not set(found.unmet) & set(range(5))


def test_markers_on_different_parts_are_refused_with_their_numbers() -> None:
    """The largest part is mapped; 642 and 650 lie on the small one."""
    speck = icosphere(1).with_vertices(0.1 * icosphere(1).vertices + 9)
    two = Mesh(np.vstack([blob(3).vertices, speck.vertices]), np.vstack([blob(3).faces, 642 + speck.faces]))
    largest = map_surface(close(two, RepairOptions(fill="all", component="largest")))
    with pytest.raises(InputError, match=r"2 source vertices in no face, or on a dropped part \(first: 642, 650\)"):
        correspond_maps(largest, lump(), VertexPairs([*FIVE, 642, 650], [*FIVE, 3, 4]))
    with pytest.raises(InputError, match=r"1 target vertices in no face, or on a dropped part \(first: 650\)"):
        correspond_maps(lump(), largest, VertexPairs([*FIVE, 3], [*FIVE, 650]))


def test_a_body_with_a_handle_is_refused_on_either_side() -> None:
    for source, target in ((blob(3), torus()), (torus(), blob(3))):
        with pytest.raises(MeshError, match=r"genus 0 for a spherical map; found a genus 1 surface .*cut them"):
            correspond(source, target, VertexPairs(FIVE[:2], FIVE[:2]))


def test_horse_to_camel_is_refused_for_its_three_handles_and_works_once_they_are_cut() -> None:
    horse, camel = data_mesh("meshes/horse.obj"), data_mesh("meshes/camel.obj")
    markers = read_pairs(data_file("markers/horse-camel.csv"))
    with pytest.raises(MeshError, match=r"found a genus 3 surface .*cut_handles=3"):
        correspond(horse, camel, markers)
    cut = map_surface(close(camel, RepairOptions(fill="all", component="largest", cut_handles=3)))
    given = np.arange(len(markers))[EVERY_NINTH]
    found = embed(close(horse), cut, VertexPairs(markers.source[given], markers.target[given]), QUICK)
    assert_one_to_one(found.closed_points, found.source.mesh.faces)
    assert len(found.unmet) == 0
    gaps = found.correspondence().positions[markers.source] - camel.vertices[markers.target]
    left_out = np.setdiff1d(np.arange(len(markers)), given)
    assert in_sizes(np.linalg.norm(gaps[left_out], axis=1), camel).mean() < 0.08  # 0.068
