"""Repair on public meshes with real faults; they are found through MORPHLET_DATA."""

import os
from pathlib import Path

import igl
import numpy as np
import pytest

from morphlet import Mesh, MeshError
from morphlet.surface.description import describe
from morphlet.surface.repair import RepairOptions, close, repair

DATA = os.environ.get("MORPHLET_DATA")
pytestmark = pytest.mark.skipif(DATA is None, reason="set MORPHLET_DATA to the folder of public test meshes")


def read(name: str) -> Mesh:
    vertices, faces = igl.read_triangle_mesh(str(Path(DATA or ".") / name))[:2]
    return Mesh(vertices, faces)


@pytest.mark.parametrize("name", ["tosca/horse5.off", "tosca/horse6.off"])
def test_reversed_faces_are_turned_and_nothing_is_torn(name: str) -> None:
    closed = close(read(name))
    assert [(r.what, r.count) for r in closed.repairs] == [("reversed faces that disagreed with their neighbours", 108)]
    np.testing.assert_array_equal(np.sort(closed.mesh.faces), np.sort(read("tosca/horse0.off").faces))


def test_camel_is_a_sphere_once_its_three_handles_are_cut() -> None:
    camel = read("meshes/camel.obj")
    with pytest.raises(MeshError, match=r"genus 3 surface.*cut_handles=3"):
        close(camel, RepairOptions(fill="all", component="largest"))
    closed = close(camel, RepairOptions(fill="all", component="largest", cut_handles=3))
    assert (closed.face_map >= 0).sum() > 0.999 * camel.n_faces
    assert describe(camel).nonmanifold_edges == 26


def test_bunny_has_stray_vertices_and_five_holes() -> None:
    bunny = read("meshes/stanford-bunny.obj")
    facts = describe(bunny)
    assert (facts.unreferenced_vertices, facts.boundary_loops, facts.genus, facts.fit_for_sphere) == (1113, 5, 0, True)
    assert repair(bunny).valid.sum() == 35947 - 1113


@pytest.mark.parametrize(("name", "loops"), [("meshes/horse.obj", [16, 3]), ("meshes/face.obj", [96]), ("meshes/camelhead.off", [56])])
def test_open_meshes_are_closed(name: str, loops: list[int]) -> None:
    mesh = read(name)
    assert [len(loop) for loop in mesh.topology.boundary_loops] == loops
    assert close(mesh).n_real_vertices == mesh.n_vertices


@pytest.mark.parametrize("name", ["meshes/cat.obj", "meshes/lion.obj", "bad/spot.obj", "tosca/wolf1.off"])
def test_clean_meshes_pass_untouched(name: str) -> None:
    mesh = read(name)
    assert close(mesh).mesh is mesh


def test_fertility_is_refused_with_its_genus() -> None:
    with pytest.raises(MeshError, match="genus 4"):
        close(read("meshes/fertility.off"))


@pytest.mark.parametrize("name", ["suzanne", "truck", "cube_40k", "beetle-alt"])
def test_bad_meshes_become_oriented_manifolds(name: str) -> None:
    mesh = read(f"bad/{name}.obj")
    mended = repair(mesh, RepairOptions(fill="all", component="largest", cut_handles=2))
    assert mended.mesh.topology.halfedge_counts[:, 0].max() == 1
    np.testing.assert_array_equal(mended.mesh.vertices[mended.vertex_map[mended.valid]], mesh.vertices[mended.valid])
    assert describe(mesh).advice
