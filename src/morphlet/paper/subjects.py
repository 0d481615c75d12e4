"""The objects of the paper, the meshes that stand in for them, and what is done to each.

Public meshes are used where they are at hand, procedural ones otherwise; nothing is downloaded. An object is made when it is
first asked for, with its spherical map, its edit and its morph, and kept as long as the stock is.
"""

import os
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from morphlet import _arrays
from morphlet.editing.arap import Arap
from morphlet.editing.editor import RoiEditor
from morphlet.editing.method import Method
from morphlet.editing.roi import Roi
from morphlet.errors import InputError
from morphlet.features.regions import Regions, find_regions
from morphlet.io.formats import read
from morphlet.numerics.optimize import OnStep
from morphlet.numerics.rotations import exponential
from morphlet.pipeline.correspond import correspond_maps
from morphlet.pipeline.results import CorrespondResult
from morphlet.samples.catalogue import fetch
from morphlet.samples.creatures import DEFAULT_VERTICES, FEWEST, MOST, sample
from morphlet.sphere.image import SphericalImage, spherical_image
from morphlet.sphere.map import SphericalMap, map_surface
from morphlet.surface.hierarchy import decimate
from morphlet.surface.mesh import Mesh
from morphlet.surface.region import Region
from morphlet.surface.repair import RepairOptions, close
from morphlet.surface.sequence import MeshSequence

FRAMES = 6
"""Of a deformation, the object at rest included: a strip's width."""
ROWS = 129
"""Of the geometry images: `approximation.rows.SIZE`, the package's own choice."""
FEW = 352
"""Vertices of the paper's Cat."""
MENDING = RepairOptions(fill="all")
HANDLES = 3
"""Of the camel's mesh, which are cut: without that it has no spherical map."""


