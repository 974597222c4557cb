"""What is known of a program's functions before they are translated: which variables are whose, and what takes time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from .errors import ScriptSyntaxError
from .nodes import For, Function, Name, OnThread, While
from .walking import assignments, calls, definitions, loops_over_lists, root, statements

if TYPE_CHECKING:
    from .functions import Library

MAIN = "f_"
"""Name of the program's own function in the translation."""

LONG = 200
"""Statements of a function that takes time for no other reason."""


@dataclass(eq=False)
class Known:
    """A function of the program.

    Attributes:
        function: its tree.
        code_name: its name in the translation.
        inner: the functions defined in it.
        outer: that which it is defined in, None for the program.
        local: its own variables, parameters among them.
        of_program: variables of the program that it gives values.
        changed: parameters that it changes in place.
        takes_time: whether it lets cycles pass.
        callees: what it calls of the program's functions.
    """

    function: Function
    code_name: str
    inner: dict[str, Known]
    outer: Known | None
    local: frozenset[str] = frozenset()
    of_program: frozenset[str] = frozenset()
    changed: frozenset[str] = frozenset()
    takes_time: bool = False
    callees: list[Known] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Around:
    """What a statement finds that is added to a program while it runs.

    Attributes:
        names: the program's variables.
        function: whose functions it can call, and those of what this is defined in; without their statements.
        statements: how many were added before.
    """

    names: frozenset[str]
    function: Known
    statements: int = 0


def defined(known: Known | None, name: str) -> Known | None:
    """The function that a name means where `known` is, or None."""
    while known is not None:
        if name in known.inner:
            return known.inner[name]
        known = known.outer
    return None


class Scopes:
    """All functions of a program.

    Args:
        tree: of the program, or of statements that are added to one.
        library: what the controller offers.
        around: the program that they are added to, or None.

    Attributes:
        functions: in the order of their definitions, the program first.
        globals: the variables that are declared as the program's.
        names: the program's variables.

    Raises:
        ScriptSyntaxError: a parameter is made global.
    """

    def __init__(self, tree: Function, library: Library, around: Around | None = None) -> None:
        self._library = library
        self._statements = around.statements + 1 if around is not None else 0
        self.functions: list[Known] = []
        self.main = self._know(tree, around.function if around is not None else None)
        self.globals = frozenset(
            part.target.name
            for known in self.functions
            for part in assignments(known.function.body)
            if isinstance(part.target, Name) and part.scope == "global"
        )
        self.names = self.globals | self._names_of_the_program()
        if around is not None:
            self.names |= around.names
        for known in self.functions:
            self._bind(known)
        self._find_what_takes_time()

    def around(self) -> Around:
        """What the next statement finds that is added."""
        bare = Known(_bare(self.main.function), self.main.code_name, {}, self.main.outer)
        for name, known in self.main.inner.items():
            bare.inner[name] = Known(
                _bare(known.function), known.code_name, {}, None, takes_time=known.takes_time
            )
        return Around(self.names, bare, self._statements)

    def _know(self, function: Function, outer: Known | None) -> Known:
        if not self.functions:
            name = f"s{self._statements}_" if self._statements else MAIN
        else:
            assert outer is not None
            name = f"{outer.code_name.rstrip('_')}_{function.name}"
        known = Known(function, name, {}, outer)
        self.functions.append(known)
        for inner in definitions(function.body):
            known.inner[inner.name] = self._know(inner, known)
            known.inner[inner.name].code_name += f"_{len(self.functions)}"
        return known

    def _names_of_the_program(self) -> frozenset[str]:
        names = {
            part.target.name
            for part in assignments(self.main.function.body)
            if isinstance(part.target, Name) and part.scope == ""
        }
        names |= {part.name for part in loops_over_lists(self.main.function.body)}
        return frozenset(names)

    def _bind(self, known: Known) -> None:
        parameters = {name for name, _ in known.function.parameters}
        local, given, changed = set(parameters), set(), set()
        for part in assignments(known.function.body):
            base = root(part.target)
            if isinstance(part.target, Name):
                if part.scope == "local":
                    local.add(part.target.name)
                else:
                    given.add(part.target.name)
                    if part.scope == "global" and part.target.name in parameters:
                        message = f"'{part.target.name}' is a parameter and cannot be global"
                        raise ScriptSyntaxError(message, part.line, part.column)
            elif base is not None:
                changed.add(base.name)
        given |= {part.name for part in loops_over_lists(known.function.body)}
        for call in calls(known.function.body):
            if call.base is not None and (base := root(call.base)) is not None:
                changed.add(base.name)
        local |= {name for name in given if name not in self.names}
        known.local = frozenset(local)
        known.of_program = frozenset(given - local)
        known.changed = frozenset(changed & parameters)

    def _find_what_takes_time(self) -> None:
        for known in self.functions:
            body = known.function.body
            known.takes_time = (
                known is self.main
                or known.function.kind == "thread"
                or any(isinstance(part, While | For | OnThread) for part in statements(body))
                or sum(1 for _ in statements(body)) > LONG
            )
            for call in calls(body):
                callee = defined(known, call.name) if call.base is None else None
                if callee is not None:
                    known.callees.append(callee)
                elif call.base is None and call.name in self._library:
                    known.takes_time |= self._library[call.name].takes_time
        for known in self.functions:  # one that comes back to itself may go on for long
            reached, new = set(), list(known.callees)
            while new:
                callee = new.pop()
                if callee not in reached:
                    reached.add(callee)
                    new.extend(callee.callees)
            known.takes_time |= known in reached
        changed = True
        while changed:
            changed = False
            for known in self.functions:
                if not known.takes_time and any(callee.takes_time for callee in known.callees):
                    known.takes_time = changed = True


def _bare(function: Function) -> Function:
    """A function without what it does."""
    return replace(function, body=())
