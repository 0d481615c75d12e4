"""Every verb of the command line on input that is unfit for it.

Each ends with 0, 1, 2, 3 or 4. With 0 every output can be read back; else one line on standard error says what was needed, what was found
and what to do, `--json` says the same, and no output is left.
"""

import contextlib
import io
import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from PIL import Image

from morphlet import Correspondence, Mesh, SurfacePoints, decode_part, read, read_pairs, write
from morphlet.cli import main
from morphlet.numerics.unit_sphere import icosphere
from torture_pool import Task

THREE_PARTS = re.compile(r"morphlet( [\w-]+)?: needed .+; found .+; .+", re.DOTALL)
CODES = (0, 1, 2, 3, 4)
VERBS = {
    "info": "info {bad}",
    "info --picture": "info {bad} --picture {out}/p.png",
    "repair": "repair {bad} -o {out}/r.ply --fill all --cut-handles 3",
    "compare": "compare {bad} {good}",
    "compare with": "compare {good} {bad}",
    "sphere": "sphere {bad} -o {out}/s.npz",
    "image": "image {bad} -o {out}/i.npz --size 17",
    "approximate": "approximate {bad} -o {out}/a.npz --size 17 --wavelets 3",
    "approximate --over sphere": "approximate {bad} -o {out}/a.npz --over sphere --wavelets 20 --residual",
    "reconstruct": "reconstruct {bad} -o {out}/r.ply",
    "regions": "regions {bad} -o {out}/r.npz",
    "match": "match {bad} {good} -o {out}/m.csv",
    "match with": "match {good} {bad} -o {out}/m.csv",
    "correspond": "correspond {bad} {good} --pairs {pairs} -o {out}/c.npz",
    "correspond with": "correspond {good} {bad} --pairs {pairs} -o {out}/c.npz",
    "correspond --pairs": "correspond {good} {good} --pairs {bad} -o {out}/c.npz",
    "carry": "carry {bad} {good} {map} --attribute color -o {out}/c.ply",
    "carry map": "carry {good} {good} {bad} --attribute color -o {out}/c.ply",
    "morph": "morph {bad} {good} --pairs {pairs} -o {out}/m --frames 2",
    "morph into": "morph {good} {bad} --pairs {pairs} -o {out}/m --frames 2 --path linear",
    "morph --schedule": "morph {good} {good} -o {out}/m --frames 2 --schedule {bad}",
    "transfer from": "transfer {bad} {bad} --to {good} --pairs {pairs} -o {out}/t",
    "transfer pose": "transfer {good} {bad} --to {good} --pairs {pairs} -o {out}/t",
    "transfer to": "transfer {good} {pose} --to {bad} --pairs {pairs} -o {out}/t",
    "deform": "deform {bad} {spec} -o {out}/d.ply",
    "deform script": "deform {good} {bad} -o {out}/d.ply",
    "encode": "encode {bad} -o {out}/e.mlw",
    "encode --rms": "encode {bad} -o {out}/e.mlw --rms 1% --mode decimated",
    "decode": "decode {bad} -o {out}/d",
    "sample": "sample {bad} -o {out}/s.ply",
    "fetch": "fetch spot --mirror {bad} -o {out}/f.obj",
}
"""Command lines; `{bad}` is the unfit input, `{out}` an empty folder."""
EXCUSED = {
    "paper": "runs all others",
    "demo": "takes no input",
    "warmup": "takes no input",
    "studio": "serves until it is stopped; what it is sent is tested with it",
    "batch": "has tests of its own",
}
"""Verbs that are not here, and why."""
QUICK_VERBS = ("info", "repair", "compare with", "reconstruct", "deform", "encode", "decode", "transfer to", "carry map", "sphere")
QUICK_INPUTS = ("empty file", "words", "folder", "ring of links", "a device", "no faces", "NaN", "one triangle", "zero area", "scale 1e12")


def ball() -> Mesh:
    """A lopsided ball."""
    points, faces = icosphere(2)
    return Mesh(points * [1.0, 1.3, 0.8] + 0.2 * points[:, [0]] ** 2, faces)


