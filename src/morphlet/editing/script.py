"""An edit told in a TOML file: region, method, and where the handle goes.

Vertices are numbered as in the mesh's file. Lengths are in mesh units, or texts like ``"5%"`` of the bounding-box diagonal. Every motion is
told from rest: it scales about a centre, then turns about it, then shifts.

``method``
    arap (if left out), rotations, laplacian, biharmonic, similarity, dual, direct, mls, ffd.
``handle``
    Vertex numbers, or ``{center = [x, y, z], radius = r}``.
``anchors``
    Vertex numbers; free is what the handle reaches without stepping on one. Or instead:
``roi``
    ``{radius = r, metric = "geodesic"}`` (or ``"euclidean"``, ``"edges"``).
``translate``, ``rotate``, ``scale``
    ``[x, y, z]``; ``{axis = [x, y, z], degrees = d, center = "handle"}`` (or a place); a factor.
``targets``
    Instead of these, a position for each handle vertex.
``path``
    Instead of these, a list of tables that each hold such a motion: a frame for each.
``weight``
    How hard the handle is held (arap, rotations, laplacian, biharmonic, similarity, dual); exactly if left out.
``smoothing``
    How strongly the rotations of neighbours are drawn together (arap): 0.02 makes bends soft.
``volume = true``
    Keep the enclosed volume (arap).
``guard = "self-intersection"``
    Give the surface a thickness and do not let it run through itself (arap, with or without volume, not with smoothing).
``detail = "multiresolution"``
    Take the fine detail off before, and put it back turned (arap, rotations, laplacian, biharmonic).
``iterations``
    How often the details are laid on the normals of the deformed surface (dual): 0 if left out.
``falloff``
    gaussian, literal, wendland (direct).
``[mls]``, ``[ffd]``
    ``kind``, ``alpha``; ``lattice = [l, m, n]``, ``basis``.
"""

import difflib
import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays, _store
from morphlet.editing.arap import Arap
from morphlet.editing.detail import Multiresolution
from morphlet.editing.estimated import EstimatedRotations, handle_turns
from morphlet.editing.falloff import Direct
from morphlet.editing.guard import Guarded
from morphlet.editing.lattice import Lattice
from morphlet.editing.linear import DualLaplacian, Laplacian, SimilarityLaplacian
from morphlet.editing.method import Method, Pull
from morphlet.editing.moving_least_squares import MovingLeastSquares
from morphlet.editing.roi import Roi, vertices_within
from morphlet.editing.shell import Shell
from morphlet.errors import InputError
from morphlet.numerics.rotations import exponential
from morphlet.surface.mesh import Mesh

Table = Mapping[str, Any]

DEFAULT = "arap"
SHOWN = 60
"""Letters of a value in a message."""
GUARD, DETAIL = "self-intersection", "multiresolution"
DETAILED = ("arap", "rotations", "laplacian", "biharmonic")
"""Methods that can be laid on a smooth base."""
SOFT = (*DETAILED, "similarity", "dual")
"""Methods that can hold a handle softly."""
MOTION = ("translate", "rotate", "scale")
MOVES = (*MOTION, "targets")
"""What a motion, or a frame of a path, is told by."""
EVERY = (*SOFT, "direct", "mls", "ffd")
KEYS = dict.fromkeys(("method", "handle", "anchors", "roi", *MOVES, "path"), EVERY) | {
    "weight": SOFT,
    "detail": DETAILED,
    "smoothing": ("arap",),
    "volume": ("arap",),
    "guard": ("arap",),
    "iterations": ("dual",),
    "falloff": ("direct",),
    "mls": ("mls",),
    "ffd": ("ffd",),
}
"""The keys of an edit, and the methods they are for."""


@dataclass(frozen=True, eq=False)
class Edit:
    """An edit of a mesh: everything that the editor needs.

    Parameters
    ----------
    name
        Of the method, as in the file.
    method
        How the region follows.
    roi
        What pulls, what follows, what stays.
    pulls
        Where the handle goes, one pull per frame.
    sequence
        Whether a path was told, so that frames come out.
    """

    name: str
    method: Method
    roi: Roi
    pulls: tuple[Pull, ...]
    sequence: bool


