"""Desktop printers: what ships, and mistakes in their files."""

import re

import pytest

from planning import ConfigurationError
from planning.configuration import shipped_configurations
from planning.desktop_printer import load_printer

SHIPPED = sorted(path.stem for path in (shipped_configurations() / "printers").glob("*.toml"))
CR10 = (shipped_configurations() / "printers" / "cr10.toml").read_text()


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ('firmware = "marlin"', 'firmware = "grbl"', "gcode.firmware"),
        ('firmware = "marlin"\nextrusion = "absolute"', "", "missing"),
        ('e_unit = "filament"', 'e_unit = "volume"', None),
        ("{bed_c:.0f}", "{bed_temperature}", "is no placeholder"),
        ("{bed_c:.0f}", "{bed_c:.0z}", "cannot be filled in"),
        ("M140 S{bed_c:.0f}", "M140 S{", "write a brace of your own twice"),
        ("margin = 10.0", "margin = 150.0", "leaves nothing of the bed"),
        ("width_min = 0.8", "width_min = 3.0", "above width_max"),
        ("height_min = 0.1", "height_min = 1.5", "above height_max"),
        ("safe_z = 5.0", "safe_z = 500.0", "safe_z = 500 is above height"),
        ("max_tilt_deg = 30.0", "max_tilt_deg = 90.0", "nozzle.max_tilt_deg"),
        ("hot_end =", "hotend =", "did you mean 'hot_end'"),
    ],
)
def test_mistakes_in_a_printer_are_one_sentence(tmp_path, old, new, says):
    text = re.sub(r" +#.*", "", CR10)
    assert old in text
    path = tmp_path / "printer.toml"
    path.write_text(text.replace(old, new, 1))
    if says is None:
        assert load_printer(str(path)).gcode.e_unit == "volume"
        return
    with pytest.raises(ConfigurationError, match=says) as error:
        load_printer(str(path))
    assert str(path) in str(error.value)
    assert "\n" not in str(error.value)


def test_klipper_is_not_given_volumes(tmp_path):
    path = tmp_path / "printer.toml"
    path.write_text(CR10.replace('"marlin"', '"klipper"').replace('e_unit = "filament"', 'e_unit = "volume"'))
    with pytest.raises(ConfigurationError, match="Klipper has no M200"):
        load_printer(str(path))


@pytest.mark.parametrize("name", SHIPPED)
def test_what_ships_loads(name):
    printer = load_printer(name)
    least, most = printer.nozzle.widths
    assert least < printer.nozzle.diameter < most
    assert (printer.bed.room > 0).all()


def test_what_ships_is_found_by_name():
    assert {"cr10", "ender3", "klipper-300", "duet-300"} <= set(SHIPPED)
    with pytest.raises(ConfigurationError, match="shipped printers: cr10, duet-300, ender3, klipper-300"):
        load_printer("ender")
