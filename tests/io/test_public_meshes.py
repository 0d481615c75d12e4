"""Public meshes, where a folder of them is at hand (environment variable MORPHLET_DATA)."""

import os
from pathlib import Path

import numpy as np
import pytest
import trimesh

from morphlet.io.formats import read, rewrite
from morphlet.io.pairs import read_pairs

FOLDER = os.environ.get("MORPHLET_DATA")
pytestmark = pytest.mark.skipif(not FOLDER, reason="MORPHLET_DATA is not set: no public meshes")
DATA = Path(FOLDER or ".")
MESHES = sorted(p for part in ("meshes", "tosca", "bad") for p in (DATA / part).glob("*.???")) if FOLDER else []


@pytest.mark.parametrize("path", MESHES, ids=lambda path: path.name)
def test_every_mesh_reads(path):
    mesh = read(path)
    assert mesh.n_vertices > 0
    assert mesh.topology.referenced[mesh.faces].all()


@pytest.mark.parametrize(
    ("name", "vertices", "faces"),
    [
        ("meshes/horse.obj", 8431, 16843),
        ("meshes/camel.obj", 21887, 43814),
        ("meshes/stanford-bunny.obj", 35947, 69451),
        ("meshes/bunny.off", 3485, 6966),
        ("meshes/horse-48k.ply", 48485, 96966),
        ("bad/spot.obj", 2930, 5856),
        ("bad/igea.ply", 134345, 268686),
    ],
)
def test_known_counts(name, vertices, faces):
    mesh = read(DATA / name)
    assert (mesh.n_vertices, mesh.n_faces) == (vertices, faces)


def test_strips_give_a_closed_oriented_surface():
    topology = read(DATA / "bad/igea.ply").topology
    assert topology.euler_characteristic == 2
    assert np.all(topology.halfedge_counts == 1)


def test_binary_ply_against_another_reader():
    peer = trimesh.load(DATA / "meshes/horse-48k.ply", process=False)
    mesh = read(DATA / "meshes/horse-48k.ply")
    assert np.array_equal(mesh.vertices, peer.vertices)
    assert np.array_equal(mesh.faces, peer.faces)


@pytest.mark.parametrize("name", ["bad/spot.obj", "bad/suzanne.obj", "bad/igea.ply", "meshes/horse.obj"])
def test_rewriting_public_meshes(tmp_path, name):
    mesh = read(DATA / name)
    moved = mesh.with_vertices(mesh.vertices @ np.diag([1, 2, 3]) + 1 / 3)
    rewrite(DATA / name, moved, tmp_path / Path(name).name)
    assert read(tmp_path / Path(name).name).fingerprint == moved.fingerprint


def test_markers_belong_to_their_meshes():
    pairs = read_pairs(DATA / "markers/cat-lion.csv")
    assert len(pairs) == 55
    assert pairs.labels[0] == "left front paw left side"
    pairs.checked(read(DATA / "meshes/cat.obj"), read(DATA / "meshes/lion.obj"))
    assert len(read_pairs(DATA / "markers/horse-camel.csv")) == 107
