"""Deform, morph, match, transfer and compress triangle meshes through a common sphere."""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from morphlet.approximation.rows import RowApproximation as RowApproximation
    from morphlet.approximation.rows import RowOptions as RowOptions
    from morphlet.approximation.rows import approximate_by_rows as approximate_by_rows
    from morphlet.approximation.rows import approximate_rows as approximate_rows
    from morphlet.approximation.surface import ApproximationOptions as ApproximationOptions
    from morphlet.approximation.surface import SurfaceApproximation as SurfaceApproximation
    from morphlet.approximation.surface import approximate as approximate
    from morphlet.codec.auto import EncodedSurface as EncodedSurface
    from morphlet.codec.auto import SurfaceReport as SurfaceReport
    from morphlet.codec.auto import Trial as Trial
    from morphlet.codec.auto import encode_network as encode_network
    from morphlet.codec.auto import encode_surface as encode_surface
    from morphlet.codec.container import CodecError as CodecError
    from morphlet.codec.container import Limits as Limits
    from morphlet.codec.network import DecodedNetwork as DecodedNetwork
    from morphlet.codec.network import NetworkOptions as NetworkOptions
    from morphlet.codec.reading import decode as decode
    from morphlet.codec.reading import decode_network as decode_network
    from morphlet.codec.reading import decode_part as decode_part
    from morphlet.codec.reading import decode_stream as decode_stream
    from morphlet.codec.results import CodecOptions as CodecOptions
    from morphlet.codec.results import Decoded as Decoded
    from morphlet.codec.results import Encoded as Encoded
    from morphlet.codec.results import EncodeReport as EncodeReport
    from morphlet.codec.sequence import FrameEncoder as FrameEncoder
    from morphlet.codec.sequence import encode as encode
    from morphlet.editing.arap import Arap as Arap
    from morphlet.editing.detail import Multiresolution as Multiresolution
    from morphlet.editing.editor import RoiEditor as RoiEditor
    from morphlet.editing.editor import edit as edit
    from morphlet.editing.estimated import EstimatedRotations as EstimatedRotations
    from morphlet.editing.falloff import Direct as Direct
    from morphlet.editing.guard import Guarded as Guarded
    from morphlet.editing.lattice import Lattice as Lattice
    from morphlet.editing.linear import DualLaplacian as DualLaplacian
    from morphlet.editing.linear import Laplacian as Laplacian
    from morphlet.editing.linear import SimilarityLaplacian as SimilarityLaplacian
    from morphlet.editing.method import Pull as Pull
    from morphlet.editing.moving_least_squares import MovingLeastSquares as MovingLeastSquares
    from morphlet.editing.roi import Roi as Roi
    from morphlet.editing.roi import vertex_path as vertex_path
    from morphlet.editing.roi import vertices_within as vertices_within
    from morphlet.editing.script import read_edit as read_edit
    from morphlet.editing.shell import Shell as Shell
    from morphlet.errors import Cancelled as Cancelled
    from morphlet.errors import FileError as FileError
    from morphlet.errors import InputError as InputError
    from morphlet.errors import MeshError as MeshError
    from morphlet.errors import MissingExtra as MissingExtra
    from morphlet.errors import MorphletError as MorphletError
    from morphlet.errors import SolveError as SolveError
    from morphlet.features.matching import Matching as Matching
    from morphlet.features.matching import match as match
    from morphlet.features.pairing import MatchOptions as MatchOptions
    from morphlet.features.regions import RegionOptions as RegionOptions
    from morphlet.features.regions import Regions as Regions
    from morphlet.features.regions import find_regions as find_regions
    from morphlet.io.formats import read as read
    from morphlet.io.formats import rewrite as rewrite
    from morphlet.io.formats import write as write
    from morphlet.io.pairs import read_pairs as read_pairs
    from morphlet.io.pairs import write_pairs as write_pairs
    from morphlet.io.sequences import Poses as Poses
    from morphlet.io.sequences import read_poses as read_poses
    from morphlet.io.sequences import read_sequence as read_sequence
    from morphlet.io.sequences import write_animation as write_animation
    from morphlet.io.sequences import write_sequence as write_sequence
    from morphlet.io.video import write_video as write_video
    from morphlet.mapping.alignment import Alignment as Alignment
    from morphlet.mapping.correspondence import Correspondence as Correspondence
    from morphlet.mapping.correspondence import confidence as confidence
    from morphlet.mapping.correspondence import doubtful_pairs as doubtful_pairs
    from morphlet.mapping.differential import laplacian_warp as laplacian_warp
    from morphlet.mapping.differential import reconstruct as reconstruct
    from morphlet.mapping.embedding import Embedding as Embedding
    from morphlet.mapping.embedding import LeaveOneOut as LeaveOneOut
    from morphlet.mapping.embedding import embed as embed
    from morphlet.mapping.embedding import leave_one_out as leave_one_out
    from morphlet.mapping.laying import EmbeddingOptions as EmbeddingOptions
    from morphlet.mapping.overlay import Overlay as Overlay
    from morphlet.mapping.overlay import overlay as overlay
    from morphlet.mapping.warp import Warp as Warp
    from morphlet.mapping.warp import warp_by_pairs as warp_by_pairs
    from morphlet.metrics import compare as compare
    from morphlet.motion.bands import Bands as Bands
    from morphlet.motion.bands import wavelet_bands as wavelet_bands
    from morphlet.motion.blend import Blend as Blend
    from morphlet.motion.delay import sweep as sweep
    from morphlet.motion.face_pairs import FacePairs as FacePairs
    from morphlet.motion.face_pairs import pair_faces as pair_faces
    from morphlet.motion.measures import Measures as Measures
    from morphlet.motion.measures import measure as measure
    from morphlet.motion.morph import Morph as Morph
    from morphlet.motion.pins import Pins as Pins
    from morphlet.motion.registration import register as register
    from morphlet.motion.schedule import Schedule as Schedule
    from morphlet.motion.tour import Tour as Tour
    from morphlet.motion.transfer import Anchor as Anchor
    from morphlet.motion.transfer import TransferSolver as TransferSolver
    from morphlet.motion.transfer import transfer as transfer
    from morphlet.numerics.optimize import Step as Step
    from morphlet.numerics.optimize import Trace as Trace
    from morphlet.pipeline.candidates import Candidate as Candidate
    from morphlet.pipeline.correspond import correspond as correspond
    from morphlet.pipeline.correspond import correspond_maps as correspond_maps
    from morphlet.pipeline.morph import MorphResult as MorphResult
    from morphlet.pipeline.morph import morph as morph
    from morphlet.pipeline.morph import morph_along as morph_along
    from morphlet.pipeline.placed import PlacedResult as PlacedResult
    from morphlet.pipeline.placed import correspond_places as correspond_places
    from morphlet.pipeline.placed import correspond_places_maps as correspond_places_maps
    from morphlet.pipeline.results import CorrespondResult as CorrespondResult
    from morphlet.pipeline.several import CommonSphere as CommonSphere
    from morphlet.pipeline.several import correspond_all as correspond_all
    from morphlet.report.film import film as film
    from morphlet.report.render import Picture as Picture
    from morphlet.report.render import render as render
    from morphlet.samples.catalogue import fetch as fetch
    from morphlet.samples.creatures import Creature as Creature
    from morphlet.samples.creatures import creature as creature
    from morphlet.samples.creatures import landmarks as landmarks
    from morphlet.samples.creatures import sample as sample
    from morphlet.sphere.embed import SphereOptions as SphereOptions
    from morphlet.sphere.image import SphericalImage as SphericalImage
    from morphlet.sphere.image import spherical_image as spherical_image
    from morphlet.sphere.map import SphericalMap as SphericalMap
    from morphlet.sphere.map import spherical_map as spherical_map
    from morphlet.sphere.untangle import untangle as untangle
    from morphlet.surface.description import Description as Description
    from morphlet.surface.description import describe as describe
    from morphlet.surface.intersections import folds as folds
    from morphlet.surface.intersections import self_intersections as self_intersections
    from morphlet.surface.mesh import Mesh as Mesh
    from morphlet.surface.mesh import Topology as Topology
    from morphlet.surface.pairs import PointPairs as PointPairs
    from morphlet.surface.pairs import VertexPairs as VertexPairs
    from morphlet.surface.points import SurfacePoints as SurfacePoints
    from morphlet.surface.region import Region as Region
    from morphlet.surface.repair import Repair as Repair
    from morphlet.surface.repair import Repaired as Repaired
    from morphlet.surface.repair import RepairOptions as RepairOptions
    from morphlet.surface.repair import repair as repair
    from morphlet.surface.sequence import MeshSequence as MeshSequence
    from morphlet.wavenet.blocks import NetworkTable as NetworkTable
    from morphlet.wavenet.fit import Fit as Fit
    from morphlet.wavenet.fit import FitOptions as FitOptions
    from morphlet.wavenet.fit import RowFits as RowFits
    from morphlet.wavenet.fit import fit as fit
    from morphlet.wavenet.fit import fit_rows as fit_rows
    from morphlet.wavenet.library import Library as Library
    from morphlet.wavenet.library import dyadic_library as dyadic_library
    from morphlet.wavenet.mothers import MOTHERS as MOTHERS
    from morphlet.wavenet.mothers import PAPER_SIX as PAPER_SIX
    from morphlet.wavenet.mothers import Mother as Mother
    from morphlet.wavenet.mothers import beta as beta
    from morphlet.wavenet.mothers import coherence as coherence
    from morphlet.wavenet.mothers import make_mother as make_mother
    from morphlet.wavenet.mothers import mother as mother
    from morphlet.wavenet.network import WaveletNetwork as WaveletNetwork
    from morphlet.wavenet.spherical import SphericalLibrary as SphericalLibrary
    from morphlet.wavenet.spherical import SphericalNetwork as SphericalNetwork
    from morphlet.wavenet.spherical import spherical_library as spherical_library
    from morphlet.wavenet.spherical_fit import SphericalFit as SphericalFit
    from morphlet.wavenet.spherical_fit import fit_sphere as fit_sphere

