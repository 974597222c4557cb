"""What starts, ends and holds programs: scripts of the user's own, the watchdog, a protective stop, reconnecting."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

from session import HOME, Session, moved, step, until


@step
def custom_scripts(robot: Session):
    """Each reads the registers that the IO client wrote, and answers in others."""
    at = robot.offset
    robot.io.setInputIntRegister(18 + at, 21)
    robot.io.setInputDoubleRegister(19 + at, 1.25)
    time.sleep(0.1)  # the client holds a second small package back until the first is acknowledged
    body = (
        f"write_output_integer_register({12 + at}, 2 * read_input_integer_register({18 + at}) + {{add}})\n"
        f"write_output_float_register({13 + at}, 2.0 * read_input_float_register({19 + at}))\n"
        f"set_standard_digital_out({{add}}, True)\n"
    )

    def told():
        robot.news(3)
        receive = robot.receive
        bits = receive.getActualDigitalOutputBits()
        return [receive.getOutputIntRegister(12 + at), receive.getOutputDoubleRegister(13 + at), bits]

    def whole(add: int) -> str:
        lines = "".join(f"  {line}\n" for line in body.format(add=add).splitlines())
        signals = [f"  write_output_integer_register({at}, {k})\n" for k in (1, 2)]
        return f"def whole():\n{signals[0]}{lines}{signals[1]}end\n"

    found = []
    begun = time.monotonic()
    answer = robot.control.sendCustomScriptFunction("partly", body.format(add=1))
    took = time.monotonic() - begun
    found.append([answer, robot.control.isProgramRunning(), told()])
    found.append([robot.control.sendCustomScript(whole(2)), robot.control.isProgramRunning(), told()])
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "whole.script"
        file.write_text(whole(3))
        answer = robot.control.sendCustomScriptFile(str(file))
    found.append([answer, robot.control.isProgramRunning(), told()])
    end = robot.control.moveL(moved(robot.receive.getActualTCPPose(), 0.01), 0.5, 2.0)
    return {"found": found, "moves_again": end, "took": took}


@step
def another_control_script(robot: Session):
    """The client uploads a script of the user's own instead of its own."""
    register = 14 + robot.offset
    text = f"def rtde_control():\n{robot.script.getScript()}end\n"
    start = "        keep_running = True\n"
    marked = text.replace(start, f"        write_output_integer_register({register}, 77)\n{start}")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "control.script"
        file.write_text(marked)
        robot.ask("stop")
        until(lambda: not robot.control.isProgramRunning())
        robot.control.setCustomScriptFile(str(file))
        until(robot.control.isProgramRunning)
        robot.news(3)
        told = robot.receive.getOutputIntRegister(register)
        moves = robot.control.moveJ([0.1, *HOME[1:]], 2.0, 10.0)
        robot.control.setCustomScriptFile("")
    until(robot.control.isProgramRunning)
    return {"changed": marked != text, "told": told, "moves": moves, "end": robot.at_rest()}


@step
def the_script_stops_and_is_sent_again(robot: Session):
    robot.control.stopScript()
    robot.news(5)
    stopped = [
        robot.control.isProgramRunning(),
        robot.receive.getRuntimeState(),
        robot.control.getRobotStatus(),
    ]
    refused = robot.control.moveJ(HOME, 1.0, 4.0)
    begun = time.monotonic()
    answer = robot.control.reuploadScript()
    until(robot.control.isProgramRunning)
    took = time.monotonic() - begun
    robot.news(5)
    runs = [robot.control.isProgramRunning(), robot.receive.getRuntimeState(), robot.control.getRobotStatus()]
    moves = robot.control.moveJ([0.1, *HOME[1:]], 2.0, 10.0)
    return {
        "stopped": stopped,
        "refused": refused,
        "answer": answer,
        "took": took,
        "runs": runs,
        "moves": moves,
        "status": robot.receive.getRobotStatus(),
    }


@step
def the_watchdog(robot: Session):
    start = robot.receive.getActualTCPPose()
    answers = [robot.control.setWatchdog(4.0)]
    assert robot.control.moveL(moved(start, 0.4), 0.05, 1.0, True)
    begun = time.monotonic()
    while time.monotonic() < begun + 0.4:
        answers.append(robot.control.kickWatchdog())
        time.sleep(0.01)
    kicked = robot.receive.getRuntimeState()
    silent = until(lambda: robot.receive.getRuntimeState() == 1)
    return {
        "answers": answers,
        "kicked": kicked,
        "silent": silent,
        "refused": robot.control.moveL(start, 0.2, 1.0),
        "start": start,
        "end": robot.at_rest(),
    }


@step
def a_protective_stop(robot: Session):
    target = moved(robot.receive.getActualTCPPose(), 0.1)
    assert robot.control.moveL(target, 0.05, 1.0, True)
    until(lambda: robot.speed() > 0.025)
    answer = robot.control.triggerProtectiveStop()
    until(robot.receive.isProtectiveStopped)
    end = robot.at_rest()
    found = {
        "answer": answer,
        "stopped": [robot.receive.isProtectiveStopped(), robot.receive.isEmergencyStopped()],
        "modes": [robot.receive.getSafetyMode(), robot.receive.getSafetyStatusBits()],
        "refused": robot.control.moveL(target, 0.2, 1.0),
        "held": [end["pose"], robot.receive.getActualTCPPose()],
        "target": target,
    }
    robot.dashboard.unlockProtectiveStop()
    until(lambda: not robot.receive.isProtectiveStopped())
    robot.dashboard.play()
    until(robot.control.isProgramRunning)
    robot.ended()
    return found | {"end": robot.at_rest(), "runs": robot.control.isProgramRunning()}


@step
def reconnecting(robot: Session):
    connected = [[robot.control.isConnected(), robot.receive.isConnected(), robot.io.isConnected()]]
    robot.receive.disconnect()
    robot.control.disconnect()
    robot.io.disconnect()
    connected.append([robot.control.isConnected(), robot.receive.isConnected(), robot.io.isConnected()])
    answers = [robot.receive.reconnect(), robot.control.reconnect(), robot.io.reconnect()]
    connected.append([robot.control.isConnected(), robot.receive.isConnected(), robot.io.isConnected()])
    until(robot.control.isProgramRunning)
    robot.news(3)
    moves = robot.control.moveJ([0.2, *HOME[1:]], 2.0, 10.0)
    robot.io.setStandardDigitalOut(7, True)
    robot.news(3)
    return {
        "connected": connected,
        "answers": answers,
        "moves": moves,
        "end": robot.at_rest(),
        "bit": robot.receive.getDigitalOutState(7),
    }
