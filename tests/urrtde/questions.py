"""What the controller is asked and told while the arm rests."""

from __future__ import annotations

import time

from session import HOME, Session, moved, step, until

ELSEWHERE = [0.2, -1.3, -1.5, -1.8, 1.4, 0.6]
TOOL = [0.01, 0.02, 0.15, 0.1, 0.2, 0.3]


@step
def forward_and_inverse(robot: Session):
    control = robot.control
    here = robot.receive.getActualTCPPose()
    other = control.getForwardKinematics(ELSEWHERE, control.getTCPOffset())
    flipped = [HOME[0], HOME[1], HOME[2], HOME[3] - 3.0, -HOME[4], HOME[5] + 3.0]
    far = moved(here, 3.0)
    return {
        "here": control.getForwardKinematics(),
        "reported": here,
        "elsewhere": other,
        "with_tool": control.getForwardKinematics(ELSEWHERE, TOOL),
        "flange": [control.getActualToolFlangePose() for _ in range(3)][-1],
        "joints": control.getInverseKinematics(here),
        "near": ELSEWHERE,
        "joints_near": control.getInverseKinematics(other, ELSEWHERE),
        "flipped": flipped,
        "joints_flipped": control.getInverseKinematics(here, flipped, 1e-8, 1e-8),
        "solvable": [
            control.getInverseKinematicsHasSolution(here),
            control.getInverseKinematicsHasSolution(other, ELSEWHERE),
            control.getInverseKinematicsHasSolution(far),
            control.getInverseKinematicsHasSolution(far, HOME),
        ],
        "poses_within": [control.isPoseWithinSafetyLimits(here), control.isPoseWithinSafetyLimits(far)],
        "joints_within": [
            control.isJointsWithinSafetyLimits(HOME),
            control.isJointsWithinSafetyLimits([7.0, *HOME[1:]]),
        ],
    }


@step
def poses_in_poses(robot: Session):
    pairs = [
        ([0.1, 0.2, 0.3, 0.4, -0.5, 0.6], [-0.3, 0.1, 0.2, 1.0, 0.3, -0.7]),
        ([0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.5, 0.6, 0.7, 0.0, 3.1, 0.0]),
        ([1.0, 0.0, -1.0, 0.0, 0.0, 1.5707963], [0.1, 0.2, 0.0, 0.0, 0.0, 0.0]),
    ]
    return {"pairs": pairs, "answers": [robot.control.poseTrans(a, b) for a, b in pairs]}


@step
def the_tool(robot: Session):
    control = robot.control
    before, offset = robot.at_rest(), control.getTCPOffset()
    answers = [control.setTcp(TOOL)]
    after = robot.at_rest()
    told = control.getTCPOffset()
    forward = control.getForwardKinematics()
    answers.append(control.moveL(moved(after["pose"], 0.05), 0.3, 2.0))
    moved_on = robot.at_rest()
    answers.append(control.setTcp(offset))
    return {
        "answers": answers,
        "tool": TOOL,
        "offset": offset,
        "told": told,
        "before": before,
        "after": after,
        "forward": forward,
        "moved": moved_on,
        "restored": control.getTCPOffset(),
    }


@step
def the_payload(robot: Session):
    def told():
        robot.news(3)
        receive = robot.receive
        return [receive.getPayload(), receive.getPayloadCog(), receive.getPayloadInertia()]

    found = [[robot.control.setPayload(2.5, [0.01, 0.02, 0.03]), told()]]
    found.append([robot.control.setPayload(3.5, []), told()])
    inertia = [0.1, 0.2, 0.3, 0.01, 0.02, 0.03]
    found.append([robot.control.setTargetPayload(4.5, [0.03, 0.01, 0.05], inertia), told()])
    found.append([robot.control.setTargetPayload(1.5, [], inertia), told()])
    return {"found": found, "inertia": inertia}


@step
def gravity(robot: Session):
    felt, answers = [], []
    for asked in ([0.0, 9.82, 0.0], [3.0, 0.0, 9.0], [0.0, 0.0, 9.82]):
        answers.append(robot.control.setGravity(asked))
        robot.news(3)
        felt.append([asked, robot.receive.getActualToolAccelerometer(), robot.receive.getActualQ()])
    answers.append(robot.control.moveJ(ELSEWHERE, 2.0, 10.0))
    robot.settled()
    felt.append([[0.0, 0.0, 9.82], robot.receive.getActualToolAccelerometer(), robot.receive.getActualQ()])
    return {"answers": answers, "felt": felt}


