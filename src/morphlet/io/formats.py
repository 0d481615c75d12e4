"""Mesh files by name: which format a file is in, and the calls that read and write it.

A file is known by its content first; its ending decides where the content does not tell. Vertices and faces keep the indexing of the
file: positions of OBJ are not split at texture seams, polygons become fans in file order. Files are written beside their target and
renamed. Everything that can be wrong with a file is a `FileError`.
"""

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from morphlet import _arrays, _store
from morphlet.errors import FileError, InputError
from morphlet.io import _text, gltf, gltf_shapes, obj, off, ply, stl
from morphlet.io.content import COLOR_MAX, Attributes, Content, File, Shapes, mesh_of
from morphlet.surface.mesh import Mesh


@dataclass(frozen=True)
class Format:
    """How one format is recognised, read, and written; `rewriter` prepares a template for other positions, `shapes` reads several."""

    name: str
    endings: tuple[str, ...]
    recognises: Callable[[bytes], bool]
    parse: Callable[[File], Content]
    attributes: Callable[[File], Attributes]
    render: Callable[[Mesh, Attributes], bytes]
    rewriter: Callable[[File], Callable[[Mesh], bytes]] | None
    holds_colors: bool
    shapes: Callable[[File], Shapes] | None = None


FORMATS = (
    Format("PLY", ply.ENDINGS, ply.recognises, ply.parse, ply.attributes, ply.render, ply.rewriter, True),
    Format("glTF", gltf.ENDINGS, gltf.recognises, gltf.parse, gltf.attributes, gltf.render, gltf.rewriter, True, gltf_shapes.shapes),
    Format("OFF", off.ENDINGS, off.recognises, off.parse, off.attributes, off.render, None, False),
    Format("STL", stl.ENDINGS, stl.recognises, stl.parse, stl.attributes, stl.render, None, False),
    Format("OBJ", obj.ENDINGS, obj.recognises, obj.parse, obj.attributes, obj.render, obj.rewriter, True),
)
"""In the order in which their contents are tried: from the most to the least particular."""
WRITTEN = (".ply", ".obj", ".off", ".stl", ".glb")
"""Endings that can be written."""


def read(path: str | os.PathLike[str]) -> Mesh:
    """Read a triangle mesh in the file's own indexing.

    Parameters
    ----------
    path
        A PLY (text, binary, triangle strips), OBJ, OFF, STL or static glTF file.

    Returns
    -------
    Mesh
        Vertex i is the file's i-th; polygons are triangulated as fans in file order. STL has no indexing: corners at exactly the same
        position are one vertex, by first appearance. The meshes of a glTF scene follow one another in node order, in world coordinates.

    Raises
    ------
    FileError
        If the file cannot be opened, is not a mesh, is cut short, or holds indices or coordinates that no mesh can have.

    Notes
    -----
    O(file size). The content decides on the format, the ending only where the content does not tell.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet.io.formats import read
    >>> with TemporaryDirectory() as folder:
    ...     file = Path(folder, "square.obj")
    ...     _ = file.write_text("v 0 0 0\\nv 1 0 0\\nv 1 1 0\\nv 0 1 0\\nf 1 2 3 4\\n")
    ...     read(file).faces
    array([[0, 1, 2],
           [0, 2, 3]])
    """
    file = _opened(path)
    with _named(file):
        return mesh_of(_format_of(file).parse(file))


def read_attributes(path: str | os.PathLike[str]) -> Attributes:
    """Read what a mesh file carries per vertex: colours, and texture coordinates that no seam splits.

    Raises
    ------
    FileError
        As `read`.
    """
    file = _opened(path)
    with _named(file):
        own = _format_of(file)
        mesh_of(own.parse(file))
        return own.attributes(file)


def read_shapes(path: str | os.PathLike[str]) -> Shapes:
    """Read all shapes of a mesh file: those that morph targets give it in glTF, the one it has in any other format.

    Raises
    ------
    FileError
        As `read`, or if targets or their animation do not fit the mesh.
    """
    file = _opened(path)
    with _named(file):
        own = _format_of(file)
        if own.shapes is not None:
            return own.shapes(file)
        mesh = mesh_of(own.parse(file))
        return Shapes(mesh, mesh.vertices[None], (file.path.stem,))


def write(path: str | os.PathLike[str], mesh: Mesh, *, colors: UInt8[np.ndarray, "n 3"] | None = None) -> None:
    """Write a mesh; the ending of the path is the format.

    Parameters
    ----------
    path
        Ends in `.ply` (binary, double), `.obj`, `.off` (shortest text that gives the same numbers back), `.stl` or `.glb`
        (single precision). An existing file is replaced once the new one is complete.
    mesh
        The mesh; its indexing is kept, except in STL, which has none.
    colors
        Red, green and blue of each vertex, 0 to 255 (PLY, OBJ and glTF).

    Raises
    ------
    FileError
        If the ending is unknown or the file cannot be written.
    InputError
        If the colours do not fit the mesh, or the format has none.

    Notes
    -----
    O(n).

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet import Mesh
    >>> from morphlet.io.formats import read, write
    >>> mesh = Mesh([[0, 0, 0], [0.1, 0, 0], [0, 1 / 3, 0]], [[0, 1, 2]])
    >>> with TemporaryDirectory() as folder:
    ...     write(Path(folder, "triangle.ply"), mesh)
    ...     read(Path(folder, "triangle.ply")).fingerprint == mesh.fingerprint
    True
    """
    target = format_by_ending(path)
    if colors is not None and not target.holds_colors:
        raise InputError("a format with vertex colours (.ply, .obj, .glb)", target.name, "leave the colours out, or choose another ending")
    checked = None if colors is None else _arrays.index(colors, "colors", (mesh.n_vertices, 3), COLOR_MAX + 1).astype(np.uint8)
    put(path, target.render(mesh, Attributes(checked)))