@dataclass(frozen=True)
class Recipe:
    """An edit told by directions, so that it fits an object and its stand-in.

    Parameters
    ----------
    toward
        The handle lies round the vertex that is farthest in this direction.
    handle, region
        How far handle and region reach from there along the surface, over the bounding-box diagonal.
    turn
        Rotation vector of the handle about the middle of the region's rim, in degrees.
    shift
        Way of the handle beside that, over the diagonal.
    """

    toward: tuple[float, float, float]
    handle: float
    region: float
    turn: tuple[float, float, float] = (0.0, 0.0, 0.0)
    shift: tuple[float, float, float] = (0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Model:
    """An object of the paper.

    Parameters
    ----------
    name
        As the paper calls it, or what it is where the paper has no name for it.
    file
        The public mesh, by its name in the catalogue.
    stand_in
        The procedural sample that takes its place.
    recipe
        How it is deformed.
    sizes
        Vertices and faces in the paper's Table 1.
    """

    name: str
    file: str
    stand_in: str
    recipe: Recipe
    sizes: tuple[int, int] | None = None


HORSE = Model("Horse", "horse.obj", "grazer", Recipe((0, 1, 1), 0.08, 0.45, turn=(45, 0, 0)), (8431, 16843))
CAT = Model("Cat", "cat.obj", "predator", Recipe((0, 0, -1), 0.06, 0.42, turn=(75, 0, 0)), (FEW, 671))
BUNNY = Model("Bunny", "stanford-bunny.obj", "spiky", Recipe((0, 1, 0), 0.08, 0.34, turn=(0, 0, 50)), (29299, 69473))
FACE = Model("Face", "face.obj", "blob", Recipe((0, 0, 1), 0.02, 0.13, shift=(0, 0, 0.06)), (58895, 57836))
DRAGON = Model("Dragon", "camelhead.off", "predator-walking", Recipe((0, 0.2, 1), 0.1, 0.5, shift=(0, 0.12, 0)))
CAMEL = Model("Camel", "camel.obj", "predator", HORSE.recipe)
LION = Model("Lion", "lion.obj", "grazer", CAT.recipe)


@dataclass(frozen=True, eq=False)
class Subject:
    """An object ready for everything that is done to it.

    Parameters
    ----------
    model
        What it is in the paper.
    mesh
        As its file has it, without vertices that lie in no face.
    origin
        The file, or the procedural sample, in words.
    mending
        What may be done so that it has a spherical map.
    on_step
        Told about the steps of long iterations.
    rows
        Of its geometry image.
    """

    model: Model
    mesh: Mesh
    origin: str
    mending: RepairOptions = MENDING
    on_step: OnStep | None = field(default=None, repr=False)
    rows: int = ROWS

    @property
    def name(self) -> str:
        """As the paper calls it."""
        return self.model.name

    @cached_property
    def sphere(self) -> SphericalMap:
        """Its spherical map (step 1)."""
        return map_surface(close(self.mesh, self.mending), on_step=self.on_step)

    @cached_property
    def regions(self) -> Regions:
        """Its feature regions (step 2)."""
        return find_regions(self.sphere.surface.mesh)

    @cached_property
    def tip(self) -> int:
        """The vertex that the recipe names."""
        return farthest(self.mesh, self.model.recipe.toward)

    @cached_property
    def roi(self) -> Roi:
        """Handle, free vertices and anchors of its edit."""
        size = self.mesh.bbox_diagonal
        edges = self.mesh.topology.edges
        ends = self.mesh.vertices[edges[(edges == self.tip).any(axis=1)]]
        nearest = float(np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).max())  # a coarse mesh may have no other vertex so near
        handle = Roi.within(self.mesh, np.array([self.tip]), max(self.model.recipe.handle * size, nearest)).moving
        return Roi.within(self.mesh, np.array(handle), self.model.recipe.region * size)

    @cached_property
    def path(self) -> Float[np.ndarray, "t h 3"]:
        """Where the handle is in each frame; the first one is its rest."""
        recipe, rest = self.model.recipe, self.mesh.vertices[self.roi.handle]
        pivot = self.mesh.vertices[self.roi.rim].mean(axis=0)
        share = np.linspace(0, 1, FRAMES)
        turns = exponential(share[:, None] * np.radians(recipe.turn))
        shift = share[:, None, None] * np.array(recipe.shift) * self.mesh.bbox_diagonal
        return pivot + np.einsum("tab,hb->tha", turns, rest - pivot) + shift

    @cached_property
    def editor(self) -> RoiEditor:
        """The prepared editor, with the package's own method."""
        return RoiEditor.prepare(self.roi, Arap())

    @cached_property
    def frames(self) -> MeshSequence:
        """Its deformation, from time 0 to 1."""
        return timed(self.editor.sequence(self.path))

    def frames_by(self, method: Method) -> MeshSequence:
        """Its deformation by another method."""
        return timed(RoiEditor.prepare(self.roi, method).sequence(self.path))

    @property
    def deformed(self) -> Mesh:
        """The deformed object: the last frame."""
        return self.frames[len(self.frames) - 1]

    @cached_property
    def deformed_map(self) -> SphericalMap:
        """The deformed object on the sphere of the object at rest."""
        return SphericalMap(close(self.deformed, self.mending), self.sphere.closed_points, self.sphere.trace)

    @cached_property
    def image(self) -> SphericalImage:
        """The geometry image of the deformed object: the signal that networks are trained on (step 5)."""
        return spherical_image(self.deformed_map, self.rows)


