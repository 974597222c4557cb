"""Programs at random: each runs, or is wrong at a place of its own; none is a crash, a hang or a full memory."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

import pytest
from hypothesis import given, note, settings
from hypothesis import strategies as st
from urscript_desk import inside, run

from robot.simulation.urscript import ScriptError, ScriptRuntimeError, ScriptSyntaxError, running
from robot.simulation.urscript.running import STUCK
from robot.simulation.urscript.tokens import KEYWORDS

NAMES = st.sampled_from(["a", "b", "p", "x", "f", "g", "t", "sync", "textmsg", "norm", "say", "pose_trans"])
WORDS = st.one_of(
    st.sampled_from(sorted(KEYWORDS)),
    NAMES,
    st.sampled_from(list("+-*/%<>=()[],.:;\n") + ["==", "!=", "<=", ">=", "#", '"', "p[", "\n", "@"]),
    st.integers(-5, 5).map(str),
    st.floats(allow_nan=False, allow_infinity=False).map(str),
)


VALUES = ["1", "0", "2.5", "True", "False", '"s"', "a", "b", "x", "[1, 2]", "p[0, 1, 2, 3, 4, 5]"]
SHAPES = [
    "{} + {}",
    "{} * {}",
    "{} / {}",
    "{} == {}",
    "{} < {}",
    "{} and {}",
    "not {}",
    "-{}",
    "[{}, {}]",
    "{}[{}]",
    "({})",
    "norm({})",
    "f({}, {})",
    "pose_trans({}, {})",
    "str_cat({}, {})",
    "{}.length()",
    "wait({})",
    "[{}, {}, 1]",
    "{}[{}, 0]",
    "inv({})",
    "transpose({})",
    "size({})",
    "str_sub({}, {})",
    "to_str({})",
    "struct(first={}, last={})",
    "{}.first",
    "make_list({}, {})",
    "interpolate_pose({}, {}, 0.5)",
]
LINES = ["assign", "put", "call", "word", "return"]
BLOCKS = ["if", "while", "for", "def", "thread", "switch"]


def random_value(chance, depth=0):
    """A value as text; of any kind, so that kinds seldom fit."""
    if depth > 2 or chance.random() < 0.5:
        return chance.choice(VALUES)
    one, two = random_value(chance, depth + 1), random_value(chance, depth + 1)
    return chance.choice(SHAPES).format(one, two)


def random_block(chance, depth=0):
    """Statements as text."""
    return "\n".join(random_statement(chance, depth) for _ in range(chance.randint(1, 4)))


def random_statement(chance, depth):
    value, name = random_value(chance), chance.choice("abx")
    kind = chance.choice(LINES + BLOCKS * (depth < 2))
    if kind in BLOCKS:
        block = random_block(chance, depth + 1)
    match kind:
        case "assign":
            return f"{chance.choice(['', 'global ', 'local '])}{name} = {value}"
        case "put":
            return f"{name}[{chance.randint(0, 2)}] = {value}"
        case "call":
            return chance.choice([f"say({value})", "sync()", f"{name}.append({value})", f"kill {name}"])
        case "word":
            return chance.choice(["break", "continue", "enter_critical", "exit_critical", "sync()"])
        case "return":
            return chance.choice([f"return {value}", "halt", f"join {name}"])
        case "def":
            return f"def f(a, b={value}):\n{block}\nend"
        case "thread":
            return f"thread t():\n{block}\nend\n{name} = run t()"
        case "switch":
            return f"switch {value}:\ncase {random_value(chance)}:\n{block}\nend\nend"
        case "for":
            return f"for {name} in {value}:\n{block}\nend"
    return f"{kind} {value}:\n{block}\nend"


@pytest.fixture(autouse=True)
def _impatient(monkeypatch):
    """What would go on for ever is ended after fewer cycles, each of which takes as long as it may."""
    monkeypatch.setattr(running, "PATIENCE", 50)


def failure(text):
    try:
        run(text, cycles=20)
    except ScriptError as error:
        return error
    return None


def survives(text):
    """A program runs or is wrong at a place of its own."""
    error = failure(text)
    if error is not None:
        assert "simulated controller failed" not in error.message
        assert 1 <= error.line <= text.count("\n") + 1
        assert 1 <= error.column <= max(map(len, text.split("\n"))) + 1


@settings(max_examples=300, deadline=None)
@given(st.randoms(use_true_random=True))
def test_a_random_program_runs_or_says_where_it_is_wrong(chance):
    text = f"def program():\na = [1, 2]\nb = 3\nx = 0.5\n{random_block(chance)}\nend\n"
    note(text)
    survives(text)


@settings(max_examples=200, deadline=None)
@given(st.lists(WORDS, max_size=40).map(" ".join))
def test_random_words_are_read_or_refused(text):
    survives(text)


@settings(max_examples=200, deadline=None)
@given(st.text(max_size=200))
def test_random_characters_are_read_or_refused(text):
    survives(text)


PROGRAM = """def program():
  # a program with a bit of everything
  global count = 0
  points = [p[0.1, 0.2, 0.3, 0, 0, 1.5], p[-0.1, 0.2, 0.3, 0, 0, 0]]
  m = [[1, 2], [3, 4]]
  thread ticker():
    while True:
      enter_critical
      count = count + 1
      exit_critical
      sync()
    end
  end
  def far(a, b=points[0], scale=2.0):
    local d = pose_dist(a, b) * scale
    if d > 0.5 and not count == 3:
      return [d, d / 2]
    elif d < 0 or d == 0x1F:
      return [0.0, 1e-3]
    else:
      return [-d, d % 0.1]
    end
  end
  h = run ticker()
  for q in points:
    say(far(q, scale=3)[0])
  end
  switch count:
    case 1:
      say(str_cat("one ", m[0, 1]))
    end
    default:
      say(m * inv(m))
    end
  end
  s = struct(name="x", data=[1, 2.5])
  s.data[1] = s.data[0] + count
  wait(3)
  kill h
  say(s)
