"""The order of vertices, coarse to fine: every ring is there before its vertex, on any mesh, from integers alone."""

import numpy as np
import pytest

from morphlet import Mesh
from morphlet.codec.hierarchy import VALENCE_CAP, Records, coarse_to_fine
from morphlet.codec.rest import write_faces
from support import beside, bipyramid, blob, data_mesh, icosphere, stacked, torus

CUT = Mesh(blob(3).vertices, blob(3).faces[blob(3).vertices[blob(3).faces, 2].mean(axis=1) > -0.3])
MESHES = {
    "sphere": blob(4),
    "torus": torus(),
    "two parts": beside(blob(2), torus((5, 0, 0))),
    "boundary": CUT,
    "hubs": bipyramid(60),
    "irregular": stacked(300),
    "bow tie": Mesh(np.random.default_rng(0).random((5, 3)), [[0, 1, 2], [0, 3, 4]]),
    "no faces": Mesh(np.random.default_rng(0).random((4, 3)), np.zeros((0, 3), int)),
}


def records_of(mesh: Mesh, shift: int = 0, bits: int = 10) -> Records:
    """The records of a mesh on a lattice of that many bits, moved by so many spacings."""
    _, shape, order, _ = write_faces(mesh.faces, mesh.n_vertices)
    low, span = mesh.vertices.min(axis=0), np.ptp(mesh.vertices, axis=0).max()
    lattice = np.round((mesh.vertices - low) / span * (2**bits - 1)).astype(np.int64)[order]
    return coarse_to_fine(shape.corner, shape.twin, np.ascontiguousarray(lattice + shift))


@pytest.mark.parametrize("name", MESHES)
def test_rings_are_there_before_their_vertices(name):
    mesh = MESHES[name]
    records = records_of(mesh)
    assert np.array_equal(np.sort(np.r_[records.removed, records.roots]), np.arange(mesh.n_vertices))
    when = np.full(mesh.n_vertices, len(records.removed))
    when[records.removed] = np.arange(len(records.removed))
    sizes = np.diff(records.offsets)
    assert (when[records.rings] > np.repeat(np.arange(len(sizes)), sizes)).all()
    assert sizes.max(initial=2) <= VALENCE_CAP
    assert sizes[records.closed == 1].min(initial=3) >= 3
    for k in range(len(sizes)):
        ring = records.rings[records.offsets[k] : records.offsets[k + 1]]
        assert len(set(ring.tolist())) == len(ring)


def test_a_closed_genus_0_mesh_leaves_few_roots():
    assert len(records_of(blob(4)).roots) <= 12
    assert len(records_of(torus()).roots) <= 16


def test_a_boundary_leaves_open_rings():
    records = records_of(MESHES["boundary"])
    assert 0 < np.sum(records.closed == 0) < len(records.closed)
    assert len(records.roots) - np.sum(~CUT.topology.referenced) < 20


def test_a_vertex_of_two_fans_stays():
    records = records_of(MESHES["bow tie"])
    _, _, order, _ = write_faces(MESHES["bow tie"].faces, 5)
    assert int(np.nonzero(order == 0)[0][0]) in records.roots


def test_moving_by_whole_spacings_changes_nothing():
    assert records_of(blob(3)).checksum == records_of(blob(3), shift=123_456).checksum


def test_other_positions_are_another_order():
    assert records_of(blob(3)).checksum != records_of(icosphere(3)).checksum


def test_ties_go_to_the_smaller_index():
    flat = Mesh(np.zeros((42, 3)), icosphere(1).faces)
    _, shape, _, _ = write_faces(flat.faces, 42)
    records = coarse_to_fine(shape.corner, shape.twin, np.zeros((42, 3), np.int64))
    free = [v for v in range(42) if v not in records.roots]
    assert records.removed[0] == min(free)


def test_public_meshes_collapse_far():
    for name, most in {"meshes/horse.obj": 10, "meshes/fertility.off": 30, "meshes/face.obj": 20}.items():
        assert len(records_of(data_mesh(name)).roots) <= most
