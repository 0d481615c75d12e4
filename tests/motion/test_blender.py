"""What Blender makes of written files, and what it writes itself: Blender runs in a process of its own, as a program we talk to.

It is found as the module `bpy` of this interpreter, or of the one that MORPHLET_BLENDER_PYTHON names; `make test-blender` sets one up.
"""

import importlib.util
import os
import subprocess
import sys

import numpy as np
import pytest

from morphlet import Mesh, MeshSequence, read_poses, write_animation, write_sequence
from support import icosphere

MINUTES = 5
"""Longest run of Blender; it takes seconds."""
RATE = 24
"""Frames a second in Blender."""
TIMES = np.array([0.0, 0.5, 2.0, 4.0])
NAMES = ("ball", "tall", "turned away", "small")
SINGLE = 1e-6
"""Rounding of positions below 10 in single precision, a few steps of it."""
BYTE = 0.005
"""Half a step of Blender's bytes, which are spaced for the eye: at most 1.2 % of full light apart."""

SCRIPT = """
import sys, pathlib
import bpy, numpy as np

folder, rate = pathlib.Path(sys.argv[1]), int(sys.argv[2])
times = np.load(folder / "times.npy")


def numbers(items, name, width, kind=np.float32):
    values = np.empty(len(items) * width, kind)
    items.foreach_get(name, values)
    return values.reshape(-1, width)


def start():
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.context.scene.render.fps = rate


def imported():
    return next(o for o in bpy.data.objects if o.type == "MESH")


def shown(thing, time):
    frame = time * rate
    bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1)
    evaluated = thing.evaluated_get(bpy.context.evaluated_depsgraph_get())
    world = np.array(thing.matrix_world)
    points = numbers(evaluated.to_mesh().vertices, "co", 3) @ world[:3, :3].T + world[:3, 3]
    evaluated.to_mesh_clear()
    return points[:, [0, 2, 1]] * [1, 1, -1]


found = {}
start()
bpy.ops.import_scene.gltf(filepath=str(folder / "ball.glb"))
thing = imported()
mesh, keys = thing.data, thing.data.shape_keys.key_blocks
found["keys"] = np.array([key.name for key in keys])
found["name"] = np.array(mesh.name)
found["faces"] = numbers(mesh.loops, "vertex_index", 1, np.int32).reshape(-1, 3)
found["targets"] = np.stack([numbers(key.data, "co", 3)[:, [0, 2, 1]] * [1, 1, -1] for key in keys])
found["shown"] = np.stack([shown(thing, t) for t in times])
found["weights"] = np.array([(shown(thing, t), [key.value for key in keys])[1] for t in times])
found["between"] = shown(thing, (times[1] + times[2]) / 2)
found["colors"] = numbers(mesh.color_attributes[0].data, "color", 4)
bpy.ops.export_scene.gltf(filepath=str(folder / "again.glb"), export_frame_range=False, export_optimize_animation_size=True)
thing.animation_data_clear()
mesh.shape_keys.animation_data_clear()
thing.shape_key_add(name="nose", from_mix=False).data[5].co.z += 1
thing.shape_key_add(name="still", from_mix=False)
bpy.ops.export_scene.gltf(filepath=str(folder / "poses.glb"), export_animations=False, export_try_sparse_sk=True)

for ending, load in (("ply", bpy.ops.wm.ply_import), ("obj", bpy.ops.wm.obj_import)):
    for number in (0, len(times) - 1):
        start()
        load(filepath=str(folder / f"frame-{number:03d}.{ending}"), forward_axis="Y", up_axis="Z")
        mesh = imported().data
        found[f"{ending}-{number}"] = numbers(mesh.vertices, "co", 3)
        found[f"{ending}-faces-{number}"] = numbers(mesh.loops, "vertex_index", 1, np.int32).reshape(-1, 3)

start()
bpy.ops.import_scene.gltf(filepath=str(folder / "odd.glb"))
found["odd"] = np.stack([shown(imported(), t) for t in times])
np.savez(folder / "found.npz", **found)
"""


def with_bpy():
    """The interpreter that has Blender; skips if there is none."""
    named = os.environ.get("MORPHLET_BLENDER_PYTHON")
    if named is None and importlib.util.find_spec("bpy") is None:
        pytest.skip("Blender's module bpy is not here: run make test-blender, or name its Python in MORPHLET_BLENDER_PYTHON")
    return named or sys.executable


