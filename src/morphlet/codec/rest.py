"""A mesh on an integer lattice as bytes: its faces, its positions, and the order its vertices and faces came in."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from morphlet.codec import connectivity, geometry
from morphlet.codec.connectivity import Border, Plan
from morphlet.codec.container import Header, damaged
from morphlet.codec.range_coder import FAULT, Coder, consumed, full, many_weights, reader, writer, written
from morphlet.codec.shuffle import CONTEXTS as SHUFFLE_CONTEXTS
from morphlet.codec.shuffle import MIXERS as SHUFFLE_MIXERS
from morphlet.codec.shuffle import code_numbers
from morphlet.errors import SolveError

FIRST_ROOM = 1 << 16
"""Bytes that a writer starts with; doubled until they are enough."""
FACES_PER_BYTE = 64
"""A reader first makes room for so many faces per byte, and for four times as many whenever that was too little."""
SPARE = 1024


@dataclass(frozen=True, eq=False)
class Shape:
    """Faces in the file's order, with what both sides derive from them: `corner`, `twin`, a half-edge out of each vertex."""

    corner: Int[np.ndarray, "h"]
    twin: Int[np.ndarray, "h"]
    start: Int[np.ndarray, "n"]

    @property
    def faces(self) -> Int[np.ndarray, "m 3"]:
        """Vertices of each face."""
        return self.corner.reshape(-1, 3)


def write_faces(faces: Int[np.ndarray, "m 3"], n: int) -> tuple[bytes, Shape, Int[np.ndarray, "n"], Int[np.ndarray, "m"]]:
    """Bytes, the shape they will be read as, the old number of each new vertex, and the old half-edge at each new face's start."""
    corner = np.ascontiguousarray(faces).ravel().copy()
    twin = connectivity.twins(corner, n)
    size = FIRST_ROOM
    while True:
        plan = Plan(corner, twin, *(np.full(k, -1, np.int64) for k in (len(corner), len(corner), n, n)))
        coder = writer(size, connectivity.CONTEXTS, connectivity.MIXERS)
        border, totals = _border(len(faces), n), np.array([n, len(faces)])
        connectivity.conquer(coder, plan, border, np.empty(len(faces) + 1, np.int64), totals)
        if not full(coder):
            break
        size *= 4
    if coder.state[FAULT] > 0 or totals[1] < len(faces):
        raise SolveError("faces that can be told", f"fault {coder.state[FAULT]} after {totals[1]} of {len(faces)}", "report this mesh")
    left = np.nonzero(plan.vertex < 0)[0]
    order = np.concatenate([plan.order[: totals[0]], left])
    shape, rank = _shape(border.corner, n)
    return written(coder), shape, order[rank], plan.old[::3].copy()


def read_faces(data: bytes, m: int, n: int, loose: int) -> Shape:
    """The shape of n vertices, at most `loose` of them without faces, and m faces; room is made as the bytes tell them."""
    room = min(m, FACES_PER_BYTE * len(data) + SPARE)
    nothing = np.zeros(0, np.int64)
    plan = Plan(*(nothing for _ in range(6)))
    while True:
        coder, totals = reader(data, connectivity.CONTEXTS, connectivity.MIXERS), np.array([n, m])
        border = _border(room, min(n, 3 * room))
        totals[0] = min(n, 3 * room)
        done = connectivity.conquer(coder, plan, border, np.empty(room + 1, np.int64), totals)
        if done or coder.state[FAULT] > 0 or room >= m:
            break
        room = min(4 * room, m)
    if not done or not consumed(coder) or n - totals[0] > loose:
        raise damaged("faces that cannot be read")
    return _shape(border.corner, n)[0]


def write_positions(shape: Shape, lattice: Int[np.ndarray, "n 3"]) -> bytes:
    """Bytes of integer positions."""
    size = FIRST_ROOM
    while True:
        coder = writer(size, geometry.CONTEXTS, geometry.MIXERS)
        _code_positions(coder, shape, lattice.copy())
        if not full(coder):
            return written(coder)
        size *= 4


