"""Input that breaks other methods: the map stays one-to-one, by a test that shares no code with the package."""

import numpy as np
import pytest

from morphlet import Mesh
from morphlet.sphere.embed import SphereOptions, embed
from morphlet.sphere.map import spherical_map
from support import assert_one_to_one, bipyramid, blob, icosphere, stacked, tetrahedron


def spiked() -> Mesh:
    """Every 97th vertex a hundred times as far out."""
    vertices = np.array(icosphere(4).vertices)
    vertices[::97] *= 100
    return icosphere(4).with_vertices(vertices)


def stretched() -> Mesh:
    """A cap drawn out a million times."""
    vertices = np.array(icosphere(4).vertices)
    vertices[vertices[:, 2] > 0.9] *= [1, 1, 1e6]
    return icosphere(4).with_vertices(vertices)


def noise(level: int, seed: int = 1) -> Mesh:
    """An icosphere's connectivity with random positions."""
    ball = icosphere(level)
    return ball.with_vertices(np.random.default_rng(seed).normal(size=ball.vertices.shape))


def some_equal() -> Mesh:
    """Half of the vertices at one place."""
    vertices = np.array(blob(3).vertices)
    vertices[vertices[:, 0] > 0] = [0.3, 0.1, 0.2]
    return blob(3).with_vertices(vertices)


CASES = {
    "tetrahedron": tetrahedron(),
    "icosahedron": icosphere(0),
    "noise": noise(3),
    "all vertices equal": icosphere(3).with_vertices(np.zeros((642, 3))),
    "half of the vertices equal": some_equal(),
    "flat": icosphere(4).with_vertices(icosphere(4).vertices * [1, 1, 0]),
    "on a line": icosphere(3).with_vertices(icosphere(3).vertices * [1, 0, 0]),
    "spikes": spiked(),
    "stretched": stretched(),
    "needle": icosphere(4).with_vertices(icosphere(4).vertices * [1, 1, 1000]),
    "pancake": icosphere(4).with_vertices(icosphere(4).vertices * [1, 1, 1e-9]),
    "stacked": stacked(1500),
    "bipyramid": bipyramid(1000),
    "tiny": icosphere(3).with_vertices(icosphere(3).vertices * 1e-12),
    "huge": icosphere(3).with_vertices(icosphere(3).vertices * 1e100),
    "far away": icosphere(3).with_vertices(icosphere(3).vertices * 1e6 + 1e12),
    "inside out": Mesh(blob(3).vertices, blob(3).faces[:, [0, 2, 1]]),
}


@pytest.mark.parametrize("mesh", [pytest.param(mesh, id=name) for name, mesh in CASES.items()])
def test_the_map_is_one_to_one(mesh: Mesh) -> None:
    sphere = spherical_map(mesh)
    assert_one_to_one(sphere.closed_points, sphere.surface.mesh.faces)
    assert sphere.certificate().holds
    found = sphere.locate(sphere.points)
    on_sphere = np.einsum("kc,kcd->kd", found.weights, sphere.points[mesh.faces[found.faces]])
    on_sphere /= np.linalg.norm(on_sphere, axis=1, keepdims=True)
    assert np.abs(on_sphere - sphere.points).max() < 1e-7  # places within a sliver are known to the slivers' width only


@pytest.mark.parametrize("options", [SphereOptions(p=0.5), SphereOptions(weights="area"), SphereOptions(0.3, "area")])
@pytest.mark.parametrize("mesh", [noise(2), stacked(300), spiked().with_vertices(spiked().vertices * [1, 0, 0])])
def test_no_option_weakens_the_guarantee(mesh: Mesh, options: SphereOptions) -> None:
    assert_one_to_one(spherical_map(mesh, options).closed_points, spherical_map(mesh, options).surface.mesh.faces)


@pytest.mark.parametrize("length", [100, 300, 1000])
def test_needles_are_distorted_no_more_than_needles_must_be(length: int) -> None:
    ball = icosphere(4)
    sphere = spherical_map(ball.with_vertices(ball.vertices * [1, 1, length]))
    found = sphere.quality()
    assert found.iso_mean < 2 * np.sqrt(length)  # its girth must be stretched and its length squeezed: about the root each
    assert found.iso_max < 4 * length


def test_size_and_place_do_not_matter_to_a_power_of_two() -> None:
    mesh = blob(3)
    one = spherical_map(mesh)
    for scale in (2.0**-40, 2.0**40):
        np.testing.assert_array_equal(spherical_map(mesh.with_vertices(mesh.vertices * scale)).points, one.points)


@pytest.mark.parametrize("seed", range(4))
def test_random_triangulations_with_random_positions(seed: int) -> None:
    mesh = stacked(60 + 40 * seed, seed)
    found = embed(mesh, np.zeros(mesh.n_faces, bool), SphereOptions())
    assert_one_to_one(found.points, mesh.faces)


@pytest.mark.parametrize("sides", [3, 4, 5, 6, 9, 17])
def test_the_smallest_bipyramids(sides: int) -> None:
    mesh = bipyramid(sides)
    assert_one_to_one(spherical_map(mesh).points, mesh.faces)
