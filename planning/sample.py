"""A printed sample: what was measured at one moment of a print."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class PrintedSample:
    """One measurement.

    Attributes:
        time: process time, s.
        x, y, z: TCP in the robot's base frame, mm.
        speed: of the TCP, mm/s.
        command: flow that the pump was last told, mm³/s.
        flow: flow that the pump reports, mm³/s.
        waypoint: the waypoint that the arm was moving to.
        segment: index of the program's segment.
    """

    time: float
    x: float
    y: float
    z: float
    speed: float
    command: float
    flow: float
    waypoint: int
    segment: int
