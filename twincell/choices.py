"""What options of the command line can be set to."""

from __future__ import annotations

from enum import StrEnum


class Units(StrEnum):
    """Units of a file: those of `twins.formats.lengths`."""

    UM = "um"
    MM = "mm"
    CM = "cm"
    DM = "dm"
    M = "m"
    KM = "km"
    MIL = "mil"
    IN = "in"
    FT = "ft"
    YD = "yd"


class Up(StrEnum):
    """Axis of a part file that points up."""

    X = "x"
    Y = "y"
    Z = "z"


class Against(StrEnum):
    """What overhang is measured against."""

    GROUND = "ground"
    LAYER = "layer"


class Side(StrEnum):
    """To which side of itself a curve may be moved."""

    IN = "in"
    OUT = "out"
    BOTH = "both"


class Subdivision(StrEnum):
    """Schemes of subdivision surfaces."""

    CATMULL_CLARK = "catmull-clark"
    LOOP = "loop"


class Planes(StrEnum):
    """Planes that the curves of layers are in."""

    NOZZLE = "nozzle"
    SLICING = "slicing"


class Exported(StrEnum):
    """What of a job is written for others."""

    CURVES = "curves"
    SURFACE = "surface"
    VOLUME = "volume"
    BEADS = "beads"
