"""The one door through which outside arrays come in: copy, check, freeze.

`real` and `index` return C-contiguous float64 / int64 copies that are read-only, or raise `InputError` naming the
argument. A dimension of `None` is free. Inner code neither re-checks nor copies.
"""

from typing import Any

import numpy as np

from morphlet.errors import InputError

Shape = tuple[int | None, ...]


def freeze(array: np.ndarray) -> np.ndarray:
    """The same array, read-only."""
    array.flags.writeable = False
    return array


def real(values: Any, name: str, shape: Shape) -> np.ndarray:
    """Finite float64 values of the given shape, copied and frozen."""
    array = _copy(values, name, np.float64)
    _check_shape(array, name, shape)
    bad = ~np.isfinite(array)
    if bad.any():
        rows = np.unique(np.nonzero(bad)[0]) if array.ndim else np.zeros(1, np.int64)
        raise InputError(
            f"finite numbers in {name}",
            f"{int(bad.sum())} NaN or infinite values in {len(rows)} of {len(np.atleast_1d(array))} rows",
            "remove or replace these rows",
            rows,
        )
    return freeze(array)


def index(values: Any, name: str, shape: Shape, below: int) -> np.ndarray:
    """Int64 indices in [0, below) of the given shape, copied and frozen."""
    raw = _copy(values, name, None)
    if raw.size and raw.dtype.kind not in "iu" and not (raw.dtype.kind == "f" and np.all(raw == np.floor(raw))):
        raise InputError(f"integer indices in {name}", f"values of type {raw.dtype}", "convert them to integers")
    array = _copy(raw, name, np.int64)
    if array.size == 0 and None in shape:
        array = array.reshape([0 if s is None else s for s in shape])
    _check_shape(array, name, shape)
    if array.size and (array.min() < 0 or array.max() >= below):
        outside = (array < 0) | (array >= below)
        rows = np.unique(np.nonzero(outside)[0])
        raise InputError(
            f"indices from 0 to {below - 1} in {name}",
            f"{int(outside.sum())} outside that range in {len(rows)} rows",
            "check that the indices are 0-based and belong to this mesh",
            rows,
        )
    return freeze(array)


def unit(values: Any, name: str) -> np.ndarray:
    """Directions (k, 3), scaled to unit length, copied and frozen; a zero direction is refused."""
    array = np.array(real(values, name, (None, 3)))
    length = np.linalg.norm(array, axis=1)
    zero = np.nonzero(length == 0)[0]
    if len(zero):
        raise InputError(f"non-zero directions in {name}", f"{len(zero)} zero vectors", "remove these rows", zero)
    return freeze(array / length[:, None])


def _copy(values: Any, name: str, dtype: type | None) -> np.ndarray:
    try:
        return np.array(values, dtype=dtype, order="C")
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"an array of numbers as {name}", f"{type(values).__name__} ({error})", "pass a rectangular array") from error


def _check_shape(array: np.ndarray, name: str, shape: Shape) -> None:
    fits = array.ndim == len(shape) and all(s is None or s == n for s, n in zip(shape, array.shape, strict=True))
    if not fits:
        wanted = ", ".join("any" if s is None else str(s) for s in shape)
        raise InputError(f"{name} of shape ({wanted})", f"shape {array.shape}", "reshape or transpose the array")
