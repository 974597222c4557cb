"""Moves, paths and stops."""

from __future__ import annotations

import time

from rtde_control import Path, PathEntry
from session import HOME, Session, moved, step, until

THERE = [0.3, -1.4, -1.7, -1.5, 1.4, 0.5]


@step
def move_j(robot: Session):
    with robot.watched() as rows:
        answer = robot.control.moveJ(THERE, 1.0, 4.0)
        end = robot.at_rest()
    return {"answer": answer, "asked": [THERE, 1.0, 4.0], "rows": rows, "end": end}


@step
def move_l(robot: Session):
    start = robot.receive.getActualTCPPose()
    target = moved(start, 0.2, 0.1, -0.05)
    with robot.watched() as rows:
        answer = robot.control.moveL(target, 0.2, 1.0)
        end = robot.at_rest()
    return {"answer": answer, "asked": [target, 0.2, 1.0], "start": start, "rows": rows, "end": end}


@step
def move_between_spaces(robot: Session):
    start = robot.receive.getActualTCPPose()
    turned = [*moved(start, 0.1, -0.1, 0.05)[:3], 2.9, -0.3, 0.2]
    with robot.watched() as rows:
        by_joints = robot.control.moveJ_IK(turned, 1.0, 4.0)
        first = robot.at_rest()
    with robot.watched() as line:
        by_line = robot.control.moveL_FK(THERE, 0.15, 2.0)  # the wrist turns far on this short line
        second = robot.at_rest()
    return {
        "pose": turned,
        "joints": THERE,
        "answers": [by_joints, by_line],
        "ends": [first, second],
        "rows": rows,
        "line": line,
    }


@step
def refused_numbers(robot: Session):
    before = robot.receive.getActualQ()
    refused = []
    for call in (
        lambda: robot.control.moveJ(THERE, 4.0, 1.0),
        lambda: robot.control.moveL(robot.receive.getActualTCPPose(), 0.1, 151.0),
        lambda: robot.control.servoJ(THERE, 0.1, 0.1, 0.008, 0.5, 300),
        lambda: robot.control.moveJ(THERE, float("nan"), 1.0),
    ):
        try:
            call()
            refused.append("")
        except Exception as error:
            refused.append(type(error).__name__)
    robot.settled()
    return {"refused": refused, "before": before, "after": robot.receive.getActualQ()}


@step
def asynchronous_moves(robot: Session):
    start = robot.receive.getActualTCPPose()
    told = []
    for move, target, v, a in (
        (robot.control.moveJ, THERE, 0.4, 4.0),
        (robot.control.moveL, start, 0.1, 2.0),
        (robot.control.moveJ_IK, moved(start, 0.1), 0.1, 4.0),
        (robot.control.moveL_FK, HOME, 0.08, 2.0),
    ):
        before = robot.control.getAsyncOperationProgressEx()
        old_before = robot.control.getAsyncOperationProgress()
        answer = move(target, v, a, True)
        until(
            lambda before=before: (
                robot.control.getAsyncOperationProgressEx().operationId() != before.operationId()
            )
        )
        during = robot.control.getAsyncOperationProgressEx()
        old_during = robot.control.getAsyncOperationProgress()
        waypoint = robot.control.getTargetWaypoint()
        steady = robot.control.isSteady()
        robot.ended()
        after = robot.control.getAsyncOperationProgressEx()
        end = robot.at_rest()
        told.append(
            {
                "answer": answer,
                "target": target,
                "ids": [before.operationId(), during.operationId(), after.operationId()],
                "changes": [before.changeCount(), during.changeCount(), after.changeCount()],
                "running": [s.isAsyncOperationRunning() for s in (before, during, after)],
                "progress": during.progress(),
                "words": [s.value() for s in (before, during, after)],
                "same": [during.equals(during), during.equals(after)],
                "old": [old_before, old_during, robot.control.getAsyncOperationProgress()],
                "waypoint": waypoint,
                "steady": [steady, robot.control.isSteady()],
                "end": end,
            }
        )
    return {"told": told}


@step
def joint_path(robot: Session):
    via, end = [0.2, -1.4, -1.6, -1.6, 1.5, 0.1], [0.4, -1.5, -1.5, -1.6, 1.6, 0.3]
    path = [[*via, 1.0, 4.0, 0.05], [*end, 1.0, 4.0, 0.0]]
    with robot.watched() as rows:
        answer = robot.control.moveJ(path)
        there = robot.at_rest()
    back = [[*via, 1.0, 4.0, 0.0], [*HOME, 1.0, 4.0, 0.0]]
    answer_back = robot.control.moveJ(back, True)
    progress = robot.ended()
    return {
        "answers": [answer, answer_back],
        "waypoints": [via, end],
        "rows": rows,
        "ends": [there, robot.at_rest()],
        "progress": progress,
    }


