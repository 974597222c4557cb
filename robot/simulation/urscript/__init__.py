"""URScript: reads programs and runs them, cycle by cycle, with the functions of a controller.

program = compiled(text, library)      ScriptSyntaxError: line and column
running = Running(program, library)
while running.step():                  ScriptRuntimeError: line and column
    ...                                one cycle of the controller
"""

from .compiling import Compiled, compiled
from .errors import Refusal, ScriptError, ScriptRuntimeError, ScriptSyntaxError
from .functions import REQUIRED, Builtin, Library, builtin
from .mathematics import MATHEMATICS
from .running import Running

__all__ = [
    "MATHEMATICS",
    "REQUIRED",
    "Builtin",
    "Compiled",
    "Library",
    "Refusal",
    "Running",
    "ScriptError",
    "ScriptRuntimeError",
    "ScriptSyntaxError",
    "builtin",
    "compiled",
]
