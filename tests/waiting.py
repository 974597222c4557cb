"""Waits in tests for what another process does, and what is done when the machine made it late."""

import time

import pytest

# A machine that holds a process up for tens of milliseconds takes a measurement out of the tested code's hands: it is
# made again. Any failure is, whichever ones the command line would rerun.
timed = pytest.mark.flaky(reruns=2, only_rerun=[".*"])


def until(condition, seconds=10.0):
    """Wait for something; it is wrong if it does not happen in so many seconds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.002)
