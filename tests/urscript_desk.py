"""A controller for programs in tests, which only writes down what it is told, and when."""

from __future__ import annotations

import copy
import math

from robot.simulation.urscript import MATHEMATICS, Refusal, Running, builtin, compiled
from robot.simulation.urscript.values import integer


class Desk:
    """A controller that only writes down what it is told, and when."""

    def __init__(self):
        self.said = []
        self.cycle = 0
        self.library = {one.name: one for one in MATHEMATICS}
        for one in (
            builtin("sync()", self._sync),
            builtin("wait(n)", self._wait),
            builtin("textmsg(s1, s2)", lambda *words: self.said.append(words), {"s2": ""}),
            builtin("say(value)", lambda value: self.said.append(copy.deepcopy(value))),
            builtin("when()", lambda: self.said.append(self.cycle)),
            builtin("refuse()", self._refuse),
        ):
            self.library[one.name] = one

    def _sync(self):
        yield

    def _wait(self, n):
        for _ in range(integer(n)):
            yield
        return n

    def _refuse(self):
        raise Refusal("not now")

    def run(self, text, cycles=5000):
        """Run a program to its end, or for so many cycles; what it said."""
        running = Running(compiled(text, self.library), self.library)
        while self.cycle < cycles and running.step():
            self.cycle += 1
        return self.said


def run(text, cycles=5000):
    return Desk().run(text, cycles)


def inside(lines):
    """A program of these lines, which "; " stands between."""
    return "def program():\n" + "".join(f"  {line}\n" for line in lines.split("; ")) + "end\n"


def nearly(said, wanted):
    """Whether values are the same, numbers to 1e-9."""
    if isinstance(wanted, list | tuple):
        return len(said) == len(wanted) and all(map(nearly, said, wanted))
    if isinstance(wanted, float):
        return isinstance(said, float) and math.isclose(said, wanted, rel_tol=1e-9, abs_tol=1e-9)
    return type(said) is type(wanted) and said == wanted
