"""Configuration files: where they are found, and how their mistakes are told.

A name such as `ur10e-demo` is looked for as a file of the user's first, then among the files that ship with the
package. A misspelt or missing key is answered with the keys that exist.
"""

from __future__ import annotations

import difflib
import json
import tomllib
from pathlib import Path
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError

from .errors import ConfigurationError


class Table(BaseModel):
    """Base of all configuration tables: frozen, no unknown keys, no silent conversions of type."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


T = TypeVar("T", bound=Table)


def shipped_configurations() -> Path:
    """The folder of the configuration files that ship with the package."""
    here = Path(__file__).resolve().parent
    installed = here / "configs"
    return installed if installed.is_dir() else here.parent / "configs"


def find_configuration(kind: str, name: str, beside: Path | None = None) -> Path:
    """The file of a configuration.

    Args:
        kind: folder it belongs to: `cells`, `mixes`, `pumps` or `printers`.
        name: a path to a TOML file, or the name of a shipped one without its ending.
        beside: a folder that relative paths may also start from.

    Raises:
        ConfigurationError: there is no such file; the message lists the shipped names.
    """
    for folder in ([beside] if beside else []) + [Path()]:
        for candidate in (folder / name, folder / f"{name}.toml"):
            if candidate.is_file():
                return candidate
    shipped = shipped_configurations() / kind
    if "/" not in name and (shipped / f"{name}.toml").is_file():
        return shipped / f"{name}.toml"
    names = ", ".join(sorted(p.stem for p in shipped.glob("*.toml"))) or "none"
    raise ConfigurationError(f"{name}: no such file among your own or in {kind}; shipped {kind}: {names}")


def read_toml(path: Path) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        ConfigurationError: the file cannot be read, or is not TOML; the message has the line.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"{path}: cannot be read: {error.strerror}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ConfigurationError(f"{path}: not valid TOML: {error}") from error


def parse_table(model: type[T], values: dict[str, Any], where: str) -> T:
    """`values` as a table of the given model.

    Args:
        where: names the file and table in messages.

    Raises:
        ConfigurationError: one sentence for the first mistake, with the keys that exist.
    """
    try:
        # As JSON, because strict JSON knows arrays for tuples and integers for floats, and nothing looser.
        return model.model_validate_json(json.dumps(values, default=str), strict=True)
    except ValidationError as error:
        raise ConfigurationError(f"{where}: {_explain(model, error)}") from error


def _explain(model: type[BaseModel], error: ValidationError) -> str:
    problems = error.errors()
    problem = next((p for p in problems if p["type"] == "extra_forbidden"), problems[0])
    location = [str(part) for part in problem["loc"]]
    key = ".".join(location)
    keys = _keys_at(model, location[:-1])
    if problem["type"] == "extra_forbidden":
        near = difflib.get_close_matches(location[-1], keys, n=1)
        hint = f"; did you mean '{near[0]}'?" if near else ""
        return f"there is no key '{key}'{hint} (keys: {', '.join(keys)})"
    if problem["type"] == "missing" and location[-1].isdigit():
        return f"key '{'.'.join(location[:-1])}' has {location[-1]} entries, and more are needed"
    if problem["type"] == "missing":
        return f"key '{key}' is missing (keys: {', '.join(keys)})"
    return f"key '{key}': {problem['msg'].removeprefix('Value error, ')}, got {problem['input']!r}"


def _keys_at(model: type[BaseModel], location: list[str]) -> list[str]:
    for part in location:
        found = model.model_fields.get(part)
        if found is not None:
            inner = _table_in(found.annotation)
            if inner is None:
                break
            model = inner
    return list(model.model_fields)


def _table_in(annotation: Any) -> type[BaseModel] | None:
    """The table that a field holds: by itself, as one that may be missing, or in an array."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    return next(filter(None, map(_table_in, get_args(annotation))), None)
