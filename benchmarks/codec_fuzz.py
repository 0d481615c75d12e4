"""Damaged and forged `.mlw` files, for as long as is given: each must be refused, or be a shorter result that says so.

    python benchmarks/codec_fuzz.py [--seconds 60] [--seed 0] [--json FILE] [--markdown]

Files of every mode are flipped, cut, spliced, overwritten, and, with checksums made to fit again, altered in their headers and
payloads. Counted are: tried; refused (with `CodecError`); partial (read, and said to be incomplete); read (only where the
checksums were made to fit, so that nothing can be noticed); wrong (read without a word although a checksum is broken, another
exception, positions that are not finite, faces out of range, a pause of more than ten seconds, or more than twice the memory
of the sound file and 1 MB). Ends with 1 if any is wrong.
"""

import argparse
import sys
import time
import tracemalloc
from collections import Counter
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from morphlet import CodecError, CodecOptions, Decoded, MeshSequence, decode_part, encode, encode_surface, sample
from morphlet.codec.auto import surface_file
from morphlet.codec.container import NETWORK, Header, Limits, Packet, Source, read_header, read_packets
from morphlet.codec.network import NetworkOptions, network_of_bytes

LONGEST = 10.0
"""Seconds that no small file may take."""
SPARE = 1 << 20
"""Bytes of memory beside twice those of the sound file."""
COUNTS = (0, 1, 2, 255, 65_536, 10**6, 2**31, 10**12, 2**63)
REALS = (0.0, -1.0, 1e-300, 1e300, float("nan"), float("inf"))


def files() -> dict[str, bytes]:
    """A sound file of each mode."""
    rest = sample("blob", n_vertices=1500)
    frames = np.stack([rest.vertices * [1, 1, 1 + k / 4] for k in range(4)])
    moves = MeshSequence(rest.topology, frames, np.arange(4.0))
    diagonal = rest.bbox_diagonal
    network = network_of_bytes(rest, 150, NetworkOptions(level=3))
    return {
        "sequence": encode(moves, error=0.01).data,
        "layers": encode(moves, error=0.01, options=CodecOptions(layers=2, order="kept", packet_frames=2)).data,
        "exact": encode(rest, error=0.01, options=CodecOptions(order="kept")).data,
        "decimated": encode_surface(rest, rms=0.01 * diagonal, mode="decimated").data,
        "shape": encode_surface(rest, rms=0.01 * diagonal, mode="shape").data,
        "mlwnn": surface_file(NETWORK, network.payloads, (10 * 4**network.level + 2, 20 * 4**network.level), diagonal),
    }


def parts(data: bytes) -> tuple[Header, list[Packet]]:
    """Header and packets of a sound file."""
    source = Source([data])
    header, chain = read_header(source, Limits())
    return header, list(read_packets(source, chain))


def whole(header: Header, packets: list[Packet]) -> bytes:
    """A file of these, its checksums made to fit."""
    data, chain = header.encoded()
    for packet in packets:
        piece, chain = packet.encoded(chain)
        data += piece
    return data


