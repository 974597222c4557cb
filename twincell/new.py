"""A new job from a part file or a toolpath."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import trimesh

from planning import load_cell, load_mix
from twins import (
    SurfaceError,
    UnwrappedCurve,
    load_toolpath,
    make_surface,
    read_surface,
    repair_surface,
    save_surface,
    save_toolpath,
    unit_of,
    unwrap,
)
from twins.formats.meshes import Y_UP_TO_Z_UP

from .errors import JobError
from .part import check_size, doubts_of_size, in_words, spelt

Array = npt.NDArray[np.float64]

GLTF = (".glb", ".gltf")

UP = {
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotations that bring the named axis of the file up."""


@dataclass(frozen=True)
class Made:
    """What became of a file.

    Attributes:
        size: of the part or the toolpath, in words.
        repairs: one sentence each.
        doubts: one sentence each on a size that may not be meant.
    """

    size: str
    repairs: tuple[str, ...] = ()
    doubts: tuple[str, ...] = ()


def up_of(part: Path) -> str:
    """The axis that points up in the files of a format."""
    return "y" if part.suffix.lower() in GLTF else "z"


def turn_up(part: Path, up: str) -> Array:
    """The rotation that brings an axis of a file up, from how `read_surface` gives it: glTF with its y up already."""
    if up == up_of(part):
        return np.eye(3)
    return UP[up] @ Y_UP_TO_Z_UP.T if part.suffix.lower() in GLTF else UP[up]


def set_down(
    surface: trimesh.Trimesh, units: str, longest: float | None, turn: Array
) -> tuple[trimesh.Trimesh, list[str]]:
    """A part as it stands on the bed: repaired, turned up, its footprint's middle at the origin.

    Args:
        surface: in mm.
        units: that its file was read in, for messages.
        longest: scales the longest side to this, mm.
        turn: rotation that brings it upright, shape (3, 3).

    Returns:
        the part, and one sentence for each repair.

    Raises:
        SurfaceError: it does not bound a solid, or its size tells of another unit.
    """
    vertices = np.asarray(surface.vertices) @ turn.T
    extent = float(np.ptp(vertices, axis=0).max())
    if longest is not None:
        if not (longest > 0 and np.isfinite(longest)):
            raise SurfaceError(f"--longest must be above 0 mm, not {longest}")
        vertices = vertices * (longest / extent)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    vertices = vertices - [0.5 * (low[0] + high[0]), 0.5 * (low[1] + high[1]), low[2]]
    part, said = repair_surface(make_surface(vertices, surface.faces))
    check_size(part, units)
    return part, said