__version__ = "0.1.0"

_HOMES = {
    "morphlet.approximation.rows": "RowApproximation RowOptions approximate_by_rows approximate_rows",
    "morphlet.approximation.surface": "ApproximationOptions SurfaceApproximation approximate",
    "morphlet.codec.auto": "EncodedSurface SurfaceReport Trial encode_network encode_surface",
    "morphlet.codec.container": "CodecError Limits",
    "morphlet.codec.network": "DecodedNetwork NetworkOptions",
    "morphlet.codec.reading": "decode decode_network decode_part decode_stream",
    "morphlet.codec.results": "CodecOptions Decoded EncodeReport Encoded",
    "morphlet.codec.sequence": "FrameEncoder encode",
    "morphlet.editing.arap": "Arap",
    "morphlet.editing.detail": "Multiresolution",
    "morphlet.editing.editor": "RoiEditor edit",
    "morphlet.editing.estimated": "EstimatedRotations",
    "morphlet.editing.falloff": "Direct",
    "morphlet.editing.guard": "Guarded",
    "morphlet.editing.lattice": "Lattice",
    "morphlet.editing.linear": "DualLaplacian Laplacian SimilarityLaplacian",
    "morphlet.editing.method": "Pull",
    "morphlet.editing.moving_least_squares": "MovingLeastSquares",
    "morphlet.editing.roi": "Roi vertex_path vertices_within",
    "morphlet.editing.script": "read_edit",
    "morphlet.editing.shell": "Shell",
    "morphlet.errors": "Cancelled FileError InputError MeshError MissingExtra MorphletError SolveError",
    "morphlet.features.matching": "Matching match",
    "morphlet.features.pairing": "MatchOptions",
    "morphlet.features.regions": "RegionOptions Regions find_regions",
    "morphlet.io.formats": "read rewrite write",
    "morphlet.io.pairs": "read_pairs write_pairs",
    "morphlet.io.sequences": "Poses read_poses read_sequence write_animation write_sequence",
    "morphlet.io.video": "write_video",
    "morphlet.mapping.alignment": "Alignment",
    "morphlet.mapping.correspondence": "Correspondence confidence doubtful_pairs",
    "morphlet.mapping.differential": "laplacian_warp reconstruct",
    "morphlet.mapping.embedding": "Embedding LeaveOneOut embed leave_one_out",
    "morphlet.mapping.laying": "EmbeddingOptions",
    "morphlet.mapping.overlay": "Overlay overlay",
    "morphlet.mapping.warp": "Warp warp_by_pairs",
    "morphlet.metrics": "compare",
    "morphlet.motion.bands": "Bands wavelet_bands",
    "morphlet.motion.blend": "Blend",
    "morphlet.motion.delay": "sweep",
    "morphlet.motion.face_pairs": "FacePairs pair_faces",
    "morphlet.motion.measures": "Measures measure",
    "morphlet.motion.morph": "Morph",
    "morphlet.motion.pins": "Pins",
    "morphlet.motion.registration": "register",
    "morphlet.motion.schedule": "Schedule",
    "morphlet.motion.tour": "Tour",
    "morphlet.motion.transfer": "Anchor TransferSolver transfer",
    "morphlet.numerics.optimize": "Step Trace",
    "morphlet.pipeline.candidates": "Candidate",
    "morphlet.pipeline.correspond": "correspond correspond_maps",
    "morphlet.pipeline.morph": "MorphResult morph morph_along",
    "morphlet.pipeline.placed": "PlacedResult correspond_places correspond_places_maps",
    "morphlet.pipeline.results": "CorrespondResult",
    "morphlet.pipeline.several": "CommonSphere correspond_all",
    "morphlet.report.film": "film",
    "morphlet.report.render": "Picture render",
    "morphlet.samples.catalogue": "fetch",
    "morphlet.samples.creatures": "Creature creature landmarks sample",
    "morphlet.sphere.embed": "SphereOptions",
    "morphlet.sphere.image": "SphericalImage spherical_image",
    "morphlet.sphere.map": "SphericalMap spherical_map",
    "morphlet.sphere.untangle": "untangle",
    "morphlet.surface.description": "Description describe",
    "morphlet.surface.intersections": "folds self_intersections",
    "morphlet.surface.mesh": "Mesh Topology",
    "morphlet.surface.pairs": "PointPairs VertexPairs",
    "morphlet.surface.points": "SurfacePoints",
    "morphlet.surface.region": "Region",
    "morphlet.surface.repair": "Repair RepairOptions Repaired repair",
    "morphlet.surface.sequence": "MeshSequence",
    "morphlet.wavenet.blocks": "NetworkTable",
    "morphlet.wavenet.fit": "Fit FitOptions RowFits fit fit_rows",
    "morphlet.wavenet.library": "Library dyadic_library",
    "morphlet.wavenet.mothers": "MOTHERS PAPER_SIX Mother beta coherence make_mother mother",
    "morphlet.wavenet.network": "WaveletNetwork",
    "morphlet.wavenet.spherical": "SphericalLibrary SphericalNetwork spherical_library",
    "morphlet.wavenet.spherical_fit": "SphericalFit fit_sphere",
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
