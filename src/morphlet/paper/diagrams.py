"""Figures 5 to 7, drawn from what the code is: a network from its own wavelets, the flows from the calls of the functions themselves."""

import ast
import inspect
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from types import FunctionType
from typing import TYPE_CHECKING, Any

import numpy as np

from morphlet.approximation.rows import approximate_by_rows, approximate_rows
from morphlet.features.matching import candidates
from morphlet.features.regions import find_regions
from morphlet.mapping.alignment import align_by_pairs
from morphlet.mapping.correspondence import compose
from morphlet.mapping.differential import reconstruct
from morphlet.mapping.embedding import embed
from morphlet.mapping.warp import warp_by_pairs
from morphlet.paper.exhibit import Exhibit
from morphlet.paper.subjects import Stock
from morphlet.pipeline.correspond import correspond, correspond_maps
from morphlet.pipeline.morph import morph_along
from morphlet.report import canvas
from morphlet.report.curves import COLORS
from morphlet.report.page import Plate
from morphlet.sphere.image import spherical_image
from morphlet.sphere.map import map_surface, spherical_map
from morphlet.wavenet.fit import fit_rows
from morphlet.wavenet.network import WaveletNetwork

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

NETWORK = (980, 760)
"""Size of Figure 5, in pixels."""
LINE, MARGIN, INDENT = 58, 24, 46
"""Height of a box of a flow with its gap, space around, and how far each call lies right of its caller, in pixels."""
FLOW_WIDTH = 980
BOX, GAP = 44, 8
"""Height of a box, and of its inner margin."""
LETTERS, LETTERS_LESS = 122, 8
"""Letters that a box has room for, and how many fewer a level below."""
STEP = 150
"""Width of the column with the steps of the paper."""
WIDEST = 5.0
"""Width of the line of the largest weight, in points."""
SAMPLES = 200
"""Places at which a wavelet is drawn."""
DEEPEST = 3
"""How far calls of calls are followed."""
QUIET = ("morphlet.surface.requirements", "morphlet.surface.orientation", "morphlet.sphere.quality", "morphlet.surface.fans")
"""Modules whose calls are left out: they check and count."""
STEPS: dict[Any, str] = {
    spherical_map: "step 1", map_surface: "step 1", find_regions: "step 2", candidates: "step 10", align_by_pairs: "Sect. 6.2, Eq. 7",
    warp_by_pairs: "Sect. 6.2", embed: "Sects. 6.1, 6.2", compose: "Sect. 6", spherical_image: "step 5", approximate_rows: "steps 5 to 8",
    fit_rows: "step 6, Eqs. 5, 6", approximate_by_rows: "steps 3 to 9", reconstruct: "step 11",
    correspond_maps: "steps 2, 10", morph_along: "Sect. 7.2",
}  # fmt: skip
"""Where the paper speaks of what a function does."""
MORPHING = (spherical_map, approximate_by_rows, correspond_maps, reconstruct, morph_along)
"""The flow of Figure 7, in the order of the paper's steps."""


def figure_5(stock: Stock) -> Exhibit:
    """The network: an input, the hidden layer of wavelets, an output neuron for each coordinate."""
    row = stock.horse.rows // 2
    network = approximate_rows(stock.horse.image).table[row]
    caption = (
        f"A network of the deformed {stock.horse.name}: that of row {row} of its geometry image. One input t, {len(network)} wavelets "
        "(each drawn where "
        "it lies in the row), linear outputs x, y, z; lines as thick as their weights, an affine part beside."
    )
    remark = (
        "The paper draws its network without saying what enters it, nor whether x, y and z share their wavelets. Here one place in a "
        "row enters, and "
        "they share them; wavelets have zero mean, so that what is affine needs a part of its own."
    )
    return Exhibit(caption, plates=(Plate(_network(network), "A wavelet network: input, wavelets, outputs"),), remarks=(remark,))


