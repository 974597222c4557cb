"""CalculiX: run it on an input file, and read what it found.

CalculiX ends with code 0 when it ignores a keyword, and prints its reactions without the loads that act on fixed
nodes. Both are checked here: its log is searched, and reactions and weight must balance.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .child import run_child
from .errors import SolverError, SolverMissing, SolverTimeout
from .self_weight import Deck
from .settings import thread_count
from .tetrahedra import Array, Indices

_PROGRAMS = ("ccx", "ccx_2.22", "ccx_2.21", "ccx_2.20")
_BALANCE = 5e-3
"""Largest difference between reactions and weight, as a share of the weight."""

_IGNORED = ("cannotbeinterpreted", "notrecognized")
"""Signs of an ignored keyword or parameter, without spaces: CalculiX itself writes "inter    preted"."""

_LEFTOVERS = ("spooles.out",)
_STALE = (".dat", ".frd", ".sta", ".cvg", ".12d")


@dataclass(frozen=True, eq=False)
class SolverResult:
    """What CalculiX found for a self-weight case.

    Attributes:
        rc: exit code, 0.
        log: what the solver printed.
        seconds: it took, s.
        reaction: printed sum of the base's reactions, shape (3,), N.
        base_weight: weight that acts on fixed nodes and is not in `reaction`, shape (3,), N.
        weight: of all elements, shape (3,), N.
        displacements: of each node of `mesh.inp`, shape (n, 3), mm.
        stresses: at the integration points, columns xx, yy, zz, xy, xz, yz, shape (k, 6), MPa.
        elements: element that each row of `stresses` belongs to, counted from 0, shape (k,).
    """

    rc: int
    log: str
    seconds: float
    reaction: Array
    base_weight: Array
    weight: Array
    displacements: Array
    stresses: Array
    elements: Indices

    @property
    def max_displacement(self) -> float:
        """Largest displacement of any node, mm."""
        return float(np.linalg.norm(self.displacements, axis=1).max())

    @property
    def imbalance(self) -> float:
        """‖reaction - base_weight + weight‖ / ‖weight‖: 0 in equilibrium."""
        rest = self.reaction - self.base_weight + self.weight
        return float(np.linalg.norm(rest) / np.linalg.norm(self.weight))

    @property
    def max_von_mises(self) -> float:
        """Largest von Mises stress at an integration point, MPa."""
        xx, yy, zz, xy, xz, yz = self.stresses.T
        squared = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (xy**2 + xz**2 + yz**2)
        return float(np.sqrt(squared.max()))


def find_solver() -> str | None:
    """Path of the CalculiX program, None where it is not installed."""
    return next((path for path in map(shutil.which, _PROGRAMS) if path), None)


def solve(deck: Deck, *, time_limit_s: float = 600.0, threads: int = 0) -> SolverResult:
    """Solve a self-weight case; its result files stay beside it.

    Args:
        time_limit_s: after which the solver is killed, s.
        threads: 0 for all cores.

    Raises:
        SolverMissing: CalculiX is not installed; the message is "ccx is not installed".
        SolverTimeout: the time is up.
        SolverError: the solver failed, did not understand a keyword, or reactions and weight do not balance.
    """
    program = find_solver()
    if program is None:
        raise SolverMissing("ccx is not installed")
    folder, name = deck.path.parent, deck.path.stem
    if not deck.path.is_file():
        raise SolverError(f"{deck.path}: no such input file; write it first")
    for suffix in _STALE:
        deck.path.with_suffix(suffix).unlink(missing_ok=True)
    count = str(thread_count(threads))
    try:
        ended = run_child(
            [program, "-i", name],
            folder=folder,
            time_limit_s=time_limit_s,
            environment={
                "OMP_NUM_THREADS": count,
                "CCX_NPROC_STIFFNESS": count,
                "CCX_NPROC_RESULTS": count,
                "CCX_NPROC_EQUATION_SOLVER": count,
            },
        )
    except OSError as error:
        raise SolverError(f"{program} cannot be started: {error.strerror}") from error
    for leftover in _LEFTOVERS:
        (folder / leftover).unlink(missing_ok=True)
    if ended.code is None:
        raise SolverTimeout(
            f"{deck.path}: the solver did not end within {time_limit_s:.6g} s; "
            "increase the edge length or the time limit"
        )
    _check_log(deck.path, ended.code, ended.output)
    return _result(deck, ended.code, ended.output, ended.seconds)


def _check_log(deck: Path, code: int, log: str) -> None:
    lines = [" ".join(line.split()) for line in log.splitlines()]
    for k, line in enumerate(lines):
        if any(sign in line.replace(" ", "") for sign in _IGNORED):
            cards = (text for text in lines[k + 1 :] if text and not text.startswith("*WARNING"))
            raise SolverError(
                f"{deck}: the solver left out what cannot be interpreted: {next(cards, line)}; correct the input file"
            )
        if "*ERROR" in line:
            raise SolverError(f"{deck}: the solver says: {' '.join(lines[k : k + 3]).strip()}")
    if code != 0:
        last = next((line for line in reversed(lines) if line), "no message")
        raise SolverError(f"{deck}: the solver ended with code {code}: {last}")


def _result(deck: Deck, code: int, log: str, seconds: float) -> SolverResult:
    path = deck.path.with_suffix(".dat")
    tables = dict(_tables(path))
    try:
        reaction, displacements, stresses = (
            tables["total force"][0],
            tables["displacements"],
            tables["stresses"],
        )
    except (KeyError, IndexError):
        raise SolverError(
            f"{path}: reactions, displacements or stresses are missing; see the solver's log"
        ) from None
    if not all(np.isfinite(table).all() for table in (reaction, displacements, stresses)):
        raise SolverError(
            f"{path}: the solution is not finite; check that the part stands firmly on its base"
        )
    result = SolverResult(
        rc=code,
        log=log,
        seconds=seconds,
        reaction=reaction,
        base_weight=deck.base_weight,
        weight=deck.weight,
        displacements=displacements[:, 1:],
        stresses=stresses[:, 2:8],
        elements=stresses[:, 0].astype(np.int64) - 1,
    )
    if result.imbalance > _BALANCE:
        raise SolverError(
            f"{path}: reactions and weight differ by {100 * result.imbalance:.2f} % of the weight; "
            "check that the part stands firmly on its base"
        )
    return result


def _tables(path: Path) -> Iterator[tuple[str, Array]]:
    """Name and numbers of each table in a `.dat` file."""
    if not path.is_file():
        raise SolverError(f"{path}: the solver wrote no results; see its log")
    text = path.read_text(encoding="ascii", errors="replace")
    # a table is a heading that begins with a word, then lines of numbers
    headings = list(re.finditer(r"^ *([a-z].*)$", text, flags=re.MULTILINE))
    starts = [heading.start() for heading in headings]
    for heading, end in zip(headings, [*starts[1:], len(text)], strict=False):
        rows = [line.split() for line in text[heading.end() : end].splitlines() if line.strip()]
        try:
            yield heading[1].split(" (")[0], np.array(rows, dtype=np.float64)
        except ValueError as error:
            raise SolverError(f"{path}: the table '{heading[1]}' is damaged: {error}") from error
