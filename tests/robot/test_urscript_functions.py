"""What URScript's own functions compute: strings, matrices, lists and bits, by their published rules and by numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from urscript_desk import inside, nearly, run

from robot.simulation.urscript import ScriptRuntimeError
from robot.simulation.urscript.strings import raw, text

EXPRESSIONS = {
    # floats have 6 decimals, without the zeros at their end
    "to_str(1.0)": "1",
    "to_str(2.123456789)": "2.123457",
    "to_str(-0.5)": "-0.5",
    "to_str(1234567.25)": "1234567.25",
    "to_str(0.0000001)": "0",
    "to_str([True, 1, 2.50])": "[True, 1, 2.5]",
    "to_str([[1, 2], [3, 4]])": "[[1, 2], [3, 4]]",
    'str_cat(str_cat("a", p[1, 2, 3, 0, 0, 0.5]), True)': "ap[1, 2, 3, 0, 0, 0.5]True",
    'to_num(" 10")': 10,
    'to_num("-5")': -5,
    'to_num("+5")': 5,
    'to_num(".36")': 0.36,
    'to_num("10e3")': 10000.0,
    'to_num("2.5E-5")': 2.5e-5,
    'to_num("0X3A")': 58,
    'to_num("INF") > 1e300': True,
    'is_num("0xb5")': True,
    'is_num("1_000")': False,
    'is_num("")': False,
    'str_sub("abcdef", 4, 10)': "ef",
    'str_sub("abc", 3)': "",
    'str_empty(str_sub("abc", 0, 0))': True,
    'length("abc")': 3,
    "length([1, 2])": 2,
    'size("abcd")': 4,
    "size([1, 2, 3])": 3,
    "size([[1, 2, 3], [4, 5, 6]])": [2, 3],
    "[[1, 2], [3, 4]][1, 0]": 3,
    "[[1, 2], [3, 4]] * [[0, 1], [1, 0]]": [[2.0, 1.0], [4.0, 3.0]],
    "[[1, 2], [3, 4]] * [1, 1]": [3.0, 7.0],
    "[1, 1] * [[1, 2], [3, 4]]": [4.0, 6.0],
    "[[1, 2], [3, 4]] * 2": [[2, 4], [6, 8]],
    "[[1, 2], [3, 4]] / 2": [[0.5, 1.0], [1.5, 2.0]],
    "[[1, 2], [3, 4]] + [[1, 1], [1, 1]]": [[2, 3], [4, 5]],
    "[[1, 2], [3, 4]] - [[1, 1], [1, 1]]": [[0, 1], [2, 3]],
    "transpose([[1, 2, 3], [4, 5, 6]])": [[1, 4], [2, 5], [3, 6]],
    "inv([[2, 0], [0, 4]])": [[0.5, 0.0], [0.0, 0.25]],
    "inv(p[1, 2, 3, 0, 0, 0])": [-1.0, -2.0, -3.0, 0.0, 0.0, 0.0],
    "normalize([3, 0, 4])": [0.6, 0.0, 0.8],
    "point_dist(p[0, 0, 0, 1, 0, 0], p[2, 3, 6, 0, 0, 0])": 7.0,
    "binary_list_to_integer([])": 0,
    "binary_list_to_integer(integer_to_binary_list(-7))": -7,
    "binary_list_to_integer(make_list(40, True))": -1,
}


@pytest.mark.parametrize("expression", EXPRESSIONS)
def test_an_expression_has_its_value(expression):
    (found,) = run(inside(f"say({expression})"))
    assert nearly(found, EXPRESSIONS[expression]), found


PROGRAMS = {
    "a number is a condition": ("if 2:; say(1); end; if 0.0:; say(2); end; say(not 0)", [1, True]),
    "a string is a condition": ('if "a":; say(1); end; if "":; say(2); else:; say(3); end', [1, 3]),
    "an expression goes on after its operator": ("x = 1 +; 2 *; 3; if x == 7 or; x == 8:; say(x); end", [7]),
    "statements on one line": ("x = 1 y = x + 1 say(y) if y == 2: say(3) end say(4)", [2, 3, 4]),
    "an item of a matrix": ("m = [[1, 2], [3, 4]]; m[0, 1] = 5; say(m); say(m[0][1])", [[[1, 5], [3, 4]], 5]),
    "a matrix is copied": ("m = [[1], [2]]; n = m; n[0, 0] = 9; say(m)", [[[1], [2]]]),
    "a member that is a keyword": ("s = struct(a=1); say(s.a)", [1]),
    "a loop over the rows of a matrix": ("for row in [[1, 2], [3, 4]]:; say(row[1]); end", [2, 4]),
    "a struct in a struct": ("s = struct(t=struct(u=5)); s.t.u = 6; say(s.t.u)", [6]),
    "a list of strings": ('l = ["a", "b"]; l.append("c"); say(l)', [["a", "b", "c"]]),
    "a default that calls": ("def f(x=sqrt(4)):; return x; end; say(f())", [2.0]),
    "threads share what is global": (
        "global n = 0; thread t():; n = n + 1; end; a = run t(); b = run t(); join a; join b; say(n)",
        [2],
    ),
    "a thread kills another": (
        "h = 0; thread a():; say(1); wait(9); say(2); end; thread b():; kill h; end; h = run a(); run b(); join h",
        [1],
    ),
    "nested loops and breaks": (
        "for i in [1, 2, 3]:; for j in [1, 2, 3]:; if j == i:; break; end; say(i * 10 + j); end; end",
        [21, 31, 32],
    ),
    "an early return of a function that takes time": (
        "def f():; wait(2); return 5; say(0); end; say(f())",
        [5],
    ),
    "xor of comparisons": ("say((1 > 2) xor (2 > 1))", [True]),
    "the remainder of a float": ("say(-7.5 % 2)", [-1.5]),
}


@pytest.mark.parametrize("name", PROGRAMS)
def test_a_program_does_what_it_says(name):
    lines, wanted = PROGRAMS[name]
    assert nearly(run(inside(lines)), wanted)


FAULTS = {
    'str_at("abc", 3)': "index 3 is outside a string of 3",
    'str_sub("abc", 4)': "outside a string of 3",
    'str_sub("abc", 0, -1)': "outside a string of 3",
    "str_len(5)": "must be a string, not an integer",
    'to_num("1.5.2")': "'1.5.2' is no number",
    'to_num("99999999999")': "beyond 32 bits",
    'to_num("1e999")': "beyond what a float holds",
    "to_str(struct(a=1))": "a struct cannot be written",
    "inv([[1, 2], [2, 4]])": "no inverse",
    "inv([[1, 2, 3], [2, 4, 5]])": "must be a square matrix",
    "transpose([[1, 2], [3]])": "rows of the same length",
    "[[1, 2], [3, 4]] * [1, 2, 3]": "a 2 by 2 matrix * a list of 3 have no product",
    "[1, 2] * [3, 4]": "a list * a list has no meaning",
    "normalize([0, 0])": "not all 0",
    "[[1, 2]] + [1, 2]": "lists of 1 and 2 items",
    "binary_list_to_integer([1, 2])": "a list of booleans",
    "size(3)": "must be a list or a string",
    "atan2(1, [2])": "must be a number, not a list",
}


@pytest.mark.parametrize("expression", FAULTS)
def test_what_has_no_value_says_where(expression):
    with pytest.raises(ScriptRuntimeError) as caught:
        run(inside(f"sync(); x = {expression}"))
    assert FAULTS[expression] in caught.value.message
    assert caught.value.line == 3


NUMBERS = st.floats(-100.0, 100.0).map(lambda x: round(x, 3))


@st.composite
def matrices(draw, rows, columns):
    return [[draw(NUMBERS) for _ in range(columns)] for _ in range(rows)]


@settings(max_examples=50, deadline=None)
@given(matrices(2, 3), matrices(3, 4), matrices(3, 3))
def test_matrices_are_numpys(a, b, c):
    product, sum_, turned = run(inside(f"say({a} * {b}); say({c} + {c}); say(transpose({a}))"))
    assert np.allclose(product, np.array(a) @ np.array(b))
    assert np.allclose(sum_, 2.0 * np.array(c))
    assert np.allclose(turned, np.array(a).T)


@given(st.binary(max_size=200))
def test_a_string_keeps_its_bytes(data):
    assert raw(text(data), "it") == data


@settings(deadline=None)
@given(st.text(st.characters(exclude_characters='"\n\r', exclude_categories=["Cs"]), max_size=30), st.data())
def test_strings_are_counted_in_bytes(value, data):
    encoded = value.encode()
    at = data.draw(st.integers(0, len(encoded)))
    length, head, tail = run(
        inside(f'say(str_len("{value}"))').replace("end\n", "")
        + f'  say(str_sub("{value}", 0, {at}))\n  say(str_sub("{value}", {at}))\nend\n'
    )
    assert length == len(encoded)
    assert raw(head, "it") + raw(tail, "it") == encoded