def rewrite(template: str | os.PathLike[str], mesh: Mesh, path: str | os.PathLike[str]) -> None:
    """Write a file with other positions that keeps what another file carries.

    Parameters
    ----------
    template
        The file whose faces and attributes are kept.
    mesh
        Its positions are written: one per vertex of the template, in its order.
    path
        The file to write. In the format of the template it keeps everything (OBJ: texture coordinates, groups, materials, colours,
        polygons; PLY: all properties and elements; glTF: texture coordinates, colours, materials). In another format it keeps vertex
        colours, and texture coordinates where each vertex has one pair, if that format holds them; else the geometry alone.

    Raises
    ------
    FileError
        If the template cannot be read, or the file cannot be written.
    InputError
        If the mesh has another number of vertices than the template.

    Notes
    -----
    O(n). Normals are recomputed where the template has them. Those of an OBJ file are dropped if a vertex has several: creases cannot
    be told from positions. `prepare_rewrite` reads the template once for many meshes.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> from morphlet.io.formats import read, rewrite
    >>> with TemporaryDirectory() as folder:
    ...     old, new = Path(folder, "old.obj"), Path(folder, "new.obj")
    ...     _ = old.write_text("usemtl skin\\nv 0 0 0\\nv 1 0 0\\nv 0 1 0\\nf 1 2 3\\n")
    ...     rewrite(old, read(old).with_vertices([[0, 0, 0], [2, 0, 0], [0, 2, 0]]), new)
    ...     new.read_text().split("\\n")[:3]
    ['usemtl skin', 'v 0.0 0.0 0.0', 'v 2.0 0.0 0.0']
    """
    target = format_by_ending(path)
    put(path, prepare_rewrite(template, target.endings[0])(mesh))


def prepare_rewrite(template: str | os.PathLike[str], ending: str) -> Callable[[Mesh], bytes]:
    """Read a template once; the result turns a mesh into the bytes of a file with this ending, as `rewrite` does.

    Raises
    ------
    FileError
        If the template cannot be read, or the ending is unknown.
    """
    target = format_by_ending(f"mesh{ending}")
    file = _opened(template)
    with _named(file):
        return _rewriter(file, target)


def _rewriter(file: File, target: Format) -> Callable[[Mesh], bytes]:
    own = _format_of(file)
    base = mesh_of(own.parse(file))
    if target is own and own.rewriter is not None:
        rendered = own.rewriter(file)
    else:
        kept = own.attributes(file)

        def rendered(mesh: Mesh) -> bytes:
            return target.render(mesh, kept)

    def rewritten(mesh: Mesh) -> bytes:
        if mesh.n_vertices != base.n_vertices:
            raise InputError(f"{base.n_vertices} vertices, as in {file.path}", str(mesh.n_vertices), "pass the mesh of this file, moved")
        return rendered(base.with_vertices(mesh.vertices))

    return rewritten


def _opened(path: str | os.PathLike[str]) -> File:
    place = Path(path)
    try:
        data = _store.contents(place)
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FileError(f"a mesh file at {place}", reason, "check the path and its permissions") from error
    if not data:
        raise FileError(f"a mesh in {place}", "an empty file", "get the file again")
    return File(place, data if stl.is_binary(data) else data.removeprefix(_text.BOM))


def _format_of(file: File) -> Format:
    for known in FORMATS:
        if known.recognises(file.data):
            return known
    for known in FORMATS:
        if file.path.suffix.lower() in known.endings:
            return known
    raise FileError(f"a {', '.join(known.name for known in FORMATS)} file", "none of these", "export the mesh in one of these formats")


@contextmanager
def _named(file: File) -> Iterator[None]:
    """A `FileError` from within gets the name of the file, and nothing that a terminal would obey."""
    try:
        yield
    except FileError as error:
        needed, found = _text.printable(error.needed), _text.printable(error.found)
        raise FileError(f"{needed} in {file.path}", found, error.advice, error.elements) from error


def format_by_ending(path: str | os.PathLike[str]) -> Format:
    """The format a path would be written in; a `FileError` lists the known endings."""
    ending = Path(path).suffix.lower()
    for known in FORMATS:
        if ending in known.endings and ending in WRITTEN:
            return known
    raise FileError(f"an ending out of {', '.join(WRITTEN)}", f"'{ending}' in {path}", "choose one of these")


def put(path: str | os.PathLike[str], data: bytes) -> None:
    """Write a file beside its target, then rename it."""
    with _store.beside(path) as temporary:
        temporary.write_bytes(data)
