"""Curves of bytes against error from the figures that `codec.py --json` wrote.

    python benchmarks/codec_pictures.py FIGURES.json OUT.png

One panel per mesh of the section "surfaces": bytes, on a logarithmic scale, against decibels.
"""

import argparse
import json
from pathlib import Path
from typing import Any

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

CURVES = {"auto": "morphlet", "exact": "morphlet, own faces", "Draco": "Draco", "decimation + Draco": "decimation + Draco"}
COLUMNS = 3
SIZE = 3.2
"""Inches of a panel."""


def panel(axes: Any, name: str, rows: list[dict[str, Any]]) -> None:
    """The curves of one mesh."""
    for key, label in CURVES.items():
        found = [(row["dB"], row[key]) for row in rows if isinstance(row.get(key), int)]
        if found:
            axes.plot(*zip(*found, strict=True), marker="o", markersize=3, linewidth=1.2, label=label)
    axes.set_yscale("log")
    axes.set_title(name, fontsize=9)
    axes.set_xlabel("dB", fontsize=8)
    axes.set_ylabel("bytes", fontsize=8)
    axes.tick_params(labelsize=7)
    axes.grid(alpha=0.3)


def draw(rows: list[dict[str, Any]], output: Path) -> None:
    """A panel per mesh."""
    names = list(dict.fromkeys(row["mesh"] for row in rows))
    lines = -(-len(names) // COLUMNS)
    figure, axes = plt.subplots(lines, COLUMNS, figsize=(COLUMNS * SIZE, lines * SIZE), squeeze=False)
    for place, axis in enumerate(axes.flat):
        axis.set_visible(place < len(names))
        if place < len(names):
            panel(axis, names[place], [row for row in rows if row["mesh"] == names[place]])
    axes[0, 0].legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(output, dpi=90)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("figures", type=Path)
    parser.add_argument("output", type=Path)
    options = parser.parse_args()
    draw(json.loads(options.figures.read_text())["figures"]["surfaces"], options.output)


if __name__ == "__main__":
    main()
