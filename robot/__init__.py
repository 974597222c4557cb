"""The cell at run time: arm, pump, printer, journal, simulators.

What is public stands in `__init__.pyi`. A name is loaded when it is first used: each of a cell's processes needs a few.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
