"""Procedural creatures: closed organic meshes that need no download, with known correspondences.

All poses and proportions of one species share one topology: vertex i of one goes with vertex i of the other. Every
mesh is closed, outward oriented, one piece of genus 0. The animals look along +z, +y is up, feet stand on y = 0.
"""

import difflib
from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Float

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.samples import anatomy, poses, skinning
from morphlet.samples.anatomy import BONES, SPECIES, Proportions
from morphlet.samples.implicit import Solid, part
from morphlet.samples.meshing import polygonise, settled
from morphlet.samples.poses import POSES, STANDING, Pose
from morphlet.surface.mesh import Mesh

T = TypeVar("T")

DEFAULT_VERTICES = 7000
"""Enough for eyes, ears and feet; quick enough to try anything on."""

FEWEST, MOST = 1500, 100_000
"""Range of vertex counts: below, ears lose their shape; above, memory and time are better spent elsewhere."""

SPIKES = 7
"""Number of spikes of the spiky ball."""

LUMPS = 9
"""Number of lumps on the blob."""

SAMPLES = (
    "grazer", "grazer-walking", "grazer-grazing", "grazer-rearing", "grazer-leaping", "grazer-turning",
    "predator", "predator-walking", "predator-rearing", "predator-leaping", "predator-turning",
    "blob", "spiky",
)  # fmt: skip
"""Names that `sample` knows: species in their poses, and two simple solids."""

FORWARD, UP, DOWN, LEFT = np.array([0.0, 0, 1]), np.array([0.0, 1, 0]), np.array([0.0, -1, 0]), np.array([1.0, 0, 0])
"""Directions of the animal at rest."""


@dataclass(frozen=True, eq=False)
class Creature:
    """An animal ready to be posed: the mesh at rest and the share of each bone in each vertex.

    Parameters
    ----------
    species
        A name in `SPECIES`.
    mesh
        The animal at rest.
    weights
        Share of each bone of `anatomy.BONES`; rows sum to 1.

    Examples
    --------
    >>> from morphlet.samples.creatures import Creature
    >>> from morphlet.samples.poses import POSES
    >>> fox = Creature.prepare("predator", n_vertices=2000)
    >>> walking = fox.posed(POSES["walking"])
    >>> walking, walking.topology is fox.mesh.topology
    (Mesh(2000 vertices, 3996 faces), True)
    """

    species: str
    mesh: Mesh
    weights: Float[np.ndarray, "n b"]

    def __post_init__(self) -> None:
        object.__setattr__(self, "weights", _arrays.real(self.weights, "weights", (self.mesh.n_vertices, len(BONES))))

    def __reduce__(self) -> tuple[Any, ...]:
        return Creature, (self.species, self.mesh, np.array(self.weights))

    @staticmethod
    def prepare(species: str, n_vertices: int = DEFAULT_VERTICES) -> "Creature":
        """Mesh the animal at rest and bind it to its bones: the slow part.

        Raises
        ------
        InputError
            If the species is unknown or the number of vertices out of range.

        Notes
        -----
        One to two seconds of one core at 7,000 vertices, some 25 at 50,000.
        """
        body, owners = anatomy.solid(_known(species, SPECIES, "species"))
        mesh = polygonise(body, _count(n_vertices))
        return Creature(species, mesh, skinning.bone_weights(mesh, body, owners))

    def posed(self, pose: Pose = STANDING, proportions: Proportions | None = None) -> Mesh:
        """The animal in a pose, and with other proportions than its species' if given, feet on y = 0.

        Notes
        -----
        A few hundredths of a second at 7,000 vertices; with other proportions about one second. With the proportions
        of another species the result is that animal, in this one's connectivity: a map between species, vertex to vertex.
        """
        rest = self.mesh if proportions is None else self._reproportioned(proportions)
        bones = anatomy.skeleton(proportions or SPECIES[self.species])
        vertices = skinning.reposed(rest.vertices, self.weights, *poses.posed(bones, pose))
        return self.mesh.with_vertices(vertices - vertices[:, 1].min() * UP)

    def _reproportioned(self, proportions: Proportions) -> Mesh:
        """The animal at rest with other proportions: bones first, then the vertices settle on the new body."""
        old, new = anatomy.skeleton(SPECIES[self.species]), anatomy.skeleton(proportions)
        moved = skinning.reproportioned(self.mesh.vertices, self.weights, old, new)
        return settled(self.mesh.with_vertices(moved), anatomy.solid(proportions)[0])

    @cached_property
    def landmarks(self) -> dict[str, int]:
        """Vertices of the same places in every species: nose, ears, feet, joints, tail."""
        places = _places(SPECIES[self.species])
        at = np.array(list(places.values()))
        nearest = [int(np.argmin(np.sum((self.mesh.vertices - place) ** 2, axis=1))) for place in at]
        return dict(zip(places, nearest, strict=True))


