"""Damaged and forged files: a typed error, or a shorter result that says so; never a wrong mesh, a hang, or all of the memory."""

import struct
import tracemalloc
import zlib
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from codec.bending import bent
from morphlet import CodecError, CodecOptions, Limits, decode, decode_part, encode
from morphlet.codec.container import (
    EXACT,
    FACES,
    FRAMES,
    POSITIONS,
    SEQUENCE,
    Header,
    Packet,
    Source,
    read_header,
    rounded_down,
    rounded_up,
)
from support import blob, icosphere, tetrahedron

SMALL = encode(bent(tetrahedron(), 3), error=0.05).data
LARGE = encode(bent(blob(4), 6), error=0.002).data
FLIPS = 10_000
CLAIM = 0xFFFFFFF0


def header_of(data: bytes) -> Header:
    """What the header of a file says."""
    return read_header(Source([data]), Limits())[0]


def size_of(data: bytes) -> int:
    """Bytes of the header with its checksum."""
    return len(header_of(data).encoded()[0])


def packets_of(data: bytes) -> list[tuple[int, int]]:
    """Start and end of each packet."""
    place, found = size_of(data), []
    while place < len(data):
        start, place, numbers = place, place + 1, []
        for _ in range(3):
            value = shift = 0
            while True:
                byte = data[place]
                place += 1
                value |= (byte & 0x7F) << shift
                shift += 7
                if byte < 0x80:
                    break
            numbers.append(value)
        place += 4 + numbers[2]
        found.append((start, place))
    return found


def forged(data: bytes, **changes: object) -> bytes:
    """The file with fields of its header changed, and the header's checksum made to fit."""
    return replace(header_of(data), **changes).encoded()[0] + data[size_of(data) :]


def overwritten(data: bytes, offset: int, value: int) -> bytes:
    """The file with one byte of its header changed, and the header's checksum made to fit."""
    size = size_of(data)
    head = bytearray(data[: size - 4])
    head[offset] = value
    return bytes(head) + struct.pack("<I", zlib.crc32(head)) + data[size:]


def rebuilt(data: bytes, *packets: Packet) -> bytes:
    """A file of this header and these packets, all checksums made to fit."""
    size = size_of(data)
    chain = struct.unpack("<I", data[size - 4 : size])[0]
    out = data[:size]
    for packet in packets:
        piece, chain = packet.encoded(chain)
        out += piece
    return out


def payload(data: bytes, number: int) -> bytes:
    """The payload of a packet whose counts take one byte each."""
    start, end = packets_of(data)[number]
    place = start + 3
    while data[place] & 0x80:
        place += 1
    return data[place + 5 : end]


def test_every_flipped_bit_of_a_small_file_is_noticed():
    for place in range(8 * len(SMALL)):
        damaged = bytearray(SMALL)
        damaged[place // 8] ^= 1 << (place % 8)
        with pytest.raises(CodecError):
            decode_part(bytes(damaged))


def test_flipped_bits_of_a_large_file_are_noticed():
    rng = np.random.default_rng(0)
    missed = 0
    for place in rng.integers(0, 8 * len(LARGE), FLIPS):
        damaged = bytearray(LARGE)
        damaged[place // 8] ^= 1 << int(place % 8)
        try:
            decode_part(bytes(damaged), Limits(frames=5))
            missed += 1
        except CodecError:
            continue
    assert missed == 0


@pytest.mark.parametrize("data", [SMALL, LARGE], ids=["small", "large"])
def test_every_cut_is_an_error_or_a_shorter_result(data):
    whole = decode(data)
    ends = {end for _, end in packets_of(data)}
    for cut in range(0, len(data), 1 if len(data) < 2000 else 7):
        if cut in ends and cut > packets_of(data)[1][0] + 1:
            continue
        with pytest.raises(CodecError):
            decode_part(data[:cut])
    for cut in sorted(ends - {len(data)})[1:]:
        part = decode_part(data[:cut])
        assert not part.complete
        assert np.array_equal(part.sequence.positions, whole.positions[: len(part.sequence)])
        with pytest.raises(CodecError, match="one cut after"):
            decode(data[:cut])


@given(st.binary(max_size=400))
def test_random_bytes_are_refused(data):
    with pytest.raises(CodecError, match="MWNC"):
        decode_part(data)


@settings(max_examples=60)
@given(st.binary(min_size=1, max_size=80), st.sampled_from([FACES, POSITIONS, FRAMES]))
def test_random_payloads_with_sound_checksums_are_refused_or_read(noise, kind):
    payloads = {k: payload(SMALL, n) for n, k in enumerate((FACES, POSITIONS, FRAMES))}
    payloads[kind] = noise
    data = rebuilt(SMALL, *(Packet(k, 2 if k == FRAMES else 0, 0, p) for k, p in payloads.items()))
    try:
        found = decode_part(data)
    except CodecError:
        return
    assert not found.complete
    assert np.isfinite(found.sequence.positions).all()


def test_other_files_and_versions_say_so():
    with pytest.raises(CodecError, match="start with MWNC"):
        decode(b"glTF" + SMALL[4:])
    with pytest.raises(CodecError, match="start with MWNC"):
        decode(b"")
    with pytest.raises(CodecError, match=r"version 2.*update morphlet"):
        decode(overwritten(SMALL, 4, 2))
    assert len(decode(rebuilt_minor(SMALL))) == 3, "a newer minor version is read"
    for offset in (6, 7):
        with pytest.raises(CodecError, match="makes no sense"):
            decode(overwritten(SMALL, offset, 9))
    for changes in ({"layers": 0}, {"corner": (0, -(1 << 60), 0)}):
        with pytest.raises(CodecError, match="makes no sense"):
            decode(forged(SMALL, **changes))


def rebuilt_minor(data: bytes) -> bytes:
    """The same file of a later minor version, with a packet that may be skipped."""
    new = overwritten(data, 5, 7)
    count = len(packets_of(data))
    found = [Packet(k, 2 if k == FRAMES else 0, 0, payload(data, n)) for n, k in enumerate((FACES, POSITIONS, FRAMES))]
    return rebuilt(new, *found, Packet(0x90, 0, 0, b"later"), Packet(6, count, 0, b""))


def test_an_unknown_packet_that_may_not_be_skipped_is_refused():
    with pytest.raises(CodecError, match="type 9; update"):
        decode(rebuilt(SMALL, Packet(9, 0, 0, b"")))


@pytest.mark.parametrize("field", ["vertices", "faces", "frames"])
def test_forged_counts_take_no_memory(field):
    tracemalloc.start()
    for claim in (10**12, CLAIM, 60_000_000, 5_000_000):
        with pytest.raises(CodecError):
            decode(forged(SMALL, **{field: claim}))
        with pytest.raises(CodecError):
            decode_part(chained(forged(SMALL, **{field: claim})))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 40_000_000


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -1.0, 0.0])
@pytest.mark.parametrize("field", ["spacing", "step", "error"])
def test_spacings_steps_and_errors_must_be_positive(field, value):
    with pytest.raises(CodecError, match="makes no sense"):
        decode(forged(SMALL, **{field: value}))