end
"""


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_a_program_that_was_damaged_runs_or_says_where_it_is_wrong(data):
    text = PROGRAM
    for _ in range(data.draw(st.integers(1, 4))):
        at = data.draw(st.integers(0, len(text) - 1))
        length = data.draw(st.sampled_from([0, 1, 1, 2, 5, 30]))
        new = data.draw(
            st.one_of(st.just(""), WORDS, st.sampled_from([text[i : i + 12] for i in range(0, 500, 37)]))
        )
        text = text[:at] + new + text[at + length :]
    survives(text)


def test_the_program_itself_runs():
    assert len(run(PROGRAM)) == 4


# -- programs that want too much

DOUBLED = "; ".join(["a = [a, a]"] * 30)
GREEDY = {
    "a string that doubles": ('s = "ab"; while True:; s = str_cat(s, s); end', "at most 1023 characters"),
    "a list that takes itself": ("a = [1]; while True:; a.append(a); end", "at most 10000 items"),
    "a list of itself and itself": (f"a = [1]; {DOUBLED}", "at most 10000 items"),
    "a list that is extended by itself": ("a = [1]; while True:; a.extend(a); end", "at most 10000 items"),
    "a list of long lists": ("a = make_list(5000, 0); b = [a, a, a]", "at most 10000 items"),
    "a long list of long lists": ("a = make_list(200, make_list(200, 0))", "at most 10000 items"),
    "an item that is a long list": (
        "a = make_list(6000, 0); b = [[1], [2]]; b[0] = a; b[1] = a",
        "at most 10000 items",
    ),
    "a struct of itself": ("s = struct(x=[1]); while True:; s = struct(x=s); end", "levels deep"),
    "a member that is a long list": (
        "a = make_list(9000, 0); s = struct(x=[1], y=[1]); s.x = a; s.y = a",
        "at most 10000 items",
    ),
    "a matrix that grows": (
        "a = make_list(101, make_list(1, 1)); b = a * transpose(a)",
        "at most 10000 items",
    ),
    "a list that is too long to make": ("a = make_list(2000000000, 0)", "0 to 10000 items"),
    "functions that call themselves": ("def f(n):; a = make_list(9000, n); return f(n + 1); end; f(0)", ""),
    "functions that call one another": ("def f(n):; g(n); end; def g(n):; f(n); end; f(0)", "too deeply"),
    "a loop that does nothing": ("while True:; end", "an infinite loop"),
    "a loop in a loop": ("while True:; for i in [1, 2, 3]:; x = i; end; end", "an infinite loop"),
    "a thread that does nothing": (
        "thread t():; while True:; x = 1; end; end; run t(); wait(9999)",
        "an infinite loop",
    ),
    "a loop over a loop's work": (
        "a = make_list(800, 1.5); while True:; x = norm(a); end",
        "an infinite loop",
    ),
    "threads that make threads": (
        "thread t():; run t(); run t(); wait(9999); end; run t(); wait(9999)",
        "100 threads",
    ),
    "a number that is too large": (
        "x = 10; while True:; x = x * 1.5e300; y = floor(x); end",
        "the result of 'floor' is beyond 32 bits",
    ),
    "a power": ("x = pow(10, 400)", "pow has no value"),
}


@pytest.mark.parametrize("name", GREEDY)
def test_a_program_that_wants_too_much_ends(name):
    lines, says = GREEDY[name]
    with pytest.raises(ScriptRuntimeError) as caught:
        run(inside(lines), cycles=20_000)
    assert says in caught.value.message


FILLING = """
from urscript_desk import inside, run
from robot.simulation.urscript import ScriptRuntimeError, running

