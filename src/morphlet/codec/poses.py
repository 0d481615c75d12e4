"""Frames of a sequence as packets, and back: references, what contexts remember, one packet after the other."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import islice
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from morphlet.codec import frames
from morphlet.codec.container import FRAMES, Packet, damaged
from morphlet.codec.frames import MOST_REFERENCES, SHARE_MOST, SHARE_ONE, Order, Past
from morphlet.codec.hierarchy import Records
from morphlet.codec.range_coder import FAULT, Coder, consumed, copied, full, opened, renewed, writer, written
from morphlet.errors import SolveError

Reference = Literal["rest", "previous", "best"]

DEAD_ZONE = 0.55
"""Differences below 0.55 steps become none, others lose up to 0.45: best size at equal squared error, by trial."""
ERROR_PER_STEP = float(np.sqrt(3.0)) * max(DEAD_ZONE, 1 - DEAD_ZONE)
"""Largest distance of a vertex from where it was, in steps: DEAD_ZONE along each of three axes."""
FINEST_ONE = 64
"""Files store the share of the step that the coarsest vertices have in 1/64."""
WINDOW = 16
"""Frames that references are taken from, beside the rest mesh."""
REST, AHEAD = 0, WINDOW + 1
"""Numbers of references: the rest mesh, 1 to 16 frames back, and where the last two frames lead."""
TRIED = 1200
"""Records that references are compared on."""
WORTH = 0.985
"""A further reference must lower the estimated size to this share: it costs time."""
REFITS = 3
STEADY = 1e-6
"""Added to a blend's squares, in squared steps: references that agree leave no system without solution."""
SMALL_ROOM = 1 << 16
BYTES_PER_VERTEX = 8
"""A writer starts with so much room per vertex and frame, and takes four times as much whenever that was too little."""
CANDIDATES: dict[Reference, tuple[int, ...]] = {
    "rest": (REST,),
    "previous": (REST, 1, 2, AHEAD),
    "best": tuple(range(AHEAD + 1)),
}
"""Which references are looked at."""


@dataclass(frozen=True)
class Law:
    """How frames are told: step, its share for the coarsest vertices (in 64ths), which references, frames per
    packet, layers, the error that must hold."""

    step: float
    finest: int
    reference: Reference
    packet_frames: int
    layers: int
    error: float


