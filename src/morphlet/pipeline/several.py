"""Several meshes on one sphere: each is brought to the first (Eq. 7 for k meshes), and through it to every other.

Every mesh is mapped to its sphere once and laid into the first one's sphere once: k meshes take k spherical maps and k - 1 dense maps,
and give all k (k - 1) correspondences between them.
"""

from collections.abc import Sequence
from dataclasses import dataclass

from morphlet.errors import InputError
from morphlet.mapping.correspondence import Correspondence, compose
from morphlet.numerics.optimize import OnStep
from morphlet.pipeline.correspond import correspond_maps
from morphlet.pipeline.results import CorrespondResult
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Mesh
from morphlet.surface.pairs import VertexPairs

FEWEST = 2
"""Meshes that can be brought together."""


@dataclass(frozen=True, eq=False)
class CommonSphere:
    """k meshes laid one-to-one on the sphere of the first.

    Parameters
    ----------
    first
        Spherical map of the first mesh.
    results
        How each of the others, in order, was brought to the first.
    """

    first: SphericalMap
    results: tuple[CorrespondResult, ...]

    def __len__(self) -> int:
        return 1 + len(self.results)

    @property
    def laid(self) -> tuple[SphericalMap, ...]:
        """All meshes on the sphere of the first, the first among them."""
        return (self.first, *(result.laid for result in self.results))

    @property
    def warnings(self) -> tuple[str, ...]:
        """What a person should know before relying on the maps; each says which mesh it is about."""
        return tuple(f"mesh {k}: {told}" for k, result in enumerate(self.results, 1) for told in result.warnings)

    def between(self, source: int, target: int) -> Correspondence:
        """Where each vertex of one mesh lies on another.

        Parameters
        ----------
        source, target
            Which meshes, counted from 0 in the order they were given.

        Raises
        ------
        InputError
            If there is no such mesh.

        Notes
        -----
        Up to the common sphere and down again: a lookup per vertex. Nothing is optimised between the two, so that the maps agree
        with each other all round, and errors of both add up.
        """
        for number in (source, target):
            if not 0 <= number < len(self):
                raise InputError(f"the number of a mesh, 0 to {len(self) - 1}", str(number), "count in the order they were given")
        return compose(self.laid[source], self.laid[target])


def correspond_all(
    meshes: Sequence[Mesh], pairs: Sequence[VertexPairs | None] | None = None, on_step: OnStep | None = None
) -> CommonSphere:
    """Bring several meshes to the first of them.

    Parameters
    ----------
    meshes
        Two or more meshes that `spherical_map` accepts.
    pairs
        For each mesh but the first, vertices of it (source) that belong to vertices of the first (target); None where feature
        regions are to be matched, as everywhere if left out.
    on_step
        Called with each step of the optimisations; may raise `Cancelled`.

    Raises
    ------
    InputError
        If there are fewer than two meshes, or not as many sets of pairs as meshes but the first, or pairs do not fit their meshes.
    MeshError
        If a mesh has no spherical map.

    Notes
    -----
    Eq. 7 of the paper brings k meshes to one: a rotation each, here followed by the dense map of `correspond`. The first mesh should
    be the one most like all others: their maps to each other run through it.

    Examples
    --------
    >>> from morphlet import Mesh, VertexPairs
    >>> from morphlet.numerics.unit_sphere import icosphere
    >>> from morphlet.pipeline.several import correspond_all
    >>> points, faces = icosphere(1)
    >>> three = [Mesh(points * size, faces) for size in ([1, 1, 1.0], [1, 1.2, 1.6], [1.3, 1, 1])]
    >>> common = correspond_all(three, 2 * [VertexPairs([0, 1, 2], [0, 1, 2])])
    >>> found = common.between(1, 2)
    >>> found.source is three[1], found.target is three[2], bool(abs(found.positions[:3] - three[2].vertices[:3]).max() < 0.01)
    (True, True, True)
    """
    if len(meshes) < FEWEST:
        raise InputError(f"{FEWEST} meshes or more", str(len(meshes)), "pass the meshes that belong together")
    given = [None] * (len(meshes) - 1) if pairs is None else list(pairs)
    if len(given) != len(meshes) - 1:
        found = f"{len(given)} for {len(meshes)} meshes"
        raise InputError("pairs for each mesh but the first", found, "pass None where regions are to be matched")
    for mesh, some in zip(meshes[1:], given, strict=True):
        if some is not None:
            some.checked(mesh, meshes[0])
    first = spherical_map(meshes[0], on_step=on_step)
    others = (spherical_map(mesh, on_step=on_step) for mesh in meshes[1:])
    return CommonSphere(first, tuple(correspond_maps(other, first, some, on_step) for other, some in zip(others, given, strict=True)))
