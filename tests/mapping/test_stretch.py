"""Even stretch: nothing where nothing is stretched, all where everything is, and smoother in between."""

import numpy as np
import pytest
from scipy.spatial import Delaunay

from morphlet import Mesh
from morphlet.mapping.stretch import MOST, PROPORTIONS, Evening
from morphlet.sphere.energy import reference, slack_areas
from morphlet.sphere.level import Level
from support import blob, icosphere, random_rotation


def level_of(mesh: Mesh) -> Level:
    """A mesh of area 4 pi, as energies measure it, as a level that lies on itself."""
    V = mesh.vertices * np.sqrt(4 * np.pi / slack_areas(mesh.vertices, np.array(mesh.faces)).sum())
    return Level(V, np.array(mesh.faces), V, reference(V, np.array(mesh.faces), 1e-6))


@pytest.fixture(scope="module")
def lump() -> Level:
    return level_of(blob(3))


def squares(found: Evening, images: np.ndarray) -> np.ndarray:
    """Squared edges opposite the corners, in the metric that was found."""
    r = found.reference(images)
    return (r.k.sum(axis=1, keepdims=True) - r.k) / r.inverse[:, None] ** 2


def true_squares(V: np.ndarray, F: np.ndarray) -> np.ndarray:
    """The same of a mesh."""
    return np.stack([np.sum((V[F[:, (c + 2) % 3]] - V[F[:, (c + 1) % 3]]) ** 2, axis=1) for c in range(3)], axis=1)


@pytest.fixture(scope="module")
def plate() -> Level:
    """A flat square with a random triangulation; evening does not ask for a closed surface."""
    places = np.random.default_rng(1).random((300, 2))
    return level_of(Mesh(np.column_stack([places, np.zeros(300)]), Delaunay(places).simplices))


def test_what_is_only_moved_keeps_its_metric(lump: Level) -> None:
    moved = lump.V @ random_rotation(3).T + 5
    kept = Evening.prepare(lump).reference(moved)
    np.testing.assert_allclose(kept.k, lump.reference.k, rtol=1e-7, atol=1e-7 * np.abs(lump.reference.k).max())
    np.testing.assert_allclose(kept.inverse, lump.reference.inverse, rtol=1e-7)
    assert kept.weight is lump.reference.weight


def share(stretch: float) -> float:
    """The share of averaged stretch that is excused."""
    return stretch**4 / (stretch**4 + PROPORTIONS**4)


def test_a_plate_stretched_as_a_whole_is_that(plate: Level) -> None:
    """Its axes, 1.5 and 0.8 times as long after a turn, keep their share of the logarithm."""
    stretched = np.log([1.5, 0.8])
    taken = np.exp(share(np.linalg.norm(2 * stretched)) * stretched)
    bent, meant = plate.V * [1.5, 0.8, 1] @ random_rotation(5), plate.V * [*taken, 1]
    np.testing.assert_allclose(squares(Evening.prepare(plate), bent), true_squares(meant, plate.F), rtol=1e-7)


def test_little_stretch_is_not_excused_and_much_is(plate: Level) -> None:
    own = true_squares(plate.V, plate.F)
    little, much = (np.log(squares(Evening.prepare(plate), factor * plate.V) / own) / (2 * np.log(factor)) for factor in (1.02, 2.0))
    assert np.abs(little).max() < 0.01
    np.testing.assert_allclose(much, 1, atol=1e-3)


def test_degenerate_images_count_to_a_limit(plate: Level) -> None:
    own, most = true_squares(plate.V, plate.F), share(np.sqrt(2) * MOST) * MOST
    np.testing.assert_allclose(squares(Evening.prepare(plate), 100 * plate.V), np.exp(most) * own, rtol=1e-7)
    np.testing.assert_allclose(squares(Evening.prepare(plate), 0 * plate.V), np.exp(-most) * own, rtol=1e-7)


def test_girth_holds_more_firmly_than_length_but_follows(lump: Level) -> None:
    """Part of a uniform enlargement is lost where the surface turns, never its sign."""
    gain = np.log(squares(Evening.prepare(lump), 1.5 * lump.V) / true_squares(lump.V, lump.F)) / np.log(2.25)
    assert gain.min() > 0.5
    assert gain.max() < 1 + 1e-6


def test_a_long_tube_stretched_along_itself_is_a_stretched_tube() -> None:
    """Stretch by 1.4 along the axis: what evening finds is that stretch, away from the caps."""
    ball = icosphere(4).vertices
    tube = Mesh(np.column_stack([0.5 * ball[:, :2], ball[:, 2] + 3 * np.clip(ball[:, 2], -0.5, 0.5)]), icosphere(4).faces)
    level = level_of(tube)
    longer = level.V * [1, 1, 1.4]
    ratio = squares(Evening.prepare(level), longer) / true_squares(longer, level.F)
    middle = np.all(np.abs(ball[level.F][:, :, 2]) < 0.3, axis=1)
    assert np.abs(np.sqrt(ratio[middle]) - 1).max() < 0.02


def test_uneven_stretch_becomes_even(lump: Level) -> None:
    """Noise in the images leaves the metric nearly as it was: far less than it changes the triangles themselves."""
    noisy = lump.V + 0.02 * np.random.default_rng(0).normal(size=lump.V.shape)
    own, evened = true_squares(lump.V, lump.F), squares(Evening.prepare(lump), noisy)
    assert np.std(np.log(evened / own)) < 0.25 * np.std(np.log(true_squares(noisy, lump.F) / own))


def test_a_metric_that_follows_twice_starts_from_the_same(lump: Level) -> None:
    evening, images = Evening.prepare(lump), 1.2 * lump.V
    first = evening.reference(images)
    lump.reference, kept = first, lump.reference
    again = evening.reference(images)
    lump.reference = kept
    np.testing.assert_array_equal(again.k, first.k)
