"""The mix: what is printed, and its limits (`configs/mixes/*.toml`)."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from pydantic import Field

from .configuration import Table, find_configuration, parse_table, read_toml

Positive = Annotated[float, Field(gt=0)]


class Mix(Table):
    """A printable material.

    Attributes:
        name: for reports.
        density_kg_m3: of the fresh mix.
        youngs_modulus: of the fresh mix, N/mm² (MPa).
        poisson: Poisson's ratio.
        layer_interval_min_s, layer_interval_max_s: between neighbouring layers: strength and cold joint, s.
        open_time_s: from mixing until it must have left the nozzle, s.
        max_overhang_by_ground: local overhang d / t, measured along gravity, that it takes; None: not known.
        max_overhang_by_layer: the same between neighbouring layers whichever way gravity points: for materials that
            are stiff as they leave the nozzle, such as polymers; None: not known.
    """

    name: str
    density_kg_m3: Positive
    youngs_modulus: Positive
    poisson: Annotated[float, Field(ge=0, lt=0.5)]
    layer_interval_min_s: Annotated[float, Field(ge=0)] = 0.0
    layer_interval_max_s: Positive
    open_time_s: Positive
    max_overhang_by_ground: Positive | None = None
    max_overhang_by_layer: Positive | None = None

    @property
    def density(self) -> float:
        """Density in tonne/mm³, the unit that goes with N and mm."""
        return self.density_kg_m3 * 1e-12


def load_mix(name: str, beside: Path | None = None) -> Mix:
    """A mix by path or by the name of a shipped one.

    Raises:
        ConfigurationError: no such file, or a mistake in it.
    """
    path = find_configuration("mixes", name, beside)
    return parse_table(Mix, read_toml(path), str(path))
