"""Planning: a toolpath becomes a program."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from twins import Plane, Toolpath

from .bead import drive
from .branch import continuous_branch
from .cell import Cell
from .errors import PlanningError
from .kinematics import arm
from .mix import Mix
from .order import Stop, print_order
from .pose import pose_from_vector
from .program import Program, Segment, SegmentKind
from .settings import PrintSettings
from .timing import bead_times, leg_times

Array = npt.NDArray[np.float64]

BLEND_SHARE = 0.45
"""Largest blend radius as a share of the shorter neighbouring move: two blends never overlap."""

SLOWEST = 0.2
"""Layers that are over before the mix allows the next are slowed down, but not below this share of the speed."""


def plan(
    toolpath: Toolpath, cell: Cell, mix: Mix, settings: PrintSettings, inputs: dict[str, str] | None = None
) -> Program:
    """Plan a toolpath for a cell.

    The tool stands along the normal of each layer's nozzle plane. The local layer height is the distance of a
    waypoint from the nozzle plane below, and the flow is speed · width · local height. Poses that the arm cannot
    take have NaN joints; `check` reports them.

    Args:
        toolpath: in part coordinates, on the bed.
        cell: where it is printed.
        mix: what is printed; layers that are too fast for it are slowed down.
        settings: how it is printed.
        inputs: SHA-256 of the files that all this came from, by name.

    Raises:
        PlanningError: the toolpath has no curves.
    """
    order = print_order(toolpath)
    if not order:
        raise PlanningError("the toolpath has no curves: there is nothing to print")
    speeds = _layer_speeds(toolpath, mix, settings)
    route = _Route()
    for stop in order:
        _add_curve(route, toolpath, stop, cell, settings, speeds[stop.layer])
    points, normals, x_axes = (np.vstack(rows) for rows in (route.points, route.normals, route.x_axes))
    poses = _tool_poses(points, normals, x_axes, cell.bed.plane)
    tool = pose_from_vector(np.array([cell.tool.tcp]))[0]
    model = arm(cell.robot.model)
    joints = continuous_branch(
        model, poses @ np.linalg.inv(tool), cell.robot.home, np.radians(cell.robot.joint_limit_deg)
    )
    width, height, speed = (np.concatenate(rows) for rows in (route.width, route.height, route.speed))
    printed = np.concatenate(route.printed)
    return Program(
        robot=model.name,
        tool=tool,
        segments=tuple(route.segments),
        poses=poses,
        joints=joints,
        external_axes=np.zeros((len(points), 0)),
        speed=speed,
        blend=_blends(points, route.segments, settings.blend),
        width=width,
        height=height,
        flow=np.where(printed, speed * width * height, 0.0),
        time=np.cumsum(np.concatenate(route.duration)),
        layer=np.concatenate(route.layer).astype(np.int32),
        curve=np.concatenate(route.curve).astype(np.int32),
        inputs=dict(inputs or {}),
    )


@dataclass
class _Route:
    """Segments as they are put together, in part coordinates."""

    segments: list[Segment] = field(default_factory=list)
    points: list[Array] = field(default_factory=list)
    normals: list[Array] = field(default_factory=list)
    x_axes: list[Array] = field(default_factory=list)
    speed: list[Array] = field(default_factory=list)
    width: list[Array] = field(default_factory=list)
    height: list[Array] = field(default_factory=list)
    duration: list[Array] = field(default_factory=list)
    layer: list[Array] = field(default_factory=list)
    curve: list[Array] = field(default_factory=list)
    printed: list[npt.NDArray[np.bool_]] = field(default_factory=list)
    count: int = 0

    def add(
        self,
        kind: SegmentKind,
        points: Array,
        planes: list[Plane],
        heading: float,
        speed: Array,
        duration: Array,
        stop: Stop | None = None,
        width: Array | None = None,
        height: Array | None = None,
    ) -> None:
        n = len(points)
        layer, curve = (stop.layer, stop.curve) if stop else (-1, -1)
        self.segments.append(Segment(kind, self.count, self.count + n, layer, curve))
        self.count += n
        x = np.array([np.cos(heading) * plane.x_axis + np.sin(heading) * plane.y_axis for plane in planes])
        self.points.append(points)
        self.normals.append(np.broadcast_to(np.array([plane.normal for plane in planes]), (n, 3)))
        self.x_axes.append(np.broadcast_to(x, (n, 3)))
        self.speed.append(speed)
        self.width.append(np.zeros(n) if width is None else width)
        self.height.append(np.zeros(n) if height is None else height)
        self.duration.append(duration)
        self.layer.append(np.full(n, layer))
        self.curve.append(np.full(n, curve))
        self.printed.append(np.full(n, kind is SegmentKind.PRINT))


def _add_curve(
    route: _Route, toolpath: Toolpath, stop: Stop, cell: Cell, settings: PrintSettings, speed: float
) -> None:
    layer = toolpath.layers[stop.layer]
    curve = layer.curves[stop.curve]
    thickest = float(toolpath.floor_of(stop.layer).height_of(layer.nozzle.to_world(curve.points)).max())
    widest = settings.width if curve.width is None else float(curve.width.max())
    head_room = cell.pump.flow_max / (speed * widest * thickest)
    bead = drive(
        curve,
        stop.start,
        settings.width,
        speed,
        settings.end_speed,
        cell.pump.lag_s,
        cell.robot.acceleration,
        head_room,
    )
    points = layer.nozzle.to_world(bead.points)
    heading = float(np.radians(cell.tool.heading_deg))
    lift = settings.clearance * layer.nozzle.normal
    above = points[0] + lift

    def leg(kind: SegmentKind, start: Array, end: Array, planes: list[Plane], fastest: float) -> None:
        length = np.linalg.norm(end - start)
        duration = np.r_[0.0, leg_times(np.array([length]), fastest, cell.robot.acceleration)]
        route.add(kind, np.array([start, end]), planes, heading, np.full(2, fastest), duration)

    if route.segments:
        last = toolpath.layers[route.segments[-2].layer].nozzle
        leg(SegmentKind.TRAVEL, route.points[-1][-1], above, [last, layer.nozzle], settings.travel_speed)
    leg(SegmentKind.APPROACH, above, points[0], [layer.nozzle], settings.approach_speed)
    length = np.linalg.norm(np.diff(points, axis=0), axis=1)
    route.add(
        SegmentKind.PRINT,
        points,
        [layer.nozzle],
        heading,
        bead.speed,
        np.r_[0.0, bead_times(length, bead.speed)],
        stop,
        bead.width,
        np.asarray(toolpath.floor_of(stop.layer).height_of(points)),
    )
    leg(SegmentKind.RETRACT, points[-1], points[-1] + lift, [layer.nozzle], settings.approach_speed)


def _layer_speeds(toolpath: Toolpath, mix: Mix, settings: PrintSettings) -> list[float]:
    """Print speed of each layer: slower where the mix needs more time before the next layer."""
    speeds = []
    for layer in toolpath.layers:
        length = sum(curve.length for curve in layer.curves)
        slowed = length / mix.layer_interval_min_s if mix.layer_interval_min_s > 0 else settings.speed
        speeds.append(float(np.clip(slowed, SLOWEST * settings.speed, settings.speed)))
    return speeds


def _tool_poses(points: Array, normals: Array, x_axes: Array, bed: Plane) -> Array:
    """Tool poses in the robot's base frame: z against the nozzle plane's normal, x along the heading."""
    poses = np.zeros((len(points), 4, 4))
    z = -normals @ bed.rotation.T
    x = x_axes @ bed.rotation.T
    poses[:, :3, 0] = x
    poses[:, :3, 1] = np.cross(z, x)
    poses[:, :3, 2] = z
    poses[:, :3, 3] = bed.to_world(points)
    poses[:, 3, 3] = 1.0
    return poses


def _blends(points: Array, segments: list[Segment], largest: float) -> Array:
    """Blend radii inside beads; everywhere else the tool comes to rest."""
    blend = np.zeros(len(points))
    for segment in segments:
        if segment.kind is SegmentKind.PRINT and segment.stop - segment.start > 2:
            length = np.linalg.norm(np.diff(points[segment.start : segment.stop], axis=0), axis=1)
            blend[segment.start + 1 : segment.stop - 1] = np.minimum(
                largest, BLEND_SHARE * np.minimum(length[:-1], length[1:])
            )
    return blend
