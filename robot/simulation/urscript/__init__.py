"""URScript: reads programs and runs them, cycle by cycle, with the functions of a controller.

program = compiled(text, library)      ScriptSyntaxError: line and column
running = Running(program, library)
while running.step():                  ScriptRuntimeError: line and column
    ...                                one cycle of the controller
"""

from .compiling import Added, Compiled, added, compiled
from .errors import Refusal, ScriptError, ScriptRuntimeError, ScriptSyntaxError
from .functions import REQUIRED, Builtin, Library, builtin
from .mathematics import MATHEMATICS
from .pieces import Pieces
from .running import Running
from .scopes import Around

__all__ = [
    "MATHEMATICS",
    "REQUIRED",
    "Added",
    "Around",
    "Builtin",
    "Compiled",
    "Library",
    "Pieces",
    "Refusal",
    "Running",
    "ScriptError",
    "ScriptRuntimeError",
    "ScriptSyntaxError",
    "added",
    "builtin",
    "compiled",
]
