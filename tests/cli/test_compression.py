"""`encode` and `decode`: sizes and errors as told, orders, what is refused; a file that ends early."""

import numpy as np
import pytest

from cli.calls import call
from cli.test_verbs import told
from morphlet import CodecOptions, MeshSequence, encode, read, write, write_sequence
from support import blob

KEYS = ["mode", "bytes", "bits_per_vertex", "rms", "hausdorff", "kg_error", "max_vertex_error", "psnr"]
BODY = blob(2)
MOVES = MeshSequence(BODY.topology, np.stack([BODY.vertices * (1 + k / 10) for k in range(4)]), np.arange(4.0))


@pytest.fixture
def files(tmp_path):
    """A body and a folder of its poses."""
    write(tmp_path / "rest.ply", BODY)
    write_sequence(tmp_path / "poses", MeshSequence(BODY.topology, MOVES.positions[1:], MOVES.times[1:]))
    return tmp_path


def test_a_sequence_there_and_back(capsys, files):
    words = ("encode", files / "rest.ply", files / "poses", "-o", files / "moves.mlw", "--permutation", files / "p.npy", "--error", "0.1%")
    result = told(call(capsys, *words, "--json"), "encode", *KEYS, "frames")
    assert (result["mode"], result["frames"]) == ("sequence", 4)
    assert result["bytes"] == (files / "moves.mlw").stat().st_size
    assert 0 < result["hausdorff"] <= result["max_vertex_error"] <= BODY.bbox_diagonal / 1000
    back = told(call(capsys, "decode", files / "moves.mlw", "-o", files / "out", "--json"), "decode", *KEYS, "complete")
    assert (back["complete"], back["frames"], back["bytes"]) == (True, 4, result["bytes"])
    assert sorted(file.name for file in (files / "out").iterdir()) == ["frame-000.ply", "frame-001.ply", "frame-002.ply", "rest.ply"]
    order = np.load(files / "p.npy", allow_pickle=False)
    for k, name in enumerate(("rest", "frame-000", "frame-001", "frame-002")):
        gap = np.linalg.norm(read(files / "out" / f"{name}.ply").vertices - MOVES.positions[k][order], axis=1)
        assert gap.max() <= BODY.bbox_diagonal / 1000


def test_a_mesh_in_its_own_order_and_to_so_many_bits(capsys, files):
    words = ("encode", files / "rest.ply", "-o", files / "body.mlw", "--keep-order", "--bits", 10, "--json")
    result = told(call(capsys, *words), "encode", *KEYS)
    assert result["mode"] == "exact"
    assert result["order_bytes"] > 0
    extent = np.ptp(BODY.vertices, axis=0).max()
    assert result["max_vertex_error"] <= np.sqrt(3) / 2 * extent / 1023
    told(call(capsys, "decode", files / "body.mlw", "-o", files / "out", "--json"), "decode")
    found = read(files / "out" / "mesh.ply")
    np.testing.assert_array_equal(found.faces, BODY.faces)
    np.testing.assert_allclose(found.vertices, BODY.vertices, atol=extent / 1023)


def test_a_file_that_ends_early_is_refused_unless_it_is_asked_for(capsys, files):
    data = encode(MOVES, options=CodecOptions(packet_frames=1)).data
    whole = [len(data[:k]) for k in range(len(data)) if complete_up_to(data[:k])]
    (files / "cut.mlw").write_bytes(data[: whole[-1]])
    answer = call(capsys, "decode", files / "cut.mlw", "-o", files / "out")
    assert (answer.code, "add --partial" in answer.err) == (4, True)
    assert not (files / "out").exists()
    result = told(call(capsys, "decode", files / "cut.mlw", "-o", files / "out", "--partial", "--json"), "decode")
    assert (result["complete"], 1 <= result["frames"] <= 4) == (False, True)


def test_a_sequence_cut_after_its_rest_mesh_is_still_one(capsys, files):
    data = encode(MOVES, options=CodecOptions(packet_frames=1)).data
    (files / "cut.mlw").write_bytes(data[: next(k for k in range(len(data)) if complete_up_to(data[:k]))])
    result = told(call(capsys, "decode", files / "cut.mlw", "-o", files / "out", "--partial", "--json"), "decode")
    assert (result["mode"], result["frames"]) == ("sequence", 1)
    assert [file.name for file in (files / "out").iterdir()] == ["rest.ply"]


