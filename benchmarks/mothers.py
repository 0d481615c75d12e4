"""The mother wavelets in figures: a table of them all, how alike they are, how alike the paper's bumps are to Gaussians.

    python benchmarks/mothers.py [--picture PATH] [--json FILE] [--markdown]

`--picture` draws every mother with its derivative. Nothing here is a time: the same figures on any machine.
"""

import argparse
from pathlib import Path

import numpy as np
from numpy.polynomial import Polynomial
from scipy.integrate import quad
from scipy.signal import fftconvolve
from scipy.special import expit

from book import Sheet, Table, add_options
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX, SHAPES, Mother, beta, coherence

LOPSIDED = (beta(1, 4, 8), beta(2, 4, 8), beta(2, 8, 4))
COMPARED = (*PAPER_SIX, *(MOTHERS[name] for name in ("slog2", "polywog2", "polywog3", "polywog5")), *LOPSIDED[:2])
EXPONENTS = ((4, 4), (5, 5), (10, 10), (30, 30), (4, 8))
GAUSSIANS = ("polywog1", "mexican_hat", "polywog2")
"""Derivatives of a Gaussian of order 1, 2 and 3."""
FAR = 40.0
"""Where the unbounded mothers have faded out to less than 1e-16."""
SHOWN = 4.2
"""Half-width of the pictures, in rms radii."""
COLUMNS, PANEL = 4, (2.6, 1.9)
"""Of the picture: panels side by side, and the size of each in inches."""
SLOPES = 1 / 3
"""Scale of the derivatives in the picture, so that they fit on the axes of the mothers."""
PARITIES = {"even": "even, ", "odd": "odd, ", "none": ""}
BLUE, RED, GREY = "#0072B2", "#D55E00", "#999999"


def published(psi: Mother) -> tuple[float, float, float]:
    """Energy, rms radius and largest value of a mother as it is published, before it is normalised."""
    if psi.name in SHAPES:
        shape = SHAPES[psi.name]
        function, (low, high) = shape.function, np.clip(shape.support, -FAR, FAR)
    else:
        function, (low, high) = bump_derivative(psi), (-1.0, 1.0)
    energy, first, second = (quad(lambda t, k=k: t**k * float(function(np.array(t))) ** 2, low, high, limit=400)[0] for k in range(3))
    largest = np.abs(function(np.linspace(low, high, 80001))).max()
    return energy, float(np.sqrt(second / energy - (first / energy) ** 2)), float(largest)


def bump_derivative(psi: Mother) -> Polynomial:
    """What `beta` normalises, from its name, for integer exponents: the polynomial itself."""
    n, p, q = (int(number) for number in psi.name.removeprefix("beta").replace("(", ",").rstrip(")").split(","))
    top = (p - q) / (p + q)
    return ((Polynomial([1, 1]) / (1 + top)) ** p * (Polynomial([1, -1]) / (1 - top)) ** q).deriv(n)


def all_mothers() -> Table:
    """What holds for the normalised one, then what was published."""
    heads, lines = ["mother", "parity", "vanishing moments", "reach", "energy", "rms radius", "largest value"], []
    for psi in (*MOTHERS.values(), *LOPSIDED):
        energy, radius, largest = published(psi)
        figures = (f"{v:.5g}" for v in (energy, radius, largest))
        lines.append([psi.name, psi.parity, psi.vanishing_moments, f"{psi.reach:.2f}", *figures])
    return Table("Mother wavelets", heads, lines)


def matrix() -> Table:
    """Coherence of the paper's six and a few more."""
    lines = [[a.name, *(f"{coherence(a, b):.4f}" if j <= i else "" for j, b in enumerate(COMPARED))] for i, a in enumerate(COMPARED)]
    return Table("Coherence", ["", *(psi.name for psi in COMPARED)], lines)


