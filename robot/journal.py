"""The journal: what happened during a print, in one SQLite file per job.

A run is one row of `runs`; its events, checkpoints and samples carry its id, so one file holds every attempt at a
job. A single thread writes, in batches, in SQLite's write-ahead mode: the control loop never waits for the disk,
and a process killed at any moment leaves a file that reads up to its last batch.

    runs         id, wall, info
    events       run, wall, process_time, kind, message, data
    checkpoints  run, wall, process_time, chunk, waypoint
    samples      run, wall, and the columns of `planning.PrintedSample`

`wall` is seconds since 1970; `process_time` is the controller's clock, s; `info` and `data` are JSON.
"""

from __future__ import annotations

import json
import math
import os
import queue
import sqlite3
import threading
import time
from collections.abc import Iterable
from contextlib import closing
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import numpy as np
import numpy.typing as npt

from planning import PrintedSample

from .errors import JournalError

COMMIT_PERIOD = 0.25
"""Shortest wall time between two commits, s."""

CAPACITY = 50_000
"""Rows that may wait for the disk; minutes of printing."""

_COLUMNS = tuple(field.name for field in fields(PrintedSample))
_WHOLE = ("waypoint", "segment")

SAMPLE = np.dtype([("wall", "f8"), *((name, "i8" if name in _WHOLE else "f8") for name in _COLUMNS)])
"""Row type of `read_samples`."""

_SCHEMA = f"""
CREATE TABLE IF NOT EXISTS runs (id INTEGER PRIMARY KEY, wall REAL NOT NULL, info TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS events (run INTEGER NOT NULL, wall REAL NOT NULL, process_time REAL, kind TEXT NOT NULL,
    message TEXT NOT NULL, data TEXT NOT NULL);
CREATE TABLE IF NOT EXISTS checkpoints (run INTEGER NOT NULL, wall REAL NOT NULL, process_time REAL NOT NULL,
    chunk INTEGER NOT NULL, waypoint INTEGER NOT NULL);
CREATE TABLE IF NOT EXISTS samples (run INTEGER NOT NULL, wall REAL NOT NULL,
    {", ".join(f"{name} {'INTEGER' if name in _WHOLE else 'REAL'} NOT NULL" for name in _COLUMNS)});
"""

_INSERT = {
    "events": "INSERT INTO events VALUES (?, ?, ?, ?, ?, ?)",
    "checkpoints": "INSERT INTO checkpoints VALUES (?, ?, ?, ?, ?)",
    "samples": f"INSERT INTO samples VALUES ({', '.join('?' * (2 + len(_COLUMNS)))})",  # noqa: S608 - fixed names
}

_Row = tuple[str, tuple[Any, ...]]


@dataclass(frozen=True)
class Event:
    """One thing that happened.

    Attributes:
        run: id of the run.
        wall: when, seconds since 1970.
        process_time: when by the controller's clock, s; NaN where that was not known.
        kind: a single word such as `chunk`, `stop` or `error`.
        message: one sentence.
        data: what belongs to it, by name.
    """

    run: int
    wall: float
    process_time: float
    kind: str
    message: str
    data: dict[str, Any]


