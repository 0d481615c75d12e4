"""Hostile files for every reader: sound ones of each kind, ways to damage and to forge them, and a judge that believes no reader.

A file that was only written otherwise (line ends, byte order mark, digits) must give the same; one that reaches out of its folder, asks for
all memory or holds what no mesh has must be refused; one that was damaged at random may be read if what comes out is sound: finite, indices
in range, the same again after it was written and read. Text and PLY files are read by a second, slow reader too, and must give the same.
"""

import copy
import io
import json
import re
import shutil
import struct
import zipfile
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from morphlet import (
    Correspondence,
    FileError,
    InputError,
    Mesh,
    MeshSequence,
    MorphletError,
    RoiEditor,
    Schedule,
    SphericalImage,
    SphericalMap,
    SphericalNetwork,
    SurfacePoints,
    VertexPairs,
    WaveletNetwork,
    approximate_by_rows,
    decode_part,
    read,
    read_edit,
    read_pairs,
    read_poses,
    rewrite,
    spherical_image,
    spherical_map,
    write,
    write_animation,
    write_pairs,
)
from morphlet.approximation.stored import load as load_approximation
from morphlet.approximation.surface import approximate
from morphlet.codec.results import Decoded
from morphlet.io.attributes import read_columns
from morphlet.io.formats import read_attributes
from morphlet.numerics.unit_sphere import icosphere
from torture_pool import Task

SAME, REFUSED, SOUND, ANY = "same", "refused", "sound", "any"
"""What must come out: the same as of the sound file; a refusal; one of both; anything that is sound."""
LONGEST_MESSAGE = 2000
"""Letters of a refusal: a file must not fill the screen."""
ELSEWHERE = "secret.bin"
"""A file outside the folder of the files: nothing may read it."""
BOMB = 1 << 30
"""Bytes that a bomb unpacks to."""
WORDS = tuple(
    b"1e999 -1 99999999999 nan 1,5 0 1e-320 0x10 1_0 inf -0 1. .5 +3 1e5 18446744073709551616 1d5 \xd9\xa1 1.5.2 --1 / // 1/ -9 1e".split()
)
VALUES = (-1, 0, 1, 2, 3, 7, 1.5, 2**31, 2**53, 10**30, 1e308, -1e308, float("nan"), float("inf"), None, True, "", "x", [], {}, [0], [[0]])
Rng = np.random.Generator
Value = list[np.ndarray]


@dataclass(frozen=True, eq=False)
class Case:
    """A hostile file: its bytes (of large ones what makes them), what lies beside it, what must come out, the sound file it was made of."""

    name: str
    data: bytes | Callable[[], bytes]
    expect: str
    seed: str = ""
    beside: dict[str, bytes] = field(default_factory=dict)
    links: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Reader:
    """Sound files by name, ways to change them at random, and files made by hand."""

    name: str
    sound: Callable[[Path], dict[str, bytes]]
    ways: tuple[Callable[[bytes, Rng], bytes], ...]
    forged: Callable[[dict[str, bytes]], Iterator[Case]]
    expect: str = ANY


# Meshes to write


def body(level: int = 2) -> Mesh:
    """A lopsided ball."""
    points, faces = icosphere(level)
    return Mesh(points * [1.0, 1.3, 0.8] + 0.2 * points[:, [0]] ** 2, faces)


TRIANGLE_PLY = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
FACE_PLY = "element face 1\nproperty list uchar int vertex_indices\nend_header\n"
ROWS = "0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n"
OBJ = (
    b"# made by hand\nmtllib skin.mtl\no body\ng limb\nusemtl skin\ns 1\nv 0 0 0 1 0 0\n"
    b"v 1 0 0 0 1 0\nv 0 1 \\\n0 0 0 1\nv 0.5 0.25 1e0 1 1 1\n"
    b"vt 0 0\nvt 1 0\nvt 0 1\nvn 0 0 1\nf 1/1/1 3/3/1 2/2/1\nf 1/1 2/2 4/3\nf -3//1 -2//1 -1//1\nf 3 1 4\nl 1 2\n"
)


def written(folder: Path, ending: str, mesh: Mesh, **how: Any) -> bytes:
    """The bytes of a mesh file."""
    write(folder / f"body{ending}", mesh, **how)
    return (folder / f"body{ending}").read_bytes()


def ply_text(mesh: Mesh) -> bytes:
    """A text PLY with colours, comments and an element that nobody knows."""
    colors = np.arange(mesh.n_vertices) % 256
    rows = "".join(f"{x!r} {y!r} {z!r} {c} 0 255\n" for (x, y, z), c in zip(mesh.vertices.tolist(), colors, strict=True))
    head = TRIANGLE_PLY.replace("vertex 3", f"vertex {mesh.n_vertices}").replace("float", "double")
    head += "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    face = FACE_PLY.replace("face 1", f"face {mesh.n_faces}").replace(
        "end_header\n", "element other 1\nproperty list uchar float x\nend_header\n"
    )
    return (head + "comment none\n" + face + rows + "".join(f"3 {a} {b} {c}\n" for a, b, c in mesh.faces.tolist()) + "2 0.5 1\n").encode()


def ply_mixed() -> bytes:
    """A big-endian PLY whose faces have different sizes."""
    head = (TRIANGLE_PLY + FACE_PLY).replace("ascii", "binary_big_endian").replace("face 1", "face 2").replace("vertex 3", "vertex 4")
    corners = struct.pack(">Biii", 3, 0, 1, 2) + struct.pack(">Biiii", 4, 0, 1, 2, 3)
    return head.encode() + np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], ">f4").tobytes() + corners


def ply_strips() -> bytes:
    """A PLY of triangle strips."""
    head = TRIANGLE_PLY.replace("vertex 3", "vertex 4") + "element tristrips 1\nproperty list int int vertex_indices\nend_header\n"
    return (head + "0 0 0\n1 0 0\n0 1 0\n1 1 1\n8 0 1 2 3 -1 1 2 0\n").encode()


def stl_text(mesh: Mesh) -> bytes:
    """A text STL."""
    facets = "".join(
        "facet normal 0 0 1\nouter loop\n" + "".join(f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in corners) + "endloop\nendfacet\n"
        for corners in mesh.vertices[mesh.faces].tolist()
    )
    return f"solid body\n{facets}endsolid body\n".encode()


def public(ending: str) -> dict[str, bytes]:
    """A small public mesh, where they are at hand."""
    import os

    names = {".obj": "bad/suzanne.obj", ".off": "meshes/decimated-knight.off"}
    path = Path(os.environ.get("MORPHLET_DATA", "-"), names.get(ending, "-"))
    return {"public": path.read_bytes()} if path.is_file() else {}


# Ways to change bytes


def flipped(data: bytes, rng: Rng) -> bytes:
    """Some bits."""
    out = bytearray(data)
    for _ in range(int(rng.integers(1, 9))):
        out[rng.integers(len(out))] ^= 1 << int(rng.integers(8))
    return bytes(out)


def overwritten(data: bytes, rng: Rng) -> bytes:
    """Noise, or zeros, in one place."""
    out, at, count = bytearray(data), int(rng.integers(len(data))), int(rng.integers(1, 40))
    out[at : at + count] = bytes(count) if rng.integers(2) else rng.integers(0, 256, count, dtype=np.uint8).tobytes()
    return bytes(out)


def deleted(data: bytes, rng: Rng) -> bytes:
    """Some bytes gone."""
    at = int(rng.integers(len(data)))
    return data[:at] + data[at + int(rng.integers(1, 30)) :]


def inserted(data: bytes, rng: Rng) -> bytes:
    """Some bytes more."""
    at = int(rng.integers(len(data)))
    return data[:at] + rng.integers(0, 256, int(rng.integers(1, 30)), dtype=np.uint8).tobytes() + data[at:]


def cut(data: bytes, rng: Rng) -> bytes:
    """The beginning."""
    return data[: rng.integers(len(data))]


