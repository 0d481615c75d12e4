"""Sequences to bytes and back: within the error, in the order told, the same in every process, as frames come."""

import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codec.bending import bent
from morphlet import (
    CodecError,
    CodecOptions,
    FrameEncoder,
    InputError,
    Mesh,
    MeshSequence,
    decode,
    decode_part,
    decode_stream,
    encode,
    encode_surface,
)
from support import beside, blob, data_file, data_mesh, icosphere, random_rotation, tetrahedron, torus

BENT_PARTS = beside(blob(2), torus((5, 0, 0)))


def worst(sequence: MeshSequence, file) -> float:
    """Largest distance of a vertex from where it was."""
    back = decode(file.data)
    return float(np.linalg.norm(back.positions - sequence.positions[:, file.permutation], axis=2).max())


RESTS = {
    "sphere": blob(3),
    "boundary": Mesh(blob(3).vertices, blob(3).faces[300:]),
    "genus": torus(),
    "parts": BENT_PARTS,
    "tiny": tetrahedron(),
    "soup": Mesh(np.random.default_rng(1).random((30, 3)), np.random.default_rng(2).integers(0, 30, (40, 3))),
}


@pytest.mark.parametrize("name", RESTS)
@pytest.mark.parametrize("error", [0.1, 1e-3, 1e-6])
def test_every_vertex_stays_within_the_error(name, error):
    sequence = bent(RESTS[name], 4)
    file = encode(sequence, error=error)
    assert worst(sequence, file) <= error
    assert file.report.max_vertex_error == worst(sequence, file)
    assert file.report.bytes == len(file.data)


@settings(max_examples=20)
@given(st.integers(0, 2**32), st.floats(1e-4, 10), st.sampled_from(["rest", "previous", "best"]))
def test_any_frames_stay_within_the_error(seed, error, reference):
    rng = np.random.default_rng(seed)
    rest = icosphere(1)
    positions = np.stack([rest.vertices, *(rng.normal(size=(42, 3)) * 10 ** rng.uniform(-3, 3) for _ in range(3))])
    sequence = MeshSequence(rest.topology, positions, np.arange(4.0))
    assert worst(sequence, encode(sequence, error=error, options=CodecOptions(reference=reference))) <= error


def test_a_smaller_error_takes_more_bytes_and_holds():
    sequence = bent(blob(3), 4)
    sizes = [len(encode(sequence, error=error).data) for error in (0.1, 0.03, 0.01, 0.003, 0.001)]
    assert sizes == sorted(sizes)


def test_a_turned_mesh_is_almost_free():
    rest = blob(4)
    turned = rest.vertices @ random_rotation(1).T + [3.0, -1, 2]
    still = encode(MeshSequence(rest.topology, np.stack([rest.vertices]), [0.0]), error=0.01)
    moved = encode(MeshSequence(rest.topology, np.stack([rest.vertices, turned]), [0.0, 1.0]), error=0.01)
    assert moved.report.frame_bytes < 0.03 * moved.report.rest_bytes + 150
    assert still.report.mode == "exact"


def test_a_still_animation_costs_a_few_bytes_a_frame():
    rest = blob(3)
    frames = np.repeat(rest.vertices[None], 41, axis=0)
    few, many = (encode(MeshSequence(rest.topology, frames[:k], np.arange(float(k))), error=0.01) for k in (21, 41))
    assert len(many.data) - len(few.data) < 20 * 12


def test_smooth_motion_is_led_on_from_the_last_two_frames():
    sequence = bent(blob(3), 12, 0.05)
    best, rest = (encode(sequence, error=1e-3, options=CodecOptions(reference=r)) for r in ("previous", "rest"))
    assert best.report.frame_bytes < 0.7 * rest.report.frame_bytes


