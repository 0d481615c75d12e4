"""A wavelet network: a weighted sum of wavelets and an affine part (Eqs. 3, 6).

The paper's w_i, t_i and d_i are the `weights`, `centers` and `dilations` here:

    y(x) = c_0 + c_1 x + sum_i w_i psi_i((x - t_i) / d_i)

Wavelets have zero mean, so what is affine has its own part. Each wavelet has its own mother and its own weights: in Eq. 6,
the sum over the mothers is over disjoint sets of wavelets.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.wavenet.library import Wavelets, different, freeze_wavelets, sampled, scaled
from morphlet.wavenet.mothers import Mother, mother

KIND, VERSION = "wavelet network", 1
ARRAYS = ("mothers", "kinds", "centers", "dilations", "weights", "affine")


@dataclass(frozen=True, eq=False)
class WaveletNetwork:
    """p wavelets that map x to k outputs.

    Parameters
    ----------
    mothers
        Different mothers.
    kinds
        Which of the mothers each wavelet has.
    centers, dilations
        Places and rms radii (positive), in units of x.
    weights
        Of the wavelets in each output.
    affine
        Constants and slopes of each output.

    Raises
    ------
    InputError
        If shapes do not agree, two mothers have one name, a kind is no mother's, a number is not finite, or a dilation is
        not positive.

    Examples
    --------
    >>> from morphlet.wavenet.network import WaveletNetwork
    >>> from morphlet.wavenet.mothers import MOTHERS
    >>> net = WaveletNetwork((MOTHERS["polywog1"],), [0], [0.5], [0.1], [[2.0, 0.0]], [[0.0, 1.0], [0.0, 3.0]])
    >>> net(np.array([0.5, 1.0])).round(3)
    array([[0. , 2.5],
           [0. , 4. ]])
    >>> net.counts()
    {'polywog1': 1}
    """

    mothers: tuple[Mother, ...]
    kinds: Int[np.ndarray, "p"]
    centers: Float[np.ndarray, "p"]
    dilations: Float[np.ndarray, "p"]
    weights: Float[np.ndarray, "p k"]
    affine: Float[np.ndarray, "2 k"]

    def __post_init__(self) -> None:
        freeze_wavelets(self)
        affine = _arrays.real(self.affine, "affine", (2, None))
        object.__setattr__(self, "weights", _arrays.real(self.weights, "weights", (len(self), affine.shape[1])))
        object.__setattr__(self, "affine", affine)

    def __reduce__(self) -> tuple[Any, ...]:
        return WaveletNetwork, (self.mothers, *(np.array(getattr(self, name)) for name in ARRAYS[1:]))

    def __len__(self) -> int:
        return len(self.centers)

    def __repr__(self) -> str:
        return f"WaveletNetwork({len(self)} wavelets, {self.affine.shape[1]} outputs)"

    def __call__(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k"]:
        """The outputs at each x.

        Parameters
        ----------
        x
            Finite numbers, inside the range of the samples or not.

        Raises
        ------
        InputError
            If a number is not finite.
        """
        x = _arrays.real(x, "x", (None,))
        return self.affine[0] + np.multiply.outer(x, self.affine[1]) + sampled(self, x) @ self.weights

    def jacobian(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k"]:
        """Slopes of the outputs at each x.

        Raises
        ------
        InputError
            If a number is not finite.

        Examples
        --------
        >>> from morphlet.wavenet.network import WaveletNetwork
        >>> WaveletNetwork((), [], [], [], np.zeros((0, 1)), [[1.0], [3.0]]).jacobian(np.array([0.5]))
        array([[3.]])
        """
        x = _arrays.real(x, "x", (None,))
        slopes = scaled(x, self.centers, self.dilations)
        for kind, psi in enumerate(self.mothers):
            columns = self.kinds == kind
            slopes[:, columns] = psi.derivative(slopes[:, columns])
        return self.affine[1] + (slopes / self.dilations) @ self.weights

    def counts(self) -> dict[str, int]:
        """How many wavelets there are of each mother."""
        return counted(self)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to an `.npz` file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        _store.save(path, KIND, VERSION, {name: getattr(self, name) for name in ARRAYS[1:]} | named(self.mothers))

    @classmethod
    def load(cls, path: str | os.PathLike[str], mothers: Sequence[Mother] = ()) -> "WaveletNetwork":
        """Read what `save` wrote; own mothers have to be passed.

        Raises
        ------
        InputError
            If what is passed are no mothers, or two of one name.
        FileError
            If the file is no wavelet network, or has a mother that is not known.
        """
        own, arrays = different(mothers), _store.load(path, KIND, VERSION, ARRAYS)
        with refused_as_file(KIND, path):
            return cls(found(arrays["mothers"], own), *(arrays[name] for name in ARRAYS[1:]))


def counted(wavelets: Wavelets) -> dict[str, int]:
    """How many wavelets there are of each mother, in the order of the mothers."""
    counts = np.bincount(wavelets.kinds, minlength=len(wavelets.mothers))
    return {psi.name: int(count) for psi, count in zip(wavelets.mothers, counts, strict=True)}


def named(mothers: tuple[Mother, ...]) -> dict[str, np.ndarray]:
    """How files keep mothers: by name."""
    return {"mothers": np.array([psi.name for psi in mothers], dtype=str)}


def found(names: np.ndarray, own: Sequence[Mother]) -> tuple[Mother, ...]:
    """The mothers of these names, the own ones first."""
    given = {psi.name: psi for psi in own}
    return tuple(given.get(str(name)) or mother(str(name)) for name in names.ravel())


@contextmanager
def refused_as_file(kind: str, path: str | os.PathLike[str]) -> Iterator[None]:
    """What a value refuses is a fault of the file it was read from."""
    try:
        yield
    except InputError as error:
        raise FileError(f"a {kind} in {path}: {error.needed}", error.found, "write it again", error.elements) from error
