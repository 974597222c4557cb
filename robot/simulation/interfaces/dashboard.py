"""The simulated controller's dashboard server: one line asked, one line answered.

The commands are those of the manufacturer's tables, each with the versions that have it. A command that changes
something needs remote control.
"""

from __future__ import annotations

import asyncio
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from robot.simulation.machine import RuntimeState
from robot.simulation.power import RobotMode, SafetyMode
from robot.simulation.versions import Version, e_series, has

from .outputs import safety_mode
from .program_files import ProgramFiles

if TYPE_CHECKING:
    from pathlib import Path

    from robot.simulation.machine import Machine

PORT = 29999
SERIAL_NUMBERS = {False: "20153500001", True: "20215500001"}  # of a CB3, of the e-Series
PROGRAM_STATES = {
    RuntimeState.PLAYING: "PLAYING",
    RuntimeState.PAUSED: "PAUSED",
    RuntimeState.PAUSING: "PAUSED",
}
USER_ROLES = ("programmer", "operator", "none", "locked", "restricted")
OPERATIONAL_MODES = ("manual", "automatic")
REPORTS = ("", "controller", "software", "system")
TOO_EARLY = (
    "Cannot unlock protective stop until {:g}s after occurrence."
    " Always inspect cause of protective stop before unlocking"
)
NOT_REMOTE = "Not in remote control"
MOST_WORDS = 4
"""Of a command's name."""

LOOK = 0.002  # s between two looks whether a program has started


@dataclass(frozen=True)
class DashboardSettings:
    """How the dashboard behaves.

    Attributes:
        programs: folder of the programs that can be loaded; without one, every name stands for an empty program.
        remote: whether the robot is in remote control.
        unlock_after: process time, s, for which a protective stop cannot be unlocked; a real controller's is 5 s.
    """

    programs: Path | None = None
    remote: bool = True
    unlock_after: float = 0.0


@dataclass(frozen=True)
class Command:
    """One command.

    Attributes:
        cb3, e: versions of the two families that brought it; None: never.
        answer: to what follows the command in its line.
        refusal: the answer of a robot that is not in remote control, `{}` for what follows; None: it answers anyway.
    """

    cb3: Version | None
    e: Version | None
    answer: Callable[[str], str]
    refusal: str | None = None


async def _nothing_starts(text: str) -> bool:
    del text
    return False