def test_limits_are_the_callers():
    with pytest.raises(CodecError, match="raise the limits"):
        decode(LARGE, Limits(vertices=100))
    with pytest.raises(CodecError, match="raise the limits"):
        decode(LARGE, Limits(frames=4))
    assert len(decode(LARGE, Limits(2562, 5120, 5))) == 6


def test_packets_of_two_files_do_not_mix():
    one, two = (encode(bent(rest, 3), error=0.01).data for rest in (blob(2), icosphere(2)))
    first, second = packets_of(one), packets_of(two)
    for k in range(len(first)):
        with pytest.raises(CodecError, match="checksum"):
            decode_part(one[: first[k][0]] + two[second[k][0] : second[k][1]] + one[first[k][1] :])


def test_packets_swapped_doubled_or_left_out_are_noticed():
    data = encode(bent(blob(2), 5), error=0.01, options=CodecOptions(packet_frames=1)).data
    spans = packets_of(data)
    pieces = [data[a:b] for a, b in spans]
    for k in range(len(pieces) - 1):
        for order in (
            [*pieces[:k], pieces[k + 1], pieces[k], *pieces[k + 2 :]],
            pieces[:k] + pieces[k + 1 :],
            [*pieces[: k + 1], *pieces[k:]],
        ):
            with pytest.raises(CodecError):
                decode_part(data[: size_of(data)] + b"".join(order))


def test_an_end_that_counts_other_packets_is_refused():
    found = [Packet(k, 2 if k == FRAMES else 0, 0, payload(SMALL, n)) for n, k in enumerate((FACES, POSITIONS, FRAMES))]
    with pytest.raises(CodecError, match="3 packets where there were 2"):
        decode_part(rebuilt(SMALL, *found, Packet(6, 2, 0, b"")))
    with pytest.raises(CodecError, match="0 frames where there were 2"):
        decode_part(rebuilt(SMALL, *found[:2], Packet(6, 2, 0, b"")))


def test_bytes_after_the_end_are_refused():
    with pytest.raises(CodecError, match="bytes after its end"):
        decode(SMALL + b"\0")


def test_another_order_of_vertices_is_refused():
    with pytest.raises(CodecError, match="order of vertices that is not the writer's"):
        decode_part(chained(forged(SMALL, hierarchy=12345)))


def chained(data: bytes) -> bytes:
    """A file, the checksums of its packets made to fit its header."""
    found = [Packet(k, 2 if k == FRAMES else 0, 0, payload(SMALL, n)) for n, k in enumerate((FACES, POSITIONS, FRAMES))]
    return rebuilt(data, *found, Packet(6, 3, 0, b""))


def test_packets_out_of_place_are_refused():
    kinds = FACES, POSITIONS, FRAMES
    faces, positions, frames = (Packet(k, 2 if k == FRAMES else 0, 0, payload(SMALL, n)) for n, k in enumerate(kinds))
    for wrong in ([positions, faces], [faces], [faces, positions, positions], [faces, positions, frames, frames]):
        with pytest.raises(CodecError):
            decode_part(rebuilt(SMALL, *wrong))
    for packet in (Packet(FRAMES, 3, 0, frames.payload), Packet(FRAMES, 1 << 40, 0, frames.payload), Packet(FRAMES, 2, 1, frames.payload)):
        with pytest.raises(CodecError, match=r"where none, or fewer, belong|cannot be read|leave bytes"):
            decode_part(rebuilt(SMALL, faces, positions, packet))


def test_a_header_says_what_it_holds():
    for header in (
        Header(SEQUENCE, 4, 4, 0.125, (0, -1, 70_000), 0.5, 2, 0.25, 24, 1, 77),
        Header(EXACT, 400, 4000, 0.125, (-64, 63, 64), 0.5),
    ):
        data, chain = header.encoded()
        assert struct.unpack("<I", data[-4:])[0] == chain == zlib.crc32(data[:-4])
        assert header_of(data) == header


@given(st.floats(1e-300, 1e300))
def test_real_numbers_lose_a_millionth(value):
    assert value * (1 - 2e-6) <= rounded_down(value) <= value <= rounded_up(value) <= value * (1 + 2e-6)
    assert rounded_down(rounded_down(value)) == rounded_down(value)
    assert rounded_up(rounded_up(value)) == rounded_up(value)
