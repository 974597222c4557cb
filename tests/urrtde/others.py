"""The receive, IO, dashboard and script clients."""

from __future__ import annotations

import csv
import tempfile
import time
from pathlib import Path

from rtde_receive import RTDEReceiveInterface
from session import HOME, Session, step, until

WITH_AN_INDEX = {"getDigitalInState", "getDigitalOutState", "getOutputIntRegister", "getOutputDoubleRegister"}
RECEIVED = [
    name
    for name in vars(RTDEReceiveInterface)
    if name.startswith(("get", "is")) and name not in WITH_AN_INDEX
]


def snapshot(robot: Session):
    """Every getter's value, all of one package."""
    while True:
        values = {name: getattr(robot.receive, name)() for name in RECEIVED}
        if robot.receive.getTimestamp() == values["getTimestamp"]:
            return values


@step
def received(robot: Session):
    resting = snapshot(robot)
    robot.control.moveJ([0.5, *HOME[1:]], 0.5, 0.2, True)
    until(lambda: robot.receive.getActualQd()[0] > 0.02)
    speeding = snapshot(robot)
    accelerations = []
    for _ in range(15):
        robot.news(1)
        accelerations.append(robot.receive.getTargetQdd())
    robot.ended()
    bits = [robot.receive.getDigitalInState(i) for i in range(18)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "record.csv"
        recorded = [robot.receive.startFileRecording(str(file), ["timestamp", "actual_q", "actual_TCP_pose"])]
        robot.control.moveJ(HOME, 2.0, 10.0)
        robot.settled()
        recorded.append(robot.receive.stopFileRecording())
        with file.open(newline="") as lines:
            rows = list(csv.reader(lines))
    return {
        "resting": resting,
        "speeding": speeding,
        "accelerations": accelerations,
        "inputs": bits,
        "recorded": recorded,
        "head": rows[0],
        "body": [[float(value) for value in row] for row in rows[1:] if len(row) == len(rows[0])],
    }


@step
def outputs(robot: Session):
    io, receive = robot.io, robot.receive

    def bits() -> int:
        robot.news(3)
        return receive.getActualDigitalOutputBits()

    for i in range(8):
        io.setStandardDigitalOut(i, False)
        io.setConfigurableDigitalOut(i, False)
    found = {"cleared": bits() & 0xFFFF, "set": [], "answers": []}
    for setter, count, first in (
        (io.setStandardDigitalOut, 8, 0),
        (io.setConfigurableDigitalOut, 8, 8),
        (io.setToolDigitalOut, 2, 16),
    ):
        for i in range(count):
            found["answers"].append(setter(i, True))
            until(lambda i=i, first=first: receive.getDigitalOutState(first + i))
            found["set"].append([first + i, bits()])
            found["answers"].append(setter(i, False))
            until(lambda i=i, first=first: not receive.getDigitalOutState(first + i))
    found["afterwards"] = bits()
    found["analog"] = []
    for setter, i, share in (
        (io.setAnalogOutputVoltage, 0, 0.25),
        (io.setAnalogOutputVoltage, 1, 0.75),
        (io.setAnalogOutputCurrent, 0, 0.5),
        (io.setAnalogOutputCurrent, 1, 0.0),
    ):
        found["answers"].append(setter(i, share))
        robot.news(3)
        found["analog"].append([receive.getStandardAnalogOutput0(), receive.getStandardAnalogOutput1()])
    return found


@step
def the_slider(robot: Session):
    answers, told = [], []
    for share in (0.5, 0.25, 1.0):
        answers.append(robot.io.setSpeedSlider(share))
        robot.news(3)
        assert robot.control.moveJ([2.0 if share != 0.25 else -2.0, *HOME[1:]], 0.4, 4.0, True)
        until(lambda share=share: abs(abs(robot.receive.getActualQd()[0]) - 0.4 * share) < 1e-6)
        robot.news(3)
        told.append([share, robot.receive.getTargetSpeedFraction(), robot.receive.getSpeedScalingCombined()])
        robot.control.stopJ(20.0)
        robot.settled()
    return {"answers": answers, "told": told}


@step
def input_registers(robot: Session):
    """What the IO client writes is told by a program that copies it to outputs."""
    at = robot.offset
    answers = []
    for i in range(18, 23):
        answers.append(robot.io.setInputIntRegister(i + at, -1000 - i))
        answers.append(robot.io.setInputDoubleRegister(i + at, 0.5 * i))
    lines = [
        f"write_output_integer_register({i - 6 + at}, read_input_integer_register({i + at}))\n"
        f"write_output_float_register({i - 6 + at}, read_input_float_register({i + at}))\n"
        for i in range(18, 23)
    ]
    answers.append(robot.control.sendCustomScriptFunction("copy", "".join(lines)))
    robot.news(3)
    refused = 0
    for setter in (robot.io.setInputIntRegister, robot.io.setInputDoubleRegister):
        try:
            setter(5, 1)
        except Exception:
            refused += 1
    return {
        "answers": answers,
        "ints": [robot.receive.getOutputIntRegister(i + at) for i in range(12, 17)],
        "doubles": [robot.receive.getOutputDoubleRegister(i + at) for i in range(12, 17)],
        "refused": refused,
    }


@step
def scripts(robot: Session):
    """The script client by itself: its programs take the control script's place."""
    client, at = robot.script, robot.offset
    connected = [client.isConnected()]
    client.connect()
    connected.append(client.isConnected())

    def runs(value: int) -> bool:
        until(lambda: robot.receive.getOutputIntRegister(15 + at) == value)
        return True

    text = f"def told():\n  write_output_integer_register({15 + at}, {{}})\nend\n"
    answers = [client.sendScriptCommand(text.format(5)), runs(5)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "told.script"
        file.write_text(text.format(6))
        answers += [client.sendScript(str(file)), runs(6)]
    until(lambda: robot.receive.getRuntimeState() == 1)
    answers.append(client.sendScript())
    time.sleep(0.3)
    state = robot.receive.getRuntimeState()
    told = client.getScript()
    client.disconnect()
    connected.append(client.isConnected())
    return {"answers": answers, "connected": connected, "text": told, "state": state}


@step
def the_dashboard(robot: Session):
    told: dict[str, object] = {}
    board = robot.dashboard
    told["connected"] = [board.isConnected()]
    for name in (
        "polyscopeVersion",
        "getSerialNumber",
        "getRobotModel",
        "isInRemoteControl",
        "isProgramSaved",
    ):
        told[name] = getattr(board, name)()
    board.loadURP("somewhere.urp")
    for name in ("getLoadedProgram", "programState", "running", "robotmode", "safetymode", "safetystatus"):
        told[name] = getattr(board, name)()
    board.popup("a word")
    board.closePopup()
    board.closeSafetyPopup()
    board.addToLog("a word")
    board.send("version\n")
    told["version"] = board.receive()
    return told


@step
def a_program_is_held(robot: Session):
    board = robot.dashboard
    target = [0.5, *HOME[1:]]
    assert robot.control.moveJ(target, 0.25, 4.0, True)
    until(robot.moves)
    board.pause()
    until(lambda: robot.receive.getRuntimeState() == 4)
    held = robot.at_rest()
    states = [board.programState(), board.running()]
    time.sleep(0.03)
    still = robot.receive.getActualQ()
    board.play()
    until(lambda: robot.receive.getRuntimeState() == 2)
    states += [board.programState(), board.running()]
    robot.ended()
    end = robot.at_rest()
    board.stop()
    until(lambda: robot.receive.getRuntimeState() == 1)
    states += [board.programState(), board.running()]
    return {"states": states, "held": held["q"], "still": still, "target": target, "end": end["q"]}


@step
def power(robot: Session):
    board, receive = robot.dashboard, robot.receive

    def mode(value: int) -> list:
        until(lambda: receive.getRobotMode() == value)
        return [value, board.robotmode(), receive.getRobotStatus() & 1, receive.getJointMode()[0]]

    found = [mode(7)]
    board.powerOff()
    found.append(mode(3))
    refused = robot.control.moveJ(HOME, 1.0, 4.0)
    board.powerOn()
    found.append(mode(5))
    board.brakeRelease()
    found.append(mode(7))
    return {"found": found, "refused": refused}


@step
def the_dashboard_leaves(robot: Session):
    board = robot.dashboard
    board.restartSafety()
    until(lambda: robot.receive.getSafetyMode() == 1)
    try:
        board.setUserRole(0)
        refused = ""
    except TypeError as error:
        refused = str(error)
    board.quit()
    board.disconnect()
    connected = [board.isConnected()]
    board.connect()
    connected.append(board.isConnected())
    board.shutdown()
    board.disconnect()
    connected.append(board.isConnected())
    return {"connected": connected, "refused": refused}