def doubled(data: bytes, rng: Rng) -> bytes:
    """A block once more, somewhere."""
    a, b, at = (int(k) for k in rng.integers(0, len(data), 3))
    return data[:at] + data[min(a, b) : max(a, b)] + data[at:]


def other_words(data: bytes, rng: Rng) -> bytes:
    """Some numbers or words become others."""
    places = list(re.finditer(rb"[^\s,\[\]{}=\"]+", data))
    for found in sorted((places[k] for k in rng.integers(0, len(places), int(rng.integers(1, 4)))), key=lambda m: -m.start()):
        data = data[: found.start()] + WORDS[rng.integers(len(WORDS))] + data[found.end() :]
    return data


def other_lines(data: bytes, rng: Rng) -> bytes:
    """A line gone, twice, elsewhere, or cut."""
    lines = data.split(b"\n")
    a, b, what = (int(k) for k in (*rng.integers(0, len(lines), 2), rng.integers(4)))
    if what == 0:
        del lines[a]
    elif what == 1:
        lines.insert(b, lines[a])
    elif what == 2:
        lines[a], lines[b] = lines[b], lines[a]
    else:
        lines[a] = lines[a][: int(rng.integers(len(lines[a]) + 1))]
    return b"\n".join(lines)


BYTES = (flipped, overwritten, deleted, inserted, cut, doubled)
TEXT = (*BYTES, other_words, other_words, other_words, other_lines, other_lines)


def headed(data: bytes, rng: Rng) -> bytes:
    """Words and lines of the header of a PLY or a glTF file."""
    end = max(data.find(b"end_header") + 11, 100)
    return (other_words, other_lines)[int(rng.integers(2))](data[:end], rng) + data[end:]


def other_tree(data: bytes, rng: Rng) -> bytes:
    """The JSON of a glTF file with some values changed, gone, or twice; the lengths made to fit."""
    tree, binary = parted(data)
    for _ in range(int(rng.integers(1, 4))):
        places = list(walked(tree))
        if not places:
            break
        box, key = places[rng.integers(len(places))]
        what = int(rng.integers(6))
        if what == 0:
            del box[key]
        elif what == 1 and isinstance(box, list):
            box.append(copy.deepcopy(box[key]))
        else:
            other = places[rng.integers(len(places))]
            box[key] = copy.deepcopy(other[0][other[1]]) if what == 2 else VALUES[rng.integers(len(VALUES))]
    return packed(tree, binary, data[:4] == b"glTF")


def walked(tree: Any) -> Iterator[tuple[Any, Any]]:
    """All places in JSON."""
    for key in list(tree) if isinstance(tree, dict) else range(len(tree)) if isinstance(tree, list) else ():
        yield tree, key
        yield from walked(tree[key])


def parted(data: bytes) -> tuple[Any, bytes]:
    """JSON and binary chunk of a glTF file."""
    if data[:4] != b"glTF":
        return json.loads(data), b""
    length = int.from_bytes(data[12:16], "little")
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def packed(tree: Any, binary: bytes, as_binary: bool = True) -> bytes:
    """A glTF file of these."""
    text = json.dumps(tree).encode()
    if not as_binary:
        return text
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return b"glTF" + struct.pack("<II", 2, 12 + len(chunks)) + chunks


def other_arrays(data: bytes, rng: Rng) -> bytes:
    """An `.npz` file in which some arrays are of another type, shape or content, or are not there."""
    with np.load(io.BytesIO(data), allow_pickle=False) as file:
        arrays = {name: np.array(file[name]) for name in file.files}
    for name in rng.choice(sorted(arrays), int(rng.integers(1, 3)), replace=False).tolist():
        changed = changed_array(arrays[name], int(rng.integers(12)), rng)
        if changed is None:
            del arrays[name]
        else:
            arrays[name] = changed
    return zipped(arrays)


def changed_array(array: np.ndarray, what: int, rng: Rng) -> np.ndarray | None:
    """One array changed in one of twelve ways."""
    if what == 0:
        return None
    if what < 5:
        kind = ["f4", "i8", "u1", "U5", "c16", "M8[s]", "?", "V8", "S3"][rng.integers(9)]
        try:
            with np.errstate(all="ignore"):
                return array.astype(kind)
        except (TypeError, ValueError):
            return np.zeros(array.shape, kind)
    if what < 8:
        return [array.ravel(), array[None], array[:-1] if array.ndim else array[None], array.T, np.zeros(0), np.array(7)][rng.integers(6)]
    out = np.array(array).reshape(-1) if array.dtype.kind in "biuf" else np.zeros(3)
    if len(out):
        values = [-1, 0, 1, 2**31, 10**18] if out.dtype.kind in "iu" else [np.nan, np.inf, 1e308, -1e308, 0.0, 5e-324]
        with np.errstate(all="ignore"):
            out[rng.integers(0, len(out), int(rng.integers(1, 4)))] = np.array(values[rng.integers(len(values))]).astype(out.dtype)
    return out.reshape(array.shape) if array.dtype.kind in "biuf" else out


