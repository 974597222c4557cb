"""Kinematics of the UR arms in closed form.

All UR arms share one layout: joints 2, 3 and 4 are parallel, joint 5 is square to them and joint 6 square to
5. Six lengths of the Denavit-Hartenberg table tell one model from another. With z the base's vertical and, in
the plane that the arm moves in, x1 its horizontal direction and n its normal, the arm's bones are

    d1 z,   a2 and a3 in the plane,   d4 n,   d5 along joint 5's axis,   d6 along the flange's z.

The inverse runs backwards: the wrist's distance d4 from the arm's plane gives joint 1 (two shoulders), the
flange's angle to n gives joints 5 and 6 (two wrists), and a triangle with sides a2 and a3 gives the rest (two
elbows).
"""

from __future__ import annotations

from dataclasses import dataclass
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from .errors import ConfigurationError

if TYPE_CHECKING:
    from collections.abc import Mapping

Array = npt.NDArray[np.float64]

LENGTH_TOLERANCE = 2e-10  # mm: a pose this little out of reach, by rounding, counts as on the limit
ANGLE_TOLERANCE = 1e-12  # sine of joint 5 below which joint 6 has no direction of its own
VERTICAL = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True)
class Arm:
    """A UR arm with the nominal lengths of its DH table, mm.

    Attributes:
        name: model name in lower case.
        d1, a2, a3, d4, d5, d6: as in the manufacturer's table; a2 and a3 are negative.
    """

    name: str
    d1: float
    a2: float
    a3: float
    d4: float
    d5: float
    d6: float

    def forward(self, joints: Array) -> Array:
        """Flange poses in the base frame, shape (n, 4, 4), mm, for joint angles of shape (n, 6), rad."""
        q = np.asarray(joints, dtype=np.float64).reshape(-1, 6)
        x1, normal = _arm_plane(q[:, 0])
        pitch = (q[:, 1] + q[:, 2] + q[:, 3])[:, None]
        x4 = np.cos(pitch) * x1 + np.sin(pitch) * VERTICAL
        y5 = -np.sin(pitch) * x1 + np.cos(pitch) * VERTICAL
        c5, s5, c6, s6 = (f(q[:, j])[:, None] for j in (4, 5) for f in (np.cos, np.sin))
        x5 = c5 * x4 + s5 * normal
        z5 = c5 * normal - s5 * x4
        forearm = q[:, 1] + q[:, 2]
        out = (self.a2 * np.cos(q[:, 1]) + self.a3 * np.cos(forearm))[:, None]
        up = (self.a2 * np.sin(q[:, 1]) + self.a3 * np.sin(forearm) + self.d1)[:, None]

        poses = np.zeros((len(q), 4, 4))
        poses[:, :3, 0] = c6 * x5 + s6 * y5
        poses[:, :3, 1] = c6 * y5 - s6 * x5
        poses[:, :3, 2] = z5
        poses[:, :3, 3] = out * x1 + up * VERTICAL + self.d4 * normal - self.d5 * y5 + self.d6 * z5
        poses[:, 3, 3] = 1.0
        return poses

    def inverse(self, poses: Array) -> Array:
        """All joint angles that reach flange poses of shape (n, 4, 4), mm.

        Returns:
            Shape (n, 8, 6), rad, each in (-pi, pi]; NaN where a branch has no solution. Branch
            4·shoulder + 2·wrist + elbow is one kind of posture: followed along a path it changes smoothly,
            apart from whole turns. Where joints 4 and 6 are parallel, joint 6 is 0 if the arm reaches the
            pose so, and otherwise brings the wrist as near to (or as far from) the shoulder as it can.
        """
        poses = np.asarray(poses, dtype=np.float64).reshape(-1, 4, 4)
        rotations, tips = poses[:, :3, :3], poses[:, :3, 3]
        wrist = tips - self.d6 * rotations[:, :, 2]
        reach = np.hypot(wrist[:, 0], wrist[:, 1])
        heading = np.arctan2(wrist[:, 1], wrist[:, 0])
        square = (reach - self.d4) * (reach + self.d4)
        square = np.where(reach < self.d4 - LENGTH_TOLERANCE, np.nan, np.maximum(square, 0.0))

        shoulder = np.arctan2(self.d4, np.sqrt(square)[:, None] * [1.0, 1.0, -1.0, -1.0])
        q1 = (heading[:, None] + shoulder).ravel()
        sign = np.tile([1.0, -1.0, 1.0, -1.0], len(poses))
        branches = self._elbows(np.repeat(rotations, 4, axis=0), np.repeat(tips, 4, axis=0), q1, sign)
        solutions = branches.reshape(-1, 8, 6)
        wrapped = np.pi - np.mod(np.pi - solutions, 2.0 * np.pi)
        return np.where(wrapped <= -np.pi, np.pi, wrapped)  # rounding may land on the open end

    def _elbows(self, rotations: Array, tips: Array, q1: Array, sign: Array) -> Array:
        """Both elbows, shape (n, 2, 6), for given joints 1 and signs of joint 5, each of shape (n,)."""
        x1, normal = _arm_plane(q1)
        along = np.einsum("nij,ni->nj", rotations, normal)  # the flange's axes along the arm plane's normal
        sine = np.hypot(along[:, 0], along[:, 1])
        q5 = np.arctan2(sign * sine, along[:, 2])
        q6 = np.arctan2(-sign * along[:, 1], sign * along[:, 0])
        q6 = np.where(sine > ANGLE_TOLERANCE, q6, self._parallel_wrist(rotations, tips, x1))
        c5, s5, c6, s6 = (f(q)[:, None] for q in (q5, q6) for f in (np.cos, np.sin))
        x5 = c6 * rotations[:, :, 0] - s6 * rotations[:, :, 1]
        y5 = s6 * rotations[:, :, 0] + c6 * rotations[:, :, 1]
        x4 = c5 * x5 - s5 * rotations[:, :, 2]
        pitch = np.arctan2(x4[:, 2], (x4 * x1).sum(axis=1))

        end = tips - self.d6 * rotations[:, :, 2] + self.d5 * y5  # where the forearm ends, beside the plane
        out, up = (end * x1).sum(axis=1), end[:, 2] - self.d1
        a2, a3 = self.a2, self.a3
        distance = np.hypot(out, up)
        possible = self._beyond_reach(distance) == 0.0
        cosine = np.where(possible, (distance * distance - a2 * a2 - a3 * a3) / (2.0 * a2 * a3), np.nan)
        bend = np.arctan2(np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 0.0)), cosine)

        solutions = np.empty((len(q1), 2, 6))
        for elbow, q3 in enumerate((bend, -bend)):
            q2 = np.arctan2(up, out) - np.arctan2(a3 * np.sin(q3), a2 + a3 * np.cos(q3))
            solutions[:, elbow] = np.column_stack([q1, q2, q3, pitch - q2 - q3, q5, q6])
        solutions[np.isnan(solutions).any(axis=2)] = np.nan  # all six or none
        return solutions

    def _parallel_wrist(self, rotations: Array, tips: Array, x1: Array) -> Array:
        """A choice of joint 6, shape (n,), where it is free because joint 4 can take over its turn."""
        hub = tips - self.d6 * rotations[:, :, 2]
        out, up = (hub * x1).sum(axis=1), hub[:, 2] - self.d1
        y6 = rotations[:, :, 1]
        ends = np.hypot(out + self.d5 * (y6 * x1).sum(axis=1), up + self.d5 * y6[:, 2])
        pull = -self._beyond_reach(ends)[:, None]  # along the line from the shoulder
        y5 = pull * (out[:, None] * x1 + up[:, None] * VERTICAL)
        turn: Array = np.arctan2((y5 * rotations[:, :, 0]).sum(axis=1), (y5 * y6).sum(axis=1))
        return turn

    def _beyond_reach(self, distance: Array) -> Array:
        """1 where upper arm and forearm are too short for a distance, -1 where too unequal, else 0."""
        far = distance > abs(self.a2 + self.a3) + LENGTH_TOLERANCE
        near = distance < abs(self.a2 - self.a3) - LENGTH_TOLERANCE
        return far.astype(np.float64) - near.astype(np.float64)


