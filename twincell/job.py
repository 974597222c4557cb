"""The job folder: one print.

    job.toml        what is wanted
    part.ply        the part, in mm, set down on the bed; none where the job began with a toolpath
    toolpath.json   surface.ply (M)   volume.ply (M')
    program.npz     program.script
    journal.sqlite
    report/         pictures and summary.json
    fea/

Inputs are hashed, and every product says which inputs made it, so that a stale product is noticed.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import trimesh
from pydantic import Field, field_validator

from analysis import FeaSettings
from planning import Cell, ConfigurationError, Mix, PrintSettings, load_cell, load_mix
from planning.configuration import Table, find_configuration, parse_table, read_toml
from twins import Plane, PlaneStack, Toolpath, adaptive_reporting, fingerprint, layer_planes
from twins.formats.lengths import MM

from .errors import JobError

Positive = Annotated[float, Field(gt=0)]
Vector3 = tuple[float, float, float]


class PartSettings(Table):
    """The `[part]` table.

    Attributes:
        file: the part, relative to the job folder.
        units: of a file that does not state its own; default mm.
    """

    file: str = "part.ply"
    units: str | None = None

    @field_validator("units")
    @classmethod
    def _is_known(cls, units: str | None) -> str | None:
        if units is not None and units not in MM:
            raise ValueError(f"must be one of {', '.join(MM)}")
        return units


class TopSettings(Table):
    """The top plane of rotary slicing.

    Attributes:
        origin: a point of the plane, mm, in part coordinates.
        normal: its direction upwards.
    """

    origin: Vector3
    normal: Vector3

    @field_validator("normal")
    @classmethod
    def _points(cls, normal: Vector3) -> Vector3:
        if not any(normal):
            raise ValueError("must not be zero")
        return normal


class SlicingSettings(Table):
    """The `[slicing]` table.

    Attributes:
        thickness: layer thickness at the bed's origin, mm; adjusted to the height.
        resolution: distance of points along the curves, mm; default the layer thickness.
        height: of the stack, mm; default the part's.
        top: top plane of rotary slicing; excludes `height`.
        cusp: largest step that layers leave on the part, mm; layers are then as thick as its slope allows, from
            `thinnest` to `thickest`. Without it all are alike.
        thinnest, thickest: with `cusp`, mm; default half and one and a half of `thickness`.
    """

    thickness: Positive
    resolution: Positive | None = None
    height: Positive | None = None
    top: TopSettings | None = None
    cusp: Positive | None = None
    thinnest: Positive | None = None
    thickest: Positive | None = None

    def planes(self, part: trimesh.Trimesh) -> PlaneStack:
        """The planes of the layers of a part that stands on z = 0.

        Raises:
            PlanesError: no layers can be made so.
        """
        return self.planes_reporting(part)[0]

    def planes_reporting(self, part: trimesh.Trimesh) -> tuple[PlaneStack, list[str]]:
        """`planes`, and sentences on what of them is not as asked.

        Raises:
            PlanesError: no layers can be made so.
        """
        top = self._top_of(part)
        if self.cusp is None:
            return layer_planes(Plane.horizontal(), top, self.thickness), []
        thinnest = 0.5 * self.thickness if self.thinnest is None else self.thinnest
        thickest = 1.5 * self.thickness if self.thickest is None else self.thickest
        return adaptive_reporting(part, Plane.horizontal(), top, thinnest, thickest, self.cusp)

    def _top_of(self, part: trimesh.Trimesh) -> Plane | float:
        if self.top is None:
            return self.height or float(np.asarray(part.vertices)[:, 2].max())
        normal = np.array(self.top.normal, dtype=np.float64)
        # Any two directions square to the normal; the frames of a rotary stack come from the bed's.
        x_axis = np.cross(np.eye(3)[int(np.argmin(np.abs(normal)))], normal)
        return Plane(np.array(self.top.origin), x_axis, np.cross(normal, x_axis))


class JobSettings(Table):
    """`job.toml`."""

    cell: str
    mix: str
    part: PartSettings = PartSettings()
    slicing: SlicingSettings
    print: PrintSettings
    fea: FeaSettings = FeaSettings()


@dataclass(frozen=True)
class Job:
    """A job folder and what it is to print.

    Attributes:
        folder: the job folder.
        settings: of `job.toml`.
        cell, mix: as the settings name them.
        cell_file, mix_file: where they were found.
    """

    folder: Path
    settings: JobSettings
    cell: Cell
    mix: Mix
    cell_file: Path
    mix_file: Path

    @property
    def part(self) -> Path:
        """The part's file."""
        return self.folder / self.settings.part.file

    @property
    def toolpath(self) -> Path:
        """The toolpath's file."""
        return self.folder / "toolpath.json"

    @property
    def surface(self) -> Path:
        """M's file."""
        return self.folder / "surface.ply"

    @property
    def volume(self) -> Path:
        """The file of the printed volume M'."""
        return self.folder / "volume.ply"

    @property
    def program(self) -> Path:
        """The program's file."""
        return self.folder / "program.npz"

    @property
    def script(self) -> Path:
        """The program as URScript."""
        return self.folder / "program.script"

    @property
    def journal(self) -> Path:
        """The journal of all runs."""
        return self.folder / "journal.sqlite"

    @property
    def report(self) -> Path:
        """Folder of pictures and `summary.json`."""
        return self.folder / "report"

    @property
    def fea(self) -> Path:
        """Folder of the finite element model."""
        return self.folder / "fea"

    def slicing_inputs(self) -> dict[str, str]:
        """SHA-256 of what the toolpath is made from."""
        slicing = self.settings.slicing.model_dump_json() + self.settings.part.model_dump_json()
        width = repr(self.settings.print.width)  # of M', which is made with the toolpath
        return {
            "part": _hash(_read(self.part)),
            "slicing": _hash(slicing.encode()),
            "width": _hash(width.encode()),
        }

    def edited_inputs(self, toolpath: Toolpath) -> dict[str, str]:
        """SHA-256 of what the surface and the volume of a toolpath are made from that did not come from the part."""
        inputs = self.slicing_inputs() if self.part.is_file() else {}
        return {
            **inputs,
            "width": _hash(repr(self.settings.print.width).encode()),
            "toolpath": fingerprint(toolpath),
        }

    def printing_inputs(self) -> dict[str, str]:
        """SHA-256 of what the program is made from."""
        return {
            "toolpath": _hash(_read(self.toolpath)),
            "print": _hash(self.settings.print.model_dump_json().encode()),
            "cell": _hash(_read(self.cell_file)),
            "mix": _hash(_read(self.mix_file)),
        }


def load_job(folder: Path) -> Job:
    """The job in a folder.

    Raises:
        JobError: there is no job.toml.
        ConfigurationError: a mistake in it, or in the cell or mix that it names.
    """
    path = folder / "job.toml"
    if not path.is_file():
        raise JobError(f"{folder}: no job.toml there; make a job with 'twincell new PART -o {folder}'")
    settings = parse_table(JobSettings, read_toml(path), str(path))
    try:
        cell_file = find_configuration("cells", settings.cell, folder)
        mix_file = find_configuration("mixes", settings.mix, folder)
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from None
    return Job(folder, settings, load_cell(str(cell_file)), load_mix(str(mix_file)), cell_file, mix_file)


def _read(path: Path) -> bytes:
    try:
        return path.read_bytes()
    except OSError as error:
        raise JobError(f"{path}: cannot be read: {error.strerror}") from error


def _hash(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