def zipped(arrays: dict[str, np.ndarray]) -> bytes:
    """An `.npz` file."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def forged_zip(members: dict[str, Any], method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """An archive of these members: bytes, so many zeros, or both."""
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", method, compresslevel=1) as archive:
        for name, data in members.items():
            with archive.open(name, "w", force_zip64=True) as file:
                before, left = data if isinstance(data, tuple) else (b"", data) if isinstance(data, int) else (data, 0)
                file.write(before)
                while left > 0:
                    file.write(bytes(min(left, 1 << 22)))
                    left -= 1 << 22
    return stream.getvalue()


def head_of(shape: tuple[int, ...], kind: str = "<f8") -> bytes:
    """The header of an `.npy` file."""
    stream = io.BytesIO()
    np.lib.format.write_array_header_1_0(stream, {"descr": kind, "fortran_order": False, "shape": shape})
    return stream.getvalue()


# Files made by hand


def rewrapped(name: str, data: bytes, numbers: bool = True) -> Iterator[Case]:
    """The same text as other systems and programs write it."""
    ways = {
        "CRLF": data.replace(b"\n", b"\r\n"),
        "byte order mark": b"\xef\xbb\xbf" + data,
        "no last newline": data.rstrip(b"\n"),
        "blank lines at the end": data + b"\n\n  \n",
        "CR": data.replace(b"\\\n", b" ").replace(b"\n", b"\r"),
    }
    if numbers:
        ways["scientific notation"] = re.sub(rb"(?<=[ \n])-?\d+\.\d+(?=[ \n])", lambda m: f"{float(m[0]):.17E}".encode(), data)
        ways["signs and zeros"] = re.sub(rb"(?<= )(\d+\.\d+)(?=[ \n])", rb"+0\g<1>0", data)
    for way, text in ways.items():
        yield Case(way, text, SAME, name)
    if numbers:
        yield Case("decimal commas", re.sub(rb"(\d)\.(\d)", rb"\1,\2", data), REFUSED, name)
        yield Case("UTF-16", data.decode("latin-1").encode("utf-16"), REFUSED, name)
    yield Case("UTF-32", data.decode("latin-1").encode("utf-32"), REFUSED, name)


def obj_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    yield from rewrapped("rich", sound["rich"])
    yield from rewrapped("body", sound["body"])
    tri = b"v 0 0 0\nv 1 0 0\nv 0 1 0\n"
    for name, text in {
        "index 0": b"f 0 1 2\n", "index beyond": b"f 1 2 4\n", "negative beyond": b"f -1 -2 -4\n",
        "huge index": b"f 1 2 99999999999999999999\n",
        "2^63": b"f 1 2 9223372036854775807\n", "before its vertices": b"", "real index": b"f 1 2 3.0\n",
        "1e999": b"v 1e999 0 0\nf 1 2 3\n",
        "nan": b"v nan 0 0\nf 1 2 3\n", "comma": b"v 1,5 0 0\nf 1 2 3\n", "no faces": b"",
        "two numbers": b"v 1 2\nf 1 2 3\n", "NUL": b"v 0 0 \x001\nf 1 2 3\n",
    }.items():  # fmt: skip
        yield Case(name, tri + text, REFUSED)
    yield Case("face before vertices by negative index", b"f -1 -2 -3\n" + tri, REFUSED)
    for library in (f"../{ELSEWHERE}", "/etc/passwd", "C:\\x.mtl", "http://localhost/x.mtl"):
        yield Case(f"mtllib {library}", sound["body"] + b"mtllib " + library.encode() + b"\n", SAME, "body")
    yield Case("Latin-1 names", b"g \xe9t\xe9\n" + sound["body"], SAME, "body")
    yield Case("a long line", b"# " + b"x" * 10**7 + b"\n" + sound["body"], SAME, "body")
    yield Case("backslashes", sound["body"] + b"g " + b"\\" * 300_000 + b"\n", SAME, "body")
    yield Case("continued without end", sound["body"] + b"#\n" + b"g \\\n" * 200_000, SAME, "body")
    yield Case("a polygon of 200000 corners", tri + b"f" + b" 1 2 3" * 66_667 + b"\n", ANY)
    yield Case("slashes", tri + b"f 1/2/3/4 2//////// 3/" + b"/" * 10**6 + b"\n", ANY)


def off_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    for name in sound:
        yield from rewrapped(name, sound[name]) if name == "body" else ()
    for counts in (
        "999999999999 1 0",
        "1 999999999999 0",
        "-1 1 0",
        "1e300 1 0",
        "3.5 1 0",
        "nan 1 0",
        "9223372036854775807 9223372036854775807 0",
        "3",
    ):
        yield Case(f"counts {counts}", f"OFF\n{counts}\n{ROWS}".encode(), REFUSED)
    yield Case("4OFF", b"4OFF\n3 1 0\n" + ROWS.encode(), REFUSED)
    yield Case("binary", b"OFF BINARY\n" + bytes(60), REFUSED)
    yield Case("a million comments", b"# x\n" * 10**6 + sound["body"], SAME, "body")
    yield Case("a million blank lines", b"\n" * 10**6 + sound["body"], SAME, "body")


def ply_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    yield from rewrapped("text", sound["text"])
    head = TRIANGLE_PLY + FACE_PLY
    for ascii_too in (head + ROWS, head.replace("ascii", "binary_little_endian") + "\0" * 60):
        for count in ("999999999999", "99999999999999999999", "-1", "2147483648", "1e3", "0x3", ""):
            for element in ("vertex 3", "face 1"):
                forged = ascii_too.replace(element, f"{element.split()[0]} {count}")
                yield Case(f"{element.split()[0]} count '{count}' {ascii_too[11:17]}", forged.encode(), REFUSED)
    yield Case(
        "a list of 2^31-1",
        (head.replace("uchar", "int").replace("ascii", "binary_little_endian")).encode() + bytes(36) + b"\xff\xff\xff\x7f",
        REFUSED,
    )
    yield Case(
        "a list of -1", (head.replace("uchar", "int").replace("ascii", "binary_little_endian")).encode() + bytes(36) + b"\xff" * 4, REFUSED
    )
    yield Case("a list counted by reals", (head.replace("uchar", "float") + ROWS).encode(), REFUSED)
    yield Case("a property twice", (head.replace("float y", "float x") + ROWS).encode(), REFUSED)
    many = "".join(f"property uchar p{k}\n" for k in range(20_000))
    wide = TRIANGLE_PLY + many + FACE_PLY
    yield Case(
        "20000 properties", (wide + "".join(f"{row} {'0 ' * 20_000}\n" for row in ROWS.splitlines()[:3]) + "3 0 1 2\n").encode(), ANY
    )
    elements = "".join(f"element e{k} 0\n" for k in range(20_000))
    yield Case("20000 elements", (TRIANGLE_PLY + elements + FACE_PLY + ROWS).encode(), ANY)
    yield Case("a header of blank lines", (TRIANGLE_PLY + "\n" * 200_000 + FACE_PLY + ROWS).encode(), ANY)
    yield Case("a header of blanks", (TRIANGLE_PLY + " " * 200_000 + "\n" + FACE_PLY + ROWS).encode(), ANY)
    yield Case("a header without end", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 10**6, REFUSED)
    yield Case("control characters in the header", b"ply\nformat \x1b[31mascii 1.0\nend_header\n", REFUSED)
    yield Case("control characters in a name", (TRIANGLE_PLY + "element \x1b[2J 2\nproperty float q\n" + FACE_PLY + ROWS).encode(), REFUSED)
    yield Case(
        "an element of a billion rows without properties", (TRIANGLE_PLY + "element e 999999999999\n" + FACE_PLY + ROWS).encode(), ANY
    )


def stl_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    yield from rewrapped("text", sound["text"])
    for count in (0xFFFFFFFF, 0, 1, 2**31):
        yield Case(f"count {count}", sound["binary"][:80] + struct.pack("<I", count) + sound["binary"][84:], REFUSED)
    yield Case("binary that says solid", b"solid body\n".ljust(80) + sound["binary"][80:], SAME, "binary")
    yield Case("binary with a byte order mark", b"\xef\xbb\xbf".ljust(80) + sound["binary"][80:], SAME, "binary")
    yield Case("NaN", sound["binary"][:96] + b"\xff" * 4 + sound["binary"][100:], REFUSED)
    yield Case("solid and nothing", b"solid" + b" " * 10**6, REFUSED)
    yield Case("capitals", sound["text"].upper().replace(b"E-", b"e-"), SAME, "text")


def edited(data: bytes, **changes: Any) -> bytes:
    """A glTF file with these values, `accessors__0__count=5` by their paths."""
    tree, binary = parted(data)
    for path, value in changes.items():
        *way, last = (int(key) if key.isdigit() else key for key in path.split("__"))
        box = tree
        for key in way:
            box = box[key]
        box[last] = value
    return packed(tree, binary, data[:4] == b"glTF")


def gltf_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    glb, text = sound["animated"], sound["text"]
    uris = [
        f"../{ELSEWHERE}",
        f"..%2F{ELSEWHERE}",
        f"%2e%2e/{ELSEWHERE}",
        "/etc/passwd",
        "file:///etc/passwd",
        "http://127.0.0.1:9/x.bin",
        "data:,",
    ]
    uris += [
        "data:;base64,!!!",
        "data:;base64",
        "",
        ".",
        "..",
        "\0",
        "x" * 5000,
        "~/x",
        "//host/x",
        "C:\\x",
        f"a/../../{ELSEWHERE}",
        "gone.bin",
        7,
        None,
        [],
        "\ud800",
    ]
    for uri in uris:
        yield Case(f"uri {str(uri)[:30]!a}", edited(text, buffers__0__uri=uri), REFUSED)
    yield Case("uri beside", edited(text, buffers__0__uri="x%20y.bin"), SAME, "text", {"x y.bin": text_buffer(text)})
    yield Case("uri of a link out of the folder", edited(text, buffers__0__uri="x.bin"), REFUSED, links={"x.bin": f"../{ELSEWHERE}"})
    yield Case("uri of a link to a device", edited(text, buffers__0__uri="x.bin"), REFUSED, links={"x.bin": "/dev/zero"})
    yield Case("uri of a link to itself", edited(text, buffers__0__uri="x.bin"), REFUSED, links={"x.bin": "x.bin"})
    yield Case("image uri out of the folder", edited(glb, images=[{"uri": "../../etc/passwd"}], textures=[{"source": 0}]), SAME, "animated")
    yield Case("uri of an endless pipe", edited(text, buffers__0__uri="pipe"), REFUSED, links={"pipe": "<pipe>"})
    for key in ("count", "byteOffset", "componentType", "type", "bufferView"):
        for value in (-1, 10**12, 2**63, 1.5, "x", None, 1e308, float("nan")):
            if not (key == "byteOffset" and value is None):
                yield Case(f"accessor {key} {value}", edited(text, **{f"accessors__0__{key}": value}), REFUSED)
    for key, value in (
        ("byteLength", 1),
        ("byteLength", 10**12),
        ("byteOffset", -4),
        ("byteOffset", 10**12),
        ("byteStride", 0),
        ("byteStride", 1),
        ("byteStride", -12),
        ("buffer", 5),
        ("buffer", -9),
    ):
        yield Case(f"view {key} {value}", edited(text, **{f"bufferViews__0__{key}": value}), REFUSED)
    yield from amplified(glb, text)
    sparse = {"count": 10**12, "indices": {"bufferView": 0, "componentType": 5125}, "values": {"bufferView": 0}}
    yield Case("sparse count 10^12", edited(text, accessors__0__sparse=sparse), REFUSED)
    yield Case("sparse without data", edited(text, accessors__0__sparse={"count": 1}), REFUSED)
    yield Case("rows without data", edited(text, accessors__0={"componentType": 5126, "count": 10**9, "type": "VEC3"}), REFUSED)
    yield Case("a node below itself", edited(text, nodes=[{"mesh": 0, "children": [0]}]), REFUSED)
    yield Case("nested JSON", b'{"asset":' + b"[" * 200_000 + b"]" * 200_000 + b"}", REFUSED)
    yield Case("a number of 100000 digits", text.replace(b'"count": 3', b'"count": 3' + b"0" * 100_000, 1), REFUSED)
    yield Case("a matrix of NaN", edited(text, nodes=[{"mesh": 0, "matrix": [float("nan")] * 16}]), REFUSED)
    yield Case("a matrix of 1e308", edited(text, nodes=[{"mesh": 0, "matrix": [1e308] * 16}]), ANY)
    yield Case("chunk longer than the file", glb[:12] + struct.pack("<I", 2**32 - 1) + glb[16:], REFUSED)
    yield Case("length 0", glb[:8] + bytes(4) + glb[12:], ANY)
    yield Case("byte order mark", b"\xef\xbb\xbf" + text, SAME, "text")
    yield Case("target named for the terminal", edited(glb, meshes__0__extras={"targetNames": ["\x1b[2J", "../../x"]}), ANY)


def amplified(glb: bytes, text: bytes) -> Iterator[Case]:
    """Small files that would unfold to large ones."""
    yield Case(
        "300000 nodes of one mesh",
        edited(glb, nodes=[{"mesh": 0}] * 300_000, scenes=[{"nodes": list(range(300_000))}], animations=[]),
        REFUSED,
    )
    tree, _ = parted(glb)
    primitive = {key: value for key, value in tree["meshes"][0]["primitives"][0].items() if key != "targets"}
    yield Case("300000 primitives", edited(glb, meshes=[{"primitives": [primitive] * 300_000}], animations=[]), REFUSED)
    targets = tree["meshes"][0]["primitives"][0]["targets"][:1]
    yield Case("30000 targets", edited(glb, meshes=[{"primitives": [primitive | {"targets": targets * 30_000}]}], animations=[]), ANY)
    yield Case("30000 empty targets", edited(glb, meshes=[{"primitives": [primitive | {"targets": [{}] * 30_000}]}], animations=[]), ANY)
    uri = json.loads(text)["buffers"][0]["uri"]
    yield Case("50000 buffers of one chunk", edited(glb, buffers=[parted(glb)[0]["buffers"][0]] * 50_000), ANY)
    yield Case(
        "3000 buffers of one large file",
        edited(text, buffers=[{"byteLength": 36, "uri": uri}] + [{"byteLength": 1 << 20, "uri": "x.bin"}] * 3000),
        ANY,
        "",
        {"x.bin": bytes(1 << 20)},
    )


def text_buffer(text: bytes) -> bytes:
    """The buffer within a glTF text."""
    import base64

    return base64.b64decode(json.loads(text)["buffers"][0]["uri"].split(",", 1)[1])


def npz_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    for name, data in sound.items():
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            arrays = {key: np.array(file[key]) for key in file.files}
        first = next(key for key in arrays if key not in ("kind", "version") and arrays[key].ndim)
        plain = {f"{key}.npy": npy(array) for key, array in arrays.items()}
        if name == "map":
            yield Case(f"{name}: 1 GB of zeros beside", lambda: forged_zip({"zeros": BOMB}), REFUSED, name)
            yield Case(f"{name}: points of 1 GB", lambda: forged_zip({"points.npy": (head_of((BOMB // 24, 3)), BOMB)}), REFUSED, name)
        yield Case(f"{name}: header of 8 TB", forged_zip(plain | {f"{first}.npy": head_of((10**12,))}), REFUSED, name)
        yield Case(f"{name}: header of 10^300", forged_zip(plain | {f"{first}.npy": head_of((10**300,))}), REFUSED, name)
        yield Case(f"{name}: pickled objects", zipped(arrays | {first: np.array([Path("x"), None], dtype=object)}), REFUSED, name)
        yield Case(f"{name}: bare pickle", pickled(), REFUSED, name)
        yield Case(f"{name}: pickle within", forged_zip(plain | {f"{first}.npy": pickled()}), REFUSED, name)
        yield Case(
            f"{name}: names out of the folder",
            forged_zip(plain | {"../../escaped.npy": npy(np.zeros(2)), "/escaped.npy": npy(np.zeros(2))}),
            ANY,
            name,
        )
        yield Case(
            f"{name}: 20000 members",
            forged_zip(plain | {f"x{k}.npy": npy(np.zeros(1)) for k in range(20_000)}, zipfile.ZIP_STORED),
            ANY,
            name,
        )
        yield Case(f"{name}: stored", forged_zip(plain, zipfile.ZIP_STORED), SAME, name)
        for key, value in (
            ("kind", np.zeros((3, 3))),
            ("kind", np.array(5)),
            ("version", np.zeros(3)),
            ("version", np.array("x")),
            ("version", np.array(99)),
            ("version", np.array(np.nan)),
        ):
            yield Case(
                f"{name}: {key} {value.shape} {value.dtype}", zipped(arrays | {key: value}), REFUSED if name != "values" else ANY, name
            )


def npy(array: np.ndarray) -> bytes:
    stream = io.BytesIO()
    np.save(stream, array, allow_pickle=False)
    return stream.getvalue()


class Ran:
    """Would leave a trace when it is unpickled."""

    def __reduce__(self) -> tuple[Any, ...]:
        return exec, ("open('unpickled', 'w')",)


def pickled() -> bytes:
    """A pickle that would run code; written here, read nowhere."""
    import pickle

    return pickle.dumps(Ran())


def columns_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    yield Case("npy of 8 TB", head_of((10**12,)), REFUSED)
    yield Case("npy of 10^300", head_of((10**300,)), REFUSED)
    yield Case("npy of objects", np_object(), REFUSED)
    yield Case("npy header of nested brackets", b"\x93NUMPY\x01\x00" + struct.pack("<H", 9000) + b"[" * 9000, REFUSED)
    yield Case(
        "npy header that calls",
        b"\x93NUMPY\x01\x00" + struct.pack("<H", 60) + b"__import__('os').system('touch unpickled')".ljust(60),
        REFUSED,
    )
    yield Case("npy of a large type", head_of((162,), "<U2000000"), REFUSED)
    yield Case("pickle", pickled(), REFUSED)


def np_object() -> bytes:
    stream = io.BytesIO()
    np.save(stream, np.array([Ran()], dtype=object), allow_pickle=True)
    return stream.getvalue()


def csv_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    data = sound["markers"]
    yield from rewrapped("markers", data, numbers=False)
    yield Case("UTF-16", data.decode().encode("utf-16"), REFUSED)
    yield Case("semicolons", data.replace(b",", b";"), REFUSED)
    yield Case("tabs", data.replace(b",", b"\t"), REFUSED)
    yield Case("all in quotes", re.sub(rb"[^,\n]+", rb'"\g<0>"', sound["plain"]), SAME, "plain")
    yield Case("blanks", re.sub(rb"(?m)^(\d+),(\d+)", rb" \1 , \2 ", data), SAME, "markers")
    for cell in ("-1", "1.5", "1e3", "99999999999999999999", "0x1", "1_0", "\u0661", "", "nan", "=1+1"):
        yield Case(f"index {cell!a}", f"source,target\n{cell},1\n".encode(), REFUSED)
    for cell in ("0", "-1", "nan", "inf", "1e999", "x", "1,5", ""):
        yield Case(f"weight {cell!r}", f"source,target,weight\n1,1,{cell}\n".encode(), REFUSED)
    yield Case("an open quote", data + b'1,1,1,"' + b"x\n" * 10**6, REFUSED)
    yield Case("NUL", data.replace(b"1", b"\0", 1), REFUSED)
    yield Case("Latin-1", data + b"1,1,1,\xe9\n", REFUSED)
    yield Case("a cell of 1 MB", data + b"1,1,1," + b"x" * 10**6 + b"\n", ANY)
    yield Case("CR in a label", data + b'1,1,1,"a\rb"\n', ANY)


def table_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    data = sound["table"]
    yield from rewrapped("table", data, numbers=False)
    yield Case("all in quotes", re.sub(rb"[^,\n]+", rb'"\g<0>"', data), SAME, "table")
    yield Case("semicolons", data.replace(b",", b";"), ANY)
    yield Case("no head", data.split(b"\n", 1)[1], ANY)
    yield Case("a name twice", data.replace(b"weight", b"bone"), REFUSED)
    yield Case("1e999", data.replace(b",0.5", b",1e999"), REFUSED)
    yield Case("nan", data.replace(b",0.5", b",nan"), REFUSED)
    yield Case("an empty number", data.replace(b",0.5", b","), REFUSED)
    yield Case("too few rows", data[: len(data) // 2].rsplit(b"\n", 1)[0] + b"\n", REFUSED)


def toml_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    for name, data in sound.items():
        for case in rewrapped(name, data, numbers=False):
            yield case if case.name != "CR" else Case(case.name, case.data, REFUSED, name)
        yield Case(f"{name}: UTF-16", data.decode().encode("utf-16"), REFUSED)
    whole = next(iter(sound.values()))
    yield Case("nested lists", whole + b"\nx = " + b"[" * 100_000 + b"]" * 100_000, REFUSED)
    yield Case("nested tables", whole + b"\nx = " + b"{a=" * 100_000 + b"1" + b"}" * 100_000, REFUSED)
    yield Case("dotted keys", whole + b"\n" + b".".join([b"a"] * 100_000) + b" = 1\n", REFUSED)
    yield Case("a number of 100000 digits", whole + b"\nx = " + b"9" * 100_000 + b"\n", REFUSED)
    yield Case("unknown key", whole + b"\nimport = 'os'\n", REFUSED)
    yield Case("Latin-1", whole + b"\n# \xe9\n", REFUSED)


def edit_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    yield from toml_cases(sound)
    yield Case("a key twice", sound["arap"] + b"weight = 2.0\n", REFUSED)
    rest = b"handle = [0, 1, 2]\nroi = {radius = '40%'}\n"
    far = (b"1e308", b"-1e308", b"1e200", b"inf", b"nan", b"9" * 400)
    for number in far:
        yield Case(
            f"translate {number[:9].decode()}",
            rest + b"translate = [" + number + b", 0, 0]\n",
            ANY if number.startswith((b"1e2", b"-1e", b"1e3")) else REFUSED,
        )
        yield Case(f"scale {number[:9].decode()}", rest + b"scale = " + number + b"\n", ANY if b"e" in number else REFUSED)
    still = rest + b"translate = [0.1, 0, 0]\n"
    for line in (
        "iterations = 1000000000000",
        "method = 'dual'\niterations = 1000000000000",
        "method = 'dual'\niterations = -1",
        "method = ['arap']",
        "method = {a = 1}",
        "weight = 1e308",
        "weight = 1e-308",
        "weight = 0",
        "weight = -1",
        "smoothing = 1e308",
        "smoothing = -1",
    ):
        yield Case(
            line.replace("\n", "; "), line.encode() + b"\n" + still, REFUSED if "weight = 1e" not in line and "g = 1e" not in line else ANY
        )
    for lattice in (
        "[1000000, 1000000, 1000000]",
        "[0, 1, 1]",
        "[-1, 2, 2]",
        "[1.5, 2, 2]",
        "'x'",
        "[]",
        "[2]",
        "[1000000000000000000000, 2, 2]",
        "[300, 300, 300]",
    ):
        yield Case(f"lattice {lattice}", b"method = 'ffd'\n" + still + b"[ffd]\nlattice = " + lattice.encode() + b"\n", REFUSED)
    for alpha in ("1e308", "-1", "nan", "'x'", "0"):
        yield Case(
            f"alpha {alpha}",
            b"method = 'mls'\n" + still + b"[mls]\nalpha = " + alpha.encode() + b"\n",
            ANY if alpha in ("1e308", "0", "-1") else REFUSED,
        )
    yield Case("handle of 10^6 numbers", b"translate = [0, 0, 1]\nroi = {radius = 1.0}\nhandle = [" + b"0," * 10**6 + b"]\n", REFUSED)
    yield Case("a path of 5000 frames", b"handle = [0, 1, 2]\nanchors = [50]\npath = [" + b"{translate = [0, 0, 1]}," * 5_000 + b"]\n", ANY)


def mlw_cases(sound: dict[str, bytes]) -> Iterator[Case]:
    for name, data in sound.items():
        yield Case(f"{name}: twice", data + data, REFUSED, name)
        yield Case(f"{name}: byte order mark", b"\xef\xbb\xbf" + data, REFUSED, name)
        yield Case(f"{name}: a byte more", data + b"\0", REFUSED, name)


# Sound files


def obj_files(folder: Path) -> dict[str, bytes]:
    return {"rich": OBJ, "body": written(folder, ".obj", body(), colors=np.full((162, 3), 9, np.uint8))} | public(".obj")


def off_files(folder: Path) -> dict[str, bytes]:
    colored = b"COFF # made\n4 2 0\n0 0 0 255 0 0\n1 0 0 9 9 9\n0 1 0 1 2 3\n0 0 1 4 5 6\n3 0 1 2\n4 0 1 2 3 1 2 3\n"
    return {"body": written(folder, ".off", body()), "colored": colored} | public(".off")


def ply_files(folder: Path) -> dict[str, bytes]:
    binary = written(folder, ".ply", body(), colors=np.full((162, 3), 9, np.uint8))
    return {"text": ply_text(body(1)), "strips": ply_strips(), "binary": binary, "mixed": ply_mixed()}


def stl_files(folder: Path) -> dict[str, bytes]:
    return {"text": stl_text(body(1)), "binary": written(folder, ".stl", body(1))}


def gltf_files(folder: Path) -> dict[str, bytes]:
    mesh = body(1)
    frames = MeshSequence(mesh.topology, np.stack([mesh.vertices * (1 + k / 4) for k in range(3)]), np.arange(3.0))
    write_animation(folder / "a.glb", frames, colors=np.full((42, 3), 9, np.uint8), names=("rest", "a", "b"))
    return {"animated": (folder / "a.glb").read_bytes(), "text": gltf_text()}


def gltf_text() -> bytes:
    """A glTF text with two nodes, a sparse accessor and its buffer within."""
    import base64

    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], "<f4").tobytes()
    buffer = (
        positions
        + np.array([0, 2], "<u2").tobytes()
        + np.array([[0, 0, 2], [0, 2, 0]], "<f4").tobytes()
        + np.array([0, 1, 2], "<u4").tobytes()
    )
    tree = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}],
        "nodes": [{"children": [1, 2]}, {"mesh": 0, "translation": [0, 0, 3]}, {"mesh": 0, "scale": [2, 2, 2], "rotation": [0, 0, 0, 1]}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}, "indices": 1, "mode": 4}]}],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3",
             "sparse": {"count": 2, "indices": {"bufferView": 1, "componentType": 5123}, "values": {"bufferView": 2}}},
            {"bufferView": 3, "componentType": 5125, "count": 3, "type": "SCALAR"},
        ],
        "bufferViews": [{"buffer": 0, "byteOffset": start, "byteLength": length}
                        for start, length in ((0, 36), (36, 4), (40, 24), (64, 12))],
        "buffers": [{"byteLength": len(buffer), "uri": "data:application/octet-stream;base64," + base64.b64encode(buffer).decode()}],
    }  # fmt: skip
    return json.dumps(tree).encode()


def npz_files(folder: Path) -> dict[str, bytes]:
    """One of each kind that is read back. Their names tell the kind."""
    mesh = body()
    write(folder / "mesh.ply", mesh)
    mapped = spherical_map(mesh)
    mapped.save(folder / "map.npz")
    Correspondence(mesh, mesh, SurfacePoints(np.arange(162) % 320, np.full((162, 3), 1 / 3)), np.ones(162, bool)).save(
        folder / "correspondence.npz"
    )
    approximate_by_rows(mapped, 17).save(folder / "rows.npz")
    found = approximate(mapped, mapped.mesh.vertices, 20)
    found.save(folder / "surface.npz")
    found.network.save(folder / "spherical.npz")
    spherical_image(mapped, 9).save(folder / "image.npz")
    small_network().save(folder / "network.npz")
    np.savez_compressed(folder / "values.npz", weight=np.linspace(0, 1, 162), bone=np.array(["hip", "knee"] * 81))
    return {path.stem: path.read_bytes() for path in sorted(folder.glob("*.npz"))}


def small_network() -> WaveletNetwork:
    """A network of three wavelets."""
    from morphlet import MOTHERS

    return WaveletNetwork((MOTHERS["beta2"],), np.zeros(3, np.int64), np.zeros(3), np.ones(3), np.ones((3, 1)), np.ones((2, 1)))


def column_files(folder: Path) -> dict[str, bytes]:
    write(folder / "mesh.ply", body())
    return {"values": npy(np.linspace(0, 1, 162)), "colors": npy(np.zeros((162, 3), np.uint8))}


def pairs_files(folder: Path) -> dict[str, bytes]:
    write_pairs(folder / "m.csv", VertexPairs([7, 12, 3], [1, 2, 3], [0.5, 1, 2], ('nose, "left"', "", "ear")))
    return {"markers": (folder / "m.csv").read_bytes(), "plain": b"source,target\n0,1\n2,3\n"}


def table_files(folder: Path) -> dict[str, bytes]:
    write(folder / "mesh.ply", body())
    return {"table": ("bone,weight,name\n" + "".join(f"{k % 7},{k + 0.5},b{k % 3}\n" for k in range(162))).encode()}


def schedule_files(folder: Path) -> dict[str, bytes]:
    Schedule.coarse_first(3).write(folder / "s.toml")
    return {"schedule": (folder / "s.toml").read_bytes()}


def edit_files(folder: Path) -> dict[str, bytes]:
    write(folder / "mesh.ply", body())
    still = "handle = [0, 1, 2]\nroi = {radius = '40%', metric = 'geodesic'}\n"
    pulled = still + "translate = [0.1, 0.0, 0.2]\n"
    texts = {
        "arap": "method = 'arap'\nsmoothing = 0.0002\nweight = 2.0\n"
        + still
        + "rotate = {axis = [0, 0, 1], degrees = 30, center = 'handle'}\n",
        "biharmonic": "method = 'biharmonic'\nhandle = {center = [1.0, 0.0, 0.0], radius = 0.5}\n"
        "anchors = {center = [-1.0, 0.0, 0.0], radius = 0.5}\nscale = 1.1\n",
        "dual": "method = 'dual'\niterations = 2\n" + pulled,
        "mls": "method = 'mls'\n" + pulled + "[mls]\nkind = 'rigid'\nalpha = 1.5\n",
        "ffd": "method = 'ffd'\n" + pulled + "[ffd]\nlattice = [3, 3, 3]\nbasis = 'bernstein'\n",
        "direct": "method = 'direct'\nfalloff = 'wendland'\n" + pulled,
        "path": "method = 'laplacian'\n" + still + "path = [{translate = [0, 0, 0.1]}, {targets = [[0, 0, 1], [0, 1, 0], [1, 0, 0]]}]\n",
    }
    return {name: text.encode() for name, text in texts.items()}


def mlw_files(folder: Path) -> dict[str, bytes]:
    from codec_fuzz import files

    return files()


def codec_ways() -> tuple[Callable[[bytes, Rng], bytes], ...]:
    """Those of `codec_fuzz`, which makes checksums fit again."""
    import codec_fuzz

    return (*codec_fuzz.BROKEN, *codec_fuzz.FORGED)


READERS = {
    reader.name: reader
    for reader in (
        Reader("obj", obj_files, TEXT, obj_cases),
        Reader("off", off_files, TEXT, off_cases),
        Reader("ply", ply_files, (*TEXT, headed, headed), ply_cases),
        Reader("stl", stl_files, TEXT, stl_cases),
        Reader("gltf", gltf_files, (*BYTES, *[other_tree] * 12), gltf_cases),
        Reader("npz", npz_files, (*BYTES, *[other_arrays] * 8), npz_cases),
        Reader("npy", column_files, (*BYTES, headed), columns_cases),
        Reader("pairs.csv", pairs_files, TEXT, csv_cases),
        Reader("table.csv", table_files, TEXT, table_cases),
        Reader("edit.toml", edit_files, TEXT, edit_cases),
        Reader("schedule.toml", schedule_files, TEXT, toml_cases),
        Reader("mlw", mlw_files, (), mlw_cases),
    )
}


def cases(reader: Reader, sound: dict[str, bytes], random: int, seed: int) -> Iterator[Case]:
    """The sound files themselves, those made by hand, and so many that were changed at random."""
    for name, data in sound.items():
        yield Case(f"{name} as it is", data, SAME, name)
    yield from reader.forged(sound)
    ways, rng, names = reader.ways or codec_ways(), np.random.default_rng(seed), sorted(sound)
    for k in range(random):
        name, way = names[k % len(names)], ways[int(rng.integers(len(ways)))]
        checked = (reader.name == "mlw" and way in ways[:4]) or (reader.name == "npz" and way in BYTES)
        yield Case(f"{k}: {name} {way.__name__}", way(sound[name], rng), SOUND if checked else reader.expect, name)


def laid(reader: Reader, folder: Path, random: int, seed: int, skipped: Sequence[str] = ()) -> Iterator[tuple[str, Task]]:
    """The tasks of a reader: each file is put into a folder of its own, and taken away after the next was asked for."""
    seeds = folder / "sound"
    seeds.mkdir(parents=True)
    sound = reader.sound(seeds)
    ending = Path(f"x.{reader.name}").suffix
    for name, data in sound.items():
        (seeds / f"{name}-sound{ending}").write_bytes(data)
    (folder / ELSEWHERE).write_bytes(bytes(100))
    place = folder / "hostile"
    for case in cases(reader, sound, random, seed):
        if any(word in case.name for word in skipped):
            continue
        shutil.rmtree(place, ignore_errors=True)
        place.mkdir()
        lay(place, case, ending)
        told = {"reader": reader.name, "file": str(place / f"x{ending}"), "expect": case.expect, "name": case.name}
        yield case.name, told | {"seed": str(seeds / f"{case.seed}-sound{ending}") if case.seed else "", "sound": str(seeds)}


def lay(place: Path, case: Case, ending: str) -> None:
    """A hostile file and what lies beside it."""
    import os

    (place / f"x{ending}").write_bytes(case.data if isinstance(case.data, bytes) else case.data())
    for name, data in case.beside.items():
        (place / name).write_bytes(data)
    for name, target in case.links.items():
        if target == "<pipe>":
            os.mkfifo(place / name)
        else:
            (place / name).symlink_to(target)


# The judge, which runs in a worker


def attempt(task: Task) -> tuple[str, str]:
    """Read a file; tell what became of it."""
    opened, expect = OPENERS[task["reader"]], task["expect"]
    place, sound = Path(task["file"]), Path(task["sound"])
    before = {path.name for path in place.parent.iterdir()}
    try:
        found = opened(place, sound, kind_of(task))
    except MorphletError as error:
        return refusal(error, expect)
    beside = {path.name for path in place.parent.iterdir()} - before
    if beside:
        return "failed", f"left {beside}"
    if expect == REFUSED:
        return "failed", "read what must be refused"
    if (
        expect in (SAME, SOUND)
        and not same(found, sound_value(task["reader"], task["seed"], str(sound), kind_of(task)))
        and not partial(found)
    ):
        return "failed", "read as something else, without a word"
    return "read", ""


def kind_of(task: Task) -> str:
    """The name of the sound file."""
    return Path(task["seed"]).stem.removesuffix("-sound")


@cache
def sound_value(reader: str, seed: str, sound: str, kind: str) -> Value:
    """What the sound file holds."""
    return OPENERS[reader](Path(seed), Path(sound), kind)


def refusal(error: MorphletError, expect: str) -> tuple[str, str]:
    """A refusal says three things, in a few printable words."""
    text = str(error)
    if not (error.needed and error.found and error.advice) or len(text) > LONGEST_MESSAGE:
        return "failed", f"a refusal without its parts, or of {len(text)} letters: {text[:160]}"
    if not text.isprintable() and any(ord(letter) < 32 or ord(letter) == 127 for letter in text):
        return "failed", f"a refusal that a terminal would obey: {text[:160]!r}"
    return ("failed", f"refused though sound: {text[:160]}") if expect == SAME else ("refused", text[:300])


def same(first: Value, second: Value) -> bool:
    """Whether all arrays are alike, bit for bit but for the sign of zero."""
    return len(first) == len(second) and all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))


def partial(found: Value) -> bool:
    """Whether a stream said that it is not whole."""
    return len(found) > 2 and found[-1].shape == () and found[-1].dtype == bool and not found[-1]


def require(fine: Any, what: str) -> None:
    """Sound or not."""
    if not fine:
        raise ArithmeticError(what)


def open_mesh(place: Path, sound: Path, kind: str) -> Value:
    """Everything that reads a mesh file, and the mesh written and read again."""
    mesh = read(place)
    require_sound(mesh)
    kept = read_attributes(place)
    for rows in (kept.colors, kept.uv):
        require(rows is None or len(rows) == mesh.n_vertices, "attributes without vertices")
    try:
        poses = read_poses(place)
    except FileError:
        poses = None
    require(poses is None or np.isfinite(poses.sequence.positions).all(), "poses that are not finite")
    with TemporaryDirectory() as folder:
        again = Path(folder, "again.ply")
        write(again, mesh)
        back = read(again)
        require(same([back.vertices, back.faces], [mesh.vertices, mesh.faces]), "another mesh after writing and reading")
        _again(place, mesh, Path(folder))
    second = SECOND.get(place.suffix)
    if second is not None:
        _compare(mesh, second(place.read_bytes()), place.suffix)
    return [mesh.vertices, mesh.faces] + ([] if poses is None else [poses.sequence.positions])


def require_sound(mesh: Mesh) -> None:
    """Finite, in range, and its plainest figures can be had."""
    require(np.isfinite(mesh.vertices).all(), "vertices that are not finite")
    require(mesh.n_faces and mesh.n_vertices, "no mesh")
    require(mesh.faces.min() >= 0 and mesh.faces.max() < mesh.n_vertices, "faces out of range")


def _again(place: Path, mesh: Mesh, folder: Path) -> None:
    """The file with its own positions is the same mesh."""
    target = folder / f"own{'.glb' if place.suffix == '.gltf' else place.suffix}"
    try:
        rewrite(place, mesh, target)
    except FileError:
        return
    except InputError as error:
        require("single precision" in error.needed, f"not written again: {error}")
        return
    if place.suffix == ".stl":
        return
    back = read(target)
    scale = np.abs(mesh.vertices).max() if place.suffix == ".gltf" else 0.0
    require(np.array_equal(back.faces, mesh.faces), "other faces after writing into the file")
    require(np.abs(back.vertices - mesh.vertices).max() <= 1e-5 * scale, "other positions after writing into the file")


def _compare(mesh: Mesh, second: tuple[np.ndarray, np.ndarray] | None, ending: str) -> None:
    """What a second reader found."""
    if second is None:
        return
    vertices, faces = second
    if ending == ".stl":
        require(np.array_equal(mesh.vertices[mesh.faces], vertices[faces]), "another mesh than a second reader's")
    else:
        require(np.array_equal(mesh.vertices, vertices) and np.array_equal(mesh.faces, faces), "another mesh than a second reader's")


def number(word: str) -> float:
    """A number as every reader knows it; Python knows more."""
    if "_" in word or not word.isascii():
        raise ValueError(word)
    return float(word)


def lines_of(data: bytes) -> list[list[str]]:
    """Words by line, without comments."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n").decode("latin-1")
    return [re.split(r"[ \t\v\f]+", line.strip(" \t\v\f")) for line in re.sub(r"#[^\n]*", "", text).split("\n")]