@step
def realtime_questions(robot: Session):
    """The client reads the answer to such a question before it can have come: each is asked until it stands."""
    control = robot.control

    def asked(question):
        for _ in range(4):
            answer = question()
            time.sleep(0.01)
        return answer

    robot.news(25)
    resting = asked(lambda: control.getActualJointPositionsHistory(20))
    found = {
        "step": asked(control.getStepTime),
        "torques": asked(control.getJointTorques),
        "flange": asked(control.getActualToolFlangePose),
        "contact": asked(lambda: control.toolContact([0.0, 0.0, 1.0, 0.0, 0.0, 0.0])),
        "resting": resting,
        "steady": control.isSteady(),
        "waypoint": control.getTargetWaypoint(),
        "home": robot.at_rest(),
    }
    with robot.watched() as rows:
        assert control.moveJ(ELSEWHERE, 0.25, 10.0, True)
        until(robot.moves)
        robot.news(60)
        asked_at = robot.receive.getTimestamp()
        control.getActualJointPositionsHistory(30)
        robot.news(6)
        late = control.getActualJointPositionsHistory(30)
        answered_at = robot.receive.getTimestamp()
        robot.ended()
        robot.settled()
    return found | {"history": late, "asked_at": asked_at, "answered_at": answered_at, "rows": rows}


@step
def periods(robot: Session):
    def loop(interface, count: int) -> float:
        begun = time.monotonic()
        for _ in range(count):
            start = interface.initPeriod()
            interface.waitPeriod(start)
        return time.monotonic() - begun

    return {"count": 100, "control": loop(robot.control, 100), "receive": loop(robot.receive, 100)}


@step
def no_contact(robot: Session):
    control = robot.control
    answers = {
        "start": control.startContactDetection([0.0, 0.0, -1.0, 0.0, 0.0, 0.0]),
        "moved": control.moveL(moved(robot.receive.getActualTCPPose(), 0.05), 0.5, 2.0),
        "read": control.readContactDetection(),
        "stop": control.stopContactDetection(),
        "zero": control.zeroFtSensor(),
        "damping": control.forceModeSetDamping(0.1),
        "gain": control.forceModeSetGainScaling(1.2),
    }
    robot.news(2)
    return {
        "answers": answers,
        "force": robot.receive.getActualTCPForce(),
        "runs": control.isProgramRunning(),
    }


@step
def an_external_sensor(robot: Session):
    control = robot.control
    answers = [control.ftRtdeInputEnable(True, 0.5, [0.0, 0.0, 0.05], [0.0, 0.0, 0.02])]
    answers.append(control.ftRtdeInputEnable(False))
    answers.append(control.enableExternalFtSensor(True, 0.5, [0.0, 0.0, 0.05], [0.0, 0.0, 0.02]))
    answers.append(control.enableExternalFtSensor(False))
    answers.append(control.setExternalForceTorque([1.0, -2.0, 3.0, 0.1, 0.2, -0.3]))
    control.kickWatchdog()
    robot.news(5)
    answers.append(control.moveJ([0.1, *HOME[1:]], 2.0, 10.0))
    return {"answers": answers, "runs": control.isProgramRunning()}


@step
def force_in_free_space(robot: Session):
    """Nothing answers the force that is asked for: the tool runs at the limit of its speed."""
    control = robot.control
    frame, selection = [0.0, 0.0, 0.0, 0.0, 0.0, 0.3], [1, 0, 0, 0, 0, 0]
    limits = [0.05, 0.1, 0.1, 0.2, 0.2, 0.2]
    start = robot.at_rest()
    answers = [control.forceMode(frame, selection, [10.0, 0.0, 0.0, 0.0, 0.0, 0.0], 2, limits)]
    until(lambda: robot.speed() > 0.049)
    robot.news(10)
    speed = robot.receive.getActualTCPSpeed()
    answers.append(control.forceModeStop())
    end = robot.at_rest()
    time.sleep(0.02)
    return {
        "answers": answers,
        "frame": frame,
        "limit": limits[0],
        "speed": speed,
        "start": start,
        "end": end,
        "later": robot.receive.getActualTCPPose(),
    }


@step
def hand_guiding(robot: Session):
    control = robot.control
    before = robot.at_rest()
    status, steady = [control.getFreedriveStatus()], [control.isSteady()]
    answers = [control.freedriveMode([1, 1, 1, 0, 0, 0])]
    status.append(control.getFreedriveStatus())
    steady.append(control.isSteady())
    answers.append(control.endFreedriveMode())
    status.append(control.getFreedriveStatus())
    answers.append(control.teachMode())
    steady.append(control.isSteady())
    answers.append(control.endTeachMode())
    steady.append(control.isSteady())
    answers.append(control.moveJ(HOME, 1.0, 4.0))
    return {
        "answers": answers,
        "status": status,
        "steady": steady,
        "before": before,
        "after": robot.at_rest(),
    }
