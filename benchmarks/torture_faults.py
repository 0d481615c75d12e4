"""What may happen to a machine: a full disk, a folder that cannot be written, a process that is killed, a library that is not there.

Each fault is a function that makes it happen, again and again where chance is in it, and tells for each time what became of it. What cannot
be made to happen here (no Linux, no root) says so with `CannotBe`.
"""

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np

from morphlet import Mesh, decode, encode, read, write
from morphlet.numerics.unit_sphere import icosphere
from torture_pool import Verdict

LONGEST = 120.0
"""Seconds for a process in which kernels may have to be compiled."""
PACKAGE = Path(sys.modules["morphlet"].__file__ or "").parent
CALL = "import sys; from morphlet.cli import main; sys.exit(main(sys.argv[1:]))"
LIMITED = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
from morphlet.cli import main
import morphlet.warm, morphlet.report.sheet, PIL.PngImagePlugin
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), resource.RLIM_INFINITY))
sys.exit(main(sys.argv[2:]))
"""
BLOCKED = """
import sys
from importlib.machinery import PathFinder
find, gone = PathFinder.find_spec, set(sys.argv[1].split(","))
PathFinder.find_spec = lambda name, path=None, target=None: None if name.split(".")[0] in gone else find(name, path, target)
from morphlet.cli import main
sys.exit(main(sys.argv[2:]))
"""
NO_GRAPHICS = """
import ctypes.util, sys
found = ctypes.util.find_library
ctypes.util.find_library = lambda name: None if name in ("EGL", "GL", "X11") else found(name)
from morphlet.cli import main
sys.exit(main(sys.argv[1:]))
"""
WRITING = """
import sys
import numpy as np
from pathlib import Path
from morphlet import Mesh, write
from morphlet._store import save
from morphlet.numerics.unit_sphere import icosphere
points, faces = icosphere(4)
print("ready", flush=True)
k = int(sys.argv[2])
while True:
    k += int(sys.argv[3])
    write(sys.argv[1], Mesh(points * k, faces)) if sys.argv[1].endswith(".ply") else save(sys.argv[1], "x", 1, {"points": points * k})