def flipped(data: bytes, rng: np.random.Generator) -> bytes:
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 4))):
        out[rng.integers(len(out))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def cut(data: bytes, rng: np.random.Generator) -> bytes:
    return data[: rng.integers(len(data))]


def overwritten(data: bytes, rng: np.random.Generator) -> bytes:
    out, start = bytearray(data), int(rng.integers(len(data)))
    noise = rng.integers(0, 256, int(rng.integers(1, 40)), dtype=np.uint8).tobytes()
    out[start : start + len(noise)] = noise
    return bytes(out)


def spliced(data: bytes, rng: np.random.Generator) -> bytes:
    a, b, c = (int(k) for k in rng.integers(0, len(data), 3))
    return data[:a] + data[b:c] + data[a:]


def forged_header(data: bytes, rng: np.random.Generator) -> bytes:
    header, packets = parts(data)
    name = str(rng.choice(["vertices", "faces", "frames", "layers", "finest", "spacing", "step", "error", "hierarchy"]))
    value: float = float(rng.choice(REALS)) if name in ("spacing", "step", "error") else int(rng.choice(COUNTS))
    value = min(value, 255) if name in ("layers", "finest") else min(value, 2**32 - 1) if name == "hierarchy" else value
    return whole(replace(header, **{name: value}), packets)


def forged_payload(data: bytes, rng: np.random.Generator) -> bytes:
    header, packets = parts(data)
    place = int(rng.integers(len(packets)))
    payload = packets[place].payload
    change: Callable[[bytes, np.random.Generator], bytes] = (flipped, cut, overwritten, spliced)[int(rng.integers(4))]
    packets[place] = replace(packets[place], payload=change(payload, rng) if payload else bytes(5))
    return whole(header, packets)


def forged_packets(data: bytes, rng: np.random.Generator) -> bytes:
    header, packets = parts(data)
    one, two = (int(k) for k in rng.integers(0, len(packets), 2))
    what = int(rng.integers(4))
    if what == 0:
        packets[one], packets[two] = packets[two], packets[one]
    elif what == 1:
        packets[one] = replace(packets[one], count=int(rng.choice(COUNTS)))
    elif what == 2:
        packets[one] = replace(packets[one], layer=int(rng.choice(COUNTS)), kind=int(rng.integers(1, 9)))
    else:
        del packets[one]
    return whole(header, packets)


BROKEN = (flipped, cut, overwritten, spliced)
"""Ways whose checksums do not fit: only a cut between packets may be read, as incomplete."""
FORGED = (forged_header, forged_payload, forged_packets)


def verdict(data: bytes, sound: bytes, known: bool, memory: int) -> str:
    """What became of a file."""
    start = time.perf_counter()
    tracemalloc.reset_peak()
    try:
        found: Decoded | None = decode_part(data)
    except CodecError:
        found = None
    except Exception as error:  # whatever else it is, it should not be
        return f"wrong: {type(error).__name__}: {error}"
    if time.perf_counter() - start > LONGEST:
        return "wrong: slow"
    if tracemalloc.get_traced_memory()[1] > 2 * memory + SPARE:
        return f"wrong: {tracemalloc.get_traced_memory()[1] >> 20} MB"
    if found is None:
        return "refused"
    faces = found.sequence.topology.faces
    if not np.isfinite(found.sequence.positions).all() or (
        len(faces) and not 0 <= faces.min() <= faces.max() < found.sequence.topology.n_vertices
    ):
        return "wrong: no mesh"
    if not found.complete:
        return "partial"
    return "read" if known or data == sound else "wrong: read"


def memory_of(data: bytes) -> int:
    """Bytes that reading a sound file takes at most."""
    decode_part(data)
    tracemalloc.reset_peak()
    decode_part(data)
    return tracemalloc.get_traced_memory()[1]


def fuzz(seconds: float, seed: int, most: int) -> Counter[str]:
    """How many of each verdict, and of "tried"."""
    sound, rng, counts = files(), np.random.default_rng(seed), Counter[str]()
    tracemalloc.start()
    memory = {name: memory_of(data) for name, data in sound.items()}
    end = time.monotonic() + seconds
    while time.monotonic() < end and counts["tried"] < most:
        name = str(rng.choice(list(sound)))
        way = (*BROKEN, *FORGED)[int(rng.integers(len(BROKEN) + len(FORGED)))]
        found = verdict(way(sound[name], rng), sound[name], way in FORGED, memory[name])
        counts["tried"] += 1
        counts[found.split(":")[0]] += 1
        if found.startswith("wrong"):
            print(name, way.__name__, found, file=sys.stderr)
    tracemalloc.stop()
    return counts


def main() -> int:
    from book import Sheet, Table, add_options  # here: a test runs the rest from its own folder

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--seed", type=int, default=0)
    add_options(parser)
    options = parser.parse_args()
    counts = fuzz(options.seconds, options.seed, sys.maxsize)
    heads = ("tried", "refused", "partial", "read", "wrong")
    title = f"Damaged and forged files in {options.seconds:g} s, seed {options.seed}"
    Sheet.of(options).add(Table(title, heads, [[counts[key] for key in heads]]))
    return int(counts["wrong"] > 0)


if __name__ == "__main__":
    sys.exit(main())