@dataclass(frozen=True, eq=False)
class EditSpec:
    """An edit as its file tells it, not tied to a mesh yet.

    Parameters
    ----------
    source
        The file, for messages.
    table
        What is in it.
    """

    source: Path
    table: Table
    method: Method = field(init=False)

    def __post_init__(self) -> None:
        name = self.table.get("method", DEFAULT)
        if name not in EVERY:
            raise InputError(f"one of {', '.join(EVERY)} as method in {self.source}", repr(name), _closest(name, EVERY))
        _known(self.table, KEYS, str(self.source))
        foreign = [key for key in self.table if name not in KEYS[key]]
        if foreign:
            needed = f"keys for the method {name} in {self.source}"
            raise InputError(needed, f"'{foreign[0]}', which is for {' and '.join(KEYS[foreign[0]])}", "remove it, or change the method")
        _one_of(self.table, (MOTION, ("targets",), ("path",)), f"where the handle goes in {self.source}")
        _one_of(self.table, (("anchors",), ("roi",)), f"what may move in {self.source}")
        if "handle" not in self.table:
            raise InputError(f"a handle in {self.source}", "none", "add handle = [...], or handle = {center = [...], radius = ...}")
        for frame in self._frames():
            _one_of(frame, (MOTION, ("targets",)), f"a motion in each frame of the path in {self.source}")
        object.__setattr__(self, "method", _detailed(METHODS[name](self.table), self.table))

    @property
    def sequence(self) -> bool:
        """Whether frames come out."""
        return "path" in self.table

    def on(self, mesh: Mesh, places: Int[np.ndarray, "n"] | None = None) -> Edit:
        """The edit of a mesh.

        Parameters
        ----------
        mesh
            At rest.
        places
            The vertex of the mesh for each vertex of its file, where these differ (seams that were welded), or -1 for one that
            is not in the mesh. Several vertices of a handle that became one must have one target.

        Returns
        -------
        edit
            Region, method and pulls.

        Raises
        ------
        InputError
            If a key does not hold what it should, or does not fit the mesh.
        """
        own = np.arange(mesh.n_vertices) if places is None else np.asarray(places)
        listed = self._vertices("handle", mesh, own)
        kept, group = _joined(listed)
        roi = self._roi(mesh, own, listed[kept])
        pulls = list[Pull]()
        for frame in self._frames() or [self.table]:
            if "targets" in frame:
                targets = _agreeing(_arrays.real(frame["targets"], "targets", (len(listed), 3)), kept, group)
                turns = handle_turns(roi, targets, pulls[-1].turns if pulls else None)
            else:
                targets, turn = _moved(frame, mesh.vertices[roi.handle])
                turns = np.tile(turn, (int(roi.handle_parts.max()) + 1, 1))
            pulls.append(Pull(targets, turns))
        return Edit(self.table.get("method", DEFAULT), self.method, roi, tuple(pulls), self.sequence)

    def _frames(self) -> list[Table]:
        """The tables of the path, checked; none without one."""
        path = self.table.get("path", [])
        if not isinstance(path, list) or not all(isinstance(frame, dict) for frame in path) or ("path" in self.table and not path):
            raise InputError(f"a list of tables as path in {self.source}", _shown(path), "write path = [{translate = [...]}, ...]")
        for frame in path:
            _known(frame, dict.fromkeys(MOVES), f"path in {self.source}")
        return path

    def _vertices(self, key: str, mesh: Mesh, places: Int[np.ndarray, "n"]) -> Int[np.ndarray, "k"]:
        """The vertices of the mesh that a key tells, in its order; a list must name each once."""
        value = self.table[key]
        if isinstance(value, dict):
            ball = _table(value, ("center", "radius"), f"{key} in {self.source}")
            return vertices_within(mesh, _vector(ball, "center"), _length(ball["radius"], "radius", mesh))
        numbers = _arrays.index(value, key, (None,), len(places))
        if len(np.unique(numbers)) < len(numbers):
            found = f"{len(numbers) - len(np.unique(numbers))} repeated"
            raise InputError(f"each vertex of {key} once in {self.source}", found, "remove the repetitions", numbers)
        lost = numbers[places[numbers] < 0]
        if len(lost):
            needed = f"vertices that belong to faces as {key} in {self.source}"
            raise InputError(needed, f"{len(lost)} that do not", "leave them out", lost)
        return places[numbers]

    def _roi(self, mesh: Mesh, places: Int[np.ndarray, "n"], handle: Int[np.ndarray, "h"]) -> Roi:
        """The region, its handle held as hard as is told."""
        if "anchors" in self.table:
            roi = Roi.between(mesh, handle, np.unique(self._vertices("anchors", mesh, places)))
        else:
            told = {"metric": "geodesic", **_table(self.table["roi"], ("radius", "metric"), f"roi in {self.source}", ("metric",))}
            roi = Roi.within(mesh, handle, _length(told["radius"], "radius", mesh), told["metric"])
        return roi.softened(_number(self.table, "weight")) if "weight" in self.table else roi