def sheet(size: int = 6) -> Mesh:
    """A square of so many rows."""
    k = np.arange(size * size)
    corner = (k.reshape(size, size)[:-1, :-1]).ravel()
    faces = np.vstack([np.stack([corner, corner + 1, corner + size], 1), np.stack([corner + 1, corner + size + 1, corner + size], 1)])
    return Mesh(np.stack([k % size, k // size, 0 * k], 1), faces)


def torus(sides: int = 12) -> Mesh:
    """A ring of square rods."""
    i, j = (k.ravel() for k in np.meshgrid(np.arange(sides), np.arange(sides), indexing="ij"))
    u, v = 2 * np.pi * i / sides, 2 * np.pi * j / sides
    points = np.stack([(1 + 0.3 * np.cos(v)) * np.cos(u), (1 + 0.3 * np.cos(v)) * np.sin(u), 0.3 * np.sin(v)], 1)

    def at(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        return (a % sides) * sides + b % sides

    corners = at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)
    return Mesh(points, np.vstack([np.stack([corners[k] for k in face], 1) for face in ((0, 1, 2), (0, 2, 3))]))


def beside(first: Mesh, second: Mesh) -> Mesh:
    """Both in one."""
    return Mesh(np.vstack([first.vertices, second.vertices]), np.vstack([first.faces, second.faces + first.n_vertices]))


def moved(scale: object, shift: float = 0.0) -> Mesh:
    """The ball elsewhere."""
    return ball().with_vertices(ball().vertices * np.asarray(scale) + shift)


def meshes() -> dict[str, Mesh]:
    """Meshes that most verbs have trouble with."""
    whole = ball()
    v, f = whole.vertices, whole.faces
    return {
        "one triangle": Mesh(np.eye(3), [[0, 1, 2]]),
        "two components": beside(whole, moved(0.5, 5.0)),
        "open sheet": sheet(),
        "torus": torus(),
        "not manifold": Mesh([[0, 0, 0], [0, 0, 1], [1, 0, 0], [0, 1, 0], [-1, -1, 0]], [[0, 1, 2], [0, 1, 3], [0, 1, 4]]),
        "a bow tie": Mesh(np.vstack([v, v[1:] + v[0] * 2]), np.vstack([f, np.where(f == 0, 0, f + 161)])),
        "zero area": whole.with_vertices(np.ones_like(v)),
        "on a line": whole.with_vertices(v * [1, 0, 0]),
        "faces that repeat a vertex": Mesh(np.eye(3), [[0, 1, 1], [0, 0, 2]]),
        "every face twice": Mesh(v, np.vstack([f, f])),
        "soup": Mesh(v[f].reshape(-1, 3), np.arange(f.size).reshape(-1, 3)),
        "half the faces turned": Mesh(v, np.vstack([f[:160], f[160:, ::-1]])),
        "stray vertices": Mesh(np.vstack([v, np.full((50, 3), 1e6)]), f),
        "scale 1e-12": moved(1e-12),
        "scale 1e12": moved(1e12),
        "scale 1e-300": moved(1e-300),
        "scale 1e150": moved(1e150),
        "scale 1e300": moved(1e300),
        "offset 1e8": moved(1.0, 1e8),
        "needles": moved([1, 1e-7, 1e4]),
    }


def inputs(folder: Path) -> dict[str, Path]:
    """Unfit input by name, put into a folder."""
    folder.mkdir(parents=True)
    files = {
        "empty file": ("a.obj", b""),
        "words": ("a.txt", b"Dear reader,\nthis is a letter.\n"),
        "a picture": ("a.ply", b"\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR" + bytes(range(256))),
        "no faces": ("a.off", b"OFF\n3 0 0\n0 0 0\n1 0 0\n0 1 0\n"),
        "NaN": ("nan.obj", b"v 0 0 0\nv nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"),
        "a table": ("a.csv", b"source,target\n0,0\n1,99999999\n"),
        "another TOML": ("a.toml", b"[project]\nname = 'x'\n"),
    }
    found = {}
    for number, (name, (file, data)) in enumerate(files.items()):
        place = folder / f"{number}-{file}"
        place.write_bytes(data)
        found[name] = place
    (folder / "folder").mkdir()
    (folder / "ring.ply").symlink_to("ring.ply")
    found |= {
        "folder": folder / "folder",
        "missing": folder / "gone.ply",
        "ring of links": folder / "ring.ply",
        "a device": Path("/dev/zero"),
    }
    np.savez(folder / "other.npz", kind=np.array("other"), version=np.array(1), points=np.zeros(3))
    found["other arrays"] = folder / "other.npz"
    for name, mesh in meshes().items():
        found[name] = folder / f"{name.replace(' ', '-')}.ply"
        write(found[name], mesh)
    return found


def fit(folder: Path) -> dict[str, str]:
    """What the command lines name beside the unfit input."""
    folder.mkdir(parents=True)
    good = ball()
    write(folder / "good.ply", good, colors=np.zeros((162, 3), np.uint8))
    write(folder / "pose.ply", good.with_vertices(good.vertices * [1, 1.2, 1]))
    Correspondence(good, good, SurfacePoints(np.arange(162), np.full((162, 3), 1 / 3)), np.ones(162, bool)).save(folder / "map.npz")
    (folder / "pairs.csv").write_text("source,target\n0,0\n1,1\n2,2\n3,3\n")
    (folder / "spec.toml").write_text("handle = [0]\nroi = {radius = '40%'}\ntranslate = [0.1, 0, 0]\n")
    names = {"good": "good.ply", "pose": "pose.ply", "map": "map.npz", "pairs": "pairs.csv", "spec": "spec.toml"}
    return {name: str(folder / file) for name, file in names.items()}


def laid(folder: Path, verb: str, quick: bool) -> Iterator[tuple[str, Task]]:
    """The tasks of a verb."""
    out, words = folder / "out", VERBS[verb].split()
    known = fit(folder / "fit")
    for name, path in inputs(folder / "unfit").items():
        if quick and name not in QUICK_INPUTS:
            continue
        shutil.rmtree(out, ignore_errors=True)
        out.mkdir()
        told = [word.format(bad=path, out=out, **known) for word in words]
        yield name, {"words": told, "out": str(out)}


def attempt(task: Task) -> tuple[str, str]:
    """Call the command line; tell what became of it."""
    out, said, told = Path(task["out"]), io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(told), contextlib.redirect_stderr(said):
        code = main([*task["words"], "--json", "--quiet"])
    text = said.getvalue()
    left = sorted(path for path in out.rglob("*") if path.is_file())
    result = json.loads(told.getvalue(), parse_constant=_no_json)
    if code not in CODES or "Traceback" in text:
        return "failed", f"exit code {code}: {text[:200]}"
    if code:
        if left or list(out.iterdir()):
            return "failed", f"refused, and left {[path.name for path in left]}"
        if result["exit_code"] != code or not THREE_PARTS.fullmatch(text.strip()) or "\x1b" in text or len(text.strip().splitlines()) > 1:
            return "failed", f"refused with {code} in other words: {text[:200]!r}"
        return "refused", f"{code}: {text.strip()[:240]}"
    if {Path(path).resolve() for path in result["outputs"]} - {path.resolve() for path in left}:
        return "failed", f"outputs that are not there: {result['outputs']}"
    for path in left:
        read_back(path)
    return ("repaired", "") if result.get("repairs") or result.get("warnings") else ("done", "")


def read_back(path: Path) -> None:
    """Raise unless a file is what its name says."""
    ending = path.suffix
    if ending in (".ply", ".obj", ".glb"):
        mesh = read(path)
        if not np.isfinite(mesh.vertices).all():
            raise ArithmeticError(f"{path.name} is not finite")
    elif ending == ".npz":
        with np.load(path, allow_pickle=False) as file:
            for name in file.files:
                if file[name].dtype.kind == "f" and not np.isfinite(file[name]).all() and name != "positions":
                    raise ArithmeticError(f"{name} in {path.name} is not finite")
    elif ending == ".mlw":
        decode_part(path.read_bytes())
    elif ending == ".csv":
        read_pairs(path)
    elif ending == ".png":
        Image.open(path).verify()
    elif ending == ".json":
        json.loads(path.read_text("utf-8"), parse_constant=_no_json)


def _no_json(word: str) -> None:
    raise ValueError(f"{word} is no JSON")
