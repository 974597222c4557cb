"""Register maps: values and words, and what is said of a map with a mistake."""

import math
import re
import struct
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from planning import ConfigurationError, load_cell
from planning.configuration import find_configuration, shipped_configurations
from robot.errors import PumpError
from robot.pump_map import load_pump_map, pump_map
from robot.pump_words import Register

MAPS = sorted(path.stem for path in (shipped_configurations() / "pumps").glob("*.toml"))
FORMATS = {"uint16": ">H", "int16": ">h", "uint32": ">I", "int32": ">i", "float32": ">f"}


def test_there_are_the_maps_that_the_documentation_names():
    assert set(MAPS) >= {"generic", "m-tec-p20", "m-tec-p50", "accelerator-doser"}


@given(
    st.sampled_from(list(FORMATS)),
    st.sampled_from(["high first", "low first"]),
    st.floats(1e-3, 1e3),
    st.floats(-1e12, 1e12),
)
def test_words_are_what_struct_makes_of_the_nearest_count(kind, order, unit, value):
    register = Register(address=7, type=kind, word_order=order, unit=unit)
    words = register.encode(value)
    data = struct.pack(f">{len(words)}H", *(words if order == "high first" else words[::-1]))
    (counts,) = struct.unpack(FORMATS[kind], data)
    assert register.decode(words) == pytest.approx(counts * unit, rel=1e-12)
    if register.holds(value):
        allowed = 1e-7 * abs(value) if kind == "float32" else 0.5 * unit
        assert register.decode(words) == pytest.approx(value, abs=allowed + 1e-9 * abs(value) + 1e-30)
    else:
        assert register.decode(words) == pytest.approx(min(max(value, register.smallest), register.largest))


def test_words_that_are_no_number_stay_none():
    assert math.isnan(Register(address=0, type="float32").decode([0x7FC0, 0]))


@pytest.mark.parametrize("name", MAPS)
@given(share=st.floats(0.0, 1.0))
def test_a_flow_comes_back_from_its_words(name, share):
    registers = load_pump_map(name)
    flow = share * min(registers.flow_max, 1e6)
    told = registers.told(flow)
    step = registers.registers.set_flow.unit * registers.flow_factor
    assert told == pytest.approx(flow, abs=0.5 * step + 1e-9)
    assert registers.told(told) == pytest.approx(told, rel=1e-6)


@pytest.mark.parametrize("name", MAPS)
@pytest.mark.parametrize("flow", [-3.0, 1e60, math.nan, math.inf])
def test_a_flow_that_does_not_fit_is_refused(name, flow):
    with pytest.raises(PumpError, match=rf"pump '{name}'.*does not fit into register \d+, which holds 0 to"):
        load_pump_map(name).words(flow)


@pytest.mark.parametrize("name", MAPS)
def test_the_shipped_cells_flow_fits_every_map(name):
    pump = load_cell("ur10e-demo").pump.model_copy(update={"registers": name})
    registers = pump_map(pump)
    assert registers.told(pump.flow_max) == pytest.approx(pump.flow_max, rel=0.01)


def test_the_cell_says_the_last_word_on_transport_and_calibration():
    pump = load_cell("ur10e-demo").pump
    changed = pump.model_copy(update={"registers": "m-tec-p20", "transport": "tcp", "flow_per_hz": 250.0})
    assert pump_map(changed).transport == "tcp"
    assert pump_map(changed).words(2500.0) == [1000]  # 10 Hz
    assert load_pump_map("m-tec-p20").transport == "rtu over tcp"


GOOD = 'name = "x"\n[registers]\ncommand = { address = 0 }\nset_flow = { address = 1 }\n'


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("measured_flow = { address = 0 }", "command and measured_flow have the same address 0"),
        (
            'measured_flow = { address = 2, type = "uint32" }\npressure = { address = 3 }',
            "measured_flow and pressure have the same address 3",
        ),
        ("[states]\ntripped = { address = 1, bit = 0 }", "set_flow and tripped have the same address 1"),
        (
            "[states]\nready = { address = 4, bit = 2 }\ntripped = { address = 4, bit = 2 }",
            "ready and tripped are the same bit 2 of 4",
        ),
        (
            "[states]\ntripped = { address = 4, bit = 16 }",
            r"key 'states.tripped.bit'.*less than or equal to 15",
        ),
        ("[commands]\nforward = 0", r"key 'commands'.*two commands are the same word"),
        ('heartbeat = { address = 9, table = "input" }', r"key 'registers.heartbeat'.*is written"),
        ('heartbeat = { address = 9, type = "int32" }', r"key 'registers.heartbeat'.*one word"),
        ('pressure = { address = 65535, type = "int32" }', r"registers.pressure.*beyond address 65535"),
        ('pressure = { address = 9, type = "int64" }', r"key 'registers.pressure.type'"),
        ("pressure = { address = 9, unit = 0 }", r"key 'registers.pressure.unit'.*greater than 0"),
        (
            "pressure = { adress = 9 }",
            r"no key 'registers.pressure.adress'; did you mean 'address'\? \(keys: address, table, type,",
        ),
        (
            "pressure = { unit = 0.1 }",
            r"key 'registers.pressure.address' is missing \(keys: address, table, type,",
        ),
        (
            "[states]\nempty = { adress = 1, bit = 0 }",
            r"did you mean 'address'\? \(keys: address, table, bit,",
        ),
        ("presure = { address = 9 }", r"no key 'registers.presure'; did you mean 'pressure'\?"),
        ("pressure = 9", r"key 'registers.pressure'"),
    ],
)
def test_a_mistake_in_a_map_is_told_with_file_and_key(tmp_path, text, match):
    (tmp_path / "wrong.toml").write_text(GOOD + text + "\n")
    with pytest.raises(ConfigurationError, match=rf"wrong\.toml: .*{match}"):
        load_pump_map("wrong", tmp_path)


def test_a_long_value_needs_requests_that_are_long_enough(tmp_path):
    (tmp_path / "wrong.toml").write_text(
        "words_at_once = 1\n" + GOOD + 'pressure = { address = 9, type = "int32" }\n'
    )
    with pytest.raises(ConfigurationError, match=r"wrong\.toml.*registers\.pressure.*'words_at_once'"):
        load_pump_map("wrong", tmp_path)


def test_what_the_documentation_shows_can_be_loaded(tmp_path):
    text = (Path(__file__).parents[2] / "docs" / "pumps.md").read_text()
    table, registers = re.findall(r"^```toml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    (tmp_path / "my-pump.toml").write_text(registers)
    assert load_pump_map("my-pump", tmp_path).states.tripped.inverted
    cell = find_configuration("cells", "ur10e-demo").read_text().split("[pump]")[0]
    (tmp_path / "cell.toml").write_text(cell + table)
    pump = load_cell(str(tmp_path / "cell.toml")).pump
    assert pump_map(pump).told(pump.flow_max) == pytest.approx(pump.flow_max, rel=1e-3)
    assert pump.hose_volume == pytest.approx(19.2e6, rel=0.01)  # as it says
    for name in MAPS:
        assert f"`{name}`" in text