"""
KERNEL = """
from morphlet import Mesh, self_intersections
from morphlet.numerics.unit_sphere import icosphere
points, faces = icosphere(1)
print(len(self_intersections(Mesh(points, faces))))
"""
OPTIONAL = ("imageio_ffmpeg", "starlette", "uvicorn", "websockets", "pyvista", "DracoPy", "sksparse")
Found = Iterator[tuple[str, Verdict]]


class CannotBe(Exception):
    """A fault that cannot be made to happen on this machine."""


def python(
    code: str, *words: object, prefix: Sequence[str] = (), cwd: Path | None = None, **variables: str
) -> subprocess.CompletedProcess[str]:
    """Code in a process of its own."""
    call = [*prefix, sys.executable, "-c", code, *map(str, words)]
    kept = {name: value for name, value in os.environ.items() if variables.get(name, "-") != ""}
    return subprocess.run(
        call,
        env={**kept, **{name: value for name, value in variables.items() if value}},
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=LONGEST,
        check=False,
    )


def ball(level: int = 2) -> Mesh:
    """A lopsided ball."""
    points, faces = icosphere(level)
    return Mesh(points * [1.0, 1.3, 0.8] + 0.2 * points[:, [0]] ** 2, faces)


def told(done: subprocess.CompletedProcess[str], *codes: int, words: str = "") -> Verdict:
    """Whether a call ended as it should: done with 0, or refused with one of these codes, in these words."""
    if "Traceback" in done.stderr or done.returncode not in codes:
        return Verdict("failed", f"exit code {done.returncode}: {done.stderr[-300:]}")
    if done.returncode and (words not in done.stderr or "found" not in done.stderr):
        return Verdict("failed", f"in other words: {done.stderr[-300:]}")
    return Verdict("refused" if done.returncode else "done", done.stderr.strip()[:200])


def and_left(found: Verdict, folder: Path, expected: set[str]) -> Verdict:
    """The verdict, if nothing else lies in the folder."""
    left = {path.name for path in folder.iterdir()}
    return found if left == expected else Verdict("failed", f"left {sorted(left)} instead of {sorted(expected)}")


def writers(folder: Path) -> dict[str, tuple[str, ...]]:
    """Command lines that write a file each, by its name."""
    write(folder / "ball.ply", ball())
    (folder / "spec.toml").write_text("handle = [0]\nroi = {radius = '40%'}\ntranslate = [0.1, 0, 0]\n")
    return {
        "r.ply": ("repair", "ball.ply"),
        "s.npz": ("sphere", "ball.ply"),
        "i.png": ("image", "ball.ply", "--size", "65"),
        "d.obj": ("deform", "ball.ply", "spec.toml"),
        "e.mlw": ("encode", "ball.ply"),
        "a.npz": ("approximate", "ball.ply", "--size", "17", "--wavelets", "3"),
    }


def full_disk(folder: Path, quick: bool) -> Found:
    """Files may not grow beyond so many bytes: exit code 4, and what was there before stays."""
    if not hasattr(signal, "SIGXFSZ"):
        raise CannotBe("no limits of file sizes here")
    folder.mkdir(parents=True)
    calls = writers(folder)
    for name, words in list(calls.items())[: 2 if quick else None]:
        for size, earlier in ((0, True), (300, False))[: 1 if quick else None]:
            place = folder / f"{name}-{size}"
            place.mkdir()
            if earlier:
                (place / name).write_text("mine")
            done = python(LIMITED, size, *words, "-o", place / name, "--force", "--quiet", cwd=folder)
            found = and_left(told(done, 4, words="to write"), place, {name} if earlier else set())
            kept = not earlier or (place / name).read_text() == "mine"
            yield f"{words[0]}, {size} bytes left", found if kept else Verdict("failed", "the earlier output is gone")


def read_only_prefix(folder: Path) -> tuple[str, ...]:
    """What makes a folder read-only for a call: its rights, or for root, whom they do not bind, a mount that ends with the call."""
    if os.name == "nt":
        raise CannotBe("no read-only folders here")
    if os.geteuid():
        return ("sh", "-c", 'chmod -R a-w "$0"; "$@"; code=$?; chmod -R u+w "$0"; exit $code', str(folder))
    mount = 'mount --bind "$0" "$0" && mount -o remount,bind,ro "$0" && exec "$@"'
    prefix = ("unshare", "-m", "sh", "-c", mount, str(folder))
    if shutil.which("unshare") is None or subprocess.run([*prefix, "true"], capture_output=True, check=False).returncode:
        raise CannotBe("root may write everywhere here, and may not mount")
    return prefix


def read_only_folder(folder: Path, quick: bool) -> Found:
    """Outputs into a folder that cannot be written, beside an existing one and into a new one."""
    folder.mkdir(parents=True)
    calls, locked = writers(folder), folder / "locked"
    locked.mkdir()
    for name, words in list(calls.items())[: 2 if quick else None]:
        (locked / name).write_text("mine")
        prefix = read_only_prefix(locked)
        done = python(CALL, *words, "-o", locked / name, "--force", "--quiet", prefix=prefix, cwd=folder)
        yield words[0], told(done, 4, words="to write into")
    names = set(list(calls)[: 2 if quick else None])
    yield "a folder", and_left(told(python(CALL, "decode", "x.mlw", "-o", locked / "d", prefix=prefix, cwd=folder), 4), locked, names)


def killed(folder: Path, quick: bool) -> Found:
    """A process that writes one file over and over is killed at a random time: the file is whole, an earlier or a later one."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for name in ("m.ply", "m.npz"):
        for _ in range(3 if quick else 20):
            with subprocess.Popen([sys.executable, "-c", WRITING, str(folder / name), "0", "1"], stdout=subprocess.PIPE) as process:
                process.stdout.readline()
                time.sleep(float(rng.uniform(0.05, 0.4)))
                process.kill()
            yield f"{name} while it was written", whole(folder / name)
            for path in folder.iterdir():
                path.unlink()


