"""The hose between pump and nozzle, a delay line: what leaves the nozzle, and how long ago it was pumped into the hose.

Flow and volume answer what the pump gives after a dead time and with a lag; both are known exactly at any time. Inside
the hose the material is a plug that moves as a whole and does not change its volume, so that what leaves now has been
in it since the pump had moved a hose's content less. The age of what filled the hose at first is not known; it counts
from the beginning.

While the pump sucks back, nothing leaves; the nozzle gives again when the same volume has been pushed forward.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from typing import NamedTuple

from .first_order import FirstOrder, Piece

LONGEST_RECORD = 1 << 17
"""Changes of the flow that are remembered while their material is in the hose; the oldest are averaged beyond."""


class _Intake(NamedTuple):
    """What entered the hose during a part of a piece of the flow.

    Attributes:
        low, high: volumes that the pump had moved in all, at its beginning and its end, mm³.
        piece: of the flow.
        begin, end: times after the piece's start, s.
    """

    low: float
    high: float
    piece: Piece
    begin: float
    end: float

    def when(self, volume: float) -> float:
        """The time at which the pump had moved a volume in all."""
        along = self.piece.integral(self.begin) + volume - self.low
        return self.piece.start + self.piece.when(along, self.begin, self.end)


class Hose:
    """What leaves the nozzle.

    Args:
        dead_time, lag: of the flow, s.
        time: at the beginning, s.
        content: what the hose holds, mm³.

    Attributes:
        time: process time until which everything is known, s.
        volume: that left the nozzle since the beginning, mm³.
    """

    def __init__(self, dead_time: float, lag: float, time: float = 0.0, *, content: float = 0.0) -> None:
        self.time = self._began = time
        self.volume = 0.0
        self._flow = FirstOrder(dead_time, lag, time)
        self._content = content
        self._moved = 0.0  # by the pump, in all; falls while it sucks back
        self._base = 0.0  # of it, before the piece that `time` lies in
        self._intakes: deque[_Intake] = deque()

    @property
    def flow(self) -> float:
        """At the nozzle, mm³/s."""
        return max(self._flow.value, 0.0) if self._moved >= self.volume else 0.0

    @property
    def age(self) -> float:
        """How long ago what leaves the nozzle entered the hose, s."""
        volume = self.volume - self._content
        if volume < 0.0:
            return self.time - self._began
        while self._intakes and self._intakes[0].high <= volume:
            self._intakes.popleft()
        return max(self.time - self._intakes[0].when(volume), 0.0) if self._intakes else 0.0

    def command(self, time: float, flow: float, slope: float = 0.0) -> None:
        """From a process time on the pump gives a flow that changes by a slope, mm³/s²; what was to come is void."""
        self._flow.command(time, flow, slope)

    def advance(self, time: float) -> None:
        """Go on to a process time."""
        for piece, end in self._flow.advance(time):
            begin = max(self.time - piece.start, 0.0)
            for low, high in pairwise(
                [begin, *piece.sign_changes(begin, end - piece.start), end - piece.start]
            ):
                self._move(piece, low, high)
            self.time = max(self.time, end)
            if piece is not self._flow.piece:
                self._base = self._moved

    def _move(self, piece: Piece, begin: float, end: float) -> None:
        """Follow a part of a piece, in which the flow keeps its direction."""
        moved = self._base + piece.integral(end)
        if moved > self._moved:
            last = self._intakes[-1] if self._intakes else None
            if last is not None and last.piece is piece and last.high == self._moved:
                self._intakes[-1] = last._replace(high=moved, end=end)
            else:
                self._intakes.append(_Intake(self._moved, moved, piece, begin, end))
                self._forget()
        elif moved < self._moved:
            while self._intakes and self._intakes[-1].low >= moved:
                self._intakes.pop()
            if self._intakes:
                self._intakes[-1] = self._intakes[-1]._replace(high=min(self._intakes[-1].high, moved))
        self._moved = moved
        self.volume = max(self.volume, moved)

    def _forget(self) -> None:
        if self._intakes[0].high <= self.volume - self._content:
            self._intakes.popleft()
        if len(self._intakes) > LONGEST_RECORD:
            first, second = self._intakes.popleft(), self._intakes.popleft()
            start = first.piece.start + first.begin
            took = second.piece.start + second.end - start
            mean = Piece(start, (second.high - first.low) / took)
            self._intakes.appendleft(_Intake(first.low, second.high, mean, 0.0, took))
