"""Binary frames from the server to a page: a header of fixed size, then arrays of four-byte elements."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

MAGIC = int.from_bytes(b"MLST", "little")
VERSION = 1
HEADER = struct.Struct("<IHHHHIIIIIII")
"""magic, version, kind, slot, flags, frame, mesh, set, count, extra, seq, nothing."""
FRAME_AT = 12
"""Byte at which the number to acknowledge stands."""
WORD = 4
WITH_COLORS = WITH_DISTORTION = LAID = 1
"""Flags: colours behind a mesh, distortion behind a frame, a sphere laid into another."""
ALL = 0
"""The set of all vertices."""


class Kind(IntEnum):
    """What a frame holds."""

    MESH = 1
    SUBSET = 2
    FRAME = 3
    ROLES = 4
    SPHERE = 5
    LABELS = 6
    IMAGES = 7


class Slot(IntEnum):
    """Which scene a frame is for."""

    SOURCE = 0
    TARGET = 1
    MORPH = 2


@dataclass(frozen=True, eq=False)
class Frame:
    """What is to be sent; its number is written when it is.

    Parameters
    ----------
    kind, slot
        What it holds, and where it belongs.
    mesh
        Number of the mesh that it is for.
    arrays
        In the order of the protocol.
    count, extra
        Rows of the arrays.
    subset
        Number of the subset that the rows are of; 0 for all vertices.
    flags, seq
        See the protocol.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.studio.frames import Frame, Kind, Slot
    >>> frame = Frame(Kind.ROLES, Slot.SOURCE, 1, (np.array([2, 1, 0], np.uint8),), 3)
    >>> len(frame.data(9)), frame.data(9)[:4], frame.data(9)[-4:]
    (44, b'MLST', b'\\x02\\x01\\x00\\x00')
    """

    kind: Kind
    slot: Slot
    mesh: int
    arrays: Sequence[np.ndarray]
    count: int
    extra: int = 0
    subset: int = ALL
    flags: int = 0
    seq: int = 0

    @property
    def key(self) -> tuple[int, int, bool]:
        """Of frames with the same key a page needs the last one only."""
        return int(self.slot), int(self.kind), self.subset == ALL or self.kind == Kind.SUBSET

    def replaces(self, key: tuple[int, int, bool]) -> bool:
        """Whether an older frame with this key has nothing to tell any more once this one is there."""
        slot, kind, whole = key
        if slot != self.slot or self.kind not in (Kind.MESH, Kind.SUBSET, Kind.FRAME):
            return key == self.key
        if self.kind == Kind.MESH:
            return True
        partial = kind == Kind.FRAME and not whole
        return key == self.key or (partial and (self.kind == Kind.SUBSET or self.subset == ALL))

    def data(self, number: int) -> bytes:
        """The bytes, with the number that the page acknowledges."""
        head = HEADER.pack(
            MAGIC, VERSION, self.kind, self.slot, self.flags, number, self.mesh, self.subset, self.count, self.extra, self.seq, 0
        )
        parts = [np.ascontiguousarray(array) for array in self.arrays]
        return b"".join([head, *(part.data for part in parts), bytes(-sum(part.nbytes for part in parts) % WORD)])
