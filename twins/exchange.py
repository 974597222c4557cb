"""The toolpath as JSON (`docs/toolpath-format.md`), and surfaces as PLY."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from .entrances import checks_kinds
from .errors import FormatError, ToolpathError
from .toolpath import Curve, Layer, Plane, Toolpath

FORMAT = "twincell-toolpath"
VERSION = 1

UNIT_LENGTH = 1e-6
"""Largest deviation of an axis from length 1."""


def toolpath_as_dict(toolpath: Toolpath) -> dict[str, Any]:
    """The toolpath as JSON values."""
    return {
        "format": FORMAT,
        "version": VERSION,
        "unit": "mm",
        "thickness": toolpath.thickness,
        "base": _plane_as_dict(toolpath.base),
        "layers": [
            {
                "slicing": _plane_as_dict(layer.slicing),
                "nozzle": _plane_as_dict(layer.nozzle),
                "curves": [_curve_as_dict(curve) for curve in layer.curves],
            }
            for layer in toolpath.layers
        ],
    }


def toolpath_from_dict(values: Any, where: str = "toolpath") -> Toolpath:
    """The toolpath that JSON values describe.

    Raises:
        FormatError: another format or version, or a key that is missing or wrong; names the layer and curve.
    """
    if not isinstance(values, dict) or values.get("format") != FORMAT:
        raise FormatError(f"{where}: not a {FORMAT} file; of a file of curves `wrap` makes one")
    if values.get("version") != VERSION:
        raise FormatError(
            f"{where}: version {values.get('version')!r} is not readable here; this is version {VERSION}"
        )
    if values.get("unit", "mm") != "mm":
        raise FormatError(f'{where}: its unit is {values["unit"]!r}; write lengths in mm, with unit "mm"')
    place = where
    try:
        base = _plane(values["base"])
        layers = []
        for i, entry in enumerate(values["layers"]):
            place = f"{where}: layer {i}"
            slicing, nozzle = _plane(entry["slicing"]), _plane(entry["nozzle"])
            curves = []
            for j, curve in enumerate(entry["curves"]):
                place = f"{where}: layer {i}, curve {j}"
                curves.append(Curve(curve["points"], _flag(curve.get("closed", True)), curve.get("width")))
            layers.append(Layer(slicing, nozzle, tuple(curves)))
        place = where
        return Toolpath(base, tuple(layers), float(values["thickness"]))
    except KeyError as error:
        raise FormatError(f"{place}: key {error} is missing") from None
    except (TypeError, ValueError, AttributeError, OverflowError, ToolpathError) as error:
        raise FormatError(f"{place}: {error}") from None


@checks_kinds
def save_toolpath(toolpath: Toolpath, path: Path | str, inputs: Mapping[str, str] | None = None) -> None:
    """Write a toolpath, with the SHA-256 of what it was made from; the file appears whole or not at all."""
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    partial.write_text(
        json.dumps({**toolpath_as_dict(toolpath), "inputs": dict(inputs or {})}, separators=(",", ":")),
        encoding="utf-8",
    )
    partial.replace(path)


def load_toolpath(path: Path | str) -> Toolpath:
    """Read a toolpath written by `save_toolpath`.

    Raises:
        FormatError: the file is missing, no JSON, or not a toolpath.
    """
    path = Path(path)
    try:
        values = json.loads(path.read_bytes())
    except FileNotFoundError:
        raise FormatError(f"{path}: no such file") from None
    except OSError as error:
        raise FormatError(f"{path}: cannot be read: {error.strerror}; name a toolpath.json") from None
    except UnicodeDecodeError:
        raise FormatError(
            f"{path}: is not text; a toolpath is a JSON file such as a job's toolpath.json"
        ) from None
    except json.JSONDecodeError as error:
        raise FormatError(
            f"{path}: is not JSON: line {error.lineno}, column {error.colno} cannot be understood; correct "
            "it there, or write the file anew"
        ) from None
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: is not JSON: {error}") from None
    return toolpath_from_dict(values, str(path))


def inputs_of(path: Path | str) -> dict[str, str]:
    """The SHA-256 of what a file of ours was made from, by name; empty where it does not say or cannot be read.

    Toolpaths say so under `inputs`, surfaces in the comments of their header.
    """
    path = Path(path)
    try:
        if path.suffix == ".ply":
            with path.open("rb") as file:
                header = file.read(65536).partition(b"end_header")[0].decode("ascii", "replace")
            said = [line.split() for line in header.splitlines() if line.startswith("comment ")]
            return {words[1]: words[3] for words in said if len(words) == 4 and words[2] == "sha256"}
        values = json.loads(path.read_bytes())
        return {str(name): str(value) for name, value in values.get("inputs", {}).items()}
    except (OSError, ValueError, AttributeError):
        return {}


@checks_kinds
def fingerprint(toolpath: Toolpath) -> str:
    """SHA-256 of what a toolpath says, however its file is laid out."""
    return hashlib.sha256(json.dumps(toolpath_as_dict(toolpath), sort_keys=True).encode()).hexdigest()


@checks_kinds
def save_surface(surface: trimesh.Trimesh, path: Path | str, comments: Sequence[str] = ()) -> None:
    """Write a surface as PLY with double precision; the file appears whole or not at all."""
    vertices = np.asarray(surface.vertices, dtype="<f8")
    faces = np.asarray(surface.faces)
    rows = np.zeros(len(faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    rows["count"] = 3
    rows["corners"] = faces
    said = [f"comment {' '.join(comment.split())}\n" for comment in comments]
    header = (
        "ply\nformat binary_little_endian 1.0\ncomment unit mm\n"
        f"{''.join(said)}"
        f"element vertex {len(vertices)}\nproperty double x\nproperty double y\nproperty double z\n"
        f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    )
    path = Path(path)
    partial = path.with_name(path.name + ".partial")
    partial.write_bytes(header.encode("ascii", "replace") + vertices.tobytes() + rows.tobytes())
    partial.replace(path)


def _plane_as_dict(plane: Plane) -> dict[str, list[float]]:
    return {"origin": plane.origin.tolist(), "x_axis": plane.x_axis.tolist(), "y_axis": plane.y_axis.tolist()}


def _plane(values: dict[str, Any]) -> Plane:
    for axis in ("x_axis", "y_axis"):
        if abs(np.linalg.norm(np.asarray(values[axis], dtype=np.float64)) - 1.0) > UNIT_LENGTH:
            raise ValueError(f"the {axis} of a plane must have length 1, not be {values[axis]}")
    return Plane(values["origin"], values["x_axis"], values["y_axis"])


def _flag(value: Any) -> bool:
    if not isinstance(value, bool):
        raise ValueError(f"closed must be true or false, not {value!r}")  # noqa: TRY004 - told as the file's fault
    return value


def _curve_as_dict(curve: Curve) -> dict[str, Any]:
    entry: dict[str, Any] = {"closed": curve.closed, "points": curve.points.tolist()}
    if curve.width is not None:
        entry["width"] = curve.width.tolist()
    return entry