def read_edit(path: str | os.PathLike[str], mesh: Mesh) -> Edit:
    """Read an edit of a mesh from a TOML file.

    Parameters
    ----------
    path
        The file; its keys are told at the top of this module.
    mesh
        The mesh it is for.

    Returns
    -------
    edit
        Region, method and pulls.

    Raises
    ------
    FileError
        If the file cannot be read or is not TOML.
    InputError
        If a key is unknown, is not for the method, is missing, or holds what it should not.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh
    >>> from morphlet.editing.editor import RoiEditor
    >>> from morphlet.editing.script import read_edit
    >>> strip = Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [0, 2, 0], [1, 2, 0]], [[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]])
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "lift.toml")
    ...     _ = file.write_text("method = 'laplacian'\\nhandle = [4, 5]\\nanchors = [0, 1]\\ntranslate = [0, 0, 2]\\n")
    ...     wanted = read_edit(file, strip)
    >>> RoiEditor.prepare(wanted.roi, wanted.method).positions(wanted.pulls[0])[:, 2].round(12).tolist()
    [1.0, 1.0, 2.0, 2.0]
    """
    return read_spec(path).on(mesh)


def read_spec(path: str | os.PathLike[str]) -> EditSpec:
    """Read an edit from a TOML file, without the mesh it is for: all that can be told to be wrong without it is.

    Raises
    ------
    FileError
        If the file cannot be read or is not TOML.
    InputError
        If a key is unknown, is not for the method, or is missing.
    """
    place = Path(path)
    return EditSpec(place, _store.toml(place, f"a TOML file at {place}"))


def _detailed(method: Method, table: Table) -> Method:
    """The method, on a smooth base if that is told."""
    if "detail" not in table:
        return method
    _word(table, "detail", DETAIL)
    return Multiresolution(method)


def _word(table: Table, key: str, word: str) -> None:
    """Refuse any other value of a key that has one."""
    if table.get(key, word) != word:
        raise InputError(f"'{word}' as {key}", _shown(table[key]), "write this, or leave it out")


def _rigid(table: Table) -> Method:
    """As rigid as possible: plain or smoothed; with its volume; without running through itself."""
    kept = table.get("volume", False)
    if not isinstance(kept, bool):
        raise InputError("true or false as volume", _shown(kept), "correct it")
    _word(table, "guard", GUARD)
    if "smoothing" in table and (kept or "guard" in table):
        raise InputError("smoothing alone, or volume and guard", "both", "remove one of them: a guarded surface has a thickness instead")
    if "guard" in table:
        return Guarded(Shell(volume="kept" if kept else "free"))
    if kept:
        return Shell(thickness=0.0)
    return Arap(smoothing=_number(table, "smoothing")) if "smoothing" in table else Arap()


def _falloff(table: Table) -> Direct:
    return Direct(table.get("falloff", Direct.falloff))


def _moving(table: Table) -> MovingLeastSquares:
    told = _table(table.get("mls", {}), ("kind", "alpha"), "mls", ("kind", "alpha"))
    return MovingLeastSquares(
        told.get("kind", MovingLeastSquares.kind), _number(told, "alpha") if "alpha" in told else MovingLeastSquares.alpha
    )


def _lattice(table: Table) -> Lattice:
    told = _table(table.get("ffd", {}), ("lattice", "basis"), "ffd", ("lattice", "basis"))
    return Lattice(told.get("lattice", Lattice.shape), told.get("basis", Lattice.basis))


METHODS: dict[str, Callable[[Table], Method]] = {
    "arap": _rigid,
    "rotations": lambda table: EstimatedRotations(),
    "laplacian": lambda table: Laplacian(order=1),
    "biharmonic": lambda table: Laplacian(order=2),
    "similarity": lambda table: SimilarityLaplacian(),
    "dual": lambda table: DualLaplacian(_count(table, "iterations", DualLaplacian.iterations)),
    "direct": _falloff,
    "mls": _moving,
    "ffd": _lattice,
}
"""How each method is made from the file."""


def _known(table: Table, keys: Mapping[str, Any], place: str) -> None:
    """Refuse unknown keys."""
    for key in table:
        if key not in keys:
            raise InputError(f"known keys in {place}: {', '.join(keys)}", f"'{key}'", _closest(key, keys))