def _network(network: WaveletNetwork) -> bytes:
    """The drawing of a network."""
    width, height = NETWORK
    figure = canvas.sheet(width, height)
    back = _board(figure, NETWORK)
    order, x = np.argsort(network.centers, kind="stable"), np.linspace(0, 1, SAMPLES)
    step = (height - 2 * MARGIN) / (len(network) + 1)
    outputs = [(width - 120.0, height * (0.3 + 0.2 * k)) for k in range(3)]
    largest = float(np.abs(network.weights).max(initial=0.0)) or 1.0
    for place, k in enumerate((*order, -1)):
        middle = MARGIN + (place + 0.5) * step
        back.plot([110, 290], [height / 2, middle], color="#888888", linewidth=0.8, zorder=1)
        weights = network.weights[k] / largest if k >= 0 else network.affine[1] / max(np.abs(network.affine[1]).max(), largest)
        for (right, there), weight, color in zip(outputs, weights, COLORS, strict=False):
            back.plot(
                [500, right], [middle, there], color=color, linewidth=WIDEST * abs(weight), alpha=0.75, zorder=1, solid_capstyle="butt"
            )
        _hidden(figure, network, int(k), (x, middle, step))
    _neuron(back, (90, height / 2), "t")
    for (right, there), name in zip(outputs, "xyz", strict=True):
        _neuron(back, (right, there), name)
    return _png(figure)


def _hidden(figure: "Figure", network: WaveletNetwork, k: int, at: tuple[np.ndarray, float, float]) -> None:
    """A wavelet as a small curve, and its name; the affine part where there is none."""
    x, middle, step = at
    drawn = canvas.axes(figure, canvas.Box(300, middle - 0.42 * step, 130, 0.84 * step))
    if k < 0:
        drawn.plot(x, x, color=canvas.INK, linewidth=1.2)
        name = "affine"
    else:
        psi = network.mothers[network.kinds[k]]
        drawn.plot(x, psi((x - network.centers[k]) / network.dilations[k]), color=canvas.INK, linewidth=1.2)
        name = psi.name
    drawn.set(xticks=[], yticks=[], xlim=(0, 1), facecolor="#f3f5f8")
    figure.text(438 / NETWORK[0], 1 - middle / NETWORK[1], name, ha="left", va="center", fontsize=canvas.SMALL, color=canvas.INK)


def _neuron(board: "Axes", at: tuple[float, float], name: str) -> None:
    """A round node with a letter."""
    board.plot(*at, "o", markersize=30, color="white", markeredgecolor=canvas.INK, zorder=3)
    board.text(*at, name, ha="center", va="center", fontsize=13, style="italic", color=canvas.INK, zorder=4)


def figure_6(stock: Stock) -> Exhibit:
    """The feature-based algorithm."""
    caption = "The feature-based algorithm, as the code has it: the calls of `correspond`, in their order, with what each says of itself."
    picture = _flow(list(_calls_below(correspond)))
    remark = "The paper's figure names its boxes only. Read as the code reads it; the paper's steps stand beside those calls that do them."
    return Exhibit(caption, plates=(Plate(picture, "The calls of the feature-based algorithm"),), remarks=(remark,))


def figure_7(stock: Stock) -> Exhibit:
    """The deformation, step by step."""
    calls = [call for function in MORPHING for call in (Call(function, 0), *_calls_below(function, 1, 2))]
    caption = "The whole deformation, steps 1 to 11: the functions that do them, and what these call."
    remark = (
        "Step 9 goes back to step 3 for every block, where a new number of wavelets may be fixed: here by an error that each block "
        "has to meet "
        "(`RowOptions(error=...)`)."
    )
    return Exhibit(caption, plates=(Plate(_flow(calls), "The calls of the whole deformation"),), remarks=(remark,))


@dataclass(frozen=True)
class Call:
    """A function that is called, and how deep."""

    function: Callable[..., Any]
    depth: int

    @property
    def name(self) -> str:
        """Module and name, without the package's."""
        return f"{self.function.__module__.removeprefix('morphlet.')}.{self.function.__qualname__}"

    @property
    def says(self) -> str:
        """The first paragraph of its docstring, cut where there is no more room."""
        text = " ".join((inspect.getdoc(self.function) or "").split("\n\n")[0].split())
        return textwrap.shorten(text, LETTERS - LETTERS_LESS * self.depth, placeholder=" ...")


