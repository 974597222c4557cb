"""The language that programs of a controller are written in: what a program does, and where one that is wrong is."""

from __future__ import annotations

import math

import pytest
from urscript_desk import inside, nearly, run

from robot.simulation.urscript import ScriptRuntimeError, ScriptSyntaxError
from robot.simulation.urscript.running import PATIENCE, THREADS

EXPRESSIONS = {
    "1 + 2 * 3": 7,
    "(1 + 2) * 3": 9,
    "7 / 2": 3.5,
    "6 / 2": 3.0,
    "7 % 3": 1,
    "-7 % 3": -1,
    "7.5 % 2": 1.5,
    "10 - 4 - 3": 3,
    "2 - -2": 4,
    "-2 * -3": 6,
    "0x1F": 31,
    "1e-3": 0.001,
    ".5 + 1.": 1.5,
    "2147483647 + 1": -2147483648,
    "-2147483647 - 2": 2147483647,
    "65536 * 65536": 0,
    "3000000000": 3e9,
    "1 == 1.0": True,
    "1 == True": False,
    '"a" == "a"': True,
    '"a" != 1': True,
    "[1, 2] == [1, 2]": True,
    "1 < 2 and 2 < 3": True,
    "True xor True": False,
    "True xor False": True,
    "not False": True,
    "not 1 == 2": True,
    "False and 1 / 0 == 1": False,
    "True or 1 / 0 == 1": True,
    "[1, 2, 3][1]": 2,
    "p[1, 2, 3, 0, 0, 0][2]": 3.0,
    "[[1, 2], [3, 4]][1][0]": 3,
    "[1, 2] + [3, 4]": [4, 6],
    "[1.0, 2.0] - [3, 4]": [-2.0, -2.0],
    "[1, 2] * 2": [2, 4],
    "2 * [1, 2.5]": [2, 5.0],
    "[1, 2] / 2": [0.5, 1.0],
    "-[1, 2.5]": [-1, -2.5],
    "sqrt(2) * sqrt(2)": 2.0,
    "sin(d2r(30))": 0.5,
    "r2d(atan2(1, 1))": 45.0,
    "pow(2, 10)": 1024.0,
    "log(10, 1000)": 3.0,
    "floor(-1.5)": -2,
    "ceil(-1.5)": -1,
    "norm([3, 4])": 5.0,
    "norm(-3)": 3,
    'str_cat("a", 1)': "a1",
    'str_cat(1.5, "b")': "1.5b",
    'str_at("abc", 1)': "b",
    'str_sub("abcdef", 2, 3)': "cde",
    'str_sub("abcdef", 2)': "cdef",
    'str_find("abcabc", "c", 3)': 5,
    'str_find("abc", "x")': -1,
    'str_len("abc")': 3,
    'str_empty("")': True,
    'to_num("12")': 12,
    'to_num("1.5e1")': 15.0,
    "to_str([1, 2.5, True])": "[1, 2.5, True]",
    "to_str(p[1, 2, 3, 0, 0, 0])": "p[1, 2, 3, 0, 0, 0]",
    'is_num("x")': False,
    "binary_list_to_integer([True, False, True])": 5,
    "integer_to_binary_list(5)[2]": True,
    "get_list_length([1, 2, 3])": 3,
    "make_list(3, 0)": [0, 0, 0],
    "pose_trans(p[1, 0, 0, 0, 0, 1.5707963267948966], p[1, 0, 0, 0, 0, 0])": [
        1.0,
        1.0,
        0.0,
        0.0,
        0.0,
        math.pi / 2,
    ],
    "pose_inv(p[1, 2, 3, 0, 0, 0])": [-1.0, -2.0, -3.0, 0.0, 0.0, 0.0],
    "pose_trans(p[1, 2, 3, 0.1, 0.2, 0.3], pose_inv(p[1, 2, 3, 0.1, 0.2, 0.3]))": [0.0] * 6,
    "pose_add(p[1, 0, 0, 0, 0, 0.5], p[1, 2, 0, 0, 0, 0.5])": [2.0, 2.0, 0.0, 0.0, 0.0, 1.0],
    "pose_sub(p[3, 0, 0, 0, 0, 0.5], p[1, 2, 0, 0, 0, 0.2])": [2.0, -2.0, 0.0, 0.0, 0.0, 0.3],
    "pose_dist(p[0, 0, 0, 1, 0, 0], p[3, 4, 0, 0, 0, 0])": 5.0,
    "interpolate_pose(p[0, 0, 0, 0, 0, 0], p[2, 0, 0, 0, 0, 1], 0.25)": [0.5, 0.0, 0.0, 0.0, 0.0, 0.25],
    "rpy2rotvec([d2r(90), 0, d2r(90)])": [2.0 * math.pi / 27**0.5] * 3,  # x to y to z to x
    "rotvec2rpy(rpy2rotvec([0.1, 0.2, 0.3]))": [0.1, 0.2, 0.3],
    "rotvec2rpy(rpy2rotvec([0.1, d2r(90), 0.3]))": [-0.2, math.pi / 2, 0.0],  # both turn about one axis
    "wrench_trans(p[1, 0, 0, 0, 0, 0], [0, 1, 0, 0, 0, 0])": [0.0, 1.0, 0.0, 0.0, 0.0, -1.0],
}


