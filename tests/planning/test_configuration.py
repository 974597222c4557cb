from typing import Annotated

import pytest
from pydantic import Field

from planning import ConfigurationError, load_cell, load_mix
from planning.configuration import Table, parse_table, shipped_configurations

CELL = (shipped_configurations() / "cells" / "ur10e-demo.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('model = "ur10e"', 'model = "ur10x"', "ur10e"),
        ("home_deg =", "hom_deg =", "did you mean 'home_deg'"),
        ('host = "127.0.0.1"\nport = 5020', 'host = "127.0.0.1"\nport = 99999', "pump.port"),
        ("flow_max = 20000.0", "", "key 'pump.flow_max' is missing"),
        ("height = 600.0", "height = -1.0", "bed.height"),
        ("size = [700.0, 700.0]", "size = [700.0]", "bed.size"),
        ("[bed]", "[bed", "not valid TOML"),
        ("origin = [700.0", "y_axis = [2.0, 0.0, 0.0]\norigin = [700.0", "not parallel"),
    ],
)
def test_mistakes_are_one_sentence_with_the_file_and_key(tmp_path, old, new, says):
    path = tmp_path / "cell.toml"
    assert old in CELL
    path.write_text(CELL.replace(old, new, 1))
    with pytest.raises(ConfigurationError, match=says) as error:
        load_cell(str(path))
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_missing_name_lists_what_is_shipped(tmp_path):
    with pytest.raises(ConfigurationError, match=r"shipped cells: .*ur10e-demo"):
        load_cell("ur99")
    with pytest.raises(ConfigurationError, match="shipped mixes: fresh-mortar"):
        load_mix("cement")


def test_a_users_own_file_wins(tmp_path):
    (tmp_path / "fresh-mortar.toml").write_text(
        (shipped_configurations() / "mixes" / "fresh-mortar.toml")
        .read_text()
        .replace("fresh mortar", "my own")
    )
    assert load_mix("fresh-mortar", tmp_path).name == "my own"
    assert load_mix("fresh-mortar").name == "fresh mortar"


class Wheel(Table):
    radius: float
    width: float = 1.0


class Cart(Table):
    colour: str = "red"
    spare: Wheel | None = None
    front: Annotated[Wheel | None, Field(description="where it has one")] = None
    wheels: tuple[Wheel, ...] = ()
    named: dict[str, Wheel] = Field(default_factory=dict)


@pytest.mark.parametrize(
    ("values", "key"),
    [
        ({"spare": {"radios": 2.0}}, "spare.radios"),
        ({"front": {"radius": 1.0, "radios": 2.0}}, "front.radios"),
        ({"wheels": [{"radius": 1.0}, {"radios": 1.0}]}, "wheels.1.radios"),
        ({"named": {"colour": {"radios": 1.0}}}, "named.colour.radios"),
    ],
)
def test_a_misspelt_key_is_told_with_the_keys_of_its_own_table(values, key):
    with pytest.raises(
        ConfigurationError, match=rf"no key '{key}'; did you mean 'radius'\? \(keys: radius, width\)"
    ):
        parse_table(Cart, values, "cart.toml")
    with pytest.raises(
        ConfigurationError, match=r"no key 'color'; did you mean 'colour'\? \(keys: colour, spare,"
    ):
        parse_table(Cart, {"color": "blue"}, "cart.toml")