def creature(
    species: str = "grazer", *, pose: Pose = STANDING, proportions: Proportions | None = None, n_vertices: int = DEFAULT_VERTICES
) -> Mesh:
    """A four-legged animal: the one-off twin of `Creature.prepare(...).posed(...)`.

    Parameters
    ----------
    species
        A name in `SPECIES`: "grazer" (long legs, long neck, stub of a tail) or "predator" (low, big-headed, brush).
    pose
        Joint angles; `POSES` has some by name.
    proportions
        Measures; the species' own if left out.
    n_vertices
        Number of vertices, met exactly.

    Returns
    -------
    Mesh
        Closed, outward oriented, genus 0. The same species and number of vertices give the same faces.

    Raises
    ------
    InputError
        If the species is unknown or the number of vertices out of range.

    Notes
    -----
    One to two seconds of one core at 7,000 vertices. For several poses prepare a `Creature` once.

    Examples
    --------
    >>> from morphlet.samples.creatures import creature
    >>> deer = creature("grazer", n_vertices=2000)
    >>> deer, deer.topology.euler_characteristic
    (Mesh(2000 vertices, 3996 faces), 2)
    """
    return Creature.prepare(species, n_vertices).posed(pose, proportions)


def landmarks(species: str, n_vertices: int = DEFAULT_VERTICES) -> dict[str, int]:
    """Vertices of the same places in every species, by label, on `creature(species, n_vertices=n_vertices)`.

    Raises
    ------
    InputError
        If the species is unknown or the number of vertices out of range.

    Examples
    --------
    >>> from morphlet.samples.creatures import landmarks
    >>> "nose" in landmarks("grazer", n_vertices=2000)
    True
    """
    return Creature.prepare(species, n_vertices).landmarks


def blob(seed: int = 0, *, n_vertices: int = DEFAULT_VERTICES) -> Mesh:
    """A ball with a few smooth lumps, other ones for each seed.

    Raises
    ------
    InputError
        If the number of vertices is out of range.

    Examples
    --------
    >>> from morphlet.samples.creatures import blob
    >>> blob(3, n_vertices=2000).topology.euler_characteristic
    2
    """
    rng = np.random.default_rng(seed)
    centres = rng.standard_normal((LUMPS, 3))
    centres *= rng.uniform(0.4, 0.75, (LUMPS, 1)) / np.linalg.norm(centres, axis=1, keepdims=True)
    lumps = [part(c, c, (r, r), 0.3) for c, r in zip(centres, rng.uniform(0.2, 0.4, LUMPS), strict=True)]
    return polygonise(Solid(np.array([part(np.zeros(3), np.zeros(3), (0.7, 0.7), 0.3), *lumps])), _count(n_vertices))