def read_positions(data: bytes, shape: Shape) -> Int[np.ndarray, "n 3"]:
    """The integer positions that these bytes tell."""
    coder, lattice = reader(data, geometry.CONTEXTS, geometry.MIXERS), np.zeros((len(shape.start), 3), np.int64)
    _code_positions(coder, shape, lattice)
    if not consumed(coder):
        raise damaged("positions that cannot be read")
    return lattice


def _code_positions(coder: Coder, shape: Shape, lattice: Int[np.ndarray, "n 3"]) -> None:
    """Positions through the kernel, with nothing learnt yet."""
    six = many_weights(geometry.SIGN_MIXER, geometry.TERMS)
    geometry.code_positions(coder, six, shape.corner, shape.twin, shape.start, geometry.nothing_learnt(), lattice)


def rest_positions(header: Header, lattice: Int[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Where vertices of a lattice lie."""
    return header.spacing * (np.array(header.corner) + lattice)


def write_order(order: Int[np.ndarray, "n"], starts: Int[np.ndarray, "m"]) -> bytes:
    """Bytes of the old number of each vertex, and of the old half-edge at each face's start."""
    size = FIRST_ROOM
    while True:
        coder = writer(size, SHUFFLE_CONTEXTS, SHUFFLE_MIXERS)
        _code_order(coder, order.copy(), starts // 3, starts % 3)
        if not full(coder):
            return written(coder)
        size *= 4


def read_order(data: bytes, n: int, m: int) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "m"]]:
    """What `write_order` was given."""
    coder = reader(data, SHUFFLE_CONTEXTS, SHUFFLE_MIXERS)
    order, rows, turns = np.zeros(n, np.int64), np.zeros(m, np.int64), np.zeros(m, np.int64)
    _code_order(coder, order, rows, turns)
    sound = all(np.array_equal(np.sort(p), np.arange(len(p))) for p in (order, rows)) and bool(np.all((turns >= 0) & (turns < 3)))
    if not consumed(coder) or not sound:
        raise damaged("an order of vertices and faces that cannot be read")
    return order, 3 * rows + turns


def as_they_came(faces: Int[np.ndarray, "m 3"], order: Int[np.ndarray, "n"], starts: Int[np.ndarray, "m"]) -> Int[np.ndarray, "m 3"]:
    """Faces with their old vertices, rows and first corners."""
    out = np.empty_like(faces)
    for k in range(3):
        out[starts // 3, (starts + k) % 3] = order[faces[:, k]]
    return out


def _code_order(coder: Coder, *numbers: np.ndarray) -> None:
    """Sequences of integers, one after the other, each in contexts of its own."""
    for kind, values in enumerate(numbers):
        code_numbers(coder, values, np.int64(kind))


def _border(m: int, n: int) -> Border:
    """Room for a region of m faces and n vertices that has none yet."""
    corner, twin, following, before, link = np.full((5, 3 * m), -1, np.int64)
    return Border(corner, twin, following, before, link, np.full(n, -1, np.int64), np.zeros(n, np.int64))


def _shape(corner: Int[np.ndarray, "h"], n: int) -> tuple[Shape, Int[np.ndarray, "n"]]:
    """The shape with its vertices in the order of positions, and the number that each had."""
    twin, order = connectivity.twins(corner, n), np.empty(n, np.int64)
    geometry.best_order(corner, twin, _starts(corner, n), order)
    rank = np.empty(n, np.int64)
    rank[order] = np.arange(n)
    moved = rank[corner]
    return Shape(moved, twin, _starts(moved, n)), order


def _starts(corner: Int[np.ndarray, "h"], n: int) -> Int[np.ndarray, "n"]:
    """The last half-edge out of each vertex; -1 where there is none."""
    start = np.full(n, -1, np.int64)
    start[corner] = np.arange(len(corner))
    return start
