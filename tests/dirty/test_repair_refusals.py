"""What cannot become a sphere is refused with the reason, the count and a way out; what can, is not."""

import dataclasses
import itertools

import numpy as np
import pytest
import trimesh

from morphlet import Mesh, MeshError
from morphlet.surface.description import describe
from morphlet.surface.repair import RepairOptions, close, repair
from morphlet.surface.requirements import require_sphere

SPHERE = Mesh.from_trimesh(trimesh.creation.icosphere(subdivisions=2))
TORUS = Mesh.from_trimesh(trimesh.creation.torus(1.0, 0.3, 16, 8))
TETRAHEDRON = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])


def beside(a: Mesh, b: Mesh) -> Mesh:
    """Two meshes as one, apart."""
    return Mesh(np.concatenate([a.vertices, b.vertices + 5]), np.concatenate([a.faces, b.faces + a.n_vertices]))


def glued(*pairs: tuple[int, int]) -> Mesh:
    """Two tetrahedra that share the given vertices (first of the one, second of the other)."""
    number = np.arange(4) + 4
    for kept, gone in pairs:
        number[gone] = kept
    return Mesh(np.random.default_rng(0).normal(size=(8, 3)), np.concatenate([TETRAHEDRON.faces, number[TETRAHEDRON.faces]]))


def grid(n: int, twist: bool) -> Mesh:
    """An n by n grid of quads closed in both directions: a torus, or with the twist a Klein bottle."""
    i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
    number = (i % n) * n + np.where((i == n) & twist, -j, j) % n
    a, b, c, d = number[:-1, :-1].ravel(), number[1:, :-1].ravel(), number[1:, 1:].ravel(), number[:-1, 1:].ravel()
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return Mesh(np.random.default_rng(0).normal(size=(n * n, 3)), faces)


def moebius() -> Mesh:
    ring = [(0, 1), (2, 3), (4, 5), (6, 7), (1, 0)]
    faces = [f for (a, b), (c, d) in itertools.pairwise(ring) for f in ((a, b, d), (a, d, c))]
    return Mesh(np.random.default_rng(0).normal(size=(8, 3)), faces)


REFUSED_AS_IS = [
    (Mesh([[0, 0, 0], [1, 0, 0]], np.zeros((0, 3))), "at least 4 vertices; found no faces"),
    (Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "at least 4 vertices; found 3 vertices and 1 face"),
    (Mesh(SPHERE.vertices, SPHERE.faces[1:]), r"found 1 boundary loop of 3 edges.*fill='all'"),
    (Mesh(SPHERE.vertices, [*SPHERE.faces[:-1], SPHERE.faces[-1, ::-1]]), r"found 3 directed edges used twice.*repair\(mesh\)"),
    (Mesh(SPHERE.vertices, [*SPHERE.faces, [0, 0, 1]]), "found 1 face with a repeated vertex"),
    (Mesh(SPHERE.vertices, [*SPHERE.faces, SPHERE.faces[0, ::-1]]), "found 1 face with the same vertices"),
    (Mesh([*SPHERE.vertices, [0, 0, 9]], SPHERE.faces), r"found 1 vertex in none \(first: 162\)"),
    (beside(SPHERE, TORUS), r"found 2 connected components.*component='largest'"),
    (TORUS, r"genus 1 surface \(chi = 0, 0 boundary loops\).*cut_handles=1"),
    (repair(glued((0, 0)), RepairOptions(split=False)).mesh, r"found 1 non-manifold vertex \(first: 0\)"),
    (Mesh(np.zeros((7, 3)), [[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 6]]), r"found 1 non-manifold boundary vertex \(first: 0\)"),
]


@pytest.mark.parametrize(("mesh", "message"), REFUSED_AS_IS)
def test_require_sphere_says_what_is_missing(mesh: Mesh, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        require_sphere(mesh)


def test_require_sphere_accepts_spheres_wherever_their_vertices_are() -> None:
    for mesh in (TETRAHEDRON, SPHERE, SPHERE.with_vertices(np.zeros_like(SPHERE.vertices))):
        require_sphere(mesh)


CANNOT_BE_CLOSED = [
    (Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), "at least 4 vertices"),
    (Mesh([[0, 0, 0], [1, 0, 0]], np.zeros((0, 3))), "no faces"),
    (Mesh(SPHERE.vertices, SPHERE.faces[:, [0, 1, 1]]), "no faces"),
    (moebius(), "an orientable surface; found a one-sided part of 8 faces"),
    (grid(4, twist=True), "an orientable surface; found a one-sided part of 32 faces"),
    (grid(4, twist=False), "genus 1 surface"),
    (beside(SPHERE, TORUS), "2 connected components"),
    (beside(SPHERE, Mesh(np.eye(3), [[0, 1, 2]])), "2 connected components"),
    (glued((0, 0)), "2 connected components"),
    (glued((0, 0), (1, 1)), "2 connected components"),
]


