"""On what, and beside what, figures were measured: the machine, and the versions of the package, its libraries and its peers."""

import json
import os
import platform
import re
import subprocess
import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

PEER_PYTHON = "MORPHLET_PEER_PYTHON"
"""Environment variable: an interpreter that has the peers that live apart; this one, unless it is set."""
LIBRARIES = ("morphlet", "numpy", "scipy", "numba", "libigl", "trimesh")
PEERS = (
    *("lapy", "pyfmaps", "PyWavelets", "scikit-learn", "scikit-sparse", "DracoPy", "zstandard", "fast-simplification"),
    *("open3d", "viser"),
)
"""Packages that figures stand beside; libigl and trimesh are peers too."""
CGAL = Path("/usr/include/CGAL/version.h")
"""Where Debian puts it."""
ASKED = """
import json, sys
from importlib import metadata
def version(name):
    try: return metadata.version(name)
    except metadata.PackageNotFoundError: return None
print(json.dumps({name: version(name) for name in sys.argv[1:]}))
"""
"""What an interpreter has: runs anywhere."""
PATIENCE = 60.0
"""Seconds that an interpreter may take to say so."""
ABSENT = "absent"


@dataclass(frozen=True)
class Machine:
    """A machine, as it is told beside figures."""

    cpu: str
    cores: int
    """That this process may use."""
    memory_gb: float
    system: str
    python: str
    libraries: dict[str, str]
    peers: dict[str, str]
    """Versions, or "absent"."""
    threads: dict[str, str]
    """Environment variables that limit threads."""

    def lines(self) -> list[list[str]]:
        """Names and values."""
        told = (f"{name} {version}" for name, version in self.libraries.items())
        beside = (f"{name} {version}" for name, version in self.peers.items())
        limits = (f"{name}={value}" for name, value in self.threads.items())
        return [
            ["processor", f"{self.cpu}, {self.cores} cores"],
            ["memory", f"{self.memory_gb:.0f} GB"],
            ["system", self.system],
            ["Python", self.python],
            ["versions", ", ".join(told)],
            ["peers", ", ".join(beside)],
            ["limits of threads", ", ".join(limits) or "none"],
        ]


def this_machine() -> Machine:
    """The one that this runs on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    named = {name: os.environ[name] for name in sorted(os.environ) if name.endswith("_NUM_THREADS")}
    libraries = {name: version or ABSENT for name, version in versions(LIBRARIES).items()}
    return Machine(
        processor(), cores, memory_gb(), f"{system()}, {platform.machine()}", platform.python_version(), libraries, peers(), named
    )


def processor() -> str:
    """Its model."""
    try:
        found = re.search(r"^model name\s*:\s*(.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    except OSError:
        found = None
    return found[1].strip() if found else platform.processor() or platform.machine()


def system() -> str:
    """The operating system, by its own name where it has one."""
    try:
        return platform.freedesktop_os_release()["PRETTY_NAME"]
    except (OSError, KeyError):
        return platform.system()


def memory_gb() -> float:
    """Of the machine; NaN where nobody says."""
    try:
        return os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
    except (ValueError, OSError, AttributeError):
        return float("nan")


def load() -> float:
    """Processes that ran or waited to run in the last minute."""
    return os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")


def versions(names: tuple[str, ...]) -> dict[str, str | None]:
    """Of packages in this interpreter."""
    found: dict[str, str | None] = {}
    for name in names:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    return found


def peers() -> dict[str, str]:
    """Versions in this interpreter or in the peers' own, and CGAL's."""
    here, apart = versions(PEERS), elsewhere(os.environ.get(PEER_PYTHON, ""))
    return {name: here[name] or apart.get(name) or ABSENT for name in PEERS} | {"CGAL": cgal()}


def elsewhere(python: str) -> dict[str, str | None]:
    """Versions in another interpreter; nothing if there is none."""
    if python in ("", sys.executable):
        return {}
    try:
        made = subprocess.run([python, "-c", ASKED, *PEERS], capture_output=True, text=True, check=True, timeout=PATIENCE)
    except (OSError, subprocess.SubprocessError):
        return {}
    return dict(json.loads(made.stdout))


def cgal() -> str:
    """Version of the headers."""
    try:
        found = re.search(r"define CGAL_VERSION (\S+)", CGAL.read_text())
    except OSError:
        found = None
    return found[1] if found else ABSENT
