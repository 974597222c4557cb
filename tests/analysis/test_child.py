import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from analysis.child import run_child

HERE = Path()


def python(code):
    return [sys.executable, "-c", code]


def test_exit_code_output_and_environment_come_back():
    ended = run_child(
        python(
            "import os, sys; print(os.environ['GIVEN']); print('to stderr', file=sys.stderr); sys.exit(3)"
        ),
        folder=HERE,
        time_limit_s=20,
        environment={"GIVEN": "a value"},
    )
    assert ended.code == 3
    assert "a value" in ended.output
    assert "to stderr" in ended.output


def test_the_signal_that_ended_it_is_told():
    ended = run_child(python("import os; os.kill(os.getpid(), 11)"), folder=HERE, time_limit_s=20)
    assert ended.code == -signal.SIGSEGV


def test_what_is_not_there_cannot_be_started():
    with pytest.raises(OSError, match="no-such-program"):
        run_child(["no-such-program"], folder=HERE, time_limit_s=1)


def test_after_the_time_limit_no_process_of_the_group_is_left(marked):
    sleep = "import time; time.sleep(60)"
    code = f"import subprocess, sys; subprocess.Popen([sys.executable, '-c', '{sleep}']); {sleep}"
    start = time.monotonic()
    ended = run_child(python(code), folder=HERE, time_limit_s=0.5)
    assert ended.code is None
    assert time.monotonic() - start < 5
    assert marked(patience_s=2) == []  # a grandchild's corpse is reaped by its new parent


def test_a_child_that_ignores_signals_and_floods_its_output_is_still_killed(marked):
    code = (
        "import signal\nfor s in (1, 2, 15): signal.signal(s, signal.SIG_IGN)\nwhile True: print('x' * 1000)"
    )
    assert run_child(python(code), folder=HERE, time_limit_s=0.5).code is None
    assert marked() == []


def test_an_interrupt_of_the_caller_leaves_nothing(marked):
    caller = (
        # Whoever runs the tests in the background may have them ignore interrupts; the caller does not inherit that.
        "import signal\nsignal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from pathlib import Path\nfrom analysis.child import run_child\nimport sys\nprint('ready', flush=True)\n"
        "run_child([sys.executable, '-c', 'import time; time.sleep(60)'], folder=Path(), time_limit_s=60)"
    )
    process = subprocess.Popen(python(caller), stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    assert process.stdout.readline() == b"ready\n"
    end = time.monotonic() + 10
    while len(marked()) < 2 and time.monotonic() < end:
        time.sleep(0.02)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=10)
    assert b"KeyboardInterrupt" in errors
    assert marked(patience_s=2) == []