@pytest.mark.parametrize(("mesh", "message"), CANNOT_BE_CLOSED)
def test_close_says_why_it_cannot(mesh: Mesh, message: str) -> None:
    with pytest.raises(MeshError, match=message):
        close(mesh)
    assert not describe(mesh).fit_for_sphere


def test_a_one_sided_speck_does_not_spoil_the_largest_part() -> None:
    closed = close(beside(SPHERE.with_vertices(100 * SPHERE.vertices), moebius()), RepairOptions(fill="all", component="largest"))
    assert closed.mesh.n_faces == SPHERE.n_faces


def test_repair_opens_a_klein_bottle_into_an_oriented_surface() -> None:
    mended = repair(grid(4, twist=True))
    assert mended.mesh.topology.halfedge_counts[:, 0].max() == 1
    assert ("left faces of one-sided parts as they were", 32) in [(r.what, r.count) for r in mended.repairs]


def test_elements_of_a_refusal_are_those_of_the_source() -> None:
    mesh = beside(SPHERE, TORUS)
    padded = Mesh(np.concatenate([np.zeros((7, 3)), mesh.vertices]), mesh.faces + 7)
    with pytest.raises(MeshError, match="2 connected components") as caught:
        close(padded)
    assert caught.value.elements == [padded.faces[0].min(), 7 + SPHERE.n_vertices]


def test_a_needle_is_no_reason_to_refuse() -> None:
    needle = TETRAHEDRON.with_vertices(TETRAHEDRON.vertices * [1, 1e-14, 1e8])
    assert close(needle).mesh is needle


def test_doubled_tetrahedra_close_when_the_largest_is_asked_for() -> None:
    for mesh in (glued((0, 0)), glued((0, 0), (1, 1))):
        assert close(mesh, RepairOptions(fill="all", component="largest")).mesh.n_faces == 4


DESCRIBED = [
    (SPHERE, {"components": 1, "boundary_loops": 0, "genus": 0, "fit_for_sphere": True, "advice": "ready for a spherical map"}),
    (TORUS, {"genus": 1, "fit_for_sphere": False}),
    (beside(TORUS, TORUS), {"genus": 2, "components": 2}),
    (Mesh(np.zeros((7, 3)), [[0, 1, 2], [0, 2, 3], [0, 4, 5], [0, 5, 6]]), {"boundary_loops": 2, "genus": None, "degenerate_faces": 4}),
    (moebius(), {"boundary_loops": 1, "genus": None}),
    (Mesh(SPHERE.vertices, [*SPHERE.faces, [0, 0, 1]]), {"degenerate_faces": 1, "nonmanifold_edges": 0, "genus": None}),
    (glued((0, 0), (1, 1)), {"nonmanifold_edges": 1, "duplicate_directed_edges": 2, "unreferenced_vertices": 2, "genus": None}),
    (Mesh(np.zeros((0, 3)), np.zeros((0, 3))), {"vertices": 0, "faces": 0, "genus": None, "area": 0.0, "bbox_diagonal": 0.0}),
]


@pytest.mark.parametrize(("mesh", "facts"), DESCRIBED)
def test_describe_counts(mesh: Mesh, facts: dict) -> None:
    found = dataclasses.asdict(describe(mesh))
    assert {key: found[key] for key in facts} == facts


def test_describe_never_raises() -> None:
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(1, 12))
        mesh = Mesh(rng.integers(0, 3, (n, 3)), rng.integers(0, n, (rng.integers(0, 30), 3)))
        assert describe(mesh).faces == mesh.n_faces
        for options in (RepairOptions(fill="all", component="largest", cut_handles=3), RepairOptions(fill="small")):
            assert repair(mesh, options).mesh.topology.halfedge_counts.max(initial=0) <= 1