@dataclass(frozen=True, eq=False)
class Stock:
    """All objects, each made when it is first asked for.

    Parameters
    ----------
    data
        Folder with the public meshes, in any sub-folder; the catalogue's cache if left out.
    n_vertices
        Of procedural stand-ins.
    on_step
        Told about the steps of long iterations; may raise `Cancelled`.
    rows
        Of the geometry images.

    Raises
    ------
    InputError
        If stand-ins cannot have so many vertices.

    Examples
    --------
    >>> import tempfile
    >>> from morphlet.paper.subjects import Stock
    >>> with tempfile.TemporaryDirectory() as empty:
    ...     Stock(Path(empty), 1500).horse.origin
    'grazer, procedural'
    """

    data: Path | None = None
    n_vertices: int = DEFAULT_VERTICES
    on_step: OnStep | None = field(default=None, repr=False)
    rows: int = ROWS

    def __post_init__(self) -> None:
        if not FEWEST <= self.n_vertices <= MOST:
            raise InputError(f"{FEWEST} to {MOST} vertices", str(self.n_vertices), "choose a number in this range")

    def subject(self, model: Model, mending: RepairOptions = MENDING) -> Subject:
        """A public mesh if it is at hand, its stand-in otherwise."""
        file = at_hand(model.file, self.data)
        if file is None:
            stand_in = sample(model.stand_in, n_vertices=self.n_vertices)
            return Subject(model, stand_in, f"{model.stand_in}, procedural", MENDING, self.on_step, self.rows)
        return Subject(model, in_faces(read(file)), model.file, mending, self.on_step, self.rows)

    @cached_property
    def horse(self) -> Subject:
        """The paper's own horse, where it is at hand."""
        return self.subject(HORSE)

    @cached_property
    def cat(self) -> Subject:
        """A cat."""
        return self.subject(CAT)

    @cached_property
    def bunny(self) -> Subject:
        """The Stanford bunny."""
        return self.subject(BUNNY)

    @cached_property
    def face(self) -> Subject:
        """A face."""
        return self.subject(FACE)

    @cached_property
    def dragon(self) -> Subject:
        """A head with a long snout."""
        return self.subject(DRAGON)

    @cached_property
    def camel(self) -> Subject:
        """What the horse becomes."""
        return self.subject(CAMEL, RepairOptions(fill="all", component="largest", cut_handles=HANDLES))

    @cached_property
    def lion(self) -> Subject:
        """What the cat becomes."""
        return self.subject(LION)

    @cached_property
    def small_cat(self) -> Subject:
        """The cat with as few vertices as the paper's."""
        closed = self.cat.sphere.surface.mesh
        return Subject(CAT, simplified(closed, FEW), f"{self.cat.origin}, decimated", MENDING, self.on_step, self.rows)

    @cached_property
    def four(self) -> tuple[Subject, ...]:
        """The objects of the paper's Table 1."""
        return self.horse, self.cat, self.bunny, self.face

    @cached_property
    def horse_to_camel(self) -> CorrespondResult:
        """Where each vertex of the horse lies on what it becomes."""
        return correspond_maps(self.horse.sphere, self.camel.sphere, on_step=self.on_step)

    @cached_property
    def cat_to_lion(self) -> CorrespondResult:
        """Where each vertex of the cat lies on what it becomes."""
        return correspond_maps(self.cat.sphere, self.lion.sphere, on_step=self.on_step)


def at_hand(name: str, data: Path | None) -> Path | None:
    """The path of a public mesh, its checksum verified, if it is in the folder, or without one in the catalogue's cache."""
    if data is not None:
        return fetch(name, mirror=data) if any(data.rglob(name)) else None
    import pooch

    cache = Path(os.fspath(pooch.os_cache("morphlet")))
    return fetch(name, cache=cache) if (cache / name).is_file() else None


def in_faces(mesh: Mesh) -> Mesh:
    """The mesh without vertices that no face has: they would be anchors wherever they lie, on the handle too."""
    used = mesh.topology.referenced
    return mesh if used.all() else Region(mesh, np.flatnonzero(used)).patch


def timed(frames: MeshSequence) -> MeshSequence:
    """The same frames at equal steps of time from 0 to 1."""
    return MeshSequence(frames.topology, frames.positions, np.linspace(0, 1, len(frames)))


def farthest(mesh: Mesh, direction: tuple[float, float, float], among: Int[np.ndarray, "k"] | None = None) -> int:
    """The vertex that is farthest in a direction, of those in a face, or of the given ones."""
    chosen = np.flatnonzero(mesh.topology.referenced) if among is None else among
    return int(chosen[np.argmax(mesh.vertices[chosen] @ np.array(direction, float))])


def simplified(closed: Mesh, count: int) -> Mesh:
    """A closed mesh of genus 0 with so many of its own vertices, and faces between these.

    Examples
    --------
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.paper.subjects import simplified
    >>> from morphlet.surface.mesh import Mesh
    >>> simplified(Mesh(*icosphere(2)), 40)
    Mesh(40 vertices, 76 faces)
    """
    size = closed.bbox_diagonal
    hierarchy = decimate(closed.with_vertices((closed.vertices - closed.vertices.mean(axis=0)) / size))
    rows = hierarchy.faces_after(max(closed.n_vertices - count, 0))
    kept, corners = np.unique(rows[rows[:, 0] >= 0], return_inverse=True)
    return Mesh(_arrays.freeze(closed.vertices[kept]), corners.reshape(-1, 3))