def whole(path: Path) -> Verdict:
    """Whether a file is one of those that were being written."""
    if not path.exists():
        return Verdict("done", "absent")
    if path.suffix == ".ply":
        vertices = read(path).vertices
    else:
        with np.load(path, allow_pickle=False) as file:
            vertices = file["points"]
    points, _ = icosphere(4)
    factor = round(float(np.linalg.norm(vertices[0])))
    intact = factor >= 1 and np.array_equal(vertices, points * factor)
    return Verdict("done", f"number {factor}") if intact else Verdict("failed", "a mixture")


def killed_verbs(folder: Path, quick: bool) -> Found:
    """Verbs killed at a random time: the earlier output stays, or the new one is whole."""
    folder.mkdir(parents=True)
    write(folder / "ball.ply", ball(5))
    rng = np.random.default_rng(0)
    for number in range(3 if quick else 20):
        verb, name = ("repair", "r.ply") if number % 2 else ("encode", "r.mlw")
        (folder / name).write_bytes(b"mine")
        words = [sys.executable, "-c", CALL, verb, "ball.ply", "-o", name, "--force", "--quiet"]
        with subprocess.Popen(words, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as process:
            time.sleep(float(rng.uniform(0.3, 2.5)))
            process.kill()
        data = (folder / name).read_bytes()
        if data == b"mine":
            yield verb, Verdict("done", "the earlier one")
            continue
        mesh = read(folder / name) if name.endswith(".ply") else decode(data)[0]
        yield verb, Verdict("done", "the new one") if mesh.n_vertices == ball(5).n_vertices else Verdict("failed", "half a mesh")


def two_writers(folder: Path, quick: bool) -> Found:
    """Two processes write one file over and over, and a third reads it."""
    folder.mkdir(parents=True)
    for name in ("m.ply", "m.npz"):
        calls = [[sys.executable, "-c", WRITING, str(folder / name), str(start), "2"] for start in (0, 1)]
        processes = [subprocess.Popen(call, stdout=subprocess.PIPE) for call in calls]
        for process in processes:
            process.stdout.readline()
        time.sleep(0.2)
        try:
            for _ in range(20 if quick else 200):
                yield f"{name} of two processes", whole(folder / name)
        finally:
            for process in processes:
                process.kill()
                process.wait()
                process.stdout.close()


def two_verbs(folder: Path, quick: bool) -> Found:
    """Two processes with one output: each is done, or refused with exit code 4; what stands there is whole."""
    folder.mkdir(parents=True)
    write(folder / "ball.ply", ball())
    (folder / "x.mlw").write_bytes(encode(ball()).data)
    calls = {"repair": ("repair", "ball.ply", "-o", "r.ply", "--force"), "decode": ("decode", "x.mlw", "-o", "d", "--force")}
    for number in range(2 if quick else 10):
        verb = list(calls)[number % 2]
        words = [sys.executable, "-c", CALL, *calls[verb], "--quiet"]
        processes = [subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True) for _ in range(2)]
        ended = [(process.communicate(timeout=LONGEST)[1], process.returncode) for process in processes]
        output = folder / ("r.ply" if verb == "repair" else "d/mesh.ply")
        fine = all(code in (0, 4) and "Traceback" not in said for said, code in ended) and read(output).n_vertices == ball().n_vertices
        hidden = [path.name for path in folder.iterdir() if path.name.startswith(".")]
        yield verb, Verdict("done", str([code for _, code in ended])) if fine and not hidden else Verdict("failed", f"{ended} {hidden}")


def installed(folder: Path) -> Path:
    """A copy of the package without compiled kernels."""
    place = folder / "install"
    shutil.copytree(PACKAGE, place / "morphlet", ignore=shutil.ignore_patterns("__pycache__"))
    (place / "home").mkdir()
    return place


def kernels(place: Path, prefix: Sequence[str] = ()) -> Verdict:
    """Whether kernels of an installed copy run and count nothing, as they should."""
    home = str(place / "home")
    done = python(
        KERNEL, prefix=prefix, cwd=place.parent, PYTHONPATH=str(place), HOME=home, NUMBA_CACHE_DIR="", XDG_CACHE_HOME="", XDG_RUNTIME_DIR=""
    )
    return Verdict("done") if (done.returncode, done.stdout) == (0, "0\n") else Verdict("failed", done.stderr[-300:])


