"""Distances between meshes, from the maps between them; and places in the plane that keep them.

The distance of two meshes is ``arccosh(E) / sqrt(2)`` of the energy E of the map between them, both scaled to unit area: for a map that
stretches alike everywhere, the root of the sum of the squared logarithms of its two stretches. It is 0 where the map is an isometry, so it
tells shapes from each other, and not poses; 1.1 in both directions everywhere is 0.13.
"""

import csv
import io
import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from morphlet import _arrays, _store

KIND, VERSION = "distances", 1
PLANE = 2
"""Coordinates of a place."""


@dataclass(frozen=True, eq=False)
class Distances:
    """How far meshes are from each other.

    Parameters
    ----------
    names
        Of the meshes.
    values
        Distances, 0 on the diagonal, NaN where there is no map.

    Examples
    --------
    >>> import numpy as np
    >>> three = Distances(("a", "b", "c"), np.array([[0, 3, 4], [3, 0, 5], [4, 5, 0.0]]))
    >>> places = three.places()
    >>> [round(float(np.linalg.norm(places[i] - places[j])), 6) for i, j in ((0, 1), (0, 2), (1, 2))]
    [3.0, 4.0, 5.0]
    """

    names: tuple[str, ...]
    values: Float[np.ndarray, "k k"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "values", _arrays.freeze(np.array(self.values, np.float64)))

    @cached_property
    def known(self) -> Bool[np.ndarray, "k k"]:
        """Between which meshes there is a map."""
        return _arrays.freeze(np.isfinite(self.values) & ~np.eye(len(self.names), dtype=bool))

    @property
    def largest(self) -> float | None:
        """The largest distance; None if there is none."""
        return float(self.values[self.known].max()) if self.known.any() else None

    @cached_property
    def complete(self) -> Float[np.ndarray, "k k"]:
        """Distances, with the shortest way through other meshes where there is no map; infinite where there is no way."""
        found = np.where(np.isfinite(self.values), self.values, np.inf)
        for through in range(len(found)):
            way = found[:, [through]] + found[[through]]
            found = np.where(self.known, found, np.minimum(found, way))
        return _arrays.freeze(found)

    @property
    def connected(self) -> Bool[np.ndarray, "k"]:
        """Meshes that are joined to as many others as any is."""
        reached = np.isfinite(self.complete)
        most = int(np.argmax(reached.sum(axis=1)))
        return reached[most]

    def places(self) -> Float[np.ndarray, "k 2"]:
        """Points in the plane whose distances are near these: classical scaling; NaN for meshes that are not `connected`.

        Notes
        -----
        The two largest eigenvalues of the doubly centred squared distances. The axis along which the first mesh lies to the right,
        or below, is turned so that it does not: the picture is the same every time. O(k^3).

        References
        ----------
        Torgerson, Multidimensional scaling: I. Theory and method, Psychometrika 1952.
        """
        out = np.full((len(self.names), PLANE), np.nan)
        chosen = np.flatnonzero(self.connected)
        squared = self.complete[np.ix_(chosen, chosen)] ** 2
        middle = squared - squared.mean(axis=0) - squared.mean(axis=1)[:, None] + squared.mean()
        values, vectors = np.linalg.eigh(-middle / 2)
        kept = min(PLANE, len(chosen))
        found = vectors[:, ::-1][:, :kept] * np.sqrt(np.maximum(values[::-1][:kept], 0))
        found = found * np.where(found[0] > 0, -1.0, 1.0)
        out[chosen] = 0.0
        out[chosen, :kept] = found
        return out

    @property
    def stress(self) -> float | None:
        """How far the distances of `places` are from these, as a share (Kruskal's stress 1); None if there is none."""
        if not self.known.any():
            return None
        places = self.places()
        apart = np.linalg.norm(places[:, None] - places[None], axis=2)
        kept = self.known & np.isfinite(apart)
        return float(np.sqrt(np.sum((apart[kept] - self.values[kept]) ** 2) / max(np.sum(self.values[kept] ** 2), np.finfo(float).tiny)))

    def write(self, folder: Path) -> list[Path]:
        """Write distances.npz (names, distances, places) and distances.csv.

        Raises
        ------
        FileError
            If a file cannot be written.
        """
        arrays = {"names": np.array(self.names, np.str_), "distances": np.array(self.values), "places": self.places()}
        _store.save(folder / "distances.npz", KIND, VERSION, arrays)
        text = io.StringIO()
        rows = csv.writer(text, lineterminator="\n")
        rows.writerow(["", *self.names])
        rows.writerows([name, *("" if np.isnan(d) else f"{d:.6g}" for d in row)] for name, row in zip(self.names, self.values, strict=True))
        with _store.beside(folder / "distances.csv") as temporary:
            temporary.write_text(text.getvalue(), encoding="utf-8")
        return [folder / "distances.npz", folder / "distances.csv"]


def distance(energy: float) -> float:
    """The distance of two meshes from the energy of the map between them.

    Examples
    --------
    >>> distance(1.0), round(distance((1.1**2 + 1.1**-2) / 2), 3)
    (0.0, 0.135)
    """
    return float(np.arccosh(max(energy, 1.0)) / np.sqrt(2.0))


def read_distances(folder: Path, names: list[str]) -> Distances:
    """The distances that are told beside the maps in a folder; those without a map are unknown.

    Parameters
    ----------
    folder
        Holds A--B.json for A before B.
    names
        Of the meshes, in order.
    """
    values = np.full((len(names), len(names)), np.nan)
    np.fill_diagonal(values, 0.0)
    for i, a in enumerate(names):
        for j in range(i + 1, len(names)):
            file = folder / f"{a}--{names[j]}.json"
            if file.is_file():
                values[i, j] = values[j, i] = distance(json.loads(file.read_text(encoding="utf-8"))["energy"])
    return Distances(tuple(names), values)
