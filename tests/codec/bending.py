"""Sequences to tell."""

import numpy as np

from morphlet import Mesh, MeshSequence


def bent(rest: Mesh, count: int, amount: float = 0.3) -> MeshSequence:
    """A body that bends more from frame to frame, and rises."""
    low, high = rest.vertices[:, 2].min(), rest.vertices[:, 2].max()
    frames = [rest.vertices]
    for k in range(1, count):
        angle = amount * k * (rest.vertices[:, 2] - low) / max(high - low, 1e-9)
        x, y, z = rest.vertices.T
        frames.append(np.stack([x * np.cos(angle) + z * np.sin(angle), y + 0.1 * k, z * np.cos(angle) - x * np.sin(angle)], axis=1))
    return MeshSequence(rest.topology, np.stack(frames), np.arange(float(count)))
