"""What is printed in tests, and where: pieces of a program, and a cell at other addresses."""

from dataclasses import replace


def at(cell, host, pump_host=None):
    """The cell at other addresses; its pump at those of its robot unless told."""
    return cell.model_copy(
        update={
            "robot": cell.robot.model_copy(update={"host": host}),
            "pump": cell.pump.model_copy(update={"host": pump_host or host}),
        }
    )


def first_curve(program):
    """A program that ends with the first curve of another."""
    stop = program.segments[3].stop
    arrays = (
        "poses",
        "joints",
        "external_axes",
        "speed",
        "blend",
        "width",
        "height",
        "flow",
        "time",
        "layer",
        "curve",
    )
    cut = {name: getattr(program, name)[:stop] for name in arrays}
    return replace(program, segments=program.segments[:4], **cut)
