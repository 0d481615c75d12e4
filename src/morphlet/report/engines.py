"""Which engine draws: the choice, with its reason.

VTK ends the whole process where graphics libraries or drivers are missing, so it is first tried in a process of its own.
"""

import ctypes.util
import functools
import importlib.util
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import UInt8

from morphlet.errors import MissingExtra
from morphlet.report.painter import paint
from morphlet.report.scene import Scene

LIBRARIES = ("EGL", "GL", "X11")
"""What VTK loads on Linux; without them it ends the process."""
TRIAL = "from morphlet.report.vtk import trial; trial()"
"""What is run in a process of its own."""
PATIENCE = 60.0
"""Seconds until a trial counts as failed: some twenty times what it takes."""


@dataclass(frozen=True)
class Engine:
    """An engine: its name, why it was chosen, and how it turns a scene into pixels."""

    name: str
    reason: str
    paint: Callable[[Scene], UInt8[np.ndarray, "h w 3"]]


def choose(wanted: str) -> Engine:
    """The engine of this name; `auto` is pyvista where it works, else matplotlib.

    Raises
    ------
    MissingExtra
        If pyvista is wanted and does not work here.
    """
    if wanted == "matplotlib":
        return Engine("matplotlib", "asked for", paint)
    obstacle = _obstacle()
    if not obstacle:
        from morphlet.report import vtk

        return Engine("pyvista", "asked for" if wanted == "pyvista" else "pyvista works here", vtk.paint)
    if wanted == "pyvista":
        raise MissingExtra("a working pyvista", obstacle, "pip install morphlet[render], or use engine 'matplotlib'")
    return Engine("matplotlib", obstacle, paint)


@functools.cache
def _obstacle() -> str:
    """What keeps pyvista from drawing, empty if nothing does; found out once per process."""
    if importlib.util.find_spec("pyvista") is None:
        return "pyvista is not installed"
    missing = [name for name in LIBRARIES if ctypes.util.find_library(name) is None] if sys.platform == "linux" else []
    if missing:
        return f"libraries missing for pyvista: {', '.join(missing)}"
    return _trial()


def _trial() -> str:
    """What went wrong when pyvista drew a first picture in a process of its own, empty if nothing did."""
    try:
        done = subprocess.run([sys.executable, "-c", TRIAL], capture_output=True, timeout=PATIENCE, check=False)
    except (OSError, ValueError, subprocess.TimeoutExpired) as error:
        return f"the trial of pyvista did not end well: {type(error).__name__}"
    return "" if done.returncode == 0 else f"the trial of pyvista ended with status {done.returncode}"