def _arm_plane(q1: Array) -> tuple[Array, Array]:
    """Horizontal direction and normal of the plane that the arm moves in, each of shape (n, 3)."""
    c, s, o = np.cos(q1), np.sin(q1), np.zeros_like(q1)
    return np.column_stack([c, s, o]), np.column_stack([s, -c, o])


# Universal Robots, "DH parameters for calculations of kinematics and dynamics". A real arm differs by its
# calibration.
_NOMINAL = (
    Arm("ur3", 151.9, -243.65, -213.25, 112.35, 85.35, 81.9),
    Arm("ur5", 89.159, -425.0, -392.25, 109.15, 94.65, 82.3),
    Arm("ur10", 127.3, -612.0, -572.3, 163.941, 115.7, 92.2),
    Arm("ur3e", 151.85, -243.55, -213.2, 131.05, 85.35, 92.1),
    Arm("ur5e", 162.5, -425.0, -392.2, 133.3, 99.7, 99.6),
    Arm("ur10e", 180.7, -612.7, -571.55, 174.15, 119.85, 116.55),
    Arm("ur16e", 180.7, -478.4, -360.0, 174.15, 119.85, 116.55),
    Arm("ur20", 236.3, -862.0, -728.7, 201.0, 159.3, 154.3),
    Arm("ur30", 236.3, -637.0, -503.7, 201.0, 159.3, 154.3),
)

ARMS: Mapping[str, Arm] = MappingProxyType({arm.name: arm for arm in _NOMINAL})
"""Every arm that is known, by name."""


def arm(name: str) -> Arm:
    """The arm of a model name, as in a cell's `robot.model`.

    Raises:
        ConfigurationError: no such arm; the message lists those that exist.
    """
    try:
        return ARMS[name]
    except KeyError:
        raise ConfigurationError(
            f"robot model '{name}' is not known; choose one of {', '.join(ARMS)}"
        ) from None
