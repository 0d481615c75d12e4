"""A wavelet network: a weighted sum of wavelets and an affine part (Eqs. 3, 6).

The paper's w_i, t_i and d_i are the `weights`, `centers` and `dilations` here:

    y(x) = c_0 + c_1 x + sum_i w_i psi_i((x - t_i) / d_i)

Wavelets have zero mean, so what is affine has its own part. Each wavelet has its own mother and its own weights: in Eq. 6,
the sum over the mothers is over disjoint sets of wavelets.
"""

import os
from collections import Counter
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.wavenet.library import by_mother, sampled, scaled, wavelets

KIND, VERSION = "wavelet network", 1
ARRAYS = ("mothers", "centers", "dilations", "weights", "affine")


@dataclass(frozen=True, eq=False)
class WaveletNetwork:
    """p wavelets that map x to k outputs.

    Parameters
    ----------
    mothers
        Names of the mothers, one per wavelet.
    centers, dilations
        Places and rms radii (positive), in units of x.
    weights
        Of the wavelets in each output.
    affine
        Constants and slopes of each output.

    Raises
    ------
    InputError
        If shapes do not agree, a mother is unknown, a number is not finite, or a dilation is not positive.

    Examples
    --------
    >>> from morphlet.wavenet.network import WaveletNetwork
    >>> net = WaveletNetwork(("polywog1",), [0.5], [0.1], [[2.0, 0.0]], [[0.0, 1.0], [0.0, 3.0]])
    >>> net(np.array([0.5, 1.0])).round(3)
    array([[0. , 2.5],
           [0. , 4. ]])
    >>> net.counts()
    {'polywog1': 1}
    """

    mothers: tuple[str, ...]
    centers: Float[np.ndarray, "p"]
    dilations: Float[np.ndarray, "p"]
    weights: Float[np.ndarray, "p k"]
    affine: Float[np.ndarray, "2 k"]

    def __post_init__(self) -> None:
        names, centers, dilations = wavelets(self.mothers, self.centers, self.dilations)
        affine = _arrays.real(self.affine, "affine", (2, None))
        object.__setattr__(self, "mothers", names)
        object.__setattr__(self, "centers", centers)
        object.__setattr__(self, "dilations", dilations)
        object.__setattr__(self, "weights", _arrays.real(self.weights, "weights", (len(names), affine.shape[1])))
        object.__setattr__(self, "affine", affine)

    def __reduce__(self) -> tuple[Any, ...]:
        return WaveletNetwork, (self.mothers, *(np.array(getattr(self, name)) for name in ARRAYS[1:]))

    def __len__(self) -> int:
        return len(self.mothers)

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
        values = sampled(self.mothers, scaled(x, self.centers, self.dilations))
        return self.affine[0] + np.multiply.outer(x, self.affine[1]) + values @ self.weights

    def jacobian(self, x: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n k"]:
        """Slopes of the outputs at each x.

        Raises
        ------
        InputError
            If a number is not finite.

        Examples
        --------
        >>> from morphlet.wavenet.network import WaveletNetwork
        >>> WaveletNetwork((), [], [], np.zeros((0, 1)), [[1.0], [3.0]]).jacobian(np.array([0.5]))
        array([[3.]])
        """
        x = _arrays.real(x, "x", (None,))
        z = scaled(x, self.centers, self.dilations)
        slopes = np.empty(z.shape)
        for psi, columns in by_mother(self.mothers):
            slopes[:, columns] = psi.derivative(z[:, columns])
        return self.affine[1] + (slopes / self.dilations) @ self.weights

    def counts(self) -> dict[str, int]:
        """How many wavelets there are of each mother, in the order of their first."""
        return dict(Counter(self.mothers))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the network to an `.npz` file.

        Raises
        ------
        FileError
            If the file cannot be written.
        """
        names = np.array(self.mothers, dtype=str)
        _store.save(path, KIND, VERSION, {"mothers": names} | {name: getattr(self, name) for name in ARRAYS[1:]})

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "WaveletNetwork":
        """Read what `save` wrote.

        Raises
        ------
        FileError
            If the file is no wavelet network.
        """
        arrays = _store.load(path, KIND, VERSION, ARRAYS)
        names = tuple(str(name) for name in arrays["mothers"].ravel())
        try:
            return cls(names, *(arrays[name] for name in ARRAYS[1:]))
        except InputError as error:
            raise FileError(f"a wavelet network in {path}: {error.needed}", error.found, "write it again", error.elements) from error
