"""What Draco would take for the mesh of a file, on the same lattice: a size to compare with."""

import numpy as np

from morphlet.codec.container import Limits, Source, read_header
from morphlet.codec.reading import decode
from morphlet.errors import MissingExtra

LEVEL = 10
"""Of Draco's compression, its highest."""


def draco_size(data: bytes) -> int:
    """Bytes of Draco for the mesh of an "exact" or "decimated" file, whose vertices lie on a lattice.

    Raises
    ------
    MissingExtra
        If DracoPy is not installed.
    """
    try:
        import DracoPy  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise MissingExtra("DracoPy", str(error), "pip install 'morphlet[draco]'") from error
    header, _ = read_header(Source([data]), Limits())
    mesh = decode(data)[0]
    steps = round(float(np.ptp(mesh.vertices, axis=0).max()) / header.spacing)
    bits = max(steps.bit_length(), 1)
    return len(
        DracoPy.encode(
            mesh.vertices.astype(np.float32),
            faces=mesh.faces.astype(np.uint32),
            quantization_bits=bits,
            compression_level=LEVEL,
            quantization_range=header.spacing * ((1 << bits) - 1),
            quantization_origin=(header.spacing * np.array(header.corner)).astype(np.float32),
        )
    )