class Journal:
    """The writing end of a journal, for one run. A context manager; closing writes what is still waiting.

    Args:
        path: the file; made when it is missing, continued when it holds earlier runs.
        info: facts about this run, kept as JSON.

    Raises:
        JournalError: the file cannot be opened, or is not a journal. From any later call: it can no longer be
            written.
    """

    def __init__(self, path: Path, info: dict[str, Any] | None = None) -> None:
        self.path = path
        self._rows: queue.Queue[_Row] = queue.Queue(CAPACITY)
        self._closing = threading.Event()
        self._failure: Exception | None = None
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            with closing(sqlite3.connect(path, timeout=5.0)) as database, database:
                database.execute("PRAGMA journal_mode = WAL")
                database.executescript(f"BEGIN; {_SCHEMA} COMMIT;")  # a reader finds all tables or none
                row = (time.time(), json.dumps(info or {}))
                self.run = int(
                    database.execute("INSERT INTO runs (wall, info) VALUES (?, ?)", row).lastrowid or 0
                )
        except (OSError, sqlite3.Error) as error:
            raise JournalError(
                f"{path}: cannot be opened as a journal ({error}); name another file, or mend this one"
            ) from error
        self._thread = threading.Thread(target=self._write, name="journal", daemon=True)
        self._thread.start()

    def event(self, kind: str, message: str, process_time: float = math.nan, **data: Any) -> None:
        """Record that something happened."""
        known = None if math.isnan(process_time) else process_time
        self._put("events", (self.run, time.time(), known, kind, message, json.dumps(data)))

    def checkpoint(self, process_time: float, chunk: int, waypoint: int) -> None:
        """Record that the tool has passed a waypoint."""
        self._put("checkpoints", (self.run, time.time(), process_time, chunk, waypoint))

    def sample(self, sample: PrintedSample) -> None:
        """Record a measurement."""
        self._put("samples", (self.run, time.time(), *astuple(sample)))

    def close(self) -> None:
        """Write what is waiting and end the thread."""
        self._closing.set()
        self._thread.join()
        self._check()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self.close()
        except JournalError:
            if error is None:
                raise

    def _put(self, table: str, row: tuple[Any, ...]) -> None:
        self._check()
        try:
            self._rows.put_nowait((table, row))
        except queue.Full:
            raise JournalError(
                f"{self.path}: the disk has not kept up for {CAPACITY} rows; free it before printing on"
            ) from None

    def _check(self) -> None:
        if self._failure is not None:
            raise JournalError(f"{self.path}: cannot be written ({self._failure})") from self._failure

    def _write(self) -> None:
        try:
            with closing(sqlite3.connect(self.path, timeout=5.0)) as database:
                database.execute("PRAGMA synchronous = NORMAL")
                ending = False
                while not ending:
                    ending = self._closing.wait(COMMIT_PERIOD)
                    self._commit(database)
        except Exception as error:
            self._failure = error

    def _commit(self, database: sqlite3.Connection) -> None:
        waiting: dict[str, list[tuple[Any, ...]]] = {}
        for _ in range(self._rows.qsize()):
            table, row = self._rows.get_nowait()
            waiting.setdefault(table, []).append(row)
        if waiting:
            with database:
                for table, rows in waiting.items():
                    database.executemany(_INSERT[table], rows)


def read_samples(path: Path, run: int | None = None) -> npt.NDArray[np.void]:
    """The samples of a run, in the order they were taken.

    Args:
        path: a journal; it may still be being written.
        run: its id, or None for the last one.

    Returns:
        structured array of type `SAMPLE`: mm, s, mm/s, mm³/s.

    Raises:
        JournalError: no such file, not a journal, or no such run.
    """
    names = ", ".join(SAMPLE.names or ())
    rows = _query(path, run, f"SELECT {names} FROM samples WHERE run = ? ORDER BY rowid")  # noqa: S608 - fixed names
    return np.array(list(rows), dtype=SAMPLE)


def read_events(path: Path, run: int | None = None) -> list[Event]:
    """The events of a run, oldest first; arguments and errors as for `read_samples`."""
    rows = _query(
        path,
        run,
        "SELECT run, wall, process_time, kind, message, data FROM events WHERE run = ? ORDER BY rowid",
    )
    return [
        Event(number, wall, math.nan if at is None else at, kind, message, json.loads(data))
        for number, wall, at, kind, message, data in rows
    ]


def read_checkpoint(path: Path, run: int | None = None) -> tuple[int, int] | None:
    """Chunk and waypoint that a run is known to have passed, or None; arguments and errors as for `read_samples`."""
    rows = list(
        _query(path, run, "SELECT chunk, waypoint FROM checkpoints WHERE run = ? ORDER BY rowid DESC LIMIT 1")
    )
    return (int(rows[0][0]), int(rows[0][1])) if rows else None


def read_runs(path: Path) -> dict[int, dict[str, Any]]:
    """Facts about every run in a journal, by id, oldest first.

    Raises:
        JournalError: no such file, or not a journal.
    """
    rows = _query(path, 0, "SELECT id, info FROM runs WHERE id > ? ORDER BY id")
    return {int(number): json.loads(info) for number, info in rows}


def _mode(path: Path) -> str:
    """Only a reader that may write clears away the write-ahead log when it closes the file last."""
    return "rw" if os.access(path, os.W_OK) and os.access(path.parent, os.W_OK) else "ro"


def _query(path: Path, run: int | None, statement: str) -> Iterable[tuple[Any, ...]]:
    if not path.is_file():
        raise JournalError(f"{path}: no such journal; a print makes it")
    try:
        with closing(
            sqlite3.connect(f"{path.resolve().as_uri()}?mode={_mode(path)}", uri=True, timeout=5.0)
        ) as database:
            if run is None:
                run = database.execute("SELECT max(id) FROM runs").fetchone()[0] or 0
            elif run and database.execute("SELECT 1 FROM runs WHERE id = ?", (run,)).fetchone() is None:
                raise JournalError(f"{path}: holds no run {run}")
            return database.execute(statement, (run,)).fetchall()
    except sqlite3.Error as error:
        raise JournalError(f"{path}: cannot be read as a journal ({error})") from error
