"""The twin engine: surface ⇄ toolpath."""

from .adaptive_planes import adaptive_planes
from .curves.bead_overlap import BeadOverlap, bead_overlap
from .curves.bead_width import BeadCover, WidthVariation, bead_cover, vary_width
from .curves.close_points import Spacing, spacing
from .curves.overfill import OverfillRelief, relieve_overfill
from .curves.resampling import resample
from .curves.smoothing import Smoothed, smooth
from .curves.turning import largest_turning
from .curves.zones import Zones
from .errors import FormatError, PlanesError, SurfaceError, ToolpathError, TwinsError
from .exchange import fingerprint, inputs_of, load_toolpath, save_surface, save_toolpath
from .extrusion import bead_outlines, extrude
from .formats.curves import read_curves, save_curves
from .formats.reading import unit_of
from .formats.unwrapped import save_unwrapped
from .formats.writing import write_surface
from .layered import LayeredMesh, layered_mesh
from .overhang.balance import GlobalOverhang, global_overhang
from .overhang.distribution import OverhangDistribution, overhang_distribution
from .overhang.local import LocalOverhang, local_overhang
from .overhang.locks import lock_base, lock_bounds, lock_box, lock_faces, lock_plane, lock_rim, lock_solid
from .overhang.orientation import Orientation, OrientationRanking, best_orientation
from .overhang.relaxation import OverhangRelaxation, relax_overhang
from .overhang.supporters import Reference
from .overhang.surfaces import SurfaceOverhang, surface_overhang
from .planes import PlaneStack, custom_planes, layer_planes
from .reconstruction import ToolpathMesh, reconstruct, toolpath_mesh
from .regions.booleans import BooleanResult, difference, intersection, union
from .regions.cleaning import CleanResult, clean
from .regions.edits import join_layers, mirror, move, reorder, reverse, rotate, scale, split_layers
from .regions.linked_layers import LinkResult
from .regions.merge_regions import merge_regions
from .regions.offsetting import OffsetResult, offset
from .regions.outlines import oriented, regions_of
from .regions.simplify_regions import simplify_regions
from .repair import repair_surface
from .shaping.end_faces import orient_to_slice, set_down
from .shaping.remeshing import remesh
from .shaping.splitting import split
from .shaping.trimming import trim
from .slicing import slice_reporting, slice_surface
from .surface import check_surface, make_surface, read_surface, signed_volume
from .toolpath import Curve, Layer, Plane, Toolpath
from .twin import Twin
from .visual import visual_mesh
from .wrapping.space_curve import SpaceCurve
from .wrapping.unwrapping import UnwrappedCurve, unwrap
from .wrapping.wrapping import Wrapped, wrap

__all__ = [
    "BeadCover",
    "BeadOverlap",
    "BooleanResult",
    "CleanResult",
    "Curve",
    "FormatError",
    "GlobalOverhang",
    "Layer",
    "LayeredMesh",
    "LinkResult",
    "LocalOverhang",
    "OffsetResult",
    "Orientation",
    "OrientationRanking",
    "OverfillRelief",
    "OverhangDistribution",
    "OverhangRelaxation",
    "Plane",
    "PlaneStack",
    "PlanesError",
    "Reference",
    "Smoothed",
    "SpaceCurve",
    "Spacing",
    "SurfaceError",
    "SurfaceOverhang",
    "Toolpath",
    "ToolpathError",
    "ToolpathMesh",
    "Twin",
    "TwinsError",
    "UnwrappedCurve",
    "WidthVariation",
    "Wrapped",
    "Zones",
    "adaptive_planes",
    "bead_cover",
    "bead_outlines",
    "bead_overlap",
    "best_orientation",
    "check_surface",
    "clean",
    "custom_planes",
    "difference",
    "extrude",
    "fingerprint",
    "global_overhang",
    "inputs_of",
    "intersection",
    "join_layers",
    "largest_turning",
    "layer_planes",
    "layered_mesh",
    "load_toolpath",
    "local_overhang",
    "lock_base",
    "lock_bounds",
    "lock_box",
    "lock_faces",
    "lock_plane",
    "lock_rim",
    "lock_solid",
    "make_surface",
    "merge_regions",
    "mirror",
    "move",
    "offset",
    "orient_to_slice",
    "oriented",
    "overhang_distribution",
    "read_curves",
    "read_surface",
    "reconstruct",
    "regions_of",
    "relax_overhang",
    "relieve_overfill",
    "remesh",
    "reorder",
    "repair_surface",
    "resample",
    "reverse",
    "rotate",
    "save_curves",
    "save_surface",
    "save_toolpath",
    "save_unwrapped",
    "scale",
    "set_down",
    "signed_volume",
    "simplify_regions",
    "slice_reporting",
    "slice_surface",
    "smooth",
    "spacing",
    "split",
    "split_layers",
    "surface_overhang",
    "toolpath_mesh",
    "trim",
    "union",
    "unit_of",
    "unwrap",
    "vary_width",
    "visual_mesh",
    "wrap",
    "write_surface",
]
