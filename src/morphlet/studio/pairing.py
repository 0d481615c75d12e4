"""Two meshes side by side: markers, feature regions, the correspondence, and the morph along it.

The source is taken as it is edited now; what was computed for another shape or other markers is marked as not current.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Float

from morphlet.errors import MeshError
from morphlet.features.matching import candidates
from morphlet.features.regions import Regions, find_regions
from morphlet.motion.morph import Morph, MorphPath
from morphlet.motion.schedule import Schedule
from morphlet.pipeline.correspond import correspond_maps
from morphlet.pipeline.morph import morph_along
from morphlet.pipeline.results import CorrespondResult
from morphlet.sphere.map import SphericalMap, map_surface
from morphlet.studio.desk import Desk, mesh_frame
from morphlet.studio.document import Marker
from morphlet.studio.events import Emit, Note
from morphlet.studio.frames import LAID, Frame, Kind, Slot
from morphlet.studio.jobs import Job
from morphlet.studio.messages import Refusal
from morphlet.studio.model import Model
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import VertexPairs
from morphlet.surface.repair import Repaired, close
from morphlet.surface.sequence import MeshSequence

MOST_MAPS = 4
"""Spherical maps that are kept: of both meshes, and of the shapes before the last edits."""


@dataclass(frozen=True, eq=False)
class Features:
    """Feature regions of both meshes, and which go together."""

    surfaces: tuple[Repaired, Repaired]
    found: tuple[Regions, Regions]
    pairs: tuple[tuple[int, int], ...]
    contested: bool = False
    """Whether other pairings are nearly as good: coarse maps have not spoken yet."""

    def told(self) -> dict[str, Any]:
        """What a page is told."""
        sides = zip(("source", "target"), self.surfaces, self.found, strict=True)
        told: dict[str, Any] = {
            name: {"tips": surface.source_vertices[own.tips].tolist(), "core": int(surface.source_vertices[own.core])}
            for name, surface, own in sides
        }
        return told | {"pairs": self.pairs, "contested": self.contested}


@dataclass(frozen=True, eq=False)
class Match:
    """A correspondence, and what it was made for."""

    result: CorrespondResult
    markers: tuple[Marker, ...]
    figures: Mapping[str, Any]

    @property
    def pairs(self) -> tuple[Marker, ...]:
        """The pairs that were used, as markers."""
        used = self.result.pairs
        return tuple(Marker(int(s), int(t), label) for s, t, label in zip(used.source, used.target, used.labels, strict=True))


@dataclass(frozen=True, eq=False)
class Travel:
    """A morph along a correspondence."""

    match: Match
    morph: Morph

    @property
    def bands(self) -> int:
        """Resolutions that move by themselves."""
        return 0 if self.morph.bands is None else len(self.morph.bands)

    def scheduled(self, schedule: Schedule) -> "Travel":
        """The same with other times."""
        own = self.morph
        return replace(self, morph=Morph(own.source, own.target_positions, own.path, own.bands, schedule))

    def positions(self, t: float) -> Float[np.ndarray, "n 3"]:
        """Of the source's vertices as in its file; those that were joined or dropped for the map travel with theirs."""
        moved, source = self.morph(t).vertices, self.match.result.correspondence.source
        surface = self.match.result.source_map.surface
        if self.morph.source.topology is source.topology:
            return moved
        ends = {0.0: source.vertices, 1.0: self.match.result.correspondence.positions}
        apart = source.vertices - surface.mesh.vertices[surface.vertex_map]
        return ends[t] if t in ends else moved[surface.vertex_map] + (1 - t) * apart

    def frames(self, count: int) -> MeshSequence:
        """Shapes at equal steps of time."""
        times = np.linspace(0.0, 1.0, count)
        source = self.match.result.correspondence.source
        return MeshSequence(source.topology, np.stack([self.positions(float(t)) for t in times]), times)