def gaussians() -> Table:
    """Coherence of the derivatives of the bumps with those of a Gaussian."""
    lines = []
    for p, q in EXPONENTS:
        pairs = [(beta(n, p, q), MOTHERS[GAUSSIANS[n - 1]]) for n in (1, 2, 3)]
        lines.append([f"{p}, {q}", *(f"{coherence(*pair):.4f}" for pair in pairs)])
    lines.append([f"{p}, {q}, shifted too", *(f"{shifted_coherence(*pair):.4f}" for pair in pairs)])
    return Table("Coherence with derivatives of a Gaussian", ["p, q", *(f"order {n}" for n in (1, 2, 3))], lines, notes=[mean_of_slog2()])


def shifted_coherence(a: Mother, b: Mother) -> float:
    """The largest |cosine| over dilations and shifts."""
    t = np.linspace(-16, 16, 2001)
    dilations = np.geomspace(0.5, 2, 201)
    overlaps = [np.abs(fftconvolve(a(t), b(-t / d))).max() / np.sqrt(d) for d in dilations]
    return float(max(overlaps)) * float(t[1] - t[0])


def mean_of_slog2() -> str:
    """Integrals of slog2 as it is often printed, with its last two terms at one place, and as it is here."""
    printed = quad(lambda t: 3 * expit(t + 1) - 3 * expit(t - 1) - 3 * expit(t + 3) + 3 * expit(t + 3), -FAR, FAR, points=(-1, 1))[0]
    here = quad(lambda t: float(SHAPES["slog2"].function(np.array(t))), -FAR, FAR, points=(-3, -1, 1, 3))[0]
    return f"Integral of slog2 as often printed: {printed:.4f}; as here: {abs(here):.1e}"


def draw(path: Path) -> None:
    """Every mother and its derivative, normalised, on the same axes."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    shown = [psi for psi in MOTHERS.values() if psi.name != "polywog4"] + list(LOPSIDED[:2])
    rows = -(-len(shown) // COLUMNS)
    t = np.linspace(-SHOWN, SHOWN, 841)
    with mpl.rc_context({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False}):
        figure = Figure(figsize=(COLUMNS * PANEL[0], rows * PANEL[1] + 0.3), layout="constrained")
        FigureCanvasAgg(figure)
        panels = figure.subplots(rows, COLUMNS, sharex=True, squeeze=False, gridspec_kw={"hspace": 0.08, "wspace": 0.05})
        for psi, panel in zip(shown, panels.flat, strict=True):
            panel.axhline(0, color=GREY, linewidth=0.5)
            panel.axvspan(-psi.reach, psi.reach, color=GREY, alpha=0.12, linewidth=0)
            (slope,) = panel.plot(t, SLOPES * psi.derivative(t), color=RED, linewidth=0.9, linestyle=(0, (4, 1.5)))
            (value,) = panel.plot(t, psi(t), color=BLUE, linewidth=1.6)
            panel.set(xlim=(-SHOWN, SHOWN), ylim=(-1.2, 1.2), xticks=range(-4, 5, 2), yticks=(-1, 0, 1))
            name = f"{psi.name} = polywog4" if psi.name == "mexican_hat" else psi.name
            panel.set_title(f"{name}: {PARITIES[psi.parity]}{moments(psi)}", fontsize=8, loc="left")
        labels = ["mother wavelet (unit norm, unit rms radius)", "a third of its derivative", "reach: 99.9 % of the energy"]
        handles = [value, slope, panels.flat[0].patches[0]]
        figure.legend(handles, labels, loc="outside lower center", ncols=3, frameon=False)
        figure.savefig(path, dpi=110)


def moments(psi: Mother) -> str:
    """How many there are, in words."""
    return f"{psi.vanishing_moments} moment{'s' if psi.vanishing_moments > 1 else ''}"


def main() -> None:
    """Print the tables; draw the picture if asked."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--picture", type=Path)
    add_options(parser)
    options = parser.parse_args()
    sheet = Sheet.of(options)
    for make in (all_mothers, matrix, gaussians):
        sheet.add(make())
    if options.picture:
        draw(options.picture)


if __name__ == "__main__":
    main()
