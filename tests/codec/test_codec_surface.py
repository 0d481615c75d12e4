"""Files that keep the surface alone: within the error, as measured; the smallest of what applies; cut, damaged, forged."""

import numpy as np
import pytest

from morphlet import CodecError, EncodedSurface, InputError, Mesh, SolveError, decode, decode_part, decode_stream, encode, encode_surface
from morphlet.codec.auto import surface_file
from morphlet.codec.container import END, SHAPE, SURFACE, Header, Limits, Packet, Source, read_header, read_packets
from morphlet.codec.decimation import decimated
from morphlet.codec.draco import draco_size
from morphlet.codec.network import NetworkOptions, network_of_bytes
from morphlet.codec.surface_error import farthest, surface_error
from support import blob, data_mesh, icosphere, tetrahedron, torus

BODY = blob(4)
RMS = 2e-3 * BODY.bbox_diagonal
OPEN = Mesh(blob(3).vertices, blob(3).faces[200:])


@pytest.fixture(scope="module")
def smallest() -> EncodedSurface:
    return encode_surface(BODY, rms=RMS)


@pytest.fixture(scope="module")
def files(smallest) -> dict[str, bytes]:
    """Each way's file."""
    return {trial.mode: trial.data for trial in smallest.report.candidates if trial.data is not None}


@pytest.fixture(scope="module")
def shape(files) -> bytes:
    return files["shape"]


@pytest.mark.parametrize("mode", ["exact", "decimated", "shape"])
def test_surfaces_stay_within_the_error(files, smallest, mode):
    back = decode_part(files[mode])
    assert (back.mode, back.complete) == (mode, True)
    found = surface_error(BODY, back.sequence[0])
    assert 0.8 * RMS < found.rms <= RMS
    trial = next(t for t in smallest.report.candidates if t.mode == mode)
    assert (trial.bytes, trial.rms, trial.note) == (len(files[mode]), found.rms, "")
    faces = len(back.sequence.topology.faces)
    assert (faces == BODY.n_faces) if mode == "exact" else (faces != BODY.n_faces)


def test_auto_takes_the_smallest(files, smallest):
    report = smallest.report
    assert set(files) == {"exact", "decimated", "shape"}
    assert smallest.data == files[report.mode] == min(files.values(), key=len)
    assert np.array_equal(decode(smallest.data)[0].vertices, smallest.mesh.vertices)
    assert report.bytes == len(smallest.data)
    assert report.max_vertex_error <= report.hausdorff + 1e-12
    assert report.psnr == pytest.approx(20 * np.log10(BODY.bbox_diagonal / report.rms))
    assert "not tried" in next(t.note for t in report.candidates if t.mode == "mlwnn")


def test_what_does_not_apply_says_why():
    report = encode_surface(OPEN, rms=2 * RMS).report
    assert report.mode in ("exact", "decimated")
    assert "closed" in next(t.note for t in report.candidates if t.mode == "shape")
    with pytest.raises(SolveError, match="shape: needed a closed"):
        encode_surface(OPEN, rms=RMS, mode="shape")


def test_where_nothing_smaller_comes_so_near_faces_are_kept():
    report = encode_surface(tetrahedron(), rms=1e-3).report
    assert report.mode == "exact"
    assert all(t.note for t in report.candidates if t.mode != "exact")


@pytest.mark.parametrize("rms", [0.0, -1.0, float("nan"), float("inf")])
def test_errors_that_are_none_are_refused(rms):
    with pytest.raises(InputError, match="an error above 0"):
        encode_surface(BODY, rms=rms)


def test_every_flipped_bit_of_a_surface_is_noticed(shape):
    for place in range(0, 8 * len(shape), 5):
        damaged = bytearray(shape)
        damaged[place // 8] ^= 1 << (place % 8)
        with pytest.raises(CodecError):
            decode_part(bytes(damaged))


def test_a_cut_surface_is_coarser_or_refused(shape):
    whole, parts = decode_part(shape), []
    for cut in range(len(shape)):
        try:
            parts.append(decode_part(shape[:cut]))
        except CodecError:
            continue
    assert all(not part.complete for part in parts)
    errors = [surface_error(BODY, part.sequence[0]).rms for part in parts]
    assert errors == sorted(errors, reverse=True)
    assert len(parts) == whole.layers
    with pytest.raises(CodecError, match="end before its last packet"):
        list(decode_stream([shape[:-8]]))


def test_a_surface_comes_as_a_stream(shape):
    (mesh,) = decode_stream(shape[k : k + 50] for k in range(0, len(shape), 50))
    assert np.array_equal(mesh.vertices, decode(shape)[0].vertices)


def packets(header: Header, *found: Packet) -> bytes:
    data, chain = header.encoded()
    for packet in found:
        piece, chain = packet.encoded(chain)
        data += piece
    return data


def test_forged_counts_and_packets_are_refused(shape):
    header = read_header(Source([shape]), Limits())[0]
    start, chain = header.encoded()
    payloads = [packet.payload for packet in read_packets(Source([shape[len(start) :]]), chain)]
    for wrong in (Header(SHAPE, header.vertices + 1, header.faces, 1.0), Header(SHAPE, header.vertices, header.faces + 2, 1.0)):
        with pytest.raises(CodecError):
            decode_part(packets(wrong, Packet(SURFACE, 0, 0, payloads[0])))
    with pytest.raises(CodecError, match="packet 1 of type 7 where number 0"):
        decode_part(packets(header, Packet(SURFACE, 0, 1, payloads[0])))
    with pytest.raises(CodecError, match="an end before its first packet"):
        decode_part(packets(header, Packet(END, 0, 0, b"")))
    with pytest.raises(CodecError, match="raise the limits"):
        decode_part(shape, Limits(vertices=header.vertices - 1))


def test_a_network_comes_back():
    found = network_of_bytes(blob(3), 120, NetworkOptions(level=3))
    data = surface_file(4, found.payloads, (10 * 4**found.level + 2, 20 * 4**found.level), RMS)
    back = decode_part(data)
    assert (back.mode, back.complete) == ("mlwnn", True)
    assert surface_error(blob(3), back.sequence[0]).rms < 0.05 * BODY.bbox_diagonal
    with pytest.raises(CodecError, match="vertices where there were"):
        decode_part(surface_file(4, found.payloads, (10 * 4**5 + 2, 20 * 4**5), RMS))


def test_fewer_faces_lie_close():
    coarse = decimated(BODY, 500)
    assert coarse.n_faces == 500
    assert surface_error(BODY, coarse).rms < 5e-3 * BODY.bbox_diagonal


def test_distances_are_those_of_surfaces():
    inner, outer = icosphere(4), icosphere(4)
    found = surface_error(inner, outer.with_vertices(1.5 * outer.vertices))
    assert found.rms == pytest.approx(0.5, rel=0.01)
    assert farthest(inner, outer.with_vertices(1.5 * outer.vertices)) == pytest.approx(0.5, rel=0.01)
    points = Mesh(np.zeros((2, 3)), np.zeros((0, 3), int))
    assert farthest(points, points.with_vertices(points.vertices + np.array([0, 0, 2]))) == 2


def test_own_coding_is_smaller_than_dracos_on_the_same_lattice():
    pytest.importorskip("DracoPy")
    for mesh in (BODY, torus(), data_mesh("meshes/cat.obj")):
        file = encode(mesh, error=3e-4 * mesh.bbox_diagonal)
        assert len(file.data) < draco_size(file.data)