def _calls_below(function: Callable[..., Any], depth: int = 0, deepest: int = DEEPEST) -> Iterator[Call]:
    """Calls of calls, each function once, the callers before the called."""
    seen = set[Any]()

    def below(caller: Callable[..., Any], level: int) -> Iterator[Call]:
        for called in _called(caller):
            if called in seen or level >= deepest:
                continue
            seen.add(called)
            yield Call(called, level)
            yield from below(called, level + 1)

    yield from below(function, depth)


def _called(function: Callable[..., Any]) -> Iterator[FunctionType]:
    """The package's public functions that a function calls, in the order of its text, those of its private helpers among them."""
    for name in _calls_in(ast.parse(textwrap.dedent(inspect.getsource(function)))):
        found = function.__globals__.get(name)
        if not isinstance(found, FunctionType) or not found.__module__.startswith("morphlet.") or found.__module__ in QUIET:
            continue
        if found.__name__.startswith("_"):
            yield from _called(found)
        else:
            yield found


def _calls_in(node: ast.AST) -> Iterator[str]:
    """Names of what is called, arguments before the call that takes them."""
    for child in ast.iter_child_nodes(node):
        yield from _calls_in(child)
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        yield node.func.id


def _flow(calls: list[Call]) -> bytes:
    """Boxes below each other, each call right of its caller, joined to it."""
    size = FLOW_WIDTH, len(calls) * LINE + 2 * MARGIN
    figure = canvas.sheet(*size)
    board = _board(figure, size)
    above = dict[int, float]()
    for number, call in enumerate(calls):
        top, left = MARGIN + number * LINE, MARGIN + STEP + call.depth * INDENT
        _box(board, (left, top), call)
        if call.depth and call.depth - 1 in above:
            trunk = left - INDENT / 2
            board.plot([trunk, trunk, left], [above[call.depth - 1], top + BOX / 2, top + BOX / 2], color="#777777", linewidth=1.0)
        elif number and call.depth == 0:
            board.annotate(
                "", (left + INDENT / 4, top), (left + INDENT / 4, above[0]), arrowprops={"arrowstyle": "-|>", "color": "#777777"}
            )
        above = {depth: y for depth, y in above.items() if depth < call.depth} | {call.depth: top + BOX}
    return _png(figure)


def _box(board: "Axes", at: tuple[float, float], call: Call) -> None:
    """A call in its box, and the paper's step beside it."""
    from matplotlib.patches import FancyBboxPatch

    left, top = at
    step = STEPS.get(call.function, "")
    face = "#e7eef7" if step else "#f6f6f4"
    shape = FancyBboxPatch(
        (left, top), FLOW_WIDTH - MARGIN - left, BOX, boxstyle="round,pad=0,rounding_size=6", facecolor=face, edgecolor="#b9c2cf"
    )
    board.add_patch(shape)
    board.text(left + GAP, top + 0.3 * BOX, call.name, va="center", fontsize=canvas.FONT, weight="bold", color=canvas.INK, parse_math=False)
    board.text(left + GAP, top + 0.72 * BOX, call.says, va="center", fontsize=canvas.SMALL, color="#555555", parse_math=False)
    board.text(MARGIN, top + BOX / 2, step, va="center", fontsize=canvas.SMALL, color="#0072B2", parse_math=False)


def _board(figure: "Figure", size: tuple[int, int]) -> "Axes":
    """Axes without lines whose units are pixels from the upper left corner."""
    drawn = figure.add_axes((0, 0, 1, 1))
    drawn.set(xlim=(0, size[0]), ylim=(size[1], 0))
    drawn.axis("off")
    return drawn


def _png(figure: "Figure") -> bytes:
    """The content of a PNG file."""
    from morphlet.report.render import Picture

    return Picture(canvas.pixels(figure), "matplotlib", "drawings need no other").png
