"""What steers the arm from moment to moment: speeds, servo targets, jogging."""

from __future__ import annotations

import math
import time

from rtde_control import RTDEControlInterface
from session import HOME, Session, moved, step, until


@step
def tool_speeds(robot: Session):
    with robot.watched() as rows:
        answers = [robot.control.speedL([0.0, 0.1, 0.0, 0.0, 0.0, 0.0], 0.5)]
        until(lambda: abs(robot.receive.getActualTCPSpeed()[1] - 0.1) < 1e-6)
        answers.append(robot.control.speedL([0.05, 0.0, 0.0, 0.0, 0.0, 0.04], 1.0, 0.1))
        until(lambda: abs(robot.receive.getActualTCPSpeed()[5] - 0.04) < 1e-6)
        speed = robot.receive.getActualTCPSpeed()
        target = robot.receive.getTargetTCPSpeed()
    with robot.watched() as stop:
        robot.news()
        answers.append(robot.control.speedStop(0.2))
        end = robot.at_rest()
    return {"answers": answers, "rows": rows, "speed": speed, "target": target, "stop": stop, "end": end}


@step
def joint_speeds(robot: Session):
    with robot.watched() as rows:
        answers = [robot.control.speedJ([0.3, 0.0, 0.0, 0.0, 0.0, -0.2], 1.0)]
        until(lambda: abs(robot.receive.getActualQd()[0] - 0.3) < 1e-6)
        speeds = robot.receive.getActualQd()
        target = robot.receive.getTargetQd()
    with robot.watched() as stop:
        robot.news()
        answers.append(robot.control.speedStop(0.5))
        end = robot.at_rest()
    return {"answers": answers, "rows": rows, "speeds": speeds, "target": target, "stop": stop, "end": end}


@step
def servo_joints(robot: Session):
    target = [0.1, *HOME[1:4], 1.5, 0.1]
    answers = []
    with robot.watched() as rows:
        deadline = time.monotonic() + 4.0
        while math.dist(robot.receive.getActualQ(), target) > 1e-5 and time.monotonic() < deadline:
            answers.append(robot.control.servoJ(target, 0.5, 0.5, 0.002, 0.1, 300))
            time.sleep(0.002)
    answers.append(robot.control.servoStop())
    return {"answers": answers, "target": target, "lookahead": 0.1, "rows": rows, "end": robot.at_rest()}


@step
def servo_tool(robot: Session):
    """A target that runs away at an even speed, then waits."""
    start = robot.receive.getActualTCPPose()
    begun = robot.receive.getTimestamp()
    speed, lookahead, seconds = 0.05, 0.1, 1.6
    answers, lags = [], []
    while (now := robot.receive.getTimestamp() - begun) < seconds:
        target = moved(start, y=speed * now)
        if now > 0.5 * seconds:
            lags.append(target[1] - robot.receive.getActualTCPPose()[1])
        answers.append(robot.control.servoL(target, 0.5, 0.5, 0.002, lookahead, 300))
        time.sleep(0.002)
    target = moved(start, y=speed * seconds)
    answers.append(robot.control.servoL(target, 0.5, 0.5, 0.002, lookahead, 300))
    until(lambda: math.dist(robot.receive.getActualTCPPose()[:3], target[:3]) < 1e-6)
    answers.append(robot.control.servoStop(5.0))
    return {
        "answers": answers,
        "lags": lags,
        "speed": speed,
        "lookahead": lookahead,
        "target": target,
        "end": robot.at_rest(),
    }


@step
def servo_circular(robot: Session):
    """The client leaves this command in its register, where it keeps others out: the program is stopped at the end."""
    target = moved(robot.receive.getActualTCPPose(), 0.05, 0.05)
    with robot.watched() as rows:
        answers = [robot.control.servoC(target, 0.1, 1.0, 0.0)]
        until(lambda: math.dist(robot.receive.getActualTCPPose()[:3], target[:3]) < 1e-6, 2.0)
        robot.news(10)
    end = robot.at_rest()
    robot.dashboard.stop()
    until(lambda: not robot.control.isProgramRunning())
    answers.append(robot.control.servoStop())
    return {"answers": answers, "target": target, "rows": rows, "end": end}


@step
def jogging(robot: Session):
    found = []
    frame = [0.3, -0.2, 0.1, 0.0, 0.3, 0.6]
    base, tool = RTDEControlInterface.FEATURE_BASE, RTDEControlInterface.FEATURE_TOOL
    custom = RTDEControlInterface.FEATURE_CUSTOM
    for name, speeds, feature in (
        ("base", [0.02, 0.05, 0.0, 0.0, 0.0, 0.0], base),
        ("tool", [0.0, 0.01, 0.05, 0.0, 0.0, 0.0], tool),
        ("custom", [0.05, 0.0, 0.0, 0.0, 0.1, 0.0], custom),
    ):
        robot.ready()
        pose = robot.receive.getActualTCPPose()
        answer = robot.control.jogStart(speeds, feature, 0.5, frame)
        wanted = math.hypot(*speeds[:3])
        until(lambda wanted=wanted: robot.speed() > 0.999 * wanted)
        robot.news(8)
        speed = robot.receive.getActualTCPSpeed()
        slower = [0.5 * one for one in speeds]
        again = robot.control.jogStart(slower, feature, 0.5, frame)
        until(lambda wanted=wanted: robot.speed() < 0.501 * wanted)
        robot.news(8)
        half = robot.receive.getActualTCPSpeed()
        stopped = robot.control.jogStop()
        found.append(
            {
                "name": name,
                "asked": speeds,
                "pose": pose,
                "frame": frame,
                "answers": [answer, again, stopped],
                "speed": speed,
                "half": half,
                "end": robot.at_rest(),
            }
        )
    return {"found": found}
