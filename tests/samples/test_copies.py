"""Copies with other connectivity: closed, true to the original, and truly different."""

import numpy as np
import pytest

from morphlet import InputError, Mesh, MeshError
from morphlet.samples.copies import remeshed
from morphlet.samples.creatures import blob, spiky
from morphlet.surface.nearest import nearest


@pytest.fixture(scope="module")
def lump():
    return blob(n_vertices=2000)


def torus(n=24, m=12):
    """A torus as a closed grid of quadrangles, each halved."""
    i, j = np.meshgrid(np.arange(n), np.arange(m), indexing="ij")
    a, b = 2 * np.pi * i / n, 2 * np.pi * j / m
    points = np.stack([(1 + 0.4 * np.cos(b)) * np.cos(a), (1 + 0.4 * np.cos(b)) * np.sin(a), 0.4 * np.sin(b)], axis=2)
    here, right, up, across = (((i + s) % n * m + (j + t) % m).ravel() for s, t in ((0, 0), (1, 0), (0, 1), (1, 1)))
    return Mesh(points.reshape(-1, 3), np.concatenate([np.stack([here, right, across], 1), np.stack([here, across, up], 1)]))


@pytest.mark.parametrize("seed", [0, 7])
def test_copy_is_closed_and_exactly_on_the_original(lump, seed):
    copy, truth = remeshed(lump, seed)
    assert np.all(copy.topology.twins >= 0)
    assert copy.topology.euler_characteristic == 2
    assert copy.topology.n_components == 1
    assert copy.n_vertices == 1700
    assert len(truth) == copy.n_vertices
    assert truth.faces.max() < lump.n_faces
    assert truth.weights.min() >= 0
    np.testing.assert_allclose(truth.weights.sum(axis=1), 1, atol=1e-12)
    np.testing.assert_allclose(truth.positions(lump), copy.vertices, atol=1e-12)


def test_copy_is_the_same_shape(lump):
    copy, truth = remeshed(lump)
    assert copy.volume == pytest.approx(lump.volume, rel=0.01)
    assert np.min(np.sum(copy.vertex_normals * lump.face_normals[truth.faces], axis=1)) > 0.8
    assert np.all(np.sum(copy.vertex_normals[copy.faces].sum(axis=1) * copy.face_normals, axis=1) > 0)


def test_copy_is_really_another_mesh(lump):
    copy, _ = remeshed(lump)
    original = {tuple(v) for v in lump.vertices}
    assert not any(tuple(v) in original for v in copy.vertices)
    steps = np.linalg.norm(copy.vertices - lump.vertices[: copy.n_vertices], axis=1)
    assert np.median(steps) > 0.3 * lump.bbox_diagonal / 2  # equal numbers are far apart
    valence, other = (np.bincount(m.faces.ravel()) for m in (lump, copy))
    assert not np.array_equal(np.sort(valence)[: len(other)], np.sort(other))


def test_held_vertices_stay_and_their_places_say_so(lump):
    held = np.array([0, 17, 900, 1999])
    copy, truth = remeshed(lump, held=held)
    still = np.flatnonzero(truth.weights.max(axis=1) == 1)
    corner = np.argmax(truth.weights[still], axis=1)
    assert sorted(lump.faces[truth.faces[still], corner].tolist()) == held.tolist()
    assert sorted(map(tuple, copy.vertices[still])) == sorted(map(tuple, lump.vertices[held]))
    assert copy.n_vertices == 1700
    with pytest.raises(InputError, match="indices from 0 to 1999 in held"):
        remeshed(lump, held=[2000])


def test_copy_keeps_to_the_surface():
    """Thin limbs and tips: collapses in order of edge length alone would leave 0.0019 sqrt(area) in the mean, these leave 0.0007."""
    thorny = spiky(7, n_vertices=2000)
    copy, _ = remeshed(thorny)
    gap = thorny.vertices - nearest(copy, thorny.vertices).positions(copy)
    assert np.linalg.norm(gap, axis=1).mean() < 9e-4 * np.sqrt(thorny.area)
    assert copy.area == pytest.approx(thorny.area, rel=0.01)


def test_seeds_repeat_and_differ(lump):
    assert remeshed(lump, 3)[0].fingerprint == remeshed(lump, 3)[0].fingerprint
    assert remeshed(lump, 3)[0].fingerprint != remeshed(lump, 4)[0].fingerprint


def test_genus_and_parts_are_kept():
    ring = torus()
    ball = spiky(3, n_vertices=1500)
    aside = ball.vertices + np.array([5, 0, 0])
    both = Mesh(np.concatenate([ring.vertices, aside]), np.concatenate([ring.faces, ball.faces + ring.n_vertices]))
    for mesh, parts, euler in ((ring, 1, 0), (both, 2, 2)):
        copy, truth = remeshed(mesh)
        assert np.all(copy.topology.twins >= 0)
        assert (copy.topology.n_components, copy.topology.euler_characteristic) == (parts, euler)
        np.testing.assert_allclose(truth.positions(mesh), copy.vertices, atol=1e-12)


def test_tetrahedron_survives():
    solid = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    copy, _ = remeshed(solid)
    assert copy.topology.euler_characteristic == 2
    assert copy.n_vertices >= 4


def test_open_and_doubled_meshes_are_refused():
    with pytest.raises(MeshError, match="needed a closed mesh; found 3 boundary edges"):
        remeshed(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))
    with pytest.raises(MeshError, match="directed edges used twice"):
        remeshed(Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 1, 2], [0, 1, 3]]))