def ball():
    """A ball that grows tall, turns away, shrinks; its colours."""
    mesh = icosphere(2)
    turned = mesh.vertices @ [[0, 1, 0], [-1, 0, 0], [0, 0, 1]] + [3, 0, 1]
    shapes = np.stack([mesh.vertices, mesh.vertices * [1, 1, 2], turned, mesh.vertices / 2])
    colors = np.random.default_rng(0).integers(0, 256, (mesh.n_vertices, 3)).astype(np.uint8)
    return MeshSequence(mesh.topology, shapes, TIMES + 7), colors


def odd():
    """A triangle without area beside one with, and one shape three times."""
    mesh = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], [[0, 1, 2], [0, 1, 3]])
    return MeshSequence(mesh.topology, np.stack([mesh.vertices, mesh.vertices, mesh.vertices, 3 * mesh.vertices]), TIMES)


@pytest.fixture(scope="module")
def blender(tmp_path_factory):
    """A folder of written files, and what Blender found in them."""
    python, folder = with_bpy(), tmp_path_factory.mktemp("blender")
    sequence, colors = ball()
    np.save(folder / "times.npy", TIMES)
    write_animation(folder / "ball.glb", sequence, colors=colors, names=NAMES, duration=TIMES[-1])
    write_animation(folder / "odd.glb", odd(), duration=TIMES[-1])
    for ending in (".ply", ".obj"):
        write_sequence(folder, sequence, ending=ending)
    command = [python, "-c", SCRIPT, str(folder), str(RATE)]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60 * MINUTES, check=False)
    assert ran.returncode == 0, ran.stderr[-4000:]
    return folder, np.load(folder / "found.npz")


def test_shape_keys_have_the_names_and_positions_of_the_frames(blender):
    _, found = blender
    sequence, _ = ball()
    assert found["keys"].tolist() == ["Basis", *NAMES[1:]]
    assert str(found["name"]) == NAMES[0]
    np.testing.assert_array_equal(found["faces"], sequence.topology.faces)
    np.testing.assert_allclose(found["targets"], sequence.positions, atol=SINGLE)


def test_the_animation_shows_every_frame_at_its_time_and_blends_between(blender):
    _, found = blender
    sequence, _ = ball()
    np.testing.assert_allclose(found["shown"], sequence.positions, atol=SINGLE)
    np.testing.assert_allclose(found["weights"][:, 1:], np.eye(4)[:, 1:], atol=SINGLE)
    np.testing.assert_allclose(found["between"], (sequence.positions[1] + sequence.positions[2]) / 2, atol=SINGLE)


def test_colors_are_those_of_the_vertices(blender):
    _, found = blender
    sequence, colors = ball()
    share = colors[sequence.topology.faces.ravel()] / 255
    light = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(found["colors"][:, :3], light, atol=BYTE)


@pytest.mark.parametrize("ending", ["ply", "obj"])
def test_files_of_a_sequence_are_the_frames(blender, ending):
    _, found = blender
    sequence, _ = ball()
    for number in (0, len(sequence) - 1):
        np.testing.assert_array_equal(found[f"{ending}-faces-{number}"], sequence.topology.faces)
        np.testing.assert_allclose(found[f"{ending}-{number}"], sequence.positions[number], atol=SINGLE)


def test_degenerate_triangles_and_equal_shapes_play(blender):
    _, found = blender
    np.testing.assert_allclose(found["odd"], odd().positions, atol=SINGLE)


def test_what_blender_exports_reads_back(blender):
    """Blender stores targets that move few vertices as sparse accessors, and a keyframe per frame of film."""
    folder, _ = blender
    sequence, _ = ball()
    poses = read_poses(folder / "poses.glb")
    assert b'"sparse"' in (folder / "poses.glb").read_bytes()
    assert poses.names == (*NAMES, "nose", "still")
    rest, faces = poses.sequence.positions[0], poses.sequence.topology.faces
    source = np.argmin(np.linalg.norm(rest[:, None] - sequence.positions[0], axis=2), axis=1)
    nose = np.where(source[:, None] == 5, [0, 1, 0], 0.0)
    added = [*sequence.positions[:, source], rest + nose, rest]
    np.testing.assert_allclose(poses.sequence.positions, added, atol=SINGLE)
    assert sorted(map(sorted, source[faces].tolist())) == sorted(map(sorted, sequence.topology.faces.tolist()))
    played = read_poses(folder / "again.glb").sequence
    for k, time in enumerate(TIMES):
        at = np.argmin(np.abs(played.times - played.times[0] - time))
        np.testing.assert_allclose(played.times[at] - played.times[0], time, atol=SINGLE)
        np.testing.assert_allclose(played.positions[at], sequence.positions[k][source], atol=SINGLE)
