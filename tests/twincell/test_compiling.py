"""A run that compiles kernels says so, once; one that finds them compiled says nothing."""

import numba as nb

from twincell.compiling import COMPILING, compiling_said


def test_compiling_is_said_once():
    heard = []
    with compiling_said(heard.append):
        for function in (lambda x: x + 1.0, lambda x: x - 1.0):
            nb.njit(function)(2.0)
    assert heard == [COMPILING]


def test_what_is_compiled_already_is_not():
    function = nb.njit(lambda x: 2.0 * x)
    function(1.0)
    heard = []
    with compiling_said(heard.append):
        function(3.0)
    function(1)  # another signature, compiled when nobody listens any more
    assert heard == []