running.MEMORY = 16 << 20
try:
    run(inside("; ".join(f"x{i} = make_list(10000, 0)" for i in range(1000))))
except ScriptRuntimeError as error:
    print(error.message)
"""


def test_a_program_that_fills_the_memory_with_variables_ends():
    """Each variable is as long as may be. In a process of its own: this one may have memory that it does not use."""
    tests = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", FILLING], cwd=tests, capture_output=True, text=True, check=True
    )
    assert "fills the controller's memory" in done.stdout


@pytest.mark.parametrize(
    "text",
    [
        "def f():\n" + "  x = 1\n" * 10_000 + "end\n",
        "def f():\n  x = [" + "1, " * 30_000 + "1]\nend\n",
        "def f():\n  x = 1" + ".a" * 30_000 + "\nend\n",
        "def f():\n  x = a" + "[0]" * 30_000 + "\nend\n",
        "def f():\n  x = a[" + "0, " * 30_000 + "0]\nend\n",
        "def f():\n  x = " + "-" * 30_000 + "1\nend\n",
        "def f():\n  x = " + "not " * 30_000 + "True\nend\n",
        "def f():\n" + "  if True:\n" * 30_000 + "end\n",
        "def f():\n  if False:\n" + "  elif False:\n" * 3_000 + "  end\nend\n",
        "def f():\n" + "".join(f"  def g{i}():\n  end\n" for i in range(3_000)) + "end\n",
        "def " * 10_000,
        "(" * 100_000,
        '"' + "a" * 100_000 + '"',
        "9" * 100_000,
    ],
    ids=lambda text: repr(text[:14]) + repr(text[100:110]),
)
def test_a_long_text_runs_or_is_refused_soon(text):
    began = time.process_time()
    survives(text)
    assert time.process_time() - began < 20.0 * STUCK


@pytest.mark.parametrize("size", [1 << 20, (1 << 20) + 1])
def test_a_text_is_as_long_as_it_may_be(size):
    text = "#" * (size - 13) + "\ndef f():\nend"
    if size > 1 << 20:
        with pytest.raises(ScriptSyntaxError, match="longer than"):
            run(text)
    else:
        assert run(text) == []