def test_several_references_beat_the_rest_mesh():
    poses = data_file("horse-poses")
    rest = data_mesh("meshes/horse.obj")
    files = [data_mesh(f"horse-poses/{file.name}").vertices for file in sorted(poses.glob("horse-0[1-5].obj"))]
    sequence = MeshSequence(rest.topology, np.stack([rest.vertices, *files]), np.arange(6.0))
    error = 5e-3 * rest.bbox_diagonal
    best, alone = (encode(sequence, error=error, options=CodecOptions(reference=r)) for r in ("best", "rest"))
    assert best.report.frame_bytes < 0.97 * alone.report.frame_bytes
    assert len(best.data) < 16_000
    assert max(best.report.max_vertex_error, alone.report.max_vertex_error) <= error


@pytest.mark.parametrize("name", RESTS)
def test_the_callers_order_comes_back(name):
    sequence = bent(RESTS[name], 3)
    file = encode(sequence, error=1e-3, options=CodecOptions(order="kept"))
    back = decode(file.data)
    assert np.array_equal(back.topology.faces, sequence.topology.faces)
    assert np.array_equal(file.permutation, np.arange(sequence.topology.n_vertices))
    assert np.linalg.norm(back.positions - sequence.positions, axis=2).max() <= 1e-3
    free = encode(sequence, error=1e-3)
    assert len(file.data) - len(free.data) == file.report.order_bytes > 0 == free.report.order_bytes


def test_times_come_back():
    rest = blob(2)
    times = np.array([-1.0, 0.25, 0.5])
    sequence = MeshSequence(rest.topology, np.repeat(rest.vertices[None], 3, axis=0), times)
    assert np.array_equal(decode(encode(sequence, error=0.1).data).times, times)


def test_encoding_again_what_was_decoded_changes_no_size_much():
    sequence = bent(blob(3), 4)
    first = encode(sequence, error=0.01)
    second = encode(decode(first.data), error=0.01)
    assert abs(len(second.data) - len(first.data)) < 0.05 * len(first.data)


@settings(max_examples=15)
@given(st.integers(0, 2**32), st.floats(1e-4, 0.3))
def test_encoding_again_what_was_decoded_changes_nothing(seed, error):
    rng = np.random.default_rng(seed)
    mesh = Mesh(icosphere(2).vertices * rng.uniform(0.6, 0.9, (162, 1)), icosphere(2).faces)
    options = CodecOptions(reference="rest", order="kept")
    for subject in (mesh, bent(mesh, 3)):
        first = encode(subject, error=error, options=options)
        second = encode(decode(first.data), error=error, options=options)
        assert np.array_equal(decode(second.data).positions, decode(first.data).positions)


def test_encoding_a_mesh_again_in_the_coders_order_moves_no_vertex():
    first = encode(blob(3), error=0.01)
    second = encode(decode(first.data), error=0.01)
    assert np.array_equal(decode(second.data).positions, decode(first.data).positions[:, second.permutation])


ELSEWHERE = """
import sys
from codec.bending import bent
from support import blob
from morphlet import encode, encode_surface
sys.stdout.write(encode(bent(blob(3), 4), error=0.01).data.hex() + encode_surface(blob(2), rms=0.05, mode="decimated").data.hex())
"""


@pytest.mark.parametrize("seed", ["1", "2"])
def test_bytes_are_the_same_in_another_process(seed):
    folder = Path(__file__).parents[1]
    surroundings = os.environ | {"PYTHONHASHSEED": seed}
    run = subprocess.run([sys.executable, "-c", ELSEWHERE], capture_output=True, text=True, check=True, cwd=folder, env=surroundings)
    here = encode(bent(blob(3), 4), error=0.01).data + encode_surface(blob(2), rms=0.05, mode="decimated").data
    assert run.stdout == here.hex()