@dataclass(eq=False)
class Pairing:
    """Source and target, and what goes between them.

    Parameters
    ----------
    emit
        Takes notes and frames.
    desk
        Where the source is edited, and the history with the markers.
    """

    emit: Emit
    desk: Desk
    target: Model | None = None
    features: Features | None = None
    match: Match | None = None
    travel: Travel | None = None
    time: float = 0.0
    number: int = 0
    """Of the mesh that morphs."""
    _maps: dict[str, SphericalMap] = field(default_factory=dict)
    _seq: dict[int, int] = field(default_factory=dict)

    def open(self, model: Model | None) -> None:
        """Put a target beside the source, or take it away."""
        self.target = model
        self.forget()
        if model is not None:
            self.emit(mesh_frame(model, Slot.TARGET, model.mesh.vertices))

    def forget(self) -> None:
        """A mesh was exchanged: nothing between the two holds any more."""
        self.features, self.match, self.travel, self.time = None, None, None, 0.0

    def both(self) -> tuple[Mesh, Mesh]:
        """The source as it is now, and the target.

        Raises
        ------
        Refusal
            If one is missing.
        """
        if self.desk.model is None or self.target is None:
            raise Refusal("order", "a source and a target", "one of them, or none", "open two meshes first")
        return self.desk.model.shape(self.desk.edit.shape), self.target.welded.source

    @property
    def markers(self) -> tuple[Marker, ...]:
        """The pairs that were set by hand."""
        return self.desk.history.now.markers

    def add(self, marker: Marker) -> None:
        """One more pair."""
        self._mark("add marker", (*self.markers, self._checked(marker)))

    def move(self, index: int, slot: str, vertex: int) -> None:
        """One end of a pair to another vertex."""
        old = self._marker(index)
        changed = replace(old, source=vertex) if slot == "source" else replace(old, target=vertex)
        self._mark("move marker", (*self.markers[:index], self._checked(changed), *self.markers[index + 1 :]))

    def name(self, index: int, label: str) -> None:
        """Another label for a pair."""
        named = replace(self._marker(index), label=label)
        self._mark("name marker", (*self.markers[:index], named, *self.markers[index + 1 :]))

    def remove(self, index: int) -> None:
        """One pair less."""
        self._marker(index)
        self._mark("remove marker", (*self.markers[:index], *self.markers[index + 1 :]))

    def take(self, markers: tuple[Marker, ...], label: str) -> None:
        """Exchange all pairs."""
        self._mark(label, tuple(self._checked(marker) for marker in markers))

    def take_matched(self) -> None:
        """The pairs of the correspondence as markers."""
        self.take(self.matched().pairs, "take pairs")

    def find(self, job: Job) -> None:
        """Feature regions of both meshes, and which go together."""
        surfaces = tuple(close(mesh) for mesh in self.both())
        found = []
        for name, surface in zip(("source", "target"), surfaces, strict=True):
            job.enter(f"regions of the {name}")
            found.append(find_regions(surface.mesh))
        job.enter("matching regions")
        self._feature(_together((surfaces[0], surfaces[1]), (found[0], found[1])))

    def correspond(self, job: Job) -> None:
        """The correspondence by the markers."""
        markers, pairs = self.markers, self.desk.history.now.pairs
        source, target = self.both()
        maps = [self._mapped(mesh, f"sphere of the {name}", job) for name, mesh in (("source", source), ("target", target))]
        job.enter("regions, alignment, dense map")
        result = correspond_maps(maps[0], maps[1], pairs if len(pairs) else None, job.on_step)
        job.enter("quality")
        self.match, self.travel = Match(result, markers, result.figures()), None
        self._tell_match(self.match)

    def prepare(self, path: MorphPath, job: Job) -> None:
        """The morph along the correspondence."""
        match = self.matched()
        job.enter("the way of each vertex" if path != "wavelet" else "wavelets of both shapes")
        travel = Travel(match, morph_along(match.result, path=path, frames=2).morph)
        if path == "gradient":
            travel.positions(0.5)  # factors
        self.travel = travel
        self.number += 1
        self.emit(self._frame(Kind.MESH, 0))
        self.show(0, self.time)

    def schedule(self, bands: tuple[Mapping[str, Any], ...]) -> None:
        """When each band moves."""
        travel = self._travelling()
        if not travel.bands:
            raise Refusal("order", 'a morph on the path "wavelet"', travel.morph.path, "prepare one first")
        if len(bands) != travel.bands:
            raise Refusal("field", f"{travel.bands} bands", str(len(bands)), "tell each band once, from coarse to fine")
        start, duration, easing = ([band[key] for band in bands] for key in ("start", "duration", "easing"))
        self.travel = travel.scheduled(Schedule(np.array(start), np.array(duration), tuple(easing)))
        self.show(0, self.time)

    def at(self, client: int, seq: int, time: float) -> None:
        """The shape at a time; what comes too late is left alone."""
        if self.travel is not None and seq > self._seq.get(client, -1):
            self._seq[client] = seq
            self.show(seq, time)

    def gone(self, client: int) -> None:
        """A page that went away."""
        self._seq.pop(client, None)

    def show(self, seq: int, time: float) -> None:
        """A frame of the morph."""
        self._travelling()
        self.time = time
        self.emit(self._frame(Kind.FRAME, seq))
        self.emit(Note({"type": "numbers", "slot": "morph", "seq": seq, "time": time}, newest=True))

    def told(self) -> dict[str, Any]:
        """The parts of the state that are about both meshes."""
        return {
            "markers": [{"source": one.source, "target": one.target, "label": one.label} for one in self.markers],
            "regions": None if self.features is None else self.features.told(),
            "match": None if self.match is None else self._told_match(self.match),
            "morph": None if self.travel is None else self._told_travel(self.travel),
        }

    def _told_match(self, match: Match) -> dict[str, Any]:
        return {
            "current": self._current(match),
            "figures": dict(match.figures),
            "warnings": match.result.warnings,
            "ambiguous": match.result.ambiguous,
            "pairs": [{"source": one.source, "target": one.target, "label": one.label} for one in match.pairs],
        }

    def _told_travel(self, travel: Travel) -> dict[str, Any]:
        schedule = travel.morph.schedule
        rows = [] if schedule is None else zip(schedule.start.tolist(), schedule.duration.tolist(), schedule.easing, strict=True)
        bands = [{"start": s, "duration": d, "easing": e} for s, d, e in rows]
        return {
            "path": travel.morph.path,
            "bands": travel.bands,
            "schedule": bands,
            "time": self.time,
            "current": self._current(travel.match),
        }

    def _current(self, match: Match) -> bool:
        """Whether shapes and markers are still those that it was made for."""
        if self.desk.model is None or [one.ends for one in match.markers] != [one.ends for one in self.markers]:
            return False
        return bool(np.array_equal(match.result.source_map.mesh.vertices, self.desk.model.placed(self.desk.edit.shape)))

    def _tell_match(self, match: Match) -> None:
        """Spheres and images; regions, if some were matched."""
        result, (source, target) = match.result, self._numbers()
        laid, points = result.laid.points.astype(np.float32), result.target_map.points.astype(np.float32)
        images = result.correspondence.positions.astype(np.float32)
        self.emit(Frame(Kind.SPHERE, Slot.SOURCE, source, (laid,), len(laid), flags=LAID))
        self.emit(Frame(Kind.SPHERE, Slot.TARGET, target, (points,), len(points)))
        self.emit(Frame(Kind.IMAGES, Slot.SOURCE, source, (images,), len(images)))
        if result.matching is not None:
            surfaces = result.source_map.surface, result.target_map.surface
            found = find_regions(surfaces[0].mesh), find_regions(surfaces[1].mesh)
            self._feature(Features(surfaces, found, _numbers(result.matching.regions)))

    def _feature(self, features: Features) -> None:
        """Keep regions and show them."""
        self.features = features
        for slot, number, surface, own in zip((Slot.SOURCE, Slot.TARGET), self._numbers(), features.surfaces, features.found, strict=True):
            nodes = own.nodes[surface.vertex_map]
            labels = np.where(nodes < len(own), nodes, -1).astype(np.int32)
            self.emit(Frame(Kind.LABELS, slot, number, (labels,), len(labels)))

    def _numbers(self) -> tuple[int, int]:
        """Of both meshes."""
        self.both()
        return self.desk.opened.number, 0 if self.target is None else self.target.number

    def _frame(self, kind: Kind, seq: int) -> Frame:
        """The morph's mesh, or a frame of it."""
        model, positions = self.desk.opened, self._travelling().positions(self.time)
        welded = positions if model.alike else positions[model.welded.source_vertices]
        shading, placed = model.normals(welded), positions.astype(np.float32)
        if kind == Kind.FRAME:
            return Frame(kind, Slot.MORPH, self.number, (placed, shading), len(placed), seq=seq)
        faces = model.faces.astype(np.uint32)
        return Frame(kind, Slot.MORPH, self.number, (placed, shading, faces), len(placed), len(faces))

    def _mapped(self, mesh: Mesh, stage: str, job: Job) -> SphericalMap:
        """The spherical map of a mesh, made once."""
        job.enter(stage)
        if mesh.fingerprint not in self._maps:
            self._maps[mesh.fingerprint] = map_surface(close(mesh), None, job.on_step)
            for old in list(self._maps)[:-MOST_MAPS]:
                del self._maps[old]
        return self._maps[mesh.fingerprint]

    def matched(self) -> Match:
        """The correspondence.

        Raises
        ------
        Refusal
            If there is none.
        """
        if self.match is None:
            raise Refusal("order", "a correspondence", "none", "run it first")
        return self.match

    def _travelling(self) -> Travel:
        if self.travel is None:
            raise Refusal("order", "a morph", "none", "prepare one first")
        return self.travel

    def _marker(self, index: int) -> Marker:
        if index >= len(self.markers):
            raise Refusal("field", f"a marker below {len(self.markers)}", str(index), "add one first")
        return self.markers[index]

    def _checked(self, marker: Marker) -> Marker:
        """A marker whose vertices both meshes have."""
        source, target = self.both()
        VertexPairs(np.array([marker.source]), np.array([marker.target])).checked(source, target)
        return marker

    def _mark(self, label: str, markers: tuple[Marker, ...]) -> None:
        self.desk.history.commit(label, replace(self.desk.history.now, markers=markers))


def _together(surfaces: tuple[Repaired, Repaired], found: tuple[Regions, Regions]) -> Features:
    """Regions that go together by themselves; none if they cannot be matched."""
    try:
        likely = candidates(*found)
    except MeshError:
        return Features(surfaces, found, ())
    return Features(surfaces, found, _numbers(likely[0].regions), len(likely) > 1)


def _numbers(pairs: np.ndarray) -> tuple[tuple[int, int], ...]:
    return tuple((int(s), int(t)) for s, t in pairs)