def fans(polygons: list[list[int]]) -> np.ndarray:
    """Triangles about the first corners."""
    return np.array([[p[0], p[k], p[k + 1]] for p in polygons for k in range(1, len(p) - 1)], np.int64).reshape(-1, 3)


def second_obj(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Positions and triangles, line by line."""
    text = data.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    vertices, polygons = [], []
    for words in lines_of(re.sub(rb"\\\n", b" ", re.sub(rb"#[^\n]*", b"", text))):
        if words[0] == "v":
            vertices.append([number(word) for word in words[1:4]])
        if words[0] == "f":
            indices = [int(word.split("/")[0]) for word in words[1:]]
            polygons.append([k - 1 if k > 0 else len(vertices) + k for k in indices])
    return np.array(vertices), fans(polygons)


def second_off(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """Positions and triangles, line by line."""
    rows = [words for words in lines_of(data) if words != [""]]
    if re.fullmatch(r"(ST)?C?N?OFF", rows[0][0]):
        rows = ([rows[0][1:]] if len(rows[0]) > 1 else []) + rows[1:]
    n, m = (int(number(word)) for word in rows[0][:2])
    faces = [[int(number(word)) for word in row[1 : 1 + int(number(row[0]))]] for row in rows[1 + n : 1 + n + m]]
    return np.array([[number(word) for word in row[:3]] for row in rows[1 : 1 + n]]), fans(faces)


def second_ply(data: bytes) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions and triangles, value by value; None where there are strips."""
    data = data.removeprefix(b"\xef\xbb\xbf")
    head, mark = data.split(b"end_header", 1)
    newline = b"\r\n" if mark.lstrip(b" \t").startswith(b"\r\n") else mark.lstrip(b" \t")[:1]
    rest = mark.lstrip(b" \t")[len(newline) :]
    elements, order = _ply_header(head)
    take = _text_values(rest) if order == "ascii" else _binary_values(rest, ">" if "big" in order else "<")
    tables = {}
    for name, count, properties in elements:
        if properties:
            tables[name] = [_ply_row(properties, take) for _ in range(count)]
    if "tristrips" in tables:
        return None
    vertices = np.array([[row[axis] for axis in "xyz"] for row in tables["vertex"]], float).reshape(-1, 3)
    key = "vertex_indices" if any("vertex_indices" in row for row in tables["face"]) else "vertex_index"
    return vertices, fans([[int(k) for k in row[key]] for row in tables["face"]])


def _ply_header(head: bytes) -> tuple[list[tuple[str, int, list[list[str]]]], str]:
    """Elements with their properties, and the format."""
    elements: list[tuple[str, int, list[list[str]]]] = []
    order = ""
    for words in (line.split() for line in re.split(r"\r\n|\r|\n", head.decode("latin-1"))):
        if words[:1] == ["format"]:
            order = words[1]
        elif words[:1] == ["element"]:
            elements.append((words[1], int(words[2]), []))
        elif words[:1] == ["property"]:
            elements[-1][2].append(words[1:])
    return elements, order


CODES = dict(
    zip(
        [
            "char",
            "uchar",
            "short",
            "ushort",
            "int",
            "uint",
            "float",
            "double",
            "int8",
            "uint8",
            "int16",
            "uint16",
            "int32",
            "uint32",
            "float32",
            "float64",
        ],
        "bBhHiIfdbBhHiIfd",
        strict=True,
    )
)


def _ply_row(properties: list[list[str]], take: Callable[[str], float]) -> dict[str, Any]:
    """One row."""
    row: dict[str, Any] = {}
    for words in properties:
        row[words[-1]] = [take(words[2]) for _ in range(int(take(words[1])))] if words[0] == "list" else take(words[0])
    take("end of row")
    return row


def _text_values(rest: bytes) -> Callable[[str], float]:
    """The next number of the present line, or on to the next line."""
    rows = iter([line.split() for line in re.split(rb"\r\n|\r|\n", rest) if line.split()])
    state: dict[str, Any] = {"row": None}

    def take(kind: str) -> float:
        if kind == "end of row":
            state["row"] = None
            return 0.0
        if state["row"] is None:
            state["row"] = iter(next(rows))
        return number(next(state["row"]).decode("latin-1"))

    return take


def _binary_values(rest: bytes, order: str) -> Callable[[str], float]:
    """The next value of a type."""
    place = 0

    def take(kind: str) -> float:
        nonlocal place
        if kind == "end of row":
            return 0.0
        (value,) = struct.unpack_from(order + CODES[kind], rest, place)
        place += struct.calcsize(order + CODES[kind])
        return value

    return take


def second_stl(data: bytes) -> tuple[np.ndarray, np.ndarray]:
    """The corners of all facets."""
    if len(data) > 84 and len(data) == 84 + 50 * int.from_bytes(data[80:84], "little"):
        corners = [struct.unpack_from("<9f", data, at + 12) for at in range(84, len(data), 50)]
        vertices = np.array(corners, float).reshape(-1, 3)
    else:
        rows = [words for words in lines_of(data.replace(b"#", b"")) if words[0].lower() == "vertex"]
        vertices = np.array([[number(word) for word in row[1:]] for row in rows])
    return vertices, np.arange(len(vertices)).reshape(-1, 3)


SECOND: dict[str, Callable[[bytes], tuple[np.ndarray, np.ndarray] | None]] = {
    ".obj": second_obj,
    ".off": second_off,
    ".ply": second_ply,
    ".stl": second_stl,
}


@cache
def shape(sound: str) -> Mesh:
    """The mesh that arrays and edits belong to."""
    return read(Path(sound, "mesh.ply"))


def open_npz(place: Path, sound: Path, kind: str) -> Value:
    """A file of arrays as what it was written as."""
    mesh = shape(str(sound))
    found = STORED[kind](place, mesh)
    for array in found:
        require(array.dtype.kind != "f" or np.isfinite(array).all(), "numbers that are not finite")
    return found


def _map(place: Path, mesh: Mesh) -> Value:
    found = SphericalMap.load(place, mesh)
    found.quality()
    require(np.abs(np.linalg.norm(found.points, axis=1) - 1).max() < 1e-6, "points off the sphere")
    return [found.points, found.surface.mesh.faces, found.surface.mesh.vertices]


def _mesh_of(place: Path, mesh: Mesh) -> Value:
    found = load_approximation(place)
    require_sound(found.mesh())
    found.counts()
    return [found.mesh().vertices, found.mesh().faces]


def _correspondence(place: Path, mesh: Mesh) -> Value:
    found = Correspondence.load(place, mesh, mesh)
    return [found.positions, found.points.faces, found.points.weights, np.asarray(found.valid)]


def _image(place: Path, mesh: Mesh) -> Value:
    found = SphericalImage.load(place)
    require(found.to_mesh().n_vertices >= 0, "no mesh")
    return [found.positions, found.mask]


def _network(place: Path, mesh: Mesh) -> Value:
    found = WaveletNetwork.load(place)
    found.counts()
    return [found(np.linspace(0, 1, 5)), found.centers]


def _spherical(place: Path, mesh: Mesh) -> Value:
    found = SphericalNetwork.load(place)
    return [found(np.eye(3)), found.centers]


def _columns(place: Path, mesh: Mesh) -> Value:
    return [values for one in read_columns(str(place), mesh) for values in (np.array([one.name]), one.values)]


STORED: dict[str, Callable[[Path, Mesh], Value]] = {
    "map": _map,
    "rows": _mesh_of,
    "surface": _mesh_of,
    "correspondence": _correspondence,
    "image": _image,
    "network": _network,
    "spherical": _spherical,
    "values": _columns,
}


def open_columns(place: Path, sound: Path, kind: str) -> Value:
    return [array for array in _columns(place, shape(str(sound))) if array.dtype.kind != "U"]


def open_table(place: Path, sound: Path, kind: str) -> Value:
    return _columns(place, shape(str(sound)))


def open_pairs(place: Path, sound: Path, kind: str) -> Value:
    found = read_pairs(place)
    require(len(found) == len(found.source) == len(found.target), "pairs of different length")
    require(found.weight is None or np.isfinite(found.weight).all(), "weights that are not finite")
    require(found.source.min(initial=0) >= 0 and found.target.min(initial=0) >= 0, "negative vertices")
    again = place.parent.parent / "again.csv"
    write_pairs(again, found)
    back = read_pairs(again)
    require(np.array_equal(back.source, found.source) and back.labels == found.labels, "other pairs after writing and reading")
    return [found.source, found.target, np.asarray(found.weight), np.array(found.labels)]


def open_schedule(place: Path, sound: Path, kind: str) -> Value:
    found = Schedule.read(place)
    shares = found(np.linspace(0, 1, 5))
    require(np.isfinite(shares).all() and shares.min() >= 0 and shares.max() <= 1 + 1e-9, "shares out of range")
    return [found.start, found.duration, np.array(found.easing)]


def open_edit(place: Path, sound: Path, kind: str) -> Value:
    found = read_edit(place, shape(str(sound)))
    editor = RoiEditor.prepare(found.roi, found.method)
    return [editor.solve(pull.targets, pull.turns).vertices for pull in found.pulls[:3]]


def open_mlw(place: Path, sound: Path, kind: str) -> Value:
    found: Decoded = decode_part(place.read_bytes())
    faces, positions = found.sequence.topology.faces, found.sequence.positions
    require(np.isfinite(positions).all(), "positions that are not finite")
    require(not len(faces) or (faces.min() >= 0 and faces.max() < positions.shape[1]), "faces out of range")
    return [positions, faces, np.array(found.complete)]


OPENERS: dict[str, Callable[[Path, Path, str], Value]] = {
    **dict.fromkeys(("obj", "off", "ply", "stl", "gltf"), open_mesh),
    "npz": open_npz,
    "npy": open_columns,
    "pairs.csv": open_pairs,
    "table.csv": open_table,
    "edit.toml": open_edit,
    "schedule.toml": open_schedule,
    "mlw": open_mlw,
}