def broken_cache(folder: Path, quick: bool) -> Found:
    """Compiled kernels on disk that are cut short, empty, or noise, as a kill or a full disk leaves them: they are compiled anew."""
    place = installed(folder)
    yield "no cache", kernels(place)
    rng, damages = np.random.default_rng(0), {"cut": 40, "empty": 0, "noise": -1}
    for ending in ("nbi", "nbc"):
        for damage, size in list(damages.items())[: 1 if quick else None]:
            for path in place.rglob(f"*.{ending}"):
                data = path.read_bytes()
                path.write_bytes(data[:size] if size >= 0 else rng.integers(0, 256, len(data), dtype=np.uint8).tobytes())
            yield f".{ending} {damage}", kernels(place)
            yield f"after .{ending} {damage}", kernels(place)


def read_only_install(folder: Path, quick: bool) -> Found:
    """The package where nothing can be written, and no home either: kernels are compiled each time."""
    place = installed(folder)
    yield "kernels", kernels(place, read_only_prefix(place))


def no_extras(folder: Path, quick: bool) -> Found:
    """Optional libraries that are not installed: what needs them is refused with their names, all else works."""
    folder.mkdir(parents=True)
    write(folder / "ball.ply", ball())
    gone = ",".join(OPTIONAL)
    yield "info", told(python(BLOCKED, gone, "info", "ball.ply", cwd=folder), 0)
    yield "studio", told(python(BLOCKED, gone, "studio", "ball.ply", "--no-browser", cwd=folder), 2, words="pip install")
    call = ("morph", "ball.ply", "ball.ply", "-o", "m", "--video", "v.mp4")
    yield "morph --video x.mp4", told(python(BLOCKED, gone, *call, cwd=folder), 2, words="pip install")
    if not quick:
        yield "info --picture", told(python(BLOCKED, gone, "info", "ball.ply", "--picture", "p.png", cwd=folder), 0)
        yield "encode --rms", told(python(BLOCKED, gone, "encode", "ball.ply", "-o", "e.mlw", "--rms", "1%", cwd=folder), 0)


def no_graphics(folder: Path, quick: bool) -> Found:
    """No graphics libraries: pictures are drawn all the same."""
    folder.mkdir(parents=True)
    write(folder / "ball.ply", ball(1))
    found = told(python(NO_GRAPHICS, "info", "ball.ply", "--picture", "p.png", cwd=folder), 0)
    data = (folder / "p.png").read_bytes()[:4] if (folder / "p.png").exists() else b""
    yield "info --picture", found if data == b"\x89PNG" else Verdict("failed", "no picture")


def no_browser(folder: Path, quick: bool) -> Found:
    """No browser to open the page in: the studio says its address and serves."""
    import urllib.request

    folder.mkdir(parents=True)
    write(folder / "ball.ply", ball(1))
    words = [sys.executable, "-c", CALL, "studio", "ball.ply"]
    with subprocess.Popen(words, cwd=folder, stderr=subprocess.PIPE, text=True, env={**os.environ, "BROWSER": "none-such"}) as process:
        said, address = [], ""
        for line in process.stderr:
            said.append(line)
            address = next((word for word in line.split() if word.startswith("http://127.0.0.1")), "")
            if address:
                break
        try:
            with urllib.request.urlopen(address, timeout=30) as answer:
                fine = answer.status == 200
        except (OSError, ValueError) as error:
            fine = getattr(error, "code", 0) in (404, 503)  # it serves, though its page was not built
        process.send_signal(signal.SIGINT)
        process.wait(LONGEST)
    yield "studio", Verdict("done") if fine else Verdict("failed", f"{address} {''.join(said)[-300:]}")


FAULTS: dict[str, Callable[[Path, bool], Found]] = {
    "disk full": full_disk,
    "folder read-only": read_only_folder,
    "killed while a file is written": killed,
    "killed while a verb runs": killed_verbs,
    "two processes write one file": two_writers,
    "two verbs with one output": two_verbs,
    "kernel cache damaged": broken_cache,
    "package and home read-only": read_only_install,
    "extras missing": no_extras,
    "no graphics libraries": no_graphics,
    "no browser": no_browser,
}