@step
def tool_path(robot: Session):
    start = robot.receive.getActualTCPPose()
    corners = [moved(start, 0.1), moved(start, 0.1, 0.1), moved(start, 0.0, 0.1)]
    path = [[*corner, 0.25, 2.0, blend] for corner, blend in zip(corners, (0.02, 0.02, 0.0), strict=True)]
    with robot.watched() as rows:
        answer = robot.control.moveL(path)
        there = robot.at_rest()
    answer_back = robot.control.moveL([[*c, 0.25, 2.0, 0.0] for c in (*corners[1::-1], start)], True)
    progress = robot.ended()
    return {
        "answers": [answer, answer_back],
        "start": start,
        "corners": corners,
        "rows": rows,
        "ends": [there, robot.at_rest()],
        "progress": progress,
    }


@step
def mixed_path(robot: Session):
    start = robot.receive.getActualTCPPose()
    corners = [moved(start, 0.05), moved(start, 0.05, 0.1), moved(start, 0.15, 0.1), moved(start, 0.15, 0.2)]
    joint, tool, joints, pose = (
        PathEntry.MoveJ,
        PathEntry.MoveL,
        PathEntry.PositionJoints,
        PathEntry.PositionTcpPose,
    )
    steady = PathEntry.MoveP
    path = Path()
    path.addEntry(PathEntry(joint, joints, [*THERE, 1.0, 4.0, 0.0]))
    path.clear()
    emptied = path.size()
    path.addEntry(PathEntry(joint, pose, [*corners[0], 1.0, 4.0, 0.0]))
    path.addEntry(PathEntry(steady, pose, [*corners[1], 0.1, 1.0, 0.01]))
    path.addEntry(PathEntry(steady, pose, [*corners[2], 0.1, 1.0, 0.01]))
    path.addEntry(PathEntry(steady, pose, [*corners[3], 0.1, 1.0, 0.0]))
    path.addEntry(PathEntry(tool, pose, [*start, 0.5, 2.0, 0.0]))
    path.addEntry(PathEntry(joint, joints, [*THERE, 1.0, 4.0, 0.0]))
    begun = time.monotonic()
    with robot.watched() as rows:
        answer = robot.control.movePath(path, True)
        started = time.monotonic() - begun
        progress = robot.ended()
        end = robot.at_rest()
    short = Path()
    short.appendMovejPath([[*HOME, 1.0, 4.0, 0.0]])
    short.appendMovelPath([[*corners[0], 0.25, 2.0, 0.0]])
    answer_short = robot.control.movePath(short)
    return {
        "sizes": [emptied, path.size(), short.size(), len(short.waypoints())],
        "code": path.toScriptCode(),
        "entry": path.waypoints()[1].toScriptCode(),
        "answers": [answer, answer_short],
        "started_in": started,
        "start": start,
        "corners": corners,
        "joints": THERE,
        "rows": rows,
        "progress": progress,
        "ends": [end, robot.at_rest()],
    }


@step
def a_path_is_stopped(robot: Session):
    start = robot.receive.getActualTCPPose()
    answer = robot.control.moveL(
        [[*moved(start, 0.1), 0.2, 2.0, 0.0], [*moved(start, 0.1, 0.7), 0.2, 2.0, 0.0]], True
    )
    until(lambda: robot.control.getAsyncOperationProgressEx().progress() == 1)
    until(lambda: robot.speed() > 0.1)
    robot.control.stopL(5.0)
    end = robot.at_rest()
    return {
        "answer": answer,
        "running": robot.control.getAsyncOperationProgressEx().isAsyncOperationRunning(),
        "start": start,
        "end": end,
    }


@step
def stops(robot: Session):
    """The script stops the joints until an asynchronous stop was asked for, and the tool from then on."""
    robot.upload()
    found = {}
    start = robot.receive.getActualTCPPose()
    for name, asynchronous, stop, deceleration in (
        ("joints", False, robot.control.stopJ, 0.8),
        ("tool later", True, robot.control.stopL, 0.5),
        ("tool", False, robot.control.stopL, 1.0),
        ("later", True, robot.control.stopJ, 2.0),
    ):
        if name in ("joints", "later"):
            assert robot.control.moveJ([3.0, *HOME[1:]], 0.6, 4.0, True)
            until(lambda: abs(robot.receive.getActualQd()[0] - 0.6) < 1e-9)
        else:
            assert robot.control.moveL(moved(start, y=0.7), 0.2, 4.0, True)
            until(lambda: abs(robot.speed() - 0.2) < 1e-9)
        with robot.watched() as rows:
            robot.news()
            stop(deceleration, asynchronous)
            running = robot.control.getAsyncOperationProgressEx().isAsyncOperationRunning()
            moving = robot.moves()
            end = robot.at_rest()
        found[name] = {
            "rows": rows,
            "asked": deceleration,
            "running": running,
            "moving": moving,
            "after": robot.control.getAsyncOperationProgressEx().isAsyncOperationRunning(),
            "end": end,
        }
        assert robot.control.moveJ(HOME, 3.0, 30.0)
        robot.settled()
    return found
