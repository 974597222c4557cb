"""Errors of the engine name its arguments; whoever typed a command reads them as options."""

import pytest

from twincell.wording import as_options

OPTIONS = {"--units", "--close-within", "--tolerance", "files"}


@pytest.mark.parametrize(
    ("said", "read"),
    [
        ('it has no unit; give it, such as `units="mm"`', "it has no unit; give it, such as --units mm"),
        ("give a larger `tolerance`, or `close_within`", "give a larger --tolerance, or --close-within"),
        ("give a `tolerance=0.5`", "give a --tolerance 0.5"),
        ("give a `top`, or other `files`", "give a `top`, or other `files`"),
        ("close it, or let `repair_surface` do it", "close it, or let twincell new do it"),
        ("nothing is named here", "nothing is named here"),
    ],
)
def test_arguments_become_options(said, read):
    assert as_options(said, OPTIONS) == read
