"""A new job from a part file or a toolpath."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh

from planning import load_cell, load_mix
from twins import (
    SurfaceError,
    load_toolpath,
    make_surface,
    read_surface,
    repair_surface,
    save_surface,
    save_toolpath,
    unit_of,
)

from .errors import JobError
from .part import check_size

UP = {
    "x": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "y": np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]),
    "z": np.eye(3),
}
"""Rotations that bring the named axis of the file up."""


def set_down(
    surface: trimesh.Trimesh, units: str, longest: float | None, up: str
) -> tuple[trimesh.Trimesh, list[str]]:
    """A part as it stands on the bed: repaired, the named axis up, its footprint's middle at the origin.

    Args:
        surface: in mm.
        units: that its file was read in, for messages.
        longest: scales the longest side to this, mm.
        up: the file's axis that points up.

    Returns:
        the part, and one sentence for each repair.

    Raises:
        SurfaceError: it does not bound a solid, or its size tells of another unit.
    """
    vertices = np.asarray(surface.vertices) @ UP[up].T
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
    up: str = "z",
    thickness: float = 10.0,
    width: float = 20.0,
    speed: float = 80.0,
) -> list[str]:
    """Make a job folder with a commented job.toml.

    Args:
        part: STL, PLY, OBJ, 3MF, STEP, 3DM or glTF; or a toolpath.json.
        folder: to make.
        cell, mix: shipped ones, or paths.
        units: of a file that does not say its own; default mm.
        chord, subdivide, levels: as in `twins.read_surface`.
        longest: scales the part's longest side to this, mm.
        up: the file's axis that points up.
        thickness, width: of layers and beads, mm.
        speed: of printing, mm/s.

    Returns:
        one sentence for each repair of the part.

    Raises:
        JobError: the folder already holds a job.
        FormatError, SurfaceError: the part cannot be used; the message names the file.
        ConfigurationError: there is no such cell or mix, or a mistake in it.
    """
    if (folder / "job.toml").exists():
        raise JobError(
            f"{folder}: already holds a job.toml; choose another folder with -o, or remove it first"
        )
    load_cell(cell, folder)
    load_mix(mix, folder)
    if part.suffix.lower() == ".json":
        if units is not None or longest is not None or up != "z":
            raise JobError(f"{part}: a toolpath is taken as it is; leave out --units, --longest and --up")
        toolpath = load_toolpath(part)
        said: list[str] = []
        thickness = toolpath.thickness
        folder.mkdir(parents=True, exist_ok=True)
        save_toolpath(toolpath, folder / "toolpath.json")
        table = f"# none: toolpath.json came from {part.name}"
    else:
        stated = unit_of(part) or units or "mm"
        try:
            read = read_surface(part, unit=units, chord=chord, subdivide=subdivide, levels=levels)
            surface, said = set_down(read, stated, longest, up)
        except SurfaceError as error:
            raise SurfaceError(f"{part}: {error}") from None
        folder.mkdir(parents=True, exist_ok=True)
        changes = [f"from {part.name}, read in {stated}, {up} up", *said]
        save_surface(surface, folder / "part.ply", changes)
        size = " × ".join(f"{s:.1f}" for s in np.ptp(np.asarray(surface.vertices), axis=0))
        table = "\n".join(
            [
                *(f"# {change}" for change in changes),
                f'file = "part.ply"        # {size} mm, standing on z = 0',
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
    return said


def _reference(name: str) -> str:
    """A path is written so that it is found from anywhere."""
    for path in (Path(name), Path(f"{name}.toml")):
        if path.is_file():
            return path.resolve().as_posix()
    return name


JOB = """\
# One print. Lengths in mm, times in s. What is commented out has the value shown as its default.

cell = "{cell}"          # a shipped cell, or the path of your own file
mix = "{mix}"

[part]
{part}
units = "mm"

[slicing]
thickness = {thickness}
# resolution = {thickness}      # distance of points along the curves; default: the layer thickness
# height = 300.0         # of the stack of layers; default: the part's
# cusp = 2.0             # largest step that layers leave on the part: thinner layers where it is flat
# thinnest = {thinner}         # with cusp
# thickest = {thicker}        # with cusp
# For rotary layers, fanned between the bed and a tilted top plane above the part:
# top = {{ origin = [0.0, 0.0, 400.0], normal = [-0.2, 0.0, 1.0] }}

[print]
width = {width}             # of the bead
speed = {speed}             # of the nozzle while printing
# travel_speed = 150.0
# approach_speed = 30.0
# clearance = 20.0       # of travels above the layer
# blend = 2.0            # largest radius at corners
# end_speed = 0.03       # share of the speed at the end of a bead, where the pump is shut

[fea]
# edge = 20.0            # length of element edges; default: from the bead width
# time_limit_s = 300.0   # for meshing
"""
