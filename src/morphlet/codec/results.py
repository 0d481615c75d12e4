"""What encoding is asked for, and what comes of it."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Int

from morphlet.codec import poses
from morphlet.codec.poses import FINEST_ONE, Reference
from morphlet.errors import InputError
from morphlet.surface.sequence import MeshSequence


@dataclass(frozen=True)
class CodecOptions:
    """How a sequence is told.

    Parameters
    ----------
    reference
        What frames are predicted from: the rest mesh; that, the two frames before and where they lead; or a blend of up to
        four of all that and the 16 frames before, at some three times the time.
    order
        "free": vertices and faces come back in the coder's order. "kept": in the caller's, whose order is stored too.
    rest_share
        Spacing of the rest mesh's lattice, in steps of the frames' differences; only sequences have it.
    finest
        Step of the coarsest vertices, which carry all others, in steps of the finest.
    packet_frames
        Frames per packet: a reader gets so many at once.
    layers
        Above 1, packets come coarse to fine, for all frames: a file cut between two packets shows all frames, less precisely.

    Raises
    ------
    InputError
        If a number is out of its range.

    Examples
    --------
    >>> from morphlet import CodecOptions, encode, sample
    >>> file = encode(sample("blob"), error=0.01, options=CodecOptions(order="kept"))
    >>> file.report.order_bytes > 0, file.permutation[:3].tolist()
    (True, [0, 1, 2])
    """

    reference: Reference = "best"
    order: Literal["free", "kept"] = "free"
    rest_share: float = 0.25
    finest: float = 0.375
    packet_frames: int = 16
    layers: int = 1

    def __post_init__(self) -> None:
        choices = {"reference": (self.reference, tuple(poses.CANDIDATES)), "order": (self.order, ("free", "kept"))}
        for name, (value, known) in choices.items():
            if value not in known:
                raise InputError(f"{name} {' or '.join(known)}", repr(value), "choose one of these")
        ranges = {"rest_share": (1e-3, 1.0), "finest": (1 / FINEST_ONE, 1.0), "packet_frames": (1, 1 << 20), "layers": (1, 16)}
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise InputError(f"{name} from {least:g} to {most:g}", f"{getattr(self, name)}", "choose one in that range")


@dataclass(frozen=True)
class EncodeReport:
    """What an encoding came to, measured on the bytes as read back.

    Parameters
    ----------
    mode
        "sequence" or "exact".
    bytes, rest_bytes, frame_bytes, order_bytes
        All; of the rest mesh; of the frames; of the caller's order.
    bits_per_vertex
        Per vertex and frame, the rest mesh among them.
    max_vertex_error, rms
        Of vertices over all frames, in mesh units.
    kg_error
        ``100 |A - A'| / |A - mean A|``, A the coordinates by frame and axis.
    psnr
        20 log10 of the bounding-box diagonal of the first frame over the rms.
    single_precision
        Whether the error holds after rounding to single precision too.
    """

    mode: str
    bytes: int
    rest_bytes: int
    frame_bytes: int
    order_bytes: int
    bits_per_vertex: float
    max_vertex_error: float
    rms: float
    kg_error: float
    psnr: float
    single_precision: bool


@dataclass(frozen=True, eq=False)
class Encoded:
    """Bytes of a `.mlw` file.

    Parameters
    ----------
    data
        The file.
    permutation
        The caller's number of each vertex as it will be read; 0, 1, 2, ... where the order is kept.
    report
        Sizes and errors.
    """

    data: bytes
    permutation: Int[np.ndarray, "n"]
    report: EncodeReport


@dataclass(frozen=True, eq=False)
class Decoded:
    """What a file holds, or as much of it as has come.

    Parameters
    ----------
    sequence
        The rest mesh and the frames.
    mode
        "sequence", "exact", "shape" or "mlwnn".
    complete
        False if the file ends early, between two packets: frames are missing, or are coarser than they were told.
    error
        Largest distance of a vertex from where it was, if complete; of "shape" and "mlwnn", root mean square distance of the surfaces.
    layers
        Of how many parts of the hierarchy the last frame was told; of "shape" and "mlwnn", how many packets have come.
    """

    sequence: MeshSequence
    mode: str
    complete: bool
    error: float
    layers: int
