"""The program: what the cell executes, waypoint by waypoint.

A program is a list of *segments*; a segment is a run of waypoints with one purpose. Between two segments the
tool does not jump: the first waypoint of a segment is where the one before it ended. `speed[i]`, `flow[i]` and
the bead's section hold on arrival at waypoint i; along the move towards it they are interpolated from waypoint
i - 1 of the same segment. Where nothing is printed, width, height and flow are 0.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass, fields
from enum import StrEnum
from pathlib import Path

import numpy as np
import numpy.typing as npt

from .errors import ProgramError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int32]

FORMAT = "twincell-program"
VERSION = 1

MOVES_MAX = 1500
"""Most moves in one script; controllers fail somewhere above 1000 to 2500 targets."""


class SegmentKind(StrEnum):
    """What a segment of the program is for."""

    APPROACH = "approach"
    PRINT = "print"
    TRAVEL = "travel"
    RETRACT = "retract"
    WAIT = "wait"
    PRIME = "prime"
    PURGE = "purge"


@dataclass(frozen=True)
class Segment:
    """A run of waypoints [start, stop) with one purpose.

    Attributes:
        kind: what it is for.
        start, stop: waypoint indices.
        layer, curve: what it prints; -1 where it prints nothing.
    """

    kind: SegmentKind
    start: int
    stop: int
    layer: int = -1
    curve: int = -1


@dataclass(frozen=True, eq=False)
class Program:
    """Waypoints for the arm with the flow for the pump; all arrays are read-only, n waypoints.

    Attributes:
        robot: name of the robot model, as `planning.arm` takes it.
        tool: TCP in the flange frame, shape (4, 4), mm.
        segments: in the order of execution; they cover all waypoints without gaps.
        poses: tool poses in the robot's base frame, shape (n, 4, 4), mm.
        joints: shape (n, 6), rad; one continuous branch.
        external_axes: positions of external axes, shape (n, k), empty unless the cell has any.
        speed: TCP speed, shape (n,), mm/s.
        blend: blend radius at the waypoint, shape (n,), mm.
        width, height: bead width and local layer height, shape (n,), mm.
        flow: volume per time, shape (n,), mm³/s.
        time: process time of arrival, shape (n,), s.
        layer, curve: shape (n,), -1 where nothing is printed.
        inputs: SHA-256 of each input that made it, by name.
    """

    robot: str
    tool: Array
    segments: tuple[Segment, ...]
    poses: Array
    joints: Array
    external_axes: Array
    speed: Array
    blend: Array
    width: Array
    height: Array
    flow: Array
    time: Array
    layer: Indices
    curve: Indices
    inputs: dict[str, str]

    def __post_init__(self) -> None:
        n = len(self.poses)
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, np.ndarray):
                if field.name != "tool" and len(value) != n:
                    raise ProgramError(f"program: {field.name} has {len(value)} entries for {n} waypoints")
                value.setflags(write=False)
        at = 0
        for k, segment in enumerate(self.segments):
            if segment.start != at or segment.stop <= segment.start:
                raise ProgramError(
                    f"program: segment {k} covers [{segment.start}, {segment.stop}) but should start at {at}"
                )
            at = segment.stop
        if at != n:
            raise ProgramError(f"program: the segments end at waypoint {at}, but there are {n}")

    def __len__(self) -> int:
        return len(self.poses)

    @property
    def positions(self) -> Array:
        """TCP positions in the robot's base frame, shape (n, 3), mm."""
        return self.poses[:, :3, 3]

    @property
    def duration(self) -> float:
        """Process time of the whole program, s."""
        return float(self.time[-1]) if len(self) else 0.0

    def of_kind(self, *kinds: SegmentKind) -> npt.NDArray[np.bool_]:
        """Mask of the waypoints that lie in segments of the given kinds, shape (n,)."""
        mask = np.zeros(len(self), dtype=np.bool_)
        for segment in self.segments:
            if segment.kind in kinds:
                mask[segment.start : segment.stop] = True
        return mask

    def moves(self) -> npt.NDArray[np.bool_]:
        """Mask of the waypoints reached by printing from the waypoint before, shape (n,)."""
        mask = np.zeros(len(self), dtype=np.bool_)
        for segment in self.segments:
            if segment.kind is SegmentKind.PRINT:
                mask[segment.start + 1 : segment.stop] = True
        return mask

    @property
    def bead_volume(self) -> float:
        """Σ width · height · length over all printing moves, mm³."""
        printing = np.flatnonzero(self.moves())
        section = self.width * self.height
        length = np.linalg.norm(self.positions[printing] - self.positions[printing - 1], axis=1)
        return float((0.5 * (section[printing] + section[printing - 1]) * length).sum())

    def save(self, path: Path) -> None:
        """Write the program as a NumPy archive with a JSON header."""
        header = {
            "format": FORMAT,
            "version": VERSION,
            "robot": self.robot,
            "inputs": self.inputs,
            "segments": [[s.kind.value, s.start, s.stop, s.layer, s.curve] for s in self.segments],
        }
        arrays = {
            f.name: getattr(self, f.name)
            for f in fields(self)
            if isinstance(getattr(self, f.name), np.ndarray)
        }
        partial = path.with_suffix(".partial.npz")
        np.savez_compressed(partial, header=np.array(json.dumps(header)), **arrays)
        partial.replace(path)

    @classmethod
    def load(cls, path: Path) -> Program:
        """Read a program written by `save`.

        Raises:
            ProgramError: the file is missing, damaged, or of another format or version.
        """
        try:
            with np.load(path, allow_pickle=False) as archive:
                header = json.loads(str(archive["header"]))
                if header.get("format") != FORMAT or header.get("version") != VERSION:
                    raise ProgramError(
                        f"{path}: not a {FORMAT} of version {VERSION}; make it again with 'twincell plan'"
                    )
                segments = tuple(Segment(SegmentKind(kind), *rest) for kind, *rest in header["segments"])
                arrays = {name: archive[name] for name in archive.files if name != "header"}
                return cls(robot=header["robot"], inputs=header["inputs"], segments=segments, **arrays)
        except FileNotFoundError:
            raise ProgramError(f"{path}: no such program; make it with 'twincell plan'") from None
        except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
            raise ProgramError(
                f"{path}: damaged program ({error}); make it again with 'twincell plan'"
            ) from error
