"""All exhibits in the order of the paper, and how they are made one after another."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from morphlet.errors import Cancelled
from morphlet.paper import contest, diagrams, equations, figures, tables
from morphlet.paper.exhibit import Exhibit
from morphlet.paper.subjects import Stock

Maker = Callable[[Stock], Exhibit]


@dataclass(frozen=True)
class Entry:
    """A table or figure of the paper.

    Parameters
    ----------
    name
        As the paper numbers it.
    title
        What it is about, in the paper's sense.
    make
        How it is computed.
    """

    name: str
    title: str
    make: Maker


ENTRIES = (
    Entry("Equations", "Equations (1) to (12)", equations.checks),
    Entry("Table 1", "The size of each object", tables.table_1),
    Entry("Table 2", "Number of wavelets against distances", tables.table_2),
    Entry("Table 3", "MSE, deformation rate and frame rate by wavelet library", tables.table_3),
    Entry("Table 4", "Wavelets used for the Horse", tables.table_4),
    Entry("Table 5", "Wavelets used for the Cat", tables.table_5),
    Entry("Table 6", "Wavelets used for the Face", tables.table_6),
    Entry("Table 7", "Wavelets used for the Bunny", tables.table_7),
    Entry("Figure 1", "Free-form deformation of the bunny", figures.figure_1),
    Entry("Figure 2", "A mouth deformed in different ways", figures.figure_2),
    Entry("Figure 3", "Two radii of the region of interest", figures.figure_3),
    Entry("Figure 4", "Correspondence, both ways", figures.figure_4),
    Entry("Figure 5", "The network", diagrams.figure_5),
    Entry("Figure 6", "The feature-based algorithm", diagrams.figure_6),
    Entry("Figure 7", "The deformation, step by step", diagrams.figure_7),
    Entry("Figure 8", "Original and target objects", figures.figure_8),
    Entry("Figure 9", "By way of a simplified mesh, and directly", contest.figure_9),
    Entry("Figure 10", "Feature regions", figures.figure_10),
    Entry("Figure 11", "Spherical parameterizations", figures.figure_11),
    Entry("Figure 12", "x, y and z before and after", figures.figure_12),
    Entry("Figure 13", "Deformation of the Horse", figures.figure_13),
    Entry("Figure 14", "Deformation of the Cat", figures.figure_14),
    Entry("Figure 15", "Deformation of the Face", figures.figure_15),
    Entry("Figure 16", "Deformation of the Bunny", figures.figure_16),
)
"""Every table and figure of the paper."""


@dataclass(frozen=True)
class Made:
    """What became of an entry: the exhibit, or why there is none.

    Parameters
    ----------
    entry
        What was to be made.
    exhibit
        The exhibit; None if it failed.
    failure
        What went wrong; empty if nothing did.
    """

    entry: Entry
    exhibit: Exhibit | None
    failure: str = ""

    @property
    def ok(self) -> bool:
        """Whether it was made, and every check in it holds."""
        return self.exhibit is not None and not self.broken

    @property
    def broken(self) -> tuple[str, ...]:
        """Checks that do not hold."""
        table = None if self.exhibit is None else self.exhibit.table
        if table is None or "holds" not in table.heads:
            return ()
        place = table.heads.index("holds")
        return tuple(str(row[0]) for row in table.rows if not row[place])


def make(entry: Entry, stock: Stock, folder: Path) -> Made:
    """Make an exhibit and write its files; a failure is kept, so that the others go on.

    Raises
    ------
    Cancelled
        If the stock's `on_step` asked for it.

    Examples
    --------
    >>> import tempfile
    >>> from morphlet.paper.book import Entry, make
    >>> def broken(stock):
    ...     raise ValueError("no data")
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     make(Entry("Table 0", "none", broken), Stock(Path(folder), 1500), Path(folder)).failure
    'ValueError: no data'
    """
    try:
        exhibit = entry.make(stock)
        exhibit.save(folder, entry.name)
    except Cancelled:
        raise
    except Exception as error:  # whatever it is: the report tells it, and the other exhibits do not depend on it
        return Made(entry, None, f"{type(error).__name__}: {error}")
    return Made(entry, exhibit)
