"""A closed mesh as a wavelet network of a few hundred bytes, which is a surface at any resolution.

The mesh is mapped to the sphere, x, y and z become sums of the same wavelets there, and the file names the wavelets and tells what
each adds to those before it, in steps of one size. The packets of a file go from coarse to fine; any first few make a surface.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from morphlet.codec import orthogonal
from morphlet.codec.atom_coder import MOST_ATOMS
from morphlet.codec.atoms import AFFINE, FINEST_LEVEL, kinds_of, levels_up_to
from morphlet.codec.container import damaged
from morphlet.codec.network_fit import Choice, Part, choose, quantised, selected, settled, surveyed
from morphlet.codec.network_stream import LAST_LEVEL, LEAST_LEVEL, STEPS_PER_OCTAVE, Head, read_payloads, step_of, write_network
from morphlet.codec.surface_error import surface_error
from morphlet.errors import InputError
from morphlet.numerics.unit_sphere import icosphere
from morphlet.sphere.embed import SphereOptions
from morphlet.sphere.map import SphericalMap, spherical_map
from morphlet.surface.mesh import Mesh, Topology
from morphlet.surface.requirements import require_sphere
from morphlet.wavenet.mothers import MOTHERS, PAPER_SIX, Mother
from morphlet.wavenet.spherical import SphericalNetwork

USUAL_LEVEL = 6
"""40962 vertices."""
BYTES_PER_WAVELET = 2.2
"""Fewest seen on animals and heads, with a tenth to spare."""
FEWEST_BYTES = 60
"""1, x, y and z take up to 35."""
OCTAVES = 22
"""Steps from the diagonal to 2^-22 of it are tried: finer ones add bytes and nothing else."""
SETTLED_SHARE = 0.98
"""Of the bytes asked for, at which wavelets are selected: their last fit makes coefficients a little larger."""
STEP_LEAST, STEP_MOST = 1 / 128, 1 / 2
"""Steps over the error asked for, between which the best one is sought."""
CLOSE = 2
"""Exponents between which the search for an error ends: 9 % of the step, 2 % of the bytes."""
FARTHEST = 2.0**400
"""Diagonals: steps have 16 bits."""
TRIAL_WAVELETS = 256
DECAY, SPARE = 0.6, 1.5
"""An error falls at least with this power of the number of wavelets; how many more are picked than that says."""


@dataclass(frozen=True)
class NetworkOptions:
    """How a mesh becomes a network.

    Parameters
    ----------
    mothers
        Among the paper's six. Directions of odd ones take bytes: at equal bytes (300 and 800, horse and bunny) no other set tried was
        more than 0.3 dB nearer than beta2 alone, and most were farther.
    finest
        Level of the finest centers, 0 to 5.
    level
        Subdivisions of the icosahedron in the mesh that a reader makes unless told otherwise, 3 to 8.
    most
        Wavelets, at most 2048.

    Raises
    ------
    InputError
        If a number is out of its range, or a mother is not one of the six.

    Examples
    --------
    >>> from morphlet.codec.network import NetworkOptions
    >>> from morphlet.wavenet.mothers import PAPER_SIX
    >>> NetworkOptions(mothers=PAPER_SIX).finest
    5
    """

    mothers: tuple[Mother, ...] = (MOTHERS["beta2"],)
    finest: int = FINEST_LEVEL - 1
    level: int = USUAL_LEVEL
    most: int = MOST_ATOMS

    def __post_init__(self) -> None:
        names = [psi.name for psi in PAPER_SIX]
        others = [psi.name for psi in self.mothers if psi.name not in names]
        if others or not self.mothers:
            raise InputError(f"mothers among {', '.join(names)}", ", ".join(others) or "none", "choose some of these")
        ranges = {"finest": (0, FINEST_LEVEL - 1), "level": (LEAST_LEVEL, LAST_LEVEL), "most": (0, MOST_ATOMS)}
        for name, (least, most) in ranges.items():
            if not least <= getattr(self, name) <= most:
                raise InputError(f"{name} from {least} to {most}", f"{getattr(self, name)}", "choose one in that range")


USUAL = NetworkOptions()


@dataclass(frozen=True)
class NetworkReport:
    """What a network came to.

    Parameters
    ----------
    bytes
        Of all payloads.
    wavelets, counts
        How many, and of each mother.
    step
        Of the coefficients, in mesh units.
    rms, hausdorff
        Distances of the two surfaces, the mesh read at the level of the options, in mesh units.
    """

    bytes: int
    wavelets: int
    counts: dict[str, int]
    step: float
    rms: float
    hausdorff: float


@dataclass(frozen=True, eq=False)
class NetworkFile:
    """A network as payloads, coarse to fine; the level of the mesh that a reader makes; what it came to."""

    payloads: list[bytes]
    level: int
    report: NetworkReport


@dataclass(frozen=True, eq=False)
class DecodedNetwork:
    """A network that was read.

    Parameters
    ----------
    network
        From unit vectors to places.
    level
        Subdivisions of the icosahedron that the writer suggests for a mesh.
    """

    network: SphericalNetwork
    level: int

    def mesh(self, level: int | None = None) -> Mesh:
        """Its surface at the points of an icosahedron with this many subdivisions, 10 4^level + 2 of them.

        Raises
        ------
        InputError
            If the level is negative or above 8.
        """
        level = self.level if level is None else level
        if not 0 <= level <= LAST_LEVEL:
            raise InputError(f"a level from 0 to {LAST_LEVEL}", f"{level}", "choose one in that range")
        points, faces = icosphere(level)
        return Mesh(self.network(points), Topology(faces, len(points)))


@dataclass(frozen=True, eq=False)
class NetworkEncoder:
    """A mesh on the sphere with the wavelets that may tell it: what all sizes have in common.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.codec.network import NetworkEncoder, NetworkOptions, read_network
    >>> encoder = NetworkEncoder.prepare(sample("blob", n_vertices=1500), 60, NetworkOptions(finest=3, level=4))
    >>> small, large = encoder.of_bytes(80), encoder.of_bytes(160)
    >>> small.report.bytes <= 80, large.report.rms < 0.5 * small.report.rms
    (True, True)
    >>> read_network(small.payloads).mesh(2)
    Mesh(162 vertices, 320 faces)
    """

    mesh: Mesh
    options: NetworkOptions
    choice: Choice

    @staticmethod
    def prepare(mesh: Mesh | SphericalMap, wavelets: int, options: NetworkOptions = USUAL) -> "NetworkEncoder":
        """Map the mesh so that areas count, unless it comes with a map, and pick so many wavelets: about one per 2.2 bytes.

        Raises
        ------
        MeshError
            If the mesh is not closed, of one piece and of genus 0.
        InputError
            If its diagonal is beyond 2^400, or below its inverse.
        """
        mapped = mesh if isinstance(mesh, SphericalMap) else area_map(mesh)
        require_sphere(mapped.mesh)
        if not 1 / FARTHEST < mapped.mesh.bbox_diagonal < FARTHEST:
            raise InputError("a mesh of some size", f"a diagonal of {mapped.mesh.bbox_diagonal:.3g}", "change the unit")
        most = min(wavelets, options.most)
        levels = levels_up_to(options.finest + 1)
        return NetworkEncoder(mapped.mesh, options, choose(surveyed(mapped, most), options.mothers, most, levels))

    def of_bytes(self, size: int) -> NetworkFile:
        """As near as may be to so many bytes, and no more.

        Raises
        ------
        InputError
            If they are fewer than 60.
        """
        if size < FEWEST_BYTES:
            raise InputError(f"at least {FEWEST_BYTES} bytes", f"{size}", "ask for more")
        high = self._exponent(1.0)
        low = high - OCTAVES * STEPS_PER_OCTAVE
        while high - low > 1:
            middle = (low + high) // 2
            fits = self._size(selected(self.choice, step_of(middle)), middle) <= SETTLED_SHARE * size
            low, high = (low, middle) if fits else (middle, high)
        part = settled(self.choice, selected(self.choice, step_of(high)))
        while self._size(part, high) > size:
            high += 1
        return self._file(part, high)

    def of_error(self, rms: float) -> NetworkFile | None:
        """As few bytes as may be for surfaces so near (root mean square, in mesh units); None if these wavelets are too few.

        Raises
        ------
        InputError
            If the error is not positive.
        """
        if not rms > 0:
            raise InputError("an error above 0", f"{rms}", "ask for a larger one")
        size = self.mesh.bbox_diagonal
        low, high = self._exponent(STEP_LEAST * rms / size), self._exponent(STEP_MOST * rms / size)
        found = None
        while high - low > CLOSE or (found is None and high > low):
            middle = (low + high) // 2
            file = self._file(settled(self.choice, selected(self.choice, step_of(middle))), middle)
            if file.report.rms <= rms:
                low, found = middle, file
            else:
                high = middle
        return found

    def nearest(self, step: float) -> float:
        """How near (root mean square, in mesh units) the wavelets come that are worth telling in such steps, before rounding."""
        part = settled(self.choice, selected(self.choice, step))
        network = self.choice.atoms[part.terms[AFFINE:] - AFFINE].network(self.choice.levels, part.weights)
        return surface_error(self.mesh, DecodedNetwork(network, self.options.level).mesh()).rms

    def _exponent(self, share: float) -> int:
        """Of a step that is such a share of the diagonal."""
        return round(math.log2(share * self.mesh.bbox_diagonal) * STEPS_PER_OCTAVE)

    def _payloads(self, part: Part, exponent: int) -> list[bytes]:
        """What a reader needs."""
        kinds = tuple(int(k) for k in np.sort(kinds_of(self.options.mothers)))
        head = Head(kinds, exponent, len(self.choice.levels) - 1, self.options.level)
        return write_network(head, *quantised(self.choice, part, head.step), self.choice.levels)

    def _size(self, part: Part, exponent: int) -> int:
        """Bytes of the payloads."""
        return sum(map(len, self._payloads(part, exponent)))

    def _file(self, part: Part, exponent: int) -> NetworkFile:
        """The file of a part, measured on what a reader makes of it."""
        payloads = self._payloads(part, exponent)
        decoded = read_network(payloads)
        error, network = surface_error(self.mesh, decoded.mesh()), decoded.network
        size, step = sum(map(len, payloads)), step_of(exponent)
        return NetworkFile(payloads, decoded.level, NetworkReport(size, len(network), network.counts(), step, error.rms, error.hausdorff))


def network_of_bytes(mesh: Mesh | SphericalMap, size: int, options: NetworkOptions = USUAL) -> NetworkFile:
    """A closed mesh as a network of at most so many bytes.

    Parameters
    ----------
    mesh
        Closed, of one piece and of genus 0; or its map, which should be one on which areas count (`area_map`).
    size
        Of all payloads; a container adds about 40.
    options
        How.

    Raises
    ------
    MeshError
        If the mesh is none that a sphere can be.
    InputError
        If the bytes are fewer than 60.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.codec.network import NetworkOptions, network_of_bytes
    >>> network_of_bytes(sample("blob", n_vertices=1500), 100, NetworkOptions(level=4)).report.bytes <= 100
    True
    """
    return NetworkEncoder.prepare(mesh, math.ceil(size / BYTES_PER_WAVELET), options).of_bytes(size)


def network_at(mesh: Mesh | SphericalMap, rms: float, options: NetworkOptions = USUAL) -> NetworkFile | None:
    """A closed mesh as a network so near to it, in as few bytes as may be; None if 2048 wavelets come no nearer.

    Parameters
    ----------
    mesh
        Closed, of one piece and of genus 0; or its map, which should be one on which areas count (`area_map`).
    rms
        Of the distances of the two surfaces, in mesh units.
    options
        How.

    Raises
    ------
    MeshError
        If the mesh is none that a sphere can be.
    InputError
        If the error is not positive.

    Notes
    -----
    256 wavelets tell how many it takes, or that no number will do.

    Examples
    --------
    >>> from morphlet import sample
    >>> from morphlet.codec.network import NetworkOptions, network_at
    >>> blob = sample("blob", n_vertices=1500)
    >>> found = network_at(blob, 0.01 * blob.bbox_diagonal, NetworkOptions(level=4))
    >>> found.report.rms <= 0.01 * blob.bbox_diagonal
    True
    """
    mapped = mesh if isinstance(mesh, SphericalMap) else area_map(mesh)
    nearest = NetworkEncoder.prepare(mapped, TRIAL_WAVELETS, options).nearest(STEP_LEAST * rms)
    needed = TRIAL_WAVELETS * (nearest / rms) ** (1 / DECAY)
    if needed > SPARE * options.most:
        return None
    return NetworkEncoder.prepare(mapped, math.ceil(SPARE * max(needed, TRIAL_WAVELETS / SPARE)), options).of_error(rms)


def area_map(mesh: Mesh) -> SphericalMap:
    """The map of a closed mesh on which areas count.

    Raises
    ------
    MeshError
        If the mesh is not closed, of one piece and of genus 0.
    """
    require_sphere(mesh)
    return spherical_map(mesh, SphereOptions(weights="area"))


def read_network(payloads: Sequence[bytes]) -> DecodedNetwork:
    """The network of all payloads of a file, or of its first ones.

    Raises
    ------
    CodecError
        If they are damaged.
    """
    head, atoms, symbols, levels = read_payloads(payloads)
    weights = orthogonal.weights(orthogonal.products(atoms, levels, levels[-1].points), symbols * head.step)
    if not np.isfinite(weights).all():
        raise damaged("a network of infinite size")
    return DecodedNetwork(atoms.network(levels, weights), head.level)
