"""Toolpaths and desktop printers of which the tests make scaled models."""

import re
from itertools import pairwise

import numpy as np
from shapes import stepped_box, vase

from planning.configuration import shipped_configurations
from planning.desktop_printer import load_printer
from twincell.springer import springer, springer_top
from twins import Curve, Layer, Plane, Toolpath, layer_planes, slice_surface

SHIPPED = sorted(path.stem for path in (shipped_configurations() / "printers").glob("*.toml"))
CR10 = (shipped_configurations() / "printers" / "cr10.toml").read_text()
SCALE = 1 / 12.5
WIDTH = 20.0


def several_curves():
    """Two layers with open and closed curves, widths of their own, drawn by hand."""
    square = np.array([[0.0, 0.0], [120.0, 0.0], [120.0, 120.0], [0.0, 120.0]])
    curves = (
        Curve(square),
        Curve(square[::-1] * 0.5 + 30.0, width=np.array([16.0, 20.0, 24.0, 20.0])),
        Curve(np.array([[160.0, 0.0], [190.0, 60.0], [160.0, 120.0]]), closed=False),
    )
    layers = [
        Layer(Plane.horizontal(z - 5.0), Plane.horizontal(z), curves) for z in (10.0, 20.0, 30.0, 40.0, 50.0)
    ]
    return Toolpath(Plane.horizontal(), tuple(layers), 10.0)


def variant(tmp_path, **changes):
    """The CR-10 with other lines of its file."""
    text = CR10
    for key, value in changes.items():
        text, count = re.subn(rf"(?m)^{key} = [^#\n]*", f"{key} = {value}  ", text, count=1)
        assert count == 1, key
    path = tmp_path / "printer.toml"
    path.write_text(text)
    return load_printer(str(path))


def stack(tops, curves=None, base=0.0):
    """Level layers with the same curves: a square without widths of its own."""
    curves = (Curve(np.array([[0.0, 0], [200, 0], [200, 200], [0, 200]])),) if curves is None else curves
    floors = [base, *tops]
    return Toolpath(
        Plane.horizontal(base),
        tuple(
            Layer(Plane.horizontal(0.5 * (a + b)), Plane.horizontal(b), curves) for a, b in pairwise(floors)
        ),
        10.0,
    )


def named_scales(text):
    return [float(n) for n in re.findall(r"(?:at least|at most|choose a scale of) 1:([\d.]+)", text)]


def sliced(name):
    """A toolpath by name."""
    match name:
        case "springer":
            return slice_surface(
                springer(), layer_planes(Plane.horizontal(), springer_top(), 10.0), resolution=10.0
            )
        case "vase":
            return slice_surface(vase(hollow=False), layer_planes(Plane.horizontal(), 400.0, 10.0), 10.0)
        case "stepped box":
            return slice_surface(stepped_box(), layer_planes(Plane.horizontal(), 200.0, 10.0), 10.0)
    return several_curves()
