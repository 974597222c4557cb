"""A simulated cell for anybody's tests: a pytest plugin, there wherever twincell is installed.

    import pytest
    from rtde_receive import RTDEReceiveInterface

    @pytest.mark.twincell(version="5.22", time_scale=4)
    def test_the_robot_is_on(simulated_cell):
        robot = RTDEReceiveInterface(simulated_cell.host)
        assert robot.getRobotMode() == 7
        robot.disconnect()

`simulated_cell` is a new cell for each test; `simulated_cells` starts cells that the tests of a session share. Each
has a loopback address of its own, also beside other workers of pytest-xdist. Nothing is loaded before a test asks.
"""
# ruff: noqa: PLC0415 - see above

from __future__ import annotations

import contextlib
import inspect
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from robot.simulation import SimulatedCell

    Starter = Callable[..., SimulatedCell]

CELL = "ur10e-demo"


def pytest_configure(config: pytest.Config) -> None:
    """Make the marker known."""
    config.addinivalue_line(
        "markers",
        "twincell(cell='ur10e-demo', **options): how `simulated_cell` is started; "
        "the options of robot.simulation.SimulatedCell.start",
    )


@pytest.fixture
def simulated_cell(request: pytest.FixtureRequest) -> Iterator[SimulatedCell]:
    """A simulated cell of this test alone; `@pytest.mark.twincell(...)` has its options."""
    options: dict[str, Any] = {}
    for marker in reversed(list(request.node.iter_markers("twincell"))):  # the nearest has the last word
        if marker.args:
            raise pytest.UsageError(
                f"{request.node.nodeid}: name the options of twincell(), as in time_scale=4"
            )
        options |= marker.kwargs
    from planning import PlanningError
    from robot.errors import RobotError

    with _starting() as start:
        try:
            cell = start(**options)
        except (pytest.UsageError, PlanningError, RobotError) as error:
            # The sentence says what to do; a traceback would say only where we are.
            pytest.fail(str(error), pytrace=False)
        yield cell


@pytest.fixture(scope="session")
def simulated_cells() -> Iterator[Starter]:
    """Starts simulated cells that end with the session: `simulated_cells(time_scale=4)`; for fixtures that share one.

    The options are `cell`, a cell file or the name of a shipped one, and those of `SimulatedCell.start`.
    """
    with _starting() as start:
        yield start


@contextlib.contextmanager
def _starting() -> Iterator[Starter]:
    """What starts cells, and ends them."""
    from planning import load_cell
    from robot.simulation import SimulatedCell
    from robot.simulation.addresses import free_address

    with contextlib.ExitStack() as stack:

        def start(cell: Any = CELL, **options: Any) -> SimulatedCell:
            try:
                inspect.signature(SimulatedCell.start).bind(cell, **options)
            except TypeError as error:
                raise pytest.UsageError(f"twincell(): {error}") from None
            if options.get("host") is None:
                options["host"] = stack.enter_context(free_address(load_cell(str(cell)).pump.port))
            simulated = SimulatedCell.start(cell, **options)
            stack.callback(_end, simulated)
            return simulated

        yield start


def _end(simulated: SimulatedCell) -> None:
    """End a cell; what its simulators said is shown with a test that fails."""
    sys.stderr.write(simulated.complaints())
    simulated.stop()