@pytest.mark.parametrize("mode", ["exact", "decimated"])
def test_a_surface_there_and_back(capsys, files, mode):
    words = ("encode", files / "rest.ply", "-o", files / "body.mlw", "--rms", "1%", "--mode", mode, "--json")
    result = told(call(capsys, *words), "encode", *KEYS)
    assert all(result[key] is not None for key in KEYS)
    assert result["rms"] <= 0.01 * BODY.bbox_diagonal
    assert result["mode"] in {trial["mode"] for trial in result["candidates"]}
    assert set(result["anchors"]) == {"draco", "decimated_draco"}
    back = told(call(capsys, "decode", files / "body.mlw", "-o", files / "out", "--json"), "decode")
    assert (back["mode"], back["complete"]) == (result["mode"], True)
    assert [file.name for file in (files / "out").iterdir()] == ["mesh.ply"]


def test_a_network_of_a_size_is_read_at_a_level(capsys, files):
    words = ("encode", files / "rest.ply", "-o", files / "body.mlw", "--mode", "mlwnn", "--size", 300, "--json")
    result = told(call(capsys, *words), "encode", *KEYS)
    assert result["bytes"] == (files / "body.mlw").stat().st_size <= 300
    told(call(capsys, "decode", files / "body.mlw", "-o", files / "back", "--level", 3, "--json"), "decode", *KEYS)
    assert read(files / "back" / "mesh.ply").n_vertices == 642
    answer = call(capsys, "decode", files / "body.mlw", "-o", files / "other", "--level", 9)
    assert (answer.code, "a level from 0 to 8" in answer.err) == (2, True)


def complete_up_to(data):
    """Whether a part of a file ends between two packets."""
    from morphlet import CodecError, decode_part

    try:
        decode_part(data)
    except CodecError:
        return False
    return True


@pytest.mark.parametrize(
    ("words", "code", "match"),
    [
        (["encode", "-o", "out.mlw"], 2, "at least one mesh; found none"),
        (["encode", "rest.ply", "-o", "out.zip"], 4, "an output ending in .mlw"),
        (
            ["encode", "rest.ply", "-o", "out.mlw", "--error", "1", "--bits", "8"],
            2,
            "one of --error, --rms, --bits, --size; found --error and --bits",
        ),
        (["encode", "rest.ply", "-o", "out.mlw", "--bits", "0"], 2, "1 to 24 --bits"),
        (["encode", "rest.ply", "-o", "out.mlw", "--error", "tiny"], 2, "a length like 0.01"),
        (["encode", "rest.ply", "-o", "out.mlw", "--error", "0"], 2, "an error above 0"),
        (["encode", "rest.ply", "-o", "out.mlw", "--error", "-1"], 2, "an error above 0"),
        (["encode", "rest.ply", "-o", "out.mlw", "--mode", "sequence"], 2, "a mesh and its poses, and no --rms, for --mode sequence"),
        (["encode", "rest.ply", "poses", "-o", "out.mlw", "--mode", "exact"], 2, "one mesh for --mode exact"),
        (["encode", "rest.ply", "-o", "out.mlw", "--rms", "0.1%", "--error", "1"], 2, "one of --error, --rms, --bits, --size"),
        (["encode", "rest.ply", "-o", "out.mlw", "--size", "500"], 2, "--mode mlwnn for a --size"),
        (["encode", "rest.ply", "-o", "out.mlw", "--mode", "mlwnn", "--size", "50"], 2, "at least 100 bytes"),
        (["encode", "rest.ply", "-o", "out.mlw", "--rms", "0.1%", "--keep-order"], 2, "--rms alone where vertices become others"),
        (["encode", "rest.ply", "-o", "out.mlw", "--mode", "shape", "--bits", "9"], 2, "--rms alone where vertices become others"),
        (["encode", "rest.ply", "poses", "-o", "out.mlw", "--mode", "shape"], 2, "one mesh for --mode shape"),
        (["encode", "rest.ply", "poses", "-o", "out.mlw", "--rms", "1%"], 2, "one mesh for --rms"),
        (["encode", "rest.ply", "other.ply", "-o", "out.mlw"], 4, "vertices"),
        (["decode", "missing.mlw", "-o", "out"], 4, "a .mlw file at"),
        (["decode", "rest.ply", "-o", "out"], 4, "a .mlw file"),
    ],
)
def test_what_cannot_be_is_refused(capsys, files, monkeypatch, words, code, match):
    monkeypatch.chdir(files)
    write("other.ply", blob(1))
    answer = call(capsys, *words)
    assert answer.code == code
    assert match in answer.err, answer.err
    assert not list(files.glob("out*"))
