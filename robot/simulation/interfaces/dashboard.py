"""The simulated controller's dashboard server: one line asked, one line answered."""

from __future__ import annotations

import asyncio
import re
from typing import TYPE_CHECKING

from robot.simulation.machine import RobotMode, RuntimeState, SafetyMode

if TYPE_CHECKING:
    from collections.abc import Callable

    from robot.simulation.machine import Machine

PORT = 29999
SERIAL_NUMBER = "20215500001"
PROGRAM_STATES = {
    RuntimeState.PLAYING: "PLAYING",
    RuntimeState.PAUSED: "PAUSED",
    RuntimeState.PAUSING: "PAUSED",
}
ACKNOWLEDGED = {
    "popup": "showing popup",
    "close popup": "closing popup",
    "close safety popup": "closing safety popup",
    "addtolog": "Added log message",
    "setuserrole": "Setting user role",
    "shutdown": "Shutting down",
}


class Dashboard:
    """Answers one client after another; the power states follow its commands."""

    def __init__(self, machine: Machine) -> None:
        self.machine = machine
        self._loaded = "/programs/unnamed.urp"
        self._answers: dict[str, Callable[[], str]] = {
            "polyscopeversion": lambda: "URSoftware {}.{}.{}.{} (simulated)".format(*machine.version),
            "version": lambda: "{}.{}.{}.{}".format(*machine.version),
            "get serial number": lambda: SERIAL_NUMBER,
            "get robot model": machine.cell.robot.model.upper,
            "get loaded program": lambda: f"Loaded program: {self._loaded}",
            "is in remote control": lambda: "true",
            "isprogramsaved": lambda: f"True {self._loaded}",
            "running": lambda: f"Program running: {str(self._playing).lower()}",
            "programstate": lambda: f"{PROGRAM_STATES.get(machine.runtime, 'STOPPED')} {self._loaded}",
            "robotmode": lambda: f"Robotmode: {machine.mode.name}",
            "safetymode": lambda: f"Safetymode: {machine.safety.name}",
            "safetystatus": lambda: f"Safetystatus: {machine.safety.name}",
            "power on": lambda: self._power(RobotMode.IDLE, "Powering on"),
            "power off": lambda: self._power(RobotMode.POWER_OFF, "Powering off"),
            "brake release": lambda: self._power(RobotMode.RUNNING, "Brake releasing"),
            "stop": self._stop,
            "play": self._play,
            "pause": self._pause,
            "unlock protective stop": self._unlock,
            "restart safety": self._restart_safety,
        }

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Talk with one client until it leaves."""
        try:
            writer.write(b"Connected: Universal Robots Dashboard Server\n")
            while line := await reader.readline():
                asked = line.decode("utf-8", "replace").strip()
                if asked.lower() == "quit":
                    writer.write(b"Disconnected\n")
                    break
                writer.write(f"{self.answer(asked)}\n".encode())
                await writer.drain()
        except (ConnectionError, asyncio.LimitOverrunError, ValueError):
            pass  # the client is gone, or never was one
        finally:
            writer.close()

    def answer(self, asked: str) -> str:
        """The answer to one line."""
        key = re.sub(r"\s+", " ", asked.lower())
        if key in self._answers:
            return self._answers[key]()
        if key.startswith("load "):
            self._loaded = asked.split(" ", 1)[1]
            return f"Loading program: {self._loaded}"
        for start, text in ACKNOWLEDGED.items():
            if key.startswith(start):
                return text
        return f"could not understand: '{asked}'"

    @property
    def _playing(self) -> bool:
        return self.machine.runtime is RuntimeState.PLAYING

    def _power(self, mode: RobotMode, text: str) -> str:
        machine = self.machine
        if machine.safety is SafetyMode.ROBOT_EMERGENCY_STOP and mode is not RobotMode.POWER_OFF:
            return f"Failed to execute: robot is in safety mode {machine.safety.name}"
        if mode is RobotMode.POWER_OFF:
            machine.stop_program("power off")
        if mode is not RobotMode.IDLE or machine.mode is RobotMode.POWER_OFF:
            machine.mode = mode
        return text

    def _stop(self) -> str:
        self.machine.stop_program()
        return "Stopped"

    def _play(self) -> str:
        return "Starting program" if self.machine.play_program() else "Failed to execute: play"

    def _pause(self) -> str:
        if not self._playing:
            return "Failed to execute: pause"
        self.machine.pause_program()
        return "Pausing program"

    def _unlock(self) -> str:
        if self.machine.safety is SafetyMode.PROTECTIVE_STOP:
            self.machine.clear_stop()
        return "Protective stop releasing"

    def _restart_safety(self) -> str:
        if self.machine.safety is not SafetyMode.ROBOT_EMERGENCY_STOP:
            self.machine.clear_stop()
        return "Restarting safety"
