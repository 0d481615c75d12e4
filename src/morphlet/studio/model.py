"""A mesh in the studio: as its file tells it, and with its seams closed, as it is edited.

Pages and files count vertices as the mesh's file does; edits work on the welded mesh. A vertex of the file that has no answer of its own
(in no face) goes with the nearest that has one.
"""

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32, Int, Int32, UInt8

from morphlet import _arrays
from morphlet.errors import InputError
from morphlet.io.formats import read, read_attributes
from morphlet.studio.kernels import shaded
from morphlet.surface.mesh import Mesh
from morphlet.surface.repair import Repaired, RepairOptions, repair

MOST_VERTICES = 2_000_000
"""Of a mesh that can be opened: its frames are then 48 MB."""
OPAQUE = 255


@dataclass(frozen=True, eq=False)
class Model:
    """A mesh that was opened.

    Parameters
    ----------
    name
        Of its file, without folders.
    file
        Its file: what is saved keeps what it carries.
    welded
        The mesh as given, and as it is edited.
    number
        Which of the meshes opened so far: frames for another one are stale.
    """

    name: str
    file: Path
    welded: Repaired
    number: int

    @staticmethod
    def open(file: Path, name: str, number: int) -> "Model":
        """Read a mesh file and close its seams.

        Raises
        ------
        FileError
            If it is no mesh file.
        InputError
            If it has too many vertices.
        """
        mesh = read(file)
        if mesh.n_vertices > MOST_VERTICES:
            raise InputError(f"at most {MOST_VERTICES} vertices in {name}", str(mesh.n_vertices), "simplify the mesh first")
        return Model(name, file, repair(mesh, RepairOptions(split=False)), number)

    @property
    def mesh(self) -> Mesh:
        """As it is edited, at rest."""
        return self.welded.mesh

    @property
    def n_vertices(self) -> int:
        """Of the file."""
        return self.welded.source.n_vertices

    @cached_property
    def faces(self) -> Int[np.ndarray, "m 3"]:
        """Faces of the file in its order, turned as the welded mesh's are."""
        faces, turned = np.array(self.welded.source.faces), self.welded.face_map[self.welded.flipped]
        turned = turned[turned >= 0]
        faces[turned] = faces[turned][:, [0, 2, 1]]
        return faces

    @cached_property
    def colors(self) -> UInt8[np.ndarray, "n 4"] | None:
        """Colours of the file, opaque; None if it has none."""
        found = read_attributes(self.file).colors
        return None if found is None else np.column_stack([found, np.full(len(found), OPAQUE, np.uint8)])

    @cached_property
    def _apart(self) -> Float[np.ndarray, "n 3"] | None:
        """How far each vertex of the file is from its own of the welded mesh; None if none is."""
        apart = self.welded.source.vertices - self.mesh.vertices[self.welded.vertex_map]
        return apart if apart.any() else None

    @cached_property
    def alike(self) -> bool:
        """Whether file and welded mesh have the same vertices in the same order."""
        return np.array_equal(self.welded.vertex_map, np.arange(self.mesh.n_vertices)) and self._apart is None

    @cached_property
    def told(self) -> dict[str, Any]:
        """What a page is told of it."""
        mesh = self.welded.source
        low, high = mesh.vertices.min(axis=0), mesh.vertices.max(axis=0)
        return {
            "name": self.name,
            "mesh": self.number,
            "vertices": mesh.n_vertices,
            "faces": mesh.n_faces,
            "diagonal": mesh.bbox_diagonal,
            "center": ((low + high) / 2).tolist(),
            "fingerprint": mesh.fingerprint,
            "repairs": [{"what": one.what, "count": one.count} for one in self.welded.repairs],
        }

    def inside(self, vertices: Int[np.ndarray, "k"]) -> Int[np.ndarray, "u"]:
        """Vertices of the welded mesh for some of the file, each once, ascending.

        Raises
        ------
        InputError
            If the file has no such vertices.
        """
        checked = _arrays.index(vertices, "vertices", (None,), self.n_vertices)
        return np.unique(self.welded.vertex_map[checked[self.welded.valid[checked]]])

    def outside(self, vertices: Int[np.ndarray, "k"]) -> Int[np.ndarray, "k"]:
        """A vertex of the file for each of some of the welded mesh."""
        return self.welded.source_vertices[vertices]

    def spread(self, values: np.ndarray) -> np.ndarray:
        """Values of the welded vertices as values of the file's."""
        return values if self.alike else values[self.welded.vertex_map]

    def placed(self, positions: Float[np.ndarray, "w 3"]) -> Float[np.ndarray, "n 3"]:
        """Positions of the file's vertices."""
        return positions if self.alike else self.spread(positions) + (0.0 if self._apart is None else self._apart)

    @cached_property
    def faces_in_order(self) -> Int32[np.ndarray, "f 3"]:
        """Faces of the welded mesh, neighbours one after the other."""
        return in_order(self.mesh.faces)

    def normals(self, positions: Float[np.ndarray, "w 3"]) -> Float32[np.ndarray, "n 3"]:
        """Unit normals of the file's vertices, zero in no face."""
        shown, out = np.empty((2, len(positions), 3), np.float32)
        shaded(np.array(positions), self.faces_in_order, np.empty((len(positions), 3)), shown, out)
        return self.spread(out)

    def shape(self, positions: Float[np.ndarray, "w 3"]) -> Mesh:
        """The mesh of the file at other positions."""
        return self.welded.source.with_vertices(self.placed(positions))


def in_order(faces: Int[np.ndarray, "m 3"]) -> Int32[np.ndarray, "m 3"]:
    """Faces by their least vertex: neighbours follow each other, as the kernels like it."""
    return np.ascontiguousarray(faces[np.argsort(faces.min(axis=1), kind="stable")], np.int32)
