"""URScript: the program as text for the controller.

The simplest form, for reading and for small jobs: one motion statement a waypoint, no pump. A controller takes one or
two thousand statements at most; larger jobs are run by `twincell run`, which sends them piece by piece.
"""

from __future__ import annotations

from .cell import Cell
from .pose import vector_from_pose
from .program import Program, SegmentKind


def urscript(program: Program, cell: Cell, name: str = "twincell_job") -> str:
    """The program as URScript; metres, as the controller wants them."""
    vectors = vector_from_pose(program.poses)
    vectors[:, :3] *= 1e-3
    tool = vector_from_pose(program.tool[None])
    tool[:, :3] *= 1e-3
    acceleration = cell.robot.acceleration * 1e-3
    lines = [f"def {name}():", f"  set_tcp(p[{_numbers(tool[0])}])"]
    joints = program.joints[0]
    lines.append(f"  movej([{_numbers(joints)}], a=0.5, v=0.5)")
    for segment in program.segments:
        what = f" layer {segment.layer} curve {segment.curve}" if segment.layer >= 0 else ""
        lines.append(f"  # {segment.kind}{what}")
        command = "movep" if segment.kind is SegmentKind.PRINT else "movel"
        for i in range(segment.start + 1, segment.stop):
            printing = segment.kind is SegmentKind.PRINT
            speed = 0.5 * (program.speed[i] + program.speed[i - 1]) if printing else program.speed[i]
            lines.append(
                f"  {command}(p[{_numbers(vectors[i])}], a={acceleration:.4g}, v={speed * 1e-3:.6g}, "
                f"r={program.blend[i] * 1e-3:.6g})"
            )
    return "\n".join([*lines, "end", ""])


def _numbers(values: object) -> str:
    return ", ".join(f"{float(v):.7g}" for v in values)  # type: ignore[attr-defined]
