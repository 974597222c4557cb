"""A simulated robot cell: a UR controller and a pump, each a process of its own on loopback.

Clients made for the real devices connect to them unchanged. `SimulatedCell` starts and stops both; either one
also runs alone, with `python -m robot.simulation.controller` or `python -m robot.simulation.pump`. What is public
stands in `__init__.pyi`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
