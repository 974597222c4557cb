"""ur-rtde's script client by itself."""

from __future__ import annotations

from script_client import ScriptClient

NOT_CALLED = {"setScriptFile": "the wheel binds it without its parameter: calling it ends the process"}


def test_every_method_is_called_or_cannot_be(tour) -> None:
    methods = {name for name in vars(ScriptClient) if name[0] != "_"}
    assert methods - tour.called("script") == set(NOT_CALLED)


def test_lines_and_files_are_run(tour) -> None:
    told = tour["scripts"]
    assert told["answers"] == [True] * 5
    assert told["connected"] == [False, True, False]


def test_a_control_script_without_its_offsets_is_refused(tour) -> None:
    """The control interface puts the offsets of the registers into the text; without them it is no program."""
    told = tour["scripts"]
    assert told["text"].startswith("# HEADER_BEGIN")
    assert told["state"] == 1
    assert "'def rtde_control():' refused" in tour.complaints