@pytest.mark.parametrize("text", EXPRESSIONS)
def test_an_expression_has_its_value(text):
    (found,) = run(inside(f"say({text})"))
    assert nearly(found, EXPRESSIONS[text]), found


PROGRAMS = {
    "bare statements": ("say(1)\nsay(2)\n", [1, 2]),
    "one line": ("def f(): say(1) end", [1]),
    "a comment, a node mark and blank lines": (
        '# head\n\ndef f(): # name\n  $ 1 "node @"\n\n  say(1) # end\nend # of it\n',
        [1],
    ),
    "a value on the next line, and a keyword behind it": (
        "def f():\n  x = # offset\n3    global y = x\n  say(y)\nend",
        [3],
    ),
    "if": (inside("x = 2; if x == 1:; say(1); elif x == 2:; say(2); else:; say(3); end"), [2]),
    "else": (inside("if False:; say(1); else:; say(3); end"), [3]),
    "an empty block": (inside("if True:; end; say(1)"), [1]),
    "while, break and continue": (
        inside(
            "i = 0; while True:; i = i + 1; if i == 2:; continue; end; if i == 5:; break; end; say(i); end"
        ),
        [1, 3, 4],
    ),
    "for": (inside("for x in [1, 2, 3]:; say(x * x); end"), [1, 4, 9]),
    "switch": (
        inside("switch 2:; case 1:; say(1); end; case 2:; say(2); end; default:; say(3); end; end"),
        [2],
    ),
    "default": (inside("switch 9:; case 1:; say(1); end; default:; say(3); end; end"), [3]),
    "functions, named arguments and defaults": (
        inside(
            "def f(a, b=2, c=3):; return a * 100 + b * 10 + c; end; say(f(1)); say(f(1, c=7)); "
            "say(f(b=0, a=5))"
        ),
        [123, 127, 503],
    ),
    "a function used before it is defined": (inside("say(f()); def f():; return 4; end"), [4]),
    "a function in a function": (
        inside("def f():; def g():; return 1; end; return g() + 1; end; say(f())"),
        [2],
    ),
    "recursion": (
        inside("def f(n):; if n < 2:; return n; end; return f(n - 1) + f(n - 2); end; say(f(10))"),
        [55],
    ),
    "a function of the program before one of the controller": (
        inside("def norm(x):; return 42; end; say(norm(1))"),
        [42],
    ),
    "a global": (inside("global g = 1; def f():; g = g + 1; end; f(); f(); say(g)"), [3]),
    "a global made in a function": (inside("def f():; global g = 5; end; f(); say(g)"), [5]),
    "a variable of the program in a function": (inside("k = 7; def f():; return k; end; say(f())"), [7]),
    "a local hides the program's": (
        inside("x = 1; def f():; local x = 2; return x; end; say(f()); say(x)"),
        [2, 1],
    ),
    "a parameter hides the program's": (inside("x = 1; def f(x):; x = 5; end; f(2); say(x)"), [1]),
    "lists are copied": (inside("a = [1, 2]; b = a; b[0] = 9; say(a); say(b)"), [[1, 2], [9, 2]]),
    "lists are copied into lists": (
        inside("a = [1]; b = [a, a]; b[0][0] = 9; say(a); say(b)"),
        [[1], [[9], [1]]],
    ),
    "what is passed stays": (
        inside("a = p[1, 2, 3, 0, 0, 0]; def f(p):; p[0] = p[0] * 2; return p; end; say(f(a)[0]); say(a[0])"),
        [2.0, 1.0],
    ),
    "what is returned is the caller's": (
        inside("global g = [1]; def f():; return g; end; x = f(); x[0] = 5; say(g)"),
        [[1]],
    ),
    "a name that Python keeps for itself": (inside("async = 1; lambda = 2; say(async + lambda)"), [3]),
    "struct": (inside("s = struct(a=1, b=[1, 2]); s.a = 5; s.b[1] = 7; say(s.a); say(s.b)"), [5, [1, 7]]),
    "methods of lists": (
        inside(
            "a = [1, 2]; a.append(3); a.insert(0, 0); a.remove(1); say(a); say(a.pop()); "
            "say(a.length()); say(a.index(2)); a.extend([5, 6]); say(a.slice(1, 3)); a.clear(); "
            "say(a.length())"
        ),
        [[0, 2, 3], 3, 2, 1, [2, 5], 0],
    ),
    "methods leave an argument alone": (inside("a = [1]; def f(l):; l.append(2); end; f(a); say(a)"), [[1]]),
    "halt": (inside("say(1); halt; say(2)"), [1]),
    "halt in a function": (inside("def f():; halt; end; f(); say(2)"), []),
    "return ends the program": (inside("say(1); return 0; say(2)"), [1]),
    "cycles": (inside("when(); sync(); when(); wait(3); when()"), [0, 1, 4]),
    "a value of what takes time": (inside("say(wait(2) + wait(1)); when()"), [3, 3]),
    "a thread": (
        inside("thread t():; say(1); sync(); say(2); end; run t(); sync(); say(10); sync()"),
        [1, 10, 2],
    ),
    "join": (inside("thread t():; wait(5); say(1); end; h = run t(); join h; say(2)"), [1, 2]),
    "kill": (
        inside("thread t():; while True:; say(1); sync(); end; end; h = run t(); wait(2); kill h; wait(3)"),
        [1, 1],
    ),
    "kill what never ran": (inside("h = 0; kill h; say(1)"), [1]),
    "a thread that ends itself": (
        inside("global h = 0; thread t():; kill h; say(1); end; h = run t(); wait(2); say(2)"),
        [2],
    ),
    "the program's end ends its threads": (
        inside("thread t():; while True:; say(1); sync(); end; end; run t(); sync(); sync()"),
        [1, 1],
    ),
    "a critical section": (
        inside(
            "global n = 0; thread t():; while True:; n = n + 1; sync(); end; end; run t(); sync(); "
            "enter_critical; a = n; i = 0; while i < 5000:; i = i + 1; end; say(n - a); exit_critical; "
            "wait(2); say(n - a > 0)"
        ),
        [0, True],
    ),
    "others run while a thread waits in a critical section": (
        inside(
            "global n = 0; thread t():; while True:; enter_critical; n = n + 1; sync(); exit_critical; end; "
            "end; run t(); enter_critical; wait(5); say(n > 2); exit_critical"
        ),
        [True],
    ),
    "a critical section ends with its thread": (
        inside("thread t():; enter_critical; end; run t(); wait(2); when()"),
        [2],
    ),
    "a long loop takes cycles": (
        inside("i = 0; while i < 3000:; i = i + 1; end; say(i)"),
        [3000],
    ),
    "a program that begins with sec": ("sec f():\n  say(1)\nend\n", [1]),
    "textmsg": (inside('textmsg("a", [1]); textmsg("b")'), [("a", [1]), ("b", "")]),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_does_what_it_says(name):
    text, wanted = PROGRAMS[name]
    assert nearly(run(text), wanted)


MISTAKES = {
    "a character": ("def f():\n  x = 1 @ 2\nend", "unexpected '@'", 2, 9),
    "a string without end": ('def f():\n  x = "abc\nend', "string without its end", 2, 7),
    "no value": ("def f():\n  x = 1 +\nend", "expected a value, not 'end'", 3, 1),
    "no value in a line": ("def f():\n  x = (1 + )\nend", "expected a value, not ')'", 2, 12),
    "no end": ("def f():\n  if True:\n    sync()\n", "expected 'elif' or 'else' or 'end'", 4, 1),
    "no colon": ("def f():\n  if True\n  end\nend", "expected ':' after the expression", 2, 10),
    "two values": (
        "def f():\n  x = 1 2\nend",
        "expected the end of the statement, not '2'",
        2,
        9,
    ),
    "an open bracket": ("def f():\n  x = (1 + 2\nend", "expected ')' after the expression, not 'end'", 3, 1),
    "a value for a value": ("def f():\n  1 = 2\nend", "only a variable can be given a value", 2, 3),
    "a short pose": ("def f():\n  x = p[1, 2]\nend", "a pose has 6 numbers, not 2", 2, 7),
    "no function": ("def f():\n  sync()\n  mvoe(1)\nend", "there is no function 'mvoe' here", 3, 3),
    "nearly one": (
        "def f():\n  sync()\n  synk()\nend",
        "there is no function 'synk'; did you mean 'sync'?",
        3,
        3,
    ),
    "another case": ("def f():\n  Sync()\nend", "there is no function 'Sync'; did you mean 'sync'?", 2, 3),
    "nearly its own": (
        "def f():\n  def closer():\n  end\n  closr()\nend",
        "there is no function 'closr'; did you mean 'closer'?",
        4,
        3,
    ),
    "nearly a variable": (
        "def f():\n  speed = 1\n  x = sped\nend",
        "there is no variable 'sped'; did you mean 'speed'?",
        3,
        7,
    ),
    "no variable": ("def f():\n  x = y + 1\nend", "there is no variable 'y'", 2, 7),
    "a function as a variable": ("def f():\n  x = sync\nend", "call it with ()", 2, 7),
    "no thread": ("def f():\n  run g()\nend", "there is no thread 'g'", 2, 3),
    "a thread called": ("def f():\n  thread t():\n  end\n  t()\nend", "start it with 'run'", 4, 3),
    "too many arguments": ("def f():\n  sync(1)\nend", "'sync' takes no arguments, not 1", 2, 3),
    "too few": ("def f():\n  x = sin()\nend", "'sin' needs 'f'", 2, 7),
    "a wrong name": ("def f():\n  x = sin(g=1)\nend", "'sin' has no parameter 'g'", 2, 13),
    "given twice": ("def f():\n  x = sin(1, f=1)\nend", "'f' is given twice", 2, 16),
    "a name, then none": (
        "def f():\n  x = pow(base=1, 2)\nend",
        "an argument without a name after one with",
        2,
        19,
    ),
    "a parameter twice": ("def f():\n  def g(a, a):\n  end\nend", "parameter 'a' twice", 2, 12),
    "a break outside": ("def f():\n  break\nend", "'break' outside a loop", 2, 3),
    "another's local": (
        "def f():\n  def g():\n    local a = 1\n  end\n  sync()\n  x = a\nend",
        "no variable 'a'",
        6,
        7,
    ),
    "text behind": ("def f():\nend\nx = 1\n", "expected nothing after the program's 'end'", 3, 1),
    "a program with parameters": ("def f(a):\nend", "a program has no parameters", 1, 1),
    "too deep": ("def f():\n  x = " + "(" * 200 + "\nend", "more than 100 levels deep", 2, 107),
    "a long sum": ("def f():\n  x = " + "+".join("1" * 500) + "\nend", "more than 100 levels deep", 2, 207),
}

DOUBLING = inside(
    "; ".join(f"def f{i}(x): return f{i + 1}(x) + f{i + 1}(x) end" for i in range(30))
    + "; def f30(x): return x end; say(f0(1))"
)

FAULTS = {
    "division by zero": (inside("sync(); x = 1 / 0"), "division by zero", 3, 9),
    "remainder by zero": (inside("x = 1 % 0"), "division by zero", 2, 9),
    "no value yet": (inside("if False:; x = 1; end; say(x)"), "variable 'x' has no value yet", 5, 7),
    "no value in a function": (
        inside("def f():; if False:; x = 1; end; return x; end; f()"),
        "variable 'x' has no value yet",
        6,
        10,
    ),
    "an index": (inside("x = [1, 2]; y = x[2]"), "index 2 is outside a list of 2", 3, 8),
    "a negative index": (inside("x = [1, 2]; x[-1] = 1"), "index -1 is outside a list of 2", 3, 4),
    "an index that is none": (
        inside("x = [1, 2]; y = x[0.5]"),
        "an index must be an integer, not a float",
        3,
        8,
    ),
    "items of a number": (inside("x = 1; y = x[0]"), "an integer has no items", 3, 8),
    "a sum": (inside('x = "a" + 1'), "a string + an integer has no meaning", 2, 11),
    "a sum of booleans": (inside("x = True + 1"), "a boolean + an integer has no meaning", 2, 12),
    "a sum of poses": (
        inside("x = p[0,0,0,0,0,0] + p[0,0,0,0,0,0]"),
        "a pose + a pose has no meaning",
        2,
        22,
    ),
    "unequal lists": (inside("x = [1] + [1, 2]"), "lists of 1 and 2 items", 2, 11),
    "a comparison": (inside('x = "a" < "b"'), "a string < a string has no meaning", 2, 11),
    "a condition": (inside("if [1]:; end"), "a condition must be True or False, not a list", 2, 6),
    "a condition of and": (inside("x = True and [1]"), "must be True or False", 2, 16),
    "a pose of text": (inside('x = p["a", 0, 0, 0, 0, 0]'), "a pose's item must be a number", 2, 7),
    "another kind of item": (inside('x = [1, 2]; x[0] = "a"'), "cannot become a string", 3, 4),
    "no member": (inside("s = struct(a=1); x = s.b"), "the struct has no member 'b'", 3, 8),
    "a member of a number": (inside("s = 1; x = s.b"), "an integer has no member 'b'", 3, 8),
    "no method": (inside("a = [1]; a.shuffle()"), "there is no method 'shuffle'", 3, 4),
    "a pose that grows": (inside("a = p[0,0,0,0,0,0]; a.append(1)"), "a pose keeps its 6 numbers", 3, 4),
    "square root": (inside("x = sqrt(-1)"), "'sqrt' has no value at -1", 2, 7),
    "a number that is none": (inside('x = to_num("one")'), "'one' is no number", 2, 7),
    "a long string": (
        inside('s = "abc"; while True:; s = str_cat(s, s); end'),
        "at most 1023 characters",
        4,
        7,
    ),
    "a long list": (
        inside("a = [1]; while True:; a.append(1); sync(); end"),
        "at most 10000 items",
        4,
        4,
    ),
    "a refusal": (inside("sync(); refuse()"), "not now", 3, 3),
    "an infinite loop": (inside("while True:; x = 1; end"), "an infinite loop", 2, 3),
    "calls without end": (
        inside("def f(n):; return f(n + 1); end; f(0)"),
        "functions call one another too deeply",
        None,
        None,
    ),
    "too many threads": (
        inside("thread t():; wait(9999); end; while True:; run t(); end"),
        f"{THREADS} threads",
        6,
        3,
    ),
    "waiting for oneself": (
        inside("global h = 0; thread t():; join h; end; h = run t(); wait(5)"),
        "its own end",
        4,
        3,
    ),
    "calls that double": (DOUBLING, "too many calls", None, None),
    "a fault in a thread": (
        inside("thread t():; x = 1 / 0; end; run t(); wait(5)"),
        "division by zero",
        3,
        9,
    ),
}


@pytest.mark.parametrize("name", MISTAKES)
def test_a_text_that_is_no_program_says_where(name):
    text, says, line, column = MISTAKES[name]
    with pytest.raises(ScriptSyntaxError) as caught:
        run(text)
    assert says in caught.value.message
    assert (caught.value.line, caught.value.column) == (line, column)


@pytest.mark.parametrize("name", FAULTS)
def test_a_program_that_fails_says_where(name):
    text, says, line, column = FAULTS[name]
    with pytest.raises(ScriptRuntimeError) as caught:
        run(text, cycles=20_000)
    assert says in caught.value.message
    if line is not None:
        assert (caught.value.line, caught.value.column) == (line, column)


def test_a_busy_thread_does_not_hold_up_the_others():
    said = run(
        inside(
            "thread t():; while True:; when(); sync(); end; end; run t(); i = 0; while i < 5000:; "
            "i = i + 1; end; say(i)"
        )
    )
    assert said[-1] == 5000
    assert said[:-1] == list(range(len(said) - 1))  # in every cycle once
    assert 3 < len(said) < PATIENCE
