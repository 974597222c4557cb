"""A print with every register map: the right volume leaves the nozzle, over the transport that the map has."""

import time
from dataclasses import replace

import pytest
from pumps.alone import cell_file

from planning import load_cell
from robot.printer import run
from robot.simulation import Fault, SimulatedCell

HOST = "127.0.34.20"
SCALE = 4.0

KINDS = {
    "m-tec-p20": {"period_s": 0.02},
    "m-tec-p50": {"period_s": 0.02, "transport": "tcp"},
    "accelerator-doser": {},
}
"""The generic map prints in the other tests."""


@pytest.mark.flaky(
    reruns=2
)  # a machine that holds one of the processes up takes printing out of the pump law's hands
@pytest.mark.parametrize("name", list(KINDS))
def test_a_bead_is_printed(name, two_layers, tmp_path):
    path = cell_file(tmp_path, name, host=HOST, **KINDS[name])
    cell = load_cell(str(path))
    cell = cell.model_copy(update={"robot": cell.robot.model_copy(update={"host": HOST})})
    stop = two_layers.segments[3].stop
    arrays = (
        "poses",
        "joints",
        "external_axes",
        "speed",
        "blend",
        "width",
        "height",
        "flow",
        "time",
        "layer",
        "curve",
    )
    program = replace(
        two_layers,
        segments=two_layers.segments[:4],
        **{kind: getattr(two_layers, kind)[:stop] for kind in arrays},
    )
    with SimulatedCell.start(path, host=HOST, time_scale=SCALE) as simulated:
        result = run(program, cell, tmp_path / "journal.sqlite")
        time.sleep(0.3)
        told = simulated.inject(Fault.PUMP_REPORT)
    assert told["volume"] == pytest.approx(program.bead_volume, rel=0.04)
    assert result.deposited_volume == pytest.approx(program.bead_volume, rel=0.04)
    assert told["state"] == "ready"
    assert told["flow"] < 1.0
