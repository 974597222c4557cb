"""Waits in tests for what another process does."""

import time


def until(condition, seconds=10.0):
    """Wait for something; it is wrong if it does not happen in so many seconds."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "did not happen in time"
        time.sleep(0.002)