def _closest(name: Any, known: Any) -> str:
    """What may have been meant."""
    near = difflib.get_close_matches(str(name), list(known), n=1)
    return f"did you mean '{near[0]}'?" if near else "use one of these"


def _one_of(table: Table, groups: tuple[tuple[str, ...], ...], what: str) -> None:
    """Refuse keys of no group, or of several."""
    told = [[key for key in group if key in table] for group in groups]
    found = [keys for keys in told if keys]
    if len(found) != 1:
        choices = " or ".join("/".join(group) for group in groups)
        raise InputError(f"{what}: {choices}", " and ".join(keys[0] for keys in found) or "none of them", "tell it one way")


def _table(value: Any, keys: tuple[str, ...], place: str, optional: tuple[str, ...] = ()) -> Table:
    """A table that has these keys and no others."""
    if not isinstance(value, dict):
        raise InputError(f"a table with {' and '.join(keys)} as {place}", _shown(value), f"write {{{keys[0]} = ...}}")
    _known(value, dict.fromkeys(keys), place)
    missing = [key for key in keys if key not in value and key not in optional]
    if missing:
        raise InputError(f"{missing[0]} in {place}", ", ".join(value) or "nothing", "add it")
    return value


def _number(table: Table, key: str) -> float:
    """A finite number."""
    value = table[key]
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"a number as {key}", _shown(value), "correct it")
    return float(value)


def _count(table: Table, key: str, default: int) -> int:
    """An integer."""
    value = table.get(key, default)
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError(f"an integer as {key}", _shown(value), "correct it")
    return value


def _vector(table: Table, key: str) -> Float[np.ndarray, "3"]:
    """Three finite numbers."""
    return _arrays.real(table[key], key, (3,))


def _length(value: Any, key: str, mesh: Mesh) -> float:
    """A length in mesh units, or a share of the bounding-box diagonal."""
    if not isinstance(value, str):
        return _number({key: value}, key)
    try:
        share = float(value.strip().removesuffix("%"))
    except ValueError:
        share = math.nan
    if not (value.strip().endswith("%") and math.isfinite(share)):
        raise InputError(f'a number or a text like "5%" as {key}', _shown(value), "correct it")
    return share / 100 * mesh.bbox_diagonal


def _joined(listed: Int[np.ndarray, "l"]) -> tuple[Int[np.ndarray, "h"], Int[np.ndarray, "l"]]:
    """Rows at which a vertex is listed first, and which of these each row repeats."""
    _, first, group = np.unique(listed, return_index=True, return_inverse=True)
    order = np.argsort(first)
    return first[order], np.argsort(order)[group]


def _agreeing(targets: Float[np.ndarray, "l 3"], kept: Int[np.ndarray, "h"], group: Int[np.ndarray, "l"]) -> Float[np.ndarray, "h 3"]:
    """One target for each vertex; rows of one vertex must be the same."""
    apart = np.flatnonzero((targets[kept][group] != targets).any(axis=1))
    if len(apart):
        needed = "one target for handle vertices at one place"
        raise InputError(needed, f"{len(apart)} that differ", "give the copies of a vertex the same target", apart)
    return targets[kept]


def _moved(frame: Table, rest: Float[np.ndarray, "h 3"]) -> tuple[Float[np.ndarray, "h 3"], Float[np.ndarray, "3"]]:
    """Targets of a handle that is scaled, turned and shifted, and its rotation vector."""
    turn, centre = _turn(frame.get("rotate"), rest.mean(axis=0))
    scale = _number(frame, "scale") if "scale" in frame else 1.0
    if scale <= 0:
        raise InputError("a scale above 0", f"{scale:g}", "turn the handle instead of reflecting it")
    shift = _vector(frame, "translate") if "translate" in frame else np.zeros(3)
    return scale * (rest - centre) @ exponential(turn[None])[0].T + centre + shift, turn


def _turn(value: Any, middle: Float[np.ndarray, "3"]) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
    """Rotation vector and centre; a turn by nothing about the middle of the handle where none is told."""
    if value is None:
        return np.zeros(3), middle
    told = _table(value, ("axis", "degrees", "center"), "rotate", ("center",))
    axis = _vector(told, "axis")
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise InputError("an axis with a direction in rotate", "[0, 0, 0]", "name a direction")
    centre = middle if told.get("center", "handle") == "handle" else _vector(told, "center")
    return np.radians(_number(told, "degrees")) / length * axis, centre


def _shown(value: Any) -> str:
    """A value in a message, not too long."""
    text = repr(value)
    return text if len(text) <= SHOWN else f"{text[: SHOWN - 3]}..."