class Dashboard:
    """Answers its clients; power, safety and programs follow its commands.

    Args:
        machine: whose state it tells and changes.
        start: starts a program, given as text; tells whether it starts.
        settings: how it behaves.
    """

    def __init__(
        self,
        machine: Machine,
        start: Callable[[str], Awaitable[bool]] = _nothing_starts,
        settings: DashboardSettings | None = None,
    ) -> None:
        self.machine = machine
        self._start = start
        self._settings = settings or DashboardSettings()
        self._files = ProgramFiles(self._settings.programs)
        self._to_start: str | None = None
        self._role = "PROGRAMMER"
        self._operational_mode = "NONE"
        self._reports = 0
        self._commands = {
            name: command
            for name, command in self._known().items()
            if has(machine.version, command.cb3, command.e)
        }

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Talk with one client until it leaves."""
        try:
            writer.write(b"Connected: Universal Robots Dashboard Server\n")
            while line := await reader.readline():
                asked = line.decode("utf-8", "replace").strip()
                answer = self.answer(asked)
                if not await self._has_started():
                    answer = "Failed to execute: play"
                writer.write(f"{answer}\n".encode())
                await writer.drain()
                if asked.lower() == "quit":
                    break
        except (ConnectionError, asyncio.LimitOverrunError, ValueError):
            pass  # the client is gone, or never was one
        finally:
            writer.close()

    def answer(self, asked: str) -> str:
        """The answer to one line."""
        words = asked.split(maxsplit=MOST_WORDS)
        for count in range(min(len(words), MOST_WORDS), 0, -1):
            command = self._commands.get(" ".join(words[:count]).lower())
            if command is not None:
                told = "".join(asked.split(maxsplit=count)[count:])
                if command.refusal is not None and not self._settings.remote:
                    return command.refusal.format(told)
                return command.answer(told)
        return f"could not understand: '{asked}'"

    async def _has_started(self) -> bool:
        """Start what was asked to be played, and wait until it runs; whether there was nothing to fail at."""
        text, self._to_start = self._to_start, None
        if text is None:
            return True
        if not await self._start(text):
            return False
        while self.machine.starting:  # noqa: ASYNC110 - the machine goes on by its own cycles
            await asyncio.sleep(LOOK)
        return True

    def _known(self) -> dict[str, Command]:
        machine = self.machine
        old, first = (1, 4), (5,)

        def told(text: Callable[[], str]) -> Callable[[str], str]:
            return lambda _: text()

        return {
            "load": Command(old, first, self._load, "Error while loading program: {}"),
            "play": Command(old, first, told(self._play), "Failed to execute: play"),
            "stop": Command(old, first, told(self._stop), "Failed to execute: stop"),
            "pause": Command(old, first, told(self._pause), "Failed to execute: pause"),
            "quit": Command(old, first, lambda _: "Disconnected"),
            "shutdown": Command(old, first, told(self._shut_down), NOT_REMOTE),
            "running": Command((1, 6), first, lambda _: f"Program running: {str(self._playing).lower()}"),
            "robotmode": Command((1, 6), first, lambda _: f"Robotmode: {machine.mode.name}"),
            "get loaded program": Command((1, 6), first, told(self._loaded)),
            "popup": Command((1, 6), first, self._show_popup),
            "close popup": Command((1, 6), first, told(self._close_popup)),
            "addtolog": Command(
                (1, 8), first, lambda t: "Added log message" if t else "No log message to add"
            ),
            "isprogramsaved": Command((1, 8), first, lambda _: f"True {self._files.name}"),
            "programstate": Command((1, 8), first, told(self._program_state)),
            "polyscopeversion": Command(
                (1, 8), first, lambda _: "URSoftware {}.{}.{}.{} (simulated)".format(*machine.version)
            ),
            "version": Command(None, first, lambda _: "{}.{}.{}.{}".format(*machine.version)),
            "setuserrole": Command((3, 1), None, self._set_role),
            "getuserrole": Command((3, 1), None, lambda _: self._role),
            "set operational mode": Command(None, first, self._set_operational_mode),
            "get operational mode": Command(None, (5, 6), lambda _: self._operational_mode),
            "clear operational mode": Command(None, first, told(self._clear_operational_mode)),
            "power on": Command(
                (3, 0), first, lambda _: self._power(RobotMode.IDLE, "Powering on"), NOT_REMOTE
            ),
            "power off": Command((3, 0), first, told(self._power_off), NOT_REMOTE),
            "brake release": Command(
                (3, 0), first, lambda _: self._power(RobotMode.RUNNING, "Brake releasing"), NOT_REMOTE
            ),
            "safetymode": Command(
                (3, 0), first, lambda _: f"Safetymode: {SafetyMode(safety_mode(machine)).name}"
            ),
            "safetystatus": Command((3, 11), (5, 4), lambda _: f"Safetystatus: {machine.safety.name}"),
            "unlock protective stop": Command((3, 1), first, told(self._unlock), NOT_REMOTE),
            "close safety popup": Command((3, 1), first, lambda _: "closing safety popup"),
            "load installation": Command(
                (3, 2), first, lambda t: f"Loading installation: {t}", "Failed to load installation: {}"
            ),
            "restart safety": Command((3, 7), (5, 1), told(self._restart_safety), NOT_REMOTE),
            "is in remote control": Command(None, (5, 6), lambda _: str(self._settings.remote).lower()),
            "get serial number": Command(
                (3, 12), (5, 6), lambda _: SERIAL_NUMBERS[e_series(machine.version)]
            ),
            "get robot model": Command(
                (3, 12), (5, 6), lambda _: machine.cell.robot.model.removesuffix("e").upper()
            ),
            "generate flight report": Command((3, 13), (5, 8), self._report),
            "generate support file": Command(
                (3, 13), (5, 8), lambda _: f"Completed successfully: ursupport_{self._reports}.zip"
            ),
            "savelog": Command((3, 13), (5, 8), lambda _: "Log saved to disk"),
        }

    # -- programs

    @property
    def _playing(self) -> bool:
        return self.machine.runtime is RuntimeState.PLAYING

    def _load(self, name: str) -> str:
        return f"{'Loading program' if self._files.load(name) else 'File not found'}: {name}"

    def _loaded(self) -> str:
        return f"Loaded program: {self._files.path}" if self._files.path else "No program loaded"

    def _program_state(self) -> str:
        return f"{PROGRAM_STATES.get(self.machine.runtime, 'STOPPED')} {self._files.name}"

    def _play(self) -> str:
        machine = self.machine
        if machine.play_program():
            return "Starting program"
        if machine.runtime is RuntimeState.STOPPED and machine.may_move and self._files.text:
            self._to_start = self._files.text
            return "Starting program"
        return "Failed to execute: play"

    def _stop(self) -> str:
        self.machine.stop_program()
        return "Stopped"

    def _pause(self) -> str:
        if not self._playing:
            return "Failed to execute: pause"
        self.machine.pause_program()
        return "Pausing program"

    # -- power and safety

    def _power(self, mode: RobotMode, text: str) -> str:
        if not self.machine.power_up(mode):
            return f"Failed to execute: robot is in safety mode {self.machine.safety.name}"
        return text

    def _power_off(self) -> str:
        self.machine.power_off()
        return "Powering off"

    def _shut_down(self) -> str:
        self.machine.power_off()
        return "Shutting down"

    def _unlock(self) -> str:
        machine = self.machine
        if machine.safety is SafetyMode.PROTECTIVE_STOP:
            if machine.time - machine.stopped_at < self._settings.unlock_after:
                return TOO_EARLY.format(self._settings.unlock_after)
            machine.clear_stop()
        return "Protective stop releasing"

    def _restart_safety(self) -> str:
        self.machine.restart_safety()
        return "Restarting safety"

    # -- the pendant

    def _show_popup(self, text: str) -> str:
        self.machine.popup = text
        return "showing popup"

    def _close_popup(self) -> str:
        self.machine.popup = None
        return "closing popup"

    def _set_role(self, role: str) -> str:
        if role.lower() not in USER_ROLES:
            return f"Failed setting user role: {role}"
        self._role = role.upper()
        return f"Setting user role: {role}"

    def _set_operational_mode(self, mode: str) -> str:
        if mode.lower() not in OPERATIONAL_MODES:
            return f"Failed setting operational mode: {mode}"
        self._operational_mode = mode.upper()
        return f"Operational mode {mode} is set"

    def _clear_operational_mode(self) -> str:
        self._operational_mode = "NONE"
        return "No longer controlling the operational mode. Current operational mode: NONE"

    def _report(self, kind: str) -> str:
        if kind.lower() not in REPORTS:
            return f"Unknown report type: {kind}"
        self._reports += 1
        return f"Flight Report generated with id: {self._reports}"
