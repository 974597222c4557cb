"""A print with every register map: the right volume leaves the nozzle, over the transport that the map has. And a pump
that no longer obeys.
"""

import threading
import time

import pytest
from printable import at, first_curve
from pumps.alone import cell_file
from waiting import timed

from planning import load_cell
from robot.errors import PumpError
from robot.journal import read_events
from robot.printer import run
from robot.simulation import Fault, SimulatedCell

HOST = "127.0.34.20"
DEAF = "127.0.44.20"
SCALE = 2.0

KINDS = {
    "m-tec-p20": {"period_s": 0.02},
    "m-tec-p50": {"period_s": 0.02, "transport": "tcp"},
    "accelerator-doser": {},
}
"""The generic map prints in the other tests."""


@timed
@pytest.mark.parametrize("name", list(KINDS))
def test_a_bead_is_printed(name, two_layers, tmp_path):
    path = cell_file(tmp_path, name, host=HOST, **KINDS[name])
    cell = at(load_cell(str(path)), HOST)
    program = first_curve(two_layers)
    with SimulatedCell.start(path, host=HOST, time_scale=SCALE) as simulated:
        result = run(program, cell, tmp_path / "journal.sqlite")
        time.sleep(0.3)
        told = simulated.inject(Fault.PUMP_REPORT)
    assert told["volume"] == pytest.approx(program.bead_volume, rel=0.04)
    assert result.deposited_volume == pytest.approx(program.bead_volume, rel=0.04)
    assert told["state"] == "ready"
    assert told["flow"] < 1.0


def test_a_pump_that_may_still_be_pumping_is_the_last_word(two_layers, demo_cell, tmp_path):
    with SimulatedCell.start("ur10e-demo", host=DEAF, time_scale=SCALE) as simulated:

        def strike():
            while simulated.inject(Fault.PUMP_REPORT)["flow"] < 5000.0:
                time.sleep(0.02)
            simulated.inject(Fault.PUMP_FROZEN)

        striking = threading.Thread(target=strike)
        striking.start()
        with pytest.raises(
            PumpError, match=rf"{DEAF}:5020.*heartbeat, register 3, stands still.*layer 0, curve"
        ) as caught:
            run(two_layers, at(demo_cell, DEAF), tmp_path / "journal.sqlite")
        striking.join()
    events = read_events(tmp_path / "journal.sqlite")
    assert [event.kind for event in events[-2:]] == ["pump", "error"]
    assert [event.kind for event in events].count("stop") == 1
    last = events[-2].message
    assert last.startswith(
        f"the pump at {DEAF}:5020 (map 'generic', device 1) has not confirmed that it stops"
    )
    assert last.endswith("may still be pumping: stop it at the drive or by the emergency stop")
    assert str(caught.value).endswith(last)
    assert events[-1].message == str(caught.value)