def spiky(n_spikes: int = SPIKES, *, length: float = 1.0, n_vertices: int = DEFAULT_VERTICES) -> Mesh:
    """A ball of radius 1/2 with long, rounded spikes spread evenly: a hard case for maps to the sphere.

    Parameters
    ----------
    n_spikes
        How many spikes, 1 to 40.
    length
        How far they reach beyond the ball, 0.1 to 2.
    n_vertices
        Number of vertices, met exactly.

    Raises
    ------
    InputError
        If a number is out of range.

    Examples
    --------
    >>> from morphlet.samples.creatures import spiky
    >>> spiky(5, n_vertices=2000).topology.n_components
    1
    """
    if not (1 <= n_spikes <= 40 and 0.1 <= length <= 2.0):
        raise InputError("1 to 40 spikes of length 0.1 to 2", f"{n_spikes} of length {length}", "choose numbers in this range")
    middle = np.arange(n_spikes) + 0.5
    height, turn = 1 - 2 * middle / n_spikes, np.pi * (1 + 5**0.5) * middle
    ring = np.sqrt(1 - height**2)
    outwards = np.stack([ring * np.cos(turn), height, ring * np.sin(turn)], axis=1)
    spikes = [part(0.3 * d, (0.5 + length) * d, (0.14, 0.03), 0.12) for d in outwards]
    return polygonise(Solid(np.array([part(np.zeros(3), np.zeros(3), (0.5, 0.5), 0.1), *spikes])), _count(n_vertices))


def sample(name: str, *, n_vertices: int = DEFAULT_VERTICES) -> Mesh:
    """One of the named samples.

    Parameters
    ----------
    name
        A name in `SAMPLES`, such as "grazer", "predator-leaping" or "blob".
    n_vertices
        Number of vertices, met exactly.

    Returns
    -------
    Mesh
        Closed, outward oriented, genus 0.

    Raises
    ------
    InputError
        If the name is unknown or the number of vertices out of range.

    Examples
    --------
    >>> from morphlet.samples.creatures import sample
    >>> sample("predator-leaping", n_vertices=2000)
    Mesh(2000 vertices, 3996 faces)
    """
    _known(name, dict.fromkeys(SAMPLES), "samples")
    if name == "blob":
        return blob(n_vertices=n_vertices)
    if name == "spiky":
        return spiky(n_vertices=n_vertices)
    species, _, pose = name.partition("-")
    return creature(species, pose=POSES[pose or "standing"], n_vertices=n_vertices)


def _known(name: str, table: dict[str, T], what: str) -> T:
    """The entry of this name."""
    if name not in table:
        close = difflib.get_close_matches(name, table)
        advice = f"did you mean '{close[0]}'?" if close else "choose one of these"
        raise InputError(f"one of the {what} {', '.join(table)}", f"'{name}'", advice)
    return table[name]


def _count(n_vertices: int) -> int:
    if not FEWEST <= n_vertices <= MOST:
        raise InputError(f"{FEWEST} to {MOST} vertices", f"{n_vertices}", "choose a number in this range")
    return n_vertices


def _places(p: Proportions) -> dict[str, Float[np.ndarray, "3"]]:
    """Where the landmarks are: ends of bones, and beside joints at the thickness of the flesh."""
    bones = anatomy.skeleton(p)
    row = {name: b for b, name in enumerate(BONES)}

    def beside(bone: str, direction: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        return bones.starts[row[bone]] + bones.radii[row[bone]] * direction

    places = {"nose": bones.ends[row["head"]], "tail tip": bones.ends[row["tail 4"]], "tail root": beside("tail 1", UP)}
    places |= {"poll": beside("head", UP), "croup": beside("pelvis", UP), "withers": beside("chest", UP) + 0.3 * p.trunk * FORWARD}
    places |= {"back": beside("loin", UP), "belly": beside("loin", DOWN)}
    places |= {"breast": bones.ends[row["chest"]] + p.girth * (FORWARD + 0.3 * DOWN)}
    for side, sign in anatomy.SIDES:
        places |= {f"{side} {leg} foot": bones.ends[row[f"{side} {leg} foot"]] for leg in ("front", "hind")}
        places |= {f"{side} ear": bones.ends[row[f"{side} ear"]], f"{side} flank": beside("loin", sign * LEFT)}
        places |= {f"{side} wrist": beside(f"{side} front cannon", FORWARD), f"{side} hock": beside(f"{side} hind cannon", -FORWARD)}
        places |= {f"{side} elbow": beside(f"{side} front lower", -FORWARD), f"{side} knee": beside(f"{side} hind shin", FORWARD)}
    return places