def new_job(
    part: Path,
    folder: Path,
    *,
    cell: str,
    mix: str,
    units: str | None = None,
    chord: float = 0.1,
    subdivide: str | None = None,
    levels: int = 2,
    longest: float | None = None,
    up: str | None = None,
    thickness: float = 10.0,
    width: float = 20.0,
    speed: float = 80.0,
) -> Made:
    """Make a job folder with a commented job.toml.

    Args:
        part: STL, PLY, OBJ, 3MF, STEP, 3DM or glTF; or a toolpath.json.
        folder: to make.
        cell, mix: shipped ones, or paths.
        units: of a file that does not say its own; default mm.
        chord, subdivide, levels: as in `twins.read_surface`.
        longest: scales the part's longest side to this, mm.
        up: the file's axis that points up; default y of glTF, as its standard has it, and z of all others.
        thickness, width: of layers and beads, mm.
        speed: of printing, mm/s.

    Raises:
        JobError: the folder already holds a job, or cannot be made.
        FormatError, SurfaceError: the part cannot be used; the message names the file.
        ConfigurationError: there is no such cell or mix, or a mistake in it.
    """
    if (folder / "job.toml").exists():
        raise JobError(
            f"{folder}: already holds a job.toml; choose another folder with -o, or remove it first"
        )
    its_cell = load_cell(cell, folder)
    load_mix(mix, folder)
    if part.suffix.lower() == ".json":
        if units is not None or longest is not None or up is not None:
            raise JobError(f"{part}: a toolpath is taken as it is; leave out --units, --longest and --up")
        toolpath = load_toolpath(part)
        thickness = toolpath.thickness
        curves = unwrap(toolpath)
        points = np.concatenate([curve.points for curve in curves] or [np.zeros((1, 3))])
        low, high = np.minimum(points.min(axis=0), [np.inf, np.inf, 0.0]), points.max(axis=0)
        made = Made(
            f"{len(toolpath.layers)} layers, {in_words(high - low)}",
            (),
            (*doubts_of_size(low, high, its_cell, width, thickness), *_open_of(curves)),
        )
        _make(folder)
        save_toolpath(toolpath, folder / "toolpath.json")
        table = f"# none: toolpath.json came from {part.name}"
    else:
        stated = unit_of(part)
        unit = stated or units or "mm"
        why = " as the file states" if stated else "" if units else " (the file states no unit)"
        upright = up or up_of(part)
        try:
            read = read_surface(part, unit=units, chord=chord, subdivide=subdivide, levels=levels)
            surface, said = set_down(read, unit, longest, turn_up(part, upright))
        except SurfaceError as error:
            raise SurfaceError(f"{part}: {error}") from None
        _make(folder)
        changes = [f"from {part.name}, read in {spelt(unit)}, {upright} up", *said]
        save_surface(surface, folder / "part.ply", changes)
        vertices = np.asarray(surface.vertices)
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        scaled = "" if longest is None else ", scaled by --longest"
        made = Made(
            f"{in_words(high - low)}, read in {spelt(unit)}{why}{scaled}",
            tuple(said),
            doubts_of_size(low, high, its_cell, width, thickness),
        )
        table = "\n".join(
            [
                *(f"# {change}" for change in changes),
                f'file = "part.ply"        # {in_words(high - low)}, standing on z = 0',
            ]
        )
    (folder / "job.toml").write_text(
        JOB.format(
            part=table,
            cell=_reference(cell),
            mix=_reference(mix),
            thickness=thickness,
            thinner=f"{0.5 * thickness:g}",
            thicker=f"{1.5 * thickness:g}",
            width=width,
            speed=speed,
        ),
        encoding="utf-8",
    )
    return made


def _open_of(curves: Sequence[UnwrappedCurve]) -> list[str]:
    count = sum(not curve.closed for curve in curves)
    if not count:
        return []
    verb = "is" if count == 1 else "are"
    said = (
        f"{count} of {len(curves)} curves {verb} open, and printed so; close them if that is not meant (twincell wrap "
        "--close-within)"
    )
    return [said]


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise JobError(
            f"{folder}: no folder can be made there ({error.strerror}); name another with -o"
        ) from None


def _reference(name: str) -> str:
    """A path is written so that it is found from anywhere."""
    for path in (Path(name), Path(f"{name}.toml")):
        if path.is_file():
            return path.resolve().as_posix()
    return name


JOB = """\
# One print. Lengths in mm, times in s. What is commented out has the value shown as its default; where it says
# "example", it has none.

cell = "{cell}"          # a shipped cell, or the path of your own file
mix = "{mix}"

[part]
{part}
units = "mm"

[slicing]
thickness = {thickness}
# resolution = {thickness}      # distance of points along the curves; default: the layer thickness
# height = 300.0         # example: of the stack of layers; without it the part's
# cusp = 2.0             # example: largest wanted step on the part: thinner layers where it is flat
# thinnest = {thinner}         # with cusp
# thickest = {thicker}        # with cusp
# For rotary layers, fanned between the bed and a tilted top plane above the part:
# top = {{ origin = [0.0, 0.0, 400.0], normal = [-0.2, 0.0, 1.0] }}  # example

[print]
width = {width}             # of the bead
speed = {speed}             # of the nozzle while printing
# travel_speed = 150.0
# approach_speed = 30.0
# clearance = 20.0       # of travels above the layer
# blend = 2.0            # largest radius at corners
# end_speed = 0.03       # share of the speed at the end of a bead, where the pump is shut

[fea]
# edge = 20.0            # example: length of element edges; without it from wall and layers
# time_limit_s = 600.0   # for meshing, and for solving
"""
