from .cell import SimulatedCell as SimulatedCell
from .faults import Fault as Fault
from .faults import inject as inject
