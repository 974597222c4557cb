"""A program translated piece by piece is the one translated whole, wherever its functions stand."""

from types import CodeType

import pytest

from robot.simulation.urscript import (
    MATHEMATICS,
    Pieces,
    Running,
    ScriptRuntimeError,
    ScriptSyntaxError,
    builtin,
    compiled,
)

PROGRAM = """def main():
  global total = 0
  # inject
  def add(n, by=1):
    def inner(m):
      return m * 1
    end
    total = total + inner(n)
  end   # the end of "add"
  thread count():
    while total < 5:
      add(1)
      sync()
    end
  end
  def part(n): return 10 / n end
  h = run count()
  join h
  note(total)
  note(part(total - 5))
end
"""


def sync():
    yield


def library(said):
    found = (*MATHEMATICS, builtin("sync()", sync), builtin("note(value)", said.append))
    return {one.name: one for one in found}


def flat(codes):
    """Every function's instructions, with their lines and columns."""
    found = {}
    for code in codes:
        for part in code.co_consts:
            if isinstance(part, CodeType):
                found[part.co_name] = (part.co_code, list(part.co_positions()))
                found |= flat([part])
    return found


def with_lines(count):
    return PROGRAM.replace("# inject", "\n".join(["x = 1"] * count))


def test_every_variant_is_what_it_is_translated_whole():
    functions = library([])
    pieces = Pieces(functions)
    for count in (0, 3, 3, 1, 40, 0):
        text = with_lines(count)
        assert flat(pieces.compiled(text).codes) == flat(compiled(text, functions).codes)
        assert pieces.compiled(text).calls == compiled(text, functions).calls


def test_a_change_around_a_function_changes_what_it_means():
    said = []
    functions = library(said)
    pieces = Pieces(functions)
    for text, expected in (
        ("def p():\n def f():\n  x = 2\n end\n global x = 1\n f()\n note(x)\nend", 2),
        ("def p():\n def f():\n  x = 2\n end\n global y = 1\n f()\n note(y)\nend", 1),
        ("def p():\n def g(): return 3 end\n def f():\n  return g()\n end\n note(f())\nend", 3),
        ("def p():\n def g():\n sync()\n return 4 end\n def f():\n  return g()\n end\n note(f())\nend", 4),
    ):
        to_the_end(Running(pieces.compiled(text), functions))
        assert said.pop() == expected


@pytest.mark.parametrize("count", [0, 7])
def test_an_error_of_a_moved_function_is_where_it_stands_now(count):
    said = []
    functions = library(said)
    pieces = Pieces(functions)
    pieces.compiled(PROGRAM)
    running = Running(pieces.compiled(with_lines(count)), functions)
    with pytest.raises(ScriptRuntimeError) as caught:
        to_the_end(running)
    place = with_lines(count).splitlines()[caught.value.line - 1]
    assert "10 / n" in place
    assert caught.value.column == place.index("10 / n") + 1 + len("10 ")
    assert said == [5]


def test_what_is_no_program_is_told_with_its_place():
    pieces = Pieces(library([]))
    pieces.compiled(PROGRAM)
    with pytest.raises(ScriptSyntaxError) as caught:
        pieces.compiled(with_lines(4).replace("m * 1", "m * bye"))
    assert (caught.value.line, caught.value.column) == (9, 18)
    for text in (
        "",
        "def p(",
        "end",
        "def p():\n def f():\n end\n def f():\n end\nend\nx",
        "def a():\n thread b():",
    ):
        whole = error_of(lambda text=text: compiled(text, library([])))
        assert error_of(lambda text=text: pieces.compiled(text)) == whole


def to_the_end(running):
    while running.step():
        pass


def error_of(act):
    try:
        act()
    except ScriptSyntaxError as error:
        return str(error)
    return None