def test_frames_come_one_by_one():
    sequence = bent(blob(2), 6)
    encoder = FrameEncoder.prepare(sequence[0], error=0.01, options=CodecOptions(packet_frames=1))
    source = iter(sequence.positions[1:])
    packets = encoder.packets(source)
    pieces = [encoder.opening, next(packets)]
    assert len(list(source)) == 4, "a packet is there before the next frame is taken"
    pieces += [*packets]
    meshes = decode_stream(bytes([b]) for b in b"".join(pieces))
    assert len([next(meshes), next(meshes)]) == 2
    with pytest.raises(StopIteration):
        next(meshes)


def test_a_stream_gives_each_frame_as_soon_as_it_is_whole():
    sequence = bent(blob(2), 5)
    encoder = FrameEncoder.prepare(sequence[0], error=0.01, options=CodecOptions(packet_frames=1))
    pieces = [encoder.opening, *encoder.packets(sequence.positions[1:])]
    taken = []

    def source():
        for piece in pieces:
            taken.append(piece)
            yield piece

    for number, mesh in enumerate(decode_stream(source())):
        assert np.abs(mesh.vertices - sequence.positions[number, encoder.permutation]).max() <= 0.01
        assert len(taken) <= number + 2


def test_stream_and_file_hold_the_same():
    sequence = bent(blob(2), 5)
    file = encode(sequence, error=0.01)
    meshes = list(decode_stream(file.data[k : k + 37] for k in range(0, len(file.data), 37)))
    assert np.array_equal(np.stack([m.vertices for m in meshes]), decode(file.data).positions)


def test_layers_cut_short_show_all_frames_less_precisely():
    sequence = bent(blob(4), 5)
    file = encode(sequence, error=0.01, options=CodecOptions(layers=3, packet_frames=5))
    whole = decode_part(file.data)
    assert whole.complete
    assert whole.layers == 3
    cuts, errors = [], []
    for cut in range(len(file.data)):
        try:
            part = decode_part(file.data[:cut])
        except CodecError:
            continue
        cuts.append(cut)
        assert not part.complete
        if len(part.sequence) == 5:
            errors.append(np.linalg.norm(part.sequence.positions - sequence.positions[:, file.permutation], axis=2).max())
    assert len(cuts) == 4, "after positions, and after each layer"
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] <= 0.01 < errors[0] < 0.5


def test_a_file_of_layers_is_no_stream():
    file = encode(bent(blob(2), 3), error=0.01, options=CodecOptions(layers=2))
    with pytest.raises(CodecError, match="a file of one layer"):
        list(decode_stream([file.data]))


def test_a_single_mesh_comes_back_within_the_error():
    for mesh in (blob(3), BENT_PARTS, tetrahedron()):
        file = encode(mesh, error=1e-3)
        back = decode(file.data)
        assert len(back) == 1
        assert np.linalg.norm(back.positions[0] - mesh.vertices[file.permutation], axis=1).max() <= 1e-3


def test_an_error_is_a_thousandth_of_the_diagonal_unless_given():
    mesh = blob(3)
    assert decode_part(encode(mesh).data).error == pytest.approx(1e-3 * mesh.bbox_diagonal)


@pytest.mark.parametrize("error", [0.0, -1.0, float("nan"), float("inf"), 1e-14])
def test_errors_that_cannot_be_kept_are_refused(error):
    with pytest.raises(InputError, match="error"):
        encode(blob(1), error=error)


def test_other_bad_arguments_are_refused():
    with pytest.raises(InputError, match="reference rest or previous or best"):
        CodecOptions(reference="next")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="layers from 1 to 16"):
        CodecOptions(layers=0)
    with pytest.raises(InputError, match="number of frames where there are layers"):
        FrameEncoder.prepare(blob(1), error=0.1, options=CodecOptions(layers=2))
    with pytest.raises(InputError, match="at least one vertex"):
        encode(Mesh(np.zeros((0, 3)), np.zeros((0, 3), int)), error=0.1)
    encoder = FrameEncoder.prepare(blob(1), error=0.1)
    with pytest.raises(InputError, match="frame of shape"):
        list(encoder.packets([np.zeros((3, 3))]))
