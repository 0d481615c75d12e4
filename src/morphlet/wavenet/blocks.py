"""The matrix IC: the networks of a signal that was cut into blocks, all in one table (steps 5-9).

Blocks are sampled at the same x. Each has a network of its own, of its own number of wavelets; a row of the table is one
wavelet: its mother, its center t, its dilation d and its weights w.
"""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays, _store
from morphlet.errors import InputError
from morphlet.wavenet.library import different, freeze_wavelets, sampled
from morphlet.wavenet.mothers import Mother
from morphlet.wavenet.network import WaveletNetwork, counted, found, named, refused_as_file

KIND, VERSION = "wavelet network table", 1
ARRAYS = ("mothers", "offsets", "kinds", "centers", "dilations", "weights", "affine")


@dataclass(frozen=True, eq=False)
class NetworkTable:
    """The networks of b blocks, p wavelets in all, with k outputs each.

    Parameters
    ----------
    mothers
        Different mothers.
    offsets
        The wavelets of block i are those from offsets[i] to offsets[i + 1].
    kinds
        Which of the mothers each wavelet has.
    centers, dilations
        Places and rms radii (positive), in units of x.
    weights
        Of the wavelets in each output.
    affine
        Constants and slopes of each output of each block.

    Raises
    ------
    InputError
        If shapes do not agree, offsets do not rise from 0 to p, or as for a `WaveletNetwork`.

    Examples
    --------
    >>> from morphlet.wavenet.blocks import NetworkTable
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> two = NetworkTable((MOTHERS["slog1"],), [0, 0, 1], [0], [0.5], [0.1], [[2.0]], np.zeros((2, 2, 1)))
    >>> len(two), two[1]
    (2, WaveletNetwork(1 wavelets, 1 outputs))
    >>> two(np.array([0.4, 0.5, 0.6])).shape
    (2, 3, 1)
    """

    mothers: tuple[Mother, ...]
    offsets: Int[np.ndarray, "b1"]
    kinds: Int[np.ndarray, "p"]
    centers: Float[np.ndarray, "p"]
    dilations: Float[np.ndarray, "p"]
    weights: Float[np.ndarray, "p k"]
    affine: Float[np.ndarray, "b 2 k"]

    def __post_init__(self) -> None:
        freeze_wavelets(self)
        p = len(self.centers)
        offsets = _arrays.index(self.offsets, "offsets", (None,), p + 1)
        if not len(offsets) or offsets[0] or offsets[-1] != p or (np.diff(offsets) < 0).any():
            raise InputError(
                f"offsets that rise from 0 to {p}", str(offsets[:8]), "give where the wavelets of each block start, and the end"
            )
        affine = _arrays.real(self.affine, "affine", (len(offsets) - 1, 2, None))
        object.__setattr__(self, "offsets", offsets)
        object.__setattr__(self, "weights", _arrays.real(self.weights, "weights", (p, affine.shape[2])))
        object.__setattr__(self, "affine", affine)

    def __reduce__(self) -> tuple[Any, ...]:
        return NetworkTable, (self.mothers, *(np.array(getattr(self, name)) for name in ARRAYS[1:]))

    def __len__(self) -> int:
        return len(self.affine)

    def __repr__(self) -> str:
        return f"NetworkTable({len(self)} blocks, {len(self.centers)} wavelets, {self.affine.shape[2]} outputs)"

    def __getitem__(self, i: int) -> WaveletNetwork:
        """The network of a block."""
        part = slice(*self.offsets[range(len(self))[i] :][:2])
        arrays = (self.kinds[part], self.centers[part], self.dilations[part], self.weights[part])
        return WaveletNetwork(self.mothers, *arrays, self.affine[i])

    def __call__(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "b n k"]:
        """The outputs of every block at each x.

        Raises
        ------
        InputError
            If a number is not finite.
        """
        x = _arrays.real(x, "x", (None,))
        values = self.affine[:, None, 0] + x[None, :, None] * self.affine[:, None, 1]
        psi = sampled(self, x)
        for i, (first, last) in enumerate(zip(self.offsets[:-1], self.offsets[1:], strict=True)):
            values[i] += psi[:, first:last] @ self.weights[first:last]
        return values

    def counts(self) -> dict[str, int]:
        """How many wavelets there are of each mother."""
        return counted(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the table to an `.npz` file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        _store.save(path, KIND, VERSION, self.arrays())

    def arrays(self) -> dict[str, np.ndarray]:
        """What a file holds of it, by name."""
        return {name: getattr(self, name) for name in ARRAYS[1:]} | named(self.mothers)

    @classmethod
    def load(cls, path: str | os.PathLike[str], mothers: Sequence[Mother] = ()) -> "NetworkTable":
        """Read what `save` wrote; own mothers have to be passed.

        Raises
        ------
        InputError
            If what is passed are no mothers, or two of one name.
        FileError
            If the file is no such table, or has a mother that is not known.
        """
        own, arrays = different(mothers), _store.load(path, KIND, VERSION, ARRAYS)
        with refused_as_file(KIND, path):
            return cls(found(arrays["mothers"], own), *(arrays[name] for name in ARRAYS[1:]))


def joined(tables: Sequence[NetworkTable]) -> NetworkTable:
    """The blocks of several tables of the same mothers, one after another.

    Examples
    --------
    >>> from morphlet.wavenet.blocks import NetworkTable, joined
    >>> affine = NetworkTable((), [0, 0], [], [], [], np.zeros((0, 1)), np.ones((1, 2, 1)))
    >>> len(joined([affine, affine, affine]))
    3
    """
    counts = np.concatenate([np.diff(table.offsets) for table in tables])
    arrays = (np.concatenate([getattr(table, name) for table in tables]) for name in ARRAYS[2:])
    return NetworkTable(tables[0].mothers, np.append(0, np.cumsum(counts)), *arrays)
