"""A simulated robot cell: a UR controller and a pump, each a process of its own on loopback.

Clients made for the real devices connect to them unchanged. `SimulatedCell` starts and stops both; either one
also runs alone, with `python -m robot.simulation.controller` or `python -m robot.simulation.pump`.
"""

from .cell import SimulatedCell
from .faults import Fault, inject

__all__ = ["Fault", "SimulatedCell", "inject"]