@dataclass(eq=False)
class Told:
    """What writer and reader both know of the frames so far: positions by frame, the rest first, and the contexts' memory."""

    rest: Float[np.ndarray, "n 3"]
    order: Order
    coder: Coder
    past: Past
    kept: dict[int, Float[np.ndarray, "n 3"]] = field(default_factory=dict)
    memory: dict[int, tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n 3"]]] = field(default_factory=dict)
    choices: dict[int, Int[np.ndarray, "c"]] = field(default_factory=dict)

    def reference(self, number: int, frame: int) -> Float[np.ndarray, "n 3"] | None:
        """Positions of a reference of a frame (counted from 1); None if there is none of that number."""
        if number == REST:
            return self.rest
        if number == AHEAD:
            last, before = self.kept.get(frame - 1), self.kept.get(frame - 2)
            return None if last is None or before is None else 2 * last - before
        return self.kept.get(frame - number)

    def blend(self, frame: int) -> tuple[Float[np.ndarray, "k n 3"], Float[np.ndarray, "k"]]:
        """The references that a frame's choice names, and their shares."""
        choice = self.choices[frame]
        found = [self.reference(int(choice[1 + 2 * k]), frame) for k in range(int(choice[0]))]
        if any(z is None for z in found):
            raise damaged(f"frame {frame} with a reference that is not there")
        shares = choice[2 : 2 + 2 * len(found) : 2] / SHARE_ONE
        shares[0] = 1 - shares[1:].sum()
        return np.ascontiguousarray(np.stack([z for z in found if z is not None])), shares

    def start(self, frame: int, layers: int) -> None:
        """Room for a frame; without layers, frames that no reference can name are forgotten."""
        n = len(self.rest)
        self.kept[frame] = np.zeros((n, 3))
        self.memory[frame] = np.zeros(n, np.int64), np.zeros((n, 3), np.int64)
        if layers == 1:
            for store in (self.kept, self.memory, self.choices):
                store.pop(frame - WINDOW - 1, None)

    def remembered(self, frame: int) -> Past:
        """The contexts' memory within a frame."""
        size, symbol = self.memory[frame]
        return self.past._replace(size=size, symbol=symbol)


def told_nothing(rest: Float[np.ndarray, "n 3"], records: Records, coder: Coder) -> Told:
    """The state before the first frame."""
    n = len(rest)
    order = Order(records.removed, records.offsets, records.rings, records.closed, records.roots)
    none = np.zeros(n, np.int64), np.zeros((n, 3), np.int64)
    return Told(rest, order, coder, Past(*none, none[0].copy(), none[1].copy()))


def new_writer() -> Coder:
    """A coder for the first packet."""
    return writer(SMALL_ROOM, frames.CONTEXTS, frames.MIXERS)


def new_reader() -> Coder:
    """A coder that has learnt nothing, for packets to be opened with."""
    return writer(0, frames.CONTEXTS, frames.MIXERS)


def span_of(layer: int, layers: int, count: int) -> tuple[int, int]:
    """First and last record (exclusive, downwards) of a layer: each has four times the vertices of those before."""
    told = [0, *(count >> (2 * (layers - 1 - k)) for k in range(layers))]
    return count - told[layer], count - told[layer + 1]


def packets(told: Told, poses: Iterable[Float[np.ndarray, "n 3"]], law: Law) -> Iterator[Packet]:
    """Packets of all frames: coarse layers of all frames first; without layers, as the frames come."""
    source = iter(poses)
    everything = list(source) if law.layers > 1 else []
    for layer in range(law.layers):
        stream, frame = iter(everything) if law.layers > 1 else source, 1
        while group := list(islice(stream, law.packet_frames)):
            coder = renewed(told.coder, SMALL_ROOM + BYTES_PER_VERTEX * len(told.rest) * len(group))
            for pose in group:
                coder = _write_frame(told, coder, pose, (frame, layer), law)
                frame += 1
            told.coder = coder
            yield Packet(FRAMES, len(group), layer, written(coder))


def _write_frame(told: Told, coder: Coder, pose: Float[np.ndarray, "n 3"], which: tuple[int, int], law: Law) -> Coder:
    """One layer of one frame: again, from what was known before it, if the writer's room was too small."""
    frame, layer = which
    if layer == 0:
        told.start(frame, law.layers)
        told.choices[frame] = _choice(told, pose, frame, law)
    while True:
        trial, past = copied(coder), Past(*(part.copy() for part in told.remembered(frame)))
        if layer == 0:
            frames.code_choice(trial, told.choices[frame].copy())
        _code(told, trial, pose, which, law, past)
        if not full(trial):
            break
        coder = coder._replace(buffer=np.concatenate([coder.buffer, np.zeros(3 * len(coder.buffer), np.uint8)]))
    if layer + 1 == law.layers:
        _check(told.kept[frame], pose, frame, law)
    told.memory[frame] = past.size, past.symbol
    told.past = told.past._replace(old_size=past.old_size, old_symbol=past.old_symbol)
    return trial


def _check(found: Float[np.ndarray, "n 3"], pose: Float[np.ndarray, "n 3"], frame: int, law: Law) -> None:
    """The error holds, or the frame is refused."""
    worst = float(np.sqrt(np.max(np.sum((found - pose) ** 2, axis=1))))
    if worst > law.error:
        raise SolveError(f"frame {frame} within {law.error:.6g}", f"{worst:.6g}", "report this sequence; a smaller error goes round it")


def _code(told: Told, coder: Coder, pose: Float[np.ndarray, "n 3"], which: tuple[int, int], law: Law, past: Past) -> None:
    """One layer of one frame through the kernel; where the coder is empty, nothing is read and nothing differs."""
    frame, layer = which
    blend, shares = told.blend(frame)
    span = *span_of(layer, law.layers, len(told.order.removed)), int(len(coder.buffer) > 0), int(layer == 0)
    steps = np.array([law.step, law.finest / FINEST_ONE, DEAD_ZONE])
    frames.code_frame(coder, pose, blend, shares, told.kept[frame], told.order, np.array(span), steps, past)


def read_packet(told: Told, packet: Packet, first: int, law: Law) -> Iterator[int]:
    """The frames of a packet, whose first is number `first`, one after the other as they are read."""
    coder = opened(told.coder, packet.payload)
    nothing = np.zeros((0, 3))
    for frame in range(first, first + packet.count):
        if packet.layer == 0:
            told.start(frame, law.layers)
            told.choices[frame] = np.zeros(1 + 2 * MOST_REFERENCES, np.int64)
            frames.code_choice(coder, told.choices[frame])
        _code(told, coder, nothing, (frame, packet.layer), law, told.remembered(frame))
        if coder.state[FAULT] > 0 or not np.isfinite(told.kept[frame]).all():
            raise damaged(f"frame {frame} that cannot be read")
        if frame + 1 < first + packet.count:
            yield frame
    if not consumed(coder):
        raise damaged("frames that leave bytes over")
    told.coder = coder
    if packet.count:
        yield first + packet.count - 1


def guess_layers(told: Told, frame: int, layer: int, law: Law) -> None:
    """Tell the layers of a frame from `layer` on by prediction alone."""
    nothing = writer(0, 0, 0)
    nothing.state[:] = 0
    for k in range(layer, law.layers):
        _code(told, nothing, np.zeros((0, 3)), (frame, k), law, told.remembered(frame))


def _choice(told: Told, pose: Float[np.ndarray, "n 3"], frame: int, law: Law) -> Int[np.ndarray, "c"]:
    """References of a frame: greedily, the blend whose open-loop differences on some records seem to cost fewest bits."""
    choice = np.zeros(1 + 2 * MOST_REFERENCES, np.int64)
    choice[0] = 1
    numbers = [k for k in CANDIDATES[law.reference] if k == REST or (law.layers == 1 and told.reference(k, frame) is not None)]
    count = len(told.order.removed)
    if len(numbers) < 2 or not count:
        return choice
    records = np.arange(0, count, max(count // TRIED, 1))
    goal = pose[told.order.removed[records]]
    places = np.stack([_open_loop(told, pose, number, frame, records) for number in numbers])
    chosen, shares = _greedy(places, goal, law.step)
    choice[0] = len(chosen)
    choice[1 : 1 + 2 * len(chosen) : 2] = [numbers[k] for k in chosen]
    choice[2 : 2 + 2 * len(chosen) : 2] = shares
    return choice


def _open_loop(
    told: Told, pose: Float[np.ndarray, "n 3"], number: int, frame: int, records: Int[np.ndarray, "s"]
) -> Float[np.ndarray, "s 3"]:
    """Where a reference would carry the vertices of some records, were the rings told exactly."""
    reference = told.reference(number, frame)
    if reference is None:
        raise SolveError("a reference that is there", f"number {number} of frame {frame}", "report this")
    places = np.empty((len(records), 3))
    frames.open_loop(pose, np.ascontiguousarray(reference), told.order, records, places)
    return places


def _greedy(places: Float[np.ndarray, "k s 3"], goal: Float[np.ndarray, "s 3"], step: float) -> tuple[list[int], Int[np.ndarray, "c"]]:
    """Which of k predictions to blend, and the shares of the blend in 64ths."""
    chosen: list[int] = []
    shares, size = np.zeros(0, np.int64), np.inf
    while len(chosen) < min(MOST_REFERENCES, len(places)):
        left = [k for k in range(len(places)) if k not in chosen]
        trials = [_blended(places[[*chosen, k]], goal, step) for k in left]
        best = int(np.argmin([trial[0] for trial in trials]))
        if trials[best][0] > WORTH * size:
            break
        (size, shares), chosen = trials[best], [*chosen, left[best]]
    return chosen, shares


def _blended(places: Float[np.ndarray, "k s 3"], goal: Float[np.ndarray, "s 3"], step: float) -> tuple[float, Int[np.ndarray, "k"]]:
    """Estimated size of the differences from the best blend of these predictions, and its shares in 64ths."""
    terms, left = places[1:] - places[0], goal - places[0]
    wanted, shares = left, np.zeros(len(terms), np.int64)
    for _ in range(REFITS if len(terms) else 0):
        trust = 1 / np.maximum(np.sqrt(np.einsum("sj,sj->s", left, left)), step / 2)
        weighted = terms * trust[:, None]
        gram = np.einsum("ksj,lsj->kl", weighted, terms) + step**2 * STEADY * np.eye(len(terms))
        found = np.linalg.solve(gram, np.einsum("ksj,sj->k", weighted, wanted))
        most = SHARE_ONE * SHARE_MOST
        shares = np.clip(np.round(found * SHARE_ONE), -most, most - 1).astype(np.int64)
        left = wanted - np.einsum("k,ksj->sj", shares / SHARE_ONE, terms)
    size = np.sum(np.log2(1 + np.einsum("sj,sj->s", left, left) / step**2))
    return float(size), np.r_[0, shares]
