"""The twin engine: surface ⇄ toolpath."""

from .errors import FormatError, PlanesError, SurfaceError, ToolpathError, TwinsError
from .exchange import fingerprint, inputs_of, load_toolpath, save_surface, save_toolpath
from .extrusion import bead_outlines, extrude
from .layered import LayeredMesh, layered_mesh
from .planes import PlaneStack, custom_planes, layer_planes
from .reconstruction import ToolpathMesh, reconstruct, toolpath_mesh
from .repair import repair_surface
from .slicing import slice_reporting, slice_surface
from .surface import check_surface, make_surface, read_surface, signed_volume
from .toolpath import Curve, Layer, Plane, Toolpath
from .twin import Twin
from .visual import visual_mesh

__all__ = [
    "Curve",
    "FormatError",
    "Layer",
    "LayeredMesh",
    "Plane",
    "PlaneStack",
    "PlanesError",
    "SurfaceError",
    "Toolpath",
    "ToolpathError",
    "ToolpathMesh",
    "Twin",
    "TwinsError",
    "bead_outlines",
    "check_surface",
    "custom_planes",
    "extrude",
    "fingerprint",
    "inputs_of",
    "layer_planes",
    "layered_mesh",
    "load_toolpath",
    "make_surface",
    "read_surface",
    "reconstruct",
    "repair_surface",
    "save_surface",
    "save_toolpath",
    "signed_volume",
    "slice_reporting",
    "slice_surface",
    "toolpath_mesh",
    "visual_mesh",
]
