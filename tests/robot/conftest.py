"""A small program, made by hand: square beads, shaped so that a first-order pump can follow them."""

import numpy as np
import pytest
from urrtde.tour import VARIANTS, Tours

from planning import Program, Segment, SegmentKind, arm, load_cell

CLEARANCE = 20.0
TRAVEL_SPEED, APPROACH_SPEED = 150.0, 30.0
END = 0.03


def bead(corners, speed, lag):
    """Waypoints along a polyline, shape (n, 3), and the speed at each.

    The speed rises evenly over two lags, from rest, and falls exponentially, slower than the pump's flow can.
    """
    corners = np.asarray(corners, dtype=float)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(corners, axis=0), axis=1))])
    total, slowing = along[-1], 1.1 * lag
    rise, fall = speed * lag, speed * slowing * (1.0 - END)
    places = [*along, *np.linspace(0.0, rise, 11), *np.linspace(total - fall, total, 16)]
    s = np.unique(np.round(places, 6))
    # A ramp's waypoint right beside a corner would leave no room for the corner's blend.
    near = np.abs(s[:, None] - along[None, 1:-1]).min(axis=1, initial=np.inf)
    s = s[(near < 1e-3) | (near > 4.0)]
    rising = np.sqrt(np.maximum(speed * s / lag, 0.0))
    falling = (total - s) / slowing + END * speed
    points = np.column_stack([np.interp(s, along, corners[:, axis]) for axis in range(3)])
    return points, np.minimum(np.minimum(rising, falling), speed)


class Beads:
    """Collects segments into a program."""

    def __init__(self, cell):
        self.cell = cell
        self.rows = []  # position, speed, blend, width, height, flow, time, layer, curve
        self.segments = []
        self.time = 0.0

    def add(self, kind, points, speeds, *, blend=0.0, section=(0.0, 0.0), layer=-1, curve=-1, pause=0.0):
        start = len(self.rows)
        for i, (point, speed) in enumerate(zip(points, speeds, strict=True)):
            if i:
                length = np.linalg.norm(point - points[i - 1])
                self.time += pause if kind is SegmentKind.WAIT else 2.0 * length / (speed + speeds[i - 1])
            width, height = section
            row = (*point, speed, blend, width, height, width * height * speed, self.time, layer, curve)
            self.rows.append(row)
        self.segments.append(Segment(kind, start, len(self.rows), layer, curve))

    def print_curve(self, corners, speed, section, layer, curve, blend=2.0):
        points, speeds = bead(corners, speed, self.cell.pump.lag_s)
        above = points[0] + [0.0, 0.0, CLEARANCE]
        start = np.array(self.rows[-1][:3]) if self.rows else above - [60.0, 0.0, 0.0]
        self.add(SegmentKind.TRAVEL, [start, above], [TRAVEL_SPEED] * 2, blend=5.0)
        self.add(SegmentKind.APPROACH, [above, points[0]], [APPROACH_SPEED] * 2)
        first = len(self.rows)
        self.add(SegmentKind.PRINT, points, speeds, section=section, layer=layer, curve=curve)
        for i in range(1, len(points) - 1):  # without a blend the tool stops
            room = 0.45 * min(
                np.linalg.norm(points[i] - points[i - 1]), np.linalg.norm(points[i + 1] - points[i])
            )
            row = list(self.rows[first + i])
            row[4] = min(blend, room)
            self.rows[first + i] = tuple(row)
        self.add(SegmentKind.RETRACT, [points[-1], points[-1] + [0.0, 0.0, CLEARANCE]], [APPROACH_SPEED] * 2)

    def program(self):
        table = np.array(self.rows)
        model = arm(self.cell.robot.model)
        tool = np.eye(4)
        tool[:3, 3] = self.cell.tool.tcp[:3]
        poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (len(table), 1, 1))
        poses[:, :3, 3] = table[:, :3]
        branches = model.inverse(poses @ np.linalg.inv(tool))
        joints = np.empty((len(table), 6))
        before = self.cell.robot.home
        for i, choices in enumerate(branches):
            turned = choices + 2.0 * np.pi * np.round((before - choices) / (2.0 * np.pi))
            joints[i] = before = turned[np.nanargmin(np.abs(turned - before).max(axis=1))]
        return Program(
            robot=self.cell.robot.model,
            tool=tool,
            segments=tuple(self.segments),
            poses=poses,
            joints=joints,
            external_axes=np.empty((len(table), 0)),
            speed=table[:, 3].copy(),
            blend=table[:, 4].copy(),
            width=table[:, 5].copy(),
            height=table[:, 6].copy(),
            flow=table[:, 7].copy(),
            time=table[:, 8].copy(),
            layer=table[:, 9].astype(np.int32),
            curve=table[:, 10].astype(np.int32),
            inputs={},
        )


def square(centre, side):
    """A closed square from one of its corners back to it, shape (5, 3), mm."""
    half = side / 2.0
    ring = np.array([[-half, -half], [half, -half], [half, half], [-half, half], [-half, -half]])
    return np.column_stack([ring, np.zeros(5)]) + np.asarray(centre, dtype=float)


@pytest.fixture
def demo_cell():
    """The cell that ships with the package."""
    return load_cell("ur10e-demo")


@pytest.fixture
def beads(demo_cell):
    """An empty collection of segments for the demo cell."""
    return Beads(demo_cell)


@pytest.fixture
def two_layers(demo_cell):
    """Two squares side by side on the first layer, one on the second; 10 mm layers."""
    made = Beads(demo_cell)
    origin = np.array(demo_cell.bed.origin)
    for layer, curve, x in ((0, 0, -60.0), (0, 1, 60.0), (1, 0, -60.0)):
        corners = square(origin + np.array([x, 0.0, 10.0 * (layer + 1)]), 60.0)
        made.print_curve(corners, 80.0, (12.0, 10.0), layer, curve)
    return made.program()


@pytest.fixture(scope="session")
def tours(request):
    """Tours of ur-rtde's clients, started together for all tests that were chosen."""
    chosen = [getattr(item, "callspec", None) for item in request.session.items]
    running = Tours({spec.params["tour"] for spec in chosen if spec is not None and "tour" in spec.params})
    yield running
    running.close()


# Each version and each range of registers is toured; the other two pairs of them are soaked.
TOURED = [
    variant
    if (variant.version == "5.12") == (variant.registers == "lower")
    else pytest.param(variant, marks=pytest.mark.soak)
    for variant in VARIANTS
]


@pytest.fixture(scope="session", params=TOURED, ids="-".join)
def tour(request, tours):
    """What ur-rtde's clients found at one version of the controller, in one range of registers."""
    return tours[request.param]
