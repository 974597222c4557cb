"""The journal keeps what it was given, run by run, and survives being killed."""

import json
import math
import os
import signal
import sqlite3
import subprocess
import sys
import time
from dataclasses import astuple, fields

import numpy as np
import pytest

from planning import PrintedSample
from robot.errors import JournalError
from robot.journal import Journal, read_checkpoint, read_events, read_runs, read_samples


def sample(i):
    return PrintedSample(0.01 * i, 1.0 * i, 2.0, 3.0, 50.0, 400.0, 399.5, i, i // 10)


def test_what_is_written_is_read(tmp_path):
    path = tmp_path / "new" / "journal.sqlite"
    with Journal(path, {"program": "abc"}) as journal:
        for i in range(100):
            journal.sample(sample(i))
        journal.event("stop", "a protective stop", 1.5, waypoint=7)
        journal.event("note", "before the clock is known")
        journal.checkpoint(0.5, 2, 41)
        journal.checkpoint(0.6, 2, 42)

    samples = read_samples(path)
    for field in fields(PrintedSample):
        assert np.array_equal(samples[field.name], [getattr(sample(i), field.name) for i in range(100)])
    stop, note = read_events(path)
    assert (stop.kind, stop.message, stop.process_time, stop.data) == (
        "stop",
        "a protective stop",
        1.5,
        {"waypoint": 7},
    )
    assert math.isnan(note.process_time)
    assert read_checkpoint(path) == (2, 42)
    assert read_runs(path) == {1: {"program": "abc"}}


def test_runs_in_one_file_stay_apart(tmp_path):
    path = tmp_path / "journal.sqlite"
    for count in (3, 5):
        with Journal(path) as journal:
            for i in range(count):
                journal.sample(sample(i))
    assert len(read_samples(path, 1)) == 3
    assert len(read_samples(path, 2)) == 5
    assert len(read_samples(path)) == 5
    assert read_checkpoint(path) is None
    with pytest.raises(JournalError, match="holds no run 3"):
        read_samples(path, 3)


def test_a_journal_can_be_read_while_it_is_written(tmp_path):
    path = tmp_path / "journal.sqlite"
    with Journal(path) as journal:
        journal.sample(sample(1))
        assert len(read_samples(path, journal.run)) <= 1
    assert len(read_samples(path)) == 1


WRITER = """
import sys, time
from pathlib import Path
from planning import PrintedSample
from robot.journal import Journal
journal = Journal(Path(sys.argv[1]))
i = 0
while True:
    journal.sample(PrintedSample(float(i), 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, i, 0))
    journal.checkpoint(float(i), 0, i)
    if i == 0:
        print("writing", flush=True)
    if i % 100 == 0:
        time.sleep(0.01)
    i += 1
"""


def test_a_killed_writer_leaves_a_readable_file(tmp_path):
    path = tmp_path / "journal.sqlite"
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, text=True)
    writer.stdout.readline()
    time.sleep(0.7)  # past some commits
    os.kill(writer.pid, signal.SIGKILL)
    writer.communicate()
    with sqlite3.connect(path) as database:
        assert database.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    rows = read_samples(path)
    assert np.array_equal(rows["waypoint"], np.arange(len(rows)))  # a prefix: nothing missing in between
    assert len(rows) > 0
    chunk, passed = read_checkpoint(path)
    assert chunk == 0
    assert abs(passed - rows["waypoint"][-1]) <= 1
    with Journal(path) as journal:  # and the next run goes on in it
        journal.sample(sample(3))
    assert len(read_samples(path)) == 1
    assert len(read_samples(path, 1)) == len(rows)


def test_commits_are_few(tmp_path):
    path = tmp_path / "journal.sqlite"
    with Journal(path) as journal, sqlite3.connect(path) as other:
        versions = []
        for i in range(200):
            journal.sample(sample(i))
            signal.sigtimedwait([], 0.005)
            versions.append(other.execute("PRAGMA data_version").fetchone()[0])
    assert len(set(versions)) <= 1 + 1.0 * 5 + 1  # about 1 s at no more than 5 commits per second


def test_what_is_not_a_journal_is_refused(tmp_path):
    text = tmp_path / "notes.txt"
    text.write_text("not a database, but long enough to look like one " * 20)
    with pytest.raises(JournalError, match=r"notes\.txt"):
        Journal(text)
    with pytest.raises(JournalError, match=r"notes\.txt"):
        read_samples(text)
    with pytest.raises(JournalError, match="no such journal"):
        read_events(tmp_path / "missing.sqlite")
    with pytest.raises(JournalError, match="cannot be opened"):
        Journal(tmp_path)


def test_a_failing_disk_is_told_to_the_next_caller(tmp_path):
    path = tmp_path / "journal.sqlite"
    journal = Journal(path)
    with sqlite3.connect(path) as database:
        database.execute("DROP TABLE samples")
    journal.sample(sample(1))
    with pytest.raises(JournalError, match="cannot be written"):
        journal.close()


def test_data_is_json(tmp_path):
    path = tmp_path / "journal.sqlite"
    with Journal(path) as journal:
        journal.event("chunk", "chunk 3", 2.0, chunk=3, joints=[0.0, 1.5])
    with sqlite3.connect(path) as database:
        assert json.loads(database.execute("SELECT data FROM events").fetchone()[0]) == {
            "chunk": 3,
            "joints": [0.0, 1.5],
        }
    assert astuple(sample(2))[7] == 2
