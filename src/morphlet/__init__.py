"""Deform, morph, match, transfer and compress triangle meshes through a common sphere."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from morphlet.errors import Cancelled as Cancelled
    from morphlet.errors import FileError as FileError
    from morphlet.errors import InputError as InputError
    from morphlet.errors import MeshError as MeshError
    from morphlet.errors import MissingExtra as MissingExtra
    from morphlet.errors import MorphletError as MorphletError
    from morphlet.errors import SolveError as SolveError
    from morphlet.surface.mesh import Mesh as Mesh
    from morphlet.surface.mesh import Topology as Topology
    from morphlet.surface.pairs import VertexPairs as VertexPairs
    from morphlet.surface.points import SurfacePoints as SurfacePoints
    from morphlet.surface.region import Region as Region
    from morphlet.surface.sequence import MeshSequence as MeshSequence

__version__ = "0.1.0"

_HOMES = {
    "morphlet.errors": "Cancelled FileError InputError MeshError MissingExtra MorphletError SolveError",
    "morphlet.surface.mesh": "Mesh Topology",
    "morphlet.surface.pairs": "VertexPairs",
    "morphlet.surface.points": "SurfacePoints",
    "morphlet.surface.region": "Region",
    "morphlet.surface.sequence": "MeshSequence",
}
_HOME = {name: module for module, names in _HOMES.items() for name in names.split()}
__all__ = ["__version__", *sorted(_HOME)]


def __getattr__(name: str) -> Any:
    """Load a public name at first use (PEP 562): `import morphlet` stays instant."""
    if name not in _HOME:
        raise AttributeError(f"module 'morphlet' has no attribute '{name}'")
    return getattr(import_module(_HOME[name]), name)


def __dir__() -> list[str]:
    return __all__
