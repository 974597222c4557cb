"""Mixes: what ships, and their limits."""

import pytest

from planning import ConfigurationError, load_mix
from planning.configuration import shipped_configurations

SHIPPED = sorted((shipped_configurations() / "mixes").glob("*.toml"))


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_mixes_load_and_know_how_far_they_may_hang_over(path):
    mix = load_mix(path.stem)
    assert mix.max_overhang_by_ground is not None
    assert mix.layer_interval_min_s < mix.layer_interval_max_s < mix.open_time_s
    assert 1e-9 < mix.density < 4e-9


def test_a_concrete_that_is_accelerated_may_hang_over_further():
    plain, accelerated = load_mix("fresh-mortar"), load_mix("two-component-concrete")
    assert accelerated.max_overhang_by_ground > plain.max_overhang_by_ground
    assert accelerated.youngs_modulus > plain.youngs_modulus


@pytest.mark.parametrize("key", ["max_overhang_by_ground", "max_overhang_by_layer"])
def test_limits_of_overhang_are_optional_and_above_zero(tmp_path, key):
    lines = SHIPPED[0].read_text().splitlines()
    without = "\n".join(line for line in lines if not line.startswith("max_overhang"))
    path = tmp_path / "mix.toml"
    path.write_text(without)
    assert getattr(load_mix(str(path)), key) is None
    path.write_text(f"{without}\n{key} = 0.45\n")
    assert getattr(load_mix(str(path)), key) == 0.45
    for wrong in ("0.0", "-0.3", '"steep"', "nan"):
        path.write_text(f"{without}\n{key} = {wrong}\n")
        with pytest.raises(ConfigurationError, match=f"key '{key}'"):
            load_mix(str(path))
