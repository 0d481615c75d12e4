"""The ways of deforming that a page can choose from, with the options that it may set.

All are told as `morphlet deform` is told them, and made by it: what the studio does, a script does again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeGuard, get_args

from morphlet.editing.arap import Arap, PreparedArap
from morphlet.editing.detail import Multiresolution
from morphlet.editing.falloff import Falloff
from morphlet.editing.lattice import Basis, Lattice
from morphlet.editing.method import Method, Prepared
from morphlet.editing.moving_least_squares import Kind, MovingLeastSquares
from morphlet.editing.script import DETAIL, GUARD, METHODS, SOFT
from morphlet.studio.messages import Checked, Field, Refusal, choice, fields, flag, number, shown, whole, wrong

Told = Mapping[str, Any]


@dataclass(frozen=True)
class Option:
    """An option of a method: how a page shows it, how its value is checked.

    Parameters
    ----------
    name, title
        For messages, for people.
    default
        Its value where a message does not tell it.
    bounds
        Of numbers: smallest and largest value, both allowed.
    choices
        The words to choose from, of an option that is a word.
    """

    name: str
    title: str
    default: Any
    bounds: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()

    @property
    def kind(self) -> str:
        """What a page makes of it: choice, flag, counts or number."""
        if self.choices:
            return "choice"
        return "flag" if isinstance(self.default, bool) else "counts" if isinstance(self.default, tuple) else "number"

    @property
    def integer(self) -> bool:
        """Whether it is a number without fractions."""
        return isinstance(self.default, int) and not isinstance(self.default, bool)

    def field(self) -> Field:
        """How its value is checked."""
        low, high = self.bounds or (0.0, 0.0)
        amount = whole(int(low), int(high)) if self.integer else number(low, high)
        kinds: dict[str, Checked] = {"choice": choice(*self.choices), "flag": flag, "number": amount}
        return Field(kinds.get(self.kind) or _counts(len(self.default), int(low), int(high)), self.default)

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        own: dict[str, Any] = {"name": self.name, "title": self.title, "kind": self.kind, "default": self.default}
        own |= {"choices": self.choices} if self.choices else {}
        own |= {"low": self.bounds[0], "high": self.bounds[1]} if self.bounds else {}
        own |= {"step": 1} if self.integer else {}
        return own | ({"length": len(self.default)} if self.kind == "counts" else {})


@dataclass(frozen=True)
class Way:
    """A method as a page sees it."""

    name: str
    title: str
    options: tuple[Option, ...] = ()

    @property
    def soft(self) -> bool:
        """Whether its handle can be held softly."""
        return self.name in SOFT

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        return {"name": self.name, "title": self.title, "soft": self.soft, "options": [option.told() for option in self.options]}


@dataclass(frozen=True)
class Choice:
    """A method with all its options set.

    Parameters
    ----------
    name
        Of the method.
    options
        Every option's value.
    weight
        How hard the handle is held; None for exactly.
    """

    name: str = "arap"
    options: Told = field(default_factory=lambda: {"smoothing": 0.0, "volume": False, "guard": False, "detail": False})
    weight: float | None = None

    def method(self) -> Method:
        """The method itself."""
        table = self.script()
        made = METHODS[self.name](table)
        return Multiresolution(made) if "detail" in table else made

    def script(self) -> dict[str, Any]:
        """How a `deform` file tells it."""
        told = {"method": self.name} | ({} if self.weight is None else {"weight": self.weight})
        return told | _SCRIPTS[self.name](self.options)

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        return {"name": self.name, "options": dict(self.options)}


def chosen(name: str, options: Told, weight: float | None) -> Choice:
    """A method by name, those options at their defaults that are left out.

    Raises
    ------
    Refusal
        If there is no such method or option, or a value or a combination is not possible.

    Examples
    --------
    >>> from morphlet.studio.methods import chosen
    >>> chosen("direct", {"falloff": "wendland"}, None).method()
    Direct(falloff='wendland', ratio='literal')
    """
    if name not in WAYS:
        raise wrong(f"one of {', '.join(WAYS)}", "method", name)
    way = WAYS[name]
    if weight is not None and not way.soft:
        raise Refusal("field", f"weight null with the method {name}", f"{weight:g}", f"leave it out, or choose one of {', '.join(SOFT)}")
    values = fields(options, {option.name: option.field() for option in way.options}, name)
    if name == "arap" and values["smoothing"] and (values["volume"] or values["guard"]):
        raise Refusal("field", "smoothing alone, or volume and guard", "both", "set smoothing to 0")
    return Choice(name, values, weight)


def shortened(prepared: Prepared, iterations: int) -> Prepared:
    """The same prepared method with at most so many iterations, where it goes on from the last frame."""
    if continues(prepared) and prepared.options.iterations > iterations:
        return replace(prepared, options=replace(prepared.options, iterations=iterations))
    return prepared


def continues(prepared: Prepared) -> TypeGuard[PreparedArap]:
    """Whether iterations go on from the last frame; with smoothing they start from rotations of their own."""
    return isinstance(prepared, PreparedArap) and not prepared.options.smoothing


def _counts(length: int, low: int, high: int) -> Checked:
    """So many integers within bounds."""
    inside = whole(low, high)

    def check(value: Any, name: str) -> tuple[int, ...]:
        if not isinstance(value, list | tuple) or len(value) != length:
            raise wrong(f"a list of {length} integers", name, shown(value))
        return tuple(inside(one, name) for one in value)

    return check


def _arap(options: Told) -> dict[str, Any]:
    """Options as `deform` tells them."""
    told: dict[str, Any] = {"smoothing": options["smoothing"]} if options["smoothing"] else {}
    told |= {"volume": True} if options["volume"] else {}
    told |= {"guard": GUARD} if options["guard"] else {}
    return told | _held(options)


def _held(options: Told) -> dict[str, Any]:
    """Whether detail is put back by itself."""
    return {"detail": DETAIL} if options["detail"] else {}


MOST_CONTROLS, MOST_SMOOTHING, MOST_ALPHA, MOST_PASSES = 12, 1.0, 10.0, 20
"""Bounds of options: a lattice of 12 x 12 x 12 takes 72 MB."""
_DETAIL = Option("detail", "Keep fine detail apart", False)
_SCRIPTS: dict[str, Callable[[Told], dict[str, Any]]] = {
    "arap": _arap,
    "rotations": _held,
    "laplacian": _held,
    "biharmonic": _held,
    "similarity": lambda options: {},
    "dual": lambda options: {"iterations": options["iterations"]},
    "direct": lambda options: {"falloff": options["falloff"]},
    "mls": lambda options: {"mls": {"kind": options["kind"], "alpha": options["alpha"]}},
    "ffd": lambda options: {"ffd": {"lattice": list(options["lattice"]), "basis": options["basis"]}},
}
WAYS = {
    way.name: way
    for way in (
        Way(
            "arap",
            "As rigid as possible",
            (
                Option("smoothing", "Smooth bends", Arap.smoothing, (0.0, MOST_SMOOTHING)),
                Option("volume", "Keep the volume", False),
                Option("guard", "Do not run through itself", False),
                _DETAIL,
            ),
        ),
        Way("rotations", "Laplacian with estimated rotations", (_DETAIL,)),
        Way("laplacian", "Harmonic (membrane)", (_DETAIL,)),
        Way("biharmonic", "Biharmonic (thin plate)", (_DETAIL,)),
        Way("similarity", "Laplacian, similarity-invariant"),
        Way("dual", "Dual Laplacian", (Option("iterations", "Passes", 0, (0, MOST_PASSES)),)),
        Way("direct", "Falloff of the handle's way", (Option("falloff", "Falloff", "gaussian", choices=get_args(Falloff)),)),
        Way(
            "mls",
            "Moving least squares",
            (
                Option("kind", "Motions", MovingLeastSquares.kind, choices=get_args(Kind)),
                Option("alpha", "Falloff", MovingLeastSquares.alpha, (0.1, MOST_ALPHA)),
            ),
        ),
        Way(
            "ffd",
            "Free-form lattice",
            (
                Option("lattice", "Control points", Lattice.shape, (2, MOST_CONTROLS)),
                Option("basis", "Blending", Lattice.basis, choices=get_args(Basis)),
            ),
        ),
    )
}
"""Every method by name, the default first."""
