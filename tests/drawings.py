"""Curves and Rhino models that tests of curve files save."""

import numpy as np
import rhino3dm

from twins.wrapping.space_curve import SpaceCurve


def random_curves(seed, count=20):
    rng = np.random.default_rng(seed)
    return [
        SpaceCurve(
            rng.normal(0, 10.0 ** rng.integers(-1, 4), (n, 3)),
            closed=bool(rng.integers(2)),
            widths=rng.uniform(1, 40, n) if rng.integers(2) else None,
        )
        for n in rng.integers(3, 60, count)
    ]


def point(*values):
    return rhino3dm.Point3d(*(float(value) for value in values))


def rhino_model(*curves, unit=rhino3dm.UnitSystem.Millimeters):
    model = rhino3dm.File3dm()
    model.Settings.ModelUnitSystem = unit
    for curve in curves:
        model.Objects.AddCurve(curve)
    return model
