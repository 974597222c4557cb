"""Inverse kinematics of the UR10e, all branches: ours against eaik, 100,000 poses, in one run."""

import statistics
import time

import numpy as np
from eaik.IK_DH import DhRobot

from planning import arm

POSES = 100_000


def median_seconds(call, runs=5):
    call()
    seconds = []
    for _ in range(runs):
        begin = time.perf_counter()
        call()
        seconds.append(time.perf_counter() - begin)
    return statistics.median(seconds)


def main():
    model = arm("ur10e")
    joints = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, 6))
    poses = model.forward(joints)
    alpha = np.array([np.pi / 2, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
    a = np.array([0.0, model.a2, model.a3, 0.0, 0.0, 0.0])
    d = np.array([model.d1, 0.0, 0.0, model.d4, model.d5, model.d6])
    peer = DhRobot(alpha, a, d)
    ours = median_seconds(lambda: model.inverse(poses))
    theirs = median_seconds(lambda: peer.IK_batched(poses, num_worker_threads=2))
    print(f"{'':24} {'seconds':>9} {'ratio':>7}")
    print(f"{'twincell (numpy)':24} {ours:9.3f} {1.0:7.2f}")
    print(f"{'eaik, 2 threads (C++)':24} {theirs:9.3f} {theirs / ours:7.2f}")


if __name__ == "__main__":
    main()
