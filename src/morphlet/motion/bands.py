"""Bands: two shapes of one mesh, each a sum of parts from coarse to fine that belong together."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from morphlet import _arrays
from morphlet.approximation.surface import DEFAULT, ApproximationOptions, approximate
from morphlet.errors import InputError
from morphlet.sphere.map import SphericalMap
from morphlet.wavenet.spherical import SphericalNetwork

WAVELETS = 500
"""Unless told otherwise: as for one surface."""
SAME_OCTAVE = 1e-6
"""Octaves by which a dilation may exceed its own through rounding."""


@dataclass(frozen=True, eq=False)
class Bands:
    """b parts of the positions of a source and of a target, from coarse to fine; their sums are the positions.

    Parameters
    ----------
    source, target
        The parts.

    Raises
    ------
    InputError
        If shapes differ, there is no band, or a value is not finite.

    Examples
    --------
    >>> import numpy as np
    >>> from morphlet.motion.bands import Bands
    >>> bands = Bands([[[0, 0, 0]], [[1, 0, 0]]], [[[4, 0, 0]], [[3, 0, 0]]])
    >>> bands.blend(np.array([0.5, 0.0]))
    array([[3., 0., 0.]])
    """

    source: Float[np.ndarray, "b n 3"]
    target: Float[np.ndarray, "b n 3"]

    def __post_init__(self) -> None:
        source = _arrays.real(self.source, "source", (None, None, 3))
        if not len(source):
            raise InputError("at least one band", "none", "pass the positions as one band")
        object.__setattr__(self, "source", source)
        object.__setattr__(self, "target", _arrays.real(self.target, "target", source.shape))

    def __reduce__(self) -> tuple[Any, ...]:
        return Bands, (np.array(self.source), np.array(self.target))

    def __len__(self) -> int:
        return len(self.source)

    def __repr__(self) -> str:
        return f"Bands({len(self)} of {self.source.shape[1]} vertices)"

    def blend(self, shares: Float[np.ndarray, "b *n"]) -> Float[np.ndarray, "n 3"]:
        """Positions where each band has gone this share of its way from source to target, everywhere or at each vertex."""
        columns = shares.reshape(len(self), -1)
        return np.einsum("bn,bnd->nd", 1 - columns, self.source) + np.einsum("bn,bnd->nd", columns, self.target)


def wavelet_bands(
    mapped: SphericalMap,
    target_positions: Float[np.ndarray, "n 3"],
    n_wavelets: int = WAVELETS,
    options: ApproximationOptions = DEFAULT,
) -> Bands:
    """Both shapes of a mapped mesh by the resolution of the wavelets that make them.

    One network of spherical wavelets is fitted to source and target at once, so that both have the same wavelets. The first band
    is the affine part; the next ones are the wavelets by octaves of their dilation, from wide to narrow; what the network leaves
    goes with the last, so that the sums are exact.

    Parameters
    ----------
    mapped
        The source and its spherical map.
    target_positions
        Where its vertices are at the end.
    n_wavelets, options
        How many wavelets at most, and which, as for `approximate`.

    Returns
    -------
    Bands
        At least two.

    Raises
    ------
    InputError
        If there is not one finite target position per vertex, or an option is out of range.

    Notes
    -----
    The fit takes nearly all the time: 5 CPU s for 500 wavelets on 7k vertices.

    Examples
    --------
    >>> from morphlet import Mesh
    >>> from morphlet.approximation.surface import ApproximationOptions
    >>> from morphlet.motion.bands import wavelet_bands
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.sphere.map import spherical_map
    >>> points, faces = icosphere(3)
    >>> egg = Mesh(points * [1.0, 1.3, 1.7] + 0.1 * np.cos(7 * points[:, [0]]), faces)
    >>> wavelet_bands(spherical_map(egg), points, 40, ApproximationOptions(levels=2))
    Bands(3 of 642 vertices)
    """
    source = mapped.mesh.vertices
    target = _arrays.real(target_positions, "target_positions", source.shape)
    network = approximate(mapped, np.hstack([source, target]), n_wavelets, options).network
    parts = [network.affine[0] + mapped.points @ network.affine[1:], *_octaves(network, mapped.points)]
    if len(parts) == 1:
        parts.append(np.zeros(parts[0].shape))
    parts[-1] = np.hstack([source, target]) - sum(parts[:-1])
    whole = np.stack(parts)
    return Bands(whole[:, :, :3], whole[:, :, 3:])


def _octaves(network: SphericalNetwork, points: Float[np.ndarray, "n 3"]) -> list[Float[np.ndarray, "n k"]]:
    """What the wavelets of each octave add up to, the widest first."""
    if not len(network):
        return []
    octave = np.floor(np.log2(network.dilations.max() / network.dilations) + SAME_OCTAVE).astype(np.int64)
    return [_chosen(network, octave == k)(points) for k in range(octave.max() + 1)]


def _chosen(network: SphericalNetwork, which: Bool[np.ndarray, "p"]) -> SphericalNetwork:
    """Some of the wavelets, without the affine part."""
    arrays = {name: getattr(network, name)[which] for name in ("kinds", "centers", "directions", "dilations", "weights")}
    return replace(network, affine=np.zeros(network.affine.shape), **arrays)
